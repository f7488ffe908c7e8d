"""Find manoeuvres in a search text, and turn them into conditions on computed features.

A text ranks by similarity of meaning, and every scenario is slightly similar to every text. The manoeuvres in a
scenario are known exactly, so "truck cuts in" is a condition like any other, and so is "no trucks". A manoeuvre that
the text denies is left to the ranking. If ``tags`` or ``features`` are given, the whole text is left to the ranking.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from ...schemas.text import one_line
from ...schemas.vocabulary import MANOEUVRES
from .bm25 import words_of
from .constraints import Constraint, feature_constraint, obstacle_constraint, obstacle_type_of

_NEAR_WORDS = 4
"""The most words between a manoeuvre and its road user or a denial (chosen)."""
_DENIALS = frozenset({"no", "not", "without", "never", "nobody", "avoid"})
_FRONT = r"\b(?:lead|leader|leading|ahead|preceding|in front)\b"
_BRAKES, _TURNS = r"\bbrak(?:e|es|ing)\b", r"\bturn(?:s|ing)?\b"
_BETWEEN = r"[\w\s-]{0,20}"
"""Up to three words between two that belong together."""
_PATTERNS: tuple[tuple[str, str, bool], ...] = (
    ("cut_in", r"\bcut(?:s|ting)?[\s-]?ins?\b", False),
    ("cut_out", r"\bcut(?:s|ting)?[\s-]?outs?\b", False),
    ("overtaking", r"\bovert(?:ak(?:e|es|ing|en)|ook)\b", False),
    ("unprotected_left", r"\bunprotected\s+left\b", False),
    ("lead_brakes_hard", rf"{_FRONT}{_BETWEEN}{_BRAKES}(?:\s+\w*ly|\s+hard)?", False),
    ("lead_brakes_hard", rf"\b(?:hard|sudden|harsh)\s+{_BRAKES}(?:\s+(?:of|by)\b{_BETWEEN}{_FRONT})?", False),
    ("lead_brakes_hard", rf"{_BRAKES}\s+(?:of|by)\b{_BETWEEN}{_FRONT}", False),
    ("oncoming_turns", rf"\boncoming\b{_BETWEEN}{_TURNS}", False),
    ("ego_turns_back", r"\bu[\s-]?turns?\b", False),
    ("ego_turns_left", rf"\bego\b{_BETWEEN}{_TURNS}\s+left\b", False),
    ("ego_turns_right", rf"\bego\b{_BETWEEN}{_TURNS}\s+right\b", False),
    ("merging", r"\bmerg(?:e|es|ing)\b(?!\s+lanes?\b)", True),
    ("crossing", r"\bcross(?:es\b|ing\b(?=\s+(?:the|its|our|ahead|before|from|in\s+front)\b))", True),
)
"""Features, their patterns in English, and whether the text must contain a road user: roads also merge and cross."""
_ROAD_USERS = frozenset({"vehicle", "vehicles", "traffic", "someone", "people", "person", "road-user", "actor"})
_WORD = re.compile(r"[^\W\d_]+")
_ENDS = r"([^\W\d_]+)(?=\s*(?:[,.;!]|$|\b(?:and|or|nor|but)\b))"
_ABSENT = re.compile(rf"\b(?:no|without)\s+(?:any\s+)?{_ENDS}", re.IGNORECASE)
_NOR = re.compile(rf"\s*,?\s*\b(?:or|nor|and)\s+(?:no\s+|any\s+)*{_ENDS}", re.IGNORECASE)
"""A denied road user and further ones. Another word after them, as in "no car ahead", denies something else."""


@dataclass(frozen=True)
class TextConditions:
    """The conditions that a text contains, and the rest of the text."""

    constraints: tuple[Constraint, ...]
    rest: str


def manoeuvres_in(text: str) -> tuple[str, ...]:
    """Return the features that a text mentions, such as ``cut_in:truck``."""
    return tuple(_with_road_user(feature, text, begin, end)[0] for feature, begin, end in _mentions(text))


def conditions_in_text(text: str) -> TextConditions:
    """Return the conditions on manoeuvres that a text mentions; each condition's note quotes the words."""
    found: dict[str, Constraint] = {}
    rest = text
    for feature, begin, end in _mentions(text):
        name, first, last = _with_road_user(feature, text, begin, end)
        quoted_words = one_line(text[first:last])
        note = f"'{quoted_words}' in the text is read as features={name}."
        found.setdefault(name, replace(feature_constraint(name), note=note))
        rest = rest.replace(text[begin:end], " ", 1)
    typed = {name.partition(":")[0] for name in found if ":" in name}
    kept = [one for name, one in found.items() if ":" in name or name not in typed]
    for kind, words in _absent_types(text):
        note = f"'{one_line(words)}' in the text is read as obstacles=!{kind}."
        kept.append(replace(obstacle_constraint(f"!{kind}"), note=note))
        rest = rest.replace(words, " ", 1)
    return TextConditions(tuple(kept), rest)


def _absent_types(text: str) -> Iterator[tuple[str, str]]:
    """Yield each type of road user that the text excludes, and the words that do so, such as ``no trucks``."""
    found: dict[str, str] = {}
    for match in _ABSENT.finditer(text):
        listed: dict[str, str] = {}
        further: re.Match[str] | None = match
        end = match.end()
        while further is not None and (kind := _type_of(further[1])) is not None:
            listed.setdefault(kind, further[0])
            end = further.end()
            further = _NOR.match(text, end)
        if not re.match(r"\s*(?:or|nor)\b", text[end:], re.IGNORECASE):  # "no cars or buses ahead" is about the lane
            found = listed | found
    yield from found.items()


def _mentions(text: str) -> Iterator[tuple[str, int, int]]:
    """Yield the features that a text mentions and does not deny, with the position of their words, each once."""
    taken: list[tuple[int, int]] = []
    for feature, pattern, needs_road_user in _PATTERNS:
        for match in re.finditer(pattern, text, re.IGNORECASE):
            begin, end = match.span()
            before = words_of(text[:begin])[-_NEAR_WORDS:]
            if any(begin < other_end and other_begin < end for other_begin, other_end in taken):
                continue
            if _DENIALS & set(before):
                continue
            if needs_road_user and not any(_is_road_user(word) for word in before):
                continue
            taken.append((begin, end))
            yield feature, begin, end


def _is_road_user(word: str) -> bool:
    return word in _ROAD_USERS or obstacle_type_of(word) is not None


def _with_road_user(feature: str, text: str, begin: int, end: int) -> tuple[str, int, int]:
    """Return the feature, with the type of a road user that the text mentions, and their position in the text.

    The road user's word is within the manoeuvre's words, before them, or after them following "by", "of" or "from".
    """
    if feature not in MANOEUVRES:
        return feature, begin, end
    before = list(_WORD.finditer(text, 0, begin))[-_NEAR_WORDS:]
    behind = re.compile(r"\s+(?:by|of|from)\s+(?:(?:an?|the)\s+)?([^\W\d_]+)").match(text, end)
    places = [
        *((word.group(), begin, end) for word in _WORD.finditer(text, begin, end)),
        *((word.group(), word.start(), end) for word in reversed(before)),
        *([(behind.group(1), begin, behind.end())] if behind else []),
    ]
    named = ((kind, first, last) for word, first, last in places if (kind := _type_of(word)))
    kind, first, last = next(named, ("", begin, end))
    return f"{feature}:{kind}" if kind else feature, first, last


def _type_of(word: str) -> str | None:
    return obstacle_type_of(word) if len(word) > 2 and word.casefold() != "emergency" else None
