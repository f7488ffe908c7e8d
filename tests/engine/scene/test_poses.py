"""Which lanelets a pose lies on: by position and heading, in every use."""

import math

import numpy as np
import pytest
from commonroad.scenario.lanelet import LaneletNetwork
from support.planning import drive, goal_state, lanelet_along, network_of, problem_for, rectangle_at, scenario_on

from plannerforge.engine.network import LaneletGraph
from plannerforge.engine.scene.poses import lanelets_of_pose
from plannerforge.engine.scene.routing import ego_route

OWN, ONCOMING, CROSSING = 1, 2, 3


def two_way_road() -> LaneletNetwork:
    """A lane to the east along the x-axis, and one to the west, left of it; each 3.5 m wide."""
    x = np.linspace(-20.0, 180.0, 41)
    east, west = np.stack([x, np.zeros(41)], axis=1), np.stack([x[::-1], np.full(41, 3.5)], axis=1)
    return network_of(
        lanelet_along(east, OWN, adjacent_left=ONCOMING, adjacent_left_same_direction=False),
        lanelet_along(west, ONCOMING, adjacent_left=OWN, adjacent_left_same_direction=False),
    )


@pytest.mark.parametrize(
    ("y_m", "heading_rad", "expected"),
    [
        (0.0, 0.0, (OWN,)),
        (1.65, 0.0, (OWN,)),
        (1.85, 0.0, (OWN,)),  # 10 cm over the centre line
        (1.85, 0.3, (OWN,)),
        (2.9, 0.0, (OWN,)),  # overtaking, more than half over
        (1.65, math.pi, (ONCOMING,)),
        (1.85, math.pi, (ONCOMING,)),
        (3.5, 0.0, (OWN,)),  # wholly on the other side, but driving its own way
        (5.0, 0.0, (ONCOMING,)),  # its own lane is out of reach
        (9.0, 0.0, ()),
    ],
)
def test_the_heading_decides_on_a_two_way_road(y_m: float, heading_rad: float, expected: tuple[int, ...]) -> None:
    assert lanelets_of_pose(two_way_road(), np.array([50.0, y_m]), heading_rad) == expected


def test_an_ego_over_the_centre_line_has_a_route_and_drives_it() -> None:
    network = two_way_road()
    problem = problem_for(goal_state((60, 90), rectangle_at(80.0, 0.0)), position=(0.0, 1.85))
    route = ego_route(network, LaneletGraph.of(network), problem)
    assert route is not None
    assert route.lanelets == (OWN,)
    assert drive(scenario_on(network), problem).final.outcome == "goal_reached"


def test_of_lanes_of_one_direction_only_the_one_under_the_pose_counts() -> None:
    x = np.linspace(-20.0, 180.0, 41)
    lanes = [lanelet_along(np.stack([x, np.full(41, 3.5 * lane)], axis=1), 10 + lane) for lane in range(3)]
    assert lanelets_of_pose(network_of(*lanes), np.array([50.0, 3.6]), 0.0) == (11,)
    assert lanelets_of_pose(network_of(*lanes), np.array([50.0, 5.2]), 0.0) == (11,)


def test_a_crossing_lane_is_not_a_start_for_an_ego_that_overhangs_its_own() -> None:
    x, y = np.linspace(-20.0, 20.0, 41), np.linspace(1.75, 30.0, 30)
    north = np.stack([np.full(30, 5.0), y], axis=1)
    lean = np.stack([5.0 + 0.3 * (y - y[0]), y], axis=1)  # leads 73° off the ego's heading
    network = network_of(lanelet_along(np.stack([x, np.zeros(41)], axis=1), OWN), lanelet_along(lean, CROSSING))
    assert lanelets_of_pose(network, np.array([5.0, 1.9]), 0.0)[0] == OWN
    only = network_of(lanelet_along(north, CROSSING))
    assert lanelets_of_pose(only, np.array([5.0, 10.0]), 0.0) == (CROSSING,)
