"""Choosing the site of a scenario: of the asked type, on the asked streets, within the asked box, by seed and index."""

import random
from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError
from ...schemas.generation import GenerationRequest, SiteCount, SiteType
from ..execution import ProgressReporter
from ..geometry import Points
from ..maps import LINKS, ROADS, RURAL_CLASSES, OsmMap, Site, SiteFinder, fold, ground_distance_m, read_map_file
from ..network import NetEdge, RoadLanelet, RoadNetwork, SumoNet
from ..traffic import Participant

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

# ---------- realised_site
# Whether a site has become in the net what the map promised: judged before traffic is made for it.

AT_M, NEAR_M = 40.0, 60.0
"""From the middle of a site to its road, and to its junction: sites that lie so close together are one."""
LEAST_ENTRIES = 2
RING_CLEAR_M = 15.0
LEAST_ARMS = 3
ALL_ROADS = frozenset((*ROADS, *LINKS))
FAST_ROADS = frozenset({"motorway", "trunk"})
RAMP_LINKS = frozenset({"motorway_link", "trunk_link"})


def middle_of(site: Site, net: SumoNet) -> Points:
    """The middle of the site in the net's coordinates, shape (2,)."""
    from pyproj import Proj

    if not net.projection:
        return np.zeros(2)
    x, y = Proj(net.projection)(site.longitude, site.latitude)
    return np.array([x + net.offset_m[0], y + net.offset_m[1]])


def why_not_realised(site: Site, net: SumoNet) -> str | None:
    """The reason why the net does not show the site's type near its middle; None where it does."""
    middle = middle_of(site, net)
    judges: dict[SiteType, Callable[[], bool]] = {
        "roundabout": lambda: any(_is_ring_at(net, middle, ring) for ring in net.roundabout_edges),
        "signalised_intersection": lambda: any(_is_lit(net, key) for key in _junctions_near(net, middle)),
        "intersection": lambda: bool(_junctions_near(net, middle)),
        "ramp": lambda: _ramp_near(net, middle),
        "highway": lambda: _passes(net, middle, AT_M, _one_of(net, FAST_ROADS)),
        "rural": lambda: _passes(net, middle, AT_M, _none_of(net, ALL_ROADS - RURAL_CLASSES)),
        "urban": lambda: _passes(net, middle, NEAR_M, _none_of(net, FAST_ROADS | frozenset(LINKS))),
    }
    if judges[site.kind]():
        return None
    return f"the {site.kind} at {site.latitude:.5f}, {site.longitude:.5f} is lost when the road network is built"


def road_classes(edge: NetEdge) -> frozenset[str]:
    """OSM's ``highway`` values of an edge; several where netconvert joined roads."""
    return frozenset(part.removeprefix("highway.") for part in edge.road_type.split("|"))


def _one_of(net: SumoNet, classes: frozenset[str]) -> Callable[[str], bool]:
    return lambda edge: bool(road_classes(net.edges[edge]) & classes)


def _none_of(net: SumoNet, classes: frozenset[str]) -> Callable[[str], bool]:
    """Roads of other classes, and those of a user's network that say nothing of theirs."""
    return lambda edge: bool(road_classes(net.edges[edge]) - classes)


def _passes(net: SumoNet, middle: Points, within_m: float, wanted: Callable[[str], bool]) -> bool:
    """Whether a road that is wanted comes so near to the middle."""
    lanes = (lane for lane in net.lanes.values() if not lane.internal and wanted(lane.edge_id))
    return any(float(np.linalg.norm(_dense(lane.shape) - middle, axis=1).min()) < within_m for lane in lanes)


