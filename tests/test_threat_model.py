"""The threat model names, for each threat, tests that exist, or says that nothing holds it."""

import ast
import re
from functools import cache

import pytest
from support.tree import CHECKOUT, source_files

from plannerforge.server.tool_schema import described_tool
from plannerforge.tools.registry import TOOLS

PAGE = (CHECKOUT / "docs" / "threat_model.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (?!threat |asset |---)([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
PATHS = {"import_files": {"path"}, "export_artifacts": {"folder"}}


@cache
def functions_of(file: str) -> set[str]:
    """The names of all functions of a test file."""
    return set(re.findall(r"^ *(?:async )?def (\w+)\(", (CHECKOUT / file).read_text(encoding="utf-8"), re.MULTILINE))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][:40])
def test_every_threat_names_existing_tests_or_says_so(row: tuple[str, str, str]) -> None:
    threat, stops, held = row
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", held)
    assert named or held == "no test", threat
    assert named or stops.startswith("Not prevented"), f"{threat}: the cell before says so"
    for file, test in named:
        assert test in functions_of(file), f"{file} has no {test}"


def test_every_row_of_a_threat_is_read() -> None:
    threats = [line for line in PAGE.partition("## A hostile file")[2].splitlines() if line.startswith("| ")]
    assert len(ROWS) == len([line for line in threats if not line.startswith(("| threat ", "| --- "))])


def test_two_tools_take_a_path_and_no_tool_takes_an_address_or_a_command() -> None:
    arguments = {spec.name: set(described_tool(spec).input_schema.get("properties", {})) for spec in TOOLS}
    found = {tool: names & {"path", "folder", "file", "output"} for tool, names in arguments.items()}
    assert {tool: names for tool, names in found.items() if names} == PATHS
    words = {word for names in arguments.values() for name in names for word in name.split("_")}
    assert words & {"url", "address", "host", "command", "program", "environment", "token"} == set()


def test_no_command_uses_a_shell() -> None:
    calls = [
        (path.relative_to(CHECKOUT).as_posix(), node.lineno)
        for path in source_files()
        if re.search(rb"shell|system|popen|getoutput", path.read_bytes())
        for node in ast.walk(ast.parse(path.read_bytes()))
        if isinstance(node, ast.Call)
        and (
            any(word.arg == "shell" and ast.unparse(word.value) != "False" for word in node.keywords)
            or ast.unparse(node.func)
            in {"os.system", "os.popen", "subprocess.getoutput", "asyncio.create_subprocess_shell"}
        )
    ]
    assert calls == []
