"""Cuts a part out of an extract as an ordinary map: finds it by name, reads its tiles, writes it as .osm.

The same request gives the same bytes. A part is as wide as the requested place, but at most a few kilometres, so that
its map can be searched in a second.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lxml import etree

from ....schemas.generation import CutExtractRequest, CutOfExtract, PlaceArea, ReadMapRequest
from ....schemas.maps import Box
from ....schemas.text import LONGEST_TEXT
from ...execution import ProgressReporter
from ..facts import facts_of
from ..index import file_stem, place_parts, without_frame
from ..naming.gazetteer import names_elsewhere
from ..naming.places import fold, place_keys
from ..naming.spellings import MOST_KEPT, road_keys, whole_road_keys
from ..naming.tags import keys_of_road
from ..osm import OsmMap, append_node, append_object, ground_distance_m
from .tiles import TileStore, box_of_tile, index_failures, tiles_in

SIDES_M = (5_000.0, 3_500.0, 2_500.0, 1_800.0)
"""Side lengths of the cut square: the first with no more nodes than ``MOST_NODES``, or the last (chosen)."""
MOST_NODES = 40_000
"""A map with this many nodes is read and searched in a second or two (measured)."""
MARGIN_M = 900.0
"""Margin around the requested place: the widest site needs 450 m, and a recording of 120 s twice that."""
NEAR_PLACE_M = 1_000.0
"""Margin around a place in which a street of it is searched (chosen): its outskirts belong to it."""
_MOST_TILES, _AT_SITE_M = 6, 60.0
"""Maximum number of tiles with a street that are examined, and maximum distance from a street to its site (chosen)."""
_STRIDE = 7919
"""A prime by which seeds step through the candidates, so that neighbouring seeds are far apart."""
_DECIMALS = 4
"""Precision of boxes in degrees: about 10 m, so that the same place gives the same box however it was computed."""
Position = tuple[float, float]


@dataclass(frozen=True)
class _Target:
    """The centre of the requested place, its reach, its label, and the text that refers to something in it.

    ``sites``: positions to use instead if the place is too large to be cut out as a whole.
    """

    middle: Position
    reach_m: float
    label: str
    words: str
    place: str | None
    sites: Sequence[Position] = ()


def cut_extract(request: CutExtractRequest, report: ProgressReporter) -> CutOfExtract:
    """Write the part of an extract that a request refers to as a map file; the path is empty if there is no such part.

    Raises:
        ResourceFailure: the index cannot be read.
    """
    index = Path(request.index)
    with index_failures(index), closing(TileStore(index)) as store:
        report(0.0, "looking up the place in the extract")
        chosen = _resolve_target(request, store)
        if chosen is None:
            return CutOfExtract()
        core = _core(chosen, request.seed, store)
        report(0.3, "cutting out the part")
        part = store.read(_widened(core, MARGIN_M))
    if not part.roads():
        return CutOfExtract()
    target = Path(request.folder) / "cut.osm"
    _write(part, target)
    known = ReadMapRequest(path=str(target), place=chosen.place or request.facts.place, country=request.facts.country)
    facts = facts_of(part, known).model_copy(
        update={"cut_of": request.facts.map_id, "file_name": request.facts.file_name}
    )
    return CutOfExtract(path=str(target), facts=facts, core=core, label=chosen.label, words=chosen.words)


def _resolve_target(request: CutExtractRequest, store: TileStore) -> _Target | None:
    """Resolve the text or the box in the extract; return None if it contains no such place."""
    parts = place_parts((request.place or "")[:LONGEST_TEXT])
    facts = request.facts
    own = {facts.map_id, facts.place, facts.file_name, file_stem(facts.file_name), facts.country or ""}
    others = [part for part in parts if fold(part) not in {fold(name) for name in own}]
    if not others:
        return _anywhere(request, store)
    roads: list[str] = []
    known: list[PlaceArea] = []
    for part in others:
        place = _place_called(part, known, store)
        known += [] if place is None else [place]
        roads += [part] if place is None else []
    area = min(known, key=lambda place: place.radius_m, default=None)
    if not roads and area is not None:
        return _at_place(area, request, store)
    return _at_roads(roads, area, request, store)


def _place_called(part: str, others: Sequence[PlaceArea], store: TileStore) -> PlaceArea | None:
    """Return the largest place with a name, or the place nearest to a second place in the text."""
    bodies = store.places_called(place_keys(part) | place_keys(without_frame(part)))
    bodies = bodies or store.places_called(names_elsewhere(without_frame(part)))
    places = [PlaceArea.model_validate_json(body) for body in bodies]
    if others:
        middle = others[0].latitude, others[0].longitude
        places.sort(key=lambda place: ground_distance_m(middle, (place.latitude, place.longitude)))
    return places[0] if places else None


def _at_place(area: PlaceArea, request: CutExtractRequest, store: TileStore) -> _Target:
    middle = area.latitude, area.longitude
    sites = _sites_in(_square(middle, 2 * area.radius_m), request, store)
    return _Target(middle, area.radius_m, f"{area.kind} {area.name}", "", area.name, sites)


def _anywhere(request: CutExtractRequest, store: TileStore) -> _Target | None:
    """Return the surroundings of a site of the type, in the box or anywhere, chosen by the seed."""
    sites = _sites_in(request.bbox, request, store)
    if not sites:
        return None
    middle = sites[request.seed * _STRIDE % len(sites)]
    return _Target(middle, math.inf, f"around {middle[0]:.4f}, {middle[1]:.4f}", "", None)


def _sites_in(box: Box | None, request: CutExtractRequest, store: TileStore) -> list[Position]:
    """Return the sites of the type in both a box and the request's box, or sites of any type if there are none."""
    boxes = [each for each in (box, request.bbox) if each is not None]
    tiles = None if not boxes else tiles_in(boxes[0])
    for kind in dict.fromkeys((request.scenario_type, "any")):
        sites = store.sites(kind, tiles)
        if inside := [site for site in sites if all(_is_in(site, each) for each in boxes)]:
            return inside
    return []