def _is_ring_at(net: SumoNet, middle: Points, ring: tuple[str, ...]) -> bool:
    """Whether a ring is closed, has roads that lead into it, and surrounds the middle or passes near it."""
    inside = frozenset(ring) & frozenset(net.edges)
    onward = {turn.from_edge for turn in net.connections if turn.from_edge in inside and turn.to_edge in inside}
    entries = {
        turn.from_edge for turn in net.connections if turn.to_edge in inside and turn.from_edge not in inside
    } & {edge.edge_id for edge in net.edges.values() if not edge.internal}
    if onward != frozenset(ring) or len(entries) < LEAST_ENTRIES:
        return False
    line = np.vstack([net.lanes[net.edges[edge].lane_ids[0]].shape for edge in ring])
    center = (line.min(axis=0) + line.max(axis=0)) / 2
    reach = float(np.linalg.norm(line - center, axis=1).max()) + RING_CLEAR_M
    return float(np.linalg.norm(middle - center)) < reach


def _junctions_near(net: SumoNet, middle: Points) -> list[str]:
    """Junctions near the middle at which three roads or more meet, not only motorways; links left out."""
    roads = [edge for edge in net.edges.values() if not edge.internal and road_classes(edge) - frozenset(LINKS)]
    around: dict[str, list[NetEdge]] = {}
    near: dict[str, None] = {}
    for edge in roads:
        line = net.lanes[edge.lane_ids[0]].shape
        for junction, end in ((edge.from_junction, line[0]), (edge.to_junction, line[-1])):
            around.setdefault(junction, []).append(edge)
            if float(np.linalg.norm(end - middle)) < NEAR_M:
                near[junction] = None
    return [key for key in near if _is_crossing(key, around[key])]


def _is_crossing(junction: str, roads: list[NetEdge]) -> bool:
    arms = {
        (edge.from_junction if edge.to_junction == junction else edge.to_junction, edge.edge_id.lstrip("-"))
        for edge in roads
    }
    return len(arms) >= LEAST_ARMS and not all(road_classes(edge) <= FAST_ROADS for edge in roads)


def _is_lit(net: SumoNet, junction: str) -> bool:
    """Whether a junction has traffic lights."""
    return net.junction_types.get(junction, "").startswith("traffic_light")


def _ramp_near(net: SumoNet, middle: Points) -> bool:
    """Whether a link leaves or joins a motorway or trunk road near the middle."""
    for turn in net.connections:
        ends = [road_classes(net.edges[key]) for key in (turn.from_edge, turn.to_edge)]
        joins = any(one & FAST_ROADS and other & RAMP_LINKS for one, other in (ends, ends[::-1]))
        if joins and float(np.linalg.norm(net.lanes[turn.from_lane].shape[-1] - middle)) < NEAR_M:
            return True
    return False


def _dense(line: Points) -> Points:
    steps = np.linspace(0.0, 1.0, 9)[:, None, None]
    return ((1 - steps) * line[None, :-1] + steps * line[None, 1:]).reshape(-1, 2) if len(line) > 1 else line


# ---------- site_heart
# What a site is about, as areas that a car's way should pass: the ring, the junction, or link and main road.

HEARTS: dict[SiteType, str] = {
    "roundabout": "the ring",
    "signalised_intersection": "the junction",
    "intersection": "the junction",
    "urban": "the junction",
    "ramp": "the ramp",
}
"""What a site of a type is about, in words; those that are not named are about a whole road."""
REACH_M = 200.0
"""So far from a site's middle its parts reach: links and main roads go on beyond, to other ramps."""


class SiteHeart:
    """Tells how much of what its site is about a car's way passes."""

    def __init__(self, site: Site, net: SumoNet, network: RoadNetwork) -> None:
        middle = middle_of(site, net)
        self._name = HEARTS.get(site.kind, "")
        self._areas = [_area(network, belongs, middle) for belongs in _parts(site, net, middle)]

    @property
    def parts(self) -> int:
        """The most parts that a way can pass: two at a ramp, otherwise one."""
        return max(len(self._areas), 1)

    def parts_passed(self, car: Participant, last_step: int) -> int:
        """How many parts the car's centre is on by the step, none without the first; 1 where a road is the site."""
        from shapely import contains_xy

        if not self._areas:
            return 1
        x, y = car.motion.positions[: last_step + 1].T
        passed = [bool(contains_xy(area, x, y).any()) for area in self._areas]
        return sum(passed) if passed[0] else 0

    def missed(self, *, only_car: bool) -> str:
        """What the answer says of an ego that passes nothing of it; ``only_car``: no other could be chosen."""
        who = "the ego's way to its goal does not pass" if only_car else "no car's way to such a goal passes"
        return f"{who} {self._name} that the site is about; a goal farther ahead or another seed may change it"


