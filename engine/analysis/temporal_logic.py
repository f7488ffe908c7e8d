"""Signal temporal logic over the steps of a run, graded: how far a formula is from changing its truth value.

A signal is an array with one value per step. The robustness of a formula at a step (Donzé and Maler, "Robust
satisfaction of temporal logic over real-valued signals", FORMATS 2010) is positive if it holds and negative if it does
not: *not* changes the sign, *and* is the smallest and *or* the largest value; *always* and *historically* are the
smallest values over a time window, *once* is the largest. A condition that is only true or false has an infinite
robustness.

Runs are finite: in a window entirely outside of the run, nothing can violate *always* or *historically*, and nothing
can fulfil *once*.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..geometry import Values


def truth(condition: NDArray[np.bool_]) -> Values:
    """Return the robustness signal of a Boolean condition: +inf where it is true, −inf where it is false."""
    return np.where(condition, np.inf, -np.inf)


def negation(signal: Values) -> Values:
    """Return the signal of *not*."""
    return -signal


def conjunction(*signals: Values) -> Values:
    """Return the signal of *and*."""
    least: Values = np.minimum.reduce(signals)
    return least


def disjunction(*signals: Values) -> Values:
    """Return the signal of *or*."""
    greatest: Values = np.maximum.reduce(signals)
    return greatest


def implies(condition: Values, demand: Values) -> Values:
    """Return the signal of the implication from the condition to the demand."""
    return disjunction(negation(condition), demand)


def historically(signal: Values, first: int = 0, last: int | None = None) -> Values:
    """Return the signal of "it held at all steps from ``last`` (None: the beginning) to ``first`` steps ago"."""
    return always(signal[::-1], first, last)[::-1]


def once(signal: Values, first: int = 0, last: int | None = None) -> Values:
    """Return the signal of "it held at some step from ``last`` (None: the beginning) to ``first`` steps ago"."""
    return negation(historically(negation(signal), first, last))


def always(signal: Values, first: int = 0, last: int | None = None) -> Values:
    """Return the signal of "it holds at all steps from ``first`` to ``last`` (None: the end) steps ahead"."""
    return _over_windows(signal, first, last, np.min)


def previously(signal: Values) -> Values:
    """Return the signal of "it held at the previous step"; false at the first step."""
    return np.concatenate([[-np.inf], signal[:-1]])


def since(holds: Values, began: Values) -> Values:
    """Return the signal of "``holds`` has been true at all steps since ``began`` was true at some step"."""
    result = np.array(began, dtype=float)
    for at in range(1, len(result)):
        result[at] = max(result[at], min(float(holds[at]), result[at - 1]))
    return result


def _over_windows(signal: Values, first: int, last: int | None, of: Callable[[Values], float]) -> Values:
    count = len(signal)
    ends = [count if last is None else min(at + last + 1, count) for at in range(count)]
    windows = (signal[at + first : end] for at, end in enumerate(ends))
    return np.array([float(of(window)) if len(window) else np.inf for window in windows])
