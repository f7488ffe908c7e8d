"""Ways through a SUMO net for vehicles of a class, found by walking from edge to edge."""

import random
from dataclasses import dataclass

from plannerforge.engine.geometry.polyline import length_m
from plannerforge.engine.network.net_parser import SumoNet

FARTHEST_M = 5_000.0
LONGEST_WALK = 200


@dataclass(frozen=True)
class EdgeGraph:
    """Edges that a class may use: length in m, speed in m/s, lanes, those that follow, and how far one can go.

    ``reach_m`` is the length of the longest known way on from the beginning of an edge, at most ``FARTHEST_M``.
    """

    length_m: dict[str, float]
    speed_mps: dict[str, float]
    lanes: dict[str, int]
    following: dict[str, tuple[str, ...]]
    reach_m: dict[str, float]

    @classmethod
    def of(cls, net: SumoNet, sumo_class: str) -> "EdgeGraph":
        """The part of a net that vehicles of a SUMO class may use."""
        lanes = [lane for lane in net.lanes.values() if not lane.internal and sumo_class in lane.allowed]
        lengths: dict[str, float] = {}
        speeds: dict[str, float] = {}
        counts: dict[str, int] = {}
        for lane in lanes:
            lengths[lane.edge_id] = length_m(lane.shape)
            speeds[lane.edge_id] = max(lane.speed_mps, speeds.get(lane.edge_id, 0.0))
            counts[lane.edge_id] = counts.get(lane.edge_id, 0) + 1
        usable = {lane.lane_id for lane in lanes}
        following: dict[str, set[str]] = {edge: set() for edge in lengths}
        for connection in net.connections:
            if connection.from_lane in usable and connection.to_lane in usable:
                following[connection.from_edge].add(connection.to_edge)
        after = {edge: tuple(sorted(found)) for edge, found in following.items()}
        return cls(lengths, speeds, counts, after, _reach(lengths, after))

    def walk(self, start: str, wanted_m: float, choice: random.Random) -> tuple[str, ...]:
        """A way from an edge on; wide and fast roads, and those that go on as far as wanted, are preferred."""
        way = [start]
        gone = self.length_m[start]
        while self.following[way[-1]] and len(way) < LONGEST_WALK and gone < wanted_m + 500.0:
            onward = self.following[way[-1]]
            rest = max(wanted_m - gone, 1.0)
            weights = [
                self.lanes[edge]
                * self.speed_mps[edge]
                * max(min(self.reach_m[edge] / rest, 1.0), 0.05) ** 2
                / (4.0 if edge in way else 1.0)
                for edge in onward
            ]
            way.append(choice.choices(onward, weights)[0])
            gone += self.length_m[way[-1]]
        return tuple(way)


def _reach(lengths: dict[str, float], following: dict[str, tuple[str, ...]]) -> dict[str, float]:
    reach = dict(lengths)
    changed = True
    while changed:
        changed = False
        for edge, onward in following.items():
            new = min(lengths[edge] + max((reach[other] for other in onward), default=0.0), FARTHEST_M)
            if new > reach[edge] + 1e-6:
                reach[edge] = new
                changed = True
    return reach
