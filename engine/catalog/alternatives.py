"""What exists where a search matches nothing: names that no scenario carries, and the candidates' nearest values."""

import sqlite3
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import islice

from ...schemas.errors import closest
from ...schemas.text import counted
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
"""Values that a note lists, at most (chosen)."""
_KINDS = {
    "tag": ("tags", TAGS),
    "feature": ("features", FEATURES),
    CIRCUMSTANCE: (CIRCUMSTANCE_WORDS, CIRCUMSTANCES),
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
            sentences.append(sentence + ".")
    return sentences


def found_elsewhere(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """A sentence for every name that was asked for as a tag or feature and that other scenarios have as the other."""
    sentences = []
    for constraint in constraints:
        if constraint.note:
            sentences.append(constraint.note)
        if constraint.subject not in ("tag", "feature"):
            continue
        for kind, word in constraint.words:
            if word in TAGS and word in FEATURES:
                tagged, computed = (_carriers(connection, each, word) for each in ("tag", "feature"))
                other = "features" if kind == "tag" else "tags"
                if (computed if kind == "tag" else tagged) > 0 and tagged != computed:
                    counts = (tagged, computed) if kind == "tag" else (computed, tagged)
                    sentences.append(f"'{word}': {kind} of {counts[0]}, as asked; in {other} of {counts[1]}.")
    return sentences


def not_computed(connection: sqlite3.Connection, constraints: Sequence[Constraint]) -> list[str]:
    """A sentence where manoeuvres are asked for and scenarios were stored before those were computed."""
    asked = {
        word.partition(":")[0] for constraint in constraints for kind, word in constraint.words if kind == "feature"
    }
    unknown = _carriers(connection, "not computed", "manoeuvres")
    if not unknown or not asked & _MANOEUVRES:
        return []
    stored = f"Of {counted(unknown, 'scenario')} that an earlier version stored, no manoeuvre is known"
    return [f"{stored}; imported into a new workspace, their files are looked at again."]


_MANOEUVRES = {*MANOEUVRES, "unprotected_left", "ego_turns_back"}


@dataclass(frozen=True)
class TextWords:
    """Where the catalogue holds the words of a text: ``found`` sentences, and the words that stand ``nowhere``.

    ``alone``: the text has words, and none of them stands anywhere.
    """

    found: tuple[str, ...]
    nowhere: tuple[str, ...]
    alone: bool


def words_in(connection: sqlite3.Connection, text: str, asked: Sequence[Constraint]) -> TextWords:
    """Look for the words of a text among tags, features, obstacles and signs, and else in places and descriptions."""
    words = [word for word in dict.fromkeys(words_of(text)) if len(word) > 2 and word not in _SAYING_NOTHING]
    known = {name for constraint in asked for _, name in constraint.words}
    found, nowhere = dict[str, None](), []
    for word in words[:_WORDS_LOOKED_UP]:
        name, places = _places_of(connection, word)
        if name and name not in known:
            called = f"'{word}'" + (f" ({name})" if name != word else "")
            found[f"{called} is {' and '.join(places)}" if places else f"{called} is in no scenario"] = None
        elif not name and not _stands(connection, word):
            nowhere.append(word)
    looked = words[:_WORDS_LOOKED_UP]
    return TextWords(tuple(found)[:_WORDS_TOLD], tuple(nowhere), bool(looked) and len(nowhere) == len(looked))


_WORDS_LOOKED_UP, _WORDS_TOLD = 12, 3
"""Words of a text that are looked up, and of which it is told where they are, at most (chosen)."""
_SAYING_NOTHING = frozenset(
    words_of(
        "and for with without near any all some show find give get want need please scenario scenarios scene "
        "scenes case cases where which that there has have are from into than more less most least about only one "
        "two three ego vehicle vehicles traffic the der die das und mit ein eine für ohne bei les des une avec "
        "sans para con sin los las "
    )
)
"""Words of requests that say nothing of a scenario."""
_VOCABULARIES = (("tag", TAGS), ("feature", FEATURES), ("sign@map", ROAD_NET_KEYS))


def _places_of(connection: sqlite3.Connection, word: str) -> tuple[str, list[str]]:
    """The name of a vocabulary that a word means, and by how many scenarios it is carried as what; '' for no name."""
    carried: list[str] = []
    meant = ""
    for spelling in (word, word.removesuffix("s")):
        for kind, vocabulary in _VOCABULARIES:
            if spelling in vocabulary:
                meant = spelling
                if count := _carriers(connection, kind, spelling):
                    carried.append(f"{kind.replace('sign@map', 'sign')} of {count}")
        if count := _carriers(connection, CIRCUMSTANCE, spelling):
            meant = spelling
            carried.append(f"{CIRCUMSTANCE} of {count}")
        if meant:
            break
    obstacle = obstacle_type_of(word)
    if obstacle is not None:
        meant = meant or obstacle
        if count := _holders(connection, obstacle):
            carried.append(f"obstacle of {count}")
    return meant, carried


def _stands(connection: sqlite3.Connection, word: str) -> bool:
    """Whether a word, or one that begins like it, stands in a place or description."""
    key = word[:_LETTERS] if len(word) > _LETTERS else word
    query = "SELECT 1 FROM catalog_scenarios WHERE instr(lower(description), ?) OR instr(lower(place), ?) LIMIT 1"
    if connection.execute(query, (key, key)).fetchone() is not None:
        return True
    return has_place(connection, tuple(place_keys(word))) or has_place(connection, tuple(names_elsewhere(word)))


_LETTERS = 5
"""Words that begin alike count as one (chosen; as in the conditions)."""


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
    if constraint.subject == "origin":
        query = "SELECT number FROM catalog_words WHERE kind = 'origin' AND word = ?"
        return _listed("origins", [one for one in ORIGINS if funnel.holding(query, (one,)) & entering], 0)
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
        countries = [country for country in known.countries if country != ARTIFICIAL]
        return _listed("countries", closest(wanted, countries, SHOWN), len(countries))
    places = [place for place, country in known.places if is_place(country, place)]
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


def _holders(connection: sqlite3.Connection, obstacle: str) -> int:
    query = "SELECT count(*) FROM catalog_counts WHERE obstacle = ? AND count > 0"
    return int(connection.execute(query, (obstacle,)).fetchone()[0])


def _carriers(connection: sqlite3.Connection, kind: str, word: str) -> int:
    query = "SELECT count(*) FROM catalog_words WHERE kind = ? AND word = ?"
    return int(connection.execute(query, (kind, word)).fetchone()[0])


def _listed(what: str, nearest: Sequence[str], count: int) -> str:
    return f"{what} {', '.join(nearest)}{' …' if count > len(nearest) else ''}" if nearest else ""