def _at_roads(
    roads: Sequence[str], area: PlaceArea | None, request: CutExtractRequest, store: TileStore
) -> _Target | None:
    """Return the surroundings of a node of the road or of an intersection of the roads.

    If possible, a site of the type is nearby.

    The search covers tiles outwards from the centre of the place, or from a tile that the seed chooses.
    """
    box = request.bbox if area is None else _square((area.latitude, area.longitude), 2 * (area.radius_m + NEAR_PLACE_M))
    tiles = _with_all_roads(roads, box, store)
    if area is not None:
        tiles.sort(key=lambda tile: (ground_distance_m(_middle(tile), (area.latitude, area.longitude)), tile))
    elif tiles:
        turn = request.seed * _STRIDE % len(tiles)
        tiles = [*tiles[turn:], *tiles[:turn]]
    found: list[tuple[float, int, Position]] = []
    for turn, tile in enumerate(tiles[:_MOST_TILES]):
        spots = _spots(roads, tile, box, store)
        sites = _sites_in(box_of_tile(tile), request, store)
        off_m = [min((ground_distance_m(spot, site) for site in sites), default=math.inf) for spot in spots]
        found += sorted(zip(off_m, [turn] * len(spots), spots, strict=True))[:1]
        if found and found[-1][0] <= _AT_SITE_M:
            break
    if not found:
        return None
    _, _, spot = min(found)
    words = ", ".join(roads)
    if area is None:
        return _Target(spot, math.inf, words, words, None)
    return _Target(spot, math.inf, f"{words} in {area.kind} {area.name}", words, area.name)


