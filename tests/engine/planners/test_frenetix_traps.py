"""Every known trap of the C++ core, each with a test that fails without its cure."""

import math
from pathlib import Path
from typing import Any

import frenetix
import frenetix.trajectory_functions.cost_functions as costs
import numpy as np
import pytest
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import Occupancy, SetBasedPrediction
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from support.planning import (
    configuration,
    drive,
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

from plannerforge.engine.geometry.polyline import arc_length, headings, resample, without_repeats
from plannerforge.engine.planners.frenetix.core import (
    SAFE_RANGE_RAD,
    CurvilinearState,
    EndState,
    FrameKeeper,
    FrenetFrame,
    SamplingSettings,
    copied_curvilinear,
    copied_trajectory,
    initial_state,
    sampling_matrix,
)
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.scene.routing import start_lanelets
from plannerforge.engine.vehicles.models import BMW_320I


def arc_road(radius_m: float, first_rad: float, turn_rad: float, count: int = 120) -> Any:
    """A road whose heading runs from ``first_rad`` over ``turn_rad``, starting at the origin."""
    heading = first_rad + np.linspace(0.0, turn_rad, count)
    steps = np.stack([np.cos(heading), np.sin(heading)], axis=1) * (abs(radius_m * turn_rad) / (count - 1))
    return np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])


def road_across_pi() -> tuple[Any, Any]:
    """A bend whose heading crosses ±π, and a problem on it."""
    center = arc_road(120.0, math.pi - 0.4, 0.8)
    goal = goal_state((60, 75), Rectangle(14.0, 4.0, center=center[90], orientation=-math.pi + 0.2))
    problem = problem_for(goal, speed_mps=10.0)
    problem.initial_state.position = center[8]
    problem.initial_state.orientation = math.pi - 0.36
    return scenario_on(network_of(lanelet_along(center, 1))), problem


def test_a_route_across_pi_is_driven() -> None:
    scenario, problem = road_across_pi()
    run = drive(scenario, problem)
    assert run.final.outcome == "goal_reached"


def test_without_the_turned_frame_the_core_rejects_all_candidates_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def untouched(self: FrameKeeper, station_m: float, ahead_m: float) -> FrenetFrame:
        del station_m, ahead_m
        return FrenetFrame.of(self._path, 0.0)

    cured = drive(*road_across_pi())
    monkeypatch.setattr(FrameKeeper, "frame_for", untouched)
    uncured = drive(*road_across_pi())
    worst = [max(plan.rejected["yaw_rate"] / plan.candidates for plan in run.plans) for run in (cured, uncured)]
    assert worst[0] < 0.15
    assert worst[1] > 0.95


def test_a_turned_world_gives_the_same_run() -> None:
    angle = 2.9
    runs = []
    for turned in (0.0, angle):
        goal = goal_state((35, 45), rectangle_at(40.0, 0.0, turned))
        runs.append(drive(scenario_on(straight_road(angle_rad=turned)), problem_for(goal, angle_rad=turned)))
    along = [np.array([np.linalg.norm(state.position) for state in run.states]) for run in runs]
    assert runs[0].final.outcome == runs[1].final.outcome == "goal_reached"
    assert np.allclose(along[0], along[1], atol=1e-6)


def test_an_ego_against_the_direction_of_its_route_is_reported_if_the_core_raises() -> None:
    """Its lane and its route run the other way: the core has no curvilinear state for it."""
    path = np.stack([np.arange(0.0, 200.0), np.zeros(200)], axis=1)
    frame = FrenetFrame.of(path, 0.0)
    along, against = EgoState(0, np.array([50.0, 0.0]), 0.0, 10.0), EgoState(0, np.array([50.0, 0.0]), math.pi, 10.0)
    assert initial_state(frame, along, BMW_320I, low_speed=False) is not None
    assert initial_state(frame, against, BMW_320I, low_speed=False) is None


