"""The SQLite file of a workspace: one connection per thread, write-ahead log, a versioned schema.

Several servers use one workspace at once (every IDE window starts its own), and a server's calls run in separate
threads. Writers wait for each other, and no transaction includes another thread's writes.
"""

import contextlib
import logging
import math
import os
import sqlite3
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic_core import from_json

from ...schemas.errors import ResourceFailure

Kept = TypeVar("Kept")
logger = logging.getLogger(__name__)
SCHEMA_VERSION = 5
_PRIVATE = 0o700
"""Other users of the machine do not need to read a user's work."""
_BUSY_TIMEOUT_S = 10.0
"""Time that a writer waits for another server's transaction (chosen: a batch of an import takes less)."""
_CACHE_KIB = 16_384
"""Page cache of a connection (chosen: with SQLite's own 2 MB, each search of a large catalogue rereads the file)."""
_ALL_CACHES_BYTES = 2 * _CACHE_KIB * 1024
"""Total cache of all threads' connections (chosen: two whole caches). Simultaneous calls read the same tables, so a
server's memory would grow by the workspace's size with each of them. Beyond this limit SQLite replaces old pages; the
operating system still caches those.
"""
_SCHEMA = """
CREATE TABLE IF NOT EXISTS artifacts (
    sequence INTEGER PRIMARY KEY AUTOINCREMENT,
    artifact_id TEXT NOT NULL,
    kind TEXT NOT NULL,
    name TEXT NOT NULL,
    digest TEXT NOT NULL,
    recipe TEXT NOT NULL,
    record TEXT NOT NULL,
    made_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%SZ', 'now')),
    UNIQUE (kind, artifact_id)
);
CREATE INDEX IF NOT EXISTS artifacts_by_digest ON artifacts (kind, digest);
CREATE INDEX IF NOT EXISTS artifacts_by_superseded ON artifacts (json_extract(record, '$.supersedes'))
    WHERE kind = 'scenario';
CREATE TABLE IF NOT EXISTS parents (
    artifact_id TEXT NOT NULL,
    parent_id TEXT NOT NULL,
    PRIMARY KEY (artifact_id, parent_id)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS parents_by_parent ON parents (parent_id);
CREATE TABLE IF NOT EXISTS imported (
    kind TEXT NOT NULL,
    artifact_id TEXT NOT NULL,
    PRIMARY KEY (kind, artifact_id)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS jobs (
    sequence INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id TEXT NOT NULL UNIQUE,
    kind TEXT NOT NULL,
    digest TEXT NOT NULL,
    recipe TEXT NOT NULL,
    state TEXT NOT NULL,
    share REAL NOT NULL,
    message TEXT NOT NULL,
    results TEXT NOT NULL,
    error TEXT NOT NULL,
    owner_pid INTEGER NOT NULL,
    started_at REAL NOT NULL,
    updated_at REAL NOT NULL
);
CREATE INDEX IF NOT EXISTS jobs_by_digest ON jobs (digest);
CREATE TABLE IF NOT EXISTS job_owners (
    job_id TEXT PRIMARY KEY,
    owner TEXT NOT NULL
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS jobs_by_owner ON job_owners (owner);
CREATE TABLE IF NOT EXISTS tasks (
    task_id TEXT PRIMARY KEY,
    owner TEXT NOT NULL,
    tool TEXT NOT NULL,
    arguments TEXT NOT NULL,
    job_id TEXT NOT NULL,
    state TEXT NOT NULL,
    message TEXT NOT NULL,
    questions TEXT NOT NULL,
    answers TEXT NOT NULL,
    result TEXT NOT NULL,
    owner_pid INTEGER NOT NULL,
    created_at REAL NOT NULL,
    updated_at REAL NOT NULL,
    lifetime_s REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS claims (
    digest TEXT PRIMARY KEY,
    owner_pid INTEGER NOT NULL,
    made_at REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS map_files (
    path TEXT PRIMARY KEY,
    stamp TEXT NOT NULL,
    map_id TEXT NOT NULL,
    refusal TEXT NOT NULL
) WITHOUT ROWID;
"""


