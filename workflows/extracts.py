"""Extracts of whole countries, which a job splits into tiles in their own folder of the workspace.

An extract becomes a map like any other when its index is complete. The next job for the same file resumes an
interrupted job.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path

import anyio

from ..engine.execution import Job, JobProgress
from ..engine.workspace import Artifact, Recipe, content_digest, disk_failure, make_private
from ..schemas.errors import ResourceFailure, UnsafeInput
from ..schemas.generation import INDEX_NAME, IndexExtractRequest, MapFacts
from ..schemas.text import shown_name
from .context import WorkflowContext
from .operations import INDEX_EXTRACT

_DISK_PER_BYTE = 10
"""The maximum number of bytes on disk per byte of an extract, including node positions (measured: 9.8)."""
_DIGESTED = 0.02
"""The share of the work that is done when the file's digest is known (chosen)."""


@dataclass(frozen=True)
class StatedPlace:
    """What the user states about a map: its place and its country (ISO alpha-3). None means that the file's own values
    apply.
    """

    place: str | None = None
    country: str | None = None


def extract_index(context: WorkflowContext, map_id: str) -> Path:
    """Return the path of the index of an extract."""
    return context.workspace.root / "extracts" / map_id / INDEX_NAME


def map_recipe(path: Path, known: StatedPlace) -> Recipe:
    """Return the recipe of a map: the content of its file, and what the user states about it."""
    arguments = {"content": content_digest(path)}
    arguments |= {"name": known.place} if known.place else {}
    arguments |= {"country": known.country} if known.country else {}
    return Recipe(tool="import_files", arguments=arguments)


def start_indexing(context: WorkflowContext, path: Path, known: StatedPlace) -> Job:
    """Start the job that splits an extract into tiles, or join a running job.

    Raises:
        UnsafeInput: the file is gone.
    """

    async def work(progress: JobProgress) -> None:
        async def report(share: float, message: str) -> None:
            progress.report(share, message)

        own_call = WorkflowContext(
            context.services, report
        )  # the call that started the job may have been answered already
        artifact = await _indexed(own_call, path, known)
        progress.add_result(artifact.artifact_id)
        progress.report(1.0, f"{shown_name(path.name)} is the map {artifact.artifact_id}")

    size, changed_ns = _state_of(path)
    arguments = {"extract": str(path), "size": size, "changed_ns": changed_ns}
    arguments |= {"name": known.place, "country": known.country}
    return context.start_job("import", Recipe(tool="import_files", arguments=arguments), work)


def _state_of(path: Path) -> tuple[int, int]:
    """Return the size in bytes and the modification time in ns.

    Raises:
        UnsafeInput: the file is gone.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error.strerror}") from error
    return stat.st_size, stat.st_mtime_ns


async def _indexed(context: WorkflowContext, path: Path, known: StatedPlace) -> Artifact:
    """Return the extract as a map: the stored map with the same content, or a new one.

    An existing index is checked, and created again if it is gone or damaged.

    Raises:
        UnsafeInput: the file is broken, unsorted, without roads, or was modified meanwhile; nothing is stored.
        ResourceFailure: the disk is full.
    """
    await context.progress(0.0, "reading the extract")
    before = _state_of(path)
    recipe = await anyio.to_thread.run_sync(map_recipe, path, known)
    map_id = f"map_{recipe.digest}"
    index = extract_index(context, map_id)
    folder = index.parent
    if not (index.exists() and context.workspace.find_by_recipe("map", recipe)):
        _make_room(folder, path)
    request = IndexExtractRequest(
        path=str(path), folder=str(folder), map_id=map_id, place=known.place, country=known.country
    )
    try:
        indexed = await context.run(INDEX_EXTRACT, request, share=(_DIGESTED, 1.0))
        if _state_of(path) != before:
            raise UnsafeInput(
                f"{shown_name(path.name)} changed while it was read", next_step="add it again when it is complete"
            )
    except UnsafeInput:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return context.workspace.put("map", map_id, recipe=recipe, record=indexed.facts, name=indexed.facts.place)


def _make_room(folder: Path, path: Path) -> None:
    try:
        make_private(folder.parent.parent)
        folder.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(folder).free + sum(each.stat().st_size for each in folder.iterdir())
    except OSError as error:
        raise disk_failure(folder, error) from error
    needed = _DISK_PER_BYTE * path.stat().st_size
    if free < needed:
        raise ResourceFailure(
            f"splitting {shown_name(path.name)} into tiles takes up to {needed / 1e9:.1f} GB of disk;"
            f" {free / 1e9:.1f} GB are free",
            next_step="free disk space, choose another --workspace, or use a smaller extract",
        )


def size_in_words(facts: MapFacts) -> str:
    """Return the size of an extract in words; empty for other maps."""
    size = facts.extract
    return (
        ""
        if size is None
        else f"{size.places:,} {'place' if size.places == 1 else 'places'}, kept by {size.tiles:,} tiles"
    )
