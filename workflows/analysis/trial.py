"""Try the suggestions of an analysis: run each change on failed runs and on a sample of passed runs.

Each suggestion is tried with two sizes of the change, and the better size is reported with its gains and losses. The
runs are those of ``run_planner``. Stored runs are found again, so a repeated call resumes.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

from ...engine.execution import JobProgress, JobWork
from ...engine.planners import source_that_drives
from ...engine.tuning import changed_configuration, preset_configuration
from ...engine.workspace import Recipe, versions_of
from ...schemas.errors import InvalidRequest, PlannerFailure, UnknownName
from ...schemas.planning import PlannerConfiguration
from ...schemas.results import AnalyzeResultsResult, Finding, Suggestion, TriedChange
from ...schemas.runs import RunRecord, RunSource
from ...schemas.text import counted
from ..configurations import resolve_configuration, store_configuration
from ..context import WorkflowContext
from ..runs import Cell, CellResult, own_versions, run_grid

MOST_TRIED = 3
"""How many suggestions one call tries (chosen)."""
_MOST_FAILING, _FEWEST_PASSING, _MOST_PASSING = 40, 8, 20
"""How many runs a trial uses (chosen): a change runs on at most sixty, twice."""
_RAISED, _LOWERED = (2.0, 5.0), (0.5, 0.2)
"""The factors for a weight (chosen)."""
_FROM_NOTHING = (0.2, 1.0)
"""The value to raise a weight of 0 to if the planner's default is 0 too (chosen: most weights are in between)."""
_WAIT_S = 45.0
"""The call answers after this time at most (chosen to be shorter than clients wait)."""


@dataclass(frozen=True)
class _Change:
    """A suggestion with one size of its change, the changed configuration, and the runs to try it on."""

    suggestion: Suggestion
    words: str
    configuration: PlannerConfiguration
    failing: tuple[RunRecord, ...]
    passing: tuple[RunRecord, ...]

    def cells(self) -> list[Cell]:
        """Return the cells to run."""
        return [
            Cell(run.scenario_id, run.problem_id, self.configuration, run.prediction, run.traffic, run.seed, run.world)
            for run in (*self.failing, *self.passing)
        ]


async def with_trials(
    result: AnalyzeResultsResult, runs: Sequence[RunSource], context: WorkflowContext
) -> AnalyzeResultsResult:
    """Return the analysis with its first suggestions tried or, while the trial runs, with its job."""
    unpreventable = frozenset(() if result.causes is None else result.causes.not_preventable)
    suggestions = _chosen(result.findings)
    edited = {source.record.planner for source in runs if _has_other_version(source.record)}
    if edited:
        return _noted(
            result, f"nothing was tried: {', '.join(sorted(edited))} has another version now than in these runs"
        )
    if not suggestions:
        return _noted(result, "nothing to try: no finding suggests a change of a weight")
    changes = [
        change
        for suggestion in suggestions
        for change in _changes(suggestion, [source.record for source in runs], unpreventable, context)
    ]
    cells = [cell for change in changes for cell in change.cells()]
    missing = [cell for cell in cells if context.workspace.find_by_recipe("run", cell.recipe()) is None]
    if missing:
        job = context.start_job("trial", _recipe(changes), _work(missing, len(cells), context))
        context.made("job", job.job_id)
        job = await context.wait_for(job.job_id, _WAIT_S)
        if job.state == "running":
            count = counted(len(suggestions), "suggestion")
            return _noted(result, f"the trial of {count} is running: {job.message}", job.job_id)
        if job.error:
            return _noted(result, f"the trial ended early: {job.error}", job.job_id)
    outcomes = {id(change): _outcome(change, context) for change in changes}
    best = {
        id(suggestion): max(
            (outcomes[id(change)] for change in changes if change.suggestion is suggestion),
            key=lambda tried: tried.gained - tried.lost,
        )
        for suggestion in suggestions
    }
    findings = tuple(
        finding.model_copy(
            update={"suggestion": finding.suggestion.model_copy(update={"tried": best[id(finding.suggestion)]})}
        )
        if finding.suggestion is not None and id(finding.suggestion) in best
        else finding
        for finding in result.findings
    )
    return result.model_copy(update={"findings": findings})


def _has_other_version(record: RunRecord) -> bool:
    """Return whether a run's planner version differs from the installed version; an unknown version counts as equal."""
    try:
        return record.planner_source not in ("", source_that_drives(record.planner))
    except (UnknownName, PlannerFailure):  # no longer installed: resolving its configuration reports this
        return False


def _chosen(findings: Sequence[Finding]) -> list[Suggestion]:
    """Return the first suggestions, each change once."""
    seen: dict[tuple[str, str, str], Suggestion] = {}
    for finding in findings:
        if finding.suggestion is not None:
            change = finding.suggestion
            seen.setdefault((change.config_id, change.weight, change.direction), change)
    return list(seen.values())[:MOST_TRIED]


