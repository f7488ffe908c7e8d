"""Newly drawn selection requests, with the ids that satisfy them by an independent reading of the files.

Places, tags, obstacles, the ego's speed and lights on the map are read from the XML with lxml. Values computed from the
geometry (features and measures, lanes, signs and limits on the ego's lanelets) come from the stored facts; the bench of
symmetries and tests judge those. No query or parser of the product is involved: conditions are drawn as slots like
those of the corpus, each with a predicate.
"""

import random
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from plannerforge.evals.ground_truth.selection import Request
from plannerforge.schemas.catalog import STAGES
from plannerforge.schemas.scenarios import ScenarioFacts
from plannerforge.schemas.vocabulary import FEATURES, OBSTACLE_TYPES, SIGNS, TAGS

_MPS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
_NEAR_MPS, _NEAR_KMH, _ROUNDING = 2.0, 0.5, 1e-6
"""Tolerance of a single speed and a posted limit to either side, by the rules of the corpus."""
_SLOTS = {"location": 0.35, "tags": 0.45, "features": 0.4, "road_net": 0.35, "obstacles": 0.5, "velocity": 0.35}
"""Frequency of each slot (chosen)."""
_ANCHORED = 0.6
"""Share of the conditions drawn from one scenario, the same for the whole request (chosen)."""
_NOWHERE = ("JPN", "AUS", "NZL")


@dataclass(frozen=True)
class Known:
    """The content of a file; ``facts`` are those that the product stored."""

    scenario_id: str
    country: str
    place: str
    tags: frozenset[str]
    counts: Counter[str]
    speed_mps: float
    lights: int
    facts: ScenarioFacts

    @classmethod
    def of(cls, path: Path, facts: ScenarioFacts) -> "Known":
        """Read a file of either format."""
        root = etree.parse(path).getroot()
        country, _, rest = root.get("benchmarkID", "").removeprefix("C-").partition("_")
        tags = {str(tag.tag) for tag in root.iterfind("scenarioTags/*")} or set(root.get("tags", "").split())
        kinds = [
            element.findtext("type", "").strip()
            for element in root.iterfind("*")
            if element.tag in ("obstacle", "staticObstacle", "dynamicObstacle")
        ]
        speed = root.findtext("planningProblem/initialState/velocity/exact", "nan")
        return cls(
            scenario_id=facts.scenario_id,
            country=country,
            place=rest.partition("-")[0],
            tags=frozenset(tags),
            counts=Counter(kinds),
            speed_mps=float(speed),
            lights=len(root.findall("trafficLight")),
            facts=facts,
        )


@dataclass(frozen=True)
class _Condition:
    """A part of a slot: its key in a request's truth, the stage that applies it, and the files that satisfy it."""

    stage: str
    slot: str
    key: str
    value: Any
    holds: Callable[[Known], bool]


def fresh_requests(known: Sequence[Known], seed: int, count: int) -> list[Request]:
    """Draw requests; the same seed draws the same ones, a larger count adds more."""
    return [
        _request(known, random.Random(f"{seed} {number}"), f"fresh-{seed}-{number}")  # noqa: S311 - no secret
        for number in range(count)
    ]


def _request(known: Sequence[Known], choice: random.Random, name: str) -> Request:
    wanted: list[str] = []
    while not wanted:
        wanted = [slot for slot, often in _SLOTS.items() if choice.random() < often]
    anchor = choice.choice(known)
    conditions = [one for slot in wanted for one in _DRAWN[slot](choice, known, anchor)]
    truth: dict[str, Any] = {}
    for one in conditions:
        if one.slot in ("tags", "features"):
            truth.setdefault(one.slot, []).append(one.value)
        elif one.slot == "velocity":
            truth["velocity"] = one.value
        else:
            truth.setdefault(one.slot, {})[one.key] = one.value
    left, emptied = list(known), ""
    for stage in STAGES:
        mine = [one for one in conditions if one.stage == stage]
        left = [file for file in left if all(one.holds(file) for one in mine)]
        if not left:
            emptied = stage
            break
    truth |= {"matching_ids": [file.scenario_id for file in left], "emptied_by": {"stage": emptied}}
    return Request(name, "", "ok" if left else "empty", truth)


