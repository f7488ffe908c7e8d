"""What the ego drives can be driven: its heading is the motion of its rear axle, and its tyres and wheels suffice."""

import math
from typing import Any

import frenetix
import numpy as np
import pytest
from commonroad.geometry.shape import Rectangle
from frenetix.trajectory_functions import FillCoordinates
from frenetix.trajectory_functions.feasability_functions import CheckCurvatureConstraint
from support.planning import (
    as_planned,
    configuration,
    drive,
    goal_state,
    lanelet_along,
    network_of,
    problem_for,
    scenario_on,
)

from plannerforge.engine.commonroad import Track
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.planners.driving.drivability import exceeded_limits, violated_limit
from plannerforge.engine.planners.frenetix import core as frenet_frame
from plannerforge.engine.planners.frenetix import planner as planner_module
from plannerforge.engine.planners.frenetix.core import (
    CurvilinearState,
    EndState,
    FrenetFrame,
    SamplingSettings,
    copied_trajectory,
    sampling_matrix,
)
from plannerforge.engine.planners.interface import EgoState, PlannedTrajectory
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.planners.simulation import DrivenRun
from plannerforge.engine.tuning.configurations import changed_configuration
from plannerforge.engine.vehicles.kinematics import rear_axle
from plannerforge.engine.vehicles.models import BMW_320I

STEP_S = 0.1
STRAIGHT = np.stack([np.arange(0.0, 200.0), np.zeros(200)], axis=1)


def around_the_corner(
    radius_m: float,
    speed_mps: float,
    last_step: int = 150,
    name: str = "frenetix:Default",
    before_m: float = 50.0,
    settings: tuple[str, ...] = (),
) -> DrivenRun:
    """A run over a straight, a left turn by 90°, and 60 m straight on."""
    turn = np.linspace(0.0, math.pi / 2, 60)
    straight = np.arange(-60.0, 0.0)
    corner = radius_m * np.stack([np.sin(turn), 1.0 - np.cos(turn)], axis=1)
    after = np.stack([np.full(60, radius_m), radius_m + np.arange(1.0, 61.0)], axis=1)
    center = np.concatenate([np.stack([straight, np.zeros(60)], axis=1), corner, after])
    goal = goal_state(
        (40, last_step), Rectangle(12.0, 3.5, center=np.array([radius_m, radius_m + 30.0]), orientation=1.57)
    )
    problem = problem_for(goal, speed_mps=speed_mps, position=(-before_m, 0.0))
    scenario = scenario_on(network_of(lanelet_along(center, 1)))
    config, _ = changed_configuration(configuration(name), None, (), settings)
    return drive(scenario, problem, config, planner=make_planner(config.planner))


def aside_of_the_motion(run: DrivenRun) -> float:
    """Largest angle in rad between the ego's heading and the motion of its rear axle, while it moves."""
    rear = np.array([rear_axle(state.position, state.heading_rad, BMW_320I) for state in run.states])
    moved = np.diff(rear, axis=0)
    heading = np.unwrap([state.heading_rad for state in run.states])
    middle = 0.5 * (heading[1:] + heading[:-1])
    turned = np.remainder(np.arctan2(moved[:, 1], moved[:, 0]) - middle + math.pi, math.tau) - math.pi
    return float(np.abs(turned[np.linalg.norm(moved, axis=1) > 0.1]).max())


def strongest(run: DrivenRun) -> float:
    """Largest acceleration of a run, along and across together, in m/s²."""
    speed = np.array([state.speed_mps for state in run.states])
    turned = np.diff(np.unwrap([state.heading_rad for state in run.states])) / STEP_S
    return float(np.hypot(np.diff(speed) / STEP_S, 0.5 * (speed[1:] + speed[:-1]) * turned).max())


@pytest.mark.parametrize("name", ["frenetix:Default", "idm"])
def test_the_heading_in_a_curve_is_the_motion_of_the_rear_axle(name: str) -> None:
    run = around_the_corner(13.0, 6.0, name=name)
    assert run.final.outcome == "goal_reached"
    assert aside_of_the_motion(run) < 0.015


def test_with_the_cores_own_headings_it_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    as_planned(monkeypatch)
    monkeypatch.setattr(frenet_frame, "tangents", lambda segments: segments)
    assert aside_of_the_motion(around_the_corner(13.0, 6.0)) > 0.03


