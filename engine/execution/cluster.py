"""Runs operations on a Dask cluster, and locally if they cannot travel or the cluster is gone.

An operation can travel if it declares which fields of its request are files (``reads``) or a folder for its results
(``writes``). Workers identify files by content: a worker without a file reports it, and receives it once. The worker's
part is in ``cluster_worker.py``: it too runs operations in a pool of processes within the same limits, so that an
operation that crashes or hangs does not take down a worker of the cluster.
"""

import asyncio
import contextlib
import hashlib
import logging
import math
import time
from collections.abc import AsyncIterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio
import anyio.to_thread

from ...schemas.errors import ResourceFailure, WorkerFailure
from ..workspace import versions_of
from .cluster_worker import WORKERS, Delivery, FileParcel, Missing, Parcel, WorkerProcesses, carry_out
from .executor import Executor, OnProgress, Operation, Request, Response, no_progress
from .limits import Limits
from .pool import response_of
from .worker import Failure

if TYPE_CHECKING:
    import distributed

_AGAIN_S = 30.0
"""Time without a cluster until the next attempt to connect (chosen)."""
_LOOK_S = 2.0
"""Interval at which a waiting operation checks that there are workers (chosen)."""
_EMPTY_S = 20.0
"""A cluster without any worker for this time counts as gone (chosen: a new worker starts in 5 s)."""
_AHEAD = 1.25
"""Operations under way per thread of the cluster, so that no thread waits for the transfer (chosen)."""
_MOST_SENT = 4
"""Most transfers of files for one operation, which may move to a worker without them (chosen)."""
_RESULTS = ("frenetix", "commonroad-io", "commonroad-drivability-checker", "libsumo", "numpy", "scipy", "shapely")
"""Packages that may affect a result; workers must have the same versions."""
logger = logging.getLogger(__name__)


class _ClusterUnavailable(Exception):
    """The scheduler does not answer, or has no workers."""


