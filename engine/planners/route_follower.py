"""The lateral half of a planner: for given speeds, a feasible motion along the route.

The centre follows the reference path and drags the rear axle; the offset from that line fades out. In the kinematic
single-track model a vehicle's heading is the direction of its rear axle's motion, so it can drive any rear-axle line
with a continuous curvature. If the centre moved along the path with the path's heading, the rear axle would slide
sideways in curves. Stations are arc lengths in m of the rear axle's path.

:class:`RouteFollower` is also the quickest way to write your own planner: ``trajectory`` needs only a speed.
"""

import math
from copy import copy
from dataclasses import dataclass

import numpy as np

from ..geometry import Lookup, PathFollower, Points, Values, arc_length, wrap_angle
from ..vehicles import centers, rear_axle, tractrix
from .driving.following import FOLLOWED_WITHIN_M, follow, is_on_plan
from .interface import EgoState, PlannedTrajectory, PlanningTask

HORIZON_S = 3.0
"""The default horizon of Frenetix in this program."""
_FADE_S, _SHORTEST_FADE_M, _FADE_PER_OFFSET = 4.0, 15.0, 6.0
"""An offset fades over 4 s at the ego's speed, but at least over 15 m and six times the offset (chosen)."""
_STEEPEST_RAD = 1.2
"""Largest angle at which a curve leaves its path, since its slope by station grows without bound (chosen)."""
_LEAST_PACE = 0.1
"""Inside a turn the curve is shorter than the path, at most by this factor: a vehicle cannot turn about the centre of a
curve.
"""


class RearAxlePath:
    """The path of a rear axle while the vehicle's centre follows a path of points (n, 2).

    It is a cubic spline over its arc length, so its curvature is continuous. Stations are its own; at ``stations_m``
    (n,) it has the headings ``headings_rad`` (n,). It follows one axle, and requests for feet must come in driving
    order. The centre starts near the station ``begin_m`` of the path if that is known.
    """

    def __init__(self, path: Points, behind_center_m: float, begin_m: float | None = None) -> None:
        from scipy.interpolate import CubicSpline

        towards = path[1] - path[0]
        self.headings_rad = tractrix(path, float(np.arctan2(towards[1], towards[0])), behind_center_m)
        towards_center = np.stack([np.cos(self.headings_rad), np.sin(self.headings_rad)], axis=1)
        self._points = path - behind_center_m * towards_center
        self.stations_m, self._center_stations_m = arc_length(self._points), arc_length(path)
        self._center_station = Lookup(self.stations_m, self._center_stations_m)
        self._end_m = float(self.stations_m[-1])
        self._begin_m = None if begin_m is None else float(np.interp(begin_m, self._center_stations_m, self.stations_m))
        self._follower = PathFollower(self._points, self._begin_m)
        spline = CubicSpline(self.stations_m, self._points)
        self._lowest = spline.x
        coefficients = [one.c for one in (spline, spline.derivative(1), spline.derivative(2))]
        # One row for each power of each coordinate of position, derivative and second derivative.
        self._table = np.concatenate(
            [row[::-1].transpose(0, 2, 1).reshape(-1, len(spline.x) - 1) for row in coefficients]
        )

    def anew(self) -> "RearAxlePath":
        """Return the same path for another axle."""
        other = copy(self)
        other._follower = self._follower.beginning_at(self._begin_m)
        return other

    def center_station(self, station: float) -> float:
        """Return the station in m of the centre on the path that it follows."""
        return self._center_station.at(station)

    def foot(self, point: Points) -> float:
        """Return the station in m nearest to a point (2,)."""
        station = self._follower.place(point)[0]
        for _ in range(6):  # Gauss-Newton from the nearest point of the chords; an error shrinks by offset / radius
            position, along, _ = self._spline(np.array([station]))
            along = along[:, 0]
            station += float((point - position[:, 0]) @ along) / float(along @ along)
            station = min(max(station, 0.0), self._end_m)
        return station

    def frame(self, stations: Values) -> tuple[Points, Values, Values, Values]:
        """Return points (n, 2), headings (n,) in rad, and the derivatives of arc length and heading with respect to the
        station.
        """
        position, along, bending = self._spline(np.minimum(np.maximum(stations, 0.0), self._end_m))
        return position.T, np.arctan2(along[1], along[0]), *_pace_and_turn(along, bending)

    def pace_and_turn(self, stations: Values) -> tuple[Values, Values]:
        """Return the derivatives of arc length and heading with respect to the station, as ``frame`` does."""
        _, along, bending = self._spline(np.minimum(np.maximum(stations, 0.0), self._end_m), with_position=False)
        return _pace_and_turn(along, bending)

    def _spline(self, stations: Values, *, with_position: bool = True) -> tuple[Points, Points, Points]:
        """Return position, derivative and second derivative at stations on the path, each (2, n).

        The powers are added in the order of scipy's splines, so the values are the same to the last bit.
        """
        index = np.minimum(np.searchsorted(self._lowest, stations, side="right") - 1, len(self._lowest) - 2)
        rows, beyond = self._table[:, index], stations - self._lowest[index]
        squared = beyond * beyond
        position = rows[:2]
        if with_position:
            position = rows[:2] + rows[2:4] * beyond + rows[4:6] * squared + rows[6:8] * (squared * beyond)
        along = rows[8:10] + rows[10:12] * beyond + rows[12:14] * squared
        return position, along, rows[14:16] + rows[16:18] * beyond


