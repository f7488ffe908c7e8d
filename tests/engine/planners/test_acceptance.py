"""What CommonRoad's benchmark accepts, in closed form, and goals that it refuses."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commonroad.common.solution import VehicleType
from commonroad.scenario.state import KSState
from commonroad.scenario.trajectory import Trajectory
from commonroad_dc.feasibility import feasibility_checker
from commonroad_dc.feasibility.feasibility_checker import trajectory_feasibility
from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics
from support.builders import Problem, town_road
from support.planning import configuration, drive, goal_state, problem_for, rectangle_at, scenario_on, straight_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.geometry import Values
from plannerforge.engine.planners import runs
from plannerforge.engine.planners.driving.acceptance import DrivenStates, first_undrivable_step, refusal
from plannerforge.engine.planners.interface import Observation, Plan, PlannedTrajectory, PlanningTask
from plannerforge.engine.planners.runs import run_planner, run_steps
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import RunRecord

STEP_S = 0.1
_COLUMNS = ("positions", "headings_rad", "speeds_mps", "steering_rad")
ROAD = straight_road()
PROBLEM = problem_for(goal_state((30, 60), rectangle_at(45.0, 0.0)), speed_mps=9.0, position=(0.0, 0.4))


@cache
def motion() -> DrivenStates:
    """Frenetix on a straight road, from beside its middle to the goal."""
    run = drive(scenario_on(ROAD), PROBLEM, configuration())
    assert run.final.outcome == "goal_reached"
    return DrivenStates.of(run_steps(run), BMW_320I, STEP_S)


def refused(states: DrivenStates) -> str | None:
    found = refusal(states, PROBLEM.goal, ROAD, BMW_320I, STEP_S)
    return None if found is None else found.code


def feasible_by_the_checker(states: DrivenStates) -> bool:
    driven = [
        KSState(
            time_step=index,
            position=states.positions[index],
            velocity=float(states.speeds_mps[index]),
            orientation=float(states.headings_rad[index]),
            steering_angle=float(states.steering_rad[index]),
        )
        for index in range(len(states.speeds_mps))
    ]
    return trajectory_feasibility(Trajectory(0, driven), VehicleDynamics.KS(VehicleType.BMW_320i), STEP_S)[0]


def test_the_vehicle_s_own_motion_is_accepted_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    def search(*_: object) -> bool:
        raise AssertionError("no step is doubtful")

    monkeypatch.setattr(feasibility_checker, "state_transition_feasibility", search)
    assert refused(motion()) is None


@pytest.mark.parametrize("size", [0.001, 0.012, 0.03, 0.3])
@pytest.mark.parametrize("changed", ["positions", "headings_rad", "speeds_mps", "steering_rad"])
def test_the_closed_form_agrees_with_the_checker(changed: str, size: float) -> None:
    noise = np.random.default_rng(3).standard_normal(getattr(motion(), changed).shape)
    whole = replace(motion(), **{changed: getattr(motion(), changed) + size * noise})
    states = DrivenStates(*(getattr(whole, name)[:16] for name in _COLUMNS), first_step=0)
    assert (first_undrivable_step(states, BMW_320I, STEP_S) is None) == feasible_by_the_checker(states)


def test_a_motion_that_slides_sideways_is_refused_at_that_step() -> None:
    aside = np.zeros_like(motion().positions)
    aside[20:, 1] = 0.2
    found = refusal(replace(motion(), positions=motion().positions + aside), PROBLEM.goal, ROAD, BMW_320I, STEP_S)
    assert found is not None
    assert (found.code, found.index) == ("not_drivable", 19)


def test_a_motion_that_ends_before_the_goal_is_refused() -> None:
    short = DrivenStates(*(getattr(motion(), name)[:10] for name in _COLUMNS), first_step=0)
    assert refused(short) == "goal_not_met"


@pytest.mark.parametrize(
    ("moved", "code"),
    [((0.0, 0.5), None), ((0.0, 1.5), "off_lanelets"), ((-18.5, 0.0), "off_lanelets")],
    ids=["within the lane", "over its edge", "behind the end of the map"],
)
def test_a_body_that_is_partly_outside_the_lanelets_is_refused(moved: tuple[float, float], code: str | None) -> None:
    states = replace(motion(), positions=motion().positions + moved)
    region = problem_for(goal_state((0, 90), rectangle_at(40.0, 0.0, size=(120.0, 9.0)))).goal
    found = refusal(states, region, ROAD, BMW_320I, STEP_S)
    assert (None if found is None else found.code) == code


def test_lanes_side_by_side_are_one_road() -> None:
    two_lanes = straight_road(lanes=2)
    states = replace(motion(), positions=motion().positions + np.array([0.0, 1.75]))
    region = problem_for(goal_state((0, 90), rectangle_at(40.0, 0.0, size=(120.0, 9.0)))).goal
    assert refusal(states, region, two_lanes, BMW_320I, STEP_S) is None


class Slides:
    """A planner that moves to the goal while it heads elsewhere."""

    def reset(self, task: PlanningTask) -> None:
        self._step_s = task.step_s

    def plan(self, observation: Observation) -> Plan:
        ego, count = observation.ego, 16
        times: Values = np.arange(count) * self._step_s
        positions = ego.position + np.outer(times, [ego.speed_mps, 0.0])
        headings = np.full(count, 0.1)
        headings[0] = ego.heading_rad
        return Plan(PlannedTrajectory(positions, headings, np.full(count, ego.speed_mps), np.zeros(count)))


def run_of(path: Path, make: Callable[..., object] | None, monkeypatch: pytest.MonkeyPatch) -> RunRecord:
    if make is not None:
        monkeypatch.setattr(runs, "make_planner", lambda *_: make())
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=str(read_scenario(path).scenario.scenario_id),
        configuration=configuration(),
        prediction="ground_truth",
    )
    return run_planner(request, silent).record


def test_a_goal_reached_by_an_infeasible_motion_is_not_a_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    near = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(20, 60))
    path = replace(town_road(), problems=(near,)).write(tmp_path / "scenario.xml")
    record = run_of(path, None, monkeypatch)
    assert (record.outcome, record.refusal, record.success_rule) == ("goal_reached", None, "accepted@3")
    record = run_of(path, Slides, monkeypatch)
    assert (record.outcome, record.refusal) == ("goal_refused", "not_drivable")
    assert record.beyond_vehicle


def test_a_run_of_a_version_before_keeps_its_rule(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = replace(town_road(), problems=(Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(20, 60)),)).write(
        tmp_path / "scenario.xml"
    )
    stored = run_of(path, None, monkeypatch).model_dump(exclude={"success_rule", "refusal"})
    assert RunRecord.model_validate(stored).success_rule == "driven@1"


def test_a_start_outside_the_lanelets_does_not_count_against_the_planner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    behind = Problem(start=(1.0, 0.0, 0.0, 10.0), goal=(36.0, 0.0, 8.0, 3.0), steps=(20, 60))
    path = replace(town_road(), vehicles=(), problems=(behind,)).write(tmp_path / "scenario.xml")
    record = run_of(path, None, monkeypatch)
    assert (record.outcome, record.refusal) == ("goal_reached", "off_lanelets")
    record = run_of(path, Slides, monkeypatch)
    assert (record.outcome, record.refusal) == ("goal_refused", "not_drivable")
