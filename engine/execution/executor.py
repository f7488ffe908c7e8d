"""Operations of the engine, and who carries them out, as the tools see it.

The local pool of processes is one executor, a cluster another. What is sent is an entry point ``module:function`` and
a request as JSON, what comes back is a response as JSON; files are named by their paths, and an operation that says
which fields these are can be carried out on other machines.
"""

import importlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Generic, Literal, Protocol, TypeVar

from ...schemas.base import Model

Request = TypeVar("Request", bound=Model)
Response = TypeVar("Response", bound=Model)
Lane = Literal["compute", "retrieval"]
OnProgress = Callable[[float, str], Awaitable[None]]


class ProgressReporter(Protocol):
    """Called by an operation with the share done in [0, 1] and a few words; may be called as often as convenient."""

    def __call__(self, share: float, message: str = "") -> None:
        """Report the share done, never less than before, and what is being done now."""


@dataclass(frozen=True)
class Operation(Generic[Request, Response]):
    """A function of the engine that runs in a worker: ``function(request, report) -> response``.

    Args:
        entry_point: ``module:function``; the module is a package's face wherever there is one.
        request_type: what the function takes.
        response_type: what it returns.
        timeout_s: time limit in seconds; None is the executor's own.
        lane: which workers carry it out.
        reads: fields of the request that name the files it reads; with them it may be carried out on other machines.
        writes: the field that names the folder for what it writes, where it has one.
    """

    entry_point: str
    request_type: type[Request]
    response_type: type[Response]
    timeout_s: float | None = None
    lane: Lane = "compute"
    reads: tuple[str, ...] = ()
    writes: str = ""

    @property
    def name(self) -> str:
        """The function's name, as errors give it."""
        return self.entry_point.rpartition(":")[2]

    def load(self) -> Callable[[Request, ProgressReporter], Response]:
        """The function, imported now: only where heavy libraries may be loaded."""
        module, _, name = self.entry_point.partition(":")
        function: Callable[[Request, ProgressReporter], Response] = getattr(importlib.import_module(module), name)
        return function


class Executor(Protocol):
    """Runs operations, each apart from the others: one that crashes or hangs disturbs no other."""

    @property
    def capacity(self) -> int:
        """How many operations of the compute lane run at once."""

    @property
    def notice(self) -> str:
        """What those who read a result have to be told of how it was made; empty where all is as it was set up."""

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = ...
    ) -> Response:
        """Run the operation and return its response; a cancelled caller ends it.

        Raises:
            PlannerForgeError: what the operation raised.
            WorkerTimeout: it took longer than its time limit.
            WorkerFailure: the process that carried it out died.
        """


class ExecutorAround:
    """What executors share that hand operations on to another one: they add ``run``."""

    def __init__(self, inner: Executor) -> None:
        self._inner = inner

    @property
    def capacity(self) -> int:
        """That of the executor behind it."""
        return self._inner.capacity

    @property
    def notice(self) -> str:
        """That of the executor behind it."""
        return self._inner.notice


def silent(share: float, message: str = "") -> None:
    """A progress reporter that drops what it is given."""
    del share, message


async def no_progress(share: float, message: str) -> None:
    """A listener to progress that drops what it is given."""
    del share, message
