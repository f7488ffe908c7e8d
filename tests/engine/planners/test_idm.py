"""The lane-following baseline: what it does about others, its goal and its path."""

from typing import Any

import numpy as np
import pytest
from support.planning import (
    FAR,
    configuration,
    drive,
    drive_on_road,
    goal_state,
    moving_car,
    parked_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
    task_on_road,
)

from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.planners.external.conformance import check_planner
from plannerforge.engine.planners.idm import IntelligentDriver
from plannerforge.engine.planners.interface import Observation, PlanningTask
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.vehicles.models import BMW_320I

ORIGIN = np.zeros(2)


def driven(*obstacles: Any, name: str = "idm", changes: tuple[str, ...] = (), **options: Any) -> Any:
    return drive_on_road(IntelligentDriver(), configuration(name, *changes), *obstacles, **options)


def task_for(speed: float, *obstacles: Any, goal: Any = FAR) -> tuple[PlanningTask, Observation]:
    return task_on_road(configuration("idm"), speed, *obstacles, goal=goal)


@pytest.mark.parametrize("speed", [0.0, 1.0, 10.0])
def test_it_keeps_the_contract(speed: float) -> None:
    for goal in (FAR, goal_state((40, 60), rectangle_at(60.0, 3.5))):
        task, observation = task_for(speed, parked_car(7, (40.0, 0.0)), goal=goal)
        assert check_planner(lambda: make_planner("idm"), task, observation) == ()


def test_the_acceleration_is_that_of_the_formula() -> None:
    """a·[1 − (v/v0)⁴ − (s*/s)²] with a = 0.73, b = 1.67, T = 1.6, s0 = 2 and v0 = 50 km/h, for one state by hand."""
    task, observation = task_for(10.0, moving_car(7, (40.0, 0.0), (6.0, 0.0)), goal=goal_state((60, 60)))
    planner = IntelligentDriver()
    planner.reset(task)
    trajectory = planner.plan(observation).trajectory
    assert trajectory is not None
    gap = 40.0 - (4.5 + 0.5) / 2 - 4.508 / 2
    wanted = 2.0 + 10.0 * 1.6 + 10.0 * (10.0 - 6.0) / (2 * (0.73 * 1.67) ** 0.5)
    free = 0.73 * (1 - (10.0 / 13.89) ** 4)
    assert trajectory.accelerations_mps2[1] == pytest.approx(free - 0.73 * (wanted / gap) ** 2, rel=1e-6)


def test_it_stops_behind_a_standing_car_and_keeps_its_gap() -> None:
    run = driven(parked_car(7, (60.0, 0.0)))
    assert run.final.outcome == "timeout"
    assert run.states[-1].speed_mps < 0.05
    gap = 60.0 - 2.25 - BMW_320I.length_m / 2 - run.states[-1].position[0]
    assert gap == pytest.approx(2.0, abs=0.6)


def test_it_follows_a_slower_car_at_its_headway() -> None:
    run = driven(moving_car(7, (25.0, 0.0), (5.0, 0.0), 200))
    state = run.states[90]
    gap = 25.0 + 5.0 * 9.0 - 2.25 - BMW_320I.length_m / 2 - state.position[0]
    assert state.speed_mps == pytest.approx(5.0, abs=0.3)
    assert gap == pytest.approx(2.0 + 5.0 * 1.6, abs=2.0)


def test_it_yields_to_a_cut_in_and_lets_a_neighbour_drive() -> None:
    beside = driven(moving_car(7, (10.0, 3.5), (8.0, 0.0), 200), lanes=2)
    cutting_in = driven(moving_car(7, (10.0, 3.5), (8.0, -1.0), 200), lanes=2)
    assert beside.states[10].speed_mps > 10.0
    assert cutting_in.states[10].speed_mps < 8.5


def test_it_arrives_with_the_speed_of_its_goal() -> None:
    run = driven(goal=goal_state((60, 120), rectangle_at(60.0, 0.0), speed=(0.0, 0.5)))
    assert run.final.outcome == "goal_reached"
    assert min(np.diff([state.speed_mps for state in run.states])) / 0.1 > -2.2


def test_it_follows_the_path_through_a_lane_change() -> None:
    run = driven(goal=goal_state((40, 70), rectangle_at(60.0, 3.5)), lanes=2)
    assert run.final.outcome == "goal_reached"
    assert max(abs(state.yaw_rate_radps) for state in run.states) < 0.5


def test_an_offset_from_the_path_fades_out_without_a_swerve() -> None:
    scenario = scenario_on(straight_road(300.0))
    run = drive(scenario, problem_for(FAR, position=(0.0, 0.6)), configuration("idm"), planner=IntelligentDriver())
    offsets = [project(np.array([[0.0, 0.0], [200.0, 0.0]]), state.position)[1] for state in run.states]
    assert offsets[0] == pytest.approx(0.6, abs=1e-6)
    assert abs(offsets[45]) < 0.02
    assert min(offsets) > -0.02


def test_each_parameter_has_its_documented_effect() -> None:
    def at(changes: tuple[str, ...], *obstacles: Any) -> Any:
        return driven(*obstacles, changes=changes).states[40]

    slow, parked = moving_car(7, (30.0, 0.0), (6.0, 0.0), 200), parked_car(8, (60.0, 0.0))
    assert at(("time_headway_s=2.5",), slow).position[0] < at((), slow).position[0] - 1.0
    assert at(("minimum_gap_m=8",), slow).position[0] < at((), slow).position[0] - 1.0
    assert at(("acceleration_mps2=2",)).position[0] > at(()).position[0]
    assert at(("deceleration_mps2=5",), parked).speed_mps > at((), parked).speed_mps


def test_it_has_no_costs_and_one_candidate() -> None:
    plan = driven().plans[0]
    assert (dict(plan.costs), plan.candidates) == ({}, 1)
