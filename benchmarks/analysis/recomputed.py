"""Recomputes the figures of analyses from records, steps and files.

It implements ``docs/statistics.md`` and ``docs/analysis.md`` and shares nothing with ``engine/analysis``.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations_with_replacement
from statistics import fmean, median
from typing import Any

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from scipy.optimize import brentq
from scipy.stats import binomtest, norm, rankdata, spearmanr, t
from shapely import Point

from plannerforge.schemas.runs import RunRecord

from .public_runs import RawRuns

METRICS = {
    "minimum_distance_m": (0.01, "valid"),
    "minimum_time_to_collision_s": (0.01, "valid"),
    "minimum_time_headway_s": (0.01, "valid"),
    "minimum_time_gap_s": (0.01, "valid"),
    "risk_score": (0.0, "valid"),
    "duration_s": (0.01, "reached"),
    "distance_m": (0.01, "reached"),
    "mean_speed_mps": (0.01, "reached"),
    "maximum_jerk_mps3": (0.01, "reached"),
    "mean_squared_jerk": (0.01, "reached"),
    "maximum_planar_jerk_mps3": (0.01, "reached"),
    "maximum_braking_mps2": (0.01, "reached"),
    "maximum_lateral_acceleration_mps2": (0.01, "reached"),
    "maximum_steering_rate_radps": (0.001, "reached"),
    "mean_total_cost": (0.0, "reached"),
}
"""By metric: its tolerance for equality, and the pairs over which it is compared."""
Z = float(norm.ppf(0.975))
CAR_MPS2, CAR_TOP_MPS = 11.5, 50.8
"""The largest acceleration and speed of vehicle 2 of CommonRoad's vehicle models (3.0.2), the ego of public runs."""
Trial = tuple[str, float]
"""A scenario and its result."""


def goal(record: RunRecord) -> bool:
    """Return True if a run reached its goal."""
    return record.outcome == "goal_reached"


def metric(record: RunRecord, name: str) -> float | None:
    """Return a metric of a run, or None if it has none."""
    value: float | None = getattr(record.metrics, name, None)
    return value


def worth(trials: Sequence[Trial], mean: float, variance: float) -> float:
    """Return the number of independent trials that these are worth, with the scenario as the unit."""
    groups: dict[str, list[float]] = {}
    for name, value in trials:
        groups.setdefault(name, []).append(value)
    count = len(groups)
    if count == len(trials):
        return float(count)
    if count < 2 or variance <= 0:
        return float(count)
    squares = sum(sum(value - mean for value in values) ** 2 for values in groups.values())
    design = max(squares * count / (count - 1) / (len(trials) * variance), 1.0)
    return float(len(trials) / design * (Z / t.ppf(0.975, count - 1)) ** 2)


def rate(trials: Sequence[Trial]) -> list[float]:
    """Return count, total, and the share with its interval in percent; also the number of scenarios if it differs."""
    of, count = len(trials), sum(value for _, value in trials)
    if not of:
        return [0, 0]
    share = count / of
    size = worth(trials, share, share * (1 - share))
    # The ends solve (p̂ − p)² = z² p (1 − p) / n.
    roots = np.roots([1 + Z**2 / size, -2 * share - Z**2 / size, share**2]).real
    scenarios = len({name for name, _ in trials})
    return [count, of, *(100 * x for x in (share, min(roots), max(roots))), *([scenarios] if scenarios != of else [])]


def goals(records: Iterable[RunRecord]) -> list[float]:
    """Return the rate of runs that reached the goal."""
    return rate([(record.scenario_id, float(goal(record))) for record in records])


def holm(p_values: Mapping[str, float]) -> dict[str, float]:
    """Return Holm's adjustment by name."""
    adjusted, highest = dict[str, float](), 0.0
    for place, name in enumerate(sorted(p_values, key=lambda key: p_values[key])):
        highest = max(highest, min(1.0, (len(p_values) - place) * p_values[name]))
        adjusted[name] = highest
    return adjusted


def sign_flip_p(sizes: Sequence[float], positive: float) -> float:
    """Return the two-sided p of a sum of positive parts if each sign is a fair coin: exact, or normal above sixty."""
    values = [value for value in sizes if value]
    if not values:
        return 1.0
    if len(values) > 60:
        spread = 0.5 * math.sqrt(sum(value**2 for value in values))
        return float(2 * norm.sf(max(abs(positive - sum(values) / 2) - 0.5, 0.0) / spread))
    chances: dict[int, float] = {0: 1.0}
    for value in values:
        following: dict[int, float] = defaultdict(float)
        for total, chance in chances.items():
            following[total] += chance / 2
            following[total + round(2 * value)] += chance / 2
        chances = following
    at = round(2 * positive)
    below = sum(chance for total, chance in chances.items() if total <= at)
    above = sum(chance for total, chance in chances.items() if total >= at)
    return min(1.0, 2 * min(below, above))