def test_a_route_of_more_than_a_full_circle_gets_new_frames_on_the_way() -> None:
    path = arc_road(30.0, 0.0, 2.6 * math.pi, 250)
    keeper = FrameKeeper(path)
    ahead = headings(path)
    for station in np.arange(0.0, 200.0, 5.0):
        frame = keeper.frame_for(float(station), 30.0)
        near = ahead[int(max(station - 10, 0)) : int(station + 30)]
        turned = np.abs(np.remainder(near - frame.angle_rad + math.pi, math.tau) - math.pi)
        assert turned.max() <= SAFE_RANGE_RAD + 0.05


def test_of_a_route_that_crosses_itself_the_core_gets_the_first_part() -> None:
    """Up a road, around the loop at its end, and back across the road: the core refuses the whole."""
    around = np.linspace(math.pi, -0.5 * math.pi, 40)[:, None]
    loop = np.array([6.0, 120.0]) + 6.0 * np.hstack([np.cos(around), np.sin(around)])
    corners = np.concatenate([[[0.0, 0.0]], loop, [[-60.0, 114.0]], [[-60.0, 60.0], [60.0, 50.0]]])
    path = resample(without_repeats(corners, 1e-2), round(float(arc_length(corners)[-1])) + 1)
    with pytest.raises(RuntimeError, match="projection domain"):
        FrenetFrame.of(path, 0.0)
    keeper = FrameKeeper(path)
    ego = EgoState(0, np.array([0.0, 20.0]), 0.5 * math.pi, 10.0)
    assert initial_state(keeper.frame_for(20.0, 40.0), ego, BMW_320I, low_speed=False) is not None
    assert np.allclose(FrameKeeper(path[:100]).frame.origin, keeper.frame.origin)


def test_copies_of_a_sample_outlive_the_cores_memory() -> None:
    frame = FrenetFrame.of(np.stack([np.arange(0.0, 200.0), np.zeros(200)], axis=1), 0.0)
    ego = EgoState(0, np.array([51.4227, 0.0]), 0.0, 10.0)
    state = CurvilinearState(np.array([50.0, 10.0, 0.0]), np.zeros(3), low_speed=False)
    handler = frenetix.TrajectoryHandler(0.1)
    handler.add_function(frenetix.trajectory_functions.FillCoordinates(False, 0.0, frame.system, 3.0))
    handler.generate_trajectories(sampling_matrix(state, 10.0, SamplingSettings(), BMW_320I), False)
    handler.evaluate_all_current_functions(False)
    sample = next(iter(handler.get_sorted_trajectories()))
    kept, curvilinear = copied_trajectory(sample, frame, ego, BMW_320I), copied_curvilinear(sample)
    arrays = (kept.positions, kept.headings_rad, kept.speeds_mps, kept.accelerations_mps2, curvilinear)
    before = [array.copy() for array in arrays]
    del sample  # as long as it is held, so is its memory
    for _ in range(20):
        handler.reset_Trajectories()
        handler.generate_trajectories(sampling_matrix(state, 30.0, SamplingSettings(), BMW_320I), False)
        handler.evaluate_all_current_functions(False)
    assert all(np.array_equal(array, copied) for array, copied in zip(arrays, before, strict=True))


def test_distance_to_obstacles_costs_nothing_on_an_empty_road() -> None:
    goal = goal_state((35, 45), rectangle_at(40.0, 0.0))
    run = drive(scenario_on(straight_road()), problem_for(goal), configuration("frenetix:Safety-Conservative"))
    assert run.final.outcome == "goal_reached"
    assert "distance_to_obstacles" not in run.plans[0].costs


def test_a_term_of_the_step_before_is_forgotten() -> None:
    """An obstacle that is gone must not go on costing: the handler keeps functions until they are removed."""
    visitor = moving_car(5, (30.0, 30.0), (0.0, 10.0), steps=10)
    goal = goal_state((35, 45), rectangle_at(40.0, 0.0))
    run = drive(scenario_on(straight_road(), visitor), problem_for(goal), configuration("frenetix:Safety"))
    assert "distance_to_obstacles" in run.plans[0].costs
    assert "distance_to_obstacles" not in run.plans[-1].costs


