"""The commands and tool calls that documentation pages show."""

import json
import re
import shlex
from collections.abc import Iterator
from typing import Any

from .tree import CHECKOUT

PAGES = [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
SHELLS = {"", "bash", "sh", "console"}
PROGRAM = re.compile(r"^(?:\$ )?(?:[A-Z_]+=\S+ +)*(?:\.venv/bin/|exec )?(plannerforge (?!\[).*)$")
"""A line that begins with the program, behind a prompt and variables."""
Shown = tuple[str, str]
"""The name of a page and a command that stands there."""


def shown_commands() -> list[Shown]:
    """Return every command in a block of a page, one per line, without shell redirections."""
    found: list[Shown] = []
    for page in PAGES:
        name = page.relative_to(CHECKOUT).as_posix()
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if language in SHELLS:
                parts = [part.strip() for line in _whole_lines(text) for part in re.split(r" && | \| ", line)]
                found += [(name, match[1]) for part in parts if (match := PROGRAM.match(part))]
    return found


def _whole_lines(text: str) -> Iterator[str]:
    """Return the lines of a shell, joined if a backslash or an open quotation mark continues them."""
    lines = iter(re.sub(r"\\\n\s*", " ", text).splitlines())
    for line in lines:
        while (
            PROGRAM.match(line) and line.partition(" #")[0].count("'") % 2 and (more := next(lines, None)) is not None
        ):
            line += f" {more.strip()}"
        yield line


def inline_commands() -> list[Shown]:
    """Return every command in running text."""
    return [
        (page.relative_to(CHECKOUT).as_posix(), text)
        for page in PAGES
        for text in re.findall(r"`(plannerforge [a-z][^`\n]*)`", BLOCK.sub("", page.read_text(encoding="utf-8")))
    ]


def shown_calls() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Return every tool call: page, tool, arguments."""
    for page, command in shown_commands():
        words = words_of(command)
        if words[1] == "call":
            positional = [word for word in words[2:] if not word.startswith("--")]
            yield page, positional[0], json.loads(positional[1]) if len(positional) > 1 else {}
    for page in PAGES:
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            for line in text.splitlines() if language == "json" else ():
                if line.startswith('{"tool"'):
                    call = json.loads(line)
                    yield page.relative_to(CHECKOUT).as_posix(), call["tool"], call["arguments"]


def words_of(command: str) -> list[str]:
    words = shlex.split(re.sub(r"\s+(>>?|2>)\s.*$", "", command), comments=True)
    return words[: words.index(">")] if ">" in words else words
