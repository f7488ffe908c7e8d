"""Sites of a scenario: which of a map fit a request, whether a net shows one, and which areas a site is about.

A *site* is a spot of a map with a type (:class:`~plannerforge.engine.maps.Site`), found in the map's tags. netconvert
may lose what makes it one (a ring whose turns are too tight, signals that it makes none of); so a site is judged again
on the net, before traffic is made for it. Distances in m.
"""

import random
from collections.abc import Callable, Mapping, Set
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, Remedy, with_values
from ...schemas.generation import THROUGH, TURNS_AT, GenerationRequest, SiteCount, SiteType, Turn
from ...schemas.text import cited, cited_all
from ..execution import ProgressReporter
from ..geometry import Points
from ..maps import (
    ALL_ROADS,
    EXPRESSWAY_KMH,
    FAST_ROADS,
    LINKS,
    RAMP_LINKS,
    ROADS,
    RURAL_CLASSES,
    Gathering,
    OsmMap,
    Site,
    SiteFinder,
    SitePart,
    fold,
    ground_distance_m,
    place_parts,
    read_map_file,
    site_finder,
)
from ..network import NetEdge, RoadLanelet, RoadNetwork, SumoNet
from ..traffic import GeneratedVehicle

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

RADIUS_M: dict[SiteType, float] = {
    "highway": 450.0,
    "ramp": 350.0,
    "rural": 400.0,
    "urban": 220.0,
    "intersection": 200.0,
    "signalised_intersection": 230.0,
    "roundabout": 220.0,
}
"""How much is cut out around a site (chosen); vehicles on fast roads need longer approaches."""
ANY_ORDER: tuple[SiteType, ...] = (
    "roundabout",
    "signalised_intersection",
    "ramp",
    "highway",
    "intersection",
    "rural",
    "urban",
)
"""All types, the rarer first."""
SAME_PLACE_M = 60.0
"""Sites of different types that lie closer together are one, as sites of one type are (``maps.site_search``)."""
SHOWN_NAMES = 3
"""Road classes, and streets of a ramp, that a refusal names, at most."""
NEARBY_DEG = 0.0005
"""Half the side of the box in which a refusal names another site: 56 m, as sites of a type lie 60 m apart."""
_WITHOUT_LINK: Mapping[Turn, tuple[str, str]] = MappingProxyType(
    {"merge": ("an exit", "joins"), "exit": ("an entry", "leaves")}
)
"""What a ramp is at which a turn is not possible, and what no link does there."""


def count_sites(request: GenerationRequest, report: ProgressReporter) -> SiteCount:
    """How many different sites of the map fit a request, at least one.

    Raises:
        NotPossible: none does; the types that the map holds there are named.
    """
    report(0.0, "looking for sites")
    return SiteCount(count=len(fitting_sites(read_map_file(Path(request.map_path)), request)))


def fitting_sites(osm: OsmMap, request: GenerationRequest) -> list[Site]:
    """All different sites for a request, in an order that the seed shuffles; of any type: the types take turns.

    If streets are asked for, sites on them come first, each narrowed to its parts on them. Ramps with a link that leads
    where the ego or another road user is to go come before others.

    Raises:
        NotPossible: the map, street or box holds no such site of the road classes asked for; the types that it does
            hold are named.
        InvalidRequest: a ramp without link roads.
    """
    finder = site_finder(osm, request.road_classes)
    turn = request.goal.turn
    any_type = tuple(kind for kind in ANY_ORDER if turn is None or turn in TURNS_AT[kind])
    wanted = any_type if request.scenario_type == "any" else (request.scenario_type,)
    choice = random.Random(request.seed)  # noqa: S311 - reproducible, not secret
    kinds = [fitting for kind in wanted if (fitting := _fitting(finder, finder.find(kind), request))]
    if not kinds and len(request.streets) > 1:
        kinds = [fitting for kind in wanted if (fitting := _fitting(finder, finder.find_by_links(kind), request))]
    if not kinds and request.scenario_type == "any" and (longest := finder.longest_road()) is not None:
        kinds = [fitting] if (fitting := _fitting(finder, [longest], request)) else []
    if not kinds:
        raise _nothing_fits(osm, finder, request)
    for sites in kinds:
        choice.shuffle(sites)
    choice.shuffle(kinds)
    different: list[Site] = []
    taken = Gathering(SAME_PLACE_M)
    in_turn = [site for sites in zip_longest(*kinds) for site in sites if site is not None]
    at_ramp = _asked_at_ramp(request)
    for site in sorted(in_turn, key=lambda site: (site.only_passed, at_ramp is not None and at_ramp not in site.turns)):
        if taken.near(site.position) is None:
            taken.add(site.position)
            different.append(site)
    return different


