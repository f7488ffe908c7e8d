"""A catalogue search: the strict filter, the order of the matches, and the answer with its evidence and next steps.

A diverse selection is a small set of matches that together cover many values. An entry covers values of several
dimensions: features, obstacle types, lanes, and bands of speed, traffic and time to conflict. The greedy selection
takes the entry that covers the most values not yet covered; it covers at least 1 − 1/e of what the best selection
covers (Nemhauser, Wolsey and Fisher 1978). After all values are covered, it starts again with the remaining entries.
"""

import math
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import nsmallest
from itertools import islice
from typing import Any, TypeVar

from ...schemas.catalog import (
    Coverage,
    Emptied,
    FindScenariosArguments,
    FindScenariosResult,
    FoundScenario,
    RankResponse,
    Relaxation,
    StageCount,
)
from ...schemas.errors import InvalidRequest
from ...schemas.scenarios import ScenarioFacts
from ...schemas.text import cited, enumerated, one_line, shown_name
from ...schemas.vocabulary import MEASURES
from .alternatives import TextWords, emptied_note, look_up_words, names_without_scenario, not_computed, notes_on_names
from .bm25 import reciprocal_rank_fusion
from .constraints import (
    CIRCUMSTANCE,
    CIRCUMSTANCE_WORDS,
    EITHER,
    PARTICIPANTS,
    Constraint,
    constraints_of,
    has_circumstances,
    location_constraints,
)
from .entry_sets import EntrySet, Postings, plain_rows
from .funnel import Funnel
from .tables import facts_of
from .text_conditions import conditions_in_text
from .words import origins_of, summary

MOST_KEPT = 1_000
"""The number of matches with ids stored with a search; for more, its conditions find the others again (chosen)."""
FALLBACKS, EXAMPLES = 3, 3
"""The most nearest entries, and the most examples of a relaxation, in an answer (chosen)."""
RANKED_FALLBACKS = 50
"""The number of nearest entries that are compared with the text if nothing matches (chosen)."""
_FEW_WORDS = 3
"""Up to this many meaningful words, the answer reports a text's unknown ones; more are a description (chosen)."""


@dataclass(frozen=True)
class _Entry:
    """A scenario with one of its planning problems; ``size`` is its number of obstacles.

    ``time_to_conflict_s`` is None if there is no ego, and ``NEVER_S`` if the ego would never meet a recorded road user.
    """

    number: int
    scenario_id: str
    size: int
    time_to_conflict_s: float | None

    def criticality(self) -> tuple[bool, float, str]:
        """Return the sort key that puts the most critical entry first, and entries without an ego last."""
        return self.time_to_conflict_s is None, self.time_to_conflict_s or 0.0, self.scenario_id


@dataclass(frozen=True)
class Ranking:
    """Scenario ids by similarity of their text, best first, with their scores, and whether the index was damaged.

    ``least_likeness``: a text without a score above it matches nothing among the descriptions.
    """

    scenario_ids: tuple[str, ...]
    scores: dict[str, float]
    mended_index: bool = False
    least_likeness: float = 0.0

    @classmethod
    def of(cls, response: RankResponse) -> "Ranking":
        """Return the ranking from a response of the retrieval worker."""
        scores = dict(zip(response.scenario_ids, response.scores, strict=True))
        return cls(response.scenario_ids, scores, response.mended_index, response.least_likeness)


@dataclass(frozen=True)
class _Found:
    """A search's result before formatting: the ids in the order of the method, and those that match.

    Of matches without a text ranking, only the first ``MOST_KEPT`` are included; ``total`` is their full number.
    ``coverage`` is the coverage of a diverse selection, if one was made; ``matches`` are then the selected scenarios.
    """

    ordered: tuple[str, ...]
    matches: tuple[str, ...]
    total: int
    coverage: tuple[Coverage, ...] = ()


