"""The requests of the modification bench: ground truth of the corpus as edits, drawn edits, and requests to be refused.

For a request to be refused, the corpus gives a reason code and the text; here, the text becomes typed edits.
The code and the failing edit determine what a refusal must state.
"""

import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...engine.cosimulation import not_drivable
from ...engine.geometry import length_m
from ...engine.scene import Scene
from ...schemas.modification import Edit
from .reach import SHARES, distances_m, is_in_reach, lanelets_at_first, places_along

CLASSES = ("car", "truck", "bus", "motorcycle", "bicycle")
MOST_TRIES, MOST_GOALS = 6, 30
"""Maximum requests of a task that are tried in turn, and nearest goals from which one is drawn (chosen)."""
DEPARTS_S = 1.0
"""Times at which drawn vehicles enter, if not at once."""
FEWEST_STATES, SLOWEST_MPS = 25, 1.0
"""Edited vehicles have more recorded states than this and a higher mean speed (chosen)."""
ON_LANELETS, ON_FOOT = 0.95, ("pedestrian",)
"""Drawn edits concern vehicles that are on lanelets for this share of their recording, including its first state."""
Presets = Mapping[str, Mapping[str, float]]
"""Values of the paper's presets by name, from its facts and not from the code under test."""


@dataclass(frozen=True)
class EditRequest:
    """One request: its task (T, B, P, G, composite or refuse), the edits, and the ground truth of each edit.

    ``must_name``: texts that must all appear in the reason of a refusal.
    """

    task: str
    edits: tuple[Edit, ...]
    truths: tuple[dict[str, Any], ...] = ()
    must_name: tuple[str, ...] = ()


def published_presets(facts: Path) -> Presets:
    """Return the presets of ``presets.json`` in a folder of facts."""
    found = json.loads((facts / "presets.json").read_text(encoding="utf-8"))["sumo_behaviour"]["presets"]
    return {one["name"].lower(): one["values"] for one in found}


def edit_of(truth: dict[str, Any]) -> Edit:
    """Return a typed edit of the corpus in the form of ``modify_scenario``."""
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


def drawn_requests(scene: Scene, seed: str, presets: Presets) -> Iterator[tuple[str, list[EditRequest]]]:
    """Yield, for each task, the requests to try in turn until the scenario allows one; the seed determines the
    requests.

    If there are no requests, the scenario does not allow the task: no vehicle moves in it, or no goal is within reach.
    """
    draw = np.random.default_rng(zlib.crc32(seed.encode()))
    moving = [key for key, track in scene.tracks.items() if _moves(scene, key) and len(track.positions) > FEWEST_STATES]
    draw.shuffle(moving)
    yield "B", [_preset(key, presets, str(draw.choice(sorted(presets)))) for key in moving[:1]]
    yield "T", [found for key in moving for found in _reroutes(scene, key, draw)][:MOST_TRIES]
    yield "P", _additions(scene, draw) if draw.random() < 0.5 else [_removal(key) for key in moving[:1]]
    yield "G", _goals(scene, draw)


def _moves(scene: Scene, key: int) -> bool:
    """Return whether a road user is a vehicle that drives on lanelets, and does not have the ego's id."""
    track = scene.tracks[key]
    if key == _ego_id(scene) or track.kind in ON_FOOT or float(track.speeds_mps.mean()) <= SLOWEST_MPS:
        return False
    on = [bool(under) for under in scene.network.find_lanelet_by_position(list(track.positions))]
    return on[0] and float(np.mean(on)) >= ON_LANELETS


def _request(task: str, **truth: Any) -> EditRequest:
    return EditRequest(task, (edit_of(truth),), (truth,))


def _preset(key: int, presets: Presets, preset: str) -> EditRequest:
    one = {"by": "ids", "ids": [key]}
    expected = dict(presets[preset])
    return _request("B", op="set_behaviour", selector=one, vehicle_ids=[key], preset=preset, expected_params=expected)


def _reroutes(scene: Scene, key: int, draw: np.random.Generator) -> list[EditRequest]:
    """Return reroutes to nearby lanelets on its route's continuations that it does not drive over, in random order."""
    track = scene.tracks[key]
    begin = lanelets_at_first(scene.network, track)
    distances = distances_m(scene.network, track.positions[0], float(track.headings_rad[0]), among=begin)
    over = {int(one) for under in scene.network.find_lanelet_by_position(list(track.positions)) for one in under}
    ahead = sorted(
        (distance_m, int(lanelet)) for lanelet, distance_m in distances.items() if lanelet in scene.layout.table.lanes
    )
    near = [lanelet for _, lanelet in ahead[:MOST_TRIES] if lanelet not in over]
    draw.shuffle(near)
    return [_request("T", op="reroute", vehicle_id=key, target_lanelets=[lanelet]) for lanelet in near]


