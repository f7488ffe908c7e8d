"""Workspaces of earlier versions of the database open with everything in them; a copy stays as it was.

``earlier/`` holds a workspace for each version, made by the last program of that version (commits af00222, 0a48a29 and
ecb00de) with its own ``plannerforge call``: a generated scenario, a configuration with its preset, a run, a search,
the journal.
"""

import sqlite3
import tarfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from support.artifacts import store_search
from support.server import Connect

from plannerforge.engine.execution import JobStore
from plannerforge.engine.workspace import Recipe, Workspace, disagreements, export_workspace, import_workspace
from plannerforge.engine.workspace.database import SCHEMA_VERSION
from plannerforge.schemas.errors import ResourceFailure
from plannerforge.server.settings import Settings

EARLIER = Path(__file__).parent / "earlier"
MADE = {
    1: ("run_b3085e620874", "ZAM_Kreiselheim-80708322_1_T-1", "search_a68248053e25"),
    2: ("run_98dd2be6b421", "ZAM_Kreiselheim-214760387_1_T-1", "search_be049abef292"),
    3: ("run_98dd2be6b421", "ZAM_Kreiselheim-214760387_1_T-1", "search_b07ca4c47803"),
    4: ("run_98dd2be6b421", "ZAM_Kreiselheim-214760387_1_T-1", "search_b07ca4c47803"),
}
CONFIGURATION = "cfg_504647410ee4"


def unpacked(version: int, root: Path) -> Path:
    with tarfile.open(EARLIER / f"version-{version}.tar.xz") as archive:
        archive.extractall(root, filter="data")
    return root


def version_of(database: Path) -> int:
    connection = sqlite3.connect(database)
    try:
        return int(connection.execute("PRAGMA user_version").fetchone()[0])
    finally:
        connection.close()


def test_there_is_a_workspace_of_every_earlier_version() -> None:
    assert sorted(MADE) == list(range(1, SCHEMA_VERSION))
    assert {path.name for path in EARLIER.iterdir()} == {f"version-{version}.tar.xz" for version in MADE}


@pytest.mark.parametrize("version", MADE)
def test_an_earlier_workspace_keeps_its_artifacts_and_a_copy_of_its_database(version: int, tmp_path: Path) -> None:
    root = unpacked(version, tmp_path / "workspace")
    assert version_of(root / "workspace.sqlite") == version
    workspace = Workspace(root)
    run, scenario, search = MADE[version]
    assert {each.artifact_id for each in workspace.newest()} >= {run, scenario, search, CONFIGURATION}
    assert {each.artifact_id for each in workspace.newest(parent=scenario)} >= {run}
    assert list(disagreements(workspace)) == []
    workspace.close()
    assert version_of(root / "workspace.sqlite") == SCHEMA_VERSION
    assert version_of(root / f"workspace.sqlite.version-{version}") == version


@pytest.mark.parametrize("version", MADE)
def test_features_of_later_versions_work_in_an_earlier_workspace(version: int, tmp_path: Path) -> None:
    workspace = Workspace(unpacked(version, tmp_path / "workspace"))
    job, is_new = JobStore(workspace.database).start("batch", Recipe(tool="run_planner"))
    assert (is_new, job.state) == (True, "running")
    tables = {row[0] for row in workspace.database.connection().execute("SELECT name FROM sqlite_master")}
    assert {"tasks", "claims", "map_files", "artifacts_by_superseded", "job_owners", "imported"} <= tables
    store_search(workspace, "new")
    export_workspace(workspace, tmp_path / "work.zip")
    assert import_workspace(Workspace(tmp_path / "other"), tmp_path / "work.zip").added == 6


@pytest.mark.anyio
@pytest.mark.parametrize("version", MADE)
async def test_tools_work_with_artifacts_of_an_earlier_program(
    version: int, connect: Connect, settings: Settings
) -> None:
    unpacked(version, settings.workspace)
    run, scenario, search = MADE[version]
    calls: tuple[tuple[str, dict[str, object], str], ...] = (
        ("list_artifacts", {"kind": "run"}, run),
        ("describe_scenario", {"scenario_id": scenario}, scenario),
        ("analyze_results", {"results": [run]}, run),
        ("find_scenarios", {"country": "ZAM"}, scenario),
        ("run_planner", {"scenarios": [search], "configs": [CONFIGURATION]}, scenario),
        ("list_planners", {"config_id": CONFIGURATION}, CONFIGURATION),
    )
    async with connect(settings.model_copy(update={"starter": False})) as client:
        for tool, arguments, told in calls:
            answer = await client.call_tool(tool, arguments)
            said = answer.content[0].text  # type: ignore[union-attr]
            assert not answer.is_error, f"{tool}: {said}"
            assert told in said


def test_servers_that_open_an_earlier_workspace_at_once_keep_the_copy_as_it_was(tmp_path: Path) -> None:
    root = unpacked(1, tmp_path / "workspace")
    with ThreadPoolExecutor(8) as threads:
        counts = list(threads.map(lambda _: len(Workspace(root).newest()), range(8)))
    assert counts == [5] * 8
    assert version_of(root / "workspace.sqlite.version-1") == 1
    assert [path.name for path in root.glob("*.partial")] == []


def test_a_copy_that_is_there_stays(tmp_path: Path) -> None:
    root = unpacked(2, tmp_path / "workspace")
    (root / "workspace.sqlite.version-2").write_text("of another day")
    Workspace(root).newest()
    assert (root / "workspace.sqlite.version-2").read_text() == "of another day"


def test_a_newer_workspace_is_refused_and_left_alone(tmp_path: Path) -> None:
    root = unpacked(2, tmp_path / "workspace")
    connection = sqlite3.connect(root / "workspace.sqlite")
    connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    connection.close()
    with pytest.raises(ResourceFailure, match=f"version {SCHEMA_VERSION + 1}; this program supports {SCHEMA_VERSION}"):
        Workspace(root).newest()
    assert version_of(root / "workspace.sqlite") == SCHEMA_VERSION + 1
    assert list(root.glob("*.version-*")) == []
