"""The terms that the core lacks, against values computed by hand."""

import math

import numpy as np
import pytest
from builders_planning import straight_road

from plannerforge.engine.planners.cost_terms import (
    CandidateBatch,
    lane_center_offset,
    path_length,
    responsibility,
    velocity,
)
from plannerforge.engine.planners.interface import PredictedObstacle
from plannerforge.engine.planners.lane_center import OUTSIDE_M, LaneCenters

STEPS = 31


def straight(
    speed: float, offset: float = 0.0, *others: PredictedObstacle, target: float | None = 8.0
) -> CandidateBatch:
    """One candidate straight along the x axis beside the centre of lane 1."""
    time = np.arange(STEPS) * 0.1
    return CandidateBatch(
        x_m=(speed * time)[None, :],
        y_m=np.full((1, STEPS), offset),
        heading_rad=np.zeros((1, STEPS)),
        speed_mps=np.full((1, STEPS), speed),
        step_s=0.1,
        target_speed_mps=target,
        obstacles=others,
        half_length_m=2.25,
        lanes=LaneCenters(straight_road(lanes=2)),
    )


def other(x: float, y: float, vx: float, heading: float = 0.0) -> PredictedObstacle:
    time = np.arange(STEPS)[:, None] * 0.1
    positions = np.array([x, y]) + time * np.array([vx, 0.0])
    return PredictedObstacle(1, positions, np.full(STEPS, heading), np.eye(2) * 0.1, 4.5, 1.8, speed_mps=abs(vx))


@pytest.mark.parametrize(("speed", "length"), [(0.0, 0.0), (5.0, 15.0), (12.0, 36.0)])
def test_path_length_is_the_way_in_three_seconds(speed: float, length: float) -> None:
    assert path_length(straight(speed)) == pytest.approx([length])


@pytest.mark.parametrize(("speed", "cost"), [(8.0, 0.0), (5.0, 3.0), (12.0, 4.0)])
def test_velocity_is_the_distance_to_the_speed_that_arrives(speed: float, cost: float) -> None:
    assert velocity(straight(speed)) == pytest.approx([cost])
    assert velocity(straight(speed, target=None)) == pytest.approx([0.0])


@pytest.mark.parametrize(("offset", "cost"), [(0.0, 0.0), (1.0, 1.0), (2.5, 1.0), (3.5, 0.0), (-4.0, OUTSIDE_M)])
def test_lane_center_offset_is_that_of_the_lane_under_the_point(offset: float, cost: float) -> None:
    assert lane_center_offset(straight(5.0, offset)) == pytest.approx([cost])


def test_driving_up_to_a_standing_car_is_the_egos_doing() -> None:
    standing = other(20.0, 0.0, 0.0)
    gap = 20.0 - 5.0 * 3.0 - 4.5
    assert responsibility(straight(5.0, 0.0, standing)) == pytest.approx([math.exp(-gap / 2.0)])


def test_being_run_into_from_behind_is_not() -> None:
    assert responsibility(straight(5.0, 0.0, other(-20.0, 0.0, 15.0))) == pytest.approx([0.0])


def test_head_on_both_share_by_their_speeds() -> None:
    towards = other(30.0, 0.0, -15.0, math.pi)
    assert responsibility(straight(5.0, 0.0, towards)) == pytest.approx([5.0 / 20.0])


def test_far_away_costs_nothing() -> None:
    assert responsibility(straight(5.0, 0.0, other(100.0, 0.0, 0.0))) == pytest.approx([0.0])
