"""A workspace as one file, written with digests of its content, and imported either as a whole or not at all.

The file is a ZIP archive: ``workspace.json`` identifies the writer, ``records.jsonl`` has one artifact per line in
order of creation, ``files/`` their files, ``journal/`` the journal if requested, and ``SHA256SUMS`` the digests of all
these. Caches, jobs and tasks are left out. Archives are not trusted: everything is checked before anything is stored,
ids must follow from content, and imported artifacts are marked, since a run's record cannot be verified.
"""

import hashlib
import json
import os
import re
import shutil
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, RootModel, ValidationError

from ... import __version__
from ...schemas.base import Model, problems_of
from ...schemas.errors import InvalidRequest, NotPossible, ResourceFailure, UnsafeInput
from ...schemas.text import cited, in_one_line, one_line, shown_name
from .artifacts import ARTIFACT_KINDS, ORDINARY_ID, ArtifactKind, NewArtifact, Workspace, disk_failure, stored_recipe
from .database import SCHEMA_VERSION, make_private, stored_json
from .export import write_whole
from .recipe import Recipe, content_digest
from .record_checks import record_fault, text_fault
from .upkeep import MAIN_FILES

_HEAD, _RECORDS, _SUMS = "workspace.json", "records.jsonl", "SHA256SUMS"
_NO_DATE = (1980, 1, 1, 0, 0, 0)
"""A fixed date, so that the same workspace gives the same bytes."""
_BLOCK_BYTES = 1024**2
_MOST_HEAD_BYTES, _MOST_SUM_BYTES = 10_000, 512
_MOST_RECORD_BYTES = 64 * 1024**2
"""Limits of ``workspace.json``, of a line of the digests and of a record (chosen: a batch of a thousand
runs has 2 MB).
"""
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,119}")
_JOURNAL_NAME = re.compile(r"calls\.jsonl(?:\.\d{1,2})?")
_SUM = re.compile(r"([0-9a-f]{64})  (\S+)")
_SHOWN = 5
"""Ids that an error lists (chosen)."""
_TIMED = {"timing.json", "planner.log"}
"""Files of a run with its computation times, which differ between machines."""

OnBytes = Callable[[int, int], None]
"""Receives the number of completed bytes and their total."""
CheckFile = Callable[[Path], object]
"""Checks a file from outside; raises if it must not be kept."""


def _ignore_progress(done: int, total: int) -> None:
    del done, total


def _accept_any(file: Path) -> None:
    del file


@dataclass(frozen=True)
class ArchiveLimits:
    """The limits of an archive (set well above a workspace of 100,000 scenarios).

    ``unpacked_bytes``: total unpacked size. ``entries``: files. ``ratio``: unpacked bytes per byte of the archive;
    trajectories as JSON reach a ratio of 30, zip bombs a thousand.
    """

    unpacked_bytes: int = 20 * 1024**3
    entries: int = 1_000_000
    ratio: int = 200


@dataclass(frozen=True)
class Exported:
    """The content of a written archive: artifacts, their files, its bytes, and artifacts left out for a
    missing file.
    """

    artifacts: int
    files: int
    size_bytes: int
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class Imported:
    """The numbers of artifacts that an archive added and of those that already existed."""

    added: int
    known: int


class _Head(Model):
    """``workspace.json``: the format of the archive, and its program and database revision."""

    format: Literal[1] = 1
    revision: int = Field(SCHEMA_VERSION, ge=1)
    made_by: str = __version__
    artifacts: int = Field(ge=0)


class _Record(Model):
    """A line of ``records.jsonl``: an artifact with the names of its files."""

    kind: ArtifactKind
    artifact_id: str = Field(pattern=rf"^{ORDINARY_ID.pattern}$")
    name: str
    recipe: Recipe
    record: dict[str, Any]
    made_at: str = Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")
    files: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """The folder of the artifact's files in the archive."""
        return f"files/{self.kind}s/{self.artifact_id}"


