"""``plannerforge demo``: what it says beside the answers of the tools."""

import io
from types import SimpleNamespace
from typing import Any, cast

import pytest
from mcp.types import CallToolResult, TextContent
from rich.console import Console

from plannerforge.agent.demo import _compare, _DemoSession

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
