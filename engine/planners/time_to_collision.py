"""Time to collision of two road users that keep their present courses and speeds (Hayward 1972), in the plane.

Both are oriented rectangles that move without turning. On every axis that is normal to a side, their shadows overlap
during an interval of time; the rectangles overlap while all four shadows do (separating axes).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.geometry.polyline import Points, Values


@dataclass(frozen=True)
class MovingRectangles:
    """Rectangles that move along their headings: centres (n, 2), headings (n,), sizes (n, 2), speeds (n,)."""

    centers: Points
    headings_rad: Values
    sizes_m: Points
    speeds_mps: Values

    @property
    def velocities(self) -> Points:
        """Velocities of shape (n, 2) in m/s."""
        return self.speeds_mps[:, None] * _directions(self.headings_rad)


def corners_of(bodies: MovingRectangles) -> NDArray[np.float64]:
    """The corners of shape (n, 4, 2), counter-clockwise from the front left."""
    along = _directions(bodies.headings_rad)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    long, wide = along * bodies.sizes_m[:, :1] / 2, across * bodies.sizes_m[:, 1:] / 2
    center = bodies.centers
    return np.stack([center + long + wide, center - long + wide, center - long - wide, center + long - wide], axis=1)


def times_to_collision_s(ones: MovingRectangles, others: MovingRectangles) -> Values:
    """Seconds until the i-th rectangles first touch, 0 while they overlap, infinite where they never will; (n,)."""
    first, second = corners_of(ones), corners_of(others)
    closing = ones.velocities - others.velocities
    begin, end = np.zeros(len(closing)), np.full(len(closing), np.inf)
    quarter = np.pi / 2
    for headings in (
        ones.headings_rad,
        ones.headings_rad + quarter,
        others.headings_rad,
        others.headings_rad + quarter,
    ):
        axis = _directions(headings)
        near, far = (np.einsum("nki,ni->nk", corners, axis) for corners in (first, second))
        speed = np.einsum("ni,ni->n", closing, axis)
        before, behind = far.min(axis=1) - near.max(axis=1), far.max(axis=1) - near.min(axis=1)
        moves = np.abs(speed) >= 1e-9
        divisor = np.where(moves, speed, 1.0)
        enters, leaves = np.sort([before / divisor, behind / divisor], axis=0)
        apart = ~moves & ((before > 0) | (behind < 0))
        begin = np.where(moves, np.maximum(begin, enters), np.where(apart, np.inf, begin))
        end = np.where(moves, np.minimum(end, leaves), end)
    return np.where(begin <= end, begin, np.inf)


def _directions(headings_rad: Values) -> Points:
    return np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=1)