def test_a_plan_that_stops_in_time_is_not_lost_by_replanning() -> None:
    """Every new candidate takes at least 1.1 s; without the rest of the old plan the ego slides into the obstacle."""
    scenario = scenario_on(straight_road(), parked_car(7, (60.0, 0.0)))
    run = drive(scenario, problem_for(goal_state((60, 70), rectangle_at(100.0, 0.0))))
    assert run.final.outcome == "timeout"
    assert run.plans[1].candidates == run.plans[0].candidates + 1


def test_going_on_is_the_old_plan() -> None:
    """A quartic and a quintic with the same end conditions from a later point are the same polynomials."""
    start = CurvilinearState(np.array([50.0, 10.0, 0.5]), np.array([0.3, 0.2, 0.0]), low_speed=False)
    whole = only_candidate(start, EndState(2.0, 5.0, 1.0))
    later = CurvilinearState(whole[:3, 3], whole[3:, 3], low_speed=False)
    rest = only_candidate(later, EndState(1.7, 5.0, 1.0))
    assert np.allclose(rest[:, :17], whole[:, 3:20], atol=1e-9)


def only_candidate(state: CurvilinearState, end: EndState) -> Any:
    """Curvilinear states (6, n) of the candidate that goes on to an end."""
    frame = FrenetFrame.of(np.stack([np.arange(0.0, 200.0), np.zeros(200)], axis=1), 0.0)
    handler = frenetix.TrajectoryHandler(0.1)
    handler.add_function(frenetix.trajectory_functions.FillCoordinates(False, 0.0, frame.system, 3.0))
    handler.generate_trajectories(sampling_matrix(state, 10.0, SamplingSettings(), BMW_320I, end)[-1:], False)
    handler.evaluate_all_current_functions(False)
    return copied_curvilinear(next(iter(handler.get_sorted_trajectories())))


def test_candidates_of_a_fast_ego_at_the_end_of_the_map_stay_on_the_reference_path() -> None:
    goal = goal_state((10, 30), rectangle_at(100.0, 0.0, size=(60.0, 3.5)))
    run = drive(scenario_on(straight_road(150.0)), problem_for(goal, speed_mps=33.0))
    assert run.final.outcome == "goal_reached"
    assert run.rejected["off_reference_path"] == 0


@pytest.mark.parametrize("turns", [-1, 3])
def test_headings_written_beyond_pi_mean_the_same_and_go_on_as_they_are_written(turns: int) -> None:
    runs = []
    for beyond_rad in (0.0, turns * math.tau):
        problem = problem_for(goal_state((35, 45), rectangle_at(40.0, 0.0), heading=(-0.2, 0.2)), position=(0.0, 0.4))
        problem.initial_state.orientation = 0.05 + beyond_rad
        car = moving_car(5, (30.0, 0.0), (10.0, 0.0))
        car.initial_state.orientation = -2 * beyond_rad
        runs.append(drive(scenario_on(straight_road(), car), problem))
    plain, beyond = (np.array([[*state.position, state.heading_rad] for state in run.states]) for run in runs)
    assert [run.final.outcome for run in runs] == ["goal_reached", "goal_reached"]
    assert np.allclose(beyond - plain, [0.0, 0.0, turns * math.tau], atol=1e-6)


def test_an_ego_at_crossing_lanes_is_on_its_own_with_any_form_of_its_heading() -> None:
    along, across = np.array([[-50.0, 0.0], [50.0, 0.0]]), np.array([[0.0, -50.0], [0.0, 50.0]])
    network = network_of(lanelet_along(along, 1), lanelet_along(across, 2))
    assert [start_lanelets(network, np.zeros(2), turns * math.tau)[0] for turns in (-1, 0, 3)] == [1, 1, 1]


def test_the_core_gets_the_smallest_angle_of_a_heading() -> None:
    frame = FrenetFrame.of(np.stack([np.arange(0.0, 50.0), np.zeros(50)], axis=1), 0.0)
    assert [frame.heading_inwards(0.3 + turns * math.tau) for turns in (-1, 0, 3)] == pytest.approx([0.3, 0.3, 0.3])


