"""Tests on pairs, against scipy and by hand."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from plannerforge.engine.analysis.statistics import fisher_exact, holm, mcnemar_exact, signed_rank, walsh_averages

differences = st.lists(st.integers(-20, 20).map(lambda value: value / 4), min_size=1, max_size=10)


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_is_the_binomial_test(before: int, after: int) -> None:
    expected = stats.binomtest(before, before + after).pvalue if before + after else 1.0
    assert mcnemar_exact(before, after) == pytest.approx(expected)


def test_five_flips_in_one_direction_do_not_reach_5_percent_but_six_do() -> None:
    assert mcnemar_exact(0, 5) == 0.0625
    assert mcnemar_exact(0, 6) == 0.03125


@pytest.mark.parametrize("count", [6, 13, 25, 60, 61, 200])
def test_signed_rank_agrees_with_scipy_without_ties(count: int) -> None:
    values = np.random.default_rng(count).normal(0.2, 1.0, count)
    method = "exact" if count <= 60 else "approx"
    expected = stats.wilcoxon(values, zero_method="pratt", correction=True, method=method)
    assert signed_rank(values.tolist()).p == pytest.approx(expected.pvalue, rel=1e-9)


@settings(max_examples=60)
@given(differences)
def test_signed_rank_with_ties_is_the_permutation_test(values: list[float]) -> None:
    found = signed_rank(values)
    ranks = stats.rankdata(np.abs(values))[np.array(values) != 0]
    observed = sum(rank for value, rank in zip(values, stats.rankdata(np.abs(values)), strict=True) if value > 0)
    sums = np.array([sum(np.array(signs) * ranks) for signs in itertools.product((0, 1), repeat=len(ranks))])
    tail = min((sums <= observed + 1e-9).mean(), (sums >= observed - 1e-9).mean())
    assert found.p == pytest.approx(min(1.0, 2 * tail))


@given(differences)
def test_signed_rank_is_symmetric(values: list[float]) -> None:
    found, turned = signed_rank(values), signed_rank([-value for value in values])
    assert found.p == pytest.approx(turned.p)
    assert (found.shift, found.effect) == pytest.approx((-turned.shift, -turned.effect))
    assert (found.low is None) == (len(values) < 6)
    if found.low is not None and found.high is not None:
        assert found.low <= found.shift <= found.high
        assert (found.low, found.high) == pytest.approx((-(turned.high or 0), -(turned.low or 0)))


def test_hodges_lehmann_by_hand() -> None:
    assert walsh_averages(np.array([1.0, 2.0, 4.0])).tolist() == [1.0, 1.5, 2.0, 2.5, 3.0, 4.0]
    assert signed_rank([1.0, 2.0, 4.0]).shift == 2.25


def test_interval_of_six_pairs_spans_them_all() -> None:
    found = signed_rank([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert (found.low, found.high, found.p, found.effect) == (1.0, 6.0, 0.03125, 1.0)


def test_interval_covers_the_true_shift_at_its_level() -> None:
    generator = np.random.default_rng(5)
    intervals = [signed_rank(generator.normal(0.7, 1.0, 12).tolist()) for _ in range(400)]
    ends = [(found.low or 0.0, found.high or 0.0) for found in intervals]
    covered = [low <= 0.7 <= high for low, high in ends]
    assert 0.93 <= np.mean(covered) <= 0.98


def test_equal_values_give_no_significance() -> None:
    found = signed_rank([0.0] * 7)
    assert (found.p, found.effect, found.shift) == (1.0, 0.0, 0.0)


def test_no_pairs_no_test() -> None:
    with pytest.raises(ValueError, match="pairs"):
        signed_rank([])


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), max_size=8))
def test_holm_never_lowers_a_p_value(values: list[float]) -> None:
    adjusted = holm(values)
    assert all(value <= found <= 1 for value, found in zip(values, adjusted, strict=True))


@given(st.integers(0, 12), st.integers(0, 12), st.integers(0, 12), st.integers(0, 12))
def test_fishers_test_is_scipys(first: int, more: int, second: int, others: int) -> None:
    table = [[first, more], [second, others]]
    found = fisher_exact((first, first + more), (second, second + others))
    assert found == pytest.approx(stats.fisher_exact(table).pvalue)
