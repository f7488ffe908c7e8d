"""Paired comparison of planner runs: arguments, results and the tests they are made of; then the answer's text."""

from typing import Annotated, Literal

from pydantic import Field, WithJsonSchema

from .base import Answer, Arguments, Model, Result
from .results import ConfigWeights, MetricName, RunSource, figure
from .runs import Outcome

UnlistedMetric = Annotated[MetricName, WithJsonSchema({"type": "string"})]
"""A metric whose name the schema leaves out, to stay small; a refusal lists them all."""


class CompareResultsArguments(Arguments):
    """A against B, paired per scenario: tests, intervals, effect sizes, flips each way, which weights changed."""

    results: list[str] = Field(
        ["previous_batch", "latest_batch"],
        min_length=1,
        max_length=50,
        description="two or more run or batch ids, the baseline first, or one batch with several configurations",
    )
    metrics: list[UnlistedMetric] = Field([], description="risk_score, duration_s …; default: all that can be compared")
    limit: int = Field(10, ge=1, le=100, description="flipped scenarios shown per direction")


class Side(Model):
    """One of the compared sets: a run, or the runs of one configuration in a batch."""

    label: str
    config_id: str
    config_name: str
    run_ids: tuple[str, ...]


class CompareRequest(Model):
    """What the comparison operation needs: the sides in order, the baseline first."""

    sides: tuple[Side, ...]
    runs: tuple[RunSource, ...]
    configs: tuple[ConfigWeights, ...] = ()
    metrics: tuple[MetricName, ...] = ()
    limit: int = 10


class Flip(Model):
    """A scenario that one side mastered and the other did not."""

    scenario_id: str
    before: Outcome
    after: Outcome
    before_run: str
    after_run: str


class WeightChange(Model):
    """A cost weight that differs; None where a side does not have it."""

    weight: str
    before: float | None
    after: float | None


class SuccessTest(Model):
    """McNemar's exact test on the pairs, and the paired difference of the success rates with its 95 % interval."""

    pairs: int
    both: int
    only_before: int
    only_after: int
    neither: int
    difference: float | None
    low: float | None
    high: float | None
    p: float | None
    p_holm: float | None


class MetricTest(Model):
    """Wilcoxon's signed-rank test of after − before.

    ``shift`` is the Hodges–Lehmann estimate with its 95 % interval (None under six differing pairs), ``effect`` the
    matched-pairs rank-biserial correlation in [−1, 1]; ``better`` names the side that did better, None if neither.
    """

    name: MetricName
    unit: str
    pairs: int
    basis: Literal["valid", "both_reached_goal"]
    median_before: float | None
    median_after: float | None
    shift: float | None
    low: float | None
    high: float | None
    effect: float | None
    p: float | None
    p_holm: float | None
    better: Literal["before", "after"] | None


class Comparison(Model):
    """One side against the baseline."""

    before: str
    after: str
    success: SuccessTest
    metrics: tuple[MetricTest, ...]
    to_success: tuple[Flip, ...]
    to_success_count: int
    to_failure: tuple[Flip, ...]
    to_failure_count: int
    weights: tuple[WeightChange, ...]
    conditions: tuple[str, ...] = Field(description="what else differs between the sides as a whole")
    unpaired: int
    invalid_pairs: int
    verdict: str = Field(description="what the figures allow to say, in one or two sentences")


class CompareResultsResult(Result):
    """Paired comparisons of every side with the first."""

    sides: tuple[Side, ...]
    comparisons: tuple[Comparison, ...]
    notes: tuple[str, ...] = ()

    def answer(self) -> Answer:
        """One block a comparison, the verdict first."""
        lines = [line for comparison in self.comparisons for line in _comparison(comparison)]
        return Answer(lines[0], lines[1:], listed=self.notes)


def _comparison(comparison: Comparison) -> list[str]:
    test = comparison.success
    lines = [f"{comparison.after} against {comparison.before}: {comparison.verdict}"]
    interval = ""
    if test.difference is not None and test.low is not None and test.high is not None:
        low, high = 100 * test.low, 100 * test.high
        interval = f", difference {100 * test.difference:+.0f} points (95 %: {low:+.0f} to {high:+.0f})"
    lines.append(
        f"- {test.pairs} pairs: both reach the goal {test.both}, only before {test.only_before}, "
        f"only after {test.only_after}, neither {test.neither}{interval}; McNemar exact {_p(test.p, test.p_holm)}"
    )
    lines += _flips("to success", comparison.to_success, comparison.to_success_count)
    lines += _flips("to failure", comparison.to_failure, comparison.to_failure_count)
    lines += [_metric(metric) for metric in comparison.metrics]
    if comparison.weights:
        changes = ", ".join(f"{c.weight} {figure(c.before)} → {figure(c.after)}" for c in comparison.weights)
        lines.append(f"- weights changed: {changes}")
    if comparison.conditions:
        lines.append(f"- the sides also differ in {'; '.join(comparison.conditions)}")
    if comparison.unpaired or comparison.invalid_pairs:
        lines.append(
            f"- left out: {comparison.unpaired} runs without a partner, "
            f"{comparison.invalid_pairs} pairs with an invalid run"
        )
    return lines


def _flips(title: str, flips: tuple[Flip, ...], count: int) -> list[str]:
    if not count:
        return []
    shown = "; ".join(
        f"{flip.scenario_id} {flip.before} → {flip.after} ({flip.before_run}, {flip.after_run})" for flip in flips
    )
    more = f" and {count - len(flips)} more" if count > len(flips) else ""
    return [f"- flipped {title} ({count}): {shown}{more}"]


def _metric(metric: MetricTest) -> str:
    over = "pairs that both reached the goal" if metric.basis == "both_reached_goal" else "valid pairs"
    if metric.pairs == 0:
        return f"- {metric.name}: defined on none of the {over}"
    interval = ""
    if metric.low is not None and metric.high is not None:
        interval = f" (95 %: {figure(metric.low)} to {figure(metric.high)})"
    better = f", better: {metric.better}" if metric.better else ""
    return (
        f"- {metric.name} [{metric.unit}]: median {figure(metric.median_before)} → {figure(metric.median_after)}, "
        f"shift {figure(metric.shift)}{interval}, effect {figure(metric.effect, 2)}, {_p(metric.p, metric.p_holm)}"
        f"{better} (n={metric.pairs} {over})"
    )


def _p(p: float | None, p_holm: float | None) -> str:
    if p is None:
        return "no test"
    return f"p={figure(p)}" if p_holm is None else f"p={figure(p)} (Holm {figure(p_holm)})"
