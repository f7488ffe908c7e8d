"""The analysis of a set of runs: outcome rates, groups, metrics, costs, findings, and a single run's timeline.

Invalid items are listed separately and are not part of any denominator.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, with_values
from ...schemas.measures import LEFT_THE_ROAD, NO_OTHER_NEAR
from ...schemas.results import (
    AnalyseRequest,
    AnalysisDetail,
    AnalyzeResultsResult,
    Breakdown,
    CostShare,
    Finding,
    Group,
    InvalidItem,
    MetricSummary,
    OutcomeShare,
    Rate,
    RunRow,
    UndefinedMetric,
)
from ...schemas.reviews import Encounter, RunReview
from ...schemas.runs import AT_GOAL, CRITICAL_TIME_TO_COLLISION_S, Outcome, RunRecord
from ...schemas.text import counted
from ..commonroad import parse_benchmark_id
from ..execution import ProgressReporter, silent
from .causes import beyond_vehicle, collision_causes, trivial_goals
from .correlations import Note, correlations
from .filters import matching, on_outcome, window_of
from .findings import find_all
from .measures import MOST_MEASURED, measure_spreads, measures_of
from .moments import contact_of, review, timeline
from .run_set import METRICS, MetricSpec, RunSet, cost_shares, most_frequent_first
from .traffic_rules import MOST_RUNS, rule_shares, rule_verdicts

_SHOWN_INVALID, _SUMMARY_FINDINGS, _SUMMARY_COSTS, _MOST_GROUPS, _FINDING_RUNS = 10, 5, 6, 20, 8
"""Entries of each list (chosen): the default answer stays under 4,500 characters; notes say what is left out."""
_FIGURED_GROUPS = 4
"""Number of configurations with their own metrics and causes in one answer, about 2,500 characters each; ``where``
selects others.
"""
_SHOWN_CONTACTS = 10
"""Number of collisions with a described contact in rows (chosen): each reads its scenario, and an answer has 50 s."""
_SHOWN_RUNS = 5
"""Run ids that an outcome lists (chosen): enough to look at some of them."""


def analyse(request: AnalyseRequest, report: ProgressReporter) -> AnalyzeResultsResult:
    """Analyse runs; ``detail`` decides which sections are filled.

    Raises:
        NotPossible: no run is left, or a timeline of several runs was requested.
        UnknownName, InvalidRequest: a condition is not valid.
    """
    conditions, window = window_of(request.where)
    runs = matching(RunSet(request.runs, request.configs, request.scenarios, request.lineage), conditions)
    if not runs.sources:
        raise NotPossible(
            f"no run meets {', '.join(request.where) or 'the request'}",
            next_step="remove a condition",
            remedies=[with_values(where=None)],
        )
    detail: AnalysisDetail = request.detail
    if detail == "measures" and not runs.valid:
        raise NotPossible("no run could be attempted, so there is nothing to measure")
    if window is not None and detail != "timeline":
        raise InvalidRequest(
            "time_s only applies to a timeline",
            next_step="add detail=timeline for one run",
            remedies=[
                with_values(detail="timeline", results=[record.run_id]) for record in (*runs.failures, *runs.successes)
            ][:1],
        )
    if detail == "timeline" and len(runs.sources) > 1:
        raise NotPossible(
            f"a timeline shows one run, but {len(runs.sources)} are selected",
            valid=[record.run_id for record in (*runs.failures, *runs.successes)],
            next_step="give one run in results",
            remedies=[with_values(results=[record.run_id]) for record in (*runs.failures, *runs.successes)][:1],
        )
    if detail == "rows" and request.offset >= len(runs.sources) > 1:
        raise InvalidRequest(
            f"offset {request.offset} is beyond the last of {counted(len(runs.sources), 'run')}",
            valid=[f"0 to {len(runs.sources) - 1}"],
        )
    report(0.1, "reading runs")
    correlated, note = correlations(runs) if detail in ("summary", "findings") else ((), ("", {}))
    findings = find_all(runs) if detail in ("summary", "findings") else ()
    stated = _summary_findings(findings) if detail == "summary" else findings
    report(0.7, "findings done")
    invalid = [record for record in runs.records if record.outcome == "invalid"]
    is_one = request.breakdown == "pooled" or runs.is_of_one_configuration
    chosen_by = on_outcome(conditions)
    rated = is_one and not chosen_by
    grouped = _groups(runs, request.breakdown, is_one=is_one, summed=detail == "summary")
    if chosen_by:
        grouped = tuple(map(_unrated, grouped))
    looked_at = review(runs, runs.records[0]) if len(runs.sources) == 1 else None
    moment = _most_critical(looked_at) if looked_at is not None and runs.successes else None
    single = len(runs.sources) == 1
    summed = detail == "summary" and not single
    shares = rule_shares(runs) if detail == "rules" and not single else ()
    notes = list(_notes(runs, request, note, len(grouped)))
    hidden = len(findings) - len(stated) if detail == "summary" else 0
    result = AnalyzeResultsResult(
        results=request.results,
        runs=len(runs.sources),
        detail=detail,
        valid_count=len(runs.valid),
        success=runs.rate(runs.valid) if rated else None,
        chosen_by_outcome=chosen_by,
        by_any_motion=_by_any_motion(runs) if rated else None,
        outcomes=_outcome_shares(runs, rated=rated) if is_one else (),
        invalid=tuple(
            InvalidItem(run_id=record.run_id, scenario_id=record.scenario_id, reason=record.reason)
            for record in invalid[:_SHOWN_INVALID]
        ),
        invalid_count=len(invalid),
        groups=grouped[:_MOST_GROUPS],
        metrics=_metric_summaries(runs) if detail == "summary" and is_one else (),
        undefined=_undefined(runs) if detail == "summary" else (),
        costs=_costs(runs, detail),
        correlations=correlated,
        findings=tuple(
            one.model_copy(
                update={
                    "run_ids": one.run_ids[:_FINDING_RUNS],
                    "run_count": len(one.run_ids),
                    "moments": one.moments[:_FINDING_RUNS],
                }
            )
            for one in stated
        ),
        rows=_rows(runs, _page(runs, request)) if detail == "rows" or single else (),
        next_offset=_next_offset(request, len(runs.sources)) if detail == "rows" else None,
        timeline=timeline(runs, runs.records[0], moment, window) if detail == "timeline" else (),
        timeline_of="window" if window is not None else "end" if moment is None else "moment",
        review=looked_at,
        measures=measures_of(runs, runs.records[0]) if detail == "measures" and single else (),
        spreads=measure_spreads(runs, silent) if detail == "measures" and not single else (),
        causes=collision_causes(runs, with_rate=rated) if summed else None,
        trivial=trivial_goals(runs, with_rate=rated) if summed else None,
        beyond_vehicle=beyond_vehicle(runs) if summed else None,
        rules=rule_verdicts(runs, runs.records[0]) if single and detail in ("summary", "rules") else (),
        rule_shares=tuple(one.model_copy(update={"run_ids": one.run_ids[:_FINDING_RUNS]}) for one in shares),
        notes=tuple(words for words, _ in notes),
        note_figures={name: value for _, figures in notes for name, value in figures.items()}
        | ({"hidden_findings": hidden} if hidden else {}),
    )
    report(1.0, "analysed")
    return result


def _summary_findings(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Return each configuration's main failure and four other findings, or five findings if there is no failure."""
    main = tuple(one for one in findings if one.name == "main_failure")
    others = tuple(one for one in findings if one.name != "main_failure")
    return (*main, *others[: _SUMMARY_FINDINGS - bool(main)])