def _parts(site: Site, net: SumoNet, middle: Points) -> list[Callable[[RoadLanelet], bool]]:
    """The parts of the heart, the foremost first: whether a lanelet belongs to each."""
    if site.kind == "roundabout":
        edges = {edge for ring in net.roundabout_edges if _is_ring_at(net, middle, ring) for edge in ring}
        return [lambda lanelet: lanelet.edge_id in edges]
    if site.kind in ("signalised_intersection", "intersection", "urban"):
        lit = site.kind == "signalised_intersection"
        junctions = {key for key in _junctions_near(net, middle) if _is_lit(net, key) or not lit}
        return [lambda lanelet: lanelet.internal and _junction(lanelet) in junctions] if junctions else []
    if site.kind == "ramp":
        return [_road(net, RAMP_LINKS), _road(net, FAST_ROADS)]
    return []


def _junction(lanelet: RoadLanelet) -> str:
    """The junction that an internal lanelet lies in: SUMO names its edges ``:junction_index``."""
    return lanelet.edge_id.removeprefix(":").rpartition("_")[0]


def _road(net: SumoNet, classes: frozenset[str]) -> Callable[[RoadLanelet], bool]:
    return lambda lanelet: not lanelet.internal and bool(road_classes(net.edges[lanelet.edge_id]) & classes)


def _area(network: RoadNetwork, belongs: Callable[[RoadLanelet], bool], middle: Points) -> "BaseGeometry":
    from shapely import Point, Polygon, make_valid, prepare, union_all

    parts = [make_valid(Polygon(one.polygon)) for one in network.lanelets.values() if belongs(one)]
    area = union_all(parts).intersection(Point(*middle).buffer(REACH_M))
    prepare(area)
    return area


# ---------- site_choice
# Choosing the site of a scenario: of the asked type, on the asked streets, within the asked box, by seed and index.

RADIUS_M: dict[SiteType, float] = {
    "highway": 450.0,
    "ramp": 350.0,
    "rural": 400.0,
    "urban": 220.0,
    "intersection": 200.0,
    "signalised_intersection": 230.0,
    "roundabout": 220.0,
}
"""How much is cut out around a site; vehicles on fast roads need longer approaches."""
ANY_ORDER: tuple[SiteType, ...] = (
    "roundabout",
    "signalised_intersection",
    "ramp",
    "highway",
    "intersection",
    "rural",
    "urban",
)
SAME_PLACE_M = 60.0
SHOWN_CLASSES = 3


def count_sites(request: GenerationRequest, report: ProgressReporter) -> SiteCount:
    """How many different sites of the map fit a request, at least one.

    Raises:
        NotPossible: none does; the types that the map holds there are named.
    """
    report(0.0, "looking for sites")
    return SiteCount(count=len(fitting_sites(read_map_file(Path(request.map_path)), request)))


