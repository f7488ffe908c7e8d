"""The tools that say what runs show: figures of a set, and one set against another."""

from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.schemas.comparison import CompareRequest, CompareResultsArguments, CompareResultsResult
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.results import AnalyseRequest, AnalyzeResultsArguments, AnalyzeResultsResult
from plannerforge.tools.call import ToolCall
from plannerforge.tools.comparison_sides import sides_of
from plannerforge.tools.result_choice import (
    ChosenResult,
    choose_results,
    config_weights,
    run_sources,
    scenario_sources,
)

TIMEOUT_S = 50.0


async def analyze_results(arguments: AnalyzeResultsArguments, call: ToolCall) -> AnalyzeResultsResult:
    """Rates, metrics, costs and findings of runs."""
    chosen = choose_results(arguments.results, call)
    runs = run_sources((run_id for found in chosen for run_id in found.run_ids), call)
    _refuse_empty(chosen, bool(runs))
    request = AnalyseRequest(
        results=tuple(found.result_id for found in chosen),
        runs=runs,
        configs=config_weights(runs, call),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), call),
        lost=tuple(cell for found in chosen for cell in found.lost),
        breakdown=arguments.breakdown,
        where=tuple(arguments.where),
        detail=arguments.detail,
    )
    return await call.run(
        "plannerforge.engine.analysis.summarise:analyse", request, AnalyzeResultsResult, timeout_s=TIMEOUT_S
    )


async def compare_results(arguments: CompareResultsArguments, call: ToolCall) -> CompareResultsResult:
    """Paired tests of every side against the first."""
    words, notes = _words_of(arguments, call.workspace)
    chosen = choose_results(words, call)
    runs = run_sources((run_id for found in chosen for run_id in found.run_ids), call)
    _refuse_empty(chosen, bool(runs))
    request = CompareRequest(
        sides=sides_of(chosen, runs),
        runs=runs,
        configs=config_weights(runs, call),
        metrics=tuple(arguments.metrics),
        limit=arguments.limit,
    )
    result = await call.run(
        "plannerforge.engine.analysis.compare:compare", request, CompareResultsResult, timeout_s=TIMEOUT_S
    )
    return result.model_copy(update={"notes": (*notes, *result.notes)})


def _words_of(arguments: CompareResultsArguments, workspace: Workspace) -> tuple[list[str], tuple[str, ...]]:
    """What is compared; left out while there is one batch only, its configurations."""
    if "results" not in arguments.model_fields_set and len(workspace.newest(kind="batch", limit=2)) == 1:
        return ["latest_batch"], ("there is one batch only: its configurations are compared",)
    return arguments.results, ()


def _refuse_empty(chosen: tuple[ChosenResult, ...], any_run: bool) -> None:
    if any_run:
        return
    errors = [cell.error for found in chosen for cell in found.lost]
    raise NotPossible(
        f"{', '.join(found.result_id for found in chosen)} holds no run{f': {errors[0]}' if errors else ''}",
        next_step="call run_planner again",
    )
