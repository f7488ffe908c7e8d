"""Makes trips through a site along the ego's requested turn, for use if no vehicle of the traffic makes it.

A trip leads straight to the site and straight on behind it where the roads allow this, so that its turn is the one at
the site.
"""

import math
import random
from collections.abc import Mapping, Sequence

from ...schemas.generation import Turn
from ..geometry import wrap_angle
from ..network import SumoNet
from ..traffic import OpenEdges, TripMaker
from ..vehicles import VehicleClass
from .site_ways import direction_rad
from .sites import SiteFocus
from .turns import ASIDE_RAD, CORNER_M

TURNING_SHARE = 0.5
"""Share of the trips of the ego's class that make the turn (chosen): the ego must interact with the others."""


def possible_turns(net: SumoNet, focus: SiteFocus, sumo_class: str) -> frozenset[Turn] | None:
    """Return the turns that a vehicle of a SUMO class can make at a site, or None if a road or a ramp is the site."""
    if focus.ways is None:
        return None
    turns = {turn for turn, _ in focus.ways.through(OpenEdges.of(net, sumo_class))}
    return frozenset(turns | ({"unprotected_left"} if "left" in turns else set()))


class TurningTrips(TripMaker):
    """Makes half of a class's trips along routes through a site; they start up to ``before_s`` seconds before it.

    Without a ``turn``, they take any route through the site. If no route makes the turn, the trips are the usual trips.
    """

    def __init__(
        self,
        net: SumoNet,
        lasting_s: float,
        choice: random.Random,
        focus: SiteFocus,
        turn: Turn | None,
        vehicle_class: VehicleClass,
        before_s: float,
    ) -> None:
        super().__init__(net, lasting_s, choice)
        wanted = "left" if turn == "unprotected_left" else turn
        ways = () if focus.ways is None else focus.ways.through(self.open_to(vehicle_class))
        self._through = tuple(way for made, way in ways if wanted is None or made == wanted)
        self._class, self._before_s = vehicle_class.name, before_s

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
        """Return by how much a vehicle turns from the end of one edge to the start of the next."""
        before, behind = (self._net.lanes[self._net.edges[key].lane_ids[0]].shape for key in (edge, onward))
        return abs(wrap_angle(direction_rad(behind, CORNER_M) - direction_rad(before[::-1], CORNER_M) - math.pi))
