"""What a planner had in mind is had by driving its run once more, and only where that gives the stored run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import Problem, town_road
from support.planning import configuration

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.runs import replay_plans, run_planner
from plannerforge.schemas.planning import Replayed, ReplayRequest, RunPlans, RunRequest, RunResponse, ShownPlan
from plannerforge.schemas.runs import RunSteps

NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))


def driven(folder: Path, name: str) -> tuple[RunRequest, RunResponse]:
    builder = replace(town_road(), problems=(NEAR,))
    path = builder.write(folder / "scenario.xml")
    config = configuration(name)
    run = RunRequest(
        run_id="run_0", scenario_path=str(path), scenario_id=builder.benchmark_id, configuration=config, seed=3
    )
    return run, run_planner(run, silent)


def replayed(folder: Path, run: RunRequest, steps: RunSteps) -> Replayed:
    stored = folder / "steps.json"
    stored.write_text(steps.model_dump_json())
    return replay_plans(ReplayRequest(run=run, steps_path=str(stored), path=str(folder / "plans.json")), silent)


def plans(found: Replayed) -> tuple[ShownPlan, ...]:
    return RunPlans.model_validate_json(Path(found.path).read_bytes()).plans


def points(line: tuple[float, ...]) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    return np.reshape(line, (-1, 2))


@pytest.mark.parametrize(
    ("name", "has_candidates"), [("frenetix:Default", True), ("mp_rbfn:Default", True), ("idm:Default", False), ("fiss:Default", True)]
)
def test_every_planning_step_has_its_plan_which_was_followed(name: str, has_candidates: bool, tmp_path: Path) -> None:
    run, response = driven(tmp_path, name)
    steps = response.steps
    shown = plans(replayed(tmp_path, run, steps))
    assert tuple(plan.step for plan in shown) == steps.plan_steps
    for plan in shown:
        here = plan.step - steps.first_step
        assert points(plan.plan)[0] == pytest.approx((steps.x_m[here], steps.y_m[here]), abs=0.006)
        if here + 2 < min(len(steps.x_m), here + run.configuration.settings.replan_steps + 1):
            assert points(plan.plan)[1] == pytest.approx((steps.x_m[here + 2], steps.y_m[here + 2]), abs=0.006)
    assert {bool(plan.candidates) for plan in shown} == {has_candidates}
    assert all(len(plan.candidates) <= 16 for plan in shown)


def test_candidates_begin_at_the_ego_and_differ(tmp_path: Path) -> None:
    run, response = driven(tmp_path, "frenetix:Default")
    first = plans(replayed(tmp_path, run, response.steps))[0]
    assert all(points(line)[0] == pytest.approx(points(first.plan)[0], abs=0.05) for line in first.candidates)
    assert len(set(first.candidates)) == len(first.candidates) > 5


def test_predictions_are_of_moving_others_nearby_alone(tmp_path: Path) -> None:
    run, response = driven(tmp_path, "frenetix:Default")
    predicted = [one for plan in plans(replayed(tmp_path, run, response.steps)) for one in plan.predictions]
    assert predicted
    assert all(np.linalg.norm(points(one)[-1] - points(one)[0]) >= 0.5 for one in predicted)


def test_run_that_comes_out_otherwise_shows_no_plans(tmp_path: Path) -> None:
    run, response = driven(tmp_path, "frenetix:Default")
    other = response.steps.model_copy(update={"x_m": (*response.steps.x_m[:-1], response.steps.x_m[-1] + 1e-6)})
    found = replayed(tmp_path, run, other)
    assert found.path == ""
    assert "drives the run otherwise" in found.note
    assert not (tmp_path / "plans.json").exists()
