"""Turn the arguments of a search into conditions on the catalogue, each with its stage, label and query.

Semantics: Methodology, Scenario Selection (five slots, velocity ± 2 m/s for a single value). Counts are exact; a posted
limit matches within 0.5 km/h. Features computed from the geometry belong to the stage of the tags. Words of the
vocabulary are accepted in upper or lower case, in the plural and as everyday names; the error for any other word lists
the nearest ones.
"""

import re
import sqlite3
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from ...schemas.catalog import FindScenariosArguments, Stage
from ...schemas.errors import Faults, InvalidRequest, UnknownName, calling, closest, instead, misspelt, with_values
from ...schemas.grammar import Condition, Interval, as_exclusion, parse_condition, parse_interval, scope_first
from ...schemas.text import one_line, quoted
from ...schemas.vocabulary import CIRCUMSTANCES, FEATURES, MANOEUVRES, MEASURES, OBSTACLE_TYPES, ROAD_NET_KEYS, TAGS
from ..maps import countries_spelt_like, country_code, country_name, names_elsewhere, place_keys, settlements_called
from ..vehicles import vehicle_class_of
from .bm25 import words_of
from .entry_sets import column_of

NameOf = Callable[[str], str]
PARTICIPANTS = "participants"
"""The name for obstacles of all types together."""
EITHER = "tag or feature"
"""The subject of a condition on a name that may be a tag or a computed feature."""
CIRCUMSTANCE, CIRCUMSTANCE_WORDS = "circumstance", "weather and times of day"
"""The subject of a condition on weather or time of day, and the plural name for these words."""
_CIRCUMSTANCE_WORDS = {"mist": "fog", "foggy": "fog", "snowy": "snow", "snowfall": "snow", "peakhour": "rush_hour"}
_RAINS = "light_rain|heavy_rain"
_TOTALS = ("participants", "participant", "roadusers", "vehicles", "obstacles", "total")
_TYPE_OF_CLASS = {
    "trailer": "truck",
    "delivery": "truck",
    "coach": "bus",
    "emergency": "priorityVehicle",
    "moped": "motorcycle",
}
"""CommonRoad's obstacle type for classes that it has no type for."""
_MEASURE_WORDS = {"timetocollision": "ttc", "duration": "horizon", "trafficdensity": "density"}
_ROAD_NET_WORDS = {"signal": "traffic_light", "trafficsignal": "traffic_light", "stopsign": "stop", "giveway": "yield"}
SPEED_TOLERANCE_MPS = 2.0
"""The tolerance to either side of a single speed (the paper)."""
LIMIT_TOLERANCE_KMH = 0.5
"""The tolerance to either side of a posted limit, which files give in m/s (chosen)."""
MEASURE_COLUMNS = {"ttc": "ttc_s", "horizon": "horizon_s", "density": "density_per_km"}
"""The column of ``catalog_scenarios`` for each measure; ``ttc_s`` is the time to conflict."""
_ROUNDING = 1e-6
"""Added to either side of an interval, so that unit conversion does not exclude its ends."""
_STEM_LETTERS = 5
"""Words with the same beginning count as one."""
_FAR = 1e12
"""Represents an open end of an interval."""


@dataclass(frozen=True)
class Constraint:
    """One condition of a search.

    ``subject``: the vocabulary name that the condition applies to, ``country`` or ``city``; ``everywhere``: whether it
    applies to the whole map. ``query`` selects the numbers of the scenarios that satisfy the condition (if ``negated``,
    of those that do not). ``words``: names that perhaps no scenario has, as ``(kind, word)``, so that the answer can
    report them. ``note``: how a word from outside its argument's vocabulary was interpreted; otherwise empty.
    """

    stage: Stage
    subject: str
    label: str
    query: str
    values: tuple[str | float, ...]
    negated: bool = False
    words: tuple[tuple[str, str], ...] = ()
    everywhere: bool = False
    note: str = ""

    def is_mentioned(self, text: str) -> bool:
        """Return whether the text contains all words of one of its names, or all numbers of a speed."""
        if self.stage == "velocity":
            numbers = re.findall(r"\d+", self.label)
            return bool(numbers) and set(numbers) <= set(re.findall(r"\d+", text))
        asked = _stems(text)
        names = [word for _, word in self.words] or [_parse_name(self.label)]
        return any(_stems(name) <= asked for name in names)

    def found_among(self, connection: sqlite3.Connection, among: Sequence[int]) -> Iterator[int]:
        """Yield the given numbers (a few thousand at most) that the query also selects."""
        holes = ", ".join("?" * len(among))
        return column_of(connection, f"{self.query} AND number IN ({holes})", (*self.values, *among))


