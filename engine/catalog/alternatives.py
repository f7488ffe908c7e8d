"""Alternatives if a search matches nothing: names that no scenario has, and the candidates' nearest values."""

import re
import sqlite3
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import islice

from ...schemas.errors import closest
from ...schemas.text import counted, enumerated
from ...schemas.vocabulary import CIRCUMSTANCES, FEATURES, MANOEUVRES, ORIGINS, ROAD_NET_KEYS, TAGS
from ..maps import names_elsewhere, place_keys
from .bm25 import words_of
from .constraints import (
    ARTIFICIAL,
    CIRCUMSTANCE,
    CIRCUMSTANCE_WORDS,
    MEASURE_COLUMNS,
    PARTICIPANTS,
    Constraint,
    has_place,
    is_place,
    known_places,
    obstacle_type_of,
)
from .entry_sets import EntrySet, column_of
from .funnel import EmptiedBy, Funnel
from .tables import NEVER_S

SHOWN = 8
"""The most values in a note (chosen)."""
_KINDS = {
    "tag": ("tags", TAGS),
    "feature": ("features", FEATURES),
    CIRCUMSTANCE: (CIRCUMSTANCE_WORDS, CIRCUMSTANCES),
    "sign@ego": ("signs on the ego's lane", ROAD_NET_KEYS),
    "sign@map": ("signs on the map", ROAD_NET_KEYS),
}
_KIND_NAMES = {
    "tag": "a tag",
    "feature": "a feature",
    CIRCUMSTANCE: "weather or time of day",
    "obstacle": "an obstacle",
    "sign@ego": "a sign on the ego's lane",
    "sign@map": "a sign on the map",
}


