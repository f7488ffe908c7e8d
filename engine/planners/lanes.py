"""The lanes around the ego in three forms, each built once per run.

- ``LaneCenters``: the distance of many points to the centre line of the lanelet under each.
- ``LaneCorridors``: the area of a vehicle that keeps its lane, the lanelets under it and all their successors.
- ``build_road``: the drivable area along a reference path, and whether a vehicle leaves it.

Lengths in m, headings in rad.
"""

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points, Values, arc_length, interpolate, wrap_angles
from ..network import LaneletGraph
from .reference_path import BEYOND_GOAL_M, ReferencePath

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
    from commonroad_dc import pycrcc
    from shapely import Polygon
    from shapely.geometry.base import BaseGeometry

OUTSIDE_M = 5.0
"""Offset of a point that is on no lanelet, as in the Frenetix reference."""
_SAMPLE_SPACING_M, _CORRIDOR_SPACING_M = 0.5, 2.0
"""Spacing of the samples of centre lines, for offsets and for corridors (chosen)."""
_ALIGNED_RAD = math.radians(60.0)
"""A lanelet has a vehicle's direction if their headings differ by less than this (chosen)."""
_GIVING_WAY = frozenset({"YIELD", "STOP", "STOP_4_WAY"})
_HAVING_WAY = frozenset({"PRIORITY", "RIGHT_OF_WAY"})
"""CommonRoad's names of the signs that decide the right of way."""
_ROAD_HALF_WIDTH_M = 25.0
"""Lanelets within this of the reference path are its road (chosen)."""
_CLOSED_GAP_M = 0.1
"""Gaps up to twice this are no road boundary, since touching lanelets of real maps are centimetres apart."""
_BEYOND_END_M, _BEFORE_BEGIN_M = 30.0, 10.0
"""Lengths by which the road extends beyond the end of the network, farther than a path, and before its
start (chosen).
"""
_EDGE_HALF_WIDTH_M = 0.005
"""Half width of the rectangles that form the road's edge, since the collision checker has no lines (chosen)."""


class LaneCenters:
    """Samples of all centre lines with their directions and half widths.

    The lanelet under a point is the one with the nearest centre line; the point is on it if its offset is at most half
    the width there. Offsets are exact on straight lanelets.
    """

    def __init__(self, network: "LaneletNetwork") -> None:
        from scipy.spatial import cKDTree

        samples = [_samples(lanelet, _SAMPLE_SPACING_M, int) for lanelet in network.lanelets]
        points, directions, half_widths, _ = (np.concatenate(values) for values in zip(*samples, strict=True))
        self._points, self._directions, self._half_widths = points, directions, half_widths
        self._tree = cKDTree(points)

    def offsets(self, points: Points) -> Values:
        """Return each point's distance in m to the centre line under it, for points (n, 2); 5 m off all lanelets."""
        _, nearest = self._tree.query(points)
        away = points - self._points[nearest]
        along = self._directions[nearest]
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
        beyond = np.abs((along * away).sum(axis=1)) > 2 * _SAMPLE_SPACING_M
        outside = (across > self._half_widths[nearest]) | beyond
        return np.where(outside, OUTSIDE_M, across)


@dataclass(frozen=True)
class Corridor:
    """Samples of the centre lines: points (n, 2), unit directions (n, 2), half widths (n,).

    ``stations_m`` (n,): distance along the lanes from the vehicle to the sample, negative behind it. ``priority``: −1
    if a sign on these lanes requires giving way, 1 if one grants the right of way or a lane is a crosswalk, otherwise
    0.
    """

    points: Points
    directions: Points
    half_widths_m: Values
    stations_m: Values
    priority: int

    @classmethod
    def joined(cls, lanes: Collection["Corridor"], begins_m: Iterable[float], priority: int) -> "Corridor":
        """Join lanes into one corridor; ``begins_m`` gives the station at which each lane starts."""
        return cls(
            points=np.concatenate([lane.points for lane in lanes]),
            directions=np.concatenate([lane.directions for lane in lanes]),
            half_widths_m=np.concatenate([lane.half_widths_m for lane in lanes]),
            stations_m=np.concatenate([lane.stations_m + m for lane, m in zip(lanes, begins_m, strict=True)]),
            priority=priority,
        )

    def locate(self, points: Points) -> tuple[Values, Values]:
        """Return each point's station, shape (m, 2), and its distance outside the lane's edge in m
        (negative inside).
        """
        middle = self.points[0]
        samples, wanted = self.points - middle, points - middle
        # no matrix product: its last bits depend on the number of points, and they decide ties
        products = np.multiply.outer(wanted[:, 0], samples[:, 0]) + np.multiply.outer(wanted[:, 1], samples[:, 1])
        squared = (samples**2).sum(axis=1)[None, :] - 2.0 * products
        nearest = squared.argmin(axis=1)
        away, along = points - self.points[nearest], self.directions[nearest]
        ahead = (along * away).sum(axis=1)
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
        beyond = np.maximum(np.abs(ahead) - _CORRIDOR_SPACING_M, 0.0)  # beyond the last sample of a lane that ends
        return self.stations_m[nearest] + ahead, np.hypot(across, beyond) - self.half_widths_m[nearest]


