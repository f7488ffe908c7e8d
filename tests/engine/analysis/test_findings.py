"""Every finding: when it speaks, with which evidence, and what it suggests."""

from pathlib import Path
from unittest.mock import Mock

import pytest
from support.builders import ScenarioBuilder, town_road
from support.runs import DEFAULT, SAFE, driven, metrics, record, source

from plannerforge.engine.analysis.findings import FINDINGS, find_all
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.engine.planners.fiss.core import costs_of
from plannerforge.engine.tuning import tuning_of
from plannerforge.schemas.results import ConfigWeights, Finding
from plannerforge.schemas.runs import DrivenObstacle, RunSource, ScenarioSource


def found(*runs: RunSource) -> dict[str, Finding]:
    return {finding.name: finding for finding in find_all(RunSet(runs, (DEFAULT, SAFE)))}


def test_unremarkable_runs_give_no_finding(tmp_path: Path) -> None:
    costs = {"prediction": 1.0, "velocity_offset": 1.0, "lateral_jerk": 1.0}
    assert found(source(record(), tmp_path, **costs)) == {}


def test_names_match_the_registry() -> None:
    assert len({find.__name__ for find in FINDINGS}) == len(FINDINGS)


def test_every_finding_names_a_moment_of_each_of_its_runs(tmp_path: Path) -> None:
    outcomes = ("collision", "timeout", "goal_late", "infeasible", "goal_reached")
    runs = [
        source(record(f"ZAM_{n}-1_1_T-1", outcomes[n % 5], config), tmp_path, velocity_offset=9.0)  # type: ignore[arg-type]
        for n in range(10)
        for config in (DEFAULT, SAFE)
    ]
    findings = find_all(RunSet(tuple(runs), (DEFAULT, SAFE)))
    assert len({one.name for one in findings}) >= 4
    for finding in findings:
        assert {moment.run_id for moment in finding.moments} >= set(finding.run_ids), finding.name


def test_main_failure_has_both_denominators() -> None:
    runs = [source(record(f"ZAM_{n}-1_1_T-1", "collision" if n < 2 else "timeout")) for n in range(3)]
    finding = found(*runs, source(record()))["main_failure"]
    assert finding.statement == "collision in 2 of 3 failures and 2 of 4 valid runs."
    assert finding.run_ids == tuple(run.record.run_id for run in runs[:2])


def test_weak_obstacle_cost_suggests_the_prediction_weight(tmp_path: Path) -> None:
    weak = source(record(outcome="collision"), tmp_path, prediction=0.05, velocity_offset=5.0)
    finding = found(weak)["weak_obstacle_cost"]
    assert finding.suggestion is not None
    assert (finding.suggestion.weight, finding.suggestion.direction) == ("prediction", "raise")
    assert "1 of 1 collisions" in finding.statement
    strong = source(record("ZAM_B-1_1_T-1", "collision"), tmp_path, prediction=5.0, velocity_offset=5.0)
    assert "weak_obstacle_cost" not in found(strong)


@pytest.mark.parametrize(
    ("costs", "weight", "direction"),
    [
        ({"velocity_offset": 6.0, "prediction": 4.0}, "velocity_offset", "raise"),
        ({"velocity_offset": 4.0, "prediction": 6.0}, "prediction", "lower"),
    ],
)
def test_held_back_names_the_largest_term(tmp_path: Path, costs: dict[str, float], weight: str, direction: str) -> None:
    finding = found(source(record(outcome="timeout"), tmp_path, **costs))["held_back"]
    assert finding.suggestion is not None
    assert (finding.suggestion.weight, finding.suggestion.direction) == (weight, direction)


def test_the_rejecting_constraint_is_that_of_most_runs_and_no_run_decides_alone() -> None:
    many = source(record(outcome="infeasible", rejected={"curvature": 7000, "collision": 10}))
    few = [
        source(record(f"ZAM_{letter}-1_1_T-1", "infeasible", rejected={"collision": 20, "curvature": 10}))
        for letter in "BC"
    ]
    finding = found(many, *few)["rejecting_constraint"]
    assert (finding.subject, finding.figures["runs"], finding.figures["of"]) == ("collision", 2, 3)
    assert round(finding.figures["median_share"], 2) == 0.67
    assert "rejecting_constraint" not in found(many, few[0])


EGO_M = 40.0
"""Where the ego of a made run begins; it drives along the x axis at 10 m/s."""


def close_run(folder: Path, other: DrivenObstacle, gap: float, scenario_id: str = "ZAM_Town-1_1_T-1") -> RunSource:
    figures = metrics(minimum_distance_m=gap, minimum_time_to_collision_s=None)
    return source(record(scenario_id, figures=figures), folder, (other,))


