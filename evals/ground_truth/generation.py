"""The requests of ``make bench-generation``: requests of a corpus with a map, seeded requests, and requests to refuse.

A refusal is correct if the error has the class that belongs to the reason, and states the problem and its subject.
"""

import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from ...engine.vehicles import vehicle_classes
from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, UnknownName
from ...schemas.generation import GenerateScenariosArguments

SEED = 2026
DENSITIES = ("low", "medium", "high")
MAY_BE_MISSING = ("roundabout", "highway", "ramp", "rural", "signalised_intersection", "intersection", "urban")
VILLAGES = frozenset(
    {"HND_Santa_Barbara-1.osm", "dueren-complete-excerpt.osm", "krautsand.osm", "o2s_overlapping_service_roads.osm"}
)
"""Maps listed without ``urban`` although they contain streets among houses: the list is about towns, the type is
not."""
LEFT_OVER = {"urban": "motorway", "intersection": "motorway", "highway": "residential", "ramp": "motorway_link"}
"""For each type, a road class without any site of the type."""
Reason = Literal["unknown_place", "no_map_here", "no_such_site", "unknown_class", "invalid_value"]
"""``no_map_here``: a real place that another set of maps could cover; refused like an unknown one."""
AS_TYPED: dict[str, dict[str, Any]] = {
    "gen-d050": {"vehicles": ["truck=-4"]},
    "gen-d091": {"vehicles": ["car=0", "pedestrian"]},
    "gen-d092": {"vehicles": ["tank=5", "helicopter=1"]},
    "gen-d093": {"duration_s": 0},
}
"""Invalid parts of requests that the corpus's ground truth omits: as in their texts."""
PEOPLE = frozenset({"gen-d091"})
"""Refused in the corpus because the paper has no pedestrians. Here they are a class, and the ego drives alone among
them, so the remaining problem is a place without a map.
"""


@dataclass(frozen=True)
class BenchRequest:
    """Arguments of generate_scenarios with the expected result.

    ``map_name`` is the file that contains the place; ``street`` is a road that the site must be on.
    """

    name: str
    arguments: GenerateScenariosArguments
    map_name: str
    street: str | None = None


def corpus_requests(lines: Sequence[str], maps: frozenset[str]) -> list[BenchRequest]:
    """Return the requests of a corpus that the available maps can fulfil, with arguments from the ground truth."""
    entries = [json.loads(line) for line in lines]
    return [
        BenchRequest(
            entry["id"],
            GenerateScenariosArguments.model_validate(_corpus_arguments(entry["truth"])),
            entry["map"],
            entry["truth"]["location"]["place"],
        )
        for entry in entries
        if entry["expect"] == "ok" and entry["map"] in maps
    ]


