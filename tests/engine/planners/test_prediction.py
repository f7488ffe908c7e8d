"""What each prediction says of the others, and that its covariance reaches the planner's cost."""

import math
from typing import Any, get_args

import numpy as np
import pytest
from commonroad.scenario.lanelet import LaneletNetwork
from support.planning import (
    configuration,
    drive,
    goal_state,
    lanelet_along,
    moving_car,
    network_of,
    problem_for,
    rectangle_at,
    rotation,
    scenario_on,
    straight_road,
)

from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.planners.frenetix.planner import Frenetix
from plannerforge.engine.planners.interface import EgoState, Observation, PlanningTask, PredictedObstacle
from plannerforge.engine.planners.lanes import build_road
from plannerforge.engine.planners.prediction import (
    LanePrediction,
    constant_velocity,
    growing_covariance,
    off_the_lanes,
    predictor,
)
from plannerforge.engine.planners.reference_path import build_reference_path
from plannerforge.engine.scene.routing import find_route
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.runs import Prediction

RADIUS_M = 25.0


def bend(width_m: float = 3.5) -> LaneletNetwork:
    """Lanelet 1 runs 40 m along the x axis, lanelet 2 turns left by 90° with a radius of 25 m, 3 leads straight on."""
    angle = np.linspace(0.0, math.pi / 2, 31)
    x = np.linspace(-20.0, 20.0, 9)
    arc = np.stack([20.0 + RADIUS_M * np.sin(angle), RADIUS_M * (1.0 - np.cos(angle))], axis=1)
    up = np.stack([np.full(9, 20.0 + RADIUS_M), RADIUS_M + np.linspace(0.0, 40.0, 9)], axis=1)
    return network_of(
        lanelet_along(np.stack([x, np.zeros(9)], axis=1), 1, width_m, successor=[2]),
        lanelet_along(arc, 2, width_m, predecessor=[1], successor=[3]),
        lanelet_along(up, 3, width_m, predecessor=[2]),
    )


def planning_task(scenario: Any, problem: Any) -> PlanningTask:
    network, ego = scenario.lanelet_network, EgoState.of(problem.initial_state)
    route = find_route(network, problem.goal, ego.position, ego.heading_rad, ahead_m=120.0)
    reference = build_reference_path(network, route, ego.position, ego.speed_mps)
    road = build_road(network, reference)
    return PlanningTask(network, problem, configuration("frenetix:Balanced"), reference, road, BMW_320I, 0.1)


def car(position: tuple[float, float], heading: float, speed: float) -> Track:
    """A track of one state."""
    return Track(7, "car", 4.5, 1.8, 0, np.array([position]), np.array([heading]), np.array([speed]))


def distance_to_centre(network: LaneletNetwork, point: Any) -> float:
    lines = [lanelet.center_vertices for lanelet in network.lanelets]
    return min(abs(project(line, point)[1]) for line in lines)


def test_in_a_curve_a_lane_prediction_keeps_the_road_constant_velocity_leaves_it() -> None:
    network, track = bend(), car((15.0, 0.3), 0.0, 10.0)
    lane = LanePrediction(network)(track, 0, 30, 0.1)
    straight = constant_velocity(track, 0, 30, 0.1)
    assert max(distance_to_centre(network, point) for point in lane.positions) < 0.4
    assert distance_to_centre(network, straight.positions[-1]) > 5.0
    assert lane.headings_rad[-1] == pytest.approx(25.0 / RADIUS_M, abs=0.05)
    steps = np.linalg.norm(np.diff(lane.positions, axis=0), axis=1)
    assert steps == pytest.approx(np.ones(30), abs=0.05)


def test_the_offset_and_the_heading_fade_with_two_seconds() -> None:
    lane = LanePrediction(straight_road())(car((0.0, 1.0), 0.1, 10.0), 0, 30, 0.1)
    assert lane.positions[0] == pytest.approx([0.0, 1.0])
    assert lane.headings_rad[0] == pytest.approx(0.1)
    assert lane.positions[20] == pytest.approx([20.0, math.exp(-1.0)])
    assert lane.headings_rad[20] == pytest.approx(0.1 * math.exp(-1.0))


def test_beyond_the_end_of_the_map_the_lane_continues_straight() -> None:
    lane = LanePrediction(straight_road(60.0))(car((35.0, 0.0), 0.0, 10.0), 0, 30, 0.1)
    assert lane.positions[-1] == pytest.approx([65.0, 0.0])


