"""Bringing the catalogue's tables up to date with the scenarios of the workspace.

The stored artifacts are the truth: what another server stored, or what a crash left uncatalogued, is entered by the
next search.
"""

from plannerforge.engine.catalog.tables import add_facts, is_ready, prepare
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
            add_facts(connection, sequence, ScenarioRecord.model_validate_json(record).facts)
    return len(rows)


def _missing(database: Database) -> list[tuple[int, str]]:
    rows = database.connection().execute(
        "SELECT sequence, record FROM artifacts WHERE kind = 'scenario' "
        "AND sequence > (SELECT ifnull(max(number), 0) FROM catalog_scenarios) ORDER BY sequence"
    )
    return [(int(row[0]), str(row[1])) for row in rows]
