"""The maps that a call may use: those of the package, of the user's map folders, and the imported ones."""

from dataclasses import dataclass
from pathlib import Path

import anyio

from ..engine.maps import (
    MapEntry,
    SeenFile,
    SeenFiles,
    built_in_maps,
    country_code,
    foreign_format,
    is_binary,
    is_map,
    stored_name,
    unpacked,
)
from ..engine.workspace import Artifact, Recipe, content_digest
from ..schemas.errors import InvalidRequest, UnexpectedFailure, UnsafeInput, WorkerFailure
from ..schemas.generation import MAP_FACTS_VERSION, ConvertMapRequest, MapFacts, ReadMapRequest
from ..schemas.importing import ImportedItem
from ..schemas.text import counted, one_line
from .call import ToolCall
from .operations import CONVERT_MAP, CONVERT_ROADS, READ_MAP

_MOST_FILES, _MOST_MAPS = 200, 1000
"""Files that are read of one map folder, and imported maps that are known; chosen."""
_SHOWN_NOTES = 3
"""Notes on files that were left out; chosen to keep answers short."""


@dataclass(frozen=True)
class MapInventory:
    """Maps with what they show, and notes on what in the map folders cannot be used, a sentence each."""

    entries: tuple[MapEntry, ...]
    notes: tuple[str, ...]


async def maps_at_hand(call: ToolCall) -> MapInventory:
    """All maps; files in the map folders that are new or changed are read and kept first.

    A file that cannot be used is left out and named in a note. Imported maps come first, newest first; then the
    package's own.
    """
    seen = SeenFiles(call.workspace.database)
    notes = [note for folder in call.services.map_folders for note in await _taken_in(call, seen, folder)]
    await _amend_old(call)
    return _together(call, notes)


async def _amend_old(call: ToolCall) -> None:
    """Read anew what an older program kept of maps: it knew fewer names, and not where the parts of a place lie."""
    for artifact in call.workspace.newest(kind="map", limit=_MOST_MAPS):
        facts = artifact.read(MapFacts)
        if facts.facts_version >= MAP_FACTS_VERSION:
            continue
        request = ReadMapRequest(path=str(_entry(call, artifact).path), map_id=facts.map_id)
        read = await call.run(READ_MAP, request)
        names = {"road_names": read.road_names, "areas": read.areas, "facts_version": read.facts_version}
        call.workspace.amend("map", artifact.artifact_id, facts.model_copy(update=names))


def maps_seen(call: ToolCall) -> MapInventory:
    """All maps that are known already, without reading a file; a note counts those that are not."""
    seen = SeenFiles(call.workspace.database)
    notes: list[str] = []
    unread = 0
    for folder in call.services.map_folders:
        paths, complaints = _files(folder)
        known = [(path, seen.find(path)) for path in paths]
        unread += sum(file is None for _, file in known)
        notes += complaints + [_left_out(path, file) for path, file in known if file and file.refusal]
    if unread:
        notes.insert(0, f"{unread} more map files will be read by the next generate_scenarios")
    return _together(call, notes)


def _together(call: ToolCall, notes: list[str]) -> MapInventory:
    imported = [_entry(call, artifact) for artifact in call.workspace.newest(kind="map", limit=_MOST_MAPS)]
    more = len(notes) - _SHOWN_NOTES
    shown = notes if more <= 0 else [*notes[:_SHOWN_NOTES], f"{more} more map files were left out"]
    return MapInventory((*imported, *built_in_maps()), tuple(shown))


def _entry(call: ToolCall, artifact: Artifact) -> MapEntry:
    facts = artifact.read(MapFacts)
    return MapEntry(facts, call.workspace.file("map", artifact.artifact_id, stored_name(Path(facts.file_name))))


def _files(folder: Path) -> tuple[list[Path], list[str]]:
    """The map files of a folder, and notes on what is wrong with the folder."""
    try:
        paths = sorted(entry for entry in folder.iterdir() if is_map(entry) and entry.is_file())
    except OSError as error:
        return [], [f"the map folder {one_line(folder.name)} cannot be read: {error.strerror}"]
    surplus = len(paths) - _MOST_FILES
    left_out = f"{surplus} files of the map folder {one_line(folder.name)} were left out: {_MOST_FILES} are read"
    return paths[:_MOST_FILES], [left_out] if surplus > 0 else []


