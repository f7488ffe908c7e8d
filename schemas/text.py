"""Text from outside (a caller's, a file's, a name on a disk), made fit for answers, errors, logs and journals.

Such text is data: it may hold line breaks that forge lines of an answer, characters that turn its direction, or a
megabyte. What repeats it does so through :func:`quoted` or :func:`one_line`.
"""

import re
import unicodedata
from collections.abc import Iterable
from typing import Any

LONGEST_TEXT = 200
"""Characters of a text from outside that are repeated; chosen: names and ids are shorter."""
_PRINTED_BITS = 128
"""Larger whole numbers are not printed; chosen: no id or time has as many."""


def printable(text: str, kept: str = "\n\t") -> str:
    """The text without control, zero-width and direction characters, but for those of ``kept``."""
    if text.isprintable():
        return text
    parts = (
        re.split(f"([{re.escape(kept)}])", text) if kept else [text]
    )  # mostly printable lines, which stay as they are
    return "".join(part if part.isprintable() or part in kept else "".join(filter(_is_shown, part)) for part in parts)


def one_line(text: str, longest: int = LONGEST_TEXT) -> str:
    """The text on one line, printable, its spaces single; what is longer than ``longest`` characters ends in ``…``."""
    read = text[: 4 * longest]
    line = " ".join(printable(" ".join(read.split()), kept="").split())
    return line if len(line) <= longest and read == text else line[: longest - 1].rstrip() + "…"


def quoted(value: Any, longest: int = LONGEST_TEXT) -> str:
    """A value from outside as an error repeats it: text in quotation marks; of a list or mapping, only its size."""
    if isinstance(value, dict | list | tuple | set):
        return f"a {'mapping' if isinstance(value, dict) else 'list'} of {len(value):,}"
    if isinstance(value, int) and value.bit_length() > _PRINTED_BITS:
        return "a whole number of too many digits"
    if value is None or isinstance(value, int | float):
        return str(value)
    return "'" + one_line(str(value), longest).replace("'", "’") + "'"


def counted(count: int, noun: str) -> str:
    """A number with its noun, ``16 buses``; obstacle types of two words are written apart."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", noun).lower() if noun.isalpha() else noun
    if count == 1:
        return f"1 {words}"
    ending = "es" if words.endswith(("s", "x", "ch", "sh")) else "s"
    is_regular = not (words.endswith("y") and words[-2:-1] not in "aeiou")
    return f"{count:,} {words}{ending}" if is_regular else f"{count:,} {words[:-1]}ies"


def in_any_case(value: Any, words: Iterable[str]) -> Any:
    """The word that a text is in another case or among spaces; else the value as it is, for others to refuse."""
    if not isinstance(value, str):
        return value
    return next((word for word in words if word.lower() == value.strip().lower()), value)


def _is_shown(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"
