"""The maps of ``make bench-generation``, and the evidence in their files about a place.

Maps are all files of a folder as a user adds them, with binary extracts written as .osm. Evidence (names, houses,
built-up land, signed limits) is read independently of the generator.
"""

import json
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from ...engine.execution import silent
from ...engine.geometry import Points
from ...engine.maps import MapEntry, is_binary, is_map, read_map, write_as_xml
from ...schemas.errors import PlannerForgeError
from ...schemas.generation import ConvertMapRequest, ReadMapRequest

NAMING = re.compile(r"(name(:.*)?|(alt|loc|int|official|short)_name|ref|addr:street|destination(:.*)?)$")
BUILT_UP_LAND = ("residential", "commercial", "retail", "industrial")
METRES_A_DEGREE = 111_200.0
"""Metres per degree of latitude, on a sphere of the Earth's mean radius."""
MANY_HOUSES = 3
"""Houses within reach that make a place built up (chosen)."""


@dataclass(frozen=True)
class Mapped:
    """A point, line or outline of a map: (latitude, longitude) in degrees of its nodes, shape (n, 2), and its tags."""

    line: Points
    tags: "Mapping[str, str]"

    def distance_m(self, latitude: float, longitude: float) -> float:
        """Return the distance from a position to the nearest point of the line in m."""
        from shapely import LineString, Point

        scale = np.array((1.0, math.cos(math.radians(latitude)))) * METRES_A_DEGREE
        local = (self.line - np.array((latitude, longitude))) * scale
        shape = LineString(local) if len(local) > 1 else Point(local[0])
        return float(shape.distance(Point(0.0, 0.0)))

    def surrounds(self, latitude: float, longitude: float) -> bool:
        """Return whether a position is inside the outline."""
        from shapely import Point, Polygon

        closed = len(self.line) > 3 and bool((self.line[0] == self.line[-1]).all())
        return closed and bool(Polygon(self.line).buffer(0.0).contains(Point(latitude, longitude)))


@dataclass(frozen=True)
class MapEvidence:
    """Everything on a map that has tags and a position."""

    mapped: tuple[Mapped, ...]

    def holds(self, key: str, value: str) -> bool:
        """Return whether anything on the map has a tag."""
        return any(found.tags.get(key) == value for found in self.mapped)

    def names_near(self, name: str, latitude: float, longitude: float, within_m: float) -> bool:
        """Return whether something within a distance has all words of ``name`` in its name, number or sign."""
        words = _words(name)
        return any(
            any(words <= _words(part) for part in _names(found)) and found.distance_m(latitude, longitude) <= within_m
            for found in self._around(latitude, longitude, within_m)
        )

    def houses(self, latitude: float, longitude: float, within_m: float) -> int:
        """Count buildings within ``within_m``."""
        return sum(
            "building" in found.tags and found.distance_m(latitude, longitude) <= within_m
            for found in self._around(latitude, longitude, within_m)
        )

    def is_built_up(self, latitude: float, longitude: float, within_m: float) -> bool:
        """Return whether a position is on built-up land or among houses."""
        land = (found for found in self.mapped if found.tags.get("landuse") in BUILT_UP_LAND)
        return self.houses(latitude, longitude, within_m) >= MANY_HOUSES or any(
            found.surrounds(latitude, longitude) for found in land
        )

    def limits_kmh(self, latitude: float, longitude: float, within_m: float) -> list[float]:
        """Return signed speed limits of the roads within ``within_m``."""
        near = (
            found
            for found in self._around(latitude, longitude, within_m)
            if "highway" in found.tags and found.distance_m(latitude, longitude) <= within_m
        )
        signed = (re.fullmatch(r"(\d+)( mph)?", found.tags.get("maxspeed", "")) for found in near)
        return [float(sign[1]) * (1.609344 if sign[2] else 1.0) for sign in signed if sign is not None]

    def _around(self, latitude: float, longitude: float, within_m: float) -> Iterable[Mapped]:
        """Return objects that may be within ``within_m``, by their bounds."""
        reach = within_m / METRES_A_DEGREE / max(math.cos(math.radians(latitude)), 0.1)
        spot = np.array((latitude, longitude))
        return (
            found
            for found in self.mapped
            if bool((found.line.min(axis=0) <= spot + reach).all() and (found.line.max(axis=0) >= spot - reach).all())
        )


