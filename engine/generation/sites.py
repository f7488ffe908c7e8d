"""Selects the sites of a map that fit a request, checks them on the net, and defines a site's areas.

A *site* is a place on a map with a type (:class:`~plannerforge.engine.maps.Site`), found in the map's tags. netconvert
may lose its defining feature, such as a ring with tight turns or signals. A site is therefore checked again on the net,
before its traffic is generated. Distances in m.
"""

import random
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from dataclasses import replace
from functools import partial
from itertools import chain, combinations, zip_longest
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, Remedy, with_values
from ...schemas.generation import (
    THROUGH,
    TURNS_AT,
    USUAL_GOAL,
    GenerationRequest,
    RequestedGoal,
    SiteCount,
    SiteType,
    Turn,
)
from ...schemas.text import cited, cited_all
from ..execution import ProgressReporter
from ..geometry import Points, length_m
from ..maps import (
    ALL_ROADS,
    ARMS_OF_A_CROSSING,
    EXPRESSWAY_KMH,
    FAST_ROADS,
    LINKS,
    LONGEST_RING_M,
    MARKED_BY_NODES,
    RAMP_LINKS,
    ROADS,
    RURAL_CLASSES,
    Gathering,
    OsmMap,
    OsmWay,
    Site,
    SiteFinder,
    SitePart,
    fold,
    ground_distance_m,
    place_parts,
    read_map_file,
    site_finder,
)
from ..network import Digraph, NetEdge, RoadLanelet, RoadNetwork, SumoNet
from ..traffic import GeneratedVehicle
from .site_ways import SiteWays

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
"""Cut radius around a site (chosen); vehicles on fast roads need longer approaches."""
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
"""Sites of different types closer than this are one, like sites of one type (``maps.site_search``)."""
MOST_CROSSINGS = 20
"""Maximum number of crossings that are examined for a suggestion (chosen)."""
SHOWN_NAMES = 3
"""Maximum number of road classes, or of a ramp's streets, that a refusal lists."""
NEARBY_DEG = 0.0005
"""Half the side of the box around another site in a refusal: 56 m, because sites of a type are at least 60 m apart."""
_WITHOUT_LINK: Mapping[Turn, tuple[str, str]] = MappingProxyType(
    {"merge": ("an exit", "joins"), "exit": ("an entry", "leaves")}
)
"""The kind of ramp at which a turn is impossible, and the movement that no link there provides."""


def count_sites(request: GenerationRequest, report: ProgressReporter) -> SiteCount:
    """Return the number of different sites of the map that fit a request, at least 1.

    Raises:
        NotPossible: no site fits; the error lists the types that the map has in the requested area.
    """
    report(0.0, "looking for sites")
    osm = read_map_file(Path(request.map_path))
    return SiteCount(count=len(fitting_sites(osm, with_streets_that_meet(osm, request)[0])))


def with_streets_that_meet(osm: OsmMap, request: GenerationRequest) -> tuple[GenerationRequest, list[str]]:
    """Return the request with streets that meet on the map, and a note if one of them has a longer name than requested.

    The requested names come first. If their streets meet nowhere on the map, streets with longer names replace as few
    of them as possible.
    """
    longer = request.longer_streets
    if not longer or streets_meet(osm, request):
        return request, []
    at = _nodes_by_name(osm)
    numbers = range(len(request.streets))
    for changed in (some for count in numbers for some in combinations(numbers, count + 1)):
        choices = [longer[one] if one in changed else request.streets[one] for one in numbers]
        nodes = [{name: set[int]().union(*(at[key] for key in _keys_of(name))) for name in names} for names in choices]
        meeting = set.intersection(*(set[int]().union(*each.values()) for each in nodes))
        if meeting:
            streets = tuple(tuple(name for name, held in each.items() if held & meeting) for each in nodes)
            return request.model_copy(update={"streets": streets}), [_taken_note(request.streets, streets, changed)]
    return request, []


def _taken_note(
    requested: tuple[tuple[str, ...], ...], streets: tuple[tuple[str, ...], ...], changed: tuple[int, ...]
) -> str:
    """Return the note on streets that were taken instead of the requested ones."""
    apart = cited_all((names[0] for names in requested), " / ")
    taken = (
        f"{cited(requested[one][0])} is read as {cited_all(streets[one][:SHOWN_NAMES], ' or ')}" for one in changed
    )
    return f"{apart} do not meet on this map, so {' and '.join(taken)}"


def streets_meet(osm: OsmMap, request: GenerationRequest) -> bool:
    """Return whether the requested streets meet anywhere on the map: at a node, across a short road or at a ring."""
    if _meet(osm, request.streets):
        return True
    anywhere = request.model_copy(update={"bbox": None, "road_classes": (), "goal": RequestedGoal.of(USUAL_GOAL)})
    return _has_meeting(_fitting_of(site_finder(osm), ANY_ORDER, anywhere), anywhere)


