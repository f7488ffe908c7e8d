"""Bounding tracks for obstacles without a trajectory: they cover where a set-based prediction says they may be.

These obstacles cannot be driven, but block the road as any other does. Each part of an occupancy becomes an oriented
rectangle around it. Because these grow and turn from step to step and a track has one size, an obstacle becomes several
tracks, one after the other or side by side.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..commonroad import Track, center_of, middle_of, size_of
from ..geometry import Values, segment_lengths, wrap_angle

if TYPE_CHECKING:
    from commonroad.scenario.obstacle import DynamicObstacle
    from commonroad.scenario.scenario import Scenario

_SIZE_STEP_M = 0.5
"""Rectangles with sides that round up to the same multiple form one track, as large as the largest of them (chosen)."""
_MOVED_M = 0.05
"""A centre that moves less than this in a step gives no direction (chosen)."""
_PIECES_PER_OBSTACLE = 10_000
"""Ids of tracks are negative: -(10 000 × the obstacle's + a number)."""


@dataclass(frozen=True)
class _Box:
    """The rectangle around one part of an occupancy at a step: centre (x, y) in m, heading in rad, sides in m."""

    step: int
    center: tuple[float, float]
    heading_rad: float
    size_m: tuple[float, float]

    @property
    def size_class(self) -> tuple[int, int]:
        """The rectangle's sides in whole size steps."""
        return math.ceil(self.size_m[0] / _SIZE_STEP_M), math.ceil(self.size_m[1] / _SIZE_STEP_M)


def occupied_regions(scenario: "Scenario") -> dict[int, tuple[Track, ...]]:
    """Return bounding tracks of all dynamic obstacles without a trajectory, by obstacle id in ascending order.

    Each track has its own negative id. One obstacle's tracks cover all its occupancies at every step. Phantom obstacles
    are left out, because it is unknown whether they exist.
    """
    regions = {
        int(obstacle.obstacle_id): _tracks(obstacle, float(scenario.dt))
        for obstacle in scenario.dynamic_obstacles
        if getattr(obstacle.prediction, "trajectory", None) is None
    }
    return dict(sorted(regions.items()))


def obstacle_of(track_id: int) -> int:
    """Return the id of the obstacle that a track belongs to: the track's own id, unless it is an occupied region."""
    return track_id if track_id >= 0 else -track_id // _PIECES_PER_OBSTACLE


def _tracks(obstacle: "DynamicObstacle", step_s: float) -> tuple[Track, ...]:
    key, kind = int(obstacle.obstacle_id), str(obstacle.obstacle_type.value)
    pieces = [piece for chain in _chains(obstacle) for piece in _pieces(chain)]
    return tuple(
        Track(
            obstacle_id=-(key * _PIECES_PER_OBSTACLE + number),
            kind=kind,
            length_m=max(box.size_m[0] for box in piece),
            width_m=max(box.size_m[1] for box in piece),
            first_step=piece[0].step,
            positions=np.array([box.center for box in piece]),
            headings_rad=np.array([box.heading_rad for box in piece]),
            speeds_mps=_speeds(piece, following, step_s),
        )
        for number, (piece, following) in enumerate(pieces)
    )


def _chains(obstacle: "DynamicObstacle") -> Iterator[list[_Box]]:
    """Yield the rectangles of each part of an obstacle's occupancies, by step."""
    first = int(obstacle.initial_state.time_step)
    parts = {first: _parts(obstacle.occupancy_at_time(first).shape)}
    for occupancy in getattr(obstacle.prediction, "occupancy_set", ()):
        time = occupancy.time_step
        for step in range(int(getattr(time, "start", time)), int(getattr(time, "end", time)) + 1):
            parts.setdefault(step, _parts(occupancy.shape))
    heading = middle_of(getattr(obstacle.initial_state, "orientation", 0.0))
    for number in range(max(map(len, parts.values()))):
        shapes = [(step, parts[step][number]) for step in sorted(parts) if number < len(parts[step])]
        yield _oriented(shapes, 0.0 if math.isnan(heading) else heading)


def _parts(shape: Any) -> list[Any]:
    return list(getattr(shape, "shapes", None) or [shape])


def _oriented(shapes: list[tuple[int, Any]], heading_rad: float) -> list[_Box]:
    """Return rectangles that point in their centre's direction of motion, or as before if it stands."""
    boxes: list[_Box] = []
    for step, shape in shapes:
        center, side_rad, size = _rectangle(shape, heading_rad)
        if boxes and math.dist(center, boxes[-1].center) > _MOVED_M:
            before = boxes[-1].center
            heading_rad = math.atan2(center[1] - before[1], center[0] - before[0])
        quarters = round(wrap_angle(heading_rad - side_rad) / (math.pi / 2))
        turned = size if quarters % 2 == 0 else (size[1], size[0])
        boxes.append(_Box(step, center, wrap_angle(side_rad + quarters * math.pi / 2), turned))
    return boxes


def _rectangle(shape: Any, heading_rad: float) -> tuple[tuple[float, float], float, tuple[float, float]]:
    """Return a bounding rectangle: centre in m, direction of one side in rad, and the sides in m (that side first)."""
    if hasattr(shape, "length") or hasattr(shape, "radius"):
        x, y = center_of(shape)
        return (float(x), float(y)), float(getattr(shape, "orientation", heading_rad)), size_of(shape)
    corners = np.asarray(shape.shapely_object.minimum_rotated_rectangle.exterior.coords)[:4]
    along, across = corners[1] - corners[0], corners[2] - corners[1]
    x, y = corners.mean(axis=0)
    size = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    return (float(x), float(y)), math.atan2(along[1], along[0]), size


def _pieces(chain: list[_Box]) -> Iterator[tuple[list[_Box], _Box | None]]:
    """Yield the pieces of a chain, cut at missing steps and size changes, each with the next rectangle."""
    begin = 0
    for index, box in enumerate(chain):
        following = chain[index + 1] if index + 1 < len(chain) else None
        if following is None or following.step != box.step + 1 or following.size_class != box.size_class:
            yield chain[begin : index + 1], following
            begin = index + 1


def _speeds(piece: list[_Box], following: _Box | None, step_s: float) -> Values:
    """Return the speeds of the centres in m/s; the last speed equals the speed before it if nothing follows."""
    onward = [*piece, following] if following is not None else piece
    centers, steps = np.array([box.center for box in onward]), np.array([box.step for box in onward])
    if len(onward) == 1:
        return np.zeros(1)
    speeds = segment_lengths(centers) / (np.diff(steps) * step_s)
    return speeds if following is not None else np.append(speeds, speeds[-1])