class Search:
    """A search in the catalogue's tables; the retrieval worker does the ranking by text.

    Raises:
        UnknownName: a word is outside the vocabularies.
        InvalidRequest: a condition is malformed, or the method needs a text and there is none.
    """

    def __init__(
        self,
        connection: sqlite3.Connection,
        arguments: FindScenariosArguments,
        within: Iterable[str] | None = None,
        postings: Postings | None = None,
    ) -> None:
        if arguments.method != "funnel" and not (arguments.text or arguments.like):
            raise InvalidRequest(
                f"method '{arguments.method}' ranks by text, but neither 'text' nor 'like' is given",
                valid=["text=WORDS", "like=SCENARIO", "method=funnel"],
                next_step="say in 'text' what you are looking for",
            )
        self._connection, self.arguments = connection, arguments
        numbers = None if within is None else _numbers_of(connection, within).values()
        location = location_constraints(connection, arguments.country, arguments.city)
        constraints = constraints_of(arguments, location, with_circumstances=has_circumstances(connection))
        in_text = conditions_in_text("" if arguments.tags or arguments.features else arguments.text or "")
        requested = {constraint.label for constraint in constraints}
        constraints += tuple(one for one in in_text.constraints if one.label not in requested)
        self._remaining_text = in_text.rest if in_text.constraints else arguments.text or ""
        self.funnel = Funnel(connection, constraints, numbers, arguments.text or "", postings)

    @property
    def needs_ranking(self) -> bool:
        """Whether the retrieval worker must rank by text."""
        return bool(self.arguments.text or self.arguments.like)

    def candidates(self) -> tuple[str, ...]:
        """Return the ids to rank: for the funnel, the matches or the nearest entries; for hybrid, those in the country;
        else all.
        """
        numbers = self.funnel.everything
        if self.arguments.method == "funnel":
            numbers = self.funnel.matches or self.funnel.entries.of(self.funnel.nearest(RANKED_FALLBACKS))
        elif self.arguments.method == "hybrid":
            for one in self.funnel.constraints:
                if one.subject == "country":
                    numbers = numbers & self.funnel.holds(one)
        return tuple(entry.scenario_id for entry in entries_of(self._connection, self._others(numbers)))

    def find(self, ranking: Ranking | None) -> _Found:
        """Return the ids in the order of the method: the matches for the funnel, otherwise all ranked ids."""
        if self._text_matches_nothing(ranking):
            return _Found(ranking.scenario_ids if ranking else (), (), 0)
        if ranking is None:
            matches = self._first()
            return self._chosen([entry.scenario_id for entry in matches], matches)
        matching = {entry.scenario_id: entry for entry in entries_of(self._connection, self._matching)}
        if self.arguments.method == "funnel":
            ordered = [key for key in ranking.scenario_ids if key in matching]
        elif self.arguments.method == "rrf":
            ordered = reciprocal_rank_fusion([list(matching), ranking.scenario_ids])
        else:
            ordered = list(ranking.scenario_ids)
        matches = [matching[key] for key in ordered if key in matching]
        if self.arguments.sort == "size":
            matches.sort(key=lambda entry: (-entry.size, entry.scenario_id))
        elif self.arguments.sort == "criticality":
            matches.sort(key=_Entry.criticality)
        return self._chosen(ordered, matches)

    def _first(self) -> list[_Entry]:
        """Return the first matches in the requested order, for a search without text; at most ``MOST_KEPT``."""
        numbers, sort = self._matching, self.arguments.sort
        if sort == "match" or len(numbers) <= MOST_KEPT:
            chosen: Iterable[int] = numbers.first(MOST_KEPT)
        else:
            sign, name = (-1.0, "size") if sort == "size" else (1.0, "ttc_s")
            column = self.funnel.postings.column(self._connection, numbers.entries, name)
            places = nsmallest(
                MOST_KEPT, numbers.places(), key=lambda place: (math.isnan(column[place]), sign * column[place], place)
            )
            chosen = (numbers.entries.numbers[place] for place in places)
        entries = entries_of(self._connection, chosen)
        if sort == "size":
            return sorted(entries, key=lambda entry: (-entry.size, entry.scenario_id))
        return sorted(entries, key=_Entry.criticality) if sort == "criticality" else entries

    def _chosen(self, ordered: Sequence[str], matches: Sequence[_Entry]) -> _Found:
        """Return the matches, or a diverse selection of them."""
        total = len(self._matching)
        if self.arguments.diverse is None:
            return _Found(tuple(ordered), tuple(entry.scenario_id for entry in matches), total)
        values = _covered_values(self._connection, matches[:MOST_CONSIDERED])
        chosen = _most_diverse(values, self.arguments.diverse)
        if self.arguments.sort != "match":
            selected = set(chosen)
            chosen = [entry.scenario_id for entry in matches if entry.scenario_id in selected]
        return _Found(tuple(ordered), tuple(chosen), len(chosen), _coverage(values, chosen) if chosen else ())

    def answer(self, search_id: str, found: _Found, ranking: Ranking | None) -> FindScenariosResult:
        """Return the requested page, and the reason if nothing matches."""
        begin = self.arguments.offset
        limit = self.arguments.diverse or self.arguments.limit
        scores = ranking.scores if ranking else {}
        return FindScenariosResult(
            search_id=search_id,
            method=self.arguments.method,
            catalogue=self.funnel.size,
            total=0 if self._text_matches_nothing(ranking) else len(self._matching),
            stages=self.stage_counts(),
            matches=self._found(found.matches[begin : begin + limit], scores),
            coverage=found.coverage,
            emptied_by=self._emptied(),
            relaxations=self._relaxations(),
            fallback=self._found(
                self._fallback(found, ranking), scores, meaningless=self._text_matches_nothing(ranking)
            ),
            notes=(
                *names_without_scenario(self._connection, self.funnel.constraints),
                *notes_on_names(self._connection, self.funnel.constraints),
                *not_computed(self._connection, self.funnel.constraints),
                *self._text_notes(ranking),
                *self._order_notes(found),
                *self._not_considered(),
            ),
        )

    def _text_notes(self, ranking: Ranking | None) -> list[str]:
        """Return notes on the words of the text that occur in the catalogue or nowhere, since a text only affects the
        ranking.
        """
        text = self._text_words
        few = len(text.found) + len(text.nowhere) <= _FEW_WORDS
        notes = ["The text index was damaged and has been rebuilt."] if ranking and ranking.mended_index else []
        notes += [f"Words found: {'; '.join(text.found)}."] if text.found else []
        if text.nowhere and (text.alone or few):
            words = enumerated([f"'{one_line(word)}'" for word in text.nowhere])
            verb = "does" if len(text.nowhere) == 1 else "do"
            matched = "results are ranked by semantic similarity"
            if text.alone and self._is_dissimilar(ranking):
                matched = "the text matches nothing"
            elif self.arguments.sort != "match":
                matched = f"sort={self.arguments.sort} decides the order"
            notes.append(f"{words} {verb} not occur in any title, tag, place or description; {matched}.")
        return notes

    def _order_notes(self, found: _Found) -> list[str]:
        """Return notes on an order that the arguments alone do not explain."""
        sort = self.arguments.sort
        if sort == "match" or not found.matches:
            return []
        if self.arguments.diverse is not None:
            return [f"diverse selects unlike matches; sort={sort} orders only those."]
        return [f"Criticality is ttc: {MEASURES['ttc']}."] if sort == "criticality" else []

    @cached_property
    def _text_words(self) -> TextWords:
        return look_up_words(self._connection, self._remaining_text, self.funnel.constraints)

    def _text_matches_nothing(self, ranking: Ranking | None) -> bool:
        """Return whether the search has only a text, with no known word and no similar description."""
        only_text = not self.funnel.constraints and self.arguments.like is None
        return only_text and self._text_words.alone and self._is_dissimilar(ranking)

    @staticmethod
    def _is_dissimilar(ranking: Ranking | None) -> bool:
        return max(ranking.scores.values(), default=0.0) <= ranking.least_likeness if ranking else True

    def _not_considered(self) -> list[str]:
        """Return a note if a diverse selection considered only the first matches."""
        total = len(self._matching)
        if self.arguments.diverse is None or total <= MOST_CONSIDERED:
            return []
        return [f"Only the first {MOST_CONSIDERED:,} of {total:,} matches were considered; narrow the search."]

    def stage_counts(self) -> tuple[StageCount, ...]:
        """Return the counts after every stage that has conditions."""
        return tuple(
            StageCount(
                stage=left.stage,
                conditions=tuple(one.label for one in left.constraints),
                kinds=_kinds(left.constraints),
                left=len(left.numbers),
            )
            for left in self.funnel.stages
        )

    @cached_property
    def _matching(self) -> EntrySet:
        return self._others(self.funnel.matches)

    def _others(self, numbers: EntrySet) -> EntrySet:
        """Return the entries without the entry given in ``like``."""
        like = [] if self.arguments.like is None else [self.arguments.like]
        return numbers - numbers.entries.of(_numbers_of(self._connection, like).values()) if like else numbers

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
                examples=tuple(entry.scenario_id for entry in self._examples(dropped.numbers)),
            )
            for dropped in self.funnel.relaxations()[:EXAMPLES]
        )

    def _examples(self, numbers: EntrySet) -> list[_Entry]:
        return entries_of(self._connection, self._others(numbers).first(EXAMPLES))

    def _fallback(self, found: _Found, ranking: Ranking | None) -> list[str]:
        """Return the nearest entries: ranked ones with unmet conditions or, for the funnel, those that satisfy most."""
        if self.arguments.fallback == "none":
            return []
        if not self.funnel.constraints:
            return list(ranking.scenario_ids[:FALLBACKS]) if ranking and self._text_matches_nothing(ranking) else []
        if self.arguments.method != "funnel":
            matches = {entry.scenario_id for entry in entries_of(self._connection, self._matching)}
            missed = [key for key in found.ordered if key not in matches]
            return missed[: max(self.arguments.limit - len(found.matches), 0)]
        if self.funnel.matches:
            return []
        return self._nearest(ranking)

    def _nearest(self, ranking: Ranking | None) -> list[str]:
        """Return the nearest entries; a text orders entries that satisfy the same conditions."""
        numbers = self.funnel.nearest(FALLBACKS if ranking is None else RANKED_FALLBACKS)
        there = self._others(self.funnel.entries.of(numbers))
        ids = {entry.number: entry.scenario_id for entry in entries_of(self._connection, there)}
        near = [(ids[number], self.funnel.nearness(number)) for number in numbers if number in ids]
        if ranking is not None:
            near.sort(key=lambda pair: (-pair[1], -ranking.scores.get(pair[0], -1.0), pair[0]))
        return [key for key, _ in near[:FALLBACKS]]

    def _found(
        self, scenario_ids: Sequence[str], scores: dict[str, float], *, meaningless: bool = False
    ) -> tuple[FoundScenario, ...]:
        facts, numbers = facts_of(self._connection, scenario_ids), _numbers_of(self._connection, scenario_ids)
        shown = []
        for key in scenario_ids:
            satisfied = self.funnel.satisfied_by(numbers[key])
            unmet = tuple(one for one in self.funnel.constraints if one not in satisfied)
            shown.append(
                FoundScenario(
                    scenario_id=key,
                    summary=summary(facts[key]),
                    counts={name: count for name, count in facts[key].participants.counts.items() if count},
                    ego_speed_mps=None if (ego := facts[key].ego) is None else ego.speed_mps,
                    satisfied=tuple(dict.fromkeys(_evidence(one, facts[key]) for one in satisfied)),
                    unmet=(
                        *(_unmet(one, _evidence(one, facts[key])) for one in unmet),
                        *(["the text"] if meaningless else []),
                    ),
                    score=scores.get(key),
                )
            )
        return tuple(shown)