def _location(choice: random.Random, known: Sequence[Known], anchor: Known) -> list[_Condition]:
    there = anchor if choice.random() < _ANCHORED else choice.choice(known)
    country = choice.choice(_NOWHERE) if choice.random() < 0.1 else there.country
    conditions = []
    if choice.random() < 0.7:
        conditions.append(_Condition("location", "location", "country", country, lambda file: file.country == country))
    if choice.random() < 0.4 or not conditions:
        place = there.place
        conditions.append(_Condition("location", "location", "city", place, lambda file: file.place == place))
    return conditions


def _tags(choice: random.Random, _known: Sequence[Known], anchor: Known) -> list[_Condition]:
    return _words(choice, "tags", list(TAGS), sorted(anchor.tags), lambda file: file.tags)


def _features(choice: random.Random, _known: Sequence[Known], anchor: Known) -> list[_Condition]:
    if choice.random() < 0.5:
        return [_measure(choice, anchor)]
    return _words(choice, "features", list(FEATURES), list(anchor.facts.features), lambda file: file.facts.features)


def _words(
    choice: random.Random,
    slot: str,
    vocabulary: Sequence[str],
    of_anchor: Sequence[str],
    words_of: Callable[[Known], Sequence[str] | frozenset[str]],
) -> list[_Condition]:
    """Return one or two conditions on words: a word, either of two, without a word."""
    conditions = []
    for _ in range(choice.randint(1, 2)):
        names = of_anchor if of_anchor and choice.random() < _ANCHORED else vocabulary
        asked = {choice.choice(names)}
        form = choice.choice(["one", "one", "either", "without"])
        if form == "either":
            asked.add(choice.choice(vocabulary))
        negated = form == "without"
        if negated:
            asked = {choice.choice(vocabulary)}
        text = ("!" if negated else "") + "|".join(sorted(asked))
        conditions.append(_Condition("tags", slot, text, text, _has(words_of, asked, negated=negated)))
    return conditions


def _has(
    words_of: Callable[[Known], Sequence[str] | frozenset[str]], asked: set[str], *, negated: bool
) -> Callable[[Known], bool]:
    return lambda file: bool(asked & set(words_of(file))) != negated


def _measure(choice: random.Random, anchor: Known) -> _Condition:
    """Return a measure within an interval around the anchor's value; without an encounter there is no time to
    conflict.
    """
    name = choice.choice(list(_MEASURES))
    value_of, unit = _MEASURES[name]
    about = value_of(anchor)
    middle = choice.uniform(1.0, 20.0) if about is None else about * choice.uniform(0.7, 1.3)
    low, high = round(middle * 0.8, 2), round(middle * 1.2 + 0.5, 2)
    form = choice.choice(["<=", ">=", "range"])
    text = f"{name}={low}..{high}{unit}" if form == "range" else f"{name}{form}{low if form == '>=' else high}{unit}"
    least, most = (-_ROUNDING if form == "<=" else low), (float("inf") if form == ">=" else high)

    def holds(file: Known) -> bool:
        value = value_of(file)
        if value is None:  # it never happens: later than any time that is named
            return form == ">="
        return least - _ROUNDING <= value <= most + _ROUNDING

    return _Condition("tags", "features", text, text, holds)


def _time_to_conflict_s(file: Known) -> float | None:
    return None if file.facts.ego is None else file.facts.ego.time_to_conflict_s


_MEASURES: Mapping[str, tuple[Callable[[Known], float | None], str]] = {
    "ttc": (_time_to_conflict_s, "s"),
    "horizon": (lambda file: file.facts.horizon_s, "s"),
    "density": (lambda file: file.facts.density_per_km, ""),
}


def _road_net(choice: random.Random, _known: Sequence[Known], anchor: Known) -> list[_Condition]:
    kind = choice.choice(["lanes", "limit", "word", "word"])
    if kind == "lanes":
        operation, count, holds = _counted(choice, _lanes(anchor), _lanes)
        return [_Condition("road_net", "road_net", "lanes", {"op": operation, "count": count}, holds)]
    scope = choice.choice(["ego", "map"])
    if kind == "limit":
        return [_limit(choice, anchor, scope)]
    key = choice.choice(["traffic_light", *SIGNS])
    operation = choice.choice(["present", "absent"])
    value = {"op": operation, "scope": scope}
    return [
        _Condition(
            "road_net", "road_net", key, value, lambda file: _shows(file, key, scope) == (operation == "present")
        )
    ]


