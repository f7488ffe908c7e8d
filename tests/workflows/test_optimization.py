"""Searches for configurations: what is held out, what is found, what is taken back, and that timing changes nothing."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.harness import call_in_process
from plannerforge.engine.tuning import (
    dimensions,
    fewest_configurations,
    parse_constraint,
    parse_objective,
    preset_configuration,
)
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.analysis.optimization import OptimizePlannerArguments, StudyRecord
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.failures import FailureCell, FailureSearchRecord, FoundFailure, ShrunkFailure
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.runs import RunRecord
from plannerforge.workflows.analysis import optimization
from plannerforge.workflows.boundaries import EXPLORED_FOLDER
from plannerforge.workflows.failures import found_failures
from plannerforge.workflows.runs import Cell, CellResult
from plannerforge.workflows.scenarios import ChosenScenario

SCENARIOS = [f"DEU_Place{number % 8}-{number}_1_T-1" for number in range(24)]
Rule = Callable[[Cell, int], bool]


def _needs_small_headway(cell: Cell, number: int) -> bool:
    """Half of the scenarios are reached by a short time gap only; the other weights do nothing."""
    return number % 2 == 0 or cell.configuration.weights["time_headway_s"] < 0.8


def _always(cell: Cell, number: int) -> bool:
    del cell, number
    return True


def _never_better(cell: Cell, number: int) -> bool:
    return number % 3 != 0 and cell.configuration.weights["time_headway_s"] > 0


def _record(cell: Cell, *, reached: bool) -> RunRecord:
    return RunRecord(
        run_id=f"run_{cell.recipe().digest}",
        scenario_id=cell.scenario_id,
        problem_id=1,
        config_id=cell.configuration.config_id,
        config_name=cell.configuration.name,
        planner="idm",
        prediction=cell.prediction,
        traffic=cell.traffic,
        seed=0,
        step_s=0.1,
        outcome="goal_reached" if reached else "collision",
        reason="",
        collision=None,
        rejected_candidates={},
        metrics=RunMetrics.model_construct(mean_squared_jerk=1.0, duration_s=5.0, risk_score=3),
    )


async def _study(
    monkeypatch: pytest.MonkeyPatch, folder: Path, rule: Rule, *, backwards: bool = False, **given: Any
) -> StudyRecord:
    """A study on made runs; ``backwards``: the runs end in the opposite order."""

    async def run_grid(_: Any, cells: Sequence[Cell], __: Any) -> list[CellResult]:
        order = reversed(range(len(cells))) if backwards else range(len(cells))
        made = {
            i: CellResult(_record(cells[i], reached=rule(cells[i], SCENARIOS.index(cells[i].scenario_id))))
            for i in order
        }
        return [made[i] for i in range(len(cells))]

    async def compare_results(*_: Any) -> Any:
        success = SimpleNamespace(difference=0.5, low=0.2, high=0.8, p=0.01)
        found = SimpleNamespace(success=success, verdict="so it is", headline_code="better", run_ids=("run_a", "run_b"))
        return SimpleNamespace(comparisons=[found])

    monkeypatch.setattr(optimization, "run_grid", run_grid)
    monkeypatch.setattr(optimization, "compare_results", compare_results)
    arguments = OptimizePlannerArguments.model_validate({"max_trials": 16, "seed": 1, **given})
    chosen = [ChosenScenario(name) for name in SCENARIOS]
    roots = {name: name for name in SCENARIOS}
    (training, held_out), places, notes = optimization._divided(chosen, roots, 1)
    plan = optimization._Plan(
        arguments=arguments,
        base=preset_configuration("idm"),
        objectives=tuple(parse_objective(text) for text in arguments.objective),
        constraints=tuple(parse_constraint(text) for text in arguments.constraints),
        space=dimensions("idm", arguments.vary),
        training=training,
        held_out=held_out,
        places=places,
        roots=roots,
        notes=notes,
    )
    workspace = Workspace(folder)
    told: list[tuple[float, str]] = []
    progress: Any = SimpleNamespace(
        results=(), report=lambda *told_now: told.append(told_now), add_result=lambda _: None
    )
    search = optimization._Search(plan, call_in_process(workspace), progress)
    study = await (optimization._effects(search) if arguments.method == "morris" else search.run())
    workspace.close()
    assert study.driven <= arguments.max_trials
    assert all(0 <= share <= 1 for share, _ in told)
    return study


@pytest.mark.anyio
async def test_a_planted_better_value_is_found_and_idle_changes_are_taken_back(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    study = await _study(monkeypatch, tmp_path, _needs_small_headway, max_trials=20)
    assert [share.change.name for share in study.changes] == ["time_headway_s"]
    assert study.changes[0].change.after < 0.8
    assert study.held_out is not None
    assert study.held_out.is_better
    answer = optimization.OptimizePlannerResult(state="done", study=study, next_step="").to_text()
    assert "is better than idm:Default" in answer


@pytest.mark.anyio
async def test_the_order_in_which_runs_end_does_not_matter(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    first = await _study(monkeypatch, tmp_path / "first", _needs_small_headway)
    second = await _study(monkeypatch, tmp_path / "second", _needs_small_headway, backwards=True)
    assert first.model_dump_json() == second.model_dump_json()


@pytest.mark.anyio
@pytest.mark.parametrize("rule", [_always, _never_better])
async def test_the_base_stays_if_no_candidate_is_better(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, rule: Rule
) -> None:
    study = await _study(monkeypatch, tmp_path, rule)
    assert (study.best_id, study.held_out, study.changes) == (study.base_id, None, ())
    answer = optimization.OptimizePlannerResult(state="done", study=study, next_step="").to_text()
    assert "better than idm:Default in training" in answer


@pytest.mark.anyio
async def test_a_front_has_no_dominated_candidate(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    given = {"objective": ["success", "comfort"], "pareto": True}
    study = await _study(monkeypatch, tmp_path, _needs_small_headway, **given)
    assert study.front
    values = [member.values for member in study.front]
    assert all(len(pair) == 2 for pair in values)
    assert not any(a != b and all(x <= y for x, y in zip(a, b, strict=True)) for a in values for b in values)


@pytest.mark.anyio
async def test_a_candidate_that_breaks_a_constraint_is_never_the_best(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def rule(cell: Cell, number: int) -> bool:
        return (number % 4 != 0) == (cell.configuration.weights["time_headway_s"] < 0.8)

    free = await _study(monkeypatch, tmp_path / "free", rule)
    bound = await _study(monkeypatch, tmp_path / "bound", rule, constraints=["collisions<=0.01"])
    assert free.best_id != free.base_id
    assert bound.best_id == bound.base_id


@pytest.mark.anyio
async def test_weights_that_matter_to_the_runs_are_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    vary = ["time_headway_s", "minimum_gap_m"]
    study = await _study(monkeypatch, tmp_path, _needs_small_headway, method="morris", vary=vary, max_trials=30)
    assert [(one.name, one.verdict) for one in study.effects] == [
        ("time_headway_s", "matters"),
        ("minimum_gap_m", "none"),
    ]


@pytest.mark.anyio
@pytest.mark.parametrize("method", ["tpe", "random", "morris"])
@pytest.mark.parametrize("most", [1, 2, 3, 4, 7, 13])
async def test_no_more_configurations_are_driven_than_were_allowed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, method: str, most: int
) -> None:
    driven: set[str] = set()

    def rule(cell: Cell, number: int) -> bool:
        driven.add(f"{cell.configuration.config_id} {'ab'[SCENARIOS.index(cell.scenario_id) in held_out]}")
        return _needs_small_headway(cell, number)

    chosen = [ChosenScenario(name) for name in SCENARIOS]
    halves = optimization._divided(chosen, {name: name for name in SCENARIOS}, 1)[0]
    held_out = {SCENARIOS.index(one.scenario_id) for one in halves[1]}
    vary = ["time_headway_s", "minimum_gap_m"]
    if method == "morris":
        needed = 1 + fewest_configurations("morris", len(vary))
        if most < needed:
            with pytest.raises(InvalidRequest, match=f"needs {needed} configurations"):
                optimization._check_design("morris", len(vary), most)
            return
    study = await _study(monkeypatch, tmp_path, rule, method=method, vary=vary, max_trials=most)
    assert len(driven) <= study.driven <= most
    answer = optimization.OptimizePlannerResult(state="done", study=study, next_step="").to_text()
    assert f"of at most {most}" in answer


@pytest.mark.anyio
async def test_an_unjudged_candidate_is_not_reported_as_better(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    study = await _study(monkeypatch, tmp_path, _needs_small_headway, max_trials=3, vary=["time_headway_s=0.1..0.7"])
    assert (study.headline_code, study.held_out) == ("not_judged", None)


@pytest.mark.anyio
async def test_easy_scenarios_at_the_start_raise_no_candidate_that_was_given_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    training = optimization._divided(
        [ChosenScenario(name) for name in SCENARIOS], {name: name for name in SCENARIOS}, 1
    )[0][0]
    order = [SCENARIOS.index(one.scenario_id) for one in training]

    def rule(cell: Cell, number: int) -> bool:
        place = order.index(number) if number in order else 0
        return place < 6 and (place > 1 or cell.configuration.weights["time_headway_s"] == 1.6)

    study = await _study(monkeypatch, tmp_path, rule)
    pruned = [trial.values[0] for trial in study.trials if trial.pruned]
    assert pruned
    assert max(pruned) < study.trials[0].values[0]


def test_an_early_answer_names_the_best_so_far() -> None:
    early = optimization.OptimizePlannerResult(
        state="running", job_id="job_1", best_so_far="cfg_1", message="4 of 16 candidates", next_step="get_job"
    )
    assert early.to_text().splitlines()[:2] == ["job_1: running; 4 of 16 candidates", "Best so far: cfg_1."]


@pytest.mark.parametrize("seed", range(5))
def test_the_two_halves_share_no_place(seed: int) -> None:
    chosen = [ChosenScenario(name) for name in SCENARIOS]
    halves, places, notes = optimization._divided(chosen, {name: name for name in SCENARIOS}, seed)
    of = [{one.scenario_id.split("-")[0] for one in half} for half in halves]
    assert not of[0] & of[1]
    assert (tuple(sorted(of[0])), tuple(sorted(of[1])), notes) == (*places, ())
    assert {one.scenario_id for half in halves for one in half} == set(SCENARIOS)


def test_one_place_is_divided_by_its_maps_and_that_is_reported() -> None:
    chosen = [ChosenScenario(f"DEU_A-{number}_1_T-1") for number in (1, 1, 2)]
    halves, places, notes = optimization._divided(chosen, {one.scenario_id: one.scenario_id for one in chosen}, 0)
    assert {place for side in places for place in side} == {"DEU_A-1", "DEU_A-2"}
    assert all(halves)
    assert notes


def test_one_map_cannot_be_divided() -> None:
    with pytest.raises(NotPossible, match="one map"):
        optimization._divided([ChosenScenario("DEU_A-1_1_T-1")], {"DEU_A-1_1_T-1": "DEU_A-1_1_T-1"}, 0)


NEAR = ("ZAM_Town-1_1_T-1", "ZAM_Town-1_1_T-2", "ZAM_Town-1_1_T-3")
"""Scenarios made from one base."""


def test_failures_near_one_base_are_divided_by_their_strata() -> None:
    chosen = [ChosenScenario(name) for name in NEAR]
    strata = dict(zip(NEAR, ("car 3 brakes", "cyclist crosses", "car 3 brakes"), strict=True))
    halves, places, notes = optimization._divided(chosen, dict.fromkeys(NEAR, NEAR[0]), 0, strata)
    of = [{strata[one.scenario_id] for one in half} for half in halves]
    assert sorted(len(half) for half in halves) == [1, 2]
    assert not of[0] & of[1]
    assert {name for side in places for name in side} == set(strata.values())
    assert notes


def test_failures_of_one_stratum_cannot_be_divided() -> None:
    chosen = [ChosenScenario(name) for name in NEAR]
    with pytest.raises(NotPossible, match="one map"):
        optimization._divided(chosen, dict.fromkeys(NEAR, NEAR[0]), 0, dict.fromkeys(NEAR, "car 3 brakes"))


def test_the_strata_of_found_failures_are_those_of_their_search(tmp_path: Path) -> None:
    context = call_in_process(Workspace(tmp_path / "workspace"))
    cell = FailureCell(counterpart="car 3 brakes", contact="rear_end", speed="fast")
    small = ShrunkFailure(
        scenario_id=NEAR[1], run_id="run_2", edits=(), road_users_before=3, road_users=1, needed=(), runs=4
    )
    failure = FoundFailure(
        scenario_id=NEAR[0],
        run_id="run_1",
        cell=cell,
        change="car 3 brakes",
        values={},
        edits=(),
        reason="collided",
        time_s=1.0,
        prevented_by=(),
        found_after=3,
        hits=1,
        shrunk=small,
    )
    record = FailureSearchRecord(
        base_id="ZAM_Town-1_1_T-9",
        config_id="cfg",
        config_name="idm",
        runs=4,
        implausible=0,
        unavoidable=0,
        strata=("car 3 brakes",),
        failures=(failure,),
    )
    folder = context.workspace.root / EXPLORED_FOLDER
    folder.mkdir(parents=True)
    (folder / "1_found.json").write_text(record.model_dump_json())
    (folder / "2_found.json").write_text("{")
    assert found_failures(context) == dict.fromkeys(NEAR[:2], cell)
    roots = dict.fromkeys(NEAR, "ZAM_Town-1_1_T-9")
    found = [ChosenScenario(name) for name in NEAR[:2]]
    assert optimization._strata(found, roots, context) == dict.fromkeys(NEAR[:2], "car 3 brakes")
    assert optimization._strata([*found, ChosenScenario(NEAR[2])], roots, context) is None
