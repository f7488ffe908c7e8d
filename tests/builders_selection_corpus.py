"""The slots of a selection corpus as arguments of find_scenarios."""

from typing import Any

from plannerforge.schemas.catalog import FindScenariosArguments


def arguments_of(truth: dict[str, Any]) -> FindScenariosArguments:
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
    if key == "lanes":
        return key + compared(value["op"], value["count"])
    name = key + ("@map" if value["scope"] == "map" else "")
    if value["op"] in ("present", "absent"):
        return ("!" if value["op"] == "absent" else "") + name
    return name + compared(value["op"], value["value"], value["unit"])


def compared(operation: str, count: Any, unit: str = "") -> str:
    if operation == "range":
        return f"={count[0]}..{count[1]}{unit}"
    if operation == "zero":
        return "=0"
    return {"exact": "=", "at_least": ">=", "at_most": "<="}[operation] + f"{count}{unit}"


def speed(slot: dict[str, Any]) -> str:
    if slot["op"] == "range":
        return f"{slot['value'][0]}..{slot['value'][1]}{slot['unit']}"
    return {"about": "", "at_least": ">=", "at_most": "<="}[slot["op"]] + f"{slot['value']}{slot['unit']}"
