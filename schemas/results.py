"""Analysis of planner runs: arguments, results and the figures they are made of; the answer's text at the end."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from .base import Answer, Arguments, Model, Result
from .measures import MeasuredValue, MeasureSpread, RunMetrics, measure_named, metric_words
from .reviews import REFERENCE_DRIVERS_DO, Contact, ContactKind, LaidTo, OwnFault, RuleVerdict, RunReview
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
from .text import counted, measured, p_figure, p_in_words
from .text import figure as figure

SIGNIFICANCE_LEVEL = 0.05
"""The level of every test and of every interval (95 %), in answers, reports, charts and searches: the usual one (Fisher
1925, "Statistical Methods for Research Workers", section 12)."""
Breakdown = Literal[
    "none", "pooled", "planner", "config", "prediction", "country", "scenario", "obstacle_count", "obstacle_class"
]
AnalysisDetail = Literal["summary", "findings", "costs", "rows", "timeline", "rules", "measures"]
if TYPE_CHECKING:
    MetricName = str
else:
    MetricName = Literal[tuple(RunMetrics.model_fields)]
"""The name of a metric: a field of ``RunMetrics``. Type checkers know it as a string only."""


class ConfigWeights(Model):
    """The cost weights of a planner configuration, and its settings that have values other than the default.

    ``default_weights``: those of the planner's first preset; None where it is not to be had here any more.
    ``parameters``: names among the weights that are no factors on cost terms, such as hard limits.
    ``terms``: recorded cost terms by the weight that they hold, if its name is another.
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
    """A share of ``count`` among ``of`` with its 95 % interval.

    All three are None if ``of`` is 0, or if the runs were chosen by how they ended, which makes it no rate.

    ``scenarios``: how many there are behind the runs; the interval counts these (docs/statistics.md). None: it counts
    the runs.
    """

    count: int = Field(description="runs that did it")
    of: int = Field(description="runs that could")
    share: float | None = Field(description="their quotient, from 0 to 1")
    low: float | None = Field(description="lower end of its 95 % interval")
    high: float | None = Field(description="upper end of its 95 % interval")
    scenarios: int | None = None

    def in_words(self) -> str:
        """``6/8 = 75 % (95 %: 41–93 %)``, with the number of scenarios if it is another one; edited ones are their
        original's.
        """
        if self.share is None or self.low is None or self.high is None:
            return f"{self.count}/{self.of}"
        span = f"95 %: {100 * self.low:.0f}–{100 * self.high:.0f} %"
        counted_by_scenario = self.scenarios is not None and self.scenarios != self.of
        scenarios = f", {counted(self.scenarios or 0, 'original scenario')}" if counted_by_scenario else ""
        return f"{self.count}/{self.of} = {_percent(self.share)} ({span}{scenarios})"


class OutcomeShare(Model):
    """How many valid runs ended in one way; ``run_ids`` holds the first five of them."""

    outcome: Outcome
    count: int = Field(description="valid runs that ended so")
    rate: Rate | None = Field(description="their share of the valid runs; null over several configurations")
    run_ids: tuple[str, ...]


class InvalidItem(Model):
    """A run that could not be attempted: counted in no rate."""

    run_id: str
    scenario_id: str
    reason: str = Field(description="why it could not be attempted")


class Group(Model):
    """One value of a breakdown; of several configurations each has its own figures, which are never pooled unasked."""

    name: str = Field(description="the value")
    success: Rate = Field(description="its share of valid runs that reached the goal")
    outcomes: dict[str, int] = Field(description="its runs by how they ended")
    invalid: int = Field(description="its runs that could not be attempted")
    failed_runs: dict[str, tuple[str, ...]] = Field(
        default_factory=dict, description="ids of failed runs by how they ended, at most five each"
    )
    valid_count: int = Field(0, description="its runs that could be attempted")
    metrics: "tuple[MetricSummary, ...]" = Field((), description="of a configuration: metrics over its valid runs")
    causes: "CollisionCauses | None" = Field(None, description="of a configuration: how collisions came about")
    trivial: "TrivialGoals | None" = Field(None, description="of a configuration: goals that asked for no driving")
    beyond_vehicle: "BeyondVehicle | None" = Field(None, description="of a configuration: runs beyond the vehicle")


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
    """Mean weighted cost per planning step of one term under one configuration, and its share of the total."""

    config_id: str
    config_name: str
    term: str = Field(description="name of the cost term")
    mean_weighted: float = Field(description="its mean weighted cost per planning step, without unit")
    share: float | None = Field(description="its share of the total cost, from 0 to 1; null where that is 0")
    runs: int = Field(description="runs behind it")


