"""A baseline: follow the reference path and keep the distance of the Intelligent Driver Model.

Longitudinal: Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic
simulations", Physical Review E 62, 2000: acceleration a·[1 − (v/v0)⁴ − (s*/s)²] with the desired gap
s* = s0 + max(0, v·T + v·Δv / (2·√(a·b))). Above the desired speed the free term is that of the improved model (Kesting,
Treiber, Helbing 2010), which never brakes harder than b. Before a curve it brakes by at most b too, to the speed
√(a_lateral / curvature) that its lateral acceleration allows there; harder only where its tyres would slip otherwise.

Lateral: the centre follows the path and drags the rear axle after it; the offset from that line fades out. In the
kinematic single-track model a vehicle heads where its rear axle moves, so whatever line the rear axle follows can be
driven if its curvature has no steps. A vehicle whose centre moved along a path and headed along it too could not be:
in a curve its rear axle would slide sideways.

It knows no cost terms, neither overtakes nor evades, and does not look at the edge of the road. Stations are arc
lengths in m, by default those of the rear axle's path.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import PathFollower, Points, Values, arc_length, wrap_angle, wrap_angles
from ..vehicles import HARDEST_BRAKING_MPS2, centers, rear_axle, tractrix
from .driving.desired_speed import DesiredSpeed, curve_speeds_mps
from .driving.drivability import violated_limit
from .driving.following import FOLLOWED_WITHIN_M, follow, is_on_plan
from .goal import Goal
from .interface import EgoState, Observation, Plan, PlanKind, PlannedTrajectory, PlanningTask, PredictedObstacle

_EXPONENT = 4.0
"""Of the free term, as in the model's source."""
_GRIP = 0.98
"""Share of the tyres' friction that is used at most: the curvature along a plan is known between points only."""
_BRAKING_GRIP, _CURVE_GRIP, _SLIP_SMOOTHING_M = 0.5, 0.75, 0.5
"""Shares of it with which the ego brakes before a curve in which it would slip, and drives through it: 0.9 together.
The curvature that decides it is smoothed less than the comfortable one."""
_LOOK_AHEAD_S = 1.0
"""An obstacle that will be in the ego's corridor within this time is a leader already, so that a cut-in is seen when it
begins."""
_CORRIDOR_MARGIN_M = 0.3
"""Chosen: the corridor is wider than the two bodies by this on either side."""
_FADE_S, _SHORTEST_FADE_M, _FADE_PER_OFFSET = 4.0, 15.0, 6.0
"""Chosen: an offset fades over the way of 4 s at the ego's speed, at least over 15 m and over six times the offset."""
_STEEPEST_RAD = 1.2
"""Chosen: a curve leaves its path at this angle at most; steeper, its slope by station grows without bound."""
_LEAST_PACE = 0.1
"""Inside a turn the curve is shorter than the path, at most by this factor: a vehicle cannot turn about the centre of a
curve."""
_LOOKED_BACK_M = 20.0
"""Chosen: how far behind the ego others are looked for on the path, more than a truck is long."""
_SAME_PASSAGE_M2 = 1.0
"""Chosen: two passages of the path are equally near to an obstacle if their squared distances differ by no more."""
_SMALLEST_GAP_M = 0.1
"""Chosen: a smaller gap counts as this, so that the interaction stays finite."""


