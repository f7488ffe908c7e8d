"""A country of millions of nodes that nobody mapped, and what it costs to make scenarios in it.

``write_country`` makes it of the shared extracts, the same bytes each time: in every cell of a grid lies a copy of one,
with ids and place names of its own; motorways with slip roads join the cells; houses in bulk stand around. It lies in
the South Pacific, where no country is near.

Keys: ``country_cut_s``: seconds of a ``generate_scenarios`` call through the server, from the words for a place to the
stored scenario (median over ``country_places`` towns; ``country_cut_worst_s``). ``country_cut_alone_s``: of it, looking
the place up, cutting it out and reading what it shows (median; in a process that did nothing before).
``country_memory_mb``: the peaks of the server's process and of its largest worker together, while the country is
indexed and cut. ``country_index_s``, ``country_file_mb``, ``country_index_mb``, ``country_nodes``, ``country_tiles``.
``country_refused``: towns where nothing could be made. ``country_tiles_equal``: of ``country_tiles_judged`` tiles,
those whose sites in the index are those of the same area when it is read as a small map that osmium cut out of the
file; ``country_sites_judged``: how many sites that were. ``country_same_bytes``: 1 where a cut made again has the same
bytes.
"""

import json
import math
import os
import random
import sqlite3
import statistics
import sys
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args

import anyio
import osmium
import psutil
from mcp import Client, StdioServerParameters
from osmium.osm import mutable

from ...engine.execution import silent
from ...engine.maps import SiteFinder, cut_extract, read_map_file
from ...schemas.extracts import INDEX_NAME, CutExtractRequest
from ...schemas.generation import MapFacts, SiteType
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
"""Extracts that the country is made of, in turn; traffic keeps to the right on all of them."""
COLUMNS, ROWS = 12, 12
"""Cells of the grid: with them the country has over five million nodes."""
_CELL_M, _REACH_M = 40_000.0, 19_000.0
"""Side of a cell; from its middle to the farthest that is copied."""
_SOUTH_WEST = (-45.0, -130.0)
_METRES_A_DEGREE = 111_195.0
_HOUSES, _HOUSE_M = 1_800, 10.0
"""Houses of a cell beside those of its extract, and their sides."""
_IDS_OF_CELL = 1_000_000
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
"""Towns that scenarios are made in, and tiles whose sites are judged."""
_SURROUNDINGS_DEG = 0.012
"""Around a tile, what the product says that it looks at."""
Position = tuple[float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Element:
    """A node, way or relation of an extract: its number there, its tags, and what it is made of."""

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
    """A name for a place that no other number has."""
    base = len(_SYLLABLES)
    parts = [_SYLLABLES[number // base**power % base] for power in range(4)]
    return "".join(parts).capitalize()


def write_country(maps: Path, target: Path, *, columns: int = COLUMNS, rows: int = ROWS) -> int:
    """Write the country as .osm.pbf, nodes before ways before relations; the number of its nodes."""
    pieces = [_piece(maps / name) for name in _SOURCES]
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
        return name_of(self._number * 64)

    def nodes(self) -> Iterator[mutable.Node]:
        """All nodes, by id."""
        places = 0
        for node in self._piece.nodes:
            tags = dict(node.tags)
            if "place" in tags and "name" in tags:  # one of a name alone: the word must mean one place
                places += 1
                tags["name"] = name_of(self._number * 64 + min(places, 62))
            yield self._node(node.number, node.position, tags)
        number = len(self._piece.nodes) + 1
        yield self._node(number, (0.0, 0.0), {"place": "town", "name": self.town})
        for line in (*self._outlines(), *(line for line, _ in self._motorways)):
            for position in line:
                number += 1
                yield self._node(number, position, {})

    def ways(self) -> Iterator[mutable.Way]:
        """All ways, by id."""
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
        for line, tags in self._motorways:
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
        """All relations, by id."""
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
        """Two carriageways north of the town, an exit and an entry at each, and a road past their ends."""
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