def constraints_of(
    arguments: FindScenariosArguments, location: Sequence[Constraint], *, with_circumstances: bool = False
) -> tuple[Constraint, ...]:
    """Return all conditions in the paper's order of stages; ``location`` comes from :func:`location_constraints`.

    Weather and times of day belong to the vocabulary if ``with_circumstances``, that is, if the catalogue contains any.

    Raises:
        UnknownName: tags, features, keys or obstacles are outside the vocabulary; all wrong names are reported
            together.
        InvalidRequest: a condition is malformed, or a speed has no unit; all faults are reported together.
    """
    makers: list[tuple[Callable[[str], Constraint], str]] = [
        *((partial(_resolve, "tags", with_circumstances), text) for text in arguments.tags),
        *((partial(_resolve, "features", with_circumstances), text) for text in arguments.features),
        *((partial(_any_of, "road_net", with_circumstances), text) for text in arguments.road_net),
        *((partial(_any_of, "obstacles", with_circumstances), text) for text in arguments.obstacles),
    ]
    constraints, faults = list(location), Faults()
    for make, text in makers:
        with faults.collecting():
            constraints.append(make(text))
    if arguments.origin is not None:
        query = "SELECT number FROM catalog_words WHERE kind = 'origin' AND word = ?"
        constraints.append(Constraint("tags", "origin", f"origin {arguments.origin}", query, (arguments.origin,)))
    with faults.collecting():
        if arguments.ego_speed is not None:
            constraints.append(_ego_speed(arguments.ego_speed))
    faults.raise_all()
    return tuple(constraints)


def _any_of(argument: str, with_circumstances: bool, text: str) -> Constraint:
    """Return a condition that holds if any alternative between ``|`` holds; with a leading ``!``, if all fail.

    Raises:
        UnknownName: a word is in no vocabulary.
        InvalidRequest: a condition is malformed, or is negated again after a leading ``!``.
    """
    parts = text.strip().removeprefix("!").split("|")
    if len(parts) == 1:
        return _resolve(argument, with_circumstances, text)
    negated = text.strip().startswith("!")
    if negated and any(part.strip().startswith("!") for part in parts):
        words = "|".join(part.strip().removeprefix("!") for part in parts)
        raise InvalidRequest(
            f"{quoted(text)} negates twice: a leading ! applies to all conditions between |",
            valid=[f"!{words}"],
            next_step="write one ! before all conditions, or one entry for each",
            given=text,
        )
    read = [_resolve(argument, with_circumstances, part.strip()) for part in parts]
    # A negated condition's query selects the scenarios that do not satisfy it.
    every = "SELECT number FROM catalog_scenarios"
    queries = [f"{every} WHERE number NOT IN ({one.query})" if one.negated else one.query for one in read]
    return Constraint(
        read[0].stage,
        read[0].subject,
        ("!" if negated else "") + "|".join(one.label for one in read),
        f"SELECT number FROM ({' UNION '.join(queries)}) WHERE 1",  # noqa: S608 - queries of ours
        tuple(value for one in read for value in one.values),
        negated,
        tuple(word for one in read for word in one.words),
        everywhere=any(one.everywhere for one in read),
        note=" ".join(one.note for one in read if one.note),
    )


def _resolve(argument: str, with_circumstances: bool, text: str) -> Constraint:
    """Return an argument's condition; a word from another argument's vocabulary is accepted and noted.

    Raises:
        UnknownName: a word is in no vocabulary.
    """
    try:
        return _MAKERS[argument](text)
    except UnknownName:
        for other in _OTHERS[argument]:
            if other == CIRCUMSTANCE_WORDS and not with_circumstances:
                continue
            try:
                found = _MAKERS[other](text)
            except (UnknownName, InvalidRequest):
                continue
            among = other.replace("|", " and ")
            note = f"'{one_line(_parse_name(text))}' is not {_WORD_NAMES[argument]}; it was looked up among {among}."
            return replace(found, note=f"{note} {found.note}".strip())
        raise


def _tag(text: str) -> Constraint:
    return _word_constraint("tag", text, _tag_name)


