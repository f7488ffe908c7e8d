"""The SQLite file of a workspace: one connection a server, write-ahead log, a schema with a version.

Several servers work on one workspace at once (every IDE window starts its own), so writers wait for each other.
"""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...schemas.errors import ResourceFailure

SCHEMA_VERSION = 1
_BUSY_TIMEOUT_S = 10.0
"""How long a writer waits for another server's transaction; chosen: a batch of an import takes less."""
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


class Database:
    """Access to the workspace's SQLite file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._connection: sqlite3.Connection | None = None

    def connection(self) -> sqlite3.Connection:
        """The open connection, with rows by name; made, and its schema checked, when first needed.

        Raises:
            ResourceFailure: the file cannot be opened, or a newer version of PlannerForge wrote it.
        """
        if self._connection is None:
            self._connection = self._open()
        return self._connection

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """A transaction: all of the block is stored, or nothing.

        Raises:
            ResourceFailure: the disk is full or the file is locked for too long.
        """
        connection = self.connection()
        try:
            connection.execute("BEGIN IMMEDIATE")
        except sqlite3.Error as error:
            raise _failure(self.path, error) from error
        try:
            yield connection
            connection.execute("COMMIT")
        except sqlite3.Error as error:
            _roll_back(connection)
            raise _failure(self.path, error) from error
        except BaseException:
            _roll_back(connection)
            raise

    def close(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _open(self) -> sqlite3.Connection:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(
                self.path, timeout=_BUSY_TIMEOUT_S, isolation_level=None, check_same_thread=False
            )
            connection.row_factory = sqlite3.Row
            _write_ahead(connection)
            connection.execute("PRAGMA synchronous = NORMAL")
            version = int(connection.execute("PRAGMA user_version").fetchone()[0])
            if version > SCHEMA_VERSION:
                connection.close()
                raise ResourceFailure(
                    f"the workspace {self.path.parent} has schema version {version}, "
                    f"this program knows {SCHEMA_VERSION}",
                    next_step="use the newer PlannerForge that made it, or another --workspace",
                )
            connection.executescript(f"BEGIN IMMEDIATE; {_SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")
        except (sqlite3.Error, OSError) as error:
            raise _failure(self.path, error) from error
        return connection


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Switch to the write-ahead log; SQLite's own busy time-out does not cover two servers that do so at once."""
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
    """Whether the process ``pid`` that wrote something at ``since`` (seconds since 1970) still runs.

    Process ids are given again, so the time counts too.
    """
    import psutil

    try:
        return bool(psutil.Process(pid).create_time() <= since + 1.0)  # clocks of file systems and kernels differ
    except psutil.NoSuchProcess:
        return False
    except psutil.AccessDenied:
        return True
