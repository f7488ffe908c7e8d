"""Reads the facts of a map from its file: place, country, roads, sites.

A table of borders (Natural Earth 1:10m, public domain, simplified to about 2 km) determines the country. The table is
coarse, so near a border, where it could be wrong, the settlements of GeoNames decide, or nothing does.
"""

import gzip
import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.generation import MAP_FACTS_VERSION, MapFacts, ReadMapRequest
from ...schemas.maps import Box
from ...schemas.text import LONGEST_TEXT, one_line
from ..execution import ProgressReporter
from .map_file import read_map_file
from .naming.gazetteer import countries_on, country_of_nearest, settlement_around, settlements_called
from .naming.places import country_code
from .naming.shown import MOST_PLACES, areas_shown, places_shown
from .naming.tags import MOST_NAMES, names_of, refs_of
from .osm import OSM_ATTRIBUTION, OsmMap, ground_distance_m, length_m
from .site_search.finder import SiteFinder
from .unpacking import MAP_ENDINGS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from shapely import STRtree

_SAME_AREA_M = 25_000.0
"""Maximum distance of a settlement in GeoNames from the map that shows it (chosen)."""
MOST_STREETS = 10_000
"""Maximum number of street names, and of road numbers, in a map's facts, the longest roads first (chosen)."""


def read_map(request: ReadMapRequest, report: ProgressReporter) -> MapFacts:
    """Read a map file and return its facts.

    The place comes from the caller, or from places and addresses in the file. If they only name parts of a settlement,
    or nothing, it is the settlement that GeoNames has around the map. The country comes from the caller, from addresses
    (``addr:country``), or from the map's location and, near a border, the settlements there.

    Raises:
        UnsafeInput: the file is broken, hostile or not a map.
    """
    path = Path(request.path)
    report(0.0, "reading the map")
    osm = read_map_file(path)
    report(0.6, "looking for sites")
    return facts_of(osm, request)


def facts_of(osm: OsmMap, request: ReadMapRequest) -> MapFacts:
    """Return the facts of a map that was read from the request's file."""
    path = Path(request.path)
    given = one_line(request.place or osm.name)
    names = list(dict.fromkeys(([given] if given else []) + places_shown(osm)))
    roads = osm.roads()
    south, west, north, east = osm.bounds
    near = countries_near(osm.bounds)
    addressed = _countries_of_addresses(osm)
    country = request.country or osm.country or next(iter(addressed), None)
    country = country or _country_among(near, names, osm.bounds)
    names = names or _name_around(osm.bounds)
    return MapFacts(
        map_id=request.map_id or _map_id_of(path),
        file_name=_shown_name(path),
        place=names[0] if names else _shown_name(path).split(".")[0],
        places=tuple(names[:MOST_PLACES]),
        country=country,
        countries_near=_others_shown(country, near, (*addressed, *countries_on(osm.bounds))) if country else near,
        south=south,
        west=west,
        north=north,
        east=east,
        streets=(*_by_length(osm, "name"), *_junction_names(osm))[:MOST_STREETS],
        refs=_by_length(osm, "ref")[:MOST_STREETS],
        sites=SiteFinder(osm).kinds(),
        road_km=round(sum(length_m(osm, way) for way in roads) / 1000, 2),
        attribution=request.attribution or osm.attribution or OSM_ATTRIBUTION,
        road_names=_road_names(osm),
        areas=areas_shown(osm),
        facts_version=MAP_FACTS_VERSION,
    )


def _name_around(bounds: Box) -> list[str]:
    """Return the name of the settlement that a map without names is in, according to GeoNames; empty outside of all."""
    south, west, north, east = bounds
    around = settlement_around(((south + north) / 2, (west + east) / 2))
    return [] if around is None else [around.name]


def _shown_name(path: Path) -> str:
    """Return a file's name on one line, with its extensions, which state its format."""
    stem, ending = next(
        ((path.name[: -len(end)], path.name[-len(end) :]) for end in MAP_ENDINGS if path.name.lower().endswith(end)),
        (path.stem, path.suffix),
    )
    return one_line(stem, LONGEST_TEXT - len(ending)) + one_line(ending)


def _map_id_of(path: Path) -> str:
    """Return ``map_`` followed by the file's name in lower-case letters and digits."""
    return "map_" + (re.sub(r"[^a-z0-9]+", "_", path.name.split(".osm")[0].lower()).strip("_") or "unnamed")


def _road_names(osm: OsmMap) -> tuple[tuple[str, ...], ...]:
    """Return the names of roads and junctions that have several, main name first; lists are sorted by main name."""
    found: dict[str, dict[str, None]] = {}
    junctions = (node.tags for node in osm.nodes.values() if node.tags.get("highway") == "motorway_junction")
    for tags in (*(way.tags for way in osm.roads()), *junctions):
        main = tags.get("name", "").strip() or tags.get("ref", "").partition(";")[0].strip()
        own = {main, *(ref.strip() for ref in tags.get("ref", "").split(";"))}
        others = [name for name in (*names_of(tags), *refs_of(tags)) if name not in own]
        if main and others:
            found.setdefault(main, {}).update(dict.fromkeys(others))
    return tuple((main, *list(found[main])[:MOST_NAMES]) for main in sorted(found))[:MOST_STREETS]


def _countries_of_addresses(osm: OsmMap) -> tuple[str, ...]:
    """Return the countries of addresses as ISO 3166-1 alpha-3, that of most addresses first."""
    codes = Counter(
        code
        for tags in [*(node.tags for node in osm.nodes.values()), *(way.tags for way in osm.ways)]
        if tags.get("addr:country") and (code := country_code(tags["addr:country"]))
    )
    return tuple(sorted(codes, key=lambda code: (-codes[code], code)))


