"""The page on refusals shows some of each tool, as told: ``pytest tests/contract --update-snapshots`` renews it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import town_road
from support.contract import CASES, hold_page
from support.tree import CHECKOUT

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
PAGE = CHECKOUT / "docs" / "refusals.md"
MARK = "<!-- from here on written by tests/contract/test_refusals_page.py -->\n"
SCENARIO = "ZAM_Builder-1_1_T-1"
MOST = 4
UNKNOWN_RUNS = {"results": ["run_000000000000", "run_000000000001"]}


def refused_calls(tool: str) -> Iterator[dict[str, Any]]:
    """Bad calls of the contract tests that need nothing but one scenario in the workspace."""
    cases = [bad.arguments for bad in CASES[tool].bad]
    for arguments in [*cases, *([UNKNOWN_RUNS] if tool == "compare_results" else [])]:
        text = json.dumps(arguments, ensure_ascii=False).replace("<scenario>", SCENARIO)
        if "<" not in text.replace("<folder>", ""):
            yield json.loads(text.replace("<folder>", "out"))


async def test_the_page_shows_refusals_of_each_tool(
    settings: Settings, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    town_road().write(tmp_path / "town.xml")
    shown = []
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:
        await client.call_tool("import_files", {"path": "town.xml"})
        for spec in TOOLS:
            blocks = []
            for arguments in list(refused_calls(spec.name))[:MOST]:
                result = await client.call_tool(spec.name, arguments)
                text = str(result.content[0].text).replace(str(tmp_path), "…")  # type: ignore[union-attr]
                assert result.is_error, (spec.name, arguments, text)
                blocks.append(f"`{json.dumps(arguments, ensure_ascii=False)}`\n\n```text\n{text}\n```")
            assert blocks, spec.name
            shown.append(f"### {spec.name}\n\n" + "\n\n".join(blocks) + "\n")
    hold_page(PAGE, MARK, shown, update=request.config.getoption("--update-snapshots"))
