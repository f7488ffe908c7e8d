"""A product that does not do what was asked, but says so, passes no check of the modification bench."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import town_road
from support.modification_bench import TRUTHS, carried_out, verdicts

from benchmarks.modification import cases as modification_cases
from benchmarks.modification.__main__ import figures_of, refusal_rows
from benchmarks.modification.cases import Case, Effort, Measured, Refusal, measure_line, several_calls_equal
from plannerforge.engine.cosimulation.driver import usual_behaviour
from plannerforge.engine.edits import rerouting as reroute
from plannerforge.engine.edits import simulation as cascade
from plannerforge.engine.edits.apply import OPERATIONS
from plannerforge.engine.edits.entries import HIT_ON_ENTRY, PLACE_TAKEN
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.evals.ground_truth.modification import edit_of
from plannerforge.schemas.errors import NotPossible, WorkerFailure
from plannerforge.schemas.modification import EditOperation
from plannerforge.workflows import modification
from plannerforge.workflows.context import WorkflowContext


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return town_road().cut(100).write(tmp_path / "ZAM_Builder-1_1_T-1.xml")


def spoil(monkeypatch: pytest.MonkeyPatch, op: EditOperation, **instead: Any) -> None:
    """Let an operation carry out its edit with other arguments than were given."""
    carry_out = OPERATIONS[op]
    spoiled = {**OPERATIONS, op: lambda edit, *rest: carry_out(edit.model_copy(update=instead), *rest)}
    monkeypatch.setattr("plannerforge.engine.edits.apply.OPERATIONS", spoiled)


def test_a_reroute_without_effect_is_seen(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reroute, "drive_along", lambda scene, plan, way, targets: replace(plan, targets=targets))
    assert not verdicts(carried_out(base, TRUTHS["T"]))["T_ends"]


def test_drivers_that_all_drive_as_usual_are_seen(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    actors = cascade.all_actors

    def usual(scene: Any, plans: Any, *rest: Any) -> Any:
        plain = {key: replace(plan, behaviour=usual_behaviour(plan.vehicle_class)) for key, plan in plans.items()}
        return actors(scene, plain, *rest)

    monkeypatch.setattr(cascade, "all_actors", usual)
    assert not verdicts(carried_out(base, TRUTHS["B"]))["B_preset"]


def test_a_result_with_only_standing_cars_is_detected(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(monkeypatch, "add_vehicle", to=[], vehicle_class="car", speed="0m/s", time_s=None)
    found = verdicts(carried_out(base, TRUTHS["P"] | {"destination_lanelet": 21}))
    assert not any(found[name] for name in ("P_class", "P_speed", "P_departure"))


def test_goals_of_one_size_at_one_time_are_seen(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(monkeypatch, "set_goal", rectangle_m=[50.0, 50.0], goal_time="<=9.9s")
    found = verdicts(carried_out(base, TRUTHS["G"]))
    assert not found["G_rectangle"]
    assert not found["G_time"]


def test_a_later_call_that_forgets_the_edits_before_it_is_seen(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edits = [edit_of(TRUTHS["B"]), edit_of(TRUTHS["R"])]
    assert several_calls_equal(base, edits)
    find = modification.one_scenario

    def without_edits(word: str, call: WorkflowContext) -> tuple[Artifact, int | None]:
        given, problem = find(word, call)
        recipe = given.recipe.model_copy(update={"arguments": {**given.recipe.arguments, "edits": []}})
        return given.model_copy(update={"recipe": recipe}), problem

    monkeypatch.setattr(modification, "one_scenario", without_edits)
    assert not several_calls_equal(base, edits)


def test_a_later_call_with_another_seed_or_id_is_seen(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edits = [edit_of(TRUTHS["B"]), edit_of(TRUTHS["R"])]
    monkeypatch.setattr(modification, "derived_benchmark_id", _counted_ids())
    assert not several_calls_equal(base, edits)


def test_several_calls_name_added_vehicles_by_their_ids(base: Path) -> None:
    added = edit_of(TRUTHS["P"])
    named = edit_of(TRUTHS["B"] | {"selector": {"by": "new", "edit": 0}})
    assert several_calls_equal(base, [added, named])


def test_a_product_that_refuses_every_composite_lowers_a_key(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"id": "c", "task": "modification_composite", "expect": "ok", "scenario": base.name}
    line = json.dumps(row | {"truth": {"edits": [TRUTHS["B"], TRUTHS["R"]]}})
    done = [measure_line(line, base.parent, Effort())]
    assert figures_of(done)["composite_done"] == 1.0
    monkeypatch.setattr(modification_cases, "apply_edits", _refuse)
    refused = [measure_line(line, base.parent, Effort())]
    assert figures_of([*done, *refused])["composite_done"] == 0.5
    assert figures_of([*done, *refused])["checks_min"] == 0.5


@pytest.mark.parametrize(
    ("error", "wrong"), [(NotPossible("no room"), 1), (WorkerFailure("SUMO stopped"), 1)], ids=["refused", "failed"]
)
def test_a_refused_reroute_that_is_possible_counts_as_failed(
    base: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, wrong: int
) -> None:
    row = {"id": "t", "task": "modification_T", "expect": "ok", "scenario": base.name}
    line = json.dumps(row | {"truth": {"edits": [TRUTHS["T"]]}})
    done = measure_line(line, base.parent, Effort())

    def fail(*_: Any) -> Any:
        raise error

    monkeypatch.setattr(modification_cases, "apply_edits", fail)
    refused = measure_line(line, base.parent, Effort())
    assert sum(one.is_right is False for one in refused.cases[0].tries) == wrong
    assert figures_of([done, refused])["T_ends"] == 0.5


def test_refused_tries_before_a_successful_one_are_counted_with_their_reasons() -> None:
    wrong, right = Refusal("T", "vehicle 5 would drive past 12", False), Refusal("T", "vehicle 6 is too fast", True)
    open_ = Refusal("P", "[not_possible] lanelet 1 at 2.5 m is taken. Valid: at=3. Next: choose another", None)
    done = Case("T", "a", tries=(wrong, right), checks={"T_ends": True}, edit_s=0.1)
    placed = Case("P", "b", tries=(open_,), checks={"P_count": True}, edit_s=0.1)
    figures = figures_of([Measured((done, placed))])
    assert figures["T_ends"] == 0.5
    assert figures["P_count"] == 1.0
    rows = refusal_rows([wrong, right, open_])
    assert rows[0] == ("tries refused T", "2, 1 of 2 judged wrongly")
    assert ("  because, T", "1 × vehicle N would drive past N") in rows
    assert ("  because, P", "1 × lanelet N at N m is taken") in rows


def _refuse(*_: Any) -> Any:
    raise NotPossible("no")


def _counted_ids() -> Any:
    made: list[str] = []

    def next_id(base_id: str, digest: str) -> str:
        made.append(digest)
        return f"{base_id.rpartition('-')[0]}-{100000000 + len(made)}"

    return next_id


@pytest.mark.parametrize(
    ("reason", "lanelet", "station_m", "is_right"),
    [
        (PLACE_TAKEN, 1, 70.0, True),
        (PLACE_TAKEN, 1, 130.0, False),
        (HIT_ON_ENTRY, 1, 85.0, True),
        (HIT_ON_ENTRY, 1, 130.0, False),
        (HIT_ON_ENTRY, 3, 215.0, False),
    ],
    ids=["taken", "free", "right before somebody", "far before somebody", "in the lane beside"],
)
def test_an_occupied_place_has_a_vehicle_on_it_or_right_behind(
    base: Path, monkeypatch: pytest.MonkeyPatch, reason: str, lanelet: int, station_m: float, is_right: bool
) -> None:
    row = {"id": "p", "task": "modification_P", "expect": "ok", "scenario": base.name}
    truth = TRUTHS["P"] | {"resolved": [{"lanelet": lanelet, "s_m": station_m}], "depart_s": 0.0}

    def refuse(*_: Any) -> Any:
        raise NotPossible(f"lanelet {lanelet} at {station_m} m is not free", reason=reason)

    monkeypatch.setattr(modification_cases, "apply_edits", refuse)
    refused = measure_line(json.dumps(row | {"truth": {"edits": [truth]}}), base.parent, Effort())
    assert [one.is_right for one in refused.cases[0].tries] == [is_right]
    done = Case("P", "done", checks={"P_count": True}, edit_s=0.1)
    assert figures_of([refused, Measured((done,))])["P_count"] == 0.5


def test_a_reroute_that_physics_forbids_is_not_a_failure_of_any_key() -> None:
    done = Case("T", "done", checks={"T_ends": True}, edit_s=0.1)
    never = Case("T", "never", "too fast", tries=(Refusal("T", "too fast", True),))
    assert figures_of([Measured((done, never))])["T_ends"] == 1.0
