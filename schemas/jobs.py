"""Arguments and answer of the tools that look at long work."""

from typing import Literal

from pydantic import Field

from .base import Answer, Arguments, Result

JobState = Literal["running", "done", "failed", "cancelled", "interrupted"]
"""``interrupted``: its server ended before it did."""


class GetJobArguments(Arguments):
    """State, progress, estimate and partial results of a job; waits for its end."""

    job_id: str = "latest"
    wait_s: float = Field(30, ge=0, le=50)


class CancelJobArguments(Arguments):
    """Stop a job; what is finished stays."""

    job_id: str


class JobResult(Result):
    """A job: ``share`` done in [0, 1], ids of what is finished, and why it failed where it did."""

    job_id: str
    kind: str
    state: JobState
    share: float
    message: str
    remaining_s: float | None
    results: tuple[str, ...]
    error: str
    next_step: str

    def answer(self) -> Answer:
        """The state, what is finished, why it failed and what to do next."""
        left = f", about {self.remaining_s:.0f} s left" if self.remaining_s is not None else ""
        more = len(self.results) - 10
        finished = f"Finished: {', '.join(self.results[-10:])}{f' and {more} before' if more > 0 else ''}"
        return Answer(
            headline=f"{self.job_id} ({self.kind}): {self.state}, {self.share:.0%} done{left}. {self.message}".rstrip(),
            decided=[finished] if self.results else (),
            warnings=[self.error] if self.error else (),
            next_step=self.next_step,
        )