def _tag_or_feature(text: str) -> Constraint:
    """Return the condition for a name that is both a tag and a computed feature: either of them satisfies it."""
    tag, feature = _tag(text), _word_constraint("feature", text, _feature_name)
    names = tag.values[1:]
    holes = ", ".join("?" * len(names))
    query = f"SELECT DISTINCT number FROM catalog_words WHERE kind IN ('tag', 'feature') AND word IN ({holes})"  # noqa: S608 - only ? marks
    return replace(
        tag,
        subject=EITHER,
        label=f"tag or feature {tag.label}",
        query=query,
        values=names,
        words=(*tag.words, *feature.words),
    )


def _circumstance(text: str) -> Constraint:
    """Return the condition on weather or time of day; ``rain`` means light and heavy rain."""
    negated, body = text.strip().startswith("!"), text.strip().removeprefix("!")
    parts = [_RAINS if _key(part) in ("rain", "rainy") else part for part in body.split("|")]
    return _word_constraint(CIRCUMSTANCE, ("!" if negated else "") + "|".join(parts), _circumstance_name)


def _word_constraint(kind: str, text: str, known: NameOf) -> Constraint:
    body = text.strip()
    negated = body.startswith("!")
    names = [known(part) for part in body.removeprefix("!").split("|")]
    label = ("!" if negated else "") + "|".join(names)
    holes = ", ".join("?" * len(names))
    return Constraint(
        "tags",
        kind,
        f"{kind} {label}" if kind == "feature" else label,
        f"SELECT DISTINCT number FROM catalog_words WHERE kind = ? AND word IN ({holes})",  # noqa: S608 - only ? marks
        (kind, *names),
        negated,
        tuple((kind, name) for name in names),
    )


def _feature(text: str) -> Constraint:
    """Return the condition on a feature, or on a measure compared with a number."""
    key = _key(_parse_name(text))
    measure = _MEASURE_WORDS.get(key, key)
    if measure not in MEASURES:
        return _word_constraint("feature", text, _feature_name)
    condition = parse_condition(text, "" if measure == "density" else "s", example=measure)
    _scope(condition, ("ego",))
    if not any(mark in text for mark in "<>="):
        raise InvalidRequest(f"'{text}' gives no value for {measure}", valid=["ttc<=3s", "horizon>=10s", "density>=10"])
    low, high = _bounds(condition.interval, 0.0)
    query = f"SELECT number FROM catalog_scenarios WHERE {MEASURE_COLUMNS[measure]} BETWEEN ? AND ?"  # noqa: S608 - fixed names
    return Constraint("tags", measure, one_line(text), query, (low, high), condition.negated)


def _road_net(text: str) -> Constraint:
    text = scope_first(text)
    name = _name(_parse_name(text), ROAD_NET_KEYS, _ROAD_NET_WORDS, "road_net key")
    if name == "lanes":
        return _lanes(text)
    if name == "speed_limit" and any(mark in text for mark in "<>="):
        return _limit(text)
    condition = parse_condition(text, example=name)
    scope = _scope(condition, ("ego", "map"))
    if condition.interval != Interval(1.0, None):
        raise InvalidRequest(
            f"'{text}' compares {name} with a number, but it is only present or absent",
            valid=[name, f"!{name}", f"{name}@map", f"!{name}@map"],
        )
    return Constraint(
        "road_net",
        name,
        f"{'!' if condition.negated else ''}{name}{'@map' if scope == 'map' else ''}",
        "SELECT number FROM catalog_words WHERE kind = ? AND word = ?",
        (f"sign@{scope}", name),
        condition.negated,
        ((f"sign@{scope}", name),),
        scope == "map",
    )


def _lanes(text: str) -> Constraint:
    condition = parse_condition(text, whole=True, example="lanes")
    _scope(condition, ("ego",))
    query = "SELECT number FROM catalog_scenarios WHERE lanes BETWEEN ? AND ?"
    return Constraint("road_net", "lanes", one_line(text), query, _bounds(condition.interval, 0.0), condition.negated)


def _limit(text: str) -> Constraint:
    _refuse_without_unit(text, text.lstrip("!").partition("@")[0], ["speed_limit=50km/h", "speed_limit<=30mph"])
    condition = parse_condition(text, "m/s", example="speed_limit")
    scope = _scope(condition, ("ego", "map"))
    low, high = _bounds(condition.interval, LIMIT_TOLERANCE_KMH, 3.6)
    query = "SELECT DISTINCT number FROM catalog_limits WHERE scope = ? AND kmh BETWEEN ? AND ?"
    values, everywhere = (scope, low, high), scope == "map"
    negated = condition.negated
    return Constraint("road_net", "speed_limit", one_line(text), query, values, negated, everywhere=everywhere)


