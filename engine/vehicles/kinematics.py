"""Computes the positions of a vehicle's centre and rear axle, and bounds on its position and speed after some time. A
vehicle is assumed to reach its maximum acceleration at every speed, forwards and braking, up to its top speed. The
extreme motions between two speeds consist of one phase of braking and one of accelerating, in either order.
CommonRoad's vehicle 2 (11.5 m/s², 50.8 m/s) represents every car. Lengths in m, times in s, speeds in m/s, headings in
rad.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points, Values
from .models import BMW_320I, VehicleParameters


def rear_axle(center: Points, heading_rad: float, vehicle: VehicleParameters) -> Points:
    """Return the position of the rear axle, shape (2,), for a centre and heading."""
    return center - vehicle.rear_axle_behind_center_m * np.array([math.cos(heading_rad), math.sin(heading_rad)])


def centers(rear: Points, headings_rad: Points, vehicle: VehicleParameters) -> Points:
    """Return positions of the centre, shape (n, 2), for positions of the rear axle and headings of shape (n,)."""
    direction = np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=1)
    moved: Points = rear + vehicle.rear_axle_behind_center_m * direction
    return moved


def farthest_m(speed_mps: float, duration_s: float, vehicle: VehicleParameters, top_mps: float = math.inf) -> float:
    """Return the longest distance in m that a vehicle covers in a time.

    The vehicle accelerates at its maximum up to its top speed, which it then keeps. The power of its engine, the road
    and other vehicles are ignored, so no drive is longer. An infinite time gives an infinite distance.

    Args:
        speed_mps: the vehicle's speed at the beginning.
        duration_s: the time, at least 0.
        vehicle: its largest acceleration and speed.
        top_mps: a lower speed than the vehicle's largest that it does not exceed, such as a speed limit. A vehicle
            that is faster at the beginning keeps its speed.
    """
    top = max(min(vehicle.maximum_speed_mps, top_mps), speed_mps)
    if math.isinf(duration_s):
        return math.inf
    faster_s = min(duration_s, (top - speed_mps) / vehicle.maximum_acceleration_mps2)
    gained_m = vehicle.maximum_acceleration_mps2 * faster_s**2 / 2
    return speed_mps * faster_s + gained_m + top * (duration_s - faster_s)


def can_be_between(
    speed_mps: float,
    bounds_m: tuple[float, float],
    times_s: Values,
    finals_mps: Values,
    vehicle: VehicleParameters = BMW_320I,
) -> NDArray[np.bool_]:
    """Return whether a vehicle can be between two distances ahead for each of n times and m speeds, shape (n, m)."""
    nearest, farthest = _spans_m(speed_mps, times_s[:, None], finals_mps[None], vehicle)
    change_mps = vehicle.maximum_acceleration_mps2 * times_s[:, None]
    in_time = np.abs(finals_mps[None] - speed_mps) <= change_mps + 1e-9
    there: NDArray[np.bool_] = in_time & (nearest <= bounds_m[1] + 1e-9) & (farthest >= bounds_m[0] - 1e-9)
    return there


def least_time_s(speed_mps: float, distance_m: float, vehicle: VehicleParameters = BMW_320I) -> float:
    """Return the shortest time in s in which a vehicle covers a distance from a speed."""
    largest_mps2, top_mps = vehicle.maximum_acceleration_mps2, vehicle.maximum_speed_mps
    speed, ahead = min(speed_mps, top_mps), max(distance_m, 0.0)
    gaining_m = (top_mps**2 - speed**2) / (2 * largest_mps2)
    if ahead <= gaining_m:
        return (math.sqrt(speed**2 + 2 * largest_mps2 * ahead) - speed) / largest_mps2
    return (top_mps - speed) / largest_mps2 + (ahead - gaining_m) / top_mps


def latest_passing_s(speed_mps: float, distance_m: float, vehicle: VehicleParameters = BMW_320I) -> float:
    """Return the time in s by which a vehicle must have covered a distance in m; infinite if it can stop first."""
    left = speed_mps**2 - 2 * vehicle.maximum_acceleration_mps2 * max(distance_m, 0.0)
    return math.inf if left <= 0.0 else (speed_mps - math.sqrt(left)) / vehicle.maximum_acceleration_mps2


def _spans_m(
    speed_mps: float, times_s: Values, finals_mps: Values, vehicle: VehicleParameters
) -> tuple[Values, Values]:
    """Return the shortest and longest distances in m that can be driven in given times from one speed to final speeds.

    Times and final speeds are broadcast together.
    """
    hardest_mps2 = vehicle.maximum_acceleration_mps2
    largest, both = 2 * hardest_mps2, speed_mps**2 + finals_mps**2
    slowest = np.maximum((speed_mps + finals_mps - hardest_mps2 * times_s) / 2, 0.0)
    fastest = (speed_mps + finals_mps + hardest_mps2 * times_s) / 2
    top = np.minimum(fastest, max(vehicle.maximum_speed_mps, speed_mps))
    held_s = 2 * (fastest - top) / hardest_mps2
    return (both - 2 * slowest**2) / largest, (2 * top**2 - both) / largest + top * held_s
