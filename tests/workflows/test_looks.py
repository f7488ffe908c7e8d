"""Looks at runs: made once in workers, kept in the workspace, and read by the next analysis."""

from pathlib import Path

import pytest
from support.runs import driven, record, source
from support.server import Connect

from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.results import AnalyzeResultsResult
from plannerforge.schemas.reviews import RunLook
from plannerforge.schemas.runs import BatchRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
ONE = "ZAM_Landmoor-32_1_T-1"


async def test_failures_are_looked_at_once(connect: Connect, settings: Settings, tmp_path: Path) -> None:
    async with connect() as client:
        assert not (await client.call_tool("describe_scenario", {"scenario_id": ONE})).is_error
        workspace = Workspace(settings.workspace)
        ego = workspace.get(ONE, "scenario").read(ScenarioRecord).facts.egos[0]
        made = [
            record(ONE, outcome, obstacle_id=7, seed=seed).model_copy(update={"problem_id": ego.problem_id})
            for seed, outcome in enumerate(("collision", "timeout", "goal_reached"))
        ]
        with workspace.scratch() as scratch:
            for run in made:
                path = source(run, tmp_path, (driven(60.0, 0.0, 1.0),)).steps_path
                steps = scratch / f"{run.run_id}.json"
                steps.write_bytes(Path(path or "").read_bytes())
                workspace.put(
                    "run", run.run_id, recipe=Recipe(tool="run_planner"), record=run, files={"steps.json": steps}
                )
        batch = BatchRecord(
            batch_id="batch_a",
            scenarios=(ONE,),
            configs=("cfg_a",),
            prediction="constant_velocity",
            traffic="recorded",
            runs=tuple(run.run_id for run in made),
            lost=(),
        )
        workspace.put("batch", "batch_a", recipe=Recipe(tool="run_planner"), record=batch)
        first = await client.call_tool("analyze_results", {"results": ["batch_a"]})
        assert not first.is_error, first.content
        kept = settings.workspace / "looks" / str(RunLook.VERSION)
        assert {path.stem for path in kept.iterdir()} == {made[0].run_id, made[1].run_id}
        look = kept / f"{made[0].run_id}.json"
        text = look.read_text(encoding="utf-8")
        assert RunLook.model_validate_json(text).review.contact is not None
        before = look.stat().st_mtime_ns
        again = await client.call_tool("analyze_results", {"results": ["batch_a"]})
        assert look.stat().st_mtime_ns == before
        assert again.structured_content == first.structured_content
        told = AnalyzeResultsResult.model_validate(again.structured_content)
        assert told.causes is not None
        assert (told.causes.collisions, told.causes.looked_at) == (1, 1)
        look.write_text("{", encoding="utf-8")  # one that cannot be read is made again
        assert not (await client.call_tool("analyze_results", {"results": ["batch_a"]})).is_error
        assert look.read_text(encoding="utf-8") == text
