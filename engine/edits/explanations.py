"""Explains why a driven vehicle misses a requested lanelet or speed, and what remains of an edit.

``DrivenVehicle`` is one vehicle as SUMO drove it among the others. Its lanelets are those of SUMO's lanes that the
written motion reaches: SUMO's bumper may cross a line that the smoothed motion does not reach. Texts are parts of
sentences in the report. Lengths are in m, speeds in m/s, steps count from the scenario's start.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
import shapely
from numpy.typing import NDArray

from ...schemas.errors import NotPossible
from ...schemas.modification import Achieved, VehicleRoute
from ..commonroad import Track
from ..cosimulation import LANE_CHANGE_S, DrivePlan, HandoverTrack, Manoeuvre, pedestrian_of
from ..geometry import Values, project
from ..scene import NOT_DRIVEN, Scene
from ..vehicles import STANDING_MPS
from .changes import Changes, EditStep, listed
from .edited_scene import EditedScene, SimulationResult, new_overlaps

_SHORT_M = 5.0
"""A vehicle may pass a lanelet shorter than this within one step, so that no step shows it there (50 m/s)."""
_LOOK_BACK = 4
"""A lanelet among this many last driven ones is not listed again: lanes overlap inside junctions (chosen)."""
_ON_IT_M = 0.5
"""A vehicle is on a lanelet with more of its front half than this, or than half the length of a shorter lanelet.

With less it is at its line.
"""
_HOLDS_UP_M, _NEAR_S, _ASIDE_M = 5.0, 2.0, 2.0
"""A road user this close ahead, by distance or by time, and no farther to the side, holds a vehicle up (chosen)."""
_LEADER_SHARE = 0.5
"""A leader must be ahead for more than this share of the steps."""
_LEAST_STANDING_S = 1.0
"""A shorter stop does not explain a late arrival (chosen)."""
_SLOW_MPS = 8.0
"""A lanelet with a lower limit or curve speed explains a late arrival (chosen)."""
_AT_THE_LIMIT, _LEAST_SHARE = 0.9, 0.5
"""A vehicle at this share of the lanelets' speed, for this share of its time, is limited by them (chosen)."""
_AT_LINE_M = 3.0
"""A vehicle that stands at most this far before the end of a lanelet is the first at its line (chosen)."""
_RED = frozenset("ru")
"""SUMO's letters of a red light, and of red and yellow."""
_SPEED_TOLERANCE_MPS = 0.3
"""A speed within this tolerance is reached (chosen)."""
_STILL_CHANGING_MPS2 = 0.3
"""A vehicle that gained this in the last second was still accelerating (chosen)."""
_MOST_NAMED = 3
"""Number of road users that a sentence lists before it is cut short (chosen)."""
_MOST_EXPLAINED = 10
"""Number of handed-over vehicles with a stated reason (chosen)."""
_Indices = NDArray[np.intp]


def vehicle_route(edited: EditedScene, step: EditStep, key: int) -> VehicleRoute:
    """Return the lanelets that a vehicle drives in the simulation, and whether it reaches each aim of an edit.

    If the vehicle does not arrive in time, its lanelets continue along the rest of its route, if there is one.
    """
    vehicle, aims = DrivenVehicle.of(edited, key, edited.road_users), step.aims.get(key, ())
    if not aims:
        return VehicleRoute(vehicle_id=key, lanelets=vehicle.lanelets)
    missed = [targets for targets in aims if not vehicle.gets_to(targets, step.since.get(key))]
    if not missed:
        return VehicleRoute(vehicle_id=key, lanelets=vehicle.lanelets, arrives=True)
    if _sent_elsewhere(step, vehicle.plan, missed[0]):
        reason, advice = "a later edit sends it elsewhere", "remove one of the two edits"
    else:
        reason = vehicle.reason_not_reached(missed[0], step.since.get(key, vehicle.track.first_step))
        advice = vehicle.advice(missed[0])
    lanelets = (*vehicle.lanelets, *vehicle.rest_of_route)
    return VehicleRoute(vehicle_id=key, lanelets=lanelets, arrives=False, reason=reason, advice=advice)


