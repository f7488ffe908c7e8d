"""Versions of a scenario: a file that was changed and imported again supersedes what was imported before."""

import sqlite3


def newest_version(connection: sqlite3.Connection, scenario_id: str) -> str:
    """The id of the version that nothing supersedes yet, beginning with this one."""
    query = "SELECT artifact_id FROM artifacts WHERE kind = 'scenario' AND json_extract(record, '$.supersedes') = ?"
    newest, seen = scenario_id, {scenario_id}
    while (row := connection.execute(query, (newest,)).fetchone()) is not None and row[0] not in seen:
        newest = str(row[0])
        seen.add(newest)
    return newest
