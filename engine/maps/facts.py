"""What a map shows, read from the file itself: place, country, roads, sites.

A country is told by a table of borders (Natural Earth 1:10m, public domain, simplified to about 2 km). The table is
coarse, so the answer is cautious: near a border, where it could be wrong, there is none.
"""

import gzip
import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.generation import MAP_FACTS_VERSION, MapFacts, PlaceArea, ReadMapRequest
from ...schemas.text import LONGEST_TEXT, one_line
from ..execution import ProgressReporter
from .map_file import read_map_file
from .osm import OSM_ATTRIBUTION, OsmMap, ground_distance_m, length_m
from .places import country_code, fold
from .site_search.finder import SiteFinder
from .spellings import road_keys, whole_road_keys
from .unpacking import MAP_ENDINGS

if TYPE_CHECKING:
    from shapely import Polygon, STRtree

PLACE_KINDS = ("city", "town", "village", "suburb", "borough", "quarter", "neighbourhood", "hamlet")
"""OSM's values of ``place`` for settlements and their parts, the larger first."""
MOST_PLACES = 40
"""Names of places that the facts of a map hold: those of a large city would fill a page (chosen)."""
MOST_STREETS = 10_000
"""Names of streets, and numbers of roads, that the facts of a map hold, those with most road first (chosen)."""
PART_RANKS = range(PLACE_KINDS.index("suburb"), PLACE_KINDS.index("hamlet"))
"""Kinds of parts of a settlement, which has its middle in one of them."""
NAME_KEYS = (
    "name",
    "int_name",
    "official_name",
    "alt_name",
    "short_name",
    "loc_name",
    "old_name",
    "nat_name",
    "reg_name",
)
"""OSM's tags for names; each may have a language after a colon (``name:ru``) and several names between semicolons."""
USUAL_RADIUS_M = {
    "city": 10_000.0,
    "town": 3000.0,
    "village": 1500.0,
    "suburb": 1500.0,
    "borough": 3000.0,
    "quarter": 1000.0,
    "neighbourhood": 700.0,
    "hamlet": 500.0,
}
"""How far a place without an outline reaches at most, by its kind (chosen)."""
LEAST_RADIUS_M = 400.0
"""A site needs room: the area of a place reaches at least as far (chosen)."""
MOST_NAMES = 400
"""Names of one place or road that are kept: a country has one in every language (chosen)."""
MOST_AREAS = 500
"""Places with their area that the facts of a map hold (chosen)."""
Position = tuple[float, float]


def read_map(request: ReadMapRequest, report: ProgressReporter) -> MapFacts:
    """Read an OpenStreetMap extract or a SUMO network and say what is in it; place and country are never guessed.

    A place is known from place nodes and addresses in the file, or from the caller; a country from the caller, from
    addresses (``addr:country``), or from where the map lies (``borders.py``).

    Raises:
        UnsafeInput: the file is broken, hostile or no map.
    """
    path = Path(request.path)
    report(0.0, "reading the map")
    osm = read_map_file(path)
    report(0.6, "looking for sites")
    return facts_of(osm, request)


def facts_of(osm: OsmMap, request: ReadMapRequest) -> MapFacts:
    """What a map shows that was read from the request's file."""
    path = Path(request.path)
    given = one_line(request.place or osm.name)
    names = list(dict.fromkeys(([given] if given else []) + _places(osm)))
    roads = osm.roads()
    south, west, north, east = osm.bounds
    near = countries_near(osm.bounds)
    country = request.country or osm.country or _country(osm) or (near[0] if len(near) == 1 else None)
    return MapFacts(
        map_id=request.map_id or _map_id_of(path),
        file_name=_shown_name(path),
        place=names[0] if names else _shown_name(path).split(".")[0],
        places=tuple(names[:MOST_PLACES]),
        country=country,
        countries_near=() if country else near,
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
        areas=_areas(osm),
        facts_version=MAP_FACTS_VERSION,
    )


def _shown_name(path: Path) -> str:
    """A file's name on one line, with its endings, which say what is in it."""
    stem, ending = next(
        ((path.name[: -len(end)], path.name[-len(end) :]) for end in MAP_ENDINGS if path.name.lower().endswith(end)),
        (path.stem, path.suffix),
    )
    return one_line(stem, LONGEST_TEXT - len(ending)) + one_line(ending)


