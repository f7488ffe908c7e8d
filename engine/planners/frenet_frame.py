"""The coordinate system of the C++ core in a turned frame.

The core interpolates the reference heading as its smallest angle, so it jumps by 2π where a route crosses ±π, and
every candidate there fails the yaw-rate check. We give the core coordinates that are turned to the middle of the
headings ahead; a route that turns through more than a full circle gets a new frame on the way.

The core also takes the direction of the segment behind a vertex for the heading at the vertex, so its headings run half
a segment ahead of its positions: in a bend the ego would look up to 40 mrad aside from where its rear axle moves, which
no vehicle can drive. We put the tangents at the vertices in their place.
"""

import math
from dataclasses import dataclass

import frenetix
import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, headings

SAFE_RANGE_RAD = 0.75 * math.pi


@dataclass(frozen=True)
class FrenetFrame:
    """A reference path as the core sees it: moved to ``origin`` and turned by ``-angle_rad``."""

    origin: Points
    angle_rad: float
    system: "frenetix.CoordinateSystemWrapper"

    @classmethod
    def of(cls, path: Points, angle_rad: float) -> "FrenetFrame":
        """The frame of a path for a middle heading."""
        origin = np.array(path[0])
        inner = np.ascontiguousarray((path - origin) @ _rotation(angle_rad))
        system = frenetix.CoordinateSystemWrapper(inner)
        system.ref_theta = tangents(np.array(system.ref_theta))
        return cls(origin, angle_rad, system)

    def inwards(self, points: Points) -> Points:
        """World coordinates, shape (…, 2), in the frame."""
        inner: Points = (points - self.origin) @ _rotation(self.angle_rad)
        return inner

    def outwards(self, points: Points) -> Points:
        """Frame coordinates, shape (n, 2), in the world."""
        outer: Points = points @ _rotation(self.angle_rad).T + self.origin
        return outer

    def heading_inwards(self, heading_rad: float) -> float:
        """A heading in the frame, in [−π, π)."""
        return (heading_rad - self.angle_rad + math.pi) % math.tau - math.pi


class FrameKeeper:
    """Gives the frame in which no heading ahead comes near ±π, and a new one only where the old does not serve."""

    def __init__(self, path: Points) -> None:
        try:
            self._follow(path)
        except RuntimeError:
            self._follow(longest_accepted(path))

    def _follow(self, path: Points) -> None:
        self._path = path
        self._stations = arc_length(path)[:-1]
        self._headings = headings(path)
        whole = (float(self._headings.min()), float(self._headings.max()))
        fits = whole[1] - whole[0] < 2 * SAFE_RANGE_RAD
        self.frame = FrenetFrame.of(path, _middle(*whole) if fits else float(self._headings[0]))

    def frame_for(self, station_m: float, ahead_m: float) -> FrenetFrame:
        """The frame for planning from an arc length over the metres ahead."""
        window = self._window(station_m, ahead_m)
        turned = np.abs(np.remainder(window - self.frame.angle_rad + math.pi, math.tau) - math.pi)
        spread = float(window.max() - window.min())
        if float(turned.max()) > SAFE_RANGE_RAD and spread < 2 * SAFE_RANGE_RAD:
            self.frame = FrenetFrame.of(self._path, _middle(float(window.min()), float(window.max())))
        return self.frame

    def _window(self, station_m: float, ahead_m: float) -> Values:
        near = (self._stations >= station_m - 10.0) & (self._stations <= station_m + ahead_m)
        return self._headings[near] if near.any() else self._headings[-1:]


def longest_accepted(path: Points) -> Points:
    """The path, or as much of it from its beginning as the core takes.

    Where a path comes back over itself, as one does that goes on around the loop of a dead end, the core finds no area
    in which every point has one place along the path, and refuses the whole.
    """
    accepted, refused = 2, len(path)
    while refused - accepted > 1:
        middle = (accepted + refused) // 2
        accepted, refused = (middle, refused) if _is_accepted(path[:middle]) else (accepted, middle)
    return path[:accepted]


def _is_accepted(path: Points) -> bool:
    try:
        FrenetFrame.of(path, 0.0)
    except RuntimeError:
        return False
    return True


def tangents(segments_rad: Values) -> Values:
    """Heading at every vertex: the middle of the segments before and after it.

    ``segments_rad``: heading of the segment after each vertex, without jumps, the last one twice.
    """
    tangents = segments_rad.copy()
    tangents[1:-1] = 0.5 * (segments_rad[:-2] + segments_rad[1:-1])
    return tangents


def _middle(low: float, high: float) -> float:
    return (low + high) / 2


def _rotation(angle_rad: float) -> Points:
    """Matrix R with ``p @ R`` turned by ``-angle_rad``."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
