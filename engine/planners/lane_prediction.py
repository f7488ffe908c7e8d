"""The way of an obstacle that keeps to its lane."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import (
    Points,
    Values,
    arc_length,
    headings,
    project,
    without_repeats,
    wrap_angle,
)
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.planners.lane_corridors import LaneCorridors
from plannerforge.engine.planners.route import straight_on

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

AHEAD_M = 250.0
SAME_OFFSET_M = 0.5


@dataclass(frozen=True)
class _Way:
    points: Points
    stations_m: Values
    headings_rad: Values


@dataclass(frozen=True)
class LanePath:
    """A way along centre lines, and the place of the obstacle on it: station and lateral offset (left positive)."""

    way: _Way
    station_m: float
    offset_m: float

    def at(self, stations_m: Values, offsets_m: Values) -> tuple[Points, Values]:
        """Points (n, 2) and headings (n,) at stations and offsets; behind the end of the road straight on."""
        way = self.way
        middles = (way.stations_m[:-1] + way.stations_m[1:]) / 2
        heading = np.interp(stations_m, middles, way.headings_rad)
        along = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        on_line = np.stack([np.interp(stations_m, way.stations_m, way.points[:, axis]) for axis in (0, 1)], axis=1)
        beyond = np.maximum(stations_m - way.stations_m[-1], 0.0)
        return on_line + across * offsets_m[:, None] + along * beyond[:, None], heading


class LanePaths:
    """Ways along a lanelet network; each is built when it is first asked for."""

    def __init__(self, network: "LaneletNetwork") -> None:
        self._network = network
        self._graph = LaneletGraph.of(network)
        self._corridors = LaneCorridors(network)
        self._ways: dict[int, _Way] = {}

    def under(self, position: Points, heading_rad: float) -> LanePath | None:
        """The way of the lanelet under a position that fits it best; None where no lanelet of its direction is there.

        Best is the nearest centre line (within half a metre), then the heading there, then the way that turns least.
        """
        found = [self._path(key, position) for key in self._corridors.under(position, heading_rad)]

        def misfit(path: LanePath) -> tuple[int, float, float]:
            direction = path.at(np.array([path.station_m]), np.zeros(1))[1][0]
            turn = float(np.ptp(path.way.headings_rad))
            offset = round(abs(path.offset_m) / SAME_OFFSET_M)
            return offset, round(abs(wrap_angle(heading_rad - direction)), 1), round(turn, 3)

        return min(found, key=misfit, default=None)

    def _path(self, lanelet_id: int, position: Points) -> LanePath:
        if lanelet_id not in self._ways:
            route = straight_on(self._network, self._graph, (lanelet_id,), AHEAD_M)
            lines = [np.asarray(self._network.find_lanelet_by_id(key).center_vertices) for key in route]
            points = without_repeats(np.concatenate(lines))
            self._ways[lanelet_id] = _Way(points, arc_length(points), headings(points))
        way = self._ways[lanelet_id]
        return LanePath(way, *project(way.points, position))
