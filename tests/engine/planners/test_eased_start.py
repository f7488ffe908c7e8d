"""A start from which no candidate gets onto the centre line is eased onto it; every other path is left as it is."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support.planning import drive, goal_state, problem_for, rectangle_at, scenario_on, straight_road

from plannerforge.engine.geometry.polyline import arc_length, headings, project, project_all
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reference_path import BEFORE_M, ReferencePath
from plannerforge.engine.planners.simulation import EASED_OVER_M, eased_start
from plannerforge.engine.vehicles.kinematics import rear_axle
from plannerforge.engine.vehicles.models import BMW_320I

FAR_GOAL = goal_state((40, 70), rectangle_at(40.0, 0.0))
WIDE_ROAD = straight_road(lanes=4)


def test_an_ego_askew_of_its_lane_is_eased_onto_it() -> None:
    run = drive(scenario_on(WIDE_ROAD), problem_for(FAR_GOAL, speed_mps=12.0, askew_rad=1.2))
    assert run.eased_over_m in EASED_OVER_M
    assert run.final.outcome == "goal_reached"
    assert abs(run.states[-1].heading_rad) < 0.4


def test_an_ego_along_its_lane_follows_the_centre_line() -> None:
    run = drive(scenario_on(WIDE_ROAD), problem_for(FAR_GOAL, speed_mps=8.0))
    assert run.eased_over_m is None


def test_a_start_that_no_curve_helps_stays_infeasible() -> None:
    run = drive(scenario_on(WIDE_ROAD), problem_for(FAR_GOAL, speed_mps=35.0, askew_rad=1.5))
    assert run.final.outcome == "infeasible"
    assert run.eased_over_m is None


@given(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.sampled_from(EASED_OVER_M))
def test_an_eased_path_runs_through_the_rear_axle_and_joins_the_route(
    heading_rad: float, offset_m: float, over_m: float
) -> None:
    along = np.arange(-BEFORE_M, 151.0)
    line = np.stack([along, np.zeros_like(along)], axis=1)
    reference = ReferencePath(line, (1,), 1, network_end_m=130.0)
    ego = EgoState(0, np.array([5.0, offset_m]), heading_rad, 8.0)
    eased = eased_start(reference, ego, BMW_320I, over_m)
    axle = rear_axle(ego.position, heading_rad, BMW_320I)
    station_m, distance_m = project(eased.points, axle)
    assert abs(distance_m) < 0.05
    turned = headings(eased.points)
    assert abs(float(np.interp(station_m, arc_length(eased.points)[:-1], turned)) - heading_rad) < 0.25
    joined = eased.points[eased.points[:, 0] > axle[0] + over_m + 1.0]
    assert np.allclose(project_all(line, joined)[1], 0.0, atol=1e-6)
    assert math.isclose(float(arc_length(eased.points)[-1]) - eased.network_end_m, 50.0, abs_tol=1e-6)


def test_a_curve_that_would_cut_across_the_edge_of_the_road_is_not_driven() -> None:
    """As above, but on a road of one lane: the curve that the start needs does not fit on it."""
    run = drive(scenario_on(straight_road(lanes=1)), problem_for(FAR_GOAL, speed_mps=12.0, askew_rad=1.2))
    assert run.final.outcome == "infeasible"
    assert run.eased_over_m is None