def _others_shown(country: str, near: tuple[str, ...], shown: Sequence[str]) -> tuple[str, ...]:
    """Return the countries on the other side of a border on the map: near it, with addresses or settlements on it."""
    return tuple(code for code in near if code != country and code in shown)


def _country_among(
    near: tuple[str, ...], names: Sequence[str], bounds: tuple[float, float, float, float]
) -> str | None:
    """Return the country of a map near the borders of these countries, or None if it is not certain.

    It is the country of the map's place, if GeoNames has it in only one of them within ``_SAME_AREA_M``. Otherwise it
    is the one with a settlement much nearer to the map's middle and corners than the settlements of the others.
    """
    if len(near) < 2:
        return near[0] if near else None
    south, west, north, east = bounds
    middle = (south + north) / 2, (west + east) / 2
    called = {
        one.country
        for one in settlements_called(names[0] if names else "")
        if ground_distance_m(middle, (one.latitude, one.longitude)) <= _SAME_AREA_M
    }
    if len(called) != 1:
        points = (middle, (south, west), (south, east), (north, west), (north, east))
        called = {country_of_nearest(point, near) or "" for point in points}
    country = called.pop()
    return country if not called and country in near else None


def country_at(osm: OsmMap, position: tuple[float, float], country: str | None) -> str | None:
    """Return the country (ISO 3166-1 alpha-3) at a latitude and longitude on a map with a main country.

    A country is certain if no other is near, or if both the border and the nearest settlements say so. Otherwise, and
    on a map that is not in its stated country, such as an invented one, it is the main country.
    """
    if country is not None and country not in countries_near(osm.bounds):
        return country
    near = countries_near((*position, *position))
    if len(near) < 2:
        return near[0] if near else country
    inside = _countries_over(position)
    return inside[0] if len(inside) == 1 and country_of_nearest(position, near) == inside[0] else country


def _countries_over(position: tuple[float, float]) -> list[str]:
    """Return the countries with areas that contain a latitude and longitude; several claim disputed areas."""
    from shapely import Point

    tree, codes = _table()
    return sorted({codes[index] for index in tree.query(Point(*position[::-1]), predicate="intersects").tolist()})


def _by_length(osm: OsmMap, key: str) -> tuple[str, ...]:
    """Return the values of a road tag, longest roads first; road numbers in a list count individually."""
    lengths: dict[str, float] = {}
    for way in osm.roads():
        values = way.tags.get(key, "").split(";") if key == "ref" else [way.tags.get(key, "")]
        for value in values:
            if value.strip():
                lengths[value.strip()] = lengths.get(value.strip(), 0.0) + length_m(osm, way)
    return tuple(sorted(lengths, key=lambda name: (-round(lengths[name], 3), name)))


def _junction_names(osm: OsmMap) -> tuple[str, ...]:
    """Return the names of motorway junctions."""
    nodes = (node for node in osm.nodes.values() if node.tags.get("highway") == "motorway_junction")
    return tuple(sorted({node.tags["name"] for node in nodes if node.tags.get("name")}))


BORDERS = Path(__file__).parent / "borders.json.gz"
UNITS_PER_DEG = 250
"""The table's grid: about 440 m."""
DOUBT_M = 6000.0
"""Maximum error of the table: its simplification, its grid and the scale of its source together."""


def countries_near(bounds: tuple[float, float, float, float]) -> tuple[str, ...]:
    """Return ISO 3166-1 alpha-3 codes of all countries within ``DOUBT_M`` of a box, sorted.

    The box is (south, west, north, east) in degrees. The result is empty at sea, and in areas that several countries
    claim. A map is in a country if no other country is near.
    """
    from shapely import box

    south, west, north, east = bounds
    up = DOUBT_M / ground_distance_m((0.0, 0.0), (1.0, 0.0))
    aside = up / max(math.cos(math.radians(max(abs(south), abs(north)))), 0.05)
    tree, codes = _table()
    near = tree.query(box(west - aside, south - up, east + aside, north + up), predicate="intersects")
    claimed_by = {codes[index] for index in near.tolist()}
    return () if "" in claimed_by else tuple(sorted(claimed_by))


@lru_cache(maxsize=1)
def _table() -> tuple["STRtree", tuple[str, ...]]:
    """Return a spatial tree of all areas, and the country code of each area."""
    from shapely import STRtree

    rows = json.loads(gzip.decompress(BORDERS.read_bytes()))
    listed = [(code, rings) for code, polygons in rows for rings in polygons]
    return STRtree(_areas([rings for _, rings in listed])), tuple(code for code, _ in listed)


def _areas(polygons: Sequence[Sequence[Sequence[int]]]) -> "NDArray[np.object_]":
    """Return the area inside the first ring of each polygon and outside the others; rings consist of steps (east,
    north) in units. All are built at once, since one after the other they need half a second.
    """
    import numpy as np
    import shapely

    lines = [np.array(steps).reshape(-1, 2).cumsum(axis=0) for rings in polygons for steps in rings]
    ring_of_point = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    polygon_of_ring = np.repeat(np.arange(len(polygons)), [len(rings) for rings in polygons])
    rings = shapely.linearrings(np.concatenate(lines) / UNITS_PER_DEG, indices=ring_of_point)
    areas: NDArray[np.object_] = shapely.polygons(rings, indices=polygon_of_ring)
    broken = ~shapely.is_valid(areas)
    areas[broken] = shapely.buffer(areas[broken], 0)
    return areas
