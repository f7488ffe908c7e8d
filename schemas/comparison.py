"""Paired comparison of planner runs: arguments, results and the tests they are made of."""

from typing import Annotated, Literal

from pydantic import Field, WithJsonSchema

from plannerforge.schemas.base import Arguments, Model, Result
from plannerforge.schemas.results import ConfigWeights, MetricName, RunSource
from plannerforge.schemas.runs import Outcome

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

    def to_text(self) -> str:
        """The same in compact lines."""
        from plannerforge.schemas.comparison_text import comparison_text

        return comparison_text(self)