@pytest.mark.parametrize("prediction", ["constant_velocity", "ground_truth"])
def test_the_ego_stops_before_a_set_based_prediction_and_passes_without_one(prediction: Any) -> None:
    initial = moving_car(4, (60.0, 0.0), (0.1, 0.0)).initial_state
    regions = [Occupancy(step, Rectangle(6.0, 2.5, center=np.array([60.0, 0.0]))) for step in range(1, 150)]
    region = DynamicObstacle(3, ObstacleType.UNKNOWN, Rectangle(4.5, 1.8), initial, SetBasedPrediction(1, regions))
    lone = DynamicObstacle(
        4, ObstacleType.CAR, Rectangle(4.5, 1.8), moving_car(4, (0.0, 40.0), (1.0, 0.0)).initial_state
    )
    goal = goal_state((60, 70), rectangle_at(100.0, 0.0))
    run = drive(scenario_on(straight_road(), region, lone), problem_for(goal), prediction=prediction)
    assert run.final.outcome == "timeout"
    assert 45.0 < run.states[-1].position[0] < 57.0 - BMW_320I.length_m / 2


def test_the_cores_acceleration_costs_are_a_quarter_as_the_presets_weights_expect() -> None:
    """Halved accelerations, squared. The presets' weights were found with them, so the terms stay as they are."""
    state = CurvilinearState(np.array([50.0, 10.0, 0.0]), np.zeros(3), low_speed=False)
    frame = FrenetFrame.of(np.stack([np.arange(0.0, 200.0), np.zeros(200)], axis=1), 0.0)
    handler = frenetix.TrajectoryHandler(0.1)
    handler.add_function(frenetix.trajectory_functions.FillCoordinates(False, 0.0, frame.system, 3.0))
    handler.add_cost_function(costs.CalculateAccelerationCost("acceleration", 1.0))
    handler.add_cost_function(costs.CalculateJerkCost("jerk", 1.0))
    ending = EndState(3.0, 4.0, 0.0)
    handler.generate_trajectories(sampling_matrix(state, 10.0, SamplingSettings(), BMW_320I, ending)[-1:], False)
    handler.evaluate_all_current_functions(False)
    found = next(iter(handler.get_sorted_trajectories())).costMap
    # from 10 to 4 m/s in 3 s without acceleration at the ends: a = -12 u (1 - u) and jerk = -4 (1 - 2 u), u = t / 3
    assert found["acceleration"][0] == pytest.approx(3.0 * 144.0 / 30.0 / 4, rel=0.02)
    assert found["jerk"][0] == pytest.approx(3.0 * 16.0 / 3.0 / 4, rel=0.2)  # 30 coarse differences


def test_uncertain_initial_values_count_by_their_middle() -> None:
    problem = problem_for(goal_state((35, 45), rectangle_at(40.0, 0.0)))
    problem.initial_state.velocity = Interval(9.0, 11.0)
    problem.initial_state.position = Rectangle(1.0, 1.0, center=np.array([0.0, 0.0]))
    assert drive(scenario_on(straight_road()), problem).final.outcome == "goal_reached"


@pytest.mark.shared_data
def test_real_files_with_traps_run(shared_data: Path) -> None:
    """No obstacle's trajectory (set-based), headings beyond ±π, several goal states, a position-free goal."""
    from plannerforge.engine.commonroad.reader import read_scenario

    for name in ("ZAM_test_0-1", "C-DEU_B471-1_3_T-1", "USA_US101-1_2_T-1"):
        loaded = read_scenario(shared_data / "data" / "commonroad" / f"{name}.xml")
        assert drive(loaded.scenario, loaded.problem()).final.reason


def test_second_derivatives_are_the_true_ones() -> None:
    """The core reports half of them; a plan that goes on must not begin with a jump in acceleration."""
    start = CurvilinearState(np.array([50.0, 10.0, 0.5]), np.array([0.3, 0.2, 0.1]), low_speed=False)
    states = only_candidate(start, EndState(2.0, 5.0, 1.0))
    assert states[2, 0] == pytest.approx(0.5)
    assert states[5, 0] == pytest.approx(0.1)
    differences = np.gradient(states[[1, 4]], 0.1, axis=1)
    assert np.allclose(differences[:, 2:17], states[[2, 5], 2:17], atol=0.03)
