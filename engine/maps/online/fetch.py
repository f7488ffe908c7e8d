"""Fetches roads from Overpass: all roads of a small place, or those around sites that fit a request."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, get_args

from ....schemas.errors import NotPossible, UnknownName
from ....schemas.generation import (
    FetchedMap,
    FetchedMaps,
    FetchMapRequest,
    MapFacts,
    ReadMapRequest,
    ScenarioType,
    SiteType,
)
from ....schemas.maps import Box, NamedPlace
from ....schemas.text import cited, one_line
from ...execution import ProgressReporter, silent
from ..facts import read_map
from ..index import NOT_SHOWN, roads_called
from ..map_file import read_map_file
from ..naming.places import latin
from ..naming.shown import MOST_PLACES
from ..naming.tags import PLACE_KINDS
from ..osm import ground_distance_m
from ..site_search.finder import SiteFinder
from .messages import MapData
from .services import Answered, ServiceClient, settings_of_query

Spot = tuple[float, float]
"""Latitude and longitude in degrees."""
CORE_M = 600.0
"""Distance from a site to the edge of the core fetched around it (chosen): room for the site and some more."""
LEAST_CORE_M = 250.0
"""Distance from the middle of the smallest core to its edge (chosen)."""
_AROUND_MIDDLE_M: Mapping[ScenarioType, float] = {"highway": 5000.0, "ramp": 5000.0, "rural": 3000.0}
"""Distance from a settlement within which people look for this type (chosen); for other types CLOSE_M."""
_CLOSE_M = 150.0
_MARGIN_M: Mapping[ScenarioType, float] = {"highway": 900.0, "ramp": 900.0, "rural": 900.0}
"""Margin fetched around a core (chosen after the cut radius of a site); otherwise USUAL_MARGIN_M."""
_USUAL_MARGIN_M = 500.0
MOST_TRIES = 3
"""Downloads for one map (chosen): a candidate may turn out not to be a site."""
SPARE_SITES = 3
"""Spare sites in addition to the requested ones: a network that cannot be built gives no scenario (chosen)."""
MOST_MAPS = 6
"""Maximum number of maps for one request for many scenarios (chosen); each one beyond the first allows two
downloads.
"""
MOST_SEARCHED_M = 60_000.0
"""Longest side of a box in which candidates are searched (chosen); of a larger box, the middle."""
MOST_SPOTS = 4000
"""Maximum number of candidates requested from a service (chosen)."""
ON_ROAD_M = 60.0
"""Maximum distance from a road to its candidates (chosen)."""
OUT_OF_TOWN_M = 1200.0
"""Distance from the middle of a settlement to rural roads (chosen); farther for towns and cities."""
_TOWN_LIMIT_KMH = 60
_SPOT_FILTERS: Mapping[ScenarioType, str] = {
    "roundabout": 'way["highway"]["junction"~"^(roundabout|circular)$"]',
    "signalised_intersection": 'node["highway"="traffic_signals"]',
    "ramp": 'way["highway"~"^(motorway|trunk)_link$"]',
    "highway": 'way["highway"~"^(motorway|trunk)$"]',
    "rural": 'way["highway"~"^(trunk|primary|secondary|tertiary|unclassified)$"]',
}
"""Overpass filters that find the sites of each type by OpenStreetMap's tags."""
_SETTLEMENTS = f'node["place"~"^({"|".join(PLACE_KINDS)})$"]'
_MAIN_ROADS = 'way["highway"~"^(motorway|trunk|primary|secondary|tertiary)(_link)?$"]'
_NAMED_ROADS = 'way["highway"]["name"]'
_WITH_HOUSES: frozenset[ScenarioType] = frozenset({"any", "urban", "rural"})
"""Types that depend on houses along the road; houses are most of a town's data."""
NO_ROADS, NO_SITE, TOO_LARGE = "no_roads", "no_such_site", "too_large"
"""Reasons of refusals."""
_METRES_A_DEGREE = 111_195.0