def read_evidence(path: Path) -> MapEvidence:
    """Read an .osm file, element by element; objects without a readable position are left out."""
    places: dict[str, tuple[float, float]] = {}
    found: list[Mapped] = []
    for _, element in etree.iterparse(path, tag=("node", "way"), resolve_entities=False):
        tags = {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}
        if element.tag == "node":
            line = _position(element)
            if line:
                places[element.get("id", "")] = line[0]
        else:
            line = [places[nd.get("ref", "")] for nd in element.iterfind("nd") if nd.get("ref") in places]
        if tags and line:
            found.append(Mapped(np.array(line), tags))
        element.clear()
    return MapEvidence(tuple(found))


def _position(node: etree._Element) -> list[tuple[float, float]]:
    """Return latitude and longitude of a node in degrees; empty if they are not numbers."""
    try:
        latitude, longitude = float(node.get("lat", "nan")), float(node.get("lon", "nan"))
    except ValueError:
        return []
    return [(latitude, longitude)] if math.isfinite(latitude) and math.isfinite(longitude) else []


def _names(found: Mapped) -> list[str]:
    return [part for key, value in found.tags.items() if NAMING.match(key) for part in value.split(";")]


def _words(name: str) -> frozenset[str]:
    """Return words without case and accents; a number next to a letter (``A4``) counts as a separate word."""
    plain = unicodedata.normalize("NFKD", name.casefold()).encode("ascii", "ignore").decode()
    return frozenset(re.findall(r"\d+|[a-z]+", plain) or [name.casefold()])


@dataclass(frozen=True)
class BenchMaps:
    """Maps by the names of their files.

    ``files`` are readable as XML; ``unread`` states why other files are not. ``places`` is the content of the folder's
    list for each, and ``entries`` are the listed maps, in the generator's format.
    """

    entries: tuple[MapEntry, ...]
    files: Mapping[str, Path]
    unread: Mapping[str, str]
    places: Mapping[str, Any]

    @property
    def names(self) -> frozenset[str]:
        """The names of the map files for which requests can be made."""
        return frozenset(entry.facts.file_name for entry in self.entries)

    def name_of(self, map_id: str) -> str:
        """Return the file of a map."""
        return next(entry.facts.file_name for entry in self.entries if entry.facts.map_id == map_id)

    def drives_left(self, name: str) -> bool:
        """Return whether traffic keeps left there; it keeps right if the list does not state it."""
        return bool(self.places.get(name, {}).get("drives_on") == "left")


def read_maps(folder: Path, scratch: Path) -> BenchMaps:
    """Read every map of a folder; ``scratch`` gets the binary maps as XML."""
    places = json.loads((folder / "places.json").read_text(encoding="utf-8"))
    entries: list[MapEntry] = []
    files: dict[str, Path] = {}
    unread: dict[str, str] = {}
    for path in sorted(entry for entry in folder.iterdir() if is_map(entry)):
        try:
            files[path.name] = _plain(path, scratch)
            if path.name in places:
                entries.append(_entry(path.name, files[path.name], places[path.name]))
        except PlannerForgeError as error:
            unread[path.name] = error.message
    return BenchMaps(tuple(entries), files, unread, places)


def _plain(path: Path, scratch: Path) -> Path:
    if not is_binary(path):
        return path
    return Path(write_as_xml(ConvertMapRequest(path=str(path), folder=str(scratch)), silent).path)


def _entry(name: str, path: Path, shown: Mapping[str, Any]) -> MapEntry:
    """Return a map with the places and the country from the list."""
    facts = read_map(ReadMapRequest(path=str(path), place=shown["places"][0], country=shown["country"]), silent)
    return MapEntry(facts.model_copy(update={"file_name": name, "places": (*shown["places"], *facts.places)}), path)
