"""The catalogue's tables in SQLite: filled from the facts of scenarios, and rebuilt from them at any time.

A row is an entry: a scenario with one of its planning problems. Its number is based on the sequence number of the
scenario's artifact. The stored artifacts are authoritative: the next search enters any scenario that another server
stored or that a crash left uncatalogued. Each entry has, in addition to its facts, its description in words, which is
embedded and searched.

A file that was changed and imported again is a *version*, which refers to the version that it supersedes; all connected
versions form a family. The catalogue lists the member that was added last, or an earlier member that was imported again
since. A separate table records this import, because artifacts are never changed and the listing must survive a
rebuild of the catalogue.
"""

import sqlite3
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from ...schemas.scenarios import ScenarioFacts, ScenarioRecord
from ..maps import place_keys
from .words import description_of, origins_of

if TYPE_CHECKING:
    from ..workspace import Database

_VERSION = 6
"""Raised when tables or descriptions change: older tables are dropped and filled again."""
MOST_ENTRIES = 1024
"""The most planning problems entered per file, and the step of the numbers between two artifacts."""
NEVER_S = 1e9
"""The value of ``ttc_s``, the time to conflict, if the ego never meets the recording."""
_TABLES = ("catalog_scenarios", "catalog_words", "catalog_counts", "catalog_limits", "catalog_version")
_SCHEMA = """
CREATE TABLE IF NOT EXISTS catalog_scenarios (
    number INTEGER PRIMARY KEY, scenario_id TEXT NOT NULL UNIQUE, country TEXT NOT NULL, place TEXT NOT NULL,
    speed_mps REAL, lanes INTEGER, size INTEGER NOT NULL, ttc_s REAL, horizon_s REAL NOT NULL,
    density_per_km REAL NOT NULL, facts TEXT NOT NULL, description TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS catalog_by_country ON catalog_scenarios (country, place);
CREATE INDEX IF NOT EXISTS catalog_by_speed ON catalog_scenarios (speed_mps);
CREATE INDEX IF NOT EXISTS catalog_by_lanes ON catalog_scenarios (lanes);
CREATE INDEX IF NOT EXISTS catalog_by_ttc ON catalog_scenarios (ttc_s);
CREATE INDEX IF NOT EXISTS catalog_by_horizon ON catalog_scenarios (horizon_s);
CREATE INDEX IF NOT EXISTS catalog_by_density ON catalog_scenarios (density_per_km);
CREATE INDEX IF NOT EXISTS catalog_by_order ON catalog_scenarios (scenario_id, number, size, ttc_s);
CREATE TABLE IF NOT EXISTS catalog_words (
    kind TEXT NOT NULL, word TEXT NOT NULL, number INTEGER NOT NULL, PRIMARY KEY (kind, word, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS catalog_counts (
    obstacle TEXT NOT NULL, number INTEGER NOT NULL, count INTEGER NOT NULL,
    PRIMARY KEY (obstacle, number)) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS catalog_by_count ON catalog_counts (obstacle, count, number);
CREATE TABLE IF NOT EXISTS catalog_limits (
    scope TEXT NOT NULL, kmh REAL NOT NULL, number INTEGER NOT NULL, PRIMARY KEY (scope, kmh, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS catalog_version (
    version INTEGER NOT NULL, last_entered INTEGER NOT NULL, changes INTEGER NOT NULL);
CREATE TRIGGER IF NOT EXISTS catalog_entered AFTER INSERT ON catalog_scenarios BEGIN
    UPDATE catalog_version SET changes = changes + 1 ; END;
CREATE TRIGGER IF NOT EXISTS catalog_taken_out AFTER DELETE ON catalog_scenarios BEGIN
    UPDATE catalog_version SET changes = changes + 1 ; END;
"""
"""``changes`` counts entries added and removed: data kept in memory is valid for one count."""

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
"""Valid until a version newer than ``newest`` is added to the family."""


def is_ready(connection: sqlite3.Connection) -> bool:
    """Return whether the tables exist in the current version."""
    if connection.execute("SELECT name FROM sqlite_master WHERE name = 'catalog_version'").fetchone() is None:
        return False
    row = connection.execute("SELECT max(version) FROM catalog_version").fetchone()
    return row is not None and row[0] == _VERSION


