"""A run of the default planner on a scenario that was just made, before it is handed out."""

from plannerforge.engine.tuning.configurations import DEFAULT_CONFIGURATION
from plannerforge.schemas.generation import ScenarioSummary
from plannerforge.schemas.runs import NO_TRAJECTORY
from plannerforge.tools.call import ToolCall
from plannerforge.tools.configurations import resolve_configuration, store_configuration
from plannerforge.tools.run_grid import Cell, run_grid

CHECK = "planner can run"
ADVICE = "the default planner cannot run here; another seed makes other traffic and another ego"


async def with_trial_run(call: ToolCall, summary: ScenarioSummary) -> ScenarioSummary:
    """The summary with what the default planner made of the scenario; the run is stored as any other.

    A collision or a missed goal is a result, not a fault of the scenario. The check fails where no run was possible:
    the planner found the problem invalid or no trajectory for it, or the run was lost. The scenario is handed out all
    the same, with a note.
    """
    configuration = resolve_configuration(DEFAULT_CONFIGURATION, call)
    store_configuration(call, configuration)
    (result,) = await run_grid(call, [Cell(summary.scenario_id, None, configuration)], lambda _: None)
    if result.record is not None:
        told = f"{result.record.outcome} ({DEFAULT_CONFIGURATION}, {result.record.run_id}): {result.record.reason}"
    else:
        told = result.lost.error if result.lost is not None else "no result"
    if result.record is not None and result.record.outcome not in NO_TRAJECTORY:
        return summary.model_copy(update={"trial_run": told, "checks_passed": [*summary.checks_passed, CHECK]})
    failed = {"checks_failed": [*summary.checks_failed, CHECK], "notes": [*summary.notes, ADVICE]}
    return summary.model_copy(update={"trial_run": told, **failed})
