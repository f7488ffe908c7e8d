"""Import the user's files.

Many files become a job. It continues after the call's answer, and the same call resumes after a crash.
"""

import logging
import os
import re
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
from ..engine.scenarios import OPENLABEL_ENDING
from ..engine.workspace import Recipe
from ..schemas.artifacts import ImportedItem, ImportFilesArguments, ImportFilesResult, RefusedItem
from ..schemas.errors import (
    InvalidRequest,
    OutsideRoots,
    PlannerForgeError,
    UnexpectedFailure,
    closest,
    error_to_report,
    misspelt,
    with_values,
)
from ..schemas.jobs import JobState
from ..schemas.text import is_utf8, one_line, quoted, shown_name
from .configurations import import_configuration
from .context import WorkflowContext
from .maps import import_map, known_country
from .scenario_storage import import_scenarios, import_tags

logger = logging.getLogger(__name__)
_ImportKind = Literal["scenario", "map", "config", "tags"]
_SHOWN = 20
"""How many items an answer lists, as its model states."""
_REPORT_EVERY_S = 0.5
"""How often the progress of an import is reported (chosen)."""
WAIT_S = 45.0
"""The call answers after this time at most (chosen to be shorter than clients wait)."""
_SUFFIXES: dict[str, _ImportKind] = {
    **dict.fromkeys(MAP_ENDINGS, "map"),
    ".xml": "scenario",
    ".yaml": "config",
    ".yml": "config",
    OPENLABEL_ENDING: "tags",
}
_WEB_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)
_PACKED_ENDINGS = (".xml.gz", ".xml.bz2")
"""Extensions of compressed XML files. The content shows whether they can be imported."""
_MOST_FILES = 5000
"""The maximum number of files of a call (chosen), which are listed before the import starts."""
MOST_IN_THE_CALL = 100
"""More files become a job, because they may take longer than a client waits."""


@dataclass
class _Tally:
    """The results for the files so far."""

    total: int
    items: list[ImportedItem] = field(default_factory=list)
    refusals: list[RefusedItem] = field(default_factory=list)
    failures: list[PlannerForgeError] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)

    def note(self, path: Path, outcome: ImportedItem | Job | PlannerForgeError) -> None:
        """Count a file that is finished, or that has its own job."""
        if isinstance(outcome, Job) and not outcome.ended:
            self.jobs.append(outcome)
        elif isinstance(outcome, Job):
            self.refusals.append(RefusedItem(file=one_line(path.name), reason=outcome.error or outcome.state))
        elif isinstance(outcome, ImportedItem):
            self.items.append(outcome)
        else:
            if (
                isinstance(outcome, UnexpectedFailure) and self.total > 1
            ):  # for a single file it is the error of the call
                logger.error("incident %s:\n%s", outcome.incident, outcome.details)
            self.failures.append(outcome)
            self.refusals.append(RefusedItem(file=one_line(path.name), reason=outcome.text))

    @property
    def done(self) -> int:
        """The number of finished files."""
        return len(self.items) + len(self.refusals) + len(self.jobs)

    def result(self, job_id: str = "", state: JobState = "done") -> ImportFilesResult:
        """Return the answer for the finished files."""
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
    """Import a file, or every matching file below a folder; refused files are reported, the rest is imported."""
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    files = _files(context, arguments)
    known = {"country": _country(arguments, files), "name": one_line(arguments.name) if arguments.name else None}
    arguments = arguments.model_copy(update=known)
    if len(files) > MOST_IN_THE_CALL:
        return await _import_as_job(context, arguments, files)
    tally = _Tally(len(files))
    await _import_all(context, files, arguments, tally, context.progress)
    passed_over = _skipped_kinds(context, arguments, files)
    if len(files) == 1 and tally.failures and not passed_over:
        raise tally.failures[0]
    result = _with_running(tally)
    notes = "; ".join(part for part in (result.note, passed_over) if part)
    return result.model_copy(update={"note": notes})


def _with_running(tally: _Tally) -> ImportFilesResult:
    """Return the answer with the job that is still reading a large extract, or the last of several such jobs."""
    if not tally.jobs:
        return tally.result()
    job = tally.jobs[-1]
    more = f"; the same for {len(tally.jobs) - 1} more" if len(tally.jobs) > 1 else ""
    note = f"a job splits the large extract into tiles ({job.share:.0%} done); it is a map when the job is done{more}"
    return tally.result(job.job_id, "running").model_copy(update={"note": note})


