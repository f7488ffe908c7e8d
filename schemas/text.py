"""Make text from outside (a caller's, a file's, a name on a disk) safe for answers, errors, logs and journals.

Such text is data. It may contain line breaks that forge lines of an answer, characters that reverse its direction, or a
megabyte. Use one of these functions to repeat such text:

- :func:`cited`: text of a file, a map service, an archive or a program. It appears in ``“…”``, a mark that nothing else
  in an answer uses and that the text cannot close (docs/threat_model.md).
- :func:`shown_name`: a name that calls accept. It appears bare if it has the form of a name, otherwise cited.
- :func:`quoted`: text of the call itself, which a refusal repeats in ``'…'``.
- :func:`one_line`: text that is its own field in a structured answer, or that is cited later.
"""

import re
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Any

LONGEST_TEXT = 200
"""The maximum length of repeated text from outside, in characters (chosen: names and ids are shorter)."""
OPENING, CLOSING = "“", "”"
"""The mark around text from outside. Our own English uses ``'`` and ``"``, so the two cannot be confused."""
_INNER = str.maketrans({OPENING: "‘", CLOSING: "’"})
"""Inside the mark, the mark itself becomes single quotes, so that nothing inside can close it."""
_NAME = re.compile(
    r"[A-Za-z0-9_][\w.:@#+/-]{0,79}"  # an id, a file's name, a weight, or planner:preset
    r"(?: \[[A-Za-z_]\w{0,59}=[\w.+-]{1,30}(?:, [A-Za-z_]\w{0,59}=[\w.+-]{1,30}){0,11}(?:, \d+ more)?\])?"
    # what a configuration changes of its preset
    r"(?: [\w.:@+-]{1,30})?(?: \([\w.:@+-]{1,30}\))?",  # a version with its digest, or the id of a result
    re.ASCII,
)
"""The form of names that answers print bare: without blanks, like ids, and as this program composes them."""
_PRINTED_BITS = 128
"""Larger whole numbers are not printed (chosen: no id or time is this large)."""


def printable(text: str, kept: str = "\n\t") -> str:
    """Return the text without control, zero-width and direction characters, except those in ``kept``."""
    if text.isprintable():
        return text
    parts = (
        re.split(f"([{re.escape(kept)}])", text) if kept else [text]
    )  # mostly printable lines, which stay as they are
    return "".join(part if part.isprintable() or part in kept else "".join(filter(_is_shown, part)) for part in parts)


def one_line(text: str, longest: int = LONGEST_TEXT) -> str:
    """Return the text on one printable line with single spaces; longer text than ``longest`` ends in ``…``."""
    read = text[: 4 * longest]
    line = " ".join(printable(" ".join(read.split()), kept="").split())
    if len(line) <= longest and read == text:
        return line
    kept = line[: longest - 1].rstrip()
    if _is_open(kept):  # the cut is inside a mark, which is closed
        kept = line[: longest - 2].rstrip()
        return kept + "…" + CLOSING * _is_open(kept)
    return kept + "…"


def cited(text: object, longest: int = LONGEST_TEXT) -> str:
    """Return text from outside as an answer prints it: marked, on one line, at most ``longest`` characters.

    Direction and control characters are removed, and a mark inside becomes single quotes. A list or mapping is replaced
    by its size.
    """
    if isinstance(text, dict | list | tuple | set):
        return _size(text)
    return OPENING + one_line(str(text)[: 4 * longest + 1].translate(_INNER), longest) + CLOSING


def cited_all(texts: Iterable[object], between: str = ", ") -> str:
    """Return several texts from outside, each in its own mark."""
    return between.join(map(cited, texts))


def shown_name(name: object, longest: int = LONGEST_TEXT) -> str:
    """Return a name that calls accept: bare if it has the form of this program's ids and names, otherwise cited."""
    text = str(name)
    return text if len(text) <= longest and _NAME.fullmatch(text) else cited(text, longest)


