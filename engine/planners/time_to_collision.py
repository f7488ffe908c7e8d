"""Time to collision of two road users that keep their present courses and speeds (Hayward 1972), in the plane.

Both are oriented rectangles that move without turning. On every axis that is normal to a side, their shadows overlap
during an interval of time; the rectangles overlap while all four shadows do (separating axes).
"""

import math
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, oriented_rectangle


@dataclass(frozen=True)
class MovingRectangle:
    """A rectangle (length, width) in metres at a centre of shape (2,), moving along its heading."""

    center: Points
    heading_rad: float
    size_m: tuple[float, float]
    speed_mps: float

    @property
    def velocity(self) -> Points:
        """Velocity of shape (2,) in m/s."""
        return self.speed_mps * np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])


def time_to_collision_s(one: MovingRectangle, other: MovingRectangle) -> float | None:
    """Seconds until the rectangles first touch, 0 while they overlap; None where they never will."""
    first, second = (oriented_rectangle(body.center, body.heading_rad, body.size_m) for body in (one, other))
    closing = one.velocity - other.velocity
    begin, end = 0.0, math.inf
    for heading in (one.heading_rad, one.heading_rad + math.pi / 2, other.heading_rad, other.heading_rad + math.pi / 2):
        axis = np.array([math.cos(heading), math.sin(heading)])
        near, far, speed = first @ axis, second @ axis, float(closing @ axis)
        before, behind = float(far.min() - near.max()), float(far.max() - near.min())
        if abs(speed) < 1e-9:
            if before > 0 or behind < 0:
                return None
            continue
        times = sorted((before / speed, behind / speed))
        begin, end = max(begin, times[0]), min(end, times[1])
        if begin > end:
            return None
    return begin
