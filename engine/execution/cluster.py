"""Operations carried out on a Dask cluster; what cannot travel, and all of it while the cluster is gone, here.

An operation travels if it says which fields of its request name files (``reads``) or a folder for its results
(``writes``). Files are named to a worker by their content: one that has not seen a file says so, and is sent it once.
What happens on a worker is in ``cluster_worker.py``: there, too, a pool of processes carries operations out, within the
same limits, so that an operation that crashes or hangs takes no worker of the cluster with it.
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
"""After so long without a cluster it is looked for again; chosen."""
_LOOK_S = 2.0
"""How often an operation that waits looks whether there are workers at all; chosen."""
_EMPTY_S = 20.0
"""A cluster without any worker for so long is taken to be gone; chosen: a worker that is started anew takes 5 s."""
_AHEAD = 1.25
"""Operations that are under way for each thread of the cluster, so that none waits for the way there; chosen."""
_MOST_SENT = 4
"""How often files are sent for one operation, which may move to a worker that has not seen them; chosen."""
_RESULTS = ("frenetix", "commonroad-io", "commonroad-drivability-checker", "libsumo", "numpy", "scipy", "shapely")
"""Packages whose version may change a result: workers must have the same."""
logger = logging.getLogger(__name__)


class _ClusterGone(Exception):
    """The scheduler does not answer, or has no workers."""


class ClusterExecutor:
    """Sends operations to the workers of a Dask scheduler; use as ``async with ClusterExecutor.open(...)``.

    ``notice``: why operations are carried out here instead, empty where they are not; ``sent_files``: files that were
    sent to workers so far.
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
        """An executor on the cluster at an address, such as ``tcp://host:8786``, or of a scheduler file.

        What cannot travel is carried out by the executor ``here``. A cluster that does not answer is no error:
        ``notice`` tells it, and it is looked for again.

        Args:
            address: of the scheduler, or the path of its file.
            here: carries out what cannot travel, and everything while the cluster is gone.
            limits: what an operation may use on a worker.
            connect_s: how long the scheduler is waited for; on a network that works it answers within a second.
            versions: packages that workers must have in these versions; None: those that make results, as here.
        """
        executor = cls(address, here, limits, connect_s, versions or versions_of(*_RESULTS))
        await executor._connected()
        try:
            yield executor
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.to_thread.run_sync(executor._close)

    @property
    def capacity(self) -> int:
        """How many operations are under way at once: a few more than the cluster has threads."""
        return math.ceil(_AHEAD * self._threads) if self._client is not None else self._here.capacity

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation on the cluster and return its response; progress inside of it is not told.

        A cancelled caller gives the operation up; where it runs already, it ends there, at its time limit at last.

        Raises:
            PlannerForgeError: what the operation raised.
            WorkerTimeout: it took longer than its time limit.
            WorkerFailure: the workers that carried it out died, one after the other.
            ResourceFailure: a worker has other versions of what makes the results, or no room.
        """
        if operation.reads and await self._connected():
            try:
                return await self._on_cluster(operation, request)
            except _ClusterGone as gone:
                await self._lost(str(gone))
        return await self._here.run(operation, request, on_progress=on_progress)

    async def _connected(self) -> bool:
        async with self._connecting:
            if self._client is None and (self._gone_since is None or time.monotonic() - self._gone_since > _AGAIN_S):
                try:
                    self._client, self._threads = await anyio.to_thread.run_sync(self._connect)
                    self._gone_since, self.notice = None, ""
                except (OSError, ValueError, _ClusterGone) as error:
                    self._tell(f"{error or type(error).__name__}")
            return self._client is not None

    def _connect(self) -> tuple["distributed.Client", int]:
        from distributed import Client

        # What it says of a lost connection are tracebacks; ``notice`` says it in words.
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
            raise _ClusterGone("it has no workers") from error
        return client, threads

    def _tell(self, why: str) -> None:
        self._gone_since = time.monotonic()
        self.notice = f"the cluster at {self._address} is not there ({why}): carried out on this machine"
        logger.warning("%s", self.notice)

    async def _lost(self, why: str) -> None:
        async with self._connecting:
            if self._client is not None:
                self._tell(why)
                with anyio.CancelScope(shield=True):
                    await anyio.to_thread.run_sync(self._close)

    def _close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(OSError, TimeoutError):  # the other end is gone already
                client.close(timeout=2)

    async def _on_cluster(self, operation: Operation[Request, Response], request: Request) -> Response:
        parcel, paths = await anyio.to_thread.run_sync(self._parcel, operation, request)
        for _ in range(_MOST_SENT):
            answer = await self._carried_out(operation.name, parcel)
            if not isinstance(answer, Missing):
                break
            self.sent_files += len(answer.digests)
            # the worker that has not seen a file is not sure to be asked next: all that it misses goes with the order
            parcel = await anyio.to_thread.run_sync(_with_contents, parcel, paths, answer)
        if isinstance(answer, Missing):
            raise WorkerFailure(f"{operation.name} was sent its files {_MOST_SENT} times, and no worker kept them")
        if isinstance(answer, Failure):
            return response_of(operation, answer)
        if operation.writes:
            folder = Path(getattr(request, operation.writes))
            await anyio.to_thread.run_sync(_unpacked, answer, folder)
        return await anyio.to_thread.run_sync(response_of, operation, answer.answer)

    def _parcel(self, operation: Operation[Request, Response], request: Request) -> tuple[Parcel, dict[str, Path]]:
        paths = {name: Path(str(getattr(request, name))) for name in operation.reads}
        files = tuple(FileParcel(name, path.name, self._digest(path)) for name, path in paths.items())
        return Parcel(operation, request.model_dump_json(), files, self._versions), paths

    def _digest(self, path: Path) -> str:
        """SHA-256 of a file; it is read once."""
        try:
            state = path.stat()
            key = (str(path), state.st_mtime_ns, state.st_size)
            if key not in self._digests:
                with path.open("rb") as file:
                    self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise ResourceFailure(f"{path.name} cannot be read: {error.strerror or error}") from error
        return self._digests[key]

    async def _carried_out(self, name: str, parcel: Parcel) -> Delivery | Missing | Failure:
        """What a worker answers to a parcel.

        Raises:
            _ClusterGone: the scheduler went away, or all workers.
            WorkerFailure: the workers that had it died.
        """
        from distributed import CancelledError
        from distributed.scheduler import KilledWorker

        client = self._client
        if client is None:
            raise _ClusterGone("it went away")
        done, loop = anyio.Event(), asyncio.get_running_loop()
        future = await anyio.to_thread.run_sync(lambda: client.submit(carry_out, parcel, pure=False))
        try:
            future.add_done_callback(lambda _: loop.call_soon_threadsafe(done.set))
            await self._waited(client, done)
            answer: Delivery | Missing | Failure = await anyio.to_thread.run_sync(future.result)
        except KilledWorker as error:
            raise WorkerFailure(
                f"the workers of the cluster that carried {name} out died, one after the other",
                next_step="ask for less at once, or give the workers more memory",
            ) from error
        except (CancelledError, OSError, TimeoutError) as error:
            raise _ClusterGone("its scheduler went away") from error
        finally:
            with anyio.CancelScope(shield=True), contextlib.suppress(Exception):
                await anyio.to_thread.run_sync(future.cancel)
        return answer

    async def _waited(self, client: "distributed.Client", done: anyio.Event) -> None:
        """Wait until an operation is done, as long as there are workers."""
        seen = time.monotonic()
        while not done.is_set():
            with anyio.move_on_after(_LOOK_S):
                await done.wait()
            if done.is_set():
                return
            if client.status != "running":
                raise _ClusterGone("its scheduler went away")
            if await anyio.to_thread.run_sync(client.nthreads):
                seen = time.monotonic()
            elif time.monotonic() - seen > _EMPTY_S:
                raise _ClusterGone("it has no workers")


def _with_contents(parcel: Parcel, paths: dict[str, Path], missing: Missing) -> Parcel:
    files = tuple(
        replace(file, content=paths[file.field].read_bytes()) if file.digest in missing.digests else file
        for file in parcel.files
    )
    return replace(parcel, files=files)


def _unpacked(delivery: Delivery, folder: Path) -> None:
    """Write what an operation left on its worker into the folder that the request names."""
    try:
        for name, content in delivery.files:
            path = folder / name
            if not path.resolve().is_relative_to(folder.resolve()):
                raise ResourceFailure(f"a worker of the cluster sent a file for outside of its folder: {name}")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except OSError as error:
        raise ResourceFailure(f"a result of the cluster cannot be written: {error.strerror or error}") from error
