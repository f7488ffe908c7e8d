"""What a planner had in mind is had by driving its run once more, and only where that gives the stored run."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import own_planner_program
from support.builders import Problem, town_road
from support.planning import configuration

from benchmarks.loop import stepwise_program
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners import Observation, Plan, PlanningTask, planner_version, programs_named
from plannerforge.engine.planners.external.guarded import guarded
from plannerforge.engine.planners.interface import ShowsCandidates
from plannerforge.engine.planners.runs import replay_plans, run_planner
from plannerforge.schemas.errors import PlannerFailure
from plannerforge.schemas.planning import (
    CommandPlanner,
    Replayed,
    ReplayRequest,
    RunPlans,
    RunRequest,
    RunResponse,
    ShownPlan,
)
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
    ("name", "has_candidates"),
    [("frenetix:Default", True), ("mp_rbfn:Default", True), ("idm:Default", False), ("fiss:Default", True)],
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


def moved(steps: RunSteps, by_m: float) -> RunSteps:
    """The steps with the last state moved along."""
    return steps.model_copy(update={"x_m": (*steps.x_m[:-1], steps.x_m[-1] + by_m)})


def test_a_run_with_a_different_result_shows_no_plans(tmp_path: Path) -> None:
    run, response = driven(tmp_path, "frenetix:Default")
    steps = response.steps
    shorter = {name: getattr(steps, name)[:-1] for name in ("x_m", "y_m", "heading_rad", "speed_mps")}
    for other in (moved(steps, 0.02), steps.model_copy(update=shorter)):
        found = replayed(tmp_path, run, other)
        assert found.path == ""
        assert found.note
        assert not (tmp_path / "plans.json").exists()


@pytest.mark.parametrize("by_m", [1e-14, 1e-6, 0.009])
def test_a_run_that_another_machine_rounds_differently_shows_its_plans(by_m: float, tmp_path: Path) -> None:
    run, response = driven(tmp_path, "frenetix:Default")
    found = replayed(tmp_path, run, moved(response.steps, by_m))
    assert found.note == ""
    assert plans(found)


def with_programs(folder: Path, planner: CommandPlanner) -> tuple[RunResponse, Replayed]:
    with programs_named({"mine": planner}):
        run, response = driven(folder, "mine:Default")
        run = run.model_copy(update={"planner_version": planner_version("mine")})
        return response, replayed(folder, run, response.steps)


def test_a_stepwise_program_shows_its_plans_and_candidates(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        f"import json, sys; sys.path.insert(0, {str(Path(stepwise_program.__file__).parent)!r})\n"
        "from stepwise_program import say, straight_on\n"
        "for line in sys.stdin:\n"
        "    message = json.loads(line)\n"
        "    if message['type'] == 'start': say({'type': 'ready', 'protocol': 1}); continue\n"
        "    plan = straight_on(message, 0.1)\n"
        "    line = {'x_m': plan['trajectory']['x_m'], 'y_m': [y + 1 for y in plan['trajectory']['y_m']]}\n"
        "    say(plan | {'shown': [line] * 3})\n"
    )
    command = (sys.executable, "-S", str(program))
    response, found = with_programs(tmp_path, CommandPlanner(summary="x", command=command, protocol="stepwise"))
    shown = plans(found)
    assert tuple(plan.step for plan in shown) == response.steps.plan_steps
    assert {len(plan.candidates) for plan in shown} == {3}
    assert points(shown[0].candidates[0])[:, 1].tolist() == pytest.approx(1 + points(shown[0].plan)[:, 1])


def test_a_one_shot_program_shows_the_rest_of_its_trajectory(tmp_path: Path) -> None:
    command = (sys.executable, "-S", own_planner_program.__file__, "drives")
    response, found = with_programs(tmp_path, CommandPlanner(summary="x", command=command))
    shown = plans(found)
    assert tuple(plan.step for plan in shown) == response.steps.plan_steps
    assert len(points(shown[0].plan)) > len(points(shown[-1].plan)) > 1


def test_a_program_edited_since_shows_no_plans(tmp_path: Path) -> None:
    command = (sys.executable, "-S", own_planner_program.__file__, "drives")
    with programs_named({"mine": CommandPlanner(summary="x", command=command)}):
        run, response = driven(tmp_path, "mine:Default")
        with pytest.raises(PlannerFailure) as caught:
            replayed(tmp_path, run.model_copy(update={"planner_version": "another"}), response.steps)
    assert caught.value.reason == "other_version"


class Showing:
    """The planner of the series' test with candidates of which some cannot be drawn."""

    def reset(self, task: PlanningTask) -> None:
        del task

    def plan(self, observation: Observation) -> Plan:
        del observation
        return Plan(None)

    def shown_candidates(self, most: int) -> list[object]:
        return [np.zeros((3, 2)), [[0.0, 0.0], [1.0, 1.0]], np.full((2, 2), np.nan), np.zeros(4)][:most]


def test_candidates_of_a_class_are_shown_if_they_are_lines() -> None:
    planner = guarded("mine", Showing)  # type: ignore[arg-type]
    assert isinstance(planner, ShowsCandidates)
    assert [len(line) for line in planner.shown_candidates(16)] == [3, 2]
