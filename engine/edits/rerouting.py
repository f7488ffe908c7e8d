"""Edit T, a new route: to lanelets or along a turn, if the vehicle can still brake and change lanes for it.

A route is refused before it is simulated if the vehicle reaches a curve too fast, or cannot change lanes before a road
ends or inside a junction. Distances are in m, speeds in m/s.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, UnknownName, with_values
from ...schemas.modification import Edit
from ..cosimulation import LANE_CHANGE_S, PROGRESS_ACROSS, DrivePlan, JunctionLaneChange, first_curve_too_tight, sent_on
from ..geometry import Points, length_m, point_at, project, wrap_angle
from ..scene import Scene
from ..vehicles import hardest_braking_mps2
from .changes import Changes, EditStep, named_vehicles, plan_of
from .references import drive_to, nearest_driven, reachable_lanelets, select, target_lanelets

_USUAL_S = 3.0
"""Usual duration of a lane change (chosen)."""
_USUAL_STEEPNESS, _STEEPEST = 0.3, 1.0
"""Largest lateral metres per metre along the lane: 17° usually, 45° of the front bumper if room is short.

The motion is smoothed, and the body follows its front: it turns by less than 25°.
"""
_TO_SPARE_M = 0.5
"""A lane change ends one step and this distance before the lanelets part (chosen)."""
_TURN_RAD, _STRAIGHT_RAD = math.radians(50.0), math.radians(20.0)
"""A branch turns above the first, and goes straight below the second (chosen); in between it does neither."""
_BRANCH_M = 60.0
"""A branch is examined no farther than this, so that a later curve of the road is not a turn."""
_ONWARD_NAMED = 3
"""Number of lanelets that are proposed to a vehicle without a fork ahead (chosen)."""


def reroute(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Send the selected vehicles to any of the target lanelets, or along a turn at their next fork.

    Raises:
        InvalidRequest: neither ``to`` nor ``turn`` is given, or both.
        NotPossible: a vehicle cannot get there, reaches a curve or the last point for a lane change too fast, or cannot
            be driven.
    """
    if bool(edit.to or edit.via) == bool(edit.turn):
        raise InvalidRequest(
            "reroute needs either 'to' or 'turn'; 'via' needs 'to'",
            valid=["to=[lanelet]", "via=[lanelet] to=[lanelet]", "turn=left|right|straight"],
            next_step="use one of these",
        )
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        plan = sent_on(plan_of(scene, changes, vehicle_id))
        changes = changes.with_plan(_rerouted(edit, scene, changes, plan))
    turn = "goes straight on" if edit.turn == "straight" else f"turns {edit.turn}"
    where = f": {turn} at the next fork" if edit.turn else f" to {' or '.join(edit.to or edit.via[-1:])}"
    through = f" through {', then '.join(edit.via)}" if edit.via and edit.to else ""
    legs = tuple(target_lanelets([text], scene, changes) for text in edit.via)
    aims = {key: (*legs, changes.driven[key].targets) for key in vehicles}
    return EditStep(changes, vehicles, f"{named_vehicles(vehicles)} rerouted{where}{through}", aims=aims)


def _rerouted(edit: Edit, scene: Scene, changes: Changes, plan: DrivePlan) -> DrivePlan:
    """Return the plan from the vehicle's matched lanelet, or from an overlapping one that leads to the target sooner.

    As a last resort, it starts on its own lanelet with a lane change inside a junction, which SUMO does not simulate. A
    vehicle that is so near may be handed over into the adjacent lane; otherwise it is refused after the simulation.

    Raises:
        NotPossible: why it cannot get there from its matched lanelet.
    """
    own, start = None, plan.lanelets[0]
    try:
        own = _rerouted_from(start, edit, scene, changes, plan)
    except NotPossible as error:
        refusal = error
    if own is not None and _is_in_time(scene, own):
        return own
    for other in _other_starts(scene, plan):
        with suppress(NotPossible):
            found = _rerouted_from(other, edit, scene, changes, plan)
            is_onward = other in scene.layout.table.successors[start]
            if _is_in_time(scene, found) or (own is None and not is_onward):
                return found
    if own is not None:
        return own
    with suppress(NotPossible):
        return _rerouted_from(start, edit, scene, changes, plan, in_junctions=True)
    raise refusal


def _other_starts(scene: Scene, plan: DrivePlan) -> tuple[int, ...]:
    """Return other lanelets that match a recorded vehicle equally well, such as the other branch at a fork.

    If a vehicle's front is past its lanelet, the following lanelets count.
    """
    if plan.cause == "added":
        return ()
    track, index, start = plan.start, plan.from_step - plan.start.first_step, plan.lanelets[0]
    pose = track.positions[index], float(track.headings_rad[index]), float(track.speeds_mps[index])
    other, lane = scene.matcher.near_as_well(*pose, start), scene.layout.table.lanes[start]
    has_left = _way_along_m(lane.center, track.front_at(index)) >= lane.length_m
    onward = scene.layout.table.successors[start] if has_left else ()
    return (*other, *(key for key in onward if key not in other))


