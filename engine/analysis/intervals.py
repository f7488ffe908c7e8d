"""Shares with their uncertainty."""

import math

from plannerforge.schemas.results import Rate

Z_95 = 1.959963984540054


def wilson_interval(count: int, of: int, z: float = Z_95) -> tuple[float, float]:
    """Score interval of a binomial share (Wilson 1927, "Probable inference"), here in Newcombe's (1998) notation.

    Raises:
        ValueError: no trials, or a count outside them.
    """
    if of < 1 or not 0 <= count <= of:
        raise ValueError(f"{count} of {of} is no share")
    share, squared = count / of, z * z
    middle = share + squared / (2 * of)
    half = z * math.sqrt(share * (1 - share) / of + squared / (4 * of * of))
    scale = 1 + squared / of
    # At the ends the formula gives 0 and 1 but for rounding.
    low = 0.0 if count == 0 else (middle - half) / scale
    high = 1.0 if count == of else (middle + half) / scale
    return low, high


def rate(count: int, of: int) -> Rate:
    """The share with its interval; without trials there is neither."""
    if of == 0:
        return Rate(count=0, of=0, share=None, low=None, high=None)
    low, high = wilson_interval(count, of)
    return Rate(count=count, of=of, share=count / of, low=low, high=high)


def paired_difference(only_after: int, only_before: int, pairs: int, z: float = Z_95) -> tuple[float, float, float]:
    """Difference of two paired shares (after − before) with an adjusted Wald interval.

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
    half = z * math.sqrt(max(after + before - center * center, 0.0) / total)
    return difference, max(center - half, -1.0), min(center + half, 1.0)
