"""Arguments and answer of the tools that look at long work."""

from typing import Literal

from pydantic import Field

from .base import Arguments, Result

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

    def to_text(self) -> str:
        """One line of state, then what is finished and what to do next."""
        left = f", about {self.remaining_s:.0f} s left" if self.remaining_s is not None else ""
        lines = [f"{self.job_id} ({self.kind}): {self.state}, {self.share:.0%} done{left}. {self.message}".rstrip()]
        if self.results:
            more = len(self.results) - 10
            lines.append(f"Finished: {', '.join(self.results[-10:])}{f' and {more} before' if more > 0 else ''}")
        if self.error:
            lines.append(f"Error: {self.error}")
        return "\n".join([*lines, f"Next: {self.next_step}"])
