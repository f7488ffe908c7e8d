"""The speed that bends allow, and the baseline that keeps it."""

import math
from typing import Any

import numpy as np
import pytest
from commonroad.geometry.shape import Rectangle
from support.planning import configuration, drive, goal_state, lanelet_along, network_of, problem_for, scenario_on

from plannerforge.engine.planners.driving.desired_speed import curve_speeds_mps
from plannerforge.engine.planners.idm import IntelligentDriver

RADIUS_M = 15.0


def test_in_a_long_curve_it_is_the_root_of_lateral_acceleration_times_radius() -> None:
    stations = np.arange(201.0)
    headings = np.clip(stations - 100.0, 0.0, 60.0) / 30.0  # from 100 m to 160 m with a radius of 30 m
    speeds = curve_speeds_mps(stations, headings, 3.0, 1.5)
    assert speeds[130] == pytest.approx(math.sqrt(3.0 * 30.0), rel=1e-6)
    assert speeds[50] == pytest.approx(math.sqrt(90.0 + 2 * 1.5 * 50.0), abs=1.0)
    assert np.diff(speeds[:95] ** 2).min() == pytest.approx(-2 * 1.5)
    assert speeds[190] > 100.0


def corner() -> Any:
    """120 m straight on, a quarter of a circle to the left, 120 m straight on."""
    angle = np.linspace(0.0, math.pi / 2, 25)[1:]
    arc = RADIUS_M * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1) + [100.0, 0.0]
    before = np.stack([np.linspace(-20.0, 100.0, 61), np.zeros(61)], axis=1)
    after = arc[-1] + np.stack([np.zeros(60), np.linspace(2.0, 120.0, 60)], axis=1)
    return network_of(lanelet_along(np.concatenate([before, arc, after]), 1))


def through_the_corner(*changes: str) -> tuple[float, Any]:
    """The largest lateral acceleration and the run, from 14 m/s towards a goal 80 m behind the corner."""
    goal = goal_state((60, 260), Rectangle(20.0, 8.0, np.array([115.0, 90.0])))
    config = configuration("idm", "acceleration_mps2=2", *changes)
    run = drive(scenario_on(corner()), problem_for(goal, speed_mps=14.0), config, planner=IntelligentDriver())
    return max(abs(state.speed_mps * state.yaw_rate_radps) for state in run.states), run


@pytest.mark.parametrize("limit", [1.5, 3.0])
def test_the_baseline_slows_down_for_a_curve_and_brakes_comfortably(limit: float) -> None:
    largest, run = through_the_corner(f"lateral_acceleration_mps2={limit}")
    assert run.final.outcome == "goal_reached"
    assert 0.7 * limit < largest < 1.25 * limit
    assert min(np.diff([state.speed_mps for state in run.states])) / 0.1 > -1.7


def test_a_large_limit_lets_it_drive_on() -> None:
    assert through_the_corner("lateral_acceleration_mps2=10")[0] > 4.5