def _country(arguments: ImportFilesArguments, files: Sequence[tuple[Path, _ImportKind]]) -> str | None:
    if arguments.country is not None and all(kind != "map" for _, kind in files):
        raise InvalidRequest("country is only for maps, and these files contain no map", next_step="leave country out")
    return known_country(arguments.country)


def _files(context: WorkflowContext, arguments: ImportFilesArguments) -> list[tuple[Path, _ImportKind]]:
    if _WEB_ADDRESS.match(arguments.path.strip()):
        raise InvalidRequest(
            f"{quoted(arguments.path)} is a web address, and import_files reads only files on this machine",
            valid=["the path of a file or folder in an allowed folder"],
            next_step="download the file, then import it from its folder",
            complete=True,
        )
    try:
        path = context.allowed_path(arguments.path)
    except OutsideRoots as error:
        called_so = _paths_with_name(Path(arguments.path).name, context)
        raise error.also(*(with_values(path=str(one)) for one in called_so)) from error.__cause__
    if not path.exists():
        near = closest(path.name, _names_in_folder(path, context)) if path.name else []
        raise InvalidRequest(
            f"{quoted(arguments.path)} does not exist",
            valid=near,
            next_step="use an existing file or folder",
            remedies=misspelt(path.name, near),
        ).also(*(with_values(path=str(one)) for one in _paths_with_name(path.name, context)))
    if path.is_file():
        if not os.access(path, os.R_OK):
            raise InvalidRequest(
                f"{quoted(arguments.path)} is not readable for the server's user",
                next_step="make it readable for this user, or use another file",
            )
        return [(path, _kind(path, arguments.kind))]
    wanted = [suffix for suffix, kind in _SUFFIXES.items() if arguments.kind in ("auto", kind)]
    endings = (*wanted, *_PACKED_ENDINGS)
    paths = sorted(entry for entry in path.rglob("*") if entry.name.lower().endswith(endings) and entry.is_file())
    paths = [entry for entry in paths if is_utf8(str(entry)) and not context.workspace.owns(entry)]
    paths = [entry for entry in paths if os.access(entry, os.R_OK)]
    paths = [entry for entry in paths if entry.name.lower().endswith(tuple(wanted)) or root_element(entry) is not None]
    if arguments.kind != "map":  # networks are often next to scenarios; they are imported only if maps are requested
        paths = [entry for entry in paths if not is_net(entry)]
    if arguments.kind != "auto":
        paths = [entry for entry in paths if _kind_of(entry, arguments.kind) == arguments.kind]
    if not paths:
        passed_over = _skipped_kinds(context, arguments, ())
        raise InvalidRequest(
            f"{quoted(arguments.path)} contains no file to import{f'; {passed_over}' if passed_over else ''}",
            valid=[f"*{end}" for end in wanted],
        )
    if len(paths) > _MOST_FILES:
        raise InvalidRequest(
            f"{quoted(arguments.path)} contains {len(paths):,} files, but one call imports at most {_MOST_FILES:,}",
            next_step="import its subfolders one by one",
        )
    return [(entry, _kind(entry, arguments.kind)) for entry in paths]


def _paths_with_name(name: str, context: WorkflowContext) -> list[Path]:
    """Return paths with this name below the allowed folders, shortest first; empty if unreadable."""
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
"""How many files with a name a refusal proposes (chosen)."""


def _names_in_folder(path: Path, context: WorkflowContext) -> list[str]:
    """Return names in the folder of a missing file; empty if the folder is not allowed or not readable."""
    try:
        return sorted(entry.name for entry in context.allowed_path(str(path.parent)).iterdir() if is_utf8(entry.name))
    except (OSError, InvalidRequest):
        return []


