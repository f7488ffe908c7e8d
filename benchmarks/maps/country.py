"""Measures the cost of scenarios in a synthetic country of millions of nodes.

``write_country`` builds it from the shared extracts, with the same bytes each time: every cell of a grid holds a copy
of one with unique ids and place names, motorways with slip roads connect the cells, and houses add bulk. The country is
in the South Pacific, away from any real one.

Keys:

- ``country_cut_s``: seconds of a ``generate_scenarios`` call through the server, from the place name to the stored
  scenario (median over ``country_places`` towns); ``country_cut_worst_s``: the worst.
- ``country_cut_alone_s``: the time to find the place, cut it out and read its content (median, in a fresh process).
- ``country_refused``: towns in which no scenario could be generated.
- ``country_memory_mb``: peak resident memory of the largest worker that reads the country into tiles, or of a process
  that cuts towns out, whichever is more (``country_indexing_mb``, ``country_cutting_mb``).
- ``country_server_mb``: memory of the server's process; ``country_generating_mb``: memory of the largest worker after
  generation.
- ``country_killed_at``: share of the work done when the first server and its workers are killed;
  ``country_kept_tiles``: tiles kept, with their known sites; ``country_resumed_s``: time of the second server, which
  continues; ``country_index_s``: both times together.
- ``country_file_mb``, ``country_index_mb``, ``country_nodes``, ``country_tiles``: sizes.
- ``country_tiles_equal``: of ``country_tiles_judged`` tiles, those with the same sites in the index as in a small map
  of the same area that osmium cut out; ``country_sites_judged``: number of these sites; ``country_sites_twice``: sites
  that the index holds twice.
- ``country_same_bytes``: 1 if a repeated cut has the same bytes.
"""

import hashlib
import json
import math
import os
import random
import sqlite3
import statistics
import sys
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, get_args

import anyio
import osmium
import psutil
from mcp import Client, StdioServerParameters
from osmium.osm import mutable

from plannerforge.engine.execution import silent
from plannerforge.engine.maps import SiteFinder, cut_extract, read_map_file
from plannerforge.schemas.generation import INDEX_NAME, CutExtractRequest, MapFacts, SiteType

from ..harness import Figures, ask, ask_to_the_end
from .bench import MapsBench