class RearAxlePath:
    """The path of a rear axle whose vehicle's centre follows a path of points (n, 2).

    A cubic spline over its arc length joins it, so that the curvature has no steps. Stations are its own; at
    ``stations_m`` (n,) it heads towards ``headings_rad`` (n,). It follows one axle, whose feet are asked for in the
    order of driving and whose centre begins near the station ``begin_m`` of the path, if that is known.
    """

    def __init__(self, path: Points, behind_center_m: float, begin_m: float | None = None) -> None:
        from scipy.interpolate import CubicSpline

        towards = path[1] - path[0]
        self.headings_rad = tractrix(path, float(np.arctan2(towards[1], towards[0])), behind_center_m)
        towards_center = np.stack([np.cos(self.headings_rad), np.sin(self.headings_rad)], axis=1)
        self._points = path - behind_center_m * towards_center
        self.stations_m, self._center_stations_m = arc_length(self._points), arc_length(path)
        self._end_m = float(self.stations_m[-1])
        begin_m = None if begin_m is None else float(np.interp(begin_m, self._center_stations_m, self.stations_m))
        self._follower = PathFollower(self._points, begin_m)
        self._position = CubicSpline(self.stations_m, self._points)
        self._first, self._second = self._position.derivative(1), self._position.derivative(2)

    def center_station(self, station: float) -> float:
        """The station in m of the centre on the path that it follows."""
        return float(np.interp(station, self.stations_m, self._center_stations_m))

    def foot(self, point: Points) -> float:
        """The station in m nearest to a point (2,)."""
        station = self._follower.place(point)[0]
        for _ in range(6):  # Gauss-Newton from the nearest point of the chords; an error shrinks by offset / radius
            along = self._first(station)
            station += float((point - self._position(station)) @ along) / float(along @ along)
            station = min(max(station, 0.0), self._end_m)
        return station

    def frame(self, stations: Values) -> tuple[Points, Values, Values, Values]:
        """Points (n, 2) and headings (n,) in rad; and how far the spline goes and how much it turns by station."""
        stations = np.clip(stations, 0.0, self._end_m)
        along, bending = self._first(stations), self._second(stations)
        pace = np.linalg.norm(along, axis=1)
        turn = (along[:, 0] * bending[:, 1] - along[:, 1] * bending[:, 0]) / pace**2
        return self._position(stations), np.arctan2(along[:, 1], along[:, 0]), pace, turn


@dataclass(frozen=True)
class _Fade:
    """The offset from a path between two stations: a quintic from an offset and slope to none."""

    begin_m: float
    length_m: float
    offset_m: float
    slope: float

    def at(self, stations: Values) -> tuple[Values, Values]:
        """Offsets in m and their slopes by station."""
        share = np.clip((stations - self.begin_m) / self.length_m, 0.0, 1.0)
        offset = self.offset_m * (1 - share**3 * (10 - 15 * share + 6 * share**2))
        offset = offset + self.slope * self.length_m * (share - share**3 * (6 - 8 * share + 3 * share**2))
        slope = -self.offset_m / self.length_m * 30 * share**2 * (1 - share) ** 2
        return offset, slope + self.slope * (1 - share**2 * (18 - 32 * share + 15 * share**2))


@dataclass(frozen=True)
class RearAxleCurve:
    """A path and the offset from it."""

    path: RearAxlePath
    fade: _Fade

    @classmethod
    def beginning_at(cls, path: RearAxlePath, point: Points, heading_rad: float, fade_m: float) -> "RearAxleCurve":
        """The curve that begins at a point (2,) with a heading and is on the path ``fade_m`` later.

        A large offset fades over a longer distance.
        """
        station = path.foot(point)
        (foot,), (along_rad,), (pace,), (turn,) = path.frame(np.array([station]))
        offset = float((point - foot) @ np.array([-np.sin(along_rad), np.cos(along_rad)]))
        turned = float(np.clip(wrap_angle(heading_rad - float(along_rad)), -_STEEPEST_RAD, _STEEPEST_RAD))
        slope = float(np.tan(turned) * max(pace - offset * turn, _LEAST_PACE))
        return cls(path, _Fade(station, max(fade_m, _SHORTEST_FADE_M, _FADE_PER_OFFSET * abs(offset)), offset, slope))

    def after(self, station: float, travelled_m: Values) -> Values:
        """The stations (n,) after distances (n,) in m along the curve, ascending from 0 at ``station``."""
        stations = station + travelled_m
        for _ in range(3):
            middle = (stations[1:] + stations[:-1]) / 2
            gained = np.diff(travelled_m) / self._motion(middle)[1]
            stations = station + np.concatenate([[0.0], np.cumsum(gained)])
        return stations

    def poses(self, stations: Values) -> tuple[Points, Values]:
        """Points (n, 2) and unwrapped headings (n,) in rad."""
        points, along_rad, _, _ = self.path.frame(stations)
        offset, _ = self.fade.at(stations)
        normal = np.stack([-np.sin(along_rad), np.cos(along_rad)], axis=1)
        return points + offset[:, None] * normal, np.unwrap(along_rad + self._motion(stations)[0])

    def _motion(self, stations: Values) -> tuple[Values, Values]:
        """How far the curve turns off the path in rad, and its length by station."""
        _, _, pace, turn = self.path.frame(stations)
        offset, slope = self.fade.at(stations)
        along = np.maximum(pace - offset * turn, _LEAST_PACE)
        return np.arctan2(slope, along), np.hypot(slope, along)


