"""A against B, paired per scenario, problem, prediction, traffic and seed."""

from collections.abc import Sequence
from statistics import median
from typing import Literal

from plannerforge.engine.analysis.intervals import paired_difference
from plannerforge.engine.analysis.metrics import METRICS, MetricSpec, metric_value
from plannerforge.engine.analysis.paired_tests import FEWEST_PAIRS, holm, mcnemar_exact, signed_rank
from plannerforge.engine.analysis.pairing import pair
from plannerforge.engine.analysis.verdict import verdict
from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.schemas.comparison import (
    CompareRequest,
    CompareResultsResult,
    Comparison,
    Flip,
    MetricTest,
    Side,
    SuccessTest,
    WeightChange,
)
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.results import ConfigWeights
from plannerforge.schemas.runs import RunRecord

Pairs = Sequence[tuple[RunRecord, RunRecord]]


def compare(request: CompareRequest, report: ProgressReporter) -> CompareResultsResult:
    """Compare every side with the first one.

    Raises:
        NotPossible: fewer than two sides, or not one pair in common.
        InvalidRequest: a side holds the same problem twice.
    """
    if len(request.sides) < 2:
        raise NotPossible(
            f"'{request.sides[0].label if request.sides else 'nothing'}' has nothing to be compared with",
            next_step="name two runs or batches, or one batch with several configurations",
        )
    records = {source.record.run_id: source.record for source in request.runs}
    baseline, *others = request.sides
    comparisons = []
    for number, other in enumerate(others):
        comparisons.append(_compare(baseline, other, records, request))
        report((number + 1) / len(others), f"{other.label} against {baseline.label}")
    return CompareResultsResult(sides=request.sides, comparisons=tuple(comparisons), notes=_notes(request))


def _compare(before: Side, after: Side, records: dict[str, RunRecord], request: CompareRequest) -> Comparison:
    pairing = pair(before, after, records)
    if not pairing.pairs and not pairing.invalid:
        raise NotPossible(
            f"{before.label} and {after.label} have no scenario and planning problem in common",
            valid=[_conditions(side, records) for side in (before, after)],
            next_step="run both configurations on the same scenarios in one run_planner call, or analyze_results them",
        )
    weights = weight_changes(before.config_id, after.config_id, request.configs)
    specs = [spec for spec in METRICS if _wanted(spec, request, weights_differ=before.config_id != after.config_id)]
    success, metrics = _with_holm(_success(pairing.pairs), [_metric(spec, pairing.pairs) for spec in specs])
    to_success = [pair for pair in pairing.pairs if _mastered(pair) == (False, True)]
    to_failure = [pair for pair in pairing.pairs if _mastered(pair) == (True, False)]
    return Comparison(
        before=before.label,
        after=after.label,
        success=success,
        metrics=tuple(metrics),
        to_success=tuple(_flip(pair) for pair in to_success[: request.limit]),
        to_success_count=len(to_success),
        to_failure=tuple(_flip(pair) for pair in to_failure[: request.limit]),
        to_failure_count=len(to_failure),
        weights=weights,
        conditions=pairing.differing,
        unpaired=pairing.unpaired,
        invalid_pairs=pairing.invalid,
        verdict=verdict(success, metrics),
    )


def _notes(request: CompareRequest) -> tuple[str, ...]:
    notes = []
    if "mean_total_cost" in request.metrics and len({side.config_id for side in request.sides}) > 1:
        notes.append("mean_total_cost depends on the weights: across configurations it compares different measures")
    if len(request.sides) > 2:
        notes.append("p values are adjusted within each comparison, not over all of them")
    return tuple(notes)


def weight_changes(before: str, after: str, configs: Sequence[ConfigWeights]) -> tuple[WeightChange, ...]:
    """Weights and settings that differ between two configurations, by name; empty where one of them is unknown.

    A setting that has its default value is None, as is a weight that the planner does not have.
    """
    known = {config.config_id: config.weights | config.settings for config in configs}
    if before not in known or after not in known:
        return ()
    first, second = known[before], known[after]
    return tuple(
        WeightChange(weight=name, before=first.get(name), after=second.get(name))
        for name in sorted({*first, *second})
        if first.get(name) != second.get(name)
    )


