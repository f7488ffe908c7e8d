"""The arguments and result of the analysis of planner runs, and the text of its answer."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from .base import Answer, Arguments, Model, Result
from .measures import MeasuredValue, MeasureSpread, RunMetrics, measure_named, metric_words
from .reviews import (
    COLLISION_CAUSES,
    CollisionCause,
    Contact,
    ContactKind,
    OwnFault,
    RuleVerdict,
    RunReview,
    broken_in_words,
    kind_in_words,
)
from .runs import (
    LimitExcess,
    Lineage,
    LostCell,
    Outcome,
    RunSource,
    ScenarioSource,
    TriggerOutcome,
    ending,
    excesses_in_words,
)
from .text import REFERENCE_DRIVERS_DO, RISK_SCALE, RISK_UNIT, counted, measured, p_figure, p_in_words, signed
from .text import figure as figure

SIGNIFICANCE_LEVEL = 0.05
"""The level of every test and of every interval (95%), in answers, reports, charts and searches: the usual one (Fisher
1925, "Statistical Methods for Research Workers", section 12)."""
Breakdown = Literal[
    "none", "pooled", "planner", "config", "prediction", "country", "scenario", "obstacle_count", "obstacle_class"
]
AnalysisDetail = Literal["summary", "findings", "costs", "rows", "timeline", "rules", "measures"]
if TYPE_CHECKING:
    MetricName = str
else:
    MetricName = Literal[tuple(RunMetrics.model_fields)]
"""The name of a metric: a field of ``RunMetrics``. Type checkers treat it as a plain string."""


class ConfigWeights(Model):
    """The cost weights of a planner configuration, and its settings that differ from the default.

    ``default_weights`` holds those of the planner's first preset, or None if that planner is no longer installed.
    ``parameters`` names the weights that are not factors on cost terms, such as hard limits. ``terms`` maps a recorded
    cost term to the weight that scales it, if the two names differ.
    """

    config_id: str
    name: str
    planner: str
    weights: dict[str, float]
    settings: dict[str, float] = Field(default_factory=dict)
    default_weights: dict[str, float] | None = Field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    terms: dict[str, str] = Field(default_factory=dict)


class Rate(Model):
    """A share of ``count`` among ``of`` with its 95% interval.

    ``share``, ``low`` and ``high`` are None if ``of`` is 0, or if the runs were selected by their outcome, because that
    share is not a rate. ``scenarios`` is the number of scenarios of the runs, which the interval counts
    (docs/statistics.md). None means that the interval counts runs.
    """

    count: int = Field(description="number of such runs")
    of: int = Field(description="number of runs in total")
    share: float | None = Field(description="`count` / `of`, from 0 to 1")
    low: float | None = Field(description="lower end of its 95% interval")
    high: float | None = Field(description="upper end of its 95% interval")
    scenarios: int | None = None

    def in_words(self) -> str:
        """Return text such as ``6/8 = 75% (95% interval 41–93%)``, with the scenario count if it differs."""
        if self.share is None or self.low is None or self.high is None:
            return f"{self.count}/{self.of}"
        span = f"95% interval {100 * self.low:.0f}–{100 * self.high:.0f}%"
        counted_by_scenario = self.scenarios is not None and self.scenarios != self.of
        scenarios = f", from {counted(self.scenarios or 0, 'original scenario')}" if counted_by_scenario else ""
        return f"{self.count}/{self.of} = {_percent(self.share)} ({span}{scenarios})"


class OutcomeShare(Model):
    """The valid runs with one outcome; ``run_ids`` holds the first five."""

    outcome: Outcome
    count: int = Field(description="valid runs with this outcome")
    rate: Rate | None = Field(description="their share of the valid runs; null over several configurations")
    run_ids: tuple[str, ...]


class InvalidItem(Model):
    """A run that could not be attempted; no rate counts it."""

    run_id: str
    scenario_id: str
    reason: str = Field(description="why it could not be attempted")


class Group(Model):
    """One value of a breakdown. If there are several configurations, each has its own figures."""

    name: str = Field(description="value of the breakdown")
    success: Rate = Field(description="share of its valid runs that reached the goal")
    outcomes: dict[str, int] = Field(description="its runs by outcome")
    invalid: int = Field(description="its runs that could not be attempted")
    failed_runs: dict[str, tuple[str, ...]] = Field(
        default_factory=dict, description="ids of failed runs by outcome, at most five each"
    )
    valid_count: int = Field(0, description="its runs that could be attempted")
    metrics: "tuple[MetricSummary, ...]" = Field((), description="for a configuration: metrics over its valid runs")
    causes: "CollisionCauses | None" = Field(None, description="for a configuration: causes of collisions")
    trivial: "TrivialGoals | None" = Field(None, description="for a configuration: goals that required no driving")
    beyond_vehicle: "BeyondVehicle | None" = Field(
        None, description="for a configuration: runs beyond the vehicle's limits"
    )


class MetricSummary(Model):
    """A metric over the valid runs in which it is defined."""

    name: MetricName = Field(description="the metric")
    unit: str
    n: int = Field(description="runs in which it is defined")
    mean: float = Field(description="mean, in `unit`")
    median: float = Field(description="median, in `unit`")
    lowest: float = Field(description="smallest value, in `unit`")
    highest: float = Field(description="largest value, in `unit`")


class CostShare(Model):
    """The mean weighted cost of one term per planning step for one configuration, and its share of the total."""

    config_id: str
    config_name: str
    term: str = Field(description="name of the cost term")
    mean_weighted: float = Field(description="its mean weighted cost per planning step, without unit")
    share: float | None = Field(description="its share of the total cost, from 0 to 1; null if that is 0")
    runs: int = Field(description="runs behind it")


class Correlation(Model):
    """Spearman's rank correlation of a scenario feature with the share of runs that reached the goal.

    ``n`` counts scenarios. ``p_holm`` is Holm-adjusted over the features. ``rho_fixed`` is the partial correlation that
    controls for ``held_fixed`` (the other features and the kind of road), with ``p_fixed``. Both are None if no
    correlation is left.
    """

    feature: str = Field(description="the feature of the scenarios")
    n: int
    rho: float = Field(description="Spearman's rank correlation, from -1 to 1")
    p: float = Field(description="its two-sided p")
    p_holm: float
    rho_fixed: float | None = None
    p_fixed: float | None = Field(None, description="p of `rho_fixed`; null if no correlation is left")
    held_fixed: tuple[str, ...] = Field((), description="features controlled for")

    @property
    def stands(self) -> bool:
        """Whether the Holm-adjusted correlation differs from 0, and still does if the other features are controlled
        for.
        """
        left = not self.held_fixed or (self.p_fixed is not None and self.p_fixed < SIGNIFICANCE_LEVEL)
        return self.p_holm < SIGNIFICANCE_LEVEL and left

    def left_in_words(self) -> str:
        """Return the partial correlation as text; empty if no feature was controlled for."""
        if not self.held_fixed:
            return ""
        fixed = ", ".join(self.held_fixed)
        if self.rho_fixed is None:
            return f"; no correlation is left after controlling for {fixed}"
        return f"; controlling for {fixed} ρ={self.rho_fixed:+.2f}, {p_in_words(self.p_fixed)}"


class TriedChange(Model):
    """The result of trying a suggested change: failed runs and a sample of passed runs, each repeated with the change.

    ``p`` is the one-sided p value of this many flips to success among all flips, if the two directions were equally
    likely. ``config_id`` is the configuration with the change.
    """

    config_id: str
    change: str = Field(description="the change as an argument of configure_planner")
    failing: int = Field(description="failed runs that were run again with it")
    gained: int = Field(description="how many of these then reached the goal")
    passing: int = Field(description="passed runs that were run again with it")
    lost: int = Field(description="how many of these then failed")
    p: float

    @property
    def helps(self) -> bool:
        """Whether the gain is clear: as unlikely by chance as four flips to success and no flip back."""
        return self.gained > self.lost and self.p <= _CLEAR_P

    def in_words(self) -> str:
        """Return the verdict with the runs gained and lost."""
        verdict = "helps" if self.helps else "shows no clear gain" if self.gained >= self.lost else "harms"
        return (
            f"tried {self.change} ({self.config_id}): {verdict}: {self.gained} of {self.failing} failing runs reach "
            f"the goal, {self.lost} of {self.passing} passing runs no longer do"
        )


_CLEAR_P = 0.0625
"""The chance of four out of four flips in one direction (chosen): a trial has few runs, and advice is not proof."""


class Suggestion(Model):
    """A weight to raise or lower, and the reason; ``tried`` is the result of a trial, None if there was no trial."""

    config_id: str = Field(description="id of the configuration to change")
    weight: str = Field(description="name of the weight")
    direction: Literal["raise", "lower"] = Field(description="whether to raise or lower it")
    why: str = Field(description="why that should help")
    value: float | None = Field(None, description="its value now")
    tried: TriedChange | None = None


class FindingMoment(Model):
    """A time in a run at which a finding can be checked, and what happens there."""

    run_id: str
    time_s: float = Field(description="time of the scenario")
    code: str = Field(description="stable code of what happens then")


class Finding(Model):
    """A computed statement with its evidence.

    ``run_count`` counts all runs that show it, and ``run_ids`` holds the first of them. ``alternatives`` names other
    explanations.
    """

    name: str = Field(description="stable code of the kind of finding")
    statement: str = Field(description="the finding in one sentence")
    subject: str = Field("", description="the weight, cost term, constraint or group of scenarios in question")
    figures: dict[str, float] = Field(default_factory=dict, description="figures of the statement by name")
    run_ids: tuple[str, ...]
    moments: tuple[FindingMoment, ...] = Field((), description="times in these runs at which it can be checked")
    run_count: int | None = None
    alternatives: str = ""
    suggestion: Suggestion | None = Field(None, description="the weight to change; null without one")
    next_step: str = ""


class CauseMoment(Model):
    """A collision that can be checked: the run, the time, its kind and its cause."""

    run_id: str
    time_s: float = Field(description="when the two met")
    kind: ContactKind = Field(description="how they met")
    laid_to: CollisionCause | None = Field(None, description="cause that it is attributed to; null: not known")
    fault: OwnFault | None = Field(None, description="what the ego did, if it is attributed to the ego")
    preventable: bool | None = Field(None, description="whether a reference driver prevents it; null: not known")


class CollisionCauses(Model):
    """Who hit whom in the collisions of a set of runs, and which of them no reference driver prevents.

    Either all collisions were examined, or a random sample (``looked_at``). ``judged`` counts the examined collisions
    with a known course. ``unpreventable_share`` is the share of these that no reference driver prevents and that the
    ego did not cause. ``from_behind`` counts unpreventable collisions in which another vehicle hit the ego from behind
    or while it stood. ``recorded_traffic`` is True if others could not react. ``laid_to`` counts the collisions by
    cause. ``success_without`` is the rate without the runs that ended in an unpreventable collision, estimated if only
    a sample was examined.
    """

    collisions: int = Field(description="runs that ended in a collision with another road user")
    looked_at: int = Field(description="collisions examined; fewer than all are a random sample")
    judged: int
    kinds: dict[ContactKind, int] = Field(description="collisions examined, by kind")
    not_preventable: tuple[str, ...] = Field(description="ids of runs whose collision no reference driver prevents")
    unpreventable_share: Rate
    from_behind: int
    recorded_traffic: bool
    success_without: Rate | None = Field(description="null over several configurations")
    laid_to: dict[CollisionCause, int] = Field(default_factory=dict)
    evidence: tuple[CauseMoment, ...] = Field((), description="each collision examined")

    @property
    def is_sample(self) -> bool:
        """Whether only a sample was examined."""
        return self.looked_at < self.collisions

    def in_words(self) -> str:
        """Return the kinds, the causes, and the share that no reference driver prevents, with the rate without them."""
        kinds = ", ".join(f"{count} {kind_in_words(kind)}" for kind, count in self.kinds.items())
        some = "" if self.judged == self.looked_at else f" that could be judged, out of {self.looked_at}"
        left = self.success_without
        without = f"; without these runs, goal {left.in_words()}" if self.not_preventable and left is not None else ""
        count = f"{len(self.not_preventable)} of {self.judged}{some}"
        if self.is_sample:
            count = f"{self.unpreventable_share.in_words()}{some}"
            without = f"; without such runs, goal about {_estimate(left)}" if without and left is not None else ""
        made = "; collisions caused by the ego are not counted" if "ego" in self.laid_to else ""
        drivers = f" ({REFERENCE_DRIVERS_DO}; taking over mid-run or at the start{made})"
        none = f"; no reference driver prevents {count}{drivers if self.not_preventable else ''}" if self.judged else ""
        if none and not self.not_preventable and not self.is_sample:
            caused = "the ego caused, or " if made else ""
            none = f"; {caused}a reference driver prevents{',' if made else ''} {self.judged} of {self.judged}{some}"
        counts = [f"{count} to {COLLISION_CAUSES[cause]}" for cause, count in self.laid_to.items()]
        laid_to = (
            f"; {counts[0].replace(' ', ' attributed ', 1)}{''.join(f', {one}' for one in counts[1:])}"
            if counts
            else ""
        )
        summary = f"{kinds}{laid_to}{none}{without}."
        sample = f"In a random {self.looked_at} of {self.collisions} collisions: " if self.is_sample else ""
        return f"{sample or 'Collisions: '}{summary}{self._examples()}"

    def _examples(self) -> str:
        """Return one collision for each cause."""
        first = {one.laid_to: one for one in reversed(self.evidence) if one.laid_to is not None}
        shown = [f"{first[cause].run_id} at {first[cause].time_s:.1f} s ({cause})" for cause in self.laid_to]
        return f" Examples: {'; '.join(shown)}." if shown else ""


def _estimate(rate: Rate) -> str:
    if rate.share is None or rate.low is None or rate.high is None:
        return "unknown"
    interval = f"95% interval {100 * rate.low:.0f}–{100 * rate.high:.0f}%"
    return f"{_percent(rate.share)} ({interval}, estimated from the sample)"


TrivialKind = Literal["at_the_start", "standing", "by_time_alone"]
"""Why a goal required no driving: the first step already met it; the ego stood still; the goal has no position."""
_TRIVIAL_WORDS: Mapping[TrivialKind, str] = MappingProxyType(
    {
        "at_the_start": "the start already met the goal",
        "standing": "the ego stood still",
        "by_time_alone": "only a time is set",
    }
)


class TrivialGoals(Model):
    """Reached goals that required no driving; ``success_without`` is the rate without these runs."""

    kinds: dict[TrivialKind, int] = Field(description="such runs by reason")
    run_ids: tuple[str, ...] = Field(description="ids of these runs")
    goals: int = Field(description="runs that reached their goal")
    looked_at: int = Field(description="how many of these were examined; fewer than all are a random sample")
    success_without: Rate | None = Field(description="null over several configurations")

    def in_words(self) -> str:
        """Return the number of goals of each kind, and the rate of goals without the runs with such goals."""
        count = sum(self.kinds.values())
        needless = f"{counted(count, 'goal')} required no driving"
        if len(self.kinds) == 1:
            needless += f", because {_TRIVIAL_WORDS[next(iter(self.kinds))]}"
        else:
            needless += f" ({', '.join(f'{_TRIVIAL_WORDS[kind]}: {many}' for kind, many in self.kinds.items())})"
        rate = self.success_without
        if self.looked_at < self.goals:
            without = "" if rate is None else f"; without such goals, {_estimate(rate)}"
            return f"Of a random {self.looked_at} of {self.goals} reached goals, {needless}{without}."
        these = "this run" if count == 1 else "these runs"
        without = "" if rate is None else f"; without {these}, goal {rate.in_words()}"
        return f"{needless}{without}."


class BeyondVehicle(Model):
    """Runs with a driven motion that exceeds limits of the ego's vehicle; ``judged`` counts the runs examined."""

    limits: dict[str, int] = Field(description="runs beyond each limit")
    run_ids: tuple[str, ...] = Field(description="ids of these runs")
    judged: int

    def in_words(self) -> str:
        """Return the number of runs, and the limits that their motions exceed, as text."""
        by_limit = ", ".join(f"{name} {count}" for name, count in self.limits.items())
        return f"The vehicle cannot drive {len(self.run_ids)} of {self.judged} motions (limits exceeded: {by_limit})."