def check_not_driven_past(edited: EditedScene, key: int) -> None:
    """Refuse to send a recorded vehicle to a target that it passes without being able to return.

    A vehicle that waits for a gap, or can still return to its target, is not refused.

    Raises:
        NotPossible: the error states the target, and why the vehicle does not reach it.
    """
    vehicle = DrivenVehicle.of(edited, key, {})
    plan, driven, graph = vehicle.plan, vehicle.lanelets, edited.scene.lanelet_graph
    leads_there = plan.targets & (set(plan.lanelets) | _side_by_side(edited.scene, plan.lanelets))
    if plan.cause != "edited" or not leads_there or vehicle.gets_to(plan.targets):
        return
    if vehicle.track.leaves or graph.shortest_route(driven[-1:], sorted(plan.targets)) is None:
        reason = vehicle.reason_not_reached(plan.targets, vehicle.track.first_step)
        raise NotPossible(
            f"vehicle {key} would drive past lanelet {vehicle.first_of(plan.targets)}: {reason}, and it is too fast to "
            "wait for a gap",
            next_step="choose a target farther ahead or straight on, or clear the lane next to it",
        )


def speeds_reached(edited: EditedScene, step: EditStep) -> tuple[list[str], list[Achieved]]:
    """Return when vehicles with an ordered speed reach it, or how close they come and what prevents it.

    A statement that holds for several vehicles is made once.
    """
    step_s, achieved = edited.scene.step_s, list[Achieved]()
    reached: dict[int, float] = {}
    missed: dict[str, dict[int, float]] = {}
    for key, (wanted, first) in step.speeds.items():
        track = edited.result.tracks.get(key)
        if track is None:
            continue
        later = _next_speed(step, edited.result.plans[key])
        until = None if later is None else max(later.from_step - track.first_step + 1, 1)
        speeds = track.speeds_mps[max(first - track.first_step, 0) : until]
        near = np.flatnonzero(np.abs(speeds - wanted) <= _SPEED_TOLERANCE_MPS)
        if len(near):
            reached[key] = (max(first, track.first_step) + int(near[0])) * step_s
            achieved.append(_speed_achieved(key, wanted, float(speeds[near[0]]), reached=True))
            continue
        if later is None and not len(speeds):
            continue
        if later is not None:
            reason = f"another edit sets its speed to {later.speed_mps:.1f} m/s from {later.from_step * step_s:g} s"
        else:
            reason = _reason_speed_missed(edited.scene, track, speeds, wanted)
        closest = float(speeds[np.argmin(np.abs(speeds - wanted))]) if len(speeds) else 0.0
        if later is not None and not len(speeds):
            closest = later.speed_mps or 0.0
        missed.setdefault(reason, {})[key] = closest
        achieved.append(_speed_achieved(key, wanted, closest, reached=False))
    sentences = []
    if reached:
        reach = "reaches" if len(reached) == 1 else "reach"
        sentences.append(f"{listed(tuple(reached))} {reach} that speed at {_range_of(reached.values())} s")
    for reason, closest_mps in missed.items():
        do = "does" if len(closest_mps) == 1 else "do"
        best = _range_of(closest_mps.values())
        sentences.append(
            f"{listed(tuple(closest_mps))} {do} not reach the speed (closest: {best} m/s), because {reason}"
        )
    return sentences, achieved


def _range_of(values: Iterable[float]) -> str:
    """Return the range of the values as text, to one decimal, or the single value if all are equal."""
    ordered = sorted(values)
    low, high = f"{round(ordered[0], 1):g}", f"{round(ordered[-1], 1):g}"
    return low if low == high else f"{low} to {high}"


def _speed_achieved(key: int, requested_mps: float, speed_mps: float, *, reached: bool) -> Achieved:
    return Achieved(
        vehicle_id=key,
        quantity="speed",
        asked=round(requested_mps, 2),
        value=round(speed_mps, 2),
        unit="m/s",
        reached=reached,
    )


_STOOD_MPS, _STOOD_S, _DROVE_ON_M = 0.1, 2.0, 2.0
"""A vehicle this slow for this long stood in its recording; it drives now if it gets this far in that time."""


