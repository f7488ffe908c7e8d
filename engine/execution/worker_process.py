"""One worker process, seen from the server: start, give an order, kill."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import IO

import anyio
import anyio.abc
from anyio.streams.buffered import BufferedByteReceiveStream

from plannerforge.engine.execution.executor import OnProgress
from plannerforge.engine.execution.messages import LONGEST_LINE_BYTES, Answer, Failure, Order, Progress, read_report
from plannerforge.engine.execution.worker import WARM_UP
from plannerforge.schemas.errors import WorkerFailure

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""More threads would make sums depend on their order, and the cores are shared by the workers anyway."""


class WorkerProcess:
    """A spawned interpreter that carries out one order after the other."""

    def __init__(self, process: anyio.abc.Process) -> None:
        if process.stdout is None or process.stdin is None:
            raise WorkerFailure("a worker started without pipes")
        self._process = process
        self._orders = process.stdin
        self._reports = BufferedByteReceiveStream(process.stdout)

    @classmethod
    async def start(cls, *, memory_bytes: int, log: Path, preload: tuple[str, ...] = ()) -> "WorkerProcess":
        """Spawn a worker that imports ``preload`` before its first order; its stray output goes to ``log``."""
        environment = {**os.environ, **_ONE_THREAD, "PLANNERFORGE_WORKER_MEMORY": str(memory_bytes)}
        with _opened(log) as stderr:
            process = await anyio.open_process(
                [sys.executable, "-m", "plannerforge.engine.execution.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stderr,
                env=environment,
                start_new_session=True,
            )
        worker = cls(process)
        try:
            if preload:
                await worker._orders.send(Order(WARM_UP, " ".join(preload)).line())
        except BaseException:
            await worker.kill()
            raise
        return worker

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.returncode is None

    async def carry_out(self, order: Order, on_progress: OnProgress) -> Answer | Failure:
        """Send an order and wait for its end.

        Raises:
            WorkerFailure: the process died.
        """
        report = await self._exchanged(order, order.line())
        while isinstance(report, Progress):
            await on_progress(report.share, report.message)
            report = await self._exchanged(order)
        return report

    async def _exchanged(self, order: Order, line: bytes = b"") -> Progress | Answer | Failure:
        try:
            if line:
                await self._orders.send(line)
            return read_report(await self._reports.receive_until(b"\n", LONGEST_LINE_BYTES))
        except (anyio.IncompleteRead, anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError) as error:
            status = await self.kill()
            raise WorkerFailure(
                f"the worker process died ({_cause(status)}) in {order.entry_point.rpartition(':')[2]}",
                next_step="call again: a fresh worker takes over; if it happens again, ask for less at once",
            ) from error

    async def kill(self) -> int:
        """End the process and all that it started at once, and wait until it is gone; returns its exit status."""
        with anyio.CancelScope(shield=True):
            if self.alive:
                self._end_group()
            status = await self._process.wait()
            await self._process.aclose()
        return status

    def _end_group(self) -> None:
        if sys.platform == "win32":
            self._process.kill()
            return
        with contextlib.suppress(ProcessLookupError):  # it ended by itself meanwhile
            os.killpg(self.pid, signal.SIGKILL)


class _opened:  # noqa: N801 - reads as a verb where it is used
    """The log file for the time it takes to hand it to a child."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> IO[bytes]:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("ab")
        return self._file

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def _cause(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"exit status {status}"
