"""One search: the strict filter, the order of what is left, and the answer with its evidence and its way out."""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass

from plannerforge.engine.catalog.bm25 import reciprocal_rank_fusion
from plannerforge.engine.catalog.constraints import constraints_of
from plannerforge.engine.catalog.describe_text import summary
from plannerforge.engine.catalog.evidence import evidence, unmet_label
from plannerforge.engine.catalog.funnel import Funnel
from plannerforge.engine.catalog.locations import location_constraints
from plannerforge.engine.catalog.tables import facts_of
from plannerforge.engine.catalog.values_there import emptied_note, never_carried
from plannerforge.schemas.catalog import (
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


@dataclass(frozen=True)
class Ranking:
    """Scenario ids by likeness of their text, best first, with their scores."""

    scenario_ids: tuple[str, ...]
    scores: dict[str, float]

    @classmethod
    def of(cls, response: RankResponse) -> "Ranking":
        """The ranking that the retrieval worker answered."""
        return cls(response.scenario_ids, dict(zip(response.scenario_ids, response.scores, strict=True)))


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
        rows = connection.execute("SELECT number, scenario_id, size FROM catalog_scenarios").fetchall()
        self._id_of = {row[0]: str(row[1]) for row in rows}
        self._number_of = {scenario_id: number for number, scenario_id in self._id_of.items()}
        self._size_of = {str(row[1]): int(row[2]) for row in rows}
        numbers = (
            None if within is None else frozenset(self._number_of[key] for key in within if key in self._number_of)
        )
        location = location_constraints(connection, arguments.country, arguments.city)
        self.funnel = Funnel(connection, constraints_of(arguments, location), numbers)

    @property
    def needs_ranking(self) -> bool:
        """Whether the retrieval worker has to rank by text."""
        return bool(self.arguments.text or self.arguments.like)

    def candidates(self) -> tuple[str, ...]:
        """What is to be ranked: the matches (funnel), the country's scenarios (hybrid), or all."""
        numbers = self.funnel.everything
        if self.arguments.method == "funnel":
            numbers = self.funnel.matches
        elif self.arguments.method == "hybrid":
            for one in self.funnel.constraints:
                if one.label.startswith("country "):
                    numbers = numbers & self.funnel.holds[one]
        like = self.arguments.like
        return tuple(key for key in self._ids(numbers) if key != like)

    def ordered(self, ranking: Ranking | None) -> tuple[str, ...]:
        """The ids in the order of the method: matches for the funnel, else everything that was ranked."""
        matches = [key for key in self._ids(self.funnel.matches) if key != self.arguments.like]
        if ranking is None:
            found = matches
        elif self.arguments.method == "rrf":
            found = reciprocal_rank_fusion([matches, ranking.scenario_ids])
        else:
            found = list(ranking.scenario_ids)
        if self.arguments.sort == "size":
            found = sorted(found, key=lambda key: (-self._size_of[key], key))
        return tuple(found)

    def matching(self, ordered: Sequence[str]) -> tuple[str, ...]:
        """Those of the ordered ids that satisfy every condition."""
        return tuple(key for key in ordered if self._number_of[key] in self.funnel.matches)

    def answer(self, search_id: str, ordered: Sequence[str], ranking: Ranking | None) -> FindScenariosResult:
        """The page that was asked for, and why nothing matches where nothing does."""
        matches, begin = self.matching(ordered), self.arguments.offset
        page = matches[begin : begin + self.arguments.limit]
        scores = ranking.scores if ranking else {}
        return FindScenariosResult(
            search_id=search_id,
            method=self.arguments.method,
            catalogue=len(self.funnel.everything),
            total=len(matches),
            stages=self.stage_counts(),
            matches=self._found(page, scores),
            emptied_by=self._emptied(),
            relaxations=self._relaxations(),
            fallback=self._found(self._fallback(matches, ordered), scores),
            notes=tuple(never_carried(self._connection, self.funnel.constraints)),
        )

    def stage_counts(self) -> tuple[StageCount, ...]:
        """The counts after every stage that has conditions."""
        return tuple(
            StageCount(
                stage=left.stage, conditions=tuple(one.label for one in left.constraints), left=len(left.numbers)
            )
            for left in self.funnel.stages()
        )

    def _ids(self, numbers: frozenset[int]) -> list[str]:
        return sorted(self._id_of[number] for number in numbers)

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
                examples=tuple(self._ids(dropped.numbers)[:EXAMPLES]),
            )
            for dropped in self.funnel.relaxations()[:EXAMPLES]
        )

    def _fallback(self, matches: Sequence[str], ordered: Sequence[str]) -> list[str]:
        """What comes nearest: the text's best that leave conditions unmet, else who satisfies most conditions."""
        if not self.funnel.constraints:
            return []
        if self.arguments.method != "funnel":
            missed = [key for key in ordered if key not in set(matches)]
            return missed[: max(self.arguments.limit - len(matches), 0)]
        if matches:
            return []
        return [self._id_of[number] for number in self.funnel.nearest(FALLBACKS)]

    def _found(self, scenario_ids: Sequence[str], scores: dict[str, float]) -> tuple[FoundScenario, ...]:
        facts = facts_of(self._connection, scenario_ids)
        found = []
        for key in scenario_ids:
            satisfied = self.funnel.satisfied_by(self._number_of[key])
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