def _pace_and_turn(along: Points, bending: Points) -> tuple[Values, Values]:
    pace = np.sqrt(along[0] * along[0] + along[1] * along[1])
    return pace, (along[0] * bending[1] - along[1] * bending[0]) / pace**2


@dataclass(frozen=True)
class _Fade:
    """The offset from a path between two stations: a quintic from an offset and slope to 0."""

    begin_m: float
    length_m: float
    offset_m: float
    slope: float

    def at(self, stations: Values) -> tuple[Values, Values]:
        """Return offsets in m, and their slopes with respect to the station."""
        share = np.clip((stations - self.begin_m) / self.length_m, 0.0, 1.0)
        offset = self.offset_m * (1 - share**3 * (10 - 15 * share + 6 * share**2))
        offset = offset + self.slope * self.length_m * (share - share**3 * (6 - 8 * share + 3 * share**2))
        slope = -self.offset_m / self.length_m * 30 * share**2 * (1 - share) ** 2
        return offset, slope + self.slope * (1 - share**2 * (18 - 32 * share + 15 * share**2))


@dataclass(frozen=True)
class RearAxleCurve:
    """A path, and the fading offset of a curve from it."""

    path: RearAxlePath
    fade: _Fade

    @classmethod
    def beginning_at(cls, path: RearAxlePath, point: Points, heading_rad: float, fade_m: float) -> "RearAxleCurve":
        """Return the curve that starts at a point (2,) with a heading and is on the path ``fade_m`` later.

        A large offset fades over a longer distance.
        """
        station = path.foot(point)
        (foot,), (along_rad,), (pace,), (turn,) = path.frame(np.array([station]))
        offset = float((point - foot) @ np.array([-np.sin(along_rad), np.cos(along_rad)]))
        turned = float(np.clip(wrap_angle(heading_rad - float(along_rad)), -_STEEPEST_RAD, _STEEPEST_RAD))
        slope = float(np.tan(turned) * max(pace - offset * turn, _LEAST_PACE))
        return cls(path, _Fade(station, max(fade_m, _SHORTEST_FADE_M, _FADE_PER_OFFSET * abs(offset)), offset, slope))

    def after(self, station: float, travelled_m: Values) -> Values:
        """Return the stations (n,) after distances (n,) in m along the curve, ascending from 0 at ``station``."""
        stations, driven = station + travelled_m, np.diff(travelled_m)
        for _ in range(3):
            middle = (stations[1:] + stations[:-1]) / 2
            along, slope = self._direction(middle)
            stations = np.empty_like(travelled_m)
            stations[0] = 0.0
            np.cumsum(driven / np.hypot(slope, along), out=stations[1:])
            stations += station
        return stations

    def poses(self, stations: Values) -> tuple[Points, Values]:
        """Return points (n, 2) and unwrapped headings (n,) in rad."""
        points, along_rad, pace, turn = self.path.frame(stations)
        offset, slope = self.fade.at(stations)
        normal = np.stack([-np.sin(along_rad), np.cos(along_rad)], axis=1)
        turned = np.arctan2(slope, np.maximum(pace - offset * turn, _LEAST_PACE))
        return points + offset[:, None] * normal, np.unwrap(along_rad + turned)

    def _direction(self, stations: Values) -> tuple[Values, Values]:
        """Return the curve's derivatives with respect to the station, along the path and across it."""
        pace, turn = self.path.pace_and_turn(stations)
        offset, slope = self.fade.at(stations)
        return np.maximum(pace - offset * turn, _LEAST_PACE), slope


