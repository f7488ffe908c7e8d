"""The database in several threads: transactions stand side by side, and nobody sees half of another's."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from plannerforge.engine.workspace import Database

COUNT = "SELECT count(*) FROM claims"
INSERT = "INSERT INTO claims VALUES (?, 1, 1)"


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return Database(tmp_path / "workspace.sqlite")


def elsewhere(function: Callable[[], int]) -> int:
    """What a function gives in another thread."""
    with ThreadPoolExecutor(1) as threads:
        return threads.submit(function).result()


def count(database: Database) -> int:
    return int(database.connection().execute(COUNT).fetchone()[0])


def test_every_thread_has_its_own_connection(database: Database) -> None:
    own = id(database.connection())
    assert id(database.connection()) == own
    assert elsewhere(lambda: id(database.connection())) != own


def test_partial_writes_are_invisible_to_other_threads(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(INSERT, ("a",))
        assert elsewhere(lambda: count(database)) == 0
    assert elsewhere(lambda: count(database)) == 1


def test_a_transaction_that_fails_leaves_other_threads_writes_in_place(database: Database) -> None:
    begun, may_fail = threading.Event(), threading.Event()

    def fail() -> None:
        with database.writing() as connection:
            connection.execute(INSERT, ("lost",))
            begun.set()
            may_fail.wait(60)
            raise ValueError("broken")

    with ThreadPoolExecutor(2) as threads:
        failing = threads.submit(fail)
        begun.wait(60)
        waiting = threads.submit(write, database, "kept")
        may_fail.set()
        waiting.result()
        assert isinstance(failing.exception(), ValueError)
    assert count(database) == 1


def test_writers_of_many_threads_wait_for_each_other(database: Database) -> None:
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda number: write(database, str(number)), range(60)))
    assert count(database) == 60


def test_closed_database_opens_again_in_each_thread(database: Database) -> None:
    write(database, "a")
    elsewhere(lambda: count(database))
    database.close()
    assert (count(database), elsewhere(lambda: count(database))) == (1, 1)


def write(database: Database, digest: str) -> None:
    with database.writing() as connection:
        connection.execute(INSERT, (digest,))


def test_the_caches_of_all_threads_have_one_bound(database: Database) -> None:
    asked = ("soft_heap_limit", "cache_size")

    def bounds() -> list[int]:
        connection = database.connection()
        return [int(connection.execute(f"PRAGMA {name}").fetchone()[0]) for name in asked]

    (together, own_kib), others = bounds(), ThreadPoolExecutor(1)
    with others:
        assert others.submit(bounds).result() == [together, own_kib]
    assert together == 2 * 1024 * abs(own_kib)