def _unmet(constraint: Constraint, evidence: str) -> str:
    """Return a condition that a scenario does not meet, with the fact that it checks if this adds anything."""
    says_so = evidence in (f"no {constraint.label}", f"no {constraint.stage.rstrip('s')} {constraint.label}")
    return constraint.label if says_so else f"{constraint.label} ({evidence})"


def _evidence(constraint: Constraint, facts: ScenarioFacts) -> str:
    """Return the fact that a condition checks, in a few words: ``truck=2``, ``limit 50 km/h``, ``place Munich``."""
    if constraint.stage == "location":
        return f"{shown_name(facts.location.place)}, {facts.location.country}"
    if constraint.stage == "tags":
        return _tags(constraint, facts) if constraint.words else _measure(constraint, facts)
    if constraint.subject == PARTICIPANTS:
        return f"{PARTICIPANTS}={facts.participants.total}"
    if constraint.stage == "obstacles":
        return f"{constraint.subject}={facts.participants.counts.get(constraint.subject, 0)}"
    if constraint.stage == "velocity":
        return f"ego {facts.ego.speed_mps:.2f} m/s ({facts.ego.speed_mps * 3.6:.1f} km/h)" if facts.ego else "no ego"
    return _road_net(constraint, facts)


def _tags(constraint: Constraint, facts: ScenarioFacts) -> str:
    kind = constraint.subject
    if kind == EITHER:
        matching = [
            f"{one} {word}"
            for one, word in constraint.words
            if word in (facts.tags if one == "tag" else facts.features)
        ]
        return ", ".join(matching) or f"no {kind} {constraint.words[0][1]}"
    computed = (*facts.features, *(facts.ego.manoeuvres or () if facts.ego else ()))
    held = {"tag": facts.tags, "feature": computed}.get(kind, facts.circumstances)
    words = [word for _, word in constraint.words]
    kind = "weather or time" if kind == CIRCUMSTANCE else kind
    carried = [word for word in words if word in held]
    missing = [word for word in words if word not in held]
    if carried and not (constraint.negated and missing):
        return f"{kind} {', '.join(carried)}"
    parts = [f"{kind} {', '.join(carried)}"] if carried else []
    return ", ".join([*parts, f"no {kind} {' or '.join(missing)}"])


