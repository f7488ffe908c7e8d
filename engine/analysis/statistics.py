"""Statistics on shares and on paired runs: intervals, exact tests, Holm's adjustment. The scenario is the unit.

Runs of one scenario (of its planning problems, configurations, predictions, edited versions) are alike: ten such runs
show less than runs of ten scenarios. Therefore intervals are those of an equivalent number of independent runs (by the
design effect), and tests treat a scenario as one unit. If every scenario has one run, these are the usual intervals and
tests.

scipy has no Holm adjustment, no interval for paired shares and, with ties, no exact signed-rank test; these are written
here. So are the Wilson interval, the binomial test of a fair coin and mean ranks: a first comparison in a worker would
wait for ``scipy.stats``, which takes most of a second to import. The tests compare them with scipy's.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.artifacts import SuccessRates, SuccessRequest
from ...schemas.results import SIGNIFICANCE_LEVEL, Rate
from ..execution import ProgressReporter

FEWEST_PAIRS = 6
"""With fewer differing pairs, a two-sided test on signs or ranks cannot go below 5%: 2 · 0.5⁵ = 6.25%."""
_Z_95 = 1.959963984540054
"""The 97.5% quantile of the standard normal distribution."""
_Z_80 = 0.8416212335729143
"""The 80% quantile of the standard normal distribution."""
LEVEL = SIGNIFICANCE_LEVEL
"""The level of all tests and intervals."""
_BISECTIONS = 40
"""Halvings of a range of at most 2: they leave an error below 1e-11 (chosen)."""
_MOST_EXACT = 60
"""Largest number of pairs with an exact p (chosen): above, the normal approximation is as good and much faster."""


def rate(count: int, of: int) -> Rate:
    """Return the share of independent trials with its 95% Wilson interval; all None if there are no trials."""
    if of == 0:
        return Rate(count=0, of=0, share=None, low=None, high=None)
    low, high = wilson_interval(count, of)
    return Rate(count=count, of=of, share=count / of, low=low, high=high)


def rate_by_scenario(trials: Iterable[tuple[str, bool]]) -> Rate:
    """Return the share of true trials with its 95% interval; a trial is its scenario and its outcome.

    If there are no trials, the share and the interval are None. The interval is Wilson's for the effective number of
    trials, with Student's quantile for the number of scenarios (Korn and Graubard 1998; Dean and Pagano 2015 on
    Wilson's form of it). The design effect of the scenarios reduces the number of trials (Rao and Scott 1992, "A simple
    method for the analysis of clustered binary data"). If all trials have the same outcome, a scenario counts as one
    trial.
    """
    clusters = _sums((key, float(outcome)) for key, outcome in trials)
    count, of = round(sum(total for total, _ in clusters)), sum(size for _, size in clusters)
    if of == 0:
        return Rate(count=0, of=0, share=None, low=None, high=None, scenarios=0)
    share = count / of
    low, high = wilson_interval(count, of, _effective(clusters, of, share, share * (1 - share)))
    return Rate(count=count, of=of, share=share, low=low, high=high, scenarios=len(clusters))


def success_rates(request: SuccessRequest, report: ProgressReporter) -> SuccessRates:
    """Return the rate of each set of trials, as :func:`rate_by_scenario` computes it."""
    rates = tuple(rate_by_scenario(trials) for trials in request.sets)
    report(1.0, "counted")
    return SuccessRates(rates=rates)


_Cluster = tuple[float, int]
"""The sum over the trials of a scenario, and their number."""


def _sums(trials: Iterable[tuple[str, float]]) -> list[_Cluster]:
    """Return the sum and number of each scenario's values, in order of appearance."""
    sums: dict[str, tuple[float, int]] = {}
    for key, value in trials:
        total, size = sums.get(key, (0.0, 0))
        sums[key] = (total + value, size + 1)
    return list(sums.values())


def _effective(clusters: Sequence[_Cluster], of: int, mean: float, variance: float) -> float:
    """Return the number of independent trials that estimate the mean as precisely as the clustered trials."""
    count = len(clusters)
    if count == of:
        return float(of)
    if variance <= 0 or count < 2:
        return float(count)
    residuals = sum((total - size * mean) ** 2 for total, size in clusters)
    design = count / (count - 1) * residuals / (of * variance)
    return of / max(design, 1.0) * (_Z_95 / _student(count - 1)) ** 2