class RuleShare(Model):
    """How many runs of a configuration broke a traffic rule, among those to which it applied.

    ``worst`` is the largest excess. ``run_ids`` holds the runs that broke it, worst first, at most eight.
    """

    rule: str = Field(description="stable name of the rule")
    name: str = Field(description="name of the rule")
    unit: str = Field(description="unit of `worst`")
    config_id: str
    config_name: str
    violated: Rate = Field(description="share of the runs that broke it")
    worst: float | None
    run_ids: tuple[str, ...]

    def in_words(self) -> str:
        """Return text such as ``R_G3 speed limit: broken in 4/20 = 20% (…), at most by 3.1 m/s …``."""
        rate = self.violated.in_words()
        if self.worst is None:
            return f"{self.rule} {self.name}: broken in {rate}"
        worst = f"at most by {measured(self.worst)} {self.unit} ({self.run_ids[0]})"
        return f"{self.rule} {self.name}: broken in {rate}, {worst}"


class RunRow(Model):
    """One run as a row of a table."""

    run_id: str
    scenario_id: str
    config_name: str
    outcome: Outcome
    duration_s: float | None = Field(description="length of the drive; null if it could not be attempted")
    minimum_distance_m: float | None = Field(
        description="smallest distance to another road user; null if no road user was near"
    )
    reason: str = Field(description="reason for the outcome")
    contact: Contact | None = Field(None, description="for the first ten collisions, with detail=rows")
    beyond_vehicle: tuple[LimitExcess, ...] = Field((), description="vehicle limits that the motion exceeds")
    triggers: tuple[TriggerOutcome, ...] = Field(
        (),
        exclude_if=lambda triggers: not triggers,
        description="triggers of prescribed motions in reactive traffic, and whether they fired",
    )


