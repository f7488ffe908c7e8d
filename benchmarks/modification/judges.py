"""The paper's checks of an edited scenario, from the written file and from SUMO, never from the product's report.

Each kind of edit has its judges: B the vehicle types in SUMO, T the route driven in SUMO and the written motion, P the
road users of both files, G the written planning problem. Only the list of other handed-over vehicles comes from the
report; the figures say so.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree

from plannerforge.engine.commonroad import Track
from plannerforge.engine.geometry import Points, length_m, oriented_rectangle, point_at, project
from plannerforge.engine.network.positions import POSITION_WORDS
from plannerforge.engine.scene import Scene
from plannerforge.evals.ground_truth.reach import SHARES, nearest_m, places_along, places_on

from ..tracks import bodies, overlap_steps
from .arrivals import ON_ROUTE_SHARE, Journey, arrives_on, handover_errors
from .written import Truth, Written, entry_step

DEEP_M, SAME_HIT_S = 0.05, 1.0
"""Two road users with a deeper overlap collide; the edit is not the cause if they overlap in the recording within this
time.
"""


def checks_of(written: Written, index: int) -> dict[str, bool]:
    """Return the paper's checks of one edit by name."""
    return _CHECKS[written.truths[index]["op"]](written, index)


def is_untouched_identical(written: Written) -> bool:
    """Return True if every element that the edits do not concern has the bytes of the source.

    They concern the named and added road users, those handed over, and the problem with the edited goal.
    """
    old, new = _elements(written.base), _elements(written.xml)
    changed = {key for key in {*old, *new} if old.get(key) != new.get(key)}
    meant = {
        key
        for index, truth in enumerate(written.truths)
        if truth["op"] not in ("set_goal", "add_vehicle")
        for key in written.vehicles_of_edit(index)
    }
    allowed = {str(key) for key in (*meant, *written.added(), *written.outcome.handed_over)}
    if any(truth["op"] == "set_goal" for truth in written.truths):
        allowed.add(str(written.scene.loaded.problem().planning_problem_id))
    return changed <= allowed


def unreported_collisions(written: Written) -> int:
    """Return unreported pairs that overlap by more than 5 cm on either side and did not around that time in the
    source.
    """
    base, new = {**written.scene.standing, **written.old}, {**written.scene.standing, **written.new}
    told = {frozenset(hit.vehicles) for hit in written.outcome.collisions}
    window = SAME_HIT_S / written.scene.step_s
    colliding = set()
    for key in (key for key in sorted(written.new) if _is_new_or_moved(written, key)):
        for other in new:
            pair = frozenset((key, other))
            if other == key or pair in told or pair in colliding:
                continue
            hits = overlap_steps(new[key], new[other], DEEP_M)
            known = overlap_steps(base[key], base[other], 0.0) if pair <= set(base) else []
            if any(all(abs(step - before) > window for before in known) for step in hits):
                colliding.add(pair)
    return len(colliding)


def handovers_of(written: Written) -> tuple[tuple[float, float], ...]:
    """Return the hand-over error in m and m/s for every vehicle that SUMO took over from its recording, from both
    files.
    """
    new, old, step_s = written.new, written.old, written.scene.step_s
    errors = [
        handover_errors(old[vehicle.vehicle_id], new[vehicle.vehicle_id], round(vehicle.from_time_s / step_s), step_s)
        for vehicle in written.outcome.touched
        if vehicle.cause in ("edited", "handed_over") and vehicle.vehicle_id in set(old) & set(new)
    ]
    return tuple(error for error in errors if error is not None)


def _is_new_or_moved(written: Written, key: int) -> bool:
    """Return True if a road user is new, or moves differently."""
    old = written.old.get(key)
    return old is None or not np.array_equal(old.positions, written.new[key].positions)


def _elements(path: Path) -> dict[str, bytes]:
    root = etree.parse(path).getroot()
    return {
        str(element.get("id") or element.tag): etree.tostring(element, with_tail=False)
        for element in root
        if isinstance(element.tag, str)
    }


