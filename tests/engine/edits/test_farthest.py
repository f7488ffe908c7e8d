"""The longest distance in a time: one answer for every question about what is in reach."""

import math

import pytest

from plannerforge.engine.vehicles.kinematics import farthest_m
from plannerforge.engine.vehicles.models import VehicleParameters

VEHICLE = VehicleParameters(maximum_acceleration_mps2=5.0, maximum_speed_mps=20.0)


@pytest.mark.parametrize(
    ("speed_mps", "duration_s", "expected_m"),
    [(10.0, 1.0, 10.0 + 2.5), (10.0, 4.0, 10.0 * 2 + 10.0 + 2 * 20.0), (25.0, 2.0, 50.0), (10.0, math.inf, math.inf)],
)
def test_the_farthest_distance_is_the_integral_of_the_fastest_drive(
    speed_mps: float, duration_s: float, expected_m: float
) -> None:
    assert farthest_m(speed_mps, duration_s, VEHICLE) == pytest.approx(expected_m)


def test_a_lower_top_speed_applies_unless_the_vehicle_begins_faster() -> None:
    assert farthest_m(10.0, 4.0, VEHICLE, top_mps=15.0) == pytest.approx(12.5 + 3 * 15.0)
    assert farthest_m(18.0, 2.0, VEHICLE, top_mps=15.0) == pytest.approx(36.0)
