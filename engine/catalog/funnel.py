"""The strict filter: matches after each stage, the condition that left nothing, and matches without it.

If nothing is left, the user's own words affect the ranking of the nearest entries: a condition that these words contain
was requested, while other conditions may be a model's guess. The paper's models rarely miss a requested slot, but add
some that were not requested (Results, Slot-level extraction).
"""

import math
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from heapq import nsmallest
from operator import and_

from ...schemas.catalog import STAGES, Stage
from .constraints import Constraint
from .entry_sets import EntrySet, Postings

FEW = 500
"""Up to this many entries, a condition is looked up for each one rather than for all that satisfy it (chosen)."""
_CHECKED_ONE_BY_ONE = 1_000
"""Up to this many entries are checked one by one, since an operation on all bits takes as long (chosen)."""
WEIGHTS: dict[Stage, float] = {"location": 8.0, "obstacles": 4.0, "road_net": 3.0, "velocity": 1.5, "tags": 1.0}
"""The weight of a satisfied condition in a fallback, before its rarity is added (chosen)."""
MENTIONED = 3.0
"""The additional weight of a condition in the user's own words; with it, a tag weighs as much as a count."""


@dataclass(frozen=True)
class _StageLeft:
    """The entries left after a stage that has conditions."""

    stage: Stage
    constraints: tuple[Constraint, ...]
    numbers: EntrySet


@dataclass(frozen=True)
class EmptiedBy:
    """The stage that left nothing, and its conditions that no candidate satisfied.

    ``together``: each single condition is satisfied by some candidate, but no candidate satisfies all; then all
    conditions of the stage are included.
    """

    stage: Stage
    constraints: tuple[Constraint, ...]
    together: bool


@dataclass(frozen=True)
class _Dropped:
    """Dropped conditions, and the entries that satisfy all others."""

    constraints: tuple[Constraint, ...]
    numbers: EntrySet