def _spots(roads: Sequence[str], tile: int, box: Box | None, store: TileStore) -> list[Position]:
    """Return the positions in a tile and a box at which the roads meet; all their nodes if there is one road or no
    meeting.
    """
    inside = box_of_tile(tile)
    osm = store.read(inside)
    lines = [_nodes_of(road, osm) for road in roads]
    meeting = set.intersection(*lines) or lines[0]
    spots = sorted(osm.nodes[key].position for key in meeting)
    return [spot for spot in spots if _is_in(spot, inside) and (box is None or _is_in(spot, box))]


def _nodes_of(road: str, osm: OsmMap) -> set[int]:
    wanted = _keys_of(road)
    return {key for way in osm.roads() if not wanted.isdisjoint(keys_of_road(way.tags)) for key in way.node_ids}


@lru_cache(maxsize=MOST_KEPT)
def _keys_of(road: str) -> frozenset[str]:
    return frozenset((*road_keys(road), *whole_road_keys(road)))


def _with_all_roads(roads: Sequence[str], box: Box | None, store: TileStore) -> list[int]:
    """Return the tiles (in a box if given) that have a road of each name."""
    found: set[int] | None = None if box is None else set(tiles_in(box))
    for road in roads:
        tiles = set(store.tiles_with_road(_keys_of(road)))
        found = tiles if found is None else found & tiles
    return sorted(found or ())


def _core(chosen: _Target, seed: int, store: TileStore) -> Box:
    """Return the largest allowed square around the requested place or, if the place is too large, one of its sites."""
    core = _square(chosen.middle, min(SIDES_M[0], 2 * chosen.reach_m))
    is_whole = 2 * chosen.reach_m <= SIDES_M[0] and store.node_count_within(_widened(core, MARGIN_M)) <= MOST_NODES
    middle = chosen.middle if is_whole or not chosen.sites else chosen.sites[seed * _STRIDE % len(chosen.sites)]
    for side_m in SIDES_M:
        core = _square(middle, min(side_m, 2 * chosen.reach_m))
        if store.node_count_within(_widened(core, MARGIN_M)) <= MOST_NODES:
            break
    return core


def _square(middle: Position, side_m: float) -> Box:
    return _widened((*middle, *middle), side_m / 2)


def _widened(box: Box, by_m: float) -> Box:
    south, west, north, east = box
    up = by_m / ground_distance_m((0.0, 0.0), (1.0, 0.0))
    aside = up / max(math.cos(math.radians(max(abs(south), abs(north)))), 0.05)
    low, left, high, right = (round(side, _DECIMALS) for side in (south - up, west - aside, north + up, east + aside))
    return low, left, high, right


def _is_in(position: Position, box: Box) -> bool:
    south, west, north, east = box
    return south <= position[0] <= north and west <= position[1] <= east


def _middle(tile: int) -> Position:
    south, west, north, east = box_of_tile(tile)
    return (south + north) / 2, (west + east) / 2


def _write(osm: OsmMap, target: Path) -> None:
    """Write a map as XML, element by element; the same map gives the same bytes."""
    south, west, north, east = osm.bounds
    sides = {"minlat": south, "minlon": west, "maxlat": north, "maxlon": east}
    with etree.xmlfile(str(target), encoding="UTF-8") as document:
        document.write_declaration()
        with document.element("osm", {"version": "0.6", "generator": "PlannerForge extract"}):
            document.write(etree.Element("bounds", {name: f"{value:.{_DECIMALS}f}" for name, value in sides.items()}))
            for element in _elements(osm):
                document.write(element)


def _elements(osm: OsmMap) -> Iterator[etree._Element]:
    root = etree.Element("osm")
    for node in osm.nodes.values():
        append_node(root, node)
        yield root[-1]
        root.clear()
    for way in osm.ways:
        append_object(root, "way", way.way_id, way.tags, parts=[("nd", {"ref": str(key)}) for key in way.node_ids])
        yield root[-1]
        root.clear()
    for relation in osm.relations:
        members = [("member", {"type": kind, "ref": str(key), "role": role}) for kind, key, role in relation.members]
        append_object(root, "relation", relation.relation_id, relation.tags, parts=members)
        yield root[-1]
        root.clear()
