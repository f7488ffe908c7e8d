"""Generates traffic from counts: routes over a site that together carry the flows counted on or between its roads.

Counts alone do not determine routes. Of all solutions, this module takes the one that spreads traffic most evenly over
the candidates (least squares without negative flows, with a small ridge). The number of vehicles on a route follows
from its flow and travel time (Little's law).
"""

import math
import random
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.generation import COMPASS_DEG, RoadFlow
from ...schemas.text import counted
from ..geometry import Points
from ..maps import fold
from ..network import LaneletLookup, SumoNet
from ..traffic import GeneratedVehicle, OpenEdges, TripMaker
from ..vehicles import VehicleClass, vehicle_classes
from .site_network import SiteNetwork

ROUTES_A_START = 40
"""Candidate routes drawn from every edge on which traffic enters (chosen)."""
EVENNESS = 0.05
"""Weight of an even spread relative to meeting the counts (chosen): decides only between equally good routes."""
LONGEST_M = 5_000.0
"""Maximum length of candidate routes (chosen): no site is larger."""
LEAST_PER_H = 0.5
"""A route with a smaller flow is dropped (chosen)."""
_OSM_WAY = re.compile(r"-?(\d+)")
MOST_ASIDE_RAD, END_ASIDE_RAD = math.radians(67.5), math.radians(45)
"""Maximum angle between a compass direction and a road that leads or ends in it (chosen).

A road leads in a direction by its heading, and ends in it by the bearing of its end from the middle of the site. A road
may curve; an end is in one quarter.
"""


@dataclass(frozen=True)
class RouteFlow:
    """A route as edges, its flow in vehicles per hour, and its free-flow travel time in s."""

    edges: tuple[str, ...]
    per_h: float
    travel_s: float

    @property
    def present(self) -> float:
        """The mean number of vehicles on the route (Little's law)."""
        return self.per_h * self.travel_s / 3600


@dataclass(frozen=True)
class CountedRoad:
    """A requested flow at this site: the counted cross-sections, each as edges, and the flow that the routes carry.

    ``planned_per_h`` is the mean over the cross-sections; there are no sections if the road is not at this site.
    """

    flow: RoadFlow
    sections: tuple[frozenset[str], ...]
    planned_per_h: float


@dataclass(frozen=True)
class FlowPlan:
    """Routes with their flows, and how well they meet the flows of the request."""

    routes: tuple[RouteFlow, ...]
    roads: tuple[CountedRoad, ...]

    @property
    def vehicles(self) -> int:
        """The mean number of vehicles at the site, at least 1."""
        return max(round(sum(route.present for route in self.routes)), 1)


def plan_flows(flows: Sequence[RoadFlow], net: SumoNet, choice: random.Random) -> FlowPlan:
    """Return routes of cars over a site that carry the counted flows.

    Raises:
        NotPossible: no counted road is at the site, or no route connects the roads between which traffic was counted.
    """
    edges = OpenEdges.of(net, vehicle_classes()["car"].sumo_class)
    place = _Place(net, edges)
    candidates = _candidates(edges, choice)
    between = [(flow, place.routes_between(flow.road, flow.to) if flow.to else ()) for flow in flows]
    routes = [
        RouteFlow(route, flow.per_h / len(ways), edges.travel_s(route)) for flow, ways in between for route in ways
    ]
    across = [(flow, ways, () if flow.to else place.sections(flow)) for flow, ways in between]
    counts = [(section, flow.per_h) for flow, _, sections in across for section in sections]
    routes += _meeting(counts, candidates, edges)
    roads = tuple(_counted(flow, frozenset(ways), sections, routes) for flow, ways, sections in across)
    if not routes:
        raise NotPossible(
            f"no counted road carries traffic at this site: {', '.join(str(flow) for flow in flows[:5])}",
            valid=place.names(),
            next_step="use roads of this site (street names or OSM way ids), or choose another place",
        )
    return FlowPlan(tuple(routes), roads)