class Correlation(Model):
    """Spearman's rank correlation of a feature of scenarios with the share of their runs that reached the goal.

    ``n``: scenarios; ``p_holm`` is Holm-adjusted over the features; ``rho_fixed``: what is left of the correlation once
    the others and the kind of road are held fixed (``held_fixed``), with its p; None where nothing is left.
    """

    feature: str = Field(description="the feature of the scenarios")
    n: int
    rho: float = Field(description="Spearman's rank correlation, from -1 to 1")
    p: float = Field(description="its two-sided p")
    p_holm: float
    rho_fixed: float | None = None
    p_fixed: float | None = Field(None, description="p of `rho_fixed`; null where nothing is left")
    held_fixed: tuple[str, ...] = Field((), description="features that were held fixed")

    @property
    def stands(self) -> bool:
        """Whether it differs from 0 after Holm's adjustment, and still does with the others held fixed."""
        left = not self.held_fixed or (self.p_fixed is not None and self.p_fixed < SIGNIFICANCE_LEVEL)
        return self.p_holm < SIGNIFICANCE_LEVEL and left

    def left_in_words(self) -> str:
        """What is left of it once the others are held fixed; empty where nothing could be."""
        if not self.held_fixed:
            return ""
        fixed = ", ".join(self.held_fixed)
        if self.rho_fixed is None:
            return f"; with {fixed} held fixed nothing is left"
        return f"; with {fixed} held fixed ρ={self.rho_fixed:+.2f}, {p_in_words(self.p_fixed)}"


class TriedChange(Model):
    """What a suggested change did in a trial: runs that failed and were run again, and a sample of those that passed.

    ``p``: one-sided, of so many flips to success among all flips where either way were as likely. ``config_id``: the
    configuration with the change.
    """

    config_id: str
    change: str = Field(description="the change, as configure_planner takes it")
    failing: int = Field(description="failed runs that were run again with it")
    gained: int = Field(description="of these, the ones that then reached the goal")
    passing: int = Field(description="passed runs that were run again with it")
    lost: int = Field(description="of these, the ones that then failed")
    p: float

    @property
    def helps(self) -> bool:
        """Whether it may be told as a help: at least four flips to success and none back, or as clear with some."""
        return self.gained > self.lost and self.p <= _CLEAR_P

    def in_words(self) -> str:
        """What it bought and what it cost."""
        verdict = "helps" if self.helps else "shows no clear gain" if self.gained >= self.lost else "harms"
        return (
            f"tried {self.change} ({self.config_id}): {verdict}: {self.gained} of {self.failing} failing runs reach "
            f"the goal, {self.lost} of {self.passing} passing ones no longer do"
        )


_CLEAR_P = 0.0625
"""Four flips of four one way by chance (chosen): a trial has few runs, and advice is not proof."""


class Suggestion(Model):
    """Which weight to move in which direction, and why; ``tried``: what it did, None where it was not tried."""

    config_id: str = Field(description="id of the configuration to change")
    weight: str = Field(description="name of the weight")
    direction: Literal["raise", "lower"] = Field(description="whether to raise or lower it")
    why: str = Field(description="why that should help")
    value: float | None = Field(None, description="its value now")
    tried: TriedChange | None = None


class FindingMoment(Model):
    """A moment by which a finding can be checked: of a run, when, and what is to be seen there."""

    run_id: str
    time_s: float = Field(description="when")
    code: str = Field(description="stable code of what is to be seen then")


class Finding(Model):
    """A computed statement with its evidence; ``run_count``: all runs, ``run_ids`` the first of them.

    ``alternatives``: what else would explain it; ``moments``: where it can be seen.
    """

    name: str = Field(description="stable code of the kind of finding")
    statement: str = Field(description="what was found, in a sentence")
    subject: str = Field("", description="the weight, cost term, constraint or group of scenarios that it is about")
    figures: dict[str, float] = Field(default_factory=dict, description="the figures of the statement, by their names")
    run_ids: tuple[str, ...]
    moments: tuple[FindingMoment, ...] = Field((), description="moments of these runs by which it can be checked")
    run_count: int | None = None
    alternatives: str = ""
    suggestion: Suggestion | None = Field(None, description="which weight to move; null without one")
    next_step: str = ""


class CauseMoment(Model):
    """A collision by which causes can be checked: of a run, when, of which kind, and what it is laid to."""

    run_id: str
    time_s: float = Field(description="when the two met")
    kind: ContactKind = Field(description="how they met")
    laid_to: LaidTo | None = Field(None, description="what it is laid to; null: not known")
    fault: OwnFault | None = Field(None, description="what the ego did, where it is laid to the ego")
    preventable: bool | None = Field(None, description="whether a reference driver prevents it; null: not known")


