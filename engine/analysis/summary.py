"""The analysis of a set of runs: rates, metrics, costs, findings; for one run the timeline to its end."""

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.results import (
    AnalyseRequest,
    AnalysisDetail,
    AnalyzeResultsResult,
    CostShare,
    Finding,
    MetricSummary,
    RunRow,
)
from ...schemas.runs import RunRecord
from ..execution import ProgressReporter
from .costs import correlations, cost_shares
from .evidence import Evidence
from .filters import matching
from .findings import find_all
from .outcomes import METRICS, MetricSpec, groups, invalid_items, metric_value, outcome_shares, success_rate
from .timeline import timeline

SHOWN_INVALID = 10
SUMMARY_FINDINGS = 5
SUMMARY_COSTS = 6
MOST_ROWS = 30
MOST_GROUPS = 20
EVIDENCE_RUNS = 8


def analyse(request: AnalyseRequest, report: ProgressReporter) -> AnalyzeResultsResult:
    """Analyse runs; ``detail`` decides which sections are filled.

    Raises:
        NotPossible: no run is left, or a timeline of several runs was asked for.
        UnknownName, InvalidRequest: a condition that cannot be meant.
    """
    evidence = matching(Evidence(request.runs, request.configs, request.scenarios), request.where)
    if not evidence.sources:
        raise NotPossible(f"no run meets {', '.join(request.where) or 'the request'}", next_step="drop a condition")
    detail: AnalysisDetail = request.detail
    if detail == "timeline" and len(evidence.sources) > 1:
        raise NotPossible(
            f"a timeline shows one run, these are {len(evidence.sources)}",
            valid=[record.run_id for record in (*evidence.failures, *evidence.successes)],
            next_step="name one run in results",
        )
    report(0.1, "reading runs")
    related, note = correlations(evidence) if detail in ("summary", "findings") else ((), "")
    findings = find_all(evidence) if detail in ("summary", "findings") else ()
    report(0.7, "findings done")
    invalid = invalid_items(evidence)
    listed = groups(evidence, request.breakdown)
    result = AnalyzeResultsResult(
        results=request.results,
        runs=len(evidence.sources),
        success=success_rate(evidence),
        outcomes=outcome_shares(evidence),
        invalid=invalid[:SHOWN_INVALID],
        invalid_count=len(invalid),
        groups=listed[:MOST_GROUPS],
        metrics=_metrics(evidence) if detail == "summary" else (),
        costs=_costs(evidence, detail),
        correlations=related,
        findings=tuple(_shortened(found) for found in findings[: SUMMARY_FINDINGS if detail == "summary" else None]),
        rows=tuple(_row(record) for record in _rows(evidence, detail)),
        timeline=timeline(evidence, evidence.runs[0]) if detail == "timeline" else (),
        notes=_notes(evidence, request, note, len(listed), len(findings)),
    )
    report(1.0, "analysed")
    return result


def _metrics(evidence: Evidence) -> tuple[MetricSummary, ...]:
    one_configuration = len({record.config_id for record in evidence.valid}) == 1
    specs = [spec for spec in METRICS if one_configuration or not spec.within_one_configuration]
    found = (_metric(spec, evidence) for spec in specs)
    return tuple(summary for summary in found if summary is not None)


def _metric(spec: MetricSpec, evidence: Evidence) -> MetricSummary | None:
    values = [value for record in evidence.valid if (value := metric_value(record, spec.name)) is not None]
    if not values:
        return None
    return MetricSummary(
        name=spec.name,
        unit=spec.unit,
        n=len(values),
        mean=float(np.mean(values)),
        median=float(np.median(values)),
        lowest=min(values),
        highest=max(values),
    )


def _costs(evidence: Evidence, detail: AnalysisDetail) -> tuple[CostShare, ...]:
    if detail == "costs":
        return cost_shares(evidence)
    return cost_shares(evidence)[:SUMMARY_COSTS] if detail == "summary" and len(evidence.sources) == 1 else ()


def _shortened(finding: Finding) -> Finding:
    return finding.model_copy(update={"run_ids": finding.run_ids[:EVIDENCE_RUNS]})


def _rows(evidence: Evidence, detail: AnalysisDetail) -> tuple[RunRecord, ...]:
    """All runs, failures first, where they were asked for; a single run always."""
    if detail != "rows" and len(evidence.sources) > 1:
        return ()
    invalid = tuple(record for record in evidence.runs if record.outcome == "invalid")
    return (*evidence.failures, *evidence.successes, *invalid)[:MOST_ROWS]


def _row(record: RunRecord) -> RunRow:
    return RunRow(
        run_id=record.run_id,
        scenario_id=record.scenario_id,
        config_name=record.config_name,
        outcome=record.outcome,
        duration_s=metric_value(record, "duration_s"),
        minimum_distance_m=metric_value(record, "minimum_distance_m"),
        reason=record.reason,
    )


def _notes(
    evidence: Evidence, request: AnalyseRequest, correlation: str, groups_found: int, found: int
) -> tuple[str, ...]:
    notes = []
    if request.lost:
        first = request.lost[0]
        notes.append(
            f"{len(request.lost)} cells gave no run and are in no figure; the first: {first.scenario_id} with "
            f"{first.config_id}: {first.error}"
        )
    if request.where:
        notes.append(f"{len(evidence.sources)} of {len(request.runs)} runs meet {' and '.join(request.where)}")
    if len(evidence.sources) == 1 and request.detail != "timeline":
        notes.append("one run says nothing about a rate; detail=timeline shows the moments before its end")
    elif correlation and request.detail == "findings":
        notes.append(correlation)
    if request.detail == "summary" and found > SUMMARY_FINDINGS:
        notes.append(f"more findings ({found - SUMMARY_FINDINGS}) with detail=findings")
    if request.detail == "rows" and len(evidence.sources) > MOST_ROWS:
        notes.append(f"{MOST_ROWS} of {len(evidence.sources)} runs shown, failures first; narrow with where")
    if groups_found > MOST_GROUPS:
        notes.append(f"{MOST_GROUPS} of {groups_found} groups shown; narrow with where")
    without = sum(record.run_id not in evidence.steps for record in evidence.valid) if request.detail == "costs" else 0
    if without:
        notes.append(f"{without} runs have no recorded steps and are in no cost figure")
    return tuple(notes)
