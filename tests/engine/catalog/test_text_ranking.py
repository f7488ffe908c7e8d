"""Ranking by text: BM25, fusion, and a real Chroma index in its generations."""

import sqlite3
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from builders_catalog import facts

from plannerforge.engine.catalog import vector_index
from plannerforge.engine.catalog.bm25 import bm25_scores, reciprocal_rank_fusion
from plannerforge.engine.catalog.embedding import Vectors
from plannerforge.engine.catalog.rank import rank
from plannerforge.engine.catalog.tables import add_facts, prepare
from plannerforge.engine.catalog.vector_index import COMPLETE, ensure_generation, query
from plannerforge.engine.execution.progress import silent
from plannerforge.schemas.catalog import RankRequest

TEXTS = {"one": "a truck on the motorway", "two": "bicycles in a village", "three": "a bus at a crossing"}


class CountingEmbedding:
    """Unit vectors from letters, so that no model has to be loaded; counts what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, texts: Sequence[str]) -> Vectors:
        self.asked += list(texts)
        counts = np.array([[text.count(chr(97 + i)) for i in range(26)] for text in texts], dtype=np.float32)
        normed: Vectors = counts / np.linalg.norm(counts, axis=1, keepdims=True)
        return normed


def test_bm25_prefers_the_text_with_the_rare_word() -> None:
    scores = bm25_scores("a truck", TEXTS)
    assert max(scores, key=lambda key: scores[key]) == "one"
    assert bm25_scores("zebra", TEXTS) == dict.fromkeys(TEXTS, 0.0)


def test_fusion_prefers_what_both_rankings_like() -> None:
    assert reciprocal_rank_fusion([["a", "b", "c"], ["b", "d"]])[0] == "b"


def test_a_generation_is_built_once_and_ranks(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    folder, built = ensure_generation(tmp_path, TEXTS, "letters", embed)
    again, rebuilt = ensure_generation(tmp_path, TEXTS, "letters", embed)
    assert (built, rebuilt, again) == (True, False, folder)
    ranked = query(folder, embed([TEXTS["two"]])[0], None, 3)
    assert ranked[0][0] == "two"
    assert ranked[0][1] == pytest.approx(1.0, abs=1e-5)


def test_only_candidates_are_ranked(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    assert {key for key, _ in query(folder, embed(["x y"])[0], ["one", "three"], 10)} == {"one", "three"}
    assert query(folder, embed(["x"])[0], [], 10) == []


def test_a_changed_catalogue_embeds_only_what_is_new(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    first, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    embed.asked.clear()
    second, _ = ensure_generation(tmp_path, {**TEXTS, "four": "a quiet lane"}, "letters", embed)
    assert embed.asked == ["a quiet lane"]
    assert first != second
    assert query(first, embed(["truck"])[0], None, 5)


def test_a_generation_that_a_crash_left_is_built_anew(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    (folder / COMPLETE).unlink()
    again, built = ensure_generation(tmp_path, TEXTS, "letters", embed)
    assert (again, built) == (folder, True)
    assert len(query(again, embed(["bus"])[0], None, 5)) == 3


def test_old_generations_go_when_nobody_used_them_for_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    embed = CountingEmbedding()
    first, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    monkeypatch.setattr(vector_index, "GRACE_S", -1.0)
    second, _ = ensure_generation(tmp_path, {"one": TEXTS["one"]}, "letters", embed)
    assert not first.exists()
    assert second.exists()


def test_collections_carry_no_embedding_function(tmp_path: Path) -> None:
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", CountingEmbedding())
    with sqlite3.connect(folder / "chroma" / "chroma.sqlite3") as connection:
        stored = str(connection.execute("SELECT * FROM collections").fetchall()).lower()
    assert "sentence" not in stored
    assert "onnx" not in stored


@pytest.mark.filterwarnings("ignore")
def test_the_real_model_finds_the_description_that_means_the_same(tmp_path: Path) -> None:
    database = tmp_path / "workspace.sqlite"
    with sqlite3.connect(database) as connection:
        prepare(connection)
        add_facts(connection, 1, facts("DEU_Bonn-1_1_T-1", tags=["highway"], counts={"truck": 5}, speed_mps=30.0))
        add_facts(connection, 2, facts("DEU_Bonn-2_1_T-1", tags=["urban"], counts={"bicycle": 4}, speed_mps=5.0))
    connection.close()
    request = RankRequest(
        database=database,
        index=tmp_path / "index",
        text="cyclists in the city",
        candidates=None,
        method="semantic",
        limit=2,
    )
    response = rank(request, silent)
    assert response.scenario_ids[0] == "DEU_Bonn-2_1_T-1"
    assert response.built_index
    assert not rank(request, silent).built_index
