"""The requests of ``make bench-generation``: of a corpus where a map covers them, and seeded ones."""

import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.generation import GenerateScenariosArguments

SEED = 2026
DENSITIES = ("low", "medium", "high")


@dataclass(frozen=True)
class BenchRequest:
    """Arguments of generate_scenarios with what has to come of them.

    ``map_name`` is the file that shows the place, ``street`` a road that the site must lie on.
    """

    name: str
    arguments: GenerateScenariosArguments
    map_name: str
    street: str | None = None


def corpus_requests(lines: Sequence[str], maps: frozenset[str]) -> list[BenchRequest]:
    """The requests of a corpus that the maps at hand can meet, with the ground truth as arguments."""
    entries = [json.loads(line) for line in lines]
    return [
        BenchRequest(
            entry["id"],
            GenerateScenariosArguments.model_validate(corpus_wish(entry["truth"])),
            entry["map"],
            entry["truth"]["location"]["place"],
        )
        for entry in entries
        if entry["expect"] == "ok" and entry["map"] in maps
    ]


def corpus_wish(truth: Mapping[str, Any]) -> dict[str, Any]:
    """The ground truth of a request as arguments, not yet checked; what it leaves open takes its default."""
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
    """So many requests that the maps can meet: site × density × classes, in turn over all maps and types."""
    choice = random.Random(SEED)  # noqa: S311 - reproducible, not secret
    pairs = [(name, kind) for name in sorted(maps & set(places)) for kind in types_of(places[name])]
    choice.shuffle(pairs)
    found = []
    for number in range(count):
        name, kind = pairs[number % len(pairs)]
        classes = choice.sample(sorted(vehicle_classes()), choice.choice((0, 1, 1, 2)))
        classes = [known for known in classes if known not in _unwelcome(kind) and known != "car"]
        wish = {
            "place": places[name]["places"][0],
            "country": places[name]["country"],
            "scenario_type": kind,
            "density": DENSITIES[number % 3],
            "vehicles": [f"{known}={choice.randint(1, 3)}" for known in classes],
            "seed": number,
        }
        found.append(BenchRequest(f"seed-{number:03d}", GenerateScenariosArguments.model_validate(wish), name))
    return found


def types_of(shown: Mapping[str, Any]) -> list[str]:
    """The scenario types of a map after the list of places."""
    signalised = ["signalised_intersection"] if shown["contains"]["signalised_crossings"]["count"] else []
    return [*shown["scenario_types"], *signalised]


def _unwelcome(kind: str) -> frozenset[str]:
    """Classes that no motorway is open to."""
    return frozenset({"bicycle", "moped"}) if kind in ("highway", "ramp") else frozenset()
