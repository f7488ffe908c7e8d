"""Files on their way into the workspace: copied to its disk and safe there before anything is locked."""

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import ResourceFailure

ArtifactKind = Literal["scenario", "search", "config", "run", "batch", "map"]


@dataclass(frozen=True)
class NewArtifact:
    """An artifact that is to be stored; ``files``: name in its folder → file to copy."""

    kind: ArtifactKind
    artifact_id: str
    recipe: Recipe
    record: Model
    files: Mapping[str, Path]
    name: str = ""


@dataclass(frozen=True)
class Staged:
    """A new artifact and the folder with the copies of its files; None without files."""

    artifact: NewArtifact
    copies: Path | None = None


def stage(artifacts: Sequence[NewArtifact], folder: Path) -> list[Staged]:
    """Copy the files of artifacts into subfolders of a scratch folder; touches no database, so any thread may do it.

    Raises:
        ResourceFailure: the disk is full, or a file cannot be read.
    """
    return [_staged(artifact, folder / str(index)) for index, artifact in enumerate(artifacts)]


def disk_failure(path: Path, error: OSError) -> ResourceFailure:
    """The error of a workspace that cannot be written."""
    return ResourceFailure(
        f"{path} cannot be written: {error.strerror or error}",
        next_step="free disk space, or choose another --workspace",
    )


def _staged(artifact: NewArtifact, copies: Path) -> Staged:
    if not artifact.files:
        return Staged(artifact)
    try:
        copies.mkdir()
        for name, source in sorted(artifact.files.items()):
            shutil.copyfile(source, copies / name)
            _flush(copies / name)
    except OSError as error:
        raise disk_failure(copies, error) from error
    return Staged(artifact, copies)


def _flush(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())
