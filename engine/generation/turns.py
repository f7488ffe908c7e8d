"""Classifies an ego's manoeuvre at its site from its recorded path: turn, go straight, change lane, merge, exit.

At a junction or a roundabout, the directions of the arms by which the car enters and leaves the site decide
(``site_ways``), so a drive around a ring counts as one turn. On a ramp, the classes of the roads decide. A left turn is
unprotected if it crosses a lane of the other direction and passes no light.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.generation import Turn
from ..geometry import Values, arc_length, length_m, wrap_angle
from ..maps import FAST_ROADS, RAMP_LINKS
from ..network import Digraph, LaneletLookup, RoadLanelet, RoadNetwork, SumoNet
from ..traffic import GeneratedVehicle, OpenEdges
from .site_ways import SiteWays, turn_of
from .sites import SiteFocus, road_classes

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely.geometry.base import BaseGeometry

OPPOSITE_RAD = math.radians(135.0)
"""A lane that arrives at a larger angle comes from the other side (chosen: a quarter of a circle around it)."""
ASIDE_RAD = math.radians(30.0)
"""A car with a larger angle to a road's direction does not drive along it (chosen)."""
CORNER_M = 20.0
"""A road's own curves are longer than a turn at a junction of streets (chosen)."""
SEEN_EVERY = 5
"""Steps (0.5 s) between two samples of the lanelet under a car."""
MOST_ON_RAMP = 12
"""Maximum number of edges of a way along links (chosen), as inside a site (``site_ways``)."""
FARTHEST_HOPS = 4
"""Maximum number of lanelets that a car passes between two samples: inside junctions they are short."""


@dataclass(frozen=True)
class MadeTurn:
    """A car's turn at the site, and the last step of its path before it turns elsewhere.

    ``is_clear``: the path starts and ends in the directions of the two arms, and has no other turn.
    """

    last_step: int
    is_clear: bool = True


def turn_made(
    turn: Turn, car: GeneratedVehicle, last_step: int, focus: SiteFocus, network: RoadNetwork, lookup: LaneletLookup
) -> MadeTurn | None:
    """Return the given turn if a car makes it on its path up to a step, otherwise None.

    A turn to the left or right belongs to the junctions that the site was made from, or to its ring: the car comes from
    outside and has left it by then. A car that goes straight does not change lanes if the site is a road, and stays on
    the main road if it is a ramp.
    """
    if turn != "lane_change" and focus.ways is not None:
        return _made_at_junction(turn, car, last_step, focus.ways, focus, network, lookup)
    under = _under(car, last_step, lookup)
    if turn == "lane_change":
        is_made = _changes_lane(under, network)
    elif focus.kind == "ramp":
        is_made = turn in _RAMP and _RAMP[turn](
            [lanelet.edge_id for lanelet in under if not lanelet.internal], focus.net
        )
    else:
        is_made = turn == "straight" and not _changes_lane(under, network) and _keeps_road(car, last_step)
    return MadeTurn(last_step) if is_made else None


def drives_through(
    car: GeneratedVehicle, last_step: int, focus: SiteFocus, network: RoadNetwork, lookup: LaneletLookup
) -> bool:
    """Return whether a car enters and leaves the site's own junctions or ring up to a step; True at other sites."""
    return focus.ways is None or any(_passages(car, last_step, focus.ways, focus, network, lookup))


@dataclass(frozen=True)
class _Passage:
    """A car's drive through a site: the edges before and after it, and its first and last step inside."""

    entry: str
    exit: str
    first: int
    last: int


def _made_at_junction(
    turn: Turn,
    car: GeneratedVehicle,
    last_step: int,
    ways: SiteWays,
    focus: SiteFocus,
    network: RoadNetwork,
    lookup: LaneletLookup,
) -> MadeTurn | None:
    passage = next(_passages(car, last_step, ways, focus, network, lookup), None)
    wanted: Turn = "left" if turn == "unprotected_left" else turn
    if passage is None or ways.turn(passage.entry, passage.exit) != wanted:
        return None
    if turn == "unprotected_left" and not _is_unprotected(car, passage, last_step, network, lookup):
        return None
    driven, headings = arc_length(car.motion.positions), car.motion.headings_rad
    arrives, leaves = ways.arrives_rad(passage.entry), ways.leaves_rad(passage.exit)
    approach = max(int(np.searchsorted(driven, driven[passage.first] - ways.diameter_m, side="right")), 1)
    is_clear = not bool(_is_off(headings[:approach], arrives).any())
    beyond = min(int(np.searchsorted(driven, driven[passage.last] + ways.diameter_m)), last_step)
    onward = headings[beyond : last_step + 1]
    off = _is_off(onward, leaves)
    if is_clear:
        off |= np.array([turn_of(wrap_angle(float(one) - float(headings[0]))) != wanted for one in onward])
    if not off.any():
        return MadeTurn(last_step, is_clear)
    if off[0]:
        return MadeTurn(last_step, is_clear=False)
    step = beyond + int(np.argmax(off)) - 1
    while step > beyond and not _is_on_road(lookup.under(car.motion.positions[step], float(headings[step]))):
        step -= 1
    return MadeTurn(step, is_clear)


def _is_off(headings: Values, direction_rad: float) -> "NDArray[np.bool_]":
    """Return a mask of the headings at which a car does not drive in a direction."""
    return np.array([abs(wrap_angle(float(one) - direction_rad)) >= ASIDE_RAD for one in headings], dtype=np.bool_)


def _is_on_road(lanelet: RoadLanelet | None) -> bool:
    return lanelet is not None and not lanelet.internal


