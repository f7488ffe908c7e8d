"""How well searches find what was asked for, with the paper's metrics, against the corpus's ground truth."""

import sqlite3
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from plannerforge.engine.catalog.embedding import EmbeddingModel
from plannerforge.engine.catalog.rank import rank
from plannerforge.engine.catalog.search import Ranking, Search
from plannerforge.engine.execution.progress import silent
from plannerforge.evals.selection_corpus import Request, arguments_of, refused_arguments
from plannerforge.evals.selection_spoiling import spoiled
from plannerforge.schemas.catalog import PACKAGED_MODEL, FindScenariosArguments, Method, RankRequest
from plannerforge.schemas.errors import UnknownName

FIRST = 5
SEEDS = 5
XML_CHARACTERS = 20_000

Ranked = list[tuple[Request, Sequence[str]]]


def measure_quality(
    connection: sqlite3.Connection, database: Path, index: Path, requests: Sequence[Request], folder: Path
) -> tuple[dict[str, float | int | str], list[tuple[str, str]]]:
    """Figures by key, and rows of the table."""
    answerable = [request for request in requests if request.expect == "ok"]

    def ordered(request: Request, method: Method, *, by_slots: bool) -> Sequence[str]:
        asked = arguments_of(request.truth) if by_slots else FindScenariosArguments()
        arguments = asked.model_copy(update={"method": method, "text": None if method == "funnel" else request.text})
        search = Search(connection, arguments)
        ranking = _ranking(search, database, index) if search.needs_ranking else None
        return search.find(ranking).ordered

    funnel: Ranked = [(one, ordered(one, "funnel", by_slots=True)) for one in answerable]
    tables: dict[str, Ranked] = {
        "funnel (slots)": funnel,
        "hybrid (country, text)": [(one, ordered(one, "hybrid", by_slots=True)) for one in answerable],
        "rrf (slots, text)": [(one, ordered(one, "rrf", by_slots=True)) for one in answerable],
        "semantic (text)": [(one, ordered(one, "semantic", by_slots=False)) for one in answerable],
        "semantic over the XML (text)": _over_xml(answerable, folder),
        "bm25 (text)": [(one, ordered(one, "bm25", by_slots=False)) for one in answerable],
    }
    rows = [(f"{name}: sat_any@5, sat_top1, sat_all@5", _shares(table)) for name, table in tables.items()]
    spoiled_top1, strict_top1 = _spoiled(connection, answerable)
    refused = [request for request in requests if request.expect == "refuse"]
    figures: dict[str, float | int | str] = {
        "sat_all_funnel": _share(funnel, lambda wanted, found: bool(found) and set(found) <= wanted),
        "ids_exact": _share(funnel, lambda wanted, found: set(found) == wanted),
        "sat_top1_spoiled": spoiled_top1,
        "sat_top1_spoiled_strict": strict_top1,
        "bm25_top1": _share(tables["bm25 (text)"], _top1),
        "refused_right": round(sum(_is_refused(connection, one) for one in refused) / len(refused), 4),
        "semantic_top1": _share(tables["semantic (text)"], _top1),
        "semantic_xml_top1": _share(tables["semantic over the XML (text)"], _top1),
    }
    return figures, rows + [(key, f"{value}") for key, value in figures.items()]


def _ranking(search: Search, database: Path, index: Path) -> Ranking:
    candidates = search.candidates()
    request = RankRequest(
        database=database,
        index=index,
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
    vectors = model.embed([path.read_text(encoding="utf-8")[:XML_CHARACTERS] for path in paths])
    asked = model.embed([request.text for request in requests])
    best = np.argsort(-(asked @ vectors.T), axis=1, kind="stable")
    return [(one, [paths[index].stem for index in row]) for one, row in zip(requests, best, strict=True)]


def _spoiled(connection: sqlite3.Connection, requests: Sequence[Request]) -> tuple[float, float]:
    """Share satisfied at rank one, of the matches or else the fallback, and of the matches alone."""
    hits = strict = 0
    for request in requests:
        for seed in range(SEEDS):
            search = Search(connection, spoiled(arguments_of(request.truth), f"{request.request_id}/{seed}"))
            answer = search.answer("search", search.find(None), None)
            strict += bool(answer.matches) and answer.matches[0].scenario_id in request.matching
            shown = answer.matches or answer.fallback
            hits += bool(shown) and shown[0].scenario_id in request.matching
    return round(hits / len(requests) / SEEDS, 4), round(strict / len(requests) / SEEDS, 4)


def _is_refused(connection: sqlite3.Connection, request: Request) -> bool:
    """Whether passing the words on is refused, naming each of them."""
    slots: Mapping[str, list[str]] = refused_arguments(request)
    try:
        Search(connection, FindScenariosArguments.model_validate(dict(slots)))
    except UnknownName as error:
        return all(word in error.text for words in slots.values() for word in words)
    return False


def _top1(wanted: frozenset[str], found: Sequence[str]) -> bool:
    return bool(found) and found[0] in wanted


def _shares(table: Ranked) -> str:
    any5 = _share(table, lambda wanted, found: bool(wanted & set(found[:FIRST])))
    all5 = _share(table, lambda wanted, found: bool(found) and set(found[:FIRST]) <= wanted)
    return f"{any5:.3f}, {_share(table, _top1):.3f}, {all5:.3f}"


def _share(table: Ranked, holds: Callable[[frozenset[str], Sequence[str]], bool]) -> float:
    return round(sum(holds(request.matching, found) for request, found in table) / len(table), 4)
