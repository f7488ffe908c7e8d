"""An executor for ``make bench-faults`` that lets the runs of some scenarios misbehave."""

from collections.abc import Mapping

from plannerforge.engine.execution.executor import Executor, Lane, OnProgress, Response, no_progress
from plannerforge.schemas.base import Model
from plannerforge.schemas.planning import RunRequest


class Misdirecting:
    """Carries out what it is asked for, but another operation for the runs of some scenarios.

    Args:
        inner: who carries it out.
        instead: scenario → entry point of the operation for its runs.
        limit_s: the time limit of such a run.
    """

    def __init__(self, inner: Executor, instead: Mapping[str, str], limit_s: float) -> None:
        self._inner, self._instead, self._limit_s = inner, instead, limit_s

    @property
    def capacity(self) -> int:
        """That of the executor behind it."""
        return self._inner.capacity

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
        """Run the operation, or the one that misbehaves."""
        if isinstance(request, RunRequest) and request.scenario_id in self._instead:
            entry_point, timeout_s = self._instead[request.scenario_id], self._limit_s
        return await self._inner.run(
            entry_point, request, response_type, timeout_s=timeout_s, on_progress=on_progress, lane=lane
        )