RELATIVE_TOLERANCE, SIZE_TOLERANCE_M = 1e-3, 0.01
"""Files round parameters and sizes."""
LEAST_M = 0.5, 0.3
"""Least length and width of a vehicle in SUMO."""
SUMO_CLASSES = {
    "car": "passenger",
    "taxi": "taxi",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "priorityVehicle": "emergency",
}
"""SUMO's vehicle class for a CommonRoad obstacle type; ``passenger`` for all others."""
OWN_GAPS_M = {"motorcycle": 2.0, "bicycle": 0.5}
"""The standstill gap of two-wheelers, whatever the preset, unless a parameter sets it."""


def _behaviour_checks(written: Written, index: int) -> dict[str, bool]:
    """Check that each selected vehicle drove in SUMO by the requested parameters, with its former class and size."""
    truth = written.truths[index]
    meant = sorted(written.vehicles_of_edit(index) - written.vehicles_to_remove())
    named = written.vehicles_of_edit(index) == set(written.outcome.edits[index].vehicles)
    return {
        "tgt": bool(meant) and named and all(key in written.new for key in meant),
        "B_preset": bool(meant) and all(_has_parameters(written, truth, key) for key in meant),
        "vClass": all(_is_of_its_class(written, key) for key in meant),
    }


def _is_of_its_class(written: Written, key: int) -> bool:
    """Return True if SUMO drove a vehicle as the file describes it, and a recorded one is unchanged."""
    track, kind, old = written.new.get(key), written.sumo.types.get(key), written.old.get(key)
    if track is None or kind is None:
        return False
    if old is not None and (old.kind, old.length_m, old.width_m) != (track.kind, track.length_m, track.width_m):
        return False
    sizes = zip((track.length_m, track.width_m), (kind["length"], kind["width"]), LEAST_M, strict=True)
    same = all(abs(float(driven) - max(size, least)) <= SIZE_TOLERANCE_M for size, driven, least in sizes)
    return same and kind["vClass"] == SUMO_CLASSES.get(track.kind, "passenger")


def _has_parameters(written: Written, truth: Truth, key: int) -> bool:
    track, kind = written.new.get(key), written.sumo.types.get(key)
    if track is None or kind is None:
        return False
    own_gap_m = OWN_GAPS_M.get(track.kind)
    keeps_gap = own_gap_m is not None and "minGap" not in truth.get("params", {}) and truth.get("preset")
    wanted = {**truth["expected_params"], **({"minGap": own_gap_m} if keeps_gap else {})}
    return all(
        abs(float(kind[name]) - value) <= RELATIVE_TOLERANCE * max(abs(value), 1e-9) for name, value in wanted.items()
    )


def _reroute_checks(written: Written, index: int) -> dict[str, bool]:
    """Check that the vehicle follows a route that ends on the target, and that its body and all others are
    unchanged.
    """
    truth, meant = written.truths[index], written.vehicles_of_edit(index)
    targets = frozenset(int(key) for key in truth["target_lanelets"])
    through = frozenset(int(key) for key in truth.get("via", ()))
    told = meant == set(written.outcome.edits[index].vehicles)
    ends = all(_ends_right(written, key, targets) and _report_agrees(written, index, key, targets) for key in meant)
    return {
        "tgt": meant <= set(written.new),
        "T_ends": bool(meant) and ends and all(_routed_over(written, key, {one}) for key in meant for one in through),
        "T_preserve": told and _others_stay(written) and all(_is_of_its_class(written, key) for key in meant),
    }


def _ends_right(written: Written, key: int, targets: frozenset[int]) -> bool:
    """Return True if a vehicle's route includes a target, and it follows the route and arrives or is late with
    reason.
    """
    if key not in written.new or not _routed_over(written, key, targets):
        return False
    track = written.new[key]
    if written.sumo.share_on_route(track) < ON_ROUTE_SHARE:
        return False
    everybody = {**written.scene.standing, **written.new}
    journey = Journey(written.scene.network, track, targets, everybody, written.scene.step_s)
    return arrives(written, key, targets) or journey.is_late_with_reason()


def arrives(written: Written, key: int, targets: frozenset[int]) -> bool:
    """Return True if the written motion of a vehicle gets onto a target and stays there or drives on from it."""
    return key in written.new and arrives_on(written.scene.network, written.new[key], targets)


