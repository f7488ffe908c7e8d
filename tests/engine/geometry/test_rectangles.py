import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.geometry.rectangles import (
    BoxTrack,
    FirstOverlap,
    first_overlaps,
    oriented_rectangle,
    rectangles_overlap,
)

NUMBER = st.floats(-12, 12)
POSE = st.tuples(NUMBER, NUMBER, st.floats(-math.pi, math.pi))
SIZE = st.tuples(st.floats(1, 17), st.floats(0.5, 3))


def body(poses: list[tuple[float, float, float]], size: tuple[float, float]) -> BoxTrack:
    values = np.array(poses)
    return BoxTrack(values[:, :2], values[:, 2], size)


def overlapping_at(one: BoxTrack, other: BoxTrack, step: int) -> bool:
    corners = [oriented_rectangle(b.positions[step], float(b.headings_rad[step]), b.size_m) for b in (one, other)]
    return rectangles_overlap(*corners)


@given(st.lists(POSE, min_size=1, max_size=6), st.lists(POSE, min_size=1, max_size=6), SIZE, SIZE)
def test_all_steps_at_once_agree_with_each_step(
    poses: list[tuple[float, float, float]],
    others: list[tuple[float, float, float]],
    size: tuple[float, float],
    other_size: tuple[float, float],
) -> None:
    one, other = body(poses, size), body(others, other_size)
    hits = [step for step in range(min(len(poses), len(others))) if overlapping_at(one, other, step)]
    assert [hit.step for hit in first_overlaps([one, other])] == hits[:1]


def test_only_pairs_that_meet_at_the_same_step_are_named() -> None:
    still = body([(0, 0, 0)] * 3, (4, 2))
    passing = body([(-20, 0, 0), (-10, 0, 0), (-1, 0, 0)], (4, 2))
    gone = body([(30, 0, 0)], (4, 2))
    assert first_overlaps([still, gone, passing]) == [FirstOverlap(0, 2, 2)]
    assert first_overlaps([still]) == []
