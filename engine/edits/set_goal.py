"""Edit G: move the ego's goal."""

import math
from dataclasses import replace

from plannerforge.engine.edits.car_limits import LARGEST_SPEED_MPS
from plannerforge.engine.edits.changes import Changes, EditStep, GoalChange
from plannerforge.engine.edits.goal_reach import (
    check_task,
    distance_along,
    goal_states,
    goal_task,
    kept_steps,
    pace_words,
)
from plannerforge.engine.edits.lanelet_targets import reach, reachable_lanelets, target_lanelets
from plannerforge.engine.edits.placing import Place
from plannerforge.engine.edits.scene import Ego, Scene
from plannerforge.engine.edits.turn_speed import first_bend_too_tight
from plannerforge.engine.network.positions import station_m
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.grammar import parse_interval
from plannerforge.schemas.modification import Edit

SPEED_TOLERANCE_MPS = 1.0
LARGEST_RECTANGLE_M = 500.0


def set_goal(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the goal of the first planning problem onto a lanelet; what is not named stays as it is.

    A bend that the ego comes to too fast is told, not refused: lanelets of real maps bend where their roads do not.

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
    way = reach(scene, starts, target_lanelets(edit.to, scene, changes), "the ego")
    lane = scene.layout.table.lanes[way[-1]]
    place = Place(way[-1], station_m(edit.position or "final", way[-1], lane.length_m))
    distance = distance_along(scene, ego, way, place.station_m)
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
    task = goal_task(scene, ego, goal, distance)
    check_task(scene, ego, goal, task)
    what = f"goal on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {distance:.1f} m ahead of the ego, {task}"
    hurry = pace_words(task, ego.speed_mps, scene.last_step * scene.step_s)
    bend = first_bend_too_tight(scene, way, ego.position, ego.speed_mps)
    warning = "" if bend is None else f"; the ego {bend}"
    return EditStep(replace(changes, goal=goal), (), what + hurry + warning)


def _starts(scene: Scene, ego: Ego) -> tuple[int, ...]:
    """The lanelets that the ego stands on; the nearest one where it stands on none."""
    under = set(scene.network.find_lanelet_by_position([ego.position])[0])
    return tuple(key for key in ego.lanelets if key in under) or ego.lanelets[:1]


def _size(rectangle_m: list[float] | None) -> tuple[float, float] | None:
    if rectangle_m is None:
        return None
    if len(rectangle_m) != 2 or not all(0.0 < side <= LARGEST_RECTANGLE_M for side in rectangle_m):
        raise InvalidRequest(
            f"rectangle_m={rectangle_m} is no goal region",
            valid=[f"[length, width] in m, both above 0 and at most {LARGEST_RECTANGLE_M:g}"],
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
    slack = SPEED_TOLERANCE_MPS if interval.exact else 0.0
    low = max((interval.low or 0.0) - slack, 0.0)
    high = (LARGEST_SPEED_MPS if interval.high is None else interval.high) + slack
    if high > LARGEST_SPEED_MPS + SPEED_TOLERANCE_MPS or high <= low:
        raise InvalidRequest(
            f"goal_speed '{text}' is no speed of a car",
            valid=[f"0 … {LARGEST_SPEED_MPS} m/s"],
            next_step="choose a speed or an interval within it, as '8..12m/s'",
        )
    return low, high