class CollisionCauses(Model):
    """Who hit whom in the collisions of a set of runs, and which of them no reference driver prevents.

    ``looked_at``: collisions that were looked at: all, or a random sample of them; ``judged``: those of these whose
    course is known. ``unpreventable_share``: of these, the share that no reference driver prevents and that the ego did
    not make. ``from_behind``: those not preventable in which another drove into the ego from behind or onto it as it
    stood; ``recorded_traffic``: whether others in them could not react; ``laid_to``: how many are laid to the ego, the
    recording, prediction, planning or neither, of those of which it is known. ``success_without``: the rate with the
    runs left out that ended in one that is not preventable; of a sample, an estimate.
    """

    collisions: int = Field(description="runs that ended in a collision with another")
    looked_at: int = Field(description="collisions that were looked at; fewer than all are a random sample")
    judged: int
    kinds: dict[ContactKind, int] = Field(description="collisions that were looked at, by their kind")
    not_preventable: tuple[str, ...] = Field(description="ids of runs whose collision no reference driver prevents")
    unpreventable_share: Rate
    from_behind: int
    recorded_traffic: bool
    success_without: Rate | None = Field(description="null over several configurations")
    laid_to: dict[LaidTo, int] = Field(default_factory=dict)
    evidence: tuple[CauseMoment, ...] = Field((), description="each collision that was looked at")

    @property
    def is_sample(self) -> bool:
        """Whether a sample was looked at."""
        return self.looked_at < self.collisions

    def in_words(self) -> str:
        """Kinds, what they are laid to, and the share that no ego could prevent, with the rate without them."""
        kinds = ", ".join(f"{kind.replace('_', ' ')} {count}" for kind, count in self.kinds.items())
        some = "" if self.judged == self.looked_at else f" that could be judged, of {self.looked_at}"
        left = self.success_without
        without = f"; without them goal {left.in_words()}" if self.not_preventable and left is not None else ""
        count = f"{len(self.not_preventable)} of {self.judged}{some}"
        if self.is_sample:
            count = f"{self.unpreventable_share.in_words()}{some}"
            without = f"; without such ones goal about {_estimate(left)}" if without and left is not None else ""
        made = "; those that the ego caused are not among them" if "ego" in self.laid_to else ""
        drivers = f" ({REFERENCE_DRIVERS_DO}, from the moment before or from the start{made})"
        none = f"; no reference driver prevents {count}{drivers if self.not_preventable else ''}" if self.judged else ""
        laid = ", ".join(f"{cause} {count}" for cause, count in self.laid_to.items())
        told = f"{kinds}{f'; laid to {laid}' if laid else ''}{none}{without}."
        sample = f"Of {self.collisions} collisions a random {self.looked_at} were looked at: " if self.is_sample else ""
        return f"{sample or 'Collisions: '}{told}{self._seen()}"

    def _seen(self) -> str:
        """Return one collision for each attribution."""
        first = {one.laid_to: one for one in reversed(self.evidence) if one.laid_to is not None}
        shown = [f"{cause} {first[cause].run_id} at {first[cause].time_s:.1f} s" for cause in self.laid_to]
        return f" See {'; '.join(shown)}." if shown else ""


def _estimate(rate: Rate) -> str:
    if rate.share is None or rate.low is None or rate.high is None:
        return "unknown"
    return f"{_percent(rate.share)} (95 %: {100 * rate.low:.0f}–{100 * rate.high:.0f} %, estimated from the sample)"


TrivialKind = Literal["at_the_start", "standing", "by_time_alone"]
"""Why a reached goal asked for no driving: the ego was there in the first step; it stood; the goal has no place."""


class TrivialGoals(Model):
    """Reached goals that asked for no driving; ``success_without``: the rate with these runs left out."""

    kinds: dict[TrivialKind, int] = Field(description="such runs by why the goal asked for nothing")
    run_ids: tuple[str, ...] = Field(description="ids of these runs")
    goals: int = Field(description="runs that reached their goal")
    looked_at: int = Field(description="of these, the ones that were looked at; fewer than all are a random sample")
    success_without: Rate | None = Field(description="null over several configurations")

    def in_words(self) -> str:
        """How many there are of which kind, with the rate without them."""
        kinds = ", ".join(f"{kind.replace('_', ' ')} {count}" for kind, count in self.kinds.items())
        if self.looked_at < self.goals:
            kinds = f"of a random {self.looked_at} of {self.goals}, {kinds}"
            without = "" if self.success_without is None else f"; without such goals {_estimate(self.success_without)}"
            return f"Goals that asked for no driving: {kinds}{without}."
        without = "" if self.success_without is None else f"; without them goal {self.success_without.in_words()}"
        return f"Goals that asked for no driving: {kinds}{without}."


