"""Tests the product's statistics on batches with and without a true difference.

Each batch has 25 to 60 scenarios under two configurations, one or two predictions, and one to three planning problems.
Runs of one scenario are similar: the scenario has its own effect on success (normal on the logit scale, so that its
runs correlate by about 0.4), another under each prediction, and effects on each metric. A null batch draws both
configurations from the same distribution; in a planted batch the second has a higher logit.

Keys:

- ``false_findings_rate``: share of null batches in which the comparison states a difference.
- ``interval_coverage``: share of 95 % intervals that contain the truth of the population, over both kinds of batches:
  the mean of ``rate_coverage`` and ``difference_coverage``.
- ``false_correlations_rate``: share of null batches in which a feature is reported as correlated with success.
- ``planted_shift``: true difference in planted batches; ``power``: share of these in which it is reported.
- ``naive_findings_rate`` (McNemar), ``naive_coverage`` (Wilson): results of methods that treat runs as independent.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.analysis import analyse, compare
from plannerforge.engine.execution import silent
from plannerforge.schemas.analysis.comparison import CompareRequest, CompareResultsResult, Side
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.results import AnalyseRequest, Rate
from plannerforge.schemas.runs import Outcome, Prediction, RunRecord, RunSource, ScenarioSource

from ..harness import Figures, SeededBench, share

BATCHES, PLANTED = 1000, 300
_LOGIT, _SCENARIO, _PREDICTION, _GAIN = 1.0, 1.7, 0.6, 1.4
"""Mean, deviation of scenarios and of predictions on the logit scale; the gain of a planted configuration."""
_PREDICTIONS: tuple[Prediction, ...] = ("constant_velocity", "ground_truth")
_CONFIGS = ("cfg_a", "cfg_b")


@dataclass(frozen=True)
class _Batch:
    """Both sides of a batch, its scenarios, and the true success of each side in the population."""

    sides: tuple[tuple[RunRecord, ...], tuple[RunRecord, ...]]
    scenarios: tuple[ScenarioSource, ...]
    truth: tuple[float, float]


def _population(gain: float) -> float:
    """Return the true success over all scenarios and predictions that could be drawn."""
    effects = np.random.default_rng(1).normal(0.0, math.hypot(_SCENARIO, _PREDICTION), 400_000)
    return float((1 / (1 + np.exp(-(_LOGIT + gain + effects)))).mean())


def drawn(seed: int, count: int, gain: float) -> Iterator[_Batch]:
    """Draw a number of batches; ``gain``: of the second configuration on the logit scale."""
    truth = (_population(0.0), _population(gain))
    for number in range(count):
        yield _batch(np.random.default_rng((seed, number, round(100 * gain))), gain, truth)


def _batch(generator: np.random.Generator, gain: float, truth: tuple[float, float]) -> _Batch:
    sides: tuple[list[RunRecord], list[RunRecord]] = ([], [])
    scenarios = []
    predictions = _PREDICTIONS[: generator.integers(1, 3)]
    most_problems = int(generator.integers(1, 4))
    for index in range(int(generator.integers(25, 61))):
        name = f"ZAM_Drawn-{index + 1}_1_T-1"
        cars, trucks = (int(number) for number in generator.integers(1, 40, 2))
        scenarios.append(
            ScenarioSource(
                scenario_id=name,
                path="",
                obstacles={"car": cars, "truck": trucks},
                density_per_km=float(generator.gamma(2.0, 5.0)),
                road=("urban", "highway")[index % 2],
            )
        )
        own, level = generator.normal(0.0, _SCENARIO), generator.normal(0.0, 1.0, 4)
        for prediction in predictions:
            logit = _LOGIT + own + generator.normal(0.0, _PREDICTION)
            for problem in range(1, int(generator.integers(1, most_problems + 1)) + 1):
                for place, side in enumerate(sides):
                    chance = 1 / (1 + math.exp(-(logit + gain * place)))
                    outcome: Outcome = "goal_reached" if generator.random() < chance else "timeout"
                    side.append(_record(name, problem, prediction, place, outcome, level, generator))
    return _Batch((tuple(sides[0]), tuple(sides[1])), tuple(scenarios), truth)


def _record(
    name: str,
    problem: int,
    prediction: Prediction,
    place: int,
    outcome: Outcome,
    level: np.ndarray,
    generator: np.random.Generator,
) -> RunRecord:
    """Return a run with the metrics of its scenario, times noise with heavy tails."""
    noise = np.exp(0.6 * level + 0.2 * generator.standard_t(3, 4))
    config = _CONFIGS[place]
    return RunRecord(
        run_id=f"run_{name}_{problem}_{prediction}_{config}",
        scenario_id=name,
        problem_id=problem,
        config_id=config,
        config_name=config,
        planner="drawn",
        prediction=prediction,
        traffic="recorded",
        seed=0,
        step_s=0.1,
        outcome=outcome,
        reason="drawn",
        collision=None,
        rejected_candidates={},
        metrics=RunMetrics(
            duration_s=round(float(6.0 * noise[0]), 1),
            distance_m=50.0,
            mean_speed_mps=10.0,
            minimum_distance_m=float(2.0 * noise[1]),
            minimum_time_to_collision_s=float(4.0 * noise[2]),
            maximum_jerk_mps3=float(3.0 * noise[3]),
            mean_squared_jerk=1.0,
            maximum_lateral_acceleration_mps2=1.0,
            mean_total_cost=None,
        ),
        ego_length_m=4.5,
        ego_width_m=1.6,
    )


def _compared(batch: _Batch) -> CompareResultsResult:
    sides = tuple(
        Side(label=config, config_id=config, config_name=config, run_ids=tuple(record.run_id for record in records))
        for config, records in zip(_CONFIGS, batch.sides, strict=True)
    )
    runs = tuple(RunSource(record=record) for side in batch.sides for record in side)
    return compare(CompareRequest(sides=sides, runs=runs, scenarios=batch.scenarios), silent)


def _states_a_difference(result: CompareResultsResult) -> bool:
    """Return True if the headline states a difference, as a reader would understand it."""
    comparison = result.comparisons[0]
    is_shown = comparison.headline_code in ("better", "worse", "mixed")
    return is_shown or "these metrics differ" in comparison.verdict or any(one.better for one in comparison.metrics)


def _naive_p(result: CompareResultsResult) -> float:
    """Return McNemar's exact p with independent pairs."""
    test = result.comparisons[0].success
    flips, fewer = test.only_before + test.only_after, min(test.only_before, test.only_after)
    return float(min(1.0, 2 * sum(math.comb(flips, k) for k in range(fewer + 1)) / 2**flips))


