"""Outcome rates, in total and by group; invalid items stand apart and are in no denominator."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ...schemas.results import Breakdown, Group, InvalidItem, MetricName, OutcomeShare, Rate
from ...schemas.runs import RunRecord
from .evidence import Evidence, country_of
from .statistics import rate

# ---------- metrics
# The metrics of a run: unit, which direction is better, and over which runs they may be compared.

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


# ---------- outcomes
# Outcome rates, in total and by group; invalid items stand apart and are in no denominator.

SHOWN_RUNS = 5
_BINS = ((0, 0), (1, 4), (5, 9), (10, 19), (20, 49), (50, 10**6))


def success_rate(evidence: Evidence) -> Rate:
    """Runs that reached the goal among the valid ones."""
    return rate(len(evidence.successes), len(evidence.valid))


def outcome_shares(evidence: Evidence) -> tuple[OutcomeShare, ...]:
    """Every outcome that occurred among the valid runs, the most frequent first."""
    counts = Counter(record.outcome for record in evidence.valid)
    return tuple(
        OutcomeShare(
            outcome=outcome,
            rate=rate(count, len(evidence.valid)),
            run_ids=tuple(record.run_id for record in evidence.valid if record.outcome == outcome)[:SHOWN_RUNS],
        )
        for outcome, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    )


def invalid_items(evidence: Evidence) -> tuple[InvalidItem, ...]:
    """Runs that could not be attempted, with the reason."""
    return tuple(
        InvalidItem(run_id=record.run_id, scenario_id=record.scenario_id, reason=record.reason)
        for record in evidence.runs
        if record.outcome == "invalid"
    )


def groups(evidence: Evidence, breakdown: Breakdown) -> tuple[Group, ...]:
    """Outcome rates by group; a scenario with several obstacle classes is in the group of each."""
    if breakdown == "none":
        return ()
    members: dict[str, list[RunRecord]] = {}
    for record in evidence.runs:
        for name in _GROUPERS[breakdown](evidence, record):
            members.setdefault(name, []).append(record)
    order = [name for name in _BIN_NAMES if name in members] if breakdown == "obstacle_count" else sorted(members)
    order += [name for name in sorted(members) if name not in order]
    return tuple(_group(name, members[name]) for name in order)


def _group(name: str, records: list[RunRecord]) -> Group:
    valid = [record for record in records if record.outcome != "invalid"]
    counts = Counter(record.outcome for record in valid)
    return Group(
        name=name,
        success=rate(counts["goal_reached"], len(valid)),
        outcomes=dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))),
        invalid=len(records) - len(valid),
    )


def _bin_name(count: int) -> str:
    low, high = next((low, high) for low, high in _BINS if low <= count <= high)
    return f"{low} obstacles" if low == high else f"{low}+ obstacles" if high == 10**6 else f"{low}–{high} obstacles"


_BIN_NAMES = tuple(_bin_name(low) for low, _ in _BINS)


def _by_count(evidence: Evidence, record: RunRecord) -> list[str]:
    found = evidence.obstacles.get(record.scenario_id)
    return ["unknown"] if found is None else [_bin_name(sum(found.values()))]


def _by_class(evidence: Evidence, record: RunRecord) -> list[str]:
    found = evidence.obstacles.get(record.scenario_id)
    return ["unknown"] if found is None else [f"with {kind}" for kind in found] or ["no obstacles"]


_GROUPERS: dict[str, Callable[[Evidence, RunRecord], list[str]]] = {
    "planner": lambda _, record: [record.planner],
    "config": lambda _, record: [f"{record.config_name} ({record.config_id})"],
    "prediction": lambda _, record: [record.prediction],
    "country": lambda _, record: [country_of(record.scenario_id)],
    "scenario": lambda _, record: [record.scenario_id],
    "obstacle_count": _by_count,
    "obstacle_class": _by_class,
}
