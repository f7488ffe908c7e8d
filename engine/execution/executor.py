"""Who carries out engine operations, as the tools see it.

The local pool of processes is one such; a cluster would be another. What is sent is an entry point ``module:function``
and a request as JSON, what comes back is a response as JSON; files are named by their paths, which an executor on other
machines has to make readable there (a shared file system, or copies).
"""

from collections.abc import Awaitable, Callable
from typing import Literal, Protocol, TypeVar

from ...schemas.base import Model

# ---------- progress
# How long work says how far it is: a callable that every operation receives.


class ProgressReporter(Protocol):
    """Called by an operation with the share done in [0, 1] and a few words; may be called as often as convenient."""

    def __call__(self, share: float, message: str = "") -> None:
        """Report the share done, never less than before, and what is being done now."""


def silent(share: float, message: str = "") -> None:
    """A reporter for callers that do not want to know."""
    del share, message


# ---------- executor
# Who carries out engine operations, as the tools see it.
#
# The local pool of processes is one such; a cluster would be another. What is sent is an entry point
# ``module:function`` and a request as JSON, what comes back is a response as JSON; files are named by their paths,
# which an executor on other machines has to make readable there (a shared file system, or copies).

Response = TypeVar("Response", bound=Model)
OnProgress = Callable[[float, str], Awaitable[None]]
Lane = Literal["compute", "retrieval"]


async def no_progress(share: float, message: str) -> None:
    """A listener for callers that do not want to know."""
    del share, message


class Executor(Protocol):
    """Runs operations somewhere, each apart from the others: one that crashes or hangs costs nobody else anything."""

    @property
    def capacity(self) -> int:
        """How many operations of the compute lane it carries out at once."""

    async def run(
        self,
        entry_point: str,
        request: Model,
        response_type: type[Response],
        *,
        timeout_s: float | None = None,
        on_progress: OnProgress = no_progress,
        lane: Lane = "compute",
    ) -> Response:
        """Run the operation ``module:function`` on a request and give its response; a cancelled caller ends it.

        Raises:
            PlannerForgeError: what the operation raised.
            WorkerTimeout: it took longer than ``timeout_s``.
            WorkerFailure: what carried it out died.
        """
