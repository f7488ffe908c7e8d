"""Immutable artifacts: a record in SQLite and a folder of files, stored either completely or not at all.

Files are copied to the workspace's disk and flushed there (*staged*) before the database is locked. Temporary folders
are on the same disk; those of killed servers are removed.
"""

import json
import os
import re
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from pydantic import BaseModel, Field, ValidationError

from ...schemas.base import Model, problems_of
from ...schemas.errors import ResourceFailure, UnknownName, calling, closest
from ...schemas.text import cited
from .database import Database, make_private, still_runs, stored_json
from .recipe import Recipe

ArtifactKind = Literal["scenario", "search", "config", "run", "batch", "map", "plan", "study", "boundary"]
ARTIFACT_KINDS: tuple[str, ...] = get_args(ArtifactKind)
VIEWED_KINDS: tuple[ArtifactKind, ...] = ("scenario", "run", "batch")
"""The kinds with a view: player or board."""
Record = TypeVar("Record", bound=Model)
ABANDONED_S = 3600.0
"""Age from which scratch folders may be removed, since an owner in another container is not visible (chosen)."""
_MAKERS: dict[ArtifactKind, str] = {
    "scenario": "call find_scenarios, generate_scenarios or import_files",
    "search": "use a search id that find_scenarios returned",
    "config": "call configure_planner, or name PLANNER:PRESET such as frenetix:Default",
    "run": "call run_planner",
    "batch": "call run_planner with several scenarios or configurations",
    "map": "call describe_catalog with facet maps",
    "plan": "call generate_scenarios with cover",
    "study": "call optimize_planner",
    "boundary": "call explore_boundary",
}
"""The call that creates an artifact of each kind, for the next step of a refusal."""
_OWN_FOLDERS = frozenset(
    {
        *("scratch", "index", "logs", "recordings", "journal", "pictures", "views", "answers", "extracts", "looks"),
        "taken_out",
        "explored",
        *(f"{kind}s" for kind in get_args(ArtifactKind)),
    }
)
STARTER_TOOL = "starter"
"""Replaces the tool in the recipes of scenarios from the package."""
_LISTED_LAST = f"kind = 'search' OR (kind = 'scenario' AND json_extract(recipe, '$.tool') = '{STARTER_TOOL}')"
"""Incidental artifacts: every query of the catalogue stores a search."""
_MOST_KEPT = 256
"""Artifacts with parsed JSON in memory, some 30 kB each (chosen: those that a session uses again)."""
ORDINARY_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,119}")


class Artifact(Model):
    """A stored artifact: its id, its recipe, and its record as JSON; the files are in the workspace.

    ``imported``: True if it came in a workspace archive, so its record is the archive author's statement.
    """

    artifact_id: str
    kind: ArtifactKind
    name: str
    recipe: Recipe
    record: dict[str, Any]
    sequence: int
    made_at: str
    imported: bool = Field(False, exclude_if=lambda imported: not imported)

    def read(self, record_type: type[Record]) -> Record:
        """Return the record as the model that wrote it.

        Raises:
            ResourceFailure: The record does not have this form, because of a defect or a foreign writer.
        """
        try:
            return record_type.model_validate(self.record)
        except ValidationError as error:
            problem = cited(problems_of(record_type, error)[0][0])
            raise ResourceFailure(
                f"the record of {self.kind} {self.artifact_id} in the workspace cannot be read: {problem}",
                next_step="`plannerforge workspace verify` lists these records, and `workspace repair` removes them",
            ) from error


@dataclass(frozen=True)
class NewArtifact:
    """An artifact to store; ``files`` maps names in its folder to the files to copy.

    ``copies``: the folder with the staged copies of its files. ``made_at``: its time of creation, if that is not the
    present. ``imported``: True if it comes from an archive; a later local artifact with the same id replaces it.
    """

    kind: ArtifactKind
    artifact_id: str
    recipe: Recipe
    record: BaseModel
    files: Mapping[str, Path]
    name: str = ""
    copies: Path | None = None
    made_at: str = ""
    imported: bool = False