def stood_until_s(edited: EditedScene, key: int) -> float | None:
    """Return until when (s) a driven vehicle stood in its recording although it drives now, or None.

    A queue at a light that is missing from the file is visible only in recordings.
    """
    track, recorded = edited.result.tracks[key], edited.scene.tracks.get(key)
    if recorded is None or edited.changes.is_added(key):
        return None
    least, until = round(_STOOD_S / edited.scene.step_s), None
    steps = np.arange(max(track.first_step, recorded.first_step), recorded.last_step + 1)
    slow = recorded.speeds_mps[steps - recorded.first_step] < _STOOD_MPS
    for stands, group in groupby(zip(steps.tolist(), slow.tolist(), strict=True), key=lambda pair: pair[1]):
        stood = [step for step, _ in group]
        if not stands or len(stood) < least:
            continue
        places = track.positions[np.clip(np.array(stood) - track.first_step, 0, len(track.positions) - 1)]
        if float(np.linalg.norm(places[-1] - places[0])) > _DROVE_ON_M:
            until = stood[-1] * edited.scene.step_s
    return until


def why_shifts_are_driven(edited: EditedScene, vehicles: tuple[int, ...]) -> list[str]:
    """Return sentences on when and why the first three of an edit's time-shifted vehicles were handed over to SUMO."""
    driven = [key for key in edited.driven_shifts if key in vehicles]
    more = [f"{len(driven) - _MOST_NAMED} more are driven"] if len(driven) > _MOST_NAMED else []
    return [_why_shift_is_driven(edited, key) for key in driven[:_MOST_NAMED]] + more


def _why_shift_is_driven(edited: EditedScene, key: int) -> str:
    step_s, tracks = edited.scene.step_s, edited.result.tracks
    driven = f"{key} is driven from {tracks[key].first_step * step_s:.1f} s"
    own, shifts = edited.shifted[key], edited.changes.shifts
    as_driven = {other: edited.road_users[other] for other in tracks}
    for others, moved in ((edited.requested, shifts), (as_driven, {key: shifts[key]})):
        hits = new_overlaps([own], (track for other, track in others.items() if other != key), {key: own}, moved)
        if hits:
            return f"{driven}: its recording would hit vehicle {hits[0].second} at {hits[0].step * step_s:.1f} s"
    return f"{driven}, because others react"


def why_handed_over(edited: EditedScene) -> dict[int, str]:
    """Return, for each handed-over vehicle, which road user it would hit on its recording, and when, as text.

    The result covers at most ten vehicles, in the order in which they were handed over. A vehicle that no longer hits
    any road user, because others react, has no reason.
    """
    tracks, recorded = edited.result.tracks, edited.scene.tracks
    handed_over = sorted(edited.handed_over, key=lambda key: (tracks[key].first_step, key))[:_MOST_EXPLAINED]
    as_driven = {key: edited.road_users[key] for key in tracks}
    reasons = {}
    for key in handed_over:
        others = [track for other, track in as_driven.items() if other != key]
        hits = new_overlaps([recorded[key]], others, recorded, edited.changes.shifts)
        if hits:
            reasons[key] = f"would hit {hits[0].second} at {hits[0].step * edited.scene.step_s:.1f} s"
    return reasons


