"""Choosing the site of a scenario: of the asked type, on the asked streets, within the asked box, by seed and index."""

import random
from itertools import zip_longest
from pathlib import Path

from plannerforge.engine.catalog.places import fold
from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.maps.map_file import read_map_file
from plannerforge.engine.maps.osm_reader import OsmMap, ground_distance_m
from plannerforge.engine.maps.road_classes import LINKS, ROADS
from plannerforge.engine.maps.sites import Site, SiteFinder
from plannerforge.schemas.errors import InvalidRequest, NotPossible, PlannerForgeError
from plannerforge.schemas.generation import GenerationRequest, SiteCount, SiteType

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
    return NotPossible(
        f"{request.place} ({request.map_id}) holds no {wish}{where}",
        valid=held,
        next_step=next_step,
    )


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