class BeyondVehicle(Model):
    """Runs whose driven motion exceeds limits of the ego's vehicle: by limit; ``judged``: runs of which it is known."""

    limits: dict[str, int] = Field(description="runs beyond each limit")
    run_ids: tuple[str, ...] = Field(description="ids of these runs")
    judged: int

    def in_words(self) -> str:
        """How many there are, and by which limits."""
        told = ", ".join(f"{name} {count}" for name, count in self.limits.items())
        return f"Beyond what the vehicle can drive: {len(self.run_ids)} of {self.judged} driven motions ({told})."


class RuleShare(Model):
    """How many runs of a configuration broke a traffic rule, of those of which it asked something.

    ``worst``: by how much the worst of them did; ``run_ids``: those that did, the worst first, at most eight.
    """

    rule: str = Field(description="stable name of the rule")
    name: str = Field(description="the rule in words")
    unit: str = Field(description="unit of `worst`")
    config_id: str
    config_name: str
    violated: Rate = Field(description="share of the runs that broke it")
    worst: float | None
    run_ids: tuple[str, ...]

    def in_words(self) -> str:
        """``R_G3 speed limit: broken in 4/20 = 20 % (95 %: 8–42 %), by 3.1 m/s at worst (run_…)``."""
        rate = self.violated.in_words()
        if self.worst is None:
            return f"{self.rule} {self.name}: kept in all, broken in {rate}"
        worst = f"by {measured(self.worst)} {self.unit} at worst ({self.run_ids[0]})"
        return f"{self.rule} {self.name}: broken in {rate}, {worst}"


class RunRow(Model):
    """One run in a line."""

    run_id: str
    scenario_id: str
    config_name: str
    outcome: Outcome
    duration_s: float | None = Field(description="length of the drive; null of a run that could not be attempted")
    minimum_distance_m: float | None = Field(description="smallest distance to another; null where none was near")
    reason: str = Field(description="why it ended so, in words")
    contact: Contact | None = Field(None, description="of the first ten collisions, where rows were asked for")
    beyond_vehicle: tuple[LimitExcess, ...] = Field((), description="limits of the vehicle that the motion exceeds")
    triggers: tuple[TriggerOutcome, ...] = Field(
        (),
        exclude_if=lambda triggers: not triggers,
        description="triggers of prescribed motions in reactive traffic, and whether they held",
    )


class TimelineStep(Model):
    """One moment of a run: what the ego did, what its cost was made of, how near the other was.

    ``gap_m``: between the ego's and the obstacle's rectangle (the one collided with, else the nearest).
    """

    time_s: float = Field(description="moment of the scenario")
    speed_mps: float = Field(description="speed of the ego")
    acceleration_mps2: float = Field(description="acceleration of the ego")
    obstacle_id: int | None
    gap_m: float | None
    largest_cost: str | None = Field(description="the cost term with the largest share; null where nothing was planned")
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
    """By what the runs are grouped, each with its rate; several configurations are one group only if pooled."""
    where: list[str] = Field([], max_length=12, description="'outcome=collision', 'config=cfg_…', 'time_s=2..4'")
    detail: AnalysisDetail = "summary"
    """Which section is shown beside the summary."""
    trial: bool = Field(False, description="run suggested changes on failing and passing runs")
    limit: int = Field(30, ge=1, le=50, description="runs of detail=rows")
    offset: int = Field(0, ge=0)
    """Runs of ``detail=rows`` to pass over."""


class AnalyseRequest(Model):
    """What the analysis operation needs."""

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
    """A metric that none of the valid runs has, and why."""

    name: MetricName = Field(description="the metric")
    why: str = Field(description="why no run has it")


