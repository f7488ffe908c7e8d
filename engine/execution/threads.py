"""Calls and jobs in threads of their own, so that nothing they do keeps the server from answering others.

``CallThreads`` lends a thread with an event loop to a call, in which the whole of it runs: reading of arguments,
SQLite, files, shaping of the answer. What belongs to the server's own loop (workers, the client's stream) is reached by
``run_in``.
Whatever is written as an ordinary async function is thereby off the server's loop, without a word about threads in it.
"""

import asyncio
import contextlib
import math
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import anyio

from ...schemas.errors import as_told
from .executor import Executor, ExecutorAround, OnProgress, Operation, Request, Response, no_progress

_Result = TypeVar("_Result")
_MOST_IDLE = 8
"""Threads that are kept for the next call; chosen: clients have few calls under way."""
_PATIENCE_S = 5.0
"""How long a cancelled call is waited for; chosen. One that hangs (a dead network disk) keeps its thread, no more."""


class CallThreads:
    """Threads with event loops, lent to one call after the other; a few are kept for the next ones."""

    def __init__(self) -> None:
        self._idle: list[_LentThread] = []  # taking and adding are atomic

    async def run(self, function: Callable[..., Awaitable[_Result]], *arguments: object) -> _Result:
        """Run an async function in a thread and event loop of its own; gives its result.

        A cancelled caller cancels it there and waits for its end, 5 s at most.

        Raises:
            Exception: what the function raised.
            ResourceFailure: there is no idle thread, and the operating system starts no further one.
        """
        try:
            thread = self._idle.pop()
        except IndexError:
            thread = _started()
        return await run_in(thread.loop, self._carry_out, thread, function, arguments, patience_s=_PATIENCE_S)

    def close(self) -> None:
        """End the threads that wait for a call; a later call gets a new one."""
        while self._idle:
            self._idle.pop().end()

    async def _carry_out(
        self, thread: "_LentThread", function: Callable[..., Awaitable[_Result]], arguments: tuple[object, ...]
    ) -> _Result:
        """Run the function, then keep its thread for the next call, whether or not the caller still waits."""
        try:
            return await function(*arguments)
        finally:
            if len(self._idle) < _MOST_IDLE:
                self._idle.append(thread)
            else:
                thread.end()


class OwnThread:
    """A thread for one user, who neither waits for threads of others nor lacks one when no more can be started."""

    def __init__(self) -> None:
        self._thread = _started()

    async def run(self, function: Callable[..., _Result], *arguments: object) -> _Result:
        """Call a function there and return its result; a cancelled caller does not wait for its end.

        Raises:
            Exception: what the function raised.
        """

        async def called() -> _Result:
            return function(*arguments)

        return await run_in(self._thread.loop, called, patience_s=0.0)

    def end(self) -> None:
        """End the thread when what it does now is done."""
        self._thread.end()


async def run_in(
    loop: asyncio.AbstractEventLoop,
    function: Callable[..., Awaitable[_Result]],
    *arguments: object,
    patience_s: float = math.inf,
) -> _Result:
    """Run an async function in the event loop of another thread, or at once where it is the caller's own.

    A cancelled caller cancels it there and waits for its end, at most ``patience_s`` seconds.

    Raises:
        Exception: what the function raised.
        RuntimeError: the loop is closed.
    """
    here = asyncio.get_running_loop()
    if loop is here:
        return await function(*arguments)
    ended, scope, errand = anyio.Event(), anyio.CancelScope(), _Errand[_Result]()

    async def there() -> None:
        try:
            with scope:
                errand.results.append(await function(*arguments))
        except BaseException as raised:  # noqa: BLE001 - it is raised again where it was called from
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
    """What became of a function in another thread; the task is held so that nobody collects it."""

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
        """Stop the loop when what it does now is done."""
        self.loop.call_soon_threadsafe(self.loop.stop)

    def _serve(self) -> None:
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_forever()
        finally:
            self.loop.close()


def _started() -> _LentThread:
    try:
        return _LentThread()
    except RuntimeError as error:
        raise as_told(error, "a thread") from error


class ReachableExecutor(ExecutorAround):
    """An executor of the event loop that this is made in, for callers in the loops of other threads."""

    def __init__(self, inner: Executor) -> None:
        super().__init__(inner)
        self._home = asyncio.get_running_loop()

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation there; progress is told in the caller's loop."""
        own = asyncio.get_running_loop()

        async def tell(share: float, message: str) -> None:
            await run_in(own, on_progress, share, message)

        async def run() -> Response:
            told = no_progress if on_progress is no_progress else tell
            return await self._inner.run(operation, request, on_progress=told)

        return await run_in(self._home, run)
