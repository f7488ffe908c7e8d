"""Compare sets of runs: their sides, the pairs of sides, and the paired tests."""

from collections.abc import Callable, Sequence
from itertools import accumulate

from ...engine.planners import PLANNERS
from ...schemas.analysis.comparison import CompareRequest, CompareResultsArguments, CompareResultsResult, Side
from ...schemas.errors import InvalidRequest, Remedy, calling, with_values
from ...schemas.runs import BatchRecord, RunRecord, RunSource, configuration_id
from ...schemas.text import counted
from ..context import WorkflowContext
from ..operations import COMPARE
from ..results import ChosenResult, chosen_runs, config_weights, lineages, scenario_sources


async def compare_results(arguments: CompareResultsArguments, context: WorkflowContext) -> CompareResultsResult:
    """Return paired tests of every side against the first, or of matching sides of several batches."""
    words, notes = _words_of(arguments, context)
    chosen, runs = chosen_runs(words, context)
    if len(chosen) < len(words):
        if len(chosen) == 1:
            raise _same_result(chosen[0], runs).also(*_other_sides(chosen, runs, context))
        ids = " and ".join(result.result_id for result in chosen)
        notes = (*notes, f"{counted(len(words), 'result')} given, but only {ids} among them; each counts once")
    try:
        sides, couples, more = _sides_of(chosen, runs)
    except InvalidRequest as error:
        raise error.also(*_other_sides(chosen, runs, context)) from error.__cause__
    request = CompareRequest(
        sides=sides,
        runs=runs,
        configs=config_weights(runs, context),
        scenarios=scenario_sources((run.record.scenario_id for run in runs), context),
        lineage=lineages((run.record.scenario_id for run in runs), context),
        metrics=tuple(arguments.metrics),
        limit=arguments.limit,
        couples=couples,
    )
    result = await context.run(COMPARE, request)
    limit = arguments.limit if "limit" in arguments.model_fields_set else None
    return result.model_copy(update={"notes": (*notes, *more, *result.notes), "flips_asked": limit})


def _words_of(arguments: CompareResultsArguments, context: WorkflowContext) -> tuple[list[str], tuple[str, ...]]:
    """Return the results to compare; by default the newest batch's configurations, or the two newest runs.

    Raises:
        InvalidRequest: the newest batch has one configuration, and the call gives no older baseline.
    """
    if arguments.results:
        return arguments.results, ()
    batches = context.newest("batch", count=2)
    if not batches:
        note = "there is no batch, so the two newest runs are compared, the older one as the baseline"
        return ["previous_run", "latest_run"], (note,)
    newest = batches[0].artifact_id
    if len(batches) == 1:
        return [newest], ("there is only one batch, so its configurations are compared",)
    if len(batches[0].read(BatchRecord).configs) == 1:
        older = batches[1].artifact_id
        raise InvalidRequest(
            f"{newest} has one configuration, and no baseline was given",
            valid=[f"results ['{older}', '{newest}']"],
            next_step="give both, the baseline first",
        )
    return [newest], (f"without results, the configurations of {newest}, the newest batch, are compared",)


def _same_result(chosen: ChosenResult, runs: Sequence[RunSource]) -> InvalidRequest:
    """Return the refusal to compare a run or batch with itself; a batch may have configurations to compare."""
    has_sides = len({run.record.config_id for run in runs}) > 1
    apart = f"give {chosen.result_id} once to compare its configurations with each other, or another"
    return InvalidRequest(
        f"{chosen.result_id} is compared with itself",
        valid=["two runs", "two batches", "one batch with several configurations"],
        next_step=f"{apart if has_sides else 'give a second'} run or batch",
        remedies=[with_values(results=[chosen.result_id])] if has_sides else [],
    )


_OTHERS_LOOKED_AT, _OTHERS_PROPOSED = 20, 3
"""How many of the newest runs and batches are searched for another side, and how many are proposed (chosen)."""


def _other_sides(chosen: Sequence[ChosenResult], runs: Sequence[RunSource], context: WorkflowContext) -> list[Remedy]:
    """Return comparable results: the newest results of other configurations on the same scenarios, or a new run."""
    given = [result.result_id for result in chosen]
    configs, scenarios = ({getattr(run.record, key) for run in runs} for key in ("config_id", "scenario_id"))
    fitting = list[str]()
    for artifact in context.newest("run", "batch", count=_OTHERS_LOOKED_AT):
        ids = (artifact.artifact_id,) if artifact.kind == "run" else artifact.read(BatchRecord).runs
        first = [context.workspace.get(key, "run").read(RunRecord) for key in ids[:_OTHERS_LOOKED_AT]]
        is_other = any(one.config_id not in configs and one.scenario_id in scenarios for one in first)
        if is_other and artifact.artifact_id not in given:
            fitting.append(artifact.artifact_id)
    others = [name for name in PLANNERS if all(run.record.planner != name for run in runs)]
    again = calling("run_planner", scenarios=sorted(scenarios)[:_OTHERS_LOOKED_AT], configs=others[:1])
    compared = [with_values(results=[*given, other]) for other in fitting[:_OTHERS_PROPOSED]]
    return [*compared, again] if scenarios and others else compared


