"""Arguments and answer of the tools for long work."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field

from .base import Answer, Arguments, Result
from .text import counted

JobState = Literal["running", "done", "failed", "cancelled", "interrupted"]
"""``interrupted`` means that the job's server stopped before the job was done."""


def state_in_words(job_id: str | None, state: JobState, message: str) -> str:
    """Return the state of a job without a result so far, in one line."""
    return f"{job_id}: {state}{f'; {message}' if message else '.'}"


_SHOWN_RESULTS = 5
"""How many ids of finished results the brief answer shows (chosen)."""


class GetJobArguments(Arguments):
    """State, progress, partial results of a job; waits for its end."""

    job_id: str = "latest"
    """The job."""
    wait_s: float = Field(30, ge=0, le=50)
    """How long to wait for the end of the job, in s."""


class CancelJobArguments(Arguments):
    """Stop a job; what is finished stays."""

    examples: ClassVar[Mapping[str, Any]] = {"job_id": "latest"}

    job_id: str
    """The job."""


class JobResult(Result):
    """A job: the completed ``share`` in [0, 1], the ids of finished results, and the reason if it failed."""

    job_id: str
    kind: str = Field(description="what kind of work it is")
    state: JobState
    share: float = Field(description="share done, from 0 to 1")
    message: str = Field(description="its current work, in words")
    remaining_s: float | None = Field(description="estimated time to its end; null if not known")
    results: tuple[str, ...] = Field(description="ids of finished results")
    error: str = Field(description="why it failed; empty if it did not")
    next_step: str

    def answer(self) -> Answer:
        """Return the state, the finished results, why it failed, and what to do next."""
        left = f", about {self.remaining_s:.0f} s left" if self.remaining_s is not None else ""
        share = "" if self.state == "done" else f", {self.share:.0%} done{left}"
        so_far = " so far" if self.state == "running" else ""
        return Answer(
            headline=f"{self.job_id} ({self.kind}): {self.state}{share}. {self.message}".rstrip(),
            decided=[f"Results{so_far}: {self._finished}"] if self.results else (),
            warnings=[self.error] if self.error else (),
            next_step=self.next_step,
        )

    @property
    def _finished(self) -> str:
        """The batch, which contains its runs, or else the newest results and the number of earlier results."""
        batches = [key for key in self.results if key.startswith("batch_")]
        shown = batches or list(self.results[-_SHOWN_RESULTS:])
        more = len(self.results) - len(shown)
        rest = f" with {counted(more, 'run')}" if batches else f" and {more} earlier"
        return ", ".join(shown) + (rest if more > 0 else "")