def _asked_at_ramp(request: GenerationRequest) -> Turn | None:
    """What a link at a ramp has to make possible for the ego or another road user; None if nothing is asked of it."""
    if request.goal.turn in _WITHOUT_LINK:
        return request.goal.turn
    return "merge" if request.others is not None and request.others.name == "merging" else None


def lacking_turn(osm: OsmMap, request: GenerationRequest) -> NotPossible | None:
    """Return the refusal of a merge at ramps that are all exits, or the other way round; None if that is not so."""
    turn = _asked_at_ramp(request)
    if turn is None:
        return None
    ramps = site_finder(osm, request.road_classes).find("ramp")
    here = [site for site in ramps if _passes_by(site, request) and _is_in_box(site, request)]
    offered = {offer for site in here for offer in site.turns}
    if turn in offered or not offered:
        return None
    kind, link = _WITHOUT_LINK[turn]
    first = f"{cited_all(here[0].streets[:SHOWN_NAMES], ' / ')} ({here[0].latitude:.5f}, {here[0].longitude:.5f})"
    which = "the ramp" if len(here) == 1 else f"each of the {len(here)} ramps here, such as the one"
    calls: dict[str, Remedy] = {}
    if turn == request.goal.turn:
        calls |= {f"goal={THROUGH}:{offer}": with_values(goal=f"{THROUGH}:{offer}") for offer in sorted(offered)}
    if (other := next((site for site in ramps if turn in site.turns), None)) is not None:
        box = _box_around(other)
        calls[f"place={request.map_id} and bbox={box}"] = with_values(place=request.map_id, bbox=box)
    return NotPossible(
        f"{which} at {first} is {kind} only: no link {link} the main road there",
        valid=list(calls),
        next_step="choose one of these" if calls else "choose another place, or leave the manoeuvre out",
        reason="no_such_turn",
        remedies=list(calls.values()),
    )


def _box_around(site: Site) -> list[float]:
    """A box (south, west, north, east) in degrees in which a site lies."""
    return [round(middle + aside, 4) for aside in (-NEARBY_DEG, NEARBY_DEG) for middle in site.position]


def other_types(osm: OsmMap, request: GenerationRequest) -> list[SiteType]:
    """The types besides the asked one of which the map holds a site on the asked streets, in the asked box."""
    held = _held_types(site_finder(osm, request.road_classes), request)
    return [kind for kind in held if kind != request.scenario_type]


def _held_types(finder: SiteFinder, request: GenerationRequest) -> list[SiteType]:
    held = [kind for kind in ANY_ORDER if _fitting(finder, finder.find(kind), request)]
    if held or len(request.streets) < 2:
        return held
    return [kind for kind in ANY_ORDER if _fitting(finder, finder.find_by_links(kind), request)]


