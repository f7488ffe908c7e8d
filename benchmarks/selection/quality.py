"""Measures search quality by the paper's metrics, against the corpus's ground truth."""

import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plannerforge.engine.catalog import Ranking, Search, rank
from plannerforge.engine.catalog.vector_index import EmbeddingModel
from plannerforge.engine.execution import silent
from plannerforge.engine.workspace import Database
from plannerforge.evals.ground_truth.selection import Request, arguments_of, extract_score, refused_arguments, spoiled
from plannerforge.schemas.catalog import PACKAGED_MODEL, FindScenariosArguments, Method, RankRequest
from plannerforge.schemas.errors import UnknownName

from ..harness import share

_FIRST = 5
"""Number of visible results, as in the paper's interface."""
SEEDS = 5
_XML_CHARACTERS = 20_000
"""Characters of a file: more than the model's first few hundred tokens."""
Ranked = list[tuple[Request, Sequence[str]]]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class _Spoiled:
    """Results with spoiled slots of one seed: strict matches, with the fallback, with the request's text as well."""

    extract: float
    strict: Ranked
    fallback: Ranked
    with_text: Ranked


class SelectionQuality:
    """Measures searches over an imported catalogue against the corpus.

    Args:
        folder: the real scenarios, for embedding their XML.
        tell: receives the current measurement's name.
    """

    def __init__(self, database: Database, index: Path, requests: Sequence[Request], folder: Path, tell: Tell) -> None:
        self._connection, self._path, self._index = database.connection(), database.path, index
        self._folder, self._tell = folder, tell
        self._refused = [one for one in requests if one.expect == "refuse"]
        self._answerable = [one for one in requests if one.expect == "ok"]

    def measure(self, seeds: Sequence[int]) -> tuple[dict[str, float | int | str], list[tuple[str, str]]]:
        """Return figures by key, and rows of the table."""
        tables = self._tables()
        rounds = []
        for seed in seeds:
            self._tell(f"spoiling slots, seed {seed}")
            rounds.append(self._spoiled(seed))
        extract = sum(one.extract for one in rounds) / len(rounds)
        strict = [pair for one in rounds for pair in one.strict]
        fallback = [pair for one in rounds for pair in one.fallback]
        with_text = [pair for one in rounds for pair in one.with_text]
        rows = [(name, f"{_shares(table)}, {'1.000' if 'slots' in name else '-'}") for name, table in tables.items()]
        rows += [
            (name, f"{_shares(table)}, {extract:.3f}")
            for name, table in (
                ("funnel, strict (spoiled slots)", strict),
                ("funnel, fallback (spoiled slots)", fallback),
                ("funnel, fallback (spoiled slots, text)", with_text),
            )
        ]
        figures: dict[str, float | int | str] = {
            "sat_top1_spoiled": _share(fallback, _top1),
            "sat_top1_spoiled_text": _share(with_text, _top1),
            "sat_top1_spoiled_strict": _share(strict, _top1),
            "bm25_top1": _share(tables["bm25 (text)"], _top1),
            "refused_right": share(_is_refused(self._connection, request) for request in self._refused),
            "semantic_top1": _share(tables["semantic (text)"], _top1),
            "semantic_xml_top1": _share(tables["semantic over the XML (text)"], _top1),
        }
        heading = [("method: sat_any@5, sat_top1, sat_all@5, extract", "")]
        by_seed = [
            (
                f"spoiled, seed {seed}: sat_top1 strict, fallback, fallback with text",
                ", ".join(f"{_share(table, _top1):.3f}" for table in (one.strict, one.fallback, one.with_text)),
            )
            for seed, one in zip(seeds, rounds, strict=True)
        ]
        return figures, [*heading, *rows, *by_seed, *((key, f"{value}") for key, value in figures.items())]

    def _tables(self) -> dict[str, Ranked]:
        """Return the matches of every method; sat_all counts the first five, as the paper's interface shows."""
        methods: dict[str, tuple[Method, bool]] = {
            "funnel (slots)": ("funnel", True),
            "rrf (slots, text)": ("rrf", True),
            "hybrid (country, text)": ("hybrid", True),
            "semantic (text)": ("semantic", False),
            "bm25 (text)": ("bm25", False),
        }
        tables: dict[str, Ranked] = {}
        for name, (method, by_slots) in methods.items():
            self._tell(name)
            tables[name] = [(one, self._ordered(one, method, by_slots=by_slots)) for one in self._answerable]
        self._tell("semantic over the XML (text)")
        tables["semantic over the XML (text)"] = _over_xml(self._answerable, self._folder)
        return tables

    def _ordered(self, request: Request, method: Method, *, by_slots: bool) -> Sequence[str]:
        asked = arguments_of(request.truth) if by_slots else FindScenariosArguments()
        arguments = asked.model_copy(update={"method": method, "text": None if method == "funnel" else request.text})
        search = Search(self._connection, arguments)
        return search.find(self._ranking(search)).ordered

    def _spoiled(self, seed: int) -> _Spoiled:
        extracts, strict, fallback, with_text = [], Ranked(), Ranked(), Ranked()
        for request in self._answerable:
            truth = arguments_of(request.truth)
            given = spoiled(truth, f"{request.request_id}/{seed}")
            extracts.append(extract_score(truth, given))
            matches, shown = self._found(given)
            strict.append((request, matches))
            fallback.append((request, shown))
            with_text.append((request, self._found(given.model_copy(update={"text": request.text}))[1]))
        return _Spoiled(sum(extracts) / len(extracts), strict, fallback, with_text)

    def _found(self, arguments: FindScenariosArguments) -> tuple[list[str], list[str]]:
        """Return the matches, and the matches or else the fallback."""
        search = Search(self._connection, arguments)
        ranking = self._ranking(search)
        answer = search.answer("search", search.find(ranking), ranking)
        matches = [one.scenario_id for one in answer.matches]
        return matches, matches or [one.scenario_id for one in answer.fallback]

    def _ranking(self, search: Search) -> Ranking | None:
        if not search.needs_ranking:
            return None
        candidates = search.candidates()
        request = RankRequest(
            database=self._path,
            index=self._index,
            text=search.arguments.text or "",
            candidates=candidates,
            method="bm25" if search.arguments.method == "bm25" else "semantic",
            limit=max(len(candidates), 1),
        )
        return Ranking.of(rank(request, silent))