def score_limit(gained: float, lost: float, size: float) -> float:
    """Return the largest difference of two paired shares within Tango's score interval (1998)."""
    tiny = 1e-12

    def failing(difference: float) -> float:
        """Return the most likely share of flips to failure: the root of the likelihood's derivative."""

        def slope(share: float) -> float:
            kept = 1 - difference - 2 * share
            return gained / (share + difference) + lost / share - 2 * (1 - gained - lost) / kept

        low, high = max(0.0, -difference) + tiny, (1 - difference) / 2 - tiny
        return low if slope(low) <= 0 else high if slope(high) >= 0 else float(brentq(slope, low, high))

    def excess(difference: float) -> float:
        variance = 2 * failing(difference) + difference * (1 - difference)
        return size * (gained - lost - difference) ** 2 - Z**2 * variance

    nearest, last = min(gained - lost + 1e-9, 1 - 1e-9), 1 - 1e-9
    return 1.0 if excess(last) <= 0 else float(brentq(excess, nearest, last))


class Pairs:
    """Runs of two configurations of a batch on the same problems."""

    def __init__(self, raw: RawRuns, configs: Sequence[str]) -> None:
        sides = [
            {(one.scenario_id, one.problem_id): one for one in raw.records if one.config_id == config}
            for config in configs
        ]
        shared = sorted(sides[0].keys() & sides[1].keys())
        both = [(sides[0][key], sides[1][key]) for key in shared]
        self.unpaired = len(sides[0]) + len(sides[1]) - 2 * len(both)
        self.pairs = [pair for pair in both if "invalid" not in (pair[0].outcome, pair[1].outcome)]
        self.invalid = len(both) - len(self.pairs)
        self.flips = [(one.scenario_id, float(goal(other) - goal(one))) for one, other in self.pairs]

    def count(self, before: bool, after: bool) -> int:
        """Count the pairs with runs that reached the goal before, and after, or not."""
        return sum((goal(one), goal(other)) == (before, after) for one, other in self.pairs)

    def success(self) -> dict[str, float]:
        """Return difference and interval in points, p, and the number of scenarios that would show ten points."""
        of, totals = len(self.flips), dict[str, float]()
        for name, flip in self.flips:
            totals[name] = totals.get(name, 0.0) + flip
        lost, gained = self.count(before=True, after=False) / of, self.count(before=False, after=True) / of
        size = worth(self.flips, gained - lost, gained + lost - (gained - lost) ** 2)
        low, high = -score_limit(lost, gained, size), score_limit(gained, lost, size)
        sizes = [abs(total) for total in totals.values() if total]
        positive = sum(total for total in totals.values() if total > 0)
        p = sign_flip_p(sizes, positive)
        if set(sizes) == {1.0}:
            p = float(binomtest(round(positive), len(sizes), 0.5).pvalue)
        if p >= 0.05:
            low, high = min(low, 0.0), max(high, 0.0)
        share = max(gained + lost, 0.1)
        needed = (Z * math.sqrt(share) + norm.ppf(0.8) * math.sqrt(share - 0.01)) ** 2 / 0.01
        return {
            "difference": 100 * (gained - lost),
            "low": 100 * max(low, -1),
            "high": 100 * min(high, 1),
            "p": p,
            "needed": math.ceil(needed),
            "scenarios": len(totals),
            "differing": len(sizes),
        }

    def values(self, name: str) -> list[tuple[str, float, float]]:
        """Return scenario, value before and after, for the pairs over which the metric is compared."""
        found = []
        for one, other in self.pairs:
            before, after = metric(one, name), metric(other, name)
            counted = METRICS[name][1] == "valid" or (goal(one) and goal(other))
            if counted and before is not None and after is not None:
                found.append((one.scenario_id, float(before), float(after)))
        return found

    def tested(self, name: str) -> dict[str, float] | None:
        """Return Wilcoxon's test on the means of scenarios with shift, interval and effect; None without pairs."""
        tolerance, groups = METRICS[name][0], dict[str, list[float]]()
        values = self.values(name)
        for scenario, before, after in values:
            equal = abs(after - before) <= max(tolerance, 1e-9 * max(abs(before), abs(after)))
            groups.setdefault(scenario, []).append(0.0 if equal else after - before)
        if not values:
            return None
        means = np.array([fmean(group) for group in groups.values()])
        ranks = rankdata(np.abs(means))
        positive, negative = float(ranks[means > 0].sum()), float(ranks[means < 0].sum())
        averages = sorted((one + other) / 2 for one, other in combinations_with_replacement(means.tolist(), 2))
        low, high = _ordered_interval(averages, len(means))
        return {
            "before": median(before for _, before, _ in values),
            "after": median(after for _, _, after in values),
            "pairs": len(values),
            "scenarios": len(means),
            "higher": int((means > 0).sum()),
            "lower": int((means < 0).sum()),
            "differing": int((means != 0).sum()),
            "shift": median(averages),
            "low": low,
            "high": high,
            "effect": (positive - negative) / (positive + negative) if positive + negative else 0.0,
            "p": sign_flip_p([float(rank) for rank in ranks[means != 0]], positive),
        }

    def adjusted(self, names: Iterable[str]) -> dict[str, float]:
        """Return the adjusted p of success and of each metric: Holm's within the metrics, half of the level for either.

        Only tests with at least six differing scenarios count, because with fewer no p can be below 5 %.
        """
        success = self.success()
        families = [
            {"success": success["p"]} if success["differing"] > 5 else {},
            {name: test["p"] for name in names if (test := self.tested(name)) is not None and test["differing"] > 5},
        ]
        share = sum(bool(family) for family in families)
        return {name: min(1.0, share * p) for family in families for name, p in holm(family).items()}


