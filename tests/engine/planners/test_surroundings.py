"""Route, reference path, road, prediction and sampling: what a planner is given."""

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commonroad.geometry.shape import Circle, Polygon, Rectangle, ShapeGroup
from commonroad.scenario.obstacle import ObstacleType, StaticObstacle
from hypothesis import given
from hypothesis import strategies as st
from support.builders import driving, town_road
from support.planning import (
    configuration,
    goal_state,
    lanelet_along,
    moving_car,
    network_of,
    parked_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.commonroad import read_recorded, read_scenario
from plannerforge.engine.geometry.polyline import arc_length, maximum_curvature, project
from plannerforge.engine.planners.external.conformance import check_planner
from plannerforge.engine.planners.frenetix.core import CurvilinearState, SamplingSettings, sampling_matrix
from plannerforge.engine.planners.frenetix.planner import Frenetix
from plannerforge.engine.planners.goal import Goal
from plannerforge.engine.planners.interface import EgoState, Observation, Plan, PlannedTrajectory, PlanningTask
from plannerforge.engine.planners.lanes import build_road
from plannerforge.engine.planners.prediction import constant_velocity, ground_truth, observe
from plannerforge.engine.planners.reference_path import build_reference_path
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic, rectangle
from plannerforge.engine.scene.routing import find_route
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.errors import NotPossible

ORIGIN = np.zeros(2)


def path_to(goal: Any, network: Any = None, lanelets: Any = None, speed: float = 10.0) -> Any:
    network = network if network is not None else straight_road(300.0, lanes=2)
    region = problem_for(goal, lanelets=lanelets).goal
    route = find_route(network, region, ORIGIN, 0.0, ahead_m=120.0)
    return route, build_reference_path(network, route, ORIGIN, speed, beyond_m=120.0)


def task_on(scenario: Any, problem: Any) -> PlanningTask:
    network = scenario.lanelet_network
    ego = EgoState.of(problem.initial_state)
    route = find_route(network, problem.goal, ego.position, ego.heading_rad, ahead_m=120.0)
    reference = build_reference_path(network, route, ego.position, ego.speed_mps)
    road = build_road(network, reference)
    return PlanningTask(network, problem, configuration("frenetix:Balanced"), reference, road, BMW_320I, 0.1)


def test_the_path_of_a_straight_road_is_its_centre_line_and_continues_beyond_it() -> None:
    _, path = path_to(goal_state((1, 2), rectangle_at(100.0, 0.0)))
    assert np.abs(path.points[:, 1]).max() < 1e-9
    assert path.points[0, 0] == pytest.approx(-50.0, abs=0.01)
    assert path.points[-1, 0] >= 100.0 + 120.0
    assert np.diff(arc_length(path.points)) == pytest.approx(1.0, abs=0.02)


def test_a_lane_change_is_drivable_and_ends_on_the_goal_lane() -> None:
    route, path = path_to(goal_state((1, 2), rectangle_at(150.0, 3.5)))
    assert route.lanelets == (1, 2)
    assert project(path.points, np.array([150.0, 3.5]))[1] == pytest.approx(0.0, abs=0.01)
    assert project(path.points, ORIGIN)[1] == pytest.approx(0.0, abs=0.1)
    assert maximum_curvature(path.points, sigma_m=1.0) < 0.05


def test_a_goal_off_the_centre_line_curves_the_path() -> None:
    network = straight_road(300.0)
    beside = rectangle_at(80.0, 1.2, size=(6.0, 0.6))
    region = problem_for(goal_state((1, 2), beside))
    route = find_route(network, region.goal, ORIGIN, 0.0, ahead_m=120.0)
    goal = Goal(region.goal)
    straight = build_reference_path(network, route, ORIGIN, 10.0)
    bent = build_reference_path(network, route, ORIGIN, 10.0, through=goal.center)
    assert goal.stations_on(straight.points) is None
    assert goal.stations_on(bent.points) is not None


def test_goal_lanelets_come_from_the_file() -> None:
    shape = rectangle_at(150.0, 3.5)
    route, _ = path_to(goal_state((1, 2), shape), lanelets={0: [2]})
    assert route.lanelets[route.goal_index or 0] == 2


def test_a_goal_without_a_place_follows_the_road() -> None:
    route, path = path_to(goal_state((30, 30)))
    assert route.goal_index is None
    assert path.goal_lanelet is None


def test_the_straightest_successor_is_followed_behind_the_goal() -> None:
    x = np.linspace(0.0, 50.0, 11)
    first = lanelet_along(np.stack([x - 5, np.zeros(11)], axis=1), 1, successor=[2, 3])
    ahead = lanelet_along(np.stack([x + 45, np.zeros(11)], axis=1), 2, predecessor=[1])
    turning = lanelet_along(np.stack([x + 45, x**2 / 50], axis=1), 3, predecessor=[1])
    network = network_of(first, ahead, turning)
    route = find_route(
        network, problem_for(goal_state((1, 2), rectangle_at(30.0, 0.0))).goal, ORIGIN, 0.0, ahead_m=99.0
    )
    assert route.lanelets == (1, 2)


def test_no_route_names_the_lanelets() -> None:
    x = np.linspace(0.0, 50.0, 11)
    apart = [lanelet_along(np.stack([x - 5, np.full(11, y)], axis=1), key) for key, y in ((1, 0.0), (2, 30.0))]
    goal = problem_for(goal_state((1, 2), rectangle_at(30.0, 30.0))).goal
    with pytest.raises(NotPossible, match="from lanelet 1 to the goal on 2"):
        find_route(network_of(*apart), goal, ORIGIN, 0.0, ahead_m=50.0)


def test_the_edge_of_the_road_is_felt_and_lane_borders_are_not() -> None:
    scenario = scenario_on(straight_road(200.0, lanes=2))
    road = task_on(scenario, problem_for(goal_state((1, 2), rectangle_at(100.0, 0.0)))).road
    touching = [
        road.touches_edge(rectangle(EgoState(0, np.array([50.0, y]), 0.0, 0.0), BMW_320I)) for y in (0.0, 1.75, -1.2)
    ]
    assert touching == [False, False, True]
    assert road.holds(np.array([50.0, 1.0]))
    assert not road.holds(np.array([50.0, -4.0]))


def test_constant_velocity_continues_straight_with_a_margin() -> None:
    track = RecordedTraffic(scenario_on(straight_road(), moving_car(5, (10.0, 0.0), (3.0, 4.0)))).moving[0]
    seen = constant_velocity(track, 10, 30, 0.1)
    assert seen.positions[0] == pytest.approx([13.0, 4.0])
    assert seen.positions[30] == pytest.approx([22.0, 16.0])
    assert (seen.length_m, seen.width_m) == pytest.approx((5.0, 2.0))


def test_ground_truth_is_the_recording_and_ends_with_it() -> None:
    track = RecordedTraffic(scenario_on(straight_road(), moving_car(5, (10.0, 0.0), (3.0, 4.0), steps=20))).moving[0]
    assert ground_truth(track, 0, 30, 0.1).positions.shape == (21, 2)
    assert ground_truth(track, 15, 30, 0.1).positions.shape == (6, 2)


def test_obstacles_within_sight_are_observed() -> None:
    cars = [moving_car(11, (60.0, 0.0), (1.0, 0.0)), moving_car(12, (90.0, 0.0), (1.0, 0.0))]
    cars += [moving_car(13, (-20.0, 0.0), (1.0, 0.0)), moving_car(14, (-5.0, 0.0), (1.0, 0.0))]
    traffic = RecordedTraffic(scenario_on(straight_road(), *cars, parked_car(16, (20.0, 5.0))))
    ego = EgoState(0, ORIGIN, 0.0, 10.0)
    guessed = {o.obstacle_id for o in observe(traffic, ego, constant_velocity, 30, 0.1)}
    known = {o.obstacle_id for o in observe(traffic, ego, ground_truth, 30, 0.1)}
    assert guessed == {11, 14, 16}
    assert known == {11, 13, 14, 16}


def test_the_sampling_of_the_reference() -> None:
    state = CurvilinearState(np.array([0.0, 10.3, 0.0]), np.array([0.1, 0.0, 0.0]), low_speed=False)
    matrix = sampling_matrix(state, 10.3, SamplingSettings(), BMW_320I)
    assert matrix.shape == (800, 13)
    assert sorted(set(matrix[:, 1])) == pytest.approx([1.1, 1.4, 1.7, 2.0, 2.3, 2.6, 2.9, 3.0])
    assert matrix[:, 5].min() == pytest.approx(0.001)
    assert matrix[:, 5].max() == pytest.approx(10.3 + 11.5 / 6 * 3)
    assert {-3.0, 0.1, 3.0} <= set(matrix[:, 10])


@given(st.floats(0.1, 30.0), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_changing_the_mode_and_back_has_no_effect(v: float, a: float, d: float, d1: float, d2: float) -> None:
    state = CurvilinearState(np.array([5.0, v, a]), np.array([d, d1, d2]), low_speed=False)
    back = state.as_mode(low_speed=True).as_mode(low_speed=False)
    assert np.allclose(back.lateral, state.lateral, atol=1e-6)


@pytest.mark.parametrize("speed", [0.0, 1.0, 10.0])
def test_frenetix_keeps_the_contract(speed: float) -> None:
    scenario = scenario_on(straight_road(300.0, lanes=2), parked_car(7, (40.0, 0.0)))
    task = task_on(scenario, problem_for(goal_state((40, 60), rectangle_at(60.0, 3.5)), speed_mps=speed))
    ego = EgoState(0, ORIGIN, 0.0, speed)
    others = observe(RecordedTraffic(scenario), ego, constant_velocity, 30, 0.1)
    assert check_planner(Frenetix, task, Observation(ego, others)) == ()


def test_the_contract_names_the_breach() -> None:
    class Careless:
        calls = 0

        def reset(self, task: PlanningTask) -> None:
            del task

        def plan(self, observation: Observation) -> Plan:
            Careless.calls += 1
            jump = np.array([[5.0 + Careless.calls, 0.0], [50.0, 0.0]])
            return Plan(PlannedTrajectory(jump, np.zeros(2), np.zeros(2), np.zeros(2)), {"jerk": math.inf})

    scenario = scenario_on(straight_road(300.0))
    task = task_on(scenario, problem_for(goal_state((40, 60), rectangle_at(60.0, 0.0))))
    found = " ".join(check_planner(Careless, task, Observation(EgoState(0, ORIGIN, 0.0, 1.0), ())))
    for part in (
        "cost jerk is inf",
        "only 0.10 s",
        "from the ego",
        "farther in a step",
        "different plan after a reset",
    ):
        assert part in found


@pytest.mark.parametrize("part", ["headings_rad", "speeds_mps", "accelerations_mps2", "rejected", "candidates", "kind"])
def test_the_contract_asks_for_every_part_of_the_same_plan_again(part: str) -> None:
    class Forgetful:
        calls = 0

        def reset(self, task: PlanningTask) -> None:
            del task

        def plan(self, observation: Observation) -> Plan:
            Forgetful.calls += 1
            x = observation.ego.position[0] + 0.1 * np.arange(12)
            line = PlannedTrajectory(np.stack([x, np.zeros(12)], axis=1), np.zeros(12), np.ones(12), np.zeros(12))
            if part in ("rejected", "candidates", "kind"):
                changed = {"rejected": {"collision": 1}, "candidates": 2, "kind": "stopping"}[part]
                return replace(Plan(line), **({part: changed} if Forgetful.calls > 1 else {}))
            return Plan(replace(line, **{part: getattr(line, part) + 0.01 * Forgetful.calls}))

    task = task_on(scenario_on(straight_road(300.0)), problem_for(goal_state((40, 60), rectangle_at(60.0, 0.0))))
    found = check_planner(Forgetful, task, Observation(EgoState(0, ORIGIN, 0.0, 1.0), ()))
    assert "gives a different plan after a reset" in found


@pytest.mark.parametrize("ahead_m", [-6.0, -4.4, -2.0, 0.0, 2.0, 4.4, 6.0])
@pytest.mark.parametrize("turn_rad", [0.0, 0.4])
def test_read_rectangles_are_hit_if_commonroad_dc_reports_a_hit(
    tmp_path: Path, ahead_m: float, turn_rad: float
) -> None:
    others = [driving(31, (20, 0), 8.0, 40), driving(32, (20, 3.5), 8.0, 40, heading_rad=7.0)]
    path = town_road().with_vehicles(*others).write(tmp_path / "base.xml")
    by_objects = RecordedTraffic(read_scenario(path).scenario)
    read = RecordedTraffic.of(read_recorded(path).loaded)
    hits = []
    for track, beside_m in itertools.product(by_objects.moving, (-2.3, -1.9, 0.0, 1.7, 2.1)):
        ego = EgoState(12, track.positions[12] + np.array([ahead_m, beside_m]), turn_rad, 8.0)
        hits.append(read.hits(ego, BMW_320I))
        assert hits[-1] == by_objects.hits(ego, BMW_320I)
    assert abs(ahead_m) > 5.0 or any(hits)
    assert not read.hits(EgoState(41, np.array([20.0, 0.0]), 0.0, 8.0), BMW_320I)


@pytest.mark.parametrize(
    "shape",
    [
        Rectangle(6.0, 2.0),
        Rectangle(6.0, 2.0, np.array([0.5, 0.2]), 0.3),
        Circle(1.6, np.array([0.4, -0.3])),
        Polygon(np.array([[-2.0, -1.0], [2.5, -1.2], [1.0, 1.6]])),
        Polygon(np.array([[-2.0, -1.0], [2.5, -1.2], [2.8, 0.3], [0.2, 1.9]])),
        ShapeGroup([Circle(1.0, np.array([-3.0, 0.0])), Rectangle(2.0, 2.0, np.array([3.0, 0.0]), 0.8)]),
    ],
    ids=("rectangle", "turned", "circle", "triangle", "polygon", "group"),
)
def test_bodies_of_any_shape_are_hit_if_commonroad_dc_reports_a_hit(shape: Any) -> None:
    from commonroad_dc import pycrcc
    from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import create_collision_object

    standing = parked_car(31, (20.0, 0.0), 0.7)
    standing = StaticObstacle(31, ObstacleType.PARKED_VEHICLE, shape, standing.initial_state)
    moving = moving_car(32, (20.0, 20.0), (3.0, 1.0), steps=12)
    moving.prediction.shape = shape
    traffic = RecordedTraffic(scenario_on(straight_road(100.0), standing, moving))
    verdicts = []
    for obstacle, step, dx, dy in itertools.product((standing, moving), (0, 12), np.arange(-6, 7, 1.5), (-3, -1, 1, 2)):
        centre = (20.0, 0.0) if obstacle is standing else (20.0 + 0.3 * step, 20.0 + 0.1 * step)
        ego = EgoState(step, np.add(centre, (dx, dy)), 0.2, 5.0)
        body = pycrcc.TimeVariantCollisionObject(step)
        body.append_obstacle(rectangle(ego, BMW_320I))
        verdicts.append(bool(create_collision_object(obstacle).collide(body)))
        assert (obstacle.obstacle_id in dict(traffic.hits(ego, BMW_320I))) == verdicts[-1]
    assert True in verdicts
    assert False in verdicts
