"""Versions of a scenario: a file that was changed and imported again takes the place of what was imported before.

A version names the one that it supersedes; all that hang together are a family. The catalogue lists the member that was
added last, or an earlier one that was imported again since. The latter is kept in a table of its own: artifacts are
never changed, and what a user listed again must stay listed when the catalogue is rebuilt.
"""

import sqlite3

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


def list_version(connection: sqlite3.Connection, scenario_id: str) -> None:
    """Let the catalogue list this version instead of those that were added later; within a writing transaction."""
    newest = family(connection, scenario_id)[-1]
    connection.execute(_LISTED_AGAIN)
    connection.execute("INSERT OR REPLACE INTO versions_listed_again VALUES (?, ?)", (newest, scenario_id))


def _has_table(connection: sqlite3.Connection) -> bool:
    query = "SELECT 1 FROM sqlite_master WHERE name = 'versions_listed_again'"
    return connection.execute(query).fetchone() is not None
