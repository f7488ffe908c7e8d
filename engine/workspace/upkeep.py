"""Maintains a workspace: reports its sizes, checks files against records, and frees space.

*Caches* (pictures, recordings, the text index, answers of map services, temporary folders, and files without a record)
may be removed, since they can be recreated. Artifacts, their records and the journal always stay.
"""

import hashlib
import json
import shutil
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from ...schemas.errors import ResourceFailure
from .artifacts import ABANDONED_S, ARTIFACT_KINDS, ORDINARY_ID, ArtifactKind, Workspace, disk_failure
from .database import stored_json
from .recipe import Recipe
from .record_checks import record_fault, text_fault

_CACHES = ("recordings", "pictures", "views", "index", "answers", "scratch")
"""Folders with files that are recreated if they are missing, fastest to recreate first."""
_MB = 1024**2
_SHOWN_RUNS = 3
_LOOK_S, _LOOKS_SHARE = 60.0, 50
"""Age up to which a measured size is reused, in seconds and relative to its duration (chosen: measuring takes 2% of
the time).
"""
MAIN_FILES = {"scenario": "scenario.xml", "run": "steps.json", "config": "config.yaml"}
"""The file without which an artifact of the kind cannot be used."""


@dataclass(frozen=True)
class FolderUse:
    """The size of a folder of the workspace, or of its database; ``is_cache``: True if it can be recreated."""

    name: str
    files: int
    size_bytes: int
    is_cache: bool


@dataclass(frozen=True)
class Disagreement:
    """An inconsistency between records and files.

    ``is_lost``: True if an artifact is no longer usable. ``broken``: kind and id of an artifact with an unreadable or
    inconsistent record, which :func:`repair` removes.
    """

    where: str
    what: str
    is_lost: bool
    broken: tuple[str, str] | None = None


def room_used(workspace: Workspace) -> list[FolderUse]:
    """Return the size of each part of the workspace, largest first."""
    uses: dict[str, list[int]] = {}
    for path in _files(workspace.root):
        relative = path.relative_to(workspace.root)
        name = "database" if len(relative.parts) == 1 else relative.parts[0]
        use = uses.setdefault(name, [0, 0])
        use[0] += 1
        use[1] += _size(path)
    found = [FolderUse(name, files, size, name in _CACHES) for name, (files, size) in uses.items()]
    return sorted(found, key=lambda use: (-use.size_bytes, use.name))


def disagreements(workspace: Workspace) -> Iterator[Disagreement]:
    """Yield the inconsistencies: the database, records without their file or their runs, files without a record."""
    damage = workspace.database.damage()
    if damage:
        yield Disagreement("database", damage, is_lost=True)
        return
    query = "SELECT kind, artifact_id, name, recipe, record FROM artifacts ORDER BY sequence"
    known: dict[str, set[str]] = {kind: set() for kind in ARTIFACT_KINDS}
    batches: list[tuple[str, Sequence[str]]] = []
    for kind, artifact_id, name, recipe, record in workspace.database.connection().execute(query):
        known.setdefault(kind, set()).add(artifact_id)
        if fault := _fault_of(workspace, kind, artifact_id, name, recipe, record):
            yield Disagreement(f"{kind} {artifact_id}", fault, is_lost=True, broken=(kind, artifact_id))
            continue
        if kind == "batch":
            batches.append((artifact_id, json.loads(record)["runs"]))
        main = MAIN_FILES.get(kind)
        if main is None:
            continue
        path = workspace.root / f"{kind}s" / artifact_id / main
        if not path.is_file():
            yield Disagreement(f"{kind} {artifact_id}", f"its file {main} is missing", is_lost=True)
        elif not _size(path):
            yield Disagreement(f"{kind} {artifact_id}", f"its file {main} is empty", is_lost=True)
    for batch_id, run_ids in batches:
        if gone := [run_id for run_id in run_ids if run_id not in known["run"]]:
            some = ", ".join(gone[:_SHOWN_RUNS]) + (", …" if len(gone) > _SHOWN_RUNS else "")
            yield Disagreement(
                f"batch {batch_id}", f"{len(gone)} of its {len(run_ids)} runs are missing: {some}", is_lost=False
            )
    for folder in _without_record(workspace, known):
        yield Disagreement(str(folder.relative_to(workspace.root)), "has no record", is_lost=False)


def _fault_of(workspace: Workspace, kind: str, artifact_id: str, name: str, recipe: str, record: str) -> str:
    """Return why calls cannot read or trust a row, by reading it in the same way; empty if they can."""
    if kind not in ARTIFACT_KINDS or not ORDINARY_ID.fullmatch(artifact_id):
        return "its kind or its id is invalid"
    try:
        made_by = Recipe.model_validate(stored_json(recipe, "its recipe"))
        content = stored_json(record, "its record")
    except (ValueError, ResourceFailure):
        return "its recipe or its record is not valid JSON, or nested too deeply"
    if not isinstance(content, dict):
        return "its record is not a JSON object"
    folder = workspace.root / f"{kind}s" / artifact_id
    known = cast("ArtifactKind", kind)
    return record_fault(known, artifact_id, made_by, content, folder) or text_fault(known, name, content)


