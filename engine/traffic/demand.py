"""Where the vehicles of a class start and drive on a site: random trips over the edges that are open to the class."""

import random
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from ...schemas.errors import NotPossible
from ...schemas.generation import TripKind
from ..geometry import length_m
from ..network import Digraph, SumoNet
from ..vehicles import VehicleClass, vehicle_classes


@dataclass(frozen=True)
class LateTrip:
    """A trip that begins shortly before the recording: its class, edges, place on the first edge in m, and time in s.

    ``at_s`` counts from the start of the simulation.
    """

    vehicle_class: VehicleClass
    edges: tuple[str, ...]
    station_m: float
    at_s: float


class TripMaker:
    """Creates trips of a class on a net, each long enough to last through the recording if the net allows it.

    Trips are more likely, by ``FAVOUR_FACTOR``, to start on the edges ``starts`` and to turn into the edges ``ways``.
    ``kind``: what determines the edge on which a trip starts.
    """

    def __init__(
        self,
        net: SumoNet,
        lasting_s: float,
        choice: random.Random,
        starts: frozenset[str] = frozenset(),
        ways: frozenset[str] = frozenset(),
        kind: TripKind = "usual",
    ) -> None:
        self._net, self._lasting_s, self._choice, self._starts, self._ways = net, lasting_s, choice, starts, ways
        self._kind = kind
        self._edges: dict[str, OpenEdges] = {}

    def check_open(self, vehicle_class: VehicleClass) -> None:
        """Refuse a class if no road of the net is open to it.

        Raises:
            NotPossible: the error lists the classes that can drive on the net.
        """
        if not self.open_to(vehicle_class).length_m:
            raise NotPossible(
                f"no road at this site is open to the vehicle class {vehicle_class.name!r}",
                valid=[name for name, other in vehicle_classes().items() if self.open_to(other).length_m],
                next_step="remove the class, or choose another place or scenario_type",
            )

    def trip(self, vehicle_class: VehicleClass) -> tuple[str, ...]:
        """Return the edges of a random trip of a class; more trips start on fast roads and roads that continue far."""
        edges = self.open_to(vehicle_class)
        starts = sorted(edges.length_m)
        weights = [self._weight(edges, edge) for edge in starts]
        start = self._choice.choices(starts, weights)[0]
        speed = min(edges.speed_mps[start], vehicle_class.maximum_speed_mps)
        return edges.random_route(start, speed * self._lasting_s, self._choice, self._ways)

    def late_trips(self) -> tuple[LateTrip, ...]:
        """Return the trips that begin at a given time and place, in order of time; usually there are none."""
        return ()

    def open_to(self, vehicle_class: VehicleClass) -> "OpenEdges":
        """Return the edges of the net that are open to a class."""
        if vehicle_class.sumo_class not in self._edges:
            self._edges[vehicle_class.sumo_class] = OpenEdges.of(self._net, vehicle_class.sumo_class)
        return self._edges[vehicle_class.sumo_class]

    def _weight(self, edges: "OpenEdges", edge: str) -> float:
        """Return the weight of an edge as a start: its lane metres and speed, less if its continuation is short."""
        length_m, lanes, speed_mps = edges.length_m[edge], edges.lanes[edge], edges.speed_mps[edge]
        match self._kind:
            case "usual" | "fringe":
                weight = length_m * lanes * speed_mps
                weight *= FRINGE_FACTOR if self._kind == "fringe" and edge in edges.entries else 1.0
            case "uniform":
                weight = 1.0
            case "length":
                weight = length_m
            case "lanes":
                weight = length_m * lanes
            case "speed":
                weight = speed_mps
        lasting = min(edges.reach_m[edge] / (speed_mps * self._lasting_s), 1.0)
        return weight * max(lasting, LEAST_WEIGHT) * (FAVOUR_FACTOR if edge in self._starts else 1.0)


FARTHEST_M = 5_000.0
"""A longer continuation makes no difference: vehicles of a site do not drive that far (chosen)."""
MOST_EDGES = 200
"""Longest route in edges: on a ring of short edges it would continue for ever (chosen)."""
SPARE_M = 500.0
"""A route is longer than wanted by this, for a vehicle that is faster than the limit (chosen)."""
LEAST_WEIGHT = 0.02
"""Weight of edges that end at once: few trips start there, but some do (chosen)."""
LEAST_PREFERENCE = 0.05
"""Weight of a dead end compared with roads that continue as far as wanted, before it is squared (chosen)."""
FAVOUR_FACTOR = 12.0
"""Favoured edges are more likely by this factor (chosen): every second car then takes a ramp next to a motorway."""
FRINGE_FACTOR = 10.0
"""If trips start at the fringe, a road on which traffic enters is more likely by this factor (chosen)."""
REVISIT_FACTOR = 4.0
"""An edge that the route has already used is less likely by this factor (chosen): routes should not circle."""