def _most_critical(looked_at: RunReview) -> Encounter | None:
    """Return the shortest time to collision if it is critical, else the smallest gap."""
    urgent = looked_at.most_urgent
    time_s = None if urgent is None else urgent.time_to_collision_s
    return urgent if time_s is not None and time_s < CRITICAL_TIME_TO_COLLISION_S else looked_at.closest


def _costs(runs: RunSet, detail: AnalysisDetail) -> tuple[CostShare, ...]:
    if detail == "costs":
        return cost_shares(runs)
    return cost_shares(runs)[:_SUMMARY_COSTS] if detail == "summary" and len(runs.sources) == 1 else ()


_OFF_ROAD_RISK = 1
"""The risk rank of a run that left the road: below collisions, equal to extreme ones (chosen)."""


def _ease(record: RunRecord) -> tuple[float, ...]:
    """Return a run's sort key: risk, time and distance to a collision, duration; the most harmful run comes first."""
    found = record.metrics
    if found is None:
        return (math.inf,)
    risk = _OFF_ROAD_RISK if record.outcome == "off_road" else found.risk_score
    worst = (risk, found.minimum_time_to_collision_s, found.minimum_distance_m, found.duration_s)
    return tuple(math.inf if value is None else float(value) for value in worst)


def _page(runs: RunSet, request: AnalyseRequest) -> list[RunRecord]:
    """Return the requested page of runs: failures, successes, then invalid runs; most harmful first in each."""
    invalid = [record for record in runs.records if record.outcome == "invalid"]
    ordered = [*sorted(runs.failures, key=_ease), *sorted(runs.successes, key=_ease), *invalid]
    return ordered if len(ordered) == 1 else ordered[request.offset : request.offset + request.limit]


