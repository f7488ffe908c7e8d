"""One set of runs against another: the sides, which of them are compared, and the paired tests."""

from collections.abc import Callable, Sequence
from itertools import accumulate

from ...schemas.analysis.comparison import CompareRequest, CompareResultsArguments, CompareResultsResult, Side
from ...schemas.errors import InvalidRequest
from ...schemas.runs import BatchRecord, RunRecord, RunSource, configuration_id
from ..context import WorkflowContext
from ..operations import COMPARE
from ..results import ChosenResult, chosen_runs, config_weights, lineages, scenario_sources


async def compare_results(arguments: CompareResultsArguments, context: WorkflowContext) -> CompareResultsResult:
    """Return paired tests of every side against the first, or of matching sides of several batches."""
    words, notes = _words_of(arguments, context)
    chosen, runs = chosen_runs(words, context)
    sides, couples, more = _sides_of(chosen, runs)
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
    asked = arguments.limit if "limit" in arguments.model_fields_set else None
    return result.model_copy(update={"notes": (*notes, *more, *result.notes), "flips_asked": asked})


def _words_of(arguments: CompareResultsArguments, context: WorkflowContext) -> tuple[list[str], tuple[str, ...]]:
    """Return what is compared; by default the configurations of the newest batch, or without one the two newest runs.

    Raises:
        InvalidRequest: the newest batch has one configuration, and the call does not name an older baseline.
    """
    if arguments.results:
        return arguments.results, ()
    batches = context.newest("batch", count=2)
    if not batches:
        told = "there is no batch: the two newest runs are compared, the older one as the baseline"
        return ["previous_run", "latest_run"], (told,)
    newest = batches[0].artifact_id
    if len(batches) == 1:
        return [newest], ("there is one batch only: its configurations are compared",)
    if len(batches[0].read(BatchRecord).configs) == 1:
        older = batches[1].artifact_id
        raise InvalidRequest(
            f"{newest} has one configuration, and which older batch is the baseline was not said",
            valid=[f"results ['{older}', '{newest}']"],
            next_step="name both, the baseline first",
        )
    return [newest], (f"results were left out: the configurations of {newest}, the newest batch, are compared",)


_Couples = tuple[tuple[int, int], ...]
"""Which sides are compared, as places among the sides, the baseline of each first; empty: all with the first."""


def _sides_of(
    chosen: Sequence[ChosenResult], runs: Sequence[RunSource]
) -> tuple[tuple[Side, ...], _Couples, tuple[str, ...]]:
    """Return the sides in the given order, which of them are compared with which, and what was left out.

    A batch gives one side a configuration; single runs with several configurations are put together by configuration;
    two runs of one configuration stand against each other. Of several batches the first that was named is the baseline,
    and each side of another batch is compared with its match in it.

    Raises:
        InvalidRequest: there is only one side, or no side of a batch matches one in another batch.
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
            f"only one side: {labels}",
            valid=["two runs or batches", "one batch with several configurations"],
            next_step="run another configuration on the same scenarios with run_planner",
        )
    if len(groups) == 1:
        return tuple(sides), (), ()
    empty = [group[0] for group, found in zip(groups, split, strict=True) if not found]
    if empty:
        raise InvalidRequest(
            f"{', '.join(empty)} holds no run that can be compared",
            valid=["results with at least one finished run each"],
            next_step="leave it out, or run it again with run_planner",
        )
    couples, alone = _matched([len(group) for group in split], sides)
    if not couples:
        named = [f"{group[0].result_id}: {', '.join(side.config_name for side in group)}" for group in split]
        raise InvalidRequest(
            f"no configuration of {groups[0][0]}, the baseline, has a like in the other results",
            valid=named,
            next_step="name results with the same configurations or with one each, or a single batch with several",
        )
    notes = [f"{side.label} has no like in the other results and is in no comparison" for side in alone]
    return tuple(sides), () if couples == _star(len(sides)) else couples, tuple(notes)


def _star(count: int) -> _Couples:
    """Return every side against the first."""
    return tuple((0, place) for place in range(1, count))


def _matched(sizes: Sequence[int], sides: Sequence[Side]) -> tuple[_Couples, list[Side]]:
    """Return the couples of matching sides of the first group and each other, and the sides left over.

    Sides match if they have the same configuration under the same planner version; otherwise the same configuration;
    otherwise if they are the only ones left of a planner in both groups; otherwise if they are the only ones
    left at all. A baseline with one side matches every side of a group without a closer match.
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
"""What makes two sides alike, the strictest first."""


def _by_config(result_id: str, members: Sequence[RunSource]) -> list[Side]:
    """Return a side for each configuration and planner version; its label is its name."""
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
    """Return the sides; equal names are told apart by the configuration and the result that they belong to."""
    told = []
    for side in sides:
        twins = [one for one in sides if one.config_name == side.config_name and one is not side]
        words = side.config_name
        if any(one.config_id != side.config_id for one in twins):
            words = f"{words} {side.config_id}"
        if any(one.result_id != side.result_id for one in twins):
            words = f"{words} ({side.result_id})"
        told.append(side.model_copy(update={"label": words}))
    return told