def _is_in_time(scene: Scene, plan: DrivePlan) -> bool:
    """Return True if a vehicle at the fastest lane's speed, or its own, completes a route before the scenario ends.

    If earlier edits limit the vehicle's speed, it drives no faster than these limits, or than at its start.

    A vehicle that has passed its turn drives around the block to return, which is useless if the scenario ends first.
    """
    table, route = scene.layout.table, plan.lanelets
    route_m = sum(table.lanes[key].length_m for key, after in pairwise(route) if after in table.successors[key])
    speed_mps = float(plan.start.speeds_mps[plan.from_step - plan.start.first_step])
    ordered_mps = [order.speed_mps for order in plan.manoeuvres if order.speed_mps is not None]
    fastest_mps = max(speed_mps, *(ordered_mps or [scene.lane_speeds_mps[key] for key in route]))
    return route_m <= fastest_mps * (scene.last_step - plan.from_step) * scene.step_s


def _rerouted_from(
    start: int, edit: Edit, scene: Scene, changes: Changes, plan: DrivePlan, *, in_junctions: bool = False
) -> DrivePlan:
    who = f"vehicle {plan.start.obstacle_id}"
    if edit.turn:
        branch = branch_for(scene, start, edit.turn, who).lanelets
        targets = frozenset(branch)
        route = drive_to(scene, start, frozenset(branch[-1:]), who, is_there=True)
    else:
        try:
            targets = target_lanelets(edit.to or edit.via[-1:], scene, changes)
        except UnknownName as error:
            near = reachable_lanelets(scene, [start])[:_ONWARD_NAMED]
            raise error.also(*(with_values(to=[str(key)]) for key in near if edit.to)) from error.__cause__
        route = _route_via(scene, start, edit.via, targets, changes, who)
    _check_curves(scene, plan, route, who)
    _check_lane_changes(scene, plan, route, who, in_junctions=in_junctions)
    through = {key for text in edit.via for key in target_lanelets([text], scene, changes)}
    over = _junction_lane_change(scene, plan, route, who)
    return replace(
        drive_along(scene, plan, route, targets), through=frozenset(through & set(route)), junction_lane_change=over
    )


def drive_along(scene: Scene, plan: DrivePlan, route: tuple[int, ...], targets: frozenset[int]) -> DrivePlan:
    """Return the plan with a new route, continued straight ahead after its end.

    Raises:
        NotPossible: SUMO's edges do not connect along the route.
    """
    edges = scene.edge_graph.route(route)
    if edges is None:
        raise NotPossible(
            f"vehicle {plan.start.obstacle_id} cannot drive from lanelet {route[0]} to {route[-1]}: lanes do not "
            "connect",
            valid=nearest_driven(scene, route[0], route[-1:]),
            next_step="choose another lanelet",
        )
    return replace(
        plan,
        through=frozenset(),
        junction_lane_change=None,
        lanelets=route,
        targets=targets,
        edges=scene.edge_graph.extended(edges, route[-1]),
    )


def _route_via(
    scene: Scene, start: int, via: Sequence[str], targets: frozenset[int], changes: Changes, who: str
) -> tuple[int, ...]:
    """Return the lanelets from a start to the nearest target, through the given lanelets or edges in order.

    Raises:
        UnknownName: a lanelet or edge does not exist.
        NotPossible: one of the legs cannot be driven.
    """
    route: tuple[int, ...] = (start,)
    for wanted in (*(target_lanelets([text], scene, changes) for text in via), targets):
        route += drive_to(scene, route[-1], wanted, who, is_there=route == (start,))[1:]
    return route


@dataclass(frozen=True)
class _Branch:
    """One branch of a fork: its lanelets up to the next fork, and its change of heading in rad (left positive)."""

    lanelets: tuple[int, ...]
    turn_rad: float

    @property
    def turn(self) -> str:
        """The direction: ``left``, ``right``, ``straight``, or "" for a curve in between."""
        if abs(self.turn_rad) < _STRAIGHT_RAD:
            return "straight"
        if abs(self.turn_rad) > _TURN_RAD:
            return "left" if self.turn_rad > 0 else "right"
        return ""

    def __str__(self) -> str:
        """Return a description of the branch, for an error that lists it."""
        side = "left" if self.turn_rad > 0 else "right"
        how = self.turn or f"slightly {side}"
        return f"{how} ({math.degrees(abs(self.turn_rad)):.0f}°) on lanelet {self.lanelets[0]}"