class _AsWritten(RootModel[dict[str, Any]]):
    """A record as stored in an archive."""


def export_workspace(
    workspace: Workspace,
    path: Path,
    *,
    journal: bool = False,
    overwrite: bool = False,
    on_bytes: OnBytes = _ignore_progress,
) -> Exported:
    """Write all artifacts with their files into one archive, either completely or not at all.

    Raises:
        NotPossible: The file exists, or would be in a folder that the workspace manages.
        ResourceFailure: The archive cannot be written, or a file of the workspace cannot be read.
    """
    if path.exists() and not overwrite:
        raise NotPossible(f"{path} already exists", next_step="set --overwrite, or choose another file")
    if workspace.owns(path.resolve()):
        raise NotPossible(f"{path} is in a folder that the workspace manages", next_step="choose a file outside it")
    newest = workspace.newest_sequence()
    sources: dict[str, Path] = {}
    left_out: list[str] = []
    count = 0
    for record in _records_until(workspace, newest):
        if _is_lost(record):
            left_out.append(f"{record.kind} {record.artifact_id}")
            continue
        count += 1
        folder = workspace.folder(record.kind, record.artifact_id)
        sources |= {f"{record.place}/{file}": folder / file for file in record.files}
    if journal:
        found = sorted((workspace.root / "journal").glob("calls.jsonl*"))
        sources |= {f"journal/{file.name}": file for file in found if _JOURNAL_NAME.fullmatch(file.name)}
    kept = (record for record in _records_until(workspace, newest) if not _is_lost(record))
    write_whole(path, lambda partial: _write(partial, _Head(artifacts=count), kept, sources, on_bytes))
    return Exported(count, len(sources), path.stat().st_size, tuple(left_out))


def _records_until(workspace: Workspace, newest: int) -> Iterator[_Record]:
    """Yield all artifacts up to a sequence number, in order of creation."""
    query = "SELECT * FROM artifacts WHERE sequence <= ? ORDER BY sequence"
    for row in workspace.database.connection().execute(query, (newest,)):
        folder = workspace.folder(row["kind"], row["artifact_id"])
        yield _Record(
            kind=row["kind"],
            artifact_id=row["artifact_id"],
            name=row["name"],
            recipe=stored_recipe(row["recipe"], f"the recipe of {row['kind']} {row['artifact_id']}"),
            record=stored_json(row["record"], f"the record of {row['kind']} {row['artifact_id']}"),
            made_at=row["made_at"],
            files=tuple(sorted(file.name for file in folder.iterdir())) if folder.is_dir() else (),
        )


def _is_lost(record: _Record) -> bool:
    """Return True if the main file of an artifact's kind is missing."""
    main = MAIN_FILES.get(record.kind)
    return main is not None and main not in record.files


def _write(path: Path, head: _Head, records: Iterable[_Record], sources: Mapping[str, Path], on_bytes: OnBytes) -> None:
    total, done = sum(source.stat().st_size for source in sources.values()), 0
    sums: list[str] = []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:

        def add(name: str, blocks: Iterable[bytes]) -> int:
            digest, written = hashlib.sha256(), 0
            entry = zipfile.ZipInfo(name, _NO_DATE)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, (stat.S_IFREG | 0o644) << 16
            with archive.open(entry, "w", force_zip64=True) as stream:
                for block in blocks:
                    digest.update(block)
                    written += stream.write(block)
            sums.append(f"{digest.hexdigest()}  {name}\n")
            return written

        add(_HEAD, [head.model_dump_json(indent=1).encode()])
        add(_RECORDS, (record.model_dump_json().encode() + b"\n" for record in records))
        for name, source in sources.items():
            done += add(name, _blocks(source))
            on_bytes(done, total)
        add(_SUMS, [line.encode() for line in tuple(sums)])


def _blocks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            yield block


