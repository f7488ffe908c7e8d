"""What SUMO held in the run that made a file: the vehicle types, who drove which route by which of them, and the net.

The first is the file that SUMO was started with, the second SUMO's own record, the third is kept with every scenario.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree

from plannerforge.engine.edits.apply import NET_FILE
from plannerforge.engine.edits.sumo_process import ROUTES_FILE, TYPES_FILE
from plannerforge.engine.geometry.polyline import Points

SAME_LINE_M = 0.3
BESIDE_M = 1.0
ENDS = (0.1, 0.5, 0.9)
"""The shares of a lanelet's length at which it has to lie on a lane to be that lane."""


@dataclass(frozen=True)
class Lane:
    """A lane of the net: its middle line, and its width in m."""

    line: shapely.LineString
    width_m: float


@dataclass(frozen=True)
class SumoRecord:
    """Attributes of each vehicle's type and the edges of its route, by vehicle id; lanes by edge and by way across.

    ``across``: the lanes through a junction from one edge to the next.
    """

    types: Mapping[int, Mapping[str, str]]
    routes: Mapping[int, tuple[str, ...]]
    lanes: Mapping[str, tuple[Lane, ...]]
    across: Mapping[tuple[str, str], tuple[Lane, ...]]

    @classmethod
    def of(cls, folder: Path) -> "SumoRecord":
        """Read the files of a folder; without a simulation nobody has a type or a route."""
        types, routes = dict[int, Mapping[str, str]](), dict[int, tuple[str, ...]]()
        if (folder / ROUTES_FILE).exists():
            known = {str(one.get("id")): dict(one.attrib) for one in _elements(folder / TYPES_FILE, "vType")}
            for vehicle in _elements(folder / ROUTES_FILE, "vehicle"):
                if str(vehicle.get("id")).isdigit():
                    types[int(vehicle.get("id"))] = known[str(vehicle.get("type"))]
                    routes[int(vehicle.get("id"))] = tuple(str(vehicle.find("route").get("edges")).split())
        lanes, across = _net(folder / NET_FILE)
        return cls(types, routes, lanes, across)

    def leads_over(self, vehicle_id: int, center_line: Points) -> bool:
        """Whether a vehicle's route has a lane along a lanelet's centre line (n, 2)."""
        line = shapely.LineString(center_line)
        points = [line.interpolate(share, normalized=True) for share in ENDS]
        return any(
            all(lane.line.distance(point) <= SAME_LINE_M for point in points) for lane in self._lanes_of(vehicle_id)
        )

    def share_on_route(self, vehicle_id: int, positions: Points) -> float:
        """The share of positions (n, 2) on the lanes of a vehicle's route, or at most 1 m beside."""
        lanes = self._lanes_of(vehicle_id)
        area = shapely.union_all([lane.line.buffer(lane.width_m / 2 + BESIDE_M) for lane in lanes])
        return float(np.mean(shapely.contains_xy(area, positions[:, 0], positions[:, 1])))

    def _lanes_of(self, vehicle_id: int) -> list[Lane]:
        edges = self.routes.get(vehicle_id, ())
        found = [lane for edge in edges for lane in self.lanes.get(edge, ())]
        return found + [lane for pair in pairwise(edges) for lane in self.across.get(pair, ())]


def _net(path: Path) -> tuple[dict[str, tuple[Lane, ...]], dict[tuple[str, str], tuple[Lane, ...]]]:
    root = etree.parse(path).getroot()
    by_lane = {str(lane.get("id")): _lane(lane) for lane in root.iter("lane")}
    lanes = {
        str(edge.get("id")): tuple(by_lane[str(lane.get("id"))] for lane in edge.iter("lane"))
        for edge in root.iter("edge")
    }
    across = dict[tuple[str, str], tuple[Lane, ...]]()
    for connection in root.iter("connection"):
        via = by_lane.get(str(connection.get("via")))
        if via is not None:
            pair = (str(connection.get("from")), str(connection.get("to")))
            across[pair] = (*across.get(pair, ()), via)
    return lanes, across


def _lane(element: Any) -> Lane:
    points = [tuple(map(float, point.split(",")[:2])) for point in str(element.get("shape")).split()]
    return Lane(shapely.LineString(points), float(element.get("width", "3.2")))


def _elements(path: Path, tag: str) -> list[Any]:
    return list(etree.parse(path).getroot().iter(tag))
