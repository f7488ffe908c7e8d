"""Runs calls and jobs in separate threads, so that they never block other answers of the server.

``CallThreads`` gives a call a thread with an event loop for its whole duration: reading arguments, SQLite, files, and
shaping the answer. ``run_in`` calls functions that belong to the server's own loop (workers, the client's stream).
Ordinary async functions thus run outside the server's loop without any code for threads.
"""

import asyncio
import contextlib
import math
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import anyio

from ...schemas.errors import error_to_report
from .executor import Executor, ExecutorAround, OnProgress, Operation, Request, Response, no_progress

_Result = TypeVar("_Result")
_MOST_IDLE = 8
"""Threads kept for the next call (chosen: clients have few calls under way)."""
_PATIENCE_S = 5.0
"""Time to wait for a cancelled call (chosen); a call that hangs (a dead network disk) keeps only its thread."""


class CallThreads:
    """Threads with event loops that serve one call after another; a few stay for the next calls."""

    def __init__(self) -> None:
        self._idle: list[_LentThread] = []  # pop and append are atomic

    async def run(self, function: Callable[..., Awaitable[_Result]], *arguments: object) -> _Result:
        """Run an async function in a thread with its own event loop, and return its result.

        If the caller is cancelled, the function is cancelled too; the caller waits for its end, at most 5 s.

        Raises:
            Exception: The function raised it.
            ResourceFailure: No thread is idle, and the operating system cannot start another one.
        """
        try:
            thread = self._idle.pop()
        except IndexError:
            thread = _start_thread()
        return await run_in(thread.loop, self._carry_out, thread, function, arguments, patience_s=_PATIENCE_S)

    def close(self) -> None:
        """End the idle threads; a later call gets a new one."""
        while self._idle:
            self._idle.pop().end()

    async def _carry_out(
        self, thread: "_LentThread", function: Callable[..., Awaitable[_Result]], arguments: tuple[object, ...]
    ) -> _Result:
        """Run the function, then keep its thread for the next call, even if the caller no longer waits."""
        try:
            return await function(*arguments)
        finally:
            if len(self._idle) < _MOST_IDLE:
                self._idle.append(thread)
            else:
                thread.end()


class OwnThread:
    """A thread reserved for one user; the user neither waits for other threads nor is affected by their limit."""

    def __init__(self) -> None:
        self._thread = _start_thread()

    async def run(self, function: Callable[..., _Result], *arguments: object) -> _Result:
        """Call a function in the thread and return its result; a cancelled caller does not wait for its end.

        Raises:
            Exception: The function raised it.
        """

        async def called() -> _Result:
            return function(*arguments)

        return await run_in(self._thread.loop, called, patience_s=0.0)

    def end(self) -> None:
        """End the thread after its current work."""
        self._thread.end()


async def run_in(
    loop: asyncio.AbstractEventLoop,
    function: Callable[..., Awaitable[_Result]],
    *arguments: object,
    patience_s: float = math.inf,
) -> _Result:
    """Run an async function in the event loop of another thread, or directly if it is the caller's own.

    If the caller is cancelled, the function is cancelled too; the caller waits for its end, at most ``patience_s``
    seconds.

    Raises:
        Exception: The function raised it.
        RuntimeError: The loop is closed.
    """
    here = asyncio.get_running_loop()
    if loop is here:
        return await function(*arguments)
    ended, scope, errand = anyio.Event(), anyio.CancelScope(), _Errand[_Result]()

    async def there() -> None:
        try:
            with scope:
                errand.results.append(await function(*arguments))
        except BaseException as raised:  # noqa: BLE001 - it is raised again in the caller
            errand.error = raised
        finally:
            with contextlib.suppress(RuntimeError):  # the caller's loop ended without waiting
                here.call_soon_threadsafe(ended.set)

    def start() -> None:
        errand.task = loop.create_task(there())

    loop.call_soon_threadsafe(start)
    try:
        await ended.wait()
    except anyio.get_cancelled_exc_class():
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(scope.cancel)
        with anyio.move_on_after(patience_s, shield=True):
            await ended.wait()
        raise
    if errand.error is not None:
        raise errand.error
    return errand.results[0]


@dataclass
class _Errand(Generic[_Result]):
    """The outcome of a function in another thread; it keeps the task from being garbage-collected."""

    results: list[_Result] = field(default_factory=list)
    error: BaseException | None = None
    task: asyncio.Task[None] | None = None


class _LentThread:
    """A thread with an event loop."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        try:
            threading.Thread(target=self._serve, name="call", daemon=True).start()
        except BaseException:
            self.loop.close()
            raise

    def end(self) -> None:
        """Stop the loop after its current work."""
        self.loop.call_soon_threadsafe(self.loop.stop)

    def _serve(self) -> None:
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_forever()
        finally:
            self.loop.close()


def _start_thread() -> _LentThread:
    try:
        return _LentThread()
    except RuntimeError as error:
        raise error_to_report(error, "a thread") from error


class ReachableExecutor(ExecutorAround):
    """An executor of the event loop that creates it, for callers in other threads' loops."""

    def __init__(self, inner: Executor) -> None:
        super().__init__(inner)
        self._home = asyncio.get_running_loop()

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation in the executor's loop, and report progress in the caller's loop."""
        own = asyncio.get_running_loop()

        async def tell(share: float, message: str) -> None:
            await run_in(own, on_progress, share, message)

        async def run() -> Response:
            listener = no_progress if on_progress is no_progress else tell
            return await self._inner.run(operation, request, on_progress=listener)

        return await run_in(self._home, run)
