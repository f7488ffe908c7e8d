"""The ego as a vehicle: it follows plans within its limits, and plans that it can drive exactly."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.planning import (
    as_planned,
    configuration,
    drive,
    goal_state,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.geometry import Values
from plannerforge.engine.planners.driving.drivability import excesses_of
from plannerforge.engine.planners.driving.following import FollowedPlan, follow, is_on_plan
from plannerforge.engine.planners.interface import EgoState, PlannedTrajectory
from plannerforge.engine.vehicles import BMW_320I, centers

STEP_S = 0.1


def planned(headings: Values, speeds: Values, begin: tuple[float, float] = (0.0, 0.0)) -> PlannedTrajectory:
    """A plan of the centre whose rear axle moves where it heads."""
    mean, middle = (speeds[1:] + speeds[:-1]) / 2, (headings[1:] + headings[:-1]) / 2
    way = mean * STEP_S * np.sinc(np.diff(headings) / (2 * np.pi))
    x = begin[0] + np.concatenate([[0.0], np.cumsum(way * np.cos(middle))])
    y = begin[1] + np.concatenate([[0.0], np.cumsum(way * np.sin(middle))])
    positions = centers(np.stack([x, y], axis=1), headings, BMW_320I)
    return PlannedTrajectory(positions, headings, speeds, np.gradient(speeds, STEP_S))


def turning(rates_radps: Values, speed_mps: float) -> PlannedTrajectory:
    """A plan at one speed that turns so fast in each step."""
    headings = np.concatenate([[0.0], np.cumsum(rates_radps * STEP_S)])
    return planned(headings, np.full(len(headings), speed_mps))


def ego_at(plan: PlannedTrajectory, steering_rad: float | None = None) -> EgoState:
    """The ego where a plan begins."""
    return EgoState(
        0, plan.positions[0], float(plan.headings_rad[0]), float(plan.speeds_mps[0]), steering_rad=steering_rad
    )


def followed(plan: PlannedTrajectory, steering_rad: float | None = None) -> FollowedPlan:
    return follow(plan, ego_at(plan, steering_rad), BMW_320I, STEP_S)


def steering_rates(answer: FollowedPlan) -> Values:
    assert answer.trajectory.steering_rad is not None
    return np.asarray(np.abs(np.diff(answer.trajectory.steering_rad)) / STEP_S)


def smooth_turn(speed_mps: float, peak_radps: float) -> PlannedTrajectory:
    return turning(peak_radps * np.sin(np.linspace(0.0, np.pi, 30)) ** 2, speed_mps)


def test_a_plan_that_the_vehicle_can_drive_is_followed_exactly() -> None:
    plan = smooth_turn(8.0, 0.4)
    answer = followed(plan, 0.0)
    assert excesses_of(plan, BMW_320I, STEP_S) == ()
    assert answer.within_tyres
    assert answer.deviation_m < 0.005
    assert np.abs(answer.trajectory.positions - plan.positions).max() < 0.02


def test_the_motion_is_that_of_the_kinematic_single_track_model() -> None:
    answer = followed(smooth_turn(9.0, 0.7), 0.0).trajectory
    assert answer.steering_rad is not None
    state = np.array([*(answer.positions[0] - [1.4227, 0.0]), 0.0])
    for index in range(30):
        pairs = [(values[index], values[index + 1]) for values in (answer.speeds_mps, answer.steering_rad)]

        def motion(time_s: float, at: Values, pairs: list[tuple[float, float]] = pairs) -> list[float]:
            speed, angle = (before + (after - before) * time_s / STEP_S for before, after in pairs)
            return [speed * math.cos(at[2]), speed * math.sin(at[2]), speed * math.tan(angle) / BMW_320I.wheelbase_m]

        state = solve_ivp(motion, (0.0, STEP_S), state, rtol=1e-10, atol=1e-12).y[:, -1]
    centre = state[:2] + 1.4227 * np.array([math.cos(state[2]), math.sin(state[2])])
    assert centre == pytest.approx(answer.positions[-1], abs=1e-5)
    assert state[2] == pytest.approx(answer.headings_rad[-1], abs=1e-6)


@pytest.mark.parametrize("speed_mps", [1.0, 4.0, 9.0])
def test_the_steering_rate_is_never_exceeded_however_sudden_the_turn(speed_mps: float) -> None:
    plan = turning(np.repeat([0.0, 0.9, 0.0], 10), speed_mps)
    answer = followed(plan, 0.0)
    assert "steering rate" in {excess.name for excess in excesses_of(plan, BMW_320I, STEP_S)}
    assert steering_rates(answer).max() <= BMW_320I.maximum_steering_rate_radps
    assert excesses_of(answer.trajectory, BMW_320I, STEP_S) == ()


def test_the_vehicle_begins_to_steer_before_a_turn_that_begins_at_once() -> None:
    plan = turning(np.repeat([0.0, 0.5], 15), 8.0)
    answer = followed(plan, 0.0)
    assert answer.trajectory.steering_rad is not None
    assert answer.trajectory.steering_rad[14] > 0.02
    assert answer.deviation_m < 0.15


def test_the_first_steering_angle_is_free_only_if_it_is_unknown() -> None:
    plan = turning(np.full(30, 0.5), 8.0)
    free, known = followed(plan), followed(plan, 0.0)
    assert free.deviation_m < 0.005 < known.deviation_m
    assert known.trajectory.steering_rad is not None
    assert known.trajectory.steering_rad[0] == 0.0


def test_a_vehicle_off_its_plan_returns_to_it() -> None:
    plan = turning(np.zeros(30), 10.0)
    ego = EgoState(0, plan.positions[0] + [0.0, 0.3], 0.0, 10.0, steering_rad=0.0)
    answer = follow(plan, ego, BMW_320I, STEP_S)
    assert answer.trajectory.positions[0] == pytest.approx(ego.position)
    assert abs(answer.trajectory.positions[-1, 1]) < 0.01


def test_a_standing_vehicle_stays_in_place() -> None:
    plan = turning(np.zeros(30), 0.0)
    ego = EgoState(0, plan.positions[0] + [0.0, 0.2], 0.1, 0.0, steering_rad=0.3)
    answer = follow(plan, ego, BMW_320I, STEP_S).trajectory
    assert np.abs(answer.positions - ego.position).max() == 0.0
    assert np.abs(answer.headings_rad - 0.1).max() == 0.0


def test_accelerations_beyond_tyres_and_engine_are_limited_and_reported() -> None:
    speeds = np.minimum(20.0 + 1.0 * np.arange(31), 40.0)  # 10 m/s², where the engine has 4.2
    answer = followed(planned(np.zeros(31), speeds), 0.0)
    assert not answer.within_tyres
    assert excesses_of(answer.trajectory, BMW_320I, STEP_S) == ()


def test_a_plan_is_continued_only_near_it() -> None:
    plan = turning(np.zeros(30), 10.0)
    near = EgoState(1, plan.positions[1] + [0.0, 0.2], 0.0, 10.0)
    assert is_on_plan(plan, 1, near, 0.3)
    assert not is_on_plan(plan, 1, near, 0.1)
    assert not is_on_plan(plan, 40, near, 0.3)


@pytest.mark.parametrize("name", ["frenetix:Default", "mp_rbfn:Default", "idm:Default", "fiss:Default"])
def test_every_built_in_planner_drives_a_vehicle(name: str) -> None:
    from plannerforge.engine.planners.registry import make_planner

    config = configuration(name)
    problem = problem_for(goal_state((30, 60), rectangle_at(45.0, 0.0)), speed_mps=9.0, position=(0.0, 0.4))
    run = drive(scenario_on(straight_road()), problem, config, planner=make_planner(config.planner))
    assert run.final.outcome == "goal_reached"
    assert run.steering_rad is not None
    assert np.abs(np.diff(run.steering_rad)).max() <= BMW_320I.maximum_steering_rate_radps * STEP_S


def test_plans_that_are_driven_as_they_are_have_no_steering(monkeypatch: pytest.MonkeyPatch) -> None:
    as_planned(monkeypatch)
    problem = problem_for(goal_state((30, 60), rectangle_at(45.0, 0.0)), speed_mps=9.0)
    assert drive(scenario_on(straight_road()), problem).steering_rad is None
