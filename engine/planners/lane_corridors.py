"""Where a vehicle may go without leaving its lane: the lanelets under it and all that follow them."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, interpolate, wrap_angles
from plannerforge.engine.network.lanelet_graph import LaneletGraph

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

SAMPLE_SPACING_M = 2.0
ALIGNED_RAD = math.radians(60.0)
GIVING_WAY = frozenset({"YIELD", "STOP", "STOP_4_WAY"})
HAVING_WAY = frozenset({"PRIORITY", "RIGHT_OF_WAY"})


@dataclass(frozen=True)
class Corridor:
    """Samples of the centre lines: points (n, 2), unit directions (n, 2), half widths (n,).

    ``stations_m`` (n,): way along the lanes from the vehicle to the sample, negative behind it. ``priority``: −1 where
    a sign on the way asks to give way, 1 where one grants the right of way or the way is a crosswalk, else 0.
    """

    points: Points
    directions: Points
    half_widths_m: Values
    stations_m: Values
    priority: int

    def locate(self, points: Points) -> tuple[Values, Values]:
        """Station of each point, shape (m, 2), and how far it lies outside the lane's edge (negative: inside), in m."""
        middle = self.points[0]
        samples, wanted = self.points - middle, points - middle
        # no matrix product: its last bits depend on how many points are asked for at once, and they decide ties
        products = np.multiply.outer(wanted[:, 0], samples[:, 0]) + np.multiply.outer(wanted[:, 1], samples[:, 1])
        squared = (samples**2).sum(axis=1)[None, :] - 2.0 * products
        nearest = squared.argmin(axis=1)
        away, along = points - self.points[nearest], self.directions[nearest]
        ahead = (along * away).sum(axis=1)
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
        beyond = np.maximum(np.abs(ahead) - SAMPLE_SPACING_M, 0.0)  # past the last sample of a lane that ends
        return self.stations_m[nearest] + ahead, np.hypot(across, beyond) - self.half_widths_m[nearest]


@dataclass(frozen=True)
class _Lane:
    points: Points
    directions: Points
    half_widths_m: Values
    stations_m: Values


class LaneCorridors:
    """Corridors on a lanelet network; built once a run."""

    def __init__(self, network: "LaneletNetwork") -> None:
        self._graph = LaneletGraph.of(network)
        self._lanes = {int(lane.lanelet_id): _sampled(lane) for lane in network.lanelets}
        self._priority = {int(lane.lanelet_id): _priority(network, lane) for lane in network.lanelets}
        self._ids = np.concatenate([np.full(len(lane.points), key) for key, lane in self._lanes.items()])
        self._points = np.concatenate([lane.points for lane in self._lanes.values()])
        self._directions = np.concatenate([lane.directions for lane in self._lanes.values()])
        self._half_widths = np.concatenate([lane.half_widths_m for lane in self._lanes.values()])
        self._headings = np.arctan2(self._directions[:, 1], self._directions[:, 0])

    def under(self, position: Points, heading_rad: float) -> tuple[int, ...]:
        """Lanelets under a position whose direction is within 60° of the heading, the nearest centre line first."""
        away = position - self._points
        across = np.abs(self._directions[:, 0] * away[:, 1] - self._directions[:, 1] * away[:, 0])
        ahead = np.abs((self._directions * away).sum(axis=1))
        turned = np.abs(wrap_angles(self._headings - heading_rad))
        found = (across <= self._half_widths) & (ahead <= SAMPLE_SPACING_M) & (turned <= ALIGNED_RAD)
        offsets: dict[int, float] = {}
        for index in np.flatnonzero(found):
            key = int(self._ids[index])
            offsets[key] = min(round(float(across[index]), 6), offsets.get(key, math.inf))
        return tuple(sorted(offsets, key=lambda key: (offsets[key], key)))

    def from_here(self, position: Points, heading_rad: float, reach_m: float) -> Corridor | None:
        """The corridor of a vehicle, ``reach_m`` metres far; None where no lanelet of its direction is under it."""
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
        lanes = [self._lanes[key] for key in begins]
        return Corridor(
            points=np.concatenate([lane.points for lane in lanes]),
            directions=np.concatenate([lane.directions for lane in lanes]),
            half_widths_m=np.concatenate([lane.half_widths_m for lane in lanes]),
            stations_m=np.concatenate([self._lanes[key].stations_m + begin for key, begin in begins.items()]),
            priority=self._priority_on(begins, starts),
        )

    def _station(self, lanelet_id: int, position: Points) -> float:
        lane = self._lanes[lanelet_id]
        away = position - lane.points
        nearest = int((away**2).sum(axis=1).argmin())
        return float(lane.stations_m[nearest] + lane.directions[nearest] @ away[nearest])

    def _priority_on(self, way: dict[int, float], starts: tuple[int, ...]) -> int:
        before = [key for start in starts for key in self._graph.predecessors[start]]
        signs = {self._priority[key] for key in [*way, *before]}
        return -1 if -1 in signs else max(signs)


def _sampled(lanelet: "Lanelet") -> _Lane:
    center = np.asarray(lanelet.center_vertices, dtype=float)
    along = arc_length(center)
    wanted = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / SAMPLE_SPACING_M), 1) + 1)
    points = interpolate(center, along, wanted)
    directions = np.gradient(points, axis=0)
    across = np.linalg.norm(np.asarray(lanelet.left_vertices) - np.asarray(lanelet.right_vertices), axis=1)
    return _Lane(
        points=points,
        directions=directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9),
        half_widths_m=np.interp(wanted, along, across) / 2,
        stations_m=wanted,
    )


def _priority(network: "LaneletNetwork", lanelet: "Lanelet") -> int:
    if any(kind.value == "crosswalk" for kind in lanelet.lanelet_type):
        return 1
    names: set[str] = set()
    for key in lanelet.traffic_signs or ():
        sign = network.find_traffic_sign_by_id(key)
        names.update(element.traffic_sign_element_id.name for element in sign.traffic_sign_elements if sign)
    return -1 if names & GIVING_WAY else int(bool(names & HAVING_WAY))