class ClusterExecutor:
    """Sends operations to the workers of a Dask scheduler; use as ``async with ClusterExecutor.open(...)``.

    ``notice``: the reason why operations run locally instead, or empty; ``sent_files``: the number of files sent to
    workers so far.
    """

    def __init__(
        self, address: str, here: Executor, limits: Limits, connect_s: float, versions: Mapping[str, str]
    ) -> None:
        self._address, self._here, self._limits = address, here, limits
        self._connect_s, self._versions = connect_s, versions
        self._client: distributed.Client | None = None
        self._threads = 0
        self._gone_since: float | None = None
        self._connecting = anyio.Lock()
        self._digests: dict[tuple[str, int, int], str] = {}
        self.notice = ""
        self.sent_files = 0

    @classmethod
    @contextlib.asynccontextmanager
    async def open(
        cls,
        address: str,
        here: Executor,
        limits: Limits,
        *,
        connect_s: float = 10.0,
        versions: Mapping[str, str] | None = None,
    ) -> AsyncIterator["ClusterExecutor"]:
        """Yield an executor for the cluster at an address, such as ``tcp://host:8786``, or in a scheduler file.

        The executor ``here`` runs what cannot travel. An unreachable cluster is not an error: ``notice`` reports it,
        and the executor tries again later.

        Args:
            address: The scheduler's address, or the path of its file.
            here: Runs what cannot travel, and everything while the cluster is gone.
            limits: The resources that an operation may use on a worker.
            connect_s: How long to wait for the scheduler, which answers within a second on a working network.
            versions: Packages that workers must have in these versions; None means the local versions of the packages
                that affect results.
        """
        executor = cls(address, here, limits, connect_s, versions or versions_of(*_RESULTS))
        await executor._connect_if_due()
        try:
            yield executor
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.to_thread.run_sync(executor._close)

    @property
    def capacity(self) -> int:
        """The number of simultaneous operations, slightly more than the cluster's threads."""
        return math.ceil(_AHEAD * self._threads) if self._client is not None else self._here.capacity

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation on the cluster and return its response, without progress reports.

        If the caller is cancelled, the operation is abandoned; if it already runs, it ends at its time limit at the
        latest.

        Raises:
            PlannerForgeError: The operation raised it.
            WorkerTimeout: The operation exceeded its time limit.
            WorkerFailure: The workers that ran it died, one after another.
            ResourceFailure: A worker has other versions of result-relevant packages, or no space.
        """
        if operation.reads and await self._connect_if_due():
            try:
                return await self._on_cluster(operation, request)
            except _ClusterUnavailable as gone:
                await self._disconnect(str(gone))
        return await self._here.run(operation, request, on_progress=on_progress)

    async def _connect_if_due(self) -> bool:
        async with self._connecting:
            if self._client is None and (self._gone_since is None or time.monotonic() - self._gone_since > _AGAIN_S):
                try:
                    self._client, self._threads = await anyio.to_thread.run_sync(self._connect)
                    self._gone_since, self.notice = None, ""
                except (OSError, ValueError, _ClusterUnavailable) as error:
                    self._announce_outage(f"{error or type(error).__name__}")
            return self._client is not None

    def _connect(self) -> tuple["distributed.Client", int]:
        from distributed import Client

        # It logs lost connections as tracebacks; ``notice`` describes them.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        file = Path(self._address).expanduser()
        where: dict[str, Any] = {"scheduler_file": str(file)} if file.is_file() else {"address": self._address}
        client = Client(**where, timeout=self._connect_s, set_as_default=False, name="plannerforge")
        try:
            client.wait_for_workers(1, timeout=_EMPTY_S)
            client.register_plugin(WorkerProcesses(self._limits), name=WORKERS)
            threads = sum(client.nthreads().values())
        except TimeoutError as error:
            client.close(timeout=1)
            raise _ClusterUnavailable("it has no workers") from error
        return client, threads

    def _announce_outage(self, why: str) -> None:
        self._gone_since = time.monotonic()
        self.notice = f"the cluster at {self._address} is unavailable ({why}); operations run on this machine"
        logger.warning("%s", self.notice)

    async def _disconnect(self, why: str) -> None:
        async with self._connecting:
            if self._client is not None:
                self._announce_outage(why)
                with anyio.CancelScope(shield=True):
                    await anyio.to_thread.run_sync(self._close)

    def _close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(OSError, TimeoutError):  # the peer is already gone
                client.close(timeout=2)

    async def _on_cluster(self, operation: Operation[Request, Response], request: Request) -> Response:
        parcel, paths = await anyio.to_thread.run_sync(self._parcel, operation, request)
        for _ in range(_MOST_SENT):
            answer = await self._send_parcel(operation.name, parcel)
            if not isinstance(answer, Missing):
                break
            self.sent_files += len(answer.digests)
            # the next worker may be a different one, so the order contains everything that this worker lacks
            parcel = await anyio.to_thread.run_sync(_with_contents, parcel, paths, answer)
        if isinstance(answer, Missing):
            raise WorkerFailure(f"{operation.name} was sent its files {_MOST_SENT} times, and no worker kept them")
        if isinstance(answer, Failure):
            return response_of(operation, answer)
        if operation.writes:
            folder = Path(getattr(request, operation.writes))
            await anyio.to_thread.run_sync(_write_results, answer, folder)
        return await anyio.to_thread.run_sync(response_of, operation, answer.answer)

    def _parcel(self, operation: Operation[Request, Response], request: Request) -> tuple[Parcel, dict[str, Path]]:
        paths = {name: Path(str(getattr(request, name))) for name in operation.reads}
        files = tuple(FileParcel(name, path.name, self._digest(path)) for name, path in paths.items())
        return Parcel(operation, request.model_dump_json(), files, self._versions), paths

    def _digest(self, path: Path) -> str:
        """Return the SHA-256 of a file, which is read once."""
        try:
            state = path.stat()
            key = (str(path), state.st_mtime_ns, state.st_size)
            if key not in self._digests:
                with path.open("rb") as file:
                    self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise ResourceFailure(f"{path.name} cannot be read: {error.strerror or error}") from error
        return self._digests[key]

    async def _send_parcel(self, name: str, parcel: Parcel) -> Delivery | Missing | Failure:
        """Return a worker's answer to a parcel.

        Raises:
            _ClusterUnavailable: The scheduler or all workers are gone.
            WorkerFailure: The workers that received it died.
        """
        from distributed import CancelledError
        from distributed.scheduler import KilledWorker

        client = self._client
        if client is None:
            raise _ClusterUnavailable("it went away")
        done, loop = anyio.Event(), asyncio.get_running_loop()
        future = await anyio.to_thread.run_sync(lambda: client.submit(carry_out, parcel, pure=False))
        try:
            future.add_done_callback(lambda _: loop.call_soon_threadsafe(done.set))
            await self._wait_until_done(client, done)
            answer: Delivery | Missing | Failure = await anyio.to_thread.run_sync(future.result)
        except KilledWorker as error:
            raise WorkerFailure(
                f"the workers of the cluster that ran {name} died, one after another",
                next_step="request less at once, or give the workers more memory",
            ) from error
        except (CancelledError, OSError, TimeoutError) as error:
            raise _ClusterUnavailable("its scheduler went away") from error
        finally:
            with anyio.CancelScope(shield=True), contextlib.suppress(Exception):
                await anyio.to_thread.run_sync(future.cancel)
        return answer

    async def _wait_until_done(self, client: "distributed.Client", done: anyio.Event) -> None:
        """Wait until an operation is done, as long as there are workers."""
        seen = time.monotonic()
        while not done.is_set():
            with anyio.move_on_after(_LOOK_S):
                await done.wait()
            if done.is_set():
                return
            if client.status != "running":
                raise _ClusterUnavailable("its scheduler went away")
            if await anyio.to_thread.run_sync(client.nthreads):
                seen = time.monotonic()
            elif time.monotonic() - seen > _EMPTY_S:
                raise _ClusterUnavailable("it has no workers")


def _with_contents(parcel: Parcel, paths: dict[str, Path], missing: Missing) -> Parcel:
    files = tuple(
        replace(file, content=paths[file.field].read_bytes()) if file.digest in missing.digests else file
        for file in parcel.files
    )
    return replace(parcel, files=files)


def _write_results(delivery: Delivery, folder: Path) -> None:
    """Write the operation's output files from its worker into the request's folder."""
    try:
        for name, content in delivery.files:
            path = folder / name
            if not path.resolve().is_relative_to(folder.resolve()):
                raise ResourceFailure(f"a worker of the cluster sent a file outside its folder: {name}")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except OSError as error:
        raise ResourceFailure(f"a result of the cluster cannot be written: {error.strerror or error}") from error