def _next_offset(request: AnalyseRequest, count: int) -> int | None:
    """Return where the next page begins, or None on the last page."""
    following = request.offset + request.limit
    return following if following < count else None


def _rows(runs: RunSet, records: Sequence[RunRecord]) -> tuple[RunRow, ...]:
    hits = [record for record in records if record.collision is not None][:_SHOWN_CONTACTS]
    contacts = {record.run_id: contact_of(runs, record) for record in hits}
    return tuple(
        RunRow(
            run_id=record.run_id,
            scenario_id=record.scenario_id,
            config_name=record.config_name,
            outcome=record.outcome,
            duration_s=record.metrics.duration_s if record.metrics else None,
            minimum_distance_m=record.metrics.minimum_distance_m if record.metrics else None,
            reason=record.reason,
            contact=contacts.get(record.run_id),
            beyond_vehicle=record.beyond_vehicle or (),
            triggers=record.triggers,
        )
        for record in records
    )


def _notes(runs: RunSet, request: AnalyseRequest, correlation: Note, group_count: int) -> Iterator[Note]:
    """Yield each note with its figures by name."""
    if request.lost:
        first = request.lost[0]
        cells = f"{counted(len(request.lost), 'cell')} without a run, counted in no figure"
        words = f"{cells}; the first: {first.scenario_id} with "
        yield words + f"{first.config_id}: {first.error}", {"lost_cells": len(request.lost)}
    if request.where:
        words = f"{' and '.join(request.where)} applies to {len(runs.sources)} of {len(request.runs)} runs"
        yield words, {"asked_runs": len(request.runs)}
    older = sum(record.success_rule == "driven@1" for record in runs.valid) if request.detail == "summary" else 0
    if older and len(runs.sources) > 1:
        yield f"{older} of {len(runs.valid)} valid runs are judged by {_OLD_RULE}", {"older_rule_runs": older}
    if correlation[0] and request.detail == "findings" and len(runs.sources) > 1:
        yield correlation
    shown = len(_page(runs, request)) if request.detail == "rows" else 0
    if shown and shown < len(runs.sources):
        page = {"first_row": request.offset + 1, "last_row": request.offset + shown}
        yield f"runs {page['first_row']} to {page['last_row']} of {len(runs.sources)}, failures first", page
    if request.detail == "rules" and len(runs.valid) > MOST_RUNS:
        words = f"traffic rules are checked for a random {MOST_RUNS} of {len(runs.valid)} valid runs; narrow with where"
        yield words, {"judged_runs": MOST_RUNS}
    if request.detail == "measures" and len(runs.valid) > MOST_MEASURED:
        words = f"a random {MOST_MEASURED} of {len(runs.valid)} valid runs are measured; narrow with where"
        yield words, {"measured_runs": MOST_MEASURED}
    if group_count > _MOST_GROUPS:
        yield f"{_MOST_GROUPS} of {group_count} groups shown; narrow with where", {"groups": group_count}
    gone = sorted({config.planner for config in runs.configs if config.default_weights is None})
    if gone and request.detail in ("summary", "findings"):
        yield f"not installed here: {', '.join(gone)}; weights are not compared with its defaults", {}
    without = sum(record.run_id not in runs.steps for record in runs.valid) if request.detail == "costs" else 0
    if without:
        yield f"{without} runs have no recorded steps and count in no cost figure", {"stepless_runs": without}


