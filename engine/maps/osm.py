"""Reads OpenStreetMap extracts into plain values: nodes, roads, and data that helps to name and judge a place.

XML (.osm) is read element by element. The binary format (.osm.pbf) is first written as XML, limited to the roads, their
names and their surroundings. Positions are in degrees (WGS 84), distances in m on the ground (equirectangular, good for
the size of an extract).

The result is consistent: every node of a way exists, ids are unique, no way crosses the antimeridian, and every tag is
short and on one line. A file with invalid numbers is rejected.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

from lxml import etree

from ...schemas.errors import UnsafeInput
from ...schemas.generation import ConvertedMap, ConvertMapRequest
from ...schemas.text import LONGEST_TEXT, cited, one_line, shown_name
from ..commonroad import XmlLimits, scan_xml
from ..execution import ProgressReporter
from .ground import EARTH_RADIUS_M as EARTH_RADIUS_M
from .ground import HALF_TURN_DEG as HALF_TURN_DEG
from .ground import ground_distance_m as ground_distance_m
from .road_classes import ALL_ROADS
from .road_tags.access import closing_tag, in_words, is_for_cars
from .road_tags.limits import signed_kmh
from .unpacking import LARGEST_BYTES

LIMITS = XmlLimits(size_bytes=LARGEST_BYTES, depth=8, elements=4_000_000)
"""Limits for a worker's memory and time; an extract may be unpacked up to this size."""
OSM_ATTRIBUTION = "© OpenStreetMap contributors, ODbL"
SHOWN_CLASSES = 5
"""Maximum number of values of ``highway`` that a refusal lists."""
SOUTHMOST_DEG, NORTHMOST_DEG = -80.0, 84.0
"""Latitude limits of the projection in which networks are built (UTM). Nearer to a pole, nothing can be drawn in
metres, and there is no public road.
"""
LARGEST_ID = 2**63
"""OpenStreetMap's ids are whole numbers of 64 bits."""
MOST_EMPTY = 10.0
"""Maximum ratio of a declared box's longer side to that of the box around all nodes; beyond it, the box is ignored."""
NO_TAGS: Mapping[str, str] = MappingProxyType({})
"""Shared by all nodes without tags, which are most."""


@dataclass(frozen=True, slots=True)
class OsmNode:
    """A point of the map in degrees (WGS 84) with its tags."""

    node_id: int
    latitude: float
    longitude: float
    tags: Mapping[str, str]

    @property
    def position(self) -> tuple[float, float]:
        """The latitude and longitude in degrees."""
        return self.latitude, self.longitude


@dataclass(frozen=True)
class OsmWay:
    """A line through nodes of the extract, with its tags."""

    way_id: int
    node_ids: tuple[int, ...]
    tags: Mapping[str, str]

    @property
    def road_class(self) -> str:
        """The value of OSM's tag ``highway``; empty if the way is not a road."""
        return self.tags.get("highway", "")

    @property
    def maxspeed_kmh(self) -> float | None:
        """The signed limit in km/h; None if there is no sign or it is not a number."""
        return signed_kmh(self.tags)

    @cached_property
    def is_for_cars(self) -> bool:
        """Whether the way's access tags leave it open to cars in at least one direction."""
        return is_for_cars(self.tags)


@dataclass(frozen=True)
class OsmRelation:
    """A relation: (type, id, role) of every member, and its tags."""

    relation_id: int
    members: tuple[tuple[str, int, str], ...]
    tags: Mapping[str, str]


