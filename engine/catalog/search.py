"""One search: the strict filter, the order of what is left, and the answer with its evidence and its way out."""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from plannerforge.engine.catalog.bm25 import reciprocal_rank_fusion
from plannerforge.engine.catalog.constraints import constraints_of
from plannerforge.engine.catalog.describe_text import summary
from plannerforge.engine.catalog.diverse import MOST_CONSIDERED, coverage, covered_values, most_diverse
from plannerforge.engine.catalog.entries import Entry, entries_of, numbers_of
from plannerforge.engine.catalog.evidence import evidence, unmet_label
from plannerforge.engine.catalog.funnel import Funnel
from plannerforge.engine.catalog.locations import location_constraints
from plannerforge.engine.catalog.tables import facts_of
from plannerforge.engine.catalog.values_there import emptied_note, never_carried
from plannerforge.schemas.catalog import (
    Coverage,
    Emptied,
    FindScenariosArguments,
    FindScenariosResult,
    FoundScenario,
    RankResponse,
    Relaxation,
    StageCount,
)
from plannerforge.schemas.errors import InvalidRequest

FALLBACKS = 3
EXAMPLES = 3
RANKED_FALLBACKS = 50
"""So many of the nearest entries a text is compared with where nothing matches."""


@dataclass(frozen=True)
class Ranking:
    """Scenario ids by likeness of their text, best first, with their scores."""

    scenario_ids: tuple[str, ...]
    scores: dict[str, float]

    @classmethod
    def of(cls, response: RankResponse) -> "Ranking":
        """The ranking that the retrieval worker answered."""
        return cls(response.scenario_ids, dict(zip(response.scenario_ids, response.scores, strict=True)))


@dataclass(frozen=True)
class Found:
    """What a search gives before it is shown: all ids in the order of the method, and those that match.

    ``coverage`` says what a diverse choice covers; ``matches`` are then the chosen ones.
    """

    ordered: tuple[str, ...]
    matches: tuple[str, ...]
    coverage: tuple[Coverage, ...] = ()


