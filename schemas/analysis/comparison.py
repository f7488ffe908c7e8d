"""Paired comparison of planner runs: arguments, result with its tests, and the text of the answer."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from ..base import Answer, Arguments, Model, Result
from ..measures import metric_of_label, metric_words
from ..planning import PlannerSettings
from ..results import SIGNIFICANCE_LEVEL, ConfigWeights, MetricName, Rate, figure, with_unit
from ..reviews import Contact, RunReview
from ..runs import Lineage, Outcome, RunSource, ScenarioSource, ending
from ..text import counted, measured, p_figure, p_in_words, without_shared_clauses

HeadlineCode = Literal[
    "no_valid_pair",
    "one_pair_better",
    "one_pair_worse",
    "one_pair_same",
    "better",
    "worse",
    "mixed",
    "tie",
    "alike",
    "flips_too_few",
    "no_difference_shown",
]
"""What the pairs show about success.

- ``better``, ``worse``: shown by the exact test after Holm's adjustment
- ``mixed``: shown, but the sign changes with the prediction or traffic mode
- ``tie``: no pair flipped
- ``alike``: pairs flipped, and the 95% interval of the difference is within ten points of 0
- ``flips_too_few``: so few scenarios differ that no test can show anything
- ``no_difference_shown``: a test was possible but shows no difference"""
MetricsCode = Literal["untested", "none", "better", "worse", "mixed", "changed"]
"""What is shown by the metrics that differ after Holm's adjustment and by more than their resolution.

- ``better``, ``worse``: all metrics with a better direction agree
- ``mixed``: some metrics are better and others worse
- ``changed``: only metrics without a better direction differ
- ``none``: no metric differs
- ``untested``: there were too few pairs"""


def _metric_name(value: object) -> object:
    return metric_of_label(value) if isinstance(value, str) else value


UnlistedMetric = Annotated[MetricName, BeforeValidator(_metric_name), WithJsonSchema({"type": "string"})]
"""The name of a metric. The schema omits the valid names to stay small; a refusal lists them all.