def test_near_misses_are_only_those_that_the_ego_caused(tmp_path: Path) -> None:
    gap = 0.4
    ahead = driven(EGO_M + (4.508 + 4.5) / 2 + gap, 0.0, 10.0)
    behind = driven(EGO_M - (4.508 + 4.5) / 2 - gap, 0.0, 10.0)
    beside = driven(EGO_M, (1.61 + 1.8) / 2 + gap, 10.0)
    finding = found(close_run(tmp_path, ahead, gap), source(record("ZAM_B-1_1_T-1")))["near_misses"]
    assert "In 1 of 2 successes" in finding.statement
    assert finding.suggestion is not None
    for other in (behind, beside):
        assert "near_misses" not in found(close_run(tmp_path, other, gap))
    both = found(close_run(tmp_path, ahead, gap), close_run(tmp_path, behind, gap, "ZAM_B-1_1_T-1"))["near_misses"]
    assert (both.figures["runs"], both.figures["of"], both.figures["by_others"]) == (1, 2, 1)


def test_late_runs_are_attributed_to_a_slower_vehicle_within_the_time_gap_of_followers(tmp_path: Path) -> None:
    late = record(outcome="timeout", figures=metrics(duration_s=4.0))
    road = ScenarioBuilder(town_road().lanes).write(tmp_path / "road.xml")
    scenarios = (ScenarioSource(scenario_id=late.scenario_id, path=str(road)),)

    def names(other: DrivenObstacle) -> dict[str, Finding]:
        run = source(late, tmp_path, (other,), velocity_offset=5.0)
        return {one.name: one for one in find_all(RunSet((run,), (DEFAULT,), scenarios))}

    held_up = names(driven(EGO_M + 25.0, 0.0, 5.0))
    assert held_up["held_up"].run_ids == (late.run_id,)
    assert [(one.run_id, one.code) for one in held_up["held_up"].moments] == [(late.run_id, "held_up")]
    assert "held_back" not in held_up
    assert "held_up" not in names(driven(EGO_M + 25.0, 5.0, 5.0))  # on the lane beside
    assert "held_up" not in names(driven(EGO_M + 50.0, 0.0, 8.0))  # too far ahead


def test_a_disabled_weight_is_named_if_runs_fail_in_what_it_penalises() -> None:
    known = {"prediction": 0.2, "velocity_offset": 1.0}
    off = DEFAULT.model_copy(update={"weights": {**known, "velocity_offset": 0.0}, "default_weights": known})
    late = [source(record(f"ZAM_{n}-1_1_T-1", "timeout")) for n in range(2)]
    good = [source(record(f"ZAM_G{n}-1_1_T-1")) for n in range(8)]

    def names(runs: list[RunSource], config: ConfigWeights = off) -> list[str]:
        return [one.name for one in find_all(RunSet(tuple(runs), (config,)))]

    assert "weight_off" in names([*late, *good])
    assert "weight_off" not in names(good)
    assert "weight_off" not in names([*late, *good], off.model_copy(update={"weights": known}))
    hits = [source(record(f"ZAM_H{n}-1_1_T-1", "collision")) for n in range(3)]
    assert "weight_off" not in names([*hits, *good])


def groups(with_truck: str, without: str) -> tuple[RunSource, ...]:
    return tuple(
        source(record(f"ZAM_{kind}{n}-1_1_T-1", "goal_reached" if letter == "g" else "timeout"))
        for kind, letters in (("T", with_truck), ("C", without))
        for n, letter in enumerate(letters)
    )


def test_a_class_is_harder_only_beyond_chance() -> None:
    def names(runs: tuple[RunSource, ...]) -> dict[str, Finding]:
        scenarios = tuple(
            ScenarioSource(
                scenario_id=run.record.scenario_id,
                path="",
                obstacles={"car": 2} | ({"truck": 1} if "_T" in run.record.scenario_id[:5] else {}),
            )
            for run in runs
        )
        return {one.name: one for one in find_all(RunSet(runs, scenarios=scenarios))}

    finding = names(groups("tttttttg", "gggggggggggg"))["harder_group"]
    figures = finding.figures
    assert (finding.subject, figures["reached"], figures["of"]) == ("truck", 1, 8)
    assert (figures["reached_by_others"], figures["of_others"]) == (12, 12)
    assert len(finding.run_ids) == 7
    assert "harder_group" not in names(groups("ttgggggg", "gggggggggggt"))


def test_one_run_does_not_decide_the_dominating_cost(tmp_path: Path) -> None:
    crash = source(record("ZAM_X-1_1_T-1", "collision"), tmp_path, prediction=9000.0, velocity_offset=1.0)
    usual = [
        source(record(f"ZAM_{n}-1_1_T-1"), tmp_path, prediction=1.0, velocity_offset=1.0, lateral_jerk=1.0)
        for n in range(4)
    ]
    assert "dominating_cost" not in found(crash, *usual)


