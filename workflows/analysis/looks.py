"""Reviews of runs (``RunLook``), computed once by workers and stored in the workspace for every later analysis."""

import logging
from collections import deque
from collections.abc import Sequence
from time import monotonic

import anyio

from ...schemas.errors import PlannerForgeError
from ...schemas.runs import ReviewRequest, RunSource, drawn, is_worth_a_look
from ..context import WorkflowContext
from ..operations import LOOK_AT_RUNS
from ..results import keep_look, scenario_sources

_AT_ONCE = 8
"""How many runs one request contains (chosen): they take a worker a second or two."""
_WITHIN_S = 20.0
"""How long an answer waits for looks (chosen): an answer has 50 s, and the analysis needs its share."""
logger = logging.getLogger(__name__)


async def looked_at(runs: Sequence[RunSource], context: WorkflowContext) -> tuple[RunSource, ...]:
    """Return the runs with their reviews, as many as are stored or can be computed in twenty seconds.

    Runs without a review are examined in random order, so that the examined ones are a random sample. The next call
    continues where this one stopped.
    """
    by_id = {run.record.run_id: run for run in runs}
    missing = [run.record for run in runs if run.look is None and run.steps_path and is_worth_a_look(run.record)]
    waiting, until = deque(drawn(missing)), monotonic() + _WITHIN_S

    async def work() -> None:
        while waiting and monotonic() < until:
            some = [by_id[waiting.popleft().run_id] for _ in range(min(_AT_ONCE, len(waiting)))]
            scenarios = scenario_sources((run.record.scenario_id for run in some), context)
            try:
                response = await context.services.workers.run(
                    LOOK_AT_RUNS, ReviewRequest(runs=tuple(some), scenarios=scenarios)
                )
            except PlannerForgeError as error:  # the analysis reports what is wrong with these runs, if it needs them
                logger.warning("no look at %s: %s", some[0].record.run_id, error.text)
                continue
            for run, look in zip(some, response.looks, strict=True):
                keep_look(run.record.run_id, look, context)
                by_id[run.record.run_id] = run.model_copy(update={"look": look})

    async with anyio.create_task_group() as tasks:
        for _ in range(min(context.services.workers.capacity, len(waiting))):
            tasks.start_soon(work)
    return tuple(by_id.values())
