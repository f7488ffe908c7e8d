"""Operators of signal temporal logic: closed forms on short signals, dualities on drawn ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from plannerforge.engine.analysis.temporal_logic import (
    always,
    conjunction,
    disjunction,
    historically,
    implies,
    negation,
    once,
    previously,
    since,
    truth,
)

SIGNALS = arrays(float, st.integers(1, 12), elements=st.floats(-5, 5))
RISING = np.array([-1.0, 0.5, 2.0, 1.0])
INF = float("inf")


def test_a_condition_has_no_degree_and_leaves_that_of_the_demand() -> None:
    condition = truth(np.array([True, False, True, False]))
    assert implies(condition, RISING).tolist() == [-1.0, INF, 2.0, INF]


def test_windows_look_back_and_ahead_in_steps() -> None:
    assert historically(RISING).tolist() == [-1.0, -1.0, -1.0, -1.0]
    assert historically(RISING, 0, 1).tolist() == [-1.0, -1.0, 0.5, 1.0]
    assert once(RISING, 1, 2).tolist() == [-INF, -1.0, 0.5, 2.0]
    assert always(RISING).tolist() == [-1.0, 0.5, 1.0, 1.0]
    assert always(RISING, 1, 1).tolist() == [0.5, 2.0, 1.0, INF]


def test_nothing_holds_before_the_first_step() -> None:
    assert previously(RISING).tolist() == [-INF, -1.0, 0.5, 2.0]


def test_since_holds_as_long_as_its_condition_holds() -> None:
    holds = truth(np.array([True, True, False, True]))
    began = truth(np.array([True, False, False, False]))
    assert since(holds, began).tolist() == [INF, INF, -INF, -INF]


@given(signal=SIGNALS, first=st.integers(0, 3), span=st.integers(0, 4))
def test_once_is_not_historically_not(signal: np.ndarray, first: int, span: int) -> None:
    windowed = once(signal, first, first + span)
    assert np.array_equal(windowed, negation(historically(negation(signal), first, first + span)))
    for at in range(len(signal)):
        seen = [signal[at - back] for back in range(first, first + span + 1) if at - back >= 0]
        assert windowed[at] == max(seen, default=-INF)


@given(signal=SIGNALS)
def test_and_is_the_least_and_or_the_greatest(signal: np.ndarray) -> None:
    other = signal[::-1]
    assert np.array_equal(conjunction(signal, other), np.minimum(signal, other))
    assert np.array_equal(negation(disjunction(signal, other)), conjunction(negation(signal), negation(other)))