def _nothing_fits(osm: OsmMap, finder: SiteFinder, request: GenerationRequest) -> PlannerForgeError:
    """The reason in words: the map, its street or box, or the road classes that were to be left of it."""
    wanted = request.scenario_type
    if wanted == "ramp" and request.road_classes and not set(request.road_classes) & set(LINKS):
        return InvalidRequest(
            f"a ramp is made of link roads; road_classes {list(request.road_classes)} leaves them out",
            valid=["roads, link", "all"],
            next_step="add link to road_classes, or leave road_classes out",
            remedies=[with_values(road_classes=None)],
        )
    held = _held_types(finder, request)
    where = " on " + cited_all((names[0] for names in request.streets), " / ") if request.streets else ""
    if request.bbox is not None:
        south, west, north, east = request.bbox
        where += f" in the part that was asked for ({south:.4f} to {north:.4f}° N, {west:.4f} to {east:.4f}° E)"
    wish = "site of any type" if wanted == "any" else f"{wanted} site"
    elsewhere = f"place={request.map_id} to look in the whole map" if request.bbox is not None else "another place"
    if wanted == "highway" and not request.road_classes:
        where += (
            "; a highway is a motorway or, on a map without one, a trunk road that is signed as a motor road or is "
            f"one-way with a limit of {EXPRESSWAY_KMH} km/h or more"
        )
    next_step = f"choose one of these scenario types, or {elsewhere}" if held else f"choose {elsewhere}"
    if not held and len(request.streets) > 1 and not _meet(osm, request.streets):
        return _never_meet(finder, request)
    everywhere = site_finder(osm)
    if request.road_classes and (wanted == "any" or _fitting(everywhere, everywhere.find(wanted), request)):
        where += f" that is made of {' or '.join(request.road_classes[:SHOWN_NAMES])} only"
        next_step = "leave road_classes out" + (", or choose one of these scenario types" if held else "")
    remedies = [with_values(scenario_type=kind) for kind in held[:1]]
    if (outside := _nearest_outside(finder, request)) is not None:
        streets = cited_all(outside.streets[:SHOWN_NAMES], " / ") or "unnamed roads"
        at = f"{outside.latitude:.5f}, {outside.longitude:.5f}"
        where += f"; the nearest {wanted} of the map lies outside it, at {streets} ({at})"
        remedies.insert(0, with_values(place=request.map_id, bbox=_box_around(outside)))
    return NotPossible(
        f"{cited(request.place)} ({request.map_id}) holds no {wish}{where}",
        valid=held,
        next_step=next_step,
        reason="no_such_site",
        remedies=remedies,
    )


def _meet(osm: OsmMap, streets: tuple[tuple[str, ...], ...]) -> bool:
    """Whether roads of all these names share a node of the map."""
    nodes: list[set[int]] = [set() for _ in streets]
    for way in osm.ways:
        if not way.road_class:
            continue
        called = tuple(way.tags[key] for key in ("name", "ref") if key in way.tags)
        for held, names in zip(nodes, streets, strict=True):
            if _carries(called, names):
                held.update(way.node_ids)
    return bool(set.intersection(*nodes))


def _never_meet(finder: SiteFinder, request: GenerationRequest) -> NotPossible:
    """The refusal of streets that do not meet, with those of them that hold the asked type alone."""
    named = cited_all((names[0] for names in request.streets), " / ")
    kinds: tuple[SiteType, ...] = ANY_ORDER if request.scenario_type == "any" else (request.scenario_type,)
    alone = []
    for names in request.streets:
        wish = request.model_copy(update={"streets": (names,)})
        is_plain = len(place_parts(names[0])) == 1
        if is_plain and any(_fitting(finder, finder.find(kind), wish) for kind in kinds):
            alone.append(f"{names[0]}, {request.place}")
    return NotPossible(
        f"{named} do not meet on the map {cited(request.place)} ({request.map_id})",
        valid=map(cited, alone),
        next_step="choose one of the streets alone, or another crossing" if alone else "choose another place",
        reason="no_such_site",
        remedies=[with_values(place=place) for place in alone],
    )