def import_workspace(
    workspace: Workspace,
    path: Path,
    *,
    limits: ArchiveLimits | None = None,
    check: CheckFile = _accept_any,
    on_bytes: OnBytes = _ignore_progress,
) -> Imported:
    """Check a whole archive, then import everything in it; import nothing if anything is wrong.

    Args:
        check: Checks each file of an artifact before it is stored.

    Raises:
        UnsafeInput: The file is not an archive of a workspace, is damaged, or has forbidden content or more than the
            limits allow.
        InvalidRequest: A newer version of the program wrote it.
        NotPossible: Its content has an id that belongs to a different artifact in this workspace.
        ResourceFailure: The disk or the quota has no space, or the workspace cannot be written.
    """
    with _open_archive(path, limits or ArchiveLimits()) as archive, workspace.scratch() as folder:
        size_bytes = sum(entry.file_size for entry in archive.infolist())
        if shutil.disk_usage(folder).free < size_bytes:
            raise ResourceFailure(
                f"{shown_name(path.name)} takes {size_bytes / 1e6:,.0f} MB when unpacked, but the disk has less",
                next_step="free disk space, or choose another --workspace",
            )
        workspace.admit(size_bytes)
        sums = _read_sums(archive)
        head = _read_head(archive, sums)
        _unpack(archive, sums, folder, check, on_bytes)
        new, known = _classify(workspace, folder, head, sums)
        with _place_files(_journal_places(workspace, folder, sums)):
            workspace.store(_stage_record(record, folder) for record in _read_records(folder) if record.place in new)
    return Imported(len(new), known)


@contextmanager
def _open_archive(path: Path, limits: ArchiveLimits) -> Iterator[zipfile.ZipFile]:
    """Yield the archive if its contents are within the limits and are only plain files in valid places.

    Raises:
        UnsafeInput: The archive violates this, or is damaged.
    """
    try:
        size_bytes = path.stat().st_size
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise UnsafeInput(f"{path} cannot be read: {error.strerror or error}") from error
    except zipfile.BadZipFile as error:
        raise _damaged(error) from error
    with archive:
        _check_entries(archive.infolist(), size_bytes, limits)
        try:
            yield archive
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
            raise _damaged(error) from error


def _damaged(why: object) -> UnsafeInput:
    return UnsafeInput(
        f"the archive is damaged or not a workspace archive: {why}", next_step="choose a file of `workspace export`"
    )


def _check_entries(entries: Sequence[zipfile.ZipInfo], size_bytes: int, limits: ArchiveLimits) -> None:
    unpacked = sum(entry.file_size for entry in entries)
    for what, found, most in (
        ("files", len(entries), limits.entries),
        ("bytes when unpacked", unpacked, limits.unpacked_bytes),
        ("unpacked bytes per byte", unpacked // max(size_bytes, 1), limits.ratio),
    ):
        if found > most:
            raise UnsafeInput(
                f"the archive has {found:,} {what}; the limit is {most:,}",
                next_step="for your own archive, --most-mb raises the byte limit; otherwise import smaller ones",
            )
    names: set[str] = set()
    for entry in entries:
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG) or entry.is_dir() or entry.flag_bits & 1:
            raise UnsafeInput(f"{cited(entry.filename)} in the archive is a link, a folder or encrypted")
        if not _has_place(entry.filename):
            raise UnsafeInput(f"the archive has {cited(entry.filename)}, which does not belong in a workspace")
        if entry.filename in names:
            raise UnsafeInput(f"the archive has {cited(entry.filename)} twice")
        names.add(entry.filename)
    if missing := {_HEAD, _RECORDS, _SUMS} - names:
        raise _damaged(f"it has no {', '.join(sorted(missing))}")


