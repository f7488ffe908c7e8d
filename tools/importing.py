"""The tool that takes in files of the user's."""

from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.engine.maps.unpacking import MAP_ENDINGS, is_net
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.importing import ImportFilesArguments, ImportFilesResult
from plannerforge.tools.call import ToolCall
from plannerforge.tools.import_job import import_as_job
from plannerforge.tools.importing_kinds import known_country
from plannerforge.tools.importing_many import ImportKind, Tally, take_in

SUFFIXES: dict[str, ImportKind] = {
    **dict.fromkeys(MAP_ENDINGS, "map"),
    ".xml": "scenario",
    ".yaml": "config",
    ".yml": "config",
}
MOST_FILES = 5000
MOST_IN_THE_CALL = 100
"""More files are a job: they may take longer than a client waits for an answer."""


async def import_files(arguments: ImportFilesArguments, call: ToolCall) -> ImportFilesResult:
    """Take in a file, or every fitting file below a folder; what is refused is reported, the rest goes in."""
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    files = _files(call, arguments)
    arguments = arguments.model_copy(update={"country": _country(arguments, files)})
    if len(files) > MOST_IN_THE_CALL:
        return await import_as_job(call, arguments, files)
    tally = Tally(len(files))
    await take_in(call, files, arguments, tally, call.progress)
    if len(files) == 1 and tally.failures:
        raise tally.failures[0]
    return tally.result()


def _country(arguments: ImportFilesArguments, files: Sequence[tuple[Path, ImportKind]]) -> str | None:
    if arguments.country is not None and all(kind != "map" for _, kind in files):
        raise InvalidRequest("country is for maps, and there is none among these files", next_step="leave country out")
    return known_country(arguments.country)


def _files(call: ToolCall, arguments: ImportFilesArguments) -> list[tuple[Path, ImportKind]]:
    path = call.allowed_path(arguments.path)
    if not path.exists():
        raise InvalidRequest(f"'{arguments.path}' does not exist", next_step="name a file or folder that does")
    if path.is_file():
        return [(path, _kind(path, arguments.kind))]
    wanted = [suffix for suffix, kind in SUFFIXES.items() if arguments.kind in ("auto", kind)]
    found = sorted(entry for entry in path.rglob("*") if entry.name.lower().endswith(tuple(wanted)) and entry.is_file())
    if arguments.kind != "map":  # networks lie beside scenarios; they are taken in where maps are asked for
        found = [entry for entry in found if not is_net(entry)]
    if not found:
        raise InvalidRequest(f"'{arguments.path}' holds no file to import", valid=[f"*{end}" for end in wanted])
    if len(found) > MOST_FILES:
        raise InvalidRequest(
            f"'{arguments.path}' holds {len(found):,} files; at most {MOST_FILES:,} are taken in by one call",
            next_step="import its subfolders one by one",
        )
    return [(entry, _kind(entry, arguments.kind)) for entry in found]


def _kind(path: Path, wanted: str) -> ImportKind:
    known = next((kind for ending, kind in SUFFIXES.items() if path.name.lower().endswith(ending)), None)
    if known is None:
        raise InvalidRequest(f"{path.name} is of no kind that can be imported", valid=[f"*{end}" for end in SUFFIXES])
    if wanted not in ("auto", known):
        raise InvalidRequest(f"{path.name} is a {known}, not a {wanted}", valid=[known, "auto"])
    return known
