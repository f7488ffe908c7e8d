"""Signal temporal logic over the steps of a run, graded: how far a formula is from turning.

A signal is an array with a value a step. The robustness of a formula at a step (Donzé and Maler, "Robust satisfaction
of temporal logic over real-valued signals", FORMATS 2010) is positive where it holds and negative where it does not:
*not* changes the sign, *and* is the least, *or* the greatest value; *always* and *historically* are least values over a
window of time, *once* is a greatest one. A condition that is only true or false is infinite.

Runs are finite: a window that lies wholly outside of the run has nothing that could break *always* or *historically*,
and nothing that could fulfil *once*.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..geometry import Values


def truth(condition: NDArray[np.bool_]) -> Values:
    """A condition without a degree."""
    return np.where(condition, np.inf, -np.inf)


def negation(signal: Values) -> Values:
    """Not."""
    return -signal


def conjunction(*signals: Values) -> Values:
    """And."""
    least: Values = np.minimum.reduce(signals)
    return least


def disjunction(*signals: Values) -> Values:
    """Or."""
    greatest: Values = np.maximum.reduce(signals)
    return greatest


def implies(condition: Values, demand: Values) -> Values:
    """Where the condition holds, the demand does."""
    return disjunction(negation(condition), demand)


def historically(signal: Values, first: int = 0, last: int | None = None) -> Values:
    """At all steps from ``last`` (None: the beginning) to ``first`` steps ago."""
    return always(signal[::-1], first, last)[::-1]


def once(signal: Values, first: int = 0, last: int | None = None) -> Values:
    """At some step from ``last`` (None: the beginning) to ``first`` steps ago."""
    return negation(historically(negation(signal), first, last))


def always(signal: Values, first: int = 0, last: int | None = None) -> Values:
    """At all steps from ``first`` to ``last`` (None: the end) steps ahead."""
    return _over_windows(signal, first, last, np.min)


def previously(signal: Values) -> Values:
    """At the step before; at the first step there is none, and it is not so."""
    return np.concatenate([[-np.inf], signal[:-1]])


def since(holds: Values, began: Values) -> Values:
    """The one has held at all steps since the other did at some step."""
    result = np.array(began, dtype=float)
    for at in range(1, len(result)):
        result[at] = max(result[at], min(float(holds[at]), result[at - 1]))
    return result


def _over_windows(signal: Values, first: int, last: int | None, of: Callable[[Values], float]) -> Values:
    count = len(signal)
    ends = [count if last is None else min(at + last + 1, count) for at in range(count)]
    windows = (signal[at + first : end] for at, end in enumerate(ends))
    return np.array([float(of(window)) if len(window) else np.inf for window in windows])