class Search:
    """A search against the catalogue's tables; ranking by text happens elsewhere, in the retrieval worker.

    Raises:
        UnknownName: a word outside the vocabularies.
        InvalidRequest: a malformed condition, or a method that needs a text without one.
    """

    def __init__(
        self, connection: sqlite3.Connection, arguments: FindScenariosArguments, within: Sequence[str] | None = None
    ) -> None:
        if arguments.method != "funnel" and not (arguments.text or arguments.like):
            raise InvalidRequest(
                f"method {arguments.method} ranks by text, and there is none",
                valid=["text", "like", "method funnel"],
                next_step="say in text what to look for",
            )
        self._connection, self.arguments = connection, arguments
        numbers = None if within is None else frozenset(numbers_of(connection, within).values())
        location = location_constraints(connection, arguments.country, arguments.city)
        self.funnel = Funnel(connection, constraints_of(arguments, location), numbers, arguments.text or "")

    @property
    def needs_ranking(self) -> bool:
        """Whether the retrieval worker has to rank by text."""
        return bool(self.arguments.text or self.arguments.like)

    def candidates(self) -> tuple[str, ...]:
        """What is to be ranked: the matches (or else the nearest) for the funnel, the country's for hybrid, or all."""
        numbers = self.funnel.everything
        if self.arguments.method == "funnel":
            numbers = self.funnel.matches or frozenset(self.funnel.nearest(RANKED_FALLBACKS))
        elif self.arguments.method == "hybrid":
            for one in self.funnel.constraints:
                if one.label.startswith("country "):
                    numbers = numbers & self.funnel.holds(one)
        return tuple(entry.scenario_id for entry in self._entries(numbers))

    def find(self, ranking: Ranking | None) -> Found:
        """The ids in the order of the method: matches for the funnel, else everything that was ranked."""
        matching = {entry.scenario_id: entry for entry in self._matching}
        if ranking is None:
            ordered = list(matching)
        elif self.arguments.method == "funnel":
            ordered = [key for key in ranking.scenario_ids if key in matching]
        elif self.arguments.method == "rrf":
            ordered = reciprocal_rank_fusion([list(matching), ranking.scenario_ids])
        else:
            ordered = list(ranking.scenario_ids)
        matches = [matching[key] for key in ordered if key in matching]
        if self.arguments.sort == "size":
            matches.sort(key=lambda entry: (-entry.size, entry.scenario_id))
        elif self.arguments.sort == "criticality":
            matches.sort(key=lambda entry: (entry.ttc_s is None, entry.ttc_s or 0.0, entry.scenario_id))
        ids = [entry.scenario_id for entry in matches]
        if self.arguments.diverse is None:
            return Found(tuple(ordered), tuple(ids))
        values = covered_values(self._connection, matches[:MOST_CONSIDERED])
        chosen = most_diverse(values, self.arguments.diverse)
        return Found(tuple(ordered), tuple(chosen), coverage(values, chosen) if chosen else ())

    def answer(self, search_id: str, found: Found, ranking: Ranking | None) -> FindScenariosResult:
        """The page that was asked for, and why nothing matches where nothing does."""
        begin = self.arguments.offset
        limit = self.arguments.diverse or self.arguments.limit
        scores = ranking.scores if ranking else {}
        return FindScenariosResult(
            search_id=search_id,
            method=self.arguments.method,
            catalogue=self.funnel.size,
            total=len(self._matching),
            stages=self.stage_counts(),
            matches=self._found(found.matches[begin : begin + limit], scores),
            coverage=found.coverage,
            emptied_by=self._emptied(),
            relaxations=self._relaxations(),
            fallback=self._found(self._fallback(found, ranking), scores),
            notes=(*never_carried(self._connection, self.funnel.constraints), *self._left_out()),
        )

    def _left_out(self) -> list[str]:
        """What a diverse choice did not look at; its coverage says nothing about these."""
        total = len(self._matching)
        if self.arguments.diverse is None or total <= MOST_CONSIDERED:
            return []
        return [f"The choice looked at the first {MOST_CONSIDERED:,} of {total:,} matches only; narrow the search."]

    def stage_counts(self) -> tuple[StageCount, ...]:
        """The counts after every stage that has conditions."""
        return tuple(
            StageCount(
                stage=left.stage, conditions=tuple(one.label for one in left.constraints), left=len(left.numbers)
            )
            for left in self.funnel.stages
        )

    @cached_property
    def _matching(self) -> list[Entry]:
        return self._entries(self.funnel.matches)

    def _entries(self, numbers: frozenset[int]) -> list[Entry]:
        """The entries by id, without the one that others are to be like."""
        return [entry for entry in entries_of(self._connection, numbers) if entry.scenario_id != self.arguments.like]

    def _emptied(self) -> Emptied | None:
        reason = self.funnel.emptied_by()
        if reason is None:
            return None
        return Emptied(
            stage=reason.stage,
            conditions=tuple(one.label for one in reason.constraints),
            note=emptied_note(self._connection, self.funnel, reason),
        )

    def _relaxations(self) -> tuple[Relaxation, ...]:
        if self.funnel.matches:
            return ()
        return tuple(
            Relaxation(
                drop=tuple(one.label for one in dropped.constraints),
                matches=len(dropped.numbers),
                examples=tuple(entry.scenario_id for entry in self._entries(dropped.numbers)[:EXAMPLES]),
            )
            for dropped in self.funnel.relaxations()[:EXAMPLES]
        )

    def _fallback(self, found: Found, ranking: Ranking | None) -> list[str]:
        """What comes nearest: the text's best that leave conditions unmet, else who satisfies most conditions."""
        if not self.funnel.constraints:
            return []
        if self.arguments.method != "funnel":
            matches = {entry.scenario_id for entry in self._matching}
            missed = [key for key in found.ordered if key not in matches]
            return missed[: max(self.arguments.limit - len(found.matches), 0)]
        if self.funnel.matches:
            return []
        return self._nearest(ranking)

    def _nearest(self, ranking: Ranking | None) -> list[str]:
        """The nearest entries; where a text ranks them, it decides between those that satisfy the same conditions."""
        numbers = self.funnel.nearest(FALLBACKS if ranking is None else RANKED_FALLBACKS)
        ids = {entry.number: entry.scenario_id for entry in self._entries(frozenset(numbers))}
        near = [(ids[number], self.funnel.nearness(number)) for number in numbers if number in ids]
        if ranking is not None:
            near.sort(key=lambda pair: (-pair[1], -ranking.scores.get(pair[0], -1.0), pair[0]))
        return [key for key, _ in near[:FALLBACKS]]

    def _found(self, scenario_ids: Sequence[str], scores: dict[str, float]) -> tuple[FoundScenario, ...]:
        facts, numbers = facts_of(self._connection, scenario_ids), numbers_of(self._connection, scenario_ids)
        found = []
        for key in scenario_ids:
            satisfied = self.funnel.satisfied_by(numbers[key])
            unmet = tuple(one for one in self.funnel.constraints if one not in satisfied)
            found.append(
                FoundScenario(
                    scenario_id=key,
                    summary=summary(facts[key]),
                    satisfied=_once([evidence(one, facts[key]) for one in satisfied]),
                    unmet=tuple(unmet_label(one, facts[key]) for one in unmet),
                    score=scores.get(key),
                )
            )
        return tuple(found)


def _once(parts: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(part for part in parts if part))
