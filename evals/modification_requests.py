"""What the modification bench asks for: ground truth of the corpus as edits, and drawn edits for every file."""

import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plannerforge.engine.edits.scene import Scene
from plannerforge.evals.modification_reach import SHARES, distances_m, is_in_reach, lanelets_at_first, length_m, ways_m
from plannerforge.schemas.modification import Edit

CLASSES = ("car", "truck", "bus", "motorcycle", "bicycle")
MOST_TRIES, MOST_GOALS = 6, 30
DEPARTS_S = 1.0
"""When vehicles are drawn to enter that are not put in at once."""

FEWEST_STATES, SLOWEST_MPS = 25, 1.0
ON_LANELETS, ON_FOOT = 0.95, ("pedestrian",)
"""Drawn edits are about vehicles that are on lanelets for that share of their recording, at first in any case."""

Presets = Mapping[str, Mapping[str, float]]
"""Values of the paper's presets by name, from its facts and not from the code that is judged."""


@dataclass(frozen=True)
class Asked:
    """One request: its task (T, B, P, G, composite or refuse), the edits, and the ground truth of each edit.

    ``must_name``: what the reason of a refusal has to name, every one of them.
    """

    task: str
    edits: tuple[Edit, ...]
    truths: tuple[dict[str, Any], ...] = ()
    must_name: tuple[str, ...] = ()


def published_presets(facts: Path) -> Presets:
    """The presets of ``presets.json`` in a folder of facts."""
    found = json.loads((facts / "presets.json").read_text(encoding="utf-8"))["sumo_behaviour"]["presets"]
    return {one["name"].lower(): one["values"] for one in found}


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


def drawn_requests(scene: Scene, seed: str, presets: Presets) -> Iterator[tuple[str, list[Asked]]]:
    """For each task the requests to try in turn until the scenario allows one; drawn by a seed.

    Without any request a scenario allows none of the task: nobody moves in it, or no goal is within a car's reach.
    """
    draw = np.random.default_rng(zlib.crc32(seed.encode()))
    moving = [key for key, track in scene.tracks.items() if _moves(scene, key) and len(track.positions) > FEWEST_STATES]
    draw.shuffle(moving)
    yield "B", [_preset(key, presets, str(draw.choice(sorted(presets)))) for key in moving[:1]]
    yield "T", [found for key in moving for found in _reroutes(scene, key, draw)][:MOST_TRIES]
    yield "P", _additions(scene, draw) if draw.random() < 0.5 else [_removal(key) for key in moving[:1]]
    yield "G", _goals(scene, draw)


def _moves(scene: Scene, key: int) -> bool:
    """Whether a road user is a vehicle that drives on lanelets."""
    track = scene.tracks[key]
    if track.kind in ON_FOOT or float(track.speeds_mps.mean()) <= SLOWEST_MPS:
        return False
    on = [bool(under) for under in scene.network.find_lanelet_by_position(list(track.positions))]
    return on[0] and float(np.mean(on)) >= ON_LANELETS


def _asked(task: str, **truth: Any) -> Asked:
    return Asked(task, (edit_of(truth),), (truth,))


def _preset(key: int, presets: Presets, preset: str) -> Asked:
    one = {"by": "ids", "ids": [key]}
    expected = dict(presets[preset])
    return _asked("B", op="set_behaviour", selector=one, vehicle_ids=[key], preset=preset, expected_params=expected)


def _reroutes(scene: Scene, key: int, draw: np.random.Generator) -> list[Asked]:
    """To lanelets that its way leads to and that it does not come over; the nearest few, in a drawn order."""
    track = scene.tracks[key]
    begin = lanelets_at_first(scene.network, track)
    ways = ways_m(scene.network, track.positions[0], float(track.headings_rad[0]), among=begin)
    over = {int(one) for under in scene.network.find_lanelet_by_position(list(track.positions)) for one in under}
    ahead = sorted((way_m, int(lanelet)) for lanelet, way_m in ways.items() if lanelet in scene.layout.table.lanes)
    near = [lanelet for _, lanelet in ahead[:MOST_TRIES] if lanelet not in over]
    draw.shuffle(near)
    return [_asked("T", op="reroute", vehicle_id=key, target_lanelets=[lanelet]) for lanelet in near]


def _removal(key: int) -> Asked:
    return _asked("P", op="remove_vehicle", selector={"by": "ids", "ids": [key]}, vehicle_ids=[key])


def _additions(scene: Scene, draw: np.random.Generator) -> list[Asked]:
    """Places along the ego's lane and in the middle of drawn lanelets, at once or later; either of them first."""
    found: list[dict[str, Any]] = []
    if scene.ego is not None and scene.ego.lanelets:
        for offset in (25.0, 40.0, 15.0, -20.0):
            where = {"relative_to": "ego", "lane": "same", "offset_m": offset}
            found.append({"class": str(draw.choice(CLASSES)), "count": 1, "where": where})
    lanelets = list(scene.layout.table.lanes)
    draw.shuffle(lanelets)
    for key in lanelets[:MOST_TRIES]:
        where = {"lanelet": key, "position": "middle"}
        departs = {"depart_s": DEPARTS_S} if draw.random() < 0.5 else {}
        found.append({"class": str(draw.choice(CLASSES)), "count": 1, "where": where, **departs})
    if draw.random() < 0.5:
        found.reverse()
    return [_asked("P", op="add_vehicle", **truth) for truth in found]


def _goals(scene: Scene, draw: np.random.Generator) -> list[Asked]:
    """Goals that a car can reach in the time of the problem, by the lanelets of the file."""
    if scene.ego is None:
        return []
    problem, ego = scene.loaded.problem(scene.ego.problem_id), scene.ego
    ways = distances_m(scene.network, ego.position, ego.heading_rad, ego.speed_mps)
    found = [
        (key, word)
        for key, way_m in sorted(ways.items(), key=lambda pair: (pair[1], pair[0]))
        if key in scene.layout.table.lanes
        for word, share in SHARES.items()
        if is_in_reach(problem, scene.step_s, _station_m(scene, key, way_m, share), scene.last_step)
    ][:MOST_GOALS]
    draw.shuffle(found)
    return [_asked("G", op="set_goal", lanelet=int(key), position=str(word)) for key, word in found[:1]]


def _station_m(scene: Scene, key: int, way_m: float, share: float) -> float:
    return way_m + share * length_m(scene.network.find_lanelet_by_id(key))


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
