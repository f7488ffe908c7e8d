"""Durable records of long work, and the runner that executes this server's jobs in the background.

A record is in the workspace's database, so any server on the workspace can report on it. A job of a server that is gone
appears as interrupted; a repeated request continues with what was not finished.
"""

import asyncio
import contextlib
import json
import logging
import os
import sqlite3
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import anyio
import anyio.abc
from pydantic import Field

from ...schemas.base import Model
from ...schemas.errors import ResourceFailure, UnexpectedFailure, UnknownName, closest, error_to_report
from ...schemas.jobs import JobState
from ..workspace import Database, Recipe, still_runs, stored_json

logger = logging.getLogger(__name__)
_POLL_S = 0.5
"""Interval at which a job of another server is checked (chosen)."""
_JOBS = "SELECT * FROM jobs LEFT JOIN job_owners USING (job_id)"


class Job(Model):
    """A piece of work: completed ``share`` in [0, 1], ids of the finished results, and the error's text if
    it failed.
    """

    job_id: str
    kind: str
    recipe: Recipe
    state: JobState
    share: float
    message: str
    results: tuple[str, ...]
    error: str
    started_at: float
    updated_at: float
    owner: str = Field("", exclude=True)
    """The owner of the token that started it, or empty; not shown, since names of people are not results."""

    @property
    def ended(self) -> bool:
        """True if the job will not change any more."""
        return self.state != "running"

    @property
    def remaining_s(self) -> float | None:
        """The estimated remaining time in seconds, or None until enough is done for an estimate."""
        if self.ended or self.share < 0.02:  # chosen: an earlier estimate is mostly the start-up
            return None
        return (self.updated_at - self.started_at) * (1 - self.share) / self.share


