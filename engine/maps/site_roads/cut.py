"""Cuts a few hundred metres around a site out of a map, as an extract of its own.

Roads of an OpenStreetMap extract are followed to the circle and end on it, so that the inside is complete; everything
else is left out. Roads of a user's SUMO network are kept whole and unchanged.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from lxml import etree

from ....schemas.errors import NotPossible
from ...network import run_netconvert
from ..foreign.net_map import NetMap
from ..osm import HALF_TURN_DEG, OsmMap, OsmNode, OsmWay, append_node, append_object, ground_distance_m
from ..road_tags.access import barrier_of
from .pavements import Pavements
from .road_reader import RoadReader

MOST_ARMS = 32
"""Maximum roads at one junction (chosen): SUMO's take 256 connections; netconvert's time grows with their square."""
MOST_NODES = 20_000
"""Maximum nodes of a cut (chosen): a site in the densest town has a tenth; netconvert then takes seconds."""
MOST_LANES, WIDEST_M, FASTEST = 32, 100.0, 1000.0
"""Larger numbers in tags are withheld from netconvert (chosen): it would build them."""
BARRIER_GAP_M = 1.0
"""Gap between the end of a road and its barrier (chosen)."""
LONGEST_NUMBER = 12
"""Maximum digits of a number in a tag; longer ones count as too large (chosen)."""
BOUNDED_TAGS: Mapping[str, float] = {"lanes": MOST_LANES, "width": WIDEST_M, "est_width": WIDEST_M, "maxspeed": FASTEST}


@dataclass(frozen=True)
class _Piece:
    """A part of a way inside the circle: its nodes in order, with new nodes on the circle."""

    way: OsmWay
    nodes: tuple[OsmNode, ...]


def cut_map(
    osm: OsmMap,
    center: tuple[float, float],
    radius_m: float,
    classes: Iterable[str],
    target: Path,
    pavements: Pavements | None = None,
    reader: RoadReader | None = None,
) -> tuple[OsmWay, ...]:
    """Write the roads of the given classes within a circle around (latitude, longitude) as an .osm file.

    A turn restriction is kept if all its nodes and exactly one piece of each of its ways are written. ``pavements``
    replace the pavements in the tags. ``reader`` rewrites the tags for netconvert and leaves out roads that are not for
    vehicles; the types of road that it needs go into a ``.typ.xml`` file next to the target.

    Returns:
        The ways that were written (parts of a way count once).

    Raises:
        NotPossible: there are too many roads in total, or too many at one node to build a junction.
    """
    new_nodes = count(max(osm.nodes, default=0) + 1)
    new_ways = count(max((way.way_id for way in osm.ways), default=0) + 1)
    roads = osm.roads(frozenset(classes), cars_only=False)
    pieces = [piece for way in roads for piece in _pieces(osm, way, center, radius_m, new_nodes)]
    if reader is not None:
        pieces = [part for piece in pieces for part in _between_barriers(piece, new_nodes, reader)]
    _refuse_crowds(pieces, center)
    root = etree.Element("osm", {"version": "0.6", "generator": "PlannerForge"})
    written = [(piece, _written_tags(piece, pavements, reader)) for piece in pieces]
    if reader is not None:
        reader.write_types(target.with_suffix(".typ.xml"))
    nodes = {node.node_id: node for piece, tags in written if tags is not None for node in piece.nodes}
    for key in sorted(nodes):
        node = nodes[key]
        append_node(root, node if pavements is None else replace(node, tags=pavements.tags_of_node(node)))
    used: set[int] = set()
    whole: set[int] = set()
    for piece, tags in written:
        if tags is None:
            continue
        way_id = piece.way.way_id if piece.way.way_id not in used else next(new_ways)
        (whole.discard if piece.way.way_id in used else whole.add)(piece.way.way_id)
        used.add(piece.way.way_id)
        # netconvert offsets a road that runs against its nodes, but centres one that follows them.
        is_against = reader is not None and tags.get("oneway") == "-1"
        references = [("nd", {"ref": str(node.node_id)}) for node in piece.nodes[:: -1 if is_against else 1]]
        append_object(root, "way", way_id, _turned(tags) if is_against else tags, parts=references)
    _write_restrictions(root, osm, nodes, whole)
    target.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    return tuple({piece.way.way_id: piece.way for piece, tags in written if tags is not None}.values())


def _turned(tags: Mapping[str, str]) -> dict[str, str]:
    """Return the tags of a road after its nodes were written in reverse order."""
    swapped = {"forward": "backward", "backward": "forward", "left": "right", "right": "left"}

    def word(text: str) -> str:
        return swapped.get(text, text)

    turned = {":".join(map(word, key.split(":"))): value for key, value in tags.items()}
    turned |= {key: word(value) for key, value in turned.items() if key.partition(":")[0] in _SIDED}
    return turned | {"oneway": "yes"}


_SIDED = frozenset({"sidewalk", "cycleway", "footway", "shoulder"})
"""Keys with a side of the road as value (https://wiki.openstreetmap.org/wiki/Forward_%26_backward,_left_%26_right)."""


def _written_tags(piece: _Piece, pavements: Pavements | None, reader: RoadReader | None) -> dict[str, str] | None:
    """Return the tags for writing a piece of a way, or None if it is not a road for vehicles."""
    tags = piece.way.tags if pavements is None else pavements.tags_of(piece.way)
    read = tags if reader is None else reader.tags_of(piece.way, piece.nodes, tags)
    return None if read is None else _buildable(read)


def _between_barriers(piece: _Piece, new_nodes: Iterator[int], reader: RoadReader) -> Iterator[_Piece]:
    """Yield the parts of a piece between barriers that stop cars; each part ends a little before the barrier.

    Roads that meet at a barrier end there separately.
    """
    tags = [barrier_of(node.tags) if node.tags else "" for node in piece.nodes]
    if not any(tags):
        yield piece
        return
    for tag in filter(None, tags):
        reader.blocked(tag)
    stops = [index for index, tag in enumerate(tags) if tag]
    begins, ends = [0, *stops], [*stops, len(tags) - 1]
    for begin, end in zip(begins, ends, strict=True):
        nodes = list(piece.nodes[begin : end + 1])
        if len(nodes) < 2:
            continue
        if tags[begin]:
            nodes[0] = _before(nodes[1], nodes[0], next(new_nodes))
        if tags[end]:
            nodes[-1] = _before(nodes[-2], nodes[-1], next(new_nodes))
        yield _Piece(piece.way, tuple(nodes))


def _before(start: OsmNode, end: OsmNode, node_id: int) -> OsmNode:
    """Return a new node ``BARRIER_GAP_M`` before a segment's end, since netconvert joins nodes at one position."""
    length = ground_distance_m(start.position, end.position)
    share = 1.0 - min(BARRIER_GAP_M / length, 0.4) if length > 0 else 0.5
    latitude = start.latitude + share * (end.latitude - start.latitude)
    longitude = start.longitude + share * (end.longitude - start.longitude)
    return OsmNode(node_id, round(latitude, 7), round(longitude, 7), {})


def _refuse_crowds(pieces: Sequence[_Piece], center: tuple[float, float]) -> None:
    where = f"at {center[0]:.5f}, {center[1]:.5f}"
    if (size := sum(len(piece.nodes) for piece in pieces)) > MOST_NODES:
        raise NotPossible(
            f"the roads {where} have {size:,} nodes; a site has at most {MOST_NODES:,}",
            next_step="choose another place",
        )
    arms = Counter(node.node_id for piece in pieces for node in (*piece.nodes, *piece.nodes[1:-1]))
    if (most := max(arms.values(), default=0)) > MOST_ARMS:
        raise NotPossible(
            f"{most:,} roads meet {where}; a junction has at most {MOST_ARMS}", next_step="choose another place"
        )


def _buildable(tags: Mapping[str, str]) -> dict[str, str]:
    """Remove tags that request more lanes, width or speed than any road has."""
    return {key: value for key, value in tags.items() if not _is_beyond(key, value)}


def _is_beyond(key: str, value: str) -> bool:
    if value.count("|") >= MOST_LANES:
        return True
    most = BOUNDED_TAGS.get(key.partition(":")[0])
    numbers = [] if most is None else re.findall(r"\d+(?:\.\d*)?(?:e\d+)?", value.lower())
    return most is not None and any(len(number) > LONGEST_NUMBER or float(number) > most for number in numbers)


def _pieces(
    osm: OsmMap, way: OsmWay, center: tuple[float, float], radius_m: float, new_nodes: Iterator[int]
) -> list[_Piece]:
    """Return the parts of a way inside the circle, with new nodes where it crosses the circle."""
    nodes = [osm.nodes[key] for key in way.node_ids]
    parts: list[list[OsmNode]] = []
    current: list[OsmNode] = []
    for index, node in enumerate(nodes):
        inside = ground_distance_m(node.position, center) <= radius_m
        if index > 0:
            cuts = _on_circle(nodes[index - 1], node, center, radius_m)
            current.extend(OsmNode(next(new_nodes), *point, {}) for point in cuts)
            if current and not inside:
                parts.append(current)
                current = []
        if inside:
            current.append(node)
    parts.append(current)
    return [_Piece(way, tuple(piece)) for piece in parts if len(piece) > 1]


def _on_circle(start: OsmNode, end: OsmNode, center: tuple[float, float], radius_m: float) -> list[tuple[float, float]]:
    """Return the points (latitude, longitude) where a straight segment crosses the circle, in order from ``start``."""
    scale, scale_east = _metres_per_degree(center)
    y = (start.latitude - center[0]) * scale
    x = math.remainder(start.longitude - center[1], 2 * HALF_TURN_DEG) * scale_east
    dy, dx = (end.latitude - start.latitude) * scale, (end.longitude - start.longitude) * scale_east
    a, b, c = dx * dx + dy * dy, 2 * (x * dx + y * dy), x * x + y * y - radius_m * radius_m
    inner = b * b - 4 * a * c
    if a < 1e-9 or inner <= 0:
        return []
    shares = ((-b - inner**0.5) / (2 * a), (-b + inner**0.5) / (2 * a))
    north, east = end.latitude - start.latitude, end.longitude - start.longitude
    inside = [share for share in shares if 0 < share < 1]
    return [(round(start.latitude + t * north, 7), round(start.longitude + t * east, 7)) for t in inside]


def _write_restrictions(root: etree._Element, osm: OsmMap, nodes: dict[int, OsmNode], ways: set[int]) -> None:
    for relation in osm.relations:
        known = all(key in (ways if kind == "way" else nodes) for kind, key, _ in relation.members)
        if relation.tags.get("type") == "restriction" and known and relation.members:
            members = [
                ("member", {"type": kind, "ref": str(member), "role": role}) for kind, member, role in relation.members
            ]
            append_object(root, "relation", relation.relation_id, relation.tags, parts=members)


def cut_net(
    net: NetMap,
    center: tuple[float, float],
    radius_m: float,
    classes: Iterable[str],
    target: Path,
    scratch: Path,
    *,
    pavements: bool = False,
) -> tuple[str, ...]:
    """Write the roads of the given classes within a circle around (latitude, longitude); return the warnings.

    Coordinates, junctions and traffic lights are those of the whole network. ``pavements``: True to add pavements to
    slow roads that have none, and crossings to junctions.

    Raises:
        NotPossible: there is no such road, there are too many of them, or netconvert rejects the network.
    """
    near = [way for way in net.roads(frozenset(classes)) if _distance_m(net, way, center) <= radius_m]
    if not near:
        raise NotPossible("no road here is in the requested road_classes", next_step="leave road_classes out")
    _refuse_crowds([_Piece(way, tuple(net.nodes[key] for key in way.node_ids)) for way in near], center)
    kept = scratch / "kept_edges.txt"
    kept.write_text("".join(f"{edge}\n" for way in near for edge in net.edges[way.way_id]), encoding="utf-8")
    options = ["--sumo-net-file", str(net.path), "--keep-edges.input-file", str(kept)]
    if pavements:
        options += ["--sidewalks.guess", "true", "--crossings.guess", "true"]
    return run_netconvert([*options, "--offset.disable-normalization", "true"], target)


def _distance_m(net: NetMap, way: OsmWay, center: tuple[float, float]) -> float:
    """Return the distance of a road from a point (equirectangular, good for the size of a site)."""
    from shapely import LineString, Point

    scale, scale_east = _metres_per_degree(center)
    nodes = [net.nodes[key] for key in way.node_ids]
    eastwards = [math.remainder(node.longitude - center[1], 2 * HALF_TURN_DEG) for node in nodes]
    line = [
        (east * scale_east, (node.latitude - center[0]) * scale) for east, node in zip(eastwards, nodes, strict=True)
    ]
    return float(LineString(line).distance(Point(0.0, 0.0)))


def _metres_per_degree(center: tuple[float, float]) -> tuple[float, float]:
    """Return metres per degree northwards and eastwards at (latitude, longitude)."""
    north = ground_distance_m(center, (center[0] + 1e-3, center[1])) / 1e-3
    return north, ground_distance_m(center, (center[0], center[1] + 1e-3)) / 1e-3