def _noted(result: AnalyzeResultsResult, note: str, job_id: str = "") -> AnalyzeResultsResult:
    return result.model_copy(update={"notes": (*result.notes, note), "job_id": job_id})


def _changes(
    suggestion: Suggestion, records: Sequence[RunRecord], unpreventable: frozenset[str], context: WorkflowContext
) -> list[_Change]:
    """Return the valid sizes of a suggested change, each with its configuration and runs."""
    base = resolve_configuration(suggestion.config_id, context)
    own = [one for one in records if one.config_id == suggestion.config_id and one.outcome != "invalid"]
    failing = [one for one in own if one.outcome != "goal_reached" and one.run_id not in unpreventable]
    passing = [one for one in own if one.outcome == "goal_reached"]
    failing = _drawn(failing, _MOST_FAILING)
    passing = _drawn(passing, min(max(len(failing), _FEWEST_PASSING), _MOST_PASSING))
    made = []
    for value in _values(suggestion, base):
        assignment = f"{suggestion.weight}={value:g}"
        try:
            configuration, _ = changed_configuration(base, None, [assignment])
        except InvalidRequest:  # beyond the weight's range: the other size is tried
            continue
        recipe = Recipe(
            tool="configure_planner",
            arguments={"base": base.config_id, "preset": None, "weights": [assignment], "settings": []},
            parents=(base.config_id,),
        )
        store_configuration(context, configuration, recipe)
        made.append(_Change(suggestion, assignment, configuration, tuple(failing), tuple(passing)))
    return made


def _values(suggestion: Suggestion, base: PlannerConfiguration) -> tuple[float, ...]:
    value = base.weights.get(suggestion.weight, 0.0)
    default = preset_configuration(base.planner).weights.get(suggestion.weight, 0.0)
    if suggestion.direction == "raise" and value < default / _RAISED[-1]:
        return default, _RAISED[0] * default
    if value == 0:
        return _FROM_NOTHING
    return tuple(factor * value for factor in (_RAISED if suggestion.direction == "raise" else _LOWERED))


def _drawn(records: Sequence[RunRecord], most: int) -> list[RunRecord]:
    """Return at most ``most`` runs, in an order that depends only on their ids."""
    drawn = sorted(records, key=lambda record: hashlib.sha256(record.run_id.encode()).hexdigest())[:most]
    return sorted(drawn, key=lambda record: record.run_id)


def _recipe(changes: Sequence[_Change]) -> Recipe:
    return Recipe(
        tool="analyze_results",
        arguments={
            "trial": [change.configuration.config_id for change in changes],
            "runs": sorted({run.run_id for change in changes for run in (*change.failing, *change.passing)}),
        },
        parents=tuple(dict.fromkeys(change.suggestion.config_id for change in changes)),
        versions=versions_of("frenetix", "commonroad-io", "commonroad-drivability-checker")
        | own_versions(change.configuration.planner for change in changes),
    )


def _work(cells: Sequence[Cell], total: int, context: WorkflowContext) -> JobWork:
    """Return the work of the job that makes the missing runs."""

    async def work(progress: JobProgress) -> None:
        done = total - len(cells)

        def on_done(result: CellResult) -> None:
            nonlocal done
            done += 1
            if result.record is not None:
                progress.add_result(result.record.run_id)
            progress.report(done / total, f"{done} of {total} runs")

        await run_grid(WorkflowContext(context.services), cells, on_done)

    return work


def _outcome(change: _Change, context: WorkflowContext) -> TriedChange:
    """Return the outcome of the runs with the change; lost runs are not counted."""
    after = {}
    for cell, run in zip(change.cells(), (*change.failing, *change.passing), strict=True):
        stored = context.workspace.find_by_recipe("run", cell.recipe())
        if stored is not None:
            after[run.run_id] = stored.read(RunRecord).outcome == "goal_reached"
    gained = sum(after.get(run.run_id, False) for run in change.failing)
    lost = sum(not after.get(run.run_id, True) for run in change.passing)
    sizes = len(_RAISED)
    return TriedChange(
        config_id=change.configuration.config_id,
        change=change.words,
        failing=sum(run.run_id in after for run in change.failing),
        gained=gained,
        passing=sum(run.run_id in after for run in change.passing),
        lost=lost,
        p=min(1.0, sizes * _one_sided(gained, lost)),
    )


def _one_sided(gained: int, lost: int) -> float:
    """Return the chance of this many gains among all flips if the two directions were equally likely.

    The caller reports that the better of two sizes was chosen.
    """
    flips = gained + lost
    return float(sum(comb(flips, count) for count in range(gained, flips + 1)) / 2**flips)
