"""Stores an extract's content in tiles of a few kilometres, in one SQLite file.

The elements of the file are staged in the order of reading, with the tiles that they touch. Each tile is then packed
into arrays. A part of the extract is read from the tiles that it touches, so its cost does not depend on the extract's
size.
"""

import io
import json
import math
import sqlite3
import zipfile
import zlib
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....schemas.errors import ResourceFailure
from ....schemas.generation import SiteType
from ....schemas.maps import Box
from ....schemas.text import cited, shown_name
from ..osm import NO_TAGS, OsmMap, OsmNode, OsmRelation, OsmWay

TILE_DEG = 0.05
"""Side of a tile (chosen): some 5 km from south to north, so that a town is a few tiles and a tile takes a second."""
_COLUMNS = round(360 / TILE_DEG)
_UNITS_PER_DEG = 10_000_000
"""OpenStreetMap's own resolution."""
_NODE, _WAY, _RELATION = range(3)
_MOST_OPEN_TILES = 12
"""Unpacked tiles kept in memory: those around one, and a few more (chosen)."""
_STAGING_ENDING = ".staged"
_KEPT_AT_ONCE = 500
"""Tiles packed in one transaction (chosen): some megabytes."""
_WIDEST_TILES = 400
"""A way that touches more tiles is not part of a road network and is left out (chosen; long roads touch dozens)."""
_LONGEST_SEGMENT_DEG = 0.5
"""Tiles between two nodes farther apart than this do not get the way (chosen): no road is so straight."""
_ADD_AGAIN = "add the extract again with plannerforge maps add: it rebuilds the damaged part of the index"
SCHEMA = """
CREATE TABLE IF NOT EXISTS state (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS tiles (tile INTEGER PRIMARY KEY, nodes INTEGER NOT NULL, body BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS places (place INTEGER PRIMARY KEY, rank INTEGER NOT NULL, body TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS place_names (name TEXT, place INTEGER, PRIMARY KEY (name, place)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS road_names (name TEXT, tile INTEGER, PRIMARY KEY (name, tile)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS sites (tile INTEGER, kind TEXT, latitude REAL, longitude REAL, mark TEXT);
CREATE INDEX IF NOT EXISTS sites_by_kind ON sites (kind, tile);
CREATE TABLE IF NOT EXISTS sited (tile INTEGER PRIMARY KEY);
"""


STAGING_SCHEMA = """
PRAGMA staging.journal_mode=WAL; PRAGMA staging.synchronous=NORMAL;
CREATE TABLE IF NOT EXISTS staging.staged
    (tile INTEGER NOT NULL, kind INTEGER NOT NULL, id INTEGER NOT NULL, body BLOB);
"""
"""A separate file, removed after packing: emptying a table takes more space than the table."""


