"""Analysis of planner runs: arguments, results and the figures they are made of; the answer's text at the end."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from .base import Answer, Arguments, Model, Result
from .runs import LostCell, Outcome, RunMetrics, RunRecord

Breakdown = Literal[
    "none", "planner", "config", "prediction", "country", "scenario", "obstacle_count", "obstacle_class"
]
AnalysisDetail = Literal["summary", "findings", "costs", "rows", "timeline"]
if TYPE_CHECKING:
    MetricName = str
else:
    MetricName = Literal[tuple(RunMetrics.model_fields)]
"""The name of a metric: a field of ``RunMetrics``. Type checkers know it as a string only."""


class ScenarioSource(Model):
    """A scenario, the CommonRoad file that holds it, and its obstacles by type where they are known."""

    scenario_id: str
    path: str
    obstacles: dict[str, int] | None = None


class RunSource(Model):
    """A run's record and the file with its steps (None: only the record is at hand)."""

    record: RunRecord
    steps_path: str | None = None


class ConfigWeights(Model):
    """The cost weights of a planner configuration, and its settings that have values other than the default."""

    config_id: str
    name: str
    planner: str
    weights: dict[str, float]
    settings: dict[str, float] = Field(default_factory=dict)


class Rate(Model):
    """A share of ``count`` among ``of`` with its 95 % Wilson interval; all three None where ``of`` is 0."""

    count: int
    of: int
    share: float | None
    low: float | None
    high: float | None


class OutcomeShare(Model):
    """How many valid runs ended in one way; ``run_ids`` holds the first five of them."""

    outcome: Outcome
    rate: Rate
    run_ids: tuple[str, ...]


class InvalidItem(Model):
    """A run that could not be attempted: counted in no rate."""

    run_id: str
    scenario_id: str
    reason: str


class Group(Model):
    """One value of a breakdown."""

    name: str
    success: Rate
    outcomes: dict[str, int]
    invalid: int


class MetricSummary(Model):
    """A metric over the valid runs in which it is defined."""

    name: MetricName
    unit: str
    n: int
    mean: float
    median: float
    lowest: float
    highest: float


class CostShare(Model):
    """Mean weighted cost per planning step of one term under one configuration, and its share of the total."""

    config_id: str
    config_name: str
    term: str
    mean_weighted: float
    share: float | None
    runs: int


class Correlation(Model):
    """Spearman's rank correlation of a feature with success (1) or failure (0); ``p_holm`` is Holm-adjusted."""

    feature: str
    n: int
    rho: float
    p: float
    p_holm: float


class Suggestion(Model):
    """Which weight to move in which direction, and how sure that is."""

    config_id: str
    weight: str
    direction: Literal["raise", "lower"]
    why: str


class Finding(Model):
    """A computed statement with its evidence."""

    name: str
    statement: str
    run_ids: tuple[str, ...]
    suggestion: Suggestion | None = None
    next_step: str = ""


class RunRow(Model):
    """One run in a line."""

    run_id: str
    scenario_id: str
    config_name: str
    outcome: Outcome
    duration_s: float | None
    minimum_distance_m: float | None
    reason: str


class TimelineStep(Model):
    """One moment of a run: what the ego did, what its cost was made of, how near the other was.

    ``gap_m``: between the ego's and the obstacle's rectangle (the one collided with, else the nearest).
    """

    time_s: float
    speed_mps: float
    acceleration_mps2: float
    obstacle_id: int | None
    gap_m: float | None
    largest_cost: str | None
    largest_cost_share: float | None


class AnalyzeResultsArguments(Arguments):
    """Rates, failure modes, costs, criticality, findings with run ids; for one run the timeline to the failure. For A against B use compare_results."""  # noqa: E501 - the text that the model reads

    results: list[str] = Field(
        ["latest"],
        min_length=1,
        max_length=200,
        description="run or batch ids; latest, latest_run, latest_batch, previous_batch",
    )
    breakdown: Breakdown = "none"
    where: list[str] = Field([], max_length=12, description="'outcome=collision', 'config=cfg_…', 'duration_s>=5'")
    detail: AnalysisDetail = "summary"


