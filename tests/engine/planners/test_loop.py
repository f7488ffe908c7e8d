"""The loop drives, and its judge says truthfully how a run ended."""

import math

import numpy as np
import pytest
from support.planning import (
    configuration,
    drive,
    goal_state,
    moving_car,
    parked_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.registry import make_planner

FAR_GOAL = goal_state((35, 45), rectangle_at(40.0, 0.0))


def test_an_empty_road_is_driven_to_the_goal() -> None:
    run = drive(scenario_on(straight_road()), problem_for(FAR_GOAL))
    assert run.final.outcome == "goal_reached"
    assert run.states[-1].step == 35
    assert max(abs(state.position[1]) for state in run.states) < 0.2


@pytest.mark.parametrize("prediction", ["constant_velocity", "ground_truth"])
def test_a_parked_car_in_the_lane_is_not_hit(prediction: str) -> None:
    scenario = scenario_on(straight_road(lanes=1), parked_car(7, (60.0, 0.0)))
    run = drive(scenario, problem_for(goal_state((60, 70), rectangle_at(100.0, 0.0))), prediction=prediction)  # type: ignore[arg-type]
    assert run.final.outcome == "timeout"
    assert run.states[-1].speed_mps < 0.5
    assert run.states[-1].position[0] < 56.0


def test_a_recorded_follower_that_does_not_brake_hits_the_ego_from_behind() -> None:
    scenario = scenario_on(straight_road(400.0), moving_car(8, (-15.0, 0.0), (20.0, 0.0)))
    run = drive(scenario, problem_for(goal_state((90, 100)), speed_mps=5.0))
    assert run.final.outcome == "collision"
    assert run.final.collision is not None
    assert run.final.collision.obstacle_id == 8
    assert "obstacle 8" in run.final.reason


def test_a_collision_at_the_start_is_the_problems_fault() -> None:
    run = drive(scenario_on(straight_road(), parked_car(9, (2.0, 0.0))), problem_for(FAR_GOAL))
    assert run.final.outcome == "invalid"
    assert "obstacle 9" in run.final.reason
    assert not run.plans


def test_an_ego_off_the_road_is_the_problems_fault() -> None:
    run = drive(scenario_on(straight_road()), problem_for(FAR_GOAL, position=(0.0, 30.0)))
    assert run.final.outcome == "invalid"
    assert "not on a lanelet" in run.final.reason


def test_a_goal_without_a_route_is_the_problems_fault() -> None:
    goal = goal_state((35, 45), rectangle_at(40.0, 60.0))
    run = drive(scenario_on(straight_road()), problem_for(goal))
    assert run.final.outcome == "invalid"


def test_a_problem_without_goal_states_is_the_problems_fault() -> None:
    run = drive(scenario_on(straight_road()), problem_for())
    assert run.final.outcome == "invalid"
    assert "no goal state" in run.final.reason


@pytest.mark.parametrize("name", ["frenetix:Default", "idm"])
@pytest.mark.parametrize(("turned_deg", "is_the_problems_fault"), [(180, True), (-100, True), (80, False)])
def test_an_ego_that_heads_back_along_its_route_is_the_problems_fault(
    name: str, turned_deg: int, is_the_problems_fault: bool
) -> None:
    problem = problem_for(goal_state((20, 30)), speed_mps=3.0)
    problem.initial_state.orientation = math.radians(turned_deg)
    config = configuration(name)
    final = drive(scenario_on(straight_road()), problem, config, planner=make_planner(config.planner)).final
    assert (final.outcome == "invalid") == is_the_problems_fault
    if is_the_problems_fault:
        assert final.invalid_reason == "ego_against_route"
        assert f"{abs(turned_deg)}° off the route" in final.reason


def test_a_lane_change_to_the_goal_lane_is_smooth_and_complete() -> None:
    goal = goal_state((70, 90), rectangle_at(100.0, 3.5))
    run = drive(scenario_on(straight_road(300.0, lanes=2)), problem_for(goal, speed_mps=12.0))
    assert run.final.outcome == "goal_reached"
    assert run.states[-1].position[1] == pytest.approx(3.5, abs=0.4)


def test_the_end_of_the_map_is_not_the_end_of_the_road() -> None:
    goal = goal_state((45, 50), rectangle_at(72.0, 0.0))
    run = drive(scenario_on(straight_road(100.0)), problem_for(goal, speed_mps=15.0))
    assert run.final.outcome == "goal_reached"


def test_a_run_is_the_same_twice() -> None:
    scenario = scenario_on(straight_road(lanes=2), parked_car(7, (35.0, 0.0)))
    first, second = (drive(scenario, problem_for(goal_state((50, 70), rectangle_at(60.0, 0.0)))) for _ in range(2))
    assert np.array_equal([s.position for s in first.states], [s.position for s in second.states])
    assert [dict(plan.costs) for plan in first.plans] == [dict(plan.costs) for plan in second.plans]


def test_cost_terms_of_the_configuration_are_logged_for_every_plan() -> None:
    run = drive(scenario_on(straight_road()), problem_for(FAR_GOAL), configuration("frenetix:Balanced"))
    named = {"path_length", "velocity", "lane_center_offset", "responsibility", "jerk", "prediction"}
    assert named <= set(run.plans[0].costs)
    assert all(np.isfinite(list(plan.costs.values())).all() for plan in run.plans)