@dataclass(frozen=True)
class _OnPath:
    """An obstacle along the path, one entry a step: its rear end, its speed, and whether it is in the corridor."""

    rear_m: Values
    speed_mps: Values
    in_corridor: NDArray[np.bool_]

    def leader_at(self, index: int, look_ahead: int) -> tuple[float, float] | None:
        """Rear end and speed when it is in the corridor first between ``index`` and ``look_ahead`` steps later."""
        later = np.flatnonzero(self.in_corridor[index : index + look_ahead + 1])
        if not len(later):
            return None
        first = index + int(later[0])
        return float(self.rear_m[first]), float(self.speed_mps[first])


@dataclass(frozen=True)
class _Driven:
    """What was planned at ``first_step``: stations (n,) of the rear axle on a curve, and the centre's trajectory."""

    first_step: int
    curve: RearAxleCurve
    stations: Values
    trajectory: PlannedTrajectory

    def going_on(self, ego: EgoState) -> tuple[RearAxleCurve, float] | None:
        """Return the curve and the station of the ego's rear axle on it, if it is on this plan."""
        index = ego.step - self.first_step
        if not is_on_plan(self.trajectory, index, ego, FOLLOWED_WITHIN_M):
            return None
        return self.curve, float(self.stations[index])


def _first_near(squared_m2: Values) -> NDArray[np.intp]:
    """Return for each row the first local minimum that is about as small as the smallest value."""
    lowest = squared_m2.min(axis=1, keepdims=True) + _SAME_PASSAGE_M2
    falls = np.diff(squared_m2, axis=1, append=np.inf) < 0.0
    first: NDArray[np.intp] = np.argmax((squared_m2 <= lowest) & ~falls, axis=1)
    return first