class TimelineStep(Model):
    """One time step of a run: the ego's motion, its largest cost term, and the gap to an obstacle.

    ``gap_m`` is measured between the rectangles of the ego and the obstacle: the one that was hit, or else the nearest
    one.
    """

    time_s: float = Field(description="time of the scenario")
    speed_mps: float = Field(description="speed of the ego")
    acceleration_mps2: float = Field(description="acceleration of the ego")
    obstacle_id: int | None
    gap_m: float | None
    largest_cost: str | None = Field(
        description="the cost term with the largest share; null at a step without planning"
    )
    largest_cost_share: float | None = Field(description="its share of the total cost, from 0 to 1")


class AnalyzeResultsArguments(Arguments):
    """Rates, failure modes, costs, measures, traffic rules, findings; of one run the timeline. A against B: compare_results."""  # noqa: E501 - the text that the model reads

    results: list[str] = Field(
        ["latest"],
        min_length=1,
        max_length=200,
        description="run or batch ids; latest, latest_run, latest_batch, previous_batch",
    )
    breakdown: Breakdown = "none"
    """The property that groups the runs. Several configurations form one group only with ``pooled``."""
    where: list[str] = Field([], max_length=12, description="'outcome=collision', 'config=cfg_…', 'time_s=2..4'")
    detail: AnalysisDetail = "summary"
    """The section shown in addition to the summary."""
    trial: bool = Field(False, description="run suggested changes on failing and passing runs")
    limit: int = Field(30, ge=1, le=50, description="runs of detail=rows")
    offset: int = Field(0, ge=0)
    """Runs of ``detail=rows`` to skip."""