def _measure(constraint: Constraint, facts: ScenarioFacts) -> str:
    if constraint.subject == "origin":
        source = f", by {cited(facts.source, 60)}" if facts.source else ""
        return f"origin {' and '.join(origins_of(facts)) or 'not stated'}{source}"
    if constraint.subject == "horizon":
        return f"horizon {facts.horizon_s:g} s"
    if constraint.subject == "density":
        return f"density {facts.density_per_km:g} vehicles/km"
    time_s = facts.ego.time_to_conflict_s if facts.ego else None
    return "no collision if the ego continues" if time_s is None else f"ttc {time_s:g} s"


def _road_net(constraint: Constraint, facts: ScenarioFacts) -> str:
    name, roads, everywhere = constraint.subject, facts.roads, constraint.everywhere
    if name == "lanes":
        return f"lanes={facts.ego.lanes}" if facts.ego else "no ego"
    if name == "speed_limit":
        limits = roads.limits_map_kmh if everywhere else roads.limits_ego_kmh
        return f"limit {'/'.join(f'{limit:g}' for limit in limits)} km/h" if limits else "no limit posted"
    if name == "traffic_light":
        present = bool(roads.traffic_lights_map) if everywhere else roads.traffic_light_ego
    else:
        present = name in (roads.signs_map if everywhere else roads.signs_ego)
    return f"{'' if present else 'no '}{name}{' on the map' if everywhere else ''}"