def _naive_covers(rate: Rate, truth: float) -> bool:
    """Return True if the truth is in Wilson's interval of independent runs, that is, if its score test accepts it."""
    return abs(rate.count / rate.of - truth) <= 1.96 * math.sqrt(truth * (1 - truth) / rate.of)


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above on 1,000 null and 300 planted batches, or the bench's limit of each."""
    stated: dict[float, list[bool]] = {0.0: [], _GAIN: []}
    naive_stated: list[bool] = []
    correlated: list[bool] = []
    rates: list[bool] = []
    naive_rates: list[bool] = []
    differences: list[bool] = []
    for gain, count in ((0.0, BATCHES), (_GAIN, PLANTED)):
        for batch in drawn(bench.seed, bench.limit or count, gain):
            result = _compared(batch)
            stated[gain].append(_states_a_difference(result))
            test = result.comparisons[0].success
            if test.low is not None and test.high is not None:
                differences.append(test.low <= batch.truth[1] - batch.truth[0] <= test.high)
            second = tuple(RunSource(record=record) for record in batch.sides[1])
            analysed = analyse(AnalyseRequest(results=("drawn",), runs=second, scenarios=batch.scenarios), silent)
            seen = analysed.success
            if seen is not None and seen.low is not None and seen.high is not None:
                rates.append(seen.low <= batch.truth[1] <= seen.high)
                naive_rates.append(_naive_covers(seen, batch.truth[1]))
            if not gain:
                naive_stated.append(_naive_p(result) < 0.05)
                correlated.append(any(one.stands for one in analysed.correlations))
    coverage = (share(rates) + share(differences)) / 2
    return {
        "false_findings_rate": share(stated[0.0]),
        "interval_coverage": round(coverage, 4),
        "rate_coverage": share(rates),
        "difference_coverage": share(differences),
        "false_correlations_rate": share(correlated),
        "planted_shift": round(_population(_GAIN) - _population(0.0), 3),
        "power": share(stated[_GAIN]),
        "naive_findings_rate": share(naive_stated),
        "naive_coverage": share(naive_rates),
        "null_batches": len(stated[0.0]),
    }