def _nearest_outside(finder: SiteFinder, request: GenerationRequest) -> Site | None:
    """The site of the asked type on the asked streets that lies nearest to the middle of the asked box, if any."""
    if request.bbox is None or request.scenario_type == "any":
        return None
    south, west, north, east = request.bbox
    middle = (south + north) / 2, (west + east) / 2
    anywhere = request.model_copy(update={"bbox": None})
    sites = _fitting(finder, finder.find(request.scenario_type), anywhere)
    return min(sites, key=lambda site: ground_distance_m(middle, site.position), default=None)


def _fitting(finder: SiteFinder, sites: list[Site], request: GenerationRequest) -> list[Site]:
    """The sites that carry all the streets of a request and lie in its box, the nearest to the box's middle first."""
    if request.streets:
        sites = [
            finder.narrowed(site, partial(_lies_on, request.streets)) for site in sites if _passes_by(site, request)
        ]
        sites = [_requested_first(site, request) for site in _ramps_of(finder, sites, request) or sites]
    if request.bbox is None:
        return sites
    south, west, north, east = request.bbox
    middle = (south + north) / 2, (west + east) / 2
    inside = (site for site in sites if _is_in_box(site, request))
    return sorted(inside, key=lambda site: ground_distance_m(middle, site.position))


def _requested_first(site: Site, request: GenerationRequest) -> Site:
    """Return the site with the requested streets ahead of the others that it is called after."""
    requested = [name for name in site.streets if any(_carries((name,), names) for names in request.streets)]
    return replace(site, streets=tuple(dict.fromkeys((*requested, *site.streets))))


def _ramps_of(finder: SiteFinder, sites: list[Site], request: GenerationRequest) -> list[Site]:
    """Return the ramps whose main road is one of the requested streets, without their other parts.

    A ramp is also called after the roads that its links lead to, which may be a kilometre away.
    """

    def is_of_street(part: SitePart) -> bool:
        main = finder.main_streets(part)
        return any(_carries(main, names) for names in request.streets)

    ramps = (site for site in sites if site.kind == "ramp" and any(map(is_of_street, site.parts)))
    return [finder.narrowed(site, is_of_street) for site in ramps]


def _is_in_box(site: Site, request: GenerationRequest) -> bool:
    if request.bbox is None:
        return True
    south, west, north, east = request.bbox
    return south <= site.latitude <= north and west <= site.longitude <= east


def _passes_by(site: Site, request: GenerationRequest) -> bool:
    return all(_carries(site.streets, names) for names in request.streets)


def _lies_on(streets: tuple[tuple[str, ...], ...], part: SitePart) -> bool:
    return all(_carries(part.streets, names) for names in streets)


def _carries(streets: tuple[str, ...], names: tuple[str, ...]) -> bool:
    """Whether one of the names is among the streets; road numbers of a list (``A 4;E 40``) count one by one."""
    single = [part.strip() for street in streets for part in street.split(";")]
    return bool({fold(name) for name in names} & {fold(name) for name in single})


def radius_for(site: Site, request: GenerationRequest) -> float:
    """Metres to cut out around a site: up to twice ``RADIUS_M`` for recordings of 20 s to 120 s.

    Vehicles can only leave after step 0, so that a longer recording needs more of them around the site.
    """
    return RADIUS_M[site.kind] * (1.0 + min(max(request.duration_s - 20.0, 0.0), 100.0) / 100.0)


def classes_for(site: Site, request: GenerationRequest) -> tuple[str, ...]:
    """OSM classes to keep around a site: as asked, otherwise all roads, with links where the site is about them."""
    return request.road_classes or (ROADS + LINKS if site.kind in ("ramp", "highway") or site.by_links else ROADS)


AT_M, JUNCTION_M = 40.0, 60.0
"""From the middle of a site to its road, and to its junction; at the latter distance two sites are one (chosen)."""
LEAST_ENTRIES = 2
"""Roads that lead into a roundabout (chosen)."""
RING_CLEAR_M = 15.0
"""How far outside its ring the middle of a site may lie (chosen)."""
LEAST_ARMS = 3
"""Roads that meet at a junction; two are one road."""


