"""A part of an extract as an ordinary map: found by what the user calls it, read from its tiles, written as .osm.

The same request gives the same bytes. A part is a few kilometres: as wide as the place that is meant, no more than what
a map of it can be looked through in a second.
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
"""Sides of the square that is cut out: the first that holds no more nodes than ``MOST_NODES``, or the last (chosen)."""
MOST_NODES = 40_000
"""A map of so many is read and looked through in a second or two (measured)."""
MARGIN_M = 900.0
"""Around what was meant: the widest site needs 450 m, and a recording of 120 s twice that."""
NEAR_PLACE_M = 1_000.0
"""Around a place, within which a street of it is looked for (chosen): its outskirts belong to it."""
_MOST_TILES, _AT_SITE_M = 6, 60.0
"""Tiles with a street that are looked into, at most; from a street to a site on it (chosen)."""
_STRIDE = 7919
"""A prime by which seeds step through what fits, so that neighbouring seeds lie apart."""
_DECIMALS = 4
"""Of boxes in degrees: about 10 m, so that the same place gives the same box however it was computed."""
Position = tuple[float, float]


@dataclass(frozen=True)
class _Meant:
    """The middle of what was meant, how far it reaches, what it is called, and the words that name something there.

    ``sites``: where to go instead when not all of it can be cut out.
    """

    middle: Position
    reach_m: float
    label: str
    words: str
    place: str | None
    sites: Sequence[Position] = ()


def cut_extract(request: CutExtractRequest, report: ProgressReporter) -> CutOfExtract:
    """Write the part of an extract that a request means as a map file; an empty path where it shows none such.

    Raises:
        ResourceFailure: the index cannot be read.
    """
    index = Path(request.index)
    with index_failures(index), closing(TileStore(index)) as store:
        report(0.0, "looking the place up in the extract")
        meant = _meant(request, store)
        if meant is None:
            return CutOfExtract()
        core = _core(meant, request.seed, store)
        report(0.3, "cutting the part out")
        part = store.read(_widened(core, MARGIN_M))
    if not part.roads():
        return CutOfExtract()
    target = Path(request.folder) / "cut.osm"
    _write(part, target)
    known = ReadMapRequest(path=str(target), place=meant.place or request.facts.place, country=request.facts.country)
    facts = facts_of(part, known).model_copy(
        update={"cut_of": request.facts.map_id, "file_name": request.facts.file_name}
    )
    return CutOfExtract(path=str(target), facts=facts, core=core, label=meant.label, words=meant.words)


def _meant(request: CutExtractRequest, store: TileStore) -> _Meant | None:
    """What the words or the box mean in the extract; None where it shows nothing such."""
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
    """The largest place of a name, or the one nearest to a place that was named with it."""
    bodies = store.places_called(place_keys(part) | place_keys(without_frame(part)))
    bodies = bodies or store.places_called(names_elsewhere(without_frame(part)))
    places = [PlaceArea.model_validate_json(body) for body in bodies]
    if others:
        middle = others[0].latitude, others[0].longitude
        places.sort(key=lambda place: ground_distance_m(middle, (place.latitude, place.longitude)))
    return places[0] if places else None


def _at_place(area: PlaceArea, request: CutExtractRequest, store: TileStore) -> _Meant:
    middle = area.latitude, area.longitude
    sites = _sites_in(_square(middle, 2 * area.radius_m), request, store)
    return _Meant(middle, area.radius_m, f"{area.kind} {area.name}", "", area.name, sites)


def _anywhere(request: CutExtractRequest, store: TileStore) -> _Meant | None:
    """Around a site of the type, in the box or anywhere, chosen by the seed."""
    sites = _sites_in(request.bbox, request, store)
    if not sites:
        return None
    middle = sites[request.seed * _STRIDE % len(sites)]
    return _Meant(middle, math.inf, f"around {middle[0]:.4f}, {middle[1]:.4f}", "", None)


def _sites_in(box: Box | None, request: CutExtractRequest, store: TileStore) -> list[Position]:
    """The sites of the type in a box and in that of the request; those of any type where there is none."""
    boxes = [each for each in (box, request.bbox) if each is not None]
    tiles = None if not boxes else tiles_in(boxes[0])
    for kind in dict.fromkeys((request.scenario_type, "any")):
        sites = store.sites(kind, tiles)
        if inside := [site for site in sites if all(_lies_in(site, each) for each in boxes)]:
            return inside
    return []


def _at_roads(
    roads: Sequence[str], area: PlaceArea | None, request: CutExtractRequest, store: TileStore
) -> _Meant | None:
    """Around a node of the road, or where the roads meet, with a site of the type near by where there is one.

    Tiles are looked through from the middle of the place on, or from one that the seed chooses.
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
        return _Meant(spot, math.inf, words, words, None)
    return _Meant(spot, math.inf, f"{words} in {area.kind} {area.name}", words, area.name)


def _spots(roads: Sequence[str], tile: int, box: Box | None, store: TileStore) -> list[Position]:
    """Where all the roads meet in a tile and a box; of a single road, and of those that never meet, all its nodes."""
    inside = box_of_tile(tile)
    osm = store.read(inside)
    lines = [_nodes_of(road, osm) for road in roads]
    meeting = set.intersection(*lines) or lines[0]
    spots = sorted(osm.nodes[key].position for key in meeting)
    return [spot for spot in spots if _lies_in(spot, inside) and (box is None or _lies_in(spot, box))]


def _nodes_of(road: str, osm: OsmMap) -> set[int]:
    wanted = _keys_of(road)
    return {key for way in osm.roads() if not wanted.isdisjoint(keys_of_road(way.tags)) for key in way.node_ids}


@lru_cache(maxsize=MOST_KEPT)
def _keys_of(road: str) -> frozenset[str]:
    return frozenset((*road_keys(road), *whole_road_keys(road)))


def _with_all_roads(roads: Sequence[str], box: Box | None, store: TileStore) -> list[int]:
    """The tiles, of a box or all, that have a road of each name."""
    found: set[int] | None = None if box is None else set(tiles_in(box))
    for road in roads:
        tiles = set(store.tiles_with_road(_keys_of(road)))
        found = tiles if found is None else found & tiles
    return sorted(found or ())


def _core(meant: _Meant, seed: int, store: TileStore) -> Box:
    """The square around what was meant that is not too much for one map; of a large place, around one of its sites."""
    core = _square(meant.middle, min(SIDES_M[0], 2 * meant.reach_m))
    is_whole = 2 * meant.reach_m <= SIDES_M[0] and store.node_count_within(_widened(core, MARGIN_M)) <= MOST_NODES
    middle = meant.middle if is_whole or not meant.sites else meant.sites[seed * _STRIDE % len(meant.sites)]
    for side_m in SIDES_M:
        core = _square(middle, min(side_m, 2 * meant.reach_m))
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


def _lies_in(position: Position, box: Box) -> bool:
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
