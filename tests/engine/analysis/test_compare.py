"""A against B."""

import pytest
from support.runs import DEFAULT, SAFE, metrics, record, source

from plannerforge.engine.analysis.comparison import compare
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.comparison import CompareRequest, CompareResultsResult, Side
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.results import RunSource
from plannerforge.schemas.runs import Outcome


def side(label: str, runs: list[RunSource]) -> Side:
    first = runs[0].record
    run_ids = tuple(run.record.run_id for run in runs)
    return Side(label=label, config_id=first.config_id, config_name=first.config_name, run_ids=run_ids)


def compared(first: list[RunSource], second: list[RunSource], **changes: object) -> CompareResultsResult:
    sides = (side("before", first), side("after", second))
    values = {"sides": sides, "runs": (*first, *second), "configs": (DEFAULT, SAFE)} | changes
    return compare(CompareRequest.model_validate(values), silent)


def runs(outcomes: list[Outcome], config: object = DEFAULT, gaps: list[float] | None = None) -> list[RunSource]:
    distances = gaps or [2.0] * len(outcomes)
    return [
        source(record(f"ZAM_T-{n}_1_T-1", outcome, config, figures=metrics(minimum_distance_m=gap)))  # type: ignore[arg-type]
        for n, (outcome, gap) in enumerate(zip(outcomes, distances, strict=True))
    ]


def test_flips_each_way_and_what_changed() -> None:
    before = runs(["goal_reached", "collision", "collision", "goal_reached"])
    after = runs(["goal_reached", "goal_reached", "timeout", "collision"], SAFE)
    found = compared(before, after).comparisons[0]
    test = found.success
    assert (test.both, test.only_before, test.only_after, test.neither) == (1, 1, 1, 1)
    assert [flip.scenario_id for flip in found.to_success] == ["ZAM_T-1_1_T-1"]
    assert [(flip.before, flip.after) for flip in found.to_failure] == [("goal_reached", "collision")]
    changes = [(change.weight, change.before, change.after) for change in found.weights]
    assert changes == [("distance_to_obstacles", 0.0, 1.0), ("prediction", 0.2, 0.5)]


def test_few_pairs_are_said_plainly() -> None:
    found = compared(runs(["collision"] * 2), runs(["goal_reached"] * 2, SAFE))
    assert "2 pairs, 2 flipped: no test can be significant" in found.to_text()
    assert all(test.p is None for test in found.comparisons[0].metrics)
    assert "metric" not in found.comparisons[0].verdict


def test_a_single_pair_is_a_pair_and_none_is_none() -> None:
    one = compared(runs(["goal_reached"]), runs(["goal_reached"], SAFE)).comparisons[0]
    assert one.verdict.startswith("1 pair, none flipped: no test can be significant")
    none = compared(runs(["invalid"]), runs(["goal_reached"], SAFE)).comparisons[0]
    assert none.verdict == "No valid pair: nothing can be compared."


def test_equal_runs_differ_in_nothing_and_that_is_said() -> None:
    found = compared(runs(["goal_reached"] * 6), runs(["goal_reached"] * 6, SAFE)).comparisons[0]
    assert found.verdict == "No difference in success: none of 6 pairs flipped. No metric differs significantly."


def test_enough_flips_are_significant_after_holm() -> None:
    count = 20
    found = compared(runs(["collision"] * count), runs(["goal_reached"] * count, SAFE)).comparisons[0]
    assert found.success.p == pytest.approx(2 * 0.5**count)
    assert found.success.p_holm is not None
    assert found.success.p <= found.success.p_holm < 0.05
    assert "'after' reaches the goal more often" in found.verdict


def test_metric_names_the_better_side_only_where_the_interval_leaves_zero() -> None:
    gaps = [1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4]
    better = compared(runs(["goal_reached"] * 8, gaps=gaps), runs(["goal_reached"] * 8, SAFE, [g + 0.5 for g in gaps]))
    test = next(test for test in better.comparisons[0].metrics if test.name == "minimum_distance_m")
    assert (test.better, test.shift, test.effect) == ("after", pytest.approx(0.5), 1.0)
    mixed = [g + (0.5 if n % 2 else -0.5) for n, g in enumerate(gaps)]
    unclear = compared(runs(["goal_reached"] * 8, gaps=gaps), runs(["goal_reached"] * 8, SAFE, mixed))
    test = next(test for test in unclear.comparisons[0].metrics if test.name == "minimum_distance_m")
    assert test.better is None


def test_comfort_is_compared_only_where_both_reached_the_goal() -> None:
    found = compared(runs(["goal_reached", "collision"]), runs(["goal_reached", "goal_reached"], SAFE)).comparisons[0]
    pairs = {test.name: test.pairs for test in found.metrics}
    assert (pairs["duration_s"], pairs["minimum_distance_m"]) == (1, 2)
    assert "mean_total_cost" not in pairs


def test_exchanging_the_sides_mirrors_everything() -> None:
    first = runs(["goal_reached", "collision", "timeout"] * 3, gaps=[1.0, 0.0, 2.5] * 3)
    second = runs(["collision", "goal_reached", "goal_reached"] * 3, SAFE, [0.0, 1.5, 2.0] * 3)
    there = compared(first, second).comparisons[0]
    back = compared(second, first).comparisons[0]
    assert there.success.p == back.success.p
    assert there.success.difference == pytest.approx(-(back.success.difference or 0))
    assert [flip.scenario_id for flip in there.to_success] == [flip.scenario_id for flip in back.to_failure]
    for one, other in zip(there.metrics, back.metrics, strict=True):
        assert one.p == other.p
        assert (one.shift or 0) == pytest.approx(-(other.shift or 0))


def test_invalid_and_lonely_runs_are_left_out_and_counted() -> None:
    found = compared(runs(["invalid", "goal_reached", "goal_reached"]), runs(["goal_reached"] * 2, SAFE)).comparisons[0]
    assert (found.success.pairs, found.invalid_pairs, found.unpaired) == (1, 1, 1)


def test_sides_under_different_predictions_are_paired_and_the_difference_is_named() -> None:
    first = [source(record())]
    second = [source(record(prediction="ground_truth"))]
    found = compared(first, second).comparisons[0]
    assert found.success.pairs == 1
    assert found.conditions == ("prediction: constant_velocity → ground_truth",)


def test_nothing_in_common_is_refused() -> None:
    with pytest.raises(NotPossible, match="no scenario and planning problem in common"):
        compared([source(record("ZAM_A-1_1_T-1"))], [source(record("ZAM_B-1_1_T-1"))])


def test_one_side_is_refused() -> None:
    first = runs(["goal_reached"])
    with pytest.raises(NotPossible, match="nothing to be compared with"):
        compare(CompareRequest(sides=(side("only", first),), runs=tuple(first)), silent)


def test_the_same_problem_twice_on_a_side_is_refused() -> None:
    twice = [source(record()), source(record(seed=1))]
    with pytest.raises(InvalidRequest, match="which one is meant"):
        # The other side has one seed only, so the seed is no condition that differs as a whole.
        compared([*twice, source(record(config=SAFE))], runs(["goal_reached"], SAFE))
