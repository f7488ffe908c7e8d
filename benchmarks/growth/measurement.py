"""Processor time on doubled inputs, and the exponent of its growth.

Times are processor times (user and system, including ended child processes), so that other load has little effect. The
exponent is the least-squares slope of log time over log size; n log n has about 1.1 to 1.2 at these sizes, and n² has
2.
"""

import gc
import math
import os
import re
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from plannerforge.schemas.errors import PlannerForgeError

SHORTEST_S = 0.05
"""Below this, one-time work dominates growth (chosen)."""
_UPPER_SIZES = 3
"""Number of largest sizes for the slope (chosen): constants dominate smaller ones."""
_LONGEST_S = 8.0
"""Work that takes longer is done once per size (chosen)."""

Work = Callable[[], object]


@dataclass(frozen=True)
class Subject:
    """Something that is done with inputs of several sizes.

    ``prepare`` makes an input of a size in a new folder and gives the work to be timed; ``sizes`` ascend.
    """

    name: str
    sizes: tuple[int, ...]
    prepare: Callable[[int, Path], Work]


@dataclass(frozen=True)
class Timed:
    """Processor seconds of the work at a size; ``refused``: the code of the refusal that it ended with."""

    size: int
    seconds: float
    refused: str = ""


@dataclass(frozen=True)
class Growth:
    """The measurements of a subject."""

    name: str
    timed: tuple[Timed, ...]

    @property
    def slope(self) -> float | None:
        """The exponent over the three largest measurable sizes; None if there are fewer."""
        done = [(one.size, one.seconds) for one in self.timed if not one.refused and one.seconds >= SHORTEST_S]
        return round(slope(done[-_UPPER_SIZES:]), 2) if len(done) >= _UPPER_SIZES else None

    @property
    def exponent(self) -> float | None:
        """The exponent of an input accepted at any size; None if some size is refused or nothing was measured."""
        return None if any(one.refused for one in self.timed) else self.slope

    @property
    def figure(self) -> float | str:
        """The exponent, or the reason why it is missing."""
        refused = next((one.size for one in self.timed if one.refused), None)
        if refused is not None:
            return f"refused from {refused} on" + (f", before that {self.slope}" if self.slope is not None else "")
        return f"below {SHORTEST_S:g} s" if self.exponent is None else self.exponent


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Return the slope of the least-squares line through the logarithms of sizes and times."""
    sizes, times = ([math.log(value) for value in values] for values in zip(*points, strict=True))
    return statistics.linear_regression(sizes, times).slope


def measured(subject: Subject, folder: Path, repeats: int, doublings: int | None = None) -> Growth:
    """Time the work of a subject at its sizes in ascending order; the best repeat counts.

    Args:
        folder: for the inputs, each in its own folder.
        repeats: timings per size, each on a new input.
        doublings: number of sizes, smallest first; all by default.
    """
    sizes = subject.sizes[: None if doublings is None else doublings + 1]
    own = folder / re.sub(r"\W+", "_", subject.name)
    _timed(subject, sizes[0], own / "first")  # one-time loading
    timed = []
    for size in sizes:
        tries: list[Timed] = []
        while len(tries) < repeats and sum(one.seconds for one in tries) < _LONGEST_S:
            tries.append(_timed(subject, size, own / f"{size}_{len(tries)}"))
        timed.append(min(tries, key=lambda one: one.seconds))
    return Growth(subject.name, tuple(timed))


def _timed(subject: Subject, size: int, folder: Path) -> Timed:
    folder.mkdir(parents=True)
    work = subject.prepare(size, folder)
    gc.collect()
    began, refused = processor_s(), ""
    try:
        work()
    except PlannerForgeError as refusal:
        refused = refusal.code
    return Timed(size, processor_s() - began, refused)


def processor_s() -> float:
    """Return the processor seconds of this process and its ended children."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
