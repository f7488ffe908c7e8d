"""The strict filter: stage after stage, what is left, which condition emptied it, and what giving it up would give.

Where nothing is left, the nearest entries are weighed by the user's own words too: a condition that they name was asked
for, while others may be a model's guess. The paper's models hardly miss a slot that was asked for; they add some that
were not (Results, Slot-level extraction).
"""

import math
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import nsmallest

from ...schemas.catalog import STAGES, Stage
from .constraints import Constraint, numbers_from

FEW = 5000
"""Up to this number of entries, a condition is looked up for each of them (chosen)."""
WEIGHTS: dict[Stage, float] = {"location": 8.0, "obstacles": 4.0, "road_net": 3.0, "velocity": 1.5, "tags": 1.0}
"""What a satisfied condition counts for in a fallback, before its rarity is added (chosen)."""
MENTIONED = 3.0
"""What a condition counts for more where the user's own words name it; with it, a tag counts as much as a count."""


@dataclass(frozen=True)
class _StageLeft:
    """The numbers left after a stage that has conditions."""

    stage: Stage
    constraints: tuple[Constraint, ...]
    numbers: frozenset[int]


@dataclass(frozen=True)
class EmptiedBy:
    """The stage that left nothing, and those of its conditions that no candidate of it satisfied.

    Where each alone is satisfied by some candidate, all conditions of the stage are named.
    """

    stage: Stage
    constraints: tuple[Constraint, ...]
    together: bool


@dataclass(frozen=True)
class _Dropped:
    """Conditions given up, and the numbers that satisfy all others."""

    constraints: tuple[Constraint, ...]
    numbers: frozenset[int]


