"""Tokens of a text as the o200k_base encoding counts them."""

from functools import cache
from typing import Any

_PIECE = 20_000
"""Characters that are counted at a time: the library takes no text of more than 200,000 tokens, and holds the
interpreter while it counts. Chosen."""


def count_tokens(text: str) -> int:
    """Number of o200k_base tokens; of a text of more than 20,000 characters, up to a token more for each 20,000."""
    pieces = (text[start : start + _PIECE] for start in range(0, len(text), _PIECE))
    return sum(len(_encoding().encode(piece)) for piece in pieces)


def has_tables() -> bool:
    """Whether the tables of the encoding have been read, which takes about a second and holds the interpreter."""
    return _encoding.cache_info().currsize > 0


@cache
def _encoding() -> Any:
    import bpe_openai

    return bpe_openai.get_encoding("o200k_base")
