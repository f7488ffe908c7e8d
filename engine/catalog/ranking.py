"""Ranking scenarios by likeness to a text: by words (BM25), by a model's vectors, and rankings fused.

BM25: Robertson and Zaragoza, The Probabilistic Relevance Framework (2009), with k1 = 1.5 and b = 0.75. SQLite's FTS5
has a bm25() too, with k1 = 1.2 and another weight of words, both fixed: of the 100 requests of the selection corpus it
puts the same five scenarios first in the same order for 49, and all in the same order for 11.
"""

import math
import re
import sqlite3
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...schemas.catalog import BuildIndexRequest, BuildIndexResponse, RankRequest, RankResponse
from ..execution import ProgressReporter
from .tables import descriptions, is_ready

_K1, _B = 1.5, 0.75
"""How fast repeated words stop to count, and how much long texts are marked down: usual values of the source."""


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


def words_of(text: str) -> list[str]:
    """Lower-case words and numbers of a text."""
    return re.findall(r"\w+", text.casefold().replace("_", " "))


def bm25_scores(query: str, texts: Mapping[str, str]) -> dict[str, float]:
    """BM25 score of every text for the query; 0 where no word is shared."""
    counts = {key: Counter(words_of(text)) for key, text in texts.items()}
    if not counts:
        return {}
    lengths = {key: sum(words.values()) for key, words in counts.items()}
    mean = sum(lengths.values()) / len(lengths) or 1.0
    scores = dict.fromkeys(texts, 0.0)
    for word in sorted(set(words_of(query))):
        holding = [key for key, words in counts.items() if word in words]
        weight = math.log(1 + (len(texts) - len(holding) + 0.5) / (len(holding) + 0.5))
        for key in holding:
            often = counts[key][word]
            scores[key] += weight * often * (_K1 + 1) / (often + _K1 * (1 - _B + _B * lengths[key] / mean))
    return scores


def reciprocal_rank_fusion(rankings: Sequence[Sequence[str]], constant: float = 60.0) -> list[str]:
    """Fuse rankings: the sum of 1 / (constant + rank) over all of them, ties alphabetically.

    Cormack, Clarke and Buettcher, Reciprocal Rank Fusion (SIGIR 2009).
    """
    scores: dict[str, float] = {}
    for ranking in rankings:
        for rank, key in enumerate(ranking, start=1):
            scores[key] = scores.get(key, 0.0) + 1.0 / (constant + rank)
    return sorted(scores, key=lambda key: (-scores[key], key))
