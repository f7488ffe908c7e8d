import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString

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
def test_the_bounds_of_a_curve_enclose_it_without_crossing(radius: float, turn: float) -> None:
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


def test_a_bound_that_crosses_itself_with_the_digits_of_a_file_is_not_valid() -> None:
    left = np.array(
        [
            [-1.85, -0.72],
            [-0.88, 0.54],
            [-0.95, 1.2],
            [-0.78, 1.87],
            [-0.37, 2.44],
            [0.22, 2.78],
            [0.92, 2.85],
            [1.58, 2.66],
            [2.12, 2.27],
            [3.69, 2.48],
        ]
    )
    right = np.array(
        [
            [0.921213, 0.881007],
            [-0.531345, 0.653726],
            [-0.585205, 1.178186],
            [-0.455576, 1.713627],
            [-0.131648, 2.158883],
            [0.342373, 2.432649],
            [0.890139, 2.489139],
            [1.418444, 2.333847],
            [1.845691, 2.023773],
            [0.920813, 0.880947],
        ]
    )
    assert not LineString(right.round(4)).is_simple
    assert LineString(right).is_simple
    assert not is_valid(left, right)