def fetch_maps(request: FetchMapRequest, report: ProgressReporter) -> FetchedMaps:
    """Fetch the roads of a place or box with sites of the requested type, on several maps if necessary.

    Raises:
        ServiceFailure: no service gives a valid answer.
        NotPossible: there is no road or no such site, or too much data; or requests are not allowed.
        UnknownName: the place has no road of that name.
    """
    client = ServiceClient(request.services, report)
    search = _Area(request, client)
    fetched: list[FetchedMap] = []
    troubles: list[str] = []
    available: set[SiteType] = set()
    sites, has_roads = 0, False
    for number, core in enumerate(islice(search.cores(), MOST_TRIES + 2 * min(request.count, MOST_MAPS) - 2)):
        query = map_query(request, core)
        answered = client.query(query)
        troubles += answered.troubles
        if not any(element.get("tags", {}).get("highway") for element in answered.answer["elements"]):
            continue
        has_roads = True
        report(0.8 + 0.1 * number / (MOST_TRIES + MOST_MAPS), "reading the map")
        path = Path(request.folder) / f"{_file_stem(search.name)}_{number}.osm"
        write_osm(answered.answer["elements"], widened(core, margin_m(request.scenario_type)), path)
        found = _sites_inside(path, core, request)
        available |= set(found)
        here = sum(found.values()) if request.scenario_type == "any" else found.get(request.scenario_type, 0)
        if here:
            sites += here
            fetched.append(_fetched(request, path, core, query, answered))
        if sites >= request.count:
            break
    if not fetched:
        raise _no_site_error(request, search.name, sorted(available), has_roads=has_roads)
    return FetchedMaps(maps=tuple(fetched), notes=tuple(dict.fromkeys((*troubles, *search.notes))))


def _no_site_error(request: FetchMapRequest, name: str, held: list[SiteType], *, has_roads: bool) -> NotPossible:
    if not has_roads and request.scenario_type in ("any", "urban", "intersection"):
        return NotPossible(
            f"OpenStreetMap has no road for vehicles at {name}",
            next_step="choose another place, or a larger bbox",
            reason=NO_ROADS,
        )
    return NotPossible(
        f"{name} has no {request.scenario_type} site on OpenStreetMap",
        valid=held,
        next_step="choose one of these scenario types, or another place" if held else "choose another place",
        reason=NO_SITE,
    )


