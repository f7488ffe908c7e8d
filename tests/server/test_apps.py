"""MCP Apps: hosts that have the extension are told pages and views; for all others nothing is different."""

import json
import sqlite3
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path
from typing import Any

import pytest
from mcp import Client, MCPError
from mcp.client.extension import advertise
from mcp.server.apps import APP_MIME_TYPE, EXTENSION_ID
from support.server import Connect

from plannerforge.engine.rendering.views.data import BoardView, PlayerView
from plannerforge.resources.apps import VIEW_KEY, view_uri, viewed_ids
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
SCENARIO, OTHER = "ZAM_Fahrhausen-4_1_T-1", "ZAM_Fahrhausen-5_1_T-1"


@asynccontextmanager
async def host(settings: Settings, era: str, folder: Path, **extension: Any) -> AsyncIterator[Client]:
    """A client session that has the extension, with these settings of it."""
    advertised = [advertise(EXTENSION_ID, extension or {"mimeTypes": [APP_MIME_TYPE]})]
    async with Client(create_server(settings, folder), mode=era, extensions=advertised) as client:  # type: ignore[arg-type]
        yield client


def test_uri_of_a_view_is_read_back() -> None:
    assert viewed_ids(str(view_uri([SCENARIO, "run_1"]))) == [SCENARIO, "run_1"]
    assert viewed_ids(f"plannerforge://view/{SCENARIO}%2Brun_1") == [SCENARIO, "run_1"]
    assert view_uri([]) is None
    assert view_uri(["run_1"] * 21) is None
    for wrong in (
        "plannerforge://view/",
        "plannerforge://view/a+",
        "plannerforge://view/../a",
        "plannerforge://views/a",
    ):
        assert viewed_ids(wrong) == []


async def test_every_page_that_a_tool_names_can_be_read(connect: Connect) -> None:
    async with connect() as client:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        named = {name: tool.meta["ui"]["resourceUri"] for name, tool in tools.items() if tool.meta}
        pages = {uri: (await client.read_resource(uri)).contents[0] for uri in set(named.values())}
    assert set(named) == {spec.name for spec in TOOLS if spec.view is not None}
    assert set(pages) == {"ui://plannerforge/player.html", "ui://plannerforge/board.html"}
    for page in pages.values():
        assert page.mime_type == APP_MIME_TYPE
        assert page.text.startswith("<!DOCTYPE html>")  # type: ignore[union-attr]


async def test_pages_are_not_listed_among_resources(connect: Connect) -> None:
    async with connect() as client:
        listed = [resource.uri for resource in (await client.list_resources()).resources]
    assert [uri for uri in listed if uri.startswith("ui:")] == []


@pytest.mark.usefixtures("warm_workers", "starter_ready")
async def test_answer_names_its_view_to_a_host_with_the_extension_alone(
    settings: Settings, era: str, tmp_path: Path, connect: Connect
) -> None:
    call = ("describe_scenario", {"scenario_id": SCENARIO})
    async with connect() as client:
        plain = await client.call_tool(*call)
    async with host(settings, era, tmp_path, mimeTypes=["text/plain"]) as client:
        other = await client.call_tool(*call)
    async with host(settings, era, tmp_path) as client:
        told = await client.call_tool(*call)
        refused = await client.call_tool("describe_scenario", {"scenario_id": "ZAM_Nowhere-1_1_T-1"})
    assert (told.meta or {})[VIEW_KEY] == f"plannerforge://view/{SCENARIO}"
    assert VIEW_KEY not in {**(plain.meta or {}), **(other.meta or {}), **(refused.meta or {})}
    assert told.content == plain.content == other.content
    assert told.structured_content == plain.structured_content


@pytest.mark.usefixtures("warm_workers", "starter_ready")
async def test_view_of_runs_is_read_as_a_resource(settings: Settings, era: str, tmp_path: Path) -> None:
    async with host(settings, era, tmp_path) as client:
        one = await client.call_tool("run_planner", {"scenarios": [SCENARIO]})
        both = await client.call_tool("run_planner", {"scenarios": [SCENARIO, OTHER], "wait_s": 50})
        drawn = await client.call_tool("render", {"ids": [SCENARIO, OTHER]})
        uris = [(result.meta or {})[VIEW_KEY] for result in (one, both, drawn)]
        contents = [(await client.read_resource(uri)).contents[0] for uri in uris]
    assert {content.mime_type for content in contents} == {"application/json"}
    run, batch, pair = (json.loads(content.text) for content in contents)  # type: ignore[union-attr]
    assert PlayerView.model_validate(run).panes[0].drive is not None
    assert len(PlayerView.model_validate(pair).panes) == 2
    board = BoardView.model_validate(batch)
    assert [row.scenario_id for row in board.rows] == [SCENARIO, OTHER]
    assert board.drives == {}  # the page asks for each run that is opened


@pytest.mark.usefixtures("warm_workers", "starter_ready")
async def test_a_run_with_a_missing_planner_is_shown_without_plans(settings: Settings, tmp_path: Path) -> None:
    views = settings.workspace / "views"
    async with host(settings, "auto", tmp_path) as client:
        ran = await client.call_tool("run_planner", {"scenarios": [SCENARIO], "configs": ["idm"]})
        uri = (ran.meta or {})[VIEW_KEY]
        whole = (await client.read_resource(uri)).contents[0].text  # type: ignore[union-attr]
        kept = len(list(views.iterdir()))
        with closing(sqlite3.connect(settings.workspace / "workspace.sqlite")) as database, database:
            database.execute("UPDATE artifacts SET record = json_set(record, '$.planner', 'gone') WHERE kind = 'run'")
        without = (await client.read_resource(uri)).contents[0].text  # type: ignore[union-attr]
    shown, bare = PlayerView.model_validate_json(whole), PlayerView.model_validate_json(without)
    assert shown.notes == ()
    assert shown.panes[0].drive is not None
    assert bare.panes[0].drive is not None
    assert len(shown.panes[0].drive.plans) == len(shown.panes[0].drive.plan_steps) > 0
    assert bare.panes[0].drive.plans == ()
    assert "its plans are not shown: there is no planner 'gone'" in bare.notes[0]
    assert len(list(views.iterdir())) == kept == 1  # it may be installed again


@pytest.mark.usefixtures("starter_ready")
@pytest.mark.parametrize("ids", ["ZAM_Nowhere-1_1_T-1", f"{SCENARIO}+{OTHER}+{SCENARIO}"])
async def test_an_artifact_without_a_view_is_refused_with_invalid_params(connect: Connect, ids: str) -> None:
    async with connect() as client:
        with pytest.raises(MCPError, match=r"unknown_name|invalid_request") as caught:
            await client.read_resource(f"plannerforge://view/{ids}")
    assert caught.value.error.code == -32602