@dataclass(frozen=True)
class DrivenVehicle:
    """A vehicle as SUMO drove it according to a plan; ``others``: road users that it may have been behind, by id."""

    scene: Scene
    plan: DrivePlan
    track: HandoverTrack
    others: Mapping[int, Track]

    @classmethod
    def of(cls, edited: EditedScene, key: int, others: Mapping[int, Track]) -> "DrivenVehicle":
        """Return a driven vehicle of an edited scene."""
        return cls(edited.scene, edited.result.plans[key], edited.result.tracks[key], others)

    @cached_property
    def lanelets(self) -> tuple[int, ...]:
        """The lanelets that the driven part reaches, in order, as SUMO assigns its lanes."""
        first = self.plan.lanelets[:1] if self.track.first_step == self.plan.start.first_step else ()
        passed = self._lanelets_passed(self.track.lanes, first)
        over = self.plan.junction_lane_change
        if over is not None and over.lanelet_id in passed:
            passed = first + passed[passed.index(over.lanelet_id) :]
        return passed[:1] + self._reached(passed[1:])

    def gets_to(self, targets: frozenset[int], since: int | None = None) -> bool:
        """Return True if the motion reaches one of the target lanelets at or after a step (None: at any step).

        SUMO's bumper may pass a short lanelet while the vehicle is still changing over from the adjacent one.
        """
        begin = 0 if since is None else max(since - self.track.first_step, 0)
        driven = self.lanelets if since is None else self._lanelets_passed(self.track.lanes[begin:])
        return any(self._gets_onto(key, begin) for key in driven if key in targets)

    @property
    def rest_of_route(self) -> tuple[int, ...]:
        """The lanelets after the driven ones to the nearest target of the plan; empty if there is no route."""
        if self.track.leaves or not self.plan.targets or self.plan.targets & set(self.lanelets):
            return ()
        starts = self.lanelets[-1:] or self.plan.lanelets[:1]
        route = self.scene.lanelet_graph.shortest_route(starts, sorted(self.plan.targets))
        return () if route is None else route[len(self.lanelets[-1:]) :]

    def first_of(self, targets: frozenset[int]) -> int:
        """Return the first target lanelet on the planned route; if there is none, the target with the lowest id."""
        return next((key for key in self.plan.lanelets if key in targets), min(targets))

    def reason_not_reached(self, targets: frozenset[int], since: int) -> str:
        """Return why the vehicle reaches none of the target lanelets: no room to change lanes, else its final position.

        ``since``: the step from which it should head there.
        """
        scene, track = self.scene, self.track
        target, last = self.first_of(targets), self.lanelets[-1] if self.lanelets else self.plan.lanelets[0]
        ends = f"it leaves the network on lanelet {last}" if track.leaves else _scenario_ends(scene)
        lane = track.lanes[-1] if track.lanes else ""
        edge, lane_of = lane.rpartition("_")[0], scene.layout.lane_of
        side_lanelets = [key for key in targets if lane_of.get(key, ("", 0))[0] == edge]
        gets_over = not targets.isdisjoint(scene.layout.lanelets_of_lane.get(lane, ()))
        if edge and side_lanelets and not gets_over:
            missing = "room" if (track.last_step - since) * scene.step_s > LANE_CHANGE_S else "time"
            return f"no {missing} to change into lanelet {min(side_lanelets)} before {ends}{self._blocking_road_users}"
        if set(self.lanelets) & _side_by_side(scene, targets) and not gets_over:
            return f"no room to change into lanelet {target} before its road ends{self._blocking_road_users}"
        if track.leaves:
            return f"{ends} before lanelet {target}"
        late = delay(scene, track, self.others, self.lanelets)
        speed_orders = [order for order in self.plan.manoeuvres if order.speed_mps is not None]
        if speed_orders and float(track.speeds_mps[-1]) <= (speed_orders[-1].speed_mps or 0.0) + _SPEED_TOLERANCE_MPS:
            late = f", limited to {speed_orders[-1].speed_mps:.1f} m/s"
        if float(track.speeds_mps[-1]) < STANDING_MPS:
            return f"it stands on lanelet {last} when {ends}{late}"
        return f"{ends} on the way to lanelet {target}{late}"

    def advice(self, targets: frozenset[int]) -> str:
        """Return what may bring the vehicle to one of the lanelets that it does not reach."""
        reached, key = self.lanelets[1:], self.track.obstacle_id
        nearer = f"send {key} to lanelet {reached[-1]}, which it reaches" if reached else f"leave {key} where it is"
        if self.track.blocked_by:
            blocking = ", ".join(str(other) for other in self.track.blocked_by[:_MOST_NAMED] if other > 0)
            return f"remove_vehicle {blocking}, or {nearer}" if blocking else nearer
        if not self.track.leaves and self.rest_of_route and not self.plan.targets.isdisjoint(targets):
            return f"set a higher speed for {key} with set_speed, or {nearer}"
        return nearer

    @property
    def _blocking_road_users(self) -> str:
        """The road users that left no room for a lane change, as text; empty if unknown."""
        names = [_in_words(self.scene, key) for key in self.track.blocked_by]
        more = " and others" if len(names) > _MOST_NAMED else ""
        return f"; in the way: {', '.join(names[:_MOST_NAMED])}{more}" if names else ""

    def _lanelets_passed(self, lanes: Iterable[str], first: Iterable[int] = ()) -> tuple[int, ...]:
        """Return the lanelets of SUMO's lanes in order, after the lanelets ``first``, even if passed within a step."""
        passed = list(first)
        for lane, _ in groupby(lanes):
            for key in self.scene.layout.lanelets_of_lane.get(lane, ()):
                if key not in passed[-_LOOK_BACK:]:
                    passed += [*self._leapt_over(passed[-1:], key), key]
        return tuple(passed)

    def _leapt_over(self, before: list[int], after: int) -> tuple[int, ...]:
        graph = self.scene.lanelet_graph
        if not before or after in (*graph.successors.get(before[0], ()), *graph.neighbours.get(before[0], ())):
            return ()
        between = (graph.shortest_route(before, [after]) or ())[1:-1]
        return between if all(graph.length_m[key] < _SHORT_M for key in between) else ()

    def _reached(self, lanelets: tuple[int, ...], begin: int = 0) -> tuple[int, ...]:
        """Return the lanelets; omit the last lanelets if the motion after an index does not reach them."""
        count = len(lanelets)
        while count and not self._gets_onto(lanelets[count - 1], begin):
            count -= 1
        return lanelets[:count]

    def _gets_onto(self, lanelet_id: int, begin: int) -> bool:
        """Return True if, at or between steps, a significant part of the vehicle's front half is on a lanelet."""
        area = self.scene.matcher.area(lanelet_id)
        least_m = min(_ON_IT_M, self.scene.lanelet_graph.length_m[lanelet_id] / 2)
        centres, fronts = self.track.positions[begin:], self.track.fronts[begin:]
        swept = np.stack([np.concatenate([centres[:1], centres[:-1]]), centres, fronts], axis=1)
        return any(
            bool((shapely.length(shapely.intersection(area, shapely.linestrings(part))) > least_m).any())
            for part in (swept[-1:], swept)
        )


