"""Taking in the user's files.

Many files are a job: it goes on when the call has answered, and the same call takes up what a crash left.
"""

import logging
import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Literal

import anyio

from ..engine.catalog import open_catalogue
from ..engine.execution import Job, JobProgress, OnProgress
from ..engine.maps import MAP_ENDINGS, is_binary, is_net, root_element
from ..engine.workspace import Recipe
from ..schemas.artifacts import ImportedItem, ImportFilesArguments, ImportFilesResult, RefusedItem
from ..schemas.errors import (
    InvalidRequest,
    OutsideRoots,
    PlannerForgeError,
    UnexpectedFailure,
    as_told,
    closest,
    misspelt,
    with_values,
)
from ..schemas.jobs import JobState
from ..schemas.text import is_utf8, one_line, quoted, shown_name
from .configurations import import_configuration
from .context import WorkflowContext
from .maps import import_map, known_country
from .scenario_storage import import_scenarios

logger = logging.getLogger(__name__)
_ImportKind = Literal["scenario", "map", "config"]
_SHOWN = 20
"""Items that an answer lists; its model says so."""
_REPORT_EVERY_S = 0.5
"""How often the progress of an import is reported; chosen."""
WAIT_S = 45.0
"""The call answers after this time at most; chosen to be less than clients wait."""
_SUFFIXES: dict[str, _ImportKind] = {
    **dict.fromkeys(MAP_ENDINGS, "map"),
    ".xml": "scenario",
    ".yaml": "config",
    ".yml": "config",
}
_PACKED_ENDINGS = (".xml.gz", ".xml.bz2")
"""Endings of compressed XML files; the content tells whether they can be imported."""
_MOST_FILES = 5000
"""Chosen; the call lists all of them before it begins."""
MOST_IN_THE_CALL = 100
"""More files are a job: they may take longer than a client waits for an answer."""


@dataclass
class _Tally:
    """What has become of the files until now."""

    total: int
    items: list[ImportedItem] = field(default_factory=list)
    refusals: list[RefusedItem] = field(default_factory=list)
    failures: list[PlannerForgeError] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)

    def note(self, path: Path, outcome: ImportedItem | Job | PlannerForgeError) -> None:
        """Count a file that is done with, or is read by a job of its own."""
        if isinstance(outcome, Job) and not outcome.ended:
            self.jobs.append(outcome)
        elif isinstance(outcome, Job):
            self.refusals.append(RefusedItem(file=one_line(path.name), reason=outcome.error or outcome.state))
        elif isinstance(outcome, ImportedItem):
            self.items.append(outcome)
        else:
            if isinstance(outcome, UnexpectedFailure) and self.total > 1:  # of a single file it is the call's error
                logger.error("incident %s:\n%s", outcome.incident, outcome.details)
            self.failures.append(outcome)
            self.refusals.append(RefusedItem(file=one_line(path.name), reason=outcome.text))

    @property
    def done(self) -> int:
        """Files that are done with."""
        return len(self.items) + len(self.refusals) + len(self.jobs)

    def result(self, job_id: str = "", state: JobState = "done") -> ImportFilesResult:
        """Return the answer for what is done."""
        reused = sum(1 for item in self.items if item.reused)
        return ImportFilesResult(
            added=len(self.items) - reused,
            reused=reused,
            refused=len(self.refusals),
            items=tuple(self.items[:_SHOWN]),
            refusals=tuple(self.refusals[:_SHOWN]),
            job_id=job_id,
            state=state,
        )


async def import_files(arguments: ImportFilesArguments, context: WorkflowContext) -> ImportFilesResult:
    """Take in a file, or every fitting file below a folder; what is refused is reported, the rest goes in."""
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    files = _files(context, arguments)
    known = {"country": _country(arguments, files), "name": one_line(arguments.name) if arguments.name else None}
    arguments = arguments.model_copy(update=known)
    if len(files) > MOST_IN_THE_CALL:
        return await _import_as_job(context, arguments, files)
    tally = _Tally(len(files))
    await _take_in(context, files, arguments, tally, context.progress)
    passed_over = _passed_over(context, arguments, files)
    if len(files) == 1 and tally.failures and not passed_over:
        raise tally.failures[0]
    result = _with_running(tally)
    notes = "; ".join(part for part in (result.note, passed_over) if part)
    return result.model_copy(update={"note": notes})


def _with_running(tally: _Tally) -> ImportFilesResult:
    """Return the answer, with the job that still reads a large extract: the last one of several."""
    if not tally.jobs:
        return tally.result()
    job = tally.jobs[-1]
    more = f"; so are {len(tally.jobs) - 1} more" if len(tally.jobs) > 1 else ""
    note = (
        f"too large to be read at once, the extract is read into tiles ({job.share:.0%} done) and then is a map{more}"
    )
    return tally.result(job.job_id, "running").model_copy(update={"note": note})


