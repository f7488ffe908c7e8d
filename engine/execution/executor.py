"""The tools' interface to operations of the engine and to their executors.

The local pool of processes and a cluster are executors. A request is an entry point ``module:function`` and JSON, a
response is JSON; files are given by their paths. An operation that declares these fields can run on other machines.
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
    """A callback that receives the completed share in [0, 1] and a short message; calls may be frequent."""

    def __call__(self, share: float, message: str = "") -> None:
        """Report the completed share, which never decreases, and the current activity."""


@dataclass(frozen=True)
class Operation(Generic[Request, Response]):
    """A function of the engine that runs in a worker: ``function(request, report) -> response``.

    Args:
        entry_point: ``module:function``; the module is the package's face if there is one.
        request_type: The type of the function's input.
        response_type: The type of its output.
        timeout_s: Time limit in seconds; None means the executor's own.
        lane: The workers that run it.
        reads: Fields of the request with files to read; with them, the operation may run on other machines.
        writes: The field with the folder for output files, if there is one.
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
        """The function's name, as errors show it."""
        return self.entry_point.rpartition(":")[2]

    def load(self) -> Callable[[Request, ProgressReporter], Response]:
        """Import and return the function; only for processes that may load heavy libraries."""
        module, _, name = self.entry_point.partition(":")
        function: Callable[[Request, ProgressReporter], Response] = getattr(importlib.import_module(module), name)
        return function


class Executor(Protocol):
    """Runs operations in isolation: an operation that crashes or hangs does not disturb the others."""

    @property
    def capacity(self) -> int:
        """The number of simultaneous operations of the compute lane."""

    @property
    def notice(self) -> str:
        """A note for readers of a result on how it was computed; empty if everything is as configured."""

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = ...
    ) -> Response:
        """Run the operation and return its response; cancelling the caller ends it.

        Raises:
            PlannerForgeError: The operation raised it.
            WorkerTimeout: The operation exceeded its time limit.
            WorkerFailure: The process that ran it died.
        """


class ExecutorAround:
    """Base of executors that pass operations on to another executor; subclasses add ``run``."""

    def __init__(self, inner: Executor) -> None:
        self._inner = inner

    @property
    def capacity(self) -> int:
        """The capacity of the inner executor."""
        return self._inner.capacity

    @property
    def notice(self) -> str:
        """The notice of the inner executor."""
        return self._inner.notice


def silent(share: float, message: str = "") -> None:
    """A progress reporter that does nothing."""
    del share, message


async def no_progress(share: float, message: str) -> None:
    """Do nothing; a progress listener."""
    del share, message