@dataclass(frozen=True)
class OsmMap:
    """An extract: all nodes by id, ways in the file's order, relations, and the bounds that its header declares.

    ``attribution`` is empty for OpenStreetMap's own data; a reader of another format must set it. ``name`` and
    ``country`` (ISO 3166-1 alpha-3) are set if the file states them.
    """

    nodes: dict[int, OsmNode]
    ways: tuple[OsmWay, ...]
    relations: tuple[OsmRelation, ...]
    declared_bounds: tuple[float, float, float, float] | None
    attribution: str = ""
    name: str = ""
    country: str | None = None

    def roads(self, classes: frozenset[str] = ALL_ROADS, *, cars_only: bool = True) -> list[OsmWay]:
        """Return ways with the given ``highway`` values; ``cars_only``: leave out those closed to cars."""
        return [way for way in self.ways if way.road_class in classes and (not cars_only or way.is_for_cars)]

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """The box (south, west, north, east) in degrees: as declared, or around all roads if that is not plausible."""
        declared = self.declared_bounds
        if declared is not None and _is_area(declared) and _fits(declared, self.nodes.values()):
            return declared
        used = [self.nodes[key] for way in self.roads() for key in way.node_ids]
        return _around(used or self.nodes.values())


def read_osm(path: Path, limits: XmlLimits = LIMITS) -> OsmMap:
    """Scan and read an extract; leave out references to nodes that it does not contain.

    Nodes without a position, or beyond ``SOUTHMOST_DEG`` and ``NORTHMOST_DEG``, are left out. If nodes or ways share an
    id, the last one is kept, except for a skeleton (Overpass's ``out skel``), which repeats an object without its tags.
    A way over the antimeridian is split there. The document is read element by element, so that only plain values stay
    in memory.

    Raises:
        UnsafeInput: the file is hostile, broken, too large, not OpenStreetMap XML, or has no road.
    """
    root_name = scan_xml(path, limits).name
    if root_name != "osm":
        raise UnsafeInput(
            f"{shown_name(path.name)} is not an OpenStreetMap extract: its root element is "
            f"<{shown_name(root_name)}>, not <osm>"
        )
    try:
        extract, beyond = _read(path)
    except KeyError as error:
        raise UnsafeInput(
            f"{shown_name(path.name)} is not readable as OpenStreetMap: something there has no {cited(error)}"
        ) from error
    except (etree.LxmlError, ValueError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as OpenStreetMap: {cited(error)}") from error
    if not extract.roads():
        if closed := extract.roads(cars_only=False):
            tags = in_words(dict.fromkeys(closing_tag(way.tags) for way in closed))
            raise UnsafeInput(
                f"{shown_name(path.name)} has no road that is open to cars: {len(closed)} are closed ({tags})",
                next_step="use an extract with open streets in it",
            )
        others = sorted({way.road_class for way in extract.ways if way.road_class})[:SHOWN_CLASSES]
        only = f", only {', '.join(others)}" if others else ""
        only += "; data beyond 80° S or 84° N, where map projections end, is not read" if beyond else ""
        raise UnsafeInput(
            f"{shown_name(path.name)} has no road for vehicles{only}", next_step="use an extract with streets in it"
        )
    return extract


def _read(path: Path) -> tuple[OsmMap, int]:
    """Return the extract, and the number of nodes that were left out because they are too close to a pole."""
    nodes: dict[int, OsmNode] = {}
    ways: dict[int, OsmWay] = {}
    relations: list[OsmRelation] = []
    bounds: tuple[float, float, float, float] | None = None
    with path.open("rb") as stream:
        document = etree.iterparse(
            stream, events=("end",), tag=("node", "way", "relation", "bounds"), resolve_entities=False, no_network=True
        )
        for _, element in document:
            if element.get("action") == "delete" or element.get("visible") == "false":
                pass  # an editor or the history keeps objects that were deleted from the map
            elif element.tag == "node":
                if "lat" in element.attrib and "lon" in element.attrib:  # deleted and unknown nodes have no position
                    node = _node(element)
                    if not (node.node_id in nodes and _is_skeleton(element, node.tags)):
                        nodes[node.node_id] = node
            elif element.tag == "way":
                way = _way(element)
                if not (way.way_id in ways and _is_skeleton(element, way.tags)):
                    ways[way.way_id] = way
            elif element.tag == "relation":
                relations.append(_relation(element))
            else:
                bounds = bounds or _bounds(element)
            _forget(element)
    beyond = [key for key, node in nodes.items() if not SOUTHMOST_DEG <= node.latitude <= NORTHMOST_DEG]
    for key in beyond:
        del nodes[key]
    whole = [replace(way, node_ids=tuple(key for key in way.node_ids if key in nodes)) for way in ways.values()]
    parted = _parted_at_antimeridian(whole, nodes)
    lines = tuple(way for way in parted if len(set(way.node_ids)) > 1 or _names_a_place(way))
    return OsmMap(nodes, lines, tuple(relations), bounds, _own_attribution(document.root)), len(beyond)


def _is_skeleton(element: Any, tags: Mapping[str, str]) -> bool:
    """Return True for an object without tags and version; an edited object in a history has a version."""
    return not tags and "version" not in element.attrib


def _names_a_place(way: OsmWay) -> bool:
    """Return whether a way outlines a place; a single corner in the extract gives its location."""
    return bool(way.node_ids) and "place" in way.tags and not way.road_class


def _parted_at_antimeridian(ways: list[OsmWay], nodes: Mapping[int, OsmNode]) -> list[OsmWay]:
    """Split ways at the antimeridian; further parts of a way have new ids.

    Longitudes jump by 360 degrees there, so measuring, cutting or drawing an unsplit way would go around the world.
    """
    new_ids = count(max((way.way_id for way in ways), default=0) + 1)
    parted: list[OsmWay] = []
    for way in ways:
        longitudes = [nodes[key].longitude for key in way.node_ids]
        jumps = [
            index
            for index, (one, other) in enumerate(pairwise(longitudes), start=1)
            if abs(other - one) > HALF_TURN_DEG
        ]
        for begin, end in pairwise([0, *jumps, len(longitudes)]):
            way_id = way.way_id if begin == 0 else next(new_ids)
            parted.append(replace(way, way_id=way_id, node_ids=way.node_ids[begin:end]) if jumps else way)
    return parted


def _forget(element: Any) -> None:
    """Free the memory of what has been read: the element's content and all elements before it."""
    element.clear()
    while element.getprevious() is not None:
        del element.getparent()[0]


def length_m(osm: OsmMap, way: OsmWay) -> float:
    """Return the length of a way in m."""
    return sum(
        ground_distance_m(one, other) for one, other in pairwise(osm.nodes[key].position for key in way.node_ids)
    )


def append_object(
    root: etree._Element,
    kind: str,
    number: int,
    tags: Mapping[str, str],
    attributes: Mapping[str, str] = NO_TAGS,
    parts: Iterable[tuple[str, dict[str, str]]] = (),
) -> None:
    """Append a node, way or relation to a document: its ``parts`` (element and attributes) before its tags."""
    named = {"id": str(number), **attributes, "visible": "true", "version": "1"}
    element = etree.SubElement(root, kind, named)
    for part, values in (*parts, *(("tag", {"k": key, "v": value}) for key, value in sorted(tags.items()))):
        etree.SubElement(element, part, values)


def append_node(root: etree._Element, node: OsmNode) -> None:
    """Append a node to a document, its position to 7 decimals: about a centimetre."""
    position = {"lat": f"{node.latitude:.7f}", "lon": f"{node.longitude:.7f}"}
    append_object(root, "node", node.node_id, node.tags, position)


def _is_area(bounds: tuple[float, float, float, float]) -> bool:
    south, west, north, east = bounds
    return -90 <= south < north <= 90 and -180 <= west < east <= 180


def _around(nodes: Collection[OsmNode]) -> tuple[float, float, float, float]:
    latitudes, longitudes = [node.latitude for node in nodes], [node.longitude for node in nodes]
    return min(latitudes), min(longitudes), max(latitudes), max(longitudes)


def _fits(declared: tuple[float, float, float, float], nodes: Collection[OsmNode]) -> bool:
    """Return whether a declared box is plausible for the file's content; some tools declare the whole world."""

    def longer_side(south: float, west: float, north: float, east: float) -> float:
        return max(north - south, east - west)

    return not nodes or longer_side(*declared) <= MOST_EMPTY * longer_side(*_around(nodes))


def _tags(element: Any) -> Mapping[str, str]:
    if not len(element):
        return NO_TAGS
    return {tag_text(tag.get("k", "")): tag_text(tag.get("v", "")) for tag in element.iterfind("tag")}


def tag_text(text: str) -> str:
    """Return a tag's text unchanged if it is short and on one line, otherwise shortened for answers and files."""
    return text if len(text) <= LONGEST_TEXT and text.isprintable() else one_line(text)


def _node(element: Any) -> OsmNode:
    latitude, longitude = float(element.attrib["lat"]), float(element.attrib["lon"])
    if not (-90 <= latitude <= 90 and -HALF_TURN_DEG <= longitude <= HALF_TURN_DEG):
        raise ValueError(f"node {element.get('id')} is at {latitude}, {longitude}")
    return OsmNode(_id(element), latitude, longitude, _tags(element))


def _way(element: Any) -> OsmWay:
    references = tuple(int(member.attrib["ref"]) for member in element.iterfind("nd"))
    return OsmWay(_id(element), references, _tags(element))


def _relation(element: Any) -> OsmRelation:
    members = tuple((m.get("type", ""), int(m.get("ref", "0")), m.get("role", "")) for m in element.iterfind("member"))
    return OsmRelation(_id(element), members, _tags(element))


def _id(element: Any) -> int:
    number = int(element.attrib["id"])
    if abs(number) >= LARGEST_ID:
        raise ValueError(f"the id of a {element.tag} has more than 64 bits")
    return number


def _bounds(element: Any) -> tuple[float, float, float, float]:
    south, west, north, east = (float(element.attrib[key]) for key in ("minlat", "minlon", "maxlat", "maxlon"))
    return south, west, north, east


def _own_attribution(root: Any) -> str:
    """Return the attribution of a map that PlannerForge drew; all other files are OpenStreetMap's."""
    return one_line(str(root.get("attribution", ""))) if root.get("generator") == "PlannerForge" else ""


KEPT_KEYS = (
    "highway",
    "junction",
    "restriction",
    "place",
    "landuse",
    "building",
    "shop",
    "addr:housenumber",
    "addr:city",
    "addr:country",
)
"""Objects with any of these tags are kept, and the nodes of such ways: sites are found, judged and named by them."""


def write_as_xml(request: ConvertMapRequest, report: ProgressReporter) -> ConvertedMap:
    """Write a binary extract as XML into a folder, unless it exceeds the limits for one reading.

    Raises:
        UnsafeInput: the file is broken.
    """
    import osmium

    path = Path(request.path)
    target = Path(request.folder) / path.stem
    report(0.1, "unpacking the map")
    try:
        # Read once first: if reading fails, osmium's writer silently leaves half a map.
        if sum(1 for _ in _kept_objects(path)) > LIMITS.elements:
            return ConvertedMap(path="", too_large=True)
        with osmium.BackReferenceWriter(str(target), ref_src=str(path), overwrite=True) as writer:
            for element in _kept_objects(path):
                writer.add(element)
    except (RuntimeError, ValueError) as error:  # all that osmium raises for a broken file
        raise UnsafeInput(
            f"{shown_name(path.name)} cannot be unpacked: {cited(error)}",
            next_step="get the extract again, or convert it to .osm",
        ) from error
    if target.stat().st_size > LIMITS.size_bytes:
        target.unlink()
        return ConvertedMap(path="", too_large=True)
    return ConvertedMap(path=str(target))


def _kept_objects(path: Path) -> Iterable[Any]:
    import osmium

    kept: Iterable[Any] = osmium.FileProcessor(str(path)).with_filter(osmium.filter.KeyFilter(*KEPT_KEYS))
    return kept
