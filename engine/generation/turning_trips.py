"""Makes trips through a site along the ego's requested turn, for use if no vehicle of the traffic makes it.

A route through the site is an edge that leads to it, edges inside it, and one that leads away. The headings of the
first and the last determine the turn, as for a recorded car (``turns``).
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...schemas.generation import Turn
from ..geometry import Points, arc_length, interpolate, wrap_angle
from ..network import SumoNet
from ..traffic import OpenEdges, TripMaker
from ..vehicles import VehicleClass
from .sites import SiteFocus
from .turns import BESIDE_M, turn_of

MOST_INSIDE = 12
"""Maximum number of edges inside a site on a route (chosen): once around a ring with as many arms."""
TURNING_SHARE = 0.5
"""Share of the trips of the ego's class that make the turn (chosen): the ego must interact with the others."""


@dataclass(frozen=True)
class SiteEdges:
    """The junctions of a site, or the edges of its ring; ``spot``: junctions that a route must pass."""

    junctions: frozenset[str]
    spot: frozenset[str]
    ring: frozenset[str] = frozenset()

    @classmethod
    def of(cls, focus: SiteFocus) -> "SiteEdges | None":
        """Return the edges of a site with left or right turns, or None if a road or a ramp is the site."""
        if not focus.junctions and not focus.ring:
            return None
        return cls(focus.junctions, focus.spot_junctions, focus.ring)

    def is_passed(self, net: SumoNet, way: tuple[str, ...]) -> bool:
        """Return whether a route passes the exact spot of the site."""
        return bool(self.ring) or any(net.edges[edge].to_junction in self.spot for edge in way[:-1])

    def is_inside(self, net: SumoNet, edge: str) -> bool:
        """Return whether an edge is part of the ring, or leads from one of the junctions to another."""
        road = net.edges[edge]
        between = road.from_junction in self.junctions and road.to_junction in self.junctions
        return edge in self.ring or (between and not self.ring)

    def leads_in(self, net: SumoNet, edge: str, onward: str) -> bool:
        """Return whether the step from one edge to the next enters the site."""
        return onward in self.ring if self.ring else net.edges[edge].to_junction in self.junctions


def routes_through(net: SumoNet, edges: OpenEdges, site: SiteEdges) -> Iterator[tuple[Turn, tuple[str, ...]]]:
    """Yield every route through a site with its turn; the first and last edges are outside the site."""
    for entry in sorted(edges.following):
        if site.is_inside(net, entry):
            continue
        waiting: list[tuple[str, ...]] = [
            (entry, onward) for onward in edges.following[entry] if site.leads_in(net, entry, onward)
        ]
        while waiting:
            way = waiting.pop()
            if not site.is_inside(net, way[-1]):
                if site.is_passed(net, way):
                    yield _turn_of_route(net, way), way
            elif len(way) <= MOST_INSIDE:
                waiting += [(*way, onward) for onward in edges.following[way[-1]] if onward not in way]


def possible_turns(net: SumoNet, focus: SiteFocus, sumo_class: str) -> frozenset[Turn] | None:
    """Return the turns that a vehicle of a SUMO class can make at a site, or None if a road or a ramp is the site."""
    site = SiteEdges.of(focus)
    if site is None:
        return None
    turns = {turn for turn, _ in routes_through(net, OpenEdges.of(net, sumo_class), site)}
    return frozenset(turns | ({"unprotected_left"} if "left" in turns else set()))


def _turn_of_route(net: SumoNet, way: tuple[str, ...]) -> Turn:
    before, behind = (net.lanes[net.edges[edge].lane_ids[0]].shape for edge in (way[0], way[-1]))
    return turn_of(wrap_angle(_heading(behind, at_end=False) - _heading(before, at_end=True)))


def _heading(line: Points, *, at_end: bool) -> float:
    """Return the heading of the last metres of a line, or of its first metres."""
    stations = arc_length(line)
    near = max(float(stations[-1]) - BESIDE_M, 0.0) if at_end else min(BESIDE_M, float(stations[-1]))
    point = interpolate(line, stations, np.array([near]))[0]
    step = line[-1] - point if at_end else point - line[0]
    return float(np.arctan2(step[1], step[0]))


class TurningTrips(TripMaker):
    """Makes half of a class's trips along routes through a site; they start up to ``before_s`` seconds before it.

    If no route makes the turn, the trips are the usual ones.
    """

    def __init__(
        self,
        net: SumoNet,
        lasting_s: float,
        choice: random.Random,
        focus: SiteFocus,
        turn: Turn,
        vehicle_class: VehicleClass,
        before_s: float,
    ) -> None:
        super().__init__(net, lasting_s, choice)
        site, wanted = SiteEdges.of(focus), "left" if turn == "unprotected_left" else turn
        ways = () if site is None else routes_through(net, self.open_to(vehicle_class), site)
        self._through = tuple(way for made, way in ways if made == wanted)
        self._class, self._before_s = vehicle_class.name, before_s

    def trip(self, vehicle_class: VehicleClass) -> tuple[str, ...]:
        """Return a trip with the turn or a usual one; the ego's class gets both."""
        if vehicle_class.name != self._class or not self._through or self._choice.random() >= TURNING_SHARE:
            return super().trip(vehicle_class)
        edges = self.open_to(vehicle_class)
        way = self._choice.choice(self._through)
        onward = edges.random_route(way[-1], edges.speed_mps[way[-1]] * self._lasting_s, self._choice, frozenset())
        wanted_s = self._choice.uniform(0.0, self._before_s)
        return (*self._approach(edges, way, wanted_s), *way, *onward[1:])

    def _approach(self, edges: OpenEdges, way: tuple[str, ...], wanted_s: float) -> tuple[str, ...]:
        """Return the edges that lead to a route: enough for the wanted time, or all that exist."""
        leading: dict[str, list[str]] = {}
        for edge, following in edges.following.items():
            for other in following:
                leading.setdefault(other, []).append(edge)
        approach = [way[0]]
        while edges.travel_s(approach) < wanted_s:
            fresh = [edge for edge in sorted(leading.get(approach[0], [])) if edge not in approach and edge not in way]
            if not fresh:
                break
            approach.insert(0, self._choice.choice(fresh))
        return tuple(approach[:-1])
