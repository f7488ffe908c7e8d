"""Shares and their intervals."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import optimize, stats

from plannerforge.engine.analysis.statistics import (
    mcnemar_exact,
    needed_scenarios,
    paired_shares,
    rate,
    rate_by_scenario,
    wilson_interval,
)

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
    with pytest.raises(ValueError, match="is not a share"):
        wilson_interval(count, of)


def test_a_rate_over_nothing_has_no_share() -> None:
    empty = rate(0, 0)
    assert (empty.share, empty.low, empty.high) == (None, None, None)


def alone(after: int, before: int, same: int) -> list[tuple[str, int]]:
    """Pairs of a scenario each: flips to success, to failure, and none."""
    flips = [1] * after + [-1] * before + [0] * same
    return [(f"scenario {index}", flip) for index, flip in enumerate(flips)]


def score_test(after: int, before: int, same: int, difference: float) -> float:
    """Squared score statistic of a paired difference; the share of flips to failure is the most likely one."""
    pairs = after + before + same

    def unlikely(failing: float) -> float:
        gained = failing + difference
        likely = [(after, gained), (before, failing), (same, 1 - gained - failing)]
        return -sum(count * math.log(share) for count, share in likely if count)

    low, high = max(0.0, -difference), (1 - difference) / 2
    failing = optimize.minimize_scalar(unlikely, bounds=(low, high), options={"xatol": 1e-10}).x
    variance = pairs * (2 * failing + difference - difference**2)
    return float((after - before - pairs * difference) ** 2 / variance)


@pytest.mark.parametrize(("after", "before", "same"), [(9, 1, 10), (12, 5, 40), (3, 3, 50), (30, 2, 1)])
def test_ends_of_a_paired_interval_are_just_not_rejected_by_the_score_test(after: int, before: int, same: int) -> None:
    found = paired_shares(alone(after, before, same))
    for end in (found.low, found.high):
        assert score_test(after, before, same, end) == pytest.approx(1.959963984540054**2, rel=1e-4)
    assert found.p == pytest.approx(mcnemar_exact(before, after))


@pytest.mark.parametrize(("pairs", "is_within"), [(18, False), (20, False), (34, False), (35, True)])
def test_pairs_without_a_flip_show_less_than_ten_points_only_if_they_are_many(pairs: int, *, is_within: bool) -> None:
    found = paired_shares(alone(0, 0, pairs))
    assert found.high == pytest.approx(wilson_interval(0, pairs)[1])
    assert found.low == -found.high
    assert (found.high < 0.1) == is_within
    if is_within:  # such pairs have a probability of 2.5 % at a difference of ten points
        assert 0.9**pairs == pytest.approx(0.025, rel=0.01)


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40))
def test_paired_shares_mirror_and_never_contradict_their_test(after: int, before: int, same: int) -> None:
    assume(after + before + same)
    found, turned = paired_shares(alone(after, before, same)), paired_shares(alone(before, after, same))
    assert (found.difference, found.low, found.high) == pytest.approx((-turned.difference, -turned.high, -turned.low))
    assert found.p == turned.p
    assert found.low <= found.difference <= found.high
    if found.p >= 0.05:
        assert found.low <= 0 <= found.high


def test_five_flips_of_24_pairs_are_not_significant_and_their_interval_says_so() -> None:
    found = paired_shares(alone(0, 5, 19))
    assert found.p == 0.0625
    assert found.high == 0.0


def test_no_pairs_have_no_difference() -> None:
    with pytest.raises(ValueError, match="pairs"):
        paired_shares([])


def repeated(trials: list[tuple[str, int]], times: int) -> list[tuple[str, int]]:
    return [trial for trial in trials for _ in range(times)]


@given(st.integers(1, 12), st.integers(1, 12), st.integers(2, 5))
def test_runs_that_repeat_their_scenario_add_no_evidence(good: int, bad: int, times: int) -> None:
    single = [(f"scenario {index}", int(index < good)) for index in range(good + bad)]
    one = rate_by_scenario((key, bool(value)) for key, value in single)
    many = rate_by_scenario((key, bool(value)) for key, value in repeated(single, times))
    assert many.share == one.share
    assert many.low is not None
    assert one.low is not None
    assert many.high is not None
    assert one.high is not None
    assert many.low <= one.low + 1e-12
    assert many.high >= one.high - 1e-12
    assert (one.scenarios, many.scenarios) == (good + bad, good + bad)


@given(shares)
def test_a_run_each_scenario_gives_the_plain_interval(share: tuple[int, int]) -> None:
    count, of = share
    found, plain = rate_by_scenario((str(i), i < count) for i in range(of)), rate(count, of)
    assert (found.low, found.high, found.share) == (plain.low, plain.high, plain.share)


def test_flips_of_one_scenario_are_one_flip() -> None:
    flips = repeated(alone(5, 0, 10), 4)
    assert paired_shares(flips).p == paired_shares(alone(5, 0, 10)).p == 0.0625
    assert paired_shares(alone(20, 0, 40)).p < 1e-5


def test_unequal_scenarios_are_flipped_as_wholes() -> None:
    pairs = [("a", 1), ("a", 1), ("a", 1), ("b", 1), ("c", -1), ("c", -1)]
    totals = (3, 1, -2)
    sums = [sum(sign * total for sign, total in zip(signs, totals, strict=True)) for signs in SIGNS]
    expected = sum(abs(value) >= 2 for value in sums) / len(sums)
    assert paired_shares(pairs).p == pytest.approx(expected)


SIGNS = list(itertools.product((1, -1), repeat=3))


@pytest.mark.parametrize(("discordant", "difference"), [(0.2, 0.1), (0.15, 0.1), (0.4, 0.15)])
def test_the_number_of_scenarios_needed_gives_the_stated_power(discordant: float, difference: float) -> None:
    needed = needed_scenarios(discordant, difference)
    assert needed is not None
    up, down = (discordant + difference) / 2, (discordant - difference) / 2
    drawn = np.random.default_rng(3).multinomial(needed, [up, down, 1 - discordant], size=2000)
    z = (drawn[:, 0] - drawn[:, 1]) / np.sqrt(np.maximum(drawn[:, 0] + drawn[:, 1], 1))
    assert 0.76 <= (z > 1.96).mean() <= 0.87


def test_no_number_shows_no_difference() -> None:
    assert needed_scenarios(0.2, 0.0) is None
