"""From SUMO's front-bumper track to a drivable motion of the vehicle's centre.

SUMO moves vehicles along lane centre lines with kinks, and steps in acceleration: 39 % of raw tracks pass the
drivability checker's kinematic single-track model. The path is smoothed over arc length, the progress over time, and
the heading follows as a tractrix: the rear axle is dragged behind the front bumper as a real one is.
"""

import math
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, gaussian, interpolate

REAR_AXLE_BEHIND_CENTER_M = 1.4227
"""Distance from the centre back to the rear axle of CommonRoad's vehicle 2 (BMW 320i)."""


@dataclass(frozen=True)
class Motion:
    """Motion of a centre: positions (n, 2) in m; headings (n,) in rad, speeds in m/s, accelerations in m/s²."""

    positions: Points
    headings_rad: Values
    speeds_mps: Values
    accelerations_mps2: Values


def drivable_motion(
    front: Points,
    first_heading_rad: float,
    length_m: float,
    step_s: float,
    *,
    sigma_steps: float = 3.0,
    sigma_m: float = 2.0,
    rear_axle_m: float = REAR_AXLE_BEHIND_CENTER_M,
) -> Motion:
    """The motion of the centre for a track of the front bumper, shape (n, 2), one point a step."""
    front = np.asarray(front, dtype=float)
    count = len(front)
    stations = arc_length(front)
    if stations[-1] < 0.3:
        heading = np.full(count, first_heading_rad)
        direction = np.array([math.cos(first_heading_rad), math.sin(first_heading_rad)])
        still = np.repeat(front[:1], count, axis=0) - length_m / 2 * direction
        return Motion(still, heading, np.zeros(count), np.zeros(count))
    guide = _smooth_guide(front, stations, sigma_steps, sigma_m)
    heading = tractrix(guide, first_heading_rad, length_m / 2 + rear_axle_m)
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    rear = guide - (length_m / 2 + rear_axle_m) * direction
    speed = np.gradient(arc_length(rear), step_s)
    speed[speed < 0.02] = 0.0
    return Motion(guide - length_m / 2 * direction, heading, speed, np.gradient(speed, step_s))


def _smooth_guide(front: Points, stations: Values, sigma_steps: float, sigma_m: float) -> Points:
    """The front track, smoothed across its path and along its time."""
    moving = np.concatenate([[True], np.diff(stations) > 1e-3])
    cells = max(int(stations[-1] / 0.25), 4)
    even = np.linspace(0.0, stations[-1], cells + 1)
    path = gaussian(interpolate(front[moving], stations[moving], even), sigma_m / (stations[-1] / cells))
    progress = np.maximum.accumulate(np.clip(gaussian(stations, sigma_steps), 0.0, stations[-1]))
    along = arc_length(path)
    return interpolate(path, along, np.interp(progress, even, along))


def tractrix(guide: Points, first_heading_rad: float, drag_m: float) -> Values:
    """Heading of a rod of length ``drag_m`` whose front end follows the guide, shape (n,), unwrapped."""
    heading = np.empty(len(guide))
    heading[0] = angle = first_heading_rad
    points = guide.tolist()  # plain floats: ten times as fast as small arrays
    rear_x, rear_y = points[0][0] - drag_m * math.cos(angle), points[0][1] - drag_m * math.sin(angle)
    for step in range(1, len(points)):
        (x, y), (tip_x, tip_y) = points[step - 1], points[step]
        for quarter in range(1, 5):
            front_x, front_y = x + (tip_x - x) * quarter / 4, y + (tip_y - y) * quarter / 4
            angle = math.atan2(front_y - rear_y, front_x - rear_x)
            rear_x, rear_y = front_x - drag_m * math.cos(angle), front_y - drag_m * math.sin(angle)
        heading[step] = angle
    return np.unwrap(heading)
