"""Check the English of pages, docstrings and strings against the rules of ``docs/style.md``: ``make english``.

Vale's packages download the program at its first start, which an offline build can't. This script therefore has the few
rules that the project needs, and codespell checks the spelling. ``[tool.check_english]`` in ``pyproject.toml`` lists
the files and how often each construction may occur.
"""

import argparse
import ast
import re
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
CONSTRUCTIONS: Mapping[str, tuple[str, str]] = {
    "beside": (r"\bbeside\b", "next to, with, as well as, near"),
    "nobody": (r"\bnobody\b", "no vehicle, no user, not … anyone"),
    "whom": (r"\bwhom\b", "who, which, that"),
    "whose": (r"\bwhose\b", "with, its, that has"),
    "of which": (r"\bof which\b", "two sentences, or with"),
    "none": (r"(?<!^)\bnone\b(?! of\b)|^none\b(?=.)", "no vehicle, not any, 0"),
    "let alone": (r"\blet alone\b", "a second sentence"),
    "is to be": (r"\b(?:is|are|was|were) to be\b", "must, should, can"),
    "such a": (r"\bsuch an?\b", "this, a … like this"),
    "by what": (r"\bby what\b", "a noun"),
    "what there is": (r"\bwhat there is\b", "a noun"),
    "until then": (r"\buntil then\b", "a time or an event"),
}
"""Constructions that read as translated: for each its pattern, and what to write instead."""
ORDINARY: Mapping[str, re.Pattern[str]] = {
    "whom": re.compile(r"\bwho hit whom\b", re.IGNORECASE),
    "none": re.compile(
        r"\b(?:there (?:is|are)|has|have) none(?=[.,:;)]|$)|\ball or none\b|'none'|(?:^|; )none(?=:)|: none$"
    ),
}
"""Uses of a construction that are ordinary English: a fixed phrase, a clause that ends in *none*, or a value *none*."""
OPENINGS: Mapping[str, tuple[str, str]] = {
    "Whether": (r"Whether\b", "Return whether …, or Return True if …"),
    "By what": (r"(?:By|Of|From|To|With) (?:what|which|whom)\b", "a verb, such as Return …"),
}
"""Beginnings of a function's docstring that are no sentence, with what to write instead."""
_FENCE = re.compile(r"^ *```.*?^ *```", re.DOTALL | re.MULTILINE)
_PART = re.compile(r"\n\s*\n|\n(?= *(?:[-*+]|\d+\.) )|\n(?=#+ )|\n(?=\|)| \| |^\||\|$", re.MULTILINE)
_END = re.compile(r"(?<=[.!?])[\"”’)*_]*\s+(?=[\"“‘(*_\[]*[A-Z0-9])")
_ABBREVIATION = re.compile(r"\b(?:e\.g|i\.e|etc|cf|vs|et al|Fig|Sec|No)\.(?= )")


@dataclass(frozen=True)
class Text:
    """Some prose with its place.

    Args:
        file: relative to the checkout.
        line: where it begins, from 1.
        words: the text on one line, as :func:`plain` returns it.
        opens_function: whether it begins the docstring of a function.
        is_prose: whether its sentences are checked for their length.
        is_cell: whether it is a cell of a table, where semicolons separate the entries of a list.
    """

    file: str
    line: int
    words: str
    opens_function: bool = False
    is_prose: bool = True
    is_cell: bool = False


@dataclass(frozen=True)
class Rules:
    """What to check, as ``[tool.check_english]`` states it.

    Args:
        pages: patterns of Markdown files.
        code: patterns of Python files, with their docstrings, comments and strings.
        without: patterns of files that are left out.
        longest_sentence: most words of a sentence.
        allowed: how often each construction may occur in all files together; 0 if it is not named.
        recorded_after: marks in pages, after which a program wrote the rest.
    """

    pages: tuple[str, ...] = ()
    code: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    longest_sentence: int = 40
    allowed: Mapping[str, int] = field(default_factory=dict)
    recorded_after: tuple[str, ...] = ("<!-- from here on written by",)


@dataclass(frozen=True)
class Fault:
    """A place that breaks a rule."""

    file: str
    line: int
    rule: str
    shown: str
    instead: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.rule}: {self.shown} (write: {self.instead})"


def read_rules(settings: Path = CHECKOUT / "pyproject.toml") -> Rules:
    """Return the rules of the settings file."""
    read = tomllib.loads(settings.read_text(encoding="utf-8"))["tool"]["check_english"]
    return Rules(**{name: tuple(value) if isinstance(value, list) else value for name, value in read.items()})


def texts_of_page(name: str, page: str, recorded_after: Iterable[str] = ()) -> Iterator[Text]:
    """Yield the paragraphs, list items, headings and table cells of a Markdown page, without code and addresses."""
    for mark in recorded_after:
        page = page.partition(mark)[0]
    page = _FENCE.sub(lambda found: "\n" * found[0].count("\n"), page)
    start = 0
    for cut in [*_PART.finditer(page), None]:
        part = page[start : cut.start() if cut else len(page)]
        if words := plain(part):
            begin = start + len(part) - len(part.lstrip())
            is_cell = page.startswith("|", page.rfind("\n", 0, begin) + 1)
            yield Text(name, page.count("\n", 0, begin) + 1, words, is_cell=is_cell)
        start = cut.end() if cut else start


