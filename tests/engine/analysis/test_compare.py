"""A against B."""

import pytest
from support.runs import DEFAULT, SAFE, metrics, record, source

from plannerforge.engine.analysis.comparison import compare
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.analysis.comparison import CompareRequest, CompareResultsResult, Lineage, Side
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.runs import Outcome, RunSource


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


def test_flips_in_each_direction_and_the_changes() -> None:
    before = runs(["goal_reached", "collision", "collision", "goal_reached"])
    after = runs(["goal_reached", "goal_reached", "timeout", "collision"], SAFE)
    found = compared(before, after).comparisons[0]
    test = found.success
    assert (test.both, test.only_before, test.only_after, test.neither) == (1, 1, 1, 1)
    assert [flip.scenario_id for flip in found.to_success] == ["ZAM_T-1_1_T-1"]
    assert [(flip.before, flip.after) for flip in found.to_failure] == [("goal_reached", "collision")]
    changes = [(change.weight, change.before, change.after) for change in found.weights]
    assert changes == [("distance_to_obstacles", 0.0, 1.0), ("prediction", 0.2, 0.5)]


def test_sides_judged_by_different_rules_are_reported() -> None:
    older = [
        run.model_copy(update={"record": run.record.model_copy(update={"success_rule": "driven@1"})})
        for run in runs(["goal_reached", "collision"])
    ]
    newer = runs(["goal_refused", "collision"], SAFE)
    told = [note for note in compared(older, newer).notes if "different success rules" in note]
    assert len(told) == 1
    assert {"driven@1", "accepted@3"} <= set(told[0].replace(";", " ").replace(",", " ").split())
    assert not compared(runs(["goal_reached", "collision"]), newer).notes


def test_few_pairs_are_stated_plainly() -> None:
    found = compared(runs(["collision"] * 2), runs(["goal_reached"] * 2, SAFE))
    assert found.comparisons[0].headline_code == "flips_too_few"
    assert found.comparisons[0].metrics_code == "untested"
    assert "2 of 2 pairs flipped to success; too few pairs for a test." in found.to_text()
    assert all(test.p is None for test in found.comparisons[0].metrics)
    assert "metric" not in found.comparisons[0].verdict


def test_pairs_of_one_and_of_zero_scenarios() -> None:
    one = compared(runs(["goal_reached"]), runs(["goal_reached"], SAFE)).comparisons[0]
    assert one.headline_code == "one_pair_same"
    assert one.verdict.startswith("same outcome: both reach the goal")
    none = compared(runs(["invalid"]), runs(["goal_reached"], SAFE)).comparisons[0]
    assert none.headline_code == "no_valid_pair"


def test_equal_runs_are_reported_to_have_no_differences() -> None:
    found = compared(runs(["goal_reached"] * 6), runs(["goal_reached"] * 6, SAFE)).comparisons[0]
    assert (found.headline_code, found.metrics_code) == ("tie", "none")
    assert found.success.needed == 77
    assert "77 scenarios" in found.verdict


def test_enough_flips_are_significant_after_holm() -> None:
    count = 20
    found = compared(runs(["collision"] * count), runs(["goal_reached"] * count, SAFE)).comparisons[0]
    assert found.success.p == pytest.approx(2 * 0.5**count)
    assert found.success.p_holm is not None
    assert found.success.p <= found.success.p_holm < 0.05
    assert found.headline_code == "better"
    assert found.verdict.startswith("Better: 20 of 20 pairs flipped to success.")


@pytest.mark.parametrize(("flips", "alone"), [(6, True), (9, False), (3, False)])
def test_an_interval_without_zero_but_no_significance_is_attributed_to_the_test(flips: int, alone: bool) -> None:
    kept = ["goal_reached"] * 8
    before = runs([*(["collision"] * flips), *kept], gaps=[1.0 + n / 10 for n in range(flips + 8)])  # type: ignore[list-item]
    after = runs([*(["goal_reached"] * flips), *kept], SAFE, gaps=[1.1 + n / 9 for n in range(flips + 8)])  # type: ignore[list-item]
    found = compared(before, after)
    test = found.comparisons[0].success
    assert test.excludes_zero_alone is alone
    assert ("for this test alone" in found.to_text()) is alone


