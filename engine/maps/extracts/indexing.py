"""Reads an extract of a country into tiles, once: elements, then names, then the sites of each tile.

The index records its own progress, so that interrupted work can resume: an unfinished stage starts again, and the
search for sites continues at its last tile. Positions of nodes stay on disk meanwhile. Their pages are released as the
work proceeds, so that memory does not grow with the extract.
"""

import ctypes
import errno
import json
import math
import mmap
import os
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np

from ....schemas.errors import ResourceFailure, UnsafeInput
from ....schemas.generation import (
    INDEX_NAME,
    MAP_FACTS_VERSION,
    ExtractSize,
    IndexedExtract,
    IndexExtractRequest,
    MapFacts,
    PlaceArea,
    SiteType,
)
from ....schemas.text import cited, one_line, shown_name
from ...execution import ProgressReporter
from ..facts import countries_near
from ..naming.places import fold, place_keys
from ..naming.shown import LEAST_RADIUS_M, USUAL_RADIUS_M
from ..naming.tags import PLACE_KINDS, keys_of_road, place_names_of
from ..osm import (
    EARTH_RADIUS_M,
    KEPT_KEYS,
    NORTHMOST_DEG,
    OSM_ATTRIBUTION,
    SOUTHMOST_DEG,
    OsmMap,
    OsmNode,
    OsmRelation,
    OsmWay,
    tag_text,
)
from ..road_classes import ALL_ROADS
from ..site_search.finder import SiteFinder
from .tiles import TileStore, box_of_tile, index_failures, tile_of

VERSION = "1"
"""Increase this if the index's content changes: existing indexes are then rebuilt."""
SURROUNDINGS_DEG = 0.012
"""Margin around a tile, so that its sites equal those of a larger map (over a kilometre; chosen)."""
REPORTED_EVERY, _BYTES_OF_ELEMENT = 10_000, 60
"""Elements between two reports, and the file size of a stored element, for the progress share (measured)."""
_TIMESTAMP = "osmosis_replication_timestamp"
"""The header's field for the time of the data."""
_NO_ROOM = tuple(os.strerror(number) for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG))
"""osmium's text for a full disk; it raises the same error for a broken file."""
_SHOWN_PLACES = 300
"""Maximum number of names of places in the facts (chosen)."""


def index_extract(request: IndexExtractRequest, report: ProgressReporter) -> IndexedExtract:
    """Read an extract into tiles, or resume that work; check a complete index for damage.

    Raises:
        UnsafeInput: the file is broken, or has no road for vehicles.
        ResourceFailure: the index cannot be written; its finished part is kept.
    """
    path, folder = Path(request.path), Path(request.folder)
    index = folder / INDEX_NAME
    with index_failures(index, writable=True), closing(_begun(index)) as store:
        if not store.state("staged"):
            report(0.0, "reading the extract")
            store.begin_staging()
            _stage(path, folder, store, report)
        if not store.state("packed"):
            for done, left in enumerate(store.pack(), start=1):
                report(0.4 + 0.2 * done / (done + left), f"packing tiles: {left:,} left")
        _find_sites(store, report)
        store.finish()
        return IndexedExtract(index=str(index), facts=_facts(request, store))


def _begun(index: Path) -> TileStore:
    """Return the unfinished index; start again if it is damaged or from another version of this program."""
    if index.exists() and not _is_resumable(index):
        for leftover in index.parent.glob(f"{index.name}*"):
            leftover.unlink()
    store = TileStore(index, writable=True)
    store.note("version", VERSION)
    return store


def _is_resumable(index: Path) -> bool:
    """Return whether an index is of this version and, if complete, undamaged.

    Raises:
        sqlite3.OperationalError: the index cannot be read: the disk is full, or another process is writing.
    """
    try:
        with closing(TileStore(index, writable=True)) as store:
            is_done = bool(store.state("packed")) and not store.tiles_without_sites()
            return store.state("version") in ("", VERSION) and (not is_done or store.is_sound())
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError:  # not an index, or its first pages are missing
        return False


