"""Whether the ego can meet a goal: be on it within its time window, at a speed of its interval."""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plannerforge.engine.edits.car_limits import LARGEST_SPEED_MPS, can_be_there, latest_passing_s, least_time_s
from plannerforge.engine.edits.changes import GoalChange
from plannerforge.engine.edits.scene import Ego, Scene
from plannerforge.engine.edits.state_elements import USUAL_GOAL_SIZE_M
from plannerforge.engine.geometry.polyline import point_at, project
from plannerforge.engine.scenarios.ego_route import goal_lanelets
from plannerforge.engine.scenarios.tracks import center_of, size_of
from plannerforge.schemas.errors import NotPossible

TIMES, SPEEDS, SPEED_STEP_MPS = 101, 41, 0.1
SLACK_M = 2.0
"""No car drives exactly along the middles of lanelets, which is how distances are measured."""

LONGEST_S = 60.0
"""A car without a time to keep has had time for every speed until then."""


@dataclass(frozen=True)
class GoalTask:
    """What a goal asks: to be ``ahead_m`` ± ``half_m`` along the way in a time window and a speed interval.

    The window counts in s from the ego's start, ``start_s``; None: at any time, at any speed.
    """

    ahead_m: float
    half_m: float
    start_s: float
    window_s: tuple[float, float] | None
    speeds_mps: tuple[float, float] | None

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Where the goal begins and ends along the way, at least and at most."""
        return self.ahead_m - self.half_m - SLACK_M, self.ahead_m + self.half_m + SLACK_M

    def __str__(self) -> str:
        """The time window (counted from the scenario's start) and the speed interval in words."""
        time, speed = "at any time", "at any speed"
        if self.window_s is not None:
            time = f"from {self.start_s + self.window_s[0]:.1f} to {self.start_s + self.window_s[1]:.1f} s"
        if self.speeds_mps is not None:
            speed = f"at {self.speeds_mps[0]:.1f} to {self.speeds_mps[1]:.1f} m/s"
        return f"{time}, {speed}"


def goal_task(scene: Scene, ego: Ego, goal: GoalChange, ahead_m: float) -> GoalTask:
    """What a moved goal asks of the ego; what an edit does not name is what the problem's goal asks."""
    steps, speeds = goal.steps or kept_steps(scene, ego), goal.speed_mps or kept_speeds(scene, ego)
    window = None if steps is None else (max(steps[0] - ego.step, 0), max(steps[1] - ego.step, 0))
    return GoalTask(
        ahead_m=ahead_m,
        half_m=_length_m(scene, ego, goal) / 2,
        start_s=ego.step * scene.step_s,
        window_s=None if window is None else (window[0] * scene.step_s, window[1] * scene.step_s),
        speeds_mps=speeds,
    )


def check_task(scene: Scene, ego: Ego, goal: GoalChange, task: GoalTask) -> None:
    """Refuse a goal that no car meets from the ego's start.

    Raises:
        NotPossible: with the times or speeds at which a car can be there.
    """
    speed = max(ego.speed_mps, 0.0)
    nearest, farthest = task.bounds_m
    comes_back = _comes_back(scene, goal.lanelet_id)
    if farthest < 0.0 and not comes_back:
        raise NotPossible(
            f"the goal lies {-task.ahead_m:.1f} m behind the ego",
            next_step="choose a later position or a lanelet ahead",
        )
    if task.window_s is not None:
        least, latest = least_time_s(speed, nearest), latest_passing_s(speed, farthest)
        if least > task.window_s[1] + 1e-9:
            raise NotPossible(
                f"{task.ahead_m:.1f} m within {task.window_s[1]:.1f} s is out of reach of any car from {speed:.1f} m/s",
                valid=[f"goal_time of at least {math.ceil((task.start_s + least) * 10) / 10:.1f} s"],
                next_step="name a later goal_time, or choose a nearer place",
            )
        if latest < task.window_s[0] - 1e-9 and not comes_back:
            raise NotPossible(
                f"the goal {task.ahead_m:.1f} m ahead is one {task}, and from {speed:.1f} m/s any car has passed it by "
                f"{task.start_s + latest:.1f} s, however hard it brakes",
                valid=[f"goal_time that begins by {math.floor((task.start_s + latest) * 10) / 10:.1f} s"],
                next_step="let the time begin earlier, or choose a place farther ahead",
            )
    if task.speeds_mps is not None:
        _check_speeds(task, speed, math.inf if comes_back else farthest)


def pace_words(task: GoalTask, speed_mps: float, recording_end_s: float) -> str:
    """How fast the ego has to be on average, after a semicolon; empty for a goal at any time.

    Where the goal's time goes on after the recording's end, in s from the scenario's start, that is told too: later
    there is nobody around. A recording without motion has no end.
    """
    if task.window_s is None or task.window_s[1] <= 0.0:
        return ""
    first_s, last_s = task.window_s
    pace = f"; to be there in time takes {max(task.ahead_m, 0.0) / last_s:.1f} m/s on average"
    left_s = recording_end_s - task.start_s
    if not 0.0 < left_s < last_s:
        return pace
    if first_s <= left_s and least_time_s(max(speed_mps, 0.0), task.bounds_m[0]) <= left_s:
        return f"{pace}, by the recording's end at {recording_end_s:.1f} s {max(task.ahead_m, 0.0) / left_s:.1f} m/s"
    return f"{pace}; the recording ends earlier, at {recording_end_s:.1f} s"


def distance_along(scene: Scene, ego: Ego, way: tuple[int, ...], station_m: float) -> float:
    """Distance in m along a way to an arc length of its last lanelet; a change to the lane beside covers none."""
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    here_m, total_m = project(lanes[way[0]].center, ego.position)[0], 0.0
    for current, following in itertools.pairwise(way):
        if following in successors[current]:
            total_m, here_m = total_m + lanes[current].length_m - here_m, 0.0
        else:
            here_m = project(lanes[following].center, point_at(lanes[current].center, here_m)[0])[0]
    return total_m + station_m - here_m


def kept_steps(scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """First and last step of the goal that the file has; None where it has none with a time."""
    found = _ends(_kept(scene, ego, "time_step"))
    return None if found is None else (int(found[0]), int(found[1]))


def kept_speeds(scene: Scene, ego: Ego) -> tuple[float, float] | None:
    """Speed interval in m/s of the goal that the file has; None where any speed will do."""
    return _ends(_kept(scene, ego, "velocity"))


def kept_goal(scene: Scene, ego: Ego) -> GoalChange | None:
    """The goal that the file has, where it is a single one with a place on a lanelet of its own; else None."""
    states, lanelets = goal_states(scene, ego), goal_lanelets(scene.network, scene.loaded.problem(ego.problem_id))
    shape = getattr(states[0], "position", None) if len(states) == 1 else None
    if shape is None or hasattr(shape, "shapes"):
        return None
    center = np.asarray(center_of(shape), dtype=float)
    on = sorted(set(scene.network.find_lanelet_by_position([center])[0]) & set(lanelets) & {*scene.layout.table.lanes})
    if not on:
        return None
    longest = max(size_of(shape))
    return GoalChange(ego.problem_id, int(on[0]), center, 0.0, (longest, longest), None, None)


def goal_states(scene: Scene, ego: Ego) -> list[Any]:
    """The goal states of the ego's planning problem."""
    return list(scene.loaded.problem(ego.problem_id).goal.state_list)


def _check_speeds(task: GoalTask, speed_mps: float, farthest_m: float) -> None:
    low, high = task.speeds_mps or (0.0, LARGEST_SPEED_MPS)
    times = np.linspace(*(task.window_s or (0.0, LONGEST_S)), TIMES)
    bounds = task.bounds_m[0], farthest_m
    wanted = np.append(np.linspace(low, high, SPEEDS), np.clip(speed_mps, low, high))
    if can_be_there(speed_mps, bounds, times, wanted).any():
        return
    every = np.arange(0.0, LARGEST_SPEED_MPS, SPEED_STEP_MPS)
    possible = every[can_be_there(speed_mps, bounds, times, every).any(axis=0)]
    raise NotPossible(
        f"no car that starts at {speed_mps:.1f} m/s is {task.ahead_m:.1f} m ahead {task}",
        valid=[f"goal_speed '{possible[0]:.1f}..{possible[-1]:.1f}m/s'"] if len(possible) else [],
        next_step="choose another goal_speed, a place farther ahead or more time",
    )


def _comes_back(scene: Scene, lanelet_id: int) -> bool:
    """Whether a way leads from a lanelet back to it, so that who has passed a place on it can come there again."""
    onward = scene.layout.table.successors[lanelet_id]
    return bool(onward) and scene.lanelet_graph.shortest_route(onward, (lanelet_id,)) is not None


def _length_m(scene: Scene, ego: Ego, goal: GoalChange) -> float:
    """Length of the goal region: as named, as the file's rectangle, or the usual one."""
    kept = _kept(scene, ego, "position")
    return float(goal.size_m[0] if goal.size_m else getattr(kept, "length", USUAL_GOAL_SIZE_M[0]))


def _kept(scene: Scene, ego: Ego, name: str) -> Any:
    return getattr(next(iter(goal_states(scene, ego)), None), name, None)


def _ends(value: Any) -> tuple[float, float] | None:
    """Both ends of an interval, or a value as both; None for None."""
    return None if value is None else (float(getattr(value, "start", value)), float(getattr(value, "end", value)))
