"""Places, districts and streets in other spellings: ``python -m benchmarks.maps.places FOLDER``.

The folder holds OpenStreetMap extracts, such as the test data of public routing programs. Every extract is read as a
map, all maps are then available, and each request must find its own.

Requests are drawn from the extracts' tags (``name:*``, ``alt_name``, ...), at most ``PER_KEY`` for each extract and
tag, and read from ``words_for_places.tsv``, written by hand before any was tried. For ``HALVES`` road names of each
extract in turn, a request has only the beginning of the name, or joins it with the extract's largest place, in either
order. Extracts listed there under ``tune`` were used in development; all others are held out.

A road counts for an extract only if the extract holds a stretch of it, because relations name ways far outside.

A request for a place is right if it finds exactly the maps that show it. A request for a road is right if it finds the
map and the road is among the streets required of the site; other maps may have a road of that name too.

Keys: ``places_kept_aside``: share of the held-out spellings that are right; ``half_typed``: the same for partial and
compound names; ``places_tuned``, ``half_typed_tuned``: the same for the others; ``places_asked``, ``half_asked``,
``languages``: how many requests and languages the first two count.
"""

import hashlib
import math
import re
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import islice, pairwise
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import osmium

from plannerforge.engine.execution import silent
from plannerforge.engine.maps import (
    MapEntry,
    built_in_maps,
    find_maps,
    is_binary,
    is_map,
    read_map,
    unpacked,
    write_as_xml,
)
from plannerforge.schemas.errors import PlannerForgeError, UnknownName
from plannerforge.schemas.generation import ConvertMapRequest, ReadMapRequest

from ..harness import Figures, existing, print_figures, share

WORDS = Path(__file__).parent / "words_for_places.tsv"
PER_KEY = 6
"""Number of requests from one tag of one extract: a city has an ``alt_name`` for every street (chosen)."""
HALVES = 9
"""Number of half-typed and compound requests for one extract (chosen)."""
BEGUN = 0.6
"""Share of the letters in a half-typed name (chosen)."""
_SHORTEST_BEGUN = 10
"""Least number of letters that identify more than a kind of road (chosen)."""
_CLOSED = ("access", "vehicle", "motor_vehicle", "motorcar")
"""Tags of a road; if one says ``no`` or ``private``, the road is not part of a map for cars."""
_DRIVEN = re.compile(r"(motorway|trunk|primary|secondary|tertiary)(_link)?|unclassified|residential|living_street")
_SETTLED = re.compile(
    r"city|town|village|suburb|borough|quarter|neighbourhood|hamlet|isolated_dwelling|square|locality"
)
_LARGEST = ("city", "town", "village", "suburb")
_NAME = re.compile(r"(name|(?:alt|official|short|loc|old|int)_name)(?::(?P<language>[a-z]{2,3}(?:[-_]\w+)*))?")


@dataclass(frozen=True)
class _Query:
    """Words, the maps that they mean, and the road; ``road`` empty: a place. ``language`` empty: not known."""

    words: str
    maps: frozenset[str]
    road: str
    half: bool
    language: str


def measure(folder: Path, workers: int = 1) -> Figures:
    """Measure all of it on the extracts of a folder."""
    with TemporaryDirectory() as scratch:
        entries = _read(sorted(path for path in folder.iterdir() if is_map(path)), Path(scratch), workers)
        written, tuned = _written(frozenset(entries))
        asked = [*written, *_drawn(entries), *_halves(entries)]
    maps = [*entries.values(), *built_in_maps()]
    stems = {entry.facts.map_id: stem for stem, entry in entries.items()}
    rights = [(one, _is_right(one, maps, stems)) for one in asked]
    kept = [(one, right) for one, right in rights if not one.maps <= tuned]
    told = [(one, right) for one, right in rights if one.maps <= tuned]
    return {
        "places_kept_aside": share(right for one, right in kept if not one.half),
        "places_asked": sum(not one.half for one, _ in kept),
        "languages": len({one.language for one, _ in kept if one.language}),
        "half_typed": share(right for one, right in kept if one.half),
        "half_asked": sum(one.half for one, _ in kept),
        "places_tuned": share(right for one, right in told if not one.half),
        "half_typed_tuned": share(right for one, right in told if one.half),
    }


def _read(paths: Sequence[Path], scratch: Path, workers: int) -> dict[str, MapEntry]:
    """Return the maps of the extracts by file name, without those that have no road for vehicles."""
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        found = pool.map(_entry, paths, [scratch] * len(paths))
    return {_stem(path): entry for path, entry in zip(paths, found, strict=True) if entry is not None}


def _entry(path: Path, scratch: Path) -> MapEntry | None:
    folder = scratch / _stem(path)
    folder.mkdir()
    try:
        if is_binary(path):
            plain = Path(write_as_xml(ConvertMapRequest(path=str(path), folder=str(folder)), silent).path)
        else:
            plain = unpacked(path, folder)
        return MapEntry(read_map(ReadMapRequest(path=str(plain), map_id=f"map_of_{_stem(path)}"), silent), plain)
    except PlannerForgeError as error:
        sys.stderr.write(f"{path.name} is left out: {error.message}\n")
        return None


def _stem(path: Path) -> str:
    return path.name.partition(".")[0]


