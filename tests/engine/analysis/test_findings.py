"""Every finding: when it speaks, with which evidence, and what it suggests."""

from pathlib import Path

import pytest
from support.runs import DEFAULT, SAFE, metrics, record, source

from plannerforge.engine.analysis.findings import FINDINGS, find_all
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.schemas.results import Finding
from plannerforge.schemas.runs import RunSource


def found(*runs: RunSource) -> dict[str, Finding]:
    return {finding.name: finding for finding in find_all(RunSet(runs, (DEFAULT, SAFE)))}


def test_unremarkable_runs_give_no_finding(tmp_path: Path) -> None:
    costs = {"prediction": 1.0, "velocity_offset": 1.0, "lateral_jerk": 1.0}
    assert found(source(record(), tmp_path, **costs)) == {}


def test_names_are_those_of_the_registry() -> None:
    assert len({find.__name__ for find in FINDINGS}) == len(FINDINGS)


def test_main_failure_has_both_denominators() -> None:
    runs = [source(record(f"ZAM_{n}-1_1_T-1", "collision" if n < 2 else "timeout")) for n in range(3)]
    finding = found(*runs, source(record()))["main_failure"]
    assert finding.statement == "collision: 2 of 3 failures, 2 of 4 valid runs."
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
def test_held_back_names_what_outweighs(tmp_path: Path, costs: dict[str, float], weight: str, direction: str) -> None:
    finding = found(source(record(outcome="timeout"), tmp_path, **costs))["held_back"]
    assert finding.suggestion is not None
    assert (finding.suggestion.weight, finding.suggestion.direction) == (weight, direction)


def test_rejecting_constraint_adds_up_over_runs() -> None:
    first = source(record(outcome="infeasible", rejected={"curvature": 70, "collision": 10}))
    second = source(record("ZAM_B-1_1_T-1", "infeasible", rejected={"collision": 20}))
    assert "'curvature' rejected 70 of 100" in found(first, second)["rejecting_constraint"].statement


@pytest.mark.parametrize("figure", [{"minimum_distance_m": 0.4}, {"minimum_time_to_collision_s": 1.4}])
def test_near_misses_are_successes_that_were_close(figure: dict[str, float]) -> None:
    close = source(record(figures=metrics(**figure)))
    finding = found(close, source(record("ZAM_B-1_1_T-1")))["near_misses"]
    assert "1 of 2 successes" in finding.statement
    assert finding.run_ids == (close.record.run_id,)


def test_uncomfortable_turns() -> None:
    harsh = source(record(figures=metrics(maximum_lateral_acceleration_mps2=3.4)))
    finding = found(harsh)["uncomfortable_turns"]
    assert finding.suggestion is not None
    assert finding.suggestion.weight == "lateral_jerk"


def test_dominating_cost_and_idle_weights(tmp_path: Path) -> None:
    findings = found(source(record(), tmp_path, velocity_offset=9.0, prediction=1.0))
    assert "velocity_offset is 90 % of the cost" in findings["dominating_cost"].statement
    assert findings["idle_weights"].statement.startswith("lateral_jerk of frenetix:Default")


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
    close = source(record(figures=metrics(minimum_distance_m=0.1)))
    assert find_all(RunSet((close,)))[0].suggestion is None