def prepare(connection: sqlite3.Connection) -> None:
    """Create the tables; tables of another version are dropped and created again, empty."""
    if is_ready(connection):
        return
    for table in _TABLES:
        connection.execute(f"DROP TABLE IF EXISTS {table}")
    for statement in _SCHEMA.split(";\n"):
        connection.execute(statement)
    connection.execute("INSERT INTO catalog_version VALUES (?, 0, 0)", (_VERSION,))


def add_facts(connection: sqlite3.Connection, number: int, facts: ScenarioFacts) -> None:
    """Enter one entry; an existing entry is unchanged."""
    ego = facts.ego
    entered = connection.execute(
        "INSERT OR IGNORE INTO catalog_scenarios VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            number,
            facts.scenario_id,
            facts.location.country,
            facts.location.place,
            ego.speed_mps if ego else None,
            ego.lanes if ego else None,
            facts.participants.total,
            (NEVER_S if ego.time_to_conflict_s is None else ego.time_to_conflict_s) if ego else None,
            facts.horizon_s,
            facts.density_per_km,
            facts.model_dump_json(),
            description_of(facts),
        ),
    )
    if entered.rowcount == 0:
        return
    connection.executemany(
        "INSERT OR IGNORE INTO catalog_words VALUES (?, ?, ?)", [(kind, word, number) for kind, word in _words(facts)]
    )
    connection.executemany(
        "INSERT OR IGNORE INTO catalog_counts VALUES (?, ?, ?)",
        [(kind, number, count) for kind, count in facts.participants.counts.items()],
    )
    scopes = (("ego", facts.roads.limits_ego_kmh), ("map", facts.roads.limits_map_kmh))
    connection.executemany(
        "INSERT OR IGNORE INTO catalog_limits VALUES (?, ?, ?)",
        [(scope, limit, number) for scope, limits in scopes for limit in limits],
    )


def facts_of(connection: sqlite3.Connection, scenario_ids: Iterable[str]) -> dict[str, ScenarioFacts]:
    """Return the facts of the given scenarios by id; ids that are not in the catalogue are left out."""
    query = "SELECT facts FROM catalog_scenarios WHERE scenario_id = ?"
    rows = ((scenario_id, connection.execute(query, (scenario_id,)).fetchone()) for scenario_id in scenario_ids)
    return {scenario_id: ScenarioFacts.model_validate_json(row[0]) for scenario_id, row in rows if row is not None}


def descriptions(connection: sqlite3.Connection) -> dict[str, str]:
    """Return the readable description of every scenario, by id in alphabetical order."""
    return dict(connection.execute("SELECT scenario_id, description FROM catalog_scenarios ORDER BY scenario_id"))


def listed_facts(connection: sqlite3.Connection, within: frozenset[str] | None) -> Iterator[ScenarioFacts]:
    """Yield the facts of the listed scenarios, or of those with the given ids, in the order of their entries."""
    query = "SELECT scenario_id, facts FROM catalog_scenarios ORDER BY number"
    for scenario_id, text in connection.execute(query):
        if within is None or scenario_id in within:
            yield ScenarioFacts.model_validate_json(text)


def _words(facts: ScenarioFacts) -> list[tuple[str, str]]:
    roads = facts.roads
    words = [("tag", tag) for tag in facts.tags] + [("origin", origin) for origin in origins_of(facts)]
    words += [("feature", feature) for feature in facts.features]
    words += [("feature", typed) for typed in (facts.ego.manoeuvres or () if facts.ego else ())]
    words += [("not computed", "manoeuvres")] if facts.ego and facts.ego.manoeuvres is None else []
    words += [("circumstance", word) for word in facts.circumstances]
    words += [("place", key) for key in sorted(place_keys(facts.location.place))]
    words += [("sign@ego", sign) for sign in roads.signs_ego] + [("sign@map", sign) for sign in roads.signs_map]
    lights = (("sign@ego", roads.traffic_light_ego), ("sign@map", roads.traffic_lights_map))
    limits = (("sign@ego", roads.limits_ego_kmh), ("sign@map", roads.limits_map_kmh))
    words += [(kind, "traffic_light") for kind, held in lights if held]
    return words + [(kind, "speed_limit") for kind, held in limits if held]