def _lanes(file: Known) -> int:
    return 0 if file.facts.ego is None else file.facts.ego.lanes


def _shows(file: Known, key: str, scope: str) -> bool:
    roads = file.facts.roads
    if key == "traffic_light":
        return roads.traffic_light_ego if scope == "ego" else file.lights > 0
    return key in (roads.signs_ego if scope == "ego" else roads.signs_map)


def _limit(choice: random.Random, anchor: Known, scope: str) -> _Condition:
    def limits(file: Known) -> tuple[float, ...]:
        return file.facts.roads.limits_ego_kmh if scope == "ego" else file.facts.roads.limits_map_kmh

    kmh = round(choice.choice(limits(anchor) or (50.0,))) if choice.random() < _ANCHORED else choice.randint(2, 13) * 10
    operation = choice.choice(["exact", "at_least", "at_most"])
    low = kmh - _NEAR_KMH if operation != "at_most" else 0.0
    high = kmh + _NEAR_KMH if operation != "at_least" else float("inf")
    value = {"op": operation, "value": kmh, "unit": "km/h", "scope": scope}
    return _Condition(
        "road_net",
        "road_net",
        "speed_limit",
        value,
        lambda file: any(low - _ROUNDING <= one <= high + _ROUNDING for one in limits(file)),
    )


def _obstacles(choice: random.Random, _known: Sequence[Known], anchor: Known) -> list[_Condition]:
    conditions = []
    for _ in range(choice.randint(1, 2)):
        kinds = sorted(anchor.counts) if anchor.counts and choice.random() < _ANCHORED else list(OBSTACLE_TYPES)
        kind = choice.choice(kinds)
        operation, count, holds = _counted(choice, anchor.counts[kind], _count_of(kind))
        conditions.append(_Condition("obstacles", "obstacles", kind, {"op": operation, "count": count}, holds))
    return list({one.key: one for one in conditions}.values())


def _count_of(kind: str) -> Callable[[Known], int]:
    return lambda file: file.counts[kind]


def _counted(
    choice: random.Random, about: int, count_of: Callable[[Known], int]
) -> tuple[str, int | list[int], Callable[[Known], bool]]:
    """Return an operation with a count near a number, and whether a file's number satisfies it."""
    number = max(about + choice.choice([0, 0, 0, -1, 1, 5]), 0)
    operation = choice.choice(["exact", "at_least", "at_most", "range", "zero"])
    low, high = {
        "exact": (number, number),
        "at_least": (number, 10**9),
        "at_most": (0, number),
        "range": (max(number - 2, 0), number + 2),
        "zero": (0, 0),
    }[operation]
    return operation, [low, high] if operation == "range" else number, lambda file: low <= count_of(file) <= high


def _velocity(choice: random.Random, _known: Sequence[Known], anchor: Known) -> list[_Condition]:
    unit = choice.choice(list(_MPS))
    speed_mps = anchor.speed_mps if choice.random() < _ANCHORED else choice.uniform(0.0, 40.0)
    shown = round(speed_mps / _MPS[unit] + choice.uniform(-1.0, 1.0), 1)
    shown = max(shown, 0.0)
    operation = choice.choice(["about", "range", "at_least", "at_most"])
    value: Any = [shown, round(shown + choice.uniform(1.0, 20.0), 1)] if operation == "range" else shown
    low, high = value if operation == "range" else (shown, shown)
    least = low * _MPS[unit] - (_NEAR_MPS if operation == "about" else 0.0) if operation != "at_most" else -1e9
    most = high * _MPS[unit] + (_NEAR_MPS if operation == "about" else 0.0) if operation != "at_least" else 1e9
    return [
        _Condition(
            "velocity",
            "velocity",
            "velocity",
            {"op": operation, "value": value, "unit": unit},
            lambda file: least - _ROUNDING <= file.speed_mps <= most + _ROUNDING,
        )
    ]


_DRAWN: Mapping[str, Callable[[random.Random, Sequence[Known], Known], list[_Condition]]] = {
    "location": _location,
    "tags": _tags,
    "features": _features,
    "road_net": _road_net,
    "obstacles": _obstacles,
    "velocity": _velocity,
}
