"""Edit G: move the ego's goal."""

import itertools
import math
from dataclasses import replace
from typing import Any

from plannerforge.engine.edits.changes import Changes, EditStep, GoalChange
from plannerforge.engine.edits.lanelet_targets import reach, reachable_lanelets, target_lanelets
from plannerforge.engine.edits.placing import Place
from plannerforge.engine.edits.scene import Ego, Scene
from plannerforge.engine.edits.turn_speed import first_bend_too_tight
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.network.positions import station_m
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.grammar import parse_interval
from plannerforge.schemas.modification import Edit

LARGEST_ACCELERATION_MPS2 = 11.5
LARGEST_SPEED_MPS = 50.8
"""Limits of CommonRoad's vehicle 2 (BMW 320i): what no car can beat."""

SPEED_TOLERANCE_MPS = 1.0
LARGEST_RECTANGLE_M = 500.0


def set_goal(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the goal of the first planning problem onto a lanelet; what is not named stays as it is.

    A bend that the ego comes to too fast is told, not refused: lanelets of real maps bend where their roads do not.

    Raises:
        InvalidRequest: no lanelet, a bad rectangle or interval.
        NotPossible: no ego, or a goal that it cannot reach, or not in the time named.
    """
    ego = scene.ego
    if ego is None or not ego.lanelets:
        raise NotPossible("the scenario has no ego on a lanelet, so there is no goal to set")
    if not edit.to:
        near = reachable_lanelets(scene, ego.lanelets)
        raise InvalidRequest("set_goal needs a lanelet in 'to'", valid=near, next_step="name one that the ego reaches")
    way = reach(scene, _starts(scene, ego), target_lanelets(edit.to, scene, changes), "the ego")
    lane = scene.layout.table.lanes[way[-1]]
    place = Place(way[-1], station_m(edit.position or "final", way[-1], lane.length_m))
    distance = _distance(scene, ego, way, place)
    goal = GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=place.lanelet_id,
        center=place.pose(scene)[0],
        heading_rad=place.pose(scene)[1],
        size_m=_size(edit.rectangle_m),
        steps=_steps(edit, scene, ego, distance),
        speed_mps=_speeds(edit.goal_speed),
    )
    what = f"goal on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {distance:.1f} m ahead of the ego"
    needed = _needed_speed(scene, ego, goal, distance)
    hurry = "" if needed is None else f", which takes {needed:.1f} m/s on average to reach in time"
    bend = first_bend_too_tight(scene, way, ego.position, ego.speed_mps)
    warning = "" if bend is None else f"; the ego {bend}"
    return EditStep(replace(changes, goal=goal), (), what + hurry + warning)


def _starts(scene: Scene, ego: Ego) -> tuple[int, ...]:
    """The lanelets that the ego stands on; the nearest one where it stands on none."""
    under = set(scene.network.find_lanelet_by_position([ego.position])[0])
    return tuple(key for key in ego.lanelets if key in under) or ego.lanelets[:1]


def _distance(scene: Scene, ego: Ego, way: tuple[int, ...], place: Place) -> float:
    """Distance in m along the way; a change to the lane beside covers no distance of its own."""
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    total = -project(lanes[way[0]].center, ego.position)[0] + place.station_m
    for current, following in itertools.pairwise(way):
        total += lanes[current].length_m if following in successors[current] else 0.0
    if total < 0.0:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m lies {-total:.1f} m behind the ego",
            next_step="choose a later position or a lanelet ahead",
        )
    return total


def _size(rectangle_m: list[float] | None) -> tuple[float, float] | None:
    if rectangle_m is None:
        return None
    if len(rectangle_m) != 2 or not all(0.0 < side <= LARGEST_RECTANGLE_M for side in rectangle_m):
        raise InvalidRequest(
            f"rectangle_m={rectangle_m} is no goal region", valid=["[length, width] in m, both above 0"]
        )
    return rectangle_m[0], rectangle_m[1]


def _steps(edit: Edit, scene: Scene, ego: Ego, distance_m: float) -> tuple[int, int] | None:
    """First and last step of the goal; None keeps the one there is. A problem without any gets the whole scenario."""
    if edit.goal_time is None and not _goal_states(scene, ego):
        _check_in_reach(scene, ego, distance_m, scene.last_step)
        return ego.step, scene.last_step
    if edit.goal_time is None:
        kept = _kept_last_step(scene, ego)
        if kept is not None:
            _check_in_reach(scene, ego, distance_m, kept)
        return None
    interval = parse_interval(edit.goal_time, "s", step_s=scene.step_s)
    last = scene.last_step if interval.high is None else math.floor(interval.high / scene.step_s + 1e-6)
    first = math.ceil((interval.low or 0.0) / scene.step_s - 1e-6)
    if interval.exact:
        first = last = round((interval.high or 0.0) / scene.step_s)
    if not 0 <= first <= last or last <= ego.step:
        raise InvalidRequest(f"goal_time '{edit.goal_time}' does not lie after the start", valid=["'8..12s'", "'<=9s'"])
    _check_in_reach(scene, ego, distance_m, last)
    return first, last


def _check_in_reach(scene: Scene, ego: Ego, distance_m: float, last_step: int) -> None:
    """Refuse a goal that no car reaches by a step.

    Raises:
        NotPossible: naming the shortest time.
    """
    available = max(last_step - ego.step, 0) * scene.step_s
    farthest = min(
        ego.speed_mps * available + LARGEST_ACCELERATION_MPS2 * available**2 / 2, LARGEST_SPEED_MPS * available
    )
    if distance_m > farthest:
        raise NotPossible(
            f"{distance_m:.1f} m within {available:.1f} s is out of reach of any car from {ego.speed_mps:.1f} m/s",
            valid=[f"goal_time of at least {_shortest_time(ego.speed_mps, distance_m):.1f} s"],
        )


def _needed_speed(scene: Scene, ego: Ego, goal: GoalChange, distance_m: float) -> float | None:
    """Mean speed in m/s with which the ego gets there by the end of the goal's time; None for goals without a time."""
    last = goal.steps[1] if goal.steps else _kept_last_step(scene, ego)
    return None if last is None or last <= ego.step else distance_m / ((last - ego.step) * scene.step_s)


def _kept_last_step(scene: Scene, ego: Ego) -> int | None:
    time = getattr(next(iter(_goal_states(scene, ego)), None), "time_step", None)
    return None if time is None else int(getattr(time, "end", time))


def _goal_states(scene: Scene, ego: Ego) -> list[Any]:
    return list(scene.loaded.problem(ego.problem_id).goal.state_list)


def _shortest_time(speed_mps: float, distance_m: float) -> float:
    root = math.sqrt(speed_mps**2 + 2 * LARGEST_ACCELERATION_MPS2 * distance_m)
    return max((root - speed_mps) / LARGEST_ACCELERATION_MPS2, distance_m / LARGEST_SPEED_MPS)


def _speeds(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    interval = parse_interval(text, "m/s")
    slack = SPEED_TOLERANCE_MPS if interval.exact else 0.0
    low = max((interval.low or 0.0) - slack, 0.0)
    high = (LARGEST_SPEED_MPS if interval.high is None else interval.high) + slack
    if high > LARGEST_SPEED_MPS + SPEED_TOLERANCE_MPS or high <= low:
        raise InvalidRequest(f"goal_speed '{text}' is no speed of a car", valid=[f"0 … {LARGEST_SPEED_MPS} m/s"])
    return low, high