Value = TypeVar("Value", str, int)
_AT_ONCE = 500
"""The number of values in one query: SQLite limits them, in old versions to 999."""
_COLUMNS = "number, scenario_id, size, ttc_s"


def entries_of(connection: sqlite3.Connection, numbers: Iterable[int]) -> list[_Entry]:
    """Return the given entries, in the alphabetical order of their ids."""
    entries = [_Entry(*row) for chunk in _chunks(numbers) for row in _selected(connection, "number", chunk)]
    return sorted(entries, key=lambda entry: entry.scenario_id)


def _numbers_of(connection: sqlite3.Connection, scenario_ids: Iterable[str]) -> dict[str, int]:
    """Return the entries' numbers by scenario id; ids that are not in the catalogue are left out."""
    rows = (row for chunk in _chunks(scenario_ids) for row in _selected(connection, "scenario_id", chunk))
    return {row[1]: row[0] for row in rows}


def _selected(connection: sqlite3.Connection, column: str, values: Sequence[str | float]) -> list[tuple[Any, ...]]:
    holes = ", ".join("?" * len(values))
    query = f"SELECT {_COLUMNS} FROM catalog_scenarios WHERE {column} IN ({holes})"  # noqa: S608 - fixed names, ? marks
    return plain_rows(connection, query, values).fetchall()


def _chunks(values: Iterable[Value]) -> Iterable[list[Value]]:
    remaining = iter(values)
    while chunk := list(islice(remaining, _AT_ONCE)):
        yield chunk