class Funnel:
    """The conditions of a search against a catalogue.

    Stage after stage, a condition is looked up only for what the stages before left, where that is little; the whole of
    what holds it is looked up once, and only where it is needed.
    """

    def __init__(
        self,
        connection: sqlite3.Connection,
        constraints: Sequence[Constraint],
        within: frozenset[int] | None = None,
        text: str = "",
    ) -> None:
        self._connection, self.within, self._text = connection, within, text
        self.constraints = tuple(constraints)
        self._held: dict[Constraint, frozenset[int]] = {}
        self._weights: dict[Constraint, float] = {}

    @cached_property
    def everything(self) -> frozenset[int]:
        """Numbers of all entries that are searched."""
        if self.within is not None:
            return self.within
        return numbers_from(self._connection, "SELECT number FROM catalog_scenarios")

    @cached_property
    def size(self) -> int:
        """How many entries are searched."""
        if self.within is not None:
            return len(self.within)
        return int(self._connection.execute("SELECT count(*) FROM catalog_scenarios").fetchone()[0])

    @property
    def matches(self) -> frozenset[int]:
        """Numbers that satisfy every condition."""
        stages = self.stages
        return stages[-1].numbers if stages else self.everything

    @cached_property
    def stages(self) -> tuple[_StageLeft, ...]:
        """The stages that have conditions, in the paper's order; ends at the one that leaves nothing."""
        left, stages = self.within, []
        for stage in STAGES:
            own = tuple(constraint for constraint in self.constraints if constraint.stage == stage)
            if not own:
                continue
            for constraint in reversed(own):  # the city before its country: the less is left, the less is looked up
                left = self.holds(constraint) if left is None else self._among(constraint, left)
            stages.append(_StageLeft(stage, own, left or frozenset()))
            if not left:
                break
        return tuple(stages)

    def holds(self, constraint: Constraint) -> frozenset[int]:
        """Numbers of all entries that satisfy the condition."""
        if constraint not in self._held:
            numbers = constraint.found(self._connection)
            if constraint.negated:
                numbers = self.everything - numbers
            elif self.within is not None:
                numbers &= self.everything
            self._held[constraint] = numbers
        return self._held[constraint]

    def entering(self) -> frozenset[int]:
        """What the stages before the last one left."""
        return self.stages[-2].numbers if len(self.stages) > 1 else self.everything

    def emptied_by(self) -> EmptiedBy | None:
        """Why nothing matches; None where something does."""
        if not self.stages or self.stages[-1].numbers:
            return None
        entering, last = self.entering(), self.stages[-1]
        alone = tuple(constraint for constraint in last.constraints if not self.holds(constraint) & entering)
        countries = tuple(constraint for constraint in alone if constraint.subject == "country")
        return EmptiedBy(last.stage, countries or alone or last.constraints, together=not alone)

    def relaxations(self) -> tuple[_Dropped, ...]:
        """The fewest conditions whose loss leaves something, most matches first; none where all would have to go.

        Exact for any number of them: what can be kept together is what some entry satisfies. A country that is given up
        takes its city with it and counts once: the city lies in it.
        """
        failed = {self._with_city(chosen) for chosen in self._failed_together()}
        possible = [dropped for dropped in failed if 0 < len(dropped) < len(self.constraints)]
        fewest = min((self._given_up(dropped) for dropped in possible), default=0)
        fewest_dropped = [dropped for dropped in possible if self._given_up(dropped) == fewest]
        relaxed = [
            _Dropped(one, self._all_of([constraint for constraint in self.constraints if constraint not in one]))
            for one in fewest_dropped
            if not any(set(other) < set(one) for other in fewest_dropped)
        ]
        return tuple(sorted(relaxed, key=lambda one: (-len(one.numbers), [each.label for each in one.constraints])))

    def satisfied_by(self, number: int) -> tuple[Constraint, ...]:
        """The conditions that this entry satisfies, in their order."""
        return tuple(constraint for constraint in self.constraints if self._among(constraint, frozenset({number})))

    def nearness(self, number: int) -> float:
        """The weight of the conditions that this entry satisfies."""
        return round(sum(self._weight(constraint) for constraint in self.satisfied_by(number)), 6)

    def nearest(self, limit: int) -> list[int]:
        """Entries that satisfy some conditions and not all, nearest first.

        What is nearest is weighed by stage, since requests name places and counts deliberately and over-predict tags
        (Results, Slot-level extraction), by rarity, since what few entries have is seldom met by chance, and by the
        user's own words, where they are known. Ties: the older.
        """
        weights: dict[int, float] = {}
        counts: dict[int, int] = {}
        for constraint in self.constraints:
            weight = self._weight(constraint)
            for number in self.holds(constraint):
                weights[number] = weights.get(number, 0.0) + weight
                counts[number] = counts.get(number, 0) + 1
        near = [number for number, count in counts.items() if count < len(self.constraints)]
        return nsmallest(limit, near, key=lambda number: (-round(weights[number], 6), number))

    def _weight(self, constraint: Constraint) -> float:
        """The weight of a condition: its stage's, the tenth logarithm of how rare it is, and that it was asked for."""
        if constraint not in self._weights:
            held = len(self.holds(constraint))
            mentioned = constraint.stage != "location" and constraint.is_mentioned(self._text)
            rarity = math.log10(self.size / held) if held else 0.0
            self._weights[constraint] = WEIGHTS[constraint.stage] + rarity + MENTIONED * mentioned
        return self._weights[constraint]

    def _among(self, constraint: Constraint, left: frozenset[int]) -> frozenset[int]:
        if len(left) > FEW or constraint in self._held:
            return left & self.holds(constraint)
        numbers = constraint.found(self._connection, sorted(left))
        return left - numbers if constraint.negated else numbers

    def _all_of(self, constraints: Sequence[Constraint]) -> frozenset[int]:
        if not constraints:
            return self.everything
        return frozenset.intersection(*sorted((self.holds(constraint) for constraint in constraints), key=len))

    def _failed_together(self) -> list[tuple[Constraint, ...]]:
        """Every set of conditions that some entry fails while it satisfies all others."""
        groups: dict[tuple[Constraint, ...], frozenset[int]] = {(): self.everything}
        for constraint in self.constraints:
            split: dict[tuple[Constraint, ...], frozenset[int]] = {}
            for failed, numbers in groups.items():
                split[failed] = numbers & self.holds(constraint)
                split[(*failed, constraint)] = numbers - self.holds(constraint)
            groups = {failed: numbers for failed, numbers in split.items() if numbers}
        return list(groups)

    @staticmethod
    def _given_up(dropped: tuple[Constraint, ...]) -> int:
        """How many conditions count as given up."""
        country = any(constraint.subject == "country" for constraint in dropped)
        return sum(not (country and constraint.subject == "city") for constraint in dropped)

    def _with_city(self, chosen: tuple[Constraint, ...]) -> tuple[Constraint, ...]:
        if not any(constraint.subject == "country" for constraint in chosen):
            return chosen
        return tuple(
            constraint for constraint in self.constraints if constraint in chosen or constraint.subject == "city"
        )
