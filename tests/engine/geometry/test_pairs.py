"""Pairs of shapes that meet, and a crowd of them."""

from itertools import combinations

import numpy as np
from shapely import box

from plannerforge.engine.geometry import meeting_pairs


def test_all_pairs_that_meet_are_found_once_and_in_order() -> None:
    chance = np.random.default_rng(3)
    shapes = [box(x, y, x + 2, y + 2) for x, y in chance.uniform(0, 20, (80, 2))]
    meeting = meeting_pairs(shapes, "intersects")
    expected = [(i, j) for i, j in combinations(range(80), 2) if shapes[i].intersects(shapes[j])]
    assert meeting.is_whole
    assert [tuple(pair) for pair in meeting.pairs.tolist()] == expected


def test_only_a_bounded_number_of_pairs_in_a_crowd_is_searched() -> None:
    meeting = meeting_pairs([box(0, 0, 1, 1)] * 400, "intersects")
    assert not meeting.is_whole
    assert len(meeting.pairs) == meeting.most == 50_000


def test_more_shapes_make_no_more_pairs_each() -> None:
    assert meeting_pairs([box(0, 0, 1, 1)] * 2000, "intersects").most == 2000 * 50


def test_no_shapes_make_no_pairs() -> None:
    meeting = meeting_pairs([], "crosses")
    assert meeting.is_whole
    assert meeting.pairs.shape == (0, 2)