def test_the_headings_at_the_vertices_of_a_circle_are_its_tangents() -> None:
    angles = np.arange(0.0, 3.0, 1.0 / 13.0)
    system = FrenetFrame.of(13.0 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1), 0.0).system
    vertices = np.array(system.ref_line)[4:-4]  # the core lengthens the line by points of its own at both ends
    tangents = np.arctan2(vertices[:, 0], 13.0 - vertices[:, 1])
    assert np.array(system.ref_theta)[4:-4] == pytest.approx(tangents, abs=1e-9)


def test_a_fast_ego_slows_down_for_a_corner_as_far_as_its_tyres_demand() -> None:
    run = around_the_corner(8.0, 17.0, last_step=60)
    assert run.rejected["friction"] > 0
    assert strongest(run) <= BMW_320I.maximum_acceleration_mps2


def test_the_lane_follower_exceeds_its_comfortable_braking_before_a_corner_too_fast() -> None:
    run = around_the_corner(8.0, 17.0, name="idm")
    assert run.final.outcome == "goal_reached"
    assert strongest(run) <= BMW_320I.maximum_acceleration_mps2


def test_the_lane_follower_reports_unavoidable_sliding() -> None:
    run = around_the_corner(8.0, 17.0, name="idm", before_m=6.0)
    assert run.final.outcome == "infeasible"
    assert run.rejected == {"friction": 1}


@pytest.mark.parametrize(
    ("setting", "limit"), [("maximum_steering_rad=0.2", {"curvature": 1}), ("wheelbase_m=4.4", {}), ("vehicle=2", {})]
)
def test_the_wheels_of_the_lane_follower_turn_only_so_far(setting: str, limit: dict[str, int]) -> None:
    run = around_the_corner(8.0, 6.0, name="idm", settings=(setting,))
    assert run.rejected == limit
    assert run.final.outcome == ("infeasible" if limit else "goal_reached")


def test_the_heading_of_the_lane_follower_depends_on_its_rear_axle() -> None:
    near, far = (
        around_the_corner(8.0, 6.0, name="idm", settings=(f"rear_axle_behind_center_m={b}",)) for b in (0.4, 2.0)
    )
    turned = [np.array([state.heading_rad for state in run.states[:90]]) for run in (near, far)]
    assert (turned[0] - turned[1]).max() > 0.05  # a rear axle far behind turns later


def test_by_the_cores_checks_alone_it_would_slide_out(monkeypatch: pytest.MonkeyPatch) -> None:
    as_planned(monkeypatch)
    monkeypatch.setattr(planner_module, "violated_limit", lambda *_: None)
    assert strongest(around_the_corner(8.0, 17.0, last_step=60)) > 1.2 * BMW_320I.maximum_acceleration_mps2


def circling(radius_m: float, speed_mps: float, braking_mps2: float = 0.0) -> PlannedTrajectory:
    """One second on a circle."""
    speed = speed_mps - braking_mps2 * STEP_S * np.arange(11)
    headings = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * STEP_S / radius_m)])
    return PlannedTrajectory(np.zeros((11, 2)), headings, speed, np.full(11, -braking_mps2))


@pytest.mark.parametrize(
    ("trajectory", "limit"),
    [
        (circling(20.0, 15.0), None),  # 11.25 m/s² across
        (circling(20.0, 15.3), "friction"),  # 11.70 m/s² across
        (circling(20.0, 13.0, 7.0), None),  # 8.45 across and 7 along: 10.97 m/s²
        (circling(20.0, 13.0, 9.0), "friction"),  # 12.3 m/s²
        (circling(1.5, 2.0), None),  # tan(1.066 rad) / 2.579 m is one over 1.43 m
        (circling(1.4, 2.0), "curvature"),
        (circling(-1.4, 2.0), "curvature"),
        (circling(0.5, 0.3), None),  # too slow to tell
    ],
)
def test_the_limits_of_the_vehicle(trajectory: PlannedTrajectory, limit: str | None) -> None:
    assert violated_limit(trajectory, BMW_320I, STEP_S) == limit


