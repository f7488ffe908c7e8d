"""Which lane follows which in a SUMO net, internal lanes included."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from plannerforge.engine.geometry.polyline import length_m
from plannerforge.engine.network.net_parser import ROAD_CLASSES, NetLane, SumoNet

SHORTEST_LANE_M = 0.05
TINY_JOINT_M = 1.0
"""An internal lane shorter than this between exactly two lanes is left out: the two are joined directly."""


@dataclass
class LaneGraph:
    """Lanes that vehicles may use, with their successors and predecessors (sorted ids)."""

    lanes: dict[str, NetLane]
    successors: dict[str, list[str]] = field(default_factory=dict)
    predecessors: dict[str, list[str]] = field(default_factory=dict)

    def link(self, before: str, after: str) -> None:
        """Let a lane follow another."""
        for found, new in ((self.successors[before], after), (self.predecessors[after], before)):
            if new not in found:
                found.append(new)
                found.sort()

    def drop(self, lane_ids: Iterable[str]) -> None:
        """Take lanes and their links out."""
        for lane_id in lane_ids:
            for following in self.successors.pop(lane_id):
                self.predecessors[following].remove(lane_id)
            for previous in self.predecessors.pop(lane_id):
                self.successors[previous].remove(lane_id)
            del self.lanes[lane_id]


def connect(net: SumoNet) -> LaneGraph:
    """The graph of all lanes for road vehicles; internal lanes that lead nowhere are left out."""
    lanes = {key: lane for key, lane in net.lanes.items() if _usable(lane)}
    graph = LaneGraph(lanes, {key: [] for key in lanes}, {key: [] for key in lanes})
    for connection in net.connections:
        after = connection.to_lane if connection.via is None else connection.via
        if connection.from_lane in lanes and after in lanes:
            graph.link(connection.from_lane, after)
    while loose := [
        key
        for key, lane in graph.lanes.items()
        if lane.internal and not (graph.successors[key] and graph.predecessors[key])
    ]:
        graph.drop(loose)
    _join_over_tiny_lanes(graph)
    return graph


def _usable(lane: NetLane) -> bool:
    return bool(lane.allowed & ROAD_CLASSES) and len(lane.shape) >= 2 and length_m(lane.shape) > SHORTEST_LANE_M


def _join_over_tiny_lanes(graph: LaneGraph) -> None:
    for key, lane in sorted(graph.lanes.items()):
        if not lane.internal or length_m(lane.shape) >= TINY_JOINT_M:
            continue
        before, after = graph.predecessors[key], graph.successors[key]
        if len(before) != 1 or len(after) != 1:
            continue
        one, other = before[0], after[0]
        joint = graph.successors[one] == [key] and graph.predecessors[other] == [key]
        if joint and not graph.lanes[one].internal and not graph.lanes[other].internal:
            graph.drop([key])
            graph.link(one, other)
