"""Each setting of a configuration changes the run as it says."""

from typing import Any

import numpy as np
import pytest
from support.planning import (
    configuration,
    drive,
    goal_state,
    moving_car,
    parked_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.idm import IntelligentDriver
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.engine.tuning.configurations import changed_configuration
from plannerforge.engine.vehicles.models import VEHICLES, vehicle_of
from plannerforge.schemas.planning import PlannerConfiguration, PlannerSettings

NEAR = goal_state((10, 15), rectangle_at(12.0, 0.0))


def config(*settings: str, name: str = "frenetix") -> PlannerConfiguration:
    return changed_configuration(configuration(name), None, (), settings)[0]


def driven(*settings: str, obstacles: tuple[Any, ...] = (), goal: Any = NEAR, name: str = "frenetix") -> Any:
    scenario = scenario_on(straight_road(200.0), *obstacles)
    planner = IntelligentDriver() if name == "idm" else None
    return drive(scenario, problem_for(goal), config(*settings, name=name), planner=planner)


def test_the_sampling_level_sets_the_number_of_candidates() -> None:
    counts = [driven(f"sampling_level={level}").plans[0].candidates for level in range(4)]
    assert counts == sorted(set(counts))
    assert counts[2] == driven().plans[0].candidates
    assert counts[0] < 50 < 2000 < counts[3]


@pytest.mark.parametrize("name", ["frenetix", "idm"])
def test_the_plan_is_renewed_every_so_many_steps(name: str) -> None:
    for steps in (1, 3, 5):
        planned = driven(f"replan_steps={steps}", name=name).plan_steps
        assert planned == list(range(0, planned[-1] + 1, steps))
        assert len(planned) > 1


@pytest.mark.parametrize("name", ["frenetix", "idm"])
def test_the_horizon_sets_how_far_is_planned(name: str) -> None:
    lengths = [len(driven(f"horizon_s={h}", name=name).plans[0].trajectory.positions) for h in (2, 3, 6)]
    assert lengths == [21, 31, 61]


def test_a_larger_vehicle_touches_an_obstacle_that_a_smaller_one_passes() -> None:
    beside = (parked_car(7, (12.0, 2.0)),)
    narrow = driven(name="idm", obstacles=beside, goal=goal_state((30, 60), rectangle_at(30.0, 0.0)))
    scenario = scenario_on(straight_road(200.0), *beside)
    ego = EgoState(0, narrow.states[0].position + np.array([12.0, 0.0]), 0.0, 10.0)
    hits = [RecordedTraffic(scenario).hits(ego, vehicle_of(config(s).settings)) for s in ("vehicle=2", "vehicle=4")]
    assert hits == [(), ((7, "parkedVehicle"),)]


def test_the_length_of_the_ego_counts_when_it_stops() -> None:
    parked = (parked_car(7, (60.0, 0.0)),)
    far = goal_state((90, 100), rectangle_at(100.0, 0.0))
    ends = [driven(*s, name="idm", obstacles=parked, goal=far).states[-1].position[0] for s in ((), ("length_m=8",))]
    assert ends[0] - ends[1] == pytest.approx((8.0 - 4.508) / 2, abs=0.3)


def test_the_top_speed_and_acceleration_of_the_vehicle_are_kept() -> None:
    hurry = goal_state((25, 35), rectangle_at(60.0, 0.0))
    for name in ("frenetix", "idm"):
        fastest = max(s.speed_mps for s in driven("maximum_speed_mps=11", name=name, goal=hurry).states)
        assert fastest <= 11.05
        assert fastest < max(s.speed_mps for s in driven(name=name, goal=hurry).states)
    slow = (moving_car(7, (14.0, 0.0), (3.0, 0.0), 100),)
    weak, strong = (
        min(s.acceleration_mps2 for s in driven(*s, name="idm", obstacles=slow).states)
        for s in (("maximum_acceleration_mps2=2",), ())
    )
    assert -2.001 < weak < -1.9
    assert strong < -3


def test_commonroads_vehicles_agree_with_their_package() -> None:
    parameters = pytest.importorskip("vehiclemodels.vehicle_parameters").setup_vehicle_parameters
    for key, ours in VEHICLES.items():
        theirs = parameters(vehicle_id=key)
        assert (ours.length_m, ours.width_m) == (theirs.l, theirs.w)
        assert ours.wheelbase_m == pytest.approx(theirs.a + theirs.b, abs=1e-4)
        assert ours.rear_axle_behind_center_m == pytest.approx(theirs.b, abs=1e-4)
        assert ours.maximum_acceleration_mps2 == theirs.longitudinal.a_max
        assert ours.maximum_speed_mps == theirs.longitudinal.v_max
        assert ours.switching_speed_mps == theirs.longitudinal.v_switch
        assert ours.maximum_steering_rad == theirs.steering.max
        assert ours.maximum_steering_rate_radps == theirs.steering.v_max


def test_a_vehicle_with_its_own_parameters() -> None:
    made = vehicle_of(PlannerSettings(vehicle=3, width_m=2.0))
    assert (made.width_m, made.length_m) == (2.0, VEHICLES[3].length_m)
