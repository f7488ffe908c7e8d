"""The maps of a call: those of the package, of the user's map folders, and the imported maps."""

from dataclasses import dataclass
from pathlib import Path

import anyio

from ..engine.execution import Job
from ..engine.maps import (
    MapEntry,
    SeenFile,
    SeenFiles,
    built_in_maps,
    countries_spelt_like,
    country_code,
    country_name,
    foreign_format,
    is_binary,
    is_large,
    is_map,
    is_net,
    named_by_content,
    stored_name,
    unpacked,
)
from ..engine.workspace import Artifact, Recipe
from ..schemas.artifacts import ImportedItem
from ..schemas.errors import InvalidRequest, UnexpectedFailure, UnknownName, UnsafeInput, WorkerFailure, with_values
from ..schemas.generation import MAP_FACTS_VERSION, ConvertMapRequest, MapFacts, ReadMapRequest
from ..schemas.text import cited, counted, is_utf8, one_line, shown_name
from .context import WorkflowContext
from .extracts import StatedPlace, extract_index, map_recipe, size_in_words, start_indexing
from .operations import CONVERT_MAP, CONVERT_ROADS, READ_MAP

_MOST_FILES, _MOST_MAPS = 200, 1000
"""How many files of a map folder are read, and how many imported maps are known (chosen)."""
_SHOWN_NOTES = 3
"""How many notes on skipped files an answer shows (chosen)."""


@dataclass(frozen=True)
class MapInventory:
    """Maps with their content, and notes on unusable files in the map folders, one sentence each."""

    entries: tuple[MapEntry, ...]
    notes: tuple[str, ...]


async def maps_at_hand(context: WorkflowContext) -> MapInventory:
    """Return all maps, after reading and storing new and changed files of the map folders.

    A file that cannot be used is skipped with a note. Imported maps come first, newest first, then the package's.
    """
    seen = SeenFiles(context.workspace.database)
    notes = [note for folder in context.services.map_folders for note in await _import_folder(context, seen, folder)]
    notes += await _reread_outdated(context)
    return _whole_inventory(context, notes)


async def _reread_outdated(context: WorkflowContext) -> list[str]:
    """Read maps again that an older version of the program stored, with fewer names and with impossible sites.

    Returns notes on maps that can no longer be read.
    """
    notes = []
    for artifact in context.workspace.newest(kind="map", limit=_MOST_MAPS):
        facts = artifact.read(MapFacts)
        if facts.facts_version >= MAP_FACTS_VERSION or facts.extract is not None:
            continue
        try:
            request = ReadMapRequest(path=str(map_entry(context, artifact).path), map_id=facts.map_id)
            read = await context.run(READ_MAP, request)
        except (UnknownName, UnsafeInput, WorkerFailure, UnexpectedFailure) as error:
            notes.append(f"facts that an older version stored for a map are used: {error.message}")
            continue
        names = {
            "places": tuple(dict.fromkeys((*facts.places[:1], *read.places))),
            "road_names": read.road_names,
            "areas": read.areas,
            "sites": read.sites,
            "facts_version": read.facts_version,
        }
        context.workspace.amend("map", artifact.artifact_id, facts.model_copy(update=names))
    return notes


def inventory_of_read_maps(context: WorkflowContext) -> MapInventory:
    """Return all known maps without reading a file; a note counts unread maps."""
    seen = SeenFiles(context.workspace.database)
    notes: list[str] = []
    unread = 0
    for folder in context.services.map_folders:
        paths, complaints = _files(folder)
        known = [(path, seen.find(path)) for path in paths]
        unread += sum(file is None for _, file in known)
        notes += complaints + [_skipped_note(path, file) for path, file in known if file and file.refusal]
    if unread:
        notes.insert(0, f"{counted(unread, 'map file')} not read yet; generate_scenarios reads new files")
    return _whole_inventory(context, notes)


