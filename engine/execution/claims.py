"""Claims on work, so that servers and batches on one workspace do not create the same result simultaneously."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from ..workspace import Database, still_runs


class Claims:
    """Claims of this process on recipes; claims of a process that is gone do not count."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._own_claims: set[str] = set()
        self._taking = threading.Lock()

    @contextmanager
    def claimed(self, digest: str) -> Iterator[bool]:
        """Claim a recipe for the block; yield False, without a claim, if another process or thread already works on it.

        Raises:
            ResourceFailure: The database cannot be written.
        """
        if not self._take(digest):
            yield False
            return
        try:
            yield True
        finally:
            try:
                with self._database.writing() as connection:
                    connection.execute("DELETE FROM claims WHERE digest = ? AND owner_pid = ?", (digest, os.getpid()))
            finally:
                self._own_claims.discard(digest)  # a claim that cannot be released must not block its own process

    def _take(self, digest: str) -> bool:
        """Take the claim, first among this process's threads, then among processes; return True if both succeed."""
        with self._taking:
            if digest in self._own_claims:
                return False
            self._own_claims.add(digest)
        is_ours = False
        try:
            is_ours = self._claim(digest)
        finally:
            if not is_ours:
                self._own_claims.discard(digest)
        return is_ours

    def _claim(self, digest: str) -> bool:
        with self._database.writing() as connection:
            row = connection.execute("SELECT owner_pid, made_at FROM claims WHERE digest = ?", (digest,)).fetchone()
            if row is not None and row["owner_pid"] != os.getpid() and still_runs(row["owner_pid"], row["made_at"]):
                return False
            connection.execute("INSERT OR REPLACE INTO claims VALUES (?, ?, ?)", (digest, os.getpid(), time.time()))
        return True
