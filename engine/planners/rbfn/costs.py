"""The seven cost channels of MP-RBFN, each divided by its own scale so that 1 is a high cost.

Names and meanings are those of the planner's public copy; the scales, which make its weights comparable, are ours. Each
channel takes a ``ChannelBatch`` and returns costs of shape (n,):

- ``distance_to_reference_path``: mean offset from the path, divided by 3 m; ``…_final``: at the last step;
- ``velocity_offset_final``: squared difference from the desired speed at the last step, divided by (5 m/s)²;
- ``orientation_offset``: mean squared angle to the path, divided by (0.5 rad)²; ``…_final``: at the last step;
- ``prediction``: the sum over the predicted obstacles of (2 / d)², at most 1 each. d is the smallest Mahalanobis
  distance to the obstacle over the steps. It combines the prediction's uncertainty with the bodies. Two
  standard deviations are an ellipse with the sum of the half lengths and the sum of the half widths as semi-axes, so
  the bodies touch at d = 2;
- ``distance_to_boundary``: mean inverse squared distance of the ego's side to the edge of the road, divided by
  (0.5 m)², at most 1.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, Values
from ...vehicles import VehicleParameters
from ..interface import PredictedObstacle
from ..lanes import Road

_OFFSET_M, _SPEED_MPS, _ANGLE_RAD, _CLEARANCE_M = 3.0, 5.0, 0.5, 0.5
"""Values that count as 1 in the channels of distance, speed, angle and boundary (chosen)."""
_TOUCHING = 2.0
"""Standard deviations at which the bodies touch."""
_FARTHEST_M = 30.0
"""Obstacles farther from all candidates are left out, since they cost less than 0.03 (chosen)."""
_EDGE_SPACING_M = 0.5
"""Distance between the points that represent the edge of the road (chosen)."""


class RoadEdge:
    """Points of the edge of a road, built once per run."""

    def __init__(self, road: Road) -> None:
        import shapely
        from scipy.spatial import cKDTree

        lines = shapely.get_parts(shapely.segmentize(road.area.boundary, _EDGE_SPACING_M))
        self._tree = cKDTree(shapely.get_coordinates(lines))

    def distances_m(self, x_m: Points, y_m: Points) -> Points:
        """Return the distances of points from the edge, on either side of it."""
        return np.asarray(self._tree.query(np.stack([x_m, y_m], axis=-1))[0])


@dataclass(frozen=True)
class ChannelBatch:
    """n candidates at m of their steps (``steps``): centres, and offsets and angles relative to the path, (n, m).

    ``final_mps`` (n,): speeds at the last step.
    """

    steps: NDArray[np.intp]
    x_m: Points
    y_m: Points
    offset_m: Points
    turned_rad: Points
    final_mps: Values
    desired_mps: float
    obstacles: tuple[PredictedObstacle, ...]
    vehicle: VehicleParameters
    edge: RoadEdge

    @cached_property
    def _box(self) -> tuple[Points, Points]:
        low = np.array([self.x_m.min(), self.y_m.min()]) - _FARTHEST_M
        return low, np.array([self.x_m.max(), self.y_m.max()]) + _FARTHEST_M

    def near(self, obstacle: PredictedObstacle) -> bool:
        """Return True if an obstacle comes close to any candidate."""
        low, high = self._box
        return bool(((obstacle.positions >= low) & (obstacle.positions <= high)).all(axis=1).any())


def _prediction(batch: ChannelBatch) -> Values:
    total = np.zeros(len(batch.x_m))
    for obstacle in batch.obstacles:
        steps = batch.steps[batch.steps < len(obstacle.positions)]
        if len(steps) and batch.near(obstacle):
            squared = _squared_mahalanobis(batch, obstacle, steps)
            total += np.minimum(_TOUCHING**2 / np.maximum(squared.min(axis=1), 1e-9), 1.0)
    return total


def _squared_mahalanobis(batch: ChannelBatch, obstacle: PredictedObstacle, steps: NDArray[np.intp]) -> Points:
    """Return squared distances (n, k) of the ego's centre to the obstacle's at k of the steps."""
    length = (obstacle.length_m + batch.vehicle.length_m) / 2 / _TOUCHING
    width = (obstacle.width_m + batch.vehicle.width_m) / 2 / _TOUCHING
    cos, sin = np.cos(obstacle.headings_rad[steps]), np.sin(obstacle.headings_rad[steps])
    given = np.broadcast_to(obstacle.covariance, (len(obstacle.positions), 2, 2))[steps]
    xx = given[:, 0, 0] + (length * cos) ** 2 + (width * sin) ** 2
    yy = given[:, 1, 1] + (length * sin) ** 2 + (width * cos) ** 2
    xy = given[:, 0, 1] + (length**2 - width**2) * sin * cos
    away_x = batch.x_m[:, : len(steps)] - obstacle.positions[steps, 0]
    away_y = batch.y_m[:, : len(steps)] - obstacle.positions[steps, 1]
    return np.asarray((yy * away_x**2 - 2 * xy * away_x * away_y + xx * away_y**2) / (xx * yy - xy**2))


def _distance_to_boundary(batch: ChannelBatch) -> Values:
    clearance = np.maximum(batch.edge.distances_m(batch.x_m, batch.y_m) - batch.vehicle.width_m / 2, 1e-3)
    return np.asarray(np.minimum((_CLEARANCE_M / clearance) ** 2, 1.0).mean(axis=1))


CHANNELS: Mapping[str, Callable[[ChannelBatch], Values]] = {
    "distance_to_reference_path": lambda batch: np.asarray(np.abs(batch.offset_m).mean(axis=1) / _OFFSET_M),
    "distance_to_reference_path_final": lambda batch: np.asarray(np.abs(batch.offset_m[:, -1]) / _OFFSET_M),
    "velocity_offset_final": lambda batch: np.asarray(((batch.final_mps - batch.desired_mps) / _SPEED_MPS) ** 2),
    "orientation_offset": lambda batch: np.asarray(((batch.turned_rad / _ANGLE_RAD) ** 2).mean(axis=1)),
    "orientation_offset_final": lambda batch: np.asarray((batch.turned_rad[:, -1] / _ANGLE_RAD) ** 2),
    "prediction": _prediction,
    "distance_to_boundary": _distance_to_boundary,
}
"""Maps weights to channels, in the order of the weights."""
