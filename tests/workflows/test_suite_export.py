"""Runs exported as a suite: another workspace repeats them, and says which failures are fixed, left or new."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest
import yaml
from mcp import Client
from support.builders import driving, town_road
from typer.testing import CliRunner, Result

from plannerforge.cli.program import application
from plannerforge.schemas.analysis.suite import SuiteBaseline, SuiteReport
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.usefixtures("warm_workers")
FIRST, SECOND = "ZAM_Builder-1_1_T-1", "ZAM_Builder-2_1_T-1"
STANDING = driving(31, (90, 0), 0.0, 151)


def exported(settings: Settings, folder: Path, config: dict[str, Any] | str = "keep_lane") -> tuple[Any, list[Any]]:
    """Run two scenarios with a standing car ahead, and export the batch as a suite.

    Return the answer, and those to a scenario and a configuration as a suite.
    """
    (folder / "maps").mkdir()
    for name in (FIRST, SECOND):
        replace(town_road().with_vehicles(STANDING), benchmark_id=name).write(folder / "maps" / f"{name}.xml")
    own = settings.model_copy(update={"starter": False})

    async def export() -> tuple[Any, list[Any]]:
        async with Client(create_server(own, start_folder=folder)) as client:

            async def ask(tool: str, **arguments: Any) -> Any:
                result = await client.call_tool(tool, arguments)
                return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

            await ask("import_files", path=str(folder / "maps"))
            configs = [config] if isinstance(config, str) else [(await ask("configure_planner", **config))["config_id"]]
            grid = await ask("run_planner", scenarios=[FIRST, SECOND], configs=configs, wait_s=50)
            wrong = [
                await ask("export_artifacts", ids=[key], formats=["suite"], folder="no") for key in (FIRST, "current")
            ]
            return await ask("export_artifacts", ids=[grid["batch_id"]], formats=["suite"], folder="suite"), wrong

    return anyio.run(export)


def repeated(folder: Path, *flags: str) -> Result:
    """Run the suite in another workspace."""
    runner = CliRunner(env={"COLUMNS": "250", "PLANNERFORGE_MAPS_ONLINE": "offline"})
    arguments = ["test", str(folder / "suite" / "suite.yaml"), "--workspace", str(folder / "elsewhere"), *flags]
    return runner.invoke(application, arguments)


def test_an_exported_suite_tells_which_failures_are_fixed_left_or_new(settings: Settings, tmp_path: Path) -> None:
    made, wrong = exported(settings, tmp_path)
    assert all("[invalid_request]" in refusal for refusal in wrong)
    assert not (tmp_path / "no").exists()
    suite = tmp_path / "suite" / "suite.yaml"
    assert Path(made["files"][0]["path"]).name == "suite.yaml"
    content = yaml.safe_load(suite.read_text())
    assert content["configurations"] == ["keep_lane:Default"]
    assert content["scenarios"] == [{"files": f"scenarios/{name}.xml"} for name in (FIRST, SECOND)]
    baseline = SuiteBaseline.model_validate_json((suite.parent / "baseline.json").read_bytes())
    before = {record.run_id for records in baseline.configurations.values() for record in records}

    report = tmp_path / "report.json"

    def progress(**keys: object) -> tuple[int, tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        suite.write_text(yaml.safe_dump(content | keys), encoding="utf-8")
        result = repeated(tmp_path, "--report", str(report))
        assert result.exit_code in (0, 1), result.output
        (told,) = SuiteReport.model_validate_json(report.read_bytes()).progress
        return result.exit_code, told.fixed, told.still_failing, told.newly_failing

    assert progress() == (1, (), (FIRST, SECOND), ())
    runs = SuiteReport.model_validate_json(report.read_bytes()).cases
    assert {case.run_id for case in runs} == before
    better = [{"name": "keep_lane:Default", "planner": "idm"}]
    assert progress(configurations=better) == (0, (FIRST, SECOND), (), ())
    saved = repeated(tmp_path, "--save-baseline", str(suite.parent / "baseline.json"))
    assert saved.exit_code == 0
    assert progress() == (1, (), (), (FIRST, SECOND))


def test_a_configuration_that_is_no_preset_travels_as_a_weight_file(settings: Settings, tmp_path: Path) -> None:
    exported(settings, tmp_path, {"base": "idm", "settings": ["horizon_s=2"]})
    (entry,) = yaml.safe_load((tmp_path / "suite" / "suite.yaml").read_text())["configurations"]
    weights = tmp_path / "suite" / entry["file"]
    assert weights.is_file()
    report = tmp_path / "report.json"
    repeated(tmp_path, "--report", str(report))
    runs = SuiteReport.model_validate_json(report.read_bytes()).runs.configurations[entry["name"]]
    assert {record.config_id for record in runs} == {weights.stem}
