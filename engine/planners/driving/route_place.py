"""Locates an ego on its reference path, and gives the desired speed of the built-in planners at its position."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry import Points, Values, arc_length, headings, project_along, wrap_angle, wrap_angles
from ..goal import Goal
from ..interface import EgoState, PlanningTask
from .desired_speed import DesiredSpeed, SpeedReason


@dataclass(frozen=True)
class RoutePlace:
    """The position of one ego state: station along the path, lateral offset (left positive), and heading error.

    ``to_goal_m``: distance along the path to the start of the goal, negative beyond it, None for a goal without a
    position.
    ``desired_speed_reason``: the reason for the desired speed.
    """

    station_m: float
    offset_m: float
    heading_error_rad: float
    to_goal_m: float | None
    desired_speed_mps: float
    desired_speed_reason: SpeedReason


class RoutePlaces:
    """The positions of a run's states, which callers request in driving order."""

    def __init__(self, task: PlanningTask) -> None:
        self._path = task.reference.points
        self._stations_m, self._headings_rad = arc_length(self._path), headings(self._path)
        goal = Goal(task.goal_ahead)
        self._start_m, self._follower = task.reference.start_m, task.reference.follower()
        begins = goal.stations_on(self._path, self._start_m) if goal.has_position else None
        self._goal_m = None if begins is None else begins[0]
        self._desired = DesiredSpeed.of(task)

    def at(self, ego: EgoState) -> RoutePlace:
        """Return the position of one state."""
        station_m, offset_m = self._follower.place(ego.position)
        desired_mps, reason = self._desired.explained_at(ego)
        return RoutePlace(
            station_m=station_m,
            offset_m=offset_m,
            heading_error_rad=wrap_angle(ego.heading_rad - float(self._direction(np.array([station_m]))[0])),
            to_goal_m=None if self._goal_m is None else self._goal_m - station_m,
            desired_speed_mps=desired_mps,
            desired_speed_reason=reason,
        )

    def deviations(self, positions: Points, headings_rad: Values) -> tuple[Values, Values]:
        """Return the offsets in m and heading errors in rad of all states of a run, both (n,)."""
        stations, offsets = project_along(self._path, positions, self._start_m)
        return offsets, wrap_angles(headings_rad - self._direction(stations))

    def desired_speeds(self, states: Sequence[EgoState]) -> list[tuple[float, SpeedReason]]:
        """Return the desired speed in m/s at each of the states, with its reason."""
        return [self._desired.explained_at(ego) for ego in states]

    def _direction(self, stations_m: Values) -> Values:
        last = len(self._headings_rad) - 1
        index = np.clip(np.searchsorted(self._stations_m, stations_m, side="right") - 1, 0, last)
        direction: Values = self._headings_rad[index]
        return direction