class AnalyzeResultsResult(Result):
    """Figures of a set of runs; the sections that ``detail`` did not ask for are empty. ``review``: of a single run."""

    results: tuple[str, ...] = Field(description="ids that were analysed")
    runs: int = Field(description="runs behind the figures")
    detail: AnalysisDetail = Field("summary", description="the section that is shown beside the summary")
    valid_count: int = Field(0, description="runs that could be attempted")
    success: Rate | None = Field(
        description="share of valid runs that reached the goal; null over several configurations, which `groups` "
        "holds, and of runs chosen by outcome"
    )
    chosen_by_outcome: tuple[str, ...] = Field((), description="conditions on how runs ended: no rate is stated then")
    by_any_motion: Rate | None = Field(
        None, description="the same by the paper's rule, refused motions included; null if none was refused"
    )
    outcomes: tuple[OutcomeShare, ...] = Field(
        description="valid runs by how they ended; empty over several configurations, which `groups` holds"
    )
    invalid: tuple[InvalidItem, ...] = Field((), description="at most ten; invalid_count has them all")
    invalid_count: int = Field(0, description="runs that could not be attempted")
    groups: tuple[Group, ...] = Field((), description="the same by what was asked for with `breakdown`")
    metrics: tuple[MetricSummary, ...] = Field(
        (), description="metrics over the runs in which they are defined; empty over several configurations"
    )
    undefined: tuple[UndefinedMetric, ...] = Field((), description="metrics that no run has")
    costs: tuple[CostShare, ...] = Field((), description="what the planners' cost was made of")
    correlations: tuple[Correlation, ...] = Field((), description="features of scenarios that go with success")
    findings: tuple[Finding, ...] = Field((), description="what is conspicuous, with its evidence")
    rows: tuple[RunRow, ...] = Field((), description="each run in a line, of one page")
    next_offset: int | None = Field(None, description="offset of the next page of `rows`; null on the last one")
    timeline: tuple[TimelineStep, ...] = Field((), description="of a single run, its moments")
    timeline_of: Literal["end", "moment", "window"] = Field("end", description="window: that of where=time_s=…")
    review: RunReview | None = None
    measures: tuple[MeasuredValue, ...] = Field((), description="of a single run, detail=measures")
    spreads: tuple[MeasureSpread, ...] = Field((), description="of several runs, detail=measures")
    causes: CollisionCauses | None = Field(None, description="how collisions came about; null without collisions")
    trivial: TrivialGoals | None = Field(None, description="goals that asked for no driving; null where there are none")
    beyond_vehicle: BeyondVehicle | None = Field(
        None, description="runs beyond the limits of the vehicle; null where there are none"
    )
    rules: tuple[RuleVerdict, ...] = Field((), description="of a single run: what it makes of each traffic rule")
    rule_shares: tuple[RuleShare, ...] = Field((), description="runs that break each traffic rule")
    notes: tuple[str, ...] = ()
    note_figures: dict[str, float] = Field(default_factory=dict, description="the figures of the notes, by their names")
    job_id: str = Field("", description="of the trial of suggestions, while it runs")

    def answer(self) -> Answer:
        """One run: how it ended and its moments; several: rates, failures, figures; then what the detail asks for."""
        return _one_run(self) if self.runs == 1 and self.rows else _several_runs(self)


_LARGEST = {
    "jerk": "maximum_jerk_mps3",
    "braking": "maximum_braking_mps2",
    "lateral acceleration": "maximum_lateral_acceleration_mps2",
}
"""Metrics that stand among the largest motions, by their names there."""
_SHOWN_FINDINGS, _SHOWN_EXCESSES, _SHOWN_INVALID, _SHOWN_RULES, _SHOWN_GROUPS, _SHOWN_TRIGGERS = 2, 2, 2, 3, 2, 3
"""Entries of the brief answer (chosen)."""


def with_unit(text: str, unit: str) -> str:
    """A figure with its unit; ``1`` is no unit."""
    return text if unit == "1" else f"{text} {unit}"


def _one_run(result: AnalyzeResultsResult) -> Answer:
    row, review = result.rows[0], result.review
    head = f"{row.run_id} on {row.scenario_id} under {row.config_name}: {ending(row.outcome, row.reason, review)}."
    figures, warnings = [], []
    if result.detail == "summary" and row.outcome != "invalid":
        told, above = _moments(review)
        figures += told + _rest_of_metrics(result, above | {"mean_total_cost", "duration_s"})
        figures += [review.pace_in_words()] if review is not None and review.pace_in_words() else []
        figures += _main_cost(result)
    if result.detail == "summary" and row.outcome == "goal_reached" and review is not None and review.uncomfortable:
        excesses = [excess.in_words() for excess in review.uncomfortable[:_SHOWN_EXCESSES]]
        more = len(review.uncomfortable) - len(excesses)
        over = "; ".join(excesses) + (f"; {more} more" if more > 0 else "")
        warnings.append(f"reached the goal harder than passengers should bear: {over}.")
    if result.detail == "summary":
        broken = [verdict for verdict in result.rules if verdict.violated]
        words = "; ".join(verdict.in_words() for verdict in broken[:_SHOWN_RULES])
        rest = f"; {len(broken) - _SHOWN_RULES} more: detail=rules" if len(broken) > _SHOWN_RULES else ""
        warnings += [f"traffic rules broken: {words}{rest}."] if broken else []
    figures += [f"{one.in_words()}." for one in row.triggers[:_SHOWN_TRIGGERS]]
    if row.beyond_vehicle:
        warnings.append(f"{excesses_in_words(row.beyond_vehicle)}.")
    listed = [*_groups(result), *_timeline(result), *_measured(result.measures), *_correlations(result)]
    listed += _rules(result)
    if result.detail == "costs":
        listed += _costs(result)
    listed += [*(_finding_text(finding) for finding in _stated(result)), *_no_suggestion(result)]
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
    """The lines on a run's moments, and the metrics that these hold."""
    if review is None:
        return [], frozenset()
    lines, held = [], {_LARGEST[one.name] for one in review.largest if one.name in _LARGEST}
    hit = review.contact is not None and review.contact.obstacle_id is not None
    if review.closest is not None and not hit:
        lines.append(review.nearness_in_words())
    if review.closest is not None or hit:
        held |= {"minimum_distance_m", "minimum_time_to_collision_s"}
    return [*lines, *([review.motion_in_words()] if review.largest else [])], frozenset(held)