def _ordered_interval(averages: Sequence[float], count: int) -> tuple[float, float]:
    """Return the distribution-free interval of the pseudomedian from the ordered Walsh averages."""
    if count < 6:
        return math.nan, math.nan
    if count <= 60:
        chances = np.ones(1)
        for rank in range(1, count + 1):
            chances = (np.pad(chances, (0, rank)) + np.pad(chances, (rank, 0))) / 2
        cut = int((np.cumsum(chances) <= 0.025).sum())
    else:
        cut = int(count * (count + 1) / 4 - Z * math.sqrt(count * (count + 1) * (2 * count + 1) / 24))
    cut = max(cut, 1)
    return averages[cut - 1], averages[-cut]


class Costs:
    """Weighted cost terms of the chosen candidates, by run."""

    def __init__(self, raw: RawRuns) -> None:
        self._raw = raw

    def terms(self, record: RunRecord, since_step: int = 0) -> dict[str, float]:
        """Return the mean of each term over the planning steps of a run; empty without any."""
        steps = self._raw.steps.get(record.run_id)
        if steps is None:
            return {}
        kept = [index for index, step in enumerate(steps.plan_steps) if step >= since_step]
        pairs = {term: [values[i] for i in kept if i < len(values)] for term, values in steps.costs.items()}
        return {term: fmean(values) for term, values in pairs.items() if values}

    def means(self, records: Sequence[RunRecord]) -> dict[str, float]:
        """Return the mean of each term over runs with equal weights."""
        found = [self.terms(record) for record in records if record.run_id in self._raw.steps]
        return {name: fmean(one.get(name, 0.0) for one in found) for name in sorted({n for one in found for n in one})}

    def median_shares(self, records: Sequence[RunRecord]) -> dict[str, float]:
        """Return the share in per cent of each term in the median of the runs that have any cost."""
        found = [terms for record in records if sum((terms := self.terms(record)).values()) > 0]
        names = sorted({name for one in found for name in one})
        return {name: median(100 * one.get(name, 0.0) / sum(one.values()) for one in found) for name in names}


def correlation(raw: RawRuns) -> dict[str, list[float]]:
    """Return for each feature Spearman's ρ, p, Holm's p, scenarios, and partial ρ and p (other features, road
    fixed).
    """
    from plannerforge.schemas.vocabulary import ROAD_KINDS

    runs: dict[str, list[RunRecord]] = {}
    for record in raw.valid:
        runs.setdefault(record.scenario_id, []).append(record)
    if len(runs) < 12:
        return {}
    success = {name: fmean(map(goal, records)) for name, records in runs.items()}
    table = {name: _features(raw, name, records) for name, records in runs.items()}
    roads = {name: next((kind for kind in ROAD_KINDS if kind in raw.facts[name].tags), "") for name in runs}
    plain: dict[str, tuple[float, float, int]] = {}
    for feature in ("obstacles", "density_per_km", "trucks_and_buses", "initial_speed_mps"):
        known = [name for name in runs if feature in table[name]]
        values = [table[name][feature] for name in known]
        if len(known) >= 12 and len(set(values)) > 1:
            found = spearmanr(values, [success[name] for name in known])
            plain[feature] = float(found.statistic), float(found.pvalue), len(known)
    adjusted = holm({feature: p for feature, (_, p, _) in plain.items()})
    known = [name for name in runs if plain.keys() <= table[name].keys()]
    counts = Counter(roads[name] for name in known)
    kinds = sorted(road for road, count in counts.items() if count >= 3)[1:]
    told = {}
    for feature, (rho, p, count) in plain.items():
        others = [[table[name][other] for name in known] for other in plain if other != feature]
        others += [[float(roads[name] == kind) for name in known] for kind in kinds]
        own = [table[name][feature] for name in known]
        left = _partial(own, [success[name] for name in known], others) if len(known) >= 12 + len(others) else []
        told[feature] = [rho, p, adjusted[feature], count, *left]
    return told


