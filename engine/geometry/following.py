"""Locates a track along a line that returns to itself, from the track's previous position.

A roundabout, a loop or a hairpin passes the same place more than once, and the nearest point of the line may then be on
another lap. A track moves along the line about as far as it moves in the plane, so its previous position determines the
lap. Stations are arc lengths in m from the line's first point, offsets are in m with left positive.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from .polyline import Points, Values, arc_length

_PACE, _SLACK_M = 2.0, 2.0
"""A track is still on its lap if it advances along the line by at most this multiple of its own distance plus this
much. On the inside of a curve of radius R, at an offset of R/2, the station advances by twice the distance.
"""
_COST_PER_M = 0.5
"""A jump along the line costs as much as half of its length in distance from the line. The next lap of a roundabout of
the smallest size for cars (13 m across, 40 m around) then costs as much as 20 m, more than its diameter.
"""
_WINDOW_M = 20.0
"""Distance beyond the track's reach within which a follower searches first. A position farther along costs more than
half of that in distance, so it cannot win against one that is nearer to the line than 10 m.
"""
_MOST_BEGINNINGS = 8
"""Number of nearest positions to try as the start of a track on an unknown lap."""
_SAME_M = 0.01
"""If tracks from several starts are equally near to the line, to a centimetre, the first start counts."""
_LEAST_SQUARED_M2 = 1e-12
"""Replaces the squared length of a segment between equal points, so that no projection divides by zero."""

_PLACED_AT_ONCE = 64
"""Positions of a track with feet that are computed together (chosen): more need too much memory for a fast cache."""
_Foot = tuple[int, float, float]
"""A local minimum of the distance from a position: the segment of the line, the station and the distance."""


class PathFollower:
    """Follows a track along a line from one position to the next and stays on the track's lap.

    Args:
        points: The line, shape (n, 2), at least two points.
        begin_m: The station near which the track starts. If it is None, the track starts on the lap that passes nearest
            to its first position.
    """

    def __init__(self, points: Points, begin_m: float | None = None) -> None:
        step = np.diff(points, axis=0)
        self._start, self._step = points[:-1].T.copy(), step.T.copy()
        self._squared = np.maximum(step[:, 0] ** 2 + step[:, 1] ** 2, _LEAST_SQUARED_M2)
        self._lengths = np.sqrt(self._squared)
        self._stations, self._count = arc_length(points), len(step)
        self._station_list: list[float] = self._stations.tolist()
        self._last_m, self._last_at, self._last_offset_m = begin_m, (math.nan, math.nan), math.nan

    def beginning_at(self, begin_m: float | None) -> "PathFollower":
        """Return a follower of another track on the same line."""
        other = copy(self)
        other._last_m, other._last_at = begin_m, (math.nan, math.nan)
        return other

    def place(self, position: Points) -> tuple[float, float]:
        """Return the station in m of the track's next position (2,), and its signed offset from the line in m."""
        x, y = position.tolist()
        if self._last_m is not None and (x, y) == self._last_at:
            return self._last_m, self._last_offset_m
        reach_m = self._reach_m(x, y)
        found = None if self._last_m is None else self._near_the_last(x, y, self._last_m, reach_m)
        if found is None:
            segments, stations, distances = self._feet(x, y, 0, len(self._squared))
            costs = distances if self._last_m is None else _costs(stations, distances, self._last_m, reach_m)
            best = int(np.argmin(costs))
            found = int(segments[best]), float(stations[best]), float(distances[best])
        return self._moved_to(x, y, *found)

    def places(self, track: Points, feet: "Sequence[Sequence[_Foot]] | None" = None) -> list[tuple[float, float]]:
        """Return what ``place`` returns for one position of a track (n, 2) after the other, in less time.

        ``feet``: those of ``feet_of(track)``, if they are known.
        """
        found = []
        for (x, y), own in zip(track.tolist(), self.feet_of(track) if feet is None else feet, strict=True):
            if self._last_m is not None and (x, y) == self._last_at:
                found.append((self._last_m, self._last_offset_m))
                continue
            foot = self._best_foot(own, x, y)
            found.append(self.place(np.array([x, y])) if foot is None else self._moved_to(x, y, *foot))
        return found

    def feet_of(self, track: Points) -> "list[list[_Foot]]":
        """Return for every position of a track (n, 2) all segments with a local minimum of the distance from it.

        The minima of many positions are computed together. Which of them counts depends on the position before.
        """
        parts = (track[begin : begin + _PLACED_AT_ONCE] for begin in range(0, len(track), _PLACED_AT_ONCE))
        return [feet for part in parts for feet in self._feet_of_all(part)]

    def _reach_m(self, x: float, y: float) -> float:
        """Return how far along the line a track may be from its last station if it moves to a position."""
        moved = math.hypot(x - self._last_at[0], y - self._last_at[1])
        return _SLACK_M + (_PACE * moved if math.isfinite(moved) else 0.0)

    def _moved_to(self, x: float, y: float, segment: int, station: float, distance: float) -> tuple[float, float]:
        """Remember a position and its foot; return its station and its signed offset."""
        self._last_m, self._last_at = station, (x, y)
        (start_x, start_y), (step_x, step_y) = self._start[:, segment], self._step[:, segment]
        self._last_offset_m = math.copysign(distance, step_x * (y - start_y) - step_y * (x - start_x))
        return self._last_m, self._last_offset_m

    def _best_foot(self, feet: "Sequence[_Foot]", x: float, y: float) -> "_Foot | None":
        """Return the foot that ``place`` chooses among all feet of a position, or None if there is no foot."""
        last_m, reach_m = self._last_m, self._reach_m(x, y)
        if last_m is None:
            return min(feet, key=_distance, default=None)

        def cost(foot: _Foot) -> float:
            return foot[2] + _COST_PER_M * max(abs(foot[1] - last_m) - reach_m, 0.0)

        low, high = self._window(last_m, reach_m)
        near = [foot for foot in feet if (foot[0] > low or low == 0) and (foot[0] < high - 1 or high == self._count)]
        best = min(near, key=cost, default=None)
        return best if best is not None and cost(best) <= _COST_PER_M * _WINDOW_M else min(feet, key=cost, default=None)

    def _feet_of_all(self, track: Points) -> list[list["_Foot"]]:
        """Return the feet on the whole line of every position of a track (n, 2), each list along the line."""
        x, y = track[:, :1], track[:, 1:]
        (start_x, start_y), (step_x, step_y) = self._start, self._step
        along = ((x - start_x) * step_x + (y - start_y) * step_y) / self._squared
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        away_x, away_y = start_x + step_x * along - x, start_y + step_y * along - y
        squared = away_x * away_x + away_y * away_y
        is_foot = np.ones(squared.shape, bool)
        is_foot[:, 1:] = squared[:, 1:] <= squared[:, :-1]
        is_foot[:, :-1] &= squared[:, :-1] < squared[:, 1:]
        of, segments = np.nonzero(is_foot)
        stations = self._stations[segments] + along[of, segments] * self._lengths[segments]
        distances = np.sqrt(squared[of, segments])
        feet: list[list[_Foot]] = [[] for _ in track]
        for number, *foot in zip(of.tolist(), segments.tolist(), stations.tolist(), distances.tolist(), strict=True):
            feet[number].append((foot[0], foot[1], foot[2]))
        return feet

    def beginnings(self, position: Points) -> Values:
        """Return the stations in m of the nearest positions on all laps that pass a position (2,), nearest first."""
        x, y = position.tolist()
        _, stations, distances = self._feet(x, y, 0, len(self._squared))
        return stations[np.argsort(distances, kind="stable")[:_MOST_BEGINNINGS]]

    def _window(self, last_m: float, reach_m: float) -> tuple[int, int]:
        """Return the segments within a window of ``last_m``, from the first to before the second."""
        window_m = reach_m + _WINDOW_M
        low = max(bisect_left(self._station_list, last_m - window_m) - 1, 0)
        return low, min(bisect_left(self._station_list, last_m + window_m) + 1, self._count)

    def _near_the_last(self, x: float, y: float, last_m: float, reach_m: float) -> tuple[int, float, float] | None:
        """Return the best position within a window of ``last_m``, or None if a position outside may be better."""
        low, high = self._window(last_m, reach_m)
        segments, stations, distances = self._feet(x, y, low, high)
        if not len(segments):
            return None
        costs = _costs(stations, distances, last_m, reach_m)
        best = int(np.argmin(costs))
        if costs[best] > _COST_PER_M * _WINDOW_M:
            return None
        return int(segments[best]), float(stations[best]), float(distances[best])

    def _feet(self, x: float, y: float, low: int, high: int) -> tuple[NDArray[np.intp], Values, Values]:
        """Return segments from ``low`` to before ``high`` with a local minimum of the distance from a point.

        Returns:
            The segments, and the station and the distance of the nearest point of each.
        """
        (start_x, start_y), (step_x, step_y) = self._start[:, low:high], self._step[:, low:high]
        along = ((x - start_x) * step_x + (y - start_y) * step_y) / self._squared[low:high]
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        away_x, away_y = start_x + step_x * along - x, start_y + step_y * along - y
        squared = away_x * away_x + away_y * away_y
        # The line continues at a cut, so a distance that still falls there is not a minimum.
        before = np.concatenate([[math.inf if low == 0 else -math.inf], squared[:-1]])
        after = np.concatenate([squared[1:], [math.inf if high == len(self._squared) else -math.inf]])
        here = np.flatnonzero((squared <= before) & (squared < after))
        return low + here, self._stations[low + here] + along[here] * self._lengths[low + here], np.sqrt(squared[here])