def texts_of_code(name: str, source: str) -> Iterator[Text]:
    """Yield the docstrings and comments of a Python file, and its strings of at least three words."""
    tree = ast.parse(source)
    docstrings: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and (
            words := ast.get_docstring(node)
        ):
            docstrings.add(id(node.body[0].value))  # type: ignore[attr-defined]
            is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            properties = {ast.unparse(one).rpartition(".")[2] for one in getattr(node, "decorator_list", [])}
            opens = is_function and not properties & {"property", "cached_property"}
            parts = [
                part
                for part in re.split(r"\n\s*\n|\n(?= *[\w ,*]+:(?: |$))|\n(?= *(?:[-*]|\d+\.) )|\n(?=[ │]*[├└])", words)
                if part.strip()
            ]
            for number, part in enumerate(parts):
                yield Text(name, node.body[0].lineno, plain(part), opens and number == 0)
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings
        if is_text and len(node.value.split()) >= 3:  # type: ignore[attr-defined,union-attr]
            yield Text(name, node.lineno, plain(str(node.value)), is_prose=False)  # type: ignore[attr-defined]
    for number, line in enumerate(source.splitlines(), 1):
        if comment := re.search(r"(?:^|\s)# (?!type:|noqa|ruff|pragma)(.+)$", line):
            yield Text(name, number, plain(comment[1]), is_prose=False)


def plain(text: str) -> str:
    """Return the text on one line; a piece of code is one word, and a link its text."""
    text = re.sub(r"<!--.*?-->", " ", text, flags=re.DOTALL)
    text = re.sub(r"``.+?``|`[^`]+`", "CODE", text, flags=re.DOTALL)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"https?://\S+|<[^>]+>", " ", text)
    return " ".join(re.sub(r"^[\s>#*+-]+|^\d+\. ", "", text.strip()).split()).strip("| ")


def sentences(text: Text) -> list[str]:
    """Return the sentences of a text, or of a cell the parts between semicolons."""
    whole = _END.split(_ABBREVIATION.sub(lambda found: found[0].replace(".", ""), text.words))
    return [part for one in whole for part in one.split("; ")] if text.is_cell else whole


def length(sentence: str) -> int:
    """Return the number of words: what is between blanks and has a letter or a digit."""
    return sum(any(letter.isalnum() for letter in word) for word in sentence.split())


def faults_of(texts: Iterable[Text], rules: Rules) -> list[Fault]:
    """Return all places that break a rule, without those that are allowed."""
    found: dict[str, list[Fault]] = defaultdict(list)
    faults: list[Fault] = []
    for text in texts:
        for rule, (pattern, instead) in CONSTRUCTIONS.items():
            fine = [use.span() for use in ORDINARY[rule].finditer(text.words)] if rule in ORDINARY else []
            for match in re.finditer(pattern, text.words, re.IGNORECASE if rule != "none" else 0):
                if any(begin <= match.start() and match.end() <= end for begin, end in fine):
                    continue
                shown = text.words[max(match.start() - 30, 0) : match.end() + 30]
                found[rule].append(Fault(text.file, text.line, rule, f"…{shown}…", instead))
        for rule, (pattern, instead) in OPENINGS.items():
            if text.opens_function and re.match(pattern, text.words):
                found[rule].append(Fault(text.file, text.line, rule, text.words[:60], instead))
        if text.is_prose:
            faults += [
                Fault(text.file, text.line, f"{length(one)} words", f"{one[:60]}…", "two sentences")
                for one in sentences(text)
                if length(one) > rules.longest_sentence
            ]
    for rule, places in found.items():
        if len(places) > rules.allowed.get(rule, 0):
            faults += places
    return sorted(faults, key=lambda fault: (fault.file, fault.line))


def files_of(patterns: Iterable[str], without: Iterable[str]) -> list[Path]:
    """Return the files of the checkout that some pattern names and ``without`` doesn't."""
    left_out = {path for pattern in without for path in CHECKOUT.glob(pattern)}
    return sorted({path for pattern in patterns for path in CHECKOUT.glob(pattern) if path.is_file()} - left_out)


def checked_texts(rules: Rules) -> Iterator[Text]:
    """Yield all texts that the rules name."""
    for path in files_of(rules.pages, rules.without):
        name = path.relative_to(CHECKOUT).as_posix()
        yield from texts_of_page(name, path.read_text(encoding="utf-8"), rules.recorded_after)
    for path in files_of(rules.code, rules.without):
        yield from texts_of_code(path.relative_to(CHECKOUT).as_posix(), path.read_text(encoding="utf-8"))


def main() -> None:
    """Print every place that breaks a rule, and exit with 1 if there is one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("patterns", nargs="*", help="files to check instead of those of the settings")
    patterns = parser.parse_args().patterns
    rules = read_rules()
    if patterns:
        pages = tuple(pattern for pattern in patterns if pattern.endswith(".md"))
        code = tuple(pattern for pattern in patterns if pattern.endswith(".py"))
        rules = Rules(pages, code, rules.without, rules.longest_sentence, rules.allowed, rules.recorded_after)
    faults = faults_of(checked_texts(rules), rules)
    for fault in faults:
        sys.stdout.write(f"{fault}\n")
    if faults:
        raise SystemExit(f"{len(faults)} places to rewrite; docs/style.md has the rules")


if __name__ == "__main__":
    main()