class LaneCorridors:
    """Corridors on a lanelet network, built once per run."""

    def __init__(self, network: "LaneletNetwork") -> None:
        self._graph = LaneletGraph.of(network)
        self._lanes = {
            int(lane.lanelet_id): Corridor(
                *_samples(lane, _CORRIDOR_SPACING_M, math.ceil), priority=_priority(network, lane)
            )
            for lane in network.lanelets
        }
        self._ids = np.concatenate([np.full(len(lane.points), key) for key, lane in self._lanes.items()])
        self._all = Corridor.joined(self._lanes.values(), [0.0] * len(self._lanes), priority=0)
        self._headings = np.arctan2(self._all.directions[:, 1], self._all.directions[:, 0])

    def under(self, position: Points, heading_rad: float) -> tuple[int, ...]:
        """Return the lanelets under a position with directions within 60° of the heading, by centre-line distance."""
        away, along = position - self._all.points, self._all.directions
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
        ahead = np.abs((along * away).sum(axis=1))
        turned = np.abs(wrap_angles(self._headings - heading_rad))
        is_under = (across <= self._all.half_widths_m) & (ahead <= _CORRIDOR_SPACING_M) & (turned <= _ALIGNED_RAD)
        offsets: dict[int, float] = {}
        for index in np.flatnonzero(is_under):
            key = int(self._ids[index])
            offsets[key] = min(round(float(across[index]), 6), offsets.get(key, math.inf))
        return tuple(sorted(offsets, key=lambda key: (offsets[key], key)))

    def from_here(self, position: Points, heading_rad: float, reach_m: float) -> Corridor | None:
        """Return a vehicle's corridor up to ``reach_m`` metres, or None if no lanelet of its direction is under it."""
        starts = self.under(position, heading_rad)
        if not starts:
            return None
        begins = {key: -self._station(key, position) for key in starts}
        waiting = list(starts)
        while waiting:
            key = waiting.pop(0)
            end_m = begins[key] + self._graph.length_m[key]
            for following in self._graph.successors[key] if end_m < reach_m else ():
                if following not in begins:
                    begins[following] = end_m
                    waiting.append(following)
        before = [key for start in starts for key in self._graph.predecessors[start]]
        signs = {self._lanes[key].priority for key in [*begins, *before]}
        priority = -1 if -1 in signs else max(signs)
        return Corridor.joined([self._lanes[key] for key in begins], begins.values(), priority)

    def _station(self, lanelet_id: int, position: Points) -> float:
        lane = self._lanes[lanelet_id]
        away = position - lane.points
        nearest = int((away**2).sum(axis=1).argmin())
        return float(lane.stations_m[nearest] + lane.directions[nearest] @ away[nearest])


def _samples(
    lanelet: "Lanelet", spacing_m: float, rounded: Callable[[float], int]
) -> tuple[Points, Points, Values, Values]:
    """Return points of a centre line about one spacing apart, unit directions, half widths and stations in m."""
    center = np.asarray(lanelet.center_vertices, dtype=float)
    along = arc_length(center)
    stations = np.linspace(0.0, along[-1], max(rounded(along[-1] / spacing_m), 1) + 1)
    points = interpolate(center, along, stations)
    directions = np.gradient(points, axis=0)
    directions = directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    across = np.linalg.norm(np.asarray(lanelet.left_vertices) - np.asarray(lanelet.right_vertices), axis=1)
    return points, directions, np.interp(stations, along, across) / 2, stations


def _priority(network: "LaneletNetwork", lanelet: "Lanelet") -> int:
    if any(kind.value == "crosswalk" for kind in lanelet.lanelet_type):
        return 1
    names: set[str] = set()
    for key in lanelet.traffic_signs or ():
        sign = network.find_traffic_sign_by_id(key)
        names.update(element.traffic_sign_element_id.name for element in sign.traffic_sign_elements if sign)
    return -1 if names & _GIVING_WAY else int(bool(names & _HAVING_WAY))