def _has_place(name: str) -> bool:
    """Return True if an export could have written a file under this name."""
    parts = name.split("/")
    if len(parts) == 4 and parts[0] == "files":
        is_kind = parts[1].removesuffix("s") in ARTIFACT_KINDS and parts[1].endswith("s")
        return is_kind and bool(ORDINARY_ID.fullmatch(parts[2]) and _FILE_NAME.fullmatch(parts[3]))
    if len(parts) == 2 and parts[0] == "journal":
        return bool(_JOURNAL_NAME.fullmatch(parts[1]))
    return name in (_HEAD, _RECORDS, _SUMS)


def _read_sums(archive: zipfile.ZipFile) -> dict[str, str]:
    """Return the digest of each file of the archive except the list itself.

    Raises:
        UnsafeInput: The list does not cover all files.
    """
    names = {entry.filename for entry in archive.infolist()} - {_SUMS}
    text = _small(archive, _SUMS, _MOST_SUM_BYTES * (len(names) + 1)).decode("ascii", errors="replace")
    found = [_SUM.fullmatch(line) for line in text.splitlines()]
    sums = {line[2]: line[1] for line in found if line}
    if None in found or len(sums) != len(found) or set(sums) != names:
        raise _damaged(f"{_SUMS} does not list exactly the files of the archive")
    return sums


def _read_head(archive: zipfile.ZipFile, sums: Mapping[str, str]) -> _Head:
    content = _small(archive, _HEAD, _MOST_HEAD_BYTES)
    if hashlib.sha256(content).hexdigest() != sums[_HEAD]:
        raise _damaged(f"{_HEAD} does not match {_SUMS}")
    try:
        head = json.loads(content)
        revision, form = int(head["revision"]), int(head["format"])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise _damaged(f"{_HEAD} does not identify its writer") from error
    if revision > SCHEMA_VERSION or form > 1:
        raise InvalidRequest(
            f"a newer PlannerForge wrote the archive (revision {revision} of the database, form {form})",
            valid=[f"revision {SCHEMA_VERSION} and before, form 1"],
            next_step="use that PlannerForge, or a newer one",
        )
    try:
        return _Head.model_validate(head)
    except ValidationError as error:
        raise _damaged(f"{_HEAD}: {problems_of(_Head, error)[0][0]}") from error


def _small(archive: zipfile.ZipFile, name: str, most_bytes: int) -> bytes:
    if archive.getinfo(name).file_size > most_bytes:
        raise UnsafeInput(f"{name} in the archive has more than {most_bytes:,} bytes")
    return archive.read(name)


def _unpack(
    archive: zipfile.ZipFile, sums: Mapping[str, str], folder: Path, check: CheckFile, on_bytes: OnBytes
) -> None:
    """Write all files into a folder after checking their digests and content."""
    total, done = sum(archive.getinfo(name).file_size for name in sums), 0
    for name, digest in sums.items():
        target = folder / name
        found = hashlib.sha256()
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(name) as packed, target.open("xb") as stream:
                while block := packed.read(_BLOCK_BYTES):
                    found.update(block)
                    stream.write(block)
                    done += len(block)
                    on_bytes(done, total)
        except OSError as error:
            raise disk_failure(target, error) from error
        if found.hexdigest() != digest:
            raise _damaged(f"{name} does not match {_SUMS}")
        if name.startswith("files/"):
            check(target)
    os.sync()  # once for all files, since syncing many thousands separately takes minutes


def _read_records(folder: Path) -> Iterator[_Record]:
    """Yield the artifacts of an unpacked archive.

    Raises:
        UnsafeInput: A line has no valid artifact.
    """
    with (folder / _RECORDS).open("rb") as stream:
        for number, line in enumerate(iter(lambda: stream.readline(_MOST_RECORD_BYTES), b""), start=1):
            try:
                yield _Record.model_validate_json(line)
            except ValidationError as error:
                problem = cited(problems_of(_Record, error)[0][0])
                raise _damaged(f"{_RECORDS}, line {number}: {problem}") from error


