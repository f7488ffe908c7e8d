"""The calls that pages show are answered, one after the other as a page shows them."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.pages import PAGES, shown_calls
from support.server import Connect
from support.tree import CHECKOUT

ELSEWHERE = {
    "docs/tutorial.md": "tests/test_tutorial.py",
    "docs/criticality.md": "tests/integration/test_criticality_page.py",
    "docs/maps.md": "asks for a town that has to be fetched",
    "docs/own_planner.md": "asks for a planner that the page lets its reader write",
    "docs/how-to/own_planner.md": "the same",
}
"""Pages whose calls are made by other tests, or by none, and why."""
SMALL = "ZAM_Fahrhausen-21_1_T-1"
"""The scenario that a reader has looked at, on a small network."""
FEWER = {
    r'^((?!.*"objective").*)preset:\d+': r"\1preset:1",
    r"preset:(?!1\b)\d+": "preset:4",
    r'"max_trials": \d+': '"max_trials": 2',
    r'\["frenetix"\], "points": \d+': '["idm"], "points": 30, "references": false',
    r'("runs": \d+)': r'\1, "until_first": true',
    r'"latest"(\], "formats": \["openscenario"\])': rf'"{SMALL}"\1',
    r'"density": "medium"': '"density": "low", "duration_s": 6, "goal": "steps:20"',
    r'"vehicles": \["bus=1"\]': '"vehicles": ["bus=1"], "duration_s": 6, "goal": "steps:20"',
    r'"method": "morris", "max_trials": 2': '"method": "morris", "base": "idm", "vary": ["time_headway_s"], '
    '"max_trials": 9',
}
"""What is done with fewer and shorter scenarios, tries, points, runs and weights, less traffic, and a planner that
plans faster than on the page: it would take minutes. The roads of the newest scenario take longer to write."""
HERE = [name for name in dict.fromkeys(page for page, _, _ in shown_calls()) if name not in ELSEWHERE]


async def answered(client: Client, tool: str, arguments: dict[str, Any]) -> None:
    """Make a call, and wait for its job where it began one."""
    result = await client.call_tool(tool, arguments)
    while (result.structured_content or {}).get("state") == "running":
        result = await client.call_tool("get_job", {"wait_s": 50})
    assert not result.is_error, (tool, arguments, result.content)


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
@pytest.mark.parametrize("page", HERE)
async def test_every_call_of_a_page_is_answered(page: str, connect: Connect, tmp_path: Path) -> None:
    async with connect() as client:
        await answered(client, "describe_scenario", {"scenario_id": SMALL})
        if "My Town" in (CHECKOUT / page).read_text(encoding="utf-8"):  # the map that it tells its reader to bring
            town = shutil.copyfile(CHECKOUT / "engine/maps/library/musterstadt.osm", tmp_path / "my_town.osm")
            await answered(client, "import_files", {"path": str(town), "name": "My Town", "country": "DEU"})
        for shown, tool, arguments in shown_calls():
            if shown == page:
                text = json.dumps(arguments).replace("~/scenarios", str(tmp_path))
                for pattern, fewer in FEWER.items():
                    text = re.sub(pattern, fewer, text)
                await answered(client, tool, json.loads(text))


def test_pages_with_calls_that_are_not_made_here_show_some() -> None:
    pages = {page.relative_to(CHECKOUT).as_posix() for page in PAGES}
    assert ELSEWHERE.keys() <= {page for page, _, _ in shown_calls()} <= pages
