"""Rank scenarios by similarity to a text: the operations of the retrieval worker."""

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.catalog import BuildIndexRequest, BuildIndexResponse, RankRequest, RankResponse
from ...schemas.errors import ResourceFailure
from ..execution import ProgressReporter
from .bm25 import bm25_scores
from .tables import descriptions, is_ready

if TYPE_CHECKING:
    from .vector_index import EmbeddingModel, Vectors


def rank(request: RankRequest, report: ProgressReporter) -> RankResponse:
    """Return the candidates ordered by similarity of their descriptions to the text.

    Semantic ranking uses the cosine of the model's vectors, and first rebuilds the index if the catalogue has changed.
    BM25 compares words.
    """
    texts = _descriptions(request.database)
    if request.method != "bm25":
        return _semantic(request, texts, report)
    wanted = texts if request.candidates is None else request.candidates
    scores = bm25_scores(request.text, {key: texts[key] for key in wanted if key in texts})
    ordered = tuple(sorted(scores, key=lambda key: (-scores[key], key))[: request.limit])
    return RankResponse(scenario_ids=ordered, scores=tuple(round(scores[key], 4) for key in ordered), built_index=False)


def build_index(request: BuildIndexRequest, report: ProgressReporter) -> BuildIndexResponse:
    """Load the model and build the text index before the first search by text.

    Raises:
        ResourceFailure: the model cannot be loaded, or the index cannot be written.
    """
    from .vector_index import EmbeddingModel

    model, texts = EmbeddingModel.of(request.model), _descriptions(request.database)
    vector = model.embed(["a scenario"])[0]
    if not texts:
        return BuildIndexResponse(descriptions=0, built=False)
    _, built, mended = _nearest(request.index, texts, model, vector, None, 1, report)
    return BuildIndexResponse(descriptions=len(texts), built=built, mended=mended)


def _semantic(request: RankRequest, texts: dict[str, str], report: ProgressReporter) -> RankResponse:
    from .vector_index import EmbeddingModel

    if not texts:
        return RankResponse(scenario_ids=(), scores=(), built_index=False)
    report(0.1, "opening the text index")
    model = EmbeddingModel.of(request.model)
    candidates = None if request.candidates is None else [key for key in request.candidates if key in texts]
    vector = model.embed([request.text])[0]
    nearest, built, mended = _nearest(request.index, texts, model, vector, candidates, request.limit, report)
    return RankResponse(
        scenario_ids=tuple(key for key, _ in nearest),
        scores=tuple(round(score, 4) for _, score in nearest),
        built_index=built,
        mended_index=mended,
        least_likeness=model.least_likeness,
    )


def _nearest(
    root: Path,
    texts: Mapping[str, str],
    model: "EmbeddingModel",
    vector: "Vectors",
    candidates: Sequence[str] | None,
    limit: int,
    report: ProgressReporter,
) -> tuple[list[tuple[str, float]], bool, bool]:
    """Return the nearest scenarios, whether the index was rebuilt in this call, and whether it was damaged.

    A damaged index is removed and rebuilt, since it is a cache.

    Raises:
        ResourceFailure: the index cannot be written, or cannot be read even after it is rebuilt.
    """
    from .vector_index import DAMAGED, ensure_generation, query, remove_damaged

    def query_index() -> tuple[list[tuple[str, float]], bool]:
        folder, built = ensure_generation(root, texts, model.identity, model.embed, report)
        report(0.9, "ranking by text")
        return query(folder, vector, candidates, limit), built

    try:
        return *query_index(), False
    except ResourceFailure as failure:
        if failure.reason != DAMAGED or not remove_damaged(root):
            raise
    return *query_index(), True


def _descriptions(database: Path) -> dict[str, str]:
    if not database.is_file():
        return {}
    connection = sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro", uri=True, timeout=10.0)
    try:
        return descriptions(connection) if is_ready(connection) else {}
    finally:
        connection.close()