def test_at_a_fork_the_straightest_route_is_chosen() -> None:
    angle = np.linspace(0.0, 1.0, 21)
    arc = np.stack([20.0 + RADIUS_M * np.sin(angle), RADIUS_M * (1.0 - np.cos(angle))], axis=1)
    x = np.linspace(-20.0, 20.0, 9)
    network = network_of(
        lanelet_along(np.stack([x, np.zeros(9)], axis=1), 1, successor=[2, 3]),
        lanelet_along(arc, 2, predecessor=[1]),
        lanelet_along(np.stack([x + 40.0, np.zeros(9)], axis=1), 3, predecessor=[1]),
    )
    for x_m in (10.0, 20.5):
        lane = LanePrediction(network)(car((x_m, 0.0), 0.0, 10.0), 0, 30, 0.1)
        assert lane.positions[-1] == pytest.approx([x_m + 30.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(("position", "heading"), [((0.0, 6.0), 0.0), ((0.0, 0.0), math.pi)])
def test_off_the_lanes_and_against_them_is_constant_velocity_and_is_counted(
    position: tuple[float, float], heading: float
) -> None:
    predict, track = predictor("lane", straight_road()), car(position, heading, 5.0)
    assert np.array_equal(predict(track, 0, 30, 0.1).positions, constant_velocity(track, 0, 30, 0.1).positions)
    assert off_the_lanes(predict) == (7,)
    assert off_the_lanes(constant_velocity) == ()


def test_the_run_names_the_obstacles_that_are_off_the_lanes() -> None:
    cars = [moving_car(11, (30.0, 0.0), (8.0, 0.0)), moving_car(12, (30.0, 9.0), (8.0, 0.0))]
    scenario, goal = scenario_on(straight_road(), *cars), goal_state((10, 20), rectangle_at(12.0, 0.0))
    assert drive(scenario, problem_for(goal), prediction="lane").off_the_lanes == (12,)
    assert drive(scenario, problem_for(goal)).off_the_lanes == ()


@pytest.mark.parametrize("heading", [0.0, 1.0])
def test_the_covariance_grows_most_along_the_heading(heading: float) -> None:
    seen = growing_covariance(car((0.0, 0.0), heading, 10.0), 0, 30, 0.1)
    along, across = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    covariance = np.asarray(seen.covariance)
    assert covariance.shape == (31, 2, 2)
    assert covariance[0] == pytest.approx(0.1 * np.eye(2))
    assert across @ covariance[30] @ across == pytest.approx(0.1 + 0.6**2)
    assert along @ covariance[30] @ along == pytest.approx(0.1 + 0.6**2 + 4.5**2)
    assert along @ covariance[20] @ across == pytest.approx(0.0, abs=1e-12)
    assert np.array_equal(seen.positions, constant_velocity(car((0.0, 0.0), heading, 10.0), 0, 30, 0.1).positions)


@pytest.mark.parametrize("prediction", get_args(Prediction))
def test_every_prediction_of_the_schema_drives(prediction: Any) -> None:
    scenario = scenario_on(straight_road(lanes=2), moving_car(8, (25.0, 3.5), (8.0, 0.0)))
    run = drive(scenario, problem_for(goal_state((25, 35), rectangle_at(30.0, 0.0))), prediction=prediction)
    assert run.final.outcome == "goal_reached"


def test_an_unknown_prediction_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(UnknownName) as refusal:
        predictor("oracle", straight_road())  # type: ignore[arg-type]
    assert set(refusal.value.valid) == set(get_args(Prediction))


class Listening(Frenetix):
    """Keeps the raw prediction costs of all feasible candidates by their sampled ends."""

    def _ranked(self, feasible: Any, step: Any) -> Any:
        ranked = list(super()._ranked(feasible, step))
        ends = [tuple(np.round(sample.sampling_parameters[[1, 5, 10]], 3) + 0.0) for sample in ranked]
        costs = [sample.costMap["prediction"][0] for sample in ranked]
        self.heard = dict(zip(ends, costs, strict=True))
        return iter(ranked)


def prediction_costs(covariance: Any, angle: float = 0.0) -> dict[Any, float]:
    """Costs against a car 14 m ahead and 2 m to the left at 8 m/s, by candidate; the ego drives 10 m/s."""
    scenario, turn = scenario_on(straight_road(300.0, lanes=2, angle_rad=angle)), rotation(angle)
    task = planning_task(scenario, problem_for(goal_state((40, 60), rectangle_at(60.0, 0.0, angle)), angle_rad=angle))
    positions = (np.array([14.0, 2.0]) + np.arange(31)[:, None] * np.array([0.8, 0.0])) @ turn.T
    other = PredictedObstacle(5, positions, np.full(31, angle), turn @ covariance @ turn.T, 4.5, 1.8, 8.0)
    planner = Listening()
    planner.reset(task)
    planner.plan(Observation(EgoState(0, np.zeros(2), angle, 10.0), (other,)))
    return planner.heard


def grown(direction: Any) -> Any:
    """0.1 m² in every direction, and (½ t²)² along a matrix, over three seconds."""
    time = np.arange(31) * 0.1
    return 0.1 * np.eye(2) + ((time**2 / 2) ** 2)[:, None, None] * np.array(direction)


def test_the_covariance_of_every_step_reaches_the_cores_cost() -> None:
    along = prediction_costs(grown([[1, 0], [0, 0]]))
    across = prediction_costs(grown([[0, 0], [0, 1]]))
    skew = prediction_costs(grown([[1.0, 0.9], [0.9, 1.0]]))
    small, last = prediction_costs(0.1 * np.eye(2)), prediction_costs(grown([[1, 0], [0, 0]])[30])
    keeps = [key for key in along if small[key] == 0.0 and across[key] == 0.0 and along[key] > 1.0]
    assert len(keeps) > 20
    assert all(last[key] > along[key] for key in keeps)
    assert sum(abs(skew[key] - along[key]) > 1.0 for key in keeps) > len(keeps) / 2


def test_the_covariance_is_turned_with_the_road() -> None:
    straight, turned = (prediction_costs(grown([[1, 0], [0, 0]]), angle) for angle in (0.0, 0.9))
    common = sorted(straight.keys() & turned.keys())
    assert len(common) > 400
    assert [turned[key] for key in common] == pytest.approx([straight[key] for key in common], rel=1e-6, abs=1e-6)
