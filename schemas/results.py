"""Analysis of planner runs: arguments, results and the figures they are made of."""

from typing import Literal

from pydantic import Field

from plannerforge.schemas.base import Arguments, Model, Result
from plannerforge.schemas.runs import LostCell, Outcome, RunRecord

Breakdown = Literal[
    "none", "planner", "config", "prediction", "country", "scenario", "obstacle_count", "obstacle_class"
]
AnalysisDetail = Literal["summary", "findings", "costs", "rows", "timeline"]
MetricName = Literal[
    "duration_s",
    "distance_m",
    "mean_speed_mps",
    "minimum_distance_m",
    "minimum_time_to_collision_s",
    "minimum_time_headway_s",
    "risk_score",
    "maximum_jerk_mps3",
    "mean_squared_jerk",
    "maximum_lateral_acceleration_mps2",
    "mean_total_cost",
]


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

    def to_text(self) -> str:
        """The same in compact lines."""
        from plannerforge.schemas.results_text import analysis_text

        return analysis_text(self)
