"""The packaged MiniLM in numpy: it is ready one second after the start and embeds a text in milliseconds.

The model is ``sentence-transformers/all-MiniLM-L6-v2``: BERT (Devlin et al. 2019) with 6 layers, 12 heads and a width
of 384 (Wang et al. 2020, MiniLM); the embedding is the normalised mean of the tokens. Its weights are stored as 8-bit
integers with a scale for each row (``scripts/pack_minilm.py``). The computation uses 32-bit floats, so the results do
not depend on the processor's integer instructions. sentence-transformers computes the same in PyTorch, but its import
alone takes longer than a whole search; a test compares the two results.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

WEIGHTS = Path(__file__).parent / "weights"
"""The folder of ``minilm.npz`` and ``minilm_tokenizer.json``, which ``scripts/pack_minilm.py`` writes."""
WEIGHTS_SHA256 = "8d33f224d15358d40dd3de39c7397d14c13b0ac9012e8a206610d6b7a83d4264"
"""The digest of ``minilm.npz``; part of the model's identity, so that other weights give a new index."""
_LAYERS, _HEADS = 6, 12
_MOST_TOKENS = 256
"""The length that the model was trained on; the rest of a longer text is ignored."""
_EPSILON = 1e-12


class MiniLM:
    """The model in memory: the packaged weights and their tokenizer."""

    def __init__(self) -> None:
        from tokenizers import Tokenizer

        self._weights = _weights(WEIGHTS / "minilm.npz")
        self._tokenizer = Tokenizer.from_file(str(WEIGHTS / "minilm_tokenizer.json"))
        self._tokenizer.enable_truncation(_MOST_TOKENS)
        self._tokenizer.no_padding()

    def embed(self, texts: Sequence[str]) -> Array:
        """Return unit vectors of the texts, shape (n, 384); each vector is independent of the other texts."""
        return np.stack([self._vector(encoding.ids) for encoding in self._tokenizer.encode_batch(list(texts))])

    def _vector(self, tokens: Sequence[int]) -> Array:
        weights = self._weights
        states = (
            weights["embeddings.word_embeddings.weight"][list(tokens)]
            + weights["embeddings.position_embeddings.weight"][: len(tokens)]
            + weights["embeddings.token_type_embeddings.weight"][0]
        )
        states = self._normalised("embeddings", states)
        for layer in range(_LAYERS):
            states = self._layer(f"encoder.layer.{layer}", states)
        mean = states.mean(axis=0)
        return np.asarray(mean / np.linalg.norm(mean), dtype=np.float32)

    def _layer(self, name: str, states: Array) -> Array:
        mixed = self._attention(f"{name}.attention", states)
        states = self._normalised(f"{name}.attention.output", states + mixed)
        inner = _gelu(self._dense(f"{name}.intermediate.dense", states))
        return self._normalised(f"{name}.output", states + self._dense(f"{name}.output.dense", inner))

    def _attention(self, name: str, states: Array) -> Array:
        query, key, value = (
            self._dense(f"{name}.self.{part}", states).reshape(len(states), _HEADS, -1).swapaxes(0, 1)
            for part in ("query", "key", "value")
        )
        scores = query @ key.swapaxes(1, 2) / np.float32(np.sqrt(query.shape[2]))
        scores = np.exp(scores - scores.max(axis=2, keepdims=True))
        heads = (scores / scores.sum(axis=2, keepdims=True)) @ value
        return self._dense(f"{name}.output.dense", heads.swapaxes(0, 1).reshape(len(states), -1))

    def _dense(self, name: str, states: Array) -> Array:
        return states @ self._weights[f"{name}.weight"].T + self._weights[f"{name}.bias"]

    def _normalised(self, name: str, states: Array) -> Array:
        centred: Array = states - states.mean(axis=1, keepdims=True)
        deviation: Array = np.sqrt((centred**2).mean(axis=1, keepdims=True) + np.float32(_EPSILON))
        return centred / deviation * self._weights[f"{name}.LayerNorm.weight"] + self._weights[f"{name}.LayerNorm.bias"]


def _weights(file: Path) -> dict[str, Array]:
    """Return all parameters by name; a matrix of integers is multiplied by the scales of its rows."""
    weights: dict[str, Array] = {}
    with np.load(file, allow_pickle=False) as stored:
        for name in stored.files:
            if name.endswith(".scale"):
                continue
            values = stored[name]
            weights[name] = values * stored[f"{name}.scale"] if values.dtype == np.int8 else values
    return weights


def _gelu(states: Array) -> Array:
    from scipy.special import erf

    return np.asarray(states * 0.5 * (1.0 + erf(states / np.float32(np.sqrt(2.0)))), dtype=np.float32)
