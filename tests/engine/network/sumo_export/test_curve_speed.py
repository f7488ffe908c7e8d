"""How fast the curve of a lanelet is driven, however the road is cut into lanelets."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.geometry import Points
from plannerforge.engine.network.sumo_export.speeds import curve_speed


def arc(turn_rad: float, length_m: float) -> Points:
    """From the origin eastwards, then to the left; vertices 25 cm apart or nearer."""
    angles = np.linspace(0.0, turn_rad, max(int(4 * length_m), 20) + 1)
    radius_m = length_m / turn_rad
    return np.column_stack([radius_m * np.sin(angles), radius_m * (1.0 - np.cos(angles))])


def between_straights(curve: Points, turn_rad: float) -> Points:
    steps = np.linspace(0.5, 40.0, 80)[:, None]
    before = curve[0] - steps[::-1] * [1.0, 0.0]
    after = curve[-1] + steps * [math.cos(turn_rad), math.sin(turn_rad)]
    return np.vstack([before, curve, after])


@given(st.floats(0.3, 2.6), st.floats(1.0, 30.0), st.booleans())
def test_a_curve_that_is_its_own_lanelet_is_driven_as_slowly_as_within_one(
    turn_rad: float, length_m: float, to_the_right: bool
) -> None:
    side = [1.0, -1.0 if to_the_right else 1.0]
    alone = arc(turn_rad, length_m)
    whole = between_straights(alone, turn_rad)
    assert curve_speed(alone * side) <= 1.15 * curve_speed(whole * side)


def test_straight_lines_have_no_curve_speed() -> None:
    assert curve_speed(np.array([[0.0, 0.0], [5.0, 0.0]])) == math.inf
    assert curve_speed(np.array([[0.0, 0.0], [2.0, 0.0], [5.0, 0.0], [5.0, 0.0]])) == math.inf
