"""The strict filter: stage after stage, what is left, which condition emptied it, and what giving it up would give."""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from plannerforge.engine.catalog.constraints import Constraint
from plannerforge.schemas.catalog import STAGES, Stage

MOST_DROPPED = 3


@dataclass(frozen=True)
class StageLeft:
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
class Dropped:
    """Conditions given up, and the numbers that satisfy all others."""

    constraints: tuple[Constraint, ...]
    numbers: frozenset[int]


class Funnel:
    """The conditions of a search against a catalogue; every condition is queried once."""

    def __init__(
        self, connection: sqlite3.Connection, constraints: Sequence[Constraint], within: frozenset[int] | None = None
    ) -> None:
        rows = connection.execute("SELECT number FROM catalog_scenarios")
        everything = frozenset(row[0] for row in rows)
        self.everything = everything if within is None else everything & within
        self.constraints = tuple(constraints)
        self.holds = {one: one.holds_for(connection, self.everything) for one in self.constraints}

    @property
    def matches(self) -> frozenset[int]:
        """Numbers that satisfy every condition."""
        return self._all_of(self.constraints)

    def stages(self) -> tuple[StageLeft, ...]:
        """The stages that have conditions, in the paper's order; ends at the one that leaves nothing."""
        left, found = self.everything, []
        for stage in STAGES:
            own = tuple(one for one in self.constraints if one.stage == stage)
            if not own:
                continue
            left = left & self._all_of(own)
            found.append(StageLeft(stage, own, left))
            if not left:
                break
        return tuple(found)

    def emptied_by(self) -> EmptiedBy | None:
        """Why nothing matches; None where something does."""
        stages = self.stages()
        if not stages or stages[-1].numbers:
            return None
        entering = stages[-2].numbers if len(stages) > 1 else self.everything
        last = stages[-1]
        alone = tuple(one for one in last.constraints if not self.holds[one] & entering)
        countries = tuple(one for one in alone if one.label.startswith("country "))
        return EmptiedBy(last.stage, countries or alone or last.constraints, together=not alone)

    def relaxations(self) -> tuple[Dropped, ...]:
        """The fewest conditions (at most three) whose loss leaves something, most matches first.

        A country that is given up takes its city with it: the city lies in it.
        """
        for count in range(1, min(MOST_DROPPED, len(self.constraints)) + 1):
            found: dict[tuple[Constraint, ...], frozenset[int]] = {}
            for chosen in combinations(self.constraints, count):
                dropped = self._with_city(chosen)
                numbers = self._all_of([one for one in self.constraints if one not in dropped])
                if numbers and len(dropped) < len(self.constraints):
                    found[dropped] = numbers
            found = {one: numbers for one, numbers in found.items() if not any(set(o) < set(one) for o in found)}
            if found:
                ordered = sorted(found.items(), key=lambda item: (-len(item[1]), [one.label for one in item[0]]))
                return tuple(Dropped(*item) for item in ordered)
        return ()

    def satisfied_by(self, number: int) -> tuple[Constraint, ...]:
        """The conditions that this scenario satisfies, in their order."""
        return tuple(one for one in self.constraints if number in self.holds[one])

    def nearest(self, limit: int) -> list[int]:
        """Scenarios that satisfy most conditions, at least one and not all; by number of conditions, then age."""
        scores = {number: len(self.satisfied_by(number)) for number in frozenset().union(*self.holds.values())}
        near = [number for number, score in scores.items() if 0 < score < len(self.constraints)]
        return sorted(near, key=lambda number: (-scores[number], number))[:limit]

    def _all_of(self, constraints: Sequence[Constraint]) -> frozenset[int]:
        left = self.everything
        for one in constraints:
            left = left & self.holds[one]
        return left

    def _with_city(self, chosen: tuple[Constraint, ...]) -> tuple[Constraint, ...]:
        if not any(one.label.startswith("country ") for one in chosen):
            return chosen
        cities = [one for one in self.constraints if one.label.startswith("city ") and one not in chosen]
        return tuple(one for one in self.constraints if one in chosen or one in cities)
