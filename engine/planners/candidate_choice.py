"""Which candidate a sampling planner drives: the cheapest that nothing speaks against."""

from collections import Counter
from collections.abc import Callable, Iterable
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


def cheapest_first(candidates: Iterable[AnyCandidate]) -> list[AnyCandidate]:
    """Candidates by ascending cost."""
    return sorted(candidates, key=lambda candidate: (candidate.cost, candidate.uniqueId))


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
