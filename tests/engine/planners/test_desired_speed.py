"""How fast to drive: defined before, inside and after the goal's time, with its reason."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from commonroad.common.common_lanelet import LaneletType
from commonroad.scenario.lanelet import LaneletNetwork
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDZamunda
from support.planning import (
    configuration,
    drive,
    goal_state,
    lanelet_along,
    moving_car,
    network_of,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.driving.desired_speed import DesiredSpeed, ReferenceDesiredSpeed, SpeedReason
from plannerforge.engine.planners.frenetix.planner import Frenetix
from plannerforge.engine.planners.interface import EgoState, PlanningTask
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.planners.simulation import _task
from plannerforge.engine.vehicles.models import BMW_320I

USUAL_MPS = 13.89
IN_GOAL = rectangle_at(60.0, 0.0)  # from 54 to 66 m
WINDOW = (40, 60)


def task_of(*goals: Any, network: LaneletNetwork | None = None, speed_mps: float = 10.0) -> PlanningTask:
    scenario, problem = scenario_on(network or straight_road()), problem_for(*goals, speed_mps=speed_mps)
    task = _task(scenario, problem, configuration(), EgoState.of(problem.initial_state), BMW_320I)
    assert isinstance(task, PlanningTask)
    return task


def ego(step: int, x_m: float, speed_mps: float) -> EgoState:
    return EgoState(step, np.array([x_m, 0.0]), 0.0, speed_mps)


@pytest.mark.parametrize(
    ("state", "speed_mps", "reason"),
    [
        (ego(0, 0.0, 10.0), 12.0, "goal_mean"),  # 60 m in 5 s
        (ego(20, 30.0, 0.0), 5.0, "goal_mean"),  # 10 m/s, but within 5 m/s of a stand
        (ego(50, 50.0, 12.0), 10.0, "goal_end"),  # 10 m in 1 s
        (ego(50, 0.0, 0.0), 5.0, "goal_end"),
        (ego(55, 0.0, 10.0), USUAL_MPS, "goal_end"),  # 120 m/s would be on time: it does not race
        (ego(61, 40.0, 0.0), 5.0, "speed_limit"),
        (ego(61, 40.0, 10.0), USUAL_MPS, "speed_limit"),
        (ego(80, 58.0, 10.0), USUAL_MPS, "speed_limit"),  # inside, but its time is over
        (ego(20, 70.0, 10.0), USUAL_MPS, "speed_limit"),  # beyond
        (ego(20, 60.0, 4.0), 0.0, "goal_mean"),  # waits in the middle for its time
    ],
)
def test_it_is_defined_before_inside_and_after_the_window(
    state: EgoState, speed_mps: float, reason: SpeedReason
) -> None:
    desired = DesiredSpeed.of(task_of(goal_state(WINDOW, IN_GOAL)))
    assert desired.explained_at(state) == (pytest.approx(speed_mps), reason)


@pytest.mark.parametrize("position", [None, IN_GOAL])
@pytest.mark.parametrize("speed", [None, (6.0, 8.0)])
@pytest.mark.parametrize("step", [0, 39, 50, 59, 60, 61, 100])
def test_a_standing_ego_outside_its_goal_is_to_drive(position: Any, speed: Any, step: int) -> None:
    desired = DesiredSpeed.of(task_of(goal_state(WINDOW, position, speed)))
    assert desired.at(ego(step, 10.0, 0.0)) > 0.2


def test_a_speed_interval_counts_inside_the_goal_and_for_a_goal_without_a_place() -> None:
    inside = DesiredSpeed.of(task_of(goal_state(WINDOW, IN_GOAL, (6.0, 8.0))))
    assert inside.explained_at(ego(30, 60.0, 9.0)) == (7.0, "goal_interval")
    anywhere = DesiredSpeed.of(task_of(goal_state(WINDOW, speed=(6.0, 8.0))))
    assert anywhere.explained_at(ego(30, 60.0, 9.0)) == (7.0, "goal_interval")
    assert anywhere.explained_at(ego(61, 60.0, 10.0)) == (USUAL_MPS, "speed_limit")


def posted(limit_mps: float) -> LaneletNetwork:
    """A straight road with a limit from x = 80 m on."""
    x = np.linspace(-20.0, 180.0, 41)
    line = np.stack([x, np.zeros(41)], axis=1)
    network = network_of(
        lanelet_along(line[:21], 1, successor=[2]), lanelet_along(line[20:], 2, predecessor=[1], traffic_signs=set())
    )
    element = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, [str(limit_mps)])
    sign = TrafficSign(50, [element], {2}, np.array([80.0, -2.0]))
    network.add_traffic_sign(sign, {2})
    return network


def test_cruising_keeps_to_the_limit_of_the_lane() -> None:
    desired = DesiredSpeed.of(task_of(goal_state((0, 1)), network=posted(8.0)))
    assert desired.explained_at(ego(5, 0.0, 10.0)) == (pytest.approx(USUAL_MPS), "speed_limit")
    assert desired.explained_at(ego(9, 100.0, 10.0)) == (8.0, "speed_limit")


@pytest.mark.parametrize(("kind", "limit_mps"), [("urban", USUAL_MPS), ("country", 100 / 3.6), ("highway", 130 / 3.6)])
def test_without_a_posted_limit_the_type_of_the_lane_decides(kind: str, limit_mps: float) -> None:
    x = np.linspace(-20.0, 180.0, 41)
    lane = lanelet_along(np.stack([x, np.zeros(41)], axis=1), 1, lanelet_type={LaneletType(kind)})
    desired = DesiredSpeed.of(task_of(goal_state((0, 1)), network=network_of(lane)))
    assert desired.at(ego(5, 0.0, limit_mps)) == pytest.approx(limit_mps, abs=0.01)


def test_an_ego_that_begins_faster_than_usual_keeps_its_speed() -> None:
    desired = DesiredSpeed.of(task_of(goal_state((0, 1)), speed_mps=25.0))
    assert desired.explained_at(ego(5, 0.0, 24.0)) == (25.0, "speed_limit")


def test_a_curve_ahead_lowers_the_cruising_speed() -> None:
    angles = np.linspace(0.0, math.pi / 2, 16)
    curve = 10.0 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    before = np.stack([np.linspace(-100.0, -5.0, 20), np.zeros(20)], axis=1)
    after = np.stack([np.full(20, 10.0), np.linspace(15.0, 100.0, 20)], axis=1)
    network = network_of(lanelet_along(np.concatenate([before, curve, after]), 1))
    scenario, problem = scenario_on(network), problem_for(goal_state((0, 1)), position=(-80.0, 0.0))
    task = _task(scenario, problem, configuration(), EgoState.of(problem.initial_state), BMW_320I)
    assert isinstance(task, PlanningTask)
    desired = DesiredSpeed.of(task)
    assert desired.explained_at(ego(5, -80.0, 10.0))[1] == "speed_limit"
    speed_mps, reason = desired.explained_at(ego(60, -3.0, 7.0))
    assert reason == "curve"
    assert math.sqrt(4.0 * 10.0) * 0.9 < speed_mps < 10.0


def test_the_rule_of_the_reference_keeps_any_present_speed() -> None:
    desired = ReferenceDesiredSpeed.of(task_of(goal_state(WINDOW, IN_GOAL)))
    assert desired.explained_at(ego(0, 0.0, 10.0)) == (pytest.approx(12.0), "goal_mean")
    assert desired.explained_at(ego(50, 10.0, 0.0)) == (0.0, "present")
    assert desired.explained_at(ego(30, 60.0, 4.0)) == (4.0, "present")


def held_up() -> Any:
    """A car that stands 20 m ahead until 8.5 s and then drives off for good."""
    car = moving_car(7, (20.0, 0.0), (0.0, 0.0), steps=250)
    for state in car.prediction.trajectory.state_list:
        gone_s = max(state.time_step * 0.1 - 8.5, 0.0)
        state.velocity = min(4.0 * gone_s, 20.0)
        state.position = np.array([20.0 + (2.0 * gone_s**2 if gone_s < 5.0 else 50.0 + 20.0 * (gone_s - 5.0)), 0.0])
    return car


@pytest.mark.parametrize("planner", ["frenetix", "fiss", "idm", "mp_rbfn"])
def test_a_stopped_ego_drives_on_once_the_road_is_free(planner: str) -> None:
    goal = goal_state((60, 80), rectangle_at(40.0, 0.0))  # over long before the leader leaves
    scenario, problem = scenario_on(straight_road(400.0), held_up()), problem_for(goal, speed_mps=8.0)
    name = "frenetix:Default" if planner == "frenetix" else planner
    run = drive(scenario, problem, configuration(name), planner=make_planner(planner))
    stood = [state.step for state in run.states if state.speed_mps < 0.5]
    assert stood, "it had to stop"
    assert max(state.speed_mps for state in run.states[stood[0] :]) > 2.0


def test_by_the_rule_of_the_reference_a_stopped_ego_stands_forever() -> None:
    goal = goal_state((60, 80), rectangle_at(40.0, 0.0))
    scenario, problem = scenario_on(straight_road(400.0), held_up()), problem_for(goal, speed_mps=8.0)
    run = drive(scenario, problem, planner=Frenetix(desired_speed=ReferenceDesiredSpeed.of))
    assert run.final.outcome == "timeout"
    assert run.states[-1].speed_mps < 0.5


def test_a_task_without_an_aim_drives_to_the_goal_of_the_problem() -> None:
    task = replace(task_of(goal_state(WINDOW, IN_GOAL)), aim=None)
    assert DesiredSpeed.of(task).at(ego(0, 0.0, 10.0)) == pytest.approx(12.0)