@dataclass(frozen=True)
class DrivenCurve:
    """A motion planned at ``first_step``: stations (n,) of the rear axle, and the centre's states."""

    first_step: int
    curve: RearAxleCurve
    stations_m: Values
    trajectory: PlannedTrajectory

    def place_of(self, ego: EgoState) -> "RoutePlace | None":
        """Return the position of the ego's rear axle on the curve, or None if the ego has left the motion."""
        index = ego.step - self.first_step
        if not is_on_plan(self.trajectory, index, ego, FOLLOWED_WITHIN_M):
            return None
        return RoutePlace(self.curve, float(self.stations_m[index]))


@dataclass(frozen=True)
class RoutePlace:
    """A station in m of a rear axle on its curve along the route."""

    curve: RearAxleCurve
    station_m: float

    def driven(self, ego: EgoState, travelled_m: Values, speeds_mps: Values, task: PlanningTask) -> DrivenCurve:
        """Return the motion from here if the rear axle covers distances (n,) at speeds (n,), one per step."""
        stations = self.curve.after(self.station_m, travelled_m)
        rear, headings = self.curve.poses(stations)
        headings += ego.heading_rad - headings[0] - wrap_angle(ego.heading_rad - float(headings[0]))
        positions = centers(rear, headings, task.vehicle)
        positions[0], headings[0] = ego.position, ego.heading_rad
        accelerations = np.concatenate([[ego.acceleration_mps2], np.diff(speeds_mps) / task.step_s])
        return DrivenCurve(
            ego.step, self.curve, stations, PlannedTrajectory(positions, headings, speeds_mps, accelerations)
        )


class RouteFollower:
    """Generates motions along the route of a planning task, one motion for each step of a run.

    ``path``: the line that the rear axle follows if the ego has no offset from its route.
    """

    def __init__(self, task: PlanningTask) -> None:
        reference, behind_m = task.reference, task.vehicle.rear_axle_behind_center_m
        self._task = task
        self.path = task.made.get(
            "rear axle path", lambda: RearAxlePath(reference.points, behind_m, reference.start_m)
        ).anew()
        self._kept: DrivenCurve | None = None

    def trajectory(
        self,
        ego: EgoState,
        target_speed_mps: float,
        *,
        acceleration_mps2: float = 2.0,
        deceleration_mps2: float = 4.0,
        horizon_s: float = HORIZON_S,
    ) -> PlannedTrajectory | None:
        """Return a motion along the route that changes to a speed and keeps it, or None if the ego heads back.

        The steering rate stays within the vehicle's limit. A speed at which the tyres would slip in a curve is not
        reduced; the loop then refuses the plan.

        Args:
            ego: The present state. Call this once for each step of a run, so that the position is tracked on a route
                that crosses itself.
            target_speed_mps: The speed to reach, in m/s, 0 to stop.
            acceleration_mps2: The rate at which the speed rises, in m/s².
            deceleration_mps2: The rate at which it falls, in m/s², positive.
            horizon_s: The duration of the motion, in s.
        """
        place = self.place_of(ego)
        if place is None:
            return None
        step_s, target_mps = self._task.step_s, max(target_speed_mps, 0.0)
        times = np.arange(round(horizon_s / step_s) + 1) * step_s
        if target_mps >= ego.speed_mps:
            speeds = np.minimum(ego.speed_mps + acceleration_mps2 * times, target_mps)
        else:
            speeds = np.maximum(ego.speed_mps - deceleration_mps2 * times, target_mps)
        travelled = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * step_s)])
        driven = place.driven(ego, travelled, speeds, self._task)
        self.keep(driven)
        return follow(driven.trajectory, ego, self._task.vehicle, step_s).trajectory

    def place_of(self, ego: EgoState) -> RoutePlace | None:
        """Return the rear axle's position on the latest kept motion, or otherwise on a new curve to the route.

        Returns None if the ego heads back along its route.
        """
        going_on = self._kept.place_of(ego) if self._kept else None
        if going_on is not None:
            return going_on
        rear = rear_axle(ego.position, ego.heading_rad, self._task.vehicle)
        station = self.path.foot(rear)
        along_rad = float(self.path.frame(np.array([station]))[1][0])
        if abs(wrap_angle(ego.heading_rad - along_rad)) > math.pi / 2:
            return None
        curve = RearAxleCurve.beginning_at(self.path, rear, ego.heading_rad, _FADE_S * ego.speed_mps)
        return RoutePlace(curve, station)

    def keep(self, driven: DrivenCurve) -> None:
        """Continue along this motion at the next step, if the ego follows it."""
        self._kept = driven
