"""Bringing the catalogue's tables up to date with the scenarios of the workspace.

The stored artifacts are the truth: what another server stored, or what a crash left uncatalogued, is entered by the
next search. Of a scenario's versions only one is listed.
"""

import sqlite3
from collections.abc import Iterable

from plannerforge.engine.catalog.tables import (
    add_scenario,
    is_ready,
    last_entered,
    prepare,
    remove_scenario,
    set_last_entered,
)
from plannerforge.engine.catalog.versions import family, list_version, listed_version
from plannerforge.engine.workspace.database import Database
from plannerforge.schemas.scenarios import ScenarioRecord


def refresh(database: Database) -> int:
    """Enter the scenarios that are stored but not yet in the tables; gives their number.

    Raises:
        ResourceFailure: the database cannot be written.
    """
    if is_ready(database.connection()) and not _missing(database.connection()):
        return 0
    with database.writing() as connection:
        prepare(connection)
        return enter_missing(connection)


def enter_missing(connection: sqlite3.Connection) -> int:
    """As ``refresh``, within a writing transaction and with tables that are there; gives the number entered."""
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
        enter_missing(connection)
        list_version(connection, scenario_id)
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
