"""Makes trips through a site along the ego's requested turn, for use if no vehicle of the traffic makes it.

If the roads allow it, a trip leads straight to the site and straight on after it, so that its only turn is at the site.
"""

import math
import random
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from ...schemas.generation import Turn
from ..geometry import wrap_angle
from ..network import SumoNet
from ..traffic import LAST_INSERTION_S, WARM_UP_S, LateTrip, OpenEdges, TripMaker
from ..vehicles import VehicleClass
from .site_ways import direction_rad
from .sites import SiteFocus
from .turns import ASIDE_RAD, CORNER_M, ramp_ways

TURNING_SHARE = 0.5
"""Share of the trips of the ego's class that make the turn (chosen): the ego must interact with the others."""
MOST_LATE = 10
"""Maximum number of trips that begin just in time to enter the site during the recording (chosen)."""
LEAST_APPROACH_S, LEAST_BEYOND_S = 4.0, 4.0
"""Time that a late trip takes to the site at the speed limits, and its time beyond it (chosen): it starts outside,
brakes before the site, and must drive in the direction of the exit's road at the end.
"""
SLOWER = 1.5
"""Time that a car takes through a site, as a multiple of that at the speed limits (chosen): it yields and turns."""


def possible_turns(net: SumoNet, focus: SiteFocus, sumo_class: str) -> frozenset[Turn] | None:
    """Return the turns that a vehicle of a SUMO class can make at a site, or None if the site is a road or a ramp."""
    if focus.ways is None:
        return None
    turns = {turn for turn, _ in focus.ways.through(OpenEdges.of(net, sumo_class))}
    return frozenset(turns | ({"unprotected_left"} if "left" in turns else set()))


def has_ways(focus: SiteFocus) -> bool:
    """Return whether vehicles can be routed along the ways of a site: it is a junction, a roundabout or a ramp."""
    return focus.ways is not None or focus.kind == "ramp"


def needed_s(net: SumoNet, focus: SiteFocus, turn: Turn | None, sumo_class: str) -> float:
    """Return how long a recording of a turn at a site must last for a SUMO class; 0 if no route makes the turn.

    Without a turn, it is the time for any way through the site. The quickest way counts.
    """
    edges = OpenEdges.of(net, sumo_class)
    times_s = [_inside_s(net, edges, way) for way in _ways_of(focus, turn, edges)]
    return LEAST_APPROACH_S + min(times_s) + LEAST_BEYOND_S if times_s else 0.0


def _ways_of(focus: SiteFocus, turn: Turn | None, edges: OpenEdges) -> tuple[tuple[str, ...], ...]:
    """Return the ways through a site that make a turn, or all ways without a turn.

    A ramp only has ways for "merge" and "exit", and a road has none.
    """
    if focus.kind == "ramp":
        return () if turn is None else tuple(ramp_ways(turn, focus.net, edges))
    wanted = "left" if turn == "unprotected_left" else turn
    ways = () if focus.ways is None else focus.ways.through(edges)
    return tuple(way for made, way in ways if wanted is None or made == wanted)


def _inside_s(net: SumoNet, edges: OpenEdges, way: Sequence[str]) -> float:
    """Return the time from the end of a way's first edge to the start of its last one.

    The parts inside junctions count as straight lines.
    """
    lines = [net.lanes[net.edges[edge].lane_ids[0]].shape for edge in way]
    gaps_s = (
        float(np.linalg.norm(onward[0] - line[-1])) / min(edges.speed_mps[one], edges.speed_mps[other])
        for (line, onward), (one, other) in zip(pairwise(lines), pairwise(way), strict=True)
    )
    return SLOWER * (edges.travel_s(way[1:-1]) + sum(gaps_s))


