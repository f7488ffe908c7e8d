"""Planners of others through a real client session: listed, configured, and run in a batch beside built-in ones."""

import os
import shutil
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support import own_planner_program
from support.builders import Problem, town_road
from support.own_planners import STRAIGHT, install

from plannerforge.engine.execution import pool
from plannerforge.engine.planners import PLANNERS
from plannerforge.schemas.planning import CommandPlanner
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
Call = Callable[..., Awaitable[Any]]
MISBEHAVING = {
    "hangs": "within 0.7 s",
    "floods": "more than 1 MB to standard output",
    "writes_five_gb": "more than 2 MB",
    "exits_three": "ended with exit status 3",
    "not_a_number": "a number that is not finite",
    "other_scenario": "DEU_Other-1_1_T-1",
}
PROGRAM = own_planner_program.__file__


@pytest.fixture
async def call(settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Call]:
    """A server with workers of its own, as those that are kept between tests know no planners of others."""
    site, files = tmp_path / "site", tmp_path / "files"
    install(site, "theirs")
    install(site, "faulty", "import absent_library")
    install(site, "idm", package="own_idm")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH", "")])))
    monkeypatch.setitem(pool.PRELOAD, "compute", ())
    files.mkdir()
    near = Problem(goal=(65.0, 0.0, 8.0, 3.0), steps=(15, 35))
    replace(town_road().with_vehicles(), problems=(near,)).write(files / "one.xml")
    programs = {
        name: CommandPlanner(
            summary=f"a program that {name}",
            command=(sys.executable, "-S", PROGRAM, name),
            time_s=0.7 if name == "hangs" else 60.0,
            folder_mb=2,
            output_mb=1,
            environment={"CHILD_FILE": str(tmp_path / "child")},
        )
        for name in ("looks", *MISBEHAVING)
    }
    own = settings.model_copy(update={"starter": False, "planners": programs})
    async with Client(create_server(own, start_folder=tmp_path)) as client:

        async def ask(tool: str, **arguments: Any) -> Any:
            result = await client.call_tool(tool, arguments)
            return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

        assert (await ask("import_files", path=str(files)))["added"] == 1
        yield ask


async def test_results_stay_readable_without_their_planner(call: Call, tmp_path: Path) -> None:
    scenarios = ["ZAM_Builder-1_1_T-1"]
    batch = await call("run_planner", scenarios=scenarios, configs=["idm", "theirs"], wait_s=50)
    shutil.rmtree(tmp_path / "site" / "own_theirs-1.0.dist-info")
    assert "there is no planner 'theirs'" in await call("run_planner", scenarios=scenarios, configs=["theirs"])
    analyzed = await call("analyze_results", results=[batch["batch_id"]])
    assert analyzed["runs"] == 2
    assert any(note.startswith("not installed here: theirs") for note in analyzed["notes"])
    compared = await call("compare_results", results=[batch["batch_id"]])
    assert "theirs:Default" in str(compared)
    assert isinstance(compared, dict), "no refusal"
    drawn = await call("render", ids=[batch["batch_id"]])
    assert drawn is None, "a picture without structure, and no refusal"


async def test_planners_of_others_go_the_whole_way(call: Call, tmp_path: Path) -> None:
    listed = {item["name"]: item["summary"] for item in (await call("list_planners"))["planners"]}
    assert list(listed) == [*PLANNERS, "theirs", "faulty", "looks", *MISBEHAVING, "refused"]
    assert "cannot be used: planner faulty: own_faulty:PLANNER" in listed["faulty"]
    assert "built-in planner idm" in listed["refused"]
    assert listed["looks"] == "a program that looks"
    assert "own_theirs" not in sys.modules, "the server's process runs no code of others"
    configured = await call("configure_planner", base="theirs:Lazy", weights=["slower_mps2=0.5"])
    assert configured["name"] == "theirs:Lazy [slower_mps2=0.5]"
    configurations = ["idm", configured["config_id"], "looks", *MISBEHAVING]
    batch = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"], configs=configurations, wait_s=50)
    assert batch["state"] == "done"
    assert [run["config_name"].split(":")[0] for run in batch["runs"]] == ["idm", "theirs", "looks"]
    assert {run["outcome"] for run in batch["runs"]} == {"goal_reached"}
    assert len(batch["lost"]) == len(MISBEHAVING)
    for (name, told), lost in zip(MISBEHAVING.items(), batch["lost"], strict=True):
        assert lost["error"].startswith(f"[planner_failure] planner {name} ")
        assert told in lost["error"]
    folder = next((tmp_path / "workspace").rglob("planner.log"))
    assert "has the file" in folder.read_text()
    written = tmp_path / "theirs.yaml"
    written.write_text(configured["yaml"])
    imported = await call("import_files", path=str(written))
    read = await call("list_planners", config_id=imported["items"][0]["artifact_id"])
    assert {weight["name"]: weight["value"] for weight in read["weights"]} == {"slower_mps2": 0.5}
    assert "[planner_failure] planner faulty" in await call("configure_planner", base="faulty")
    again = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"], configs=configurations[1:3], wait_s=50)
    assert again["reused"] == 2
    (tmp_path / "site" / "own_theirs.py").write_text(STRAIGHT + "# edited\n")
    after = await call("run_planner", scenarios=["ZAM_Builder-1_1_T-1"], configs=configurations[1:2], wait_s=50)
    assert after["reused"] == 0, "another version of the planner"
