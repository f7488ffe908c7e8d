"""What the core of FISS does that a planner must know of, and what is done about it."""

import math
from itertools import pairwise
from typing import Any

import fiss_planner
import numpy as np
import pytest
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

from plannerforge.engine.geometry import Points
from plannerforge.engine.planners.fiss.core import (
    PathLine,
    core_configuration,
    core_obstacles,
    dragged_headings,
    vehicle_limits,
)
from plannerforge.engine.planners.fiss.planner import Fiss
from plannerforge.engine.planners.interface import EgoState, PredictedObstacle
from plannerforge.engine.planners.reference_path import ReferencePath
from plannerforge.engine.vehicles import VehicleParameters, tractrix
from plannerforge.engine.vehicles.models import BMW_320I


def line_of(points: Points) -> PathLine:
    return PathLine(ReferencePath(points, (1,), None, float(len(points))), 8.0)


def straight_line() -> PathLine:
    return line_of(np.stack([np.arange(0.0, 200.0), np.zeros(200)], axis=1))


def circle(radius_m: float, laps: float) -> Points:
    angle = np.linspace(0.0, laps * math.tau, round(laps * math.tau * radius_m) + 1)
    return radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)


def planned(line: PathLine, start: Any, obstacles: Any = (), target_mps: float = 10.0) -> Any:
    made = configuration("fiss")
    core = fiss_planner.make_planner(
        core_configuration(made.weights, made.settings, 0.1, every_candidate=True), vehicle_limits(BMW_320I)
    )
    corridor = fiss_planner.Corridor.uniform(0.0, 190.0, -1.75, 1.75)
    return core.plan(start, line.line, corridor, list(obstacles), target_speed=target_mps)


def test_arrays_of_a_candidate_are_copies_that_outlive_the_next_plan() -> None:
    line, start = straight_line(), fiss_planner.FrenetState(s=10.0, s_d=10.0)
    result = planned(line, start)
    x = result.trajectory.x
    before = x.copy()
    x[0] = -1.0
    assert result.trajectory.x[0] == before[0]
    del result
    planned(line, start)
    assert np.array_equal(x[1:], before[1:])


def test_no_obstacles_are_fine() -> None:
    assert planned(straight_line(), fiss_planner.FrenetState(s=10.0, s_d=10.0)).success
    assert core_obstacles((), EgoState(0, np.zeros(2), 0.0, 10.0), 30.0, 0.1) == []


def test_obstacles_out_of_reach_are_left_out_and_predictions_can_be_cut() -> None:
    def obstacle(x_m: float) -> PredictedObstacle:
        positions = np.stack([x_m + np.arange(31) * 0.5, np.zeros(31)], axis=1)
        return PredictedObstacle(7, positions, np.zeros(31), np.zeros((2, 2)), 4.5, 1.8, 5.0)

    ego = EgoState(0, np.zeros(2), 0.0, 10.0)
    assert core_obstacles([obstacle(400.0)], ego, 30.0, 0.1) == []
    whole, cut = (core_obstacles([obstacle(20.0)], ego, 30.0, 0.1, until)[0] for until in (math.inf, 1.0))
    assert (len(whole.prediction), len(cut.prediction)) == (31, 11)
    assert cut.box_at(2.0) is None


def test_the_ego_is_found_on_the_lap_that_it_drives() -> None:
    line = line_of(circle(20.0, 1.6))
    ego = EgoState(0, np.array([20.0 * math.sin(0.5), 20.0 - 20.0 * math.cos(0.5)]), 0.5, 8.0)
    first, second = (line.start(ego, BMW_320I, near) for near in (10.0, 10.0 + 40.0 * math.pi))
    assert first is not None
    assert second is not None
    assert second.s - first.s == pytest.approx(40.0 * math.pi, abs=0.1)


def test_an_ego_that_heads_against_the_path_is_refused() -> None:
    ego = EgoState(0, np.array([50.0, 0.0]), math.pi, 8.0)
    assert straight_line().start(ego, BMW_320I, 50.0) is None


def test_headings_go_on_from_the_ego_across_the_wrap() -> None:
    scenario = scenario_on(straight_road(300.0, angle_rad=math.pi))
    goal = goal_state((40, 60), rectangle_at(50.0, 0.0, math.pi))
    run = drive(scenario, problem_for(goal, angle_rad=math.pi), configuration("fiss"), planner=Fiss())
    assert run.final.outcome == "goal_reached"
    headings = np.array([state.heading_rad for state in run.states])
    assert np.abs(np.diff(headings)).max() < 0.1


def test_a_path_that_crosses_the_wrap_in_a_curve_is_driven() -> None:
    center = circle(40.0, 0.75)
    network = network_of(lanelet_along(center, 1))
    goal = goal_state((100, 190), rectangle_at(*center[150], size=(6.0, 6.0)))
    run = drive(scenario_on(network), problem_for(goal, speed_mps=8.0), configuration("fiss"), planner=Fiss())
    assert run.final.outcome == "goal_reached"


def test_a_standing_ego_off_its_path_does_not_slide_to_it() -> None:
    problem = problem_for(goal_state((80, 120), rectangle_at(30.0, 0.0)), speed_mps=0.0, position=(0.0, 0.5))
    run = drive(scenario_on(straight_road(300.0)), problem, configuration("fiss"), planner=Fiss())
    assert run.final.outcome == "goal_reached"
    for before, after in pairwise(run.states):
        moved = after.position - before.position
        across = abs(float(moved @ [-math.sin(before.heading_rad), math.cos(before.heading_rad)]))
        assert across <= 0.02 + 0.1 * float(np.linalg.norm(moved))


def test_the_rod_that_is_dragged_agrees_with_small_steps() -> None:
    line = circle(15.0, 0.4)
    exact = dragged_headings(line, 0.3, 1.4)
    assert exact == pytest.approx(tractrix(line, 0.3, 1.4), abs=0.03)
    fine = np.concatenate([np.linspace(a, b, 200, endpoint=False) for a, b in pairwise(line)])
    assert exact[:-1] == pytest.approx(tractrix(fine, 0.3, 1.4)[::200], abs=0.002)


def test_limits_never_exceed_those_of_a_weaker_vehicle() -> None:
    weak = VehicleParameters(**(vars(BMW_320I) | {"maximum_acceleration_mps2": 3.0}))
    limits = vehicle_limits(weak)
    assert max(limits.max_accel, limits.max_decel, limits.max_lat_accel) <= 3.0


def test_an_ego_close_behind_another_still_gets_a_plan() -> None:
    """The core keeps 0.5 m before and behind at every state, the present one included."""
    queue = moving_car(7, (5.0, 0.0), (2.0, 0.0)), moving_car(8, (-5.0, 0.0), (2.0, 0.0))
    goal = goal_state((40, 120), rectangle_at(16.0, 0.0))
    run = drive(
        scenario_on(straight_road(300.0), *queue),
        problem_for(goal, speed_mps=2.0),
        configuration("fiss"),
        planner=Fiss(),
    )
    assert run.final.outcome == "goal_reached"
