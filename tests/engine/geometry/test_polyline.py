"""Lengths of segments are those that numpy's norm gives, to the last bit: files made before stay as they are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from plannerforge.engine.geometry.polyline import Points, arc_length, length_m, segment_lengths

COORDINATES = st.floats(-1e6, 1e6)
LINES = st.integers(1, 30).flatmap(lambda count: arrays(float, (count, 2), elements=COORDINATES))


@given(LINES)
def test_lengths_are_the_norms_of_the_differences(line: Points) -> None:
    assert np.array_equal(segment_lengths(line), np.linalg.norm(np.diff(line, axis=0), axis=1))


@given(LINES)
def test_the_last_station_is_the_length(line: Points) -> None:
    assert arc_length(line)[-1] == pytest.approx(length_m(line))
