"""Trials of what an analysis suggests: the change is run on what failed and on some of what passed.

For each suggestion two sizes of the change are run; the better one is told, with what it bought and what it cost. Runs
are those of ``run_planner``: what was run before is found again, so that the same call goes on where one was left.
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
from ..configurations import resolve_configuration, store_configuration
from ..context import WorkflowContext
from ..runs import Cell, CellResult, own_versions, run_grid

MOST_TRIED = 3
"""Suggestions that one call tries (chosen)."""
_MOST_FAILING, _FEWEST_PASSING, _MOST_PASSING = 40, 8, 20
"""Runs that a trial takes (chosen): a change is run on at most sixty, twice."""
_RAISED, _LOWERED = (2.0, 5.0), (0.5, 0.2)
"""By which a weight is multiplied (chosen)."""
_FROM_NOTHING = (0.2, 1.0)
"""What a weight of 0 is raised to where the planner's default is 0 too (chosen: most weights lie between)."""
_WAIT_S = 45.0
"""The call answers after this time at most; chosen to be less than clients wait."""


@dataclass(frozen=True)
class _Change:
    """A suggestion with one size of its change, the configuration with it, and the runs that it is tried on."""

    suggestion: Suggestion
    words: str
    configuration: PlannerConfiguration
    failing: tuple[RunRecord, ...]
    passing: tuple[RunRecord, ...]

    def cells(self) -> list[Cell]:
        """Return the runs to make."""
        return [
            Cell(run.scenario_id, run.problem_id, self.configuration, run.prediction, run.traffic, run.seed)
            for run in (*self.failing, *self.passing)
        ]


async def with_trials(
    result: AnalyzeResultsResult, runs: Sequence[RunSource], context: WorkflowContext
) -> AnalyzeResultsResult:
    """The analysis with its first suggestions tried; while the runs are under way, with the job that makes them."""
    unpreventable = frozenset(() if result.causes is None else result.causes.not_preventable)
    suggestions = _chosen(result.findings)
    edited = {source.record.planner for source in runs if _was_edited(source.record)}
    if edited:
        return _noted(
            result, f"nothing was tried: {', '.join(sorted(edited))} is another version now than in these runs"
        )
    if not suggestions:
        return _noted(result, "nothing to be tried: no finding suggests a change of a weight")
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
            return _noted(result, f"the trial of {len(suggestions)} suggestions runs: {job.message}", job.job_id)
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


def _was_edited(record: RunRecord) -> bool:
    """Return whether a run's planner version differs from the one that would drive a trial; unknown counts as equal."""
    try:
        return record.planner_source not in ("", source_that_drives(record.planner))
    except (UnknownName, PlannerFailure):  # it is not installed any more: what resolves its configuration says so
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
    """Return the sizes of a suggested change that the weight allows, each with its configuration and runs."""
    base = resolve_configuration(suggestion.config_id, context)
    own = [one for one in records if one.config_id == suggestion.config_id and one.outcome != "invalid"]
    failing = [one for one in own if one.outcome != "goal_reached" and one.run_id not in unpreventable]
    passing = [one for one in own if one.outcome == "goal_reached"]
    failing = _drawn(failing, _MOST_FAILING)
    passing = _drawn(passing, min(max(len(failing), _FEWEST_PASSING), _MOST_PASSING))
    made = []
    for value in _values(suggestion, base):
        words = f"{suggestion.weight}={value:g}"
        try:
            configuration, _ = changed_configuration(base, None, [words])
        except InvalidRequest:  # beyond what the weight may be: the other size is tried
            continue
        recipe = Recipe(
            tool="configure_planner",
            arguments={"base": base.config_id, "preset": None, "weights": [words], "settings": []},
            parents=(base.config_id,),
        )
        store_configuration(context, configuration, recipe)
        made.append(_Change(suggestion, words, configuration, tuple(failing), tuple(passing)))
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
    """At most so many runs, drawn by their ids: always the same ones."""
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
    """Return the job: makes the runs that are missing."""

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
    """Return what became of the runs under the change; one that was lost is in no figure."""
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
    """The chance of as many gains among all flips, were either way as likely; that the better size was taken is told
    by its caller.
    """
    flips = gained + lost
    return float(sum(comb(flips, count) for count in range(gained, flips + 1)) / 2**flips)
