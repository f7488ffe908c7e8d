import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plannerforge.engine.geometry.polyline import arc_length
from plannerforge.engine.network.lane_bounds import is_valid, offset, repaired, stations_along


@settings(max_examples=60, deadline=None)
@given(length=st.floats(1, 300), parts=st.integers(1, 6), step=st.floats(1, 10))
def test_stations_rise_to_the_end_with_no_step_too_long(length: float, parts: int, step: float) -> None:
    line = np.stack([np.linspace(0, length, parts + 1), np.zeros(parts + 1)], axis=1)
    stations = stations_along(line, step)
    assert len(stations) >= 3
    assert stations[0] == 0
    assert abs(stations[-1] - length) < 1e-3
    assert (np.diff(stations) > 0).all()
    assert np.diff(stations).max() <= max(step, length / 2) + 1e-6


@settings(max_examples=60, deadline=None)
@given(radius=st.floats(3, 60), turn=st.floats(0.2, 3.0))
def test_the_bounds_of_a_bend_enclose_it_without_crossing(radius: float, turn: float) -> None:
    angles = np.linspace(0, turn, 20)
    center = radius * np.stack([np.sin(angles), 1 - np.cos(angles)], axis=1)
    left, right = offset(center, 1.6), offset(center, -1.6)
    bounds = repaired(center, left, right)
    assert bounds is not None
    assert is_valid(*bounds)
    assert arc_length(bounds[1])[-1] > arc_length(bounds[0])[-1]


def test_a_line_that_runs_back_over_itself_has_no_bounds_or_valid_ones() -> None:
    center = np.array([[0.0, 0], [5, 0], [5, 0.1], [0, 0.1]])
    bounds = repaired(center, offset(center, 1.6), offset(center, -1.6))
    assert bounds is None or is_valid(*bounds)


def test_a_bound_whose_ends_meet_with_the_digits_of_a_file_is_not_valid() -> None:
    angles = np.linspace(0.0, 2 * np.pi, 20)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    gap_m = np.stack([np.zeros(20), np.linspace(0.0, 4e-5, 20)], axis=1)
    assert not is_valid(circle * 0.2 + gap_m, circle + gap_m)