Every name that an answer, a table or a legend prints is accepted."""


class CompareResultsArguments(Arguments):
    """A against B, paired per scenario: tests, intervals, effect sizes, flips, changed weights."""

    results: list[str] = Field(
        [],
        max_length=50,
        description="run or batch ids, baseline first, or one batch of configurations; default: the newest",
    )
    metrics: list[UnlistedMetric] = Field([], description="risk_score, duration_s …; default: all comparable")
    limit: int = Field(10, ge=1, le=100, description="flips shown per direction")


class Side(Model):
    """One compared set: a run, or the runs of one configuration and planner version in a batch."""

    label: str = Field(description="name of the side in comparisons")
    config_id: str = Field(description="id of its configuration")
    config_name: str = Field(description="name of its configuration")
    run_ids: tuple[str, ...] = Field(description="ids of its runs")
    result_id: str = Field("", description="the given run or batch; empty for runs given one by one")
    planner_version: str = Field("", description="version of its planner; empty if not known")


class CompareRequest(Model):
    """The request to the comparison operation: the sides, baseline first, and the ``lineage`` of edited scenarios.

    ``couples`` lists the pairs of sides to compare, as indices into ``sides``, the baseline first. Empty means that
    every side is compared with the first.
    """

    sides: tuple[Side, ...]
    runs: tuple[RunSource, ...]
    configs: tuple[ConfigWeights, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()
    lineage: tuple[Lineage, ...] = ()
    metrics: tuple[MetricName, ...] = ()
    limit: int = 10
    couples: tuple[tuple[int, int], ...] = ()


class EditedPair(Model):
    """Two scenarios paired by lineage, and the edits that only one of them has."""

    before: str = Field(description="id of the baseline's scenario")
    after: str = Field(description="id of the other side's scenario")
    common: str = Field(description="their common ancestor, which may be one of them")
    undone: tuple[str, ...] = Field((), description="edits that only the baseline's scenario has")
    done: tuple[str, ...] = Field((), description="edits that only the other side's scenario has")


class PairedRun(Model):
    """One side of a single pair: the outcome of its run, and its key moments."""

    run_id: str
    outcome: Outcome
    reason: str = Field(description="reason for the outcome")
    review: RunReview = Field(description="its key moments")

    def in_words(self) -> str:
        """Return the run and its outcome."""
        return f"{self.run_id}: {ending(self.outcome, self.reason, self.review)}"


class Flip(Model):
    """A scenario in which only one side succeeded.

    ``why`` describes a collision and what would prevent it.
    """

    scenario_id: str
    before: Outcome = Field(description="outcome of the baseline's run")
    after: Outcome = Field(description="outcome of the other side's run")
    before_run: str = Field(description="id of the baseline's run")
    after_run: str = Field(description="id of the other side's run")
    after_scenario_id: str = Field("", description="the other side's scenario, if it is another version")
    why: str = ""
    contact: Contact | None = Field(None, description="the contact that `why` describes")


class WeightChange(Model):
    """A cost weight that differs between the sides; a value is None if that side does not have the weight."""

    weight: str = Field(description="name of the weight")
    before: float | None = Field(description="the baseline's value")
    after: float | None = Field(description="the other side's value")


class SuccessTest(Model):
    """The pairs by success, and the paired difference in success rates with its 95% interval and exact p value.

    The scenario is the unit: the pairs of one scenario together count as one difference (docs/statistics.md). If no
    difference is shown, ``needed`` is the number of scenarios that would show one of ten points.
    """

    pairs: int = Field(description="pairs of runs")
    scenarios: int = Field(0, description="scenarios behind them")
    differing: int = Field(0, description="scenarios in which more pairs flip in one direction")
    both: int = Field(description="pairs in which both reach the goal")
    only_before: int = Field(description="pairs in which only the baseline does")
    only_after: int = Field(description="pairs in which only the other side does")
    neither: int = Field(description="pairs in which neither does")
    difference: float | None = Field(
        description="difference of the success rates, after − before, from -1 to 1; null without pairs"
    )
    low: float | None = Field(description="lower end of its 95% interval, of this test alone")
    high: float | None = Field(description="upper end of its 95% interval, of this test alone")
    p: float | None = Field(description="exact two-sided p; null without pairs")
    p_holm: float | None = Field(description="p after Holm's adjustment; null if the test could show nothing")
    needed: int | None = None

    @property
    def excludes_zero_alone(self) -> bool:
        """Whether the interval excludes 0 although the adjusted test shows no difference."""
        if self.low is None or self.high is None or self.low <= 0 <= self.high:
            return False
        return self.p_holm is None or self.p_holm >= SIGNIFICANCE_LEVEL


class Stratum(Model):
    """The pairs with one prediction and traffic mode, if the sides have several."""

    name: str = Field(description="the prediction and traffic mode")
    pairs: int = Field(description="pairs of runs with it")
    only_before: int = Field(description="pairs in which only the baseline reaches the goal")
    only_after: int = Field(description="pairs in which only the other side does")
    difference: float = Field(description="difference of the success rates, after − before, from -1 to 1")


class MetricTest(Model):
    """Wilcoxon's signed-rank test of after − before, on pairs averaged by scenario.

    ``pairs`` counts the pairs and ``scenarios`` the tested averages. ``shift`` is the Hodges–Lehmann estimate with its
    95% interval (None below six differing pairs). ``effect`` is the matched-pairs rank-biserial correlation in [−1,
    1]. ``higher`` and ``lower`` count scenarios in which the metric rises and falls. ``better`` is the better side if p
    is below 5% after Holm's adjustment and the shift exceeds the metric's resolution, otherwise None. ``run_ids`` is
    then the pair with the largest difference. For a single pair, ``direction`` compares the two values without a test:
    ``changed`` if the metric has no better direction, ``same`` if the first three digits agree.
    """

    name: MetricName = Field(description="the metric")
    unit: str
    pairs: int
    scenarios: int = Field(0, description="scenarios tested")
    basis: Literal["valid", "both_reached_goal"] = Field(
        description="which pairs count: all valid ones, or those in which both reached the goal"
    )
    median_before: float | None = Field(description="median of the baseline over the scenarios, in `unit`")
    median_after: float | None = Field(description="median of the other side, in `unit`")
    shift: float | None = Field(
        description="Hodges–Lehmann estimate of after − before, in `unit`; null below six differing pairs"
    )
    low: float | None = Field(description="lower end of its 95% interval, of this test alone, in `unit`")
    high: float | None = Field(description="upper end of its 95% interval, of this test alone, in `unit`")
    effect: float | None = Field(description="matched-pairs rank-biserial correlation, from -1 to 1")
    p: float | None = Field(description="two-sided p of Wilcoxon's signed-rank test; null if not tested")
    p_holm: float | None = Field(description="p after Holm's adjustment; null if the test could show nothing")
    better: Literal["before", "after"] | None = Field(
        description="the side that did better, beyond resolution and chance; null if not shown"
    )
    higher: int = Field(0, description="scenarios in which the metric rises")
    lower: int = 0
    direction: Literal["better", "worse", "same", "changed"] | None = None
    run_ids: tuple[str, ...] = ()


class UncomparedCost(Model):
    """The mean total costs of the two sides (medians over valid runs), and why they are not comparable."""

    before: float = Field(description="median of the baseline's mean total cost")
    after: float = Field(description="median of the other side's")
    why: str = Field(description="why the two cannot be compared")


class Comparison(Model):
    """One side compared with the baseline."""

    before: str = Field(description="label of the baseline")
    after: str = Field(description="label of the other side")
    success: SuccessTest = Field(description="how often each side reaches the goal")
    metrics: tuple[MetricTest, ...] = Field(description="each metric tested")
    cost: UncomparedCost | None = Field(None, description="if mean_total_cost is not comparable between the sides")
    to_success: tuple[Flip, ...] = Field(description="scenarios that only the other side masters, up to the limit")
    to_success_count: int = Field(description="number of these")
    to_failure: tuple[Flip, ...] = Field(description="scenarios that only the baseline masters, up to the limit")
    to_failure_count: int = Field(description="number of these")
    weights: tuple[WeightChange, ...] = Field(description="cost weights that differ")
    conditions: tuple[str, ...] = Field(description="other differences between the sides")
    strata: tuple[Stratum, ...] = Field((), description="if a side has several predictions, traffic modes or worlds")
    unpaired: int = Field(description="runs of either side without a counterpart")
    invalid_pairs: int = Field(description="pairs in which a run could not be attempted")
    headline_code: HeadlineCode = Field(description="stable code of what the pairs show about success")
    metrics_code: MetricsCode = Field("untested", description="stable code of what the metrics show")
    verdict: str = Field(description="the headline: what happened, then what the tests show")
    run_ids: tuple[str, ...] = Field((), description="runs to check it with: flipped pairs first, at most eight")
    run_count: int = Field(0, description="runs of all pairs")
    least_differing: int = Field(0, description="scenarios that must differ for a test to show anything")
    paired: str = Field("", description="how results were paired, if several were given")
    edited: tuple[EditedPair, ...] = Field((), description="pairs by lineage: at most ten")
    edited_count: int = Field(0, description="pairs of a scenario and an edited one")
    single: tuple[PairedRun, PairedRun] | None = Field(None, description="before and after, if there is only one pair")


class RankedSide(Model):
    """One of several sides, ranked by success.

    ``rank`` is 1 plus the number of sides that reach the goal significantly more often, by Holm-adjusted tests of all
    pairs of sides.
    """

    label: str = Field(description="name of the side")
    rank: int
    success: Rate = Field(description="its share of runs that reach the goal")
    worse_than: tuple[str, ...] = Field((), description="labels of the sides that reach it significantly more often")


class CompareResultsResult(Result):
    """Paired comparisons of every side with the first one; a ranking if there are three sides or more."""

    sides: tuple[Side, ...] = Field(description="the compared sides, the baseline first")
    comparisons: tuple[Comparison, ...] = Field(description="each other side against the baseline")
    ranking: tuple[RankedSide, ...] = Field((), description="of three and more sides, the best first")
    flips_asked: int | None = Field(None, description="number of flips to list")
    notes: tuple[str, ...] = ()

    def answer(self) -> Answer:
        """Return one block per comparison, the verdict first."""
        shown = _SHOWN_FLIPS if self.flips_asked is None else self.flips_asked
        lines = [line for comparison in self.comparisons for line in _comparison(comparison, shown)]
        lines += _ranking(self.ranking)
        return Answer(lines[0], figures=lines[1:], listed=[f"Note: {note}" for note in self.notes])


_SHOWN_EDITED, _SHOWN_EDITS, _SHOWN_FLIPS, _SHOWN_RUNS = 2, 6, 3, 4
"""How many entries the brief answer shows (chosen)."""


def _ranking(sides: tuple[RankedSide, ...]) -> list[str]:
    """Return the sides by rank in one line."""
    parts = [
        f"{'; ' * (rank > 1)}{rank}. "
        + ", ".join(f"{one.label} {one.success.count}/{one.success.of}" for one in sides if one.rank == rank)
        for rank in dict.fromkeys(side.rank for side in sides)
    ]
    tied = len({side.rank for side in sides}) == 1
    note = "; no difference between them is shown" if tied else "; no difference between equal ranks is shown"
    return [f"- by success, all pairs tested (Holm): {''.join(parts)}{note}"] if parts else []


def _comparison(comparison: Comparison, shown_flips: int) -> list[str]:
    lines = [f"{comparison.after} compared with the baseline {comparison.before}: {comparison.verdict}"]
    if comparison.single is not None:
        before, after = comparison.single
        (first, second), shared = without_shared_clauses([before.in_words(), after.in_words()])
        lines += [f"- baseline: {first}", f"- other: {second}"]
        lines += [f"- same for both: {'; '.join(shared)}"] if shared else []
        lines += _edited(comparison)
        lines += _directions(comparison.metrics)
    else:
        lines += [f"- paired: {comparison.paired}"] if comparison.paired else []
        lines += _edited(comparison)
        lines += _success(comparison.success)
        lines += _strata(comparison)
        lines += _flips("to success", comparison.to_success, comparison.to_success_count, shown_flips)
        lines += _flips("to failure", comparison.to_failure, comparison.to_failure_count, shown_flips)
        lines += _tested(comparison.metrics)
        lines += _checked_by(comparison)
    lines += _cost(comparison.cost)
    lines += _weights(comparison.weights)
    if comparison.conditions:
        lines.append(f"- the sides also differ in {'; '.join(comparison.conditions)}")
    left_out = [
        f"{counted(count, noun)} {why}"
        for count, noun, why in (
            (comparison.unpaired, "run", "without a counterpart"),
            (comparison.invalid_pairs, "pair", "with an invalid run"),
        )
        if count
    ]
    lines += [f"- left out: {', '.join(left_out)}"] if left_out else []
    return lines


def _checked_by(comparison: Comparison) -> list[str]:
    """Return the runs that confirm a headline, if no flip above shows them."""
    if comparison.to_success_count + comparison.to_failure_count or not comparison.run_ids:
        return []
    more = 2 * comparison.success.pairs - len(comparison.run_ids[:_SHOWN_RUNS])
    rest = f" and {more} more" if more > 0 else ""
    shown = comparison.run_ids[:_SHOWN_RUNS]
    pairs = "; ".join(f"{one}, {other}" for one, other in zip(shown[::2], shown[1::2], strict=True))
    return [f"- runs (baseline, other): {pairs}{rest}"]


def _cost(cost: UncomparedCost | None) -> list[str]:
    if cost is None:
        return []
    return [
        f"- {metric_words('mean_total_cost')} {figure(cost.before)} → {figure(cost.after)}, not compared: {cost.why}"
    ]


def _weights(changes: tuple[WeightChange, ...]) -> list[str]:
    """Return the changed weights in one line; for two planners, the shared weights and the number of others."""
    one_sided = [change for change in changes if change.before is None or change.after is None]
    shown = [change for change in changes if change not in one_sided] if len(one_sided) > _SHOWN_EDITS else changes
    parts = [f"{change.weight} {_or_default(change.before)} → {_or_default(change.after)}" for change in shown]
    hidden = len(changes) - len(shown)
    parts += [f"{hidden} weights and settings that only one of the planners has"] if hidden else []
    settings = sum(change.weight in PlannerSettings.model_fields for change in shown)
    kinds = ["weights"] * (settings < len(shown)) + ["settings"] * (settings > 0)
    return [f"- {' and '.join(kinds or ['weights'])} changed: {', '.join(parts)}"] if parts else []


def _or_default(value: float | None) -> str:
    return "not set" if value is None else figure(value)


def _success(test: SuccessTest) -> list[str]:
    """Return the pairs by success, with the difference and its test if there was one."""
    if not test.pairs:
        return []
    counts = {
        "by both": test.both,
        "only by the baseline": test.only_before,
        "only by the other": test.only_after,
        "by neither": test.neither,
    }
    shares = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    line = f"- {counted(test.pairs, 'pair')}, goal reached: {shares}"
    if (
        test.only_before + test.only_after
        and test.difference is not None
        and test.low is not None
        and test.high is not None
    ):
        low, high = 100 * test.low, 100 * test.high
        line += f"; {100 * test.difference:+.0f} points (95%: {low:+.0f} to {high:+.0f}), "
        line += f"{'McNemar' if test.scenarios in (0, test.pairs) else f'{test.scenarios} scenarios'} exact "
        line += _p(test.p, test.p_holm)
        line += f"; {_ALONE}" if test.excludes_zero_alone else ""
    return [line]


_ALONE = "the interval is for this test alone; adjusted for all tests of this answer (Holm), no difference is shown"
"""The note for a difference with a 95% interval that excludes 0, although the adjusted test does not show it."""


def _strata(comparison: Comparison) -> list[str]:
    """Return the difference under each prediction and traffic mode, if there are several."""
    parts = [f"{one.name} {100 * one.difference:+.0f} points in {one.pairs} pairs" for one in comparison.strata]
    return [f"- separately: {', '.join(parts)}"] if parts else []


def _edited(comparison: Comparison) -> list[str]:
    """Return lines on what the edits changed between the scenarios of pairs by lineage."""
    if not comparison.edited_count:
        return []
    lines = []
    for pair in comparison.edited[:_SHOWN_EDITED]:
        only = " only in the second" if pair.undone else ""
        parts = [*(f"{edit} only in the first" for edit in pair.undone), *(f"{edit}{only}" for edit in pair.done)]
        more = len(parts) - _SHOWN_EDITS
        changes = "; ".join(parts[:_SHOWN_EDITS]) + (
            f"; {more} more: describe_scenario detail=recipe" if more > 0 else ""
        )
        lines.append(
            f"- {'edits differ' if pair.undone else 'edited'} ({pair.before} → {pair.after}): "
            f"{changes or 'generated again with another seed or traffic'}"
        )
    more = comparison.edited_count - len(lines)
    return [*lines, *([f"- {counted(more, 'more pair')} of a scenario and its edited version"] if more > 0 else [])]


def _flips(title: str, flips: tuple[Flip, ...], count: int, most: int) -> list[str]:
    if not count:
        return []
    shown = "; ".join(
        f"{flip.scenario_id} {_words(flip.before)} → {_words(flip.after)} ({flip.before_run}, {flip.after_run}"
        f"{f': {flip.why}' if flip.why else ''})"
        for flip in flips[:most]
    )
    more = f"; {count - len(flips[:most])} more: limit={count}" if count > len(flips[:most]) else ""
    return [f"- flipped {title} ({count}): {shown}{more}"]


def _words(outcome: str) -> str:
    return outcome.replace("_", " ")


def _directions(metrics: tuple[MetricTest, ...]) -> list[str]:
    """Return the metrics of a single pair by direction; values that agree to three digits count as the same."""
    groups: dict[str, list[str]] = {"better": [], "worse": [], "changed": [], "same": [], "none": []}
    for metric in metrics:
        words, before, after = metric_words(metric.name), measured(metric.median_before), measured(metric.median_after)
        if metric.pairs == 0:
            groups["none"].append(words)
        elif metric.direction in (None, "same"):
            groups["same"].append(f"{words} {with_unit(before, metric.unit)}")
        else:
            groups[metric.direction].append(f"{words} {with_unit(f'{before} → {after}', metric.unit)}")
    titles = {
        "better": "better in this pair",
        "worse": "worse in this pair",
        "same": "same to three digits",
        "none": "not compared (undefined in one run, or comparable only if both reach the goal)",
    }
    return [f"- {titles.get(name, name)}: {', '.join(items)}" for name, items in groups.items() if items]


def _tested(metrics: tuple[MetricTest, ...]) -> list[str]:
    """Return the metrics that differ, smallest p first, and the others in one line."""
    differing = [metric for metric in metrics if metric.p_holm is not None and metric.p_holm < SIGNIFICANCE_LEVEL]
    shown = sorted(differing, key=lambda metric: (metric.p_holm or 0.0, metric.name))
    lines = [_metric(metric) for metric in shown]
    others = [metric for metric in metrics if metric not in differing]
    for title, tested in (
        ("medians, no significant difference", True),
        ("medians, too few pairs for a test (one figure: the same on both sides)", False),
    ):
        medians = [
            f"{metric_words(metric.name)} {_medians(metric)}"
            for metric in others
            if metric.pairs and (metric.p is not None) == tested
        ]
        lines += [f"- {title}: {', '.join(medians)}"] if medians else []
    absent = [metric_words(metric.name) for metric in others if not metric.pairs]
    return lines + ([f"- undefined in every pair: {', '.join(absent)}"] if absent else [])


def _medians(metric: MetricTest) -> str:
    before, after = measured(metric.median_before), measured(metric.median_after)
    return with_unit(before if before == after else f"{before} → {after}", metric.unit)


def _metric(metric: MetricTest) -> str:
    over = "pairs in which both reached the goal" if metric.basis == "both_reached_goal" else "valid pairs"
    interval = ""
    if metric.low is not None and metric.high is not None:
        interval = f" (95%: {measured(metric.low)} to {measured(metric.high)})"
    scenarios = "" if metric.scenarios in (0, metric.pairs) else f" in {metric.scenarios} scenarios"
    better = f"; the baseline is {'better' if metric.better == 'before' else 'worse'}" if metric.better else ""
    return (
        f"- {metric_words(metric.name)}: median {_medians(metric)}, "
        f"shift {measured(metric.shift)}{interval}, effect size {figure(metric.effect, 2)}, "
        f"{_p(metric.p, metric.p_holm)}"
        f"{better} (n={metric.pairs} {over}{scenarios})"
    )


def _p(p: float | None, p_holm: float | None) -> str:
    return p_in_words(p) if p is None or p_holm is None else f"{p_in_words(p)} (Holm {p_figure(p_holm)})"