class AnalyseRequest(Model):
    """What the analysis operation needs."""

    results: tuple[str, ...]
    runs: tuple[RunSource, ...]
    configs: tuple[ConfigWeights, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()
    lost: tuple[LostCell, ...] = ()
    breakdown: Breakdown = "none"
    where: tuple[str, ...] = ()
    detail: AnalysisDetail = "summary"


class AnalyzeResultsResult(Result):
    """Figures of a set of runs; the sections that ``detail`` did not ask for are empty."""

    results: tuple[str, ...]
    runs: int
    success: Rate
    outcomes: tuple[OutcomeShare, ...]
    invalid: tuple[InvalidItem, ...] = Field((), description="at most ten; invalid_count has them all")
    invalid_count: int = 0
    groups: tuple[Group, ...] = ()
    metrics: tuple[MetricSummary, ...] = ()
    costs: tuple[CostShare, ...] = ()
    correlations: tuple[Correlation, ...] = ()
    findings: tuple[Finding, ...] = ()
    rows: tuple[RunRow, ...] = ()
    timeline: tuple[TimelineStep, ...] = ()
    notes: tuple[str, ...] = ()

    def answer(self) -> Answer:
        """All sections that are there, one line an item."""
        lines = [] if self.runs == 1 else _rates(self)
        for section in (_rows, _groups, _metrics, _costs, _correlations, _timeline):
            lines += section(self)
        if self.findings:
            lines.append("Findings:")
            lines += [_finding_text(finding) for finding in self.findings]
        return Answer(lines[0], lines[1:], listed=self.notes)


def _rates(result: AnalyzeResultsResult) -> list[str]:
    valid = result.success.of
    lines = [f"{result.runs} runs ({valid} valid, {result.invalid_count} invalid): goal {_rate_text(result.success)}"]
    lines += [
        f"- {item.outcome}: {_rate_text(item.rate)} · {_listed(item.run_ids, 3)}"
        for item in result.outcomes
        if item.outcome != "goal_reached"
    ]
    return lines + [
        f"- invalid, in no rate: {item.run_id} {item.scenario_id}: {item.reason}" for item in result.invalid
    ]


def _finding_text(finding: Finding) -> str:
    """One finding in one line, with evidence and suggestion."""
    parts = [f"- [{finding.name}] {finding.statement}"]
    if finding.suggestion:
        change = finding.suggestion
        parts.append(f"Suggest: {change.direction} {change.weight} of {change.config_id} ({change.why}).")
    if finding.next_step:
        parts.append(f"Next: {finding.next_step}.")
    parts.append(f"Runs: {_listed(finding.run_ids)}")
    return " ".join(parts)


def _groups(result: AnalyzeResultsResult) -> list[str]:
    def line(name: str, rate: Rate, outcomes: dict[str, int], invalid: int) -> str:
        failures = ", ".join(f"{key} {count}" for key, count in outcomes.items() if key != "goal_reached")
        parts = [f"- {name}: goal {_rate_text(rate)}", failures, f"invalid {invalid}" if invalid else ""]
        return "; ".join(part for part in parts if part)

    lines = [line(group.name, group.success, group.outcomes, group.invalid) for group in result.groups]
    return ["By group:", *lines] if lines else []


def _metrics(result: AnalyzeResultsResult) -> list[str]:
    if result.runs == 1:
        return ["Metrics: " + ", ".join(f"{i.name} {figure(i.median)} {i.unit}" for i in result.metrics)] * bool(
            result.metrics
        )
    lines = [
        f"- {item.name}: median {figure(item.median)}, mean {figure(item.mean)}, "
        f"{figure(item.lowest)}–{figure(item.highest)} {item.unit} (n={item.n})"
        for item in result.metrics
    ]
    return ["Metrics of valid runs:", *lines] if lines else []


def _costs(result: AnalyzeResultsResult) -> list[str]:
    lines = [
        f"- {item.config_name} {item.term}: {_percent(item.share)} of the cost, {figure(item.mean_weighted)} a "
        f"planning step (n={item.runs})"
        for item in result.costs
    ]
    return ["Weighted cost terms of the chosen candidates:", *lines] if lines else []


def _correlations(result: AnalyzeResultsResult) -> list[str]:
    lines = [
        f"- success × {item.feature}: ρ={item.rho:+.2f}, p={figure(item.p)}, Holm {figure(item.p_holm)} (n={item.n})"
        for item in result.correlations
    ]
    return ["Spearman correlations:", *lines] if lines else []


def _rows(result: AnalyzeResultsResult) -> list[str]:
    lines = [
        f"- {row.run_id} {row.scenario_id} {row.config_name}: {row.outcome}, {figure(row.duration_s)} s, "
        f"gap {figure(row.minimum_distance_m)} m; {row.reason}"
        for row in result.rows
    ]
    return ["Runs:", *lines] if lines and result.runs > 1 else [line.removeprefix("- ") for line in lines]


def _timeline(result: AnalyzeResultsResult) -> list[str]:
    lines = []
    for step in result.timeline:
        gap = f", {step.gap_m:.2f} m to {step.obstacle_id}" if step.gap_m is not None else ""
        cost = f", {step.largest_cost} {_percent(step.largest_cost_share)} of the cost" if step.largest_cost else ""
        lines.append(f"- {step.time_s:.1f} s: {step.speed_mps:.1f} m/s, {step.acceleration_mps2:+.1f} m/s²{gap}{cost}")
    return ["Before the end:", *lines] if lines else []


def _percent(share: float | None) -> str:
    """A share as a percentage without decimals; a dash where there is none."""
    return "–" if share is None else f"{100 * share:.0f} %"


def _rate_text(rate: Rate) -> str:
    """``6/8 = 75 % (95 %: 41–93 %)``."""
    if rate.share is None or rate.low is None or rate.high is None:
        return f"{rate.count}/{rate.of}"
    return f"{rate.count}/{rate.of} = {_percent(rate.share)} (95 %: {100 * rate.low:.0f}–{100 * rate.high:.0f} %)"


def figure(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits; a dash for None."""
    return "–" if value is None else f"{value:.{digits}g}"


def _listed(ids: Iterable[str], most: int = 5) -> str:
    """The first ids, and how many more there are."""
    all_ids = list(ids)
    more = f" +{len(all_ids) - most}" if len(all_ids) > most else ""
    return " ".join(all_ids[:most]) + more
