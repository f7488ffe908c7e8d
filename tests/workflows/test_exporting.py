"""export_artifacts: solution files of runs and tables of batches, through a real client session."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from mcp import Client
from support.builders import Problem, town_road
from support.loop_watch import watched_loop
from support.runs import record

from plannerforge.schemas.runs import RunSeries
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.workflows.results import driven_by

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))
BLOCKED = Problem(start=(70.0, 0.0, 0.0, 8.0))
"""The ego starts in the parked car."""


async def test_solution_of_a_run_and_tables_of_a_batch(settings: Settings, tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    replace(town_road().cut(61), problems=(NEAR,)).write(folder / "one.xml")
    replace(town_road().cut(61), problems=(BLOCKED,), benchmark_id="ZAM_Builder-2_1_T-1").write(folder / "two.xml")
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
        assert "as solution" in refused
        steps = await ask("export_artifacts", ids=[run["run_id"]], formats=["csv", "json"], folder="steps")
        files = {file["format"]: Path(file["path"]) for file in steps["files"]}
        assert set(files) == {"csv", "json", "steps", "series"}
        with files["csv"].open(newline="") as stream:
            assert float(next(csv.DictReader(stream))["lateral_offset_m"]) == 0.0
        assert RunSeries.model_validate_json(files["series"].read_bytes()).steering_rad
        untold = await ask("export_artifacts", ids=[invalid["run_id"]], formats=["csv"], folder="out")
        assert "as csv" in untold
        with watched_loop():
            shown = ["ZAM_Builder-1_1_T-1", grid["batch_id"]]
            report = await ask("export_artifacts", ids=shown, formats=["html"], folder="r")
        page, player, board = (Path(file["path"]) for file in report["files"])
        assert [file["format"] for file in report["files"]] == ["html", "view", "view"]
        assert f'href="{player.name}"' in page.read_text()
        assert f'href="{board.name}"' in page.read_text()
        assert "<script" not in page.read_text()
        assert [word in player.read_text() for word in ("class Player", "class Board")] == [True, False]
        assert "class Board" in board.read_text()
        taken = await ask("export_artifacts", ids=["ZAM_Builder-1_1_T-1"], formats=["html"], folder="r")
        assert "overwrite" in taken
        unseen = await ask("export_artifacts", ids=["current"], formats=["html"], folder="unseen")
        assert "[invalid_request]" in unseen
        assert "Valid: yaml, json, recipe." in unseen
        assert not (tmp_path / "unseen").exists()
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
        told = (await ask("analyze_results", results=[run["run_id"]], detail="measures"))["measures"]
        values = {f"measure_{one['name']}": one["value"] for one in told}
        measured = {
            name: by_outcome["goal_reached"][name] for name in table.column_names if name.startswith("measure_")
        }
        assert measured == {name: values[name] for name in measured}
        assert measured["measure_drivable_share"] == 1.0
        assert by_outcome["invalid"]["measure_drivable_share"] is None
        again = await ask("export_artifacts", ids=[grid["batch_id"]], formats=["parquet"], folder="again")
        assert Path(again["files"][0]["path"]).read_bytes() == as_parquet.read_bytes()


async def test_a_scenario_is_exported_for_other_tools_with_its_roads(settings: Settings, tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    town_road().write(folder / "one.xml")
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:
        await client.call_tool("import_files", {"path": str(folder)})
        arguments = {"ids": ["ZAM_Builder-1_1_T-1"], "formats": ["openscenario"], "folder": "out"}
        result = await client.call_tool("export_artifacts", arguments)
        assert result.structured_content is not None
        files = {file["format"]: file for file in result.structured_content["files"]}
        assert set(files) == {"opendrive", "openscenario"}
        assert Path(files["opendrive"]["path"]).name in Path(files["openscenario"]["path"]).read_text()
        assert files["opendrive"]["geometry"]["max_m"] < 0.1
        assert files["opendrive"]["geometry"]["within_share"] == 1.0
        text = result.content[0].text  # type: ignore[union-attr]
        assert "100% of" in text
        assert "lost: 1 goal" in text
        taken = await client.call_tool("export_artifacts", arguments)
        assert taken.is_error
        assert "2 files already exist: " in taken.content[0].text  # type: ignore[union-attr]


async def test_a_run_has_no_roads_to_export(settings: Settings, tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    replace(town_road().cut(61), problems=(NEAR,)).write(folder / "one.xml")
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:
        await client.call_tool("import_files", {"path": str(folder)})
        made = await client.call_tool("run_planner", {"scenarios": ["ZAM_Builder-1_1_T-1"], "wait_s": 50})
        assert made.structured_content is not None
        run_id = made.structured_content["runs"][0]["run_id"]
        arguments = {"ids": [run_id], "formats": ["opendrive"], "folder": "out"}
        refused = await client.call_tool("export_artifacts", arguments)
        assert refused.is_error
        assert "as opendrive" in refused.content[0].text  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("planner", "name", "version", "told"),
    [
        ("mylane", "mylane:Default", "v2 (d4e5f6a)", "mylane:Default v2 (d4e5f6a)"),
        ("mylane", "mylane:Default v2 (d4e5f6a)", "v2 (d4e5f6a)", "mylane:Default v2 (d4e5f6a)"),
        ("mylane", "mylane:Default", "", "mylane:Default"),
        ("frenetix", "frenetix:Default", "0.4.0", "frenetix:Default"),
    ],
)
def test_a_report_names_the_version_of_an_own_planner_once(planner: str, name: str, version: str, told: str) -> None:
    run = record().model_copy(update={"planner": planner, "config_name": name, "planner_version": version})
    assert driven_by(run) == told