def test_every_finding_with_a_suggestion_states_alternatives(tmp_path: Path) -> None:
    weak = source(record(outcome="collision"), tmp_path, prediction=0.05, velocity_offset=5.0)
    harsh = source(record("ZAM_B-1_1_T-1", figures=metrics(maximum_lateral_acceleration_mps2=3.4)))
    told = [one for one in found(weak, harsh).values() if one.suggestion is not None]
    assert len(told) == 2
    assert all(one.alternatives for one in told)


def test_uncomfortable_turns() -> None:
    harsh = source(record(figures=metrics(maximum_lateral_acceleration_mps2=3.4)))
    finding = found(harsh)["uncomfortable_turns"]
    assert finding.suggestion is not None
    assert finding.suggestion.weight == "lateral_jerk"


def test_dominating_cost_and_idle_weights(tmp_path: Path) -> None:
    findings = found(source(record(), tmp_path, velocity_offset=9.0, prediction=1.0))
    assert "velocity_offset is 90% of the cost in the median run" in findings["dominating_cost"].statement
    assert findings["idle_weights"].statement.startswith("lateral_jerk of frenetix:Default")


def test_a_parameter_that_is_not_a_cost_weight_is_not_called_idle(tmp_path: Path) -> None:
    run = source(record(), tmp_path, velocity_offset=9.0, prediction=1.0)
    declared = DEFAULT.model_copy(update={"parameters": ("lateral_jerk",)})
    assert "idle_weights" not in {one.name for one in find_all(RunSet((run,), (declared,)))}


def test_a_weight_with_a_differently_named_term_is_not_called_idle(tmp_path: Path) -> None:
    run = source(record(), tmp_path, velocity_offset=9.0, prediction=1.0)
    declared = DEFAULT.model_copy(update={"terms": {"lateral_jerk": "prediction"}})
    assert "idle_weights" not in {one.name for one in find_all(RunSet((run,), (declared,)))}


def test_limits_of_fiss_are_not_weights_and_each_weight_has_its_term() -> None:
    recorded = costs_of(Mock()).keys()
    weights = tuning_of("fiss").weights
    assert {weight.term or name for name, weight in weights.items() if weight.of_cost} == recorded
    limits = {"reaction_time_s", "least_gap_m", "least_headway_s", "least_time_to_collision_s", "crossing_gap_s"}
    assert not any(weights[name].of_cost for name in limits)


def test_weights_of_a_planner_with_other_names_of_terms_are_not_called_idle(tmp_path: Path) -> None:
    run = source(record(), tmp_path, comfort=9.0, safety=1.0)
    assert "idle_weights" not in found(run)


def test_a_scenario_is_hard_only_if_every_configuration_failed() -> None:
    both = [source(record("ZAM_A-1_1_T-1", "collision", config)) for config in (DEFAULT, SAFE)]
    one = [
        source(record("ZAM_B-1_1_T-1", outcome, config))
        for outcome, config in (("timeout", DEFAULT), ("goal_reached", SAFE))
    ]  # type: ignore[arg-type]
    finding = found(*both, *one)["hard_scenarios"]
    assert "1 of 2 scenarios" in finding.statement
    assert "ZAM_A-1_1_T-1" in finding.statement
    assert "hard_scenarios" not in found(both[0])


def test_a_suggestion_needs_a_known_weight() -> None:
    harsh = source(record(figures=metrics(maximum_lateral_acceleration_mps2=3.4)))
    assert find_all(RunSet((harsh,)))[0].suggestion is None


def test_every_finding_has_a_moment_of_each_of_its_runs(tmp_path: Path) -> None:
    runs = [source(record(f"ZAM_{n}-1_1_T-1", "timeout"), tmp_path, velocity_offset=6.0) for n in range(2)]
    runs += [source(record("ZAM_C-1_1_T-1", "collision"), tmp_path, prediction=0.05, velocity_offset=5.0)]
    for finding in found(*runs).values():
        assert {one.run_id for one in finding.moments} == set(finding.run_ids), finding.name


def test_refused_motions_at_the_goal_are_explained_by_the_benchmark() -> None:
    refused = [
        record(outcome="goal_refused", config=config).model_copy(update={"refusal": "not_drivable"})
        for config in (DEFAULT, SAFE)
    ]
    results = found(*map(source, refused))
    hard = results["hard_scenarios"]
    assert "describe_scenario" not in hard.next_step
    assert refused[0].run_id in hard.next_step
    assert "benchmark" in hard.alternatives
    main = found(source(refused[0]))["main_failure"]
    assert "not drivable" in main.statement
    assert "animation" not in main.next_step