_Couples = tuple[tuple[int, int], ...]
"""The pairs of sides to compare, by index, the baseline first; empty compares all with the first."""


def _sides_of(
    chosen: Sequence[ChosenResult], runs: Sequence[RunSource]
) -> tuple[tuple[Side, ...], _Couples, tuple[str, ...]]:
    """Return the sides in the given order, their pairs, and notes on what was left out.

    A batch gives one side per configuration. Single runs with several configurations are grouped by configuration. Two
    runs of one configuration are compared with each other. Of several batches, the first one given is the baseline, and
    each side of another batch is compared with its match in the baseline.

    Raises:
        InvalidRequest: there is only one side, or no side of a batch has a match in another batch.
    """
    by_id = {run.record.run_id: run for run in runs}
    if all(result.kind == "run" for result in chosen) and len({run.record.config_id for run in runs}) > 1:
        groups = [("", list(by_id.values()))]
    else:
        groups = [(result.result_id, [by_id[run_id] for run_id in result.run_ids]) for result in chosen]
    split = [_by_config(result_id, members) for result_id, members in groups]
    sides = _labelled([side for group in split for side in group])
    if len(sides) < 2:
        labels = ", ".join(side.label for side in sides)
        raise InvalidRequest(
            f"{labels or 'no run'} has nothing to be compared with",
            valid=["two runs", "two batches", "one batch with several configurations"],
            next_step="give a second run or batch",
        )
    if len(groups) == 1:
        return tuple(sides), (), ()
    empty = [group[0] for group, found in zip(groups, split, strict=True) if not found]
    if empty:
        raise InvalidRequest(
            f"{', '.join(empty)} has no run to compare",
            valid=["results with at least one finished run each"],
            next_step="leave it out, or run it again with run_planner",
        )
    couples, alone = _matched([len(group) for group in split], sides)
    if not couples:
        configurations = [f"{group[0].result_id}: {', '.join(side.config_name for side in group)}" for group in split]
        raise InvalidRequest(
            f"no configuration of the baseline {groups[0][0]} has a match in the other results",
            valid=configurations,
            next_step="use results with the same configurations or with one each, or a single batch with several",
        )
    notes = [f"{side.label} has no match in the other results and is not compared" for side in alone]
    return tuple(sides), () if couples == _star(len(sides)) else couples, tuple(notes)


def _star(count: int) -> _Couples:
    """Return the pairs that match the first side with every other one."""
    return tuple((0, place) for place in range(1, count))


def _matched(sizes: Sequence[int], sides: Sequence[Side]) -> tuple[_Couples, list[Side]]:
    """Return the pairs of matching sides between the first group and each other group, and the remaining sides.

    Sides match if they have the same configuration and planner version, or else the same configuration, or else if each
    is its group's only remaining side of the planner, or else its group's only remaining side. A baseline with one side
    matches every side of a group without a closer match.
    """
    ends = list(accumulate(sizes))
    groups = [list(range(end - size, end)) for size, end in zip(sizes, ends, strict=True)]
    couples: list[tuple[int, int]] = []
    for group in groups[1:]:
        left, right = list(groups[0]), list(group)
        found: list[tuple[int, int]] = []
        for alike in _LIKENESS:
            kinds = {alike(sides[place]) for place in left} & {alike(sides[place]) for place in right}
            for kind in sorted(kinds):
                first = [place for place in left if alike(sides[place]) == kind]
                second = [place for place in right if alike(sides[place]) == kind]
                if len(first) == len(second) == 1:
                    found.append((first[0], second[0]))
                    left.remove(first[0])
                    right.remove(second[0])
        if not found and len(groups[0]) == 1:
            found = [(groups[0][0], place) for place in right]
        couples += sorted(found, key=lambda couple: couple[1])
    used = {place for couple in couples for place in couple}
    return tuple(couples), [side for place, side in enumerate(sides) if place not in used]


_LIKENESS: tuple[Callable[[Side], str], ...] = (
    lambda side: side.config_id,
    lambda side: configuration_id(side.config_id),
    lambda side: side.config_name.partition(":")[0],
    lambda _: "",
)
"""Criteria for matching sides, the strictest first."""


def _by_config(result_id: str, members: Sequence[RunSource]) -> list[Side]:
    """Return a side for each configuration and planner version, with its name as the label."""
    groups: dict[str, list[RunRecord]] = {}
    for member in members:
        groups.setdefault(member.record.config_id, []).append(member.record)
    return [
        Side(
            label=records[0].config_name,
            config_id=config_id,
            config_name=records[0].config_name,
            run_ids=tuple(record.run_id for record in records),
            result_id=result_id,
            planner_version=records[0].planner_version,
        )
        for config_id, records in groups.items()
    ]


def _labelled(sides: Sequence[Side]) -> list[Side]:
    """Return the sides, with the configuration and result added to equal labels."""
    labelled = []
    for side in sides:
        twins = [one for one in sides if one.config_name == side.config_name and one is not side]
        label = side.config_name
        if any(one.config_id != side.config_id for one in twins):
            label = f"{label} {side.config_id}"
        if any(one.result_id != side.result_id for one in twins):
            label = f"{label} ({side.result_id})"
        labelled.append(side.model_copy(update={"label": label}))
    return labelled
