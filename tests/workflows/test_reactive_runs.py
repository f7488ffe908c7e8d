"""Reactive traffic through a real client session: asked for, refused, told, stored and drawn."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import Problem, driving, town_road

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.rendering.content import driven_path
from plannerforge.engine.rendering.pictures import render
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.schemas.rendering import RenderRequest
from plannerforge.schemas.runs import RunRecord, RunSource, ScenarioSource
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))


async def test_a_reactive_run_is_requested_refused_reported_stored_and_drawn(
    settings: Settings, tmp_path: Path
) -> None:
    builder = replace(town_road(), problems=(NEAR,)).with_vehicles(
        driving(32, (15.0, 0.0), 16.0, 60), driving(60, (90.0, -9.0), 1.0, 60, kind="pedestrian", size_m=(0.6, 0.6))
    )
    path = builder.write(tmp_path / "one.xml")
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:

        async def ask(tool: str, **arguments: Any) -> Any:
            result = await client.call_tool(tool, arguments)
            return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

        await ask("import_files", path=str(path))
        refused = await ask("run_planner", traffic="reactive", prediction="ground_truth")
        assert "constant_velocity" in refused
        assert "ground_truth" in refused
        reactive = await ask("run_planner", traffic="reactive")
        recorded = await ask("run_planner")
    assert reactive["traffic"] == "reactive"
    assert reactive["notes"] == ["reactive traffic: 1 obstacle in 1 of 1 runs still followed the recording"]
    assert recorded["notes"] == []
    assert reactive["runs"][0]["run_id"] != recorded["runs"][0]["run_id"]
    workspace = Workspace(own.workspace)
    run_id = reactive["runs"][0]["run_id"]
    steps = workspace.file("run", run_id, "steps.json")
    assert [other["obstacle_id"] for other in json.loads(steps.read_text())["others"]] == [32]
    source = RunSource(record=workspace.get(run_id, "run").read(RunRecord), steps_path=str(steps))
    driven = driven_path(source)
    assert driven is not None
    assert driven.others[32].first_step == 0
    drawn = render(
        RenderRequest(
            kind="picture",
            scenarios=(ScenarioSource(scenario_id=builder.benchmark_id, path=str(path)),),
            runs=(source, source),
            configs=(),
            time_s=None,
            folder=str(tmp_path),
        ),
        silent,
    )
    assert any("as recorded" in note for note in drawn.notes)
