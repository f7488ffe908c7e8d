"""How runs ended: outcome rates in total and by group, metrics, and which features go with success.

Invalid items stand apart and are in no denominator. ``METRICS`` lists the metrics of a run with unit and direction.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from ...schemas.results import Breakdown, Correlation, Group, InvalidItem, MetricName, MetricSummary, OutcomeShare, Rate
from ...schemas.runs import RunRecord
from .run_set import RunSet, country_of
from .statistics import holm, rate

Name = TypeVar("Name", bound=str)


@dataclass(frozen=True)
class MetricSpec:
    """One metric of a run: unit, which direction is better, and over which runs it may be compared.

    ``basis``: a run that ends in a collision is short and never brakes for its goal, so progress and comfort are
    compared only where both runs reached the goal; nearness to others counts in every valid run.
    ``within_one_configuration``: the figure depends on the weights, so it means nothing across configurations.
    """

    name: MetricName
    unit: str
    better: Literal["lower", "higher"] | None
    basis: Literal["valid", "both_reached_goal"]
    within_one_configuration: bool = False

    def value(self, record: RunRecord) -> float | None:
        """The value of the metric in a run; None where it is not defined."""
        value: float | None = getattr(record.metrics, self.name, None)
        return value


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
"""The metrics in the order in which they are shown: one line for each field of ``RunMetrics``."""
_SHOWN_RUNS = 5
"""Run ids that an outcome lists (chosen): enough to look at some of them."""


def success_rate(runs: RunSet) -> Rate:
    """Runs that reached the goal among the valid ones."""
    return rate(len(runs.successes), len(runs.valid))


def outcome_shares(runs: RunSet) -> tuple[OutcomeShare, ...]:
    """Every outcome that occurred among the valid runs, the most frequent first."""
    return tuple(
        OutcomeShare(
            outcome=outcome,
            rate=rate(count, len(runs.valid)),
            run_ids=tuple(record.run_id for record in runs.valid if record.outcome == outcome)[:_SHOWN_RUNS],
        )
        for outcome, count in _most_frequent_first(Counter(record.outcome for record in runs.valid))
    )


def invalid_items(runs: RunSet) -> tuple[InvalidItem, ...]:
    """Runs that could not be attempted, with the reason."""
    return tuple(
        InvalidItem(run_id=record.run_id, scenario_id=record.scenario_id, reason=record.reason)
        for record in runs.records
        if record.outcome == "invalid"
    )


def metric_summaries(runs: RunSet) -> tuple[MetricSummary, ...]:
    """Mean, median and range of every metric over the valid runs in which it is defined."""
    one_configuration = len({record.config_id for record in runs.valid}) == 1
    summaries = []
    for spec in METRICS:
        values = [value for record in runs.valid if (value := spec.value(record)) is not None]
        if values and (one_configuration or not spec.within_one_configuration):
            summaries.append(
                MetricSummary(
                    name=spec.name,
                    unit=spec.unit,
                    n=len(values),
                    mean=float(np.mean(values)),
                    median=float(np.median(values)),
                    lowest=min(values),
                    highest=max(values),
                )
            )
    return tuple(summaries)


def groups(runs: RunSet, breakdown: Breakdown) -> tuple[Group, ...]:
    """Outcome rates by group; a scenario with several obstacle classes is in the group of each."""
    if breakdown == "none":
        return ()
    members: dict[str, list[RunRecord]] = {}
    for record in runs.records:
        for name in _GROUPERS[breakdown](runs, record):
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
        outcomes=dict(_most_frequent_first(counts)),
        invalid=len(records) - len(valid),
    )


def _most_frequent_first(counts: Counter[Name]) -> list[tuple[Name, int]]:
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))


_BINS = ((0, 0), (1, 4), (5, 9), (10, 19), (20, 49), (50, 10**6))
"""First and last number of obstacles of each group (chosen: about twice as many from one to the next)."""


def _bin_name(count: int) -> str:
    low, high = next((low, high) for low, high in _BINS if low <= count <= high)
    return f"{low} obstacles" if low == high else f"{low}+ obstacles" if high == 10**6 else f"{low}–{high} obstacles"


_BIN_NAMES = tuple(_bin_name(low) for low, _ in _BINS)


def _count_group(runs: RunSet, record: RunRecord) -> list[str]:
    count = runs.obstacle_count(record)
    return ["unknown"] if count is None else [_bin_name(count)]


def _class_groups(runs: RunSet, record: RunRecord) -> list[str]:
    by_type = runs.obstacles.get(record.scenario_id)
    return ["unknown"] if by_type is None else [f"with {kind}" for kind in by_type] or ["no obstacles"]


_GROUPERS: dict[str, Callable[[RunSet, RunRecord], list[str]]] = {
    "planner": lambda _, record: [record.planner],
    "config": lambda _, record: [f"{record.config_name} ({record.config_id})"],
    "prediction": lambda _, record: [record.prediction],
    "country": lambda _, record: [country_of(record.scenario_id)],
    "scenario": lambda _, record: [record.scenario_id],
    "obstacle_count": _count_group,
    "obstacle_class": _class_groups,
}

_FEWEST_RUNS = 12
"""Below this a rank correlation must exceed 0.58 to differ from 0 at 5 %: too coarse to report."""


def correlations(runs: RunSet) -> tuple[tuple[Correlation, ...], str]:
    """Spearman correlations of scenario features with success, the strongest first, and a note where there are none.

    Features are known before a run (traffic, speed at the start), never results of it.
    """
    valid = runs.valid
    if len(valid) < _FEWEST_RUNS:
        return (), f"no correlations: {len(valid)} valid runs, at least {_FEWEST_RUNS} are needed"
    if not runs.failures or not runs.successes:
        return (), "no correlations: all valid runs ended alike"
    tested = []
    for name, feature in _FEATURES.items():
        pairs = [(value, float(r.outcome == "goal_reached")) for r in valid if (value := feature(runs, r)) is not None]
        correlation = _spearman(pairs)
        if correlation is not None:
            tested.append((name, len(pairs), *correlation))
    adjusted = holm([p for *_, p in tested])
    listed = [
        Correlation(feature=name, n=n, rho=rho, p=p, p_holm=p_holm)
        for (name, n, rho, p), p_holm in zip(tested, adjusted, strict=True)
    ]
    return tuple(sorted(listed, key=lambda item: (-abs(item.rho), item.feature))), ""


def _spearman(pairs: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """ρ and its two-sided p; None where there are too few pairs, or a side is constant."""
    from scipy.stats import spearmanr

    if len(pairs) < _FEWEST_RUNS:
        return None
    first, second = zip(*pairs, strict=True)
    if len(set(first)) == 1 or len(set(second)) == 1:
        return None
    result = spearmanr(first, second)
    return float(result.statistic), float(result.pvalue)


def _obstacles(runs: RunSet, record: RunRecord) -> float | None:
    return runs.obstacle_count(record)


def _large_vehicles(runs: RunSet, record: RunRecord) -> float | None:
    by_type = runs.obstacles.get(record.scenario_id)
    return None if by_type is None else by_type.get("truck", 0) + by_type.get("bus", 0)


def _initial_speed(runs: RunSet, record: RunRecord) -> float | None:
    steps = runs.steps.get(record.run_id)
    return steps.speed_mps[0] if steps is not None and steps.speed_mps else None


_FEATURES: dict[str, Callable[[RunSet, RunRecord], float | None]] = {
    "obstacles": _obstacles,
    "trucks_and_buses": _large_vehicles,
    "initial_speed_mps": _initial_speed,
}
