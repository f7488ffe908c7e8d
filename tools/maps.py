"""The maps that a call may use: those of the package, of the user's map folders, and the imported ones."""

from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.maps.index import MapEntry, built_in_maps
from plannerforge.engine.maps.seen_files import SeenFile, SeenFiles
from plannerforge.engine.maps.unpacking import is_map, stored_name
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.schemas.errors import InvalidRequest, UnexpectedFailure, UnsafeInput, WorkerFailure
from plannerforge.schemas.generation import MapFacts
from plannerforge.tools.call import ToolCall
from plannerforge.tools.importing_kinds import import_map

MOST_FILES = 200
MOST_MAPS = 1000
SHOWN_NOTES = 3


@dataclass(frozen=True)
class MapsAtHand:
    """Maps with what they show, and in a sentence each what in the map folders cannot be used."""

    entries: tuple[MapEntry, ...]
    notes: tuple[str, ...]


async def maps_at_hand(call: ToolCall) -> MapsAtHand:
    """All maps; files in the map folders that are new or changed are read and kept first.

    A file that cannot be used is left out and told of; the others are there. Imported maps come first, newest first;
    then the maps that we drew ourselves.
    """
    seen = SeenFiles(call.workspace.database)
    notes = [note for folder in call.services.map_folders for note in await _taken_in(call, seen, folder)]
    return _together(call, notes)


def maps_seen(call: ToolCall) -> MapsAtHand:
    """All maps that are known already, without reading a file; the notes tell of those that are not."""
    seen = SeenFiles(call.workspace.database)
    notes: list[str] = []
    unread = 0
    for folder in call.services.map_folders:
        paths, complaints = _files(folder)
        known = [(path, seen.find(path)) for path in paths]
        unread += sum(found is None for _, found in known)
        notes += complaints + [_left_out(path, found) for path, found in known if found and found.refusal]
    if unread:
        notes.insert(0, f"{unread} more map files will be read by the next generate_scenarios")
    return _together(call, notes)


def _together(call: ToolCall, notes: list[str]) -> MapsAtHand:
    imported = [_entry(call, artifact) for artifact in call.workspace.newest(kind="map", limit=MOST_MAPS)]
    more = len(notes) - SHOWN_NOTES
    shown = notes if more <= 0 else [*notes[:SHOWN_NOTES], f"{more} more map files were left out"]
    return MapsAtHand((*imported, *built_in_maps()), tuple(shown))


def _entry(call: ToolCall, artifact: Artifact) -> MapEntry:
    facts = artifact.read(MapFacts)
    return MapEntry(facts, call.workspace.file("map", artifact.artifact_id, stored_name(Path(facts.file_name))))


def _files(folder: Path) -> tuple[list[Path], list[str]]:
    """The map files of a folder, and what is wrong with the folder in words."""
    try:
        paths = sorted(entry for entry in folder.iterdir() if is_map(entry) and entry.is_file())
    except OSError as error:
        return [], [f"the map folder {folder.name} cannot be read: {error.strerror}"]
    surplus = [f"{len(paths) - MOST_FILES} files of the map folder {folder.name} were left out: {MOST_FILES} are read"]
    return paths[:MOST_FILES], surplus if len(paths) > MOST_FILES else []


def _left_out(path: Path, found: SeenFile) -> str:
    return f"the map {path.name} was left out: {found.refusal}"


async def _taken_in(call: ToolCall, seen: SeenFiles, folder: Path) -> list[str]:
    """Take the maps of a folder in; what was left out, in words."""
    paths, notes = _files(folder)
    for path in paths:
        try:
            found = seen.find(path) or await _read(call, seen, path)
        except OSError as error:
            found = SeenFile("", error.strerror or str(error))
        if found.refusal:
            notes.append(_left_out(path, found))
    return notes


async def _read(call: ToolCall, seen: SeenFiles, path: Path) -> SeenFile:
    try:
        found = SeenFile((await import_map(call, path, None)).artifact_id, "")
    except (UnsafeInput, InvalidRequest, WorkerFailure, UnexpectedFailure) as error:
        found = SeenFile("", error.message)
    seen.keep(path, found)
    return found
