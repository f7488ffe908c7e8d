"""A baseline that follows the reference path and keeps the distance of the Intelligent Driver Model.

Longitudinal: Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic
simulations", Physical Review E 62, 2000: acceleration a·[1 − (v/v0)⁴ − (s*/s)²] with the desired gap
s* = s0 + max(0, v·T + v·Δv / (2·√(a·b))). Above the desired speed the free term is that of the improved model (Kesting,
Treiber, Helbing 2010), which never brakes harder than b. Before a curve it also brakes, at no more than b, to the speed
√(a_lateral / curvature) that its lateral acceleration allows there; it brakes harder only if its tyres would slip.

Lateral: ``route_follower.py``.

The planner has no cost terms, does not overtake or evade, and ignores the edge of the road. Stations are arc lengths in
m, by default those of the rear axle's path.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import Lookup, Points, Values, arc_length, wrap_angles
from ..vehicles import HARDEST_BRAKING_MPS2
from .driving.desired_speed import DesiredSpeed, curve_speeds_mps
from .driving.drivability import violated_limit
from .driving.following import follow
from .goal import Goal
from .interface import Observation, Plan, PlanKind, PlanningTask, PredictedObstacle
from .reference_path import ReferencePath
from .route_follower import RearAxlePath, RouteFollower

_EXPONENT = 4.0
"""Exponent of the free term, as in the model's source."""
_GRIP = 0.98
"""Largest usable share of the tyres' friction, since a plan's curvature is known only between points."""
_BRAKING_GRIP, _CURVE_GRIP, _SLIP_SMOOTHING_M = 0.5, 0.75, 0.5
"""Shares of it with which the ego brakes before a curve in which it would slip, and drives through it: 0.9 together.
The curvature that decides is smoothed less than the comfortable one.
"""
_LOOK_AHEAD_S = 1.0
"""An obstacle that will enter the ego's corridor within this time is already a leader, so the ego sees a cut-in at its
start.
"""
_CORRIDOR_MARGIN_M = 0.3
"""The corridor extends beyond both bodies by this on either side (chosen)."""
_LOOKED_BACK_M = 20.0
"""Distance behind the ego at which obstacles on the path still count (chosen: more than the length of a truck)."""
_SAME_PASSAGE_M2 = 1.0
"""Two passages of the path are equally near to an obstacle if their squared distances differ by at most
this (chosen).
"""
_SEARCHED_M = 25.0
"""The path is first searched within this distance of the obstacles (chosen); the result does not depend on it."""
_BETWEEN_POINTS_M = 3.0
"""Added to the width of the corridor, because it is measured from points of the path about a metre apart (chosen)."""
_SMALLEST_GAP_M = 0.1
"""Smaller gaps count as this, so that the interaction stays finite (chosen)."""


@dataclass(frozen=True)
class _OnPath:
    """An obstacle projected onto the path: per step, its rear end, its speed, and whether it is in the corridor."""

    rear_m: Values
    speed_mps: Values
    in_corridor: NDArray[np.bool_]

    def leaders(self, look_ahead: int) -> list[tuple[float, float] | None]:
        """Return, for each step, the obstacle's rear end and speed at the next step at which it is in the corridor.

        The entry is None if the obstacle does not enter the corridor within ``look_ahead`` steps.
        """
        count = len(self.in_corridor)
        entries = np.where(self.in_corridor, np.arange(count), count + look_ahead)
        following = np.minimum.accumulate(entries[::-1])[::-1]
        rears, speeds = self.rear_m.tolist(), self.speed_mps.tolist()
        return [
            (rears[first], speeds[first]) if first <= index + look_ahead else None
            for index, first in enumerate(following.tolist())
        ]


