"""The maps of ``make bench-generation``: every file of a folder as a user adds it, binary extracts written as .osm."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.maps.binary_osm import write_as_xml
from plannerforge.engine.maps.facts import read_map
from plannerforge.engine.maps.index import MapEntry
from plannerforge.engine.maps.unpacking import is_binary, is_map
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import ConvertMapRequest, ReadMapRequest


@dataclass(frozen=True)
class BenchMaps:
    """Maps by the names of their files.

    ``files`` are readable as XML, ``unread`` says why others are not; ``places`` is what the folder's list tells of
    each, and ``entries`` are those that are listed, as the generator takes them.
    """

    entries: tuple[MapEntry, ...]
    files: Mapping[str, Path]
    unread: Mapping[str, str]
    places: Mapping[str, Any]

    @property
    def names(self) -> frozenset[str]:
        """Files that requests can be made for."""
        return frozenset(entry.facts.file_name for entry in self.entries)

    def name_of(self, map_id: str) -> str:
        """The file of a map."""
        return next(entry.facts.file_name for entry in self.entries if entry.facts.map_id == map_id)

    def drives_left(self, name: str) -> bool:
        """Whether traffic keeps to the left there; to the right where the list does not say."""
        return bool(self.places.get(name, {}).get("drives_on") == "left")


def read_maps(folder: Path, scratch: Path) -> BenchMaps:
    """Read every map of a folder; ``scratch`` takes the binary ones as XML."""
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
    """A map with the places and the country that the list names."""
    facts = read_map(ReadMapRequest(path=str(path), place=shown["places"][0], country=shown["country"]), silent)
    return MapEntry(facts.model_copy(update={"file_name": name, "places": (*shown["places"], *facts.places)}), path)
