"""Shares and their intervals."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from plannerforge.engine.analysis.statistics import paired_difference, rate, wilson_interval

shares = st.integers(1, 500).flatmap(lambda of: st.tuples(st.integers(0, of), st.just(of)))


@given(shares)
def test_wilson_agrees_with_scipy(share: tuple[int, int]) -> None:
    count, of = share
    expected = stats.binomtest(count, of).proportion_ci(method="wilson")
    low, high = wilson_interval(count, of)
    assert math.isclose(low, expected.low, abs_tol=1e-9)
    assert math.isclose(high, expected.high, abs_tol=1e-9)


@given(shares)
def test_wilson_contains_the_share_and_mirrors(share: tuple[int, int]) -> None:
    count, of = share
    low, high = wilson_interval(count, of)
    assert 0 <= low <= count / of <= high <= 1
    mirrored = wilson_interval(of - count, of)
    assert math.isclose(low, 1 - mirrored[1], abs_tol=1e-12)
    assert math.isclose(high, 1 - mirrored[0], abs_tol=1e-12)


def test_wilson_by_hand() -> None:
    # 0 of 10 at 95 %: z² / (n + z²)
    assert wilson_interval(0, 10) == pytest.approx((0.0, 3.841458820694124 / 13.841458820694124))


@pytest.mark.parametrize(("count", "of"), [(1, 0), (-1, 3), (4, 3)])
def test_no_share_is_refused(count: int, of: int) -> None:
    with pytest.raises(ValueError, match="is no share"):
        wilson_interval(count, of)


def test_rate_of_nothing_has_no_share() -> None:
    empty = rate(0, 0)
    assert (empty.share, empty.low, empty.high) == (None, None, None)


def test_paired_difference_by_hand() -> None:
    difference, low, high = paired_difference(only_after=5, only_before=1, pairs=20)
    half = 1.959963984540054 * math.sqrt((7 / 22 - (4 / 22) ** 2) / 22)
    assert (difference, low, high) == pytest.approx((0.2, 4 / 22 - half, 4 / 22 + half))


@given(st.integers(0, 40), st.integers(0, 40), st.integers(1, 40))
def test_paired_difference_is_symmetric(after: int, before: int, more: int) -> None:
    pairs = after + before + more
    difference, low, high = paired_difference(after, before, pairs)
    turned, turned_low, turned_high = paired_difference(before, after, pairs)
    assert (difference, low, high) == pytest.approx((-turned, -turned_high, -turned_low))
    assert -1 <= low <= high <= 1


def test_no_pairs_no_difference() -> None:
    with pytest.raises(ValueError, match="no pairs"):
        paired_difference(0, 0, 0)