def _others_stay(written: Written) -> bool:
    """Return True if all road users are there except those that the edits remove."""
    return set(written.old) - set(written.new) == written.vehicles_to_remove() & set(written.old)


def _routed_over(written: Written, key: int, lanelets: "frozenset[int] | set[int]") -> bool:
    network = written.scene.network
    return any(written.sumo.leads_over(key, network.find_lanelet_by_id(one).center_vertices) for one in lanelets)


def _report_agrees(written: Written, index: int, key: int, targets: frozenset[int]) -> bool:
    """Return True if the report agrees with a vehicle's motion, with a reason if it does not arrive."""
    told = [route for route in written.outcome.edits[index].routes if route.vehicle_id == key]
    if len(told) != 1 or told[0].arrives is None:
        return False
    return told[0].arrives == arrives(written, key, targets) and (told[0].arrives or bool(told[0].reason))


PLACE_TOLERANCE_M, SPEED_TOLERANCE_MPS = 2.0, 0.01
"""Tolerance between the request and the file."""
EGO_LENGTH_M = 4.5
"""Length of CommonRoad's vehicle 2 (BMW 320i), rounded; the file does not state it."""
CLEARANCE_M = 1.0
"""A vehicle enters later than requested only if a road user is on its place or this close to it."""
REACTION_S, HARDEST_BRAKING_MPS2 = 0.5, 8.0
"""A driver's reaction time and highest deceleration."""
PASSING_M = 0.5
"""A road user that passes closer counts as a hit."""


@dataclass(frozen=True)
class _Kind:
    """A CommonRoad obstacle type, and between which lengths and widths in m vehicles of a class are."""

    commonroad_type: str
    lengths_m: tuple[float, float]
    widths_m: tuple[float, float]

    def fits(self, track: Track) -> bool:
        """Return True if a road user is of this class."""
        sizes = ((track.length_m, self.lengths_m), (track.width_m, self.widths_m))
        return track.kind == self.commonroad_type and all(low <= size <= high for size, (low, high) in sizes)


KINDS = {
    "car": _Kind("car", (3.5, 5.5), (1.5, 2.2)),
    "truck": _Kind("truck", (6.0, 12.0), (2.2, 2.6)),
    "bus": _Kind("bus", (9.0, 14.0), (2.3, 2.6)),
    "motorcycle": _Kind("motorcycle", (1.8, 2.6), (0.6, 1.0)),
    "bicycle": _Kind("bicycle", (1.4, 2.0), (0.4, 0.8)),
}


def _removal_checks(written: Written, index: int) -> dict[str, bool]:
    """Check that exactly the selected vehicles are gone."""
    meant = written.vehicles_of_edit(index)
    gone = not meant & set(written.new)
    told = meant == set(written.outcome.edits[index].vehicles)
    return {"P_count": bool(meant) and gone and told, "P_target": gone, "P_others": _others_stay(written)}


def _addition_checks(written: Written, index: int) -> dict[str, bool]:
    """Check number, class, place, time, speed and target of the added vehicles, and that all others stay."""
    truth, told = written.truths[index], written.outcome.edits[index].vehicles
    added = [key for key in told if key in written.added()]
    left_out = [key for key in told if key in written.vehicles_to_remove()]
    there = [written.new[key] for key in added]
    return {
        "P_count": len(added) + len(left_out) == truth["count"] and _adds_up(written),
        "P_class": all(KINDS[truth["class"]].fits(one) and _is_of_its_class(written, one.obstacle_id) for one in there),
        "P_target": all(_is_placed(written, track, truth, place) for place, track in enumerate(there)),
        "P_speed": all(_has_speed(track, truth) for track in there),
        "P_departure": all(_departs(written, track, truth) for track in there),
        "P_destination": all(_gets_there(written, key, truth) for key in added),
        "P_others": _others_stay(written),
    }


def is_taken(scene: Scene, truth: Truth) -> bool:
    """Return True if a recorded road user is on or close to a requested place when the first vehicle enters there."""
    size = _largest_size(truth, CLEARANCE_M)
    places = _places(scene, truth, 0, sum(KINDS[truth["class"]].lengths_m) / 2)
    rooms = [shapely.Point(place).buffer(float(np.hypot(*size)) / 2) for place in places]
    there = _bodies_at({**scene.tracks, **scene.standing}, entry_step(scene, truth))
    return any(room.intersects(body) for room in rooms for body in there) or (
        scene.ego is not None and nearest_m(scene.ego.position, places) <= size[0] + EGO_LENGTH_M / 2
    )


