"""The packaged all-MiniLM-L6-v2 without PyTorch: a BERT encoder of six layers in NumPy.

A search by text must not wait for PyTorch, whose import alone takes ten times as long as everything here. The weights,
the tokenizer and the vectors (to 1e-6; a test holds it) are those of sentence-transformers.

Sources: Devlin et al., BERT (2019); Reimers and Gurevych, Sentence-BERT (2019): mean pooling, unit length.
"""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tokenizers import Tokenizer

HEADS = 12
WIDTH = 384
LAYERS = 6
LONGEST_TOKENS = 256
"""What sentence-transformers reads of a text with this model (sentence_bert_config.json)."""
MOST_THREADS = min(2, os.cpu_count() or 1)
"""NumPy lets go of the interpreter while it multiplies; the other cores are the compute workers'."""

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class _Dense:
    """``x @ weights + bias``."""

    weights: Floats
    bias: Floats

    @classmethod
    def of(cls, tensors: Mapping[str, Floats], *names: str) -> "_Dense":
        """One matrix of several that are applied to the same input."""
        weights = np.concatenate([tensors[f"{name}.weight"].T for name in names], axis=1)
        return cls(np.ascontiguousarray(weights), np.concatenate([tensors[f"{name}.bias"] for name in names]))

    def __call__(self, values: Floats) -> Floats:
        result: Floats = values @ self.weights + self.bias
        return result


@dataclass(frozen=True)
class _Norm:
    """Layer normalisation over the last axis."""

    scale: Floats
    shift: Floats

    @classmethod
    def of(cls, tensors: Mapping[str, Floats], name: str) -> "_Norm":
        return cls(tensors[f"{name}.weight"], tensors[f"{name}.bias"])

    def __call__(self, values: Floats) -> Floats:
        centred = values - values.mean(axis=-1, keepdims=True)
        spread = np.sqrt((centred * centred).mean(axis=-1, keepdims=True) + np.float32(1e-12))
        result: Floats = centred / spread * self.scale + self.shift
        return result


@dataclass(frozen=True)
class _Layer:
    """Self-attention and feed-forward, each added to its input and normalised."""

    query_key_value: _Dense
    joined: _Dense
    attention_norm: _Norm
    wide: _Dense
    narrow: _Dense
    norm: _Norm

    @classmethod
    def of(cls, tensors: Mapping[str, Floats], name: str) -> "_Layer":
        own = f"{name}.attention.self"
        return cls(
            _Dense.of(tensors, f"{own}.query", f"{own}.key", f"{own}.value"),
            _Dense.of(tensors, f"{name}.attention.output.dense"),
            _Norm.of(tensors, f"{name}.attention.output.LayerNorm"),
            _Dense.of(tensors, f"{name}.intermediate.dense"),
            _Dense.of(tensors, f"{name}.output.dense"),
            _Norm.of(tensors, f"{name}.output.LayerNorm"),
        )

    def __call__(self, values: Floats) -> Floats:
        attended = self.attention_norm(values + self.joined(self._attention(values)))
        return self.norm(attended + self.narrow(_gelu(self.wide(attended))))

    def _attention(self, values: Floats) -> Floats:
        length = len(values)
        parts = self.query_key_value(values).reshape(length, 3, HEADS, WIDTH // HEADS)
        query, key, value = parts.transpose(1, 2, 0, 3)
        shares = _softmax(query @ key.transpose(0, 2, 1) / np.float32((WIDTH // HEADS) ** 0.5))
        result: Floats = (shares @ value).transpose(1, 0, 2).reshape(length, WIDTH)
        return result


@dataclass(frozen=True)
class MiniLm:
    """The encoder with its tokenizer."""

    tokenizer: "Tokenizer"
    words: Floats
    positions: Floats
    norm: _Norm
    layers: tuple[_Layer, ...]

    @classmethod
    def load(cls, folder: Path) -> "MiniLm":
        """The model in this folder (``model.safetensors``, ``tokenizer.json``)."""
        from safetensors.numpy import load_file
        from tokenizers import Tokenizer

        tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
        tokenizer.no_padding()
        tokenizer.enable_truncation(LONGEST_TOKENS)
        tensors = load_file(folder / "model.safetensors")
        return cls(
            tokenizer,
            tensors["embeddings.word_embeddings.weight"],
            tensors["embeddings.position_embeddings.weight"] + tensors["embeddings.token_type_embeddings.weight"][0],
            _Norm.of(tensors, "embeddings.LayerNorm"),
            tuple(_Layer.of(tensors, f"encoder.layer.{index}") for index in range(LAYERS)),
        )

    def encode(self, texts: Sequence[str]) -> Floats:
        """Unit vectors of the texts, shape (n, 384); each is computed by itself and does not depend on the others."""
        with ThreadPoolExecutor(MOST_THREADS if len(texts) > 1 else 1) as threads:
            vectors = list(threads.map(self._vector, texts))
        return np.array(vectors, dtype=np.float32).reshape(len(texts), WIDTH)

    def _vector(self, text: str) -> Floats:
        tokens = self.tokenizer.encode(text).ids
        values = self.norm(self.words[tokens] + self.positions[: len(tokens)])
        for layer in self.layers:
            values = layer(values)
        mean = values.mean(axis=0)
        result: Floats = mean / np.linalg.norm(mean)
        return result


def _softmax(values: Floats) -> Floats:
    raised = np.exp(values - values.max(axis=-1, keepdims=True))
    result: Floats = raised / raised.sum(axis=-1, keepdims=True)
    return result


def _gelu(values: Floats) -> Floats:
    from scipy.special import erf

    share: Floats = erf(values * np.float32(0.5**0.5)).astype(np.float32, copy=False)
    return values * np.float32(0.5) * (np.float32(1.0) + share)
