"""Polylines as arrays of shape (n, 2) in metres: lengths, positions along them, projections, headings and curvature.

Every function takes at least two points unless stated otherwise. Arc lengths (*stations*) are in metres from the first
point, angles in radians, offsets in metres with left positive.
"""

import math

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Values = NDArray[np.float64]


# lengths and positions along a line


def without_repeats(points: Points, tolerance_m: float = 1e-3) -> Points:
    """Return the polyline without vertices nearer than the tolerance to the previous vertex; any number of points."""
    points = np.asarray(points, dtype=float)
    if len(points) < 2:
        return points
    kept = np.concatenate([[True], segment_lengths(points) > tolerance_m])
    unique: Points = points[kept]
    return unique


def segment_lengths(points: Points) -> Values:
    """Return the length of every segment in metres, shape (n − 1,)."""
    step = points[1:] - points[:-1]
    along, across = step[:, 0], step[:, 1]
    return np.sqrt(along * along + across * across)  # takes a third of the time of diff and norm, with identical bits


def arc_length(points: Points) -> Values:
    """Return the arc length in m at each vertex, shape (n,), starting with 0."""
    return np.concatenate([[0.0], np.cumsum(segment_lengths(points))])


def length_m(points: Points) -> float:
    """Return the length of the polyline in metres."""
    return float(segment_lengths(points).sum())


def interpolate(points: Points, stations: Values, wanted: Values) -> Points:
    """Return points (m, 2) at the ``wanted`` arc lengths (clamped to the ends); ``stations`` are those of
    the vertices.
    """
    return np.stack([np.interp(wanted, stations, points[:, 0]), np.interp(wanted, stations, points[:, 1])], axis=1)


def resample(points: Points, count: int) -> Points:
    """Return ``count`` points evenly spaced along the polyline, including the ends."""
    stations = arc_length(points)
    return interpolate(points, stations, np.linspace(0.0, stations[-1], count))


def point_at(points: Points, station_m: float) -> tuple[Points, float]:
    """Return the point of shape (2,) and heading in radians at an arc length (clamped to the ends)."""
    stations = arc_length(points)
    station_m = float(np.clip(station_m, 0.0, stations[-1]))
    index = int(np.clip(np.searchsorted(stations, station_m, side="right") - 1, 0, len(points) - 2))
    direction = points[index + 1] - points[index]
    point = interpolate(points, stations, np.array([station_m]))[0]
    return point, math.atan2(direction[1], direction[0])


_LEAST_SQUARED_M2 = 1e-12
"""Replaces the squared length of a segment between equal points, so that no projection divides by zero."""


def project(points: Points, point: Points) -> tuple[float, float]:
    """Return the arc length of the line's point nearest to ``point`` (2,), and the signed offset from it, in metres."""
    (start_x, start_y), (step_x, step_y) = points[:-1].T, np.diff(points, axis=0).T
    x, y = point.tolist()
    # Coordinate by coordinate, since numpy is slow at reducing axes of two.
    squared = np.maximum(step_x * step_x + step_y * step_y, _LEAST_SQUARED_M2)
    along = np.clip(((x - start_x) * step_x + (y - start_y) * step_y) / squared, 0.0, 1.0)
    away_x, away_y = start_x + step_x * along - x, start_y + step_y * along - y
    distance = np.sqrt(away_x * away_x + away_y * away_y)
    index = int(np.argmin(distance))
    cross = step_x[index] * (y - start_y[index]) - step_y[index] * (x - start_x[index])
    stations = arc_length(points)
    station = float(stations[index] + along[index] * math.sqrt(squared[index]))
    return station, float(math.copysign(distance[index], cross))


_MOST_PAIRS = 2_000_000
"""Chosen: pairs of a point and a vertex in memory at once, about 150 MB."""


