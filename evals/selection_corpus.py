"""The selection corpus: requests with ground truth, and their slots as arguments of find_scenarios."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plannerforge.schemas.catalog import FindScenariosArguments


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
    """All requests of a corpus file."""
    lines = (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())
    return [Request(line["id"], line["text"], line["expect"], line["truth"]) for line in lines]


def refused_arguments(request: Request) -> dict[str, Any]:
    """The slots of a request outside the vocabulary, as a model would pass the user's words on."""
    slots: dict[str, list[str]] = {"tags": [], "road_net": [], "obstacles": []}
    for refused in request.truth["refused"]:
        slots[{"sign": "road_net"}.get(refused["slot"], refused["slot"])].append(str(refused["value"]))
    return slots


def arguments_of(truth: dict[str, Any]) -> FindScenariosArguments:
    """The ground-truth slots as arguments of find_scenarios."""
    location = truth.get("location") or {}
    return FindScenariosArguments(
        country=location.get("country"),
        city=location.get("city"),
        tags=truth.get("tags", []),
        road_net=[road_net(key, value) for key, value in truth.get("road_net", {}).items()],
        obstacles=[
            f"{kind}{compared(value['op'], value['count'])}" for kind, value in truth.get("obstacles", {}).items()
        ],
        ego_speed=speed(truth["velocity"]) if "velocity" in truth else None,
        limit=50,
    )


def road_net(key: str, value: dict[str, Any]) -> str:
    """A road_net slot as the argument's word."""
    if key == "lanes":
        return key + compared(value["op"], value["count"])
    name = key + ("@map" if value["scope"] == "map" else "")
    if value["op"] in ("present", "absent"):
        return ("!" if value["op"] == "absent" else "") + name
    return name + compared(value["op"], value["value"], value["unit"])


def compared(operation: str, count: Any, unit: str = "") -> str:
    """An operation with its count or value, as it is written."""
    if operation == "range":
        return f"={count[0]}..{count[1]}{unit}"
    if operation == "zero":
        return "=0"
    return {"exact": "=", "at_least": ">=", "at_most": "<="}[operation] + f"{count}{unit}"


def speed(slot: dict[str, Any]) -> str:
    """A velocity slot as it is written."""
    if slot["op"] == "range":
        return f"{slot['value'][0]}..{slot['value'][1]}{slot['unit']}"
    return {"about": "", "at_least": ">=", "at_most": "<="}[slot["op"]] + f"{slot['value']}{slot['unit']}"
