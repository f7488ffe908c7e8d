"""A start from which no candidate gets onto the centre line is led onto it; every other path is left as it is."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support.planning import drive, goal_state, problem_for, rectangle_at, scenario_on, straight_road

from plannerforge.engine.geometry.polyline import arc_length, headings, project, project_all
from plannerforge.engine.planners.reference_path import BLENDED_OVER_M, ReferencePath, blended_start
from plannerforge.engine.vehicles.kinematics import rear_axle
from plannerforge.engine.vehicles.models import BMW_320I

FAR_GOAL = goal_state((40, 70), rectangle_at(40.0, 0.0))
WIDE_ROAD = straight_road(lanes=4)


def test_an_ego_oblique_to_its_lane_is_led_onto_it() -> None:
    run = drive(scenario_on(WIDE_ROAD), problem_for(FAR_GOAL, speed_mps=12.0, askew_rad=1.2))
    assert run.blended_over_m in BLENDED_OVER_M
    assert run.final.outcome == "goal_reached"
    assert abs(run.states[-1].heading_rad) < 0.4


def test_an_ego_along_its_lane_follows_the_centre_line() -> None:
    run = drive(scenario_on(WIDE_ROAD), problem_for(FAR_GOAL, speed_mps=8.0))
    assert run.blended_over_m is None


def test_a_start_that_no_curve_helps_stays_infeasible() -> None:
    run = drive(scenario_on(WIDE_ROAD), problem_for(FAR_GOAL, speed_mps=35.0, askew_rad=1.5))
    assert run.final.outcome == "infeasible"
    assert run.blended_over_m is None


@given(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.sampled_from(BLENDED_OVER_M))
def test_a_blended_path_runs_through_the_rear_axle_and_joins_the_route(
    heading_rad: float, offset_m: float, over_m: float
) -> None:
    along = np.arange(-30.0, 151.0)
    line = np.stack([along, np.zeros_like(along)], axis=1)
    reference = ReferencePath(line, (1,), 1, network_end_m=130.0)
    axle = rear_axle(np.array([5.0, offset_m]), heading_rad, BMW_320I)
    blended = blended_start(reference, axle, heading_rad, over_m)
    station_m, distance_m = project(blended.points, axle)
    assert abs(distance_m) < 0.05
    turned = headings(blended.points)
    assert abs(float(np.interp(station_m, arc_length(blended.points)[:-1], turned)) - heading_rad) < 0.25
    joined = blended.points[blended.points[:, 0] > axle[0] + over_m + 1.0]
    assert np.allclose(project_all(line, joined)[1], 0.0, atol=1e-6)
    assert math.isclose(float(arc_length(blended.points)[-1]) - blended.network_end_m, 50.0, abs_tol=1e-6)


def test_a_curve_that_would_cut_across_the_edge_of_the_road_is_not_driven() -> None:
    """As above, but on a road of one lane: the curve that the start needs does not fit on it."""
    run = drive(scenario_on(straight_road(lanes=1)), problem_for(FAR_GOAL, speed_mps=12.0, askew_rad=1.2))
    assert run.final.outcome == "infeasible"
    assert run.blended_over_m is None
