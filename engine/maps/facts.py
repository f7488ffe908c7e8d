"""What a map shows, read from the file itself."""

import gzip
import json
import math
import re
from collections import Counter
from functools import lru_cache
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.generation import MapFacts, ReadMapRequest
from ..execution import ProgressReporter
from .map_file import read_map_file
from .osm import OSM_ATTRIBUTION, OsmMap, distance_m, ground_distance_m
from .places import country_code, fold
from .road_classes import LINKS, ROADS
from .sites import SiteFinder

if TYPE_CHECKING:
    from shapely import Polygon, STRtree

# ---------- borders
# Which country a map lies in, from a table of borders: Natural Earth 1:10m, public domain, simplified to about 2 km.
#
# The table is coarse, so the answer is cautious: near a border, where it could be wrong, there is none.

TABLE = Path(__file__).parent / "borders.json.gz"
UNITS_PER_DEG = 250
DOUBT_M = 6000.0
"""The table may be off by so much: its simplification, its grid and the scale of its source together."""


def country_of(bounds: tuple[float, float, float, float]) -> str | None:
    """ISO 3166-1 alpha-3 code of the only country within ``DOUBT_M`` of a box (south, west, north, east) in degrees.

    None at sea, near a border, and in areas that several countries claim.
    """
    near = countries_near(bounds)
    return near[0] if len(near) == 1 else None


def countries_near(bounds: tuple[float, float, float, float]) -> tuple[str, ...]:
    """Codes of all countries within ``DOUBT_M`` of a box, sorted; none at sea and in areas that several claim."""
    from shapely import box

    south, west, north, east = bounds
    up = DOUBT_M / ground_distance_m((0.0, 0.0), (1.0, 0.0))
    aside = up / max(math.cos(math.radians(max(abs(south), abs(north)))), 0.05)
    tree, codes = _table()
    near = tree.query(box(west - aside, south - up, east + aside, north + up), predicate="intersects")
    found = {codes[index] for index in near.tolist()}
    return () if "" in found else tuple(sorted(found))


@lru_cache(maxsize=1)
def _table() -> tuple["STRtree", tuple[str, ...]]:
    """A tree of all areas with the code of each."""
    from shapely import STRtree

    rows = json.loads(gzip.decompress(TABLE.read_bytes()))
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


# ---------- facts
# What a map shows, read from the file itself.

PLACE_KINDS = ("city", "town", "village", "suburb", "borough", "quarter", "neighbourhood", "hamlet")
MOST_PLACES = 40


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
    found = _places(osm)
    names = list(dict.fromkeys(([request.place] if request.place else []) + found))
    roads = osm.roads(frozenset((*ROADS, *LINKS)))
    south, west, north, east = osm.bounds
    near = countries_near(osm.bounds)
    country = request.country or _country(osm) or (near[0] if len(near) == 1 else None)
    return MapFacts(
        map_id=request.map_id or _map_id_of(path),
        file_name=path.name,
        place=names[0] if names else path.name.split(".")[0],
        places=tuple(names[:MOST_PLACES]),
        country=country,
        countries_near=() if country else near,
        south=south,
        west=west,
        north=north,
        east=east,
        streets=(*_by_length(osm, "name"), *_junction_names(osm)),
        refs=_by_length(osm, "ref"),
        sites=SiteFinder(osm).kinds(),
        road_km=round(sum(_length_m(osm, way.node_ids) for way in roads) / 1000, 2),
        attribution=request.attribution or osm.attribution or OSM_ATTRIBUTION,
    )


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
    for way in osm.roads(frozenset((*ROADS, *LINKS))):
        values = way.tags.get(key, "").split(";") if key == "ref" else [way.tags.get(key, "")]
        for value in values:
            if value.strip():
                lengths[value.strip()] = lengths.get(value.strip(), 0.0) + _length_m(osm, way.node_ids)
    return tuple(sorted(lengths, key=lambda name: (-round(lengths[name], 3), name)))


def _junction_names(osm: OsmMap) -> tuple[str, ...]:
    """Names of motorway junctions."""
    nodes = (node for node in osm.nodes.values() if node.tags.get("highway") == "motorway_junction")
    return tuple(sorted({node.tags["name"] for node in nodes if node.tags.get("name")}))


def _length_m(osm: OsmMap, node_ids: tuple[int, ...]) -> float:
    nodes = [osm.nodes[key] for key in node_ids]
    return sum(distance_m(one, other) for one, other in pairwise(nodes))