def _noted(result: AnalyzeResultsResult) -> list[str]:
    return [f"Note: {note}" for note in result.notes]


def _rest_of_metrics(result: AnalyzeResultsResult, above: frozenset[str]) -> list[str]:
    """The metrics that stand in no other line, in one; those that there are not, with the reason."""
    parts = [
        f"{metric_words(item.name)} {with_unit(measured(item.median), item.unit)}"
        for item in result.metrics
        if item.name not in above
    ]
    parts += [f"{metric_words(item.name)} none: {item.why}" for item in result.undefined if item.name not in above]
    text = "; ".join(parts)
    return [f"{text[0].upper()}{text[1:]}."] if parts else []


def _main_cost(result: AnalyzeResultsResult) -> list[str]:
    """The term that made up most of the cost of one run."""
    if not result.costs:
        return [f"Cost: none: {item.why}." for item in result.undefined if item.name == "mean_total_cost"]
    most = result.costs[0]
    total = next((item.median for item in result.metrics if item.name == "mean_total_cost"), None)
    per_step = "" if total is None else f" of {figure(total)} a planning step"
    return [f"Cost: mostly {most.term}, {_percent(most.share)}{per_step}."]


def _several_runs(result: AnalyzeResultsResult) -> Answer:
    goal = "by configuration" if result.success is None else f"goal {result.success.in_words()}"
    if result.chosen_by_outcome:
        goal = f"chosen by {' and '.join(result.chosen_by_outcome)}, so that no rate of goals is one of the planner"
    head = f"{result.runs} runs ({result.valid_count} valid, {result.invalid_count} invalid): {goal}"
    figures = _by_any_motion(result) + _failures(result)
    if result.success is not None or result.outcomes:
        told = (result.causes, result.trivial, result.beyond_vehicle)
        figures += [part.in_words() for part in told if part is not None]
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
    more = len(stated) - len(shown)
    listed += [f"… {more} more: detail=findings"] if more > 0 else []
    listed += _no_suggestion(result)
    main = next((finding.next_step for finding in result.findings if finding.name == "main_failure"), "")
    causes = result.causes
    if causes is not None and causes.recorded_traffic and 2 * causes.from_behind > causes.collisions:
        main = "run_planner with traffic=reactive: most collisions are by others that follow a recording"
    if result.job_id:
        main = f"get_job with job_id '{result.job_id}', then the same call again: the trial goes on"
    return Answer(head, figures=figures, listed=[*listed, *_noted(result)], next_step=main)


_SAID_ABOVE = frozenset(
    [
        *("main_failure", "dominating_cost", "near_misses", "uncomfortable_turns", "idle_weights"),
        *("stood_without_cause", "braked_without_cause"),
    ]
)
"""Findings that repeat, of a single run, what its moments and its cost say."""


def _no_suggestion(result: AnalyzeResultsResult) -> list[str]:
    """Where findings were asked for and none points at a weight, that it is so."""
    if result.detail != "findings" or any(finding.suggestion for finding in result.findings):
        return []
    return ["No change of a weight follows from these runs; optimize_planner searches for one on several scenarios."]


def _stated(result: AnalyzeResultsResult) -> list[Finding]:
    """The findings that say something beside the rest of the answer."""
    if result.detail == "findings":
        return list(result.findings)
    above = _SAID_ABOVE if result.runs == 1 else {"main_failure"}
    return [finding for finding in result.findings if finding.name not in above]


def _by_any_motion(result: AnalyzeResultsResult) -> list[str]:
    """Return the rate by the paper's rule if it differs."""
    rate = result.by_any_motion
    return [] if rate is None else [f"By the paper's rule, a goal by any motion: {rate.in_words()}."]


def _failures(result: AnalyzeResultsResult) -> list[str]:
    failed = [
        f"{item.outcome} {item.count} ({_listed(item.run_ids, 2, item.count)})"
        for item in result.outcomes
        if item.outcome != "goal_reached"
    ]
    lines = [f"Failed: {', '.join(failed)}."] if failed else []
    if result.invalid:
        shown = [f"{i.run_id} {i.scenario_id}: {i.reason}" for i in result.invalid[:_SHOWN_INVALID]]
        more = result.invalid_count - len(shown)
        rest = f"; {more} more: where outcome=invalid, detail=rows" if more > 0 else ""
        lines.append(f"Invalid, in no rate: {'; '.join(shown)}{rest}.")
    return lines