class _Area:
    """The search area of a request: the boxes to fetch, best first."""

    def __init__(self, request: FetchMapRequest, client: ServiceClient) -> None:
        self._request, self._client = request, client
        self._kind, self._place = request.scenario_type, request.place
        self.notes: list[str] = []
        place = request.place
        self.name = cited(place.label) if place is not None else f"the box {list(request.bbox or ())}"

    def cores(self) -> Iterator[Box]:
        """Yield boxes in which sites may be chosen; each box with its margin fits into one download."""
        whole = self._whole()
        if self._hinted:
            yield from self._about(self._spots_of_hinted_roads(whole))
        elif self._fits(whole):
            yield whole
        else:
            self.notes.append(f"{self.name} is too large to fetch whole; only roads around sites were fetched")
            yield from self._about(self._spots(whole))

    @property
    def _hinted(self) -> bool:
        """Whether only the map, not Nominatim, can resolve the requested road in the requested settlement."""
        return self._place is not None and self._place.is_settlement and bool(self._place.roads)

    def _whole(self) -> Box:
        """Return the box of everything that the request may refer to."""
        if self._request.bbox is not None:
            return self._request.bbox
        if self._place is None:
            raise NotPossible("neither a place nor a box was given", next_step="give one")
        box = self._place.box
        if self._place.is_settlement and not self._hinted:
            return _at_least(widened(box, _AROUND_MIDDLE_M.get(self._kind, _CLOSE_M)))
        return _at_least(box)

    def _fits(self, core: Box) -> bool:
        return area_km2(widened(core, margin_m(self._kind))) <= self._request.services.most_km2

    def _about(self, spots: Sequence[Spot]) -> Iterator[Box]:
        """Yield a core around each candidate, without overlaps, together with the neighbours that fit into it.

        The boxes suffice for the requested scenarios, and for a few that replace failed scenarios.
        """
        used: list[Box] = []
        for spot in spots:
            core = _about_spot(spot, CORE_M)
            if any(_overlap(core, box) for box in used):
                continue
            room = self._request.count + SPARE_SITES
            for other in sorted(spots, key=lambda each: ground_distance_m(spot, each))[:room]:
                larger = _around_both(core, _about_spot(other, LEAST_CORE_M))
                apart = not any(_overlap(larger, box) for box in used)
                core = larger if apart and self._fits(larger) else core
            used.append(core)
            yield core

    def _spots(self, whole: Box) -> list[Spot]:
        """Return the positions of possible sites of the type, nearest to the middle of the place first."""
        middle = self._middle(whole)
        box = _bounded(whole, middle)
        lines = self._place.lines if self._place is not None else ()
        selector = _SPOT_FILTERS.get(self._kind)
        if selector is None or (lines and self._kind in ("highway", "rural")):
            points = [point for line in lines for point in line] or self._settled(box, middle)
            return _nearest_first(points, middle)
        found = self._found([selector], box)
        if self._kind == "rural":
            found = self._out_of_town(found, box)
        if self._kind == "highway":  # an expressway counts if there is no motorway
            found = [one for one in found if one["tags"].get("highway") == "motorway"] or found
        spots = [_position(one) for one in found]
        if lines:
            spots = [spot for spot in spots if _is_on(spot, lines)]
        return _nearest_first(spots, middle)

    def _middle(self, whole: Box) -> Spot:
        if self._request.bbox is None and self._place is not None:
            return self._place.latitude, self._place.longitude
        return (whole[0] + whole[2]) / 2, (whole[1] + whole[3]) / 2

    def _settled(self, box: Box, middle: Spot) -> list[Spot]:
        """Return the middle of a place, or the settlements in a box that is larger than any place."""
        if self._request.bbox is None:
            return [middle, *(_position(one) for one in self._found([_SETTLEMENTS], box))]
        return [_position(one) for one in self._found([_SETTLEMENTS], box)] + [middle]

    def _found(self, selectors: Sequence[str], box: Box) -> list[Mapping[str, Any]]:
        area = box_text(box)
        wanted = "".join(f"{selector}({area});" for selector in selectors)
        query = f"{settings_of_query(self._request.services)}({wanted});out tags center {MOST_SPOTS};"
        return [one for one in self._client.query(query).answer["elements"] if _has_position(one)]

    def _out_of_town(self, roads: list[Mapping[str, Any]], box: Box) -> list[Mapping[str, Any]]:
        """Return the roads away from the town's middle and without signs of a town; all roads if there are none."""
        roads = [road for road in roads if not _indicates_town(road["tags"])] or roads
        towns = [(_position(one), one["tags"].get("place")) for one in self._found([_SETTLEMENTS], box)]
        far = {"city": 3 * OUT_OF_TOWN_M, "town": 1.5 * OUT_OF_TOWN_M, "hamlet": 0.4 * OUT_OF_TOWN_M}
        apart = [
            road
            for road in roads
            if all(ground_distance_m(_position(road), town) > far.get(str(kind), OUT_OF_TOWN_M) for town, kind in towns)
        ]
        return apart or roads

    def _spots_of_hinted_roads(self, whole: Box) -> list[Spot]:
        """Return the positions of a settlement's roads that only the map can resolve.

        Raises:
            UnknownName: there is no such road.
        """
        middle = self._middle(whole)
        box = _bounded(widened(whole, _AROUND_MIDDLE_M["highway"]), middle)
        roads = self._place.roads if self._place is not None else ()
        for selector in (_MAIN_ROADS, _NAMED_ROADS):
            found = self._found([selector], box)
            for (words,) in roads:
                names = frozenset(roads_called(words, _facts_of_roads(found)))
                spots = [_position(one) for one in found if names & _names_of_road(one)]
                if spots:
                    return _nearest_first(spots, middle)
        raise UnknownName(
            f"no available map contains {roads[0][0]!r}, and OpenStreetMap has no such road in {self.name}",
            next_step="use a map's spelling, or another road",
            reason=NOT_SHOWN,
        )


