"""Commands and calls that the pages show are such that the program takes them."""

import json
import re
import shlex
import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from support.pages import BLOCK, PAGES, inline_commands, shown_calls, shown_commands, words_of
from support.tree import CHECKOUT

from plannerforge.cli.main import application
from plannerforge.cli.suite import read_suite
from plannerforge.engine.catalog import judge_odd
from plannerforge.engine.execution import silent
from plannerforge.engine.exploration import read_logical_scenario
from plannerforge.schemas.base import Arguments
from plannerforge.schemas.boundaries import DescribeLogicalRequest
from plannerforge.schemas.odd import OddRequest
from plannerforge.schemas.planning import CommandPlanner
from plannerforge.tools.registry import TOOLS
from plannerforge.workflows.analysis.suite import limits_of


@cache
def program() -> Any:
    """The command line, which takes a while to put together."""
    return typer.main.get_command(application)


def fault(words: Sequence[str]) -> str:
    """What the command line has against words, empty where it takes them; whether files are there is not looked at."""
    command, rest = program(), list(words[1:])
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
def test_every_shown_command_is_accepted_by_the_program(page: str, command: str) -> None:
    assert fault(words_of(command)) == ""


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
    assert re.search(r"No such option|no command|not a valid|valid integer|unexpected extra", fault(words_of(command)))


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
def test_every_shown_suite_scenario_or_odd_can_be_read(page: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / "suite.yaml"
    file.write_text(text, encoding="utf-8")
    if page == "docs/boundaries.md":
        assert read_logical_scenario(DescribeLogicalRequest(path=str(file)), silent).edits
        return
    if page == "docs/coverage.md":
        assert judge_odd(OddRequest(path=file), silent).missing
        return
    suite = read_suite(file)
    assert set(suite.limits) <= {limit.text for limit in limits_of(suite)}


@pytest.mark.parametrize(("page", "text"), blocks_of("toml"), ids=lambda part: part[:40])
def test_shown_settings_name_planners_that_are_understood(page: str, text: str) -> None:
    read = tomllib.loads(text)
    assert set(read) <= {"planners", "project"}
    for planner in read.get("planners", {}).values():
        CommandPlanner.model_validate(planner)