def _country(arguments: ImportFilesArguments, files: Sequence[tuple[Path, _ImportKind]]) -> str | None:
    if arguments.country is not None and all(kind != "map" for _, kind in files):
        raise InvalidRequest("country is for maps, and there is none among these files", next_step="leave country out")
    return known_country(arguments.country)


def _files(context: WorkflowContext, arguments: ImportFilesArguments) -> list[tuple[Path, _ImportKind]]:
    try:
        path = context.allowed_path(arguments.path)
    except OutsideRoots as error:
        called_so = _paths_called_so(Path(arguments.path).name, context)
        raise error.also(*(with_values(path=str(one)) for one in called_so)) from error.__cause__
    if not path.exists():
        near = closest(path.name, _names_beside(path, context)) if path.name else []
        raise InvalidRequest(
            f"{quoted(arguments.path)} does not exist",
            valid=near,
            next_step="name a file or folder that does",
            remedies=misspelt(path.name, near),
        ).also(*(with_values(path=str(one)) for one in _paths_called_so(path.name, context)))
    if path.is_file():
        if not os.access(path, os.R_OK):
            raise InvalidRequest(
                f"{quoted(arguments.path)} may not be read by the user that the server runs as",
                next_step="let this user read it, or name another file",
            )
        return [(path, _kind(path, arguments.kind))]
    wanted = [suffix for suffix, kind in _SUFFIXES.items() if arguments.kind in ("auto", kind)]
    endings = (*wanted, *_PACKED_ENDINGS)
    paths = sorted(entry for entry in path.rglob("*") if entry.name.lower().endswith(endings) and entry.is_file())
    paths = [entry for entry in paths if is_utf8(str(entry)) and not context.workspace.owns(entry)]
    paths = [entry for entry in paths if os.access(entry, os.R_OK)]
    paths = [entry for entry in paths if entry.name.lower().endswith(tuple(wanted)) or root_element(entry) is not None]
    if arguments.kind != "map":  # networks lie beside scenarios; they are taken in where maps are asked for
        paths = [entry for entry in paths if not is_net(entry)]
    if arguments.kind != "auto":
        paths = [entry for entry in paths if _kind_of(entry, arguments.kind) == arguments.kind]
    if not paths:
        passed_over = _passed_over(context, arguments, ())
        raise InvalidRequest(
            f"{quoted(arguments.path)} holds no file to import{f'; {passed_over}' if passed_over else ''}",
            valid=[f"*{end}" for end in wanted],
        )
    if len(paths) > _MOST_FILES:
        raise InvalidRequest(
            f"{quoted(arguments.path)} holds {len(paths):,} files; at most {_MOST_FILES:,} are taken in by one call",
            next_step="import its subfolders one by one",
        )
    return [(entry, _kind(entry, arguments.kind)) for entry in paths]


def _paths_called_so(name: str, context: WorkflowContext) -> list[Path]:
    """The paths of a name below the folders that may be used, the shortest first; empty if they cannot be read."""
    found = list[Path]()
    try:
        for root in context.limits.roots:
            entries = islice((path for path in root.resolve().rglob("*") if is_utf8(str(path))), _MOST_COUNTED)
            found += [path for path in entries if path.name == name]
    except OSError:
        return []
    found.sort(key=lambda path: (len(path.parts), str(path)))
    allowed = list[Path]()
    for path in found[:_MOST_CALLED_SO]:
        with suppress(InvalidRequest):
            allowed.append(context.allowed_path(str(path)))
    return allowed


_MOST_CALLED_SO = 3
"""Files of a name that a refusal proposes (chosen)."""


def _names_beside(path: Path, context: WorkflowContext) -> list[str]:
    """Names of what lies in the folder of a missing file; empty if the folder may not be used or cannot be read."""
    try:
        return sorted(entry.name for entry in context.allowed_path(str(path.parent)).iterdir() if is_utf8(entry.name))
    except (OSError, InvalidRequest):
        return []


def _passed_over(
    context: WorkflowContext, arguments: ImportFilesArguments, files: Sequence[tuple[Path, _ImportKind]]
) -> str:
    """Return how many files below a folder are of no kind that was asked for, by their endings; empty without any."""
    path = context.allowed_path(arguments.path)
    if path.is_file():
        return ""
    taken = {entry for entry, _ in files}
    others = islice((entry for entry in path.rglob("*") if entry not in taken and entry.is_file()), _MOST_COUNTED)
    kinds = Counter(_kind_in_words(entry) for entry in others if not context.workspace.owns(entry))
    if not kinds:
        return ""
    shown = ", ".join(f"{ending} {count}" for ending, count in kinds.most_common(_KINDS_SHOWN))
    more = f", other kinds {sum(kinds.values()) - sum(count for _, count in kinds.most_common(_KINDS_SHOWN))}"
    protobuf = f"; {_PROTOBUF}" if kinds[PROTOBUF_ENDING] else ""
    return f"passed over: {shown}{more if len(kinds) > _KINDS_SHOWN else ''}{protobuf}"