def _reason_speed_missed(scene: Scene, track: HandoverTrack, speeds: Values, requested_mps: float) -> str:
    """Return why a speed was not reached: no time, or something in the way.

    Nothing ahead prevents a vehicle from slowing down, and less than one second is not enough to judge.
    """
    a_second = round(1.0 / scene.step_s)
    gained_mps = float(speeds[-1] - speeds[-a_second - 1]) if len(speeds) > a_second else math.inf
    if speeds[-1] < requested_mps and gained_mps < _STILL_CHANGING_MPS2:
        return "traffic ahead, a junction or a curve limits it"
    if track.leaves:
        return "it leaves the network first"
    return _scenario_ends(scene)


def why_slower_or_faster(edited: EditedScene, track: HandoverTrack, speeds: Values, requested_mps: float) -> str:
    """Return why the mean of a vehicle's speeds differs from a requested mean: its leader, or what limits its speed."""
    if float(speeds.mean()) > requested_mps:
        return "it needs time to slow down"
    leader = _behind(edited.scene, track, edited.road_users, range(track.first_step, track.last_step + 1))
    return leader.strip() if leader else _reason_speed_missed(edited.scene, track, speeds, requested_mps)


def _scenario_ends(scene: Scene) -> str:
    return f"the scenario ends at {scene.last_step * scene.step_s:.1f} s"


def _side_by_side(scene: Scene, lanelets: Iterable[int]) -> set[int]:
    """Return all lanelets of the edges that contain the given lanelets."""
    edges = {scene.layout.lane_of[key][0] for key in lanelets if key in scene.layout.lane_of}
    return {key for edge in edges for key in scene.layout.edges[edge]}


def delay(scene: Scene, track: HandoverTrack, others: Mapping[int, Track], driven: tuple[int, ...] = ()) -> str:
    """Return what delayed a vehicle, as the end of a sentence: longest stop, slow lanelets, a leader, or "".

    ``others``: all road users after the edits. ``driven``: the lanelets that the vehicle reaches; it stands on the last
    one even if its bumper is over the line of the next one.
    """
    steps, key = _longest_stand(scene, track, driven)
    stood_s = len(steps) * scene.step_s
    if stood_s >= _LEAST_STANDING_S:
        where = f"{_standing(scene, track, steps, key)} lanelet {key}"
        return f", after {stood_s:.1f} s {where}{_behind(scene, track, others, steps)}"
    slow = _slow_lanelet(scene, track)
    if slow is None:
        behind = _behind(scene, track, others, range(track.first_step, track.last_step + 1))
        return f",{behind}" if behind else ""
    return f", on lanelets limited to {scene.driven_speeds_mps[slow]:.1f} m/s ({slow})"


