"""Statistics on shares and on paired runs: intervals, exact tests, Holm's adjustment.

scipy has no Holm adjustment, no interval for paired shares and, with ties, no exact signed-rank test; these are written
here. So are the Wilson interval, the binomial test of a fair coin and mean ranks: a first comparison in a worker would
wait for ``scipy.stats``, which takes most of a second to import. The tests hold them against scipy's.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.results import Rate

FEWEST_PAIRS = 6
"""With fewer differing pairs no two-sided test on signs or ranks can go below 5 %: 2 · 0.5⁵ = 6.25 %."""
_Z_95 = 1.959963984540054
"""The 97.5 % quantile of the standard normal distribution."""
_MOST_EXACT = 60
"""Pairs up to which p is exact (chosen): above, the normal approximation is as good and the distribution long."""


def rate(count: int, of: int) -> Rate:
    """The share with its 95 % Wilson interval; without trials there is neither."""
    if of == 0:
        return Rate(count=0, of=0, share=None, low=None, high=None)
    low, high = wilson_interval(count, of)
    return Rate(count=count, of=of, share=count / of, low=low, high=high)


def wilson_interval(count: int, of: int) -> tuple[float, float]:
    """95 % score interval of a binomial share (Wilson 1927, "Probable inference"), in Newcombe's (1998) notation.

    Raises:
        ValueError: no trials, or a count outside them.
    """
    if of < 1 or not 0 <= count <= of:
        raise ValueError(f"{count} of {of} is no share")
    share, squared = count / of, _Z_95 * _Z_95
    middle = share + squared / (2 * of)
    half = _Z_95 * math.sqrt(share * (1 - share) / of + squared / (4 * of * of))
    scale = 1 + squared / of
    # At the ends the formula gives 0 and 1 but for rounding.
    low = 0.0 if count == 0 else (middle - half) / scale
    high = 1.0 if count == of else (middle + half) / scale
    return low, high


def paired_difference(only_after: int, only_before: int, pairs: int) -> tuple[float, float, float]:
    """Difference of two paired shares (after − before) with an adjusted Wald 95 % interval.

    Half a pair is added to each of the four cells (Agresti and Min 2005, "Simple improved confidence intervals for
    comparing matched proportions"); the difference itself is the plain one.

    Raises:
        ValueError: no pairs.
    """
    if pairs < 1:
        raise ValueError("no pairs, no difference")
    difference = (only_after - only_before) / pairs
    total = pairs + 2
    after, before = (only_after + 0.5) / total, (only_before + 0.5) / total
    center = after - before
    half = _Z_95 * math.sqrt(max(after + before - center * center, 0.0) / total)
    return difference, max(center - half, -1.0), min(center + half, 1.0)


def mcnemar_exact(only_before: int, only_after: int) -> float:
    """Two-sided p of the exact (binomial) McNemar test on the discordant pairs; 1 without any."""
    from scipy.special import bdtr

    fewer, discordant = min(only_before, only_after), only_before + only_after
    return min(1.0, 2 * float(bdtr(fewer, discordant, 0.5))) if discordant else 1.0


@dataclass(frozen=True)
class SignedRank:
    """Result of the signed-rank test on differences after − before.

    ``shift``: Hodges–Lehmann estimate, the median of all pairwise means; ``low`` and ``high``: its distribution-free
    95 % interval, None under six pairs; ``effect``: matched-pairs rank-biserial correlation, positive where after is
    larger.
    """

    pairs: int
    shift: float
    low: float | None
    high: float | None
    effect: float
    p: float


def signed_rank(differences: Sequence[float]) -> SignedRank:
    """Wilcoxon's signed-rank test; zero differences keep their ranks (Pratt 1959), ties share the mean rank.

    Up to 60 pairs p comes from the exact permutation distribution of the ranks as they are, ties included; above from
    the normal approximation with continuity correction.

    Raises:
        ValueError: no differences.
    """
    values = np.asarray(differences, dtype=float)
    if len(values) == 0:
        raise ValueError("no pairs, no test")
    ranks = _mean_ranks(np.abs(values))
    positive, negative = float(ranks[values > 0].sum()), float(ranks[values < 0].sum())
    total = positive + negative
    averages = walsh_averages(values)
    low, high = _interval(averages, len(values))
    return SignedRank(
        pairs=len(values),
        shift=float(np.median(averages)),
        low=low,
        high=high,
        effect=(positive - negative) / total if total else 0.0,
        p=_two_sided(ranks[values != 0], positive) if total else 1.0,
    )


def _mean_ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rank of each value from 1; equal values share the mean of theirs."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[places]


def walsh_averages(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """All n(n + 1)/2 pairwise means, each value with itself included, in ascending order."""
    first, second = np.triu_indices(len(values))
    return np.sort((values[first] + values[second]) / 2)


def _interval(averages: NDArray[np.float64], count: int) -> tuple[float | None, float | None]:
    """Distribution-free 95 % interval from the ordered Walsh averages (Hollander and Wolfe, chapter 3)."""
    if count < FEWEST_PAIRS:
        return None, None
    if count <= _MOST_EXACT:
        cumulated = np.cumsum(_rank_sum_chances(2 * np.arange(1, count + 1)))[::2]
        cut = int(np.searchsorted(cumulated, 0.025, side="right"))
    else:
        spread = math.sqrt(count * (count + 1) * (2 * count + 1) / 24)
        cut = int(count * (count + 1) / 4 - _Z_95 * spread)
    cut = max(cut, 1)
    return float(averages[cut - 1]), float(averages[-cut])


def _two_sided(ranks: NDArray[np.float64], positive: float) -> float:
    """Two-sided p of a sum of positive ranks, given all ranks of differences other than 0."""
    if len(ranks) <= _MOST_EXACT:
        chances = _rank_sum_chances(np.rint(2 * ranks).astype(np.int64))
        at = round(2 * positive)
        return float(min(1.0, 2 * min(chances[: at + 1].sum(), chances[at:].sum())))
    spread = 0.5 * math.sqrt(float((ranks**2).sum()))
    distance = max(abs(positive - float(ranks.sum()) / 2) - 0.5, 0.0)
    return math.erfc(distance / spread / math.sqrt(2))


def _rank_sum_chances(doubled_ranks: NDArray[np.int64]) -> NDArray[np.float64]:
    """Probability of every sum of doubled ranks (mean ranks end in .5) when each sign is a fair coin."""
    chances = np.ones(1)
    for rank in doubled_ranks:
        longer = np.zeros(len(chances) + int(rank))
        longer[: len(chances)] += 0.5 * chances
        longer[int(rank) :] += 0.5 * chances
        chances = longer
    return chances


def holm(p_values: Sequence[float]) -> list[float]:
    """Step-down adjusted p values (Holm 1979), in the given order."""
    count = len(p_values)
    adjusted = [0.0] * count
    highest = 0.0
    for position, index in enumerate(sorted(range(count), key=lambda i: (p_values[i], i))):
        highest = max(highest, min(1.0, (count - position) * p_values[index]))
        adjusted[index] = highest
    return adjusted
