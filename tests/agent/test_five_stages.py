"""The chat of ``docs/chat.md`` with the real server: five stages, each with what the one before made."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from support.model_servers import Reply, serving
from support.tree import loaded_script

from plannerforge.agent.connection import ToolConnection
from plannerforge.agent.loop import AgentSession
from plannerforge.agent.models.interface import ModelSettings
from plannerforge.agent.models.registry import open_model
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings


@pytest.fixture(scope="module")
def recording() -> ModuleType:
    """The script that records the page."""
    return loaded_script("record_chat")


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready", "warm_workers")
async def test_a_chat_covers_five_stages(recording: ModuleType, settings: Settings, tmp_path: Path) -> None:
    def script(request: Mapping[str, Any]) -> Reply:
        """The model of the page, which asks for a smaller scenario."""
        reply: Reply = recording.script(request)
        less = {"density": "low", "duration_s": 6, "goal": "steps:20"}
        calls = [(tool, {**asked, **less} if tool == "generate_scenarios" else asked) for tool, asked in reply.calls]
        return replace(reply, calls=tuple(calls))

    results = []
    with serving("ollama", script) as server:
        model = open_model("ollama:big:70b", ModelSettings(host=server.url))
        async with ToolConnection.open(create_server(settings, start_folder=tmp_path)) as connection:
            session = AgentSession(model, connection)
            for said in recording.STAGES:
                results.append(await session.take_turn(said))  # noqa: PERF401 - one after the other
        await model.close()
    assert [result.problem for result in results] == [""] * 6
    assert [result.ending for result in results] == ["refused"] + ["answered"] * 5
    calls = [call for result in results for call in result.calls]
    refused = [call.call.arguments for call in calls if call.answer.is_error]
    assert [arguments["place"] for arguments in refused] == ["Springfield"]
    modified = results[3].calls[-1].answer.structured
    run = next(call.answer.structured for call in results[4].calls if call.call.tool == "run_planner")
    assert modified["base_id"] == results[1].calls[-1].answer.structured["scenarios"][0]["scenario_id"]
    assert (session.state.scenario, session.state.batch) == (modified["scenario_id"], run["batch_id"])
    assert results[5].calls[-1].call.arguments == {"results": [run["batch_id"]]}


def test_the_page_shows_the_chat_of_the_script(recording: ModuleType) -> None:
    page = recording.TARGET.read_text(encoding="utf-8")
    assert page.startswith(recording.HEAD)
    said = [line.removeprefix("you › ") for line in page.splitlines() if line.startswith("you › ")]
    assert said == [*recording.STAGES, "/state", "/quit"]
    tools = [line.split()[1] for line in page.splitlines() if line.startswith("● ")]
    assert {"generate_scenarios", "describe_scenario", "modify_scenario", "run_planner", "compare_results"} <= set(
        tools
    )
