"""What is in view from a point: the share of each body's outline that lies in the field of view and is not hidden.

Bodies are rectangles, and the share is exact. Seen from a point, a convex body covers an interval of angles. If two
convex bodies do not overlap, one of them is in front wherever their intervals overlap: a line separates the bodies, and
every ray that meets both crosses it at most once. So the hidden part of a body is the union of the intervals of those
in front of it, and one ray decides which of two is in front.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points, Values, wrap_angles

if TYPE_CHECKING:
    from commonroad.scenario.scenario import Scenario

LOOKED_PAST = frozenset({"pedestrian", "bicycle", "motorcycle"})
"""Road users that hide nothing, because a sensor sees past and over them."""
_OPAQUE_KINDS = ("building", "pillar")
"""CommonRoad's types of environment obstacles that are as high as a road user."""
_WALL_M = 0.02
"""Thickness of a wall (chosen: it hides nothing by itself if seen from its end)."""
_NOTHING_RAD = 1e-9
_PARALLEL = 1e-12


@dataclass(frozen=True)
class Bodies:
    """The same n rectangles in f frames: centres (f, n, 2) in m, headings (f, n) in rad, length and width (n, 2) in m.

    ``hides`` (n,): those that hide what is behind them. ``present`` (f, n): those that exist in a frame.
    """

    centres: Points
    headings_rad: Points
    sizes_m: Points
    hides: NDArray[np.bool_]
    present: NDArray[np.bool_]

    def and_walls(self, walls: "Bodies") -> "Bodies":
        """Return these bodies followed by walls, which stand still and are given in one frame."""
        frames = len(self.centres)
        return Bodies(
            np.concatenate([self.centres, np.repeat(walls.centres, frames, axis=0)], axis=1),
            np.concatenate([self.headings_rad, np.repeat(walls.headings_rad, frames, axis=0)], axis=1),
            np.concatenate([self.sizes_m, walls.sizes_m]),
            np.concatenate([self.hides, walls.hides]),
            np.concatenate([self.present, np.repeat(walls.present, frames, axis=0)], axis=1),
        )

    def near(self, point: Points, radius_m: float) -> "Bodies":
        """Return the bodies of a single frame that may have a part within a radius of a point."""
        reach = np.hypot(self.sizes_m[:, 0], self.sizes_m[:, 1]) / 2
        kept = np.hypot(*(self.centres[0] - point).T) - reach <= radius_m
        return Bodies(
            self.centres[:, kept],
            self.headings_rad[:, kept],
            self.sizes_m[kept],
            self.hides[kept],
            self.present[:, kept],
        )


NO_BODIES = Bodies(
    np.empty((1, 0, 2)), np.empty((1, 0)), np.empty((0, 2)), np.empty(0, dtype=bool), np.empty((1, 0), dtype=bool)
)


def walls_of(scenario: "Scenario") -> Bodies:
    """Return the walls of a scenario's buildings and pillars; empty if its map has none."""
    walls = [wall for obstacle in scenario.environment_obstacle for wall in _walls(obstacle)]
    if not walls:
        return NO_BODIES
    ends = np.array(walls, dtype=float)
    along = ends[:, 1] - ends[:, 0]
    lengths = np.hypot(along[:, 0], along[:, 1])
    return Bodies(
        ends.mean(axis=1)[None],
        np.arctan2(along[:, 1], along[:, 0])[None],
        np.stack([lengths, np.full(len(walls), _WALL_M)], axis=1),
        np.ones(len(walls), dtype=bool),
        np.ones((1, len(walls)), dtype=bool),
    )


def _walls(obstacle: Any) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yield the sides of an environment obstacle's outline as pairs of points."""
    if str(obstacle.obstacle_type.value) not in _OPAQUE_KINDS:
        return
    shapes = getattr(obstacle.obstacle_shape, "shapes", None) or [obstacle.obstacle_shape]
    for shape in shapes:
        corners = list(shape.shapely_object.exterior.coords)
        yield from pairwise(corners)


@dataclass(frozen=True)
class InView:
    """For each body, the share of its outline in the field of view, and the share that is also visible, each (f, n).

    ``hidden_by`` (f, n): the body that hides the largest part of it, or −1 if it is not hidden.
    """

    within: Points
    visible: Points
    hidden_by: NDArray[np.intp]


