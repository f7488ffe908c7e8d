"""Correlations of scenarios' features with success: the scenario is the unit, and what goes together is told apart."""

import numpy as np
import pytest
from scipy import stats
from support.runs import SAFE, record

from plannerforge.engine.analysis.correlations import correlations
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.engine.analysis.statistics import rank_correlation
from plannerforge.schemas.results import Correlation
from plannerforge.schemas.runs import RunSource, ScenarioSource


def scenario(number: int, obstacles: int, trucks: int = 0, road: str = "") -> ScenarioSource:
    counts = {"car": obstacles - trucks, "truck": trucks}
    return ScenarioSource(scenario_id=f"ZAM_Town-{number}_1_T-1", path="", obstacles=counts, road=road)


def runs_of(scenarios: list[ScenarioSource], reached: list[bool], times: int = 1) -> RunSet:
    sources = [
        RunSource(record=record(one.scenario_id, "goal_reached" if good else "timeout", config=SAFE, seed=seed))
        for one, good in zip(scenarios, reached, strict=True)
        for seed in range(times)
    ]
    return RunSet(tuple(sources), scenarios=tuple(scenarios))


def found(runs: RunSet) -> dict[str, Correlation]:
    return {one.feature: one for one in correlations(runs)[0]}


def test_without_others_it_is_spearmans() -> None:
    generator = np.random.default_rng(1)
    rows = generator.integers(0, 9, (40, 2)).astype(float)
    expected = stats.spearmanr(rows[:, 0], rows[:, 1])
    assert rank_correlation(rows.tolist()) == pytest.approx((expected.statistic, expected.pvalue))


def test_controlling_for_one_feature_gives_the_partial_rank_correlation() -> None:
    generator = np.random.default_rng(2)
    third = generator.normal(size=60)
    rows = np.column_stack([third + generator.normal(size=60), third + generator.normal(size=60), third])
    xy, xz, yz = (stats.spearmanr(rows[:, i], rows[:, j]).statistic for i, j in ((0, 1), (0, 2), (1, 2)))
    expected = (xy - xz * yz) / np.sqrt((1 - xz**2) * (1 - yz**2))
    left = rank_correlation(rows.tolist(), 1)
    assert left is not None
    assert left[0] == pytest.approx(expected)


def test_more_runs_of_the_same_scenarios_change_no_correlation() -> None:
    scenarios = [scenario(number, 5 + number) for number in range(14)]
    reached = [number % 3 != 0 or number < 5 for number in range(14)]
    assert found(runs_of(scenarios, reached)) == found(runs_of(scenarios, reached, times=4))


def test_an_indirect_correlation_vanishes_once_the_cause_is_controlled_for() -> None:
    generator = np.random.default_rng(4)
    obstacles = generator.integers(5, 60, 80)
    trucks = np.minimum(np.rint(obstacles / 6 + generator.normal(0, 1.2, 80)).clip(0), obstacles).astype(int)
    reached = generator.random(80) < 1 / (1 + np.exp((obstacles - 30) / 5))
    scenarios = [
        scenario(i, int(count), int(large)) for i, (count, large) in enumerate(zip(obstacles, trucks, strict=True))
    ]
    told = found(runs_of(scenarios, reached.tolist()))
    assert told["trucks_and_buses"].p_holm < 0.001
    assert told["trucks_and_buses"].held_fixed == ("obstacles",)
    assert told["trucks_and_buses"].p_fixed is not None
    assert told["trucks_and_buses"].p_fixed > 0.05
    assert told["obstacles"].p_fixed is not None
    assert told["obstacles"].p_fixed < 0.01


def test_the_kind_of_road_is_controlled_for_if_there_are_several() -> None:
    scenarios = [scenario(i, 3 + i % 7 + 20 * (i % 2), road="highway" if i % 2 else "urban") for i in range(30)]
    told = found(runs_of(scenarios, [i % 2 == 0 for i in range(30)]))
    assert told["obstacles"].held_fixed == ("road",)
    assert told["obstacles"].rho < -0.8
    assert told["obstacles"].rho_fixed is None
    assert not told["obstacles"].stands
    assert told["obstacles"].left_in_words() == "; no correlation is left after controlling for road"


def test_too_few_scenarios_give_no_correlation() -> None:
    scenarios = [scenario(number, number) for number in range(1, 6)]
    listed, note = correlations(runs_of(scenarios, [True, False, True, False, True], times=5))
    assert listed == ()
    assert note[1] == {"scenarios": 5, "least_scenarios": 12}