_SOURCES = (
    "liechtenstein.osm.pbf",
    "munich.osm",
    "monaco.osm",
    "berlin-siegessaeule.osm",
    "bautzen.osm",
    "o2s_tempe_light_rail.osm",
    "o2s_tiny_loop.osm",
    "dueren-complete-excerpt.osm",
    "o2s_northgate_dual_carriageway.osm",
    "Laufamholzstrasse.osm",
    "o2s_roosevelt_cycletrack.osm",
    "o2s_montlake_roundabout.osm",
)
"""Extracts of the country, in turn; all have right-hand traffic."""
COLUMNS, ROWS = 12, 12
"""Cells of the grid, for over five million nodes."""
_CELL_M, _REACH_M = 40_000.0, 19_000.0
"""Side of a cell, and the largest distance from its middle that is copied."""
_SOUTH_WEST = (-45.0, -130.0)
_METRES_A_DEGREE = 111_195.0
_HOUSES, _HOUSE_M = 1_800, 10.0
"""Number of houses in a cell in addition to those of its extract, and their sides."""
_IDS_OF_CELL, _NAMES_OF_CELL = 1_000_000, 256
_SYLLABLES = (
    "ba",
    "dor",
    "fel",
    "gan",
    "hul",
    "kir",
    "lom",
    "mas",
    "nev",
    "pol",
    "rud",
    "sil",
    "tav",
    "vor",
    "wen",
    "zal",
)
_PLACES, _JUDGED_TILES = 24, 12
"""Numbers of towns for scenarios, and of tiles for the judge of sites."""
_KILLED_AT = 0.75
"""Share of the work at which the first server is killed, in its longest part, the search for sites."""
_SURROUNDINGS_DEG = 0.012
"""Margin around a tile that the product says it uses."""
_SITES_TWICE = (
    "SELECT COUNT(*) - COUNT(DISTINCT printf('%d %s %f %f %s', tile, kind, latitude, longitude, mark)) FROM sites"
)
Position = tuple[float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Element:
    """A node, way or relation of an extract: its number, its tags, and its members."""

    number: int
    tags: Mapping[str, str]
    position: Position = (0.0, 0.0)
    nodes: tuple[int, ...] = ()
    members: tuple[tuple[str, int, str], ...] = ()


@dataclass(frozen=True)
class _Piece:
    """An extract as it is copied: elements numbered from 1 by kind, positions in metres from its middle."""

    nodes: tuple[_Element, ...]
    ways: tuple[_Element, ...]
    relations: tuple[_Element, ...]


def name_of(number: int) -> str:
    """Return a name for a place that no other number has."""
    base = len(_SYLLABLES)
    parts = [_SYLLABLES[number // base**power % base] for power in range(4)]
    return "".join(parts).capitalize()


def town_of(cell: int) -> str:
    """Return the name of the town in the middle of a cell."""
    return name_of(cell * _NAMES_OF_CELL)


def write_country(
    maps: Path, target: Path, *, columns: int = COLUMNS, rows: int = ROWS, sources: Sequence[str] = _SOURCES
) -> int:
    """Write the country as .osm.pbf, nodes before ways before relations; the number of its nodes.

    Its cells are copies of the files of these names in the folder of maps, in turn.
    """
    pieces = [_piece(maps / name) for name in sources[: columns * rows]]
    cells = [_Cell(number, columns, pieces[number % len(pieces)]) for number in range(columns * rows)]
    count = 0
    with osmium.SimpleWriter(str(target), overwrite=True) as writer:
        for cell in cells:
            for node in cell.nodes():
                writer.add_node(node)
                count += 1
        for cell in cells:
            for way in cell.ways():
                writer.add_way(way)
        for cell in cells:
            for relation in cell.relations():
                writer.add_relation(relation)
    return count


def _piece(path: Path) -> _Piece:
    nodes: dict[int, _Element] = {}
    ways: dict[int, _Element] = {}
    relations: list[_Element] = []
    found = list(_read(path))
    middles = [element.position for kind, element in found if kind == "n" and "highway" in element.tags]
    middles = middles or [element.position for kind, element in found if kind == "n"]
    south, west = (statistics.median(place[side] for place in middles) for side in (0, 1))
    for kind, element in found:
        if kind == "n":
            north_m = (element.position[0] - south) * _METRES_A_DEGREE
            east_m = (element.position[1] - west) * _METRES_A_DEGREE * math.cos(math.radians(south))
            if max(abs(north_m), abs(east_m)) < _REACH_M:
                nodes[element.number] = _Element(len(nodes) + 1, element.tags, (north_m, east_m))
        elif kind == "w":
            refs = tuple(nodes[key].number for key in element.nodes if key in nodes)
            if len(refs) > 1:
                ways[element.number] = _Element(len(ways) + 1, element.tags, nodes=refs)
        elif element.tags.get("type") == "restriction":
            known: Mapping[str, Mapping[int, _Element]] = {"n": nodes, "w": ways}
            if all(key in known.get(sort, {}) for sort, key, _ in element.members):
                members = tuple((sort, known[sort][key].number, role) for sort, key, role in element.members)
                relations.append(_Element(len(relations) + 1, element.tags, members=members))
    return _Piece(tuple(nodes.values()), tuple(ways.values()), tuple(relations))


def _read(path: Path) -> Iterator[tuple[str, _Element]]:
    for one in osmium.FileProcessor(str(path)):
        element: Any = one
        tags = {tag.k: tag.v for tag in element.tags if not tag.k.startswith(("addr:", "name:", "is_in"))}
        if element.is_node():
            if element.location.valid():
                yield "n", _Element(element.id, tags, (element.location.lat, element.location.lon))
        elif element.is_way():
            yield "w", _Element(element.id, tags, nodes=tuple(node.ref for node in element.nodes))
        else:
            members = tuple((member.type, member.ref, member.role) for member in element.members)
            yield "r", _Element(element.id, tags, members=members)


class _Cell:
    """A cell of the grid: a copy of an extract, a town's name, houses, and the motorway to the cell east of it."""

    def __init__(self, number: int, columns: int, piece: _Piece) -> None:
        row, column = divmod(number, columns)
        self._number, self._piece = number, piece
        self._base = (number + 1) * _IDS_OF_CELL
        self._south = _SOUTH_WEST[0] + row * _CELL_M / _METRES_A_DEGREE
        self._west = _SOUTH_WEST[1] + column * _CELL_M / (_METRES_A_DEGREE * math.cos(math.radians(_SOUTH_WEST[0])))
        self._chance = random.Random(number)  # noqa: S311 - reproducible, not secret
        self._houses = [
            (self._chance.uniform(-_REACH_M, _REACH_M), self._chance.uniform(-_REACH_M, _REACH_M))
            for _ in range(_HOUSES)
        ]
        self._motorways = list(self._lines())

    @property
    def town(self) -> str:
        """The name of the place in its middle."""
        return town_of(self._number)

    def nodes(self) -> Iterator[mutable.Node]:
        """Yield all nodes, by id."""
        places = 0
        for node in self._piece.nodes:
            tags = dict(node.tags)
            if "place" in tags and "name" in tags:  # one of a name alone: the word must mean one place
                places += 1
                tags["name"] = name_of(self._number * _NAMES_OF_CELL + places)
            yield self._node(node.number, node.position, tags)
        number = len(self._piece.nodes) + 1
        yield self._node(number, (0.0, 0.0), {"place": "town", "name": self.town})
        for line in (*self._outlines(), *(line for line, _ in self._motorways)):
            for position in line:
                number += 1
                yield self._node(number, position, {})

    def ways(self) -> Iterator[mutable.Way]:
        """Yield all ways, by id."""
        for way in self._piece.ways:
            tags = {key: value for key, value in way.tags.items() if key != "place"}
            yield self._way(way.number, way.nodes, tags)
        number, node = len(self._piece.ways), len(self._piece.nodes) + 2
        for line in self._outlines():
            number += 1
            corners = range(node, node + len(line))
            yield self._way(number, (*corners, node), {"building": "house"})
            node += len(line)
        begins: list[int] = []
        for line, _ in self._motorways:
            begins.append(node)
            node += len(line)
        ends = {0: begins[0] + 20, 1: begins[1] + 20}
        for index, (line, tags) in enumerate(self._motorways):
            number += 1
            refs = list(range(begins[index], begins[index] + len(line)))
            if tags["highway"] == "motorway_link":
                refs = [ends[index % 2], *refs] if index < 4 else [*refs, ends[index % 2] + 2]
            yield self._way(number, tuple(refs), tags)

    def relations(self) -> Iterator[mutable.Relation]:
        """Yield all relations, by id."""
        for relation in self._piece.relations:
            members = [(sort, self._base + key, role) for sort, key, role in relation.members]
            yield mutable.Relation(id=self._base + relation.number, members=members, tags=dict(relation.tags))

    def _outlines(self) -> Iterator[list[Position]]:
        for north, east in self._houses:
            yield [
                (north, east),
                (north, east + _HOUSE_M),
                (north + _HOUSE_M, east + _HOUSE_M),
                (north + _HOUSE_M, east),
            ]

    def _lines(self) -> Iterator[tuple[list[Position], dict[str, str]]]:
        """Add two carriageways north of the town, with an exit and an entry at each."""
        steps = range(60)
        bend = [60.0 * math.sin(step / 7) for step in steps]
        length_m = _CELL_M / (len(bend) - 1)
        ref = f"A {1 + self._number // COLUMNS}"
        north = _REACH_M - 500.0
        motorway = {"highway": "motorway", "oneway": "yes", "lanes": "2", "maxspeed": "120", "ref": ref}
        link = {"highway": "motorway_link", "oneway": "yes", "lanes": "1", "maxspeed": "60"}
        east = [-_CELL_M / 2 + step * length_m for step in steps]
        yield [(north + bend[step], east[step]) for step in steps], motorway
        yield [(north + 30.0 + bend[step], east[step]) for step in reversed(steps)], motorway
        for side, along in ((-1.0, 1.0), (1.0, -1.0)):
            first = east[20] if side < 0 else east[39]
            base = north + (30.0 if side > 0 else 0.0) + (bend[20] if side < 0 else bend[39])
            yield [(base + side * off, first + along * run) for run, off in ((150.0, 12.0), (300.0, 40.0))], link
        for side, along in ((-1.0, 1.0), (1.0, -1.0)):
            first = east[22] if side < 0 else east[37]
            base = north + (30.0 if side > 0 else 0.0) + (bend[22] if side < 0 else bend[37])
            yield [(base + side * off, first - along * run) for run, off in ((300.0, 40.0), (150.0, 12.0))], link

    def _node(self, number: int, position: Position, tags: Mapping[str, str]) -> mutable.Node:
        latitude = self._south + position[0] / _METRES_A_DEGREE
        longitude = self._west + position[1] / (_METRES_A_DEGREE * math.cos(math.radians(self._south)))
        return mutable.Node(id=self._base + number, location=(longitude, latitude), tags=dict(tags))

    def _way(self, number: int, nodes: Sequence[int], tags: Mapping[str, str]) -> mutable.Way:
        return mutable.Way(id=self._base + number, nodes=[self._base + node for node in nodes], tags=dict(tags))


@dataclass(frozen=True)
class _Timed:
    """The seconds for a town's scenario, and whether it was generated from the country."""

    place: str
    seconds: float
    made: bool


@asynccontextmanager
async def _server(bench: MapsBench, workspace: Path) -> AsyncIterator[tuple[Client, psutil.Process]]:
    """Open a client of a server in its own process, and return that process too."""
    arguments = ["-m", "plannerforge", "serve", "--workspace", str(workspace), "--roots", str(bench.scratch)]
    settings = {"STARTER": "false", "WARM_UP": "false", "MAPS_ONLINE": "offline", "WORKERS": str(bench.workers)}
    environment = {**os.environ, **{f"PLANNERFORGE_{name}": value for name, value in settings.items()}}
    before = {child.pid for child in psutil.Process().children()}
    async with Client(StdioServerParameters(command=sys.executable, args=arguments, env=environment)) as client:
        await client.list_tools()
        yield client, next(child for child in psutil.Process().children() if child.pid not in before)


def measure(bench: MapsBench) -> Figures:
    """Make the country, take it in, make scenarios in its towns, and judge its sites by the file itself."""
    path, workspace = bench.scratch / "Syntheticland.osm.pbf", bench.folder("country")
    nodes = write_country(bench.maps, path)
    killed = anyio.run(_broken_off, bench, path, workspace)
    figures, facts = anyio.run(_through_the_server, bench, path, workspace)
    index = workspace / "extracts" / facts.map_id / INDEX_NAME
    cuts = _cuts_alone(index, facts, bench.folder("cuts"))
    indexing_mb = max(killed.peak_mb, float(figures["country_indexing_mb"]))
    return {
        **figures,
        **cuts,
        "country_memory_mb": round(max(indexing_mb, cuts["country_cutting_mb"])),
        "country_indexing_mb": round(indexing_mb),
        "country_index_s": round(killed.seconds + float(figures["country_resumed_s"]), 1),
        "country_killed_at": killed.share,
        "country_kept_tiles": killed.tiles,
        "country_nodes": nodes,
        "country_file_mb": round(path.stat().st_size / 1e6, 1),
        "country_index_mb": round(index.stat().st_size / 1e6, 1),
        **_judged(index, path, bench.folder("judged")),
    }


@dataclass(frozen=True)
class _Killed:
    """The state of a server when it was killed: share of the work, seconds, peak in MB, tiles with sites."""

    share: float
    seconds: float
    peak_mb: float
    tiles: int


async def _broken_off(bench: MapsBench, path: Path, workspace: Path) -> _Killed:
    """Begin to take the country in, and kill the server with all its workers.

    Raises:
        RuntimeError: the work ended before that.
    """
    started = time.perf_counter()
    async with _server(bench, workspace) as (client, server):
        job = await ask(client, "import_files", path=str(path))
        while (job := await ask(client, "get_job", job_id=job["job_id"], wait_s=1))["share"] < _KILLED_AT:
            if job["state"] != "running":
                raise RuntimeError(f"the work ended as {job['state']} before the kill: {job}")
        found = _Killed(job["share"], time.perf_counter() - started, _worker_peak_mb(server), 0)
        for process in (server, *server.children(recursive=True)):
            process.kill()
    (index,) = workspace.glob(f"extracts/*/{INDEX_NAME}")
    with closing(sqlite3.connect(index)) as database:
        (tiles,) = database.execute("SELECT COUNT(*) FROM sited").fetchone()
    return replace(found, tiles=tiles)


async def _through_the_server(
    bench: MapsBench, path: Path, workspace: Path
) -> tuple[dict[str, float | int | str], MapFacts]:
    count = min(bench.limit or _PLACES, _PLACES)
    towns = [town_of(number) for number in range(0, COLUMNS * ROWS, COLUMNS * ROWS // _PLACES)][:count]
    async with _server(bench, workspace) as (client, server):
        started = time.perf_counter()
        await ask_to_the_end(client, "import_files", path=str(path))
        resumed_s = time.perf_counter() - started
        await ask(client, "describe_catalog", facet="maps")
        indexing_mb = _worker_peak_mb(server)
        timed = [await _made(client, town) for town in towns]
        generating_mb, server_mb = _worker_peak_mb(server), _peak_of(server.pid)
    records = [json.loads(row) for row in _records(workspace)]
    facts = next(facts for facts in map(MapFacts.model_validate, records) if facts.extract is not None)
    seconds = [one.seconds for one in timed if one.made]
    figures: dict[str, float | int | str] = {
        "country_cut_s": round(statistics.median(seconds), 2),
        "country_cut_worst_s": round(max(seconds), 2),
        "country_places": len(timed),
        "country_refused": sum(not one.made for one in timed),
        "country_indexing_mb": indexing_mb,
        "country_generating_mb": round(generating_mb),
        "country_server_mb": round(server_mb),
        "country_resumed_s": round(resumed_s, 1),
        "country_tiles": facts.extract.tiles if facts.extract is not None else 0,
    }
    return figures, facts


async def _made(client: Client, town: str) -> _Timed:
    started = time.perf_counter()
    answer = await client.call_tool("generate_scenarios", {"place": town})
    seconds = time.perf_counter() - started
    content = answer.structured_content or {}
    told = any("was cut out of" in note for note in content.get("notes", ()))
    made = not answer.is_error and told and content["scenarios"][0]["place"] == town
    sys.stderr.write(f"{town}: {seconds:.2f} s{'' if made else f', not made: {answer.content}'}\n")
    return _Timed(town, seconds, made)


def _worker_peak_mb(server: psutil.Process) -> float:
    """Return the peak resident memory of one of the server's workers."""
    return max((_peak_of(worker.pid) for worker in server.children(recursive=True)), default=0.0)


def _peak_of(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    peak = next((line for line in status.splitlines() if line.startswith("VmHWM")), "VmHWM: 0 kB")
    return int(peak.split()[1]) / 1000


def _records(workspace: Path) -> list[str]:
    with closing(sqlite3.connect(workspace / "workspace.sqlite")) as database:
        return [row[0] for row in database.execute("SELECT record FROM artifacts WHERE kind = 'map'")]


def _cuts_alone(index: Path, facts: MapFacts, folder: Path) -> dict[str, float]:
    """Cut a town out in a separate process; return the seconds, whether the bytes repeat, and its memory."""
    seconds: list[float] = []
    same = True
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        for number in range(0, COLUMNS * ROWS, COLUMNS * ROWS // _PLACES):
            request = CutExtractRequest(index=str(index), folder=str(folder), facts=facts, place=town_of(number))
            (one_s, one), (_, other) = pool.submit(_cut_s, request).result(), pool.submit(_cut_s, request).result()
            seconds.append(one_s)
            same = same and one == other
        cutting_mb = _peak_of(pool.submit(os.getpid).result())
    return {
        "country_cut_alone_s": round(statistics.median(seconds), 2),
        "country_same_bytes": int(same),
        "country_cutting_mb": round(cutting_mb),
    }


def _cut_s(request: CutExtractRequest) -> tuple[float, str]:
    """Return the seconds of a cut, and the digest of its result."""
    started = time.perf_counter()
    path = cut_extract(request, silent).path
    return time.perf_counter() - started, hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _judged(index: Path, path: Path, folder: Path) -> dict[str, int]:
    """Count the tiles with the same sites as a small map of the same area."""
    with closing(sqlite3.connect(index)) as database:
        tiles = [row[0] for row in database.execute("SELECT DISTINCT tile FROM sites ORDER BY tile")]
        (sites_twice,) = database.execute(_SITES_TWICE).fetchone()
        chosen = random.Random(18).sample(tiles, min(_JUDGED_TILES, len(tiles)))  # noqa: S311 - reproducible
        held = {
            tile: set(database.execute("SELECT kind, mark FROM sites WHERE tile = ?", (tile,)).fetchall())
            for tile in chosen
        }
    boxes = {tile: _box_of(tile, _SURROUNDINGS_DEG) for tile in chosen}
    files = _small_maps(path, boxes, folder)
    found = {tile: _sites_of(files[tile], _box_of(tile, 0.0)) for tile in chosen}
    for tile in chosen:
        if found[tile] != held[tile]:
            sys.stderr.write(f"tile {tile}: only in the index {sorted(held[tile] - found[tile])[:5]}, ")
            sys.stderr.write(f"only in the small map {sorted(found[tile] - held[tile])[:5]}\n")
    return {
        "country_sites_twice": sites_twice,
        "country_tiles_judged": len(chosen),
        "country_tiles_equal": sum(found[tile] == held[tile] for tile in chosen),
        "country_sites_judged": sum(len(sites) for sites in found.values()),
    }


def _box_of(tile: int, around_deg: float) -> Box:
    """Return a tile's box as docs/maps.md states it: 0.05 degrees, numbered from the south-west by rows."""
    row, column = divmod(tile, 7200)
    south, west = row / 20 - 90, column / 20 - 180
    return south - around_deg, west - around_deg, south + 0.05 + around_deg, west + 0.05 + around_deg


def _small_maps(path: Path, boxes: Mapping[int, Box], folder: Path) -> dict[int, Path]:
    """Return what osmium finds in each box: complete ways with a node there, in two passes over the file."""
    inside: dict[int, set[int]] = {tile: set() for tile in boxes}
    for one in osmium.FileProcessor(str(path), osmium.osm.NODE):
        node: Any = one
        latitude, longitude = node.location.lat, node.location.lon
        for tile, (south, west, north, east) in boxes.items():
            if south <= latitude <= north and west <= longitude <= east:
                inside[tile].add(node.id)
    writers = {
        tile: osmium.BackReferenceWriter(str(folder / f"{tile}.osm"), ref_src=str(path), overwrite=True)
        for tile in boxes
    }
    for one in osmium.FileProcessor(str(path)):
        element: Any = one
        for tile, writer in writers.items():
            if element.is_node():
                if element.id in inside[tile] and len(element.tags):
                    writer.add(element)
            elif element.is_way() and any(node.ref in inside[tile] for node in element.nodes):
                writer.add(element)
    for writer in writers.values():
        writer.close()
    return {tile: folder / f"{tile}.osm" for tile in boxes}


def _sites_of(path: Path, box: Box) -> set[tuple[str, str]]:
    finder = SiteFinder(read_map_file(path))
    south, west, north, east = box
    return {
        (kind, site.osm_id)
        for kind in get_args(SiteType)
        for site in finder.find(kind)
        if south <= site.latitude < north and west <= site.longitude < east
    }