def obstacle_constraint(text: str) -> Constraint:
    """Return the condition on the number of obstacles of one type, or of all types together."""
    condition = parse_condition(as_exclusion(text), whole=True)
    if _key(condition.name) in _TOTALS:
        return _total(text, condition)
    name = _obstacle_name(condition.name)
    _scope(condition, ("map",))
    low, high = _bounds(condition.interval, 0.0)
    label = one_line(text).replace(condition.name, name, 1)
    within = "SELECT number FROM catalog_counts WHERE obstacle = ? AND count BETWEEN ? AND ?"
    outside = "SELECT number FROM catalog_counts WHERE obstacle = ? AND count NOT BETWEEN ? AND ?"
    holds_for_none = low <= 0 <= high
    query = outside if holds_for_none else within
    negated = condition.negated != holds_for_none
    alike = _key(condition.name) in (key := _key(name), f"{key}s", f"{key}es")
    note = "" if alike else f"'{one_line(condition.name)}' is read as {name}."
    return Constraint("obstacles", name, label, query, (name, low, high), negated, (("obstacle", name),), note=note)


_MAKERS: dict[str, Callable[[str], Constraint]] = {
    "tags": _tag,
    "features": _feature,
    "road_net": _road_net,
    "obstacles": obstacle_constraint,
    "tags|features": _tag_or_feature,
    CIRCUMSTANCE_WORDS: _circumstance,
}
_WORD_NAMES = {"tags": "a tag", "features": "a feature", "road_net": "a road_net key", "obstacles": "an obstacle type"}
"""The name for one word of an argument, with its article."""
_OTHERS = {
    "tags": ("features", CIRCUMSTANCE_WORDS, "obstacles", "road_net"),
    "features": ("tags", CIRCUMSTANCE_WORDS, "obstacles", "road_net"),
    "road_net": ("tags|features", "features", "tags", CIRCUMSTANCE_WORDS, "obstacles"),
    "obstacles": ("tags|features", "features", "tags", CIRCUMSTANCE_WORDS, "road_net"),
}
"""The vocabularies to search, in this order, for a word that is not in its argument's own."""


def _total(text: str, condition: Condition) -> Constraint:
    """Return the condition on the number of obstacles of all types together, excluding the ego."""
    _scope(condition, ("map",))
    query = "SELECT number FROM catalog_scenarios WHERE size BETWEEN ? AND ?"
    bounds = _bounds(condition.interval, 0.0)
    return Constraint("obstacles", PARTICIPANTS, one_line(text), query, bounds, condition.negated)


def _ego_speed(text: str) -> Constraint:
    _refuse_without_unit(text, "ego_speed", ["50km/h", "10..15m/s", ">=20mph"])
    try:
        interval = parse_interval(_operators(text), "m/s")
    except InvalidRequest as error:
        raise error.also(with_values(ego_speed=None)) from error.__cause__
    tolerance = SPEED_TOLERANCE_MPS if interval.exact else 0.0
    query = "SELECT number FROM catalog_scenarios WHERE speed_mps BETWEEN ? AND ?"
    return Constraint("velocity", "ego_speed", f"ego_speed {one_line(text)}", query, _bounds(interval, tolerance))


def _parse_name(text: str) -> str:
    """Return the name that a condition begins with."""
    body = text.strip().lstrip("!").strip()
    ends = [body.index(mark) for mark in "@<>= " if mark in body]
    return body[: min(ends)] if ends else body


def _operators(text: str) -> str:
    body = text.strip()
    return body[0] + "=" + body[1:] if body[:1] in "<>" and body[1:2] != "=" else body


def _refuse_without_unit(text: str, name: str, valid: list[str]) -> None:
    if not any(letter.isalpha() for letter in text.rpartition("=")[2].lstrip("<>").replace("speed_limit", "")):
        raise InvalidRequest(
            f"'{text}' gives {name} without a unit", valid=valid, next_step="add km/h, m/s or mph", given=text
        )


def _scope(condition: Condition, allowed: tuple[str, ...]) -> str:
    scope = condition.scope or allowed[0]
    if scope not in allowed:
        raise InvalidRequest(
            f"'{condition.name}@{scope}' has an unknown scope", valid=[f"{condition.name}@{word}" for word in allowed]
        )
    return scope


def _bounds(interval: Interval, tolerance: float, factor: float = 1.0) -> tuple[float, float]:
    """Return an interval's ends in the column's unit (``factor`` times the interval's), widened on both sides."""
    slack = tolerance + _ROUNDING
    low = -_FAR if interval.low is None else interval.low * factor - slack
    return low, _FAR if interval.high is None else interval.high * factor + slack


