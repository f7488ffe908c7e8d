"""Fault injection for ``make bench-faults``: runs that hang or crash the native core in place of the requested ones."""

import ctypes
import time
from collections.abc import Mapping
from dataclasses import replace

from plannerforge.engine.execution import (
    Executor,
    ExecutorAround,
    OnProgress,
    Operation,
    ProgressReporter,
    Request,
    Response,
    no_progress,
)
from plannerforge.schemas.planning import RunRequest, RunResponse

RunOperation = Operation[RunRequest, RunResponse]
_HANG_LIMIT_S = 4.0
"""Time limit of a hanging run (chosen): short, because the bench always waits for it."""


def hang(request: RunRequest, report: ProgressReporter) -> RunResponse:
    """Hang forever."""
    report(0.1, request.scenario_id)
    while True:
        time.sleep(1.0)


def crash(request: RunRequest, report: ProgressReporter) -> RunResponse:
    """Read memory of no process, as a defect of native code would."""
    report(0.1, request.scenario_id)
    ctypes.string_at(0)
    raise AssertionError("the process outlived a segmentation fault")


HANG, CRASH = (
    RunOperation(f"{__name__}:{name}", RunRequest, RunResponse, timeout_s=_HANG_LIMIT_S) for name in ("hang", "crash")
)


class FaultInjector(ExecutorAround):
    """An executor that carries out another operation for the runs of some scenarios.

    Args:
        inner: the executor that carries operations out.
        instead: scenario → operation for its runs.
    """

    def __init__(self, inner: Executor, instead: Mapping[str, RunOperation]) -> None:
        super().__init__(inner)
        self._instead = instead

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation, or the injected one with its time limit."""
        if isinstance(request, RunRequest) and request.scenario_id in self._instead:
            injected = self._instead[request.scenario_id]
            operation = replace(operation, entry_point=injected.entry_point, timeout_s=injected.timeout_s)
        return await self._inner.run(operation, request, on_progress=on_progress)