def cited_parts(value: Any) -> Any:
    """Return a JSON value for a text, with each of its texts cited unless it is one printable word."""
    if isinstance(value, dict):
        return {cited_parts(key): cited_parts(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [cited_parts(part) for part in value]
    if not isinstance(value, str):
        return value
    is_word = len(value) <= LONGEST_TEXT and value.isprintable() and not re.search(f"[ {OPENING}{CLOSING}]", value)
    return value if is_word else cited(value)


def printable_parts(value: Any) -> Any:
    """Return a JSON value with printable texts. Line breaks and tabs stay."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [printable_parts(part) for part in value]
    if isinstance(value, dict):
        return {printable(key): printable_parts(part) for key, part in value.items()}
    return value


def in_one_line(value: Any) -> Any:
    """Return a JSON value with each of its texts on one line, without control and direction characters."""
    if isinstance(value, str):
        return value if value.isprintable() else " ".join(printable(" ".join(value.split()), kept="").split())
    if isinstance(value, dict):
        return {in_one_line(key): in_one_line(part) for key, part in value.items()}
    if isinstance(value, list):
        return [in_one_line(part) for part in value]
    return value


def uncited(text: str) -> str:
    """Return a text without the marks around text from outside, so that a call can repeat the text of an answer."""
    return re.sub(f"{OPENING}([^{OPENING}{CLOSING}]*){CLOSING}", r"\1", text)


def quoted(value: Any, longest: int = LONGEST_TEXT) -> str:
    """Return a value in a call as repeated in an error: text in quotation marks, or the size of a list or mapping."""
    if isinstance(value, dict | list | tuple | set):
        return _size(value)
    if isinstance(value, int) and value.bit_length() > _PRINTED_BITS:
        return "a whole number of too many digits"
    if value is None or isinstance(value, int | float):
        return str(value)
    return "'" + one_line(str(value), longest).replace("'", "’") + "'"


def without_shared_clauses(sentences: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return sentences without the clauses that all of them share, and these clauses.

    Clauses are separated by semicolons outside of brackets. The first clause of a sentence always stays.
    """
    parts = [re.split(r"; (?![^(]*\))", sentence) for sentence in sentences]
    if len(parts) < 2:
        return list(sentences), []
    shared = [clause for clause in parts[0][1:] if all(clause in other[1:] for other in parts[1:])]
    return ["; ".join([part[0], *(clause for clause in part[1:] if clause not in shared)]) for part in parts], shared


REFERENCE_DRIVERS_DO = (
    "full braking; UN regulation R157's careful and fuzzy drivers and Responsibility-Sensitive Safety, which keep the "
    "ego's speed until they see a danger"
)
"""The drivers of a verdict and what they do, for each statement that no driver prevents a collision."""
RISK_SCALE, RISK_UNIT = "0 = collision, 5 = negligible", "of 5"
_LATER_EXPLANATION = re.compile(rf" \((?:{re.escape(REFERENCE_DRIVERS_DO)}|{re.escape(RISK_SCALE)})[^()]*\)")


def stated_once(text: str) -> str:
    """Return the text of an answer in which each of these explanations in brackets appears only the first time."""
    found: set[str] = set()

    def kept(match: re.Match[str]) -> str:
        explanation = next(one for one in (REFERENCE_DRIVERS_DO, RISK_SCALE) if one in match[0])
        is_new = explanation not in found
        found.add(explanation)
        return match[0] if is_new else ""

    return _LATER_EXPLANATION.sub(kept, text)


def is_utf8(text: str) -> bool:
    """Return whether a text can be encoded as UTF-8. Linux allows file names that cannot, but answers do not."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


_CLASS_NOUNS = {"delivery": "delivery van", "emergency": "emergency vehicle", "unknown": "road user of unknown type"}
"""Nouns for the vehicle classes and obstacle types that are not nouns for a road user."""


def class_noun(name: str) -> str:
    """Return the noun for a vehicle class or obstacle type, such as ``delivery van`` or ``parked vehicle``."""
    noun = _CLASS_NOUNS.get(name, name)
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", noun).lower() if noun.isalpha() else noun


def enumerated(names: Sequence[str]) -> str:
    """Return names as a phrase: ``a``, ``a and b`` or ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, such as ``16 buses``; obstacle types of two words are split."""
    return f"1 {class_noun(noun)}" if count == 1 else f"{count:,} {plural(noun)}"


def plural(noun: str) -> str:
    """Return the plural of a noun, such as ``buses``; obstacle types of two words are split."""
    words = class_noun(noun)
    words, of, kind = words.partition(" of ")
    if words.endswith("y") and words[-2:-1] not in "aeiou":
        return f"{words[:-1]}ies{of}{kind}"
    return f"{words}{'es' if words.endswith(('s', 'x', 'ch', 'sh')) else 's'}{of}{kind}"


_LONGEST_NUMBER = 1e7
"""Figures below this are written out in full."""
_ROUNDING = 1e-9
"""Smaller values are rounding errors."""
RESOLUTION = 5e-4
"""Half of the finest displayed step of measured quantities, 0.001 in their unit; smaller values appear as 0."""
_SMALLEST_P = 1e-12
"""Smaller p values are stated as a bound, because sums of double-precision numbers do not resolve them."""


def figure(value: float | None, digits: int = 3) -> str:
    """Return a number to ``digits`` significant digits; a large number as an integer, 0 below 1e-9, a dash for None."""
    if value is None:
        return "–"
    if abs(value) < _ROUNDING:
        return "0"
    return f"{value:.0f}" if 10**digits <= abs(value) < _LONGEST_NUMBER else f"{value:.{digits}g}"


def measured(value: float | None, digits: int = 3) -> str:
    """Return a measured quantity as :func:`figure` writes it, and 0 below its resolution."""
    return figure(0.0 if value is not None and abs(value) < RESOLUTION else value, digits)


def signed(value: float) -> str:
    """Return a number with its sign to one decimal, and 0 without either."""
    shown = f"{value:+.1f}"
    return "0" if float(shown) == 0 else shown


def p_figure(p: float | None) -> str:
    """Return a p value, or the bound ``<1e-12``, because no sample shows that something is impossible."""
    if p is None:
        return "–"
    return f"<{_SMALLEST_P:g}" if p < _SMALLEST_P else f"{p:.3g}"


def p_in_words(p: float | None) -> str:
    """Return text such as ``p=0.031`` or ``p<1e-12``."""
    shown = p_figure(p)
    return "no test" if p is None else f"p{shown}" if shown.startswith("<") else f"p={shown}"


def in_any_case(value: Any, words: Iterable[str]) -> Any:
    """Return the word that equals a text apart from case and spaces; otherwise the value itself, which is refused
    later.
    """
    if not isinstance(value, str):
        return value
    return next((word for word in words if word.lower() == value.strip().lower()), value)


def _is_open(text: str) -> bool:
    """Return whether a mark begins in a text and does not end in it."""
    return text.count(OPENING) > text.count(CLOSING)


def _is_shown(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"


def _size(value: "dict[Any, Any] | list[Any] | tuple[Any, ...] | set[Any]") -> str:
    return f"a {'mapping' if isinstance(value, dict) else 'list'} of {len(value):,}"
