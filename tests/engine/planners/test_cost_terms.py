"""The terms that the core lacks, against values computed by hand."""

import numpy as np
import pytest
from support.planning import (
    configuration,
    drive,
    goal_state,
    parked_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.frenetix.costs import OWN_TERMS, CandidateBatch
from plannerforge.engine.planners.lanes import OUTSIDE_M, LaneCenters, LaneCorridors
from plannerforge.engine.tuning import tuning_of

STEPS = 31


def straight(speed: float, offset: float = 0.0, target: float | None = 8.0) -> CandidateBatch:
    """One candidate straight along the x axis beside the centre of lane 1."""
    time, network = np.arange(STEPS) * 0.1, straight_road(lanes=2)
    return CandidateBatch(
        x_m=(speed * time)[None, :],
        y_m=np.full((1, STEPS), offset),
        heading_rad=np.zeros((1, STEPS)),
        speed_mps=np.full((1, STEPS), speed),
        step_s=0.1,
        fastest_mps=speed,
        target_speed_mps=target,
        obstacles=(),
        half_length_m=2.25,
        half_width_m=0.8,
        lanes=LaneCenters(network),
        corridors=LaneCorridors(network),
    )


@pytest.mark.parametrize(("speed", "length"), [(0.0, 0.0), (5.0, 15.0), (12.0, 36.0)])
def test_path_length_is_the_distance_in_three_seconds(speed: float, length: float) -> None:
    assert OWN_TERMS["path_length"](straight(speed)) == pytest.approx([length])


@pytest.mark.parametrize(("speed", "cost"), [(8.0, 0.0), (5.0, 3.0), (12.0, 4.0)])
def test_velocity_is_the_distance_to_the_speed_that_arrives(speed: float, cost: float) -> None:
    assert OWN_TERMS["velocity"](straight(speed)) == pytest.approx([cost])
    assert OWN_TERMS["velocity"](straight(speed, target=None)) == pytest.approx([0.0])


@pytest.mark.parametrize(("offset", "cost"), [(0.0, 0.0), (1.0, 1.0), (2.5, 1.0), (3.5, 0.0), (-4.0, OUTSIDE_M)])
def test_lane_center_offset_is_that_of_the_lane_under_the_point(offset: float, cost: float) -> None:
    assert OWN_TERMS["lane_center_offset"](straight(5.0, offset)) == pytest.approx([cost])


def test_all_thirteen_weights_act_and_the_three_external_ones_do_not() -> None:
    tuning = tuning_of("frenetix")
    assert [weight.name for weight in tuning.weights.values() if not weight.acts] == []
    assert len(tuning.weights) == 13
    assert {name for name, weight in tuning.weights.items() if weight.computed_by == "ours"} == set(OWN_TERMS)
    assert sorted(tuning.external) == ["occ_pm", "occ_um", "occ_ve"]
    assert not any(weight.acts for weight in tuning.external.values())


def test_external_weights_do_not_change_the_driven_motion() -> None:
    scenario = scenario_on(straight_road(lanes=2), parked_car(7, (35.0, 0.0)))
    goal = goal_state((20, 30), rectangle_at(25.0, 0.0))
    plain, kept = (
        drive(scenario, problem_for(goal), configuration("frenetix:Balanced", *changes))
        for changes in ((), ("occ_pm=5", "occ_um=5", "occ_ve=5"))
    )
    assert np.array_equal([s.position for s in plain.states], [s.position for s in kept.states])
    assert [dict(plan.costs) for plan in plain.plans] == [dict(plan.costs) for plan in kept.plans]