class AnalyseRequest(Model):
    """The input of the analysis operation."""

    results: tuple[str, ...]
    runs: tuple[RunSource, ...]
    configs: tuple[ConfigWeights, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()
    lineage: tuple[Lineage, ...] = ()
    lost: tuple[LostCell, ...] = ()
    breakdown: Breakdown = "none"
    where: tuple[str, ...] = ()
    detail: AnalysisDetail = "summary"
    limit: int = 30
    offset: int = 0


class UndefinedMetric(Model):
    """A metric that no valid run has, and the reason."""

    name: MetricName = Field(description="the metric")
    why: str = Field(description="why no run has it")


class AnalyzeResultsResult(Result):
    """The figures of a set of runs. Sections that ``detail`` did not select are empty.

    ``review`` is present only for a single run.
    """

    results: tuple[str, ...] = Field(description="ids analysed")
    runs: int = Field(description="runs behind the figures")
    detail: AnalysisDetail = Field("summary", description="the section shown in addition to the summary")
    valid_count: int = Field(0, description="runs that could be attempted")
    success: Rate | None = Field(
        description="share of valid runs that reached the goal; null over several configurations, see "
        "`groups`, or if the runs were selected by outcome"
    )
    chosen_by_outcome: tuple[str, ...] = Field((), description="conditions on outcomes; they rule out a rate")
    by_any_motion: Rate | None = Field(
        None, description="the same by the paper's rule, refused motions included; null if no motion was refused"
    )
    outcomes: tuple[OutcomeShare, ...] = Field(
        description="valid runs by outcome; empty over several configurations, see `groups`"
    )
    invalid: tuple[InvalidItem, ...] = Field((), description="at most ten; invalid_count counts all")
    invalid_count: int = Field(0, description="runs that could not be attempted")
    groups: tuple[Group, ...] = Field((), description="the same by `breakdown`")
    metrics: tuple[MetricSummary, ...] = Field(
        (), description="metrics over the runs in which they are defined; empty over several configurations"
    )
    undefined: tuple[UndefinedMetric, ...] = Field((), description="metrics that no run has")
    costs: tuple[CostShare, ...] = Field((), description="shares of the planners' cost")
    correlations: tuple[Correlation, ...] = Field((), description="correlations of scenario features with success")
    findings: tuple[Finding, ...] = Field((), description="conspicuous facts with their evidence")
    rows: tuple[RunRow, ...] = Field((), description="one page of runs, one row each")
    next_offset: int | None = Field(None, description="offset of the next page of `rows`; null on the last one")
    timeline: tuple[TimelineStep, ...] = Field((), description="of a single run, its time steps")
    timeline_of: Literal["end", "moment", "window"] = Field("end", description="window: the span of where=time_s=…")
    review: RunReview | None = None
    measures: tuple[MeasuredValue, ...] = Field((), description="of a single run, detail=measures")
    spreads: tuple[MeasureSpread, ...] = Field((), description="of several runs, detail=measures")
    causes: CollisionCauses | None = Field(None, description="causes of collisions; null without collisions")
    trivial: TrivialGoals | None = Field(None, description="goals that required no driving; null if absent")
    beyond_vehicle: BeyondVehicle | None = Field(
        None, description="runs beyond the limits of the vehicle; null if absent"
    )
    rules: tuple[RuleVerdict, ...] = Field((), description="of a single run: its verdict on each traffic rule")
    rule_shares: tuple[RuleShare, ...] = Field((), description="runs that break each traffic rule")
    notes: tuple[str, ...] = ()
    note_figures: dict[str, float] = Field(default_factory=dict, description="figures of the notes by name")
    job_id: str = Field("", description="of the trial of suggestions, if it is still running")

    def answer(self) -> Answer:
        """Return how one run ended and its key moments, or the rates of several; then the section of ``detail``."""
        return _one_run(self) if self.runs == 1 and self.rows else _several_runs(self)


_LARGEST = {
    "jerk": "maximum_jerk_mps3",
    "braking": "maximum_braking_mps2",
    "lateral acceleration": "maximum_lateral_acceleration_mps2",
}
"""Metrics shown among the largest motions, by the names of these motions."""
_SHOWN_FINDINGS, _SHOWN_EXCESSES, _SHOWN_INVALID, _SHOWN_RULES, _SHOWN_GROUPS, _SHOWN_TRIGGERS = 2, 2, 2, 3, 2, 3
"""The number of entries that the brief answer shows (chosen)."""


def with_unit(text: str, unit: str) -> str:
    """Return a figure with its unit, which is left out if it is ``1``; a risk score has its scale in brackets."""
    scale = f" ({RISK_SCALE})" if unit == RISK_UNIT else ""
    return text if unit == "1" else f"{text} {unit}{scale}"


def _one_run(result: AnalyzeResultsResult) -> Answer:
    row, review = result.rows[0], result.review
    head = f"{row.run_id} on {row.scenario_id} under {row.config_name}: {ending(row.outcome, row.reason, review)}."
    figures, warnings = [], []
    if result.detail == "summary" and row.outcome != "invalid":
        moments, above = _moments(review)
        figures += moments + _rest_of_metrics(result, above | {"mean_total_cost", "duration_s"})
        figures += [review.pace_in_words()] if review is not None and review.pace_in_words() else []
        figures += _main_cost(result)
    if result.detail == "summary" and row.outcome == "goal_reached" and review is not None and review.uncomfortable:
        excesses = [excess.in_words() for excess in review.uncomfortable[:_SHOWN_EXCESSES]]
        more = len(review.uncomfortable) - len(excesses)
        over = "; ".join(excesses) + (f"; {more} more" if more > 0 else "")
        warnings.append(f"reached the goal, but beyond comfort limits: {over}.")
    if result.detail == "summary":
        broken = broken_in_words(result.rules, _SHOWN_RULES, "detail=rules")
        warnings += [broken] if broken else []
    figures += [f"{one.in_words()}." for one in row.triggers[:_SHOWN_TRIGGERS]]
    if row.beyond_vehicle:
        warnings.append(f"{excesses_in_words(row.beyond_vehicle)}.")
    listed = [*_groups(result), *_timeline(result), *_measured(result.measures), *_correlations(result)]
    listed += _rules(result)
    if result.detail == "costs":
        listed += _costs(result)
    hidden = _hidden(result)
    listed += [_finding_text(finding) for finding in _stated(result)]
    listed += [*([f"… {counted(hidden, 'more finding')}: detail=findings"] if hidden else []), *_no_suggestion(result)]
    failed = row.outcome not in ("goal_reached", "invalid")
    look = f"analyze_results with results ['{row.run_id}'], detail timeline"
    if result.detail == "timeline":
        look = f"render with ids ['{row.run_id}'], kind animation"
    following = f"describe_scenario of {row.scenario_id} with detail checks" if row.outcome == "invalid" else look
    return Answer(
        head,
        figures=figures,
        listed=[*listed, *_noted(result)],
        warnings=warnings,
        next_step=following if failed or row.outcome == "invalid" or result.detail == "summary" else "",
    )


def _moments(review: RunReview | None) -> tuple[list[str], frozenset[str]]:
    """Return the lines on a run's key moments, and the metrics that they state."""
    if review is None:
        return [], frozenset()
    lines, stated = [], {_LARGEST[one.name] for one in review.largest if one.name in _LARGEST}
    hit = review.contact is not None and review.contact.obstacle_id is not None
    if review.closest is not None and not hit:
        lines.append(review.nearness_in_words())
    if review.closest is not None or hit:
        stated |= {"minimum_distance_m", "minimum_time_to_collision_s"}
    lines += [review.unseen_in_words()] if review.unseen else []
    return [*lines, *([review.motion_in_words()] if review.largest else [])], frozenset(stated)


def _noted(result: AnalyzeResultsResult) -> list[str]:
    return [f"Note: {note}" for note in result.notes]


def _rest_of_metrics(result: AnalyzeResultsResult, above: frozenset[str]) -> list[str]:
    """Return one line with the metrics that no other line states, and the undefined ones with the reason."""
    parts = [
        f"{metric_words(item.name)} {with_unit(measured(item.median), item.unit)}"
        for item in result.metrics
        if item.name not in above
    ]
    parts += _undefined([item for item in result.undefined if item.name not in above])
    text = "; ".join(parts)
    return [f"{text[0].upper()}{text[1:]}."] if parts else []


def _undefined(metrics: Sequence[UndefinedMetric]) -> list[str]:
    """Return the undefined metrics with the reason, once for those with the same reason."""
    names: dict[str, list[str]] = {}
    for metric in metrics:
        names.setdefault(metric.why, []).append(metric_words(metric.name))
    return [f"{' and '.join(words)} undefined: {why}" for why, words in names.items()]


def _main_cost(result: AnalyzeResultsResult) -> list[str]:
    """Return the line on the term that made up most of the cost of one run."""
    if not result.costs:
        return [f"Cost undefined: {item.why}." for item in result.undefined if item.name == "mean_total_cost"]
    most = result.costs[0]
    total = next((item.median for item in result.metrics if item.name == "mean_total_cost"), None)
    per_step = "" if total is None else f" of {figure(total)} per planning step"
    return [f"Cost: mostly {most.term}, {_percent(most.share)}{per_step}."]


def _several_runs(result: AnalyzeResultsResult) -> Answer:
    goal = "" if result.success is None else f": goal {result.success.in_words()}"
    if result.chosen_by_outcome:
        goal = f": selected by {' and '.join(result.chosen_by_outcome)}, so a goal rate would not describe the planner"
    head = f"{result.runs} runs ({result.valid_count} valid, {result.invalid_count} invalid){goal}"
    figures = _by_any_motion(result) + _failures(result)
    if result.success is not None or result.outcomes:
        parts = (result.causes, result.trivial, result.beyond_vehicle)
        figures += [part.in_words() for part in parts if part is not None]
        figures += _metrics(result.metrics, result.valid_count, result.undefined)
    listed = [*_rows(result), *_spreads(result.spreads), *_groups(result), *_rules(result)]
    if result.detail == "costs":
        listed += _costs(result)
    listed += _correlations(result)
    stated = _stated(result)
    tried = [finding for finding in stated if finding.suggestion is not None and finding.suggestion.tried is not None]
    stated = [*tried, *(finding for finding in stated if finding not in tried)]
    shown = stated[: max(_SHOWN_FINDINGS, len(tried))] if result.detail == "summary" else stated
    listed += ["Findings:", *(_finding_text(finding) for finding in shown)] if shown else []
    more = len(stated) - len(shown) + _hidden(result)
    listed += [f"… {counted(more, 'more finding')}: detail=findings"] if more > 0 else []
    listed += _no_suggestion(result)
    main = next((finding.next_step for finding in result.findings if finding.name == "main_failure"), "")
    causes = result.causes
    if causes is not None and causes.recorded_traffic and 2 * causes.from_behind > causes.collisions:
        main = "run_planner with traffic=reactive, because in most collisions a recorded vehicle hit the ego"
    if result.job_id:
        main = f"get_job with job_id '{result.job_id}', then repeat this call: the trial is still running"
    return Answer(head, figures=figures, listed=[*listed, *_noted(result)], next_step=main)


_STATED_ABOVE = frozenset(
    [
        *("main_failure", "dominating_cost", "near_misses", "uncomfortable_turns", "idle_weights"),
        *("stood_without_cause", "braked_without_cause"),
    ]
)
"""Findings that repeat what the key moments and the cost of a single run already state."""


def _no_suggestion(result: AnalyzeResultsResult) -> list[str]:
    """Return a line saying that no finding suggests a weight; empty if one does, or if findings were not requested."""
    if result.detail != "findings" or any(finding.suggestion for finding in result.findings):
        return []
    return [
        "These runs do not suggest changing any weight; optimize_planner searches for better weights on more scenarios."
    ]


def _hidden(result: AnalyzeResultsResult) -> int:
    """Return the number of findings that a summary leaves out of its structured answer."""
    return int(result.note_figures.get("hidden_findings", 0))


def _stated(result: AnalyzeResultsResult) -> list[Finding]:
    """Return the findings that add to the rest of the answer."""
    if result.detail == "findings":
        return list(result.findings)
    above = _STATED_ABOVE if result.runs == 1 else {"main_failure"}
    return [finding for finding in result.findings if finding.name not in above]


def _by_any_motion(result: AnalyzeResultsResult) -> list[str]:
    """Return a line with the rate by the paper's rule; no line if no motion to the goal was refused."""
    rate = result.by_any_motion
    return [] if rate is None else [f"Including motions that CommonRoad's benchmark refuses: goal {rate.in_words()}."]


def _failures(result: AnalyzeResultsResult) -> list[str]:
    failed = [
        f"{item.outcome.replace('_', ' ')} {item.count} ({_listed(item.run_ids, 2, item.count)})"
        for item in result.outcomes
        if item.outcome != "goal_reached"
    ]
    lines = [f"Failed: {', '.join(failed)}."] if failed else []
    if result.invalid:
        shown = [f"{i.run_id} {i.scenario_id}: {i.reason}" for i in result.invalid[:_SHOWN_INVALID]]
        more = result.invalid_count - len(shown)
        rest = f"; {more} more: where=['outcome=invalid'], detail=rows" if more > 0 else ""
        lines.append(f"Invalid, not counted in rates: {'; '.join(shown)}{rest}.")
    return lines


def _finding_text(finding: Finding) -> str:
    """Return a finding in one line, with its evidence, other explanations, and the suggestion."""
    parts = [f"- [{finding.name}] {finding.statement}"]
    if finding.alternatives:
        parts.append(f"Possible explanation: {finding.alternatives}.")
    if finding.suggestion:
        change = finding.suggestion
        tried = "not tried yet; trial=true tries it" if change.tried is None else change.tried.in_words()
        parts.append(f"Suggestion: {change.direction} {change.weight} of {change.config_id} ({change.why}; {tried}).")
    if finding.next_step:
        parts.append(f"Try {finding.next_step}.")
    times = {moment.run_id: moment.time_s for moment in reversed(finding.moments)}
    ids = (f"{run_id} ({times[run_id]:.1f} s)" if run_id in times else run_id for run_id in finding.run_ids)
    parts.append(f"Runs: {_listed(ids, 2, finding.run_count)}")
    return " ".join(parts)


def _groups(result: AnalyzeResultsResult) -> list[str]:
    def line(group: Group) -> str:
        failures = ", ".join(
            f"{key.replace('_', ' ')} {count}"
            + (f" ({_listed(group.failed_runs[key], 1, count)})" if key in group.failed_runs else "")
            for key, count in group.outcomes.items()
            if key != "goal_reached"
        )
        invalid = f"invalid {group.invalid}" if group.invalid else ""
        goal = (
            counted(group.valid_count, "valid run") if result.chosen_by_outcome else f"goal {group.success.in_words()}"
        )
        return "; ".join(part for part in (f"- {group.name}: {goal}", failures, invalid) if part)

    lines = [line(group) for group in result.groups]
    for group in result.groups[:_SHOWN_GROUPS]:
        parts = (group.causes, group.trivial, group.beyond_vehicle)
        apart = [*(part.in_words() for part in parts if part), *_metrics(group.metrics, group.valid_count, ())]
        lines += [f"- {group.name}: {part}" for part in apart]
    if len(result.groups) > _SHOWN_GROUPS and any(group.metrics for group in result.groups):
        lines.append(f"- {counted(len(result.groups) - _SHOWN_GROUPS, 'more group')}: where=['config=cfg_…']")
    return ["By group:", *lines] if lines else []


def _metrics(metrics: Sequence[MetricSummary], valid: int, undefined: Sequence[UndefinedMetric]) -> list[str]:
    """Return the median and range of every metric; one figure if all runs agree, only the range for two runs."""
    if not metrics:
        return []
    parts = []
    for item in metrics:
        low, high, middle = measured(item.lowest), measured(item.highest), measured(item.median)
        text = middle if low == high else f"{low}–{high}" if item.n == 2 else f"{middle} ({low}–{high})"
        some = "" if item.n == valid else f" (in {counted(item.n, 'run')})"
        parts.append(f"{metric_words(item.name)} {with_unit(text, item.unit)}{some}")
    parts += _undefined(undefined)
    return [f"{'Median (range)' if valid > 2 else 'Range'} over {counted(valid, 'valid run')}: {'; '.join(parts)}."]


def _costs(result: AnalyzeResultsResult) -> list[str]:
    lines = [
        f"- {item.config_name} {item.term}: {_percent(item.share)} of the cost, {figure(item.mean_weighted)} per "
        f"planning step (n={item.runs})"
        for item in result.costs
    ]
    return ["Weighted cost terms of the chosen candidates:", *lines] if lines else ["No cost terms were recorded."]


def _rules(result: AnalyzeResultsResult) -> list[str]:
    """Return the verdict on each traffic rule for one run, or the share of runs that broke it, by configuration."""
    if result.detail != "rules":
        return []
    if result.runs == 1:
        lines = [f"- broken: {one.in_words()}" for one in result.rules if one.violated]
        kept = [
            f"{one.rule} {one.name} (margin {measured(one.robustness)} {one.unit})"
            for one in result.rules
            if one.robustness is not None and not one.violated
        ]
        absent = [f"{one.rule} {one.name}" for one in result.rules if one.robustness is None]
        lines += [f"- complied with: {', '.join(kept)}"] if kept else []
        lines += [f"- not applicable: {', '.join(absent)}"] if absent else []
        return ["Traffic rules:", *lines] if lines else ["Traffic rules: no rule could be judged."]
    several = len({one.config_id for one in result.rule_shares}) > 1
    lines = [
        f"- {f'{one.config_name}: ' if several else ''}{one.in_words()}"
        for one in result.rule_shares
        if one.violated.of
    ]
    applied = {one.rule for one in result.rule_shares if one.violated.of}
    unused = dict.fromkeys(f"{one.rule} {one.name}" for one in result.rule_shares if one.rule not in applied)
    lines += [f"- not applicable in any run: {', '.join(unused)}"] if unused else []
    return ["Traffic rules:", *lines] if lines else ["Traffic rules: no rule could be judged."]


def _correlations(result: AnalyzeResultsResult) -> list[str]:
    """Return all correlations with ``detail=findings``, otherwise those for which ``stands`` is true."""
    shown = [item for item in result.correlations if result.detail == "findings" or item.stands]
    lines = [
        f"- success × {item.feature}: ρ={item.rho:+.2f}, {p_in_words(item.p)}, Holm {p_figure(item.p_holm)} "
        f"(n={item.n} scenarios){item.left_in_words()}"
        for item in shown
    ]
    return ["Spearman correlations:", *lines] if lines else []


def _rows(result: AnalyzeResultsResult) -> list[str]:
    if result.detail != "rows":
        return []
    lines = [
        f"- {row.run_id} {row.scenario_id} {row.config_name}: {ending(row.outcome, row.reason, contact=row.contact)}"
        f"{'' if row.duration_s is None else f'; drove {figure(row.duration_s)} s'}"
        f"{'' if row.minimum_distance_m is None else f', smallest gap {measured(row.minimum_distance_m)} m'}"
        for row in result.rows
    ]
    more = (
        []
        if result.next_offset is None
        else [f"… {result.runs - result.next_offset} more: offset={result.next_offset}"]
    )
    return ["Hardest first (failed runs, then by risk score, time to collision and gap):", *lines, *more]


def _timeline(result: AnalyzeResultsResult) -> list[str]:
    lines = []
    for step in result.timeline:
        gap = f", {step.gap_m:.2f} m to {step.obstacle_id}" if step.gap_m is not None else ""
        cost = f", {step.largest_cost} {_percent(step.largest_cost_share)} of the cost" if step.largest_cost else ""
        lines.append(
            f"- {step.time_s:.1f} s: {step.speed_mps:.1f} m/s, {signed(step.acceleration_mps2)} m/s²{gap}{cost}"
        )
    of = {"end": "Before the end", "moment": "Around the most critical moment", "window": "In the requested time span"}
    gaps = " (m to ID: gap to road user ID)" if any(step.gap_m is not None for step in result.timeline) else ""
    return [f"{of[result.timeline_of]}{gaps}:", *lines] if lines else []


def _measured(measures: Sequence[MeasuredValue]) -> list[str]:
    """Return a line for each measure of one run, and a line for those that are undefined, by reason."""
    lines, absent = list[str](), dict[str, list[str]]()
    for one in measures:
        if one.value is None:
            absent.setdefault(one.why, []).append(_short_words(one.name))
        else:
            context = [one.partner, "" if one.time_s is None else f"at {one.time_s:.1f} s", one.note]
            lines.append(f"- {_short_words(one.name)} {measured_figure(one)}{_with_context(context)}")
    lines += [f"- undefined: {', '.join(names)}: {why}" for why, names in absent.items()]
    return ["Measures (docs/measures.md):", *lines] if lines else []


def _with_context(parts: Iterable[str]) -> str:
    shown = ", ".join(part for part in parts if part)
    return f" {shown}" if shown.startswith("at ") else f", {shown}" if shown else ""


def _spreads(spreads: Sequence[MeasureSpread]) -> list[str]:
    """Return a line for each measure of several runs: median, range, and the run with the worst value."""
    lines, absent = list[str](), dict[str, list[str]]()
    for one in spreads:
        known = measure_named(one.name)
        if not one.runs or known is None:
            absent.setdefault(one.why, []).append(_short_words(one.name))
            continue
        spread = "" if one.lowest == one.highest else f" ({measured(one.lowest)}–{measured(one.highest)})"
        span = with_unit(f"{measured(one.median)}{spread}", known.unit)
        partner = "" if one.worst is None else one.worst.partner
        worst = f"; {one.worst_run_id}{f' {partner}' if partner else ''}" if one.worst_run_id else ""
        lines.append(f"- {_short_words(one.name)} {span}, n={one.runs}{worst}")
    lines += [f"- undefined: {', '.join(names)}: {why}" for why, names in absent.items()]
    return ["Measures: median (range); worst run (docs/measures.md):", *lines] if lines else []


def _short_words(name: str) -> str:
    """Return the name without its explanation in brackets, with the field's abbreviation if there is one."""
    known = measure_named(name)
    words = metric_words(name).partition(" (")[0]
    return words if known is None or not known.abbreviation else f"{words} ({known.abbreviation})"


def measured_figure(one: MeasuredValue) -> str:
    """Return a measured value with its unit, or a dash if it is undefined."""
    known = measure_named(one.name)
    return measured(one.value) if known is None or one.value is None else with_unit(measured(one.value), known.unit)


_ONE_PERCENT = 0.01


def _percent(share: float | None) -> str:
    """Return a share as a whole percentage, ``<1 %`` if it is smaller, or a dash if it is undefined."""
    if share is None:
        return "–"
    return "<1%" if 0 < share < _ONE_PERCENT / 2 else f"{100 * share:.0f}%"


def _listed(ids: Iterable[str], most: int, count: int | None = None) -> str:
    """Return the first ids and the number of the others; ``count`` counts all if ``ids`` is only the first of them."""
    all_ids = list(ids)
    more = (len(all_ids) if count is None else count) - len(all_ids[:most])
    return ", ".join(all_ids[:most]) + (f" and {more} more" if more > 0 else "")