class Workspace:
    """A folder with all stored artifacts, which several servers may use at once."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.database = Database(root / "workspace.sqlite")
        self._tidied = False
        self._admits: Callable[[int], None] = _admit_all
        self._parsed = lru_cache(_MOST_KEPT)(_artifact)
        """Keyed by whole rows, which are read each time, so that changes of other servers are visible."""

    def limit_room(self, admits: Callable[[int], None]) -> None:
        """Have ``admits`` approve everything before it is stored, by its size in bytes; it may free space or raise an
        error.
        """
        self._admits = admits

    def admit(self, size_bytes: int) -> None:
        """Request space for something to store.

        Raises:
            ResourceFailure: The workspace has a quota, and is full.
        """
        self._admits(size_bytes)

    def put(
        self,
        kind: ArtifactKind,
        artifact_id: str,
        *,
        recipe: Recipe,
        record: Model,
        files: Mapping[str, Path] | None = None,
        name: str = "",
    ) -> Artifact:
        """Store an artifact; if the id exists, return the stored one unchanged.

        A local artifact replaces one that came from an archive.

        Args:
            files: Maps names in the artifact's folder to files to move there (same disk: use :meth:`scratch`).

        Raises:
            ResourceFailure: The disk is full; then nothing of the artifact remains.
        """
        stored = self.find(kind, artifact_id)
        if stored is not None and not stored.imported:
            return stored
        new = NewArtifact(kind, artifact_id, recipe, record, files or {}, name)
        if not new.files:
            self.put_staged([new])
        else:
            with self.scratch() as folder:
                self.put_staged([stage(new, folder / "files")])
        return self.get(artifact_id, kind)

    def amend(self, kind: ArtifactKind, artifact_id: str, record: Model) -> None:
        """Replace an artifact's record with one that a newer version of the program derived from the same file.

        Id, recipe and files stay unchanged.

        Raises:
            ResourceFailure: The database cannot be written.
        """
        with self.database.writing() as connection:
            connection.execute(
                "UPDATE artifacts SET record = ? WHERE kind = ? AND artifact_id = ?",
                (record.model_dump_json(), kind, artifact_id),
            )

    def put_staged(self, artifacts: Sequence[NewArtifact]) -> None:
        """Store artifacts in one transaction, all or none; existing ids keep the stored artifact.

        Raises:
            ResourceFailure: The database or a folder cannot be written, or the workspace's quota has no space.
        """
        self.admit(sum(map(_size_of, artifacts)))
        self.store(artifacts)

    def store(self, artifacts: Iterable[NewArtifact]) -> None:
        """Store artifacts as ``put_staged`` does, after their space has been requested.

        Raises:
            ResourceFailure: The database or a folder cannot be written.
        """
        placed: list[Path] = []

        def remove_placed() -> None:
            for folder in placed:
                shutil.rmtree(folder, ignore_errors=True)

        with self.database.writing(remove_placed) as connection:
            for new in artifacts:
                stored = self.find(new.kind, new.artifact_id)  # another server may have stored it meanwhile
                if stored is not None and (new.imported or not stored.imported):
                    continue
                if stored is not None:
                    _forget(connection, new.kind, new.artifact_id)
                placed.append(self.folder(new.kind, new.artifact_id))
                self._place(placed[-1], new.copies)
                connection.execute(
                    "INSERT INTO artifacts (artifact_id, kind, name, digest, recipe, record, made_at) VALUES"
                    " (?, ?, ?, ?, ?, ?, coalesce(nullif(?, ''), strftime('%Y-%m-%dT%H:%M:%SZ', 'now')))",
                    (
                        new.artifact_id,
                        new.kind,
                        new.name,
                        new.recipe.digest,
                        new.recipe.model_dump_json(),
                        new.record.model_dump_json(),
                        new.made_at,
                    ),
                )
                if new.imported:
                    connection.execute("INSERT INTO imported VALUES (?, ?)", (new.kind, new.artifact_id))
                connection.executemany(
                    "INSERT OR IGNORE INTO parents VALUES (?, ?)",
                    [(new.artifact_id, parent) for parent in new.recipe.parents],
                )

    def find(self, kind: ArtifactKind, artifact_id: str) -> Artifact | None:
        """Return the artifact with this id, or None."""
        return self._first("artifact_id = ?", kind, artifact_id)

    def find_by_recipe(self, kind: ArtifactKind, recipe: Recipe) -> Artifact | None:
        """Return the local artifact of this recipe, or None; an archive's artifacts are not trusted."""
        return self._first(f"digest = ? AND NOT {_IS_IMPORTED}", kind, recipe.digest)

    def imported_of(self, artifact_ids: Iterable[str]) -> list[str]:
        """Return the given ids of artifacts that came from an archive, in order."""
        wanted = list(artifact_ids)
        if not wanted:
            return []
        query = "SELECT artifact_id FROM imported WHERE artifact_id IN (SELECT value FROM json_each(?))"
        marked = {row[0] for row in self.database.connection().execute(query, (json.dumps(wanted),))}
        return [artifact_id for artifact_id in wanted if artifact_id in marked]

    def move_out(self, kind: ArtifactKind, artifact_id: str, kept: Path) -> None:
        """Move an artifact out of the workspace, with its files and its row as JSON, to a new folder.

        Raises:
            ResourceFailure: The folder or the database cannot be written.
        """
        query = "SELECT * FROM artifacts WHERE kind = ? AND artifact_id = ?"
        with self.database.writing() as connection:
            row = connection.execute(query, (kind, artifact_id)).fetchone()
            folder = self.root / f"{kind}s" / artifact_id
            try:
                kept.mkdir(parents=True)
                (kept / "artifact.json").write_text(json.dumps(dict(row), indent=1), encoding="utf-8")
                if ORDINARY_ID.fullmatch(artifact_id) and folder.is_dir():
                    folder.rename(kept / "files")
            except OSError as error:
                raise disk_failure(kept, error) from error
            _forget(connection, kind, artifact_id)

    def get(self, artifact_id: str, kind: ArtifactKind) -> Artifact:
        """Return the artifact with this id; ``latest`` is the newest of its kind.

        Raises:
            UnknownName: No artifact has this id; the error lists the nearest ids.
        """
        if artifact_id == "latest":
            newest = self.newest(kind=kind, limit=1)
            if newest:
                return newest[0]
            raise UnknownName(f"there is no {kind} yet", next_step=_MAKERS[kind])
        stored = self.find(kind, artifact_id)
        if stored is None:
            known = [row[0] for row in self._ids(kind)]
            what = f"there is no {kind} '{artifact_id}'" if artifact_id else f"the id of the {kind} is empty"
            raise UnknownName(what, valid=closest(artifact_id, known), next_step=_MAKERS[kind]).also(
                calling("list_artifacts", kind=kind)
            )
        return stored

    def newest(
        self,
        *,
        kind: ArtifactKind | None = None,
        parent: str | None = None,
        text: str | None = None,
        limit: int = 10,
        offset: int = 0,
    ) -> list[Artifact]:
        """Return artifacts, newest first; ``text`` is searched in ids, names and recipes."""
        wanted, values = self._condition(kind, parent, text)
        query = f"SELECT {_COLUMNS} FROM artifacts WHERE {wanted} ORDER BY sequence DESC LIMIT ? OFFSET ?"  # noqa: S608 - fixed words only
        rows = self.database.connection().execute(query, (*values, limit, offset)).fetchall()
        return [self._parsed(*row) for row in rows]

    def count(self, *, kind: ArtifactKind | None = None, parent: str | None = None, text: str | None = None) -> int:
        """Return the number of artifacts that ``newest`` would list without a limit."""
        wanted, values = self._condition(kind, parent, text)
        query = f"SELECT count(*) FROM artifacts WHERE {wanted}"  # noqa: S608 - fixed words only
        return int(self.database.connection().execute(query, values).fetchone()[0])

    @staticmethod
    def _condition(kind: ArtifactKind | None, parent: str | None, text: str | None) -> tuple[str, list[str]]:
        """Return the SQL condition on artifacts, with its parameters."""
        conditions = ["1"]
        values: list[str] = []
        if kind is not None:
            conditions.append("kind = ?")
            values.append(kind)
        if parent is not None:
            conditions.append("artifact_id IN (SELECT artifact_id FROM parents WHERE parent_id = ?)")
            values.append(parent)
        if text:
            conditions.append("instr(lower(artifact_id || ' ' || name || ' ' || recipe), lower(?)) > 0")
            values.append(text)
        return " AND ".join(conditions), values

    def newest_made(self, limit: int) -> list[Artifact]:
        """Return the newest artifacts: created and imported artifacts first, then searches and starter scenarios."""
        rows: list[sqlite3.Row] = []
        for is_wanted in (f"NOT ({_LISTED_LAST})", _LISTED_LAST):
            query = f"SELECT {_COLUMNS} FROM artifacts WHERE {is_wanted} ORDER BY sequence DESC LIMIT ?"  # noqa: S608 - fixed words only
            rows += self.database.connection().execute(query, (limit - len(rows),)).fetchall()
        return [self._parsed(*row) for row in rows]

    def newest_sequence(self) -> int:
        """Return the sequence number of the newest artifact, or 0 if there are no artifacts."""
        row = self.database.connection().execute("SELECT max(sequence) FROM artifacts").fetchone()
        return int(row[0] or 0)

    def kind_of(self, artifact_id: str, *expected: ArtifactKind) -> ArtifactKind:
        """Return the kind of an artifact; ``expected``: the kinds that the caller can use, empty to accept all kinds.

        Raises:
            UnknownName: No artifact has this id; the error lists the nearest ids of the expected kinds.
        """
        query = "SELECT kind FROM artifacts WHERE artifact_id = ? ORDER BY sequence DESC LIMIT 1"
        row = self.database.connection().execute(query, (artifact_id,)).fetchone()
        if row is None:
            known = [str(entry[0]) for kind in expected or (None,) for entry in self._ids(kind)]
            what = f"there is nothing called '{artifact_id}'" if artifact_id else "an id is empty"
            raise UnknownName(what, valid=closest(artifact_id, known))
        kind: ArtifactKind = row[0]
        return kind

    def folder(self, kind: ArtifactKind, artifact_id: str) -> Path:
        """Return the folder of an artifact's files."""
        if not ORDINARY_ID.fullmatch(artifact_id):
            raise UnknownName(f"'{artifact_id}' cannot be the id of an artifact")
        return self.root / f"{kind}s" / artifact_id

    def file(self, kind: ArtifactKind, artifact_id: str, name: str) -> Path:
        """Return a file of an artifact.

        Raises:
            UnknownName: The artifact has no such file.
        """
        path = self.folder(kind, artifact_id) / name
        if not path.is_file():
            there = sorted(entry.name for entry in path.parent.glob("*")) if path.parent.is_dir() else []
            raise UnknownName(f"{kind} '{artifact_id}' has no file {name}", valid=there)
        return path

    def owns(self, path: Path) -> bool:
        """Return True if a path is the workspace's folder or in one that it manages, which users must not write to."""
        root = self.root.resolve()
        if not path.is_relative_to(root):
            return False
        first = path.relative_to(root).parts[:1]
        return not first or first[0] in _OWN_FOLDERS or first[0].startswith(self.database.path.name)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Yield a temporary folder on the workspace's disk, and remove it after the block.

        Raises:
            ResourceFailure: The folder cannot be created.
        """
        parent = self.root / "scratch"
        try:
            make_private(self.root)
            parent.mkdir(exist_ok=True)
            folder = Path(
                tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=parent)
            )  # the name identifies the owner for the clean-up
            if not self._tidied:
                self._tidied = True
                _remove_abandoned(parent)
        except OSError as error:
            raise disk_failure(parent, error) from error
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def close(self) -> None:
        """Close the database."""
        self.database.close()

    def _first(self, condition: str, kind: ArtifactKind, value: str) -> Artifact | None:
        query = f"SELECT {_COLUMNS} FROM artifacts WHERE kind = ? AND {condition} ORDER BY sequence LIMIT 1"  # noqa: S608 - fixed words only
        row = self.database.connection().execute(query, (kind, value)).fetchone()
        return None if row is None else self._parsed(*row)

    def _ids(self, kind: ArtifactKind | None) -> list[sqlite3.Row]:
        query = "SELECT artifact_id FROM artifacts WHERE ?1 IS NULL OR kind = ?1 ORDER BY sequence DESC LIMIT 5000"
        return self.database.connection().execute(query, (kind,)).fetchall()

    def _place(self, target: Path, copies: Path | None) -> None:
        """Move the copies to their folder; existing files without a record are left over from a crashed server."""
        try:
            if target.is_dir():
                shutil.rmtree(target)
            if copies is not None:
                target.parent.mkdir(parents=True, exist_ok=True)
                copies.rename(target)
        except OSError as error:
            raise disk_failure(target, error) from error


_IS_IMPORTED = (
    "EXISTS (SELECT 1 FROM imported WHERE imported.kind = artifacts.kind"
    " AND imported.artifact_id = artifacts.artifact_id)"
)
_COLUMNS = f"sequence, artifact_id, kind, name, recipe, record, made_at, {_IS_IMPORTED}"


def _forget(connection: sqlite3.Connection, kind: str, artifact_id: str) -> None:
    """Remove an artifact from the tables; its children keep it as their parent."""
    for table in ("artifacts", "imported"):
        connection.execute(f"DELETE FROM {table} WHERE kind = ? AND artifact_id = ?", (kind, artifact_id))  # noqa: S608 - fixed words only
    connection.execute("DELETE FROM parents WHERE artifact_id = ?", (artifact_id,))


def stored_recipe(text: str, what: str) -> Recipe:
    """Return a recipe from the database.

    Raises:
        ResourceFailure: The text is not a recipe, or nested too deeply.
    """
    try:
        return Recipe.model_validate(stored_json(text, what))
    except ValidationError as error:
        raise ResourceFailure(
            f"{what} in the workspace is invalid: {cited(problems_of(Recipe, error)[0][0])}",
            next_step="`plannerforge workspace verify` lists these records, and `workspace repair` removes them",
        ) from error


def _artifact(
    sequence: int,
    artifact_id: str,
    kind: ArtifactKind,
    name: str,
    recipe: str,
    record: str,
    made_at: str,
    imported: int,
) -> Artifact:
    """Return the artifact in a row of the database."""
    return Artifact(
        artifact_id=artifact_id,
        kind=kind,
        name=name,
        recipe=stored_recipe(recipe, f"the recipe of {kind} {artifact_id}"),
        record=stored_json(record, f"the record of {kind} {artifact_id}"),
        sequence=sequence,
        made_at=made_at,
        imported=bool(imported),
    )


def _admit_all(size_bytes: int) -> None:
    del size_bytes


def _size_of(artifact: NewArtifact) -> int:
    """Return the size of a staged artifact's files in bytes; its record is small in comparison."""
    return sum(file.stat().st_size for file in artifact.copies.iterdir()) if artifact.copies else 0