def test_a_metric_names_the_better_side_only_if_the_interval_leaves_zero() -> None:
    gaps = [1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4]
    better = compared(runs(["goal_reached"] * 8, gaps=gaps), runs(["goal_reached"] * 8, SAFE, [g + 0.5 for g in gaps]))
    test = next(test for test in better.comparisons[0].metrics if test.name == "minimum_distance_m")
    assert (test.better, test.shift, test.effect) == ("after", pytest.approx(0.5), 1.0)
    mixed = [g + (0.5 if n % 2 else -0.5) for n, g in enumerate(gaps)]
    unclear = compared(runs(["goal_reached"] * 8, gaps=gaps), runs(["goal_reached"] * 8, SAFE, mixed))
    test = next(test for test in unclear.comparisons[0].metrics if test.name == "minimum_distance_m")
    assert test.better is None


def test_comfort_is_compared_only_if_both_reached_the_goal() -> None:
    found = compared(runs(["goal_reached", "collision"]), runs(["goal_reached", "goal_reached"], SAFE)).comparisons[0]
    pairs = {test.name: test.pairs for test in found.metrics}
    assert (pairs["duration_s"], pairs["minimum_distance_m"]) == (1, 2)
    assert "mean_total_cost" not in pairs


def test_costs_of_plans_of_other_lengths_are_not_comparable_for_that_reason() -> None:
    longer = DEFAULT.model_copy(update={"config_id": "cfg_longer", "settings": {"horizon_s": 4.0}})
    before, after = (
        [source(record(config=config, figures=metrics(mean_total_cost=cost)))]
        for config, cost in ((DEFAULT, 3.0), (longer, 8.0))
    )
    cost = compared(before, after, configs=(DEFAULT, longer)).comparisons[0].cost
    assert cost is not None
    assert "3 and 4 s" in cost.why


def test_a_vehicle_that_one_side_states_is_a_changed_setting() -> None:
    stated = DEFAULT.model_copy(update={"config_id": "cfg_stated", "settings": {"vehicle": 2}})
    found = compared(runs(["goal_reached"]), runs(["goal_reached"], stated), configs=(DEFAULT, stated))
    (change,) = found.comparisons[0].weights
    assert (change.weight, change.before, change.after) == ("vehicle", None, 2.0)


def test_incomparable_costs_are_shown_with_the_reason() -> None:
    cheap, dear = (metrics(mean_total_cost=cost) for cost in (3.0, 8.0))
    before = [source(record(figures=cheap))]
    other_weights = compared(before, [source(record(config=SAFE, figures=dear))])
    assert "mean total cost 3 → 8, not compared: the configurations use different weights" in other_weights.to_text()
    failed = compared(before, [source(record(outcome="collision", figures=dear, seed=1))], lineage=())
    assert "mean total cost 3 → 8, not compared: no pair reaches the goal on both sides" in failed.to_text()
    alike = compared(before, [source(record(figures=dear, seed=1))])
    assert alike.comparisons[0].cost is None
    assert "mean total cost 3 → 8" in alike.to_text()
    assert compared(before, [source(record(config=SAFE))], metrics=("risk_score",)).comparisons[0].cost is None


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


def test_sides_without_common_scenarios_are_refused() -> None:
    with pytest.raises(NotPossible, match=r"ZAM_A-1_1_T-1.*ZAM_B-1_1_T-1"):
        compared([source(record("ZAM_A-1_1_T-1"))], [source(record("ZAM_B-1_1_T-1"))])