def map_query(request: FetchMapRequest, core: Box) -> str:
    """Return the query for everything in a map: whole roads and paths, land use, settlements, turn restrictions."""
    area = box_text(widened(core, margin_m(request.scenario_type)))
    houses = f'way["building"]({area});node["building"]({area});' if request.scenario_type in _WITH_HOUSES else ""
    return (
        f"{settings_of_query(request.services)}"
        f'(way["highway"]({area});way["landuse"]({area});{houses})->.ways;'
        'rel["type"="restriction"](bw.ways)->.rules;'
        f"(.ways;.rules;node(w.ways);{_SETTLEMENTS}({area}););out body qt;"
    )


def margin_m(kind: ScenarioType) -> float:
    """Return the margin in metres around a core that makes the cut around a site at its edge complete."""
    return _MARGIN_M.get(kind, _USUAL_MARGIN_M)


def box_text(box: Box) -> str:
    """Return a box as Overpass expects it: south, west, north, east, to the nearest metre."""
    return ",".join(f"{value:.5f}" for value in box)


def widened(box: Box, by_m: float) -> Box:
    """Return a box extended by a number of metres on each side, on the globe."""
    south, west, north, east = box
    up = by_m / _METRES_A_DEGREE
    aside = up / max(math.cos(math.radians((south + north) / 2)), 0.05)
    return max(south - up, -90.0), max(west - aside, -180.0), min(north + up, 90.0), min(east + aside, 180.0)


def area_km2(box: Box) -> float:
    """Return the area of a box in km²."""
    south, west, north, east = box
    wide = (east - west) * math.cos(math.radians((south + north) / 2))
    return (north - south) * wide * (_METRES_A_DEGREE / 1000) ** 2


def _about_spot(spot: Spot, reach_m: float) -> Box:
    return widened((*spot, *spot), reach_m)


def _at_least(box: Box) -> Box:
    """Return the box, enlarged if necessary to have room for a site."""
    middle = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
    return _around_both(box, _about_spot(middle, LEAST_CORE_M))


def _around_both(one: Box, other: Box) -> Box:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _bounded(box: Box, middle: Spot) -> Box:
    """Return the part of a box that is searched: around ``middle``, at most ``MOST_SEARCHED_M`` wide and high."""
    around = _about_spot(middle, MOST_SEARCHED_M / 2)
    return max(box[0], around[0]), max(box[1], around[1]), min(box[2], around[2]), min(box[3], around[3])


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and one[2] > other[0] and one[1] < other[3] and one[3] > other[1]


def _is_in(spot: Spot, box: Box) -> bool:
    return box[0] <= spot[0] <= box[2] and box[1] <= spot[1] <= box[3]


def _nearest_first(spots: Iterable[Spot], middle: Spot) -> list[Spot]:
    return sorted(dict.fromkeys(spots), key=lambda spot: (round(ground_distance_m(spot, middle)), spot))


def _is_on(spot: Spot, lines: Sequence[Sequence[Spot]]) -> bool:
    """Return whether a point is approximately on one of the lines."""
    from shapely import LineString, Point

    narrow = math.cos(math.radians(spot[0]))
    point = Point(spot[1] * narrow, spot[0])
    return any(
        LineString([(lon * narrow, lat) for lat, lon in line]).distance(point) * _METRES_A_DEGREE < ON_ROAD_M
        for line in lines
        if len(line) > 1
    )


def _indicates_town(tags: Mapping[str, str]) -> bool:
    """Return whether a limit or a pavement indicates a town."""
    limit = tags.get("maxspeed", "").split(" ")[0]
    slow = limit.isdecimal() and int(limit) * (1.6 if "mph" in tags["maxspeed"] else 1.0) < _TOWN_LIMIT_KMH
    return slow or tags.get("sidewalk", "no") not in ("no", "none")


def _has_position(element: Mapping[str, Any]) -> bool:
    return "lat" in element or "center" in element


