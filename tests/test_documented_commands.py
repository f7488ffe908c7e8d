"""Commands and calls that the pages show are such that the program takes them."""

import json
import re
import shlex
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer
from support.tree import CHECKOUT

from plannerforge.evals.command_line import application
from plannerforge.schemas.base import Arguments
from plannerforge.schemas.planning import CommandPlanner
from plannerforge.server.commands.suite import read_suite
from plannerforge.tools.analysis.suite import limits_of
from plannerforge.tools.registry import TOOLS

PAGES = [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
SHELLS = {"", "bash", "sh", "console"}
PROGRAM = re.compile(r"^(?:\$ )?(?:[A-Z_]+=\S+ +)*(?:\.venv/bin/|exec )?(plannerforge (?!\[).*)$")
"""A line that begins with the program, behind a prompt and variables."""
Shown = tuple[str, str]
"""The name of a page and a command that stands there."""


def shown_commands() -> list[Shown]:
    """Every command of the program in a block of a page, a line each, without what a shell makes of its output."""
    found: list[Shown] = []
    for page in PAGES:
        name = page.relative_to(CHECKOUT).as_posix()
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if language in SHELLS:
                parts = [part.strip() for line in _whole_lines(text) for part in re.split(r" && | \| ", line)]
                found += [(name, match[1]) for part in parts if (match := PROGRAM.match(part))]
    return found


def _whole_lines(text: str) -> Iterator[str]:
    """The lines of a shell, each with those that a backslash or an open quotation mark continues it on."""
    lines = iter(re.sub(r"\\\n\s*", " ", text).splitlines())
    for line in lines:
        while (
            PROGRAM.match(line) and line.partition(" #")[0].count("'") % 2 and (more := next(lines, None)) is not None
        ):
            line += f" {more.strip()}"
        yield line


def inline_commands() -> list[Shown]:
    """Every command of the program that is named in running text."""
    return [
        (page.relative_to(CHECKOUT).as_posix(), text)
        for page in PAGES
        for text in re.findall(r"`(plannerforge [a-z][^`\n]*)`", BLOCK.sub("", page.read_text(encoding="utf-8")))
    ]


def shown_calls() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Every call of a tool: page, tool, arguments."""
    for page, command in shown_commands():
        words = _words(command)
        if words[1] == "call":
            positional = [word for word in words[2:] if not word.startswith("--")]
            yield page, positional[0], json.loads(positional[1]) if len(positional) > 1 else {}
    for page in PAGES:
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            for line in text.splitlines() if language == "json" else ():
                if line.startswith('{"tool"'):
                    call = json.loads(line)
                    yield page.relative_to(CHECKOUT).as_posix(), call["tool"], call["arguments"]


def _words(command: str) -> list[str]:
    words = shlex.split(re.sub(r"\s+(>>?|2>)\s.*$", "", command), comments=True)
    return words[: words.index(">")] if ">" in words else words


def fault(words: Sequence[str]) -> str:
    """What the command line has against words, empty where it takes them; whether files are there is not looked at."""
    command, rest = typer.main.get_command(application), list(words[1:])
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        if rest[0] not in command.commands:
            return f"no command {rest[0]!r} among {sorted(command.commands)}"
        command = command.commands[rest.pop(0)]
    try:
        command.make_context("plannerforge", rest)
    except typer.Exit:
        return ""
    except Exception as error:  # noqa: BLE001 - typer has a click of its own, whose errors bear no public name
        told = str(getattr(error, "message", "")) or str(error)
        return "" if "does not exist" in told else told
    return ""


@pytest.mark.parametrize(("page", "command"), dict.fromkeys(shown_commands()), ids=lambda text: text[:60])
def test_a_shown_command_is_one_that_the_program_takes(page: str, command: str) -> None:
    assert fault(_words(command)) == ""


@pytest.mark.parametrize(("page", "command"), dict.fromkeys(inline_commands()), ids=lambda text: text[:60])
def test_a_named_command_and_its_options_exist(page: str, command: str) -> None:
    """What is cut with an ellipsis, or says ``a | b``, is looked at as far as it goes."""
    known = command.replace("[", "").replace("]", "").replace('"…"', "…").partition("…")[0].partition(" | ")[0]
    told = fault(shlex.split(known))
    assert not told or "issing" in told


@pytest.mark.parametrize(("page", "tool", "arguments"), list(shown_calls()), ids=lambda part: str(part)[:60])
def test_a_shown_call_has_arguments_that_the_tool_takes(page: str, tool: str, arguments: dict[str, Any]) -> None:
    spec = next((spec for spec in TOOLS if spec.name == tool), None)
    assert spec is not None, f"there is no tool {tool}"
    model: type[Arguments] = spec.arguments_type
    model.model_validate_json(json.dumps(arguments))


@pytest.mark.parametrize(
    "command",
    [
        "plannerforge fly",
        "plannerforge serve --wings",
        "plannerforge maps ad town.osm",
        "plannerforge serve --port many",
        "plannerforge call render {} more",
    ],
)
def test_a_command_that_the_program_does_not_take_is_seen(command: str) -> None:
    assert re.search(r"No such option|no command|not a valid|valid integer|unexpected extra", fault(_words(command)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(CHECKOUT).as_posix())
def test_every_block_of_json_is_json(page: Path) -> None:
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language == "json":
            for part in text.splitlines() if text.startswith('{"tool"') else [text]:
                json.loads(part)


def blocks_of(language: str) -> list[tuple[str, str]]:
    """The blocks of a language on all pages, with the page's name."""
    return [
        (page.relative_to(CHECKOUT).as_posix(), text)
        for page in PAGES
        for found, text in BLOCK.findall(page.read_text(encoding="utf-8"))
        if found == language
    ]


@pytest.mark.parametrize(("page", "text"), blocks_of("yaml"), ids=lambda part: part[:40])
def test_a_shown_suite_is_one_that_is_read(page: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / "suite.yaml"
    file.write_text(text, encoding="utf-8")
    suite = read_suite(file)
    assert set(suite.limits) <= {limit.text for limit in limits_of(suite)}


@pytest.mark.parametrize(("page", "text"), blocks_of("toml"), ids=lambda part: part[:40])
def test_shown_settings_name_planners_that_are_understood(page: str, text: str) -> None:
    read = tomllib.loads(text)
    assert set(read) <= {"planners", "project"}
    for planner in read.get("planners", {}).values():
        CommandPlanner.model_validate(planner)