def _success(pairs: Pairs) -> SuccessTest:
    mastered = [_mastered(pair) for pair in pairs]
    only_before, only_after = mastered.count((True, False)), mastered.count((False, True))
    difference: tuple[float | None, float | None, float | None] = (None, None, None)
    if pairs:
        difference = paired_difference(only_after, only_before, len(pairs))
    return SuccessTest(
        pairs=len(pairs),
        both=mastered.count((True, True)),
        only_before=only_before,
        only_after=only_after,
        neither=mastered.count((False, False)),
        difference=difference[0],
        low=difference[1],
        high=difference[2],
        p=mcnemar_exact(only_before, only_after) if pairs else None,
        p_holm=None,
    )


def _metric(spec: MetricSpec, pairs: Pairs) -> MetricTest:
    kept = [pair for pair in pairs if spec.basis == "valid" or _mastered(pair) == (True, True)]
    values = [(metric_value(first, spec.name), metric_value(second, spec.name)) for first, second in kept]
    defined = [(first, second) for first, second in values if first is not None and second is not None]
    test = signed_rank([second - first for first, second in defined]) if defined else None
    # A one-sided look at a shift that the interval does not separate from 0 would be a guess.
    separated = test is not None and test.low is not None and test.high is not None and (test.low > 0 or test.high < 0)
    better: Literal["before", "after"] | None = None
    if separated and test is not None and spec.better is not None:
        better = "after" if (test.shift > 0) == (spec.better == "higher") else "before"
    return MetricTest(
        name=spec.name,
        unit=spec.unit,
        pairs=len(defined),
        basis=spec.basis,
        median_before=median(first for first, _ in defined) if defined else None,
        median_after=median(second for _, second in defined) if defined else None,
        shift=test.shift if test else None,
        low=test.low if test else None,
        high=test.high if test else None,
        effect=test.effect if test else None,
        p=test.p if test and test.pairs >= FEWEST_PAIRS else None,
        p_holm=None,
        better=better,
    )


def _with_holm(success: SuccessTest, metrics: list[MetricTest]) -> tuple[SuccessTest, list[MetricTest]]:
    """Holm's adjustment over all tests of one comparison."""
    tests: list[SuccessTest | MetricTest] = [success, *metrics]
    tested = [test for test in tests if test.p is not None]
    adjusted = iter(holm([test.p for test in tested if test.p is not None]))
    done = [test.model_copy(update={"p_holm": next(adjusted)}) if test.p is not None else test for test in tests]
    return done[0], done[1:]  # type: ignore[return-value]


def _wanted(spec: MetricSpec, request: CompareRequest, *, weights_differ: bool) -> bool:
    if request.metrics:
        return spec.name in request.metrics
    return not (spec.within_one_configuration and weights_differ)


def _mastered(pair: tuple[RunRecord, RunRecord]) -> tuple[bool, bool]:
    return pair[0].outcome == "goal_reached", pair[1].outcome == "goal_reached"


def _flip(pair: tuple[RunRecord, RunRecord]) -> Flip:
    before, after = pair
    return Flip(
        scenario_id=before.scenario_id,
        before=before.outcome,
        after=after.outcome,
        before_run=before.run_id,
        after_run=after.run_id,
    )


def _conditions(side: Side, records: dict[str, RunRecord]) -> str:
    chosen = [records[run_id] for run_id in side.run_ids]
    scenarios = sorted({record.scenario_id for record in chosen})
    words = sorted({f"{record.prediction}/{record.traffic}/seed {record.seed}" for record in chosen})
    return f"{side.label}: {len(scenarios)} scenarios ({', '.join(scenarios[:2])}…), {', '.join(words)}"
