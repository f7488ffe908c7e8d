"""Chooses the scenarios that a coverage plan generates next, until every combination of levels is covered.

Combinations that were never tried get rows from a covering array (covertable). A refused row may contain combinations
that are possible. Each such combination is tried again in its own row, with other levels that have worked together,
until it is made, or is refused ``TRIES`` times and counts as impossible. When every combination is settled, further
arrays follow. The same state gives the same rows.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product

from ...schemas.generation import Combination, CoverageReport, CoverageRequest, PlanFactor
from ..execution import ProgressReporter

TRIES = 3
"""The number of refused rows after which a combination counts as impossible (chosen)."""
_Rank = Callable[[Mapping[int, int], int, int], tuple[int, ...]]
"""Ranks a level of a factor, given the levels already chosen: takes the factor's index and the level's index."""


def plan_coverage(request: CoverageRequest, report: ProgressReporter) -> CoverageReport:
    """Return the progress of a plan and its next rows.

    The list of rows is empty if ``most`` is 0 or no further combination can be made.
    """
    report(0.0, "choosing the next rows")
    covered = frozenset(request.covered)
    times = dict(request.refused)
    failed = frozenset(key for key, count in times.items() if count >= TRIES and key not in covered)
    plan = _Space(request.factors, request.barred)
    possible = [key for key in plan.all_of(request.strength) if plan.completed(key) is not None]
    space = _Space(request.factors, (*request.barred, *sorted(failed)))
    allowed = [key for key in possible if key in covered or space.completed(key) is not None]
    left = [key for key in allowed if key not in covered]
    rows: list[tuple[int, ...]] = []
    if request.most and left:
        rows = _covering(space, request.strength, left, covered, times)
    elif request.most and allowed:
        for number in range(request.most):  # each array has at least one row
            rows += space.array(request.strength, salt=f"lap {request.lap} {number}")
            if len(rows) >= request.most:
                break
    can_be = frozenset(allowed)
    return CoverageReport(
        rows=tuple(rows[: request.most]),
        allowed=len(allowed),
        covered=len(can_be & covered),
        left=tuple(left),
        cannot=tuple(key for key in possible if key not in can_be),
    )


def combinations_in(row: Sequence[int | None], strength: int) -> Iterator[Combination]:
    """Yield the combinations of ``strength`` factors in a row; None marks a level that the plan does not have."""
    known = [(factor, level) for factor, level in enumerate(row) if level is not None]
    return combinations(known, strength)


def _covering(
    space: "_Space",
    strength: int,
    left: Sequence[Combination],
    covered: frozenset[Combination],
    times: Mapping[Combination, int],
) -> list[tuple[int, ...]]:
    """Return rows for all remaining combinations: array rows for untried combinations, then a row per refused one."""
    fresh = frozenset(key for key in left if not times.get(key))
    rows = space.array(strength, salt="", without=[key for key in space.all_of(strength) if key not in fresh])
    there = {key for row in rows for key in combinations_in(row, strength)}
    alone = [key for key in left if key not in there] + [key for key in left if key in there and key not in fresh]
    seen = set(rows)
    for key in alone:
        row = space.completed(key, _rank_with_covered(space, key, strength, covered, times.get(key, 0)))
        if row is not None and row not in seen:
            seen.add(row)
            rows.append(row)
    return rows


def _rank_with_covered(
    space: "_Space", key: Combination, strength: int, covered: frozenset[Combination], turn: int
) -> _Rank:
    """Return a ranking that prefers levels if their combinations with the chosen levels are already covered.

    ``turn``: how often the combination was refused; levels of equal rank take turns.
    """

    def rank(chosen: Mapping[int, int], factor: int, level: int) -> tuple[int, ...]:
        others = [part for part in chosen.items() if part[0] != factor]
        formed = (tuple(sorted((*parts, (factor, level)))) for parts in combinations(others, strength - 1))
        return sum(one not in covered for one in formed), (level + turn + key[0][1]) % space.sizes[factor]

    return rank


def _in_order(chosen: Mapping[int, int], factor: int, level: int) -> tuple[int, ...]:
    del chosen, factor
    return (level,)


class _Space:
    """All rows that avoid the barred combinations; ``sizes`` is the number of levels of each factor."""

    def __init__(self, factors: Sequence[PlanFactor], barred: Iterable[Combination]) -> None:
        self.sizes = [len(factor.levels) for factor in factors]
        self._barred = [dict(key) for key in barred]
        self._barred_with: dict[tuple[int, int], list[dict[int, int]]] = {}
        for key in self._barred:
            for part in key.items():
                self._barred_with.setdefault(part, []).append(key)

    def all_of(self, strength: int) -> Iterator[Combination]:
        """Yield all combinations of ``strength`` factors in order, including barred ones."""
        for factors in combinations(range(len(self.sizes)), strength):
            for levels in product(*(range(self.sizes[factor]) for factor in factors)):
                yield tuple(zip(factors, levels, strict=True))

    def completed(self, key: Combination, rank: _Rank = _in_order) -> tuple[int, ...] | None:
        """Extend a combination to a full row with the lowest-ranked levels; return None if every row is barred."""
        chosen: dict[int, int] = {}
        for factor, level in key:
            chosen[factor] = level
            if self._is_barred(chosen, factor):
                return None
        return self._filled(chosen, rank)

    def _filled(self, chosen: dict[int, int], rank: _Rank) -> tuple[int, ...] | None:
        factor = next((one for one in range(len(self.sizes)) if one not in chosen), None)
        if factor is None:
            return tuple(chosen[one] for one in range(len(self.sizes)))
        for level in sorted(range(self.sizes[factor]), key=lambda one: rank(chosen, factor, one)):
            chosen[factor] = level
            if not self._is_barred(chosen, factor) and (row := self._filled(chosen, rank)) is not None:
                return row
            del chosen[factor]
        return None

    def _is_barred(self, chosen: Mapping[int, int], factor: int) -> bool:
        """Return whether the chosen levels contain a barred combination with this factor's level."""
        keys = self._barred_with.get((factor, chosen[factor]), ())
        return any(all(chosen.get(one) == level for one, level in key.items()) for key in keys)

    def array(self, strength: int, *, salt: str, without: Iterable[Combination] = ()) -> list[tuple[int, ...]]:
        """Return a covering array without barred combinations; combinations in ``without`` may be missing."""
        from covertable.main import Controller

        factors = {str(factor): list(range(size)) for factor, size in enumerate(self.sizes)}
        constraints = [
            {
                "operator": "not",
                "condition": {
                    "operator": "and",
                    "conditions": [
                        {"operator": "eq", "left": str(factor), "value": level} for factor, level in key.items()
                    ],
                },
            }
            for key in self._barred
        ]
        controller = Controller(factors, strength=strength, constraints=constraints, salt=salt)
        for key in without:
            controller.consume_pairs({str(factor): controller.serials[str(factor)][level] for factor, level in key})
        return [tuple(row[str(factor)] for factor in range(len(self.sizes))) for row in controller.make_async()]