def _finding_text(finding: Finding) -> str:
    """One finding in one line, with evidence, what else would explain it, and the suggestion, tried or not."""
    parts = [f"- [{finding.name}] {finding.statement}"]
    if finding.alternatives:
        parts.append(f"Or: {finding.alternatives}.")
    if finding.suggestion:
        change = finding.suggestion
        tried = "untried: trial=true runs it" if change.tried is None else change.tried.in_words()
        parts.append(f"Suggest: {change.direction} {change.weight} of {change.config_id} ({change.why}; {tried}).")
    if finding.next_step:
        parts.append(f"See {finding.next_step}.")
    times = {moment.run_id: moment.time_s for moment in reversed(finding.moments)}
    ids = (f"{run_id} ({times[run_id]:.1f} s)" if run_id in times else run_id for run_id in finding.run_ids)
    parts.append(f"Runs: {_listed(ids, 2, finding.run_count)}")
    return " ".join(parts)


def _groups(result: AnalyzeResultsResult) -> list[str]:
    def line(group: Group) -> str:
        failures = ", ".join(
            f"{key} {count}" + (f" ({_listed(group.failed_runs[key], 1, count)})" if key in group.failed_runs else "")
            for key, count in group.outcomes.items()
            if key != "goal_reached"
        )
        invalid = f"invalid {group.invalid}" if group.invalid else ""
        goal = f"{group.valid_count} valid runs" if result.chosen_by_outcome else f"goal {group.success.in_words()}"
        return "; ".join(part for part in (f"- {group.name}: {goal}", failures, invalid) if part)

    lines = [line(group) for group in result.groups]
    for group in result.groups[:_SHOWN_GROUPS]:
        told = (group.causes, group.trivial, group.beyond_vehicle)
        apart = [*(part.in_words() for part in told if part), *_metrics(group.metrics, group.valid_count, ())]
        lines += [f"- {group.name}: {part}" for part in apart]
    if len(result.groups) > _SHOWN_GROUPS and any(group.metrics for group in result.groups):
        lines.append(f"- the figures of {len(result.groups) - _SHOWN_GROUPS} more: where=['config=cfg_…']")
    return ["By group:", *lines] if lines else []


def _metrics(metrics: Sequence[MetricSummary], valid: int, undefined: Sequence[UndefinedMetric]) -> list[str]:
    """Median and range of every metric; one figure where all runs have it, the range alone where there are two."""
    if not metrics:
        return []
    parts = []
    for item in metrics:
        low, high, middle = measured(item.lowest), measured(item.highest), measured(item.median)
        text = middle if low == high else f"{low}–{high}" if item.n == 2 else f"{middle} ({low}–{high})"
        some = "" if item.n == valid else f" in {item.n} runs"
        parts.append(f"{metric_words(item.name)} {with_unit(text, item.unit)}{some}")
    parts += [f"{metric_words(item.name)} none: {item.why}" for item in undefined]
    return [f"{'Median (range)' if valid > 2 else 'Range'} over {valid} valid runs: {'; '.join(parts)}."]


def _costs(result: AnalyzeResultsResult) -> list[str]:
    lines = [
        f"- {item.config_name} {item.term}: {_percent(item.share)} of the cost, {figure(item.mean_weighted)} a "
        f"planning step (n={item.runs})"
        for item in result.costs
    ]
    return ["Weighted cost terms of the chosen candidates:", *lines] if lines else ["No recorded cost terms."]


def _rules(result: AnalyzeResultsResult) -> list[str]:
    """Each traffic rule: of one run what it makes of it, of several how many broke it, by configuration."""
    if result.detail != "rules":
        return []
    if result.runs == 1:
        lines = [f"- broken: {one.in_words()}" for one in result.rules if one.violated]
        kept = [
            f"{one.rule} {one.name} (by {measured(one.robustness)} {one.unit})"
            for one in result.rules
            if one.robustness is not None and not one.violated
        ]
        absent = [f"{one.rule} {one.name}" for one in result.rules if one.robustness is None]
        lines += [f"- kept: {', '.join(kept)}"] if kept else []
        lines += [f"- nothing there that they are about: {', '.join(absent)}"] if absent else []
        return ["Traffic rules:", *lines] if lines else ["Traffic rules: none could be judged."]
    several = len({one.config_id for one in result.rule_shares}) > 1
    lines = [
        f"- {f'{one.config_name}: ' if several else ''}{one.in_words()}"
        for one in result.rule_shares
        if one.violated.of
    ]
    asked = {one.rule for one in result.rule_shares if one.violated.of}
    never = dict.fromkeys(f"{one.rule} {one.name}" for one in result.rule_shares if one.rule not in asked)
    lines += [f"- in no run anything that they are about: {', '.join(never)}"] if never else []
    return ["Traffic rules:", *lines] if lines else ["Traffic rules: none could be judged."]


