"""Looking after a workspace: what takes how much room, whether files and records agree, and room made again.

What can be made again (*caches*: pictures, recordings, the text index, answers of map services, temporary folders, and
files that belong to no record) may go; what was made, its records and the journal never do.
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
"""Folders whose files are made anew when they are missing, those first that are made again most quickly."""
_MB = 1024**2
_SHOWN_RUNS = 3
_LOOK_S, _LOOKS_SHARE = 60.0, 50
"""How old a look at a whole workspace may be, and how often what it took itself; chosen: looks take 2 % of the time."""
MAIN_FILES = {"scenario": "scenario.xml", "run": "steps.json", "config": "config.yaml"}
"""The file without which an artifact of the kind cannot be used."""


@dataclass(frozen=True)
class FolderUse:
    """What a folder of the workspace, or its database, takes; ``is_cache``: it can be made again."""

    name: str
    files: int
    size_bytes: int
    is_cache: bool


@dataclass(frozen=True)
class Disagreement:
    """Something that records and files disagree on.

    ``is_lost``: what was made cannot be used any more. ``broken``: kind and id of an artifact whose record is not what
    calls can read or believe; :func:`repair` takes it out.
    """

    where: str
    what: str
    is_lost: bool
    broken: tuple[str, str] | None = None


def room_used(workspace: Workspace) -> list[FolderUse]:
    """What each part of the workspace takes, the largest first."""
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
    """What does not fit together: the database, records without their file or their runs, files without a record."""
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
            yield Disagreement(f"{kind} {artifact_id}", f"its file {main} is gone", is_lost=True)
        elif not _size(path):
            yield Disagreement(f"{kind} {artifact_id}", f"its file {main} is empty", is_lost=True)
    for batch_id, run_ids in batches:
        if gone := [run_id for run_id in run_ids if run_id not in known["run"]]:
            some = ", ".join(gone[:_SHOWN_RUNS]) + (", …" if len(gone) > _SHOWN_RUNS else "")
            yield Disagreement(
                f"batch {batch_id}", f"{len(gone)} of its {len(run_ids)} runs are gone: {some}", is_lost=False
            )
    for folder in _without_record(workspace, known):
        yield Disagreement(str(folder.relative_to(workspace.root)), "belongs to no record", is_lost=False)


def _fault_of(workspace: Workspace, kind: str, artifact_id: str, name: str, recipe: str, record: str) -> str:
    """Return why calls cannot read or believe a row, by reading it as they do; empty if they can."""
    if kind not in ARTIFACT_KINDS or not ORDINARY_ID.fullmatch(artifact_id):
        return "its kind or its id is one that no call gives"
    try:
        made_by = Recipe.model_validate(stored_json(recipe, "its recipe"))
        content = stored_json(record, "its record")
    except (ValueError, ResourceFailure):
        return "its recipe or its record is no JSON of its form, or nested too deeply"
    if not isinstance(content, dict):
        return "its record is no JSON object"
    folder = workspace.root / f"{kind}s" / artifact_id
    known = cast("ArtifactKind", kind)
    return record_fault(known, artifact_id, made_by, content, folder) or text_fault(known, name, content)


def repair(workspace: Workspace) -> list[tuple[Disagreement, Path]]:
    """Take out every artifact whose record calls cannot read or believe; everything else stays.

    Returns:
        What was wrong with each, and the folder below ``taken_out`` to which its row and its files were moved.

    Raises:
        ResourceFailure: the database is damaged, or something cannot be moved.
    """
    done: list[tuple[Disagreement, Path]] = []
    found = list(disagreements(workspace))
    if any(each.where == "database" for each in found):
        raise ResourceFailure(
            "the database itself is damaged, and its records cannot be told apart",
            next_step="restore workspace.sqlite from a backup, or import an archive of the workspace into a new one",
        )
    for each in found:
        if each.broken is not None:
            kind, artifact_id = each.broken
            name = f"{kind}_{hashlib.sha256(artifact_id.encode()).hexdigest()[:12]}_{time.time_ns()}"
            kept = workspace.root / "taken_out" / name
            workspace.take_out(cast("ArtifactKind", kind), artifact_id, kept)
            done.append((each, kept))
    return done


def make_room(workspace: Workspace, *, quota_bytes: int | None = None) -> list[tuple[str, int]]:
    """Remove what belongs to nothing and, above a quota for the whole workspace, caches, the least used first.

    Without a quota all caches stay. Another server may use the workspace meanwhile: what is younger than an hour stays.

    Args:
        quota_bytes: what the workspace may take.

    Returns:
        What was removed, with its bytes.

    Raises:
        ResourceFailure: something cannot be removed.
    """
    known = {kind: {row[0] for row in _ids(workspace, kind)} for kind in ARTIFACT_KINDS}
    scratch = workspace.root / "scratch"
    left = [*_without_record(workspace, known), *(scratch.iterdir() if scratch.is_dir() else ())]
    removed = [(str(path.relative_to(workspace.root)), _remove(path)) for path in left if _is_old(path)]
    if quota_bytes is not None:
        excess = sum(use.size_bytes for use in room_used(workspace)) - quota_bytes
        removed += _emptied(workspace.root, excess)
    return removed


class Quota:
    """What a workspace may take, asked before something is stored: caches go first, and then nothing more is stored.

    To look through a large workspace takes long, so what it takes is counted on from the last look; another look is
    taken when that says it is full, and when the last one is old, since others write too.
    """

    def __init__(self, workspace: Workspace, size_bytes: int) -> None:
        self._workspace, self._size_bytes = workspace, size_bytes
        self._lock = threading.Lock()
        self._taken_bytes, self._look_again_at = 0, 0.0

    def admit(self, size_bytes: int) -> None:
        """Let something of this size be stored.

        Raises:
            ResourceFailure: there is no room, and no cache that may go.
        """
        with self._lock:
            if time.monotonic() > self._look_again_at or self._excess(size_bytes) > 0:
                self._look()
            if self._excess(size_bytes) > 0:
                make_room(self._workspace)
                self._look()
                self._taken_bytes -= sum(freed for _, freed in _emptied(self._workspace.root, self._excess(size_bytes)))
            if self._excess(size_bytes) > 0:
                raise ResourceFailure(
                    f"the workspace {self._workspace.root} is full: it takes {self._taken_bytes / _MB:,.1f} MB of the "
                    f"{self._size_bytes / _MB:,.0f} that it may, and caches that are an hour old were removed already",
                    next_step="raise the setting workspace_mb, or run `plannerforge workspace gc` in an hour; "
                    "`workspace info` shows what takes room, `workspace export` keeps all of it in a file",
                )
            self._taken_bytes += size_bytes

    def _excess(self, size_bytes: int) -> int:
        return self._taken_bytes + size_bytes - self._size_bytes

    def _look(self) -> None:
        started = time.monotonic()
        uses = room_used(self._workspace)
        self._taken_bytes = sum(use.size_bytes for use in uses if use.name != "scratch")  # what is about to be stored
        ended = time.monotonic()
        self._look_again_at = ended + max(_LOOK_S, _LOOKS_SHARE * (ended - started))


def _emptied(root: Path, excess_bytes: int) -> Iterator[tuple[str, int]]:
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