def why_not_realised(site: Site, net: SumoNet) -> str | None:
    """The reason why the net does not show the site's type near its middle; None where it does."""
    middle = middle_of(site, net)
    judges: dict[SiteType, Callable[[], bool]] = {
        "roundabout": lambda: bool(_ring_edges_at(net, middle)),
        "signalised_intersection": lambda: any(
            _is_lit(net, key) for key in _junctions_near(net, middle, site.by_links)
        ),
        "intersection": lambda: bool(_junctions_near(net, middle, site.by_links)),
        "ramp": lambda: _ramp_near(net, middle),
        "highway": lambda: _passes(net, middle, AT_M, lambda classes: bool(classes & FAST_ROADS)),
        "rural": lambda: _passes(net, middle, AT_M, lambda classes: bool(classes - (ALL_ROADS - RURAL_CLASSES))),
        "urban": lambda: _passes(
            net, middle, JUNCTION_M, lambda classes: bool(classes - FAST_ROADS - frozenset(LINKS))
        ),
    }
    if judges[site.kind]():
        return None
    return f"the {site.kind} at {site.latitude:.5f}, {site.longitude:.5f} is lost when the road network is built"


def middle_of(site: Site, net: SumoNet) -> Points:
    """The middle of the site in the net's coordinates, shape (2,)."""
    return _place_of(site.position, net)


def _place_of(position: tuple[float, float], net: SumoNet) -> Points:
    """A latitude and longitude in the net's coordinates, shape (2,)."""
    from pyproj import Proj

    if not net.projection:
        return np.zeros(2)
    x, y = Proj(net.projection)(position[1], position[0])
    return np.array([x + net.offset_m[0], y + net.offset_m[1]])


def road_classes(edge: NetEdge) -> frozenset[str]:
    """OSM's ``highway`` values of an edge: several where netconvert joined roads, "" where a user's net states none."""
    parts = edge.road_type.split("|")
    return frozenset(part.removeprefix("highway.") for part in parts if not part.startswith("service."))


def _passes(net: SumoNet, middle: Points, within_m: float, wanted: Callable[[frozenset[str]], bool]) -> bool:
    """Whether a road of wanted classes comes nearer to the middle than a distance; 8 points on each segment count."""
    roads = {edge.edge_id for edge in net.edges.values() if not edge.internal and wanted(road_classes(edge))}
    lanes = (lane for lane in net.lanes.values() if lane.edge_id in roads)
    return any(float(np.linalg.norm(_dense(lane.shape) - middle, axis=1).min()) < within_m for lane in lanes)


def _dense(line: Points) -> Points:
    steps = np.linspace(0.0, 1.0, 9)[:, None, None]
    return ((1 - steps) * line[None, :-1] + steps * line[None, 1:]).reshape(-1, 2) if len(line) > 1 else line


def _ring_edges_at(net: SumoNet, middle: Points) -> frozenset[str]:
    """The edges of all roundabouts of the net that are closed, entered by roads, and at the middle."""
    before: dict[str, set[str]] = {}
    for turn in net.connections:
        before.setdefault(turn.to_edge, set()).add(turn.from_edge)
    return frozenset(edge for ring in net.roundabout_edges if _is_ring_at(net, middle, ring, before) for edge in ring)


def _is_ring_at(net: SumoNet, middle: Points, ring: tuple[str, ...], before: Mapping[str, Set[str]]) -> bool:
    """Whether a ring is closed, has roads that lead into it, and surrounds the middle or passes near it.

    ``before``: by edge, those that lead into it.
    """
    inside = frozenset(ring)
    leading = {edge for follower in inside for edge in before.get(follower, ())}
    entries = {edge for edge in leading - inside if edge in net.edges and not net.edges[edge].internal}
    if not inside <= leading & frozenset(net.edges) or len(entries) < LEAST_ENTRIES:
        return False
    line = np.vstack([net.lanes[net.edges[edge].lane_ids[0]].shape for edge in ring])
    center = (line.min(axis=0) + line.max(axis=0)) / 2
    reach = float(np.linalg.norm(line - center, axis=1).max()) + RING_CLEAR_M
    return float(np.linalg.norm(middle - center)) < reach