def repair(workspace: Workspace) -> list[tuple[Disagreement, Path]]:
    """Remove every artifact with an unreadable or inconsistent record; everything else stays.

    Returns:
        For each removed artifact: its problem, and the folder below ``taken_out`` with its row and files.

    Raises:
        ResourceFailure: The database is damaged, or something cannot be moved.
    """
    done: list[tuple[Disagreement, Path]] = []
    found = list(disagreements(workspace))
    if any(each.where == "database" for each in found):
        raise ResourceFailure(
            "the database itself is damaged, so its records cannot be checked",
            next_step="restore workspace.sqlite from a backup, or import an archive of the workspace into a new one",
        )
    for each in found:
        if each.broken is not None:
            kind, artifact_id = each.broken
            name = f"{kind}_{hashlib.sha256(artifact_id.encode()).hexdigest()[:12]}_{time.time_ns()}"
            kept = workspace.root / "taken_out" / name
            workspace.move_out(cast("ArtifactKind", kind), artifact_id, kept)
            done.append((each, kept))
    return done


def make_room(workspace: Workspace, *, quota_bytes: int | None = None) -> list[tuple[str, int]]:
    """Remove what belongs to no record and, above the workspace's quota, caches, least recently used first.

    Without a quota all caches stay. Since another server may use the workspace, everything younger than an hour stays.

    Args:
        quota_bytes: Size limit of the workspace.

    Returns:
        The removed entries with their bytes.

    Raises:
        ResourceFailure: Something cannot be removed.
    """
    known = {kind: {row[0] for row in _ids(workspace, kind)} for kind in ARTIFACT_KINDS}
    scratch = workspace.root / "scratch"
    left = [*_without_record(workspace, known), *(scratch.iterdir() if scratch.is_dir() else ())]
    removed = [(str(path.relative_to(workspace.root)), _remove(path)) for path in left if _is_old(path)]
    if quota_bytes is not None:
        excess = sum(use.size_bytes for use in room_used(workspace)) - quota_bytes
        removed += _empty_caches(workspace.root, excess)
    return removed


class Quota:
    """The size limit of a workspace: before something is stored, caches are removed; a full workspace refuses.

    Measuring a large workspace takes long, so its size is updated from the last measurement. A new measurement happens
    when the workspace seems full, and when the last one is old, since other servers write too.
    """

    def __init__(self, workspace: Workspace, size_bytes: int) -> None:
        self._workspace, self._size_bytes = workspace, size_bytes
        self._lock = threading.Lock()
        self._taken_bytes, self._look_again_at = 0, 0.0

    def admit(self, size_bytes: int) -> None:
        """Make sure that there is room for something of this size, and remove caches if necessary.

        Raises:
            ResourceFailure: There is no space, and no cache that may be removed.
        """
        with self._lock:
            if time.monotonic() > self._look_again_at or self._excess(size_bytes) > 0:
                self._measure()
            if self._excess(size_bytes) > 0:
                make_room(self._workspace)
                self._measure()
                self._taken_bytes -= sum(
                    freed for _, freed in _empty_caches(self._workspace.root, self._excess(size_bytes))
                )
            if self._excess(size_bytes) > 0:
                raise ResourceFailure(
                    f"the workspace {self._workspace.root} is full: it takes {self._taken_bytes / _MB:,.1f} MB of "
                    f"{self._size_bytes / _MB:,.0f} MB, and caches older than an hour are already removed",
                    next_step="raise the setting workspace_mb, or run `plannerforge workspace gc` in an hour; "
                    "`workspace info` shows its parts, `workspace export` writes all of it to a file",
                )
            self._taken_bytes += size_bytes

    def _excess(self, size_bytes: int) -> int:
        return self._taken_bytes + size_bytes - self._size_bytes

    def _measure(self) -> None:
        started = time.monotonic()
        uses = room_used(self._workspace)
        self._taken_bytes = sum(
            use.size_bytes for use in uses if use.name != "scratch"
        )  # excludes data that is about to be stored
        ended = time.monotonic()
        self._look_again_at = ended + max(_LOOK_S, _LOOKS_SHARE * (ended - started))


def _empty_caches(root: Path, excess_bytes: int) -> Iterator[tuple[str, int]]:
    for name in _CACHES:
        entries = [path for path in ((root / name).iterdir() if (root / name).is_dir() else ()) if _is_old(path)]
        for path in sorted(entries, key=lambda entry: entry.stat().st_mtime):
            if excess_bytes <= 0:
                return
            freed = _remove(path)
            excess_bytes -= freed
            yield str(path.relative_to(root)), freed


def _without_record(workspace: Workspace, known: dict[str, set[str]]) -> Iterator[Path]:
    for kind, ids in known.items():
        folder = workspace.root / f"{kind}s"
        if folder.is_dir():
            yield from (path for path in sorted(folder.iterdir()) if path.name not in ids)


def _ids(workspace: Workspace, kind: str) -> Sequence[Sequence[str]]:
    query = "SELECT artifact_id FROM artifacts WHERE kind = ?"
    return workspace.database.connection().execute(query, (kind,)).fetchall()


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:  # another server has just removed it
        return 0


def _is_old(path: Path) -> bool:
    try:
        return time.time() - path.stat().st_mtime > ABANDONED_S
    except FileNotFoundError:
        return False


def _remove(path: Path) -> int:
    freed = sum(map(_size, _files(path))) if path.is_dir() else _size(path)
    try:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise disk_failure(path, error) from error
    return freed
