"""What traffic is wanted on a site: how many vehicles of which class, and where each one drives."""

import random
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from lxml import etree

from plannerforge.engine.geometry.polyline import length_m
from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.engine.traffic.routes import EdgeGraph
from plannerforge.engine.traffic.vehicle_classes import VehicleClass, vehicle_classes
from plannerforge.schemas.errors import NotPossible, UnknownName, closest
from plannerforge.schemas.generation import Density, VehicleDemand

VEHICLES_PER_LANE_KM: dict[Density, float] = {"low": 7.0, "medium": 16.0, "high": 28.0}
"""Vehicles on a kilometre of lane at the first step, the ego included.

The bounds of levels of service A, C and E for motorways (Highway Capacity Manual, in passenger cars). The paper counts
trips of a scenario instead (20, 50, 100), whatever the size of its map.
"""
PAPER_TRIPS: dict[Density, int] = {"low": 20, "medium": 50, "high": 100}
FEWEST, MOST = 8, 120
"""Bounds for vehicles on a site: fewer make no traffic, more would only be slow."""

NAMED_SHARE = 0.2
"""Share of the vehicles for a class that was asked for without a number, at least one."""


@dataclass(frozen=True)
class Demand:
    """Vehicles wanted by class; ``least`` are those that the request names, beside the ego."""

    counts: dict[str, int]
    least: dict[str, int]
    most: dict[str, int]

    @property
    def total(self) -> int:
        """All vehicles wanted, the ego included."""
        return sum(self.counts.values())

    def with_spare_cars(self, share: float) -> "Demand":
        """The same with more cars, by a share of all vehicles and at least one."""
        spare = max(1, round(share * self.total))
        return replace(self, counts={**self.counts, "car": self.counts["car"] + spare})


def plan_counts(density: Density, vehicles: Iterable[VehicleDemand], lane_km: float) -> Demand:
    """Split a density over the classes: named ones first, cars for the rest; one car more is the ego.

    ``lane_km``: kilometres of lane at the site that are open to cars.

    Raises:
        UnknownName: a class that does not exist.
    """
    known = vehicle_classes()
    asked = {demand.vehicle_class: demand for demand in vehicles}
    for name in asked:
        if name not in known:
            raise UnknownName(f"there is no vehicle class {name!r}", valid=closest(name, known))
    wanted = min(max(round(VEHICLES_PER_LANE_KM[density] * lane_km), FEWEST), MOST)
    counts: dict[str, int] = {}
    for name, demand in asked.items():
        share = max(1, round(wanted * NAMED_SHARE / max(1, len(asked) / 2)))
        fitting = demand.least if demand.least > 1 or demand.most is not None else max(demand.least, share)
        counts[name] = fitting if demand.most is None else min(fitting, demand.most)
    others = sum(count for name, count in counts.items() if name != "car")
    cars = asked.get("car")
    rest = max(wanted - others, 1)
    if cars is not None:
        rest = max(rest, cars.least + 1)
        rest = rest if cars.most is None else min(rest, cars.most + 1)
    counts["car"] = rest
    counts = {name: counts[name] for name in known if counts.get(name)}
    least = {name: asked[name].least for name in known if name in asked}
    most = {name: limit for name, d in sorted(asked.items()) if (limit := d.most) is not None}
    return Demand(counts, least, most)


@dataclass(frozen=True)
class Trip:
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

    def trip(self, vehicle_class: VehicleClass) -> Trip:
        """A random trip of a class that is open here; fast roads and long ways on begin more of them."""
        graph = self._graph(vehicle_class)
        starts = sorted(graph.length_m)
        weights = [self._pull(graph, edge) for edge in starts]
        start = self._choice.choices(starts, weights)[0]
        speed = min(graph.speed_mps[start], vehicle_class.maximum_speed_mps)
        return Trip(vehicle_class, graph.walk(start, speed * self._lasting_s, self._choice))

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
