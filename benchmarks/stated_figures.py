"""Checks that each figure in the text of an answer is also in its structured content, by one rule without any English.

A figure is a number by itself in a text, not a part of a name, an id, an address or a word. It is known if a field
holds it, rounded to the digits shown. The text may show a value as a percentage, without its sign, or as the length of
a list. It may state the number of omitted entries: a length or a whole number of the fields, minus the names in the
line or the items that the lines list. It may repeat the arguments of the call. If a sentence is a field itself, such as
the statement of a finding, its figures must be next to it, in the same object. Any other figure is unknown: either the
text says more than the fields, or one of them is wrong.

Other judges recompute the fields themselves.
"""

import re
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

NAME_KEYS = frozenset(
    ["unit", "source", "label", "name", "before", "after", "planner_version", "config_name", "reason", "next_step"]
)
"""Fields with digits that are no figures of the answer: names, data stored with a run, and the next call."""
CONSTANTS = (0.0, 5.0, 10.0, 95.0)
"""Figures in texts that no field holds: the ends of the risk scale, the seconds that measures look ahead, the least
difference of rates in points (``docs/statistics.md``), and the level of every interval in percent.
"""
_FIGURE = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_BETWEEN = re.compile(r"(?<!\d),|,(?!\d{3}(?!\d))|\.\.|[.?!](?=\s|$)|[\s()\[\]{};\"'“”‘’|<>=≥≤≈×→–/…:%*~&#·]+")


def agrees(shown: str, value: float | None) -> bool:
    """Return True if a figure is a value rounded to the digits shown, either way if it is between."""
    return value is not None and abs(_value_of(shown) - value) <= _half_a_unit(shown)


def _value_of(shown: str) -> float:
    return float(shown.replace(",", "").replace("−", "-"))


def _half_a_unit(shown: str) -> float:
    mantissa, _, exponent = shown.replace(",", "").partition("e")
    return float(0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])) * (1 + 1e-6))


def figures_in(text: str, names: re.Pattern[str] | None = None) -> list[str]:
    """Return the numbers by themselves in a text, without those in the names that a pattern finds."""
    rest = text if names is None else names.sub(" ", text)
    tokens = (token.replace(",", "") for token in _BETWEEN.split(rest) if token)
    return [token for token in tokens if _FIGURE.fullmatch(token)]


def numbers_in(content: Any) -> Iterator[float]:
    """Yield the numbers of structured content, those that are keys too, and the lengths of its lists."""
    if isinstance(content, bool) or content is None:
        return
    if isinstance(content, int | float):
        yield float(content)
    elif isinstance(content, Mapping):
        for key, part in content.items():
            yield from numbers_in(key)
            yield from numbers_in(part)
    elif isinstance(content, str) and _FIGURE.fullmatch(content):
        yield _value_of(content)
    elif isinstance(content, list | tuple):
        yield float(len(content))
        for part in content:
            yield from numbers_in(part)


def texts_in(content: Any, key: str = "", around: Any = None) -> Iterator[tuple[str, str, Any]]:
    """Yield each text of structured content with its key and the object that it is a field of."""
    if isinstance(content, str):
        yield key, content, around
    elif isinstance(content, Mapping):
        for name, part in content.items():
            yield from texts_in(name, "name_id", content)
            yield from texts_in(part, name, content)
    elif isinstance(content, list | tuple):
        for part in content:
            yield from texts_in(part, key, around)


class ContentNumbers:
    """The numbers of some structured content, to be looked up as they are shown."""

    def __init__(self, *contents: Any) -> None:
        found = {number for content in contents for number in numbers_in(content)}
        self._whole = sorted(number for number in found if number == int(number))
        shown = {abs(form) for number in found for form in (number, 100 * number)} | set(CONSTANTS)
        self._shown = sorted(shown)

    def has(self, figure: str) -> bool:
        """Return True if one of them is the figure, rounded to its digits."""
        value, half = abs(_value_of(figure)), _half_a_unit(figure)
        place = bisect_left(self._shown, value - half)
        return place < len(self._shown) and self._shown[place] <= value + half

    def has_rest(self, figure: str, named: Collection[int]) -> bool:
        """Return True if a whole figure and the number of named entries add up to one of them."""
        if not figure.lstrip("+").isdigit():
            return False
        return any(_is_in(self._whole, _value_of(figure) + count) for count in named if count)


def _is_in(numbers: Sequence[float], value: float) -> bool:
    place = bisect_left(numbers, value)
    return place < len(numbers) and numbers[place] == value


def names_of(*contents: Any) -> re.Pattern[str] | None:
    """Return a pattern of the names in structured content that hold a digit, the longest first; None without any."""
    found = {
        text
        for content in contents
        for key, text, _ in texts_in(content)
        if any(map(str.isdigit, text)) and (_is_name_key(key) or not re.search(r"\s", text))
    }
    names = sorted((name for name in found if not _FIGURE.fullmatch(name)), key=len, reverse=True)
    return re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, names))})(?!\w)") if names else None


def _is_name_key(key: str) -> bool:
    return key in NAME_KEYS or key.endswith(("_id", "_ids", "_run"))


def unknown_in_text(text: str, content: Any, asked: Any = None) -> list[str]:
    """Return the figures of an answer's text that neither its fields nor its arguments hold, each with its line."""
    names, found, items, lines = names_of(content, asked), list[str](), 0, text.splitlines()
    listed = sum(line.startswith("- ") for line in lines)
    sentences = [figure for told in _sentences(content) for figure in figures_in(told, names)]
    held = ContentNumbers(content, asked, [_value_of(figure) for figure in sentences])
    for line in lines:
        named = _count_names(line)
        items = items + 1 if line.startswith("- ") else items
        for figure in figures_in(line, names):
            if not held.has(figure) and not held.has_rest(figure, (*range(1, named + 1), items, listed)):
                found.append(f"{figure} in: {line}")
    return found


def unknown_in_fields(content: Any, asked: Any = None) -> list[str]:
    """Return the figures of sentences that are fields and that the objects around them do not hold."""
    names, found = names_of(content, asked), list[str]()
    for key, text, around in texts_in(content):
        figures = [] if _is_name_key(key) or _FIGURE.fullmatch(text) else figures_in(text, names)
        if figures:
            held, named = ContentNumbers(around, asked), _count_names(text)
            unknown = [one for one in figures if not held.has(one) and not held.has_rest(one, range(1, named + 1))]
            found += [f"{figure} in {key}: {text}" for figure in unknown]
    return found


def _count_names(text: str) -> int:
    """Return how many words of a text are ids, such as ``run_a1b2`` and ``ZAM_Zip-1_1_T-1``."""
    return sum(bool(re.search(r"[A-Za-z]\w*[_-]", token) and re.search(r"\d", token)) for token in _BETWEEN.split(text))


def count_of(text: str, content: Any, asked: Any = None) -> int:
    """Return how many figures a text and the sentences among its fields hold."""
    names = names_of(content, asked)
    return sum(len(figures_in(told, names)) for told in (*text.splitlines(), *_sentences(content)))


def _sentences(content: Any) -> Iterator[str]:
    """Yield the texts of fields that are no names."""
    return (text for key, text, _ in texts_in(content) if not _is_name_key(key) and not _FIGURE.fullmatch(text))
