"""The catalogue's tables in SQLite: filled from the facts of scenarios, and rebuilt from them at any time.

A row is an entry: a scenario with one of its planning problems. Its number is made of the sequence of the scenario's
artifact, so that a server sees at once what another one added, and a crash between storing and cataloguing heals with
the next search. Each entry holds its description in words, which is embedded and searched, beside its facts.
"""

import sqlite3
from collections.abc import Iterable

from ...schemas.scenarios import EgoFacts, ScenarioFacts
from ..maps import place_keys

VERSION = 3
"""Raised when tables or descriptions change: older tables are dropped and filled again."""
MOST_ENTRIES = 1024
"""Planning problems of one file that are entered, and the step of the numbers between two artifacts."""
NEVER_S = 1e9
"""Stands in the column ``ttc_s``, the time to conflict, where the ego never meets the recording."""
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
    if connection.execute("SELECT name FROM sqlite_master WHERE name = 'catalog_version'").fetchone() is None:
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
    """The facts of these scenarios; ids that are not in the catalogue are left out."""
    facts = {}
    for scenario_id in scenario_ids:
        row = connection.execute("SELECT facts FROM catalog_scenarios WHERE scenario_id = ?", (scenario_id,)).fetchone()
        if row is not None:
            facts[scenario_id] = ScenarioFacts.model_validate_json(row[0])
    return facts


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


_FEATURE_WORDS = {
    "intersection": "an intersection",
    "roundabout": "a roundabout",
    "oncoming_traffic": "oncoming traffic",
    "lead_vehicle": "a vehicle ahead in the ego's lane",
}
_MANOEUVRES = {
    "ego_turns_left": "turns left",
    "ego_turns_right": "turns right",
    "ego_goes_straight": "goes straight on",
    "ego_changes_lane": "changes lane",
}


def description_of(facts: ScenarioFacts) -> str:
    """A few plain sentences: place, kind of road, signs, traffic, the ego's start and task."""
    where = f"{facts.location.place}, {facts.location.country}"
    parts = [f"Traffic scenario in {where}."]
    if facts.tags:
        parts.append(f"Tagged {', '.join(tag.replace('_', ' ') for tag in facts.tags)}.")
    seen = [words for feature, words in _FEATURE_WORDS.items() if feature in facts.features]
    if seen:
        parts.append(f"The road shows {', '.join(seen)}.")
    parts.append(_road_sentence(facts))
    parts.append(_traffic_sentence(facts))
    if facts.ego:
        parts.append(_ego_sentence(facts, facts.ego))
    return " ".join(part for part in parts if part)


def summary(facts: ScenarioFacts) -> str:
    """A scenario in one line: traffic, lanes, ego speed, manoeuvre."""
    counts = ", ".join(f"{count} {kind}" for kind, count in _by_number(facts.participants.counts)) or "no traffic"
    ego = facts.ego
    parts = [counts]
    if ego:
        parts.append(f"ego {ego.speed_mps:.1f} m/s on {_lanes(ego.lanes)}")
        parts += [words for feature, words in _MANOEUVRES.items() if feature in facts.features]
    return ", ".join(parts)


def _road_sentence(facts: ScenarioFacts) -> str:
    roads, parts = facts.roads, []
    if facts.ego and facts.ego.lanes:
        parts.append(f"{_lanes(facts.ego.lanes)} in the ego's direction")
    if roads.limits_ego_kmh:
        parts.append(f"speed limit {' and '.join(f'{limit:g}' for limit in roads.limits_ego_kmh)} km/h")
    if roads.traffic_light_ego:
        parts.append("a traffic light on the ego's lane")
    elif roads.traffic_lights_map:
        parts.append("traffic lights elsewhere on the map")
    signs = [sign.replace("_", " ") for sign in roads.signs_ego if sign != "speed_limit"]
    if signs:
        parts.append(f"signs: {', '.join(signs)}")
    return f"Road: {'; '.join(parts)}." if parts else ""


def _traffic_sentence(facts: ScenarioFacts) -> str:
    counts = _by_number(facts.participants.counts)
    if not counts:
        return "No other traffic."
    amount = "Dense" if facts.participants.total >= 20 else "Some" if facts.participants.total >= 6 else "Little"
    return f"{amount} traffic: {', '.join(f'{count} {_plural(kind, count)}' for kind, count in counts)}."


def _ego_sentence(facts: ScenarioFacts, ego: EgoFacts) -> str:
    pace = "stands" if ego.speed_mps < 0.5 else f"starts at {ego.speed_mps:.0f} m/s ({ego.speed_mps * 3.6:.0f} km/h)"
    manoeuvres = [words for feature, words in _MANOEUVRES.items() if feature in facts.features]
    task = f" and {' and '.join(manoeuvres)} to its goal" if manoeuvres else ""
    return f"The ego vehicle {pace}{task}, within {facts.horizon_steps * facts.step_s:.0f} s."


def _by_number(counts: dict[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))


def _plural(kind: str, count: int) -> str:
    words = {"parkedVehicle": "parked vehicle", "priorityVehicle": "priority vehicle", "unknown": "unknown object"}
    word = words.get(kind, kind)
    return word if count == 1 else f"{word}es" if word == "bus" else f"{word}s"


def _lanes(count: int) -> str:
    return "1 lane" if count == 1 else f"{count} lanes"
