"""Random numbers of sensors that depend only on the seeds, the road user and the time step.

Each kind of error has a stream of its own for each road user. So an error does not change if another road user appears,
or if another kind of error is turned on.
"""

import math
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points, Values

_BLOCK = 64
"""Steps that are drawn together (chosen: a run has some hundreds)."""
Part = Literal["estimate", "missed", "class", "frames", "ghosts", "localisation"]
_PARTS: tuple[Part, ...] = ("estimate", "missed", "class", "frames", "ghosts", "localisation")


def stream(seeds: tuple[int, int], part: Part, key: int = 0) -> np.random.Generator:
    """Return the generator of random numbers for one part of the sensors and one road user."""
    return np.random.Generator(np.random.PCG64([*(seed % 2**64 for seed in seeds), _PARTS.index(part), key % 2**64]))


class Slow:
    """Standard normal numbers, one or more per step, that change slowly from step to step: a first-order Gauss-Markov
    process.
    """

    def __init__(self, numbers: np.random.Generator, columns: int, kept: float) -> None:
        """``kept``: the correlation of a number with the one at the previous step."""
        self._numbers, self._columns, self._kept = numbers, columns, kept
        self._values: Points = np.empty((0, columns))

    def at(self, index: int) -> Values:
        """Return the numbers of a step, counted from 0."""
        while index >= len(self._values):
            self._values = np.concatenate([self._values, self._block()])
        row: Values = self._values[index]
        return row

    def _block(self) -> Points:
        drawn = self._numbers.standard_normal((_BLOCK, self._columns))
        if self._kept <= 0:
            return drawn
        drawn *= math.sqrt(1 - self._kept**2)
        if len(self._values):
            drawn[0] += self._kept * self._values[-1]
        else:
            drawn[0] /= math.sqrt(1 - self._kept**2)
        return np.asarray(_decay(self._kept) @ drawn)


@lru_cache(maxsize=8)
def _decay(kept: float) -> Points:
    """Return the matrix in which row i adds each earlier number j ≤ i with the weight kept^(i − j)."""
    apart = np.arange(_BLOCK)[:, None] - np.arange(_BLOCK)[None, :]
    return np.where(apart >= 0, kept ** np.maximum(apart, 0), 0.0)


class Stretches:
    """A condition that holds at some steps: a two-state Markov chain with a given share of time and mean duration."""

    def __init__(self, numbers: np.random.Generator, share: float, mean_steps: float) -> None:
        self._numbers, self._share = numbers, share
        self._ends = 1.0 / max(mean_steps, 1.0)
        self._begins = 1.0 if share >= 1 else min(share * self._ends / (1 - share), 1.0)
        self._independent = mean_steps <= 1 or share >= 1
        self._values: list[bool] = []

    def at(self, index: int) -> bool:
        """Return whether the condition holds at a step, counted from 0."""
        while index >= len(self._values):
            self._extend(self._numbers.random(_BLOCK))
        return self._values[index]

    def _extend(self, drawn: NDArray[np.float64]) -> None:
        if self._independent:
            self._values += (drawn < self._share).tolist()
            return
        for number in drawn.tolist():
            if not self._values:
                self._values.append(number < self._share)
            else:
                self._values.append(number >= self._ends if self._values[-1] else number < self._begins)


def correlation(time_constant_s: float, step_s: float) -> float:
    """Return the correlation of a slow error with its value at the previous step."""
    return math.exp(-step_s / time_constant_s) if time_constant_s > 0 else 0.0