def names_without_scenario(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """Return a sentence for every valid name that a condition requires and no scenario of the catalogue has."""
    sentences = []
    for constraint in constraints:
        if constraint.negated:
            continue
        for kind, word in constraint.words:
            if _occurs_in_catalogue(connection, kind, word):
                continue
            sentences.append(f"No scenario in this catalogue has '{word}' as {_KIND_NAMES[kind]}.")
    return sentences


def notes_on_names(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """Return a sentence for every tag that other scenarios have as a feature, or feature that others have as a tag."""
    sentences = []
    for constraint in constraints:
        if constraint.note:
            sentences.append(constraint.note)
        if constraint.subject not in ("tag", "feature"):
            continue
        for kind, word in constraint.words:
            if word in TAGS and word in FEATURES:
                tagged, computed = (_count_scenarios(connection, each, word) for each in ("tag", "feature"))
                other = "features" if kind == "tag" else "tags"
                if (computed if kind == "tag" else tagged) > 0 and tagged != computed:
                    counts = (tagged, computed) if kind == "tag" else (computed, tagged)
                    found = f"'{word}' is a {kind} of {counted(counts[0], 'scenario')} (searched)"
                    sentences.append(f"{found} and in the {other} of {counts[1]}.")
    return sentences


def not_computed(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """Return a sentence if manoeuvres are required but were not computed for some scenarios stored earlier."""
    requested = {
        word.partition(":")[0] for constraint in constraints for kind, word in constraint.words if kind == "feature"
    }
    unknown = _count_scenarios(connection, "not computed", "manoeuvres")
    if not unknown or not requested & _MANOEUVRES:
        return []
    stored = f"Manoeuvres are unknown for {counted(unknown, 'scenario')} stored by an earlier version"
    return [f"{stored}; import their files into a new workspace to compute them."]


_MANOEUVRES = {*MANOEUVRES, "unprotected_left", "ego_turns_back"}


@dataclass(frozen=True)
class TextWords:
    """Where a text's words occur: sentences about the ``found`` words, and the words that occur ``nowhere``.

    ``alone``: the text has words, and all of them are in ``nowhere``.
    """

    found: tuple[str, ...]
    nowhere: tuple[str, ...]
    alone: bool


def look_up_words(connection: sqlite3.Connection, text: str, constraints: Sequence[Constraint]) -> TextWords:
    """Look up a text's words among tags, features, obstacles and signs, and then in places and descriptions."""
    names = set(words_of(" ".join(re.findall(r"\b[A-Z]{2}\b", text))))  # such as US
    words = [
        word for word in dict.fromkeys(words_of(text)) if (len(word) > 2 or word in names) and word not in _STOP_WORDS
    ]
    known = {name for constraint in constraints for _, name in constraint.words}
    found, nowhere = dict[str, None](), []
    for word in words[:_WORDS_LOOKED_UP]:
        name, places = _places_of(connection, word)
        if name and name not in known:
            called = f"'{word}'" + (f" (read as {name})" if name != word else "")
            found[f"{called} in {', '.join(places) or 'no scenario'}"] = None
        elif not name and not _occurs(connection, word):
            nowhere.append(word)
    looked = words[:_WORDS_LOOKED_UP]
    return TextWords(tuple(found)[:_WORDS_REPORTED], tuple(nowhere), bool(looked) and len(nowhere) == len(looked))


_WORDS_LOOKED_UP, _WORDS_REPORTED = 12, 3
"""The most words of a text that are looked up, and that are reported as found (chosen)."""
_STOP_WORDS = frozenset(
    words_of(
        "and for with without near any all some show find give get want need please scenario scenarios scene "
        "scenes case cases where which that there has have are from into than more less most least about only one "
        "two three ego vehicle vehicles traffic the der die das und mit ein eine für ohne bei les des une avec "
        "sans para con sin los las "
    )
)
"""Words of requests that do not describe a scenario."""
_VOCABULARIES = (("tag", TAGS), ("feature", FEATURES), ("sign@map", ROAD_NET_KEYS))


def _places_of(connection: sqlite3.Connection, word: str) -> tuple[str, list[str]]:
    """Return the vocabulary name that a word means, or '', and how many scenarios have it, by kind."""
    carried: list[str] = []
    name = ""
    for spelling in (word, word.removesuffix("s")):
        for kind, vocabulary in _VOCABULARIES:
            if spelling in vocabulary:
                name = spelling
                if count := _count_scenarios(connection, kind, spelling):
                    carried.append(_as_kind(count, kind.replace("sign@map", "sign")))
        if count := _count_scenarios(connection, CIRCUMSTANCE, spelling):
            name = spelling
            carried.append(_as_kind(count, CIRCUMSTANCE))
        if name:
            break
    obstacle = obstacle_type_of(word)
    if obstacle is not None:
        name = name or obstacle
        if count := _count_scenarios_with_obstacle(connection, obstacle):
            carried.append(_as_kind(count, "obstacle"))
    return name, carried


def _as_kind(count: int, kind: str) -> str:
    return f"{counted(count, 'scenario')} ({kind})"


def _occurs(connection: sqlite3.Connection, word: str) -> bool:
    """Return whether a word, or a word with the same beginning, occurs in a place or description."""
    key = word[:_LETTERS] if len(word) > _LETTERS else word
    query = "SELECT 1 FROM catalog_scenarios WHERE instr(lower(description), ?) OR instr(lower(place), ?) LIMIT 1"
    if connection.execute(query, (key, key)).fetchone() is not None:
        return True
    return has_place(connection, tuple(place_keys(word))) or has_place(connection, tuple(names_elsewhere(word)))


_LETTERS = 5
"""Words with the same beginning count as one (chosen; as in the conditions)."""


def emptied_note(connection: sqlite3.Connection, funnel: Funnel, reason: EmptiedBy) -> str:
    """Return a note on the conditions that left no candidate, and on the values that the candidates have instead."""
    entering = funnel.entering()
    names = enumerated([constraint.label for constraint in reason.constraints])
    if reason.together:
        return f"each of {names} holds for some of the {len(entering):,} candidates, but no candidate meets all"
    alternatives = [_alternatives(connection, constraint, funnel, entering) for constraint in reason.constraints]
    existing = "; ".join(values for values in alternatives if values)
    return f"0 of {len(entering):,} candidates match {names}" + (f"; available {existing}" if existing else "")


def _alternatives(connection: sqlite3.Connection, constraint: Constraint, funnel: Funnel, entering: EntrySet) -> str:
    """Return the values that candidates have for a condition, or an empty string if they would not help."""
    if constraint.stage == "location":
        return _places(connection, constraint, funnel.within)
    if constraint.stage == "obstacles" and constraint.words:
        return _counts(connection, constraint, funnel, entering)
    if constraint.subject == "origin":
        query = "SELECT number FROM catalog_words WHERE kind = 'origin' AND word = ?"
        return _listed("origins", [one for one in ORIGINS if funnel.holding(query, (one,)) & entering], 0)
    if constraint.words:
        return _words(constraint, funnel, entering)
    if constraint.subject == "speed_limit":
        return _limits(connection, constraint, entering)
    what, column_name = _column(constraint)
    column = funnel.postings.column(connection, funnel.entries, column_name)
    present = (column[place] for place in entering.places())
    return _nearest(what, constraint, {round(value, 1) for value in present if value < NEVER_S})


_UNITS = {"ttc": "s", "horizon": "s", "density": "vehicles/km"}
"""The units of the measures."""


def _column(constraint: Constraint) -> tuple[str, str]:
    """Return the subject of a condition on a number, in words, and its column."""
    if constraint.stage == "velocity":
        return "initial speeds in m/s", "speed_mps"
    if constraint.stage == "road_net":
        return "lanes", "lanes"
    if constraint.subject == PARTICIPANTS:
        return f"numbers of {PARTICIPANTS}", "size"
    return f"{constraint.subject} in {_UNITS[constraint.subject]}", MEASURE_COLUMNS[constraint.subject]


def _counts(connection: sqlite3.Connection, constraint: Constraint, funnel: Funnel, entering: EntrySet) -> str:
    """Return the counts of an obstacle type that occur among the candidates."""
    name, values, without = constraint.words[0][1], set[int](), entering
    for count in column_of(connection, "SELECT DISTINCT count FROM catalog_counts WHERE obstacle = ?", (name,)):
        query = "SELECT number FROM catalog_counts WHERE obstacle = ? AND count = ?"
        matching = funnel.holding(query, (name, count)) & entering
        without -= matching
        values |= {count} if matching else set()
    return _nearest(f"{name} counts", constraint, values | ({0} if without else set()))


def _places(connection: sqlite3.Connection, constraint: Constraint, within: EntrySet | None) -> str:
    if constraint.negated:
        return ""
    known, wanted = known_places(connection, within), constraint.label.partition(" ")[2]
    if constraint.subject == "country":
        countries = [country for country in known.countries if country != ARTIFICIAL]
        return _listed("countries", closest(wanted, countries, SHOWN), len(countries))
    places = [place for place, country in known.places if is_place(country, place)]
    return _listed("places", closest(wanted, places, SHOWN), len(places))


def _limits(connection: sqlite3.Connection, constraint: Constraint, entering: EntrySet) -> str:
    scope = "map" if constraint.everywhere else "ego"
    rows = connection.execute("SELECT number, kmh FROM catalog_limits WHERE scope = ?", (scope,))
    return _nearest("limits in km/h", constraint, {row[1] for row in rows if row[0] in entering})


def _words(constraint: Constraint, funnel: Funnel, entering: EntrySet) -> str:
    """Return similar names of the same kind that some candidate has, or an empty string for an excluded name."""
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
    """Return the values nearest to the requested interval, and the range of all values if there are more."""
    low, high = (float(value) for value in constraint.values[-2:])
    ordered = sorted(values, key=lambda value: (max(low - value, value - high, 0.0), value))
    listed = _listed(what, [f"{value:g}" for value in ordered[:SHOWN]], len(ordered))
    return f"{listed} ({min(values):g} to {max(values):g})" if len(ordered) > SHOWN else listed


def _occurs_in_catalogue(connection: sqlite3.Connection, kind: str, word: str) -> bool:
    if kind == "obstacle":
        row = connection.execute("SELECT 1 FROM catalog_counts WHERE obstacle = ? LIMIT 1", (word,)).fetchone()
    else:
        query = "SELECT 1 FROM catalog_words WHERE kind = ? AND word = ? LIMIT 1"
        row = connection.execute(query, (kind, word)).fetchone()
    return row is not None


def _count_scenarios_with_obstacle(connection: sqlite3.Connection, obstacle: str) -> int:
    query = "SELECT count(*) FROM catalog_counts WHERE obstacle = ? AND count > 0"
    return int(connection.execute(query, (obstacle,)).fetchone()[0])


def _count_scenarios(connection: sqlite3.Connection, kind: str, word: str) -> int:
    query = "SELECT count(*) FROM catalog_words WHERE kind = ? AND word = ?"
    return int(connection.execute(query, (kind, word)).fetchone()[0])


def _listed(what: str, nearest: Sequence[str], count: int) -> str:
    return f"{what}: {', '.join(nearest)}{' …' if count > len(nearest) else ''}" if nearest else ""