def _kind_in_words(path: Path) -> str:
    if not is_utf8(str(path)):
        return "names that are not UTF-8"
    if not os.access(path, os.R_OK):
        return "files that may not be read"
    return one_line(path.suffix.lower())[:_LONGEST_ENDING] or "without ending"


_KINDS_SHOWN, _LONGEST_ENDING, _MOST_COUNTED = 6, 12, 50_000
"""Kinds of files that are named, characters of an ending, files that are looked at (chosen)."""
PROTOBUF_ENDING = ".pb"
_PROTOBUF = (
    "CommonRoad's protobuf format (.pb) is not read, because only its XML can be checked before a library reads it: "
    "convert it with commonroad-io (CommonRoadFileReader, CommonRoadFileWriter)"
)


def _kind(path: Path, wanted: str) -> _ImportKind:
    if path.suffix.lower() == PROTOBUF_ENDING:
        raise InvalidRequest(f"{shown_name(path.name)}: {_PROTOBUF}", valid=[f"*{end}" for end in _SUFFIXES])
    known = _kind_of(path, wanted)
    if known is None:
        raise InvalidRequest(
            f"{shown_name(path.name)} is of no kind that can be imported", valid=[f"*{end}" for end in _SUFFIXES]
        )
    if wanted not in ("auto", known):
        raise InvalidRequest(
            f"{shown_name(path.name)} is a {known}, not a {wanted}", valid=[known, "auto"], given=wanted
        )
    return known


def _kind_of(path: Path, wanted: str) -> _ImportKind | None:
    """Return what a file is, by its content where that tells, else by its name; None for what cannot be imported."""
    root = root_element(path)
    if root == "commonRoad":  # as a map it is a road network, to be filled with other traffic
        return "map" if wanted == "map" else "scenario"
    if root is not None:
        return "map"
    if path.suffix.lower() == ".pbf" and is_binary(path):
        return "map"
    known = next((kind for ending, kind in _SUFFIXES.items() if path.name.lower().endswith(ending)), None)
    return "map" if wanted == "map" and path.name.lower().endswith(".xml") else known


async def _import_as_job(
    context: WorkflowContext, arguments: ImportFilesArguments, files: Sequence[tuple[Path, _ImportKind]]
) -> ImportFilesResult:
    """Start the import, or join the one that runs, and answer with what is done after 45 s at most."""
    tally = _Tally(len(files))

    async def work(progress: JobProgress) -> None:
        async def report(share: float, message: str) -> None:
            progress.report(share, message)

        own_call = WorkflowContext(context.services)  # the one that started the job may have been answered already
        await _take_in(own_call, files, arguments, tally, report)
        progress.report(1.0, tally.result().to_line())

    resolved = {"path": str(context.allowed_path(arguments.path))}
    recipe = Recipe(tool="import_files", arguments=arguments.model_dump(mode="json") | resolved)
    job = context.start_job("import", recipe, work)
    context.made("job", job.job_id)
    job = await context.wait_for(job.job_id, WAIT_S)
    result = tally.result(job.job_id, job.state)
    notes = (job.error or ("" if tally.done else job.message), _passed_over(context, arguments, files))
    return result.model_copy(update={"note": "; ".join(note for note in notes if note)})


async def _take_in(
    context: WorkflowContext,
    files: Sequence[tuple[Path, _ImportKind]],
    arguments: ImportFilesArguments,
    tally: _Tally,
    report: OnProgress,
) -> None:
    """Import the files; the share done is reported every half second."""

    def note(path: Path, item: ImportedItem | Job | PlannerForgeError) -> None:
        tally.note(path, item)
        if isinstance(item, Job):
            context.made("job", item.job_id)
        if isinstance(item, ImportedItem):
            context.made(item.kind, item.artifact_id)

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(_keep_reporting, tally, report)
        await import_scenarios(context, [path for path, kind in files if kind == "scenario"], note)
        for path, kind in files:
            if kind != "scenario":
                note(path, await _imported_other(context, path, kind, arguments))
        tasks.cancel_scope.cancel()


async def _keep_reporting(tally: _Tally, report: OnProgress) -> None:
    while True:
        await report(tally.done / tally.total, f"{tally.done} of {tally.total} files")
        await anyio.sleep(_REPORT_EVERY_S)


async def _imported_other(
    context: WorkflowContext, path: Path, kind: _ImportKind, arguments: ImportFilesArguments
) -> ImportedItem | Job | PlannerForgeError:
    try:
        checked = context.allowed_path(str(path))
        if not is_binary(checked):  # one of any size is read piece by piece
            context.limits.check_size(checked)
        if kind == "map":
            return await import_map(context, checked, arguments.name, arguments.country, wait_s=WAIT_S)
        return await import_configuration(context, checked, arguments.name)
    except Exception as raised:  # noqa: BLE001 - the boundary of a file: it becomes the refusal of this one
        return as_told(raised, f"import of {kind} {shown_name(path.name)}")
