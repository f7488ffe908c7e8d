"""The worker side of a Dask cluster: an operation, its files by content, and the pool that runs it.

The workers import this module; the server imports it only if a cluster is configured.
"""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio.from_thread
from distributed import Worker, WorkerPlugin, get_worker

from ...schemas.errors import PlannerForgeError, ResourceFailure, UnexpectedFailure
from ..workspace import versions_of
from .executor import Operation
from .limits import Limits
from .pool import WorkerPool
from .worker import Answer, Failure

if TYPE_CHECKING:
    from anyio.from_thread import BlockingPortal

WORKERS = "plannerforge"
"""The name of the plugin on every worker."""
_MOST_KEPT_BYTES = 2 * 1024**3
"""Space for files on a worker (chosen: a thousand times the size of one scenario of a batch of 500)."""


@dataclass(frozen=True)
class FileParcel:
    """A file in a field of a request: its name, SHA-256 and, if requested, its content."""

    field: str
    name: str
    digest: str
    content: bytes | None = None


@dataclass(frozen=True)
class Parcel:
    """An operation and its request as JSON, the files that it reads, and the required versions."""

    operation: Operation[Any, Any]
    request: str
    files: tuple[FileParcel, ...]
    versions: Mapping[str, str]


@dataclass(frozen=True)
class Missing:
    """Digests of the files that a worker lacks."""

    digests: frozenset[str]


@dataclass(frozen=True)
class Delivery:
    """The response of an operation, and its output files: names in the request's folder, with their contents."""

    answer: Answer
    files: tuple[tuple[str, bytes], ...] = ()


class WorkerProcesses(WorkerPlugin):  # type: ignore[misc]  # distributed is not type-checked
    """The pool of one Dask worker, with one process per thread; it ends with the worker."""

    name = WORKERS

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._exits = contextlib.ExitStack()

    def setup(self, worker: Worker) -> None:
        """Create a folder in the worker's own and a pool, which starts its processes with the first operation."""
        self._address = worker.address
        self._folder = Path(worker.local_directory) / WORKERS
        self._files = self._folder / "files"
        self._files.mkdir(parents=True, exist_ok=True)
        limits = replace(
            self._limits,
            roots=(self._folder,),
            worker_count=worker.state.nthreads,
            recordings=self._folder / "recordings",
        )
        self._portal: BlockingPortal = self._exits.enter_context(anyio.from_thread.start_blocking_portal())
        opened = WorkerPool.open(limits, self._folder / "workers.log")
        self._pool = self._exits.enter_context(self._portal.wrap_async_context_manager(opened))

    def teardown(self, worker: Worker) -> None:
        """Stop the processes."""
        del worker
        self._exits.close()

    def __getstate__(self) -> dict[str, Any]:
        """Return only the limits, which are sent to the worker."""
        return {"_limits": self._limits}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["_limits"])  # type: ignore[misc]

    def carry_out(self, parcel: Parcel) -> Delivery | Missing:
        """Run the operation in one of the processes.

        Raises:
            PlannerForgeError: The operation raised it, or this worker has other versions.
        """
        self._check_versions(parcel.versions)
        missing = frozenset(file.digest for file in parcel.files if not self._received(file))
        if missing:
            return Missing(missing)
        operation = parcel.operation
        request = json.loads(parcel.request)
        for file in parcel.files:
            request[file.field] = str(self._path(file))
        with tempfile.TemporaryDirectory(dir=self._folder) as scratch:
            if operation.writes:
                request[operation.writes] = scratch
            made = operation.request_type.model_validate(request)
            response = self._portal.call(self._pool.run, operation, made)
            written = sorted(path for path in Path(scratch).rglob("*") if path.is_file())
            files = tuple((path.relative_to(scratch).as_posix(), path.read_bytes()) for path in written)
        return Delivery(Answer(response.model_dump_json()), files)

    def _check_versions(self, wanted: Mapping[str, str]) -> None:
        own = versions_of(*(name for name in wanted if name != "plannerforge-mcp"))
        other = [f"{name} {own[name]}, not {version}" for name, version in wanted.items() if own[name] != version]
        if other:
            raise ResourceFailure(
                f"the worker {self._address} of the cluster has {'; '.join(other)}, so its results would differ",
                next_step="install the same versions on all workers and on the server",
            )

    def _path(self, file: FileParcel) -> Path:
        return self._files / file.digest / Path(file.name).name

    def _received(self, file: FileParcel) -> bool:
        """Write the received content of a file; return True if the file is present."""
        path = self._path(file)
        if path.is_file():
            return True
        if file.content is None:
            return False
        self._make_room(len(file.content))
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "wb") as opened:
            opened.write(file.content)
        Path(name).replace(path)
        return True

    def _make_room(self, size_bytes: int) -> None:
        kept = {folder: sum(file.stat().st_size for file in folder.iterdir()) for folder in self._files.iterdir()}
        total = sum(kept.values()) + size_bytes
        for folder in sorted(kept, key=lambda folder: folder.stat().st_mtime_ns):
            if total <= _MOST_KEPT_BYTES:
                break
            total -= kept[folder]
            shutil.rmtree(folder, ignore_errors=True)


def carry_out(parcel: Parcel) -> Delivery | Missing | Failure:
    """Run a task of a worker; return a failure as a value, so that the cluster does not treat it as its own failure."""
    plugin = get_worker().plugins[WORKERS]
    if not isinstance(plugin, WorkerProcesses):
        raise TypeError(f"the plugin {WORKERS} of this worker is a {type(plugin).__name__}")
    try:
        return plugin.carry_out(parcel)
    except UnexpectedFailure as error:
        return Failure.of(error, error.details)
    except PlannerForgeError as error:
        return Failure.of(error)
    except OSError as error:
        return Failure.of(ResourceFailure(f"a worker of the cluster failed: {error.strerror or error}"))