def _student(degrees: int) -> float:
    """Return the 97.5% quantile of Student's distribution."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 0.975))


def wilson_interval(count: int, of: int, effective: float | None = None) -> tuple[float, float]:
    """Return the 95% score interval of a binomial share (Wilson 1927; notation of Newcombe 1998).

    ``effective``: the number of independent trials; by default ``of``.

    Raises:
        ValueError: there are no trials, or the count is not between 0 and ``of``.
    """
    if of < 1 or not 0 <= count <= of:
        raise ValueError(f"{count} of {of} is not a share")
    share, squared = count / of, _Z_95 * _Z_95
    trials = float(of) if effective is None else effective
    middle = share + squared / (2 * trials)
    half = _Z_95 * math.sqrt(share * (1 - share) / trials + squared / (4 * trials * trials))
    scale = 1 + squared / trials
    # The formula gives 0 and 1 here except for rounding.
    low = 0.0 if count == 0 else (middle - half) / scale
    high = 1.0 if count == of else (middle + half) / scale
    return low, high


@dataclass(frozen=True)
class PairedShares:
    """Success before and after on the same problems: difference (after − before), 95% interval, and p.

    ``p`` is exact: under the null hypothesis, each scenario's flips could have gone the other way, all together
    (McNemar's test if every scenario has one pair). If the exact test shows no difference (p of at least 0.05), the
    interval is widened to include 0.
    """

    difference: float
    low: float
    high: float
    p: float


def paired_shares(flips: Iterable[tuple[str, int]]) -> PairedShares:
    """Return the difference of two paired shares; a pair is a scenario and 1 (to success), −1 (to failure) or 0.

    The interval is Tango's score interval (1998, "Equivalence test and confidence interval for the difference in
    proportions for the paired-sample design"), which keeps its level if few or no pairs flip. The pairs are first
    reduced to their effective number, as in :func:`rate_by_scenario`.

    Raises:
        ValueError: there are no pairs.
    """
    pairs = list(flips)
    if not pairs:
        raise ValueError("a difference needs pairs")
    clusters = _sums((key, float(flip)) for key, flip in pairs)
    gained, lost = (sum(flip == sign for _, flip in pairs) / len(pairs) for sign in (1, -1))
    difference = gained - lost
    effective = _effective(clusters, len(pairs), difference, gained + lost - difference**2)
    low = -_largest_difference(lost * effective, gained * effective, effective)
    high = _largest_difference(gained * effective, lost * effective, effective)
    p = _sign_flips([round(total) for total, _ in clusters])
    if p >= LEVEL:
        low, high = min(low, 0.0), max(high, 0.0)
    return PairedShares(difference, low, high, p)


def _largest_difference(gained: float, lost: float, pairs: float) -> float:
    """Return the largest difference of two paired shares that a two-sided score test at 5% does not reject."""
    low, high = (gained - lost) / pairs, 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        # The share of pairs that flip to failure, as likely as possible if the difference is ``middle``.
        slope = (2 * pairs - gained + lost) * middle - gained - lost
        root = math.sqrt(slope * slope + 8 * pairs * lost * middle * (1 - middle))
        variance = pairs * ((root - slope) / (2 * pairs) + middle * (1 - middle))
        rejected = (pairs * middle - gained + lost) ** 2 > _Z_95**2 * max(variance, 0.0)
        low, high = (low, middle) if rejected else (middle, high)
    return low


def _sign_flips(totals: Sequence[int]) -> float:
    """Return the two-sided p of a sum of totals that could each have the opposite sign; 1 if all totals are 0."""
    sizes = np.array([abs(total) for total in totals if total], dtype=float)
    if not len(sizes):
        return 1.0
    positive = float(sum(total for total in totals if total > 0))
    if (sizes == 1).all():
        return mcnemar_exact(len(sizes) - round(positive), round(positive))
    return _two_sided(sizes, positive)


def needed_scenarios(discordant: float, difference: float) -> int | None:
    """Return the number of pairs that show a difference at 5% with a power of 80%, or None if no number does.

    Connor 1987, "Sample size for testing differences in proportions for the paired-sample design"; ``discordant`` is
    the share of pairs that flip, which is at least the difference.
    """
    share = max(discordant, difference)
    if difference <= 0 or share <= 0:
        return None
    inner = max(share - difference**2, 0.0)
    return math.ceil((_Z_95 * math.sqrt(share) + _Z_80 * math.sqrt(inner)) ** 2 / difference**2)


def mcnemar_exact(only_before: int, only_after: int) -> float:
    """Return the two-sided p of the exact (binomial) McNemar test on discordant pairs; 1 if there are none."""
    from scipy.special import bdtr

    fewer, discordant = min(only_before, only_after), only_before + only_after
    return min(1.0, 2 * float(bdtr(fewer, discordant, 0.5))) if discordant else 1.0


@dataclass(frozen=True)
class SignedRank:
    """The result of the signed-rank test on differences after − before.

    ``shift``: Hodges–Lehmann estimate, the median of all pairwise means; ``low`` and ``high``: its distribution-free 95
    % interval, None under six pairs; ``effect``: matched-pairs rank-biserial correlation, positive if after is larger.
    """

    pairs: int
    shift: float
    low: float | None
    high: float | None
    effect: float
    p: float


def signed_rank(differences: Sequence[float]) -> SignedRank:
    """Return Wilcoxon's signed-rank test of differences; zeros keep ranks (Pratt 1959), ties share the mean rank.

    Up to 60 pairs, p comes from the exact permutation distribution of the observed ranks, ties included; above, from
    the normal approximation with continuity correction.

    Raises:
        ValueError: there are no differences.
    """
    values = np.asarray(differences, dtype=float)
    if len(values) == 0:
        raise ValueError("a test needs pairs")
    ranks = mean_ranks(np.abs(values))
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


def cluster_means(values: Iterable[tuple[str, float]]) -> list[float]:
    """Return the mean of each scenario's values, in order of appearance."""
    return [total / size for total, size in _sums(values)]


def rank_correlation(rows: Sequence[Sequence[float]], fixed: int = 0) -> tuple[float, float] | None:
    """Return Spearman's ρ of the first two columns, one row per scenario, and its two-sided p.

    The result is None if a column is constant. ``fixed``: number of further columns that are held fixed. Their ranks
    are removed from the first two columns by least squares (partial rank correlation), which costs as many degrees of
    freedom. p comes from Student's distribution.
    """
    from scipy.special import stdtr

    ranks = np.column_stack([mean_ranks(np.asarray(column, dtype=float)) for column in zip(*rows, strict=True)])
    others = np.column_stack([np.ones(len(ranks)), ranks[:, 2 : 2 + fixed]])
    left = ranks[:, :2] - others @ np.linalg.lstsq(others, ranks[:, :2], rcond=None)[0]
    lengths = np.linalg.norm(left, axis=0)
    degrees = len(ranks) - 1 - np.linalg.matrix_rank(others)
    if degrees < 1 or (lengths < 1e-9 * len(ranks)).any():
        return None
    rho = float(np.clip(left[:, 0] @ left[:, 1] / lengths.prod(), -1.0, 1.0))
    if abs(rho) > 1 - 1e-12:
        return rho, 0.0
    return rho, min(1.0, 2 * float(stdtr(degrees, -abs(rho) * math.sqrt(degrees / (1 - rho * rho)))))


def mean_ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rank of each value, from 1; equal values share the mean of their ranks."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[places]


def walsh_averages(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return all n(n + 1)/2 pairwise means, each value with itself included, in ascending order."""
    first, second = np.triu_indices(len(values))
    return np.sort((values[first] + values[second]) / 2)


def _interval(averages: NDArray[np.float64], count: int) -> tuple[float | None, float | None]:
    """Return the distribution-free 95% interval from the ordered Walsh averages (Hollander and Wolfe, chapter 3)."""
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
    """Return the two-sided p of a sum of positive ranks, given all ranks of nonzero differences."""
    if len(ranks) <= _MOST_EXACT:
        chances = _rank_sum_chances(np.rint(2 * ranks).astype(np.int64))
        at = round(2 * positive)
        return float(min(1.0, 2 * min(chances[: at + 1].sum(), chances[at:].sum())))
    spread = 0.5 * math.sqrt(float((ranks**2).sum()))
    distance = max(abs(positive - float(ranks.sum()) / 2) - 0.5, 0.0)
    return math.erfc(distance / spread / math.sqrt(2))


def _rank_sum_chances(doubled_ranks: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the probability of every sum of doubled ranks (mean ranks end in .5) if each sign is a fair coin."""
    chances = np.ones(1)
    for rank in doubled_ranks:
        longer = np.zeros(len(chances) + int(rank))
        longer[: len(chances)] += 0.5 * chances
        longer[int(rank) :] += 0.5 * chances
        chances = longer
    return chances


def fisher_exact(first: tuple[int, int], second: tuple[int, int]) -> float:
    """Return the two-sided p of Fisher's exact test on two groups (count, of)."""
    of, other, total = first[1], second[1], first[0] + second[0]
    ways = {k: math.comb(of, k) * math.comb(other, total - k) for k in range(max(0, total - other), min(of, total) + 1)}
    seen = ways[first[0]]
    return sum(way for way in ways.values() if way <= seen) / sum(ways.values())


def holm(p_values: Sequence[float]) -> list[float]:
    """Return step-down adjusted p values (Holm 1979), in the given order."""
    count = len(p_values)
    adjusted = [0.0] * count
    highest = 0.0
    for position, index in enumerate(sorted(range(count), key=lambda i: (p_values[i], i))):
        highest = max(highest, min(1.0, (count - position) * p_values[index]))
        adjusted[index] = highest
    return adjusted
