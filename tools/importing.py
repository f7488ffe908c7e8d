"""The tool that takes in files of the user's."""

from pathlib import Path
from typing import Literal

import anyio

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError
from plannerforge.schemas.importing import ImportedItem, ImportFilesArguments, ImportFilesResult, RefusedItem
from plannerforge.tools.call import ToolCall
from plannerforge.tools.importing_kinds import import_configuration, import_map
from plannerforge.tools.importing_scenarios import OnDone, import_scenarios

ImportKind = Literal["scenario", "map", "config"]
SUFFIXES: dict[str, ImportKind] = {
    ".xml": "scenario",
    ".osm": "map",
    ".osm.gz": "map",
    ".osm.bz2": "map",
    ".yaml": "config",
    ".yml": "config",
}
MOST_FILES = 5000
SHOWN = 20
TELL_EVERY_S = 0.5


async def import_files(arguments: ImportFilesArguments, call: ToolCall) -> ImportFilesResult:
    """Take in a file, or every fitting file below a folder; what is refused is reported, the rest goes in."""
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    files = _files(call, arguments)
    items: list[ImportedItem] = []
    refusals: list[RefusedItem] = []
    failures: list[PlannerForgeError | OSError] = []

    def note(path: Path, outcome: ImportedItem | PlannerForgeError | OSError) -> None:
        if isinstance(outcome, ImportedItem):
            items.append(outcome)
        else:
            failures.append(outcome)
            refusals.append(RefusedItem(file=path.name, reason=_reason(outcome)))

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(_tell, call, items, refusals, len(files))
        await import_scenarios(call, [path for path, kind in files if kind == "scenario"], note)
        for path, kind in files:
            if kind != "scenario":
                await _import_other(call, path, kind, arguments.name, note)
        tasks.cancel_scope.cancel()
    if len(files) == 1 and failures:
        raise failures[0]
    reused = sum(1 for item in items if item.reused)
    return ImportFilesResult(
        added=len(items) - reused,
        reused=reused,
        refused=len(refusals),
        items=tuple(items[:SHOWN]),
        refusals=tuple(refusals[:SHOWN]),
    )


async def _tell(call: ToolCall, items: list[ImportedItem], refusals: list[RefusedItem], files: int) -> None:
    """Report progress until it is cancelled."""
    while True:
        done = len(items) + len(refusals)
        await call.progress(done / files, f"{done} of {files} files")
        await anyio.sleep(TELL_EVERY_S)


async def _import_other(call: ToolCall, path: Path, kind: ImportKind, name: str | None, on_done: OnDone) -> None:
    try:
        checked = call.allowed_path(str(path))
        make = import_map if kind == "map" else import_configuration
        on_done(path, await make(call, checked, name))
    except (PlannerForgeError, OSError) as error:
        on_done(path, error)


def _files(call: ToolCall, arguments: ImportFilesArguments) -> list[tuple[Path, ImportKind]]:
    path = call.allowed_path(arguments.path)
    if not path.exists():
        raise InvalidRequest(f"'{arguments.path}' does not exist", next_step="name a file or folder that does")
    if path.is_file():
        return [(path, _kind(path, arguments.kind))]
    wanted = [suffix for suffix, kind in SUFFIXES.items() if arguments.kind in ("auto", kind)]
    found = sorted(entry for entry in path.rglob("*") if entry.name.lower().endswith(tuple(wanted)) and entry.is_file())
    found = [entry for entry in found if not entry.name.endswith(".net.xml")]
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
    if known is None or path.name.endswith(".net.xml"):
        raise InvalidRequest(f"{path.name} is of no kind that can be imported", valid=[f"*{end}" for end in SUFFIXES])
    if wanted not in ("auto", known):
        raise InvalidRequest(f"{path.name} is a {known}, not a {wanted}", valid=[known, "auto"])
    return known


def _reason(error: PlannerForgeError | OSError) -> str:
    return error.text if isinstance(error, PlannerForgeError) else str(error.strerror or error)
