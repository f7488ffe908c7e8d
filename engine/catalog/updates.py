"""Bringing the catalogue's tables up to date with the scenarios of the workspace.

The stored artifacts are the truth: what another server stored, or what a crash left uncatalogued, is entered by the
next search.

A file that was changed and imported again is a *version*, which names the one that it supersedes; all that hang
together are a family. The catalogue lists the member that was added last, or an earlier one that was imported again
since. The latter is kept in a table of its own: artifacts are never changed, and what a user listed again must stay
listed when the catalogue is rebuilt.
"""

import sqlite3
from collections.abc import Iterable

from ...schemas.scenarios import ScenarioRecord
from ..workspace import Database
from .tables import add_scenario, is_ready, last_entered, prepare, remove_scenario, set_last_entered

_FAMILY = """
WITH RECURSIVE
    earlier (id) AS (
        VALUES (?) UNION
        SELECT json_extract(record, '$.supersedes') FROM artifacts JOIN earlier ON artifact_id = earlier.id
        WHERE kind = 'scenario' AND json_extract(record, '$.supersedes') IS NOT NULL),
    family (id) AS (
        SELECT id FROM earlier UNION
        SELECT artifact_id FROM artifacts JOIN family ON json_extract(record, '$.supersedes') = family.id
        WHERE kind = 'scenario')
SELECT artifact_id FROM artifacts JOIN family ON artifact_id = family.id WHERE kind = 'scenario' ORDER BY sequence
"""
_LISTED_AGAIN = """
CREATE TABLE IF NOT EXISTS versions_listed_again (newest TEXT PRIMARY KEY, listed TEXT NOT NULL) WITHOUT ROWID
"""
"""Counts as long as nothing newer than ``newest`` was added to its family."""


def refresh(database: Database) -> int:
    """Enter the scenarios that are stored but not yet in the tables; returns their number.

    Raises:
        ResourceFailure: the database cannot be written.
    """
    if is_ready(database.connection()) and not _missing(database.connection()):
        return 0
    with database.writing() as connection:
        prepare(connection)
        return _enter_missing(connection)


def _enter_missing(connection: sqlite3.Connection) -> int:
    """As ``refresh``, within a writing transaction and with tables that exist."""
    rows = _missing(connection)
    changed = []
    for sequence, artifact_id, record in rows:
        read = ScenarioRecord.model_validate_json(record)
        add_scenario(connection, sequence, read.facts)
        if read.supersedes is not None:
            changed.append(artifact_id)
    if rows:
        set_last_entered(connection, rows[-1][0])
    _list_one_of_each(connection, changed)
    return len(rows)


def list_again(database: Database, scenario_id: str) -> None:
    """List an earlier version in place of the later ones.

    Raises:
        ResourceFailure: the database cannot be written.
    """
    with database.writing() as connection:
        prepare(connection)
        _enter_missing(connection)
        _list_version(connection, scenario_id)
        _list_one_of_each(connection, [scenario_id])


def _list_one_of_each(connection: sqlite3.Connection, changed: Iterable[str]) -> None:
    """Of every family with a changed member, enter the version that is listed and take out the others."""
    done: set[str] = set()
    for artifact_id in changed:
        if artifact_id in done:
            continue
        members = family(connection, artifact_id)
        done.update(members)
        listed = listed_version(connection, artifact_id)
        for member in members:
            sequence, record = _stored(connection, member)
            if member == listed:
                add_scenario(connection, sequence, ScenarioRecord.model_validate_json(record).facts)
            else:
                remove_scenario(connection, sequence)


def _stored(connection: sqlite3.Connection, scenario_id: str) -> tuple[int, str]:
    query = "SELECT sequence, record FROM artifacts WHERE kind = 'scenario' AND artifact_id = ?"
    row = connection.execute(query, (scenario_id,)).fetchone()
    return int(row[0]), str(row[1])


def _missing(connection: sqlite3.Connection) -> list[tuple[int, str, str]]:
    rows = connection.execute(
        "SELECT sequence, artifact_id, record FROM artifacts "
        "WHERE kind = 'scenario' AND sequence > ? ORDER BY sequence",
        (last_entered(connection),),
    )
    return [(int(row[0]), str(row[1]), str(row[2])) for row in rows]


def family(connection: sqlite3.Connection, scenario_id: str) -> tuple[str, ...]:
    """All versions that hang together with this stored one, in the order in which they were added."""
    return tuple(str(row[0]) for row in connection.execute(_FAMILY, (scenario_id,)))


def listed_version(connection: sqlite3.Connection, scenario_id: str) -> str:
    """The version of this scenario that the catalogue lists."""
    newest = family(connection, scenario_id)[-1]
    if not _has_table(connection):
        return newest
    row = connection.execute("SELECT listed FROM versions_listed_again WHERE newest = ?", (newest,)).fetchone()
    return newest if row is None else str(row[0])


def _list_version(connection: sqlite3.Connection, scenario_id: str) -> None:
    """Let the catalogue list this version instead of those that were added later; within a writing transaction."""
    newest = family(connection, scenario_id)[-1]
    connection.execute(_LISTED_AGAIN)
    connection.execute("INSERT OR REPLACE INTO versions_listed_again VALUES (?, ?)", (newest, scenario_id))


def _has_table(connection: sqlite3.Connection) -> bool:
    query = "SELECT 1 FROM sqlite_master WHERE name = 'versions_listed_again'"
    return connection.execute(query).fetchone() is not None