def _behind(scene: Scene, track: HandoverTrack, others: Mapping[int, Track], steps: Sequence[int]) -> str:
    """Return the road user that a vehicle was behind for most of the given steps, as text; "" if there is none."""
    leaders, indices = [], np.array(steps) - track.first_step
    for key, other in others.items():
        there = indices + (track.first_step - other.first_step)
        both = (there >= 0) & (there < len(other.positions))
        if key == track.obstacle_id or both.sum() <= _LEADER_SHARE * len(indices):
            continue
        gap_m = _gaps_m(track, other, indices[both], there[both])
        near = gap_m <= np.maximum(_HOLDS_UP_M, _NEAR_S * track.speeds_mps[indices[both]])
        if near.sum() > _LEADER_SHARE * len(indices):
            leaders.append((-int(near.sum()), float(gap_m[near].mean()), key))
    return f" behind {_in_words(scene, min(leaders)[2])}" if leaders else ""


def _standing(scene: Scene, track: HandoverTrack, steps: list[int], key: int) -> str:
    """Return how a vehicle stands on a lanelet at given steps, as text that ends before the lanelet's name."""
    if sum(is_red(scene, key, step) for step in steps) > len(steps) / 2:
        return "at a red light on"
    return "waiting at the junction after" if _is_at_junction(scene, track, steps[-1], key) else "standing on"


def _longest_stand(scene: Scene, track: HandoverTrack, driven: tuple[int, ...]) -> tuple[list[int], int]:
    """Return the steps at which a vehicle stood on the lanelet of its longest stop, and the lanelet's id.

    If the vehicle does not stop, there are no steps.
    """
    stands: dict[int, list[int]] = {}
    for index, (lane, speed) in enumerate(zip(track.lanes, track.speeds_mps, strict=False)):
        if speed < STANDING_MPS:
            under = scene.layout.lanelets_of_lane.get(lane, ())
            for key in [key for key in under if key in driven or not driven][-1:] or driven[-1:]:
                stands.setdefault(key, []).append(track.first_step + index)
    if not stands:
        return [], 0
    key, steps = max(stands.items(), key=lambda stand: (len(stand[1]), -stand[0]))
    return steps, key


def _is_at_junction(scene: Scene, track: HandoverTrack, step: int, key: int) -> bool:
    """Return True if a vehicle is the first at the end of a lanelet that leads into a junction."""
    lane = scene.layout.table.lanes[key]
    if key not in scene.layout.lane_of or scene.layout.lane_of.keys() >= set(scene.layout.table.successors[key]):
        return False
    front = track.fronts[step - track.first_step]
    return project(lane.center, front)[0] >= lane.length_m - _AT_LINE_M


def is_red(scene: Scene, lanelet_id: int, step: int) -> bool:
    """Return True if a lanelet has lights and all of them are red (or red and yellow) at a time step."""
    letters = [one.letter_at(step * scene.step_s) for one in scene.signals if lanelet_id in one.lanelets]
    return bool(letters) and _RED.issuperset(letters)


def _slow_lanelet(scene: Scene, track: HandoverTrack) -> int | None:
    """Return the lanelet with the limit that slowed a vehicle for the longest time, or None."""
    limited_steps: dict[int, int] = {}
    for lane, speed in zip(track.lanes, track.speeds_mps, strict=False):
        for key in scene.layout.lanelets_of_lane.get(lane, ())[-1:]:
            allowed = scene.driven_speeds_mps[key]
            if allowed < _SLOW_MPS and speed >= _AT_THE_LIMIT * allowed:
                limited_steps[key] = limited_steps.get(key, 0) + 1
    if sum(limited_steps.values()) < _LEAST_SHARE * len(track.speeds_mps):
        return None
    return max(limited_steps, key=lambda key: (limited_steps[key], -key))


def _gaps_m(track: HandoverTrack, other: Track, indices: _Indices, there: _Indices) -> Values:
    """Return the gap in m to another vehicle at the given steps (n,); infinite if it is not directly ahead."""
    heading = track.headings_rad[indices]
    x, y = (other.positions[there] - track.positions[indices]).T
    ahead, aside = x * np.cos(heading) + y * np.sin(heading), y * np.cos(heading) - x * np.sin(heading)
    room_m = ahead - (track.length_m + other.length_m) / 2
    return np.where((ahead > 0.0) & (np.abs(aside) <= _ASIDE_M), room_m, np.inf)


def _in_words(scene: Scene, key: int) -> str:
    """Return the name of a road user; the ego has its problem's id, negative if an obstacle has the same id."""
    if scene.ego is not None and key not in scene.tracks and abs(key) == scene.ego.problem_id:
        return "the ego"
    if key < 0:
        return f"pedestrian {pedestrian_of(key)}"
    is_pedestrian = key in scene.tracks and scene.tracks[key].kind in NOT_DRIVEN
    return f"{'pedestrian' if is_pedestrian else 'vehicle'} {key}"