def _passages(
    car: GeneratedVehicle, last_step: int, ways: SiteWays, focus: SiteFocus, network: RoadNetwork, lookup: LaneletLookup
) -> Iterator[_Passage]:
    """Yield the car's drives through the site up to a step, except those that start or end inside it."""
    steps = np.flatnonzero(focus.inside(car)[: last_step + 1])
    for run in np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1):
        if not len(run):
            continue
        first, last = int(run[0]), int(run[-1])
        entry = _first_edge(car, range(first - 1, -1, -1), ways.entries, network, lookup)
        exit_ = _first_edge(car, range(last + 1, last_step + 1), ways.exits, network, lookup)
        if entry in ways.entries and exit_ in ways.exits:
            yield _Passage(entry, exit_, first, last)


def _first_edge(
    car: GeneratedVehicle, steps: Iterable[int], wanted: frozenset[str], network: RoadNetwork, lookup: LaneletLookup
) -> str:
    """Return the first edge under a car at the given steps, or an empty string if there is none.

    The edges before a ring may be shorter than a step. If the car is in a junction at one end of a ``wanted`` edge, it
    has passed that edge or will pass it.
    """
    for step in steps:
        lanelet = lookup.under(car.motion.positions[step], float(car.motion.headings_rad[step]))
        if lanelet is None:
            continue
        if not lanelet.internal:
            return lanelet.edge_id
        joined = {network.lanelets[key].edge_id for key in (*lanelet.predecessors, *lanelet.successors)} & wanted
        if len(joined) == 1:
            return joined.pop()
    return ""


def _is_unprotected(
    car: GeneratedVehicle, passage: _Passage, last_step: int, network: RoadNetwork, lookup: LaneletLookup
) -> bool:
    """Return whether a car crosses a lane of the direction opposite to its approach, and passes no light."""
    from shapely import LineString

    lit = {light.lanelet_id for light in network.lights}
    passed = [lanelet.lanelet_id for lanelet in _under(car, last_step, lookup)]
    under = set(passed)
    if lit & set(passed[:-1]):  # a light is at the end of its lanelet
        return False
    approach = float(car.motion.headings_rad[passage.first - 1])
    driven = LineString(car.motion.positions[passage.first : passage.last + 2])
    for key, lanelet in network.lanelets.items():
        line = lanelet.center
        if key in under or not lanelet.internal or len(line) < 2:
            continue
        arriving = math.atan2(*(line[1] - line[0])[::-1])
        if abs(wrap_angle(arriving - approach)) > OPPOSITE_RAD and driven.crosses(LineString(line)):
            return True
    return False


def _keeps_road(car: GeneratedVehicle, last_step: int) -> bool:
    """Return whether the car never turns as sharply as at a junction; a road's own curves are long."""
    driven, headings = arc_length(car.motion.positions), np.unwrap(car.motion.headings_rad)
    ahead = np.minimum(np.searchsorted(driven, driven[: last_step + 1] + CORNER_M), last_step)
    return bool(np.abs(headings[ahead] - headings[: last_step + 1]).max() < ASIDE_RAD)


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


def _takes_link(edges: list[str], net: SumoNet, *, onto_main: bool) -> bool:
    """Return whether a car takes a link onto the main road from another road, or the reverse.

    Between two main roads, it does both, unless the first road itself leads to the second.
    """
    roads = [road_classes(net.edges[edge]) for edge in edges]
    if not any(classes & RAMP_LINKS for classes in roads):
        return False
    begins, ends = bool(roads[0] & FAST_ROADS), bool(roads[-1] & FAST_ROADS)
    if begins and ends:
        return not _leads_along_main_road(edges[0], edges[-1], net)
    return (begins, ends) == (not onto_main, onto_main)


def _leads_along_main_road(edge: str, other: str, net: SumoNet) -> bool:
    """Return whether one edge of a main road leads to another without links."""
    main = {key for key, one in net.edges.items() if not one.internal and road_classes(one) & FAST_ROADS}
    onward: dict[str, list[tuple[str, float]]] = {}
    for turn in net.connections:
        if turn.from_edge in main and turn.to_edge in main:
            onward.setdefault(turn.from_edge, []).append((turn.to_edge, 1.0))
    return other in Digraph[str](lambda key: onward.get(key, ())).reachable([edge])


def ramp_ways(turn: Turn, net: SumoNet, edges: OpenEdges) -> Iterator[tuple[str, ...]]:
    """Yield the ways of a class of vehicles along links, onto or off the main roads of a net.

    A way begins with the edge before the links and ends with the edge after them, if there are such edges. Only the
    turns "merge" and "exit" have such ways.
    """
    if turn not in ("merge", "exit"):
        return
    links = {edge for edge in edges.following if road_classes(net.edges[edge]) & RAMP_LINKS}
    led_to = {edge for onward in edges.following.values() for edge in onward}
    waiting: list[tuple[str, ...]] = [(edge,) for edge in sorted(links - led_to)]
    for edge in sorted(edges.following.keys() - links):
        waiting += [(edge, onward) for onward in edges.following[edge] if onward in links]
    while waiting:
        way = waiting.pop()
        onward = [edge for edge in edges.following[way[-1]] if edge not in way]
        if way[-1] in links and onward:
            waiting += [(*way, edge) for edge in onward] if len(way) < MOST_ON_RAMP else []
        elif _RAMP[turn](list(way), net):
            yield way


def _stays_on_main_road(edges: list[str], net: SumoNet) -> bool:
    return bool(edges) and all(road_classes(net.edges[edge]) & FAST_ROADS for edge in edges)


_RAMP: Mapping[Turn, Callable[[list[str], SumoNet], bool]] = {
    "merge": partial(_takes_link, onto_main=True),
    "exit": partial(_takes_link, onto_main=False),
    "straight": _stays_on_main_road,
}
"""The test for each manoeuvre at a ramp, by the edges that the car passes in order, without those inside junctions."""
