"""The goal region in all of CommonRoad's forms."""

import math
from typing import Any

import numpy as np
import pytest
from commonroad.geometry.shape import Circle, Polygon, ShapeGroup
from hypothesis import given
from hypothesis import strategies as st
from support.planning import (
    goal_state,
    lanelet_along,
    network_of,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.goal import Goal, progress_to_goal
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.vehicles import BMW_320I


def ego(step: int = 10, x: float = 0.0, y: float = 0.0, heading: float = 0.0, speed: float = 5.0) -> EgoState:
    return EgoState(step, np.array([x, y]), heading, speed)


def goal(*states: Any) -> Goal:
    return Goal(problem_for(*states).goal)


def reached(what: Goal, state: EgoState) -> bool:
    return any(status.reached for status in what.status(state))


@pytest.mark.parametrize(
    "shape",
    [
        rectangle_at(0.0, 0.0),
        Circle(3.0, np.array([0.0, 0.0])),
        Polygon(np.array([[-3.0, -3.0], [3.0, -3.0], [0.0, 4.0]])),
        ShapeGroup([rectangle_at(50.0, 0.0), Circle(3.0, np.array([0.0, 0.0]))]),
    ],
)
def test_a_position_of_every_shape(shape: Any) -> None:
    region = goal(goal_state((5, 20), shape))
    assert reached(region, ego())
    assert not reached(region, ego(x=20.0))


def test_a_goal_without_a_position_asks_for_the_time_only() -> None:
    region = goal(goal_state((33, 33)))
    assert not region.has_position
    assert [reached(region, ego(step, x=1000.0)) for step in (32, 33, 34)] == [False, True, False]


def test_the_ends_of_the_time_window_count() -> None:
    region = goal(goal_state((5, 8), rectangle_at(0.0, 0.0)))
    assert [reached(region, ego(step)) for step in (4, 5, 8, 9)] == [False, True, True, False]
    assert [region.status(ego(step))[0].timing for step in (4, 9)] == ["early", "late"]


def test_speed_and_heading_are_conditions() -> None:
    region = goal(goal_state((5, 20), rectangle_at(0.0, 0.0), speed=(4.0, 6.0), heading=(-0.1, 0.1)))
    assert reached(region, ego())
    assert not reached(region, ego(speed=6.1))
    assert not reached(region, ego(heading=0.2))
    assert region.speed_mps == 5.0


def test_one_of_several_goal_states_is_enough_but_all_of_its_conditions() -> None:
    region = goal(
        goal_state((5, 20), rectangle_at(0.0, 0.0), speed=(0.0, 1.0)), goal_state((5, 20), rectangle_at(40.0, 0.0))
    )
    assert not reached(region, ego())
    assert reached(region, ego(speed=0.5))
    assert reached(region, ego(x=40.0))
    assert (region.first_step, region.last_step) == (5, 20)


@given(st.floats(-3.1, 3.1), st.floats(0.0, 1.5), st.floats(-1.0, 1.0), st.integers(-3, 3))
def test_headings_count_on_the_circle(middle: float, half: float, share: float, turns: int) -> None:
    low, high = middle - half, middle + half
    if low < -2 * math.pi or high > 2 * math.pi:
        return
    region = goal(goal_state((5, 20), heading=(low, high)))
    inside = middle + 0.99 * half * share + turns * math.tau
    assert reached(region, ego(heading=inside))
    if half < 1.5:
        assert not reached(region, ego(heading=middle + half + 0.05 + turns * math.tau)) or half > math.pi - 0.05


def test_positions_of_a_path_inside_a_goal() -> None:
    path = np.stack([np.arange(0.0, 100.0), np.zeros(100)], axis=1)
    region = goal(goal_state((5, 20), rectangle_at(50.0, 0.0)))
    assert region.stations_on(path) == (44.0, 56.0)
    assert goal(goal_state((5, 20), rectangle_at(50.0, 30.0))).stations_on(path) is None


def test_a_path_point_on_the_edge_of_the_goal_is_inside_at_any_map_position() -> None:
    path = np.stack([np.arange(0.0, 100.0), np.zeros(100)], axis=1)
    for rounding in (-1e-10, 0.0, 1e-10):
        region = goal(goal_state((5, 20), rectangle_at(50.0 + rounding, 0.0)))
        assert region.stations_on(path) == (44.0, 56.0)


@pytest.mark.parametrize(("farthest_m", "share"), [(0.0, 0.0), (47.0, 0.5), (94.0, 1.0), (120.0, 1.0)])
def test_progress_is_the_share_of_the_path_to_where_the_goal_begins(farthest_m: float, share: float) -> None:
    scenario, problem = scenario_on(straight_road(200.0)), problem_for(goal_state((5, 90), rectangle_at(100.0, 0.0)))
    there = np.linspace(0.0, farthest_m, 100)
    driven = np.stack([[*there, farthest_m / 2], np.full(101, 0.5)], axis=1)  # that it was there counts
    found = progress_to_goal(scenario, problem, BMW_320I, driven)
    assert found == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize(("aside_m", "left_m"), [(1.9, 0.0), (2.5, 0.5), (4.0, 2.0)])
def test_progress_is_one_only_if_the_ego_was_in_the_goal_itself(aside_m: float, left_m: float) -> None:
    goal_state_of = goal_state((5, 90), rectangle_at(100.0, 0.0, size=(12.0, 4.0)))
    driven = np.stack([np.linspace(0.0, 130.0, 131), np.full(131, aside_m)], axis=1)
    found = progress_to_goal(scenario_on(straight_road(200.0)), problem_for(goal_state_of), BMW_320I, driven)
    assert found == pytest.approx(1.0 - left_m / 94.0, abs=1e-6)
    assert (found == 1.0) == (left_m == 0.0)


def test_a_goal_without_a_position_has_no_progress() -> None:
    problem = problem_for(goal_state((5, 90)))
    assert progress_to_goal(scenario_on(straight_road()), problem, BMW_320I, np.zeros((2, 2))) is None


def ring(radius_m: float = 20.0) -> Any:
    """A ring road of four lanelets to the left, from the origin to the east."""
    angle = np.linspace(0.0, math.tau, 161)
    line = radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
    quarters = [line[40 * i : 40 * i + 41] for i in range(4)]
    return line, network_of(
        *(
            lanelet_along(one, i + 1, predecessor=[(i - 1) % 4 + 1], successor=[(i + 1) % 4 + 1])
            for i, one in enumerate(quarters)
        )
    )


def test_the_first_passage_of_a_goal_counts_if_the_path_passes_it_again() -> None:
    line, _ = ring()
    path = np.concatenate([line, line[1:]])
    here = goal(goal_state((5, 20), rectangle_at(*line[80], size=(6.0, 6.0))))
    first = here.stations_on(path)
    assert first is not None
    assert first[0] == pytest.approx(math.pi * 20.0 - 3.0, abs=0.5)
    assert first[1] == pytest.approx(math.pi * 20.0 + 3.0, abs=0.5)
    second = here.stations_on(path, from_m=100.0)
    assert second is not None
    assert second[0] - first[0] == pytest.approx(math.tau * 20.0, abs=0.5)


def test_progress_on_a_ring_road_is_that_of_the_lap_which_was_driven() -> None:
    line, network = ring()
    last = line[150]  # the goal lies a little behind the ego's start
    problem = problem_for(goal_state((5, 200), rectangle_at(*last, size=(4.0, 4.0))), position=line[5])
    problem.initial_state.orientation = 5 / 160 * math.tau
    whole_m = 145 / 160 * math.tau * 20.0 - 2.0
    for count in (1, 10, 60, 120):
        found = progress_to_goal(scenario_on(network), problem, BMW_320I, line[5 : 5 + count])
        assert found == pytest.approx((count - 1) / 160 * math.tau * 20.0 / whole_m, abs=0.01)
