"""Ranking scenarios by likeness to a text: the operations of the retrieval worker."""

import sqlite3
from pathlib import Path

from ...schemas.catalog import BuildIndexRequest, BuildIndexResponse, RankRequest, RankResponse
from ..execution import ProgressReporter
from .bm25 import bm25_scores
from .tables import descriptions, is_ready


def rank(request: RankRequest, report: ProgressReporter) -> RankResponse:
    """The candidates ordered by likeness of their descriptions to the text.

    Semantic: cosine of the model's vectors; the index is built first where the catalogue has changed. BM25: words.
    """
    texts = _descriptions(request.database)
    if request.method != "bm25":
        return _semantic(request, texts, report)
    wanted = texts if request.candidates is None else request.candidates
    scores = bm25_scores(request.text, {key: texts[key] for key in wanted if key in texts})
    ordered = tuple(sorted(scores, key=lambda key: (-scores[key], key))[: request.limit])
    return RankResponse(scenario_ids=ordered, scores=tuple(round(scores[key], 4) for key in ordered), built_index=False)


def build_index(request: BuildIndexRequest, report: ProgressReporter) -> BuildIndexResponse:
    """Load the model and have the text index ready before the first search by text.

    Raises:
        ResourceFailure: the model cannot be loaded, or the index not be written.
    """
    from .vector_index import EmbeddingModel, ensure_generation, query

    model, texts = EmbeddingModel.of(request.model), _descriptions(request.database)
    vector = model.embed(["a scenario"])[0]
    if not texts:
        return BuildIndexResponse(descriptions=0, built=False)
    folder, built = ensure_generation(request.index, texts, model.identity, model.embed, report)
    query(folder, vector, None, 1)
    return BuildIndexResponse(descriptions=len(texts), built=built)


def _semantic(request: RankRequest, texts: dict[str, str], report: ProgressReporter) -> RankResponse:
    from .vector_index import EmbeddingModel, ensure_generation, query

    if not texts:
        return RankResponse(scenario_ids=(), scores=(), built_index=False)
    report(0.1, "opening the text index")
    model = EmbeddingModel.of(request.model)
    folder, built = ensure_generation(request.index, texts, model.identity, model.embed, report)
    report(0.9, "ranking by text")
    candidates = None if request.candidates is None else [key for key in request.candidates if key in texts]
    nearest = query(folder, model.embed([request.text])[0], candidates, request.limit)
    return RankResponse(
        scenario_ids=tuple(key for key, _ in nearest),
        scores=tuple(round(score, 4) for _, score in nearest),
        built_index=built,
    )


def _descriptions(database: Path) -> dict[str, str]:
    if not database.is_file():
        return {}
    connection = sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro", uri=True, timeout=10.0)
    try:
        return descriptions(connection) if is_ready(connection) else {}
    finally:
        connection.close()