@dataclass(frozen=True)
class Road:
    """The lanelets near the reference path as one area, and its edge as thin rectangles for the collision checker."""

    area: "BaseGeometry"
    edge: "pycrcc.CollisionChecker"

    def touches_edge(self, vehicle: "pycrcc.CollisionObject") -> bool:
        """Return True if a vehicle (or any step of its motion) touches the edge of the road."""
        return bool(self.edge.collide(vehicle))

    def holds(self, point: Points) -> bool:
        """Return True if a point is on the road."""
        from shapely import Point

        return bool(self.area.covers(Point(point)))


def build_road(network: "LaneletNetwork", reference: ReferencePath, *, beyond_m: float = BEYOND_GOAL_M) -> Road:
    """Return the road along a reference path that extends ``beyond_m`` metres beyond its goal.

    At the end of the network, the road is assumed to continue straight, like the reference path: the end of a map is
    not the end of the road.
    """
    import shapely

    corridor = shapely.LineString(reference.points).buffer(_ROAD_HALF_WIDTH_M)
    near = [lanelet for lanelet in network.lanelets if lanelet.polygon.shapely_object.intersects(corridor)]
    parts = [shapely.make_valid(lanelet.polygon.shapely_object) for lanelet in near]
    ends = {lanelet.lanelet_id for lanelet in near if not lanelet.successor}
    begins = {lanelet.lanelet_id for lanelet in near if not lanelet.predecessor}
    stations = arc_length(reference.points)
    last = reference.points[int(np.searchsorted(stations, reference.network_end_m)) :][:2]
    for lanelet in near:
        left, right = np.asarray(lanelet.left_vertices), np.asarray(lanelet.right_vertices)
        if lanelet.lanelet_id in ends and _ends_at_exit(left[-1], right[-1], left[-2], last):
            parts.append(
                _strip(left[-1], right[-1], lanelet.center_vertices[-2:], max(BEYOND_GOAL_M + _BEYOND_END_M, beyond_m))
            )
        if lanelet.lanelet_id in begins:
            parts.append(_strip(left[0], right[0], lanelet.center_vertices[1::-1], _BEFORE_BEGIN_M))
    area = shapely.union_all(parts)
    area = area.buffer(_CLOSED_GAP_M, join_style="mitre").buffer(-_CLOSED_GAP_M, join_style="mitre")
    return Road(area, _edge_checker(area.intersection(corridor.buffer(5.0)).boundary, corridor))


def _ends_at_exit(left: Points, right: Points, before: Points, last: Points) -> bool:
    """Return True if a lanelet ends where the reference path leaves the network, in the same direction."""
    if len(last) < 2:
        return False
    direction, leaving = left - before, last[1] - last[0]
    turned = abs(math.remainder(math.atan2(*direction[::-1]) - math.atan2(*leaving[::-1]), math.tau))
    return turned < math.pi / 4 and float(np.linalg.norm((left + right) / 2 - last[0])) < _ROAD_HALF_WIDTH_M


def _strip(left: Points, right: Points, pair: Points, length_m: float) -> "Polygon":
    """Return the straight continuation of a lanelet's end edge in the direction given by a pair of points."""
    import shapely

    direction = pair[1] - pair[0]
    ahead = direction / max(float(np.linalg.norm(direction)), 1e-9) * length_m
    back = -ahead / length_m * 0.05
    return shapely.Polygon([left + back, left + ahead, right + ahead, right + back]).convex_hull


def _edge_checker(boundary: "BaseGeometry", corridor: "BaseGeometry") -> "pycrcc.CollisionChecker":
    import shapely
    from commonroad_dc import pycrcc

    checker, group, count = pycrcc.CollisionChecker(), pycrcc.ShapeGroup(), 0
    for line in shapely.get_parts(boundary.intersection(corridor)):
        for start, end in pairwise(np.asarray(line.coords)):
            along, (x, y) = end - start, (start + end) / 2
            length_m = float(np.hypot(*along))
            if length_m > 1e-3:
                heading = math.atan2(along[1], along[0])
                group.add_shape(pycrcc.RectOBB(length_m / 2, _EDGE_HALF_WIDTH_M, heading, float(x), float(y)))
                count += 1
    if count:
        checker.add_collision_object(group)
    return checker