def seen_shares(origins: Points, headings_rad: Values, view_rad: float, bodies: Bodies, *, count: int) -> InView:
    """Return how much of the first ``count`` bodies is in view from a point in each frame; all bodies may hide them.

    The outline of a body is measured by the angle that it covers, seen from the point. ``origins`` (f, 2) are the
    points and ``headings_rad`` (f,) the centres of the field of view, which is ``view_rad`` wide. A body that contains
    the point is in view and hides nothing.
    """
    offsets = bodies.centres - origins[:, None, :]
    bearings = np.arctan2(offsets[..., 1], offsets[..., 0])
    low, high = _covered(offsets, bearings, bodies)
    around = high - low >= math.pi
    width = np.maximum(high - low, _NOTHING_RAD)[:, :count]
    begin, end = low[:, :count], high[:, :count]
    if view_rad < math.tau:
        ahead = wrap_angles(bearings[:, :count] - headings_rad[:, None])
        begin, end = np.maximum(begin, -view_rad / 2 - ahead), np.minimum(end, view_rad / 2 - ahead)
    within = np.where(around[:, :count], 1.0, np.maximum(end - begin, 0.0) / width)

    shift = wrap_angles(bearings[:, None, :] - bearings[:, :count, None])
    starts = np.maximum(shift + low[:, None, :], begin[:, :, None])
    ends = np.minimum(shift + high[:, None, :], end[:, :, None])
    may_hide = (ends - starts > _NOTHING_RAD) & (bodies.hides & bodies.present & ~around)[:, None, :]
    may_hide &= ~around[:, :count, None]
    may_hide[:, np.arange(count), np.arange(count)] = False
    frames, targets, hiders = np.nonzero(may_hide)
    visible, hidden_by = within.copy(), np.full(within.shape, -1, dtype=np.intp)
    if not len(frames):
        return InView(within, visible, hidden_by)
    first, last = starts[frames, targets, hiders], ends[frames, targets, hiders]
    ray = (first + last) / 2 + bearings[frames, targets]
    in_front = _distance(offsets, bodies, (frames, hiders), ray) < _distance(offsets, bodies, (frames, targets), ray)
    chosen = np.flatnonzero(in_front)
    order = chosen[np.lexsort((first[chosen], targets[chosen], frames[chosen]))]
    pairs = zip(*(each[order].tolist() for each in (frames, targets, hiders, first, last)), strict=True)
    hidden = dict[tuple[int, int], float]()
    until = dict[tuple[int, int], float]()
    largest = dict[tuple[int, int], float]()
    for frame, target, hider, one, other in pairs:
        key = (frame, target)
        covered = until.get(key, -math.inf)
        hidden[key] = hidden.get(key, 0.0) + max(other - max(one, covered), 0.0)
        until[key] = max(covered, other)
        if other - one > largest.get(key, 0.0):
            largest[key], hidden_by[key] = other - one, hider
    for key, angle in hidden.items():
        visible[key] = max(within[key] - angle / width[key], 0.0)
    return InView(within, visible, hidden_by)


def _covered(offsets: Points, bearings: Points, bodies: Bodies) -> tuple[Points, Points]:
    """Return the interval of angles (f, n), (f, n) in rad that each body covers, relative to its centre's bearing."""
    cosine, sine = np.cos(bodies.headings_rad), np.sin(bodies.headings_rad)
    half_length, half_width = bodies.sizes_m[:, 0] / 2, bodies.sizes_m[:, 1] / 2
    along_x, along_y = cosine * half_length, sine * half_length
    across_x, across_y = -sine * half_width, cosine * half_width
    x, y = offsets[..., 0], offsets[..., 1]
    corners_x = np.stack(
        [x + along_x + across_x, x - along_x + across_x, x - along_x - across_x, x + along_x - across_x]
    )
    corners_y = np.stack(
        [y + along_y + across_y, y - along_y + across_y, y - along_y - across_y, y + along_y - across_y]
    )
    angles = wrap_angles(np.arctan2(corners_y, corners_x) - bearings)
    return angles.min(axis=0), angles.max(axis=0)


def _distance(
    offsets: Points, bodies: Bodies, chosen: tuple[NDArray[np.intp], NDArray[np.intp]], ray_rad: Values
) -> Values:
    """Return the distance (m,) in m at which rays from the origin enter the chosen bodies (frame, number)."""
    heading = bodies.headings_rad[chosen]
    cosine, sine, x, y = np.cos(heading), np.sin(heading), offsets[..., 0][chosen], offsets[..., 1][chosen]
    start = np.stack([-(x * cosine + y * sine), x * sine - y * cosine], axis=1)
    ahead = np.stack([np.cos(ray_rad - heading), np.sin(ray_rad - heading)], axis=1)
    ahead = np.where(np.abs(ahead) < _PARALLEL, _PARALLEL, ahead)
    half = bodies.sizes_m[chosen[1]] / 2
    entry = np.minimum((-half - start) / ahead, (half - start) / ahead)
    return np.asarray(entry.max(axis=1))
