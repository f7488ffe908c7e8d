"""Where the vehicles of a class begin and drive on a site, and SUMO's types for them."""

import random
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from ...schemas.errors import NotPossible
from ..geometry import length_m
from ..network import SumoNet
from ..vehicles import VehicleClass, vehicle_classes

# ---------- routes
# Ways through a SUMO net for vehicles of a class, found by walking from edge to edge.

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


# ---------- demand
# Where the vehicles of a class begin and drive on a site, and SUMO's types for them.


@dataclass(frozen=True)
class _Trip:
    """A vehicle to be inserted: its class and the edges that it drives."""

    vehicle_class: VehicleClass
    edges: tuple[str, ...]


class TripMaker:
    """Makes trips of a class on a net, each long enough to last through the recording where the net allows it."""

    def __init__(self, net: SumoNet, lasting_s: float, choice: random.Random) -> None:
        self._net, self._lasting_s, self._choice = net, lasting_s, choice
        self._graphs: dict[str, EdgeGraph] = {}

    def check_open(self, vehicle_class: VehicleClass) -> None:
        """Refuse a class that no road of the net is open to.

        Raises:
            NotPossible: naming the classes that could drive here.
        """
        if not self._graph(vehicle_class).length_m:
            raise NotPossible(
                f"no road at this site is open to the vehicle class {vehicle_class.name!r}",
                valid=[name for name, other in vehicle_classes().items() if self._graph(other).length_m],
                next_step="leave the class out, or choose another place or scenario_type",
            )

    def trip(self, vehicle_class: VehicleClass) -> _Trip:
        """A random trip of a class that is open here; fast roads and long ways on begin more of them."""
        graph = self._graph(vehicle_class)
        starts = sorted(graph.length_m)
        weights = [self._pull(graph, edge) for edge in starts]
        start = self._choice.choices(starts, weights)[0]
        speed = min(graph.speed_mps[start], vehicle_class.maximum_speed_mps)
        return _Trip(vehicle_class, graph.walk(start, speed * self._lasting_s, self._choice))

    def _graph(self, vehicle_class: VehicleClass) -> EdgeGraph:
        if vehicle_class.sumo_class not in self._graphs:
            self._graphs[vehicle_class.sumo_class] = EdgeGraph.of(self._net, vehicle_class.sumo_class)
        return self._graphs[vehicle_class.sumo_class]

    def _pull(self, graph: EdgeGraph, edge: str) -> float:
        """How many trips begin on an edge: by its lane metres and speed, fewer where the way soon ends."""
        lasting = min(graph.reach_m[edge] / (graph.speed_mps[edge] * self._lasting_s), 1.0)
        return graph.length_m[edge] * graph.lanes[edge] * graph.speed_mps[edge] * max(lasting, 0.02)


def write_vehicle_types(path: Path, classes: Iterable[VehicleClass]) -> None:
    """Write SUMO's types for the classes: EIDM as the follower model, real dimensions, speeds around the limit."""
    root = etree.Element("routes")
    for found in classes:
        attributes = {
            "id": found.name,
            "vClass": found.sumo_class,
            "carFollowModel": "EIDM",
            "length": f"{found.length_m:g}",
            "width": f"{found.width_m:g}",
            "accel": f"{found.acceleration_mps2:g}",
            "decel": f"{found.deceleration_mps2:g}",
            "minGap": f"{found.minimum_gap_m:g}",
            "maxSpeed": f"{found.maximum_speed_mps:g}",
            "speedFactor": "normc(0.95,0.08,0.75,1.1)",
        }
        etree.SubElement(root, "vType", attributes)
    path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))


def lane_km_of(net: SumoNet) -> float:
    """Kilometres of lane that are open to cars, the insides of junctions left out."""
    lanes = (lane for lane in net.lanes.values() if not lane.internal and "passenger" in lane.allowed)
    return sum(length_m(lane.shape) for lane in lanes) / 1000