def _position(element: Mapping[str, Any]) -> Spot:
    at = element.get("center", element)
    return float(at["lat"]), float(at["lon"])


def _names_of_road(element: Mapping[str, Any]) -> frozenset[str]:
    tags = element.get("tags", {})
    refs = (part.strip() for part in tags.get("ref", "").split(";"))
    return frozenset(name for name in (tags.get("name", ""), *refs) if name)


def _facts_of_roads(found: Sequence[Mapping[str, Any]]) -> MapFacts:
    """Return the facts needed to resolve the name of a road."""
    names = sorted({name for one in found for name in _names_of_road(one)})
    return MapFacts(
        map_id="", file_name="", place="", places=(), country=None, south=0.0, west=0.0, north=0.0, east=0.0,
        streets=tuple(names), refs=tuple(names), sites={}, road_km=0.0, attribution="",
    )  # fmt: skip


def _sites_inside(path: Path, core: Box, request: FetchMapRequest) -> Mapping[SiteType, int]:
    """Return the number of sites of each type that the map has inside the core."""
    finder = SiteFinder(read_map_file(path), request.road_classes)
    kinds: tuple[SiteType, ...] = get_args(SiteType)
    found = {kind: sum(_is_in(site.position, core) for site in finder.find(kind)) for kind in kinds}
    inside: dict[SiteType, int] = {kind: count for kind, count in found.items() if count}
    longest = finder.longest_road() if not inside and request.scenario_type == "any" else None
    return {longest.kind: 1} if longest is not None and _is_in(longest.position, core) else inside


def _fetched(request: FetchMapRequest, path: Path, core: Box, query: str, answered: Answered[MapData]) -> FetchedMap:
    place = request.place
    name = _town_of(place) if place is not None else None
    country = (place.country if place is not None else None) or request.country
    facts = read_map(ReadMapRequest(path=str(path), place=name, country=country), silent)
    own = () if place is None or not place.is_settlement else (place.name, *place.names)  # a road is no place on it
    known = () if place is None else (*own, *place.around)
    places = tuple(dict.fromkeys((*facts.places[:1], *known, *facts.places)))[:MOST_PLACES]
    stamp = answered.answer.get("osm3s", {}).get("timestamp_osm_base", "")
    return FetchedMap(
        path=str(path),
        facts=facts.model_copy(update={"places": places}),
        core=core,
        query=query,
        service=answered.service,
        data_time=one_line(str(stamp)),
        kept=answered.kept,
    )


def _town_of(place: NamedPlace) -> str:
    """Return a name for the map of a place: its settlement's name if known, otherwise the place's own name."""
    return place.name if place.is_settlement or not place.around else place.around[0]


def _file_stem(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", latin(name.partition(",")[0])).strip("_")[:40] or "map"


def write_osm(elements: Sequence[Mapping[str, Any]], box: Box, path: Path) -> None:
    """Write the elements of Overpass's JSON as OpenStreetMap XML, each once, ordered by kind and id."""
    import osmium
    from osmium.osm import Box as Bounds
    from osmium.osm import Location, mutable

    south, west, north, east = box
    header = osmium.io.Header()
    header.add_box(Bounds(Location(west, south), Location(east, north)))
    unique = {(str(one["type"]), int(one["id"])): one for one in elements if "id" in one}
    with osmium.SimpleWriter(str(path), header=header, overwrite=True) as writer:
        for kind in ("node", "way", "relation"):
            for key in sorted(number for of_kind, number in unique if of_kind == kind):
                one = unique[kind, key]
                tags = {str(name): str(value) for name, value in one.get("tags", {}).items()}
                if kind == "node":
                    writer.add_node(mutable.Node(id=key, location=(float(one["lon"]), float(one["lat"])), tags=tags))
                elif kind == "way":
                    writer.add_way(mutable.Way(id=key, nodes=[int(node) for node in one.get("nodes", ())], tags=tags))
                else:
                    members = [
                        (str(m["type"])[0], int(m["ref"]), str(m.get("role", ""))) for m in one.get("members", ())
                    ]
                    writer.add_relation(mutable.Relation(id=key, members=members, tags=tags))
