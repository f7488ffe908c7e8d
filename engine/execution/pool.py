"""Warm worker processes that carry out engine operations, one at a time each.

Two lanes: ``compute`` for SUMO, planners, files and pictures, and ``retrieval`` for the one process that holds the
embedding model, which takes seconds to import and hundreds of megabytes.
"""

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import anyio

from plannerforge.engine.execution.executor import Lane, OnProgress, Response, no_progress
from plannerforge.engine.execution.limits import Limits
from plannerforge.engine.execution.messages import Answer, Failure, Order
from plannerforge.engine.execution.worker_process import WorkerProcess
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import UnexpectedFailure, WorkerTimeout

PRELOAD: dict[Lane, tuple[str, ...]] = {
    "compute": ("libsumo", "commonroad.common.file_reader", "shapely", "frenetix"),
    "retrieval": ("sentence_transformers", "chromadb"),
}
RETRIEVAL_MEMORY_BYTES = 8 * 1024**3

logger = logging.getLogger(__name__)


class WorkerPool:
    """Runs operations in worker processes; use as ``async with WorkerPool.open(limits, log) as pool``."""

    def __init__(self, limits: Limits, log: Path) -> None:
        self._limits, self._log = limits, log
        self._idle: dict[Lane, list[WorkerProcess]] = {"compute": [], "retrieval": []}
        self._busy: set[WorkerProcess] = set()
        self._slots = {"compute": anyio.Semaphore(limits.worker_count), "retrieval": anyio.Semaphore(1)}

    @classmethod
    @asynccontextmanager
    async def open(cls, limits: Limits, log: Path) -> AsyncIterator["WorkerPool"]:
        """A pool whose processes are all gone when the block is left."""
        pool = cls(limits, log)
        try:
            yield pool
        finally:
            await pool.close()

    @property
    def capacity(self) -> int:
        """How many operations of the compute lane run at once."""
        return self._limits.worker_count

    async def run(
        self,
        entry_point: str,
        request: Model,
        response_type: type[Response],
        *,
        timeout_s: float | None = None,
        on_progress: OnProgress = no_progress,
        lane: Lane = "compute",
    ) -> Response:
        """Run the operation ``module:function`` on a request and give its response.

        A cancelled caller, a time-out and a dead process all end the worker; the next call gets a fresh one.

        Raises:
            PlannerForgeError: what the operation raised.
            WorkerTimeout: the operation took longer than ``timeout_s``.
            WorkerFailure: the process died.
        """
        limit_s = timeout_s or self._limits.operation_timeout_s
        async with self._slots[lane]:
            worker = await self._take(lane)
            finished = False
            try:
                with anyio.fail_after(limit_s):
                    report = await worker.carry_out(Order(entry_point, request.model_dump_json()), on_progress)
                finished = True
            except TimeoutError as error:
                raise WorkerTimeout(
                    f"{entry_point.rpartition(':')[2]} took longer than {limit_s:g} s and was ended",
                    next_step="ask for less at once, or raise the operation_timeout_s setting",
                ) from error
            finally:
                self._busy.discard(worker)
                if finished:
                    self._idle[lane].append(worker)
                else:
                    await worker.kill()
        return self._response(entry_point, report, response_type)

    async def warm_up(self, lane: Lane = "compute") -> None:
        """Have one idle worker with its heavy imports done, before anybody waits for it."""
        nobody_works = self._slots[lane].value == (1 if lane == "retrieval" else self._limits.worker_count)
        if nobody_works and not self._idle[lane]:
            self._idle[lane].append(await self._start(lane))

    async def close(self) -> None:
        """Kill every worker."""
        with anyio.CancelScope(shield=True):
            for worker in [*self._busy, *self._idle["compute"], *self._idle["retrieval"]]:
                await worker.kill()
            for idle in self._idle.values():
                idle.clear()
            self._busy.clear()

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """Process ids of all workers, busy ones first."""
        return tuple(worker.pid for worker in [*self._busy, *self._idle["compute"], *self._idle["retrieval"]])

    async def _take(self, lane: Lane) -> WorkerProcess:
        while self._idle[lane]:
            worker = self._idle[lane].pop()
            if worker.alive:
                self._busy.add(worker)
                return worker
            await worker.kill()
        worker = await self._start(lane)
        self._busy.add(worker)
        return worker

    async def _start(self, lane: Lane) -> WorkerProcess:
        memory = self._limits.worker_memory_bytes if lane == "compute" else RETRIEVAL_MEMORY_BYTES
        return await WorkerProcess.start(memory_bytes=memory, log=self._log, preload=PRELOAD[lane])

    @staticmethod
    def _response(entry_point: str, report: Answer | Failure, response_type: type[Response]) -> Response:
        if isinstance(report, Answer):
            return response_type.model_validate_json(report.response)
        if report.code == UnexpectedFailure.code:
            raise UnexpectedFailure(entry_point.rpartition(":")[2], report.unexpected)
        if report.unexpected:
            logger.error("operation %s failed:\n%s", entry_point, report.unexpected)
        raise report.error()