def _junctions_near(net: SumoNet, middle: Points, with_links: bool = False) -> list[str]:
    """Junctions near the middle at which three roads or more meet, not only motorways; links are left out, or count."""
    open_to_many = net.drivable_edges("passenger") | net.drivable_edges("delivery")
    roads = [net.edges[key] for key in net.edges if key in open_to_many]
    roads = [edge for edge in roads if with_links or road_classes(edge) - frozenset(LINKS)]
    around: dict[str, list[NetEdge]] = {}
    near: dict[str, None] = {}
    for edge in roads:
        line = net.lanes[edge.lane_ids[0]].shape
        for junction, end in ((edge.from_junction, line[0]), (edge.to_junction, line[-1])):
            around.setdefault(junction, []).append(edge)
            if float(np.linalg.norm(end - middle)) < JUNCTION_M:
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
        before, after = (road_classes(net.edges[key]) for key in (turn.from_edge, turn.to_edge))
        joins = (before & FAST_ROADS and after & RAMP_LINKS) or (after & FAST_ROADS and before & RAMP_LINKS)
        if joins and float(np.linalg.norm(net.lanes[turn.from_lane].shape[-1] - middle)) < JUNCTION_M:
            return True
    return False


FOCUS_NAMES: dict[SiteType, str] = {
    "roundabout": "the ring",
    "signalised_intersection": "the junction",
    "intersection": "the junction",
    "urban": "the junction",
    "ramp": "the ramp",
}
"""What a site of a type is about, in words; sites of the other types are about a whole road."""
REACH_M = 200.0
"""How far from a site's middle its areas reach (chosen): links and main roads go on beyond, to other ramps."""


class SiteFocus:
    """The areas of a site that its ego's path should pass: the ring, the junction, or link and main road.

    ``ring``: the edges of a roundabout; ``junctions``: those that are near the middle of a site at junctions, and
    ``spot_junctions``: those among them that the site was made of.
    """

    def __init__(self, site: Site, net: SumoNet, network: RoadNetwork) -> None:
        middle = middle_of(site, net)
        self.kind, self.net = site.kind, net
        self._name = FOCUS_NAMES.get(site.kind, "")
        self._areas = [_area(network, belongs, middle) for belongs in _parts(site, net, middle)]
        self.ring = _ring_edges_at(net, middle) if site.kind == "roundabout" else frozenset[str]()
        self.junctions = _junctions_of(site, net, middle)
        self.spot_junctions, self._spot = _spot(site, self.junctions, net, network, middle)

    @property
    def parts(self) -> int:
        """The most areas that a path can pass: two at a ramp, otherwise one."""
        return max(len(self._areas), 1)

    def parts_passed(self, car: GeneratedVehicle, last_step: int) -> int:
        """How many areas the car's centre is on by the step, none without the first; 1 where a road is the site."""
        from shapely import contains_xy

        if not self._areas:
            return 1
        x, y = car.motion.positions[: last_step + 1].T
        passed = [bool(contains_xy(area, x, y).any()) for area in self._areas]
        return sum(passed) if passed[0] else 0

    def is_on_spot(self, car: GeneratedVehicle, last_step: int) -> bool:
        """Whether the car's centre comes by the step to a junction that the site was made of; True at other sites."""
        from shapely import contains_xy

        if self._spot is None:
            return True
        x, y = car.motion.positions[: last_step + 1].T
        return bool(contains_xy(self._spot, x, y).any())

    def inside(self, car: GeneratedVehicle) -> NDArray[np.bool_]:
        """At which steps the car's centre is on any of the areas; nowhere where a road is the site."""
        from shapely import contains_xy

        x, y = car.motion.positions.T
        within = np.zeros(len(x), dtype=np.bool_)
        for area in self._areas:
            within |= contains_xy(area, x, y)
        return within

    def is_left_by(self, car: GeneratedVehicle, step: int) -> bool:
        """Whether the car's centre is on none of the areas at a step; so it is everywhere where a road is the site."""
        from shapely import contains_xy

        x, y = car.motion.positions[step]
        return not any(bool(contains_xy(area, x, y)) for area in self._areas)

    def missed(self, *, only_car: bool) -> str:
        """The note on an ego that passes none of the areas; ``only_car``: no other could be chosen."""
        who = "the ego's way to its goal does not pass" if only_car else "no car's way to such a goal passes"
        return f"{who} {self._name} that the site is about; a goal farther ahead or another seed may change it"

    def passed_close_by(self, *, only_car: bool) -> str:
        """The note on an ego that passes another junction close by; ``only_car``: no other could be chosen."""
        who = "the ego's way to its goal" if only_car else "the way of every car that has such a goal"
        return f"{who} passes a junction close by, not the one that the site is about; another seed may change it"


