"""How fast the ego should drive to be at the goal in time."""

import numpy as np

from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.planners.goal import Goal
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reference_path import ReferencePath

SPEED_BAND_MPS = 5.0
MAXIMUM_SPEED_MPS = 50.0


class DesiredSpeed:
    """Distance to the goal's middle over the time to the middle of its window, within 5 m/s of the present speed.

    Inside the goal it is the middle of the goal's speed interval; the present speed where nothing else is known (a
    goal without a place or speed). This is the rule of the Frenetix reference loop, with one difference: inside a goal
    without a speed interval the reference keeps the present speed and so drives out of it before its time; here the
    ego goes on aiming at the goal's middle, and waits there. The goal is to be one goal state, see :mod:`.aim`.
    """

    def __init__(self, goal: Goal, reference: ReferencePath, step_s: float) -> None:
        self._goal, self._reference, self._step_s = goal, reference, step_s
        stations = goal.stations_on(reference.points) if goal.has_position else None
        self._goal_station_m = None if stations is None else (stations[0] + stations[1]) / 2
        self._middle_step = (goal.windows[0].first + goal.windows[0].last) // 2

    def at(self, ego: EgoState) -> float:
        """The desired speed in m/s."""
        wanted = self._wanted(ego)
        low, high = max(ego.speed_mps - SPEED_BAND_MPS, 0.0), min(ego.speed_mps + SPEED_BAND_MPS, MAXIMUM_SPEED_MPS)
        return float(np.clip(wanted, min(low, high), high))

    def average_to_goal(self, ego: EgoState) -> float | None:
        """Mean speed that brings the ego to the goal's middle in the time left; None without a place or time."""
        if self._goal_station_m is None:
            return None
        if self._goal.holds(ego.position):
            return self._goal.speed_mps
        time_left_s = (self._goal.last_step - ego.step) * self._step_s
        if time_left_s <= 0:
            return None
        return max((self._goal_station_m - project(self._reference.points, ego.position)[0]) / time_left_s, 0.0)

    def _wanted(self, ego: EgoState) -> float:
        otherwise = ego.speed_mps if self._goal.speed_mps is None else self._goal.speed_mps
        if self._goal_station_m is None:
            return otherwise if self._goal.has_position else ego.speed_mps
        if self._goal.holds(ego.position) and self._goal.speed_mps is not None:
            return self._goal.speed_mps
        time_left_s = (self._middle_step - ego.step) * self._step_s
        if time_left_s <= 0:
            return otherwise
        return (self._goal_station_m - project(self._reference.points, ego.position)[0]) / time_left_s