def _first_near(squared_m2: Values) -> NDArray[np.intp]:
    """Return, for each row, the index of the first local minimum that is about as small as the smallest value."""
    is_near = squared_m2 <= squared_m2.min(axis=1, keepdims=True) + _SAME_PASSAGE_M2
    is_near[:, :-1] &= squared_m2[:, 1:] >= squared_m2[:, :-1]
    first: NDArray[np.intp] = np.argmax(is_near, axis=1)
    return first


def _nearest_points(path: Points, begin: int, positions: Points) -> NDArray[np.intp]:
    """Return, for each position (m, 2), the index of the nearest point of its first passage, from an index on.

    Points of the path far from all positions are left out, unless a position is as far from the others.
    """
    low, high = positions.min(axis=0) - _SEARCHED_M, positions.max(axis=0) + _SEARCHED_M
    x, y = path[begin:, 0], path[begin:, 1]
    around = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
    if len(around):
        first, last = begin + int(around[0]), begin + int(around[-1]) + 1
        squared = _squared_distances(path[first:last], positions)
        if float(squared.min(axis=1).max()) + _SAME_PASSAGE_M2 < _SEARCHED_M**2:
            return first + _first_near(squared)
    return begin + _first_near(_squared_distances(path[begin:], positions))


def _squared_distances(path: Points, positions: Points) -> Points:
    """Return the squared distances (m, n) of positions (m, 2) from points (n, 2)."""
    # Coordinate by coordinate, because numpy is slow at reducing axes of two.
    away_x = path[None, :, 0] - positions[:, None, 0]
    away_y = path[None, :, 1] - positions[:, None, 1]
    squared: Points = away_x * away_x + away_y * away_y
    return squared


@dataclass(frozen=True)
class _Way:
    """What does not change along the path: headings of its points, speeds and curvature by station, and the goal."""

    stations_m: Values
    headings_rad: Values
    comfortable_mps: Lookup
    slip_mps: Lookup
    curvature_at: Lookup
    goal_m: tuple[float, float] | None

    @classmethod
    def of(
        cls,
        reference: ReferencePath,
        path: RearAxlePath,
        goal: Goal,
        comfortable: tuple[float, float],
        grip_mps2: float,
    ) -> "_Way":
        """Return the way of a rear axle's path.

        ``comfortable``: lateral acceleration and deceleration.
        """
        along = np.gradient(reference.points, axis=0)
        line = path.stations_m, path.headings_rad
        slipping = curve_speeds_mps(*line, _CURVE_GRIP * grip_mps2, _BRAKING_GRIP * grip_mps2, _SLIP_SMOOTHING_M)
        curvature = np.abs(np.gradient(path.headings_rad, path.stations_m))
        return cls(
            stations_m=arc_length(reference.points),
            headings_rad=np.unwrap(np.arctan2(along[:, 1], along[:, 0])),
            comfortable_mps=Lookup(path.stations_m, curve_speeds_mps(*line, *comfortable)),
            slip_mps=Lookup(path.stations_m, slipping),
            curvature_at=Lookup(path.stations_m, curvature),
            goal_m=goal.stations_on(reference.points, reference.start_m) if goal.has_position else None,
        )


