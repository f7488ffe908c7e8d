"""The paper's checks of an edited scenario, made on the file that was written.

What a file does not hold is taken from elsewhere: the way that a vehicle is still on when the scenario ends from the
report, and the parameters of a driver from what SUMO was given.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree

from plannerforge.engine.edits.behaviours import own_minimum_gap_m
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.participants import driven_participant
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import point_at, project
from plannerforge.engine.network.positions import POSITION_WORDS
from plannerforge.engine.planners.time_to_collision import MovingRectangles, corners_of
from plannerforge.engine.scenarios.reader import LoadedScenario, read_scenario
from plannerforge.engine.scenarios.tracks import Track, recorded_tracks
from plannerforge.engine.scenarios.validate import schema_errors
from plannerforge.evals.modification_reach import SHARES, length_m, nearest_m, places_along, places_on
from plannerforge.evals.modification_tracks import arrives_on, follows, handover_errors
from plannerforge.schemas.modification import EditReport, ModificationOutcome, VehicleRoute

RELATIVE_TOLERANCE = 1e-3
PLACE_TOLERANCE_M, GOAL_TOLERANCE_M = 2.0, 0.5
DEEP_M = 0.05


@dataclass(frozen=True)
class Written:
    """The base scene, what the edits resolve to, what was reported, and the file that came of it."""

    base: Path
    scene: Scene
    changes: Changes
    outcome: ModificationOutcome
    xml: Path
    new: LoadedScenario

    @classmethod
    def of(cls, base: Path, scene: Scene, changes: Changes, outcome: ModificationOutcome) -> "Written":
        """Read the new file."""
        if outcome.xml is None:
            raise ValueError("a dry run wrote nothing to check")
        return cls(base, scene, changes, outcome, outcome.xml, read_scenario(outcome.xml))

    def tracks(self) -> dict[int, Track]:
        """Trajectories of the new file."""
        return recorded_tracks(self.new.scenario)


def checks_of(written: Written, truth: dict[str, Any], report: EditReport) -> dict[str, bool]:
    """The paper's checks of one edit by name; ``truth`` in the corpus's form."""
    if truth["op"] == "reroute":
        return _trajectory_checks(written, truth, report)
    if truth["op"] == "set_behaviour":
        return _behaviour_checks(written, truth, report)
    if truth["op"] == "set_goal":
        return _goal_checks(written, truth)
    return _population_checks(written, truth, report)


def is_valid(written: Written) -> bool:
    """No schema error that the source does not have; the file was read by commonroad-io already.

    An id that breaks the pattern does so in both files, although it is another one in each.
    """
    old, new = (
        {error.replace(loaded.declared_id, "") for error in schema_errors(loaded.path)}
        for loaded in (written.scene.loaded, written.new)
    )
    return new <= old


def is_untouched_identical(written: Written) -> bool:
    """Whether every element but those of touched road users and the edited problem has the bytes of the source."""
    old, new = _elements(written.base), _elements(written.xml)
    changed = {key for key in {*old, *new} if old.get(key) != new.get(key)}
    allowed = {str(one.vehicle_id) for one in written.outcome.touched} | {str(k) for k in written.outcome.removed}
    allowed |= {str(written.scene.ego.problem_id)} if written.changes.goal and written.scene.ego else set()
    return changed <= allowed


def unreported_collisions(written: Written) -> int:
    """Pairs that overlap by more than 5 cm on either side, did not in the source, and are not in the report."""
    base, new = written.scene.tracks, written.tracks()
    standing = written.scene.standing
    told = {frozenset(hit.vehicles) for hit in written.outcome.collisions}
    found = set()
    for key in sorted({one.vehicle_id for one in written.outcome.touched} & set(new)):
        for other, track in (new | standing).items():
            pair = frozenset((key, other))
            if other != key and pair not in told and _overlap(new[key], track, DEEP_M):
                both = [(base | standing).get(one) for one in (key, other)]
                recorded = both[0] is not None and both[1] is not None and _overlap(both[0], both[1], 0.0)
                found |= set() if recorded else {pair}
    return len(found)


def handovers_of(written: Written) -> tuple[tuple[float, float], ...]:
    """For every vehicle that SUMO took over from its recording what that adds in m and m/s, from both files."""
    new, old, step_s = written.tracks(), written.scene.tracks, written.scene.step_s
    given = [one for one in written.outcome.touched if one.cause in ("edited", "handed_over") and one.vehicle_id in old]
    found = [
        handover_errors(old[one.vehicle_id], new[one.vehicle_id], round(one.from_time_s / step_s), step_s)
        for one in given
        if one.vehicle_id in new
    ]
    return tuple(one for one in found if one is not None)


def _trajectory_checks(written: Written, truth: dict[str, Any], report: EditReport) -> dict[str, bool]:
    new, old = written.tracks(), written.scene.tracks
    asked = {truth["vehicle_id"]} if "vehicle_id" in truth else set(report.vehicles)
    routes = {route.vehicle_id: route for route in report.routes}
    ends = [key in routes and _ends(written, routes[key], set(truth["target_lanelets"]), new) for key in sorted(asked)]
    others = set(old) - set(written.outcome.removed) <= set(new)
    same = all(_bodies_equal(old[key], new[key]) for key in asked if key in old and key in new)
    return {
        "tgt": asked <= set(new),
        "T_ends": bool(ends) and all(ends),
        "T_preserve": others and same and asked == set(report.vehicles),
    }


def _ends(written: Written, route: VehicleRoute, targets: set[int], new: dict[int, Track]) -> bool:
    """The written track arrives; one that cannot in the time is on a way that ends there, and the report says why."""
    touched = {one.vehicle_id: one for one in written.outcome.touched}.get(route.vehicle_id)
    if touched is None or route.vehicle_id not in new:
        return False
    track, network = new[route.vehicle_id], written.scene.network
    first = max(round(touched.from_time_s / written.scene.step_s) - track.first_step, 0)
    on_its_way = follows(network, route.lanelets, track.positions[first:])
    if arrives_on(network, track, first, targets):
        return on_its_way and bool(route.arrives)
    return on_its_way and route.arrives is False and bool(route.reason) and route.lanelets[-1] in targets


def _bodies_equal(one: Track, other: Track) -> bool:
    return (one.kind, one.length_m, one.width_m) == (other.kind, other.length_m, other.width_m)


def _behaviour_checks(written: Written, truth: dict[str, Any], report: EditReport) -> dict[str, bool]:
    new, expected = written.tracks(), truth["expected_params"]
    preset, kept = [], []
    for key in report.vehicles:
        plan = written.changes.driven.get(key)
        if plan is None or key not in new:
            preset.append(False)
            continue
        attributes = etree.fromstring(driven_participant(written.scene, plan).vehicle_type()).attrib
        own_gap_m = own_minimum_gap_m(plan.vehicle_class)
        kept_gap = own_gap_m is not None and "minGap" not in truth.get("params", {})
        wanted = expected | ({"minGap": own_gap_m} if kept_gap else {})
        preset.append(
            all(abs(float(attributes[n]) - v) <= RELATIVE_TOLERANCE * max(abs(v), 1e-9) for n, v in wanted.items())
        )
        old = written.scene.tracks.get(key)
        same = old is None or _bodies_equal(old, new[key])
        kept.append(same and attributes["vClass"] == plan.vehicle_class.sumo_class)
    return {"tgt": all(key in new for key in report.vehicles), "B_preset": all(preset), "vClass": all(kept)}


def _population_checks(written: Written, truth: dict[str, Any], report: EditReport) -> dict[str, bool]:
    new, old = written.tracks(), written.scene.tracks
    others = (set(old) - set(written.outcome.removed)) <= set(new)
    if truth["op"] == "remove_vehicle":
        gone = all(key not in new for key in report.vehicles)
        right = truth["vehicle_ids"] is None or sorted(truth["vehicle_ids"]) == sorted(report.vehicles)
        return {"P_count": gone and right, "P_target": gone, "P_others": others}
    added = [key for key in report.vehicles if key in new or key in written.outcome.removed]
    there = [new[key] for key in report.vehicles if key in new]
    placed = all(_is_placed(written, track, truth, index) for index, track in enumerate(there))
    counted = len(added) == truth["count"] and not set(report.vehicles) & set(old)
    return {"P_count": counted, "P_target": placed, "P_others": others}


def _is_placed(written: Written, track: Track, truth: dict[str, Any], index: int) -> bool:
    """Whether an added vehicle starts where it was asked for: where the corpus says, or by the rules of its words."""
    network, where = written.scene.network, truth["where"]
    if truth.get("resolved"):
        place = truth["resolved"][index]
        line = network.find_lanelet_by_id(place["lanelet"]).center_vertices
        return nearest_m(track.positions[0], [point_at(line, place["s_m"])[0]]) <= PLACE_TOLERANCE_M
    if "lanelet" in where:
        places = places_on(network, where["lanelet"], SHARES[where["position"]], track.length_m)
    else:
        start = np.asarray(written.scene.loaded.problem().initial_state.position, dtype=float)
        places = places_along(network, start, float(where["offset_m"]))
    return nearest_m(track.positions[0], places) <= PLACE_TOLERANCE_M


def _goal_checks(written: Written, truth: dict[str, Any]) -> dict[str, bool]:
    """The goal as written: over its lanelet, along it where the word says, and nothing changed that was not named.

    A problem that had no goal state has nothing to keep.
    """
    state = written.new.problem().goal.state_list[0]
    former = next(iter(written.scene.loaded.problem().goal.state_list), None)
    lanelet = written.new.scenario.lanelet_network.find_lanelet_by_id(int(truth["lanelet"]))
    center = np.asarray(state.position.center)
    share = POSITION_WORDS.get(str(truth.get("position") or "final"))
    station_m = project(lanelet.center_vertices, center)[0]
    near = share is None or abs(station_m - share * length_m(lanelet)) <= GOAL_TOLERANCE_M
    on = lanelet.polygon.shapely_object.buffer(0.2).contains(shapely.Point(center))
    kept = ["velocity"] if truth.get("time") else ["velocity", "time_step"]
    preserved = former is None or all(
        str(getattr(state, name, None)) == str(getattr(former, name, None)) for name in kept
    )
    return {"G_edge": bool(on), "G_position": near, "G_preserve": preserved}


def _elements(path: Path) -> dict[str, bytes]:
    root = etree.parse(path).getroot()
    return {
        str(element.get("id") or element.tag): etree.tostring(element, with_tail=False)
        for element in root
        if isinstance(element.tag, str)
    }


def _overlap(one: Track, other: Track, depth_m: float) -> bool:
    begin, end = max(one.first_step, other.first_step), min(one.last_step, other.last_step) + 1
    if begin >= end:
        return False
    first, second = (_polygons(track, begin, end, depth_m) for track in (one, other))
    return bool(shapely.intersects(first, second).any())


def _polygons(track: Track, begin: int, end: int, depth_m: float) -> Any:
    """The rectangles at the steps, smaller by a depth on every side."""
    part = slice(begin - track.first_step, end - track.first_step)
    size = np.maximum(np.array([track.length_m, track.width_m]) - 2 * depth_m, 0.01)
    count = end - begin
    bodies = MovingRectangles(
        track.positions[part], track.headings_rad[part], np.tile(size, (count, 1)), np.zeros(count)
    )
    return shapely.polygons(corners_of(bodies))