def _branches_at_next_fork(scene: Scene, start: int) -> tuple[_Branch, ...]:
    """Return the branches of the first fork of a lanelet's own lane; empty if the lane ends without a fork."""
    successors = scene.layout.table.successors
    current, seen = start, {start}
    while len(successors[current]) == 1 and successors[current][0] not in seen:
        current = successors[current][0]
        seen.add(current)
    if len(successors[current]) < 2:
        return ()
    arriving = _end_heading(scene, current)
    return tuple(_branch(scene, first, arriving) for first in successors[current])


def branch_for(scene: Scene, start: int, turn: str, who: str) -> _Branch:
    """Return the branch that turns left or right or goes straight at the next fork.

    Raises:
        NotPossible: there is no fork ahead, or no branch in that direction; the error lists all branches.
    """
    branches = _branches_at_next_fork(scene, start)
    if not branches:
        onward = [key for key in reachable_lanelets(scene, [start]) if key != start]
        raise NotPossible(
            f"{who} has no fork ahead in its lane",
            valid=[f"to={key}" for key in onward[:_ONWARD_NAMED]],
            next_step="set 'to' to a lanelet that it can reach",
            remedies=[with_values(turn=None, to=[str(key)]) for key in onward[:_ONWARD_NAMED]],
        )
    fitting = [branch for branch in branches if branch.turn == turn]
    if not fitting:
        side = {"left": 1.0, "right": -1.0}.get(turn, 0.0)
        alike = sorted((one for one in branches if one.turn_rad * side > 0), key=lambda one: -abs(one.turn_rad))
        raise NotPossible(
            f"{who} cannot go {turn} at the next fork",
            valid=branches,
            next_step="choose one of these",
            remedies=[with_values(turn=None, to=[str(one.lanelets[-1])]) for one in alike],  # not the opposite turn
        )
    sign = {"left": -1.0, "right": 1.0}.get(turn)
    rank = (lambda branch: abs(branch.turn_rad)) if sign is None else (lambda branch: sign * branch.turn_rad)
    return min(fitting, key=rank)


def _branch(scene: Scene, first: int, arriving_rad: float) -> _Branch:
    successors, lanes = scene.layout.table.successors, scene.layout.table.lanes
    chain, length = [first], lanes[first].length_m
    while len(successors[chain[-1]]) == 1 and successors[chain[-1]][0] not in chain and length < _BRANCH_M:
        chain.append(successors[chain[-1]][0])
        length += lanes[chain[-1]].length_m
    return _Branch(tuple(chain), wrap_angle(_end_heading(scene, first) - arriving_rad))


def _end_heading(scene: Scene, key: int) -> float:
    lane = scene.layout.table.lanes[key]
    return point_at(lane.center, lane.length_m)[1]


def _check_curves(scene: Scene, plan: DrivePlan, route: tuple[int, ...], who: str) -> None:
    """Refuse a route with a curve that the vehicle reaches too fast, even if it brakes as hard as it can.

    Lanelets of the recorded route are left out: the vehicle was recorded in their curves.

    Raises:
        NotPossible: the error states the lanelet, the lowest possible speed there and the highest that its curve
            allows.
    """
    index = plan.from_step - plan.start.first_step
    recorded = scene.matches.get(plan.start.obstacle_id)
    known = set(recorded.sequence) if recorded is not None and plan.cause != "added" else set()
    why = first_curve_too_tight(scene, route, plan.start.positions[index], float(plan.start.speeds_mps[index]), known)
    if why is not None:
        raise NotPossible(
            f"{who} {why}",
            next_step="choose a target straight ahead, or remove the vehicle and add one that starts slower",
        )


def _check_lane_changes(scene: Scene, plan: DrivePlan, route: tuple[int, ...], who: str, *, in_junctions: bool) -> None:
    """Refuse a route with a lane change that the vehicle must pass, even if it brakes as hard as it can.

    A vehicle that can stop and wait for a gap is sent to the target, even if it does not arrive in time.

    Raises:
        NotPossible: the error states the lanelet that ends too soon.
    """
    lanes = scene.layout.table.lanes
    index = plan.from_step - plan.start.first_step
    speed_mps = max(float(plan.start.speeds_mps[index]), 0.0)
    left_m = -_way_along_m(lanes[route[0]].center, plan.start.front_at(index))
    place = 0
    while place < len(route):
        end = _last_parallel(scene, route, place)
        left_m += lanes[route[place]].length_m
        needed_m = min(
            speed_mps**2 / (2 * hardest_braking_mps2(scene.friction)), speed_mps * LANE_CHANGE_S * (end - place)
        )
        needed_m = max(needed_m, _shortest_crossing_m(scene, route[place : end + 1]))
        room_m, wrong, right = _last_place(scene, route, place, end, in_junctions=in_junctions)
        if end > place and left_m + room_m < needed_m:
            raise NotPossible(
                f"{who} drives {speed_mps:.1f} m/s, and lanelet {wrong}, which it must leave for {right}, ends "
                f"{max(left_m + room_m, 0.0):.0f} m ahead of its front: it can neither change lanes nor stop before",
                next_step="choose a target farther ahead or straight on",
            )
        place = end + 1