def fitting_sites(osm: OsmMap, request: GenerationRequest) -> list[Site]:
    """Return all different sites for a request, shuffled by the seed; if any type is allowed, the types take turns.

    If the request has streets, sites on them come first, each narrowed to its parts on them. If several requested
    streets share a node, sites that do not have it come later: rings that the streets only reach at different arms, and
    after them ramps, whose links may lead to a street that is far away. Sites on the names that a request lists first
    come before those on its other names, and ramps with a link in the required direction before other ramps.

    Raises:
        NotPossible: the map, street or box has no such site of the requested road classes; the error lists the types
            that it has.
        InvalidRequest: a ramp is requested, but link roads are excluded.
    """
    finder = site_finder(osm, request.road_classes)
    turn = request.goal.turn
    any_type = tuple(kind for kind in ANY_ORDER if turn is None or turn in TURNS_AT[kind])
    wanted = any_type if request.scenario_type == "any" else (request.scenario_type,)
    choice = random.Random(request.seed)  # noqa: S311 - reproducible, not secret
    kinds = list(_fitting_of(finder, wanted, request).values())
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
    at_ramp = _required_ramp_turn(request)
    shared = _shared_nodes(osm, request.streets) if len(request.streets) > 1 else set[int]()
    ways = {way.way_id: way for way in osm.ways} if shared else {}
    for site in sorted(
        in_turn,
        key=lambda site: (
            site.only_passed,
            len(request.streets) > 1 and site.kind == "ramp",
            bool(shared) and shared.isdisjoint(_nodes_of(site, ways)),
            _later_names(site, request.streets),
            at_ramp is not None and at_ramp not in site.turns,
            _is_in_corner(site, request),
        ),
    ):
        if taken.near(site.position) is None:
            taken.add(site.position)
            different.append(site)
    return different


def _later_names(site: Site, streets: tuple[tuple[str, ...], ...]) -> int:
    """Return how many names of the requested streets come before the names that a site has of them."""
    return sum(next((at for at, name in enumerate(names) if _carries(site.streets, (name,))), 0) for names in streets)


def _nodes_of(site: Site, ways: Mapping[int, OsmWay]) -> set[int]:
    """Return the nodes that mark a site, or those of the ways that mark it."""
    marks = {part.mark for part in site.parts}
    return marks if site.kind in MARKED_BY_NODES else {key for mark in marks for key in ways[mark].node_ids}


def _required_ramp_turn(request: GenerationRequest) -> Turn | None:
    """Return the turn that a link at a ramp must provide for the ego or another road user, or None for any turn."""
    if request.goal.turn in _WITHOUT_LINK:
        return request.goal.turn
    return "merge" if request.others is not None and request.others.name == "merging" else None


def lacking_turn(osm: OsmMap, request: GenerationRequest) -> NotPossible | None:
    """Return the refusal if no ramp in the request's area offers the required merge or exit; None if one does."""
    turn = _required_ramp_turn(request)
    if turn is None:
        return None
    ramps = site_finder(osm, request.road_classes).find("ramp")
    here = [site for site in ramps if _passes_by(site, request) and _is_in_box(site, request)]
    offered = {offer for site in here for offer in site.turns}
    if turn in offered or not offered:
        return None
    kind, link = _WITHOUT_LINK[turn]
    first = f"{cited_all(here[0].streets[:SHOWN_NAMES], ' / ')} ({here[0].latitude:.5f}, {here[0].longitude:.5f})"
    which = "the ramp" if len(here) == 1 else f"each of the {len(here)} ramps here, for example the one"
    calls: dict[str, Remedy] = {}
    if turn == request.goal.turn:
        calls |= {f"goal={THROUGH}:{offer}": with_values(goal=f"{THROUGH}:{offer}") for offer in sorted(offered)}
    if (other := next((site for site in ramps if turn in site.turns), None)) is not None:
        box = _box_around(other)
        calls[f"place={request.map_id} and bbox={box}"] = with_values(place=request.map_id, bbox=box)
    return NotPossible(
        f"{which} at {first} is only {kind}: no link {link} the main road there",
        valid=list(calls),
        next_step="choose one of these" if calls else "choose another place, or leave the manoeuvre out",
        reason="no_such_turn",
        remedies=list(calls.values()),
    )


def _box_around(site: Site) -> list[float]:
    """Return a box (south, west, north, east) in degrees around a site."""
    return [round(middle + aside, 4) for aside in (-NEARBY_DEG, NEARBY_DEG) for middle in site.position]


def other_types(osm: OsmMap, request: GenerationRequest) -> list[SiteType]:
    """Return the other types that have a site on the requested streets and in the requested box."""
    available = _available_types(site_finder(osm, request.road_classes), request)
    return [kind for kind in available if kind != request.scenario_type]


def _available_types(finder: SiteFinder, request: GenerationRequest) -> list[SiteType]:
    return list(_fitting_of(finder, ANY_ORDER, request))


