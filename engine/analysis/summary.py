"""The analysis of a set of runs: rates, metrics, costs, findings; for one run the timeline to its end."""

from ...schemas.errors import NotPossible
from ...schemas.results import AnalyseRequest, AnalysisDetail, AnalyzeResultsResult, CostShare, Finding, RunRow
from ...schemas.runs import RunRecord
from ..execution import ProgressReporter
from .costs import cost_shares
from .filters import matching
from .findings import find_all
from .outcomes import correlations, groups, invalid_items, metric_summaries, outcome_shares, success_rate
from .run_set import RunSet
from .timeline import timeline

SHOWN_INVALID, SUMMARY_FINDINGS, SUMMARY_COSTS, MOST_ROWS, MOST_GROUPS, FINDING_RUNS = 10, 5, 6, 30, 20, 8
"""Entries of each list (chosen): the default answer stays under 4,500 characters; notes say what is left out."""


def analyse(request: AnalyseRequest, report: ProgressReporter) -> AnalyzeResultsResult:
    """Analyse runs; ``detail`` decides which sections are filled.

    Raises:
        NotPossible: no run is left, or a timeline of several runs was asked for.
        UnknownName, InvalidRequest: a condition that cannot be meant.
    """
    runs = matching(RunSet(request.runs, request.configs, request.scenarios), request.where)
    if not runs.sources:
        raise NotPossible(f"no run meets {', '.join(request.where) or 'the request'}", next_step="drop a condition")
    detail: AnalysisDetail = request.detail
    if detail == "timeline" and len(runs.sources) > 1:
        raise NotPossible(
            f"a timeline shows one run, these are {len(runs.sources)}",
            valid=[record.run_id for record in (*runs.failures, *runs.successes)],
            next_step="name one run in results",
        )
    report(0.1, "reading runs")
    correlated, note = correlations(runs) if detail in ("summary", "findings") else ((), "")
    findings = find_all(runs) if detail in ("summary", "findings") else ()
    report(0.7, "findings done")
    invalid = invalid_items(runs)
    grouped = groups(runs, request.breakdown)
    result = AnalyzeResultsResult(
        results=request.results,
        runs=len(runs.sources),
        success=success_rate(runs),
        outcomes=outcome_shares(runs),
        invalid=invalid[:SHOWN_INVALID],
        invalid_count=len(invalid),
        groups=grouped[:MOST_GROUPS],
        metrics=metric_summaries(runs) if detail == "summary" else (),
        costs=_costs(runs, detail),
        correlations=correlated,
        findings=tuple(_shortened(one) for one in findings[: SUMMARY_FINDINGS if detail == "summary" else None]),
        rows=tuple(_row(record) for record in _rows(runs, detail)),
        timeline=timeline(runs, runs.records[0]) if detail == "timeline" else (),
        notes=_notes(runs, request, note, len(grouped), len(findings)),
    )
    report(1.0, "analysed")
    return result


def _costs(runs: RunSet, detail: AnalysisDetail) -> tuple[CostShare, ...]:
    if detail == "costs":
        return cost_shares(runs)
    return cost_shares(runs)[:SUMMARY_COSTS] if detail == "summary" and len(runs.sources) == 1 else ()


def _shortened(finding: Finding) -> Finding:
    return finding.model_copy(update={"run_ids": finding.run_ids[:FINDING_RUNS]})


def _rows(runs: RunSet, detail: AnalysisDetail) -> tuple[RunRecord, ...]:
    """All runs, failures first, where they were asked for; a single run always."""
    if detail != "rows" and len(runs.sources) > 1:
        return ()
    invalid = tuple(record for record in runs.records if record.outcome == "invalid")
    return (*runs.failures, *runs.successes, *invalid)[:MOST_ROWS]


def _row(record: RunRecord) -> RunRow:
    metrics = record.metrics
    return RunRow(
        run_id=record.run_id,
        scenario_id=record.scenario_id,
        config_name=record.config_name,
        outcome=record.outcome,
        duration_s=metrics.duration_s if metrics else None,
        minimum_distance_m=metrics.minimum_distance_m if metrics else None,
        reason=record.reason,
    )


def _notes(
    runs: RunSet, request: AnalyseRequest, correlation: str, group_count: int, finding_count: int
) -> tuple[str, ...]:
    notes = []
    if request.lost:
        first = request.lost[0]
        notes.append(
            f"{len(request.lost)} cells gave no run and are in no figure; the first: {first.scenario_id} with "
            f"{first.config_id}: {first.error}"
        )
    if request.where:
        notes.append(f"{len(runs.sources)} of {len(request.runs)} runs meet {' and '.join(request.where)}")
    if len(runs.sources) == 1 and request.detail != "timeline":
        notes.append("one run says nothing about a rate; detail=timeline shows the moments before its end")
    elif correlation and request.detail == "findings":
        notes.append(correlation)
    if request.detail == "summary" and finding_count > SUMMARY_FINDINGS:
        notes.append(f"more findings ({finding_count - SUMMARY_FINDINGS}) with detail=findings")
    if request.detail == "rows" and len(runs.sources) > MOST_ROWS:
        notes.append(f"{MOST_ROWS} of {len(runs.sources)} runs shown, failures first; narrow with where")
    if group_count > MOST_GROUPS:
        notes.append(f"{MOST_GROUPS} of {group_count} groups shown; narrow with where")
    without = sum(record.run_id not in runs.steps for record in runs.valid) if request.detail == "costs" else 0
    if without:
        notes.append(f"{without} runs have no recorded steps and are in no cost figure")
    return tuple(notes)