def _left_out(path: Path, file: SeenFile) -> str:
    return f"the map {one_line(path.name)} was left out: {file.refusal}"


async def _taken_in(call: ToolCall, seen: SeenFiles, folder: Path) -> list[str]:
    """Take the maps of a folder in; returns notes on what was left out."""
    paths, notes = _files(folder)
    for path in paths:
        try:
            file = seen.find(path) or await _read(call, seen, path)
        except OSError as error:
            file = SeenFile("", error.strerror or str(error))
        if file.refusal:
            notes.append(_left_out(path, file))
    return notes


async def _read(call: ToolCall, seen: SeenFiles, path: Path) -> SeenFile:
    try:
        file = SeenFile((await import_map(call, path, None)).artifact_id, "")
    except (UnsafeInput, InvalidRequest, WorkerFailure, UnexpectedFailure) as error:
        file = SeenFile("", error.message)
    seen.keep(path, file)
    return file


async def import_map(call: ToolCall, path: Path, name: str | None, country: str | None = None) -> ImportedItem:
    """Store a map, unpacked, with what it shows; name and country (ISO alpha-3) win over what the file says."""
    with call.workspace.scratch() as folder:
        plain, lost = await _plain(call, path, folder)
        recipe = _recipe(plain, name, country)
        before = call.workspace.find_by_recipe("map", recipe)
        artifact = before or await _store_map(call, plain, recipe, name, country)
    facts = artifact.read(MapFacts)
    sites = (
        ", ".join(
            counted(count, f"{kind.replace('_', ' ')} site") for kind, count in sorted(facts.sites.items()) if count
        )
        or "no sites"
    )
    left_out = f"; lost on the way: {'; '.join(lost)}" if lost else ""
    where = f"{facts.place} ({facts.country or 'country unknown'})"
    return ImportedItem(
        file=one_line(path.name),
        kind="map",
        artifact_id=artifact.artifact_id,
        summary=f"{where}: {facts.road_km:.1f} km of roads, {sites}{left_out}",
        reused=before is not None,
    )


async def map_of_scenario(call: ToolCall, word: str) -> str | None:
    """The id of the map that a scenario's road network is, kept when it is first asked for; None for other words.

    Raises:
        UnsafeInput: no vehicle can drive on the lanelets of the scenario.
    """
    if call.workspace.find("scenario", word) is None:
        return None
    return (await import_map(call, call.workspace.file("scenario", word, "scenario.xml"), None)).artifact_id


def known_country(text: str | None) -> str | None:
    """The ISO alpha-3 code of a country's code or name.

    Raises:
        InvalidRequest: there is no such country.
    """
    code = None if text is None else country_code(text)
    if code is None and text is not None:
        raise InvalidRequest(f"there is no country {text!r}", valid=["DEU", "Germany", "de"])
    return code


async def _plain(call: ToolCall, path: Path, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """The map itself, unpacked or converted into the folder, and what is lost of it, in words."""
    if is_binary(path):
        converted = await call.run(CONVERT_MAP, ConvertMapRequest(path=str(path), folder=str(folder)))
        return Path(converted.path), converted.lost
    plain = await anyio.to_thread.run_sync(unpacked, path, folder)
    if await anyio.to_thread.run_sync(foreign_format, plain) is None:
        return plain, ()
    converted = await call.run(CONVERT_ROADS, ConvertMapRequest(path=str(plain), folder=str(folder)))
    return Path(converted.path), converted.lost


async def _store_map(call: ToolCall, path: Path, recipe: Recipe, name: str | None, country: str | None) -> Artifact:
    request = ReadMapRequest(path=str(path), map_id=f"map_{recipe.digest}", place=name, country=country)
    facts = await call.run(READ_MAP, request)
    return call.workspace.put(
        "map", facts.map_id, recipe=recipe, record=facts, files={stored_name(path): path}, name=facts.place
    )


def _recipe(path: Path, name: str | None, country: str | None) -> Recipe:
    arguments = {"content": content_digest(path)}
    arguments |= ({"name": name} if name else {}) | ({"country": country} if country else {})
    return Recipe(tool="import_files", arguments=arguments)
