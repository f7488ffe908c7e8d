"""``latest`` and ``current`` mean what a client made or chose last, whatever others make on the same workspace."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from pydantic import SecretStr
from support.builders import town_road
from support.http_serving import READER, WRITER, served
from support.server import both_eras

from plannerforge.engine.workspace import Workspace
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.workflows.context import Recent

pytestmark = pytest.mark.anyio
ONE, TWO = "ZAM_Builder-1_1_T-1", "ZAM_Builder-2_1_T-1"


class Session:
    """A client of its own on the workspace that all share."""

    def __init__(self, client: Client) -> None:
        self._client = client

    async def ask(self, tool: str, **arguments: Any) -> Any:
        result = await self._client.call_tool(tool, arguments)
        assert not result.is_error, result.content
        return result.structured_content

    async def text(self, tool: str, **arguments: Any) -> str:
        result = await self._client.call_tool(tool, arguments)
        return str(result.content[0].text)  # type: ignore[union-attr]


@pytest.fixture
async def sessions(settings: Settings, warm_workers: None, tmp_path: Path) -> AsyncIterator[tuple[Session, Session]]:
    own = settings.model_copy(update={"starter": False})
    town_road().cut(61).write(tmp_path / "one.xml")
    async with AsyncExitStack() as stack:
        servers = [create_server(own, start_folder=tmp_path) for _ in range(2)]
        first, second = [Session(await stack.enter_async_context(Client(server))) for server in servers]
        await first.ask("import_files", path="one.xml")
        yield first, second


async def test_a_configuration_that_exists_is_current_again_when_it_is_configured(
    sessions: tuple[Session, Session],
) -> None:
    client, _ = sessions
    first = await client.ask("configure_planner", weights=["jerk=0.5"])
    await client.ask("configure_planner", base="frenetix:Default", weights=["jerk=0.7"])
    again = await client.ask("configure_planner", base="frenetix:Default", weights=["jerk=0.5"])
    assert again["reused"]
    assert again["config_id"] == first["config_id"]
    run = await client.ask("run_planner")
    assert run["summary"][0]["config_id"] == first["config_id"]


async def test_other_clients_results_move_neither_current_nor_latest(sessions: tuple[Session, Session]) -> None:
    client, other = sessions
    mine = await client.ask("configure_planner", weights=["jerk=0.5"])
    slower = [{"op": "set_speed", "vehicles": ["31"], "speed": "5m/s"}]
    edited = await client.ask("modify_scenario", edits=slower)
    await other.ask("configure_planner", base="frenetix:Default", weights=["jerk=0.9"])
    faster = [{"op": "set_speed", "vehicles": ["31"], "speed": "9m/s"}]
    theirs = await other.ask("modify_scenario", scenario_id=ONE, edits=faster)
    assert (await client.ask("list_planners"))["config_id"] == mine["config_id"]
    assert (await client.ask("describe_scenario"))["scenario_id"] == edited["scenario_id"]
    assert (await other.ask("describe_scenario"))["scenario_id"] == theirs["scenario_id"]
    found = await client.ask("find_scenarios", obstacles=["car"])
    await other.ask("find_scenarios", obstacles=["bus=0"])
    refined = await client.ask("find_scenarios", within="latest", obstacles=["truck"])
    assert refined["catalogue"] == found["total"]


async def test_a_client_without_own_artifacts_gets_the_newest_with_one_remark(
    sessions: tuple[Session, Session],
) -> None:
    first, second = sessions
    made = await first.ask("configure_planner", weights=["jerk=0.5"])
    told = f"This session has no scenarios yet, so the workspace's newest one, {ONE}, is used."
    assert told in (await second.text("describe_scenario")).splitlines()
    assert told not in await second.text("describe_scenario")
    assert told not in await first.text("describe_scenario")
    assert f"the workspace's newest one, {made['config_id']} ({made['name']}), is used." in await second.text(
        "list_planners"
    )


async def test_existing_runs_and_batches_become_the_latest_when_requested_again(
    sessions: tuple[Session, Session],
) -> None:
    client, _ = sessions
    first = await client.ask("run_planner", configs=["idm"])
    await client.ask("run_planner", configs=["idm:Sporty"])
    again = await client.ask("run_planner", configs=["idm"])
    assert again["runs"][0]["run_id"] == first["runs"][0]["run_id"]
    assert (await client.ask("analyze_results"))["rows"][0]["run_id"] == first["runs"][0]["run_id"]
    exported = await client.ask("export_artifacts", ids=["latest", "current", "latest_scenario"], folder="out")
    owners = {file["artifact_id"] for file in exported["files"]}
    assert {first["runs"][0]["run_id"], ONE} <= owners
    assert any(key.startswith("cfg_") for key in owners)


@both_eras
async def test_clients_of_one_server_by_http_have_a_latest_and_a_current_each(
    settings: Settings, warm_workers: None, tmp_path: Path, era: str
) -> None:
    tokens = (SecretStr(f"one {WRITER}"), SecretStr(f"two {READER}"))
    own = settings.model_copy(update={"starter": False, "http_tokens": tokens})
    town_road().cut(61).write(tmp_path / "one.xml")
    async with (
        served(own, tmp_path) as server,
        server.client(era, WRITER) as first,
        server.client(era, READER) as second,
    ):
        one, two = Session(first), Session(second)
        await one.ask("import_files", path="one.xml")
        mine = await one.ask("configure_planner", base="idm", weights=["time_headway_s=1.2"])
        edited = await one.ask("modify_scenario", edits=[{"op": "set_speed", "vehicles": ["31"], "speed": "5m/s"}])
        run = await one.ask("run_planner")
        faster = [{"op": "set_speed", "vehicles": ["31"], "speed": "9m/s"}]
        theirs = await two.ask("configure_planner", base="idm", weights=["time_headway_s=2"])
        other = await two.ask("modify_scenario", scenario_id=ONE, edits=faster)
        other_run = await two.ask("run_planner")
        found = [await client.ask("find_scenarios", obstacles=["car"]) for client in (one, two)]
        for client, config, scenario, ran in ((one, mine, edited, run), (two, theirs, other, other_run)):
            assert (await client.ask("list_planners"))["config_id"] == config["config_id"]
            assert (await client.ask("describe_scenario"))["scenario_id"] == scenario["scenario_id"]
            assert ran["runs"][0]["config_id"] == config["config_id"]
            assert ran["runs"][0]["scenario_id"] == scenario["scenario_id"]
            assert (await client.ask("analyze_results"))["rows"][0]["run_id"] == ran["runs"][0]["run_id"]
        assert found[0]["total"] == found[1]["total"]


def test_the_memory_of_a_session_is_bounded() -> None:
    recent = Recent()
    for number in range(3_000):
        recent.note("run", f"run_{number}")
    recent.note("run", "run_2500")
    last = recent.last(["run"])
    assert last[:2] == [("run", "run_2500"), ("run", "run_2999")]
    assert len(last) == 1_000


def test_workers_keep_their_cache_in_the_workspace(tmp_path: Path) -> None:
    assert Workspace(tmp_path).owns(tmp_path / "recordings" / "a.recording")