def _stage(path: Path, folder: Path, store: TileStore, report: ProgressReporter) -> None:
    import osmium

    positions = folder / "positions"
    positions.unlink(missing_ok=True)
    bounds = [math.inf, math.inf, -math.inf, -math.inf]
    nodes = ways = 0
    is_indexed = False
    road_m = 0.0
    places: list[_Settlement] = []
    try:
        header = osmium.FileProcessor(str(path)).header
        if header.has_multiple_object_versions:
            raise UnsafeInput(
                f"{shown_name(path.name)} contains the history of its objects",
                next_step="use an extract of one time (osmium time-filter)",
            )
        for element in _in_order(_elements(path, positions), path.name):
            if element.is_node():
                node = _node(element)
                if node is None:
                    continue
                nodes += 1
                store.stage_nodes([node])
                if node.tags.get("place") in PLACE_KINDS and (names := place_names_of(node.tags)):
                    places.append(_Settlement(PLACE_KINDS.index(node.tags["place"]), tuple(names), *node.position))
            elif element.is_way():
                way, line = _way(element)
                if len(set(way.node_ids)) < 2:
                    continue
                ways += 1
                store.stage_way(way, line)
                if way.road_class in ALL_ROADS:
                    road_m += _length_m(line)
                    bounds = _widened(bounds, line)
            elif element.is_relation() and (relation := _relation(element)):
                if not is_indexed:
                    store.index_staged()
                    is_indexed = True
                store.stage_relation(relation)
            if (nodes + ways) % REPORTED_EVERY == 0:
                share = (nodes + ways) * _BYTES_OF_ELEMENT / path.stat().st_size
                report(0.4 * min(share, 1.0), f"reading the extract: {nodes + ways:,} elements")
                give_pages_back(positions)
                store.keep()
    except (RuntimeError, ValueError) as error:  # all that osmium raises, about the file and about positions
        if any(words in str(error) for words in _NO_ROOM):
            raise ResourceFailure(
                f"the positions of the nodes of {shown_name(path.name)} could not be written: {cited(error)}",
                next_step="free disk space and add the extract again",
            ) from error
        raise UnsafeInput(
            f"{shown_name(path.name)} cannot be read: {cited(error)}",
            next_step="get the extract again, or convert it to .osm.pbf",
        ) from error
    finally:
        positions.unlink(missing_ok=True)
    if not road_m:
        raise UnsafeInput(
            f"{shown_name(path.name)} has no road for vehicles", next_step="use an extract with streets in it"
        )
    for number, (rank, place) in enumerate(_areas(places)):
        keys = {key for name in (place.name, *place.other_names) for key in place_keys(name)}
        store.add_place(number, rank, place.model_dump_json(), keys)
    store.note("data_time", header.get(_TIMESTAMP, ""))
    store.note("counts", json.dumps([road_m / 1000, ways, bounds]))
    store.end_staging()


def _elements(path: Path, positions: Path) -> Iterator[Any]:
    import osmium

    found: Iterable[Any] = (
        osmium.FileProcessor(str(path))
        .with_locations(f"sparse_file_array,{positions}")
        .with_filter(osmium.filter.KeyFilter(*KEPT_KEYS))
    )
    return iter(found)


def give_pages_back(path: Path) -> None:
    """Release the pages of a shared file mapping from this process; they stay in the file.

    osmium maps the positions into memory, and a process keeps every page that it read until other processes need the
    memory. This function does nothing on systems that do not list mappings; such systems take pages back when memory is
    short.
    """
    try:
        mapped = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return
    system = ctypes.CDLL(None)
    for line in mapped:
        places, access, *rest = line.split(maxsplit=5)
        if access.endswith("s") and rest[-1] == str(path.resolve()):  # changes to a private mapping would be lost
            begin, end = (int(place, 16) for place in places.split("-"))
            system.madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), mmap.MADV_DONTNEED)


def _in_order(elements: Iterator[Any], name: str) -> Iterator[Any]:
    """Yield nodes, then ways, then relations, each once and by id; a way needs the positions of earlier nodes.

    Raises:
        UnsafeInput: the elements are in another order.
    """
    last = (0, False, -1)
    for element in elements:
        here = ("nwr".find(element.type_str()), element.id > 0, abs(element.id))
        if here <= last:
            raise UnsafeInput(
                f"{name} is not in order at {element.type_str()}{element.id}, or contains it twice",
                next_step="sort it with osmium sort, or use an extract of one time",
            )
        last = here
        yield element


def _tags(element: Any) -> dict[str, str]:
    return {tag_text(tag.k): tag_text(tag.v) for tag in element.tags}


def _node(element: Any) -> OsmNode | None:
    """Return the node, or None if it was deleted, has no position, or is beyond the latitudes of maps."""
    if element.deleted or not element.location.valid():
        return None
    latitude, longitude = element.location.lat, element.location.lon
    if not SOUTHMOST_DEG <= latitude <= NORTHMOST_DEG:
        return None
    return OsmNode(element.id, latitude, longitude, _tags(element))


def _way(element: Any) -> tuple[OsmWay, list[tuple[int, int]]]:
    """Return a way through its nodes with positions, and their (latitude, longitude) in 1e-7 degrees."""
    refs, line = [], []
    if not element.deleted:
        for node in element.nodes:
            place = node.location
            if place.valid() and SOUTHMOST_DEG <= place.lat <= NORTHMOST_DEG:
                refs.append(node.ref)
                line.append((place.y, place.x))
    return OsmWay(element.id, tuple(refs), _tags(element)), line


def _relation(element: Any) -> OsmRelation | None:
    if element.deleted:
        return None
    kinds = {"n": "node", "w": "way", "r": "relation"}
    members = tuple((kinds.get(member.type, ""), member.ref, member.role) for member in element.members)
    return OsmRelation(element.id, members, _tags(element))