@contextmanager
def index_failures(path: Path, *, writable: bool = False) -> Iterator[None]:
    """Convert an SQLite failure of an index into an error with a remedy.

    Raises:
        ResourceFailure: the index cannot be read or written.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise ResourceFailure(
            f"the index {shown_name(path.name)} of the extract cannot be {'written' if writable else 'used'}: "
            f"{cited(error)}",
            next_step="free disk space and add the extract again: it resumes the work" if writable else _ADD_AGAIN,
        ) from error


def tile_of(latitude: float, longitude: float) -> int:
    """Return the number of the tile around a position in degrees."""
    row = math.floor((latitude + 90.0) / TILE_DEG)
    return row * _COLUMNS + math.floor((longitude + 180.0) / TILE_DEG) % _COLUMNS


def box_of_tile(tile: int) -> Box:
    """Return the box of a tile in degrees."""
    row, column = divmod(tile, _COLUMNS)
    south, west = row * TILE_DEG - 90.0, column * TILE_DEG - 180.0
    return south, west, south + TILE_DEG, west + TILE_DEG


def tiles_in(box: Box) -> list[int]:
    """Return the tiles that a box touches, ascending."""
    south, west, north, east = box
    rows = range(math.floor((south + 90.0) / TILE_DEG), math.floor((north + 90.0) / TILE_DEG) + 1)
    columns = range(math.floor((west + 180.0) / TILE_DEG), math.floor((east + 180.0) / TILE_DEG) + 1)
    return sorted(row * _COLUMNS + column % _COLUMNS for row in rows for column in columns)


@dataclass(frozen=True)
class _Tile:
    """A tile's elements: nodes by id with position in units, ways by id with their nodes' indices in ``node_ids``."""

    node_ids: NDArray[np.int64]
    places: NDArray[np.int32]
    node_tags: Mapping[int, Mapping[str, str]]
    way_ids: NDArray[np.int64]
    begins: NDArray[np.int64]
    refs: NDArray[np.int64]
    way_tags: Sequence[Mapping[str, str]]
    relations: Sequence[Any]

    def ways_within(self, sides: Sequence[int]) -> Iterator[int]:
        """Yield the ways with a segment that may touch a box: (south, west, north, east) in units."""
        south, west, north, east = sides
        of_way = np.repeat(np.arange(len(self.way_ids)), np.diff(self.begins))
        one, other = self.places[self.refs[:-1]], self.places[self.refs[1:]]
        low, high = np.minimum(one, other), np.maximum(one, other)
        touching = (low[:, 0] <= north) & (high[:, 0] >= south) & (low[:, 1] <= east) & (high[:, 1] >= west)
        yield from np.unique(of_way[:-1][touching & (of_way[:-1] == of_way[1:])]).tolist()


class TileStore:
    """The file of tiles; for one thread, and only within ``index_failures``, which converts SQLite's errors."""

    def __init__(self, path: Path, *, writable: bool = False) -> None:
        self._path = path
        self._database = sqlite3.connect(path if writable else f"file:{path}?mode=ro", uri=not writable)
        try:
            if writable:
                self._database.executescript(f"PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; {SCHEMA}")
                if not self.state("packed"):
                    self._attach_staging()
            else:
                self._database.execute("SELECT value FROM state LIMIT 1")
        except sqlite3.Error:
            self._database.close()
            raise
        self._tile = lru_cache(maxsize=_MOST_OPEN_TILES)(self._unpacked)

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    # Progress

    def state(self, name: str) -> str:
        """Return a stored note on the work, or an empty string if there is none."""
        row = self._database.execute("SELECT value FROM state WHERE name = ?", (name,)).fetchone()
        return "" if row is None else str(row[0])

    def note(self, name: str, value: str) -> None:
        """Store a note, and commit everything written before."""
        self._database.execute("INSERT OR REPLACE INTO state VALUES (?, ?)", (name, value))
        self._database.commit()

    def keep(self) -> None:
        """Commit what was written; otherwise the log of changes would grow to contain all of it a second time."""
        self._database.commit()

    def is_sound(self) -> bool:
        """Return whether the whole file is readable: its pages by SQLite, its tiles by their checksums."""
        try:
            if self._database.execute("PRAGMA quick_check(1)").fetchone()[0] != "ok":
                return False
            for (tile,) in self._database.execute("SELECT tile FROM tiles ORDER BY tile"):
                self._unpacked(tile)
        except (sqlite3.DatabaseError, ResourceFailure):
            return False
        return True

    # Staging

    def begin_staging(self) -> None:
        """Discard what an interrupted attempt has staged."""
        self._database.execute("DELETE FROM places")
        self._database.execute("DELETE FROM place_names")
        self.keep()
        self._database.execute("DETACH staging")
        self._remove_staging()
        self._attach_staging()

    def end_staging(self) -> None:
        """Note that staging is complete; flush the staged data first, because the note is in another file."""
        self.keep()
        self._database.execute("PRAGMA staging.wal_checkpoint(TRUNCATE)").fetchall()
        self.note("staged", "yes")

    def _attach_staging(self) -> None:
        self._database.execute("ATTACH ? AS staging", (f"{self._path}{_STAGING_ENDING}",))
        self._database.executescript(STAGING_SCHEMA)

    def _remove_staging(self) -> None:
        for leftover in self._path.parent.glob(f"{self._path.name}{_STAGING_ENDING}*"):
            leftover.unlink()

    def stage_nodes(self, nodes: Iterable[OsmNode]) -> None:
        """Stage nodes with tags."""
        rows = ((tile_of(node.latitude, node.longitude), _NODE, node.node_id, _node_body(node)) for node in nodes)
        self._database.executemany("INSERT INTO staged VALUES (?, ?, ?, ?)", rows)

    def stage_way(self, way: OsmWay, places: Sequence[tuple[int, int]]) -> None:
        """Stage a way; ``places``: (latitude, longitude) of its nodes in units of 1e-7 degrees."""
        tiles = _tiles_along(places)
        if len(tiles) > _WIDEST_TILES:
            return
        body = _way_body(way, places)
        self._database.executemany(
            "INSERT INTO staged VALUES (?, ?, ?, ?)", ((tile, _WAY, way.way_id, body) for tile in tiles)
        )

    def stage_relation(self, relation: OsmRelation) -> None:
        """Stage a relation in every tile that contains a staged way of the relation."""
        ways = [number for kind, number, _ in relation.members if kind == "way"]
        body = json.dumps([relation.relation_id, relation.members, dict(relation.tags)]).encode()
        tiles = {
            tile
            for number in ways
            for (tile,) in self._database.execute("SELECT tile FROM staged WHERE kind = ? AND id = ?", (_WAY, number))
        }
        self._database.executemany(
            "INSERT INTO staged VALUES (?, ?, ?, ?)",
            ((tile, _RELATION, relation.relation_id, body) for tile in tiles if len(tiles) <= _WIDEST_TILES),
        )

    def index_staged(self) -> None:
        """Index ways by id, for the relations."""
        self._database.execute("CREATE INDEX IF NOT EXISTS staging.staged_by_id ON staged (kind, id)")

    # Packing

    def pack(self) -> Iterator[int]:
        """Pack every tile; yield how many are left."""
        self._database.execute("DROP INDEX IF EXISTS staging.staged_by_id")
        self._database.execute("CREATE INDEX IF NOT EXISTS staging.staged_by_tile ON staged (tile)")
        tiles = [row[0] for row in self._database.execute("SELECT DISTINCT tile FROM staged ORDER BY tile")]
        for left, tile in zip(range(len(tiles) - 1, -1, -1), tiles, strict=True):
            rows = self._database.execute("SELECT kind, id, body FROM staged WHERE tile = ? ORDER BY rowid", (tile,))
            count, body = _packed(rows)
            self._database.execute("INSERT OR REPLACE INTO tiles VALUES (?, ?, ?)", (tile, count, body))
            if left % _KEPT_AT_ONCE == 0:
                self.keep()
            yield left
        self.note("packed", "yes")
        self._database.execute("DETACH staging")
        self._remove_staging()

    def finish(self) -> None:
        """Close the log of changes, so that the file can be read without write access."""
        self._remove_staging()  # from work that was killed after packing
        self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._database.execute("PRAGMA journal_mode=DELETE")

    # Names and sites

    def add_place(self, number: int, rank: int, body: str, names: Iterable[str]) -> None:
        """Store a place with the keys of its names."""
        self._database.execute("INSERT OR REPLACE INTO places VALUES (?, ?, ?)", (number, rank, body))
        self._database.executemany(
            "INSERT OR IGNORE INTO place_names VALUES (?, ?)", ((name, number) for name in names)
        )

    def add_sites(self, tile: int, sites: Iterable[tuple[str, float, float, str]], roads: Iterable[str]) -> None:
        """Store a tile's sites (kind, latitude, longitude, OSM id) and the keys of its roads, in one transaction."""
        self._database.executemany("INSERT OR IGNORE INTO road_names VALUES (?, ?)", ((name, tile) for name in roads))
        self._database.executemany("INSERT INTO sites VALUES (?, ?, ?, ?, ?)", ((tile, *site) for site in sites))
        self._database.execute("INSERT INTO sited VALUES (?)", (tile,))
        self._database.commit()

    def tiles_without_sites(self) -> list[int]:
        """Return the tiles without known sites, ascending."""
        rows = self._database.execute("SELECT tile FROM tiles WHERE tile NOT IN (SELECT tile FROM sited) ORDER BY tile")
        return [row[0] for row in rows]

    def counts(self) -> dict[str, int]:
        """Return the numbers of tiles, places and road names."""
        of = {"tiles": "tiles", "places": "places", "road_names": "(SELECT DISTINCT name FROM road_names)"}
        return {
            name: int(self._database.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0])  # noqa: S608 - fixed names
            for name, table in of.items()
        }

    def kept_nodes(self) -> int:
        """Return how many nodes all tiles contain; a node at a border of tiles may count once per tile."""
        return int(self._database.execute("SELECT COALESCE(SUM(nodes), 0) FROM tiles").fetchone()[0])

    def site_counts(self) -> dict[SiteType, int]:
        """Return the number of sites of each kind."""
        rows = self._database.execute("SELECT kind, COUNT(*) FROM sites GROUP BY kind ORDER BY kind")
        return {kind: int(count) for kind, count in rows}

    def places_called(self, keys: Iterable[str]) -> list[str]:
        """Return the places with one of the names, larger places first, as they were added."""
        wanted = sorted(set(keys))
        holes = ", ".join("?" * len(wanted))
        query = (
            "SELECT body FROM places WHERE place IN"  # noqa: S608 - only ? marks
            f" (SELECT place FROM place_names WHERE name IN ({holes})) ORDER BY rank, place"
        )
        return [str(row[0]) for row in self._database.execute(query, wanted)]

    def largest_places(self, count: int) -> list[str]:
        """Return the places with the highest ranks, as they were added."""
        return [
            str(row[0])
            for row in self._database.execute("SELECT body FROM places ORDER BY rank, place LIMIT ?", (count,))
        ]

    def tiles_with_road(self, keys: Iterable[str]) -> list[int]:
        """Return the tiles with a road of one of the names, ascending."""
        wanted = sorted(set(keys))
        holes = ", ".join("?" * len(wanted))
        query = f"SELECT DISTINCT tile FROM road_names WHERE name IN ({holes}) ORDER BY tile"  # noqa: S608 - only ? marks
        return [row[0] for row in self._database.execute(query, wanted)]

    def sites(self, kind: str, tiles: Sequence[int] | None = None) -> list[tuple[float, float]]:
        """Return the positions of sites of a kind (``any`` for all), in some or all tiles, in a fixed order."""
        query, values = "SELECT latitude, longitude FROM sites", list[Any]()
        conditions = []
        if kind != "any":
            conditions.append("kind = ?")
            values.append(kind)
        if tiles is not None:
            conditions.append(f"tile IN ({', '.join('?' * len(tiles))})")
            values += tiles
        where = f" WHERE {' AND '.join(conditions)}" if conditions else ""
        return self._database.execute(f"{query}{where} ORDER BY latitude, longitude", values).fetchall()

    # Reading a part

    def node_count_within(self, box: Box) -> int:
        """Return how many nodes are in a box."""
        south, west, north, east = (round(side * _UNITS_PER_DEG) for side in box)
        count = 0
        for number in tiles_in(box):
            if (tile := self._tile(number)) is not None:
                y, x = tile.places[:, 0], tile.places[:, 1]
                count += int(((south <= y) & (y <= north) & (west <= x) & (x <= east)).sum())
        return count

    def read(self, box: Box) -> OsmMap:
        """Return the extract's part in a box, including whole ways that enter it and their whole relations."""
        sides = south, west, north, east = [round(side * _UNITS_PER_DEG) for side in box]
        nodes: dict[int, OsmNode] = {}
        ways: dict[int, OsmWay] = {}
        relations: dict[int, OsmRelation] = {}
        for number in tiles_in(box):
            tile = self._tile(number)
            if tile is None:
                continue
            y, x = tile.places[:, 0], tile.places[:, 1]
            inside = (south <= y) & (y <= north) & (west <= x) & (x <= east)
            used = {index for index in tile.node_tags if inside[index]}
            for index in tile.ways_within(sides):
                refs = tile.refs[tile.begins[index] : tile.begins[index + 1]].tolist()
                used.update(refs)
                way_id = int(tile.way_ids[index])
                ways[way_id] = OsmWay(way_id, tuple(tile.node_ids[refs].tolist()), tile.way_tags[index])
            for index in used:
                node_id = int(tile.node_ids[index])
                latitude, longitude = (tile.places[index] / _UNITS_PER_DEG).tolist()
                nodes[node_id] = OsmNode(node_id, latitude, longitude, tile.node_tags.get(index, NO_TAGS))
            for relation_id, members, tags in tile.relations:
                if any(kind == "way" and key in ways for kind, key, _ in members):
                    relations[relation_id] = OsmRelation(
                        relation_id, tuple((kind, key, role) for kind, key, role in members), tags
                    )
        return OsmMap(
            dict(sorted(nodes.items())),
            tuple(ways[key] for key in sorted(ways)),
            tuple(relations[key] for key in sorted(relations)),
            box,
        )

    def _unpacked(self, number: int) -> _Tile | None:
        row = self._database.execute("SELECT body FROM tiles WHERE tile = ?", (number,)).fetchone()
        if row is None:
            return None
        try:
            with closing(np.load(io.BytesIO(row[0]), allow_pickle=False)) as arrays:
                words = json.loads(arrays["words"].tobytes())
                return _Tile(
                    node_ids=arrays["node_ids"],
                    places=arrays["places"],
                    node_tags={int(key): tags for key, tags in words["nodes"].items()},
                    way_ids=arrays["way_ids"],
                    begins=arrays["begins"],
                    refs=arrays["refs"],
                    way_tags=words["ways"],
                    relations=words["relations"],
                )
        except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
            raise ResourceFailure(
                f"the index {shown_name(self._path.name)} of the extract is damaged at tile {number}: {cited(error)}",
                next_step=_ADD_AGAIN,
            ) from error


