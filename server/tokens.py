"""Tokens of a text as the o200k_base encoding counts them."""

from functools import cache
from typing import Any


def count_tokens(text: str) -> int:
    """Number of o200k_base tokens."""
    return len(_encoding().encode(text))


@cache
def _encoding() -> Any:
    import bpe_openai

    return bpe_openai.get_encoding("o200k_base")