def _removal(key: int) -> EditRequest:
    return _request("P", op="remove_vehicle", selector={"by": "ids", "ids": [key]}, vehicle_ids=[key])


def _additions(scene: Scene, draw: np.random.Generator) -> list[EditRequest]:
    """Return additions along the ego's lane and in the middle of drawn lanelets, at once or later."""
    found: list[dict[str, Any]] = []
    if scene.ego is not None and scene.ego.lanelets:
        for offset in (25.0, 40.0, 15.0, -20.0):
            where = {"relative_to": "ego", "lane": "same", "offset_m": offset}
            added = {"class": str(draw.choice(CLASSES)), "count": 1, "where": where}
            found += [added] if places_along(scene.network, scene.ego.position, offset) else []
    lanelets = list(scene.layout.table.lanes)
    draw.shuffle(lanelets)
    for key in lanelets[:MOST_TRIES]:
        where = {"lanelet": key, "position": "middle"}
        later = draw.random() < 0.5 and scene.last_step * scene.step_s > DEPARTS_S
        departs = {"depart_s": DEPARTS_S} if later else {}
        found.append({"class": str(draw.choice(CLASSES)), "count": 1, "where": where, **departs})
    if draw.random() < 0.5:
        found.reverse()
    return [_request("P", op="add_vehicle", **truth) for truth in found]


def _goals(scene: Scene, draw: np.random.Generator) -> list[EditRequest]:
    """Return goals that a car can reach in the time of the problem, according to the lanelets of the file."""
    if scene.ego is None:
        return []
    problem, ego = scene.loaded.problem(scene.ego.problem_id), scene.ego
    distances = distances_m(scene.network, ego.position, ego.heading_rad, ego.speed_mps)
    found = [
        (key, word)
        for key, distance_m in sorted(distances.items(), key=lambda pair: (pair[1], pair[0]))
        if key in scene.layout.table.lanes
        for word, share in SHARES.items()
        if is_in_reach(problem, scene.step_s, _station_m(scene, key, distance_m, share), scene.last_step)
    ][:MOST_GOALS]
    draw.shuffle(found)
    return [_request("G", op="set_goal", lanelet=int(key), position=str(word)) for key, word in found[:1]]


def _station_m(scene: Scene, key: int, distance_m: float, share: float) -> float:
    return distance_m + share * length_m(scene.network.find_lanelet_by_id(key).center_vertices)


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