def refresh(database: "Database") -> int:
    """Enter the scenarios that are stored but not yet in the tables, and return their number.

    Raises:
        ResourceFailure: the database cannot be written.
    """
    if is_ready(database.connection()) and not _missing(database.connection()):
        return 0
    with database.writing() as connection:
        prepare(connection)
        return _enter_missing(connection)


def _enter_missing(connection: sqlite3.Connection) -> int:
    """Do the same as ``refresh``; the caller has opened a writing transaction and prepared the tables."""
    rows = _missing(connection)
    changed = []
    for sequence, artifact_id, record in rows:
        read = ScenarioRecord.model_validate_json(record)
        _add_scenario(connection, sequence, read.facts)
        if read.supersedes is not None:
            changed.append(artifact_id)
    if rows:
        connection.execute("UPDATE catalog_version SET last_entered = ?", (rows[-1][0],))
    _list_one_of_each(connection, changed)
    return len(rows)


def list_again(database: "Database", scenario_id: str) -> None:
    """Make the catalogue list an earlier version of a scenario again, instead of its later versions.

    Raises:
        ResourceFailure: the database cannot be written.
    """
    with database.writing() as connection:
        prepare(connection)
        _enter_missing(connection)
        newest = family(connection, scenario_id)[-1]
        connection.execute(_LISTED_AGAIN)
        connection.execute("INSERT OR REPLACE INTO versions_listed_again VALUES (?, ?)", (newest, scenario_id))
        _list_one_of_each(connection, [scenario_id])


def _list_one_of_each(connection: sqlite3.Connection, changed: Iterable[str]) -> None:
    """For every family with a changed member, enter the listed version and remove the other versions."""
    done: set[str] = set()
    for artifact_id in changed:
        if artifact_id in done:
            continue
        members = family(connection, artifact_id)
        done.update(members)
        listed = listed_version(connection, artifact_id)
        for member in members:
            query = "SELECT sequence, record FROM artifacts WHERE kind = 'scenario' AND artifact_id = ?"
            sequence, record = connection.execute(query, (member,)).fetchone()
            if member == listed:
                _add_scenario(connection, sequence, ScenarioRecord.model_validate_json(record).facts)
                continue
            first = sequence * MOST_ENTRIES
            for table in ("catalog_scenarios", "catalog_words", "catalog_counts", "catalog_limits"):
                query = f"DELETE FROM {table} WHERE number BETWEEN ? AND ?"  # noqa: S608 - fixed names only
                connection.execute(query, (first, first + MOST_ENTRIES - 1))


def _add_scenario(connection: sqlite3.Connection, sequence: int, facts: ScenarioFacts) -> None:
    """Enter every planning problem of a scenario that was stored as artifact number ``sequence``."""
    for index, entry in enumerate(facts.entries()[:MOST_ENTRIES]):
        add_facts(connection, sequence * MOST_ENTRIES + index, entry)


def _missing(connection: sqlite3.Connection) -> list[tuple[int, str, str]]:
    """Return the sequence, id and record of the stored scenarios that are not entered yet."""
    rows = connection.execute(
        "SELECT sequence, artifact_id, record FROM artifacts WHERE kind = 'scenario' "
        "AND sequence > (SELECT last_entered FROM catalog_version) ORDER BY sequence"
    )
    return [(int(row[0]), str(row[1]), str(row[2])) for row in rows]


def family(connection: sqlite3.Connection, scenario_id: str) -> tuple[str, ...]:
    """Return all versions connected with a stored scenario, in the order in which they were added."""
    return tuple(str(row[0]) for row in connection.execute(_FAMILY, (scenario_id,)))


def listed_version(connection: sqlite3.Connection, scenario_id: str) -> str:
    """Return the version of this scenario that the catalogue lists."""
    newest = family(connection, scenario_id)[-1]
    query = "SELECT 1 FROM sqlite_master WHERE name = 'versions_listed_again'"
    if connection.execute(query).fetchone() is None:
        return newest
    row = connection.execute("SELECT listed FROM versions_listed_again WHERE newest = ?", (newest,)).fetchone()
    return newest if row is None else str(row[0])