def is_run_over(scene: Scene, truth: Truth) -> bool:
    """Return True if a recorded road user gets onto or close to the place although it brakes as hard as it can.

    It does not react to the vehicle before that enters, and takes some time to brake.
    """
    places = _places(scene, truth, 0, sum(KINDS[truth["class"]].lengths_m) / 2)
    rooms = [room for place in places for room in _rooms(scene, place, _largest_size(truth, PASSING_M))]
    for other in scene.tracks.values():
        index = other.index_at(entry_step(scene, truth))
        if index is None:
            continue
        speed_mps = max(float(other.speeds_mps[index]), 0.0)
        stops_after_m = speed_mps * REACTION_S + speed_mps**2 / (2 * HARDEST_BRAKING_MPS2)
        steps_m = np.linalg.norm(np.diff(other.positions[index:], axis=0), axis=1)
        last = index + int((np.cumsum(steps_m) <= stops_after_m).sum())
        swept = bodies(other, np.arange(index, last + 1))
        if any(shapely.intersects(room, swept).any() for room in rooms):
            return True
    return False


def _bodies_at(tracks: Mapping[int, Track], step: int) -> list[shapely.Polygon]:
    """Return the bodies of all road users present at a step."""
    there = ((track, track.index_at(step)) for track in tracks.values())
    return [bodies(track, np.array([index]))[0] for track, index in there if index is not None]


def _largest_size(truth: Truth, larger_m: float) -> tuple[float, float]:
    """Return length and width in m of the largest vehicle of the class, with a margin on all sides."""
    kind = KINDS[truth["class"]]
    return kind.lengths_m[1] + 2 * larger_m, kind.widths_m[1] + 2 * larger_m


def _rooms(scene: Scene, place: Points, size: tuple[float, float]) -> list[shapely.Polygon]:
    """Return rectangles around a place along all lanelets under it."""
    under = scene.network.find_lanelet_by_position([place])[0]
    lines = [scene.network.find_lanelet_by_id(key).center_vertices for key in under]
    headings_rad = [point_at(line, project(line, place)[0])[1] for line in lines]
    return [shapely.Polygon(oriented_rectangle(place, heading_rad, size)) for heading_rad in headings_rad]


def _adds_up(written: Written) -> bool:
    """Return True if the new file has exactly as many new road users as all edits together add."""
    asked = sum(truth["count"] for truth in written.truths if truth["op"] == "add_vehicle")
    gone = written.vehicles_to_remove() - set(written.old)
    return len(written.added()) + len(gone) == int(asked)


def _is_placed(written: Written, track: Track, truth: Truth, index: int) -> bool:
    """Return True if an added vehicle starts at the requested place, from the corpus or by the rules of its words."""
    return nearest_m(track.positions[0], _places(written.scene, truth, index, track.length_m)) <= PLACE_TOLERANCE_M


def _places(scene: Scene, truth: Truth, index: int, vehicle_length_m: float) -> list[Points]:
    network, where = scene.network, truth["where"]
    if truth.get("resolved"):
        place = truth["resolved"][index]
        line = network.find_lanelet_by_id(place["lanelet"]).center_vertices
        return [point_at(line, place["s_m"])[0]]
    if "lanelet" in where:
        return places_on(network, where["lanelet"], SHARES[where["position"]], vehicle_length_m)
    start = np.asarray(scene.loaded.problem().initial_state.position, dtype=float)
    return places_along(network, start, float(where["offset_m"]))


def _has_speed(track: Track, truth: Truth) -> bool:
    asked = truth.get("speed_mps")
    return asked is None or abs(float(track.speeds_mps[0]) - float(asked)) <= SPEED_TOLERANCE_MPS


