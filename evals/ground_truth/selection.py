"""The selection corpus: requests with ground truth, their slots as arguments of find_scenarios, and spoiled slots.

Slots are spoiled, by a seed, as language models spoil them (paper, Results, Slot-level extraction). All requests get
one or two tags that were not requested, half of them also a wrong road_net key, and a third the velocity of an example
of the prompt.
"""

import json
import random
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...schemas.catalog import FindScenariosArguments
from ...schemas.vocabulary import SIGNS, TAGS

_EXAMPLE_SPEEDS = ("50km/h", "10m/s", "30km/h")
"""Velocities of the examples in the paper's prompt."""
_WRONG_KEY_SHARE, _COPIED_SPEED_SHARE = 0.5, 1 / 3


@dataclass(frozen=True)
class Request:
    """One line of the corpus; ``matching`` are the ids that satisfy all slots of its ground truth."""

    request_id: str
    text: str
    expect: str
    truth: dict[str, Any]

    @property
    def matching(self) -> frozenset[str]:
        """Ids that satisfy every slot."""
        return frozenset(self.truth["matching_ids"])


def read_requests(path: Path) -> list[Request]:
    """Return all requests of a corpus file."""
    lines = (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())
    return [Request(line["id"], line["text"], line["expect"], line["truth"]) for line in lines]


def refused_arguments(request: Request) -> dict[str, Any]:
    """Return the slots of a request outside the vocabulary, as a model would pass on the user's text."""
    slots: dict[str, list[str]] = {"tags": [], "road_net": [], "obstacles": []}
    for refused in request.truth["refused"]:
        slots[{"sign": "road_net"}.get(refused["slot"], refused["slot"])].append(str(refused["value"]))
    return slots


def arguments_of(truth: dict[str, Any]) -> FindScenariosArguments:
    """Return arguments of find_scenarios with the ground-truth slots."""
    location = truth.get("location") or {}
    return FindScenariosArguments(
        country=location.get("country"),
        city=location.get("city"),
        tags=truth.get("tags", []),
        features=truth.get("features", []),
        road_net=[_road_net(key, value) for key, value in truth.get("road_net", {}).items()],
        obstacles=[
            f"{kind}{_compared(value['op'], value['count'])}" for kind, value in truth.get("obstacles", {}).items()
        ],
        ego_speed=_speed(truth["velocity"]) if "velocity" in truth else None,
        limit=50,
    )


def _road_net(key: str, value: dict[str, Any]) -> str:
    """Return a road_net slot as the argument's text."""
    if key == "lanes":
        return key + _compared(value["op"], value["count"])
    name = key + ("@map" if value["scope"] == "map" else "")
    if value["op"] in ("present", "absent"):
        return ("!" if value["op"] == "absent" else "") + name
    return name + _compared(value["op"], value["value"], value["unit"])


def _compared(operation: str, count: Any, unit: str = "") -> str:
    """Return a condition on a count or a value as text, such as ``>=3`` or ``=10..20``, plus its unit."""
    if operation == "range":
        return f"={count[0]}..{count[1]}{unit}"
    if operation == "zero":
        return "=0"
    return {"exact": "=", "at_least": ">=", "at_most": "<="}[operation] + f"{count}{unit}"


def _speed(slot: dict[str, Any]) -> str:
    """Return a velocity slot in the notation of a call, such as ``>=10m/s``."""
    if slot["op"] == "range":
        return f"{slot['value'][0]}..{slot['value'][1]}{slot['unit']}"
    return {"about": "", "at_least": ">=", "at_most": "<="}[slot["op"]] + f"{slot['value']}{slot['unit']}"


def spoiled(arguments: FindScenariosArguments, seed: str) -> FindScenariosArguments:
    """Return the arguments with over-predicted tags, and by chance a wrong key and a copied velocity."""
    chance = random.Random(seed)  # noqa: S311 - a reproducible choice, no secret
    unasked = sorted(set(TAGS) - set(arguments.tags))
    changes: dict[str, object] = {"tags": [*arguments.tags, *chance.sample(unasked, chance.randint(1, 2))]}
    if chance.random() < _WRONG_KEY_SHARE:
        requested = " ".join(arguments.road_net)
        changes["road_net"] = [
            *arguments.road_net,
            chance.choice([key for key in sorted(SIGNS) if key not in requested]),
        ]
    if chance.random() < _COPIED_SPEED_SHARE:
        changes["ego_speed"] = chance.choice(_EXAMPLE_SPEEDS)
    return arguments.model_copy(update=changes)


def extract_score(truth: FindScenariosArguments, given: FindScenariosArguments) -> float:
    """Return the paper's *extract* of slots: the mean of five scores in [0, 1]; slots empty in both count as 1.

    Tags are compared by the overlap of the sets (Jaccard), as in the paper. The paper does not specify the rest: the
    other slots are compared in the same way, condition by condition.
    """
    pairs = [
        ({truth.country, truth.city}, {given.country, given.city}),
        (truth.tags, given.tags),
        (truth.road_net, given.road_net),
        (truth.obstacles, given.obstacles),
        ({truth.ego_speed}, {given.ego_speed}),
    ]
    return sum(_overlap(first, second) for first, second in pairs) / len(pairs)


def _overlap(first: Collection[str | None], second: Collection[str | None]) -> float:
    together = set(first) | set(second)
    return len(set(first) & set(second)) / len(together) if together else 1.0