class IntelligentDriver:
    """The Intelligent Driver Model as a planner; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._weights = task.configuration.weights
        self._steps = round(task.configuration.settings.horizon_s / task.step_s)
        self._goal = Goal(task.goal_ahead)
        self._desired_speed = DesiredSpeed.of(task)
        self._route = RouteFollower(task)
        self._path = self._route.path
        comfortable = self._weights["lateral_acceleration_mps2"], self._weights["deceleration_mps2"]
        self._accelerates_mps2 = float(self._weights["acceleration_mps2"])
        self._brakes_mps2 = float(self._weights["deceleration_mps2"])
        self._headway_s, self._least_gap_m = self._weights["time_headway_s"], self._weights["minimum_gap_m"]
        grip = task.vehicle.maximum_acceleration_mps2
        self._grip_squared, self._step_s = (_GRIP * grip) ** 2, task.step_s
        self._way = task.made.get(
            ("way", comfortable, id(task.goal_ahead)),
            lambda: _Way.of(task.reference, self._path, self._goal, comfortable, grip),
            task.goal_ahead,
        )

    def plan(self, observation: Observation) -> Plan:
        """Return one trajectory along the path with the model's acceleration, simulated over the horizon."""
        ego = observation.ego
        place = self._route.place_of(ego)
        if place is None:
            return Plan(None, rejected={"initial_state": 1}, candidates=1)
        travelled, speeds = self._motion(observation, place.station_m)
        driven = place.driven(ego, travelled, speeds, self._task)
        trajectory = driven.trajectory
        before_next_plan = trajectory.until(self._task.configuration.settings.replan_steps + 1)
        limit = violated_limit(before_next_plan, self._task.vehicle, self._task.step_s)
        if limit is not None:
            return Plan(None, rejected={limit: 1}, candidates=1)
        self._route.keep(driven)
        kind: PlanKind = "regular" if speeds.any() else "standstill"
        followed = follow(trajectory, ego, self._task.vehicle, self._task.step_s)
        return Plan(followed.trajectory, candidates=1, kind=kind)

    def _motion(self, observation: Observation, station: float) -> tuple[Values, Values]:
        """Return the distance in m and the speed, per step, of a rear axle that starts at a station."""
        step_s, vehicle = self._task.step_s, self._task.vehicle
        here = self._path.center_station(station)
        others = self._on_path([one for one in observation.obstacles if len(one.positions)], here)
        desired, look_ahead = self._desired_speed.at(observation.ego), round(_LOOK_AHEAD_S / step_s)
        on_way = [other.leaders(look_ahead) for other in others]
        speed, covered = observation.ego.speed_mps, 0.0
        travelled, speeds = [covered], [speed]
        top, half_length = vehicle.maximum_speed_mps, vehicle.length_m / 2
        for i in range(self._steps):
            rear_axle_m = station + covered
            center_m = self._path.center_station(rear_axle_m)
            acceleration = self._free(speed, min(desired, self._allowed(center_m), top))
            leader: tuple[float, float] | None = None
            for other in on_way:
                ahead = other[i] if i < len(other) else None
                if ahead is not None and ahead[0] > center_m and (leader is None or ahead < leader):
                    leader = ahead
            if leader is not None:
                gap_m = leader[0] - center_m - half_length
                acceleration -= self._interaction(speed, gap_m, speed - leader[1])
            acceleration = min(acceleration, self._before_curve(speed, rear_axle_m + speed * step_s))
            grip = self._grip_mps2(speed, rear_axle_m + speed * step_s / 2)
            most = min(grip, vehicle.most_acceleration_mps2(speed))
            acceleration = min(max(acceleration, -min(HARDEST_BRAKING_MPS2, grip)), most)
            following = max(speed + acceleration * step_s, 0.0)
            covered = covered + (speed + following) / 2 * step_s
            speed = following
            travelled.append(covered)
            speeds.append(speed)
        return np.array(travelled), np.array(speeds)

    def _free(self, speed: float, desired: float) -> float:
        a, b = self._accelerates_mps2, self._brakes_mps2
        if speed > desired:
            return -b * (1.0 - float((max(desired, 0.0) / speed) ** (a * _EXPONENT / b)))
        return a * (1.0 - (speed / desired) ** _EXPONENT) if desired > 0 else 0.0

    def _interaction(self, speed: float, gap_m: float, closing_mps: float) -> float:
        a, b = self._accelerates_mps2, self._brakes_mps2
        headway = speed * self._headway_s + speed * closing_mps / (2.0 * math.sqrt(a * b))
        wanted = self._least_gap_m + max(0.0, headway)
        return a * (wanted / max(gap_m, _SMALLEST_GAP_M)) ** 2

    def _before_curve(self, speed: float, following: float) -> float:
        """Return the acceleration that leads to the speed that the curves allow at the next station.

        The ego brakes at most comfortably for a comfortable speed, and as hard as necessary if its tyres would slip.
        """
        comfortable = (self._way.comfortable_mps.at(following) - speed) / self._step_s
        slipping = (self._way.slip_mps.at(following) - speed) / self._step_s
        return min(max(comfortable, -self._brakes_mps2), slipping)

    def _grip_mps2(self, speed: float, station: float) -> float:
        """Return the longitudinal acceleration that the tyres' friction still allows in the curve."""
        curvature = self._way.curvature_at.at(station)
        return math.sqrt(max(self._grip_squared - (speed**2 * curvature) ** 2, 0.0))

    def _allowed(self, station: float) -> float:
        """Return the speed from which comfortable braking reaches the goal's speed at the start of the goal."""
        if self._way.goal_m is None or self._goal.speed_mps is None:
            return math.inf
        left = max(self._way.goal_m[0] - station, 0.0)
        return math.sqrt(self._goal.speed_mps**2 + 2.0 * self._brakes_mps2 * left)

    def _near(self, obstacles: Sequence[PredictedObstacle], path: Points) -> Sequence[PredictedObstacle]:
        """Return the obstacles that may come into the corridor: the others are far from all points of the path.

        An obstacle gets nearer by at most its largest distance from its present position.
        """
        if not obstacles:
            return obstacles
        away = np.sqrt(_squared_distances(path, np.array([one.positions[0] for one in obstacles])).min(axis=1))
        width = self._task.vehicle.width_m
        near = []
        for one, away_m in zip(obstacles, away.tolist(), strict=True):
            moved = one.positions - one.positions[0]
            reach_m = math.sqrt(float((moved[:, 0] * moved[:, 0] + moved[:, 1] * moved[:, 1]).max()))
            room_m = (width + one.length_m + one.width_m) / 2 + _CORRIDOR_MARGIN_M + _BETWEEN_POINTS_M
            if away_m <= reach_m + room_m:
                near.append(one)
        return near

    def _on_path(self, obstacles: Sequence[PredictedObstacle], here_m: float) -> list[_OnPath]:
        """Return the projections onto the nearest points of the path of the obstacles that enter the ego's corridor.

        The path's points are about one metre apart. If the path passes an obstacle more than once, the next passage
        ahead of the ego counts. All obstacles are projected together, because each of them takes little time.
        """
        path, step_s = self._task.reference.points, self._task.step_s
        behind = max(int(np.searchsorted(self._way.stations_m, here_m - _LOOKED_BACK_M)), 0)
        obstacles = self._near(obstacles, path[behind:])
        if not obstacles:
            return []
        counts = [len(obstacle.positions) for obstacle in obstacles]
        positions = np.concatenate([obstacle.positions for obstacle in obstacles])
        nearest = _nearest_points(path, behind, positions)
        heading, offset = self._way.headings_rad[nearest], positions - path[nearest]
        along = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading)
        aside = offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading)
        turned = wrap_angles(np.concatenate([obstacle.headings_rad for obstacle in obstacles]) - heading)
        cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        length = np.repeat([obstacle.length_m for obstacle in obstacles], counts)
        width = np.repeat([obstacle.width_m for obstacle in obstacles], counts)
        rears = self._way.stations_m[nearest] + along
        half_along, half_across = (length * cos + width * sin) / 2, (length * sin + width * cos) / 2
        room = self._task.vehicle.width_m / 2 + half_across + _CORRIDOR_MARGIN_M
        in_corridor = (np.abs(aside) < room) & (nearest > 0) & (nearest < len(path) - 1)
        found, end = [], 0
        for count in counts:
            begin, end = end, end + count
            if in_corridor[begin:end].any():
                stations = rears[begin:end]
                moving = np.gradient(stations, step_s) if count > 1 else np.zeros(1)
                found.append(_OnPath(stations - half_along[begin:end], moving, in_corridor[begin:end]))
        return found
