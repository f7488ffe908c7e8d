"""What the modification bench asks for: ground truth of the corpus as edits, and drawn edits for every file."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from plannerforge.engine.edits.behaviours import presets
from plannerforge.engine.edits.changes import not_drivable
from plannerforge.engine.edits.lanelet_targets import reachable_lanelets
from plannerforge.engine.edits.scene import Scene
from plannerforge.schemas.modification import Edit

CLASSES = ("car", "truck", "bus", "motorcycle", "bicycle")
POSITIONS = ("beginning", "quarter", "middle", "three_quarter", "final")
MOST_TRIES = 6
FEWEST_STATES, SLOWEST_MPS = 25, 1.0


@dataclass(frozen=True)
class Asked:
    """One request: its task (T, B, P, G, composite or refuse), the edits, and the ground truth of each edit.

    ``must_name``: what the reason of a refusal has to name.
    """

    task: str
    edits: tuple[Edit, ...]
    truths: tuple[dict[str, Any], ...] = ()
    must_name: str = ""


def edit_of(truth: dict[str, Any]) -> Edit:
    """A typed edit of the corpus as ``modify_scenario`` takes it."""
    made: dict[str, Any] = {"op": truth["op"]}
    if truth["op"] == "reroute":
        named = [str(truth["vehicle_id"])] if "vehicle_id" in truth else _selected(truth)
        made |= {"vehicles": named, "to": [str(key) for key in truth["target_lanelets"]]}
    elif truth["op"] == "set_behaviour":
        params = [f"{name}={value}" for name, value in truth.get("params", {}).items()]
        made |= {"vehicles": _selected(truth), "preset": truth.get("preset"), "params": params}
    elif truth["op"] == "remove_vehicle":
        made |= {"vehicles": _selected(truth)}
    elif truth["op"] == "add_vehicle":
        made |= _added(truth)
    else:
        made |= _goal(truth)
    return Edit.model_validate(made)


def drawn_requests(scene: Scene, seed: str) -> Iterator[list[Asked]]:
    """For each task the requests to try in turn until the scenario allows one; drawn by a seed."""
    draw = np.random.default_rng(zlib.crc32(seed.encode()))
    moving = [key for key, track in scene.tracks.items() if _moves(scene, key) and len(track.positions) > FEWEST_STATES]
    draw.shuffle(moving)
    yield [_preset(key, str(draw.choice(list(presets())))) for key in moving[:1]]
    yield [found for key in moving for found in _reroutes(scene, key, draw)][:MOST_TRIES]
    yield _additions(scene, draw) if draw.random() < 0.5 else [_removal(key) for key in moving[:1]]
    yield _goals(scene, draw)


def refusals(scene: Scene) -> list[Asked]:
    """Requests that no scenario allows, each with what the reason has to name."""
    unknown = str(max([*scene.tracks, *scene.layout.table.lanes, 0]) + 7_654_321)
    vehicle = next((str(key) for key in scene.tracks if not not_drivable(scene, key)), None)
    asked: list[tuple[dict[str, Any], str]] = [
        ({"op": "remove_vehicle", "vehicles": [unknown]}, unknown),
        ({"op": "set_behaviour", "vehicles": ["ego"], "preset": "eco"}, "ego"),
        ({"op": "set_goal", "to": [unknown]}, unknown),
        ({"op": "add_vehicle", "vehicle_class": "tram", "at": "ego"}, "tram"),
        ({"op": "add_vehicle", "vehicle_class": "car", "at": unknown}, unknown),
    ]
    if vehicle is not None:
        asked += [
            ({"op": "reroute", "vehicles": [vehicle], "to": [unknown]}, unknown),
            ({"op": "set_behaviour", "vehicles": [vehicle], "preset": "furious"}, "furious"),
            ({"op": "set_behaviour", "vehicles": [vehicle], "params": ["hornLevel=2"]}, "hornLevel"),
            ({"op": "set_behaviour", "vehicles": [vehicle], "params": ["sigma=1.5"]}, "sigma"),
        ]
        asked += [(_unreachable(scene, int(vehicle)), "reach")] if _unreachable(scene, int(vehicle)) else []
    return [Asked("refuse", (Edit.model_validate(edit),), must_name=word) for edit, word in asked]


def _unreachable(scene: Scene, vehicle_id: int) -> dict[str, Any]:
    """A reroute to a lanelet that no way leads to; empty where every lanelet can be reached."""
    start = scene.matches[vehicle_id].sequence[0]
    reached = {start, *scene.lanelet_graph.reachable([start])}
    beyond = [key for key in scene.layout.table.lanes if key not in reached]
    return {"op": "reroute", "vehicles": [str(vehicle_id)], "to": [str(beyond[0])]} if beyond else {}


def _moves(scene: Scene, key: int) -> bool:
    return not not_drivable(scene, key) and float(scene.tracks[key].speeds_mps.mean()) > SLOWEST_MPS


def _asked(task: str, **truth: Any) -> Asked:
    return Asked(task, (edit_of(truth),), (truth,))


def _preset(key: int, preset: str) -> Asked:
    one = {"by": "ids", "ids": [key]}
    expected = presets()[preset]
    return _asked("B", op="set_behaviour", selector=one, vehicle_ids=[key], preset=preset, expected_params=expected)


def _reroutes(scene: Scene, key: int, draw: np.random.Generator) -> list[Asked]:
    way = scene.matches[key].sequence
    near = [lanelet for lanelet in reachable_lanelets(scene, [way[0]])[:MOST_TRIES] if lanelet not in way]
    draw.shuffle(near)
    return [_asked("T", op="reroute", vehicle_id=key, target_lanelets=[lanelet]) for lanelet in near]


def _removal(key: int) -> Asked:
    return _asked("P", op="remove_vehicle", selector={"by": "ids", "ids": [key]}, vehicle_ids=[key])


def _additions(scene: Scene, draw: np.random.Generator) -> list[Asked]:
    found: list[dict[str, Any]] = []
    if scene.ego is not None and scene.ego.lanelets:
        for offset in (25.0, 40.0, 15.0, -20.0):
            where = {"relative_to": "ego", "lane": "same", "offset_m": offset}
            found.append({"class": str(draw.choice(CLASSES)), "count": 1, "where": where})
    lanelets = list(scene.layout.table.lanes)
    draw.shuffle(lanelets)
    middles = [{"lanelet": key, "position": "middle"} for key in lanelets[:MOST_TRIES]]
    found += [{"class": str(draw.choice(CLASSES)), "count": 1, "where": where} for where in middles]
    return [_asked("P", op="add_vehicle", **truth) for truth in found]


def _goals(scene: Scene, draw: np.random.Generator) -> list[Asked]:
    if scene.ego is None or not scene.ego.lanelets:
        return []
    near = reachable_lanelets(scene, scene.ego.lanelets[:1])[:MOST_TRIES]
    draw.shuffle(near)
    return [_asked("G", op="set_goal", lanelet=key, position=str(draw.choice(POSITIONS))) for key in near]


def _selected(truth: dict[str, Any]) -> list[str]:
    selector = truth["selector"]
    if selector["by"] == "ids":
        return [str(key) for key in selector["ids"]]
    if selector["by"] == "description" and selector["rule"] == "only":
        return [str(key) for key in truth["vehicle_ids"]]
    by = selector["by"]
    words: dict[str, str] = {
        "class": f"class:{selector.get('class')}",
        "all": "all",
        "nearest_to_ego": f"nearest:{selector.get('n')}",
        "new": f"new:{selector.get('edit')}",
        "description": {"nearest": "nearest:1"}.get(selector.get("rule"), str(selector.get("rule"))),
    }
    named = [words[by]]
    named += [f"!{key}" for key in selector.get("except", [])]
    return named + [f"new:{index}" for index in selector.get("include_new", [])]


def _added(truth: dict[str, Any]) -> dict[str, Any]:
    where = truth["where"]
    made: dict[str, Any] = {"vehicle_class": truth["class"], "spacing_m": where.get("spacing_m")}
    if truth.get("count", 1) > 1:
        made["count"] = truth["count"]
    if "lanelet" in where:
        position = f"{where['s_m']}m" if "s_m" in where else where.get("position")
        made |= {"at": str(where["lanelet"]), "position": position}
    else:
        made |= {"at": str(where["relative_to"]), "lane": where["lane"], "offset_m": where["offset_m"]}
    if truth.get("speed_mps") is not None:
        made["speed"] = f"{truth['speed_mps']}m/s"
    if truth.get("destination_lanelet"):
        made["to"] = [str(truth["destination_lanelet"])]
    if truth.get("depart_s"):
        made["time_s"] = truth["depart_s"]
    return made


def _goal(truth: dict[str, Any]) -> dict[str, Any]:
    made: dict[str, Any] = {"to": [str(truth["lanelet"])], "position": truth.get("position")}
    if truth.get("rectangle"):
        made["rectangle_m"] = [truth["rectangle"]["length_m"], truth["rectangle"]["width_m"]]
    if truth.get("time"):
        made["goal_time"] = f"{truth['time']['start_s']}..{truth['time']['end_s']}s"
    return made
