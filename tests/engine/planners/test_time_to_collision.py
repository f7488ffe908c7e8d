import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.geometry.polyline import oriented_rectangle, rectangles_overlap
from plannerforge.engine.planners.time_to_collision import MovingRectangle, time_to_collision_s

SIZE = (4.5, 1.8)


def body(x: float, y: float, heading: float, speed: float) -> MovingRectangle:
    return MovingRectangle(np.array([x, y]), heading, SIZE, speed)


def test_a_slower_vehicle_ahead_is_reached_after_the_gap_over_the_closing_speed() -> None:
    assert time_to_collision_s(body(0, 0, 0, 15), body(34.5, 0, 0, 5)) == pytest.approx(3.0)


def test_crossing_courses_meet_where_both_are_at_once() -> None:
    # the other's front reaches the ego's lane edge after (20 − 0.9 − 2.25) / 10 s, the ego is there from 1.285 s on
    assert time_to_collision_s(body(-16, 0, 0, 10), body(0, -20, math.pi / 2, 10)) == pytest.approx(1.685)


def test_a_vehicle_beside_that_stands_askew_is_not_yet_hit() -> None:
    ego, other = body(0, 0, 0, 5), body(4.2, 2.6, math.pi / 4, 0)
    first, second = (oriented_rectangle(b.center, b.heading_rad, b.size_m) for b in (ego, other))
    assert not rectangles_overlap(first, second)
    assert (time_to_collision_s(ego, other) or 0) > 0


@pytest.mark.parametrize(
    "other",
    [body(-30, 0, 0, 5), body(30, 4, 0, 0), body(30, 0, 0, 15), body(30, 0, 0, 20)],
    ids=["behind and slower", "in the next lane", "as fast", "faster"],
)
def test_courses_that_never_meet_have_none(other: MovingRectangle) -> None:
    assert time_to_collision_s(body(0, 0, 0, 15), other) is None


@given(
    x=st.floats(-40, 40),
    y=st.floats(-40, 40),
    heading=st.floats(-math.pi, math.pi),
    speeds=st.tuples(st.floats(0, 30), st.floats(0, 30)),
)
def test_the_rectangles_touch_at_that_time_and_not_before(
    x: float, y: float, heading: float, speeds: tuple[float, float]
) -> None:
    one, other = body(0, 0, 0.3, speeds[0]), body(x, y, heading, speeds[1])
    time = time_to_collision_s(one, other)

    def overlap(at: float, shrink: float) -> bool:
        corners = [oriented_rectangle(b.center + at * b.velocity, b.heading_rad, b.size_m) for b in (one, other)]
        return rectangles_overlap(corners[0], corners[1], shrink_m=shrink)

    if time is None:
        assert not any(overlap(at, 1e-6) for at in np.linspace(0, 20, 41))
    else:
        assert overlap(time, -1e-6)
        before = np.linspace(0, time, 20, endpoint=False) if time > 1e-6 else ()
        assert not any(overlap(at, 1e-6) for at in before)
