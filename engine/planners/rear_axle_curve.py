"""The curve that a rear axle drives: dragged along a path by the centre, beside it by an offset that fades out.

In the kinematic single-track model a vehicle heads where its rear axle moves, so whatever line the rear axle follows
can be driven if its curvature has no steps. A vehicle whose centre moved along a path and headed along it too could
not: in a bend its rear axle would slide aside.
"""

from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, project, wrap_angle
from plannerforge.engine.traffic.smoothing import tractrix

SHORTEST_FADE_M, FADE_PER_OFFSET = 15.0, 6.0
STEEPEST_RAD = 1.2
LEAST_PACE = 0.1
"""Inside a bend the curve is shorter than the path, at most by this factor: nobody turns about the middle of a bend."""


class RearAxlePath:
    """The way of a rear axle whose vehicle's centre follows a path of points (n, 2).

    A cubic spline over its arc length joins it, so that the curvature has no steps. Stations are its own; at
    ``stations_m`` (n,) it heads towards ``headings_rad`` (n,).
    """

    def __init__(self, path: Points, behind_center_m: float) -> None:
        from scipy.interpolate import CubicSpline

        towards = path[1] - path[0]
        self.headings_rad = tractrix(path, float(np.arctan2(towards[1], towards[0])), behind_center_m)
        towards_center = np.stack([np.cos(self.headings_rad), np.sin(self.headings_rad)], axis=1)
        self._points = path - behind_center_m * towards_center
        self.stations_m, self._center_stations_m = arc_length(self._points), arc_length(path)
        self._end_m = float(self.stations_m[-1])
        self._position = CubicSpline(self.stations_m, self._points)
        self._first, self._second = self._position.derivative(1), self._position.derivative(2)

    def center_station(self, station: float) -> float:
        """The station in m of the centre on the path that it follows."""
        return float(np.interp(station, self.stations_m, self._center_stations_m))

    def foot(self, point: Points) -> float:
        """The station in m nearest to a point (2,)."""
        station = project(self._points, point)[0]
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
class Fade:
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
    fade: Fade

    @classmethod
    def beginning_at(cls, path: RearAxlePath, point: Points, heading_rad: float, fade_m: float) -> "RearAxleCurve":
        """The curve that begins at a point (2,) with a heading and is on the path ``fade_m`` later.

        A large offset takes a longer way to fade.
        """
        station = path.foot(point)
        (foot,), (along_rad,), (pace,), (turn,) = path.frame(np.array([station]))
        offset = float((point - foot) @ np.array([-np.sin(along_rad), np.cos(along_rad)]))
        turned = float(np.clip(wrap_angle(heading_rad - float(along_rad)), -STEEPEST_RAD, STEEPEST_RAD))
        slope = float(np.tan(turned) * max(pace - offset * turn, LEAST_PACE))
        return cls(path, Fade(station, max(fade_m, SHORTEST_FADE_M, FADE_PER_OFFSET * abs(offset)), offset, slope))

    def after(self, station: float, travelled_m: Values) -> Values:
        """The stations (n,) after so many metres of the curve, ascending from 0 at ``station``."""
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
        along = np.maximum(pace - offset * turn, LEAST_PACE)
        return np.arctan2(slope, along), np.hypot(slope, along)
