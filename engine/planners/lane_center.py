"""Distance to the centre line of the lanelet under a point, for many points at once."""

from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, interpolate

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

SAMPLE_SPACING_M = 0.5
OUTSIDE_M = 5.0
"""Offset of a point that lies on no lanelet, as in the Frenetix reference."""


class LaneCenters:
    """Samples of all centre lines with their directions and half widths.

    The lanelet under a point is the one whose centre line is nearest; the point is on it where its offset is at most
    half the width there. Offsets are exact on straight lanelets.
    """

    def __init__(self, network: "LaneletNetwork") -> None:
        from scipy.spatial import cKDTree

        points, directions, half_widths = [], [], []
        for lanelet in network.lanelets:
            center = np.asarray(lanelet.center_vertices, dtype=float)
            stations = arc_length(center)
            wanted = np.linspace(0.0, stations[-1], max(int(stations[-1] / SAMPLE_SPACING_M), 1) + 1)
            samples = interpolate(center, stations, wanted)
            across = np.linalg.norm(np.asarray(lanelet.left_vertices) - np.asarray(lanelet.right_vertices), axis=1)
            points.append(samples)
            directions.append(np.gradient(samples, axis=0))
            half_widths.append(np.interp(wanted, stations, across) / 2)
        self._points: Points = np.concatenate(points)
        direction = np.concatenate(directions)
        self._directions: Points = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
        self._half_widths: Values = np.concatenate(half_widths)
        self._tree = cKDTree(self._points)

    def offsets(self, points: Points) -> Values:
        """Distance in m of each point, shape (n, 2), to the centre line under it; 5 m where there is no lanelet."""
        _, nearest = self._tree.query(points)
        away = points - self._points[nearest]
        along = self._directions[nearest]
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
        beyond = np.abs((along * away).sum(axis=1)) > 2 * SAMPLE_SPACING_M
        outside = (across > self._half_widths[nearest]) | beyond
        return np.where(outside, OUTSIDE_M, across)
