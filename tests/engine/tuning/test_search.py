"""Searches: the space, what is drawn from what was told, objectives and bounds, and which weights matter."""

import math

import pytest

from plannerforge.engine.execution import silent
from plannerforge.engine.tuning import (
    dimensions,
    judge_gain,
    parse_constraint,
    parse_objective,
    point_of,
    preset_configuration,
    propose,
    sensitivity_design,
    sensitivity_effects,
    values_at,
)
from plannerforge.schemas.analysis.optimization import (
    DesignRequest,
    EffectsRequest,
    EvaluatedTrial,
    GainRequest,
    ProposeRequest,
    SearchMethod,
)
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.runs import Outcome, RunRecord


def _run(outcome: Outcome, jerk: float = 0.0, duration_s: float = 10.0, risk: int | None = None) -> RunRecord:
    metrics = RunMetrics.model_construct(mean_squared_jerk=jerk, duration_s=duration_s, risk_score=risk)
    return RunRecord.model_construct(outcome=outcome, metrics=metrics)


@pytest.mark.parametrize(
    ("text", "run", "score"),
    [
        ("success", _run("goal_reached"), 1.0),
        ("success*2", _run("goal_late"), 0.0),
        ("collisions*0.5", _run("collision"), -0.5),
        ("risk", _run("goal_reached", risk=4), -0.2),
        ("risk", _run("collision", risk=0), -1.0),
        ("comfort", _run("goal_reached", jerk=4.0), 0.5),
        ("comfort", _run("collision"), 0.0),
        ("time", _run("goal_reached", duration_s=10.0), -0.5),
        ("time", _run("collision", duration_s=0.1), -1.0),
    ],
)
def test_failing_early_is_neither_comfortable_nor_quick(text: str, run: RunRecord, score: float) -> None:
    assert parse_objective(text).score(run) == pytest.approx(score)


def test_a_bound_is_a_number_or_the_mean_of_the_base() -> None:
    runs, base = [_run("goal_reached"), _run("collision")], [_run("goal_reached"), _run("goal_reached")]
    assert parse_constraint("collisions<=0.5").holds(runs, base)
    assert not parse_constraint("collisions<=0.4").holds(runs, base)
    assert not parse_constraint("success >= base").holds(runs, base)
    assert parse_constraint("success>=base").holds(base, base)


@pytest.mark.parametrize("text", ["", "speed", "success*", "success-1", "collisions<=0.1"])
def test_an_invalid_objective_is_refused(text: str) -> None:
    with pytest.raises(PlannerForgeError):
        parse_objective(text)


@pytest.mark.parametrize(
    "vary", [["jurk"], ["jerk=5..2"], ["horizon_s=0..9"], ["jerk", "jerk"], ["jerk=a..b"], ["jerk*2"]]
)
def test_fixed_parameters_cannot_be_varied(vary: list[str]) -> None:
    with pytest.raises(PlannerForgeError):
        dimensions("frenetix", vary)


@pytest.mark.parametrize("name", ["frenetix", "idm"])
def test_presets_are_in_the_space_at_their_own_values(name: str) -> None:
    configuration = preset_configuration(name)
    space = dimensions(name, [])
    assert values_at(space, point_of(space, configuration)) == pytest.approx(configuration.weights)


def test_settings_are_varied_in_their_ranges_and_counts_as_integers() -> None:
    space = dimensions("frenetix", ["replan_steps=1..4", "horizon_s=2..5", "prediction=0..50"])
    assert values_at(space, (0.99, 0.5, 0.05)) == {"replan_steps": 4.0, "horizon_s": 3.5, "prediction": 0.0}
    assert values_at(space, (0.0, 0.0, 1.0)) == {"replan_steps": 1.0, "horizon_s": 2.0, "prediction": 50.0}


def _request(method: SearchMethod, rounds: tuple[tuple[EvaluatedTrial, ...], ...]) -> ProposeRequest:
    return ProposeRequest(
        method=method,
        seed=3,
        names=("a", "b"),
        start=(0.5, 0.5),
        objectives=1,
        enqueued=(EvaluatedTrial(point=(0.5, 0.5), values=(-0.5,)),),
        rounds=rounds,
        count=4,
    )


@pytest.mark.parametrize("method", ["tpe", "cmaes", "random"])
def test_any_seed_that_a_call_may_have_can_be_searched_with(method: SearchMethod) -> None:
    drawn = [
        propose(_request(method, ()).model_copy(update={"seed": seed}), silent).points
        for seed in (3, 3 + 2**32, 10**15)
    ]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]
    if method == "random":
        design = DesignRequest(method="morris", names=("a", "b"), most=20, seed=10**15)
        points = sensitivity_design(design, silent).points
        assert sensitivity_effects(EffectsRequest(design=design, values=(0.7,) * len(points)), silent).effects
        assert sensitivity_design(design.model_copy(update={"method": "sobol"}), silent).points


def _searched(method: SearchMethod, rounds: int) -> list[EvaluatedTrial]:
    """A search for the point (0.8, 0.2), played to its end."""
    told: tuple[tuple[EvaluatedTrial, ...], ...] = ()
    for _ in range(rounds):
        points = propose(_request(method, told), silent).points
        made = tuple(EvaluatedTrial(point=point, values=(-math.dist(point, (0.8, 0.2)),)) for point in points)
        told = (*told, made)
    return [trial for each in told for trial in each]


@pytest.mark.parametrize("method", ["tpe", "cmaes"])
def test_the_same_results_lead_a_search_to_the_same_candidates(method: SearchMethod) -> None:
    found = _searched(method, 12)
    assert found[:12] == _searched(method, 3)
    first, last = (max(trial.values[0] for trial in part) for part in (found[:8], found[-16:]))
    assert last > max(first, -0.15)


def test_a_search_that_is_replayed_differently_is_reported() -> None:
    other = (EvaluatedTrial(point=(0.123, 0.456), values=(0.0,)),)
    with pytest.raises(PlannerForgeError):
        propose(_request("tpe", (other,)), silent)


@pytest.mark.parametrize(("method", "most"), [("morris", 40), ("sobol", 320)])
def test_a_planted_weight_matters_and_one_without_effect_is_reported(method: str, most: int) -> None:
    design = DesignRequest.model_validate({"method": method, "names": ("much", "idle", "bit"), "most": most, "seed": 1})
    points = sensitivity_design(design, silent).points
    assert len(points) <= most
    values = tuple(float(point[0] > 0.4) + 0.05 * point[2] for point in points)
    effects = sensitivity_effects(EffectsRequest(design=design, values=values), silent).effects
    verdicts = {one.name: one.verdict for one in effects}
    assert (effects[0].name, verdicts["much"], verdicts["idle"]) == ("much", "matters", "none")


def test_no_weight_matters_if_no_result_changes() -> None:
    design = DesignRequest(method="morris", names=("a", "b"), most=20, seed=1)
    points = sensitivity_design(design, silent).points
    effects = sensitivity_effects(EffectsRequest(design=design, values=(0.7,) * len(points)), silent).effects
    assert {one.verdict for one in effects} == {"none"}


def test_a_gain_counts_scenarios_and_not_their_runs() -> None:
    one_each = judge_gain(GainRequest(differences=tuple((f"S{i}", float(i % 2)) for i in range(10))), silent)
    ten_each = judge_gain(
        GainRequest(differences=tuple((f"S{i}", float(i % 2)) for i in range(10) for _ in range(10))), silent
    )
    assert one_each == ten_each
    assert one_each.difference == pytest.approx(0.5)
    assert 0 < one_each.low < 0.5 < one_each.high < 1