def _parts(site: Site, net: SumoNet, middle: Points) -> list[Callable[[RoadLanelet], bool]]:
    """For each area, the most important first, whether a lanelet belongs to it."""
    if site.kind == "roundabout":
        edges = _ring_edges_at(net, middle)
        return [lambda lanelet: lanelet.edge_id in edges]
    if site.kind in ("signalised_intersection", "intersection", "urban"):
        junctions = _junctions_of(site, net, middle)
        return [lambda lanelet: lanelet.internal and _junction(lanelet) in junctions] if junctions else []
    if site.kind == "ramp":
        return [_road(net, RAMP_LINKS), _road(net, FAST_ROADS)]
    return []


def _junctions_of(site: Site, net: SumoNet, middle: Points) -> frozenset[str]:
    if site.kind not in ("signalised_intersection", "intersection", "urban"):
        return frozenset()
    lit = site.kind == "signalised_intersection"
    return frozenset(key for key in _junctions_near(net, middle, site.by_links) if _is_lit(net, key) or not lit)


def _spot(
    site: Site, junctions: frozenset[str], net: SumoNet, network: RoadNetwork, middle: Points
) -> "tuple[frozenset[str], BaseGeometry | None]":
    """The junctions that a site was made of, and the area around its nodes with them; None if no others are near."""
    from shapely import Point, union_all

    near = sorted(junctions) if len(junctions) > 1 else []
    areas = {key: _area(network, partial(_is_in, key), middle) for key in near}
    areas = {key: area for key, area in areas.items() if not area.is_empty}
    places = [_place_of(part.position, net) for part in site.parts] or [middle]
    spot = {min(areas, key=lambda key: areas[key].distance(Point(*place))) for place in places} if areas else set()
    if len(spot) == len(areas):
        return junctions, None
    around = [Point(*place).buffer(AT_M) for place in places]  # the other carriageway of a wide street
    return frozenset(spot), union_all([*around, *(areas[key] for key in sorted(spot))])


def _is_in(junction: str, lanelet: RoadLanelet) -> bool:
    return lanelet.internal and _junction(lanelet) == junction


def _junction(lanelet: RoadLanelet) -> str:
    """The junction that an internal lanelet lies in: SUMO names its edges ``:junction_index``."""
    return lanelet.edge_id.removeprefix(":").rpartition("_")[0]


def _road(net: SumoNet, classes: frozenset[str]) -> Callable[[RoadLanelet], bool]:
    return lambda lanelet: not lanelet.internal and bool(road_classes(net.edges[lanelet.edge_id]) & classes)


def _area(network: RoadNetwork, belongs: Callable[[RoadLanelet], bool], middle: Points) -> "BaseGeometry":
    from shapely import Point, Polygon, make_valid, prepare, union_all

    polygons = [make_valid(Polygon(lanelet.polygon)) for lanelet in network.lanelets.values() if belongs(lanelet)]
    area = union_all(polygons).intersection(Point(*middle).buffer(REACH_M))
    prepare(area)
    return area
