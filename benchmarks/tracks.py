"""Positions, overlaps and feasibility of road users' tracks, for the judges of all benches."""

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from plannerforge.engine.commonroad import Track
from plannerforge.engine.geometry import Points, Values
from plannerforge.engine.vehicles import Motion, check_drivability, nearest_class

_LEAST_SIZE_M = 0.01
"""Remaining size of a body that is reduced by more than its size."""


def directions(headings_rad: Values) -> Points:
    """Return unit vectors (n, 2) along headings."""
    return np.column_stack([np.cos(headings_rad), np.sin(headings_rad)])


def fronts(track: Track) -> Points:
    """Return the front bumper at every step, (n, 2) in m."""
    return np.asarray(track.positions + track.length_m / 2 * directions(track.headings_rad))


def ahead_and_left_m(point: Points, position: Points, heading_rad: float) -> tuple[float, float]:
    """Return how far a point is ahead and to the left of a position with a heading."""
    dx, dy = float(point[0] - position[0]), float(point[1] - position[1])
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return dx * cos + dy * sin, dy * cos - dx * sin


def bodies(track: Track, indices: NDArray[np.int_], larger_m: float = 0.0) -> NDArray[np.object_]:
    """Return the rectangles (shapely) of a road user at indices of its track, larger by a distance on every side."""
    length_m, width_m = (max(size + 2 * larger_m, _LEAST_SIZE_M) for size in (track.length_m, track.width_m))
    centers, headings_rad = track.positions[indices], track.headings_rad[indices]
    ahead, left = directions(headings_rad) * length_m / 2, directions(headings_rad + np.pi / 2) * width_m / 2
    corners = (ahead + left, left - ahead, -ahead - left, ahead - left)
    return np.asarray(shapely.polygons(np.stack([centers + corner for corner in corners], axis=1)))


def overlap_steps(one: Track, other: Track, depth_m: float) -> list[int]:
    """Return the steps at which two road users overlap, both reduced by a margin on every side."""
    steps = np.arange(max(one.first_step, other.first_step), min(one.last_step, other.last_step) + 1)
    apart_m = one.positions[steps - one.first_step] - other.positions[steps - other.first_step]
    reach_m = (one.length_m + one.width_m + other.length_m + other.width_m) / 2
    near = steps[np.linalg.norm(apart_m, axis=1) < reach_m]
    shapes = (bodies(track, near - track.first_step, -depth_m) for track in (one, other))
    return [int(step) for step in near[shapely.intersects(*shapes)]]


def is_drivable(track: Track, step_s: float, begin: int = 0, end: int | None = None) -> bool:
    """Return True if the drivability checker accepts a part of a track, with the axles of the vehicle's class."""
    chassis, part = nearest_class(track.kind, track.length_m), slice(begin, end)
    speeds_mps = track.speeds_mps[part]
    motion = Motion(track.positions[part], track.headings_rad[part], speeds_mps, np.zeros(len(speeds_mps)))
    axles = {"wheelbase_m": chassis.wheelbase_m, "rear_axle_m": chassis.rear_axle_m}
    return check_drivability(motion, step_s, **axles).feasible
