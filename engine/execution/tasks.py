"""Durable records of calls that a client does not wait for; the client requests the answer later, in any session.

A task is found only by its unguessable id together with its owner. Its record has the request and the process that
works on it. If that process is gone, the next server to receive a request for the task repeats the call. It reuses
finished results, since recipes identify runs, scenarios and jobs.
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
"""Lifetime of a task from its start (chosen: an answer from Friday is still there on Monday)."""
_RELEASED = 0
"""In place of a process id: the task has not ended, but no process works on it."""


class Task(Model):
    """A separate call: its request and owner, its progress, its questions, its answer."""

    task_id: str
    owner: str
    tool: str
    arguments: dict[str, Any]
    job_id: str
    state: TaskState
    message: str
    questions: dict[str, Any]
    """Open questions by their keys, in the protocol's format."""
    answers: dict[str, Any]
    result: dict[str, Any]
    """The answer of the tool, or the error of the protocol if the call failed."""
    owner_pid: int
    created_at: float
    updated_at: float
    lifetime_s: float

    @property
    def ended(self) -> bool:
        """True if the task will not change any more."""
        return self.state != "working"

    @property
    def is_carried_out(self) -> bool:
        """True if a server is working on it."""
        return self.owner_pid != _RELEASED and still_runs(self.owner_pid, self.updated_at)


class TaskStore:
    """Reads and writes tasks."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def begin(self, owner: str, tool: str, arguments: Mapping[str, Any], lifetime_s: float = LIFETIME_S) -> Task:
        """Create a task that this process works on, and delete expired tasks."""
        now, task_id = time.time(), secrets.token_urlsafe(24)
        with self._database.writing() as connection:
            connection.execute("DELETE FROM tasks WHERE created_at + lifetime_s < ?", (now,))
            connection.execute(
                "INSERT INTO tasks VALUES (?, ?, ?, ?, '', 'working', '', '{}', '{}', '{}', ?, ?, ?, ?)",
                (task_id, owner, tool, json.dumps(arguments), os.getpid(), now, now, lifetime_s),
            )
        return self.get(task_id, owner)

    def get(self, task_id: str, owner: str) -> Task:
        """Return the owner's task with this id.

        Raises:
            UnknownName: There is no such task, or it has expired; no similar ids are listed, since ids are secrets.
        """
        query = "SELECT * FROM tasks WHERE task_id = ? AND owner = ? AND created_at + lifetime_s >= ?"
        row = self._database.connection().execute(query, (task_id, owner, time.time())).fetchone()
        if row is None:
            raise UnknownName(
                "there is no such task, or it has expired",
                next_step="call the tool again with the same arguments; finished parts are reused",
            )
        return _task(row)

    def note(self, task_id: str, message: str) -> None:
        """Record the progress of a task in a few words."""
        self._set(task_id, "message = ?", message)

    def note_job(self, task_id: str, job_id: str) -> None:
        """Record the job that a task waits for."""
        self._set(task_id, "job_id = ?", job_id)

    def ask(self, task_id: str, key: str, question: Mapping[str, Any]) -> None:
        """Record an open question."""
        self._set(task_id, "questions = json_set(questions, ?, json(?))", f'$."{key}"', json.dumps(question))

    def answer(self, task_id: str, answers: Mapping[str, Any]) -> None:
        """Record answers to open questions; other answers are ignored."""
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
        """Record how a task ended; a task that has already ended stays unchanged."""
        values = (state, json.dumps(result), message)
        self._set(task_id, "state = ?, result = ?, message = ?, questions = '{}'", *values)

    def release(self, task_id: str) -> None:
        """Release a task that has not ended, so that any server may continue it."""
        self._set(task_id, "owner_pid = ?", _RELEASED)

    def take_over(self, task: Task) -> bool:
        """Take over a task of a server that is gone; return False if another server was faster."""
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