def test_one_side_is_refused() -> None:
    first = runs(["goal_reached"])
    with pytest.raises(NotPossible, match="only"):
        compare(CompareRequest(sides=(side("only", first),), runs=tuple(first)), silent)


def test_the_same_problem_twice_on_a_side_is_refused() -> None:
    twice = [source(record()), source(record(seed=1))]
    with pytest.raises(InvalidRequest, match="contains both"):
        # The other side has one seed only, so the seed is no condition that differs as a whole.
        compared([*twice, source(record(config=SAFE))], runs(["goal_reached"], SAFE))


def edited(scenario_id: str, *edits: str, base: str = "ZAM_A-1_1_T-1") -> Lineage:
    return Lineage(scenario_id=scenario_id, ancestors=(base,), edits=edits)


def test_a_scenario_and_its_edited_version_are_a_pair_and_the_edit_is_reported() -> None:
    before = [source(record("ZAM_A-1_1_T-1"))]
    after = [source(record("ZAM_A-1_1_T-2", "collision"))]
    result = compared(before, after, lineage=(edited("ZAM_A-1_1_T-2", "set_speed lead (speed 10m/s)"),))
    found = result.comparisons[0]
    assert (found.success.pairs, found.edited_count, found.unpaired) == (1, 1, 0)
    assert (found.edited[0].common, found.edited[0].done) == ("ZAM_A-1_1_T-1", ("set_speed lead (speed 10m/s)",))
    assert found.to_failure[0].after_scenario_id == "ZAM_A-1_1_T-2"
    assert found.headline_code == "one_pair_worse"
    assert "- edited (ZAM_A-1_1_T-1 → ZAM_A-1_1_T-2): set_speed lead (speed 10m/s)" in result.to_text()


def test_versions_of_one_scenario_are_paired_and_differ_in_their_own_edits() -> None:
    lineage = (edited("ZAM_A-1_1_T-2", "one", "two"), edited("ZAM_A-1_1_T-3", "one", "three"))
    before, after = [source(record("ZAM_A-1_1_T-2"))], [source(record("ZAM_A-1_1_T-3"))]
    result = compared(before, after, lineage=lineage)
    pair = result.comparisons[0].edited[0]
    assert (pair.common, pair.undone, pair.done) == ("ZAM_A-1_1_T-1", ("two",), ("three",))
    words = "- edits differ (ZAM_A-1_1_T-2 → ZAM_A-1_1_T-3): two only in the first; three only in the second"
    assert words in result.to_text()


def test_the_same_scenario_is_preferred_and_several_versions_are_not_paired() -> None:
    lineage = (edited("ZAM_A-1_1_T-2", "one"), edited("ZAM_A-1_1_T-3", "two"))
    before = [source(record("ZAM_A-1_1_T-1"))]
    after = [source(record("ZAM_A-1_1_T-1", config=SAFE)), source(record("ZAM_A-1_1_T-2", config=SAFE))]
    found = compared(before, after, lineage=lineage).comparisons[0]
    assert (found.success.pairs, found.edited_count, found.unpaired) == (1, 0, 1)
    unclear = [source(record(f"ZAM_A-1_1_T-{n}", config=SAFE)) for n in (2, 3)]
    with pytest.raises(NotPossible):
        compared(before, unclear, lineage=lineage)


def test_a_single_pair_gives_directions_and_no_tests() -> None:
    first = [source(record(figures=metrics(minimum_distance_m=2.0, maximum_jerk_mps3=2.0, distance_m=50.0)))]
    better = metrics(minimum_distance_m=3.0, maximum_jerk_mps3=4.0, distance_m=51.0)
    result = compared(first, [source(record(config=SAFE, figures=better))])
    said = result.to_text()
    assert "- better in this pair: minimum distance 2 → 3 m" in said
    assert "- worse in this pair: largest jerk 2 → 4 m/s³" in said
    assert "- changed: distance driven 50 → 51 m" in said
    assert "test" not in said.replace("fastest", "")