def project_all(points: Points, others: Points) -> tuple[Values, Values]:
    """Project many points of shape (m, 2) at once, as :func:`project` does: stations (m,), signed offsets (m,) in
    metres.
    """
    at_once = max(1, _MOST_PAIRS // len(points))
    if len(others) > at_once:
        parts = [project_all(points, others[begin : begin + at_once]) for begin in range(0, len(others), at_once)]
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    start, step = points[:-1], np.diff(points, axis=0)
    squared = np.maximum((step**2).sum(axis=1), _LEAST_SQUARED_M2)
    away = others[:, None, :] - start
    along = np.clip((away * step).sum(axis=2) / squared, 0.0, 1.0)
    distance = np.linalg.norm(away - step * along[:, :, None], axis=2)
    rows, index = np.arange(len(others)), np.argmin(distance, axis=1)
    cross = step[index, 0] * away[rows, index, 1] - step[index, 1] * away[rows, index, 0]
    stations = arc_length(points)[index] + along[rows, index] * np.sqrt(squared[index])
    return stations, np.copysign(distance[rows, index], cross)


# headings, smoothing and curvature


def wrap_angle(angle_rad: float) -> float:
    """Wrap an angle to [−π, π)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def wrap_angles(angles_rad: Values) -> Values:
    """Wrap angles to [−π, π)."""
    return np.mod(np.asarray(angles_rad) + np.pi, 2 * np.pi) - np.pi


def headings(points: Points) -> Values:
    """Return the unwrapped heading of every segment in radians, shape (n − 1,)."""
    step = points[1:] - points[:-1]
    return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def gaussian(values: NDArray[np.float64], sigma_samples: float) -> NDArray[np.float64]:
    """Smooth values (n,) or (n, m) along axis 0; points are reflected at both ends, so that the end values stay.

    The kernel ends at three sigma, or earlier for fewer values. ``scipy.ndimage.gaussian_filter1d`` on the reflected
    values agrees to 2e-15, but not to the last bit, and planners follow paths smoothed here: of 208 compared files it
    changed 11, all of them steps of runs.
    """
    count = len(values)
    radius = min(int(3 * sigma_samples + 0.5), count - 1)
    if radius < 1:
        return values
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_samples) ** 2)
    kernel /= kernel.sum()
    columns = values.reshape(count, -1)
    padded = np.concatenate(
        [2 * columns[0] - columns[radius:0:-1], columns, 2 * columns[-1] - columns[-2 : -radius - 2 : -1]]
    )
    smooth = np.stack([np.convolve(padded[:, i], kernel, "valid") for i in range(columns.shape[1])], axis=1)
    return smooth.reshape(values.shape)


_SMOOTHING_M = 4.0
"""Chosen: the length of a car. Kinks of coarsely drawn lanes within it are not curves that a car would follow."""


def curvatures(points: Points, sigma_m: float = _SMOOTHING_M, spacing_m: float = 1.0) -> tuple[Values, Values]:
    """Return arc lengths in m about ``spacing_m`` apart, and the absolute curvature there in 1/m, both (n,).

    The line is smoothed over ``sigma_m``. A line of fewer than three points has no curvature, so both arrays are empty.
    """
    points = without_repeats(points)
    if len(points) < 3:
        return np.empty(0), np.empty(0)
    stations = arc_length(points)
    count = max(int(stations[-1] / spacing_m), 3)
    at = np.linspace(0.0, stations[-1], count + 1)
    even = gaussian(interpolate(points, stations, at), sigma_m / (stations[-1] / count))
    turn = np.abs(np.diff(headings(even)))
    step = segment_lengths(even)
    return at[1:-1], turn / np.maximum((step[1:] + step[:-1]) / 2, 1e-3)


def maximum_curvature(points: Points, sigma_m: float = _SMOOTHING_M, spacing_m: float = 1.0) -> float:
    """Return the largest curvature in 1/m after smoothing over ``sigma_m``; 0 for a straight or very short line."""
    return float(np.max(curvatures(points, sigma_m, spacing_m)[1], initial=0.0))
