"""The catalogue's tables in SQLite: filled from the facts of scenarios, and rebuilt from them at any time.

A row is an entry: a scenario with one of its planning problems. Its number is made of the sequence of the scenario's
artifact, so that a server sees at once what another one added, and a crash between storing and cataloguing heals with
the next search.
"""

import sqlite3
from collections.abc import Iterable

from plannerforge.engine.catalog.describe_text import describe
from plannerforge.engine.catalog.places import place_keys
from plannerforge.schemas.scenarios import ScenarioFacts

VERSION = 3
"""Raised when tables or descriptions change: older tables are dropped and filled again."""

MOST_ENTRIES = 1024
"""Planning problems of one file that are entered, and the step of the numbers between two artifacts."""

NEVER_S = 1e9
"""Stands in the tables for a time to collision that never comes."""

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
CREATE TABLE IF NOT EXISTS catalog_version (version INTEGER NOT NULL, last_entered INTEGER NOT NULL);
"""


def is_ready(connection: sqlite3.Connection) -> bool:
    """Whether the tables exist in this version."""
    found = connection.execute("SELECT name FROM sqlite_master WHERE name = 'catalog_version'").fetchone()
    if found is None:
        return False
    row = connection.execute("SELECT max(version) FROM catalog_version").fetchone()
    return row is not None and row[0] == VERSION


def prepare(connection: sqlite3.Connection) -> None:
    """Make the tables; tables of another version are dropped and made anew, empty."""
    if is_ready(connection):
        return
    for table in _TABLES:
        connection.execute(f"DROP TABLE IF EXISTS {table}")
    for statement in _SCHEMA.split(";"):
        connection.execute(statement)
    connection.execute("INSERT INTO catalog_version VALUES (?, 0)", (VERSION,))


def last_entered(connection: sqlite3.Connection) -> int:
    """The sequence of the artifact up to which all scenarios have been entered; 0 for new tables."""
    return int(connection.execute("SELECT last_entered FROM catalog_version").fetchone()[0])


def set_last_entered(connection: sqlite3.Connection, sequence: int) -> None:
    """Remember how far the artifacts have been entered."""
    connection.execute("UPDATE catalog_version SET last_entered = ?", (sequence,))


def add_scenario(connection: sqlite3.Connection, sequence: int, facts: ScenarioFacts) -> None:
    """Enter every planning problem of a scenario that was stored as artifact number ``sequence``."""
    for index, entry in enumerate(facts.entries()[:MOST_ENTRIES]):
        add_facts(connection, sequence * MOST_ENTRIES + index, entry)


def remove_scenario(connection: sqlite3.Connection, sequence: int) -> None:
    """Take out every entry of the scenario that was stored as artifact number ``sequence``."""
    first = sequence * MOST_ENTRIES
    for table in ("catalog_scenarios", "catalog_words", "catalog_counts", "catalog_limits"):
        connection.execute(
            f"DELETE FROM {table} WHERE number BETWEEN ? AND ?",  # noqa: S608 - fixed names only
            (first, first + MOST_ENTRIES - 1),
        )


def add_facts(connection: sqlite3.Connection, number: int, facts: ScenarioFacts) -> None:
    """Enter one entry; one that is there already stays as it is."""
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
            (NEVER_S if ego.time_to_collision_s is None else ego.time_to_collision_s) if ego else None,
            facts.horizon_s,
            facts.density_per_km,
            facts.model_dump_json(),
            describe(facts),
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
    """The facts of these scenarios; ids that are not in the catalogue are left out."""
    found = {}
    for scenario_id in scenario_ids:
        row = connection.execute("SELECT facts FROM catalog_scenarios WHERE scenario_id = ?", (scenario_id,)).fetchone()
        if row is not None:
            found[scenario_id] = ScenarioFacts.model_validate_json(row[0])
    return found


def descriptions(connection: sqlite3.Connection) -> dict[str, str]:
    """The readable description of every scenario, by id in alphabetical order."""
    rows = connection.execute("SELECT scenario_id, description FROM catalog_scenarios ORDER BY scenario_id")
    return {row[0]: row[1] for row in rows}


def _words(facts: ScenarioFacts) -> list[tuple[str, str]]:
    roads = facts.roads
    words = [("tag", tag) for tag in facts.tags]
    words += [("feature", feature) for feature in facts.features]
    words += [("place", key) for key in sorted(place_keys(facts.location.place))]
    words += [("sign@ego", sign) for sign in roads.signs_ego] + [("sign@map", sign) for sign in roads.signs_map]
    words += [("sign@ego", "traffic_light")] if roads.traffic_light_ego else []
    words += [("sign@map", "traffic_light")] if roads.traffic_lights_map else []
    words += [("sign@ego", "speed_limit")] if roads.limits_ego_kmh else []
    words += [("sign@map", "speed_limit")] if roads.limits_map_kmh else []
    return words