def test_noise_of_floating_point_is_not_a_difference() -> None:
    gaps = [1.0 + n / 10 for n in range(8)]
    noisy = [gap * (1 + 1e-13) for gap in gaps]
    result = compared(runs(["goal_reached"] * 8, gaps=gaps), runs(["goal_reached"] * 8, SAFE, noisy))
    test = next(test for test in result.comparisons[0].metrics if test.name == "minimum_distance_m")
    assert (test.shift, test.p, test.better) == (0.0, 1.0, None)
    one = compared(runs(["goal_reached"], gaps=gaps[:1]), runs(["goal_reached"], SAFE, noisy[:1])).comparisons[0]
    assert {test.direction for test in one.metrics} == {"same"}


def test_metrics_that_differ_come_first_and_the_others_are_in_one_line() -> None:
    gaps = [1.0 + n / 10 for n in range(12)]
    wider = [gap + 0.5 + n / 100 for n, gap in enumerate(gaps)]
    result = compared(runs(["goal_reached"] * 12, gaps=gaps), runs(["goal_reached"] * 12, SAFE, wider))
    lines = result.to_text().splitlines()
    assert lines[2].startswith("- minimum distance: median 1.55 → 2.1 m, shift")
    assert lines[3].startswith("- medians, no significant difference: time to collision 4 s, time headway 2 s")
    assert lines[4].startswith("- runs (baseline, other): run_")
    assert len(lines) == 7


def test_planners_without_common_weights_are_not_listed_weight_by_weight() -> None:
    other = DEFAULT.model_copy(update={"config_id": "cfg_b", "weights": {f"idm_{n}": 1.0 for n in range(5)}})
    result = compared(runs(["goal_reached"]), runs(["goal_reached"], SAFE), configs=(DEFAULT, other))
    assert "weights changed: 9 weights and settings that only one of the planners has" in result.to_text()


def test_a_single_pair_gives_no_verdict_on_metrics() -> None:
    first = [source(record(figures=metrics(minimum_time_headway_s=0.8200, maximum_jerk_mps3=2.0)))]
    second = [source(record(config=SAFE, figures=metrics(minimum_time_headway_s=0.8204, maximum_jerk_mps3=3.0)))]
    said = compared(first, second).to_text()
    assert "metric" not in said.splitlines()[0]
    assert "- worse in this pair: largest jerk 2 → 3 m/s³" in said
    assert "time headway 0.82 s" in said


def test_runs_of_one_scenario_are_one_witness() -> None:
    def repeated(outcome: Outcome, config: object) -> list[RunSource]:
        return [source(record("ZAM_T-1_1_T-1", outcome, config, seed=seed)) for seed in range(8)]  # type: ignore[arg-type]

    others = ["goal_reached"] * 6
    before = [*repeated("collision", DEFAULT), *runs(others)[2:]]  # type: ignore[arg-type]
    after = [*repeated("goal_reached", SAFE), *runs(others, SAFE)[2:]]  # type: ignore[arg-type]
    test = compared(before, after).comparisons[0].success
    assert (test.pairs, test.scenarios, test.only_after, test.p) == (12, 5, 8, 1.0)
    assert test.low is not None
    assert test.low < 0


def test_a_difference_that_turns_round_between_predictions_is_reported() -> None:
    def under(prediction: str, good: int, bad: int, config: object) -> list[RunSource]:
        outcomes: list[Outcome] = ["goal_reached"] * good + ["timeout"] * bad
        return [
            source(record(f"ZAM_{prediction}-{i}_1_T-1", outcome, config, prediction=prediction))  # type: ignore[arg-type]
            for i, outcome in enumerate(outcomes)
        ]

    before = [*under("constant_velocity", 2, 8, DEFAULT), *under("ground_truth", 6, 0, DEFAULT)]
    after = [*under("constant_velocity", 9, 1, SAFE), *under("ground_truth", 4, 2, SAFE)]
    found = compared(before, after)
    (comparison,) = found.comparisons
    assert [(one.name, one.only_after, one.only_before) for one in comparison.strata] == [
        ("constant_velocity/recorded", 7, 0),
        ("ground_truth/recorded", 0, 2),
    ]
    assert "ground_truth/recorded" in comparison.verdict
    assert "constant_velocity/recorded +70 points in 10 pairs" in found.to_text()