def _nothing_fits(osm: OsmMap, finder: SiteFinder, request: GenerationRequest) -> PlannerForgeError:
    """Return the refusal with its cause: the map, the requested street or box, or the requested road classes."""
    wanted = request.scenario_type
    if wanted == "ramp" and request.road_classes and not set(request.road_classes) & set(LINKS):
        return InvalidRequest(
            f"a ramp is made of link roads; road_classes {list(request.road_classes)} leaves them out",
            valid=["roads, link", "all"],
            next_step="add link to road_classes, or leave road_classes out",
            remedies=[with_values(road_classes=None)],
        )
    available = _available_types(finder, request)
    where = " on " + cited_all((names[0] for names in request.streets), " / ") if request.streets else ""
    if request.bbox is not None:
        south, west, north, east = request.bbox
        where += f" in the requested part ({south:.4f} to {north:.4f}° N, {west:.4f} to {east:.4f}° E)"
    wanted_site = "site of any type" if wanted == "any" else f"{wanted} site"
    elsewhere = f"place={request.map_id} to search the whole map" if request.bbox is not None else "another place"
    if wanted == "highway" and not request.road_classes:
        where += (
            "; a highway is a motorway or, on a map without one, a trunk road that is signed as a motor road, or is "
            f"one-way with a limit of {EXPRESSWAY_KMH} km/h or more"
        )
    if wanted == "roundabout":
        where += _ring_fault(finder, request)
    next_step = f"choose one of these scenario types, or {elsewhere}" if available else f"choose {elsewhere}"
    if not available and len(request.streets) > 1 and not _meet(osm, request.streets):
        return _never_meet(osm, finder, request)
    kinds = ANY_ORDER if wanted == "any" else (wanted,)
    is_excluded = bool(request.road_classes and _fitting_of(site_finder(osm), kinds, request))
    if is_excluded:
        where += f" with only roads of class {' or '.join(request.road_classes[:SHOWN_NAMES])}"
        if excluded := _excluded_streets(osm, request):
            where += f" ({excluded})"
        next_step = "leave road_classes out" + (", or choose one of these scenario types" if available else "")
    turn = request.goal.turn
    suited = [kind for kind in available if turn is None or turn in TURNS_AT[kind]]
    remedies = [with_values(scenario_type=kind) for kind in suited[:1]]
    if available and not suited:
        remedies = [with_values(scenario_type=available[0], goal=None)]
    if is_excluded:
        remedies.insert(0, with_values(road_classes=None))
    if (outside := _nearest_outside(finder, request)) is not None:
        streets = cited_all(outside.streets[:SHOWN_NAMES], " / ") or "unnamed roads"
        at = f"{outside.latitude:.5f}, {outside.longitude:.5f}"
        where += f"; the nearest {wanted} of the map is outside this part, at {streets} ({at})"
        remedies.insert(0, with_values(place=request.map_id, bbox=_box_around(outside)))
    return NotPossible(
        f"{cited(request.place)} ({request.map_id}) has no {wanted_site}{where}",
        valid=available,
        next_step=next_step,
        reason="no_such_site",
        remedies=remedies,
    )


def _meet(osm: OsmMap, streets: tuple[tuple[str, ...], ...]) -> bool:
    """Return whether roads of all these names share a node of the map."""
    return bool(_shared_nodes(osm, streets))


def _shared_nodes(osm: OsmMap, streets: tuple[tuple[str, ...], ...]) -> set[int]:
    """Return the nodes that roads of all these names share."""
    return set.intersection(*(_nodes_called(osm, names) for names in streets))


def _nodes_called(osm: OsmMap, names: tuple[str, ...]) -> set[int]:
    """Return the nodes of the roads with one of the names."""
    return {key for way in _called(osm, names) for key in way.node_ids}


def _nodes_by_name(osm: OsmMap) -> Mapping[str, set[int]]:
    """Return the nodes of all roads, by each of their names and numbers in a plain form."""
    nodes: dict[str, set[int]] = defaultdict(set)
    for way in osm.ways:
        for name in (way.tags[key] for key in ("name", "ref") if way.road_class and key in way.tags):
            for key in _keys_of(name):
                nodes[key].update(way.node_ids)
    return nodes


def _excluded_streets(osm: OsmMap, request: GenerationRequest) -> str:
    """Return the requested streets without a road of the requested classes, with their own classes, as text."""
    excluded = []
    for names in request.streets:
        classes = sorted({way.road_class for way in _called(osm, names) if way.road_class})
        if not set(classes) & set(request.road_classes):
            excluded.append(f"{cited(names[0])} is {' or '.join(classes[:SHOWN_NAMES])}")
    return ", ".join(excluded)


def _ring_fault(finder: SiteFinder, request: GenerationRequest) -> str:
    """Return why a way tagged as a roundabout on the requested streets is not one; empty if there is no such way."""
    for part, fault in finder.ring_faults():
        ring = Site("roundabout", *part.position, part.streets, part.mark)
        if _passes_by(ring, request) and _is_in_box(ring, request):
            return f"; {ring.osm_id} is tagged as a roundabout, but {fault}"
    return ""