def _whole_inventory(context: WorkflowContext, notes: list[str]) -> MapInventory:
    imported = []
    for artifact in context.workspace.newest(kind="map", limit=_MOST_MAPS):
        try:
            entry = map_entry(context, artifact)
        except UnknownName as missing:
            notes = [*notes, f"a stored map was left out: {missing.message}"]
            continue
        if not entry.facts.cut_of:
            imported.append(entry)
    more = len(notes) - _SHOWN_NOTES
    shown = notes if more <= 0 else [*notes[:_SHOWN_NOTES], f"{counted(more, 'more map file')} skipped"]
    return MapInventory((*imported, *built_in_maps()), tuple(shown))


def map_entry(context: WorkflowContext, artifact: Artifact) -> MapEntry:
    """Return a stored map with its file or, for a country extract, the index of its tiles."""
    facts = artifact.read(MapFacts)
    if facts.extract is not None:
        return MapEntry(facts, extract_index(context, facts.map_id))
    return MapEntry(facts, context.workspace.file("map", artifact.artifact_id, stored_name(Path(facts.file_name))))


def _files(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the map files of a folder, and notes on problems with the folder."""
    try:
        found = sorted(entry for entry in folder.iterdir() if is_map(entry) and entry.is_file())
    except OSError as error:
        return [], [f"the map folder {shown_name(folder.name)} cannot be read: {error.strerror}"]
    paths = [path for path in found if is_utf8(str(path))]
    notes = []
    if len(paths) < len(found):
        unnamed = counted(len(found) - len(paths), "file")
        notes.append(f"{unnamed} of the map folder {shown_name(folder.name)} skipped: their names are not UTF-8")
    if len(paths) > _MOST_FILES:
        surplus = counted(len(paths) - _MOST_FILES, "file")
        notes.append(f"{surplus} of the map folder {shown_name(folder.name)} skipped: only {_MOST_FILES} are read")
    return paths[:_MOST_FILES], notes


def _skipped_note(path: Path, file: SeenFile) -> str:
    return f"the map {shown_name(path.name)} was left out: {file.refusal}"


async def _import_folder(context: WorkflowContext, seen: SeenFiles, folder: Path) -> list[str]:
    """Import the maps of a folder; return notes on skipped and unfinished maps."""
    paths, notes = _files(folder)
    for path in paths:
        try:
            file = seen.find(path) or await _read(context, seen, path)
        except OSError as error:
            file = SeenFile("", error.strerror or str(error))
        if isinstance(file, Job):
            notes.append(
                f"the map {shown_name(path.name)} is still being split into tiles: {file.job_id}, {file.share:.0%} done"
            )
        elif file.refusal:
            notes.append(_skipped_note(path, file))
    return notes


async def _read(context: WorkflowContext, seen: SeenFiles, path: Path) -> SeenFile | Job:
    """Return the result for a file, or the job that reads it."""
    try:
        imported = await import_map(context, path, None)
        if isinstance(imported, Job) and not imported.ended:
            return imported
        refusal = imported.error if isinstance(imported, Job) else ""
        file = SeenFile("" if isinstance(imported, Job) else imported.artifact_id, refusal)
    except (UnsafeInput, InvalidRequest, WorkerFailure, UnexpectedFailure) as error:
        file = SeenFile("", error.message)
    seen.keep(path, file)
    return file


async def import_map(
    context: WorkflowContext, path: Path, name: str | None, country: str | None = None, *, wait_s: float = 0.0
) -> ImportedItem | Job:
    """Store a map, unpacked, with its content. A given name and country (ISO alpha-3) override the file's.

    A job splits a binary extract that is too large to read in one piece into tiles. The call waits for this job, and
    returns it if it failed or is still running after ``wait_s``.
    """
    known = StatedPlace(name, country)
    if is_large(path):
        return await _as_extract(context, path, known, wait_s)
    with context.workspace.scratch() as folder:
        plain, lost = await _plain(context, path, folder)
        if plain is None:
            return await _as_extract(context, path, known, wait_s)
        recipe = map_recipe(plain, known)
        before = context.workspace.find_by_recipe("map", recipe)
        artifact = before or await _store_map(context, plain, recipe, name, country)
    return _item(path, artifact, lost, reused=before is not None)


async def _as_extract(context: WorkflowContext, path: Path, known: StatedPlace, wait_s: float) -> ImportedItem | Job:
    newest = {artifact.artifact_id for artifact in context.workspace.newest(kind="map", limit=_MOST_MAPS)}
    job = await context.wait_for(start_indexing(context, path, known).job_id, wait_s)
    if job.state != "done":
        return job
    artifact = context.workspace.get(job.results[0], "map")
    return _item(path, artifact, reused=artifact.artifact_id in newest)


def _item(path: Path, artifact: Artifact, lost: tuple[str, ...] = (), *, reused: bool) -> ImportedItem:
    facts = artifact.read(MapFacts)
    sites = (
        ", ".join(
            counted(count, f"{kind.replace('_', ' ')} site") for kind, count in sorted(facts.sites.items()) if count
        )
        or "no sites"
    )
    size = f"; {size_in_words(facts)}" if facts.extract is not None else ""
    left_out = f"; lost in the conversion: {'; '.join(lost)}" if lost else ""
    where = f"{cited(facts.place)} ({facts.country or 'country unknown'})"
    return ImportedItem(
        file=one_line(path.name),
        kind="map",
        artifact_id=artifact.artifact_id,
        summary=f"{where}: {facts.road_km:.1f} km of roads, {sites}{size}{left_out}",
        reused=reused,
    )


async def map_of_scenario(context: WorkflowContext, word: str) -> str | None:
    """Return the id of the map made from a scenario's road network, created at first use; None for other words.

    Raises:
        UnsafeInput: a vehicle cannot drive on the lanelets of the scenario.
    """
    if context.workspace.find("scenario", word) is None:
        return None
    roads = await import_map(context, context.workspace.file("scenario", word, "scenario.xml"), None)
    return None if isinstance(roads, Job) else roads.artifact_id


def known_country(text: str | None) -> str | None:
    """Return the ISO alpha-3 code for a country's code or name.

    Raises:
        UnknownName: there is no such country; the error lists the countries with a similar name.
    """
    code = None if text is None else country_code(text)
    if code is None and text is not None:
        near = [country_name(one) for one in countries_spelt_like(text)]
        raise UnknownName(
            f"there is no country {text!r}",
            valid=near or ["DEU", "Germany", "de"],
            next_step="use one of these" if near else "give the name of a country or its ISO 3166-1 code",
            remedies=[*(with_values(country=one) for one in near), with_values(country=None)],
        )
    return code


async def _plain(context: WorkflowContext, path: Path, folder: Path) -> tuple[Path | None, tuple[str, ...]]:
    """Return the map, unpacked or converted into the folder, and what the conversion lost, in words.

    The map is None if it is too large to read in one piece.
    """
    if is_binary(path):
        converted = await context.run(CONVERT_MAP, ConvertMapRequest(path=str(path), folder=str(folder)))
        return None if converted.too_large else Path(converted.path), converted.lost
    packed = await anyio.to_thread.run_sync(unpacked, path, folder)
    plain = await anyio.to_thread.run_sync(named_by_content, packed, folder)
    if not is_net(plain) and await anyio.to_thread.run_sync(foreign_format, plain) is None:
        return plain, ()
    converted = await context.run(CONVERT_ROADS, ConvertMapRequest(path=str(plain), folder=str(folder)))
    return Path(converted.path), converted.lost


async def _store_map(
    context: WorkflowContext, path: Path, recipe: Recipe, name: str | None, country: str | None
) -> Artifact:
    request = ReadMapRequest(path=str(path), map_id=f"map_{recipe.digest}", place=name, country=country)
    facts = await context.run(READ_MAP, request)
    return context.workspace.put(
        "map", facts.map_id, recipe=recipe, record=facts, files={stored_name(path): path}, name=facts.place
    )