def test_three_sides_are_ranked_and_equal_ones_share_a_rank() -> None:
    third = SAFE.model_copy(update={"config_id": "cfg_c", "name": "frenetix:Third"})
    good: list[Outcome] = ["goal_reached"] * 20
    bad: list[Outcome] = ["timeout"] * 12 + ["goal_reached"] * 8
    nearly: list[Outcome] = ["timeout"] * 2 + ["goal_reached"] * 18
    groups = [runs(bad), runs(good, SAFE), runs(nearly, third)]
    request = CompareRequest(
        sides=tuple(side(name, group) for name, group in zip(("bad", "good", "nearly"), groups, strict=True)),
        runs=tuple(run for group in groups for run in group),
    )
    found = compare(request, silent)
    assert [(one.label, one.rank, one.worse_than) for one in found.ranking] == [
        ("good", 1, ()),
        ("nearly", 1, ()),
        ("bad", 3, ("good", "nearly")),
    ]
    assert "1. good 20/20, nearly 18/20; 3. bad 8/20;" in found.to_text()


@pytest.mark.parametrize(("pairs", "is_shown"), [(20, False), (40, True)])
def test_few_pairs_without_a_flip_do_not_show_that_the_rates_are_alike(pairs: int, *, is_shown: bool) -> None:
    same = runs(["goal_reached"] * pairs)
    found = compared(same, same).comparisons[0]
    assert found.success.high is not None
    assert (found.success.high < 0.1) == is_shown
    assert ("less than 10 percentage points" in found.verdict) == is_shown


def test_differences_below_the_resolution_do_not_count() -> None:
    first = runs(["goal_reached"] * 8)
    second = runs(["goal_reached"] * 8, SAFE, gaps=[2.009] * 8)
    (metric,) = (one for one in compared(first, second).comparisons[0].metrics if one.name == "minimum_distance_m")
    assert (metric.p, metric.shift) == (1.0, 0.0)


def test_a_metric_that_differs_in_some_scenarios_only_is_not_reported_to_fall() -> None:
    gaps = [1.5] * 10 + [2.0] * 30
    found = compared(runs(["goal_reached"] * 40), runs(["goal_reached"] * 40, SAFE, gaps)).comparisons[0]
    (metric,) = (one for one in found.metrics if one.name == "minimum_distance_m")
    assert metric.p_holm is not None
    assert metric.p_holm < 0.05
    assert (metric.shift, metric.higher, metric.lower, metric.better) == (0.0, 0, 10, None)
    assert "minimum_distance_m falls" not in found.verdict
    assert "minimum distance (higher in 0, lower in 10)" in found.verdict


@pytest.mark.parametrize(
    ("before", "after", "code"),
    [
        ("ccc" + "g", "ggg" + "g", "flips_too_few"),
        ("g" * 4, "g" * 4, "tie"),
        ("c" * 5 + "g" * 200, "g" * 205, "alike"),
        ("c" * 9 + "g" * 6 + "g" * 10, "g" * 9 + "c" * 6 + "g" * 10, "no_difference_shown"),
        ("c" * 12 + "g" * 4, "g" * 16, "better"),
        ("g" * 16, "c" * 12 + "g" * 4, "worse"),
        ("c", "g", "one_pair_better"),
    ],
)
def test_the_code_of_a_headline_follows_its_flips(before: str, after: str, code: str) -> None:
    ends: dict[str, Outcome] = {"g": "goal_reached", "c": "collision"}
    first, second = ([ends[letter] for letter in side] for side in (before, after))
    found = compared(runs(first), runs(second, SAFE)).comparisons[0]
    assert found.headline_code == code
    flips = sum(one != other for one, other in zip(before, after, strict=True))
    if flips:
        assert "o difference" not in found.verdict, "flips are told as flips"
        flipped = {run for flip in (*found.to_success, *found.to_failure) for run in (flip.before_run, flip.after_run)}
        assert set(found.run_ids[:2]) <= flipped