def stage(artifact: NewArtifact, copies: Path) -> NewArtifact:
    """Copy the files of an artifact into a new folder on the workspace's disk; return the artifact with this folder.

    It does not use the database, so any thread may call it.

    Raises:
        ResourceFailure: The disk is full, or a file cannot be read.
    """
    if not artifact.files:
        return artifact
    try:
        copies.mkdir()
        for name, source in sorted(artifact.files.items()):
            shutil.copyfile(source, copies / name)
            with (copies / name).open("rb") as stream:
                os.fsync(stream.fileno())
    except OSError as error:
        raise disk_failure(copies, error) from error
    return replace(artifact, copies=copies)


def write_text(path: Path, text: str, what: str) -> None:
    """Write a file that will become part of an artifact; ``what`` names its content in the error.

    Raises:
        ResourceFailure: The disk is full, or the folder cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise disk_failure(what, error, "free disk space and call again; finished parts are reused") from error


def append_text(path: Path, text: str, what: str) -> None:
    """Append to a file, which is created with its folder if it is missing; ``what`` names its content in the error.

    Raises:
        ResourceFailure: The disk is full, or the folder cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as stream:
            stream.write(text)
    except OSError as error:
        raise disk_failure(what, error, "free disk space and call again; finished parts are reused") from error


def disk_failure(
    what: object, error: OSError, next_step: str = "free disk space, or choose another --workspace"
) -> ResourceFailure:
    """Return the error for a file or folder that cannot be written, by default the workspace's."""
    return ResourceFailure(f"{what} cannot be written: {error.strerror or error}", next_step=next_step)


def _remove_abandoned(parent: Path) -> None:
    """Remove the folders of processes that are gone, an hour after the last write."""
    for folder in sorted(parent.glob("*-*")):
        pid = folder.name.partition("-")[0]
        try:
            written_at = folder.stat().st_mtime
        except FileNotFoundError:  # its owner has just removed it
            continue
        if pid.isdecimal() and time.time() - written_at > ABANDONED_S and not still_runs(int(pid), written_at):
            shutil.rmtree(folder, ignore_errors=True)