def swerving(end: EndState, speed_mps: float) -> Any:
    """The core's sample, with its own check of the curvature."""
    state = CurvilinearState(np.array([50.0, speed_mps, 0.0]), np.zeros(3), low_speed=False)
    handler = frenetix.TrajectoryHandler(STEP_S)
    system = FrenetFrame.of(STRAIGHT, 0.0).system
    handler.add_function(FillCoordinates(False, 0.0, system, 3.0))
    handler.add_feasability_function(
        CheckCurvatureConstraint(BMW_320I.maximum_steering_rad, BMW_320I.wheelbase_m, False)
    )
    matrix: Points = sampling_matrix(state, speed_mps, SamplingSettings(), BMW_320I, end)[-1:]
    handler.generate_trajectories(matrix, False)
    handler.evaluate_all_current_functions(False)
    return next(iter(handler.get_sorted_trajectories())), handler


def test_the_core_accepts_a_swerve_twice_as_tight_as_it_computes() -> None:
    sample, _handler = swerving(EndState(1.1, 3.2, 2.0), 3.2)
    ego = EgoState(0, np.array([51.4227, 0.0]), 0.0, 3.2)
    trajectory = copied_trajectory(sample, FrenetFrame.of(STRAIGHT, 0.0), ego, BMW_320I)
    true = np.abs(np.diff(trajectory.headings_rad) / STEP_S / trajectory.speeds_mps[1:]).max()
    assert np.abs(np.array(sample.cartesian.kappa)).max() == pytest.approx(true / 2, rel=0.1)
    assert sample.feasible
    assert violated_limit(trajectory, BMW_320I, STEP_S) == "curvature"


def turning(steering_rad: Points, speed_mps: Points) -> Track:
    """A vehicle 2 that drives with these steering angles, in a fine step: its centre at every 0.1 s."""
    fine = 100
    x = y = heading = 0.0
    states = []
    rear_m, wheelbase_m = BMW_320I.rear_axle_behind_center_m, BMW_320I.wheelbase_m
    for step in range(len(speed_mps) - 1):
        states.append((x + rear_m * math.cos(heading), y + rear_m * math.sin(heading), heading))
        for part in range(fine):
            share = part / fine
            speed = speed_mps[step] + share * (speed_mps[step + 1] - speed_mps[step])
            angle = steering_rad[step] + share * (steering_rad[step + 1] - steering_rad[step])
            x += speed * math.cos(heading) * STEP_S / fine
            y += speed * math.sin(heading) * STEP_S / fine
            heading += speed * math.tan(angle) / wheelbase_m * STEP_S / fine
    states = np.array(states)
    speeds = speed_mps[:-1]
    return Track(-1, "car", BMW_320I.length_m, BMW_320I.width_m, 0, states[:, :2], states[:, 2], speeds)


def test_a_drivable_motion_exceeds_no_limit_of_the_vehicle() -> None:
    steering = 0.2 * np.sin(np.arange(60) / 10)
    assert list(exceeded_limits(turning(steering, np.full(60, 8.0)), BMW_320I, STEP_S)) == []


def test_wheels_that_turn_too_fast_are_reported_with_their_moment() -> None:
    ramp = np.concatenate([np.zeros(20), np.arange(1, 5) * 0.08, np.full(20, 0.32)])
    found = {one.name: one for one in exceeded_limits(turning(ramp, np.full(44, 4.0)), BMW_320I, STEP_S)}
    assert set(found) == {"steering rate"}
    assert found["steering rate"].value == pytest.approx(0.8, rel=0.02)
    assert found["steering rate"].time_s == pytest.approx(2.2, abs=0.11)
    assert found["steering rate"].in_words().startswith("steering rate 0.8 rad/s at 2.")


def test_braking_beyond_the_tyres_is_reported() -> None:
    speed = np.maximum(20.0 - 1.4 * np.arange(20), 0.0)
    found = {one.name: one for one in exceeded_limits(turning(np.zeros(20), speed), BMW_320I, STEP_S)}
    assert found["friction"].value == pytest.approx(14.0)
    assert found["friction"].limit == 11.5


def test_a_body_that_moves_aside_slides() -> None:
    count = np.arange(30)
    aside = np.column_stack([count * 1.0, count * 0.1])
    track = Track(-1, "car", 4.5, 1.6, 0, aside, np.zeros(30), np.full(30, 10.0))
    (found,) = exceeded_limits(track, BMW_320I, STEP_S)
    assert (found.name, found.value) == ("rolling", 1.0)
    assert "slide in 100% of the steps" in found.in_words()
