"""Copies of an artifact's files, and of what was drawn or computed of it, for the user's own folder."""

import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...schemas.errors import InvalidRequest, NotPossible, with_values
from .artifacts import Artifact, Workspace, disk_failure

_STORED = {
    "xml": "scenario.xml",
    "net": "scenario.net.xml",
    "yaml": "config.yaml",
    "steps": "steps.json",
    "series": "series.json",
}
_WRITTEN = ("json", "recipe")
_DRAWN = ("png", "gif")
_MADE = {
    "scenario": ("png", "opendrive", "openscenario"),
    "run": ("png", "gif", "solution", "csv", "parquet"),
    "batch": ("png", "csv", "parquet"),
}
_ENDINGS = {
    "net": ".net.xml",
    "recipe": ".recipe.json",
    "steps": ".steps.json",
    "series": ".series.json",
    "solution": ".solution.xml",
    "opendrive": ".xodr",
    "openscenario": ".xosc",
}
"""Where files of a format come from: stored, written from the record, drawn, or made by kind; endings that differ."""
_WITH = {"openscenario": ("opendrive",), "json": ("steps", "series")}
"""What is written in addition to a format's file: files it names, and for a run what its record does not hold."""
REPORT_NAME = "report.html"
_READABLE = 0o644
"""Temporary files are private; what a user asked for may be read by others."""


@dataclass(frozen=True)
class Export:
    """One file to write: of which artifact, in which format, where."""

    artifact: Artifact
    format: str
    path: Path

    @property
    def is_drawn(self) -> bool:
        """Whether it has to be drawn before it can be copied."""
        return self.format in _DRAWN

    @property
    def is_computed(self) -> bool:
        """Whether a worker has to compute it, other than a picture, before it can be copied."""
        return not self.is_drawn and self.format in _MADE.get(self.artifact.kind, ())


def plan_exports(
    workspace: Workspace, artifacts: Sequence[Artifact], formats: Sequence[str], folder: Path
) -> tuple[Export, ...]:
    """What has to be written; without formats, every stored one. ``html`` is one page for all and not among them.

    Raises:
        InvalidRequest: an artifact does not have a format that was asked for.
    """
    return tuple(
        Export(artifact, form, folder / (artifact.artifact_id + _ENDINGS.get(form, f".{form}")))
        for artifact in artifacts
        for form in _formats(workspace, artifact, [form for form in formats if form != "html"], bool(formats))
    )


def refuse_taken(paths: Sequence[Path]) -> None:
    """Raise before anything is written where a file is there already.

    Raises:
        NotPossible: naming the first of them.
    """
    taken = [str(path) for path in paths if path.exists()]
    if taken:
        raise NotPossible(
            f"{len(taken)} files are there already: {', '.join(taken[:3])}",
            next_step="set overwrite, or name another folder",
        )


def write_export(workspace: Workspace, export: Export, made: Path | None = None) -> None:
    """Write one file whole: a stored file, the record or recipe as JSON, or what was drawn or computed.

    Raises:
        ResourceFailure: the folder cannot be written.
    """
    write_whole(export.path, lambda partial: _fill(partial, workspace, export, made))


def write_whole(path: Path, fill: Callable[[Path], object]) -> None:
    """Have ``fill`` write a new file beside ``path``, then give it that name: half a file is never read.

    The new file's name is made up and must be free, so nothing that lies in the folder (a link, a pipe) is written
    through. What has the name already is replaced, never followed.

    Raises:
        ResourceFailure: the folder cannot be written; nothing half-written stays.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".partial")
        os.close(handle)
        partial = Path(name)
        try:
            fill(partial)
            partial.chmod(_READABLE)
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise disk_failure(path, error, "free disk space, or name another folder") from error


def _fill(partial: Path, workspace: Workspace, export: Export, made: Path | None) -> None:
    if made is not None:
        shutil.copyfile(made, partial)
    elif export.format in _STORED:
        source = workspace.file(export.artifact.kind, export.artifact.artifact_id, _STORED[export.format])
        shutil.copyfile(source, partial)
    else:
        content = export.artifact.recipe if export.format == "recipe" else export.artifact
        partial.write_text(content.model_dump_json(indent=1), encoding="utf-8")


def _formats(workspace: Workspace, artifact: Artifact, asked: Sequence[str], any_asked: bool) -> list[str]:
    folder = workspace.folder(artifact.kind, artifact.artifact_id)
    stored = [form for form, name in _STORED.items() if (folder / name).is_file()]
    available = [*stored, *_WRITTEN, *_MADE.get(artifact.kind, ())]
    if artifact.record.get("outcome") == "invalid":  # such a run has no trajectory
        available = [form for form in available if form not in ("solution", "csv", "parquet")]
    missing = [form for form in asked if form not in available]
    if missing:
        kept = [form for form in asked if form in available]
        raise InvalidRequest(
            f"{artifact.artifact_id} has no {', '.join(missing)}",
            valid=available,
            remedies=[with_values(formats=kept or available[:1])],
        )
    wanted = [form for one in asked for form in (*(also for also in _WITH.get(one, ()) if also in available), one)]
    return list(dict.fromkeys(wanted)) if any_asked else [*stored, *_WRITTEN]