def stored_json(text: str, what: str) -> Any:
    """Return a JSON value from the database; refuse a value that is nested more than about 200 levels deep.

    No record of this program has ten levels. Recursive readers in Python or SQLite would fail on deeply nested values
    with errors of their own.

    Args:
        what: Names the value in the error.

    Raises:
        ResourceFailure: The value is not JSON, or nested too deeply.
    """
    try:
        return from_json(text)
    except ValueError as error:
        raise ResourceFailure(
            f"{what} in the workspace cannot be read: it is not JSON, or nested too deeply",
            next_step="`plannerforge workspace verify` lists these records, and `workspace repair` removes them",
        ) from error


class Database:
    """Access to the workspace's SQLite file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._opened = _Opened()
        self._kept: dict[object, object] = {}
        self._lock = threading.Lock()

    def connection(self) -> sqlite3.Connection:
        """Return the calling thread's connection, with rows by name; it opens, and checks its schema, on first use.

        Raises:
            ResourceFailure: The file cannot be opened, or a newer version of PlannerForge wrote it.
        """
        opened = self._opened
        if opened.connection is None:
            opened.connection, opened.refused = self._open()
        return opened.connection

    def damage(self) -> str:
        """Return the damage that SQLite finds in the file; empty if it is intact."""
        result = str(self.connection().execute("PRAGMA quick_check").fetchone()[0])
        return "" if result == "ok" else result

    def kept(self, make: Callable[[], Kept]) -> Kept:
        """Return the in-memory object that a factory creates on first use; all threads share it."""
        with self._lock:
            if make not in self._kept:
                self._kept[make] = make()
            return cast("Kept", self._kept[make])

    @contextmanager
    def writing(self, undo: Callable[[], None] = lambda: None) -> Iterator[sqlite3.Connection]:
        """Start a transaction that stores either the whole block or nothing.

        Args:
            undo: Reverts the block's effects outside the database; called while the database is still locked.

        Raises:
            ResourceFailure: The disk is full, or the file is locked for too long.
        """
        if self._opened.refused is not None:  # the disk was full when the file was opened; it may have space now
            self._opened.close()
        connection = self.connection()
        if (refused := self._opened.refused) is not None:
            raise _failure(self.path, refused)
        try:
            connection.execute("BEGIN IMMEDIATE")
        except sqlite3.Error as error:
            raise _failure(self.path, error) from error
        try:
            yield connection
            connection.execute("COMMIT")
        except sqlite3.Error as error:
            undo()
            _roll_back(connection)
            raise _failure(self.path, error) from error
        except BaseException:
            undo()
            _roll_back(connection)
            raise

    def close(self) -> None:
        """Close the calling thread's connection, and those of other threads once they are unused."""
        self._opened.close()
        self._opened = _Opened()

    def _open(self) -> tuple[sqlite3.Connection, Exception | None]:
        """Return a read-write connection or, if the disk is full, a read-only connection and the error."""
        try:
            make_private(self.path.parent)
            return _prepared(self.path), None
        except (sqlite3.Error, OSError) as error:
            readable = _read_only(self.path)
            if readable is None:
                raise _failure(self.path, error) from error
            logger.warning("the workspace database %s can only be read: %s", self.path, error)
            return readable, error


class _Opened(threading.local):
    """A thread's connection, and the reason if it is read-only."""

    connection: sqlite3.Connection | None = None
    refused: Exception | None = None

    def close(self) -> None:
        """Close this thread's connection."""
        if self.connection is not None:
            self.connection.close()
        self.connection = self.refused = None


def _prepared(path: Path) -> sqlite3.Connection:
    """Return a connection to a file with the current tables.

    Raises:
        ResourceFailure: A newer version of PlannerForge wrote the file.
        sqlite3.Error: The file cannot be opened or written.
    """
    connection = sqlite3.connect(path, timeout=_BUSY_TIMEOUT_S, isolation_level=None, check_same_thread=False)
    try:
        connection.row_factory = sqlite3.Row
        _write_ahead(connection)
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute(f"PRAGMA cache_size = -{_CACHE_KIB}")
        connection.execute(f"PRAGMA soft_heap_limit = {_ALL_CACHES_BYTES}")  # a setting of the whole process
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if version > SCHEMA_VERSION:
            raise ResourceFailure(
                f"the workspace {path.parent} has schema version {version}; this program supports {SCHEMA_VERSION}",
                next_step="use the newer PlannerForge that created it, or another --workspace",
            )
        if version < SCHEMA_VERSION:
            if version:
                _keep_copy(connection, path, version)
            connection.executescript(f"BEGIN IMMEDIATE; {_SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")
    except BaseException:
        connection.close()
        raise
    return connection


