"""Finds the lanelets that a pose is on, for starts of routes, edits, descriptions and checks.

A vehicle drives on a lanelet that leads in its direction. If its centre is a few centimetres over the centre line of a
two-way road, it is on the oncoming lanelet by position only, and on its own lanelet by position and heading.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points, point_at, project, without_repeats, wrap_angle

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

REACH_M = 2.5
"""A vehicle cannot be on a lanelet farther from its position (chosen: a vehicle half off its lane)."""
COST_PER_M_OUTSIDE, COST_PER_M_LATERAL, COST_PER_RAD = 3.0, 0.6, 2.0
"""Costs of a pose on a lanelet: outside it, off its centre line, and turned from it. Weighted by hand on
recorded traffic; the match of a whole track (``map_matching.py``) uses the same costs."""
COST_OF_NO_DIFFERENCE = 0.5
"""A pose is also on another lanelet that fits worse by no more than this (0.8 m off, or 14° turned; chosen)."""
_FARTHEST_CENTER_M = 3.0
"""A pose off all lanelets counts as on those with a centre line within this (chosen: nearly a lane's width)."""


def lanelets_of_pose(network: "LaneletNetwork", position: Points, heading_rad: float) -> tuple[int, ...]:
    """Return the lanelets that a pose is on, best fit first; empty if there are none.

    These lanelets are under the position and lead in the direction of the heading, within 90°. An adjacent lanelet is
    included if it fits better than all of them: the vehicle then extends over its edge. If no lanelet within reach
    leads in the direction of the heading, the result is the lanelets under the position, or lanelets with a near centre
    line, regardless of direction.

    Args:
        network: the lanelets.
        position: the centre of the vehicle, shape (2,), in m.
        heading_rad: its heading.
    """
    from commonroad.geometry.shape import Rectangle
    from shapely import Point

    point = Point(position)
    around = Rectangle(2 * REACH_M, 2 * REACH_M, np.asarray(position, dtype=float))
    fits: list[tuple[float, float, float, int]] = []
    for lanelet in map(network.find_lanelet_by_id, network.find_lanelet_by_shape(around)):
        turned, offset = _pose_on(lanelet, position, heading_rad)
        outside = float(lanelet.polygon.shapely_object.distance(point))
        if outside > REACH_M:
            continue
        cost = COST_PER_M_OUTSIDE * outside + COST_PER_M_LATERAL * offset + COST_PER_RAD * turned
        fits.append((round(cost, 3), outside, turned, int(lanelet.lanelet_id)))
    aligned = [fit for fit in sorted(fits) if fit[2] < math.pi / 2]
    if aligned:
        best_under = min((fit[0] for fit in aligned if fit[1] == 0.0), default=aligned[0][0] + COST_OF_NO_DIFFERENCE)
        return tuple(fit[3] for fit in aligned if fit[1] == 0.0 or fit[0] < best_under)
    under = [fit for fit in sorted(fits, key=lambda fit: (round(fit[2], 3), fit[3])) if fit[1] == 0.0]
    if under:
        return tuple(fit[3] for fit in under)
    near = [(*_pose_on(lanelet, position, heading_rad), int(lanelet.lanelet_id)) for lanelet in network.lanelets]
    return tuple(key for turned, offset, key in sorted(near) if offset < _FARTHEST_CENTER_M)


def _pose_on(lanelet: "Lanelet", position: Points, heading_rad: float) -> tuple[float, float]:
    """Return a pose's angle to a lanelet in rad and its distance from the lanelet's centre line in m."""
    line = without_repeats(np.asarray(lanelet.center_vertices, dtype=float))
    if len(line) < 2:
        return abs(wrap_angle(heading_rad)), float(np.linalg.norm(line[0] - position))
    station, offset = project(line, np.asarray(position, dtype=float))
    return abs(wrap_angle(point_at(line, station)[1] - heading_rad)), abs(offset)
