"""Calls in threads of their own: what comes back, what is cancelled, and that one that hangs holds up nobody."""

import asyncio
import threading
from collections.abc import Iterator

import anyio
import pytest

from plannerforge.engine.execution import CallThreads, OwnThread, run_in
from plannerforge.schemas.errors import NotPossible, ResourceFailure

pytestmark = pytest.mark.anyio


@pytest.fixture
def threads() -> Iterator[CallThreads]:
    lent = CallThreads()
    yield lent
    lent.close()


async def thread_of_this() -> int:
    await anyio.sleep(0)
    return threading.get_ident()


async def refuse(word: str) -> None:
    raise NotPossible(word)


async def test_a_function_runs_in_its_own_thread_and_loop(threads: CallThreads) -> None:
    own = threading.get_ident()
    first = await threads.run(thread_of_this)
    assert first != own
    assert await threads.run(thread_of_this) == first, "the thread is kept for the next call"


async def test_an_exception_of_a_function_comes_back(threads: CallThreads) -> None:
    with pytest.raises(NotPossible, match="the lane ends"):
        await threads.run(refuse, "the lane ends")


async def test_calls_at_once_have_different_threads(threads: CallThreads) -> None:
    met: set[int] = set()
    both = threading.Barrier(2, timeout=60)

    async def meet() -> None:
        both.wait()
        met.add(threading.get_ident())

    async with anyio.create_task_group() as tasks:
        for _ in range(2):
            tasks.start_soon(threads.run, meet)
    assert len(met) == 2


async def test_loop_serves_others_while_a_call_blocks_its_thread(threads: CallThreads) -> None:
    goes_on = threading.Event()

    async def block() -> bool:
        return goes_on.wait(60)

    async with anyio.create_task_group() as tasks:

        async def release() -> None:
            goes_on.set()

        tasks.start_soon(release)
        assert await threads.run(block)


async def test_functions_of_the_home_loop_run_there(threads: CallThreads) -> None:
    home, own = asyncio.get_running_loop(), threading.get_ident()

    async def call() -> int:
        return await run_in(home, thread_of_this)

    assert await threads.run(call) == own
    assert await run_in(home, thread_of_this) == own, "the caller's own loop needs no detour"


async def test_a_cancelled_call_ends_before_its_caller_continues(threads: CallThreads) -> None:
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
        tasks.start_soon(threads.run, wait_for_good)
        await begun.wait()
        tasks.cancel_scope.cancel()
    assert ended == ["call"]


async def test_a_cancelled_call_cancels_its_work_in_the_home_loop(threads: CallThreads) -> None:
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
        tasks.start_soon(threads.run, run_in, home, work_at_home)
        await begun.wait()
        tasks.cancel_scope.cancel()
    assert ended == ["work"]


async def test_call_that_hangs_is_left_behind_after_a_while(threads: CallThreads) -> None:
    goes_on, begun = threading.Event(), anyio.Event()
    home = asyncio.get_running_loop()

    async def hang() -> None:
        home.call_soon_threadsafe(begun.set)
        goes_on.wait()

    async def call() -> None:
        await run_in(other, hang, patience_s=0.05)

    other = await threads.run(_loop_of_this)
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(call)
        await begun.wait()
        tasks.cancel_scope.cancel()
    goes_on.set()
    assert await run_in(other, thread_of_this) != threading.get_ident(), "it is there again"


async def test_waiting_threads_end_when_closed_and_later_calls_get_new_ones(threads: CallThreads) -> None:
    first = await threads.run(asyncio_thread)
    threads.close()
    first.join(60)
    assert not first.is_alive()
    assert await threads.run(asyncio_thread) is not first


async def asyncio_thread() -> threading.Thread:
    return threading.current_thread()


async def _loop_of_this() -> asyncio.AbstractEventLoop:
    return asyncio.get_running_loop()


async def test_call_fails_by_name_if_no_thread_can_be_started_and_the_next_one_is_served(
    threads: CallThreads, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refuse_to_start)
        with pytest.raises(ResourceFailure):
            await threads.run(thread_of_this)
    assert await threads.run(thread_of_this)


async def test_own_thread_serves_when_no_other_can_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    own = OwnThread()
    monkeypatch.setattr(threading.Thread, "start", refuse_to_start)
    assert await own.run(sum, (1, 2)) == 3
    own.end()


def refuse_to_start(thread: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")
