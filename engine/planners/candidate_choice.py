"""Which candidate a sampling planner drives: the cheapest that nothing speaks against."""

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol, TypeVar


class Candidate(Protocol):
    """A trajectory with its total cost; the id decides between equal costs."""

    @property
    def cost(self) -> Any:
        """Weighted sum of the cost terms."""

    @property
    def uniqueId(self) -> Any:  # noqa: N802 - as the core names it
        """A number of its own."""


AnyCandidate = TypeVar("AnyCandidate", bound=Candidate)


def cheapest_first(
    candidates: Iterable[AnyCandidate], complete: Callable[[Sequence[AnyCandidate]], None], at_once: int
) -> Iterator[AnyCandidate]:
    """Candidates by ascending cost, the rest of their costs computed only as far as somebody asks for the next one.

    The given costs lack dear terms that are never negative. ``complete`` adds them to so many candidates ``at_once``,
    in the order of the costs so far. A completed candidate that costs less than the next one does without the dear
    terms is cheaper than all that follow, so the order is the same as if all had been completed before.
    """
    waiting = sorted(candidates, key=_order)
    completed: list[tuple[Any, Any, AnyCandidate]] = []
    for begin in range(0, len(waiting), at_once):
        while completed and completed[0][0] < waiting[begin].cost:
            yield heapq.heappop(completed)[-1]
        several = waiting[begin : begin + at_once]
        complete(several)
        for candidate in several:
            heapq.heappush(completed, (*_order(candidate), candidate))
    while completed:
        yield heapq.heappop(completed)[-1]


def _order(candidate: Candidate) -> tuple[Any, Any]:
    return candidate.cost, candidate.uniqueId


def first_without_objection(
    ordered: Iterable[AnyCandidate], objection: Callable[[AnyCandidate], str | None], rejected: Counter[str]
) -> AnyCandidate | None:
    """The first candidate that nothing speaks against; the objections to those before it are counted."""
    for candidate in ordered:
        found = objection(candidate)
        if found is None:
            return candidate
        rejected[found] += 1
    return None
