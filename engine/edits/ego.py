"""Edits G: move the ego's goal; let the ego start elsewhere, or in the place of a recorded car."""

import math
from dataclasses import replace

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.grammar import parse_interval, parse_quantity
from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import DrivePlan, first_curve_too_tight, usual_behaviour
from ..network import station_m
from ..scene import Ego, Scene, goal_center_lanelets
from ..vehicles import EGO_SIZE_M, LARGEST_SPEED_MPS, vehicle_classes
from .changes import Changes, EditStep, GoalChange
from .entries import PLACE_TAKEN, OccupiedPlaces
from .goal_feasibility import GoalTask, distance_along, goal_lanelet_ids, goal_states, kept_speeds, kept_steps
from .placement import Place, first_place
from .references import reachable_lanelets, route_to, select, target_lanelets

_SPEED_TOLERANCE_MPS = 1.0
"""Half the width of the speed interval of a goal whose speed is given as one value (chosen)."""
_LARGEST_RECTANGLE_M = 500.0
"""Longer than any goal region of a published scenario: what is larger is a slip of the units (chosen)."""
_LET_VANISH = "let it vanish: nobody can drive it on"


def set_goal(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the goal of the ego's planning problem onto a lanelet; what is not named stays as it is.

    A curve that the ego comes to too fast is noted, not refused: lanelets of real maps bend where their roads do not.

    Raises:
        InvalidRequest: no lanelet, a bad rectangle or interval.
        NotPossible: no ego, or a goal that it cannot reach, or that no car meets in its time at its speed.
    """
    ego = scene.ego
    if ego is None or not ego.lanelets:
        raise NotPossible(
            "the scenario has no ego on a lanelet, so there is no goal to set",
            next_step="choose a scenario with a planning problem, or let the ego start on a lanelet with set_ego",
        )
    starts = _starts(scene, ego)
    if not edit.to:
        near = reachable_lanelets(scene, starts)
        raise InvalidRequest("set_goal needs a lanelet in 'to'", valid=near, next_step="name one that the ego reaches")
    route = route_to(scene, starts, target_lanelets(edit.to, scene, changes), "the ego")
    lane = scene.layout.table.lanes[route[-1]]
    place = Place(route[-1], station_m(edit.position or "final", route[-1], lane.length_m))
    distance = distance_along(scene, ego, route, place.station_m)
    if distance < 0.0:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m lies {-distance:.1f} m behind the ego",
            next_step="choose a later position or a lanelet ahead",
        )
    goal = GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=place.lanelet_id,
        center=place.pose(scene)[0],
        heading_rad=place.pose(scene)[1],
        size_m=_size(edit.rectangle_m),
        steps=_steps(edit, scene, ego),
        speed_mps=_speeds(edit.goal_speed),
    )
    task = GoalTask.of(scene, ego, goal, distance)
    task.check()
    what = f"goal on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {distance:.1f} m ahead of the ego, {task}"
    pace = task.pace_note(scene.last_step * scene.step_s)
    curve = first_curve_too_tight(scene, route, ego.position, ego.speed_mps)
    warning = "" if curve is None else f"; the ego {curve}"
    return EditStep(replace(changes, goal=goal), (), what + pace + warning)


def _starts(scene: Scene, ego: Ego) -> tuple[int, ...]:
    """The lanelets that the ego stands on; the nearest one where it stands on none."""
    under = set(scene.network.find_lanelet_by_position([ego.position])[0])
    return tuple(key for key in ego.lanelets if key in under) or ego.lanelets[:1]


def _size(rectangle_m: list[float] | None) -> tuple[float, float] | None:
    if rectangle_m is None:
        return None
    if len(rectangle_m) != 2 or not all(0.0 < side <= _LARGEST_RECTANGLE_M for side in rectangle_m):
        raise InvalidRequest(
            f"rectangle_m={rectangle_m} is no goal region",
            valid=[f"[length, width] in m, both above 0 and at most {_LARGEST_RECTANGLE_M:g}"],
            next_step="give both sides, as in [8, 3]",
        )
    return rectangle_m[0], rectangle_m[1]


def _steps(edit: Edit, scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """First and last step of the goal; None keeps the one there is. A problem without any gets the whole scenario."""
    if edit.goal_time is None:
        return None if goal_states(scene, ego) else (ego.step, scene.last_step)
    interval = parse_interval(edit.goal_time, "s", step_s=scene.step_s)
    end = max(scene.last_step, (kept_steps(scene, ego) or (0, 0))[1])
    last = end if interval.high is None else math.floor(interval.high / scene.step_s + 1e-6)
    first = math.ceil((interval.low or 0.0) / scene.step_s - 1e-6)
    if interval.exact:
        first = last = round((interval.high or 0.0) / scene.step_s)
    if first > end > 0:
        raise InvalidRequest(
            f"goal_time '{edit.goal_time}' begins after the scenario's end at {end * scene.step_s:.1f} s",
            valid=[f"'<={end * scene.step_s:.1f}s'"],
            next_step="choose an earlier goal_time",
        )
    if not 0 <= first <= last or last <= ego.step:
        raise InvalidRequest(
            f"goal_time '{edit.goal_time}' does not lie after the start",
            valid=["'8..12s'", "'<=9s'"],
            next_step=f"choose a goal_time after {ego.step * scene.step_s:g} s",
        )
    return first, last


def _speeds(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    interval = parse_interval(text, "m/s")
    slack = _SPEED_TOLERANCE_MPS if interval.exact else 0.0
    low = max((interval.low or 0.0) - slack, 0.0)
    high = (LARGEST_SPEED_MPS if interval.high is None else interval.high) + slack
    if high > LARGEST_SPEED_MPS + _SPEED_TOLERANCE_MPS or high <= low:
        raise InvalidRequest(
            f"goal_speed '{text}' is no speed of a car",
            valid=[f"0 … {LARGEST_SPEED_MPS} m/s"],
            next_step="choose a speed or an interval within it, as '8..12m/s'",
        )
    return low, high


def set_ego(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Start the ego at another place or speed, or put it in the place of a recorded car, which leaves the traffic.

    In the place of a car the goal becomes the end of that car's recording. The former ego vanishes, or becomes a car
    that SUMO drives to the former goal.

    Raises:
        InvalidRequest: neither a car nor a start, or both, or a former ego that stays where the ego still starts.
        NotPossible: no ego, no such car at the ego's first step, or a place that is taken.
    """
    ego = scene.ego
    if ego is None:
        raise NotPossible("the scenario has no ego", next_step="choose a scenario with a planning problem")
    moved = edit.at is not None or edit.speed is not None
    if bool(edit.vehicles) == moved:
        raise InvalidRequest(
            "set_ego takes either a car in 'vehicles' or a start",
            valid=["vehicles=[ID]", "at=LANELET", "speed='8m/s'"],
            next_step="give one of these",
        )
    if edit.former_ego == "traffic" and not edit.vehicles and edit.at is None:
        raise InvalidRequest(
            "former_ego=traffic would put a car where the ego still starts",
            valid=["at=LANELET", "vehicles=[ID]", "former_ego=vanish"],
            next_step="let the ego start elsewhere too",
        )
    before = changes
    if edit.vehicles:
        changes, what = _instead_of(edit, scene, changes, ego)
    else:
        changes, what = _started(edit, scene, changes, ego)
    if edit.former_ego != "traffic":
        return EditStep(changes, (), what)
    plan = _former(scene, before, ego)
    who = plan.start.obstacle_id
    changes = replace(changes.with_plan(plan), next_id=who + 1)
    return EditStep(changes, (who,), f"{what}; the former ego is car {who}", added=(who,))


def _instead_of(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    chosen = select(edit.vehicles, scene, changes)
    cars = [key for key, track in scene.tracks.items() if _fits(scene, changes, track, ego.step)]
    if len(chosen) != 1 or chosen[0] not in cars:
        names = ", ".join(map(str, chosen))
        raise NotPossible(
            f"vehicle {names} cannot become the ego: that takes one recorded car, on a lanelet when the ego starts",
            valid=cars,
            next_step="name one of these",
        )
    track = scene.tracks[chosen[0]]
    index = ego.step - track.first_step
    new = Ego(
        ego.problem_id,
        ego.step,
        track.positions[index],
        float(track.headings_rad[index]),
        max(float(track.speeds_mps[index]), 0.0),
        (scene.matches[chosen[0]].at(index),),
    )
    changes = replace(changes.without(chosen[0]), ego=new)
    what = f"the ego is car {chosen[0]} at {new.speed_mps:.1f} m/s"
    goal = _goal_at_end_of(track, scene, ego)
    if goal is None:
        return changes, what
    what += f", its goal where that car's recording ends, on lanelet {goal.lanelet_id}"
    return replace(changes, goal=goal), what


def _fits(scene: Scene, changes: Changes, track: Track, step: int) -> bool:
    key = track.obstacle_id
    there = track.index_at(step) is not None and track.last_step > step and key in scene.matches
    return track.kind == "car" and there and key not in changes.removed


def _goal_at_end_of(track: Track, scene: Scene, ego: Ego) -> GoalChange | None:
    """The last recorded place of a car as the goal; None where the file's goal has no place.

    The goal's time and speed intervals are widened to those of the car there.
    """
    if not goal_center_lanelets(scene.network, scene.loaded.problem(ego.problem_id)):
        return None
    state = goal_states(scene, ego)[0]
    time = getattr(state, "time_step", track.last_step)
    first, last = int(getattr(time, "start", time)), int(getattr(time, "end", time))
    asked, there = kept_speeds(scene, ego), max(float(track.speeds_mps[-1]), 0.0)
    keeps_speeds = asked is None or asked[0] <= there <= asked[1]
    return GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=scene.matches[track.obstacle_id].lanelets[-1],
        center=track.positions[-1],
        heading_rad=float(track.headings_rad[-1]),
        size_m=None,
        steps=(min(first, track.last_step), max(last, track.last_step)),
        speed_mps=None if asked is None or keeps_speeds else (min(asked[0], there), max(asked[1], there)),
    )


def _started(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    speed = ego.speed_mps if edit.speed is None else parse_quantity(edit.speed, "m/s")
    if not 0.0 <= speed <= LARGEST_SPEED_MPS:
        raise InvalidRequest(
            f"the ego does not drive {edit.speed}",
            valid=[f"0 … {LARGEST_SPEED_MPS:g} m/s"],
            next_step="choose another speed",
        )
    if edit.at is None:
        return replace(changes, ego=replace(ego, speed_mps=speed)), f"the ego starts at {speed:.1f} m/s"
    place = first_place(edit, scene, changes, EGO_SIZE_M[0])
    _check_free(edit, scene, changes, place, ego)
    position, heading = place.pose(scene)
    new = Ego(ego.problem_id, ego.step, position, heading, speed, (place.lanelet_id,))
    what = f"the ego starts on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {speed:.1f} m/s"
    return replace(changes, ego=new), what


def _check_free(edit: Edit, scene: Scene, changes: Changes, place: Place, ego: Ego) -> None:
    """The former ego is in the way only where it stays as traffic."""
    others = scene if edit.former_ego == "traffic" else replace(scene, ego=None)
    places = OccupiedPlaces.at(others, ego.step, changes)
    occupant = places.occupant(place, EGO_SIZE_M)
    if occupant is not None:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m is taken by {occupant}",
            reason=PLACE_TAKEN,
            valid=places.free_places(place, EGO_SIZE_M),
            next_step="choose a free place",
        )


def _former(scene: Scene, changes: Changes, ego: Ego) -> DrivePlan:
    """The former ego as a car that drives to the former goal, or straight on."""
    if not ego.lanelets:
        raise NotPossible("the former ego stands on no lanelet", valid=["former_ego=vanish"], next_step=_LET_VANISH)
    goals = tuple(key for key in goal_lanelet_ids(scene, changes, ego) if key in scene.layout.table.lanes)
    route = scene.lanelet_graph.shortest_route(ego.lanelets[:1], goals) if goals else None
    edges = scene.edge_graph.route(route or ego.lanelets[:1])
    if edges is None:
        route, edges = None, scene.edge_graph.route(ego.lanelets[:1])
    if edges is None:
        raise NotPossible(
            "the former ego's way leaves the lanelet graph", valid=["former_ego=vanish"], next_step=_LET_VANISH
        )
    lanelets, car = route or ego.lanelets[:1], vehicle_classes()["car"]
    start = Track(
        obstacle_id=changes.next_id,
        kind=car.commonroad_type,
        length_m=EGO_SIZE_M[0],
        width_m=EGO_SIZE_M[1],
        first_step=ego.step,
        positions=np.asarray(ego.position)[None],
        headings_rad=np.array([ego.heading_rad]),
        speeds_mps=np.array([ego.speed_mps]),
    )
    return DrivePlan(
        start=start,
        cause="added",
        from_step=ego.step,
        lanelets=lanelets,
        edges=scene.edge_graph.extended(edges, lanelets[-1]),
        targets=frozenset(goals) if route else frozenset(),
        behaviour=usual_behaviour(car),
        vehicle_class=car,
    )