def _corpus_arguments(truth: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ground truth of a request as unchecked arguments; open values take their defaults."""
    where = truth["location"]
    words = [word for word in (where["place"], where["city"]) if word]
    signalised = truth.get("feature") == "signalised_crossing"
    return {
        "place": ", ".join(dict.fromkeys(words)) or None,
        "country": where["country"],
        "bbox": where["bbox"],
        "scenario_type": "signalised_intersection" if signalised else truth["scenario_type"],
        "road_classes": None if truth["road_classes"] == ["roads"] else truth["road_classes"],
        "density": truth["density"],
        "vehicles": _vehicles(truth.get("vehicles_accept", [truth["vehicles"]])[0]),
        "duration_s": truth["duration_s"],
        "ego": _ego(truth["ego"]),
        "goal": _goal(truth["goal"]),
        "count": truth["count"],
    }


def _vehicles(wanted: Mapping[str, int | str]) -> list[str]:
    named = {name: count for name, count in wanted.items() if (name, count) != ("car", "present")}
    return [name if count == "present" else f"{name}={count}" for name, count in named.items()]


def _ego(ego: Mapping[str, Any]) -> str:
    if "requested_class" in ego:
        return f"type:{ego['requested_class']}"
    return {"first": "first", "by_type": "type:car"}.get(ego["strategy"]) or f"index:{ego['index']}"


def _goal(goal: Mapping[str, Any]) -> str:
    return f"distance_m:{goal['distance_m']}" if "distance_m" in goal else f"steps:{goal['offset_steps']}"


def seeded_requests(places: Mapping[str, Any], maps: frozenset[str], count: int) -> list[BenchRequest]:
    """Return ``count`` requests that the maps can fulfil: site × density × classes, cycling through maps and types."""
    choice = random.Random(SEED)  # noqa: S311 - reproducible, not secret
    pairs = [(name, kind) for name in sorted(maps & set(places)) for kind in _types_of(places[name])]
    choice.shuffle(pairs)
    found = []
    for number in range(count):
        name, kind = pairs[number % len(pairs)]
        classes = choice.sample(sorted(vehicle_classes()), choice.choice((0, 1, 1, 2)))
        classes = [known for known in classes if known not in barred(kind) and known != "car"]
        given = {
            "place": places[name]["places"][0],
            "country": places[name]["country"],
            "scenario_type": kind,
            "density": DENSITIES[number % 3],
            "vehicles": [f"{known}={choice.randint(1, 3)}" for known in classes],
            "seed": number,
        }
        found.append(BenchRequest(f"seed-{number:03d}", GenerateScenariosArguments.model_validate(given), name))
    return found


def _types_of(shown: Mapping[str, Any]) -> list[str]:
    """Return the scenario types of a map according to the list of places."""
    signalised = ["signalised_intersection"] if shown["contains"]["signalised_crossings"]["count"] else []
    return [*shown["scenario_types"], *signalised]


def barred(kind: str) -> frozenset[str]:
    """Return the classes that motorways are closed to."""
    return frozenset({"bicycle", "moped"}) if kind in ("highway", "ramp") else frozenset()


@dataclass(frozen=True)
class Refusal:
    """Arguments as a caller sends them, the reason for their refusal, and texts; the error must contain one of them."""

    name: str
    given: Mapping[str, Any]
    reason: Reason
    subjects: tuple[str, ...]


def corpus_refusals(lines: Sequence[str]) -> list[Refusal]:
    """Return all requests of a corpus that must be refused, and those for places without a map here."""
    entries = [json.loads(line) for line in lines]
    return [
        _corpus_refusal(entry)
        for entry in entries
        if entry["expect"] == "refuse" or (entry["expect"] == "ok" and entry["map"] is None)
    ]


def _corpus_refusal(entry: Mapping[str, Any]) -> Refusal:
    """Return a refusal of the corpus; if a class is the problem, its place, which has no map either, is left out."""
    reason: Any = "no_map_here" if entry["id"] in PEOPLE else entry["truth"].get("reason", "no_map_here")
    code, _, field = reason.partition(":")
    if code not in get_args(Reason):
        raise ValueError(f"{entry['id']}: unknown reason {code!r}")
    given = _corpus_arguments(entry["truth"]) | AS_TYPED.get(entry["id"], {})
    if code == "unknown_class":
        given |= {"place": None, "country": None}
        return Refusal(entry["id"], given, code, tuple(word.partition("=")[0] for word in given["vehicles"]))
    if code == "invalid_value":
        return Refusal(entry["id"], given, code, (field,))
    if code == "no_such_site":
        return Refusal(entry["id"], given, code, (given["scenario_type"],))
    return Refusal(entry["id"], given, code, _place_words(given))


def _place_words(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the texts with which an error can refer to the place: as written, its country or its box."""
    return tuple(str(given[key]) for key in ("place", "country", "bbox") if given[key] is not None)


def missing_requests(places: Mapping[str, Any], maps: frozenset[str], count: int) -> list[Refusal]:
    """Return requests for a type of site that neither the map nor another map of its place contains."""
    there = sorted(maps & set(places))
    pairs = [
        (name, kind)
        for name in there
        for kind in MAY_BE_MISSING
        if not (kind == "urban" and name in VILLAGES)
        and not any(
            kind in _types_of(places[other]) for other in there if places[name]["places"][0] in places[other]["places"]
        )
    ]
    random.Random(SEED).shuffle(pairs)  # noqa: S311 - reproducible, not secret
    return [_missing(name, kind, places[name]) for name, kind in pairs[:count]]


def _missing(name: str, kind: str, shown: Mapping[str, Any]) -> Refusal:
    given = {"place": shown["places"][0], "country": shown["country"], "scenario_type": kind}
    return Refusal(f"missing-{kind}-{name}", given, "no_such_site", (kind,))


def left_over_requests(places: Mapping[str, Any], maps: frozenset[str]) -> list[Refusal]:
    """Return requests at motorways for a type of site that the map contains, but not in the requested road class."""
    return [
        Refusal(
            f"left-{kind}-{name}",
            {
                "place": places[name]["places"][0],
                "country": places[name]["country"],
                "scenario_type": kind,
                "road_classes": [road_class],
            },
            "no_such_site",
            (kind,),
        )
        for name in sorted(maps & set(places))
        for kind, road_class in LEFT_OVER.items()
        if {kind, "highway"} <= set(_types_of(places[name]))
    ]


def is_right_reason(refusal: Refusal, error: PlannerForgeError) -> bool:
    """Return whether an error has the class and reason of the refusal, and its text contains the subject."""
    expected: dict[Reason, tuple[type[PlannerForgeError], str]] = {
        "unknown_place": (UnknownName, "not_shown"),
        "no_map_here": (UnknownName, "not_shown"),
        "no_such_site": (NotPossible, "no_such_site"),
        "unknown_class": (UnknownName, "unknown_class"),
        "invalid_value": (InvalidRequest, ""),
    }
    named = any(subject in error.message for subject in refusal.subjects)
    return (type(error), error.reason) == expected[refusal.reason] and named
