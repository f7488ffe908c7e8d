"""Cubic curves begin and end where they should, in the given directions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.geometry.curves import hermite, unit

ANGLE = st.floats(-math.pi, math.pi)
PLACE = st.tuples(st.floats(-50, 50), st.floats(-50, 50)).map(np.array)


@given(PLACE, PLACE, ANGLE, ANGLE, st.floats(0.1, 20), st.floats(0.1, 20))
def test_a_curve_meets_its_ends_with_tangents_of_the_specified_lengths(
    start: np.ndarray, end: np.ndarray, leaves: float, arrives: float, first_m: float, last_m: float
) -> None:
    directions = [np.array([math.cos(angle), math.sin(angle)]) for angle in (leaves, arrives)]
    step = 1e-6
    curve = hermite(start, directions[0], end, directions[1], np.array([0.0, step, 1.0 - step, 1.0]), (first_m, last_m))
    assert curve[[0, -1]] == pytest.approx(np.array([start, end]))
    assert (curve[1] - curve[0]) / step == pytest.approx(first_m * directions[0], abs=1e-2)
    assert (curve[3] - curve[2]) / step == pytest.approx(last_m * directions[1], abs=1e-2)


def test_without_lengths_the_tangents_are_as_long_as_the_distance_of_the_ends() -> None:
    ends = np.array([0.0, 0.0]), np.array([3.0, 4.0])
    ahead, shares = np.array([1.0, 0.0]), np.linspace(0, 1, 7)
    stated = hermite(ends[0], ahead, ends[1], ahead, shares, (5.0, 5.0))
    assert np.array_equal(hermite(ends[0], ahead, ends[1], ahead, shares), stated)


def test_a_vector_without_length_stays_zero() -> None:
    assert unit(np.zeros(2)).tolist() == [0.0, 0.0]
    assert np.linalg.norm(unit(np.array([3.0, -4.0]))) == pytest.approx(1.0)
