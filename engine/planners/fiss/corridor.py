"""The lanes along a reference path as FISS's core expects them: bands of lateral offsets, one value per station.

Lane 0 is the band around the path itself, as wide as the lane under it, so a path that changes lanes leads the planner
from one lane to the other. Lanes −1 and +1 are the lanes of the same direction to its right and left, if a lane change
is allowed. A missing lane has a band of zero width. The core samples no end states in bands that are narrower than the
vehicle, and a band of zero width adds nothing to the road.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import fiss_planner
import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, Values, arc_length, interpolate
from ...network import LaneletGraph
from ..reference_path import BEYOND_GOAL_M, ReferencePath

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

_SPACING_M = 2.0
"""Distance between the stations of a band (chosen: lanes change their width over tens of metres)."""
_SIDE_M, _AHEAD_M = 10.0, 1.0
"""A lane's cross-section belongs to a station if it is within these lateral and longitudinal distances."""
_ALIGNED = 0.5
"""Cosine of 60°: a lanelet leads the same way as the path if their directions differ by less."""
_TOUCHING_M = 0.75
"""Largest overlap or gap between neighbouring lanes of recorded maps (chosen)."""
_USUAL_HALF_WIDTH_M = 1.75
"""Half of the lane width of 3.5 m of CommonRoad's hand-crafted roads, for a path that is on no lane."""
_NOT_CROSSED = frozenset({"solid", "solid_solid", "broad_solid", "curb", "lowered_curb"})
"""CommonRoad's line markings that a vehicle must not cross."""


@dataclass(frozen=True)
class LaneBand:
    """Edges of a lane as offsets from the path in m, left positive, one per station (n,).

    ``is_next``: True if the route changes to this lane later.
    """

    right_m: Values
    left_m: Values
    is_next: NDArray[np.bool_]


@dataclass(frozen=True)
class Bands:
    """The lane under the path and the two adjacent lanes, at stations (n,) in m along the path."""

    stations_m: Values
    under: LaneBand
    right: LaneBand
    left: LaneBand

    def off_route(self, station_m: float) -> tuple[bool, bool]:
        """Return, for the right and the left lane, whether the route no longer changes to it after a station."""
        index = min(int(np.searchsorted(self.stations_m, station_m)), len(self.stations_m) - 1)
        return not self.right.is_next[index], not self.left.is_next[index]

    def corridor(self, right_cost: float, left_cost: float) -> "fiss_planner.Corridor":
        """Return the bands in the core's format; the core adds each side's cost to candidates that end in its lane."""
        corridor = fiss_planner.Corridor(self.stations_m.tolist())
        for offset, band, cost in ((-1, self.right, right_cost), (0, self.under, 0.0), (1, self.left, left_cost)):
            lane = fiss_planner.LaneBand()
            lane.offset, lane.extra_cost = offset, cost
            lane.center = ((band.left_m + band.right_m) / 2).tolist()
            lane.left, lane.right = band.left_m.tolist(), band.right_m.tolist()
            corridor.add_lane(lane)
        return corridor

    def half_width_at(self, station_m: float) -> float:
        """Return half the width in m of the lane under the path."""
        return float(np.interp(station_m, self.stations_m, self.under.left_m))


def lane_bands(network: "LaneletNetwork", reference: ReferencePath) -> Bands:
    """Return the bands along a reference path, from its start to its end.

    Only the lanes of the route, their successors, and lanes that a lane change reaches from these count. A marking that
    must not be crossed excludes a lane, unless the route itself changes to it.
    """
    length_m = float(arc_length(reference.points)[-1])
    stations = np.linspace(0.0, length_m, max(round(length_m / _SPACING_M), 1) + 1)
    points = interpolate(reference.points, arc_length(reference.points), stations)
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    graph = LaneletGraph.of(network)
    route = _route_and_beyond(graph, reference.lanelets)
    sections = [
        section
        for key in sorted(graph.parallel_lanes(route))
        for section in _sections(network.find_lanelet_by_id(key), points, along, route.get(key))
    ]
    return _bands(stations, sections)


def _route_and_beyond(graph: LaneletGraph, lanelets: tuple[int, ...]) -> dict[int, int]:
    """Return the position in the route of each lanelet on it, in driving order.

    Predecessors of the first lanelet have the position −1; successors of the last lanelet, as far as a path continues,
    have the last position.
    """
    places = dict.fromkeys(graph.predecessors[lanelets[0]], -1) | {key: at for at, key in enumerate(lanelets)}
    ends = {lanelets[-1]: 0.0}
    while ends:
        key, driven_m = ends.popitem()
        for following in graph.successors[key] if driven_m < BEYOND_GOAL_M else ():
            if following not in places:
                places[following] = places[lanelets[-1]]
                ends[following] = driven_m + graph.length_m[following]
    return places