def _by_any_motion(runs: RunSet) -> Rate | None:
    """Return the rate of goals according to the paper's rule, or None if no motion to the goal was refused."""
    refused = any(record.outcome == "goal_refused" for record in runs.valid)
    return runs.rate(runs.valid, lambda record: record.outcome in AT_GOAL) if refused else None


def _unrated(group: Group) -> Group:
    """Return a group without rates of goals, because its runs were selected by outcome."""
    rate = group.success.model_copy(update={"share": None, "low": None, "high": None})
    causes, trivial = (
        None if figures is None else figures.model_copy(update={"success_without": None})
        for figures in (group.causes, group.trivial)
    )
    return group.model_copy(update={"success": rate, "causes": causes, "trivial": trivial})


def _outcome_shares(runs: RunSet, *, rated: bool) -> tuple[OutcomeShare, ...]:
    """Return every outcome that occurred among the valid runs, most frequent first."""
    return tuple(
        OutcomeShare(
            outcome=outcome,
            count=count,
            rate=runs.rate(runs.valid, _ended_as(outcome)) if rated else None,
            run_ids=tuple(record.run_id for record in runs.valid if record.outcome == outcome)[:_SHOWN_RUNS],
        )
        for outcome, count in most_frequent_first(Counter(record.outcome for record in runs.valid))
    )


def _ended_as(outcome: Outcome) -> Callable[[RunRecord], bool]:
    return lambda record: record.outcome == outcome


def _metric_summaries(runs: RunSet) -> tuple[MetricSummary, ...]:
    """Return the mean, median and range of every metric over the valid runs in which it is defined."""
    one_configuration = len({record.config_id for record in runs.valid}) == 1
    summaries = []
    for spec in METRICS:
        values = [value for record in runs.valid if (value := spec.value(record)) is not None]
        if values and (one_configuration or not spec.within_one_configuration):
            summaries.append(
                MetricSummary(
                    name=spec.name,
                    unit=spec.unit,
                    n=len(values),
                    mean=float(np.mean(values)),
                    median=float(np.median(values)),
                    lowest=min(values),
                    highest=max(values),
                )
            )
    return tuple(summaries)


def _undefined(runs: RunSet) -> tuple[UndefinedMetric, ...]:
    """Return the metrics that no valid run has; empty if there are no valid runs."""
    absent = [spec for spec in METRICS if runs.valid and all(spec.value(record) is None for record in runs.valid)]
    return tuple(UndefinedMetric(name=spec.name, why=_why_undefined(spec, runs.valid)) for spec in absent)


def _why_undefined(spec: MetricSpec, records: Sequence[RunRecord]) -> str:
    """Return why no run has a metric; an ego that left the road has no risk score, even near others."""
    off_road = {record.outcome == "off_road" for record in records}
    if spec.name != "risk_score" or len(off_road) > 1:
        return spec.why_none
    return LEFT_THE_ROAD if off_road == {True} else NO_OTHER_NEAR


