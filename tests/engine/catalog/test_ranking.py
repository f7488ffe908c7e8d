"""Ranking by text: BM25, fusion, and a real Chroma index in its generations."""

import os
import shutil
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from support.catalog import facts

from plannerforge.engine.catalog import packaged_model, vector_index
from plannerforge.engine.catalog.bm25 import bm25_scores, reciprocal_rank_fusion
from plannerforge.engine.catalog.ranking import build_index, rank
from plannerforge.engine.catalog.tables import add_facts, prepare
from plannerforge.engine.catalog.vector_index import (
    COMPLETE,
    Vectors,
    damaged_parts,
    ensure_generation,
    query,
    remove_damaged,
)
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.catalog import (
    PACKAGED_MODEL,
    BuildIndexRequest,
    BuildIndexResponse,
    RankRequest,
    RankResponse,
)
from plannerforge.schemas.errors import ResourceFailure

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


def test_fusion_prefers_scenarios_high_in_both_rankings() -> None:
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


def test_only_new_descriptions_are_embedded_after_a_change(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    first, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    embed.asked.clear()
    second, _ = ensure_generation(tmp_path, {**TEXTS, "four": "a quiet lane"}, "letters", embed)
    assert embed.asked == ["a quiet lane"]
    assert first != second
    assert query(first, embed(["truck"])[0], None, 5)


def test_a_generation_that_a_crash_left_is_built_again(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    (folder / COMPLETE).unlink()
    again, built = ensure_generation(tmp_path, TEXTS, "letters", embed)
    assert (again, built) == (folder, True)
    assert len(query(again, embed(["bus"])[0], None, 5)) == 3


def test_old_generations_are_removed_when_unused_for_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    embed = CountingEmbedding()
    first, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    monkeypatch.setattr(vector_index, "GRACE_S", -1.0)
    second, _ = ensure_generation(tmp_path, {"one": TEXTS["one"]}, "letters", embed)
    assert not first.exists()
    assert second.exists()


def test_a_generation_that_vanishes_meanwhile_is_not_called_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    embed = CountingEmbedding()
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    seen_by_this_process = Path.is_file

    def removed_after_the_look(path: Path) -> bool:
        there = seen_by_this_process(path)
        if path == folder / COMPLETE and there:
            path.unlink()
            shutil.rmtree(folder / "chroma")
        return there

    monkeypatch.setattr(Path, "is_file", removed_after_the_look)
    again, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    monkeypatch.undo()
    assert len(query(again, embed(["bus"])[0], None, 5)) == 3


def test_a_generation_that_is_in_use_is_not_old(tmp_path: Path) -> None:
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", CountingEmbedding())
    os.utime(folder / COMPLETE, (0.0, 0.0))
    ensure_generation(tmp_path, TEXTS, "letters", CountingEmbedding())
    ensure_generation(tmp_path, {"one": TEXTS["one"]}, "letters", CountingEmbedding())
    assert folder.exists()


def test_collections_carry_no_embedding_function(tmp_path: Path) -> None:
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", CountingEmbedding())
    with sqlite3.connect(folder / "chroma" / "chroma.sqlite3") as connection:
        stored = str(connection.execute("SELECT * FROM collections").fetchall()).lower()
    assert "sentence" not in stored
    assert "onnx" not in stored


def test_a_generation_that_is_built_again_while_it_is_open_is_read_again(tmp_path: Path) -> None:
    embed = CountingEmbedding()
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    assert len(query(folder, embed(["bus"])[0], None, 5)) == 3
    shutil.rmtree(folder)
    again, built = ensure_generation(tmp_path, TEXTS, "letters", embed)
    assert (again, built) == (folder, True)
    assert len(query(folder, embed(["bus"])[0], None, 5)) == 3


def test_embeddings_from_before_an_interruption_are_reused(tmp_path: Path) -> None:
    class Interrupted(CountingEmbedding):
        def __call__(self, texts: Sequence[str]) -> Vectors:
            if self.asked:
                raise KeyboardInterrupt
            return super().__call__(texts)

    many = {f"{number:03}": f"lane {chr(97 + number % 26)} {number}" for number in range(100)}
    first, second = Interrupted(), CountingEmbedding()
    with pytest.raises(KeyboardInterrupt):
        ensure_generation(tmp_path, many, "letters", first)
    ensure_generation(tmp_path, many, "letters", second)
    assert 0 < len(first.asked) < 100
    assert sorted(first.asked + second.asked) == sorted(many.values())


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """Heavy traffic on a motorway, and bicycles in a town."""
    path = tmp_path / "workspace.sqlite"
    connection = sqlite3.connect(path)
    with connection:
        prepare(connection)
        add_facts(connection, 1, facts("DEU_Bonn-1_1_T-1", tags=["highway"], counts={"truck": 5}, speed_mps=30.0))
        add_facts(connection, 2, facts("DEU_Bonn-2_1_T-1", tags=["urban"], counts={"bicycle": 4}, speed_mps=5.0))
    connection.close()
    return path


def ranked(database: Path, model: str = PACKAGED_MODEL) -> RankResponse:
    request = RankRequest(
        database=database,
        index=database.parent / "index",
        text="cyclists in the city",
        candidates=None,
        method="semantic",
        limit=2,
        model=model,
    )
    return rank(request, silent)


def test_the_packaged_model_finds_the_description_that_means_the_same(database: Path) -> None:
    response = ranked(database)
    assert response.scenario_ids[0] == "DEU_Bonn-2_1_T-1"
    assert response.built_index
    assert not ranked(database).built_index


def test_an_index_of_other_weights_is_rebuilt(database: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as earlier:  # as a release with other weights left the workspace
        earlier.setattr(packaged_model, "WEIGHTS_SHA256", "0" * 64)
        earlier.setattr(vector_index, "load_packaged", lambda name: CountingEmbedding())
        assert ranked(database).built_index
    after = ranked(database)
    assert after.built_index
    assert after.scenario_ids[0] == "DEU_Bonn-2_1_T-1"
    assert not ranked(database).built_index


@pytest.mark.parametrize("method", ["bm25", "semantic"])
def test_an_empty_list_of_candidates_ranks_no_scenarios(database: Path, method: Literal["bm25", "semantic"]) -> None:
    request = RankRequest(
        database=database, index=database.parent / "index", text="cyclists", candidates=(), method=method, limit=1
    )
    assert rank(request, silent).scenario_ids == ()


def test_a_prepared_index_is_not_built_by_the_first_search(database: Path) -> None:
    request = BuildIndexRequest(database=database, index=database.parent / "index")
    assert build_index(request, silent) == BuildIndexResponse(descriptions=2, built=True)
    assert not ranked(database).built_index


def test_an_index_of_an_empty_catalogue_is_not_a_failure(tmp_path: Path) -> None:
    request = BuildIndexRequest(database=tmp_path / "none.sqlite", index=tmp_path / "index")
    assert build_index(request, silent).descriptions == 0


def spoilt(path: Path, how: str) -> None:
    """Overwrite a file, empty it, or cut it off in its middle."""
    if how == "truncated":
        os.truncate(path, path.stat().st_size // 2)
    else:
        path.write_bytes(b"" if how == "empty" else b"no database at all" * 1000)


@pytest.mark.parametrize("how", ["rubbish", "empty", "truncated"])
def test_a_damaged_generation_is_rebuilt_and_reported(database: Path, how: str) -> None:
    before = ranked(database)
    (file,) = database.parent.glob("index/*/chroma/chroma.sqlite3")
    remove_damaged(file.parents[2])  # lets go of the file, as another process would find it
    spoilt(file, how)
    after = ranked(database)
    assert (after.mended_index, after.built_index) == (True, True)
    assert (after.scenario_ids, after.scores) == (before.scenario_ids, before.scores)
    assert not ranked(database).mended_index


@pytest.mark.parametrize(
    ("name", "how", "told"),
    [
        ("vectors.sqlite", "rubbish", True),
        ("vectors.sqlite", "truncated", True),
        ("vectors.sqlite", "empty", False),
        ("writer.sqlite", "rubbish", True),
    ],
)
def test_extra_files_of_an_index_are_rebuilt(database: Path, name: str, how: str, told: bool) -> None:
    build_index(BuildIndexRequest(database=database, index=database.parent / "index"), silent)
    spoilt(database.parent / "index" / name, how)
    with sqlite3.connect(database) as connection:
        add_facts(connection, 3, facts("DEU_Bonn-3_1_T-1", tags=["urban"]))
    connection.close()
    request = BuildIndexRequest(database=database, index=database.parent / "index")
    assert build_index(request, silent) == BuildIndexResponse(descriptions=3, built=True, mended=told)
    assert ranked(database).scenario_ids[0] == "DEU_Bonn-2_1_T-1"


def test_a_generation_that_lacks_vectors_is_damaged(tmp_path: Path) -> None:
    folder, _ = ensure_generation(tmp_path, TEXTS, "letters", CountingEmbedding())
    assert damaged_parts(tmp_path) == []
    remove_damaged(tmp_path)  # lets go of it
    (folder / COMPLETE).write_text("4")
    assert damaged_parts(tmp_path) == [folder]


def test_a_full_disk_is_not_damage(tmp_path: Path) -> None:
    class Full(CountingEmbedding):
        def __call__(self, texts: Sequence[str]) -> Vectors:
            raise sqlite3.OperationalError("database or disk is full")

    with pytest.raises(ResourceFailure, match="cannot be written") as failure:
        ensure_generation(tmp_path, TEXTS, "letters", Full())
    assert failure.value.reason == ""
    assert "free disk space" in failure.value.text


@pytest.mark.parametrize("bytes_of_a_file", [512, 180_000])
def test_disk_that_fills_while_chroma_writes_is_named_and_the_next_call_succeeds(
    bytes_of_a_file: int, tmp_path: Path
) -> None:
    """Chroma cannot make its database, or cannot add to it; the vectors are known before."""
    resource = pytest.importorskip("resource")
    embed = CountingEmbedding()
    other, _ = ensure_generation(tmp_path, {"one": TEXTS["one"]}, "letters", embed)
    before, _ = ensure_generation(tmp_path, TEXTS, "letters", embed)
    shutil.rmtree(before)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_of_a_file, hard))
    try:
        with pytest.raises(ResourceFailure, match="cannot be written") as failure:
            ensure_generation(tmp_path, TEXTS, "letters", embed)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "free disk space" in failure.value.text
    assert not before.exists()
    for folder, count in ((other, 1), (ensure_generation(tmp_path, TEXTS, "letters", embed)[0], 3)):
        assert len(query(folder, embed(["a truck"])[0], None, 5)) == count
