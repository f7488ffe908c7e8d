"""Runs jobs of this server in the background and lets callers wait for news."""

import logging
import traceback
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import anyio
import anyio.abc

from plannerforge.engine.execution.jobs import Job, JobState, JobStore
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import PlannerForgeError, ResourceFailure, UnexpectedFailure

logger = logging.getLogger(__name__)

POLL_S = 0.5
"""How often a job of another server is looked at."""


class JobProgress:
    """What the work of a job uses to say how far it is."""

    def __init__(self, store: JobStore, job_id: str, news: Callable[[], None]) -> None:
        self._store, self._job_id, self._news = store, job_id, news
        self.results: tuple[str, ...] = ()

    def report(self, share: float, message: str) -> None:
        """Record the share done in [0, 1] and a few words; where that fails (a full disk) the work goes on."""
        try:
            self._store.update(self._job_id, share=share, message=message, results=self.results)
        except ResourceFailure as error:
            logger.warning("the progress of %s could not be recorded: %s", self._job_id, error.text)
        self._news()

    def add_result(self, artifact_id: str) -> None:
        """Record the id of something that is finished and stored."""
        self.results = (*self.results, artifact_id)


@dataclass(frozen=True)
class JobEnd:
    """How a job ended."""

    state: JobState
    results: tuple[str, ...]
    error: str


JobWork = Callable[[JobProgress], Awaitable[None]]


class JobRunner:
    """Starts, waits for and cancels jobs."""

    def __init__(self, store: JobStore, tasks: anyio.abc.TaskGroup) -> None:
        self.store = store
        self._tasks = tasks
        self._scopes: dict[str, anyio.CancelScope] = {}
        self._changed = anyio.Event()
        self._unrecorded: dict[str, JobEnd] = {}

    def start(self, kind: str, recipe: Recipe, work: JobWork) -> Job:
        """Start the work, or join the job that already makes this recipe."""
        self._record_missed_ends()
        job, is_new = self.store.start_or_join(kind, recipe)
        if not is_new:
            return job
        scope = anyio.CancelScope()
        self._scopes[job.job_id] = scope
        self._tasks.start_soon(self._carry_out, job.job_id, scope, work)
        return job

    async def wait(self, job_id: str, wait_s: float, on_news: Callable[[Job], Awaitable[None]]) -> Job:
        """The job once it has ended, or as it is after ``wait_s``."""
        self._record_missed_ends()
        job = self.store.get(job_id)
        with anyio.move_on_after(wait_s):
            while not job.ended:
                changed = self._changed
                with anyio.move_on_after(POLL_S):
                    await changed.wait()
                self._record_missed_ends()
                job = self.store.get(job_id)
                await on_news(job)
        return job

    async def cancel(self, job_id: str) -> Job:
        """Stop a job; what is finished stays. A job that has ended, or runs in another server, is left as it is."""
        scope = self._scopes.get(job_id)
        if scope is not None:
            scope.cancel()
            await self.wait(job_id, 10.0, _ignore)
        return self.store.get(job_id)

    async def _carry_out(self, job_id: str, scope: anyio.CancelScope, work: JobWork) -> None:
        progress = JobProgress(self.store, job_id, self._announce)
        error = ""
        state: JobState = "interrupted"
        try:
            with scope:
                await work(progress)
                state = "done"
        except PlannerForgeError as raised:
            error, state = raised.text, "failed"
        except Exception:  # noqa: BLE001 - the boundary of a job: it becomes the error of this one job
            failure = UnexpectedFailure(job_id, traceback.format_exc())
            logger.error("incident %s in %s:\n%s", failure.incident, job_id, failure.details)  # noqa: TRY400
            error, state = failure.text, "failed"
        finally:
            if scope.cancel_called and state == "interrupted":
                state = "cancelled"
            self._unrecorded[job_id] = JobEnd(state, progress.results, error)
            self._record_missed_ends()
            self._scopes.pop(job_id, None)
            self._announce()

    def _record_missed_ends(self) -> None:
        """Record how jobs ended; what a full disk refuses is tried again later, or the job would seem to run on."""
        for job_id, end in list(self._unrecorded.items()):
            try:
                self.store.end(job_id, end.state, results=end.results, error=end.error)
            except ResourceFailure:
                logger.exception("the end of %s (%s) could not be recorded", job_id, end.state)
            else:
                del self._unrecorded[job_id]

    def _announce(self) -> None:
        self._changed.set()
        self._changed = anyio.Event()


async def _ignore(job: Job) -> None:
    del job