def _length_m(line: list[tuple[int, int]]) -> float:
    """Return the length in m of a line of (latitude, longitude) in 1e-7 degrees."""
    sides = np.radians(np.array(line) / 1e7)
    north, east = np.diff(sides, axis=0).T
    middle = (sides[1:, 0] + sides[:-1, 0]) / 2
    return float(np.hypot(north, east * np.cos(middle)).sum() * EARTH_RADIUS_M)


def _widened(bounds: list[float], line: list[tuple[int, int]]) -> list[float]:
    latitudes, longitudes = [y / 1e7 for y, _ in line], [x / 1e7 for _, x in line]
    south, west, north, east = bounds
    return [min(south, *latitudes), min(west, *longitudes), max(north, *latitudes), max(east, *longitudes)]


class _Settlement(NamedTuple):
    """A place node: its rank among the kinds of places, its names, and its position in degrees."""

    rank: int
    names: tuple[str, ...]
    latitude: float
    longitude: float


def _areas(places: Iterable[_Settlement]) -> list[tuple[int, PlaceArea]]:
    """Return settlements by rank, largest first; each reaches at most half way to the next of its size."""
    from scipy.spatial import cKDTree

    ranked = sorted(places, key=lambda place: (place.rank, fold(place.names[0]), place.latitude, place.longitude))
    if not ranked:
        return []
    angles = np.radians(np.array([(place.latitude, place.longitude) for place in ranked]))
    points = np.column_stack(
        [np.cos(angles[:, 0]) * np.cos(angles[:, 1]), np.cos(angles[:, 0]) * np.sin(angles[:, 1]), np.sin(angles[:, 0])]
    )
    ranks = np.array([place.rank for place in ranked])
    reach_m = np.array([USUAL_RADIUS_M[PLACE_KINDS[rank]] for rank in ranks])
    for rank in sorted(set(ranks.tolist())):
        as_large, of_rank = np.flatnonzero(ranks <= rank), np.flatnonzero(ranks == rank)
        if len(as_large) > 1:
            apart, _ = cKDTree(points[as_large]).query(points[of_rank], k=2)
            reach_m[of_rank] = np.minimum(reach_m[of_rank], np.asarray(apart)[:, 1] * EARTH_RADIUS_M / 2)
    return [
        (
            place.rank,
            PlaceArea(
                name=place.names[0],
                kind=PLACE_KINDS[place.rank],
                other_names=place.names[1:],
                latitude=place.latitude,
                longitude=place.longitude,
                radius_m=round(max(float(reach), LEAST_RADIUS_M)),
            ),
        )
        for place, reach in zip(ranked, reach_m, strict=True)
    ]


def _find_sites(store: TileStore, report: ProgressReporter) -> None:
    tiles = store.tiles_without_sites()
    for number, tile in enumerate(tiles):
        if number % 20 == 0:
            report(0.6 + 0.4 * number / len(tiles), f"looking for sites: {len(tiles) - number:,} tiles left")
        south, west, north, east = box_of_tile(tile)
        wide = south - SURROUNDINGS_DEG, west - SURROUNDINGS_DEG, north + SURROUNDINGS_DEG, east + SURROUNDINGS_DEG
        osm = store.read(wide)
        store.add_sites(tile, _sites_in(osm, tile), _road_keys(osm, tile))


def _road_keys(osm: OsmMap, tile: int) -> set[str]:
    """Return the keys of the names and numbers of all roads through a tile."""
    return {
        key
        for way in osm.roads()
        if any(tile_of(*osm.nodes[node].position) == tile for node in way.node_ids)
        for key in keys_of_road(way.tags)
    }


def _sites_in(osm: OsmMap, tile: int) -> Iterator[tuple[str, float, float, str]]:
    """Yield the sites in a tile, found on a map that also covers its surroundings."""
    if not osm.roads():
        return
    finder = SiteFinder(osm)
    for kind in get_args(SiteType):
        for site in finder.find(kind):
            if tile_of(*site.position) == tile:
                yield kind, site.latitude, site.longitude, site.osm_id


def _facts(request: IndexExtractRequest, store: TileStore) -> MapFacts:
    road_km, ways, box = json.loads(store.state("counts"))
    south, west, north, east = box
    near = countries_near((south, west, north, east))
    country = request.country or (near[0] if len(near) == 1 else None)
    counts = store.counts()
    largest = [PlaceArea.model_validate_json(body).name for body in store.largest_places(_SHOWN_PLACES)]
    name = one_line(Path(request.path).name)
    return MapFacts(
        map_id=request.map_id,
        file_name=name,
        place=request.place or name.partition(".")[0],
        places=tuple(dict.fromkeys(largest)),
        country=country,
        countries_near=() if country else near,
        south=south,
        west=west,
        north=north,
        east=east,
        streets=(),
        refs=(),
        sites=store.site_counts(),
        road_km=round(road_km, 1),
        attribution=OSM_ATTRIBUTION,
        facts_version=MAP_FACTS_VERSION,
        extract=ExtractSize(
            places=counts["places"],
            road_names=counts["road_names"],
            nodes=store.kept_nodes(),
            ways=ways,
            tiles=counts["tiles"],
            data_time=store.state("data_time"),
        ),
    )