def _keep_copy(connection: sqlite3.Connection, path: Path, version: int) -> None:
    """Keep a copy of an older version's database next to the upgraded database.

    The upgrade only adds tables, so a user can go back to the older version with the copy.
    """
    kept = path.with_name(f"{path.name}.version-{version}")
    if kept.exists():
        return
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f"{path.name}.", suffix=".partial")
    os.close(handle)
    partial = Path(name)
    try:
        connection.execute("VACUUM INTO ?", (name,))
        with contextlib.closing(sqlite3.connect(partial)) as copied:
            is_as_it_was = int(copied.execute("PRAGMA user_version").fetchone()[0]) == version
        if is_as_it_was:  # otherwise another server has just upgraded it and kept a copy
            partial.rename(kept)
            logger.warning(
                "the workspace database %s had version %d and is upgraded to %d", path, version, SCHEMA_VERSION
            )
    finally:
        partial.unlink(missing_ok=True)


def _read_only(path: Path) -> sqlite3.Connection | None:
    """Return a read-only connection if the file has tables of this version, otherwise None.

    SQLite cannot create its write-ahead log on a full disk. Without a log there is no writer, and the file itself is
    complete.
    """
    log = path.with_name(path.name + "-wal")
    fixed = "" if log.exists() and log.stat().st_size else "&immutable=1"
    try:
        connection = sqlite3.connect(
            f"{path.absolute().as_uri()}?mode=ro{fixed}", uri=True, isolation_level=None, check_same_thread=False
        )
    except sqlite3.Error:
        return None
    try:
        connection.row_factory = sqlite3.Row
        if int(connection.execute("PRAGMA user_version").fetchone()[0]) == SCHEMA_VERSION:
            return connection
    except sqlite3.Error as error:
        logger.warning("the workspace database %s cannot be read either: %s", path, error)
    connection.close()
    return None


def make_private(folder: Path) -> None:
    """Create a folder that only this user can read; an existing folder stays unchanged.

    Raises:
        ResourceFailure: The folder cannot be created.
    """
    try:
        folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
    except OSError as error:
        raise _failure(folder, error) from error


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Switch to the write-ahead log; SQLite's own busy time-out does not cover two servers that switch at once."""
    give_up = time.monotonic() + _BUSY_TIMEOUT_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > give_up:
                raise
            time.sleep(0.02)
        else:
            return


def _roll_back(connection: sqlite3.Connection) -> None:
    if connection.in_transaction:
        connection.execute("ROLLBACK")


def _failure(path: Path, error: Exception) -> ResourceFailure:
    return ResourceFailure(
        f"the workspace database {path} cannot be used: {error}",
        next_step="check that the folder is writable and the disk has room, or choose another --workspace",
    )


def still_runs(pid: int, since: float) -> bool:
    """Return True if the process ``pid`` that wrote something at ``since`` (in s since 1970) is still running.

    Process ids are reused, so the time is compared too. The start time of a process uses the clock at that time. If the
    clock was set back since, the age of the process decides, which is independent of clock changes.
    """
    import psutil

    try:
        started_before = psutil.Process(pid).create_time() <= since + _CLOCKS_DIFFER_S
    except psutil.NoSuchProcess:
        return False
    except psutil.AccessDenied:
        return True
    return bool(started_before or _age_s(pid) >= time.time() - since - _CLOCKS_DIFFER_S)


_CLOCKS_DIFFER_S = 1.0
"""Largest difference between clocks of file systems and kernels (chosen)."""


def _age_s(pid: int) -> float:
    """Return the age of a process by the clock since the machine's start, or minus infinity if it is unknown.

    The start of a process is the 22nd field of ``/proc/PID/stat``, in ticks (proc_pid_stat(5)).
    """
    if sys.platform != "linux":
        return -math.inf
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return -math.inf