def _correlations(result: AnalyzeResultsResult) -> list[str]:
    """All of them where findings were asked for; else those that stand after Holm's adjustment, by themselves."""
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
        f"- {row.run_id} {row.scenario_id} {row.config_name}: {ending(row.outcome, row.reason, contact=row.contact)}; "
        f"{figure(row.duration_s)} s, gap {measured(row.minimum_distance_m)} m"
        for row in result.rows
    ]
    more = (
        []
        if result.next_offset is None
        else [f"… {result.runs - result.next_offset} more: offset={result.next_offset}"]
    )
    return ["The hardest first: failed runs, then by risk score, time and distance to a collision:", *lines, *more]


def _timeline(result: AnalyzeResultsResult) -> list[str]:
    lines = []
    for step in result.timeline:
        gap = f", {step.gap_m:.2f} m to {step.obstacle_id}" if step.gap_m is not None else ""
        cost = f", {step.largest_cost} {_percent(step.largest_cost_share)} of the cost" if step.largest_cost else ""
        lines.append(f"- {step.time_s:.1f} s: {step.speed_mps:.1f} m/s, {step.acceleration_mps2:+.1f} m/s²{gap}{cost}")
    of = {"end": "Before the end", "moment": "Around the most critical moment", "window": "In the span asked for"}
    return [f"{of[result.timeline_of]}:", *lines] if lines else []


def _measured(measures: Sequence[MeasuredValue]) -> list[str]:
    """A line a measure of one run, with the other, its relation and the moment; what there is not in one, by reason."""
    lines, absent = list[str](), dict[str, list[str]]()
    for one in measures:
        if one.value is None:
            absent.setdefault(one.why, []).append(_short_words(one.name))
        else:
            beside = [one.partner, "" if one.time_s is None else f"at {one.time_s:.1f} s", one.note]
            lines.append(f"- {_short_words(one.name)} {measured_figure(one)}{_behind_colon(beside)}")
    lines += [f"- none: {', '.join(names)}: {why}" for why, names in absent.items()]
    return ["Measures (docs/measures.md):", *lines] if lines else []


def _behind_colon(parts: Iterable[str]) -> str:
    told = ", ".join(part for part in parts if part)
    return f": {told}" if told else ""


def _spreads(spreads: Sequence[MeasureSpread]) -> list[str]:
    """A line a measure of several runs: median, range, and the run in which it is worst."""
    lines, absent = list[str](), dict[str, list[str]]()
    for one in spreads:
        known = measure_named(one.name)
        if not one.runs or known is None:
            absent.setdefault(one.why, []).append(_short_words(one.name))
            continue
        spread = "" if one.lowest == one.highest else f" ({measured(one.lowest)}–{measured(one.highest)})"
        span = with_unit(f"{measured(one.median)}{spread}", known.unit)
        beside = "" if one.worst is None else one.worst.partner
        worst = f"; {one.worst_run_id}{f' {beside}' if beside else ''}" if one.worst_run_id else ""
        lines.append(f"- {_short_words(one.name)} {span}, n={one.runs}{worst}")
    lines += [f"- none: {', '.join(names)}: {why}" for why, names in absent.items()]
    return ["Measures, median (range), and the worst run (docs/measures.md):", *lines] if lines else []


def _short_words(name: str) -> str:
    """The name without what is explained behind it, with the abbreviation of the field if there is one."""
    known = measure_named(name)
    words = metric_words(name).partition(" (")[0]
    return words if known is None or not known.abbreviation else f"{words} ({known.abbreviation})"


def measured_figure(one: MeasuredValue) -> str:
    """A measured value with its unit; a dash where there is none."""
    known = measure_named(one.name)
    return measured(one.value) if known is None or one.value is None else with_unit(measured(one.value), known.unit)


_ONE_PERCENT = 0.01


def _percent(share: float | None) -> str:
    """A share as a percentage without decimals, less than one said so; a dash where there is none."""
    if share is None:
        return "–"
    return "<1 %" if 0 < share < _ONE_PERCENT / 2 else f"{100 * share:.0f} %"


def _listed(ids: Iterable[str], most: int, count: int | None = None) -> str:
    """The first ids, and how many more there are; ``count``: of all, where ``ids`` are the first of them only."""
    all_ids = list(ids)
    more = (len(all_ids) if count is None else count) - len(all_ids[:most])
    return " ".join(all_ids[:most]) + (f" +{more}" if more > 0 else "")
