"""Runs in an imperfect world: what the planner gets, what the record says, and why a collision happened."""

import math
from functools import cache
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, Vehicle, driving, line
from support.planning import configuration

from plannerforge.engine.analysis.findings import find_all
from plannerforge.engine.analysis.moments import contact_of
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.runs import run_planner
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.planning import RunRequest, RunResponse
from plannerforge.schemas.runs import RunSource, ScenarioSource
from plannerforge.schemas.worlds import world_of

CYCLIST, TRUCK = 3074, 12


def hidden_crossing() -> ScenarioBuilder:
    """Return a straight lane that a cyclist crosses from behind a truck parked beside it."""
    cyclist = driving(CYCLIST, (60, -13.73), 3.0, 120, heading_rad=math.pi / 2, kind="bicycle", size_m=(1.8, 0.6))
    truck = Vehicle(TRUCK, ((52.0, -3.3, 0.0, 0.0),), "truck", 12.0, 2.5)
    problem = Problem(start=(5.0, 0.0, 0.0, 13.0), goal=(115.0, 0.0, 12.0, 3.0), steps=(60, 120))
    lane = Lane(1, line((0, 0), (260, 0)))
    return ScenarioBuilder((lane,), (cyclist,), parked=(truck,), problems=(problem,))


@cache
def carried_out(folder: Path, world: str, seed: int = 0) -> tuple[RunResponse, Path]:
    path = hidden_crossing().write(folder / "scenario.xml")
    request = RunRequest(
        run_id=f"run_{world}",
        scenario_path=str(path),
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=configuration("frenetix:Default"),
        world=world_of(world),
        seed=seed,
    )
    return run_planner(request, silent), path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("worlds")


def _runs(response: RunResponse, path: Path) -> RunSet:
    steps = path.with_name(f"{response.record.run_id}.json")
    steps.write_text(response.steps.model_dump_json(), encoding="utf-8")
    scenario = ScenarioSource(scenario_id=response.record.scenario_id, path=str(path))
    return RunSet((RunSource(record=response.record, steps_path=str(steps)),), scenarios=(scenario,))


def test_a_perfect_world_leaves_no_trace_in_what_is_stored(folder: Path) -> None:
    response, _ = carried_out(folder, "perfect")
    assert response.record.outcome != "collision"
    assert "world" not in response.record.model_dump(mode="json")
    assert "perceived" not in response.steps.model_dump(mode="json")


def test_a_cyclist_hidden_by_a_truck_is_hit_and_the_run_says_since_when_it_was_seen(folder: Path) -> None:
    response, path = carried_out(folder, "occlusion")
    assert response.record.collision is not None
    assert response.record.collision.obstacle_id == CYCLIST
    runs = _runs(response, path)
    contact = contact_of(runs, response.record)
    assert contact is not None
    assert contact.sight is not None
    assert (contact.sight.code, contact.sight.by, contact.sight.by_class) == ("occluded", TRUCK, "truck")
    assert contact.sight.since_s is not None
    assert 0 < contact.time_s - contact.sight.since_s < 1.5
    assert contact.sight.in_words(contact.other, contact.time_s) in contact.in_words()
    assert contact.laid_to == "perception"
    (unseen,) = (finding for finding in find_all(runs) if finding.name == "unseen")
    assert unseen.subject == "occluded"
    assert unseen.run_ids == (response.record.run_id,)
    assert unseen.figures["runs"] == unseen.figures["occluded"] == 1


def test_the_same_seed_gives_the_same_run_and_another_seed_another_one(folder: Path) -> None:
    first, _ = carried_out(folder, "degraded")
    carried_out.cache_clear()
    again, other = (carried_out(folder, "degraded", seed)[0] for seed in (0, 1))
    assert first.steps == again.steps
    assert other.steps.perceived != first.steps.perceived


def test_a_localisation_error_moves_the_true_drive_off_the_planned_line(folder: Path) -> None:
    response, _ = carried_out(folder, "localisation_m=0.2, localisation_s=10")
    perceived = response.steps.perceived
    assert perceived is not None
    assert len(perceived.ego_x_m) >= len(response.steps.plan_steps)
    planned_at = [step - response.steps.first_step for step in response.steps.plan_steps]
    offsets = [perceived.ego_y_m[at] - response.steps.y_m[index] for at, index in enumerate(planned_at)]
    assert 0.05 < max(map(abs, offsets)) < 1.0
    assert max(map(abs, response.steps.y_m)) > 0.02


def test_the_recorded_future_is_refused_in_an_imperfect_world(folder: Path) -> None:
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(hidden_crossing().write(folder / "scenario.xml")),
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=configuration("frenetix:Default"),
        prediction="ground_truth",
        world=world_of("occlusion"),
    )
    with pytest.raises(InvalidRequest, match="ground_truth") as refused:
        run_planner(request, silent)
    assert "lane" in refused.value.valid
