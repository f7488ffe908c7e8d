"""Analyses a set of runs (rates, metrics, costs and findings) and, on request, tries the suggested changes."""

from ...schemas.results import AnalyseRequest, AnalyzeResultsArguments, AnalyzeResultsResult
from ..context import WorkflowContext
from ..operations import ANALYSE
from ..results import chosen_runs, config_weights, lineages, scenario_sources
from .looks import looked_at
from .trial import with_trials


async def analyze_results(arguments: AnalyzeResultsArguments, context: WorkflowContext) -> AnalyzeResultsResult:
    """Return rates, metrics, costs and findings of runs."""
    chosen, runs = chosen_runs(arguments.results, context)
    if arguments.detail in ("summary", "findings") and len(runs) > 1:
        runs = await looked_at(runs, context)
    request = AnalyseRequest(
        results=tuple(result.result_id for result in chosen),
        runs=runs,
        configs=config_weights(runs, context),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), context),
        lineage=lineages((run.record.scenario_id for run in runs), context),
        lost=tuple(cell for result in chosen for cell in result.lost),
        breakdown=arguments.breakdown,
        where=tuple(arguments.where),
        detail=arguments.detail,
        limit=arguments.limit,
        offset=arguments.offset,
    )
    result = await context.run(ANALYSE, request)
    if not arguments.trial:
        return result
    return await with_trials(result, runs, context)