def test_the_table_names_a_better_side_only_if_the_headline_does() -> None:
    gaps = [1.0 + n / 10 for n in range(7)]
    wider = [gap + 0.5 for gap in gaps]
    jerky = [metrics(minimum_distance_m=gap, maximum_jerk_mps3=2.0 + (-1) ** n) for n, gap in enumerate(wider)]
    second = [
        source(record(f"ZAM_T-{n}_1_T-1", "goal_reached", SAFE, figures=figures)) for n, figures in enumerate(jerky)
    ]
    found = compared(runs(["goal_reached"] * 7, gaps=gaps), second).comparisons[0]
    (metric,) = (one for one in found.metrics if one.name == "minimum_distance_m")
    assert metric.p == pytest.approx(2 * 0.5**7), "significant alone"
    assert metric.p_holm == pytest.approx(2 * 2 * 0.5**7), "with the jerk, which could have been shown as well"
    assert (metric.better, found.metrics_code) == ("after", "better")
    braking = [
        one.model_copy(
            update={"maximum_braking_mps2": 1.0 + n, "maximum_lateral_acceleration_mps2": 1.0 + (-1) ** n / 2}
        )
        for n, one in enumerate(jerky)
    ]
    third = [source(record(f"ZAM_T-{n}_1_T-1", "goal_reached", SAFE, figures=one)) for n, one in enumerate(braking)]
    found = compared(runs(["goal_reached"] * 7, gaps=gaps), third).comparisons[0]
    assert [one.name for one in found.metrics if one.better] == []
    assert found.metrics_code == "none"


def test_sides_are_compared_in_the_requested_pairs() -> None:
    good, bad = runs(["goal_reached"] * 3), runs(["collision"] * 3, SAFE)
    again = [RunSource(record=one.record.model_copy(update={"run_id": f"{one.record.run_id}_2"})) for one in good]
    worse = [RunSource(record=one.record.model_copy(update={"run_id": f"{one.record.run_id}_2"})) for one in bad]
    groups = {"A1": good, "B1": bad, "A2": again, "B2": worse}
    sides = tuple(side(label, group) for label, group in groups.items())
    sources = tuple(one for group in groups.values() for one in group)
    found = compare(CompareRequest(sides=sides, runs=sources, couples=((0, 2), (1, 3))), silent)
    assert [(one.before, one.after, one.headline_code) for one in found.comparisons] == [
        ("A1", "A2", "tie"),
        ("B1", "B2", "tie"),
    ]
    assert found.ranking == ()


def test_changed_settings_are_called_settings_and_show_their_defaults() -> None:
    longer = DEFAULT.model_copy(update={"config_id": "cfg_longer", "settings": {"horizon_s": 4.0}})
    result = compared(runs(["goal_reached"] * 2), runs(["goal_reached"] * 2, longer), configs=(DEFAULT, longer))
    change = result.comparisons[0].weights[0]
    assert (change.weight, change.before, change.after) == ("horizon_s", 3.0, 4.0)
    assert "settings changed" in result.to_text()
    assert "weights changed" not in result.to_text()


def test_only_what_was_left_out_is_counted() -> None:
    result = compared(runs(["goal_reached", "invalid"]), runs(["goal_reached", "goal_reached"], SAFE))
    (line,) = [line for line in result.to_text().splitlines() if "left out" in line]
    assert "1 pair " in line
    assert " 0 " not in line
