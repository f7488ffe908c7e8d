"""export_artifacts: solution files of runs and tables of batches, through a real client session."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from mcp import Client
from support.builders import Problem, town_road

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))
BLOCKED = Problem(start=(70.0, 0.0, 0.0, 8.0))
"""The ego starts in the parked car."""


async def test_solution_of_a_run_and_tables_of_a_batch(settings: Settings, tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    replace(town_road(), problems=(NEAR,)).write(folder / "one.xml")
    replace(town_road(), problems=(BLOCKED,), benchmark_id="ZAM_Builder-2_1_T-1").write(folder / "two.xml")
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:

        async def ask(tool: str, **arguments: Any) -> Any:
            result = await client.call_tool(tool, arguments)
            return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

        await ask("import_files", path=str(folder))
        grid = await ask("run_planner", scenarios=["ZAM_Builder-1_1_T-1", "ZAM_Builder-2_1_T-1"], wait_s=50)
        run = next(entry for entry in grid["runs"] if entry["outcome"] == "goal_reached")
        invalid = next(entry for entry in grid["runs"] if entry["outcome"] == "invalid")

        solution = await ask("export_artifacts", ids=[run["run_id"]], formats=["solution"], folder="out")
        assert Path(solution["files"][0]["path"]).name == f"{run['run_id']}.solution.xml"
        assert "<ksTrajectory" in Path(solution["files"][0]["path"]).read_text()
        refused = await ask("export_artifacts", ids=[invalid["run_id"]], formats=["solution"], folder="out")
        assert "has no solution" in refused
        stored = await ask("export_artifacts", ids=[grid["batch_id"]], folder="plain")
        assert {file["format"] for file in stored["files"]} == {"json", "recipe"}

        tables = await ask("export_artifacts", ids=[grid["batch_id"]], formats=["csv", "parquet"], folder="out")
        as_csv, as_parquet = (Path(file["path"]) for file in tables["files"])
        with as_csv.open(newline="") as stream:
            rows = list(csv.DictReader(stream))
        table = pq.read_table(as_parquet)
        assert [row["run_id"] for row in rows] == [entry["run_id"] for entry in grid["runs"]]
        assert table.column_names == list(rows[0])
        by_outcome = {entry["outcome"]: entry for entry in table.to_pylist()}
        assert by_outcome["goal_reached"]["metrics_duration_s"] == run["duration_s"]
        assert by_outcome["goal_reached"]["weight_lateral_jerk"] > 0
        assert by_outcome["invalid"]["metrics_duration_s"] is None
        again = await ask("export_artifacts", ids=[grid["batch_id"]], formats=["parquet"], folder="again")
        assert Path(again["files"][0]["path"]).read_bytes() == as_parquet.read_bytes()