def _never_meet(osm: OsmMap, finder: SiteFinder, request: GenerationRequest) -> NotPossible:
    """Return the refusal of streets that do not meet. As alternatives, it lists the crossing of one of these streets
    that is nearest to the others, and then each street that has a site of the requested type.
    """
    named = cited_all((names[0] for names in request.streets), " / ")
    kinds: tuple[SiteType, ...] = ANY_ORDER if request.scenario_type == "any" else (request.scenario_type,)
    crossing = _crossing_nearby(osm, finder, request, kinds)
    alone = [] if crossing is None else [f"{crossing}, {request.place}"]
    alone += [
        f"{names[0]}, {request.place}"
        for names in request.streets
        if len(place_parts(names[0])) == 1 and _fitting_any(finder, request, kinds, (names,))
    ]
    return NotPossible(
        f"{named} do not meet on the map {cited(request.place)} ({request.map_id})",
        valid=map(cited, alone),
        next_step="choose one of these, or another crossing" if alone else "choose another place",
        reason="no_such_site",
        remedies=[with_values(place=place) for place in alone],
    )


def _crossing_nearby(
    osm: OsmMap, finder: SiteFinder, request: GenerationRequest, kinds: tuple[SiteType, ...]
) -> str | None:
    """Return the crossing of one requested street with any road that is nearest to the other requested streets."""
    if not set(kinds) & {"intersection", "signalised_intersection", "urban"}:
        return None
    found: list[tuple[float, str, tuple[tuple[str, ...], ...]]] = []
    for names in request.streets:
        if len(place_parts(names[0])) != 1:
            continue
        others = [
            osm.nodes[key].position
            for other in request.streets
            if other is not names
            for way in _called(osm, other)
            for key in way.node_ids
        ]
        for site in _fitting_any(finder, request, kinds, (names,)):
            for part in site.parts if others else ():
                crossed = [street for street in part.streets if not _carries((street,), names)]
                away_m = min(ground_distance_m(part.position, place) for place in others)
                found += [(away_m, f"{names[0]} / {street}", (names, (street,))) for street in crossed]
    for _, text, streets in sorted(found, key=lambda one: one[:2])[:MOST_CROSSINGS]:
        if len(place_parts(text)) == len(streets) and _fitting_any(finder, request, kinds, streets):
            return text
    return None


def _fitting_any(
    finder: SiteFinder, request: GenerationRequest, kinds: Iterable[SiteType], streets: tuple[tuple[str, ...], ...]
) -> list[Site]:
    """Return the fitting sites of any of the kinds on the given streets instead of the requested kinds."""
    elsewhere = request.model_copy(update={"streets": streets})
    return [site for kind in kinds for site in _fitting(finder, finder.find(kind), elsewhere)]


def _called(osm: OsmMap, names: tuple[str, ...]) -> Iterator[OsmWay]:
    """Yield the roads with one of the names."""
    for way in osm.ways:
        if way.road_class and _is_called(names, way):
            yield way


def _is_called(names: tuple[str, ...], way: OsmWay) -> bool:
    """Return whether a road has one of the names or numbers."""
    return _carries(tuple(way.tags[key] for key in ("name", "ref") if key in way.tags), names)


def _nearest_outside(finder: SiteFinder, request: GenerationRequest) -> Site | None:
    """Return the requested type's site on the streets nearest to the middle of the box, or None."""
    if request.bbox is None or request.scenario_type == "any":
        return None
    south, west, north, east = request.bbox
    middle = (south + north) / 2, (west + east) / 2
    anywhere = request.model_copy(update={"bbox": None})
    sites = _fitting(finder, finder.find(request.scenario_type), anywhere)
    return min(sites, key=lambda site: ground_distance_m(middle, site.position), default=None)


def _fitting(finder: SiteFinder, sites: list[Site], request: GenerationRequest) -> list[Site]:
    """Return the sites on all streets of a request and in its box."""
    if request.streets:
        sites = [
            finder.narrowed(site, partial(_is_on_streets, request.streets))
            for site in sites
            if _passes_by(site, request)
        ]
        sites = [_requested_first(site, request) for site in _ramps_of(finder, sites, request) or sites]
    return [site for site in sites if _is_in_box(site, request)]


def _fitting_of(
    finder: SiteFinder, kinds: Iterable[SiteType], request: GenerationRequest
) -> dict[SiteType, list[Site]]:
    """Return the fitting sites of each kind that has some, and those that are found only for a request like this.

    They are needed if there are no others, or if the requested streets only pass the others. If streets meet only at a
    roundabout, that is their intersection.
    """
    kinds = tuple(kinds)
    found = {kind: fitting for kind in kinds if (fitting := _fitting(finder, finder.find(kind), request))}
    if _has_meeting(found, request):
        return found
    more = _fitting_by_links(finder, kinds, request)
    if not _has_meeting(more, request) and "intersection" in kinds:
        rings = _fitting_rings(finder, request)
        more = rings if _has_meeting(rings, request) else more
    if not _has_meeting(more, request):
        more = _fitting_meetings(finder, kinds, request) or more
    if not found and not more:
        more = _fitting_besides_motorways(finder, kinds, request) or _fitting_joints(finder, kinds, request)
    return {kind: both for kind in ANY_ORDER if (both := [*found.get(kind, []), *more.get(kind, [])])}


def _fitting_rings(finder: SiteFinder, request: GenerationRequest) -> dict[SiteType, list[Site]]:
    """Return the roundabouts at which several requested streets meet, if an ego can make its turn there."""
    turn = request.goal.turn
    if len(request.streets) < 2 or (turn is not None and turn not in TURNS_AT["roundabout"]):
        return {}
    return {"roundabout": _fitting(finder, finder.find("roundabout"), request)}