def _counted(
    flow: RoadFlow,
    routes_between: frozenset[tuple[str, ...]],
    sections: tuple[frozenset[str], ...],
    routes: list[RouteFlow],
) -> CountedRoad:
    """Return a counted road with the flow that the routes carry, between two roads or across its sections."""
    if flow.to:
        planned = sum(route.per_h for route in routes if route.edges in routes_between)
        return CountedRoad(flow, (), min(planned, flow.per_h))
    carried = [sum(route.per_h for route in routes if section & set(route.edges)) for section in sections]
    return CountedRoad(flow, sections, float(np.mean(carried)) if carried else 0.0)


def _candidates(edges: OpenEdges, choice: random.Random) -> list[tuple[str, ...]]:
    """Draw distinct routes from entries to exits of the site, so that each reachable edge is on at least one."""
    drawn = {
        edges.random_route(start, LONGEST_M, choice, frozenset())
        for start in sorted(edges.entries)
        for _ in range(ROUTES_A_START)
    }
    covered = {edge for route in drawn for edge in route}
    for edge in sorted(set(edges.length_m) - covered):
        entering = edges.quickest(edges.entries, edge) or (edge,)
        drawn.add((*entering[:-1], *edges.random_route(edge, LONGEST_M, choice, frozenset())))
    return sorted(drawn)


def _meeting(
    counts: list[tuple[frozenset[str], float]], candidates: list[tuple[str, ...]], edges: OpenEdges
) -> list[RouteFlow]:
    """Fit the flows on the candidate routes to the counts at the cross-sections; return the routes with their flows."""
    from scipy.optimize import nnls

    used = [route for route in candidates if any(section & set(route) for section, _ in counts)]
    if not used:
        return []
    passes = np.array([[float(bool(section & set(route))) for route in used] for section, _ in counts])
    wanted = np.array([per_h for _, per_h in counts])
    system = np.vstack([passes, EVENNESS * np.eye(len(used))])
    flows, _ = nnls(system, np.concatenate([wanted, np.zeros(len(used))]))
    return [
        RouteFlow(route, float(flow), edges.travel_s(route))
        for route, flow in zip(used, flows, strict=True)
        if flow >= LEAST_PER_H
    ]


def flow_notes(plan: FlowPlan, vehicles: Sequence[GeneratedVehicle], site: SiteNetwork) -> list[str]:
    """Describe each flow: the count, the planned flow, and the number of vehicles on the road at step 0."""
    here = Counter(_edges_at_start(vehicles, site))
    return [_flow_note(road, sum(here[edge] for section in road.sections for edge in section)) for road in plan.roads]


def _flow_note(road: CountedRoad, at_start: int) -> str:
    flow_text = f"{road.flow}: {road.flow.per_h:g} vehicles an hour counted"
    if road.flow.to:
        no_route = "but no route leads there here"
        planned = f"{road.planned_per_h:.0f} planned on its routes" if road.planned_per_h else no_route
        return f"{flow_text}, {planned}"
    if not road.sections:
        return f"{flow_text}, but no such road carries cars at this site"
    return f"{flow_text}, {road.planned_per_h:.0f} planned; {counted(at_start, 'vehicle')} on it at the start"


def _edges_at_start(vehicles: Sequence[GeneratedVehicle], site: SiteNetwork) -> Iterator[str]:
    lookup = LaneletLookup(site.network)
    for vehicle in vehicles:
        lanelet = lookup.under(vehicle.motion.positions[0], float(vehicle.motion.headings_rad[0]))
        if lanelet is not None:
            yield lanelet.edge_id


