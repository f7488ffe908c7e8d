"""Measures how many spellings of places are understood: roads, crossings, settlements, whole maps, refusals.

Each line of ``places.tsv`` holds a spelling, its language, the maps to choose from, what it means, and whether the case
was held out while the search for names was developed. The meaning is an element of the map file (``way 123``, several
with `` + `` for a crossing, ``area node 5`` for a part of a map), ``map`` for the whole map, or ``refused`` with the
reason. This module reads the element's names and position from the file with osmium.
"""

import argparse
import csv
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.maps import MapEntry, MapMatch, find_maps, is_binary, read_map, write_as_xml
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import ConvertMapRequest, ReadMapRequest

from ..harness import shared_folder

_CASES = Path(__file__).parent / "places.tsv"
_LARGEST_AREA_DEG = 0.1
"""Height of the largest box that may represent a town or a part of one: 11 km (chosen)."""


@dataclass(frozen=True)
class PlaceCase:
    """A spelling of a place, the map files to choose from, and the expected meaning."""

    words: str
    language: str
    maps: frozenset[str]
    expected: str
    aside: bool


@dataclass(frozen=True)
class _Element:
    """An element of a map file: all its names and numbers, and its middle (latitude, longitude) in degrees."""

    names: frozenset[str]
    middle: tuple[float, float]


def place_cases() -> list[PlaceCase]:
    """Return all cases of the data file, in its order."""
    with _CASES.open(encoding="utf-8", newline="") as stream:
        return [
            PlaceCase(
                row["words"], row["language"], frozenset(row["maps"].split(",")), row["expected"], row["set"] == "aside"
            )
            for row in csv.DictReader(stream, delimiter="\t", quoting=csv.QUOTE_NONE)
        ]


def measure_places() -> tuple[float, float, int]:
    """Return the share of spellings understood in the tuned and the held-out set, and their numbers."""
    faults = place_faults(place_cases())
    shares = [
        sum(not fault for case, fault in faults if case.aside is aside)
        / max(1, sum(case.aside is aside for case, _ in faults))
        for aside in (False, True)
    ]
    return shares[0], shares[1], len(faults)


def place_faults(cases: Sequence[PlaceCase]) -> list[tuple[PlaceCase, str]]:
    """Return each case with the fault in its interpretation, empty if it is right."""
    with tempfile.TemporaryDirectory() as folder:
        files = sorted(path for path in (shared_folder() / "data" / "osm").iterdir() if ".osm" in path.name)
        entries = {path.name: _entry(path, Path(folder)) for path in files}
    return [(case, _fault(case, entries)) for case in cases]


def _entry(path: Path, folder: Path) -> MapEntry:
    plain = path
    if is_binary(path):
        plain = Path(write_as_xml(ConvertMapRequest(path=str(path), folder=str(folder)), silent).path)
    return MapEntry(read_map(ReadMapRequest(path=str(plain)), silent), path)


def _fault(case: PlaceCase, entries: Mapping[str, MapEntry]) -> str:
    try:
        matches = find_maps(list(entries.values()), place=case.words)
    except UnknownName as refusal:
        return "" if case.expected.startswith("refused") else f"refused: {refusal.message}"
    chosen = {match.entry.path.name for match in matches}
    if case.expected.startswith("refused"):
        return f"not refused: {sorted(chosen)}"
    if not chosen <= case.maps:
        return f"other maps: {sorted(chosen - case.maps)}"
    return next((fault for match in matches if (fault := wrong_there(case.expected, match))), "")


def wrong_there(expected: str, match: MapMatch) -> str:
    """Return the fault in the chosen part of a map, empty if it is the expected one."""
    elements = _elements(match.entry.path)
    box = match.box
    if expected == "map":
        south, west, north, east = _bounds(match.entry.path)
        whole = box is None or (box[0] <= south and box[1] <= west and box[2] >= north and box[3] >= east)
        return "" if whole and not match.streets else f"not the whole map: {match.area}, {match.streets}"
    if expected.startswith("area "):
        latitude, longitude = elements[expected.removeprefix("area ")].middle
        if box is None:
            return "the whole map"
        inside = box[0] < latitude < box[2] and box[1] < longitude < box[3] and not match.streets
        return "" if inside and box[2] - box[0] <= _LARGEST_AREA_DEG else f"another area: {match.area}"
    wanted = [elements[name].names for name in expected.split(" + ")]
    right = len(wanted) == len(match.streets) and all(
        any(names & {*road} for road in match.streets) for names in wanted
    )
    return "" if right else f"other roads: {match.streets}"


@cache
def _elements(path: Path) -> dict[str, _Element]:
    """Return elements with tags by ``node 1`` or ``way 1``; a way's middle is that of its first and last node."""
    import osmium

    found = {}
    for thing in osmium.FileProcessor(str(path)).with_locations():
        if not thing.tags or not (thing.is_node() or thing.is_way()):
            continue
        names = {part.strip() for tag in thing.tags if "name" in tag.k or tag.k == "ref" for part in tag.v.split(";")}
        points = [thing.location] if thing.is_node() else [node.location for node in thing.nodes]
        known = [(point.lat, point.lon) for point in points if point.valid()]
        if known:
            middle = tuple(sum(axis) / len(known) for axis in zip(*known, strict=True))
            kind = "node" if thing.is_node() else "way"
            found[f"{kind} {thing.id}"] = _Element(frozenset(names), (middle[0], middle[1]))
    return found


@cache
def _bounds(path: Path) -> tuple[float, float, float, float]:
    """Return the box around the roads of the file: south, west, north, east in degrees."""
    import osmium

    points = [
        (node.location.lat, node.location.lon)
        for thing in osmium.FileProcessor(str(path)).with_locations()
        if thing.is_way() and "highway" in thing.tags
        for node in thing.nodes
        if node.location.valid()
    ]
    latitudes, longitudes = [point[0] for point in points], [point[1] for point in points]
    return min(latitudes), min(longitudes), max(latitudes), max(longitudes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the shares and the misunderstood cases; ``--dev`` hides the held-out ones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dev", action="store_true", help="list only the cases that are not held out")
    given = parser.parse_args(arguments)
    faults = place_faults(place_cases())
    for case, fault in faults:
        if fault and not (given.dev and case.aside):
            sys.stdout.write(f"{case.words} [{case.language}, {case.expected}]: {fault}\n")
    for name, aside in (("places_understood_dev", False), ("places_understood_aside", True)):
        outcomes = [not fault for case, fault in faults if case.aside is aside]
        sys.stdout.write(f"{name} {sum(outcomes) / max(1, len(outcomes)):.4f} ({len(outcomes)} spellings)\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