def _has_meeting(found: Mapping[SiteType, list[Site]], request: GenerationRequest) -> bool:
    """Return whether there are sites and, if the request has several streets, one of them is where they meet."""
    sites = chain(*found.values())
    return any(len(request.streets) < 2 or not (site.only_passed or site.kind == "ramp") for site in sites)


def _fitting_meetings(
    finder: SiteFinder, kinds: Iterable[SiteType], request: GenerationRequest
) -> dict[SiteType, list[Site]]:
    """Return the junctions at which the requested streets meet only across a short road, by kind."""
    if len(request.streets) < 2:
        return {}
    first, *others = (partial(_is_called, names) for names in request.streets)
    found: dict[SiteType, list[Site]] = {}
    for kind in kinds:
        sites = [site for other in others for site in finder.meetings(kind, first, other)]
        fitting = [site for site in sites if _passes_by(site, request) and _is_in_box(site, request)]
        found |= {kind: fitting} if fitting else {}
    return found


def _fitting_joints(
    finder: SiteFinder, kinds: Iterable[SiteType], request: GenerationRequest
) -> dict[SiteType, list[Site]]:
    """Return the roads where a requested street continues another one without a junction, for each kind of road."""
    if len(request.streets) < 2:
        return {}
    joints = _fitting(finder, finder.joints_of_streets(), request)
    of_kind = {kind: [site for site in joints if site.kind == kind and not site.only_passed] for kind in kinds}
    return {kind: fitting for kind, fitting in of_kind.items() if fitting}


def _fitting_besides_motorways(
    finder: SiteFinder, kinds: Iterable[SiteType], request: GenerationRequest
) -> dict[SiteType, list[Site]]:
    """Return the fitting highways and ramps of trunk roads on a map with a motorway, for each kind that has some."""
    sites = {kind: _fitting(finder, finder.find_besides_motorways(kind), request) for kind in kinds}
    return {kind: fitting for kind, fitting in sites.items() if fitting}


def _fitting_by_links(
    finder: SiteFinder, kinds: Iterable[SiteType], request: GenerationRequest
) -> dict[SiteType, list[Site]]:
    """Return the fitting sites that links belong to, for each kind that has some.

    Links make a junction only of several requested streets; the ring of a roundabout may always consist of links. A
    single street without an urban junction is itself an urban site if it has houses.
    """
    possible = [kind for kind in kinds if kind == "roundabout" or len(request.streets) > 1]
    found = {kind: fitting for kind in possible if (fitting := _fitting(finder, finder.find_by_links(kind), request))}
    if not found and "urban" in kinds and len(request.streets) == 1:
        found = {"urban": fitting} if (fitting := _fitting(finder, finder.middles_of_streets(), request)) else {}
    return found


_LEAST_BOX_DEG = 1e-9
"""Below the size of any box, so that one of no size has no corner."""


def _is_in_corner(site: Site, request: GenerationRequest) -> bool:
    """Return True if a site is outside the ellipse in the requested box, since a place's box represents a circle."""
    if request.bbox is None:
        return False
    south, west, north, east = request.bbox
    up = (2 * site.latitude - south - north) / max(north - south, _LEAST_BOX_DEG)
    aside = (2 * site.longitude - west - east) / max(east - west, _LEAST_BOX_DEG)
    return up**2 + aside**2 > 1.0


def _requested_first(site: Site, request: GenerationRequest) -> Site:
    """Return the site with the requested streets first in its name."""
    requested = [name for name in site.streets if any(_carries((name,), names) for names in request.streets)]
    return replace(site, streets=tuple(dict.fromkeys((*requested, *site.streets))))


def _ramps_of(finder: SiteFinder, sites: list[Site], request: GenerationRequest) -> list[Site]:
    """Return the ramps that have a requested street as their main road, without their other parts.

    The name of a ramp also includes the roads that its links lead to, which may be a kilometre away.
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


def _is_on_streets(streets: tuple[tuple[str, ...], ...], part: SitePart) -> bool:
    return all(_carries(part.streets, names) for names in streets)


def _carries(streets: tuple[str, ...], names: tuple[str, ...]) -> bool:
    """Return whether the streets include one of the names; names in a list (``A 4;E 40``) count individually."""
    held, wanted = (set[str]().union(*map(_keys_of, lists)) for lists in (streets, names))
    return not held.isdisjoint(wanted)


def _keys_of(listed: str) -> set[str]:
    """Return the plain forms of a name, and of the names in a list."""
    return {fold(part) for part in (listed, *listed.split(";"))} - {""}


def radius_for(site: Site, request: GenerationRequest) -> float:
    """Return the cut radius around a site in m: up to twice ``RADIUS_M`` for recordings of 20 s to 120 s.

    Vehicles can only leave after step 0, so a longer recording needs more of them around the site.
    """
    return RADIUS_M[site.kind] * (1.0 + min(max(request.duration_s - 20.0, 0.0), 100.0) / 100.0)


def classes_for(site: Site, request: GenerationRequest) -> tuple[str, ...]:
    """Return the OSM classes to keep around a site: those requested or all, with links if the site has them."""
    return request.road_classes or (ROADS + LINKS if site.kind in ("ramp", "highway") or site.by_links else ROADS)


AT_M, JUNCTION_M = 40.0, 60.0
"""Distance from a site's middle to its road and its junction; within the latter, two sites are one (chosen)."""
LEAST_ENTRIES = 2
"""Minimum number of roads that lead into a roundabout (chosen)."""
RING_CLEAR_M = 15.0
"""Maximum distance of a site's middle from its ring, outside it (chosen)."""
LEAST_ARMS = 3
"""Minimum number of roads at a junction; two count as one road."""


