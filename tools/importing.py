"""The tool that takes in files of the user's."""

from pathlib import Path
from typing import Literal

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError
from plannerforge.schemas.importing import ImportedItem, ImportFilesArguments, ImportFilesResult, RefusedItem
from plannerforge.tools.call import ToolCall
from plannerforge.tools.importing_kinds import import_configuration, import_map, import_scenario

ImportKind = Literal["scenario", "map", "config"]
SUFFIXES: dict[str, ImportKind] = {".xml": "scenario", ".osm": "map", ".yaml": "config", ".yml": "config"}
MOST_FILES = 5000
SHOWN = 20


async def import_files(arguments: ImportFilesArguments, call: ToolCall) -> ImportFilesResult:
    """Take in a file, or every fitting file below a folder; what is refused is reported, the rest goes in."""
    open_catalogue(call.workspace, with_starter=call.services.with_starter)
    files = _files(call, arguments)
    items: list[ImportedItem] = []
    refusals: list[RefusedItem] = []
    for done, (path, kind) in enumerate(files):
        await call.progress(done / len(files), f"reading {path.name}")
        try:
            items.append(await _import(call, path, kind, arguments.name))
        except (PlannerForgeError, OSError) as error:
            if len(files) == 1:
                raise
            refusals.append(RefusedItem(file=path.name, reason=_reason(error)))
    reused = sum(1 for item in items if item.reused)
    return ImportFilesResult(
        added=len(items) - reused,
        reused=reused,
        refused=len(refusals),
        items=tuple(items[:SHOWN]),
        refusals=tuple(refusals[:SHOWN]),
    )


async def _import(call: ToolCall, path: Path, kind: ImportKind, name: str | None) -> ImportedItem:
    checked = call.allowed_path(str(path))
    if kind == "scenario":
        return await import_scenario(call, checked)
    if kind == "map":
        return await import_map(call, checked, name)
    return await import_configuration(call, checked, name)


def _files(call: ToolCall, arguments: ImportFilesArguments) -> list[tuple[Path, ImportKind]]:
    path = call.allowed_path(arguments.path)
    if not path.exists():
        raise InvalidRequest(f"'{arguments.path}' does not exist", next_step="name a file or folder that does")
    if path.is_file():
        return [(path, _kind(path, arguments.kind))]
    wanted = [suffix for suffix, kind in SUFFIXES.items() if arguments.kind in ("auto", kind)]
    found = sorted(entry for entry in path.rglob("*") if entry.suffix.lower() in wanted and entry.is_file())
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
    known = SUFFIXES.get(path.suffix.lower())
    if known is None or path.name.endswith(".net.xml"):
        raise InvalidRequest(f"{path.name} is of no kind that can be imported", valid=[f"*{end}" for end in SUFFIXES])
    if wanted not in ("auto", known):
        raise InvalidRequest(f"{path.name} is a {known}, not a {wanted}", valid=[known, "auto"])
    return known


def _reason(error: PlannerForgeError | OSError) -> str:
    return error.text if isinstance(error, PlannerForgeError) else str(error.strerror or error)
