"""Calls in threads of their own: what comes back, what is cancelled, and that one that hangs holds up nobody."""

import asyncio
import threading

import anyio
import pytest

from plannerforge.engine.execution import in_own_thread, run_in
from plannerforge.schemas.errors import NotPossible

pytestmark = pytest.mark.anyio


async def thread_of_this() -> int:
    await anyio.sleep(0)
    return threading.get_ident()


async def refuse(word: str) -> None:
    raise NotPossible(word)


async def test_function_runs_in_a_thread_and_loop_of_its_own() -> None:
    own = threading.get_ident()
    first = await in_own_thread(thread_of_this)
    assert first != own
    assert await in_own_thread(thread_of_this) == first, "the thread is kept for the next call"


async def test_what_a_function_raises_comes_back() -> None:
    with pytest.raises(NotPossible, match="the lane ends"):
        await in_own_thread(refuse, "the lane ends")


async def test_calls_at_once_have_different_threads() -> None:
    met: set[int] = set()
    both = threading.Barrier(2, timeout=60)

    async def meet() -> None:
        both.wait()
        met.add(threading.get_ident())

    async with anyio.create_task_group() as tasks:
        for _ in range(2):
            tasks.start_soon(in_own_thread, meet)
    assert len(met) == 2


async def test_loop_serves_others_while_a_call_blocks_its_thread() -> None:
    goes_on = threading.Event()

    async def block() -> bool:
        return goes_on.wait(60)

    async with anyio.create_task_group() as tasks:

        async def release() -> None:
            goes_on.set()

        tasks.start_soon(release)
        assert await in_own_thread(block)


async def test_what_belongs_to_the_home_loop_runs_there() -> None:
    home, own = asyncio.get_running_loop(), threading.get_ident()

    async def call() -> int:
        return await run_in(home, thread_of_this)

    assert await in_own_thread(call) == own
    assert await run_in(home, thread_of_this) == own, "the caller's own loop needs no detour"


async def test_cancelled_call_ends_there_before_its_caller_goes_on() -> None:
    ended: list[str] = []
    begun = anyio.Event()
    home = asyncio.get_running_loop()

    async def tell() -> None:
        begun.set()

    async def wait_for_good() -> None:
        await run_in(home, tell)
        try:
            await anyio.sleep_forever()
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.sleep(0.01)
            ended.append("call")

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(in_own_thread, wait_for_good)
        await begun.wait()
        tasks.cancel_scope.cancel()
    assert ended == ["call"]


async def test_cancelled_call_cancels_what_it_waits_for_at_home() -> None:
    ended: list[str] = []
    begun = anyio.Event()
    home = asyncio.get_running_loop()

    async def work_at_home() -> None:
        begun.set()
        try:
            await anyio.sleep_forever()
        finally:
            ended.append("work")

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(in_own_thread, run_in, home, work_at_home)
        await begun.wait()
        tasks.cancel_scope.cancel()
    assert ended == ["work"]


async def test_call_that_hangs_is_left_behind_after_a_while() -> None:
    goes_on, begun = threading.Event(), anyio.Event()
    home = asyncio.get_running_loop()

    async def hang() -> None:
        home.call_soon_threadsafe(begun.set)
        goes_on.wait()

    async def call() -> None:
        await run_in(other, hang, patience_s=0.05)

    other = await in_own_thread(_loop_of_this)
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(call)
        await begun.wait()
        tasks.cancel_scope.cancel()
    goes_on.set()
    assert await run_in(other, thread_of_this) != threading.get_ident(), "it is there again"


async def _loop_of_this() -> asyncio.AbstractEventLoop:
    return asyncio.get_running_loop()