class TurningTrips(TripMaker):
    """Makes half of a class's trips along routes through a site.

    Without a ``turn``, they take any route through the site. If no route makes the turn, the trips are the usual trips.
    Most trips begin with the simulation, so on short roads they have passed the site before the recording. Up to
    ``most_late`` of the class's trips therefore begin only when they will enter the site during the recording, early
    enough to leave it again.
    """

    def __init__(
        self,
        net: SumoNet,
        lasting_s: float,
        choice: random.Random,
        focus: SiteFocus,
        turn: Turn | None,
        vehicle_class: VehicleClass,
        duration_s: float,
        most_late: int,
    ) -> None:
        super().__init__(net, lasting_s, choice)
        self._through = _ways_of(focus, turn, self.open_to(vehicle_class))
        self._class, self._before_s = vehicle_class.name, WARM_UP_S + duration_s / 2
        self._late = tuple(self._timed(vehicle_class, duration_s, min(most_late, MOST_LATE)))

    def trip(self, vehicle_class: VehicleClass) -> tuple[str, ...]:
        """Return a trip with the turn, or a usual trip; the ego's class gets both."""
        if vehicle_class.name != self._class or not self._through or self._choice.random() >= TURNING_SHARE:
            return super().trip(vehicle_class)
        edges = self.open_to(vehicle_class)
        way = self._choice.choice(self._through)
        way = self._straight_on(edges, way)
        onward = edges.random_route(way[-1], edges.speed_mps[way[-1]] * self._lasting_s, self._choice, frozenset())
        wanted_s = self._choice.uniform(0.0, self._before_s)
        return (*self._approach(edges, way, wanted_s), *way, *onward[1:])

    def late_trips(self) -> tuple[LateTrip, ...]:
        """Return the trips that enter the site during the recording, one after the other."""
        return self._late

    def _timed(self, vehicle_class: VehicleClass, duration_s: float, count: int) -> list[LateTrip]:
        """Return trips of a class with the turn, in order of time; ways that take too long come only without others."""
        edges = self.open_to(vehicle_class)
        inside_s = {way: _inside_s(self._net, edges, way) for way in self._through}
        ways = self._choice.sample(self._through, len(self._through))
        ways = [way for way in ways if inside_s[way] < duration_s - LEAST_BEYOND_S] or ways
        trips = []
        for number in range(count if ways else 0):
            way = ways[number % len(ways)]
            latest_s = max(duration_s - inside_s[way] - LEAST_BEYOND_S, 0.0)
            enters_s = WARM_UP_S + latest_s * number / count
            trips.append(self._late_trip(edges, vehicle_class, self._straight_on(edges, way), way[0], enters_s))
        return sorted(trips, key=lambda trip: trip.at_s)

    def _late_trip(
        self, edges: OpenEdges, vehicle_class: VehicleClass, way: tuple[str, ...], entry: str, enters_s: float
    ) -> LateTrip:
        """Return the trip that reaches the end of its entry at a time of the simulation, or as soon before as it can.

        It begins as late as possible, but with room to brake before the site.
        """
        begins_s = min(LAST_INSERTION_S - 1.0, enters_s - LEAST_APPROACH_S)
        approach = self._approach(edges, way, enters_s - begins_s)
        first = (*approach, entry)[0]
        spare_s = edges.travel_s((*approach, entry)) - (enters_s - begins_s)
        station_m = min(max(spare_s * edges.speed_mps[first], vehicle_class.length_m), edges.length_m[first])
        return LateTrip(vehicle_class, (*approach, *way), station_m, begins_s)

    def _straight_on(self, edges: OpenEdges, way: tuple[str, ...]) -> tuple[str, ...]:
        """Return a route with the edges that lead straight on after it, for as long as trips last."""
        longer = list(way)
        while edges.travel_s(longer) < self._lasting_s:
            onward = [edge for edge in edges.following[longer[-1]] if edge not in longer]
            turned = {edge: self._turned_rad(longer[-1], edge) for edge in onward}
            if not turned or min(turned.values()) >= ASIDE_RAD:
                break
            longer.append(min(turned, key=lambda edge: (turned[edge], edge)))
        return tuple(longer)

    def _approach(self, edges: OpenEdges, way: tuple[str, ...], wanted_s: float) -> tuple[str, ...]:
        """Return the edges that lead to a route: enough for the wanted time, or all that exist.

        They lead straight to it if such edges are long enough.
        """
        leading: dict[str, list[str]] = {}
        for edge, following in edges.following.items():
            for other in following:
                leading.setdefault(other, []).append(edge)
        straight = {
            other: [edge for edge in before if self._turned_rad(edge, other) < ASIDE_RAD]
            for other, before in leading.items()
        }
        approach = self._leading_to(edges, way, wanted_s, straight)
        if edges.travel_s(approach) < wanted_s:
            approach = self._leading_to(edges, way, wanted_s, leading)
        return tuple(approach[:-1])

    def _leading_to(
        self, edges: OpenEdges, way: tuple[str, ...], wanted_s: float, leading: Mapping[str, Sequence[str]]
    ) -> list[str]:
        """Return random edges that lead to a route, and its first edge."""
        approach = [way[0]]
        while edges.travel_s(approach) < wanted_s:
            fresh = [edge for edge in sorted(leading.get(approach[0], [])) if edge not in approach and edge not in way]
            if not fresh:
                break
            approach.insert(0, self._choice.choice(fresh))
        return approach

    def _turned_rad(self, edge: str, onward: str) -> float:
        """Return the angle by which a vehicle turns from the end of one edge to the start of the next."""
        before, behind = (self._net.lanes[self._net.edges[key].lane_ids[0]].shape for key in (edge, onward))
        return abs(wrap_angle(direction_rad(behind, CORNER_M) - direction_rad(before[::-1], CORNER_M) - math.pi))
