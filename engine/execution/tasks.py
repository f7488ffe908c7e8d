"""Durable records of calls that a client does not wait for: it asks for the answer later, in this session or another.

A task is found by its id alone, which nobody can guess, and by whoever began it. Beside what was asked its record holds
who carries it out: where that server went away, the next one that is asked takes the call up again, and what was
finished is found (runs, scenarios and jobs are known by their recipes).
"""

import json
import os
import secrets
import sqlite3
import time
from collections.abc import Mapping
from typing import Any, Literal

from ...schemas.base import Model
from ...schemas.errors import UnknownName
from ..workspace import Database, still_runs, stored_json

TaskState = Literal["working", "completed", "failed", "cancelled"]
LIFETIME_S = 7 * 86_400.0
"""How long a task is kept from its beginning; chosen: somebody who asks on Friday finds the answer on Monday."""
_RELEASED = 0
"""In the place of a process: nobody carries the task out, though it has not ended."""


class Task(Model):
    """A call that is carried out apart: what was asked by whom, how far it is, its questions, its answer."""

    task_id: str
    owner: str
    tool: str
    arguments: dict[str, Any]
    job_id: str
    state: TaskState
    message: str
    questions: dict[str, Any]
    """Open questions by their keys, as the protocol words them."""
    answers: dict[str, Any]
    result: dict[str, Any]
    """The answer of the tool, or the error of the protocol where the call failed."""
    owner_pid: int
    created_at: float
    updated_at: float
    lifetime_s: float

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self.state != "working"

    @property
    def is_carried_out(self) -> bool:
        """Whether a server is at it."""
        return self.owner_pid != _RELEASED and still_runs(self.owner_pid, self.updated_at)


class TaskStore:
    """Reads and writes tasks."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def begin(self, owner: str, tool: str, arguments: Mapping[str, Any], lifetime_s: float = LIFETIME_S) -> Task:
        """A new task, carried out by this process; tasks whose lifetime is over are forgotten."""
        now, task_id = time.time(), secrets.token_urlsafe(24)
        with self._database.writing() as connection:
            connection.execute("DELETE FROM tasks WHERE created_at + lifetime_s < ?", (now,))
            connection.execute(
                "INSERT INTO tasks VALUES (?, ?, ?, ?, '', 'working', '', '{}', '{}', '{}', ?, ?, ?, ?)",
                (task_id, owner, tool, json.dumps(arguments), os.getpid(), now, now, lifetime_s),
            )
        return self.get(task_id, owner)

    def get(self, task_id: str, owner: str) -> Task:
        """The task with this id that this owner began.

        Raises:
            UnknownName: there is none, or its lifetime is over; ids are not compared, since they are secrets.
        """
        query = "SELECT * FROM tasks WHERE task_id = ? AND owner = ? AND created_at + lifetime_s >= ?"
        row = self._database.connection().execute(query, (task_id, owner, time.time())).fetchone()
        if row is None:
            raise UnknownName(
                "there is no such task, or its lifetime is over",
                next_step="call the tool again with the same arguments: what was finished is found",
            )
        return _task(row)

    def note(self, task_id: str, message: str) -> None:
        """Record how far a task is, in a few words."""
        self._set(task_id, "message = ?", message)

    def note_job(self, task_id: str, job_id: str) -> None:
        """Record the job that a task waits for."""
        self._set(task_id, "job_id = ?", job_id)

    def ask(self, task_id: str, key: str, question: Mapping[str, Any]) -> None:
        """Record an open question."""
        self._set(task_id, "questions = json_set(questions, ?, json(?))", f'$."{key}"', json.dumps(question))

    def answer(self, task_id: str, answers: Mapping[str, Any]) -> None:
        """Record answers; one to a question that is not open is dropped."""
        with self._database.writing() as connection:
            row = connection.execute("SELECT questions, answers FROM tasks WHERE task_id = ?", (task_id,)).fetchone()
            if row is None:
                return
            questions, known = (stored_json(row[name], f"{name} of {task_id}") for name in ("questions", "answers"))
            for key in [key for key in answers if key in questions]:
                del questions[key]
                known[key] = answers[key]
            connection.execute(
                "UPDATE tasks SET questions = ?, answers = ?, updated_at = ? WHERE task_id = ? AND state = 'working'",
                (json.dumps(questions), json.dumps(known), time.time(), task_id),
            )

    def end(self, task_id: str, state: TaskState, result: Mapping[str, Any], message: str = "") -> None:
        """Record how a task ended; one that has ended stays as it is."""
        values = (state, json.dumps(result), message)
        self._set(task_id, "state = ?, result = ?, message = ?, questions = '{}'", *values)

    def release(self, task_id: str) -> None:
        """Leave a task that has not ended to whichever server is asked for it next."""
        self._set(task_id, "owner_pid = ?", _RELEASED)

    def take_over(self, task: Task) -> bool:
        """Carry a task out that nobody is at; False where another server was faster."""
        with self._database.writing() as connection:
            taken = connection.execute(
                "UPDATE tasks SET owner_pid = ?, updated_at = ? WHERE task_id = ? AND owner_pid = ? AND updated_at = ?"
                " AND state = 'working'",
                (os.getpid(), time.time(), task.task_id, task.owner_pid, task.updated_at),
            )
            return taken.rowcount == 1

    def _set(self, task_id: str, assignments: str, *values: object) -> None:
        with self._database.writing() as connection:
            connection.execute(
                f"UPDATE tasks SET {assignments}, updated_at = ? WHERE task_id = ? AND state = 'working'",  # noqa: S608 - fixed words only
                (*values, time.time(), task_id),
            )


def _task(row: sqlite3.Row) -> Task:
    texts = {
        name: stored_json(row[name], f"{name} of {row['task_id']}")
        for name in ("arguments", "questions", "answers", "result")
    }
    return Task.model_validate({**dict(row), **texts})
