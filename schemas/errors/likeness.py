"""How similar a word is to valid names: which of them it may misspell, and which are nearest to it."""

import re
from collections.abc import Iterable

from ..text import one_line

_ALIKE, _ALIKE_IDS = 75.0, 90.0
"""The minimum similarity (in percent, as :func:`likeness`) of a word to the name that it may misspell (chosen).

Ids share fixed parts and digits by chance, so they must be almost equal."""
_ID = re.compile(r"[a-z]+_[0-9a-f]{12}|[A-Z]{3}_[\w-]+_T-\d+")
"""An id of random digits, or the benchmark id of a CommonRoad scenario."""
_SHORTEST_PART = 4
"""A word of at least this length that is part of a valid name may mean that name (chosen)."""
_COMPARED = 2000
"""How many known words a word is compared with (chosen: at 200 characters each, this takes under 0.1 s)."""


def likeness(word: str, name: str) -> float:
    """Return the similarity of two words in percent: the share of letters in common, in order.

    Case and punctuation are ignored, and only the first 200 characters are compared.
    """
    from rapidfuzz import fuzz

    asked, known = _compared(word), _compared(name)
    return float(fuzz.ratio(asked, known)) if asked and known else 0.0


def misspelt_names(word: str, names: Iterable[str]) -> list[str]:
    """Return the names that a word may misspell or abbreviate, the most similar first; never the word itself.

    A word without a letter misspells no name, because a different number means a different thing.
    """
    if not any(letter.isalpha() for letter in word):
        return []
    scored = [(likeness(word, name), name) for name in names if name != word]
    alike = [(score, name) for score, name in scored if score >= _least(name) or _is_part(word, name)]
    return [name for _, name in sorted(alike, key=lambda pair: -pair[0])]


def closest(word: str, known: Iterable[str], limit: int | None = None) -> list[str]:
    """Return known words, the most similar to ``word`` first (case and punctuation ignored).

    Likely misspellings of a whole name precede names that contain the word; of those, the shorter ones come first.

    Args:
        word: the wrong word.
        known: the valid words. The first 2,000 are compared, so that no number of names slows down the server; the
            others follow in their order, so the result has all words.
        limit: how many words to return; all by default.
    """
    from rapidfuzz import fuzz, process

    words = list(known)
    scored = process.extract(word, words[:_COMPARED], scorer=fuzz.WRatio, processor=_compared, limit=None)
    whole = {name: likeness(word, name) for name, _, _ in scored}
    alike = {name: ratio if ratio >= _ALIKE else 0.0 for name, ratio in whole.items()}
    ranked = sorted(scored, key=lambda found: (-alike[found[0]], -round(found[1]), len(found[0])))
    return [*(name for name, _, _ in ranked), *words[_COMPARED:]][:limit]


def _compared(text: str) -> str:
    from rapidfuzz import utils

    return utils.default_process(one_line(text))


def _least(name: str) -> float:
    return _ALIKE_IDS if _ID.fullmatch(name) else _ALIKE


def _is_part(word: str, name: str) -> bool:
    asked = word.strip().lower()
    return len(asked) >= _SHORTEST_PART and asked in re.split(r"[^a-z]+", name.lower())
