"""Copies an artifact's files, and its drawings and computed files, into the user's own folder."""

import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...schemas.artifacts import shown_path
from ...schemas.errors import InvalidRequest, NotPossible, with_values
from ...schemas.text import counted, quoted
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
    "scenario": ("png", "opendrive", "openscenario", "openlabel"),
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
    "openlabel": ".openlabel.json",
}
"""The sources of a format's files: stored, written from the record, drawn, or computed by kind; special suffixes."""
_WITH = {"openscenario": ("opendrive",), "json": ("steps", "series")}
"""Additional files of a format: files that it refers to, and for a run what its record lacks."""
REPORT_NAME = "report.html"
_SHARED = ("html", "suite")
"""Formats with files for all artifacts together."""
_SHARED_BY = {"scenario": ("html",), "run": ("suite",), "batch": ("html", "suite")}
"""The shared formats that can contain an artifact, by its kind."""
_READABLE = 0o644
"""Temporary files are private; other users may read exports."""


@dataclass(frozen=True)
class Export:
    """One file to write: its artifact, its format, its path."""

    artifact: Artifact
    format: str
    path: Path

    @property
    def is_drawn(self) -> bool:
        """True if the file must be drawn before it can be copied."""
        return self.format in _DRAWN

    @property
    def is_computed(self) -> bool:
        """True if a worker must compute the file before it can be copied, and it is not a picture."""
        return not self.is_drawn and self.format in _MADE.get(self.artifact.kind, ())


def plan_exports(
    workspace: Workspace, artifacts: Sequence[Artifact], formats: Sequence[str], folder: Path
) -> tuple[Export, ...]:
    """Return the files to write, or every stored file if no formats are given.

    ``html`` and ``suite`` are not included, since all artifacts share their files.

    Raises:
        InvalidRequest: An artifact does not have a requested format.
    """
    return tuple(
        Export(artifact, form, folder / (artifact.artifact_id + _ENDINGS.get(form, f".{form}")))
        for artifact in artifacts
        for form in _formats(workspace, artifact, formats)
        if form not in _SHARED
    )


def refuse_file(folder: Path) -> None:
    """Raise if a folder for files, or a folder that contains it, is a file.

    Raises:
        InvalidRequest: It is a file; the error proposes the folder that contains it.
    """
    file = next((path for path in (folder, *folder.parents) if path.exists() and not path.is_dir()), None)
    if file is not None:
        raise InvalidRequest(
            f"{quoted(shown_path(file))} is a file, not a folder",
            valid=[shown_path(file.parent)],
            next_step="choose a folder",
            remedies=[with_values(folder=shown_path(file.parent))],
        )


def refuse_existing(paths: Sequence[Path]) -> None:
    """Raise if a file exists, before anything is written.

    Raises:
        NotPossible: A file exists; the error lists the first files.
    """
    taken = [str(path) for path in paths if path.exists()]
    if taken:
        raise NotPossible(
            f"{counted(len(taken), 'file')} already {'exists' if len(taken) == 1 else 'exist'}: {', '.join(taken[:3])}",
            next_step="set overwrite, or choose another folder",
        )


def write_export(workspace: Workspace, export: Export, made: Path | None = None) -> None:
    """Write one file as a whole: a stored file, the record or recipe as JSON, or a drawn or computed file.

    Raises:
        ResourceFailure: The folder cannot be written.
    """
    write_whole(export.path, lambda partial: _fill(partial, workspace, export, made))


def write_whole(path: Path, fill: Callable[[Path], object]) -> None:
    """Let ``fill`` write a new file next to ``path``, then rename it, so no reader sees a partial file.

    The new file has a random, free name, so nothing in the folder (a link, a pipe) is written through. An existing file
    with the final name is replaced, never followed.

    Raises:
        ResourceFailure: The folder cannot be written; no partial file remains.
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
        is_file = isinstance(error, FileExistsError | NotADirectoryError)
        step = "choose a folder instead of a file" if is_file else "free disk space, or choose another folder"
        raise disk_failure(path, error, step) from error


def _kinds_with(form: str) -> list[str]:
    """Return the kinds of artifacts whose export in a format is made for it."""
    return [kind for kind, forms in _MADE.items() if form in (*forms, *_SHARED_BY[kind])]


def _fill(partial: Path, workspace: Workspace, export: Export, made: Path | None) -> None:
    if made is not None:
        shutil.copyfile(made, partial)
    elif export.format in _STORED:
        source = workspace.file(export.artifact.kind, export.artifact.artifact_id, _STORED[export.format])
        shutil.copyfile(source, partial)
    else:
        content = export.artifact.recipe if export.format == "recipe" else export.artifact
        partial.write_text(content.model_dump_json(indent=1), encoding="utf-8")


def _formats(workspace: Workspace, artifact: Artifact, requested: Sequence[str]) -> list[str]:
    folder = workspace.folder(artifact.kind, artifact.artifact_id)
    stored = [form for form, name in _STORED.items() if (folder / name).is_file()]
    available = [*stored, *_WRITTEN, *_MADE.get(artifact.kind, ()), *_SHARED_BY.get(artifact.kind, ())]
    if artifact.record.get("outcome") == "invalid":  # an invalid run has no trajectory
        available = [form for form in available if form not in ("solution", "csv", "parquet")]
    missing = [form for form in requested if form not in available]
    if missing:
        kept = [form for form in requested if form in available]
        drawn = [form for form in _DRAWN if form in available and not set(missing).isdisjoint(_DRAWN)]
        suited = [f"; {form} needs a {kinds}" for form in missing if (kinds := " or ".join(_kinds_with(form)))]
        raise InvalidRequest(
            f"the {artifact.kind} {artifact.artifact_id} cannot be exported as {', '.join(missing)}{''.join(suited)}",
            valid=available,
            next_step="choose one of these formats",
            remedies=[with_values(formats=kept or drawn[:1] or None)],
            complete=True,
        )
    wanted = [form for one in requested for form in (*(also for also in _WITH.get(one, ()) if also in available), one)]
    return list(dict.fromkeys(wanted)) if requested else [*stored, *_WRITTEN]
