"""Imperfect worlds through a real client session: asked for, refused, told, stored, compared and selected."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import Problem, driving, town_road

from plannerforge.engine.planners import check_world, programs_named
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.planning import CommandPlanner
from plannerforge.schemas.runs import RunRecord, RunSteps
from plannerforge.schemas.worlds import PERFECT, world_of
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))


@pytest.mark.anyio
@pytest.mark.usefixtures("warm_workers")
async def test_a_world_is_requested_refused_stored_compared_and_selected(settings: Settings, tmp_path: Path) -> None:
    builder = replace(town_road(), problems=(NEAR,)).with_vehicles(
        driving(31, (70.0, 3.5), 10.0, 60), driving(32, (85.0, 3.5), 10.0, 60)
    )
    path = builder.write(tmp_path / "one.xml")
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:

        async def ask(tool: str, **arguments: Any) -> Any:
            result = await client.call_tool(tool, arguments)
            return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

        await ask("import_files", path=str(path))
        assert "camera" in await ask("run_planner", world="camra")
        assert "ground_truth" in await ask("run_planner", world="camera", prediction="ground_truth")
        perfect = await ask("run_planner")
        spelled = await ask("run_planner", world="perfect, missed=0")
        sensed = await ask("run_planner", world="visible=0.2, missed=0.1")
        again = await ask("run_planner", world="occlusion, missed=0.1")
        run_ids = [answer["runs"][0]["run_id"] for answer in (perfect, spelled, sensed, again)]
        compared = await ask("compare_results", results=[run_ids[0], run_ids[2]])
        chosen = await ask("analyze_results", results=run_ids[::2], where=["world=perfect"])
    assert run_ids[0] == run_ids[1] != run_ids[2] == run_ids[3]
    assert (spelled["reused"], again["reused"]) == (1, 1)
    assert "world" not in perfect
    assert sensed["world"] == "occlusion, missed=0.1"
    assert compared["comparisons"][0]["conditions"] == ["world: perfect → occlusion, missed=0.1"]
    assert chosen["runs"] == 1
    stored = Workspace(own.workspace)
    record = stored.get(run_ids[2], "run")
    assert record.read(RunRecord).world == world_of("occlusion, missed=0.1")
    assert record.recipe.arguments["world"] == {"visible": 0.2, "missed": 0.1}
    assert "world" not in stored.get(run_ids[0], "run").recipe.arguments
    steps = RunSteps.model_validate_json(stored.file("run", run_ids[2], "steps.json").read_bytes())
    assert steps.perceived is not None
    assert {one.obstacle_id for one in steps.perceived.sightings} == {31, 32}


def test_a_program_that_reads_the_recording_cannot_run_in_an_imperfect_world() -> None:
    once = CommandPlanner(summary="reads the file", command=("python3", "-"))
    with programs_named({"reads_all": once, "asks": once.model_copy(update={"protocol": "stepwise"})}):
        with pytest.raises(InvalidRequest, match="reads_all"):
            check_world("reads_all", world_of("camera"))
        check_world("reads_all", PERFECT)
        check_world("asks", world_of("camera"))