EditWords = dict[str, Any]
CORPUS: Final[Mapping[str, tuple[tuple[EditWords, ...], tuple[str, ...]]]] = {
    "modT-d041": (({"op": "reroute", "vehicles": ["495"], "to": ["40"]},), ("no vehicle 495",)),
    "modT-d042": (({"op": "reroute", "vehicles": ["31033"], "to": ["402"]},), ("no vehicle 31033",)),
    "modT-d043": (({"op": "reroute", "vehicles": ["332"], "to": ["338"]},), ("338 is not a lanelet",)),
    "modT-d048": (({"op": "reroute", "vehicles": ["ego"], "to": ["290"]},), ("drives the ego", "set_goal")),
    "modT-d049": (({"op": "reroute", "vehicles": ["30749"]},), ("'to'",)),
    "modT-d050": (({"op": "reroute", "vehicles": ["one:motorcycle"], "to": ["1155"]},), ("there are", "motorcycle")),
    "modB-d041": (({"op": "set_behaviour", "vehicles": ["317"], "preset": "drunk"},), ("preset 'drunk'",)),
    "modB-d042": (({"op": "set_behaviour", "vehicles": ["11006"], "preset": "zen"},), ("preset 'zen'",)),
    "modB-d043": (({"op": "set_behaviour", "vehicles": ["260"], "preset": "aggressive"},), ("no vehicle 260",)),
    "modB-d044": (({"op": "set_behaviour", "vehicles": ["97"], "preset": "eco"},), ("no vehicle 97",)),
    "modB-d045": (({"op": "set_behaviour", "vehicles": ["class:truck"], "preset": "cautious"},), ("has no truck",)),
    "modB-d046": (({"op": "set_behaviour", "vehicles": ["338"], "params": ["tau=-1"]},), ("tau=-1 is out of range",)),
    "modB-d047": (({"op": "set_behaviour", "vehicles": ["523"], "params": ["hornLevel=0.7"]},), ("'hornLevel'",)),
    "modB-d048": (
        ({"op": "set_behaviour", "vehicles": ["ego"], "preset": "cautious"},),
        ("drives the ego", "configure_planner"),
    ),
    "modB-d049": (({"op": "set_behaviour", "vehicles": ["341"]},), ("preset",)),
    "modB-d050": (({"op": "set_behaviour", "preset": "aggressive"},), ("vehicle",)),
    "modP-d041": (({"op": "remove_vehicle", "vehicles": ["30673"]},), ("no vehicle 30673",)),
    "modP-d042": (({"op": "remove_vehicle", "vehicles": ["460"]},), ("no vehicle 460",)),
    "modP-d043": (({"op": "remove_vehicle", "vehicles": ["class:bus"]},), ("has no bus",)),
    "modP-d044": (({"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "4"},), ("pedestrian is not allowed",)),
    "modP-d045": (({"op": "add_vehicle", "vehicle_class": "tank", "at": "52804"},), ("class 'tank'",)),
    "modP-d046": (
        ({"op": "add_vehicle", "vehicle_class": "car", "at": "30222", "position": "middle"},),
        ("30222 is not a lanelet",),
    ),
    "modP-d047": (({"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "lane": "left"},), ("no lane", "left")),
    "modP-d048": (({"op": "add_vehicle", "vehicle_class": "car", "at": "vehicle:20026"},), ("occupied", "20026")),
    "modP-d049": (({"op": "add_vehicle", "vehicle_class": "truck"},), ("needs a place",)),
    "modP-d050": (({"op": "remove_vehicle", "vehicles": ["one:car"]},), ("there are", "car")),
    "modG-d041": (({"op": "set_goal", "to": ["400"]},), ("400 is not a lanelet",)),
    "modG-d042": (({"op": "set_goal", "to": ["258"], "position": "final"},), ("258 is not a lanelet",)),
    "modG-d047": (
        ({"op": "set_goal", "to": ["35"], "position": "middle", "rectangle_m": [6.0, 0.0]},),
        ("[6.0, 0.0]",),
    ),
    "modG-d048": (({"op": "set_goal"},), ("lanelet", "'to'")),
    "modG-d050": (({"op": "set_goal", "position": "final"},), ("lanelet", "'to'")),
    "modC-d026": (
        ({"op": "reroute", "vehicles": ["30203"], "to": ["453"]}, {"op": "remove_vehicle", "vehicles": ["30213"]}),
        ("no vehicle 30213", "edit 1"),
    ),
    "modC-d027": (
        (
            {"op": "set_behaviour", "vehicles": ["324"], "preset": "aggressive"},
            {"op": "set_goal", "to": ["31075"], "position": "middle"},
        ),
        ("31075 cannot be reached by the ego", "edit 1"),
    ),
    "modC-d028": (
        (
            {"op": "add_vehicle", "vehicle_class": "car", "at": "299", "position": "beginning"},
            {"op": "set_behaviour", "vehicles": ["326"], "preset": "zombie"},
        ),
        ("preset 'zombie'", "edit 1"),
    ),
    "modC-d029": (
        ({"op": "reroute", "vehicles": ["3099"], "to": ["371"]}, {"op": "remove_vehicle", "vehicles": ["3108"]}),
        ("371 cannot be reached by vehicle 3099", "edit 0"),
    ),
    "modC-d030": (
        ({"op": "remove_vehicle", "vehicles": ["32"]}, {"op": "reroute", "vehicles": ["32"], "to": ["48063"]}),
        ("32", "removed"),
    ),
}
"""Lines with a ground truth without an executable edit: the edits of their texts, and what a refusal must state."""


def corpus_refusal(row: Mapping[str, Any]) -> EditRequest | None:
    """Return the edits of a corpus line that must be refused, or None if none of them must be.

    A refusal is optional if it is also correct to continue with a stated assumption, as for "two thirds along the
    lanelet".
    """
    truth = row["truth"]
    if row["id"] in CORPUS:
        edits, words = CORPUS[row["id"]]
        return EditRequest("refuse", tuple(Edit.model_validate(edit) for edit in edits), must_name=words)
    requested = truth.get("requested", ())
    if not requested or any("infeasible" in one for one in requested) or "ok" in truth.get("also_accept", ()):
        return None
    failing = requested[truth.get("failing_edit", 0)]
    return EditRequest("refuse", tuple(edit_of(one) for one in requested), must_name=_words(truth["reason"], failing))


def drawn_refusals(scene: Scene) -> list[EditRequest]:
    """Return requests that no scenario allows, each with what the reason must state."""
    unknown = str(max([*scene.tracks, *scene.layout.table.lanes, 0]) + 7_654_321)
    goal = unknown if scene.ego is not None and scene.ego.lanelets else "no ego"
    requests: list[tuple[EditWords, tuple[str, ...]]] = [
        ({"op": "remove_vehicle", "vehicles": [unknown]}, (f"no vehicle {unknown}",)),
        ({"op": "set_behaviour", "vehicles": ["ego"], "preset": "eco"}, ("drives the ego",)),
        ({"op": "set_goal", "to": [unknown]}, (goal,)),
        ({"op": "add_vehicle", "vehicle_class": "tram", "at": "ego"}, ("'tram'",)),
        ({"op": "add_vehicle", "vehicle_class": "car", "at": unknown}, (f"{unknown} is not a lanelet",)),
    ]
    vehicle = _vehicle(scene)
    if vehicle is not None:
        named = [str(vehicle)]
        requests += [
            ({"op": "reroute", "vehicles": named, "to": [unknown]}, (f"{unknown} is not a lanelet",)),
            ({"op": "set_behaviour", "vehicles": named, "preset": "furious"}, ("'furious'",)),
            ({"op": "set_behaviour", "vehicles": named, "params": ["hornLevel=2"]}, ("'hornLevel'",)),
            ({"op": "set_behaviour", "vehicles": named, "params": ["sigma=1.5"]}, ("sigma=1.5 is out of range",)),
            *_unreachable(scene, vehicle),
        ]
    return [EditRequest("refuse", (Edit.model_validate(edit),), must_name=words) for edit, words in requests]


def _words(reason: str, failing: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the texts that a refusal for a reason must contain about the failing edit."""
    if reason == "infeasible_time":
        return ("out of reach", "goal_time")
    if reason == "unreachable_target" and failing["op"] == "set_goal":
        return (f"{failing['lanelet']} cannot be reached by the ego",)
    if reason == "unreachable_target":
        return (f"{failing['target_lanelets'][0]} cannot be reached by vehicle {failing['vehicle_id']}",)
    named = _selected(dict(failing))[0] if "selector" in failing else ""
    words = {
        "unknown_vehicle": f"no vehicle {named}",
        "ego_is_not_traffic": "drives the ego",
        "unknown_class": f"'{failing.get('class')}'",
        "unknown_preset": f"'{failing.get('preset')}'",
    }
    if reason == "unknown_lanelet":
        return (f"{_lanelet_of(failing)} is not a lanelet",)
    if reason not in words:
        raise ValueError(f"no words are known for the reason {reason}")
    return (words[reason],)


def _lanelet_of(edit: Mapping[str, Any]) -> object:
    """Return the lanelet that a typed edit has as its target or place."""
    if edit["op"] == "reroute":
        return edit["target_lanelets"][0]
    return edit["where"].get("lanelet") if edit["op"] == "add_vehicle" else edit.get("lanelet")


def _vehicle(scene: Scene) -> int | None:
    """Return a vehicle that can be edited; a vehicle with the planning problem's id would count as the ego."""
    return next((key for key in scene.tracks if key != _ego_id(scene) and not not_drivable(scene, key)), None)


def _ego_id(scene: Scene) -> int | None:
    return None if scene.ego is None else scene.ego.problem_id


def _unreachable(scene: Scene, vehicle_id: int) -> list[tuple[EditWords, tuple[str, ...]]]:
    """Return a reroute to a lanelet without a route from any under the vehicle; empty if all can be reached."""
    under = scene.network.find_lanelet_by_position([scene.tracks[vehicle_id].positions[0]])[0]
    starts = {scene.matches[vehicle_id].sequence[0], *(int(key) for key in under)} & set(scene.layout.table.lanes)
    reached = {*starts, *scene.lanelet_graph.reachable(sorted(starts))}
    beyond = next((key for key in scene.layout.table.lanes if key not in reached), None)
    if beyond is None:
        return []
    edit = {"op": "reroute", "vehicles": [str(vehicle_id)], "to": [str(beyond)]}
    return [(edit, (f"{beyond} cannot be reached by vehicle {vehicle_id}",))]