@dataclass(frozen=True)
class _Section:
    """The cross-section of a lane at one station of the path, with its edges as offsets in m.

    ``place``: the position of its lanelet in the route; None if the lanelet is not part of the route.
    """

    station: int
    right_m: float
    left_m: float
    place: int | None
    crossed_right: bool
    crossed_left: bool

    @property
    def center_m(self) -> float:
        return (self.right_m + self.left_m) / 2

    def is_lane_change_from(self, other: "_Section") -> bool:
        """Return True if the route changes to this lane from the other lane."""
        return self.place is not None and other.place is not None and self.place > other.place


def _sections(lanelet: "Lanelet", points: Points, along: Points, place: int | None) -> Iterator[_Section]:
    """Yield the sections of a lanelet, at most one per station: the nearest of its cross-sections, about 1 m apart."""
    left, right = np.asarray(lanelet.left_vertices, dtype=float), np.asarray(lanelet.right_vertices, dtype=float)
    center = np.asarray(lanelet.center_vertices, dtype=float)
    lengths = arc_length(center)
    wanted = np.linspace(0.0, lengths[-1], max(round(float(lengths[-1])), 1) + 1)
    left, right, center = (interpolate(line, lengths, wanted) for line in (left, right, center))
    directions = np.gradient(center, axis=0)
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    near = _near(points, center)
    if not len(near):
        return
    away = center[None] - points[near, None]
    ahead = np.abs((away * along[near, None]).sum(axis=2))
    aligned = directions @ along[near].T > _ALIGNED
    ahead[~aligned.T | (np.linalg.norm(away, axis=2) > _SIDE_M)] = np.inf
    nearest = ahead.argmin(axis=1)
    crossed_left = _may_cross(lanelet.line_marking_left_vertices)
    crossed_right = _may_cross(lanelet.line_marking_right_vertices)
    for row, index in enumerate(nearest.tolist()):
        if ahead[row, index] > _AHEAD_M:
            continue
        station = int(near[row])
        normal = np.array([-along[station, 1], along[station, 0]])
        right_m, left_m = (float((edge[index] - points[station]) @ normal) for edge in (right, left))
        yield _Section(station, right_m, left_m, place, crossed_right, crossed_left)


def _near(points: Points, center: Points) -> NDArray[np.intp]:
    """Return the indices of the points within ``_SIDE_M`` of the bounding box of the line ``center``."""
    low, high = center.min(axis=0) - _SIDE_M, center.max(axis=0) + _SIDE_M
    return np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))


def _may_cross(marking: object) -> bool:
    return getattr(marking, "value", None) not in _NOT_CROSSED


def _bands(stations: Values, sections: Collection[_Section]) -> Bands:
    by_station: dict[int, list[_Section]] = {}
    for section in sections:
        by_station.setdefault(section.station, []).append(section)
    count = len(stations)
    half = np.full(count, np.nan)
    adjacent: dict[bool, list[_Section | None]] = {side: [None] * count for side in (False, True)}
    is_next = {side: [False] * count for side in (False, True)}
    for station, here in by_station.items():
        under = _under(here)
        if under is not None:
            half[station] = (under.left_m - under.right_m) / 2
            for is_left, neighbours in adjacent.items():
                neighbours[station] = _neighbour(under, here, is_left=is_left)
                is_next[is_left][station] = _is_next(under, neighbours[station])
    known = np.isfinite(half)
    half = np.interp(stations, stations[known], half[known]) if known.any() else np.full(count, _USUAL_HALF_WIDTH_M)
    return Bands(
        stations,
        under=LaneBand(-half, half, np.ones(count, dtype=np.bool_)),
        right=_adjacent_band(adjacent[False], is_next[False], -half),
        left=_adjacent_band(adjacent[True], is_next[True], half),
    )


def _under(here: list[_Section]) -> _Section | None:
    """Return the lane under the path: preferably a lane of the route, then the one with the nearest centre."""
    holding = [section for section in here if section.right_m <= 0.0 <= section.left_m]
    return min(holding, key=lambda section: (section.place is None, abs(section.center_m)), default=None)


def _neighbour(under: _Section, here: list[_Section], *, is_left: bool) -> _Section | None:
    """Return the lane that touches the lane under the path on a side, if the vehicle may enter it."""
    edge = under.left_m if is_left else under.right_m
    crossed = under.crossed_left if is_left else under.crossed_right
    candidates = [
        section
        for section in here
        if section is not under
        and (section.center_m > edge if is_left else section.center_m < edge)
        and abs((section.right_m if is_left else section.left_m) - edge) < _TOUCHING_M
        and (crossed or section.place is not None)
    ]
    return min(candidates, key=lambda section: abs(section.center_m - edge), default=None)


def _is_next(under: _Section, neighbour: _Section | None) -> bool:
    return neighbour is not None and neighbour.is_lane_change_from(under)


def _adjacent_band(neighbours: list[_Section | None], is_next: list[bool], inner_m: Values) -> LaneBand:
    """Return a band along the edge of the lane under the path; its width is 0 at stations without a lane."""
    right, left = inner_m.copy(), inner_m.copy()
    for index, section in enumerate(neighbours):
        if section is not None:
            right[index], left[index] = section.right_m, section.left_m
    return LaneBand(right, left, np.array(is_next, dtype=np.bool_))
