"""Where a recorded car is at the goal that was asked for."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from support.roads import network_of_streets, street

from plannerforge.engine.generation.planning_problem import TaskSpec, choose_task, passage
from plannerforge.engine.generation.sites import SiteFocus
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.traffic.motions import GeneratedVehicle
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import RequestedEgo, RequestedGoal

LENGTH_M = 200.0


def asked(goal: str, duration_s: float, ego: str = "first") -> TaskSpec:
    return TaskSpec(RequestedGoal.of(goal), RequestedEgo.of(ego), duration_s)


def road() -> RoadNetwork:
    along = np.stack([np.linspace(0.0, LENGTH_M, 41), np.zeros(41)], axis=1)
    return network_of_streets(street(1, along))


def car() -> GeneratedVehicle:
    """Drives 180 m along the lanelet from 10 m beyond its beginning, with 10 m/s."""
    still = np.zeros(181)
    positions = np.stack([10.0 + np.arange(181.0), still], axis=1)
    return GeneratedVehicle("1", vehicle_classes()["car"], Motion(positions, still, still + 10.0, still), True)


@pytest.mark.parametrize(
    ("goal", "step"),
    [
        ("steps:50", 50),
        ("distance_m:5", 5),
        ("lanelet:1:0.5", 90),
        ("lanelet:1:0.5:20x3", 90),
        ("lanelet:1:0.5:500x500", None),
        ("lanelet:1:0.5:181x3", None),
        ("lanelet:1:0.5:179x3", 90),
    ],
)
def test_a_goal_around_the_start_is_not_chosen(goal: str, step: int | None) -> None:
    found = passage(asked(goal, 20.0), car(), road(), 0.1)
    assert (found.step if found else None) == step


class WholeRoad:
    """A focus that every way passes."""

    ways = None
    parts = 1

    @staticmethod
    def parts_passed(car: GeneratedVehicle, last_step: int) -> int:
        return int(last_step < len(car.motion.positions))

    @staticmethod
    def takes_street(car: GeneratedVehicle, last_step: int) -> bool:
        return True

    @staticmethod
    def is_on_spot(car: GeneratedVehicle, step: int) -> bool:
        return "beside" not in car.vehicle_id

    @staticmethod
    def is_left_by(car: GeneratedVehicle, step: int) -> bool:
        return float(car.motion.positions[step][0]) > 60.0


def waiting(number: str) -> GeneratedVehicle:
    """Stands on the lanelet all the time."""
    still = np.zeros(181)
    return replace(car(), vehicle_id=number, motion=Motion(np.tile([50.0, 0.0], (181, 1)), still, still, still))


def test_a_car_behind_replaces_a_waiting_one() -> None:
    driving, focus = replace(car(), vehicle_id="driving"), cast("SiteFocus", WholeRoad())
    cars = [driving, waiting("a"), waiting("b"), replace(driving, vehicle_id="later")]
    specs = [asked("steps:50", 20.0, f"index:{index}") for index in (0, 1, 3)]
    chosen = [choose_task(spec, cars, road(), focus, 0.1) for spec in specs]
    assert [(task.ego.vehicle_id, task.stands_in) for task in chosen] == [
        ("driving", False),
        ("later", True),
        ("later", False),
    ]
    with pytest.raises(NotPossible, match="2 tried"):
        choose_task(specs[1], cars[:3], road(), focus, 0.1)


@pytest.mark.parametrize(("duration_s", "step"), [(30.0, 160), (18.0, 165), (10.0, 85)])
def test_a_goal_behind_the_site_is_as_far_as_time_and_cut_allow(duration_s: float, step: int) -> None:
    found = passage(asked("through", duration_s), car(), road(), 0.1)
    assert found is not None
    assert abs(found.step - step) <= 1


def test_a_goal_behind_the_site_is_at_a_waiting_car_s_stop() -> None:
    driving = car().motion
    positions = np.concatenate([driving.positions[:100], np.repeat(driving.positions[99:100], 81, axis=0)])
    stops = replace(car(), motion=replace(driving, positions=positions))
    found = passage(asked("through", 18.0), stops, road(), 0.1)
    assert found is not None
    assert found.step == 99


def shortened(number: str, steps: int) -> GeneratedVehicle:
    motion = car().motion
    parts = (motion.positions, motion.headings_rad, motion.speeds_mps, motion.accelerations_mps2)
    return replace(car(), vehicle_id=number, motion=Motion(*(part[:steps] for part in parts)))


def test_the_ego_of_a_goal_behind_the_site_leaves_it_and_drives_long() -> None:
    cars = [shortened("on the site", 60), shortened("short", 100), car(), replace(car(), vehicle_id="later")]
    spec = asked("through", 18.0)
    task = choose_task(spec, cars, road(), cast("SiteFocus", WholeRoad()), 0.1)
    assert (task.ego.vehicle_id, task.focus_left, task.takes_most) == ("1", True, True)
    assert task.time_steps[0] < task.goal_step <= task.time_steps[1] <= 180
    second = choose_task(spec, cars[:2], road(), cast("SiteFocus", WholeRoad()), 0.1)
    assert (second.ego.vehicle_id, second.focus_left, second.takes_most) == ("short", True, False)


def test_an_ego_through_the_exact_spot_is_preferred_to_another_junction() -> None:
    cars = [replace(car(), vehicle_id="beside"), shortened("on the spot", 100)]
    spec, focus = asked("through", 18.0), cast("SiteFocus", WholeRoad())
    chosen = choose_task(spec, cars, road(), focus, 0.1)
    assert (chosen.ego.vehicle_id, chosen.on_spot) == ("on the spot", True)
    assert not choose_task(spec, cars[:1], road(), focus, 0.1).on_spot