def _skipped_kinds(
    context: WorkflowContext, arguments: ImportFilesArguments, files: Sequence[tuple[Path, _ImportKind]]
) -> str:
    """Return how many files below a folder are of other kinds, by extension; empty if all kinds match."""
    path = context.allowed_path(arguments.path)
    if path.is_file():
        return ""
    taken = {entry for entry, _ in files}
    others = islice((entry for entry in path.rglob("*") if entry not in taken and entry.is_file()), _MOST_COUNTED)
    kinds = Counter(_kind_in_words(entry) for entry in others if not context.workspace.owns(entry))
    if not kinds:
        return ""
    shown = ", ".join(f"{ending} ({count})" for ending, count in kinds.most_common(_KINDS_SHOWN))
    more = f", others ({sum(kinds.values()) - sum(count for _, count in kinds.most_common(_KINDS_SHOWN))})"
    protobuf = f"; {_PROTOBUF}" if kinds[PROTOBUF_ENDING] else ""
    return f"skipped files: {shown}{more if len(kinds) > _KINDS_SHOWN else ''}{protobuf}"


def _kind_in_words(path: Path) -> str:
    if not is_utf8(str(path)):
        return "names that are not UTF-8"
    if not os.access(path, os.R_OK):
        return "not readable"
    return one_line(path.suffix.lower())[:_LONGEST_ENDING] or "without ending"


_KINDS_SHOWN, _LONGEST_ENDING, _MOST_COUNTED = 6, 12, 50_000
"""Limits for the kinds of files listed, characters of an extension, and files examined (chosen)."""
PROTOBUF_ENDING = ".pb"
_PROTOBUF = (
    "CommonRoad's protobuf format (.pb) is not supported, because only XML can be checked before a library reads it; "
    "convert it with commonroad-io (CommonRoadFileReader, CommonRoadFileWriter)"
)


def _kind(path: Path, wanted: str) -> _ImportKind:
    if path.suffix.lower() == PROTOBUF_ENDING:
        raise InvalidRequest(f"{shown_name(path.name)}: {_PROTOBUF}", valid=[f"*{end}" for end in _SUFFIXES])
    known = _kind_of(path, wanted)
    if known is None and path.suffix.lower() == ".json":  # files from elsewhere; in a folder only those with our ending
        known = "tags"
    if known is None:
        raise InvalidRequest(
            f"{shown_name(path.name)} has a type that cannot be imported",
            valid=[f"*{end}" for end in _SUFFIXES],
            next_step="import a file of one of these types",
        )
    if wanted not in ("auto", known):
        raise InvalidRequest(
            f"{shown_name(path.name)} is a {known}, not a {wanted}", valid=[known, "auto"], given=wanted
        )
    return known


def _kind_of(path: Path, wanted: str) -> _ImportKind | None:
    """Return the kind of a file, by its content if possible, otherwise by its name; None if unsupported."""
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
    """Start the import, or join a running import; answer when it is done, or after 45 s with the files finished by
    then.
    """
    tally = _Tally(len(files))

    async def work(progress: JobProgress) -> None:
        async def report(share: float, message: str) -> None:
            progress.report(share, message)

        own_call = WorkflowContext(context.services)  # the call that started the job may have been answered already
        await _import_all(own_call, files, arguments, tally, report)
        progress.report(1.0, tally.result().to_line())

    resolved = {"path": str(context.allowed_path(arguments.path))}
    recipe = Recipe(tool="import_files", arguments=arguments.model_dump(mode="json") | resolved)
    job = context.start_job("import", recipe, work)
    context.made("job", job.job_id)
    job = await context.wait_for(job.job_id, WAIT_S)
    result = tally.result(job.job_id, job.state)
    notes = (job.error or ("" if tally.done else job.message), _skipped_kinds(context, arguments, files))
    return result.model_copy(update={"note": "; ".join(note for note in notes if note)})


async def _import_all(
    context: WorkflowContext,
    files: Sequence[tuple[Path, _ImportKind]],
    arguments: ImportFilesArguments,
    tally: _Tally,
    report: OnProgress,
) -> None:
    """Import the files, and report the share done every half second."""

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
        if not is_binary(checked):  # a binary file of any size is read piece by piece
            context.limits.check_size(checked)
        if kind == "map":
            return await import_map(context, checked, arguments.name, arguments.country, wait_s=WAIT_S)
        if kind == "tags":
            return await import_tags(context, checked)
        return await import_configuration(context, checked, arguments.name)
    except Exception as raised:  # noqa: BLE001 - the boundary of a file: it becomes the refusal of this one
        return error_to_report(raised, f"import of {kind} {shown_name(path.name)}")
