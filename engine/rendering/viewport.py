"""Which part of a scenario a picture shows: the ego, its way and its goal, not the whole map."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.rendering.driven_path import DrivenPath
from plannerforge.engine.rendering.scene_content import SceneContent

MARGIN_M = 14.0
SMALLEST_SPAN_M = 80.0
LARGEST_SPAN_M = 260.0
FLATTEST_RATIO = 3.0
STEEPEST_RATIO = 1.1
GOAL_SHOWN_M = 30.0
NEIGHBOURS_M = 35.0
LOOK_AHEAD_S = 2.5


@dataclass(frozen=True)
class Viewport:
    """A rectangle in scenario coordinates (metres)."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width_m(self) -> float:
        """Extent along x."""
        return self.x_max - self.x_min

    @property
    def height_m(self) -> float:
        """Extent along y."""
        return self.y_max - self.y_min

    def contains(self, points: Points) -> bool:
        """Whether any of the points (n, 2) lies inside."""
        x, y = points[:, 0], points[:, 1]
        inside = (self.x_min <= x) & (x <= self.x_max) & (self.y_min <= y) & (y <= self.y_max)
        return bool(inside.any())


def viewport_of(content: SceneContent, paths: Sequence[DrivenPath] = (), step: int | None = None) -> Viewport:
    """The part that matters: ego, neighbours, driven paths and the near end of the goal; else the traffic or the map.

    At least 80 m wide, at most 260 m in each direction, no flatter than 3 to 1: pictures keep a usable shape.
    """
    points = _points_of_interest(content, paths, step)
    center = _anchor(content, paths, step, points)
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    low, high = _limited(low, high, center)
    width, height = high - low
    middle = (low + high) / 2
    width, height = max(width, SMALLEST_SPAN_M), max(height, SMALLEST_SPAN_M / FLATTEST_RATIO)
    height = max(height, width / FLATTEST_RATIO)
    width = max(width, height * STEEPEST_RATIO)
    return Viewport(middle[0] - width / 2, middle[1] - height / 2, middle[0] + width / 2, middle[1] + height / 2)


def union(first: Viewport, second: Viewport) -> Viewport:
    """The smallest viewport that holds both: for pictures that shall be compared."""
    return Viewport(
        min(first.x_min, second.x_min),
        min(first.y_min, second.y_min),
        max(first.x_max, second.x_max),
        max(first.y_max, second.y_max),
    )


def _points_of_interest(content: SceneContent, paths: Sequence[DrivenPath], step: int | None) -> Points:
    found = [path.positions for path in paths]
    at = content.ego_step if step is None else step
    present = [track.positions[index] for track in content.tracks.values() if (index := track.index_at(at)) is not None]
    traffic = np.array(present).reshape(-1, 2)
    if content.ego_position is not None:
        direction = np.array([np.cos(content.ego_heading_rad), np.sin(content.ego_heading_rad)])
        ahead = content.ego_position + direction * content.ego_speed_mps * LOOK_AHEAD_S
        found += [content.ego_position[None, :]] if paths else [np.stack([content.ego_position, ahead])]
        center = paths[0].positions[paths[0].index_at(at)] if paths else content.ego_position
        found.append(traffic[np.linalg.norm(traffic - center, axis=1) <= NEIGHBOURS_M])
        goal = content.goal_points()
        if len(goal):
            reference = np.vstack(found)
            distance = np.linalg.norm(goal[:, None, :] - reference[None, :, :], axis=2).min(axis=1)
            found.append(goal[distance <= distance.min() + GOAL_SHOWN_M])
    else:
        found.append(traffic)
    if not any(len(points) for points in found):
        found = [lanelet.center for lanelet in content.lanelets] or [np.zeros((1, 2))]
    return np.vstack(found)


def _anchor(content: SceneContent, paths: Sequence[DrivenPath], step: int | None, points: Points) -> Points:
    if paths and step is not None:
        anchor: Points = paths[0].positions[paths[0].index_at(step)]
        return anchor
    if content.ego_position is not None:
        return content.ego_position
    middle: Points = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle


def _limited(low: Points, high: Points, center: Points) -> tuple[Points, Points]:
    """Cut an extent that is too large, keeping the centre of interest inside."""
    for axis in (0, 1):
        if high[axis] - low[axis] > LARGEST_SPAN_M:
            start = np.clip(center[axis] - LARGEST_SPAN_M / 2, low[axis], high[axis] - LARGEST_SPAN_M)
            low[axis], high[axis] = start, start + LARGEST_SPAN_M
    return low, high
