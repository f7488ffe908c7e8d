"""Whether the ego can meet a goal: be on it within its time window, at a speed of its interval.

No planner is asked: a goal is refused only where no car could meet it, by the limits of CommonRoad's vehicle 2 along
the lanelets' middles. Distances are in m along lanelets, times in s from the ego's start where nothing else is said.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...schemas.errors import NotPossible
from ..commonroad import center_of, size_of
from ..geometry import point_at, project
from ..scene import Ego, Scene, goal_center_lanelets
from ..vehicles import LARGEST_SPEED_MPS, can_be_there, latest_passing_s, least_time_s
from .changes import Changes, GoalChange
from .writing import USUAL_GOAL_SIZE_M

_TIMES, _SPEEDS, _SPEED_STEP_MPS = 101, 41, 0.1
"""How finely a goal's time window and speed interval are tried, and the speeds that a refusal names (chosen)."""
_SLACK_M = 2.0
"""No car drives exactly along the middles of lanelets, which is how distances are measured (chosen)."""
_LONGEST_S = 60.0
"""A car without a time to keep has had time for every speed until then."""
_AFTER_START = "add a set_goal edit after set_ego, or choose another start"


@dataclass(frozen=True)
class GoalTask:
    """What a goal asks: to be ``ahead_m`` ± ``half_m`` along the route in a time window and a speed interval.

    The window counts in s from the ego's start, which is ``start_s`` after the scenario's; None: at any time, at any
    speed. ``speed_mps``: the ego's at its start. ``comes_back``: a route leads from the goal back to it, so that the
    ego may pass it first.
    """

    ahead_m: float
    half_m: float
    start_s: float
    window_s: tuple[float, float] | None
    speeds_mps: tuple[float, float] | None
    speed_mps: float
    comes_back: bool

    @classmethod
    def of(cls, scene: Scene, ego: Ego, goal: GoalChange, ahead_m: float) -> "GoalTask":
        """The task of a goal that an edit moves; what the edit does not name is what the file's goal asks."""
        steps, speeds = goal.steps or kept_steps(scene, ego), goal.speed_mps or kept_speeds(scene, ego)
        window = None if steps is None else (max(steps[0] - ego.step, 0), max(steps[1] - ego.step, 0))
        onward = scene.layout.table.successors[goal.lanelet_id]
        return cls(
            ahead_m=ahead_m,
            half_m=_length_m(scene, ego, goal) / 2,
            start_s=ego.step * scene.step_s,
            window_s=None if window is None else (window[0] * scene.step_s, window[1] * scene.step_s),
            speeds_mps=speeds,
            speed_mps=max(ego.speed_mps, 0.0),
            comes_back=bool(onward) and scene.lanelet_graph.shortest_route(onward, (goal.lanelet_id,)) is not None,
        )

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Where the goal begins and ends along the route, at least and at most."""
        return self.ahead_m - self.half_m - _SLACK_M, self.ahead_m + self.half_m + _SLACK_M

    def __str__(self) -> str:
        """The time window (counted from the scenario's start) and the speed interval in words."""
        time, speed = "at any time", "at any speed"
        if self.window_s is not None:
            time = f"from {self.start_s + self.window_s[0]:.1f} to {self.start_s + self.window_s[1]:.1f} s"
        if self.speeds_mps is not None:
            speed = f"at {self.speeds_mps[0]:.1f} to {self.speeds_mps[1]:.1f} m/s"
        return f"{time}, {speed}"

    def check(self) -> None:
        """Refuse a goal that no car meets from the ego's start.

        Raises:
            NotPossible: with the times or speeds at which a car can be there.
        """
        nearest, farthest = self.bounds_m
        if farthest < 0.0 and not self.comes_back:
            raise NotPossible(
                f"the goal lies {-self.ahead_m:.1f} m behind the ego",
                next_step="choose a later position or a lanelet ahead",
            )
        if self.window_s is not None:
            least, latest = least_time_s(self.speed_mps, nearest), latest_passing_s(self.speed_mps, farthest)
            if least > self.window_s[1] + 1e-9:
                raise NotPossible(
                    f"{self.ahead_m:.1f} m within {self.window_s[1]:.1f} s is out of reach of any car from "
                    f"{self.speed_mps:.1f} m/s",
                    valid=[f"goal_time of at least {math.ceil((self.start_s + least) * 10) / 10:.1f} s"],
                    next_step="name a later goal_time, or choose a nearer place",
                )
            if latest < self.window_s[0] - 1e-9 and not self.comes_back:
                raise NotPossible(
                    f"the goal {self.ahead_m:.1f} m ahead is one {self}, and from {self.speed_mps:.1f} m/s any car has "
                    f"passed it by {self.start_s + latest:.1f} s, however hard it brakes",
                    valid=[f"goal_time that begins by {math.floor((self.start_s + latest) * 10) / 10:.1f} s"],
                    next_step="let the time begin earlier, or choose a place farther ahead",
                )
        if self.speeds_mps is not None:
            self._check_speeds(*self.speeds_mps)

    def _check_speeds(self, low: float, high: float) -> None:
        times = np.linspace(*(self.window_s or (0.0, _LONGEST_S)), _TIMES)
        bounds = self.bounds_m[0], math.inf if self.comes_back else self.bounds_m[1]
        wanted = np.append(np.linspace(low, high, _SPEEDS), np.clip(self.speed_mps, low, high))
        if can_be_there(self.speed_mps, bounds, times, wanted).any():
            return
        every = np.arange(0.0, LARGEST_SPEED_MPS, _SPEED_STEP_MPS)
        possible = every[can_be_there(self.speed_mps, bounds, times, every).any(axis=0)]
        raise NotPossible(
            f"no car that starts at {self.speed_mps:.1f} m/s is {self.ahead_m:.1f} m ahead {self}",
            valid=[f"goal_speed '{possible[0]:.1f}..{possible[-1]:.1f}m/s'"] if len(possible) else [],
            next_step="choose another goal_speed, a place farther ahead or more time",
        )

    def pace_note(self, recording_end_s: float) -> str:
        """How fast the ego has to be on average, after a semicolon; empty for a goal at any time.

        Where the goal's time goes on after the recording's end, in s from the scenario's start, that is stated too:
        later there is no recorded traffic. A recording without motion has no end.
        """
        if self.window_s is None or self.window_s[1] <= 0.0:
            return ""
        first_s, last_s = self.window_s
        pace = f"; to be there in time takes {max(self.ahead_m, 0.0) / last_s:.1f} m/s on average"
        left_s = recording_end_s - self.start_s
        if not 0.0 < left_s < last_s:
            return pace
        if first_s <= left_s and least_time_s(self.speed_mps, self.bounds_m[0]) <= left_s:
            by_then_mps = max(self.ahead_m, 0.0) / left_s
            return f"{pace}, by the recording's end at {recording_end_s:.1f} s {by_then_mps:.1f} m/s"
        return f"{pace}; the recording ends earlier, at {recording_end_s:.1f} s"


def check_goal(scene: Scene, changes: Changes) -> None:
    """Refuse a new start of the ego from which its goal cannot be reached, or not in its time at its speed.

    Raises:
        NotPossible: the goal lies where no lanelet leads from the start, or no car meets it from there.
    """
    ego = changes.ego
    if ego is None:
        return
    goals = goal_lanelet_ids(scene, changes, ego)
    if goals and scene.lanelet_graph.shortest_route(ego.lanelets, goals) is None:
        raise NotPossible(
            f"the goal on lanelet {', '.join(map(str, goals))} cannot be reached from the ego's new start on lanelet "
            f"{', '.join(map(str, ego.lanelets))}",
            next_step=_AFTER_START,
        )
    goal = changes.goal or _kept_goal(scene, ego)
    route = None if goal is None else scene.lanelet_graph.shortest_route(ego.lanelets, (goal.lanelet_id,))
    if goal is None or route is None:
        return
    station = project(scene.layout.table.lanes[goal.lanelet_id].center, goal.center)[0]
    try:
        GoalTask.of(scene, ego, goal, distance_along(scene, ego, route, station)).check()
    except NotPossible as error:
        message = f"the goal on lanelet {goal.lanelet_id} cannot be met from the ego's new start: {error.message}"
        raise NotPossible(message, valid=error.valid, next_step=_AFTER_START) from error


def distance_along(scene: Scene, ego: Ego, route: tuple[int, ...], station_m: float) -> float:
    """Distance along a route to an arc length of its last lanelet; a change to the lane beside covers none."""
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    here_m, total_m = project(lanes[route[0]].center, ego.position)[0], 0.0
    for current, following in itertools.pairwise(route):
        if following in successors[current]:
            total_m, here_m = total_m + lanes[current].length_m - here_m, 0.0
        else:
            here_m = project(lanes[following].center, point_at(lanes[current].center, here_m)[0])[0]
    return total_m + station_m - here_m


def goal_lanelet_ids(scene: Scene, changes: Changes, ego: Ego) -> tuple[int, ...]:
    """The lanelets of the goal, as edits moved it or as the file states it; empty where it has none."""
    if changes.goal:
        return (changes.goal.lanelet_id,)
    return tuple(goal_center_lanelets(scene.network, scene.loaded.problem(ego.problem_id)))


def kept_steps(scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """First and last step of the goal that the file has; None where it has none with a time."""
    ends = _ends(_kept(scene, ego, "time_step"))
    return None if ends is None else (int(ends[0]), int(ends[1]))


def kept_speeds(scene: Scene, ego: Ego) -> tuple[float, float] | None:
    """Speed interval in m/s of the goal that the file has; None where any speed will do."""
    return _ends(_kept(scene, ego, "velocity"))


def goal_states(scene: Scene, ego: Ego) -> list[Any]:
    """The goal states of the ego's planning problem."""
    return list(scene.loaded.problem(ego.problem_id).goal.state_list)


def _kept_goal(scene: Scene, ego: Ego) -> GoalChange | None:
    """The goal that the file has, where it is a single one with a place on a lanelet of its own; else None."""
    states = goal_states(scene, ego)
    lanelets = goal_center_lanelets(scene.network, scene.loaded.problem(ego.problem_id))
    shape = getattr(states[0], "position", None) if len(states) == 1 else None
    if shape is None or hasattr(shape, "shapes"):
        return None
    center = np.asarray(center_of(shape), dtype=float)
    on = sorted(set(scene.network.find_lanelet_by_position([center])[0]) & set(lanelets) & {*scene.layout.table.lanes})
    if not on:
        return None
    longest = max(size_of(shape))
    return GoalChange(ego.problem_id, int(on[0]), center, 0.0, (longest, longest), None, None)


def _length_m(scene: Scene, ego: Ego, goal: GoalChange) -> float:
    """Length of the goal region: as named, as the file's rectangle, or the usual one."""
    kept = _kept(scene, ego, "position")
    return float(goal.size_m[0] if goal.size_m else getattr(kept, "length", USUAL_GOAL_SIZE_M[0]))


def _kept(scene: Scene, ego: Ego, name: str) -> Any:
    return getattr(next(iter(goal_states(scene, ego)), None), name, None)


def _ends(value: Any) -> tuple[float, float] | None:
    """Both ends of an interval, or a value as both; None for None."""
    return None if value is None else (float(getattr(value, "start", value)), float(getattr(value, "end", value)))