def has_circumstances(connection: sqlite3.Connection) -> bool:
    """Return whether any entry of the catalogue states its weather or time of day."""
    query = "SELECT 1 FROM catalog_words WHERE kind = ? LIMIT 1"
    return connection.execute(query, (CIRCUMSTANCE,)).fetchone() is not None


ARTIFICIAL = "ZAM"
"""CommonRoad's country code for networks that are not of a real place."""
_NO_PLACES = frozenset({"test", "unittest", "example", "sample", "scenario", "unknown", "none", "map", "default"})
"""Place names in the ids of files that were created for tests (chosen)."""


def is_place(country: str, place: str) -> bool:
    """Return whether a scenario's place is real: it is in a country, and is neither a number nor a test's name."""
    letters = any(letter.isalpha() for letter in place)
    return country != ARTIFICIAL and letters and place.casefold().rstrip("0123456789") not in _NO_PLACES


@dataclass(frozen=True)
class _Places:
    """The catalogue's countries, and its places with their countries, alphabetically."""

    countries: tuple[str, ...]
    places: tuple[tuple[str, str], ...]


def known_places(connection: sqlite3.Connection, among: Container[int] | None = None) -> _Places:
    """Return all countries and places of the catalogue, or of the given entries."""
    if among is None:
        rows = connection.execute("SELECT DISTINCT place, country FROM catalog_scenarios").fetchall()
    else:
        every = connection.execute("SELECT place, country, number FROM catalog_scenarios")
        rows = [row[:2] for row in every if row[2] in among]
    places = tuple(sorted({(str(row[0]), str(row[1])) for row in rows}))
    return _Places(tuple(sorted({country for _, country in places})), places)


def location_constraints(connection: sqlite3.Connection, country: str | None, city: str | None) -> list[Constraint]:
    """Return conditions for the country and the city. The catalogue need not contain this country or city.

    As for other conditions, ``|`` separates alternatives, and a leading ``!`` excludes all of them.

    Raises:
        UnknownName: the country is neither an ISO alpha-3 code nor a known name, or the city is probably a
            misspelt place in the catalogue.
    """
    constraints = []
    if country is not None:
        negated, parts = _alternatives_of(country)
        codes = tuple(dict.fromkeys(_country_code(connection, part) for part in parts))
        holes = ", ".join("?" * len(codes))
        query = f"SELECT number FROM catalog_scenarios WHERE country IN ({holes})"  # noqa: S608 - only ? marks
        label = f"country {'!' * negated}{'|'.join(codes)}"
        constraints.append(Constraint("location", "country", label, query, codes, negated))
    if city is not None:
        negated, parts = _alternatives_of(city)
        keys = tuple(sorted({key for part in parts for key in _keys_of_place(connection, part)}))
        holes = ", ".join("?" * len(keys))
        query = f"SELECT DISTINCT number FROM catalog_words WHERE kind = 'place' AND word IN ({holes})"  # noqa: S608 - only ? marks
        constraints.append(Constraint("location", "city", f"city {one_line(city)}", query, keys, negated))
    return constraints


def _alternatives_of(text: str) -> tuple[bool, list[str]]:
    """Return whether a leading ``!`` excludes the places of a text, and the places, which ``|`` separates.

    Raises:
        InvalidRequest: a place after the first is excluded on its own.
    """
    body = text.strip()
    parts = [part.strip() for part in body.removeprefix("!").split("|")]
    if any(part.startswith("!") for part in parts):
        words = "|".join(part.removeprefix("!").strip() for part in parts)
        raise InvalidRequest(
            f"{quoted(text)} has a ! after its beginning, but only a leading ! excludes, and it excludes all places",
            valid=[f"!{words}", words],
            next_step="write one ! before all places, or leave it out",
            given=text,
        )
    return body.startswith("!"), parts


def _country_code(connection: sqlite3.Connection, country: str) -> str:
    code = country_code(country)
    if code is None:
        known = known_places(connection).countries
        near, alike = closest(country, known), countries_spelt_like(country)
        there = [one for one in alike if one in known]
        elsewhere = f"; no scenario is in {country_name(alike[0])} either" if alike and not there else ""
        raise UnknownName(
            f"'{country}' is not a known country{elsewhere}",
            valid=dict.fromkeys([*there, *near]),
            next_step="give the ISO 3166-1 alpha-3 code, or ZAM for artificial networks",
            remedies=[
                *(instead(country, one, "country") for one in there),
                *misspelt(country, near, "country"),
                calling("describe_catalog", facet="places"),
            ],
        )
    return code