class JobStore:
    """Reads and writes job records."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def start(self, kind: str, recipe: Recipe, owner: str = "") -> tuple[Job, bool]:
        """Return the job for this recipe, and whether it is new; simultaneous requests by two servers get the same job.

        The id of a new job counts the attempts (``job_<digest>``, ``job_<digest>_2``, …). Its ``owner`` remains the
        owner that started it.
        """
        now = time.time()
        with self._database.writing() as connection:
            running = self.running(recipe)
            if running is not None:
                return running, False
            attempts = connection.execute("SELECT count(*) FROM jobs WHERE digest = ?", (recipe.digest,)).fetchone()[0]
            job_id = f"job_{recipe.digest}" + (f"_{attempts + 1}" if attempts else "")
            connection.execute(
                "INSERT INTO jobs (job_id, kind, digest, recipe, state, share, message, results, error, owner_pid,"
                " started_at, updated_at) VALUES (?, ?, ?, ?, 'running', 0, '', '[]', '', ?, ?, ?)",
                (job_id, kind, recipe.digest, recipe.model_dump_json(), os.getpid(), now, now),
            )
            if owner:
                connection.execute("INSERT INTO job_owners VALUES (?, ?)", (job_id, owner))
        return self.get(job_id), True

    def update(self, job_id: str, *, share: float, message: str, results: tuple[str, ...]) -> None:
        """Record progress of a running job."""
        self._set(job_id, "share = ?, message = ?, results = ?", (share, message, json.dumps(results)))

    def end(self, job_id: str, state: JobState, *, results: tuple[str, ...], error: str = "") -> None:
        """Record how a job ended; a job that has already ended stays unchanged."""
        share = "1.0" if state == "done" else "share"
        self._set(job_id, f"state = ?, share = {share}, results = ?, error = ?", (state, json.dumps(results), error))

    def get(self, job_id: str) -> Job:
        """Return the job with this id; ``latest`` means the newest job.

        Raises:
            UnknownName: No job has this id; the error lists the nearest ids.
        """
        if job_id == "latest":
            newest = self.newest(1)
            if newest:
                return newest[0]
            raise UnknownName("there is no job yet", next_step="start one, for instance with run_planner")
        row = self._database.connection().execute(f"{_JOBS} WHERE job_id = ?", (job_id,)).fetchone()
        if row is None:
            known = [job.job_id for job in self.newest(500)]
            raise UnknownName(f"there is no job '{job_id}'", valid=closest(job_id, known))
        return _job(row)

    def running(self, recipe: Recipe) -> Job | None:
        """Return the job that currently works on this recipe, in any server."""
        query = f"{_JOBS} WHERE digest = ? AND state = 'running' ORDER BY sequence DESC"
        jobs = [_job(row) for row in self._database.connection().execute(query, (recipe.digest,)).fetchall()]
        return next((job for job in jobs if job.state == "running"), None)

    def newest(self, limit: int, offset: int = 0) -> list[Job]:
        """Return jobs, newest first."""
        query = f"{_JOBS} ORDER BY sequence DESC LIMIT ? OFFSET ?"
        return [_job(row) for row in self._database.connection().execute(query, (limit, offset)).fetchall()]

    def count(self) -> int:
        """Return the number of jobs."""
        return int(self._database.connection().execute("SELECT count(*) FROM jobs").fetchone()[0])

    def newest_of(self, owner: str, limit: int) -> list[Job]:
        """Return the jobs that were started with one token, newest first."""
        query = f"{_JOBS} WHERE owner = ? ORDER BY sequence DESC LIMIT ?"
        return [_job(row) for row in self._database.connection().execute(query, (owner, limit)).fetchall()]

    def lately(self, within_s: float = 60.0) -> list[Job]:
        """Return jobs that are running or changed in the last few seconds, newest first."""
        query = f"{_JOBS} WHERE state = 'running' OR updated_at > ? ORDER BY sequence DESC"
        return [_job(row) for row in self._database.connection().execute(query, (time.time() - within_s,)).fetchall()]

    def _set(self, job_id: str, assignments: str, values: tuple[object, ...]) -> None:
        with self._database.writing() as connection:
            connection.execute(
                f"UPDATE jobs SET {assignments}, updated_at = ? WHERE job_id = ? AND state = 'running'",  # noqa: S608 - fixed words only
                (*values, time.time(), job_id),
            )


def _job(row: sqlite3.Row) -> Job:
    state: JobState = row["state"]
    if state == "running" and not still_runs(row["owner_pid"], row["started_at"]):
        state = "interrupted"
    return Job(
        job_id=row["job_id"],
        kind=row["kind"],
        recipe=Recipe.model_validate(stored_json(row["recipe"], f"the recipe of {row['job_id']}")),
        state=state,
        share=row["share"],
        message=row["message"],
        results=tuple(stored_json(row["results"], f"the results of {row['job_id']}")),
        error=row["error"],
        started_at=row["started_at"],
        updated_at=row["updated_at"],
        owner=row["owner"] or "",
    )


class JobProgress:
    """Records the progress and the results of a job during its work."""

    def __init__(self, store: JobStore, job_id: str, news: Callable[[], None]) -> None:
        self._store, self._job_id, self._news = store, job_id, news
        self.results: tuple[str, ...] = ()

    def report(self, share: float, message: str) -> None:
        """Record the completed share in [0, 1] and a short message; if that fails (a full disk), the work continues."""
        try:
            self._store.update(self._job_id, share=share, message=message, results=self.results)
        except ResourceFailure as error:
            logger.warning("the progress of %s could not be recorded: %s", self._job_id, error.text)
        self._news()

    def add_result(self, artifact_id: str) -> None:
        """Record the id of a finished and stored result."""
        self.results = (*self.results, artifact_id)


JobWork = Callable[[JobProgress], Awaitable[None]]
RunApart = Callable[..., Coroutine[Any, Any, None]]
"""Runs an async function with its arguments, such as ``CallThreads.run``."""


async def _in_place(function: Callable[..., Awaitable[None]], *arguments: object) -> None:
    await function(*arguments)


class JobRunner:
    """Starts, waits for and cancels jobs; callable from the event loop of any thread.

    Args:
        tasks: The task group of the loop that creates the runner; jobs are interrupted with it.
        run_apart: Runs a job, by default among the tasks of that loop.
    """

    def __init__(self, store: JobStore, tasks: anyio.abc.TaskGroup, run_apart: RunApart = _in_place) -> None:
        self.store = store
        self._tasks, self._home, self._run_apart = tasks, asyncio.get_running_loop(), run_apart
        self._own: dict[str, _Running | None] = {}
        self._to_cancel: set[str] = set()
        self._listeners: set[_Listener] = set()
        self._unrecorded: dict[str, _JobEnd] = {}

    def start(self, kind: str, recipe: Recipe, work: JobWork, owner: str = "") -> Job:
        """Start the work, or join the job that is already working on this recipe.

        Args:
            owner: The owner of the token that starts it; empty if no token is required.
        """
        self._record_missed_ends()
        job, is_new = self.store.start(kind, recipe, owner)
        if not is_new:
            return job
        self._own[job.job_id] = None

        def begin() -> None:
            self._tasks.start_soon(self._run_job, job.job_id, work)

        async def begin_at_home() -> None:  # a task, since anyio does not know its event loop outside one
            begin()

        if asyncio.get_running_loop() is self._home:
            begin()
        else:
            asyncio.run_coroutine_threadsafe(begin_at_home(), self._home)
        return job

    async def wait(self, job_id: str, wait_s: float, on_news: Callable[[Job], Awaitable[None]]) -> Job:
        """Return the job after it has ended, or its state after ``wait_s``."""
        self._record_missed_ends()
        job = self.store.get(job_id)
        with anyio.move_on_after(wait_s):
            while not job.ended:
                with self._listening() as news:
                    job = self.store.get(job_id)  # events before the listener existed
                    if not job.ended:
                        with anyio.move_on_after(_POLL_S):
                            await news.wait()
                self._record_missed_ends()
                job = self.store.get(job_id)
                await on_news(job)
        return job

    async def cancel(self, job_id: str) -> Job:
        """Stop a job; finished parts stay. A job that has ended, or runs in another server, stays unchanged."""
        if job_id in self._own:
            self._to_cancel.add(job_id)  # first, since a job that has not started checks it at its start
            running = self._own.get(job_id)
            if running is not None:
                running.loop.call_soon_threadsafe(running.scope.cancel)
            await self.wait(job_id, 10.0, _ignore)
        return self.store.get(job_id)

    async def _run_job(self, job_id: str, work: JobWork) -> None:
        """Run a job with ``run_apart``; if it cannot start there, only this job fails."""
        try:
            await self._run_apart(self._carry_out, job_id, work)
        except Exception as raised:  # noqa: BLE001 - the boundary of a job: the exception becomes this job's error
            self._finish(job_id, _JobEnd("failed", (), _error_text(raised, job_id)))

    async def _carry_out(self, job_id: str, work: JobWork) -> None:
        progress, scope = JobProgress(self.store, job_id, self._announce), anyio.CancelScope()
        self._own[job_id] = _Running(asyncio.get_running_loop(), scope)
        if job_id in self._to_cancel:
            scope.cancel()
        error = ""
        state: JobState = "interrupted"
        try:
            with scope:
                await work(progress)
                state = "done"
        except Exception as raised:  # noqa: BLE001 - the boundary of a job: the exception becomes this job's error
            error, state = _error_text(raised, job_id), "failed"
        finally:
            if scope.cancel_called and state == "interrupted":
                state = "cancelled"
            self._finish(job_id, _JobEnd(state, progress.results, error))

    def _finish(self, job_id: str, end: "_JobEnd") -> None:
        """Record how a job ended, drop it from memory, and notify everyone who waits for it."""
        self._unrecorded[job_id] = end
        self._record_missed_ends()
        self._own.pop(job_id, None)
        self._to_cancel.discard(job_id)
        self._announce()

    def _record_missed_ends(self) -> None:
        """Record how jobs ended; retry after a full disk, since the job would otherwise appear to run."""
        for job_id, end in list(self._unrecorded.items()):
            try:
                self.store.end(job_id, end.state, results=end.results, error=end.error)
            except ResourceFailure:
                logger.exception("the end of %s (%s) could not be recorded", job_id, end.state)
            else:
                self._unrecorded.pop(job_id, None)  # another thread may have recorded it too

    @contextmanager
    def _listening(self) -> Iterator[anyio.Event]:
        """Yield an event of the caller's loop that the next news of any job sets."""
        listener = _Listener(asyncio.get_running_loop(), anyio.Event())
        self._listeners.add(listener)
        try:
            yield listener.news
        finally:
            self._listeners.discard(listener)

    def _announce(self) -> None:
        for listener in list(self._listeners):
            with contextlib.suppress(RuntimeError):  # its loop has ended
                listener.loop.call_soon_threadsafe(listener.news.set)


@dataclass(frozen=True)
class _Running:
    """A job that has started: the event loop that it runs in, and the scope that cancels it."""

    loop: asyncio.AbstractEventLoop
    scope: anyio.CancelScope


@dataclass(frozen=True, eq=False)
class _Listener:
    """A listener that waits for news of jobs, in the loop of a thread."""

    loop: asyncio.AbstractEventLoop
    news: anyio.Event


@dataclass(frozen=True)
class _JobEnd:
    """How a job ended."""

    state: JobState
    results: tuple[str, ...]
    error: str


def _error_text(raised: Exception, job_id: str) -> str:
    """Return the text of an error for the job's record; a defect of ours goes to the log with its details."""
    failure = error_to_report(raised, job_id)
    if isinstance(failure, UnexpectedFailure):
        logger.error("incident %s in %s:\n%s", failure.incident, job_id, failure.details)
    return failure.text


async def _ignore(job: Job) -> None:
    del job