def _distance(foot: _Foot) -> float:
    return foot[2]


def _costs(stations: Values, distances: Values, last_m: float, reach_m: float) -> Values:
    """Return the costs of positions as a track's next position: their distance, and their excess over its reach."""
    return distances + _COST_PER_M * np.maximum(np.abs(stations - last_m) - reach_m, 0.0)


def project_along(
    points: "Points | PathFollower", track: Points, begin_m: float | None = None
) -> tuple[Values, Values]:
    """Project the positions of a track onto a line with continuity, on the lap of the track.

    Unlike :func:`~.polyline.project_all`, which projects each position separately onto the nearest point, this function
    follows the track from its first position. Use it for the track of a vehicle on a line that may come near itself.

    Args:
        points: The line, shape (n, 2), at least two points, or a follower of it, which saves its preparation.
        track: Positions in driving order, shape (m, 2).
        begin_m: The station near which the track starts. If it is None, every lap that passes the first position is
            tried, and the lap to which the track stays nearest is used. In a tie, it is the first lap on the line.

    Returns:
        Stations (m,) in m and signed offsets (m,) in m, left positive.
    """
    if not len(track):
        return np.empty(0), np.empty(0)
    line = points if isinstance(points, PathFollower) else PathFollower(points)
    begins = [begin_m] if begin_m is not None else sorted(line.beginnings(track[0]).tolist())
    feet = line.feet_of(track)
    followed = []
    for begin in begins:
        places = np.array(line.beginning_at(begin).places(track, feet))
        followed.append((round(float(np.abs(places[:, 1]).mean()) / _SAME_M), places))
    best = min(followed, key=lambda one: one[0])[1]
    return best[:, 0], best[:, 1]
