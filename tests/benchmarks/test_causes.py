"""The bench of causes: its truth is found without the product, and the product agrees with it."""

import math
from pathlib import Path

import pytest

from benchmarks.analysis.causes import Made, compared, first_touch_s, kind_at, latest_braking_s, overlap, straight


def test_rectangles_overlap_as_their_sizes_require() -> None:
    assert overlap((0, 0, 0), (4.4, 0, 0))
    assert not overlap((0, 0, 0), (4.6, 0, 0))
    assert overlap((0, 0, 0), (0, 3.0, math.pi / 2))
    assert not overlap((0, 0, 0), (0, 3.1, math.pi / 2))
    assert overlap((0, 0, 0), (0, 3.1, math.pi / 2), 0.1)


def test_the_truth_about_braking_before_a_standing_obstacle() -> None:
    made = Made("into_standing", 10.0, straight(44.508, 0.0, 0.0, 0.0))
    touch = first_touch_s(made)
    assert touch == pytest.approx(4.0, abs=0.11)
    assert kind_at(made, touch) == "into_standing"
    stopping_m = 10.0 * 0.3 + 10.0**2 / (2 * 7.6)
    assert latest_braking_s(made, touch) == pytest.approx((40.0 - stopping_m) / 10.0, abs=0.15)


def test_no_reaction_prevents_a_hit_by_a_follower() -> None:
    made = Made("rear_end_by_other", 5.0, straight(-20.0, 0.0, 0.0, 12.0))
    touch = first_touch_s(made)
    assert touch is not None
    assert latest_braking_s(made, touch) is None


def test_the_product_agrees_on_one_collision_of_each_kind(tmp_path: Path) -> None:
    figures = compared(7, 1, tmp_path)
    assert figures["causes_collisions"] == 8
    assert figures["class_right"] == figures["fault_right"] == 1.0
