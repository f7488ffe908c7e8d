"""The page on answers shows one of each tool, as it is: ``pytest tests/contract --update-snapshots`` writes it anew."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp.types import CallToolResult
from support.builders import town_road
from support.contract import hold_page

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.server.tokens import count_tokens
from plannerforge.tools.registry import TOOLS

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
PAGE = Path(__file__).parents[2] / "docs" / "answers.md"
MARK = "<!-- from here on written by tests/contract/test_answers_page.py -->\n"
MOST_LINES, MOST_TOKENS = 12, 250
LISTS = {"list_planners", "describe_catalog", "list_artifacts"}
"""Tools whose answer is a list that was asked for."""
CROSSING = {"place": "Musterstadt", "scenario_type": "intersection", "duration_s": 10, "vehicles": ["truck=2"]}
CALLS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("import_files", {"path": "town.xml"}),
    ("generate_scenarios", CROSSING),
    ("describe_scenario", {}),
    ("modify_scenario", {"edits": [{"op": "set_behaviour", "vehicles": ["nearest:2"], "preset": "aggressive"}]}),
    ("find_scenarios", {"obstacles": ["truck"], "sort": "criticality"}),
    ("describe_catalog", {"facet": "obstacles"}),
    ("configure_planner", {"preset": "Comfort", "weights": ["jerk=0.5"]}),
    ("list_planners", {}),
    ("run_planner", {}),
    ("analyze_results", {}),
    ("run_planner", {"configs": ["frenetix:Default", "current"]}),
    ("get_job", {}),
    ("compare_results", {}),
    ("render", {"ids": ["latest_run"]}),
    ("export_artifacts", {"ids": ["latest_run"], "folder": "out"}),
    ("list_artifacts", {"kind": "config"}),
    ("find_failures", {"scenario_id": "ZAM_Builder-1_1_T-1", "config": "idm", "runs": 8}),
    ("optimize_planner", {"scenarios": ["preset:3"], "base": "idm", "vary": ["time_headway_s"], "max_trials": 3}),
    (
        "explore_boundary",
        {"scenario": "cut_in", "configs": ["keep_lane"], "points": 30, "references": False, "wait_s": 50},
    ),
    ("cancel_job", {"job_id": "latest"}),
)


def stable(text: str, folder: Path) -> str:
    """The answer without what differs from day to day: folders, times, and names of pictures."""
    text = text.replace(str(folder), "…")
    text = re.sub(r"\d{4}-\d\d-\d\dT[\d:]+Z", "2026-…", text)
    text = re.sub(r"_[0-9a-f]{12}\.png", "_….png", text)
    return re.sub(r"\([\d,]+ bytes, ", "(… bytes, ", text)


async def finished(client: Client, tool: str, arguments: dict[str, Any]) -> CallToolResult:
    """The tool's answer; a call that becomes a job is repeated after the job, so that the page depends on no clock."""
    result = await client.call_tool(tool, arguments)
    while tool != "get_job" and (result.structured_content or {}).get("state") == "running":
        await client.call_tool("get_job", {"job_id": (result.structured_content or {})["job_id"], "wait_s": 50})
        result = await client.call_tool(tool, arguments)
    return result


async def test_the_page_shows_an_answer_of_each_tool(
    settings: Settings, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    assert {tool for tool, _ in CALLS} == {spec.name for spec in TOOLS}
    town_road().write(tmp_path / "town.xml")
    shown, too_long = [], {}
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:
        for tool, arguments in CALLS:
            result = await finished(client, tool, arguments)
            text = stable(str(result.content[0].text), tmp_path)  # type: ignore[union-attr]
            assert not result.is_error, (tool, text)
            shown.append(f"### {tool}\n\n`{json.dumps(arguments, ensure_ascii=False)}`\n\n```text\n{text}\n```\n")
            if tool not in LISTS and len(text.splitlines()) > MOST_LINES and count_tokens(text) > MOST_TOKENS:
                too_long[tool] = text
    assert too_long == {}
    hold_page(PAGE, MARK, shown, update=request.config.getoption("--update-snapshots"))
