"""Classifies an ego's manoeuvre at its site from its recorded path: turn, go straight, change lane, merge, exit.

At a junction or a roundabout, the heading before the site's first metre is compared with the heading after its last, so
a drive around a ring counts as one turn. On a ramp, the classes of the roads decide. Left is positive. A left turn is
unprotected if it crosses a lane of the other direction and passes no light.
"""

import math
from collections.abc import Callable, Mapping
from heapq import heappop, heappush
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.generation import Turn
from ..geometry import arc_length, length_m, wrap_angle
from ..maps import FAST_ROADS, RAMP_LINKS
from ..network import LaneletLookup, RoadLanelet, RoadNetwork
from ..traffic import GeneratedVehicle
from .sites import SiteFocus, road_classes

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

TURN_RAD, BACK_RAD = math.radians(30.0), math.radians(150.0)
"""A car with a smaller heading change goes straight; one with a larger change than the second turns back (chosen)."""
OPPOSITE_RAD = math.radians(135.0)
"""A lane that arrives at a larger angle comes from the other side (chosen: a quarter of a circle around it)."""
BESIDE_M = 10.0
"""Distance before and after the site at which the headings are taken (chosen): lanes curve near a ring."""
SEEN_EVERY = 5
"""Steps (0.5 s) between two samples of the lanelet under a car."""
FARTHEST_HOPS = 4
"""Maximum number of lanelets that a car passes between two samples: inside junctions they are short."""


def makes(
    turn: Turn, car: GeneratedVehicle, last_step: int, focus: SiteFocus, network: RoadNetwork, lookup: LaneletLookup
) -> bool:
    """Return whether a car makes the given turn on its path up to a step.

    A turn to the left or right belongs to a junction or ring: the car comes from outside and has left it by then. A car
    that goes straight does not change lanes if the site is a road, and stays on the main road if it is a ramp.
    """
    if turn == "lane_change":
        return _changes_lane(_under(car, last_step, lookup), network)
    if focus.kind == "ramp":
        return _RAMP[turn](_classes(_under(car, last_step, lookup), focus)) if turn in _RAMP else False
    if focus.kind in ("highway", "rural"):
        under = _under(car, last_step, lookup)
        return turn == "straight" and not _changes_lane(under, network) and _keeps_road(car, last_step)
    if turn == "unprotected_left":
        return _turned(car, last_step, focus) == "left" and _is_unprotected(car, last_step, focus, network, lookup)
    return _turned(car, last_step, focus) == turn


def _is_unprotected(
    car: GeneratedVehicle, last_step: int, focus: SiteFocus, network: RoadNetwork, lookup: LaneletLookup
) -> bool:
    """Return whether a car crosses a lane of the direction opposite to its approach, and passes no light."""
    from shapely import LineString

    lit = {light.lanelet_id for light in network.lights}
    passed = [lanelet.lanelet_id for lanelet in _under(car, last_step, lookup)]
    under = set(passed)
    if lit & set(passed[:-1]):  # a light is at the end of its lanelet
        return False
    steps = np.flatnonzero(focus.inside(car)[: last_step + 1])
    approach = float(car.motion.headings_rad[max(int(steps[0]) - 1, 0)])
    driven = LineString(car.motion.positions[steps[0] : steps[-1] + 2])
    for key, lanelet in network.lanelets.items():
        line = lanelet.center
        if key in under or not lanelet.internal or len(line) < 2:
            continue
        arriving = math.atan2(*(line[1] - line[0])[::-1])
        if abs(wrap_angle(arriving - approach)) > OPPOSITE_RAD and driven.crosses(LineString(line)):
            return True
    return False


def _turned(car: GeneratedVehicle, last_step: int, focus: SiteFocus) -> Turn | None:
    """Return the car's turn at the junction or ring, or None if its path does not start and end outside it."""
    steps = np.flatnonzero(focus.inside(car)[: last_step + 1])
    if not len(steps) or steps[0] == 0 or steps[-1] == last_step:
        return None
    if focus.is_between_ring_edges(car, 0) or focus.is_between_ring_edges(car, last_step):
        return None
    driven = arc_length(car.motion.positions)
    before = int(np.searchsorted(driven, driven[steps[0]] - BESIDE_M))
    behind = min(int(np.searchsorted(driven, driven[steps[-1]] + BESIDE_M)), last_step)
    headings = car.motion.headings_rad
    return turn_of(wrap_angle(float(headings[behind]) - float(headings[before])))


