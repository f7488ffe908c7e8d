"""The drivable area along a reference path, and whether a vehicle leaves it."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length
from plannerforge.engine.planners.reference_path import BEYOND_GOAL_M, ReferencePath

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad_dc import pycrcc
    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

CORRIDOR_M = 25.0
CLOSED_GAP_M = 0.1
"""Lanelets of real maps lie centimetres apart where they should touch: gaps up to twice this are no road boundary."""


@dataclass(frozen=True)
class Road:
    """The lanelets near the reference path as one area, and its edge as thin rectangles for the collision checker."""

    area: "BaseGeometry"
    edge: "pycrcc.CollisionChecker"

    def touches_edge(self, vehicle: "pycrcc.CollisionObject") -> bool:
        """Whether a vehicle (or any step of its motion) touches the edge of the road."""
        return bool(self.edge.collide(vehicle))

    def holds(self, point: Points) -> bool:
        """Whether a point lies on the road."""
        from shapely import Point

        return bool(self.area.covers(Point(point)))


def build_road(network: "LaneletNetwork", reference: ReferencePath, *, beyond_m: float = BEYOND_GOAL_M) -> Road:
    """The road along a reference path that goes on ``beyond_m`` metres behind its goal.

    Where the network ends, the road is taken to go straight on as the reference path does: the end of a map is not
    the end of the road.
    """
    import shapely

    corridor = shapely.LineString(reference.points).buffer(CORRIDOR_M)
    near = [lanelet for lanelet in network.lanelets if lanelet.polygon.shapely_object.intersects(corridor)]
    parts = [shapely.make_valid(lanelet.polygon.shapely_object) for lanelet in near]
    ends = {lanelet.lanelet_id for lanelet in near if not lanelet.successor}
    begins = {lanelet.lanelet_id for lanelet in near if not lanelet.predecessor}
    stations = arc_length(reference.points)
    last = reference.points[int(np.searchsorted(stations, reference.network_end_m)) :][:2]
    for lanelet in near:
        left, right = np.asarray(lanelet.left_vertices), np.asarray(lanelet.right_vertices)
        if lanelet.lanelet_id in ends and _goes_on(left[-1], right[-1], left[-2], last):
            parts.append(_strip(left[-1], right[-1], lanelet.center_vertices[-2:], max(BEYOND_GOAL_M + 30.0, beyond_m)))
        if lanelet.lanelet_id in begins:
            parts.append(_strip(left[0], right[0], lanelet.center_vertices[1::-1], 10.0))
    area = shapely.union_all(parts)
    area = area.buffer(CLOSED_GAP_M, join_style="mitre").buffer(-CLOSED_GAP_M, join_style="mitre")
    return Road(area, _edge_checker(area.intersection(corridor.buffer(5.0)).boundary, corridor))


def _goes_on(left: Points, right: Points, before: Points, last: Points) -> bool:
    """Whether a lanelet's end lies beside the point where the reference path leaves the network, in its direction."""
    if len(last) < 2:
        return False
    direction, leaving = left - before, last[1] - last[0]
    turned = abs(math.remainder(math.atan2(*direction[::-1]) - math.atan2(*leaving[::-1]), math.tau))
    return turned < math.pi / 4 and float(np.linalg.norm((left + right) / 2 - last[0])) < CORRIDOR_M


def _strip(left: Points, right: Points, pair: Points, length_m: float) -> "Polygon":
    """The straight continuation of a lanelet's end edge in the direction of the pair of points."""
    import shapely

    direction = pair[1] - pair[0]
    ahead = direction / max(float(np.linalg.norm(direction)), 1e-9) * length_m
    back = -ahead / length_m * 0.05
    return shapely.Polygon([left + back, left + ahead, right + ahead, right + back]).convex_hull


def _edge_checker(boundary: "BaseGeometry", corridor: "BaseGeometry") -> "pycrcc.CollisionChecker":
    import shapely
    from commonroad_dc import pycrcc

    checker = pycrcc.CollisionChecker()
    group = pycrcc.ShapeGroup()
    count = 0
    for line in shapely.get_parts(boundary.intersection(corridor)):
        points = np.asarray(line.coords)
        for start, end in pairwise(points):
            length = float(np.hypot(*(end - start)))
            if length > 1e-3:
                middle = (start + end) / 2
                group.add_shape(_thin(pycrcc, length, math.atan2(*(end - start)[::-1]), middle))
                count += 1
    if count:
        checker.add_collision_object(group)
    return checker


def _thin(pycrcc: Any, length: float, heading: float, middle: Points) -> "pycrcc.Shape":
    return pycrcc.RectOBB(length / 2, 0.005, heading, float(middle[0]), float(middle[1]))
