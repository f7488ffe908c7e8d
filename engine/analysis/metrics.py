"""The metrics of a run: unit, which direction is better, and over which runs they may be compared."""

from dataclasses import dataclass
from typing import Literal

from plannerforge.schemas.results import MetricName
from plannerforge.schemas.runs import RunRecord

Basis = Literal["valid", "both_reached_goal"]


@dataclass(frozen=True)
class MetricSpec:
    """One metric.

    ``basis``: a run that ends in a collision is short and never brakes for its goal, so progress and comfort are
    compared only where both runs reached the goal; nearness to others counts in every valid run.
    ``within_one_configuration``: the figure depends on the weights, so it means nothing across configurations.
    """

    name: MetricName
    unit: str
    better: Literal["lower", "higher"] | None
    basis: Basis
    within_one_configuration: bool = False


METRICS: tuple[MetricSpec, ...] = (
    MetricSpec("minimum_distance_m", "m", "higher", "valid"),
    MetricSpec("minimum_time_to_collision_s", "s", "higher", "valid"),
    MetricSpec("minimum_time_headway_s", "s", "higher", "valid"),
    MetricSpec("risk_score", "of 5", "higher", "valid"),
    MetricSpec("duration_s", "s", "lower", "both_reached_goal"),
    MetricSpec("distance_m", "m", None, "both_reached_goal"),
    MetricSpec("mean_speed_mps", "m/s", None, "both_reached_goal"),
    MetricSpec("maximum_jerk_mps3", "m/s³", "lower", "both_reached_goal"),
    MetricSpec("mean_squared_jerk", "m²/s⁶", "lower", "both_reached_goal"),
    MetricSpec("maximum_lateral_acceleration_mps2", "m/s²", "lower", "both_reached_goal"),
    MetricSpec("mean_total_cost", "1", "lower", "both_reached_goal", within_one_configuration=True),
)


def metric_value(record: RunRecord, name: MetricName) -> float | None:
    """The value of a metric in a run; None where it is not defined."""
    if record.metrics is None:
        return None
    value: float | None = getattr(record.metrics, name)
    return value