def _map_id_of(path: Path) -> str:
    """``map_`` and the file's name in small letters and digits."""
    return "map_" + (re.sub(r"[^a-z0-9]+", "_", path.name.split(".osm")[0].lower()).strip("_") or "unnamed")


def _places(osm: OsmMap) -> list[str]:
    """Names of the places in the file: settlements by their rank, then the towns of addresses by their number."""
    ranked: list[tuple[int, str]] = []
    tagged = [node.tags for node in osm.nodes.values() if node.tags] + [way.tags for way in osm.ways]
    tagged += [relation.tags for relation in osm.relations]
    towns = Counter(tags["addr:city"] for tags in tagged if tags.get("addr:city"))
    for tags in tagged:
        if tags.get("place") in PLACE_KINDS:
            names = [tags.get("name"), tags.get("name:en"), tags.get("int_name")]
            ranked += [(PLACE_KINDS.index(tags["place"]), name) for name in names if name]
    nodes = [name for _, name in sorted(ranked, key=lambda entry: entry[0])]
    addresses = [town for town, _ in sorted(towns.items(), key=lambda entry: (-entry[1], entry[0]))]
    first_is_town = bool(ranked) and min(ranked)[0] <= PLACE_KINDS.index("village")
    merged = nodes + addresses if first_is_town or not addresses else addresses + nodes
    return list({fold(name): name for name in reversed(merged)}.values())[::-1]


def names_of(tags: Mapping[str, str]) -> list[str]:
    """All names that the tags give, the main one first, each once."""
    keys = [key for key in tags if key.partition(":")[0] in NAME_KEYS]
    keys.sort(key=lambda key: (NAME_KEYS.index(key.partition(":")[0]), key != "name:en", key))
    names = (name.strip() for key in keys for name in tags[key].split(";"))
    return list(dict.fromkeys(name for name in names if name))[:MOST_NAMES]


def keys_of_road(tags: Mapping[str, str]) -> frozenset[str]:
    """The keys of all names and numbers of a road; two spellings mean the same road where they share one."""
    names = [*names_of(tags), *(part.strip() for part in tags.get("ref", "").split(";") if part.strip())]
    return frozenset(key for name in names for key in (*road_keys(name), *whole_road_keys(name)))


def _road_names(osm: OsmMap) -> tuple[tuple[str, ...], ...]:
    """Names of roads and motorway junctions that have several: the main one, then the others, sorted by the main."""
    found: dict[str, dict[str, None]] = {}
    junctions = (node.tags for node in osm.nodes.values() if node.tags.get("highway") == "motorway_junction")
    for tags in (*(way.tags for way in osm.roads()), *junctions):
        main = tags.get("name", "").strip() or tags.get("ref", "").partition(";")[0].strip()
        others = [name for name in names_of(tags) if name != main]
        if main and others:
            found.setdefault(main, {}).update(dict.fromkeys(others))
    return tuple((main, *list(found[main])[:MOST_NAMES]) for main in sorted(found))[:MOST_STREETS]


def _areas(osm: OsmMap) -> tuple[PlaceArea, ...]:
    """Settlements and their parts with where they lie, the larger first.

    One that is a point and an outline is one place, where its point lies.
    """
    outlines: list[tuple[Mapping[str, str], Position, float | None]] = []
    outlines += [
        (node.tags, node.position, None) for node in osm.nodes.values() if node.tags.get("place") in PLACE_KINDS
    ]
    ways = {way.way_id: way for way in osm.ways}
    outlines += [
        (way.tags, *_middle_and_reach([osm.nodes[key].position for key in way.node_ids]))
        for way in osm.ways
        if way.tags.get("place") in PLACE_KINDS and way.node_ids[0] == way.node_ids[-1]
    ]
    for relation in osm.relations:
        if relation.tags.get("place") in PLACE_KINDS:
            lines = [ways[number] for kind, number, _ in relation.members if kind == "way" and number in ways]
            if points := [osm.nodes[key].position for line in lines for key in line.node_ids]:
                outlines.append((relation.tags, *_middle_and_reach(points)))
    return _merged(outlines)


def _middle_and_reach(points: list[Position]) -> tuple[Position, float]:
    south, north = min(p[0] for p in points), max(p[0] for p in points)
    west, east = min(p[1] for p in points), max(p[1] for p in points)
    middle = ((south + north) / 2, (west + east) / 2)
    return middle, max(ground_distance_m(middle, point) for point in points)