def _groups(runs: RunSet, breakdown: Breakdown, *, is_one: bool, summed: bool) -> tuple[Group, ...]:
    """Return outcome rates by group; a scenario with several obstacle classes is in the group of each class.

    Without a requested breakdown, several configurations are separate groups; in a breakdown by scenarios they are
    separate within each group.
    """
    if breakdown == "pooled" or (breakdown == "none" and is_one):
        return ()
    factor = "config" if breakdown == "none" else breakdown
    apart = not is_one and factor in _OF_SCENARIOS
    members: dict[str, list[RunRecord]] = {}
    for record in runs.records:
        for name in _GROUPERS[factor](runs, record):
            members.setdefault(f"{name}, {record.config_name}" if apart else name, []).append(record)
    order = [name for name in _BIN_NAMES if name in members] if breakdown == "obstacle_count" else sorted(members)
    order += [name for name in sorted(members) if name not in order]
    groups = tuple(_group(runs, name, members[name]) for name in order)
    if factor != "config" or is_one:
        return groups
    by_configuration = runs.by_configuration
    return tuple(
        _with_own_figures(
            one, by_configuration[members[one.name][0].config_id], summed=summed and place < _FIGURED_GROUPS
        )
        for place, one in enumerate(groups)
    )


def _group(runs: RunSet, name: str, records: list[RunRecord]) -> Group:
    valid = [record for record in records if record.outcome != "invalid"]
    counts = Counter(record.outcome for record in valid)
    return Group(
        name=name,
        success=runs.rate(valid),
        outcomes=dict(most_frequent_first(counts)),
        invalid=len(records) - len(valid),
        valid_count=len(valid),
    )


def _with_own_figures(group: Group, own: RunSet, *, summed: bool) -> Group:
    """Return the group of a configuration with the configuration's own figures, which are not pooled."""
    failed = {
        outcome: tuple(record.run_id for record in own.failures if record.outcome == outcome)[:_SHOWN_RUNS]
        for outcome in group.outcomes
        if outcome != "goal_reached"
    }
    if not summed:
        return group.model_copy(update={"failed_runs": failed})
    figures = {
        "failed_runs": failed,
        "metrics": _metric_summaries(own),
        "causes": collision_causes(own),
        "trivial": trivial_goals(own),
        "beyond_vehicle": beyond_vehicle(own),
    }
    return group.model_copy(update=figures)


_OLD_RULE = "driven@1, an older rule that counts a goal after any motion"
_BINS = ((0, 0), (1, 4), (5, 9), (10, 19), (20, 49), (50, 10**6))
"""First and last number of obstacles of each group (chosen: about doubling from one to the next)."""


def _bin_name(count: int) -> str:
    low, high = next((low, high) for low, high in _BINS if low <= count <= high)
    return f"{low} obstacles" if low == high else f"{low}+ obstacles" if high == 10**6 else f"{low}–{high} obstacles"


_BIN_NAMES = tuple(_bin_name(low) for low, _ in _BINS)


def _count_group(runs: RunSet, record: RunRecord) -> list[str]:
    count = runs.obstacle_count(record)
    return ["unknown"] if count is None else [_bin_name(count)]


def _class_groups(runs: RunSet, record: RunRecord) -> list[str]:
    by_type = runs.obstacles.get(record.scenario_id)
    return ["unknown"] if by_type is None else [f"with {kind}" for kind in by_type] or ["no obstacles"]


_OF_SCENARIOS = ("country", "scenario", "obstacle_count", "obstacle_class")
"""Breakdowns that do not distinguish configurations."""
_GROUPERS: dict[str, Callable[[RunSet, RunRecord], list[str]]] = {
    "planner": lambda _, record: [record.planner],
    "config": lambda _, record: [f"{record.config_name} ({record.config_id})"],
    "prediction": lambda _, record: [record.prediction],
    "country": lambda _, record: [parse_benchmark_id(record.scenario_id)[0]],
    "scenario": lambda _, record: [record.scenario_id],
    "obstacle_count": _count_group,
    "obstacle_class": _class_groups,
}