def turn_of(turned_rad: float) -> Turn:
    """Return the turn of a car at a junction or ring, by the change of its heading there, left positive."""
    if abs(turned_rad) > BACK_RAD:
        return "u_turn"
    if abs(turned_rad) < TURN_RAD:
        return "straight"
    return "left" if turned_rad > 0 else "right"


def _keeps_road(car: GeneratedVehicle, last_step: int) -> bool:
    """Return whether the car never turns as sharply as at a junction; a road's own curves are long."""
    driven, headings = arc_length(car.motion.positions), np.unwrap(car.motion.headings_rad)
    ahead = np.minimum(np.searchsorted(driven, driven[: last_step + 1] + 2 * BESIDE_M), last_step)
    return bool(np.abs(headings[ahead] - headings[: last_step + 1]).max() < TURN_RAD)


def _under(car: GeneratedVehicle, last_step: int, lookup: LaneletLookup) -> list[RoadLanelet]:
    """Return the lanelets under the car, each once per visit; positions are sampled twice a second."""
    motion = car.motion
    steps = [*range(0, last_step, SEEN_EVERY), last_step]
    seen = [lookup.under(motion.positions[step], float(motion.headings_rad[step])) for step in steps]
    return [lanelet for lanelet, _ in groupby(lanelet for lanelet in seen if lanelet is not None)]


def _changes_lane(under: list[RoadLanelet], network: RoadNetwork) -> bool:
    return any(_is_lane_change(one, other, network) for one, other in pairwise(under))


def _is_lane_change(one: RoadLanelet, other: RoadLanelet, network: RoadNetwork) -> bool:
    """Return whether the way from one lanelet to the other needs a lane change, to a neighbour or its successors."""
    if _leads_to(one, other, network):
        return False
    return any(key == other.lanelet_id or _leads_to(network.lanelets[key], other, network) for key in one.neighbours())


def _leads_to(one: RoadLanelet, other: RoadLanelet, network: RoadNetwork) -> bool:
    reached = {one.lanelet_id}
    for _ in range(FARTHEST_HOPS):
        reached = {key for before in reached for key in network.lanelets[before].successors}
        if other.lanelet_id in reached:
            return True
    return False


def leads_without_change(start: RoadLanelet, region: "BaseGeometry", network: RoadNetwork, farthest_m: float) -> bool:
    """Return whether successive lanelets lead from a lanelet to a region within a distance.

    Lanelets that the region only touches do not count, because their centre lines miss it.
    """
    from shapely import LineString

    waiting, reached = [(0.0, start.lanelet_id)], set[int]()
    while waiting:
        begun_m, key = heappop(waiting)
        if key in reached:
            continue
        reached.add(key)
        lanelet = network.lanelets[key]
        if LineString(lanelet.center).intersects(region):
            return True
        ended_m = begun_m + length_m(lanelet.center)
        if ended_m <= farthest_m:
            for following in lanelet.successors:
                heappush(waiting, (ended_m, following))
    return False


def _classes(under: list[RoadLanelet], focus: SiteFocus) -> list[frozenset[str]]:
    """Return the OSM classes of the roads under a car in order; the insides of junctions are left out."""
    return [road_classes(focus.net.edges[lanelet.edge_id]) for lanelet in under if not lanelet.internal]


def _takes_link(roads: list[frozenset[str]], *, onto_main: bool) -> bool:
    """Return whether a car takes a link onto the main road from another road, or the reverse."""
    if not any(classes & RAMP_LINKS for classes in roads):
        return False
    begins, ends = bool(roads[0] & FAST_ROADS), bool(roads[-1] & FAST_ROADS)
    return (begins, ends) == (not onto_main, onto_main)


_RAMP: Mapping[Turn, Callable[[list[frozenset[str]]], bool]] = {
    "merge": lambda roads: _takes_link(roads, onto_main=True),
    "exit": lambda roads: _takes_link(roads, onto_main=False),
    "straight": lambda roads: bool(roads) and all(classes & FAST_ROADS for classes in roads),
}
"""The test for each manoeuvre at a ramp, by the classes of the roads that the car passes."""
