"""Copies of an artifact's files for the user's own folder."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plannerforge.engine.workspace.artifacts import Artifact, Workspace
from plannerforge.schemas.errors import InvalidRequest, NotPossible, ResourceFailure

_FILES = {"xml": "scenario.xml", "net": "scenario.net.xml", "yaml": "config.yaml"}
_WRITTEN = ("json", "recipe")


@dataclass(frozen=True)
class Exported:
    """A file that was written."""

    artifact_id: str
    format: str
    path: Path


def export(
    workspace: Workspace, artifacts: Sequence[Artifact], formats: Sequence[str], folder: Path, *, overwrite: bool
) -> list[Exported]:
    """Write the files of artifacts into a folder; all names are checked before the first is written.

    Raises:
        InvalidRequest: an artifact does not have a format that was asked for by name.
        NotPossible: a file is there already and ``overwrite`` is not set.
        ResourceFailure: the folder cannot be written.
    """
    wanted = [
        Exported(artifact.artifact_id, form, folder / _file_name(artifact, form))
        for artifact in artifacts
        for form in _formats(workspace, artifact, formats)
    ]
    taken = [str(file.path) for file in wanted if file.path.exists()]
    if taken and not overwrite:
        raise NotPossible(
            f"{len(taken)} files are there already: {', '.join(taken[:3])}",
            next_step="set overwrite, or name another folder",
        )
    by_id = {artifact.artifact_id: artifact for artifact in artifacts}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in wanted:
            _write(workspace, by_id[file.artifact_id], file)
    except OSError as error:
        raise ResourceFailure(
            f"{folder} cannot be written: {error.strerror or error}", next_step="free disk space or name another folder"
        ) from error
    return wanted


def _formats(workspace: Workspace, artifact: Artifact, asked: Sequence[str]) -> list[str]:
    folder = workspace.folder(artifact.kind, artifact.artifact_id)
    there = [form for form, name in _FILES.items() if (folder / name).is_file()]
    available = [*there, *_WRITTEN]
    missing = [form for form in asked if form not in available]
    if missing:
        raise InvalidRequest(f"{artifact.artifact_id} has no {', '.join(missing)}", valid=available)
    return list(dict.fromkeys(asked)) or available


def _file_name(artifact: Artifact, form: str) -> str:
    endings = {"xml": ".xml", "net": ".net.xml", "yaml": ".yaml", "json": ".json", "recipe": ".recipe.json"}
    return artifact.artifact_id + endings[form]


def _write(workspace: Workspace, artifact: Artifact, file: Exported) -> None:
    partial = file.path.with_name(file.path.name + ".partial")
    try:
        if file.format in _FILES:
            shutil.copyfile(workspace.file(artifact.kind, artifact.artifact_id, _FILES[file.format]), partial)
        else:
            content = artifact.recipe if file.format == "recipe" else artifact
            partial.write_text(content.model_dump_json(indent=1), encoding="utf-8")
        partial.replace(file.path)
    finally:
        partial.unlink(missing_ok=True)
