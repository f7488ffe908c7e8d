"""What exists where a search found nothing: names that no scenario carries, and the values of the candidates."""

import sqlite3
from collections.abc import Sequence

from plannerforge.engine.catalog.constraints import Constraint
from plannerforge.engine.catalog.funnel import EmptiedBy, Funnel
from plannerforge.engine.catalog.locations import known_places
from plannerforge.engine.catalog.tables import NEVER_S
from plannerforge.engine.catalog.vocabulary_words import measure_name
from plannerforge.schemas.errors import closest
from plannerforge.schemas.vocabulary import FEATURES

SHOWN = 8


def never_carried(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """A sentence for every valid name that a condition asks for and that no scenario of the catalogue carries."""
    sentences = []
    for constraint in constraints:
        if constraint.negated:
            continue
        for kind, word in constraint.words:
            if _carriers(connection, kind, word):
                continue
            sentence = f"No scenario of this catalogue carries {kind.replace('sign@', 'sign on ')} '{word}'"
            if kind == "tag" and word in FEATURES and (there := _carriers(connection, "feature", word)):
                sentence += f"; the computed feature '{word}' holds for {there}: use features"
            sentences.append(sentence + ".")
    return sentences


def emptied_note(connection: sqlite3.Connection, funnel: Funnel, reason: EmptiedBy) -> str:
    """Which conditions left nothing, and what the candidates of that stage have instead."""
    entering = funnel.entering()
    names = ", ".join(one.label for one in reason.constraints)
    if reason.together:
        return f"each of {names} holds for some of the {len(entering)} candidates, but no candidate has them together"
    there = [values for values in (_there(connection, one, entering) for one in reason.constraints) if values]
    return f"none of the {len(entering)} candidates has {names}" + (f"; there are {'; '.join(there)}" if there else "")


def _there(connection: sqlite3.Connection, constraint: Constraint, entering: frozenset[int]) -> str:
    if constraint.stage == "location":
        return _places(connection, constraint)
    if constraint.stage == "tags":
        return _measures(connection, constraint, entering)
    if constraint.stage == "obstacles":
        name = constraint.words[0][1]
        counts = dict(connection.execute("SELECT number, count FROM catalog_counts WHERE obstacle = ?", (name,)))
        return _listed(f"{name} counts", sorted({counts.get(number, 0) for number in entering}))
    column = {"velocity": "speed_mps", "road_net": "lanes"}.get(constraint.stage, "")
    if column == "lanes" and constraint.subject != "lanes":
        return _limits(connection, constraint, entering) if constraint.subject == "speed_limit" else ""
    if not column:
        return ""
    rows = connection.execute(f"SELECT number, {column} FROM catalog_scenarios")  # noqa: S608 - one of two fixed names
    values = sorted({row[1] for row in rows if row[0] in entering and row[1] is not None})
    if column == "speed_mps" and values:
        return f"initial speeds from {values[0]:.1f} to {values[-1]:.1f} m/s"
    return _listed(column, values)


def _measures(connection: sqlite3.Connection, constraint: Constraint, entering: frozenset[int]) -> str:
    if constraint.words:
        return ""
    columns = {"ttc": "ttc_s", "horizon": "horizon_s", "density": "density_per_km"}
    name = measure_name(constraint.subject) or ""
    rows = connection.execute(f"SELECT number, {columns[name]} FROM catalog_scenarios")  # noqa: S608 - a fixed name
    values = sorted(row[1] for row in rows if row[0] in entering and row[1] is not None and row[1] < NEVER_S)
    return f"{name} from {values[0]:g} to {values[-1]:g}" if values else ""


def _places(connection: sqlite3.Connection, constraint: Constraint) -> str:
    known, wanted = known_places(connection), constraint.label.partition(" ")[2]
    if constraint.label.startswith("country "):
        return _listed("countries", list(known.countries))
    return _listed("places", closest(wanted, [place for place, _ in known.places], SHOWN))


def _limits(connection: sqlite3.Connection, constraint: Constraint, entering: frozenset[int]) -> str:
    scope = "map" if "@map" in constraint.label else "ego"
    rows = connection.execute("SELECT number, kmh FROM catalog_limits WHERE scope = ?", (scope,))
    return _listed("limits in km/h", sorted({row[1] for row in rows if row[0] in entering}))


def _carriers(connection: sqlite3.Connection, kind: str, word: str) -> int:
    if kind == "obstacle":
        row = connection.execute("SELECT count(*) FROM catalog_counts WHERE obstacle = ?", (word,)).fetchone()
    else:
        query = "SELECT count(*) FROM catalog_words WHERE kind = ? AND word = ?"
        row = connection.execute(query, (kind, word)).fetchone()
    return int(row[0])


def _listed(what: str, values: Sequence[object]) -> str:
    shown = ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values[:SHOWN])
    return f"{what} {shown}{' …' if len(values) > SHOWN else ''}" if values else ""
