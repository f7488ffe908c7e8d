"""Bringing the catalogue's tables up to date with the scenarios of the workspace.

The stored artifacts are the truth: what another server stored, or what a crash left uncatalogued, is entered by the
next search. A scenario that supersedes another one (a changed file that was imported again) takes its place.
"""

import sqlite3

from plannerforge.engine.catalog.tables import MOST_ENTRIES, add_scenario, is_ready, prepare, remove_scenario
from plannerforge.engine.workspace.database import Database
from plannerforge.schemas.scenarios import ScenarioRecord


def refresh(database: Database) -> int:
    """Enter the scenarios that are stored but not yet in the tables; gives their number.

    Raises:
        ResourceFailure: the database cannot be written.
    """
    if is_ready(database.connection()) and not _missing(database):
        return 0
    with database.writing() as connection:
        prepare(connection)
        rows = _missing(database)
        for sequence, record in rows:
            read = ScenarioRecord.model_validate_json(record)
            add_scenario(connection, sequence, read.facts)
            if read.supersedes is not None:
                _take_out(connection, read.supersedes)
    return len(rows)


def _take_out(connection: sqlite3.Connection, scenario_id: str) -> None:
    row = connection.execute(
        "SELECT sequence FROM artifacts WHERE kind = 'scenario' AND artifact_id = ?", (scenario_id,)
    ).fetchone()
    if row is not None:
        remove_scenario(connection, int(row[0]))


def _missing(database: Database) -> list[tuple[int, str]]:
    rows = database.connection().execute(
        "SELECT sequence, record FROM artifacts WHERE kind = 'scenario' "
        "AND sequence > (SELECT ifnull(max(number), 0) / ? FROM catalog_scenarios) ORDER BY sequence",
        (MOST_ENTRIES,),
    )
    return [(int(row[0]), str(row[1])) for row in rows]