def _tiles_along(places: Sequence[tuple[int, int]]) -> set[int]:
    """Return the tiles on a line of (latitude, longitude) in units, and those that it cuts at a corner."""
    tiles = [tile_of(y / _UNITS_PER_DEG, x / _UNITS_PER_DEG) for y, x in places]
    found = set(tiles)
    for number, (one, other) in enumerate(pairwise(tiles)):
        if one != other and len(found) <= _WIDEST_TILES:
            (y, x), (v, u) = places[number], places[number + 1]
            around = min(y, v), min(x, u), max(y, v), max(x, u)
            south, west, north, east = (side / _UNITS_PER_DEG for side in around)
            if (north - south + east - west) < _LONGEST_SEGMENT_DEG:
                found.update(tiles_in((south, west, north, east)))
    return found


def _node_body(node: OsmNode) -> bytes:
    y, x = round(node.latitude * _UNITS_PER_DEG), round(node.longitude * _UNITS_PER_DEG)
    return json.dumps([y, x, dict(node.tags)]).encode()


def _way_body(way: OsmWay, places: Sequence[tuple[int, int]]) -> bytes:
    """Return the number of nodes, their ids, their places, and the tags, packed as bytes."""
    flat = array("i", (side for place in places for side in place))
    numbers = array("q", (len(way.node_ids), *way.node_ids)).tobytes() + flat.tobytes()
    return numbers + json.dumps(dict(way.tags)).encode()