def why_not_realised(site: Site, net: SumoNet) -> str | None:
    """Return why the net lacks the features of the site's type near the site's centre, or None if it has them."""
    middle = middle_of(site, net)
    judges: dict[SiteType, Callable[[], bool]] = {
        "roundabout": lambda: bool(_ring_edges_at(site, net, middle)),
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
    """Return the centre of the site in the net's coordinates, shape (2,)."""
    return _place_of(site.position, net)


def _place_of(position: tuple[float, float], net: SumoNet) -> Points:
    """Convert a latitude and longitude to the net's coordinates, shape (2,)."""
    from pyproj import Proj

    if not net.projection:
        return np.zeros(2)
    x, y = Proj(net.projection)(position[1], position[0])
    return np.array([x + net.offset_m[0], y + net.offset_m[1]])


def road_classes(edge: NetEdge) -> frozenset[str]:
    """Return the OSM ``highway`` values of an edge: several if netconvert joined roads, "" if a user's net has none."""
    parts = edge.road_type.split("|")
    return frozenset(part.removeprefix("highway.") for part in parts if not part.startswith("service."))


def _passes(net: SumoNet, middle: Points, within_m: float, wanted: Callable[[frozenset[str]], bool]) -> bool:
    """Return whether a road of the wanted classes is near the site's centre; checks 8 points per segment."""
    roads = {edge.edge_id for edge in net.edges.values() if not edge.internal and wanted(road_classes(edge))}
    lanes = (lane for lane in net.lanes.values() if lane.edge_id in roads)
    return any(float(np.linalg.norm(_dense(lane.shape) - middle, axis=1).min()) < within_m for lane in lanes)


def _dense(line: Points) -> Points:
    steps = np.linspace(0.0, 1.0, 9)[:, None, None]
    return ((1 - steps) * line[None, :-1] + steps * line[None, 1:]).reshape(-1, 2) if len(line) > 1 else line


def _ring_edges_at(site: Site, net: SumoNet, middle: Points) -> frozenset[str]:
    """Return the edges of all roundabouts at the site's centre that are closed and that roads enter.

    netconvert does not mark every ring as a roundabout, for example not one with ``junction=circular``. If no ring is
    marked, the ring is the circle of one-way edges that the site's ways are part of.
    """
    before: dict[str, set[str]] = {}
    for turn in net.connections:
        before.setdefault(turn.to_edge, set()).add(turn.from_edge)
    marked = [ring for ring in net.roundabout_edges if _is_ring_at(net, middle, ring, before)]
    drawn = drawn_ring(site, net)
    if not marked and drawn and _is_ring_at(net, middle, drawn, before):
        marked = [drawn]
    return frozenset(edge for ring in marked for edge in ring)


def drawn_ring(site: Site, net: SumoNet) -> tuple[str, ...]:
    """Return the shortest circle of one-way edges that a tagged way of a roundabout is part of, or an empty tuple.

    The edges follow each other from junction to junction, but may lack connections.
    """
    marks = {str(mark) for mark in (site.mark, *(part.mark for part in site.parts))}
    leaving: dict[str, list[str]] = {}
    lengths: dict[str, float] = {}
    for key, edge in net.edges.items():
        if not edge.internal and edge.lane_ids and f"-{key}".removeprefix("--") not in net.edges:
            leaving.setdefault(edge.from_junction, []).append(key)
            lengths[key] = length_m(net.lanes[edge.lane_ids[0]].shape)
    roads = Digraph[str](lambda key: [(one, lengths[one]) for one in leaving.get(net.edges[key].to_junction, ())])
    for first in lengths:
        if first.removeprefix("-").partition("#")[0] in marks:
            onward = leaving.get(net.edges[first].to_junction, ())
            ring = roads.cheapest_route(onward, [first])
            if ring is not None and sum(lengths[key] for key in ring) <= LONGEST_RING_M:
                return ring
    return ()


def _is_ring_at(net: SumoNet, middle: Points, ring: tuple[str, ...], before: Mapping[str, Set[str]]) -> bool:
    """Return whether a ring is closed, has roads that lead into it, and surrounds the site's centre or passes near it.

    ``before``: the edges that lead into each edge.
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
    """Return the junctions of three or more roads, not only motorways, near the site's centre.

    ``with_links``: whether link roads count.
    """
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
    if len(arms) < LEAST_ARMS:
        return False
    if not all(road_classes(edge) <= FAST_ROADS for edge in roads):
        return True
    ends = {(edge.from_junction, edge.to_junction) for edge in roads}
    is_two_way = any(pair[::-1] in ends for pair in ends)
    is_of_motorways = any("motorway" in road_classes(edge) for edge in roads)
    return not is_of_motorways and (is_two_way or len(arms) >= ARMS_OF_A_CROSSING)


def _is_lit(net: SumoNet, junction: str) -> bool:
    """Return whether a junction has traffic lights."""
    return net.junction_types.get(junction, "").startswith("traffic_light")


def _ramp_near(net: SumoNet, middle: Points) -> bool:
    """Return whether a link leaves or joins a motorway or trunk road near the site's centre."""
    for turn in net.connections:
        before, after = (road_classes(net.edges[key]) for key in (turn.from_edge, turn.to_edge))
        joins = (before & FAST_ROADS and after & RAMP_LINKS) or (after & FAST_ROADS and before & RAMP_LINKS)
        if joins and float(np.linalg.norm(net.lanes[turn.from_lane].shape[-1] - middle)) < JUNCTION_M:
            return True
    return False


def lines_of_streets(osm: OsmMap, streets: Iterable[tuple[str, ...]], net: SumoNet) -> "BaseGeometry | None":
    """Return the lines of the requested streets in the net's coordinates; None without streets or positions.

    Their slip roads, which may have the same name, do not count, unless there is nothing else.
    """
    from pyproj import Proj
    from shapely import MultiLineString

    called = {way.way_id: way for names in streets for way in _called(osm, names) if len(way.node_ids) > 1}
    ways = {key: way for key, way in called.items() if way.road_class not in LINKS} or called
    if not ways or not net.projection:
        return None
    places = {key: osm.nodes[key].position for way in ways.values() for key in way.node_ids}
    east, north = Proj(net.projection)([place[1] for place in places.values()], [place[0] for place in places.values()])
    points = dict(zip(places, np.column_stack([east, north]) + np.array(net.offset_m), strict=True))
    return MultiLineString([[points[key] for key in way.node_ids] for way in ways.values()])


FOCUS_NAMES: dict[SiteType, str] = {
    "roundabout": "the ring",
    "signalised_intersection": "the junction",
    "intersection": "the junction",
    "urban": "the junction",
    "ramp": "the ramp",
}
"""The focus of a site of each type, as text; other types concern a whole road."""
REACH_M = 200.0
"""Maximum distance of a site's areas from its middle (chosen): links and main roads continue to other ramps."""
STREET_M = 15.0
"""Maximum distance of a car on a street from the street's line on the map (chosen): half of a road with eight lanes."""
LEAST_ON_STREET_M, LEAST_SHARE_ON_STREET = 25.0, 0.25
"""Minimum length of a path within ``STREET_M`` of a street, or minimum share if that is less (chosen).

A path across the street is within this distance for at least 30 m, and one that only touches the street is not.
"""


class SiteFocus:
    """The areas of a site that its ego's path should pass: the ring, the junction, or link and main road.

    ``ring``: the edges of a roundabout. ``ways``: the ways through the ring, or through the junctions that the site was
    made from; None if the site is a road or a ramp. ``streets``: the lines of the requested streets, if any.
    """

    def __init__(self, site: Site, net: SumoNet, network: RoadNetwork, streets: "BaseGeometry | None" = None) -> None:
        middle = middle_of(site, net)
        self.kind, self.net = site.kind, net
        self._name = FOCUS_NAMES.get(site.kind, "")
        self._areas = [_area(network, belongs, middle) for belongs in _parts(site, net, middle)]
        ring = _ring_edges_at(site, net, middle) if site.kind == "roundabout" else frozenset[str]()
        spot, self._spot = _spot(site, _junctions_of(site, net, middle), net, network, middle)
        self.ways = SiteWays(net, spot, ring) if spot or ring else None
        self._inside = None if self.ways is None else _area(network, _belongs_to(self.ways, spot, network), middle)
        self._streets = None if streets is None else streets.buffer(STREET_M)

    @property
    def parts(self) -> int:
        """The maximum number of areas that a path can pass: two at a ramp, otherwise one."""
        return max(len(self._areas), 1)

    def parts_passed(self, car: GeneratedVehicle, last_step: int) -> int:
        """Count the areas that the car's centre passes up to a step.

        The result is 0 if the car misses the first area, and always 1 if the site is a road.
        """
        from shapely import contains_xy

        if not self._areas:
            return 1
        x, y = car.motion.positions[: last_step + 1].T
        passed = [bool(contains_xy(area, x, y).any()) for area in self._areas]
        return sum(passed) if passed[0] else 0

    def is_on_spot(self, car: GeneratedVehicle, last_step: int) -> bool:
        """Return whether the car passes a junction that is the site, up to a step; True at other sites."""
        from shapely import contains_xy

        if self._spot is None:
            return True
        return bool(contains_xy(self._spot, *car.motion.positions[: last_step + 1].T).any())

    def takes_street(self, car: GeneratedVehicle, last_step: int) -> bool:
        """Return whether the car drives along or across a requested street, or around the ring, up to a step.

        The result is True if no street is requested.
        """
        from shapely import LineString

        if self._streets is None or (self.kind == "roundabout" and self.parts_passed(car, last_step)):
            return True
        path = LineString(car.motion.positions[: last_step + 1])
        least_m = min(LEAST_ON_STREET_M, LEAST_SHARE_ON_STREET * path.length)
        return bool(path.intersection(self._streets).length >= least_m)

    def inside(self, car: GeneratedVehicle) -> NDArray[np.bool_]:
        """Return a mask of the steps at which the car's centre is on the ring, or in the junctions of the site.

        At a site of several junctions, the edges between them count as inside. If the site is a road or a ramp, all
        entries are False.
        """
        from shapely import contains_xy

        x, y = car.motion.positions.T
        if self._inside is None:
            return np.zeros(len(x), dtype=np.bool_)
        within: NDArray[np.bool_] = contains_xy(self._inside, x, y)
        return within

    def is_left_by(self, car: GeneratedVehicle, step: int) -> bool:
        """Return whether the car's centre is outside all areas at a step; always True if the site is a road."""
        from shapely import contains_xy

        x, y = car.motion.positions[step]
        return not any(bool(contains_xy(area, x, y)) for area in self._areas)

    def missed(self, *, only_car: bool) -> str:
        """Return the note on an ego that passes no area; ``only_car``: no other car could be chosen."""
        who = "the ego's route to its goal does not pass" if only_car else "no car's route to its goal passes"
        return f"{who} {self._name} of the site; a goal farther ahead or another seed may change this"

    def left_the_street(self, *, only_car: bool) -> str:
        """Return the note on an ego that leaves the requested street; ``only_car``: no other could be chosen."""
        who = "the ego's route to its goal is not" if only_car else "no car's route to its goal is"
        return f"{who} on the requested street; another seed or goal may change this"

    def passed_close_by(self, *, only_car: bool) -> str:
        """Return the note on an ego that passes another junction nearby; ``only_car``: no other car could be chosen."""
        who = "the ego's route to its goal" if only_car else "every car's route to its goal"
        return f"{who} passes a junction nearby instead of the site's; another seed may change this"


def _joins(lanelet: RoadLanelet, edges: frozenset[str], network: RoadNetwork) -> bool:
    """Return True for a lanelet inside a junction that leads from one of the edges to another of them."""

    def is_among(keys: Iterable[int]) -> bool:
        return any(network.lanelets[key].edge_id in edges for key in keys)

    return lanelet.internal and is_among(lanelet.predecessors) and is_among(lanelet.successors)


def _parts(site: Site, net: SumoNet, middle: Points) -> list[Callable[[RoadLanelet], bool]]:
    """Return a function for each area, most important first, that tests whether a lanelet belongs to it."""
    if site.kind == "roundabout":
        edges = _ring_edges_at(site, net, middle)
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
) -> tuple[frozenset[str], "BaseGeometry | None"]:
    """Return the junctions that a site was made of, and their area (None if no other junctions are near)."""
    from shapely import Point, union_all

    near = sorted(junctions) if len(junctions) > 1 else []
    areas = {key: _area(network, partial(_is_in, key), middle) for key in near}
    areas = {key: area for key, area in areas.items() if not area.is_empty}
    places = [_place_of(part.position, net) for part in site.parts] or [middle]
    spot = {min(areas, key=lambda key: areas[key].distance(Point(*place))) for place in places} if areas else set()
    if len(spot) == len(areas):
        return junctions, None
    return frozenset(spot), union_all([areas[key] for key in sorted(spot)])