def _written(stems: frozenset[str]) -> tuple[list[_Query], frozenset[str]]:
    """Return the handwritten requests for the available extracts, and the tuned extracts."""
    asked: list[_Query] = []
    tuned: set[str] = set()
    is_tuned = True
    for line in WORDS.read_text(encoding="utf-8").splitlines():
        is_tuned = is_tuned and not line.startswith("# report")
        if line.startswith("#"):
            continue
        names, kind, words, road = line.split("\t")
        maps = frozenset(names.split("|"))
        tuned |= maps if is_tuned and len(maps) == 1 else frozenset()
        if maps <= stems:
            asked.append(_Query(words, maps, road, kind == "half", ""))
    return asked, frozenset(tuned)


def _drawn(entries: Mapping[str, MapEntry]) -> list[_Query]:
    """Return the requests drawn from the tags of the extracts, with every extract that has a name."""
    holders: dict[str, set[str]] = {}
    rows: dict[tuple[str, str, str], tuple[str, str]] = {}
    for stem, entry in entries.items():
        for main, is_road, key, other in _other_names(entry.path):
            holders.setdefault(other, set()).add(stem)
            rows.setdefault((stem, main, other), (key, main if is_road else ""))
    drawn: Counter[tuple[str, str]] = Counter()
    asked = []
    for (stem, _, other), (key, road) in rows.items():
        drawn[stem, key] += 1
        if drawn[stem, key] <= PER_KEY:
            match = _NAME.fullmatch(key)
            language = "" if match is None else match["language"] or ""
            asked.append(_Query(other, frozenset(holders[other]), road, half=False, language=language))
    return asked


def _other_names(path: Path) -> Iterator[tuple[str, bool, str, str]]:
    """Return main name, whether it is a road's, tag and name of everything in an extract with another name."""
    nodes = _nodes(path)
    for element in osmium.FileProcessor(str(path)):
        tags = {tag.k: tag.v for tag in element.tags}
        is_road = element.is_way() and _is_driven(tags) and _is_there(element, nodes)
        is_place = _is_settled(tags)
        if "name" not in tags or not (is_road or is_place):
            continue
        for key, value in tags.items():
            if _NAME.fullmatch(key) and key != "name" and value != tags["name"] and ";" not in value:
                yield tags["name"], is_road, key, value


def _nodes(path: Path) -> frozenset[int]:
    """Return the ids of the nodes that an extract holds."""
    return frozenset(node.id for node in osmium.FileProcessor(str(path), osmium.osm.NODE))


def _is_there(way: Any, nodes: frozenset[int]) -> bool:
    """Return True if an extract holds a stretch of a way; relations name ways with nodes far outside."""
    return any(one.ref in nodes and other.ref in nodes for one, other in pairwise(way.nodes))


def _is_driven(tags: Mapping[str, str]) -> bool:
    is_open = all(tags.get(key) not in ("no", "private") for key in _CLOSED)
    return is_open and _DRIVEN.fullmatch(tags.get("highway", "")) is not None


def _is_settled(tags: Mapping[str, str]) -> bool:
    return _SETTLED.fullmatch(tags.get("place", "")) is not None


def _halves(entries: Mapping[str, MapEntry]) -> list[_Query]:
    """Return half-typed and compound requests for roads of each extract, chosen by a digest of their names."""
    asked = []
    for stem, entry in entries.items():
        roads: dict[str, None] = {}
        settled: list[tuple[int, str]] = []
        nodes = _nodes(entry.path)
        for element in osmium.FileProcessor(str(entry.path)):
            tags = {tag.k: tag.v for tag in element.tags}
            name = tags.get("name", "")
            if len(name) >= 2 and element.is_way() and _is_driven(tags) and _is_there(element, nodes):
                roads[name] = None
            elif name and tags.get("place") in _LARGEST:
                settled.append((_LARGEST.index(tags["place"]), name))
        largest = min(settled, default=(0, ""))[1]
        chosen = sorted(roads, key=lambda name: (hashlib.sha256(name.encode()).digest(), name))
        kinds = [_begun, _before, _behind] if largest else [_begun]
        words = [(kinds[index % len(kinds)](name, largest), name) for index, name in enumerate(chosen)]
        half = ((text, name) for text, name in words if text and text != name)
        asked += [_Query(text, frozenset([stem]), name, half=True, language="") for text, name in islice(half, HALVES)]
    return asked


def _begun(name: str, _: str) -> str:
    return name[: math.ceil(BEGUN * len(name))] if len(name) >= _SHORTEST_BEGUN else ""


def _before(name: str, place: str) -> str:
    return f"{name} {place}"


def _behind(name: str, place: str) -> str:
    return f"{place} {name}"


def _is_right(asked: _Query, maps: Sequence[MapEntry], stems: Mapping[str, str]) -> bool:
    try:
        found = find_maps(maps, place=asked.words)
    except UnknownName as refusal:
        sys.stderr.write(f"{asked.words!r} of {sorted(asked.maps)}: {refusal.message}\n")
        return False
    shown = {stems.get(match.entry.facts.map_id, "") for match in found}
    meant = [match for match in found if stems.get(match.entry.facts.map_id) in asked.maps]
    streets = {name for match in meant for names in match.streets for name in names}
    if asked.road:
        right = not streets.isdisjoint((asked.words, *asked.road.split("|")))
    else:
        right = bool(meant) and shown <= asked.maps
    if not right:
        sys.stderr.write(f"{asked.words!r} of {sorted(asked.maps)}: {sorted(shown)}, {sorted(streets)[:4]}\n")
    return right


def main() -> None:
    """Read the command line, measure, print."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="OpenStreetMap extracts")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    print_figures("places by other spellings", measure(existing(arguments.folder), arguments.workers))


if __name__ == "__main__":
    main()