def _features(raw: RawRuns, name: str, records: Sequence[RunRecord]) -> dict[str, float]:
    facts = raw.facts[name]
    counts = facts.participants.counts
    starts = [steps.speed_mps[0] for one in records if (steps := raw.steps.get(one.run_id)) and steps.speed_mps]
    return {
        "obstacles": float(sum(counts.values())),
        "density_per_km": facts.density_per_km,
        "trucks_and_buses": float(counts.get("truck", 0) + counts.get("bus", 0)),
    } | ({"initial_speed_mps": fmean(starts)} if starts else {})


def _partial(one: Sequence[float], other: Sequence[float], held: Sequence[Sequence[float]]) -> list[float]:
    """Return Spearman's partial ρ from the inverse of the rank correlation matrix, and its p."""
    ranks = np.array([rankdata(column) for column in (one, other, *held) if len(set(column)) > 1])
    inverse = np.linalg.inv(np.corrcoef(ranks))
    left = float(-inverse[0, 1] / math.sqrt(inverse[0, 0] * inverse[1, 1]))
    degrees = len(one) - len(ranks)
    return [left, float(2 * t.sf(abs(left) * math.sqrt(degrees / (1 - left**2)), degrees))]


_LATE_BY: Mapping[str, tuple[str, ...]] = {
    "stood_late": ("stood_at_green", "stood_without_cause"),
    "waited_late": ("stood_at_red", "stood_before_red", "stood_at_light", "stood_at_stop_sign", "stood_to_give_way"),
    "held_up": ("held_up", "stood_in_queue", "stood_behind_vehicle"),
}


def late_because(raw: RawRuns, record: RunRecord, pace: Sequence[Mapping[str, Any]]) -> str:
    """Return why a run was late: the goal is out of reach, or what took most of the drive; empty if neither.

    A place is out of reach if it is farther away than a car gets on a straight line at the highest acceleration of
    CommonRoad's vehicle 2, up to the highest posted limit or the vehicle's own. A group of stretches took most of the
    drive if its sum is the largest and at least 40 %. The stretches come from the answer on the run alone;
    ``benchmarks.loop.standing`` judges these.
    """
    if record.scenario_id not in raw.files:
        return ""
    _, problems = CommonRoadFileReader(str(raw.files[record.scenario_id])).open()
    problem = problems.planning_problem_dict[record.problem_id]
    if all(_too_far(raw, record, problem.initial_state, state) for state in problem.goal.state_list):
        return "goal_out_of_reach"
    lasted_s = (len(raw.steps[record.run_id].x_m) - 1) * record.step_s
    spent = {
        name: sum(one["until_s"] - one["since_s"] for one in pace if one["code"] in codes)
        for name, codes in _LATE_BY.items()
    }
    most = max(spent, key=lambda name: spent[name])
    return most if lasted_s > 0 and spent[most] >= 0.4 * lasted_s - 1e-6 else ""


def _too_far(raw: RawRuns, record: RunRecord, start: Any, state: Any) -> bool:
    place, limits = getattr(state, "position", None), raw.facts[record.scenario_id].roads.limits_ego_kmh
    if place is None:
        return False
    speed = float(start.velocity)
    limit = max(min(max(limits) / 3.6, CAR_TOP_MPS) if limits else CAR_TOP_MPS, speed)
    time = (float(getattr(state.time_step, "end", state.time_step)) - start.time_step) * record.step_s
    fine = np.arange(0.0, time, 0.001)
    reach = 0.001 * float(np.minimum(speed + CAR_MPS2 * fine, limit).sum())
    shapes = getattr(place, "shapes", [place])
    away = min(shape.shapely_object.distance(Point(start.position)) for shape in shapes)
    return bool(away - record.ego_length_m > reach)