def _belongs_to(ways: SiteWays, junctions: frozenset[str], network: RoadNetwork) -> Callable[[RoadLanelet], bool]:
    """Return a function that tests whether a lanelet is inside a site, between its entries and exits."""

    def belongs(lanelet: RoadLanelet) -> bool:
        if not lanelet.internal:
            return lanelet.edge_id in ways.inside
        return _junction(lanelet) in junctions or _joins(lanelet, ways.inside, network)

    return belongs


def _is_in(junction: str, lanelet: RoadLanelet) -> bool:
    return lanelet.internal and _junction(lanelet) == junction


def _junction(lanelet: RoadLanelet) -> str:
    """Return the junction that an internal lanelet is in: SUMO names its edges ``:junction_index``."""
    return lanelet.edge_id.removeprefix(":").rpartition("_")[0]


def _road(net: SumoNet, classes: frozenset[str]) -> Callable[[RoadLanelet], bool]:
    return lambda lanelet: not lanelet.internal and bool(road_classes(net.edges[lanelet.edge_id]) & classes)


def _area(network: RoadNetwork, belongs: Callable[[RoadLanelet], bool], middle: Points) -> "BaseGeometry":
    from shapely import Point, Polygon, make_valid, prepare, union_all

    polygons = [make_valid(Polygon(lanelet.polygon)) for lanelet in network.lanelets.values() if belongs(lanelet)]
    area = union_all(polygons).intersection(Point(*middle).buffer(REACH_M))
    prepare(area)
    return area
