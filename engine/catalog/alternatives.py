"""What exists where a search matches nothing: names that no scenario carries, and the candidates' nearest values."""

import sqlite3
from collections.abc import Collection, Sequence
from itertools import islice

from ...schemas.errors import closest
from ...schemas.vocabulary import FEATURES, ROAD_NET_KEYS, TAGS
from .constraints import MEASURE_COLUMNS, PARTICIPANTS, Constraint, known_places
from .entry_sets import EntrySet, column_of
from .funnel import EmptiedBy, Funnel
from .tables import NEVER_S

SHOWN = 8
"""Values that a note lists, at most (chosen)."""
_KINDS = {
    "tag": ("tags", TAGS),
    "feature": ("features", FEATURES),
    "sign@ego": ("signs on the ego's lane", ROAD_NET_KEYS),
    "sign@map": ("signs on the map", ROAD_NET_KEYS),
}


def never_carried(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """A sentence for every valid name that a condition asks for and that no scenario of the catalogue carries."""
    sentences = []
    for constraint in constraints:
        if constraint.negated:
            continue
        for kind, word in constraint.words:
            if _is_carried(connection, kind, word):
                continue
            sentence = f"No scenario of this catalogue carries {kind.replace('sign@', 'sign on ')} '{word}'"
            if kind == "tag" and word in FEATURES and (holding := _carriers(connection, "feature", word)):
                sentence += f"; the computed feature '{word}' holds for {holding}: use features"
            sentences.append(sentence + ".")
    return sentences


def emptied_note(connection: sqlite3.Connection, funnel: Funnel, reason: EmptiedBy) -> str:
    """Which conditions left nothing, and what the candidates of that stage have instead."""
    entering = funnel.entering()
    names = ", ".join(constraint.label for constraint in reason.constraints)
    if reason.together:
        return f"each of {names} holds for some of the {len(entering)} candidates, but no candidate has them together"
    alternatives = [_alternatives(connection, constraint, funnel, entering) for constraint in reason.constraints]
    existing = "; ".join(values for values in alternatives if values)
    return f"none of the {len(entering)} candidates has {names}" + (f"; there are {existing}" if existing else "")


def _alternatives(connection: sqlite3.Connection, constraint: Constraint, funnel: Funnel, entering: EntrySet) -> str:
    """What the candidates have of what a condition is about; empty where that is not worth saying."""
    if constraint.stage == "location":
        return _places(connection, constraint, funnel.within)
    if constraint.stage == "obstacles" and constraint.words:
        return _counts(connection, constraint, funnel, entering)
    if constraint.words:
        return _words(constraint, funnel, entering)
    if constraint.subject == "speed_limit":
        return _limits(connection, constraint, entering)
    what, column_name = _column(constraint)
    column = funnel.postings.column(connection, funnel.entries, column_name)
    held = (column[place] for place in entering.places())
    return _nearest(what, constraint, {round(value, 1) for value in held if value < NEVER_S})


def _column(constraint: Constraint) -> tuple[str, str]:
    """What a condition on a number is about, in words, and the column that holds it."""
    if constraint.stage == "velocity":
        return "initial speeds in m/s", "speed_mps"
    if constraint.stage == "road_net":
        return "lanes", "lanes"
    if constraint.subject == PARTICIPANTS:
        return f"numbers of {PARTICIPANTS}", "size"
    return constraint.subject, MEASURE_COLUMNS[constraint.subject]


def _counts(connection: sqlite3.Connection, constraint: Constraint, funnel: Funnel, entering: EntrySet) -> str:
    """The counts of an obstacle type that occur among the candidates."""
    name, values, without = constraint.words[0][1], set[int](), entering
    for count in column_of(connection, "SELECT DISTINCT count FROM catalog_counts WHERE obstacle = ?", (name,)):
        query = "SELECT number FROM catalog_counts WHERE obstacle = ? AND count = ?"
        held = funnel.holding(query, (name, count)) & entering
        without -= held
        values |= {count} if held else set()
    return _nearest(f"{name} counts", constraint, values | ({0} if without else set()))


def _places(connection: sqlite3.Connection, constraint: Constraint, within: EntrySet | None) -> str:
    known, wanted = known_places(connection, within), constraint.label.partition(" ")[2]
    if constraint.subject == "country":
        return _listed("countries", closest(wanted, known.countries, SHOWN), len(known.countries))
    places = [place for place, _ in known.places]
    return _listed("places", closest(wanted, places, SHOWN), len(places))


def _limits(connection: sqlite3.Connection, constraint: Constraint, entering: EntrySet) -> str:
    scope = "map" if constraint.everywhere else "ego"
    rows = connection.execute("SELECT number, kmh FROM catalog_limits WHERE scope = ?", (scope,))
    return _nearest("limits in km/h", constraint, {row[1] for row in rows if row[0] in entering})


def _words(constraint: Constraint, funnel: Funnel, entering: EntrySet) -> str:
    """Names of the same kind that candidates carry; nothing where they carry what was excluded."""
    if constraint.negated:
        return ""
    kind, word = constraint.words[0]
    what, vocabulary = _KINDS[kind]
    query = "SELECT number FROM catalog_words WHERE kind = ? AND word = ?"
    like_it = closest(word, vocabulary, len(vocabulary))
    carried = (name for name in like_it if funnel.holding(query, (kind, name)) & entering)
    names = list(islice(carried, SHOWN + 1))
    return _listed(what, names[:SHOWN], len(names))


def _nearest(what: str, constraint: Constraint, values: Collection[float]) -> str:
    """The values nearest to the interval that was asked for, and the range of all where there are more."""
    low, high = (float(value) for value in constraint.values[-2:])
    ordered = sorted(values, key=lambda value: (max(low - value, value - high, 0.0), value))
    listed = _listed(what, [f"{value:g}" for value in ordered[:SHOWN]], len(ordered))
    return f"{listed} ({min(values):g} to {max(values):g})" if len(ordered) > SHOWN else listed


def _is_carried(connection: sqlite3.Connection, kind: str, word: str) -> bool:
    if kind == "obstacle":
        row = connection.execute("SELECT 1 FROM catalog_counts WHERE obstacle = ? LIMIT 1", (word,)).fetchone()
    else:
        query = "SELECT 1 FROM catalog_words WHERE kind = ? AND word = ? LIMIT 1"
        row = connection.execute(query, (kind, word)).fetchone()
    return row is not None


def _carriers(connection: sqlite3.Connection, kind: str, word: str) -> int:
    query = "SELECT count(*) FROM catalog_words WHERE kind = ? AND word = ?"
    return int(connection.execute(query, (kind, word)).fetchone()[0])


def _listed(what: str, nearest: Sequence[str], count: int) -> str:
    return f"{what} {', '.join(nearest)}{' …' if count > len(nearest) else ''}" if nearest else ""