def _merged(outlines: list[tuple[Mapping[str, str], Position, float | None]]) -> tuple[PlaceArea, ...]:
    """One area a place; without an outline it reaches at most half way to the next place that is as large."""
    ranked = sorted((PLACE_KINDS.index(tags["place"]), index) for index, (tags, _, _) in enumerate(outlines))
    named = [(rank, *outlines[index], names) for rank, index in ranked if (names := names_of(outlines[index][0]))]
    keyed = [(rank, fold(names[0]), middle) for rank, _, middle, _, names in named[:MOST_AREAS]]
    merged: dict[str, PlaceArea] = {}
    for rank, tags, middle, reach, names in named[:MOST_AREAS]:
        key = fold(names[0])
        if key in merged:
            kept = merged[key]
            others = dict.fromkeys((*kept.other_names, *(name for name in names if name != kept.name)))
            merged[key] = kept.model_copy(update={"other_names": tuple(others)[:MOST_NAMES]})
            continue
        if reach is None:
            near = (
                ground_distance_m(middle, position) / 2
                for other_rank, other_key, position in keyed
                if other_rank <= rank and other_key != key and (other_rank in PART_RANKS) == (rank in PART_RANKS)
            )
            reach = min([USUAL_RADIUS_M[tags["place"]], *near])
        merged[key] = PlaceArea(
            name=names[0],
            kind=tags["place"],
            other_names=tuple(names[1:]),
            latitude=middle[0],
            longitude=middle[1],
            radius_m=round(max(reach, LEAST_RADIUS_M)),
        )
    return tuple(merged.values())


def _country(osm: OsmMap) -> str | None:
    """The country that most addresses name, as ISO 3166-1 alpha-3."""
    codes = Counter(
        code
        for tags in [*(node.tags for node in osm.nodes.values()), *(way.tags for way in osm.ways)]
        if tags.get("addr:country") and (code := country_code(tags["addr:country"]))
    )
    return min(codes, key=lambda code: (-codes[code], code)) if codes else None


def _by_length(osm: OsmMap, key: str) -> tuple[str, ...]:
    """Values of a road tag, those with most road first; road numbers of a list one by one."""
    lengths: dict[str, float] = {}
    for way in osm.roads():
        values = way.tags.get(key, "").split(";") if key == "ref" else [way.tags.get(key, "")]
        for value in values:
            if value.strip():
                lengths[value.strip()] = lengths.get(value.strip(), 0.0) + length_m(osm, way)
    return tuple(sorted(lengths, key=lambda name: (-round(lengths[name], 3), name)))


def _junction_names(osm: OsmMap) -> tuple[str, ...]:
    """Names of motorway junctions."""
    nodes = (node for node in osm.nodes.values() if node.tags.get("highway") == "motorway_junction")
    return tuple(sorted({node.tags["name"] for node in nodes if node.tags.get("name")}))


BORDERS = Path(__file__).parent / "borders.json.gz"
UNITS_PER_DEG = 250
"""The table's grid: about 440 m."""
DOUBT_M = 6000.0
"""How far off the table may be: its simplification, its grid and the scale of its source together."""


def countries_near(bounds: tuple[float, float, float, float]) -> tuple[str, ...]:
    """ISO 3166-1 alpha-3 codes of all countries within ``DOUBT_M`` of a box, sorted.

    The box is (south, west, north, east) in degrees. Empty at sea, and in areas that several countries claim. A map
    lies in a country if no other one is near.
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
    """A tree of all areas with the code of each."""
    from shapely import STRtree

    rows = json.loads(gzip.decompress(BORDERS.read_bytes()))
    areas = [(code, _polygon(rings)) for code, polygons in rows for rings in polygons]
    return STRtree([area for _, area in areas]), tuple(code for code, _ in areas)


def _polygon(rings: list[list[int]]) -> "Polygon":
    """The area inside the first ring and outside the others; a ring is steps (east, north) from (0, 0) in units."""
    from shapely import Polygon

    lines = [list(zip(_summed(steps[::2]), _summed(steps[1::2]), strict=True)) for steps in rings]
    area: Polygon = Polygon(lines[0], lines[1:])
    return area if area.is_valid else area.buffer(0)


def _summed(steps: list[int]) -> list[float]:
    return [units / UNITS_PER_DEG for units in accumulate(steps)]