def fitting_sites(osm: OsmMap, request: GenerationRequest) -> list[Site]:
    """All different sites for a request, in an order that the seed shuffles; of any type: the types take turns.

    Raises:
        NotPossible: the map, street or box holds no such site of the road classes asked for; the types that it does
            hold are named.
        InvalidRequest: a ramp without link roads.
    """
    finder = SiteFinder(osm, request.road_classes)
    wanted = ANY_ORDER if request.scenario_type == "any" else (request.scenario_type,)
    choice = random.Random(request.seed)  # noqa: S311 - reproducible, not secret
    kinds = [fitting for kind in wanted if (fitting := _fitting(finder.find(kind), request))]
    if not kinds and request.scenario_type == "any":
        kinds = [anywhere] if (anywhere := _fitting(_longest_road(finder), request)) else []
    if not kinds:
        raise _nothing_fits(osm, finder, request)
    for sites in kinds:
        choice.shuffle(sites)
    choice.shuffle(kinds)
    found: list[Site] = []
    for site in (site for turn in zip_longest(*kinds) for site in turn if site is not None):
        if all(_distance_m(site, other) > SAME_PLACE_M for other in found):
            found.append(site)
    return found


def _distance_m(one: Site, other: Site) -> float:
    return ground_distance_m((one.latitude, one.longitude), (other.latitude, other.longitude))


def held_types(finder: SiteFinder, request: GenerationRequest) -> list[SiteType]:
    """The types of which the map holds a site on the asked streets, in the asked box."""
    return [kind for kind in ANY_ORDER if _fitting(finder.find(kind), request)]


def _longest_road(finder: SiteFinder) -> list[Site]:
    longest = finder.longest_road()
    return [] if longest is None else [longest]


def _nothing_fits(osm: OsmMap, finder: SiteFinder, request: GenerationRequest) -> PlannerForgeError:
    """The reason in words: the map, its street or box, or the road classes that were to be left of it."""
    wanted = request.scenario_type
    if wanted == "ramp" and request.road_classes and not set(request.road_classes) & set(LINKS):
        return InvalidRequest(
            f"a ramp is made of link roads; road_classes {list(request.road_classes)} leaves them out",
            valid=["roads, link", "all"],
            next_step="add link to road_classes, or leave road_classes out",
        )
    held = held_types(finder, request)
    where = " on " + " / ".join(names[0] for names in request.streets) if request.streets else ""
    where += " in the box" if request.bbox is not None else ""
    wish = "site of any type" if wanted == "any" else f"{wanted} site"
    next_step = "choose one of these scenario types, or another place" if held else "choose another place"
    if request.road_classes and (wanted == "any" or _fitting(SiteFinder(osm).find(wanted), request)):
        where += f" that is made of {' or '.join(request.road_classes[:SHOWN_CLASSES])} only"
        next_step = "leave road_classes out" + (", or choose one of these scenario types" if held else "")
    return NotPossible(f"{request.place} ({request.map_id}) holds no {wish}{where}", valid=held, next_step=next_step)


def radius_for(site: Site, request: GenerationRequest) -> float:
    """Metres to cut out around a site: more for longer recordings, because vehicles can only leave after step 0."""
    return RADIUS_M[site.kind] * (1.0 + min(max(request.duration_s - 20.0, 0.0), 100.0) / 100.0)


def classes_for(site: Site, request: GenerationRequest) -> tuple[str, ...]:
    """OSM classes to keep around a site: as asked, otherwise all roads, with links where the site is about them."""
    return request.road_classes or (ROADS + LINKS if site.kind in ("ramp", "highway") else ROADS)


def _fitting(sites: list[Site], request: GenerationRequest) -> list[Site]:
    found = [site for site in sites if all(_carries(site, names) for names in request.streets)]
    if request.bbox is None:
        return found
    south, west, north, east = request.bbox
    return [site for site in found if south <= site.latitude <= north and west <= site.longitude <= east]


def _carries(site: Site, names: tuple[str, ...]) -> bool:
    """Whether one of the names is among the site's streets."""
    return bool({fold(name) for name in names} & {fold(name) for name in _single_names(site.streets)})


def _single_names(streets: tuple[str, ...]) -> list[str]:
    """Names as they are, and road numbers of a list (``A 4;E 40``) one by one."""
    return [part.strip() for street in streets for part in street.split(";")]
