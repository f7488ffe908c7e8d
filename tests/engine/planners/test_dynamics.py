"""The ego as a vehicle model under a tracking controller: how near it stays to plans, and what it cannot do."""

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from support.planning import FAR, configuration, problem_for, scenario_on, straight_road

from plannerforge.engine.planners.driving.dynamics import SimulatedVehicle
from plannerforge.engine.planners.idm import IntelligentDriver
from plannerforge.engine.planners.interface import EgoState, PlannedTrajectory
from plannerforge.engine.planners.simulation import simulate
from plannerforge.engine.vehicles import ego_class
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.worlds import Dynamics, world_of

STEP_S = 0.1
MODELS = [name for name in get_args(Dynamics) if name != "exact"]


def plan(speed_mps: float, curvature: float, steps: int, push_mps2: float = 0.0) -> PlannedTrajectory:
    """Return an arc of the centre from the origin, driven at a constant acceleration until it stands."""
    speeds = np.maximum(speed_mps + push_mps2 * STEP_S * np.arange(steps + 1), 0.0)
    ways = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)])
    headings = curvature * ways
    if curvature:
        positions = np.stack([np.sin(headings), 1 - np.cos(headings)], axis=1) / curvature
    else:
        positions = np.stack([ways, np.zeros_like(ways)], axis=1)
    return PlannedTrajectory(positions, headings, speeds, np.full(steps + 1, push_mps2))


def driven(
    model: Dynamics, wanted: PlannedTrajectory, steps: int, friction: float | None = None, delay_s: float = 0.0
) -> list[EgoState]:
    """Return the states of a vehicle that begins on a plan and follows it."""
    ego = EgoState(0, np.zeros(2), 0.0, float(wanted.speeds_mps[0]))
    vehicle = SimulatedVehicle(model, delay_s, BMW_320I.on_road(friction), ego, STEP_S)
    return vehicle.follow(wanted, steps, 1)


def away_m(states: list[EgoState], wanted: PlannedTrajectory) -> float:
    """Return the largest distance from the planned places."""
    places = np.array([state.position for state in states])
    return float(np.hypot(*(places - wanted.positions[1 : len(states) + 1]).T).max())


@pytest.mark.parametrize("model", MODELS)
def test_a_vehicle_stays_near_a_plan_that_it_can_drive(model: Dynamics) -> None:
    wanted = plan(12.0, 0.02, 40)
    states = driven(model, wanted, 30)
    assert [state.step for state in states] == list(range(1, 31))
    assert away_m(states, wanted) < 0.6
    assert states[-1].speed_mps == pytest.approx(12.0, abs=0.3)
    assert states[-1].yaw_rate_radps == pytest.approx(0.24, abs=0.03)
    assert states[-1].steering_rad is not None
    assert states[-1].steering_rad > 0.02


@pytest.mark.parametrize("model", MODELS)
def test_a_vehicle_that_brakes_to_a_stop_stands_there(model: Dynamics) -> None:
    wanted = plan(6.0, 0.0, 40, push_mps2=-3.0)
    states = driven(model, wanted, 40)
    assert away_m(states, wanted) < 0.3
    assert states[-1].speed_mps < 0.05
    assert states[-1].position == pytest.approx(states[-5].position, abs=0.01)


@pytest.mark.parametrize("model", MODELS)
def test_no_vehicle_brakes_harder_than_its_road_allows(model: Dynamics) -> None:
    states = driven(model, plan(15.0, 0.0, 40, push_mps2=-9.0), 15, friction=0.3)
    decelerations = -np.diff([15.0, *(state.speed_mps for state in states)]) / STEP_S
    assert decelerations.max() < 0.33 * 9.81
    assert decelerations.mean() > 0.2 * 9.81


def test_a_vehicle_with_slip_leaves_a_curve_on_ice_that_wheels_without_slip_keep() -> None:
    wanted = plan(12.0, 0.04, 40)
    kinematic, drift = (away_m(driven(model, wanted, 30, friction=0.1), wanted) for model in ("kinematic", "drift"))
    assert kinematic < 0.6
    assert drift > 2.0


def test_commands_act_after_the_delay_and_the_vehicle_stays_stable() -> None:
    wanted = plan(12.0, 0.0, 60, push_mps2=-4.0)
    prompt, late = (driven("kinematic", wanted, 20, delay_s=delay) for delay in (0.0, 0.3))
    assert prompt[1].speed_mps < 11.6
    assert [state.speed_mps for state in late[:3]] == pytest.approx([12.0] * 3)
    assert late[4].speed_mps < 11.8
    curved = plan(12.0, 0.02, 60)
    assert away_m(driven("single_track", curved, 50, delay_s=0.2), curved) < 1.0


def test_a_vehicle_without_masses_and_tyres_is_refused() -> None:
    truck = ego_class("truck").vehicle
    with pytest.raises(NotPossible) as refused:
        SimulatedVehicle("drift", 0.0, truck, EgoState(0, np.zeros(2), 0.0, 5.0), STEP_S)
    assert "the setting vehicle=2" in refused.value.valid
    other = replace(BMW_320I, wheelbase_m=3.0)
    with pytest.raises(NotPossible):
        SimulatedVehicle("kinematic", 0.0, other, EgoState(0, np.zeros(2), 0.0, 5.0), STEP_S)


@pytest.mark.parametrize("text", ["ego=single_track", "ego=kinematic, actuator_s=0.1", "ego=kinematic, occlusion"])
def test_a_run_with_a_vehicle_model_drives_to_its_goal_with_known_steering(text: str) -> None:
    world = world_of(text)
    run = simulate(
        scenario_on(straight_road(300.0)),
        problem_for(FAR),
        configuration("idm:Default"),
        IntelligentDriver(),
        "constant_velocity",
        lambda *_: None,
        world=world,
    )
    assert run.final.outcome in ("goal_reached", "goal_late")
    assert run.steering_rad is not None
    assert len(run.steering_rad) == len(run.states)
    assert (run.sensors is not None) == world.hides_truth
    assert max(abs(float(state.position[1])) for state in run.states) < 0.05
    assert all(math.isfinite(state.speed_mps) for state in run.states)


def test_a_delay_without_a_vehicle_model_and_an_unknown_model_are_refused() -> None:
    with pytest.raises(InvalidRequest) as refused:
        world_of("actuator_s=0.2")
    assert "ego=kinematic" in refused.value.valid
    with pytest.raises(InvalidRequest) as refused:
        world_of("ego=drifting")
    assert "ego=drift" in refused.value.valid
    assert world_of("ego=drift, actuator_s=0.2").in_words() == "ego=drift, actuator_s=0.2"