_BANDS: dict[str, tuple[float, ...]] = {
    "ego_speed_mps": (0.5, 5, 10, 15, 25),
    "obstacles_total": (1, 6, 20, 50),
    "ttc_s": (1, 3, 6, 1e8),
    "density_per_km": (2, 5, 10, 20),
}
"""Bounds of the bands by dimension (chosen); ``ttc_s`` is the time to conflict, over 1e8 without a conflict."""
_COLUMN_OF = {"ego_speed_mps": "speed_mps", "obstacles_total": "size"}
MOST_CONSIDERED = 5000
"""The most matches that a diverse selection considers (chosen)."""
Values = frozenset[tuple[str, str]]
"""The values that an entry covers, as pairs of dimension and value."""


def _covered_values(connection: sqlite3.Connection, entries: Sequence[_Entry]) -> dict[str, Values]:
    """Return the values that every entry covers, by id."""
    chosen = {entry.number: entry.scenario_id for entry in entries}
    covered: dict[str, set[tuple[str, str]]] = {entry.scenario_id: set() for entry in entries}

    def add(query: str, dimension: str, edges: Sequence[float] | None = None) -> None:
        for chunk in _chunks(chosen):
            holes = ", ".join("?" * len(chunk))
            for number, value in plain_rows(connection, f"{query} number IN ({holes})", chunk):
                if value is not None:
                    covered[chosen[number]].add((dimension, str(value) if edges is None else _band(value, edges)))

    add("SELECT number, word FROM catalog_words WHERE kind = 'feature' AND", "features")
    add("SELECT number, obstacle FROM catalog_counts WHERE count > 0 AND", "obstacles")
    add("SELECT number, lanes FROM catalog_scenarios WHERE", "lanes")
    add("SELECT number, country FROM catalog_scenarios WHERE", "countries")
    for dimension, edges in _BANDS.items():
        column = _COLUMN_OF.get(dimension, dimension)
        add(f"SELECT number, {column} FROM catalog_scenarios WHERE", dimension, edges)  # noqa: S608 - fixed names
    return {key: frozenset(values) for key, values in covered.items()}


def _kinds(constraints: Iterable[Constraint]) -> tuple[str, ...]:
    """Return the arguments that a stage's conditions belong to, as answers name them, each once."""
    return tuple(dict.fromkeys(_KINDS.get(one.subject, _STAGE_KINDS.get(one.stage, "features")) for one in constraints))


_KINDS = {"tag": "tags", EITHER: "tags or features", CIRCUMSTANCE: CIRCUMSTANCE_WORDS, "origin": "origin"}
_STAGE_KINDS = {"location": "place", "road_net": "road net", "obstacles": "obstacles", "velocity": "ego speed"}


def _most_diverse(values: Mapping[str, Values], wanted: int) -> list[str]:
    """Return the ids of the greedy selection, in order of choice; the entry that is earlier in ``values`` wins
    a tie.
    """
    remaining, chosen = list(values), list[str]()
    covered: set[tuple[str, str]] = set()
    while remaining and len(chosen) < wanted:
        best = max(remaining, key=lambda key: len(values[key] - covered))
        if covered and not values[best] - covered:
            covered = set()
            continue
        chosen.append(best)
        remaining.remove(best)
        covered |= values[best]
        if not values[best]:
            chosen += remaining[: wanted - len(chosen)]
            break
    return chosen


def _coverage(values: Mapping[str, Values], chosen: Sequence[str]) -> tuple[Coverage, ...]:
    """Return the covered and missed values of all matches, per dimension."""
    occurring = frozenset().union(*values.values())
    taken = frozenset().union(*(values[key] for key in chosen))
    dimensions = sorted({dimension for dimension, _ in occurring})
    return tuple(
        Coverage(
            dimension=dimension,
            covered=tuple(sorted(value for name, value in taken if name == dimension)),
            missed=tuple(sorted(value for name, value in occurring - taken if name == dimension)),
        )
        for dimension in dimensions
    )


def _band(value: float, edges: Sequence[float]) -> str:
    for low, high in zip((None, *edges), (*edges, None), strict=True):
        if high is None:
            return f">={low:g}" if low != 1e8 else "never"
        if value < high:
            return f"<{high:g}" if low is None else f">={low:g}" if high == 1e8 else f"{low:g}..{high:g}"
    return ""
