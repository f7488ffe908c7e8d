"""Reduces a failure to the items and values that it needs. The caller decides what these are, and whether the failure
remains.

``minimal_subset`` is the delta debugging of Zeller and Hildebrandt ("Simplifying and Isolating Failure-Inducing Input",
2002). Its result is 1-minimal: without any single one of the remaining items, the failure disappears.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item", bound=Hashable)
Candidate = TypeVar("Candidate", bound=Hashable)


class OutOfRuns(Exception):
    """Raised if a reduction has used all of its runs."""


@dataclass
class Trials(Generic[Candidate]):
    """Tests whether the same failure remains for a candidate; runs each candidate once, and at most ``most``
    candidates.
    """

    remains: Callable[[Candidate], bool]
    most: int
    known: dict[Candidate, bool] = field(default_factory=dict)

    @property
    def runs(self) -> int:
        """The number of candidates that were run."""
        return len(self.known)

    def __call__(self, candidate: Candidate) -> bool:
        """Return True if the failure remains.

        Raises:
            OutOfRuns: no run is left for the candidate.
        """
        if candidate not in self.known:
            if len(self.known) >= self.most:
                raise OutOfRuns
            self.known[candidate] = self.remains(candidate)
        return self.known[candidate]


@dataclass(frozen=True)
class Subset(Generic[Item]):
    """The remaining items in their order; ``is_minimal``: no item can be left out (False if the runs were used up
    first).
    """

    items: tuple[Item, ...]
    is_minimal: bool = True


def minimal_subset(items: Sequence[Item], remains: Callable[[tuple[Item, ...]], bool]) -> Subset[Item]:
    """Return a 1-minimal subset with which the failure remains.

    Args:
        items: all items; with them, the failure occurs.
        remains: returns True if the failure remains with only some of the items. It may raise ``OutOfRuns``; the
            smallest subset so far is returned then.
    """
    kept, parts = tuple(items), 1
    try:
        while kept:
            if parts == 1 and remains(()):
                return Subset(())
            parts = max(parts, 2)
            size = max(-(-len(kept) // parts), 1)
            pieces = [kept[begin : begin + size] for begin in range(0, len(kept), size)]
            smaller = _smaller(kept, pieces, remains)
            if smaller is not None:
                kept, parts = smaller, max(parts - 1, 2)
            elif size == 1:
                break
            else:
                parts = min(parts * 2, len(kept))
    except OutOfRuns:
        return Subset(kept, is_minimal=False)
    return Subset(kept)


def _smaller(
    kept: tuple[Item, ...], pieces: Sequence[tuple[Item, ...]], remains: Callable[[tuple[Item, ...]], bool]
) -> tuple[Item, ...] | None:
    """Return the items without the first piece that the failure does not need, or None if it needs every piece."""
    for piece in pieces:
        rest = tuple(item for item in kept if item not in piece)
        if rest != kept and rest and remains(rest):
            return rest
    return None


@dataclass(frozen=True)
class NearValues:
    """Values as near to their base as the failure allows, and the indices of those that differ from the base."""

    values: tuple[float, ...]
    changed: tuple[int, ...]


def nearest_values(
    values: Sequence[float],
    base: Sequence[float],
    remains: Callable[[tuple[float, ...]], bool],
    halvings: int = 1,
    decimals: int = 6,
) -> NearValues:
    """Return values that are moved towards their base, one after the other, as far as the failure remains.

    Args:
        values: the values with which the failure occurs.
        base: the values that count as unchanged, in the same order.
        remains: returns True if the failure remains with other values. It may raise ``OutOfRuns``.
        halvings: the number of times that the distance from the base is halved, for a value that cannot return to it.
        decimals: the number of decimals that halved values are rounded to.
    """
    near = list(values)
    try:
        for index, target in enumerate(base):
            if near[index] != target and remains(_with(near, index, target)):
                near[index] = target
        for index, target in enumerate(base):
            for _ in range(halvings):
                half = round((near[index] + target) / 2, decimals)
                if near[index] == target or half == near[index] or not remains(_with(near, index, half)):
                    break
                near[index] = half
    except OutOfRuns:
        pass
    return NearValues(tuple(near), tuple(index for index, target in enumerate(base) if near[index] != target))


def _with(values: Sequence[float], index: int, value: float) -> tuple[float, ...]:
    return (*values[:index], value, *values[index + 1 :])


def smallest(options: Sequence[Item], remains: Callable[[Item], bool]) -> Item | None:
    """Return the smallest option with which the failure remains; None if there is no such option. Options are tried
    from large to small.
    """
    found: Item | None = None
    try:
        for option in options:
            if not remains(option):
                break
            found = option
    except OutOfRuns:
        pass
    return found