def _departs(written: Written, track: Track, truth: Truth) -> bool:
    """Return True if it departs at the requested step, or after a named one as soon as the place is free."""
    asked = entry_step(written.scene, truth)
    if asked == 0:
        return track.first_step == 0
    others = {**written.new, **written.scene.standing}
    others.pop(track.obstacle_id, None)
    place = bodies(track, np.array([0]), CLEARANCE_M)[0]
    waits = range(asked, track.first_step)
    taken = (any(place.intersects(body) for body in _bodies_at(others, step)) for step in waits)
    return track.first_step >= asked and all(taken)


def _gets_there(written: Written, key: int, truth: Truth) -> bool:
    destination = truth.get("destination_lanelet")
    return destination is None or _ends_right(written, key, frozenset([int(destination)]))


GOAL_TOLERANCE_M = 0.5
"""Distance along the lanelet between the requested and the written place."""
USUAL_SIZE_M = (6.0, 2.0)
"""Default length and width of a goal if neither the request nor the file gives any, as in the paper's code."""
ROUNDING = 1e-6
"""Tolerance of a step: times divided by the step are not exact."""


def _goal_checks(written: Written, index: int) -> dict[str, bool]:
    """Check the written goal: on its lanelet, along it as requested, with the requested size and time.

    commonroad-io decides what is on a lanelet, because planners find the ego's route by it. Unnamed values must equal
    the source's; a problem without a goal state has no values to keep.
    """
    truth, network = written.truths[index], written.loaded.scenario.lanelet_network
    lanelet = network.find_lanelet_by_id(int(truth["lanelet"]))
    center = np.asarray(written.loaded.problem().goal.state_list[0].position.center)
    share = POSITION_WORDS.get(str(truth.get("position") or "final"))
    station_m = project(lanelet.center_vertices, center)[0]
    new, old = _goal(written.xml), _goal(written.base)
    size = _size(new)
    return {
        "G_edge": lanelet.lanelet_id in network.find_lanelet_by_position([center])[0],
        "G_position": share is None or abs(station_m - share * length_m(lanelet.center_vertices)) <= GOAL_TOLERANCE_M,
        "G_rectangle": size is not None and np.allclose(size, _right_size(truth, old), rtol=0.0, atol=SIZE_TOLERANCE_M),
        "G_time": _is_at_its_time(_interval(new, "time"), truth, written.scene.step_s, old),
        "G_preserve": old is None or _interval(new, "velocity") == _interval(old, "velocity"),
    }


def _goal(path: Any) -> Any:
    """Return the first goal state of a file's first planning problem, or None if it has none."""
    return etree.parse(path).getroot().find("planningProblem/goalState")


def _right_size(truth: Truth, old: Any) -> tuple[float, float]:
    """Return the right length and width in m: the requested ones, otherwise the previous ones, otherwise the usual
    ones.
    """
    asked = truth.get("rectangle")
    if asked:
        return float(asked["length_m"]), float(asked["width_m"])
    return (None if old is None else _size(old)) or USUAL_SIZE_M


def _size(goal: Any) -> tuple[float, float] | None:
    rectangle = goal.find("position/rectangle")
    return None if rectangle is None else (float(rectangle.findtext("length")), float(rectangle.findtext("width")))


def _is_at_its_time(steps: tuple[float, float] | None, truth: Truth, step_s: float, old: Any) -> bool:
    """Return True if both steps are as requested, rounded inwards, or unchanged if no time was requested."""
    asked = truth.get("time")
    if asked:
        first, last = asked["start_s"] / step_s, asked["end_s"] / step_s
        return steps == (math.ceil(first - ROUNDING), math.floor(last + ROUNDING))
    if old is None:
        return steps is not None and 0 <= steps[0] < steps[1]
    return steps == _interval(old, "time")


def _interval(goal: Any, name: str) -> tuple[float, float] | None:
    """Return both ends of an interval, twice an exact value, or None if it is not given."""
    element = goal.find(name)
    if element is None:
        return None
    exact = element.findtext("exact")
    ends = (exact, exact) if exact is not None else (element.findtext("intervalStart"), element.findtext("intervalEnd"))
    return float(ends[0]), float(ends[1])


_CHECKS: Mapping[str, Callable[[Written, int], dict[str, bool]]] = {
    "reroute": _reroute_checks,
    "set_behaviour": _behaviour_checks,
    "set_goal": _goal_checks,
    "remove_vehicle": _removal_checks,
    "add_vehicle": _addition_checks,
}
