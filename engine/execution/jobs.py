"""Durable records of long work: what was asked, how far it is, what came out.

The record lives in the workspace's database, so that any server on the workspace can answer for it. A job that runs in
a server that went away is shown as interrupted; asking for the same again takes up what was finished.
"""

import json
import os
import sqlite3
import time
from typing import Literal

from plannerforge.engine.execution.ownership import still_runs
from plannerforge.engine.workspace.database import Database
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import UnknownName, closest

JobState = Literal["running", "done", "failed", "cancelled", "interrupted"]


class Job(Model):
    """A piece of work: ``share`` done in [0, 1], ids of the results so far, and the error's text where it failed."""

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

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self.state != "running"

    @property
    def remaining_s(self) -> float | None:
        """Estimated time to the end in seconds; None while too little is done to say."""
        if self.ended or self.share < 0.02:
            return None
        return (self.updated_at - self.started_at) * (1 - self.share) / self.share


class JobStore:
    """Reads and writes job records."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def start(self, kind: str, recipe: Recipe) -> Job:
        """A new running job of this process; the id tells the attempt (``job_<digest>``, ``job_<digest>_2``, …)."""
        return self.start_or_join(kind, recipe, join=False)[0]

    def start_or_join(self, kind: str, recipe: Recipe, *, join: bool = True) -> tuple[Job, bool]:
        """The job that makes this recipe, and whether it is a new one: two servers that ask at once get one job."""
        now = time.time()
        with self._database.writing() as connection:
            running = self.running(recipe) if join else None
            if running is not None:
                return running, False
            attempts = connection.execute("SELECT count(*) FROM jobs WHERE digest = ?", (recipe.digest,)).fetchone()[0]
            job_id = f"job_{recipe.digest}" + (f"_{attempts + 1}" if attempts else "")
            connection.execute(
                "INSERT INTO jobs (job_id, kind, digest, recipe, state, share, message, results, error, owner_pid,"
                " started_at, updated_at) VALUES (?, ?, ?, ?, 'running', 0, '', '[]', '', ?, ?, ?)",
                (job_id, kind, recipe.digest, recipe.model_dump_json(), os.getpid(), now, now),
            )
        return self.get(job_id), True

    def update(self, job_id: str, *, share: float, message: str, results: tuple[str, ...]) -> None:
        """Record progress of a running job."""
        self._set(job_id, "share = ?, message = ?, results = ?", (share, message, json.dumps(results)))

    def end(self, job_id: str, state: JobState, *, results: tuple[str, ...], error: str = "") -> None:
        """Record how a job ended; one that has ended stays as it is."""
        share = "1.0" if state == "done" else "share"
        self._set(job_id, f"state = ?, share = {share}, results = ?, error = ?", (state, json.dumps(results), error))

    def get(self, job_id: str) -> Job:
        """The job with this id; ``latest`` is the newest one.

        Raises:
            UnknownName: with the nearest ids.
        """
        if job_id == "latest":
            found = self.newest(1)
            if found:
                return found[0]
            raise UnknownName("there is no job yet", next_step="start one, for instance with run_planner")
        row = self._database.connection().execute("SELECT * FROM jobs WHERE job_id = ?", (job_id,)).fetchone()
        if row is None:
            known = [job.job_id for job in self.newest(500)]
            raise UnknownName(f"there is no job '{job_id}'", valid=closest(job_id, known))
        return _job(row)

    def running(self, recipe: Recipe) -> Job | None:
        """The job that makes this recipe just now, in whichever server."""
        query = "SELECT * FROM jobs WHERE digest = ? AND state = 'running' ORDER BY sequence DESC"
        jobs = [_job(row) for row in self._database.connection().execute(query, (recipe.digest,)).fetchall()]
        return next((job for job in jobs if job.state == "running"), None)

    def newest(self, limit: int, offset: int = 0) -> list[Job]:
        """Jobs, newest first."""
        query = "SELECT * FROM jobs ORDER BY sequence DESC LIMIT ? OFFSET ?"
        return [_job(row) for row in self._database.connection().execute(query, (limit, offset)).fetchall()]

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
        recipe=Recipe.model_validate_json(row["recipe"]),
        state=state,
        share=row["share"],
        message=row["message"],
        results=tuple(json.loads(row["results"])),
        error=row["error"],
        started_at=row["started_at"],
        updated_at=row["updated_at"],
    )