def why_undone(
    op: str, step: EditStep, later: tuple[EditStep, ...], result: SimulationResult, routes: tuple[VehicleRoute, ...]
) -> str | None:
    """Return why nothing remains of an edit, or None if something does.

    Something remains for vehicles that arrived where the edit sent them. For other vehicles, nothing remains if later
    edits remove them, send them elsewhere, or prevent the edit's speed from ever applying.
    """
    final = (step, *later)[-1].changes
    is_replaced = {"set_goal": _is_goal_replaced(step, final), "set_ego": final.ego is not step.changes.ego}
    if is_replaced.get(op):
        return "a later edit replaces it"
    gone = {*step.changes.driven, *step.changes.replays} - {*final.driven, *final.replays}
    arrived = {route.vehicle_id for route in routes if route.arrives}
    if not step.vehicles or not all(
        key not in arrived
        and (key in gone or _is_set_anew(step, key, later) or _is_superseded_by_plan(step, key, result))
        for key in step.vehicles
    ):
        return None
    return "a later edit removes its vehicles" if gone.issuperset(step.vehicles) else "later edits override it"


def _is_goal_replaced(step: EditStep, final: Changes) -> bool:
    """Return True if nothing remains of the goal that an edit sets: neither its place nor its time and speed."""
    own, last = step.changes.goal, final.goal
    if own is None or last is None or own is last:
        return own is not last
    keeps_place = not own.keeps_place and own.center is last.center
    carried = own.keeps_place and (own.steps, own.speed_mps) == (last.steps, last.speed_mps)
    return not keeps_place and not carried


def why_missed(values: Sequence[Achieved]) -> str | None:
    """Return why an edit counts as not done although its vehicles follow its orders; None if it is done.

    An edit is not done if its effect occurred for none of its vehicles. A value that only differs from the requested
    value is reported as a value.
    """
    reasons = {one.vehicle_id: one.reason for one in values if one.failed}
    if {one.vehicle_id for one in values} - set(reasons):
        return None
    return next((reason for reason in reasons.values() if reason), None)


def _is_set_anew(step: EditStep, key: int, later: Sequence[EditStep]) -> bool:
    """Return True if later edits set all parameters of an edit again, to values independent of the earlier values."""
    of_vehicle = [other.parameters for other in later if key in other.vehicles]
    anew = {name for parameters in of_vehicle for name, is_whatever in parameters.items() if is_whatever}
    return bool(step.parameters) and anew.issuperset(step.parameters)


def _is_superseded_by_plan(step: EditStep, key: int, result: SimulationResult) -> bool:
    plan, track = result.plans.get(key), result.tracks.get(key)
    if plan is None or track is None:
        return False
    if key in step.speeds:
        later = _next_speed(step, plan)
        return later is not None and later.from_step <= step.speeds[key][1]
    aims = step.aims.get(key, ())
    return bool(aims) and all(_sent_elsewhere(step, plan, targets) for targets in aims)


def _sent_elsewhere(step: EditStep, plan: DrivePlan, targets: frozenset[int]) -> bool:
    """Return True if a later edit sends a vehicle away from an edit's targets; ``plan``: its last plan."""
    key = plan.start.obstacle_id
    own = step.changes.driven[key]
    lane_changes = [one for one in own.manoeuvres if one.lanes_left and one.from_step == step.since.get(key)]
    later = [one for one in plan.manoeuvres if one.lanes_left and one not in own.manoeuvres]
    if lane_changes and any(one.lanes_left * lane_changes[-1].lanes_left < 0 for one in later):
        return True
    is_changed = (plan.targets, plan.lanelets) != (own.targets, own.lanelets)
    return is_changed and not targets & (plan.through | set(plan.lanelets))


def _next_speed(step: EditStep, plan: DrivePlan) -> Manoeuvre | None:
    """Return the next speed order after the edit's own, or None if there is none."""
    wanted, first = step.speeds[plan.start.obstacle_id]
    own = Manoeuvre(first, speed_mps=wanted)
    after = plan.manoeuvres[plan.manoeuvres.index(own) + 1 :]
    return next((one for one in after if one.speed_mps is not None), None)