def _way_along_m(line: Points, front: Points) -> float:
    """Return how far a front is along a line; past the end, its distance from the end is added."""
    station_m, total_m = project(line, front)[0], length_m(line)
    return station_m if station_m < total_m else total_m + float(np.linalg.norm(front - line[-1]))


def _shortest_crossing_m(scene: Scene, row: tuple[int, ...]) -> float:
    """Return the shortest distance in which a vehicle crosses from its lane's centre to the last lane's edge."""
    first_m, *between_m = (scene.layout.table.lanes[key].width_m for key in row)
    return (first_m / 2 + sum(between_m[:-1])) / _STEEPEST


def _last_parallel(scene: Scene, route: tuple[int, ...], place: int) -> int:
    """Return the index of the last lanelet in the lane changes that start at an index, or that index itself."""
    neighbours = scene.lanelet_graph.neighbours
    while place + 1 < len(route) and route[place + 1] in neighbours.get(route[place], ()):
        place += 1
    return place


def _last_place(
    scene: Scene, route: tuple[int, ...], place: int, end: int, *, in_junctions: bool
) -> tuple[float, int, int]:
    """Return how far (m) the lane change remains possible, and the last pair of lanes: the wrong lane, the route's.

    The two lanes may continue side by side beyond their ends. Lanes inside a junction count only for a vehicle that is
    already inside one, or for all vehicles if ``in_junctions``.
    """
    lanes, inside = scene.layout.table.lanes, scene.layout.interior.lanelets
    last, more_m, wrong = (0.0, route[place], route[end]), 0.0, route[place]
    for onward in route[end + 1 :]:
        straight = scene.lanelet_graph.parallel_lanes([onward]).intersection(scene.layout.table.successors[wrong]) - {
            onward
        }
        if not straight:
            break
        wrong = min(straight)
        more_m += lanes[wrong].length_m
        if in_junctions or wrong not in inside or route[place] in inside:
            last = more_m, wrong, onward
    return last


def _junction_lane_change(scene: Scene, plan: DrivePlan, route: tuple[int, ...], who: str) -> JunctionLaneChange | None:
    """Return a vehicle's lane change inside a junction at the start of its route, or None if there is none.

    The vehicle moves sideways along a smooth step, 3p² - 2p³ after the share p of the length. The path is at most 1.5
    times as steep as on average, and the lateral acceleration is at most 6 v² · aside / length².

    Raises:
        NotPossible: the vehicle is too near the end of its lanelet for that, or too fast.
    """
    end = _last_parallel(scene, route, 0)
    if end == 0 or route[0] in scene.layout.lane_of:
        return None
    index, lanes = plan.from_step - plan.start.first_step, scene.layout.table.lanes
    front, speed_mps = plan.start.front_at(index), max(float(plan.start.speeds_mps[index]), 0.0)
    left_m = [lanes[key].length_m - _way_along_m(lanes[key].center, front) for key in (route[0], route[end])]
    room_m = min(left_m) + _last_place(scene, route, 0, end, in_junctions=True)[0]
    aside_m = abs(project(lanes[route[end]].center, front)[1])
    to_spare_m = _TO_SPARE_M + speed_mps * scene.step_s
    within_m = (room_m - to_spare_m) / PROGRESS_ACROSS
    shortest_m = max(
        1.5 * aside_m / _STEEPEST, speed_mps * math.sqrt(6.0 * aside_m / hardest_braking_mps2(scene.friction))
    )
    if within_m < shortest_m:
        raise NotPossible(
            f"{who} would have to change from lanelet {route[0]} to {route[end]} inside a junction: at "
            f"{speed_mps:.1f} m/s that takes {shortest_m * PROGRESS_ACROSS + to_spare_m:.0f} m, but only "
            f"{max(room_m, 0.0):.0f} m are left ahead of its front",
            valid=nearest_driven(scene, route[0], [route[-1]]),
            next_step="choose a target farther ahead or straight on",
        )
    usual_m = max(speed_mps * _USUAL_S, 1.5 * aside_m / _USUAL_STEEPNESS)
    return JunctionLaneChange(route[end], min(usual_m, within_m))
