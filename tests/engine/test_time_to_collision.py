import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.criticality import MovingRectangles, corners_of, times_to_collision_s
from plannerforge.engine.geometry.rectangles import oriented_rectangle, rectangles_overlap

SIZE = (4.5, 1.8)


def body(x: float, y: float, heading: float, speed: float) -> MovingRectangles:
    return MovingRectangles(np.array([[x, y]]), np.array([heading]), np.array([SIZE]), np.array([speed]))


def time_to_collision_s(one: MovingRectangles, other: MovingRectangles) -> float | None:
    time = float(times_to_collision_s(one, other)[0])
    return time if math.isfinite(time) else None


def test_a_slower_vehicle_ahead_is_reached_after_the_gap_over_the_closing_speed() -> None:
    assert time_to_collision_s(body(0, 0, 0, 15), body(34.5, 0, 0, 5)) == pytest.approx(3.0)


def test_crossing_courses_meet_if_both_arrive_at_once() -> None:
    # the other's front reaches the ego's lane edge after (20 − 0.9 − 2.25) / 10 s, the ego is there from 1.285 s on
    assert time_to_collision_s(body(-16, 0, 0, 10), body(0, -20, math.pi / 2, 10)) == pytest.approx(1.685)


def test_an_adjacent_vehicle_at_an_angle_is_not_yet_hit() -> None:
    ego, other = body(0, 0, 0, 5), body(4.2, 2.6, math.pi / 4, 0)
    assert not rectangles_overlap(corners_of(ego)[0], corners_of(other)[0])
    assert (time_to_collision_s(ego, other) or 0) > 0


@pytest.mark.parametrize(
    "other",
    [body(-30, 0, 0, 5), body(30, 4, 0, 0), body(30, 0, 0, 15), body(30, 0, 0, 20)],
    ids=["behind and slower", "in the next lane", "as fast", "faster"],
)
def test_courses_that_never_meet_have_no_time_to_collision(other: MovingRectangles) -> None:
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
        corners = [corners_of(b)[0] + at * b.velocities[0] for b in (one, other)]
        return rectangles_overlap(corners[0], corners[1], shrink_m=shrink)

    if time is None:
        assert not any(overlap(at, 1e-6) for at in np.linspace(0, 20, 41))
    else:
        assert overlap(time, -1e-6)
        before = np.linspace(0, time, 20, endpoint=False) if time > 1e-6 else ()
        assert not any(overlap(at, 1e-6) for at in before)


def test_many_pairs_give_the_same_as_each_alone() -> None:
    rows = [(20.0, 1.0, 0.2, 3.0), (-5.0, 12.0, -1.2, 9.0), (3.0, 0.5, 0.0, 0.0)]
    others = MovingRectangles(
        np.array([row[:2] for row in rows]),
        np.array([row[2] for row in rows]),
        np.tile(SIZE, (3, 1)),
        np.array([row[3] for row in rows]),
    )
    egos = MovingRectangles(np.zeros((3, 2)), np.zeros(3), np.tile(SIZE, (3, 1)), np.full(3, 12.0))
    alone = [time_to_collision_s(body(0, 0, 0, 12.0), body(*row)) for row in rows]
    together = times_to_collision_s(egos, others)
    assert [float(t) if math.isfinite(t) else None for t in together] == alone


def test_corners_match_an_oriented_rectangle() -> None:
    assert corners_of(body(3, 4, 0.7, 1))[0] == pytest.approx(oriented_rectangle(np.array([3, 4]), 0.7, SIZE))