def _keys_of_place(connection: sqlite3.Connection, city: str) -> tuple[str, ...]:
    """Return the keys of a city's name as spelled or, if these are not in the catalogue, in other languages."""
    own = tuple(sorted(place_keys(city)))
    if has_place(connection, own):
        return own
    elsewhere = tuple(sorted(names_elsewhere(city)))
    if not has_place(connection, elsewhere) and not settlements_called(city):
        near = closest(city, sorted({place for place, _ in known_places(connection).places}))
        if meant := misspelt(city, near, "city"):
            raise UnknownName(
                f"no scenario is in '{one_line(city)}', and no settlement of 5,000 inhabitants or more has this name",
                valid=near,
                next_step="choose one of these places, or leave the place out",
                remedies=meant,
            )
    return elsewhere


def has_place(connection: sqlite3.Connection, keys: Sequence[str]) -> bool:
    """Return whether the catalogue has a scenario in a place with one of the keys."""
    holes = ", ".join("?" * len(keys))
    query = f"SELECT 1 FROM catalog_words WHERE kind = 'place' AND word IN ({holes}) LIMIT 1"  # noqa: S608 - only ? marks
    return connection.execute(query, tuple(keys)).fetchone() is not None


def obstacle_type_of(word: str) -> str | None:
    """Return the obstacle type that a word means, or None."""
    try:
        return _obstacle_name(word)
    except UnknownName:
        return None


def _obstacle_name(word: str) -> str:
    found = vehicle_class_of(word)
    everyday = {_key(word): _TYPE_OF_CLASS.get(found, found)} if found else {}
    return _name(word, OBSTACLE_TYPES, everyday, "obstacle type")


def _tag_name(word: str) -> str:
    return _name(word, TAGS, {}, "tag", "describe it in text, or use features for the geometry")


def _circumstance_name(word: str) -> str:
    return _name(word, CIRCUMSTANCES, _CIRCUMSTANCE_WORDS, CIRCUMSTANCE, "describe it in text")


def _feature_name(word: str) -> str:
    """Return the name of a feature; a manoeuvre's name may include a road user's type: ``cut_in:truck``."""
    name, mark, kind = word.partition(":")
    found = _name(name, [*FEATURES, *MEASURES], _FEATURE_WORDS, "feature")
    if not mark:
        return found
    if found not in MANOEUVRES:
        valid = [f"{one}:{kind.strip()}" for one in MANOEUVRES]
        raise UnknownName(f"'{word.strip()}': {found} takes no type of road user", valid=valid)
    return f"{found}:{_obstacle_name(kind)}"


_FEATURE_WORDS = {"uturn": "ego_turns_back", "leadbrakes": "lead_brakes_hard", "hardbraking": "lead_brakes_hard"}


def feature_constraint(name: str) -> Constraint:
    """Return the condition on a feature, or a manoeuvre with the type of its road user."""
    return _word_constraint("feature", name, _feature_name)


_FACETS = {"tag": "tags", "feature": "features", "road_net key": "road_net", "obstacle type": "obstacles"}
"""The facet of describe_catalog that lists the names of each kind."""
_MOST_SUGGESTIONS = UnknownName.tried_values


def _name(word: str, known: Iterable[str], everyday: dict[str, str], what: str, next_step: str = "") -> str:
    """Return the vocabulary's name for a word, or raise an UnknownName with the nearest names."""
    names = list(known)
    by_key = {**everyday, **{_key(name): name for name in names}}
    key = _key(word)
    for spelling in (key, key.removesuffix("s")):
        if spelling in by_key:
            return by_key[spelling]
    near = closest(word, names)
    listing = [calling("describe_catalog", facet=facet) for name, facet in _FACETS.items() if name == what]
    raise UnknownName(
        f"'{word.strip()}' is not {'an' if what[0] in 'aeiou' else 'a'} {what}",
        valid=near,
        next_step=next_step,
        remedies=[*misspelt(word.strip(), near)[:_MOST_SUGGESTIONS], *listing],
    )


def _stems(text: str) -> set[str]:
    """Return the stems of all words: "trucks" has the same stem as "truck"."""
    return {word[:_STEM_LETTERS] for word in words_of(text)}


def _key(word: str) -> str:
    return "".join(letter for letter in word.casefold() if letter.isalnum())