class Funnel:
    """The conditions of a search, applied to a catalogue.

    If earlier stages left few entries, a condition is checked only for those. All entries that satisfy a condition are
    looked up once, and only if they are needed.
    """

    def __init__(
        self,
        connection: sqlite3.Connection,
        constraints: Sequence[Constraint],
        within: Iterable[int] | None = None,
        text: str = "",
        postings: Postings | None = None,
    ) -> None:
        self._connection, self._text, self.postings = connection, text, postings or Postings()
        self.entries = self.postings.entries(connection)
        self.within = None if within is None else self.entries.of(within)
        self.everything = self.entries.all if self.within is None else self.within
        self.constraints = tuple(constraints)
        self._satisfying: dict[Constraint, EntrySet] = {}
        self._weights: dict[Constraint, float] = {}

    @cached_property
    def size(self) -> int:
        """The number of searched entries."""
        return len(self.everything)

    @property
    def matches(self) -> EntrySet:
        """The entries that satisfy every condition."""
        stages = self.stages
        return stages[-1].numbers if stages else self.everything

    @cached_property
    def stages(self) -> tuple[_StageLeft, ...]:
        """The stages that have conditions, in the paper's order, up to the stage that leaves nothing."""
        left, stages = self.everything, []
        for stage in STAGES:
            own = tuple(constraint for constraint in self.constraints if constraint.stage == stage)
            if not own:
                continue
            for constraint in reversed(own):  # the city before its country: fewer look-ups
                left = self._among(constraint, left)
            stages.append(_StageLeft(stage, own, left))
            if not left:
                break
        return tuple(stages)

    def holds(self, constraint: Constraint) -> EntrySet:
        """Return all entries that satisfy the condition."""
        if constraint not in self._satisfying:
            found = self.holding(constraint.query, constraint.values)
            self._satisfying[constraint] = self.everything - found if constraint.negated else self.everything & found
        return self._satisfying[constraint]

    def holding(self, query: str, values: Sequence[str | float]) -> EntrySet:
        """Return the catalogue's entries with the numbers that the query selects."""
        return self.postings.holding(self._connection, self.entries, query, values)

    def entering(self) -> EntrySet:
        """Return the entries that were left before the last stage."""
        return self.stages[-2].numbers if len(self.stages) > 1 else self.everything

    def emptied_by(self) -> EmptiedBy | None:
        """Return why nothing matches, or None if something does."""
        if not self.stages or self.stages[-1].numbers:
            return None
        entering, last = self.entering(), self.stages[-1]
        alone = tuple(constraint for constraint in last.constraints if not self.holds(constraint) & entering)
        countries = tuple(constraint for constraint in alone if constraint.subject == "country")
        return EmptiedBy(last.stage, countries or alone or last.constraints, together=not alone)

    def relaxations(self) -> tuple[_Dropped, ...]:
        """Return the smallest sets of conditions to drop for matches, most matches first; empty if all must be dropped.

        The result is exact for any number of conditions: conditions can be kept together if some entry satisfies all of
            them. Dropping a country also drops its city and counts once, since the city is in the country.
        """
        failed = {self._with_city(chosen) for chosen in self._failed_together()}
        possible = [dropped for dropped in failed if 0 < len(dropped) < len(self.constraints)]
        fewest = min((self._count_dropped(dropped) for dropped in possible), default=0)
        fewest_dropped = [dropped for dropped in possible if self._count_dropped(dropped) == fewest]
        relaxed = [
            _Dropped(one, self._all_of([constraint for constraint in self.constraints if constraint not in one]))
            for one in fewest_dropped
            if not any(set(other) < set(one) for other in fewest_dropped)
        ]
        return tuple(sorted(relaxed, key=lambda one: (-len(one.numbers), [each.label for each in one.constraints])))

    def satisfied_by(self, number: int) -> tuple[Constraint, ...]:
        """Return the conditions that this entry satisfies, in the given order."""
        return tuple(constraint for constraint in self.constraints if self._satisfies(constraint, number))

    def _satisfies(self, constraint: Constraint, number: int) -> bool:
        if constraint in self._satisfying:
            return number in self._satisfying[constraint]
        return any(constraint.found_among(self._connection, [number])) != constraint.negated

    def nearness(self, number: int) -> float:
        """Return the total weight of the conditions that this entry satisfies."""
        return round(sum(self._weight(constraint) for constraint in self.satisfied_by(number)), 6)

    def nearest(self, limit: int) -> list[int]:
        """Return entries that satisfy some conditions but not all, nearest first.

        Nearness is weighted by stage, since requests contain places and counts deliberately and over-predict tags
        (Results, Slot-level extraction); by rarity, since a rare property is rarely matched by chance; and by the
        user's own words, if known. In a tie, the older entry is first.
        """
        near: dict[float, list[tuple[Constraint, ...]]] = {}
        for failed in self._failed_together():
            if 0 < len(failed) < len(self.constraints):
                kept = (one for one in self.constraints if one not in failed)
                near.setdefault(round(sum(map(self._weight, kept)), 6), []).append(failed)
        nearest: list[int] = []
        for weight in sorted(near, reverse=True):
            alike = (number for failed in near[weight] for number in self._failing(failed))
            nearest += nsmallest(limit - len(nearest), alike)
            if len(nearest) >= limit:
                break
        return nearest

    def _weight(self, constraint: Constraint) -> float:
        """Return a condition's weight: by stage, by log10 of its rarity, and a bonus if the user's words contain it."""
        if constraint not in self._weights:
            count = len(self.holds(constraint))
            mentioned = constraint.stage != "location" and constraint.is_mentioned(self._text)
            rarity = math.log10(self.size / count) if count else 0.0
            self._weights[constraint] = WEIGHTS[constraint.stage] + rarity + MENTIONED * mentioned
        return self._weights[constraint]

    def _among(self, constraint: Constraint, left: EntrySet) -> EntrySet:
        if left is self.entries.all or len(left) > FEW or constraint in self._satisfying:
            return left & self.holds(constraint)
        found = self.entries.of(constraint.found_among(self._connection, sorted(left)))
        return left - found if constraint.negated else found

    def _all_of(self, constraints: Sequence[Constraint]) -> EntrySet:
        return reduce(and_, map(self.holds, constraints), self.everything)

    def _failed_together(self) -> set[tuple[Constraint, ...]]:
        """Return every set of conditions such that some entry fails exactly these conditions."""
        found: set[tuple[Constraint, ...]] = set()

        def split(failed: tuple[Constraint, ...], numbers: EntrySet, rest: tuple[Constraint, ...]) -> None:
            if not numbers or not rest:
                found.update([failed] if numbers else [])
                return
            if len(numbers) <= _CHECKED_ONE_BY_ONE:
                held_by = [(one, self.holds(one)) for one in rest]
                found.update((*failed, *(one for one, held in held_by if number not in held)) for number in numbers)
                return
            held = self.holds(rest[0])
            split(failed, numbers & held, rest[1:])
            split((*failed, rest[0]), numbers - held, rest[1:])

        split((), self.everything, self.constraints)
        return found

    def _failing(self, failed: tuple[Constraint, ...]) -> EntrySet:
        """Return the entries that fail the given conditions and satisfy all other conditions."""
        kept = self._all_of([constraint for constraint in self.constraints if constraint not in failed])
        return reduce(lambda numbers, constraint: numbers - self.holds(constraint), failed, kept)

    @staticmethod
    def _count_dropped(dropped: tuple[Constraint, ...]) -> int:
        """Return the number of conditions that count as dropped."""
        country = any(constraint.subject == "country" for constraint in dropped)
        return sum(not (country and constraint.subject == "city") for constraint in dropped)

    def _with_city(self, chosen: tuple[Constraint, ...]) -> tuple[Constraint, ...]:
        if not any(constraint.subject == "country" for constraint in chosen):
            return chosen
        return tuple(
            constraint for constraint in self.constraints if constraint in chosen or constraint.subject == "city"
        )