class FlowTrips(TripMaker):
    """Makes trips along the routes of a plan; each starts where a vehicle would be at a random time.

    Vehicles of a class that may not use any of the routes drive as if there were no plan.
    """

    def __init__(self, net: SumoNet, lasting_s: float, choice: random.Random, plan: FlowPlan) -> None:
        super().__init__(net, lasting_s, choice)
        self._plan = plan

    def trip(self, vehicle_class: VehicleClass) -> tuple[str, ...]:
        """Return a route from a random start, weighted by the vehicles on routes and by the time on each edge."""
        edges = self.open_to(vehicle_class)
        routes = [route for route in self._plan.routes if edges.length_m.keys() >= set(route.edges)]
        if not routes:
            return super().trip(vehicle_class)
        route = self._choice.choices(routes, [each.present for each in routes])[0].edges
        times_s = [edges.travel_s([edge]) for edge in route]
        return route[self._choice.choices(range(len(route)), times_s)[0] :]


class _Place:
    """The roads of a site under the names of a request: street names, OSM way ids, compass directions."""

    def __init__(self, net: SumoNet, edges: OpenEdges) -> None:
        self._net, self._edges = net, edges
        ends = np.array([self._ends(edge) for edge in sorted(edges.length_m)])
        self._middle = ends.reshape(-1, 2).mean(axis=0)

    def names(self) -> list[str]:
        """Return the names of the named streets, then the OSM way ids of the unnamed streets."""
        named = {self._net.edges[edge].name for edge in self._edges.length_m} - {""}
        unnamed = {_way(edge) for edge in self._edges.length_m if not self._net.edges[edge].name}
        return [*sorted(named), *sorted(unnamed)]

    def sections(self, flow: RoadFlow) -> tuple[frozenset[str], ...]:
        """Return the cross-sections of a counted road, as edges of both directions, or of the requested direction."""
        sections: dict[str, set[str]] = {}
        for edge in sorted(self._edges.length_m):
            if self._has_name(edge, flow.road) and self._leads(edge, flow.direction):
                sections.setdefault(edge.lstrip("-"), set()).add(edge)
        return tuple(frozenset(section) for section in sections.values())

    def routes_between(self, origin: str, destination: str) -> tuple[tuple[str, ...], ...]:
        """Return the quickest routes from each entry edge at the origin to each exit edge at the destination."""
        starts, goals = (
            self._beginning(origin, self._edges.entries, 0),
            self._beginning(destination, self._edges.exits, 1),
        )
        routes = (self._edges.quickest([start], goal) for start, goal in product(starts, goals))
        return tuple(sorted(route for route in routes if route and not self._turns_back(route)))

    def _turns_back(self, route: tuple[str, ...]) -> bool:
        return self._net.edges[route[0]].from_junction == self._net.edges[route[-1]].to_junction

    def _beginning(self, word: str, edges: frozenset[str], end: int) -> list[str]:
        """Return the edges of a street or way, or for a compass direction those that start or end on that side.

        ``end``: 0 for the start of an edge, 1 for its end.
        """
        heading_deg = COMPASS_DEG.get(word.lower())
        if heading_deg is None:
            return [edge for edge in sorted(edges) if self._has_name(edge, word)]
        return [
            edge for edge in sorted(edges) if _turn(self._ends(edge)[end] - self._middle, heading_deg) <= END_ASIDE_RAD
        ]

    def _has_name(self, edge: str, word: str) -> bool:
        return word == _way(edge) or fold(word) == fold(self._net.edges[edge].name) != ""

    def _leads(self, edge: str, direction: str) -> bool:
        if not direction:
            return True
        start, end = self._ends(edge)
        return _turn(end - start, COMPASS_DEG[direction]) <= MOST_ASIDE_RAD

    def _ends(self, edge: str) -> tuple[Points, Points]:
        shape = self._net.lanes[self._net.edges[edge].lane_ids[-1]].shape
        return shape[0], shape[-1]


def _way(edge: str) -> str:
    """Return the OSM way that netconvert made an edge from."""
    found = _OSM_WAY.match(edge)
    return found[1] if found else edge


def _turn(step: Points, heading_deg: float) -> float:
    """Return the angle in rad between the direction of a displacement and a heading."""
    return abs(math.remainder(math.atan2(step[1], step[0]) - math.radians(heading_deg), math.tau))
