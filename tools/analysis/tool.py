"""The tools that say what runs show: figures of a set, and one set against another."""

from collections.abc import Sequence

from ...schemas.analysis.comparison import CompareRequest, CompareResultsArguments, CompareResultsResult, Side
from ...schemas.errors import InvalidRequest
from ...schemas.results import AnalyseRequest, AnalyzeResultsArguments, AnalyzeResultsResult
from ...schemas.runs import RunSource
from ..call import ToolCall
from ..operations import ANALYSE, COMPARE
from ..results import ChosenResult, chosen_runs, config_weights, lineages, scenario_sources
from .looks import looked_at
from .trial import with_trials


async def analyze_results(arguments: AnalyzeResultsArguments, call: ToolCall) -> AnalyzeResultsResult:
    """Rates, metrics, costs and findings of runs."""
    chosen, runs = chosen_runs(arguments.results, call)
    call.shows(*(result.result_id for result in chosen))
    if arguments.detail in ("summary", "findings") and len(runs) > 1:
        runs = await looked_at(runs, call)
    request = AnalyseRequest(
        results=tuple(result.result_id for result in chosen),
        runs=runs,
        configs=config_weights(runs, call),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), call),
        lineage=lineages((run.record.scenario_id for run in runs), call),
        lost=tuple(cell for result in chosen for cell in result.lost),
        breakdown=arguments.breakdown,
        where=tuple(arguments.where),
        detail=arguments.detail,
    )
    result = await call.run(ANALYSE, request)
    if not arguments.trial:
        return result
    return await with_trials(result, runs, call)


async def compare_results(arguments: CompareResultsArguments, call: ToolCall) -> CompareResultsResult:
    """Paired tests of every side against the first."""
    words, notes = _words_of(arguments, call)
    chosen, runs = chosen_runs(words, call)
    call.shows(*(result.result_id for result in chosen))
    request = CompareRequest(
        sides=_sides_of(chosen, runs),
        runs=runs,
        configs=config_weights(runs, call),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), call),
        lineage=lineages((run.record.scenario_id for run in runs), call),
        metrics=tuple(arguments.metrics),
        limit=arguments.limit,
    )
    result = await call.run(COMPARE, request)
    asked = arguments.limit if "limit" in arguments.model_fields_set else None
    return result.model_copy(update={"notes": (*notes, *result.notes), "flips_asked": asked})


def _words_of(arguments: CompareResultsArguments, call: ToolCall) -> tuple[list[str], tuple[str, ...]]:
    """What is compared; left out while there is one batch only, its configurations, and without any, two runs."""
    if "results" in arguments.model_fields_set:
        return arguments.results, ()
    batches = len(call.newest("batch", count=2))
    if batches == 0:
        return ["previous_run", "latest_run"], ("there is no batch: the two newest runs are compared",)
    if batches == 1:
        return ["latest_batch"], ("there is one batch only: its configurations are compared",)
    return arguments.results, ()


def _sides_of(chosen: Sequence[ChosenResult], runs: Sequence[RunSource]) -> tuple[Side, ...]:
    """The sides in the given order.

    A batch gives one side a configuration; single runs with several configurations are put together by configuration;
    two runs of one configuration stand against each other.

    Raises:
        InvalidRequest: there is only one side.
    """
    by_id = {run.record.run_id: run for run in runs}
    if all(result.kind == "run" for result in chosen) and len({run.record.config_id for run in runs}) > 1:
        groups = [("", list(by_id.values()))]
    else:
        groups = [(result.result_id, [by_id[run_id] for run_id in result.run_ids]) for result in chosen]
    sides = [side for label, members in groups for side in _by_config(label, members, alone=len(groups) == 1)]
    if len(sides) < 2:
        labels = ", ".join(side.label for side in sides)
        raise InvalidRequest(
            f"only one side: {labels}",
            valid=["two runs or batches", "one batch with several configurations"],
            next_step="run another configuration on the same scenarios with run_planner",
        )
    return tuple(sides)


def _by_config(label: str, members: Sequence[RunSource], *, alone: bool) -> list[Side]:
    groups: dict[str, list[RunSource]] = {}
    for member in members:
        groups.setdefault(member.record.config_id, []).append(member)
    names = [group[0].record.config_name for group in groups.values()]
    sides = []
    for config_id, group in groups.items():
        name = group[0].record.config_name
        words = name if names.count(name) == 1 else f"{name} {config_id}"
        sides.append(
            Side(
                label=words if alone else f"{words} ({label})",
                config_id=config_id,
                config_name=name,
                run_ids=tuple(member.record.run_id for member in group),
            )
        )
    return sides