def _classify(workspace: Workspace, folder: Path, head: _Head, sums: Mapping[str, str]) -> tuple[set[str], int]:
    """Return the archive folders of artifacts that are new to this workspace, and the number of known artifacts.

    Raises:
        UnsafeInput: Records and files do not match.
        NotPossible: A different artifact already has one of the ids.
    """
    seen: set[str] = set()
    new: set[str] = set()
    files: set[str] = set()
    different: list[str] = []
    for record in _read_records(folder):
        if record.place in seen:
            raise _damaged(f"it has two records of {record.kind} {record.artifact_id}")
        if _is_lost(record):
            raise _damaged(f"{record.kind} {record.artifact_id} has no {MAIN_FILES[record.kind]}")
        fault = record_fault(record.kind, record.artifact_id, record.recipe, record.record, folder / record.place)
        fault = fault or text_fault(record.kind, one_line(record.name), in_one_line(record.record))
        if fault:
            raise UnsafeInput(
                f"{record.kind} {record.artifact_id} in the archive is inconsistent: {fault}",
                next_step="request an unmodified archive of `workspace export` from its author",
            )
        seen.add(record.place)
        files |= {f"{record.place}/{file}" for file in record.files}
        if workspace.find(record.kind, record.artifact_id) is None:
            new.add(record.place)
        elif not _is_same(workspace, record, sums):
            different.append(f"{record.kind} {record.artifact_id}")
    if len(seen) != head.artifacts or files != {name for name in sums if name.startswith("files/")}:
        raise _damaged("its records do not match its files")
    if different:
        raise NotPossible(
            f"{len(different)} artifacts of the archive have ids of different artifacts here: "
            f"{', '.join(different[:_SHOWN])}",
            next_step="import it into another --workspace",
        )
    return new, len(seen) - len(new)


def _is_same(workspace: Workspace, record: _Record, sums: Mapping[str, str]) -> bool:
    """Return True if the stored artifact with this id is the same.

    A scenario is defined by its file: its record is derived from the file, and a newer version of the program may
    derive a different record.
    """
    stored = workspace.find(record.kind, record.artifact_id)
    if stored is None or stored.recipe != record.recipe:
        return False
    if record.kind != "scenario" and stored.record != record.record:
        return False
    folder = workspace.folder(record.kind, record.artifact_id)
    here = {file.name: content_digest(file) for file in folder.iterdir()} if folder.is_dir() else {}
    there = {file: sums[f"{record.place}/{file}"] for file in record.files}
    return {name: here[name] for name in here.keys() - _TIMED} == {name: there[name] for name in there.keys() - _TIMED}


def _stage_record(record: _Record, folder: Path) -> NewArtifact:
    return NewArtifact(
        record.kind,
        record.artifact_id,
        record.recipe,
        _AsWritten(in_one_line(record.record)),
        files={},
        name=one_line(record.name),
        copies=folder / record.place if record.files else None,
        made_at=record.made_at,
        imported=record.kind != "config",  # its id derives from its content
    )


def _journal_places(workspace: Workspace, folder: Path, sums: Mapping[str, str]) -> list[tuple[Path, Path]]:
    """Return where to keep the journal of an archive: next to this workspace's journal, under a separate name."""
    return [
        (folder / name, workspace.root / "journal" / f"imported-{digest[:12]}-{name.rpartition('/')[2]}")
        for name, digest in sums.items()
        if name.startswith("journal/")
    ]


@contextmanager
def _place_files(places: Sequence[tuple[Path, Path]]) -> Iterator[None]:
    """Move files to their folders for the block, and remove them again if it fails; existing files stay."""
    placed: list[Path] = []
    try:
        for source, target in places:
            if target.exists():
                continue
            try:
                make_private(target.parent)
                source.chmod(0o600)
                source.rename(target)
            except OSError as error:
                raise disk_failure(target, error) from error
            placed.append(target)
        yield
    except BaseException:
        for target in placed:
            target.unlink(missing_ok=True)
        raise