@dataclass(frozen=True)
class OpenEdges:
    """Edges that a class may use: length in m, speed in m/s, lanes, successors, and how far one can drive.

    ``reach_m`` is the length of the longest known continuation from the start of an edge, at most ``FARTHEST_M``.
    """

    length_m: dict[str, float]
    speed_mps: dict[str, float]
    lanes: dict[str, int]
    following: dict[str, tuple[str, ...]]
    reach_m: dict[str, float]

    @classmethod
    def of(cls, net: SumoNet, sumo_class: str) -> "OpenEdges":
        """Return the part of a net that vehicles of a SUMO class may use."""
        lanes = [lane for lane in net.lanes.values() if not lane.internal and sumo_class in lane.allowed]
        lengths = {lane.edge_id: length_m(lane.shape) for lane in lanes}
        counts = Counter(lane.edge_id for lane in lanes)
        speeds = dict.fromkeys(lengths, 0.0)
        for lane in lanes:
            speeds[lane.edge_id] = max(lane.speed_mps, speeds[lane.edge_id])
        usable = {lane.lane_id for lane in lanes}
        following: dict[str, set[str]] = {edge: set() for edge in lengths}
        for connection in net.connections:
            if connection.from_lane in usable and connection.to_lane in usable:
                following[connection.from_edge].add(connection.to_edge)
        after = {edge: tuple(sorted(edges)) for edge, edges in following.items()}
        return cls(lengths, speeds, counts, after, _reach(lengths, after))

    @cached_property
    def entries(self) -> frozenset[str]:
        """The edges on which traffic enters, which have no predecessor; all edges if there are no such edges."""
        reached = {edge for onward in self.following.values() for edge in onward}
        return frozenset(self.length_m.keys() - reached) or frozenset(self.length_m)

    @cached_property
    def exits(self) -> frozenset[str]:
        """The edges on which traffic leaves, which have no successor; all edges if there are no such edges."""
        return frozenset(edge for edge, onward in self.following.items() if not onward) or frozenset(self.length_m)

    def travel_s(self, route: Iterable[str]) -> float:
        """Return how long a route takes at the speed limits."""
        return sum(self.length_m[edge] / self.speed_mps[edge] for edge in route)

    def quickest(self, starts: Iterable[str], goal: str) -> tuple[str, ...] | None:
        """Return the quickest route from any of the starts to an edge, both included; None if there is no route."""
        # The cost of an edge is paid when it is left: the last one of a route costs the same on all of them.
        graph = Digraph(lambda edge: [(onward, self.travel_s([edge])) for onward in self.following[edge]])
        return graph.cheapest_route(starts, [goal])

    def random_route(
        self, start: str, wanted_m: float, choice: random.Random, favoured: frozenset[str]
    ) -> tuple[str, ...]:
        """Return a route from an edge that prefers wide, fast and favoured roads that continue as far as needed."""
        route = [start]
        driven_m = self.length_m[start]
        while self.following[route[-1]] and len(route) < MOST_EDGES and driven_m < wanted_m + SPARE_M:
            onward = self.following[route[-1]]
            rest_m = max(wanted_m - driven_m, 1.0)
            weights = [
                self.lanes[edge]
                * self.speed_mps[edge]
                * max(min(self.reach_m[edge] / rest_m, 1.0), LEAST_PREFERENCE) ** 2
                / (REVISIT_FACTOR if edge in route else 1.0)
                * (FAVOUR_FACTOR if edge in favoured else 1.0)
                for edge in onward
            ]
            route.append(choice.choices(onward, weights)[0])
            driven_m += self.length_m[route[-1]]
        return tuple(route)


def _reach(lengths: dict[str, float], following: dict[str, tuple[str, ...]]) -> dict[str, float]:
    """Return the distance in m that one can drive from the start of each edge, at most ``FARTHEST_M``.

    The time is linear in the number of edges.

    Edges are removed from the end of the routes (Kahn's order, backwards); an edge that cannot be removed leads into a
    cycle, on which one can drive indefinitely.
    """
    leading: dict[str, list[str]] = {edge: [] for edge in lengths}
    for edge, onward in following.items():
        for other in onward:
            leading[other].append(edge)
    left = {edge: len(onward) for edge, onward in following.items()}
    reach = dict.fromkeys(lengths, FARTHEST_M)
    ready = [edge for edge, count in left.items() if not count]
    while ready:
        edge = ready.pop()
        reach[edge] = min(lengths[edge] + max((reach[other] for other in following[edge]), default=0.0), FARTHEST_M)
        for before in leading[edge]:
            left[before] -= 1
            if not left[before]:
                ready.append(before)
    return reach


def lane_km_of(net: SumoNet) -> float:
    """Return the kilometres of lane open to cars, outside junctions."""
    lanes = (lane for lane in net.lanes.values() if not lane.internal and "passenger" in lane.allowed)
    return sum(length_m(lane.shape) for lane in lanes) / 1000
