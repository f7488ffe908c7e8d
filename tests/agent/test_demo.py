"""``plannerforge demo``: what it says beside the answers of the tools."""

import io
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from mcp.types import CallToolResult, TextContent
from rich.console import Console

from plannerforge.agent.demo import _compare, _DemoSession, _find_failure

MARK = "Goals reached without driving say nothing about a planner: run_1, run_2."


async def _compared(trivial: dict[str, Any] | None) -> str:
    """What the stage of comparison prints where an analysis finds such goals, or none."""

    async def call_tool(tool: str, arguments: dict[str, Any]) -> CallToolResult:
        structured = {"trivial": trivial} if tool == "analyze_results" and arguments["results"] == ["batch_1"] else {}
        return CallToolResult(content=[TextContent(type="text", text=tool)], structured_content=structured)

    printed = io.StringIO()
    session = _DemoSession(cast("Any", SimpleNamespace(call_tool=call_tool)), Console(file=printed, width=118))
    await _compare(session, "batch_1", "run_1")
    return printed.getvalue()


@pytest.mark.anyio
async def test_demo_marks_goals_that_are_met_without_driving() -> None:
    assert MARK in await _compared({"run_ids": ["run_1", "run_2"]})
    assert "without driving" not in await _compared(None)


@pytest.mark.anyio
async def test_demo_waits_for_the_search_and_shows_the_reduced_failure(tmp_path: Path) -> None:
    found = {"failures": [{"run_id": "run_1", "shrunk": {"run_id": "run_2"}}]}
    answers = iter([{"state": "running", "search": None}, {"state": "done", "search": found}])
    calls: list[tuple[str, dict[str, Any]]] = []

    async def call_tool(tool: str, arguments: dict[str, Any]) -> CallToolResult:
        calls.append((tool, arguments))
        structured = next(answers) if tool == "find_failures" else {}
        return CallToolResult(content=[TextContent(type="text", text=tool)], structured_content=structured)

    session = _DemoSession(cast("Any", SimpleNamespace(call_tool=call_tool)), Console(file=io.StringIO(), width=118))
    await _find_failure(session, tmp_path)
    search, again, *shown = calls
    assert search == again
    assert search[1]["shrink"]
    assert {arguments["ids"][0] for _, arguments in shown} == {"run_2"}
    assert [(tool, arguments.get("formats")) for tool, arguments in shown][-1] == ("export_artifacts", ["png", "gif"])