class IntelligentDriver:
    """The planner; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._weights = task.configuration.weights
        self._steps = round(task.configuration.settings.horizon_s / task.step_s)
        self._goal = Goal(task.goal_ahead)
        self._desired_speed = DesiredSpeed.of(task)
        self._stations = arc_length(task.reference.points)
        along = np.gradient(task.reference.points, axis=0)
        self._headings = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        self._path = RearAxlePath(task.reference.points, task.vehicle.rear_axle_behind_center_m, task.reference.start_m)
        line = self._path.stations_m, self._path.headings_rad
        comfortable = self._weights["lateral_acceleration_mps2"], self._weights["deceleration_mps2"]
        grip = task.vehicle.maximum_acceleration_mps2
        self._comfortable_mps = curve_speeds_mps(*line, *comfortable)
        self._slip_mps = curve_speeds_mps(*line, _CURVE_GRIP * grip, _BRAKING_GRIP * grip, _SLIP_SMOOTHING_M)
        self._curvature = np.abs(np.gradient(self._path.headings_rad, self._path.stations_m))
        start_m = task.reference.start_m
        self._goal_m = self._goal.stations_on(task.reference.points, start_m) if self._goal.has_position else None
        self._driven: _Driven | None = None

    def plan(self, observation: Observation) -> Plan:
        """One trajectory: along the path with the model's acceleration, simulated over the horizon."""
        ego = observation.ego
        began = self._driven.going_on(ego) if self._driven else None
        curve, station = began or self._curve_from(ego)
        if curve is None:
            return Plan(None, rejected={"initial_state": 1}, candidates=1)
        travelled, speeds = self._motion(observation, station)
        stations = curve.after(station, travelled)
        trajectory = self._trajectory(ego, curve, stations, speeds)
        before_next_plan = trajectory.until(self._task.configuration.settings.replan_steps + 1)
        limit = violated_limit(before_next_plan, self._task.vehicle, self._task.step_s)
        if limit is not None:
            return Plan(None, rejected={limit: 1}, candidates=1)
        self._driven = _Driven(ego.step, curve, stations, trajectory)
        kind: PlanKind = "regular" if speeds.any() else "standstill"
        followed = follow(trajectory, ego, self._task.vehicle, self._task.step_s)
        return Plan(followed.trajectory, candidates=1, kind=kind)

    def _curve_from(self, ego: EgoState) -> tuple[RearAxleCurve | None, float]:
        """The curve from where the ego's rear axle is, and its station; none where the ego heads back."""
        rear = rear_axle(ego.position, ego.heading_rad, self._task.vehicle)
        station = self._path.foot(rear)
        along_rad = float(self._path.frame(np.array([station]))[1][0])
        if abs(wrap_angle(ego.heading_rad - along_rad)) > math.pi / 2:
            return None, station
        return RearAxleCurve.beginning_at(self._path, rear, ego.heading_rad, _FADE_S * ego.speed_mps), station

    def _motion(self, observation: Observation, station: float) -> tuple[Values, Values]:
        """The distance in m and the speed, one a step, of a rear axle that begins at a station."""
        step_s, vehicle = self._task.step_s, self._task.vehicle
        here = self._path.center_station(station)
        others = [self._on_path(obstacle, here) for obstacle in observation.obstacles if len(obstacle.positions)]
        desired, look_ahead = self._desired_speed.at(observation.ego), round(_LOOK_AHEAD_S / step_s)
        travelled, speeds = np.zeros(self._steps + 1), np.full(self._steps + 1, observation.ego.speed_mps)
        for i in range(self._steps):
            speed, rear_axle_m = float(speeds[i]), station + float(travelled[i])
            center_m = self._path.center_station(rear_axle_m)
            ahead = (other.leader_at(i, look_ahead) for other in others)
            leaders = [leader for leader in ahead if leader is not None and leader[0] > center_m]
            acceleration = self._free(speed, min(desired, self._allowed(center_m), vehicle.maximum_speed_mps))
            if leaders:
                rear, leader_speed = min(leaders)
                gap_m = rear - center_m - vehicle.length_m / 2
                acceleration -= self._interaction(speed, gap_m, speed - leader_speed)
            acceleration = min(acceleration, self._before_curve(speed, rear_axle_m + speed * step_s))
            grip = self._grip_mps2(speed, rear_axle_m + speed * step_s / 2)
            most = min(grip, vehicle.most_acceleration_mps2(speed))
            acceleration = min(max(acceleration, -min(HARDEST_BRAKING_MPS2, grip)), most)
            speeds[i + 1] = max(speed + acceleration * step_s, 0.0)
            travelled[i + 1] = travelled[i] + (speed + speeds[i + 1]) / 2 * step_s
        return travelled, speeds

    def _free(self, speed: float, desired: float) -> float:
        a, b = self._weights["acceleration_mps2"], self._weights["deceleration_mps2"]
        if speed > desired:
            return float(-b * (1.0 - (max(desired, 0.0) / speed) ** (a * _EXPONENT / b)))
        return float(a * (1.0 - (speed / desired) ** _EXPONENT)) if desired > 0 else 0.0

    def _interaction(self, speed: float, gap_m: float, closing_mps: float) -> float:
        a, b = self._weights["acceleration_mps2"], self._weights["deceleration_mps2"]
        headway = speed * self._weights["time_headway_s"] + speed * closing_mps / (2.0 * math.sqrt(a * b))
        wanted = self._weights["minimum_gap_m"] + max(0.0, headway)
        return float(a * (wanted / max(gap_m, _SMALLEST_GAP_M)) ** 2)

    def _before_curve(self, speed: float, following: float) -> float:
        """The acceleration to the speed that the curves allow at the following station.

        It brakes at most comfortably for a comfortable speed, and as hard as it must where the tyres would slip.
        """
        comfortable, slipping = (
            (float(np.interp(following, self._path.stations_m, allowed)) - speed) / self._task.step_s
            for allowed in (self._comfortable_mps, self._slip_mps)
        )
        return min(max(comfortable, -self._weights["deceleration_mps2"]), slipping)

    def _grip_mps2(self, speed: float, station: float) -> float:
        """What the curve leaves of the tyres' friction for motion along it."""
        curvature = float(np.interp(station, self._path.stations_m, self._curvature))
        whole = _GRIP * self._task.vehicle.maximum_acceleration_mps2
        return math.sqrt(max(whole**2 - (speed**2 * curvature) ** 2, 0.0))

    def _allowed(self, station: float) -> float:
        """The speed from which the comfortable deceleration reaches the goal's speed where the goal begins."""
        if self._goal_m is None or self._goal.speed_mps is None:
            return math.inf
        left = max(self._goal_m[0] - station, 0.0)
        return math.sqrt(self._goal.speed_mps**2 + 2.0 * self._weights["deceleration_mps2"] * left)

    def _on_path(self, obstacle: PredictedObstacle, here_m: float) -> _OnPath:
        """Return the projection onto the nearest point of the path; its points are about one metre apart.

        Where the path passes the obstacle more than once, the passage that is next ahead of the ego counts.
        """
        path = self._task.reference.points
        gaps = path[None, :, :] - obstacle.positions[:, None, :]
        squared = (gaps**2).sum(axis=2)
        behind = max(int(np.searchsorted(self._stations, here_m - _LOOKED_BACK_M)), 0)
        nearest = behind + _first_near(squared[:, behind:])
        heading, offset = self._headings[nearest], -gaps[np.arange(len(nearest)), nearest]
        along = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading)
        aside = offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading)
        turned = wrap_angles(obstacle.headings_rad - heading)
        cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        half_along = (obstacle.length_m * cos + obstacle.width_m * sin) / 2
        half_across = (obstacle.length_m * sin + obstacle.width_m * cos) / 2
        stations = self._stations[nearest] + along
        room = self._task.vehicle.width_m / 2 + half_across + _CORRIDOR_MARGIN_M
        on_path = (nearest > 0) & (nearest < len(path) - 1)
        moving = np.gradient(stations, self._task.step_s) if len(stations) > 1 else np.zeros(1)
        return _OnPath(stations - half_along, moving, (np.abs(aside) < room) & on_path)

    def _trajectory(self, ego: EgoState, curve: RearAxleCurve, stations: Values, speeds: Values) -> PlannedTrajectory:
        rear, headings = curve.poses(stations)
        headings += ego.heading_rad - headings[0] - wrap_angle(ego.heading_rad - float(headings[0]))
        positions = centers(rear, headings, self._task.vehicle)
        positions[0], headings[0] = ego.position, ego.heading_rad
        gained = np.diff(speeds) / self._task.step_s
        return PlannedTrajectory(positions, headings, speeds, np.concatenate([[ego.acceleration_mps2], gained]))