def _packed(rows: Iterable[tuple[int, int, bytes]]) -> tuple[int, bytes]:
    """Return the number of nodes and the arrays of a tile; if elements share an id, the last one is kept."""
    places: dict[int, tuple[int, int]] = {}
    node_tags: dict[int, dict[str, str]] = {}
    ways: dict[int, tuple[NDArray[np.int64], dict[str, str]]] = {}
    relations: dict[int, Any] = {}
    for kind, key, body in rows:
        if kind == _NODE:
            y, x, node_tags[key] = json.loads(body)
            places[key] = y, x
        elif kind == _WAY:
            count = int(np.frombuffer(body, np.int64, 1)[0])
            refs = np.frombuffer(body, np.int64, count, 8)
            sides = np.frombuffer(body, np.int32, 2 * count, 8 + 8 * count).reshape(-1, 2)
            ways[key] = refs, json.loads(body[8 + 16 * count :])
            places.update(zip(refs.tolist(), ((y, x) for y, x in sides.tolist()), strict=True))
        else:
            relations[key] = json.loads(body)
    node_ids = np.array(sorted(places), dtype=np.int64)
    place_of = {key: place for place, key in enumerate(node_ids.tolist())}
    way_ids = sorted(ways)
    words = {
        "nodes": {place_of[key]: node_tags[key] for key in sorted(node_tags)},
        "ways": [ways[key][1] for key in way_ids],
        "relations": [relations[key] for key in sorted(relations)],
    }
    all_refs = [ways[key][0] for key in way_ids]
    sink = io.BytesIO()
    np.savez_compressed(
        sink,
        node_ids=node_ids,
        places=np.array([places[key] for key in node_ids.tolist()], dtype=np.int32).reshape(-1, 2),
        way_ids=np.array(way_ids, dtype=np.int64),
        begins=np.concatenate([[0], np.cumsum([len(refs) for refs in all_refs])]).astype(np.int64),
        refs=np.searchsorted(node_ids, np.concatenate([*all_refs, np.empty(0, np.int64)])),
        words=np.frombuffer(json.dumps(words, ensure_ascii=False).encode(), dtype=np.uint8),
    )
    return len(node_ids), sink.getvalue()