def _over_xml(requests: Sequence[Request], folder: Path) -> Ranked:
    """Embedding the files instead of descriptions; the model reads the first few hundred tokens of each."""
    paths = sorted(folder.glob("*.xml"))
    model = EmbeddingModel.of(PACKAGED_MODEL)
    vectors = model.embed([path.read_text(encoding="utf-8")[:_XML_CHARACTERS] for path in paths])
    asked = model.embed([request.text for request in requests])
    best = np.argsort(-(asked @ vectors.T), axis=1, kind="stable")
    return [(one, [paths[index].stem for index in row]) for one, row in zip(requests, best, strict=True)]


def _is_refused(connection: sqlite3.Connection, request: Request) -> bool:
    """Return True if the words are refused with each of them named."""
    slots: Mapping[str, list[str]] = refused_arguments(request)
    try:
        Search(connection, FindScenariosArguments.model_validate(dict(slots)))
    except UnknownName as error:
        return all(word in error.text for words in slots.values() for word in words)
    return False


def _top1(wanted: frozenset[str], found: Sequence[str]) -> bool:
    return bool(found) and found[0] in wanted


def _shares(table: Ranked) -> str:
    any5 = _share(table, lambda wanted, found: bool(wanted & set(found[:_FIRST])))
    all5 = _share(table, lambda wanted, found: bool(found) and set(found[:_FIRST]) <= wanted)
    return f"{any5:.3f}, {_share(table, _top1):.3f}, {all5:.3f}"


def _share(table: Ranked, holds: Callable[[frozenset[str], Sequence[str]], bool]) -> float:
    return share(holds(request.matching, found) for request, found in table)
