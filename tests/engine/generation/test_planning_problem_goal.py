"""Where a recorded car is at the goal that was asked for."""

import numpy as np
import pytest
from support.roads import network_of_streets, street

from plannerforge.engine.generation.planning_problem import parse_goal, passage
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.traffic.motions import GeneratedVehicle
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion

LENGTH_M = 200.0


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
def test_a_goal_around_the_start_is_none(goal: str, step: int | None) -> None:
    found = passage(parse_goal(goal), car(), road())
    assert (found.step if found else None) == step
