"""What becomes of files that were read, where others import at the same time or files change meanwhile."""

from collections.abc import Iterator
from pathlib import Path

import anyio
import pytest
from support.builders import town_road
from support.catalog import facts

from plannerforge.engine.catalog import ReadFile, ScenarioIntake
from plannerforge.engine.workspace import Workspace, content_digest
from plannerforge.schemas.artifacts import ImportedItem
from plannerforge.schemas.errors import PlannerForgeError

pytestmark = pytest.mark.anyio
ID = "ZAM_Builder-1_1_T-1"


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    made = Workspace(tmp_path / "workspace")
    yield made
    made.close()


def read(path: Path, vehicles: int = 5) -> ReadFile:
    road = town_road()
    road.with_vehicles(*road.vehicles[:vehicles]).cut(3).write(path)
    return ReadFile(path, content_digest(path), facts(ID))


def listed(workspace: Workspace) -> list[str]:
    rows = workspace.database.connection().execute("SELECT scenario_id FROM catalog_scenarios")
    return [row[0] for row in rows]


async def test_two_imports_at_once_of_other_content_under_one_id_give_two_versions(
    workspace: Workspace, tmp_path: Path
) -> None:
    files = [read(tmp_path / f"{count}.xml", count) for count in (1, 2)]
    outcomes: list[ImportedItem | PlannerForgeError] = []

    async def store(file: ReadFile) -> None:
        outcomes.extend(await ScenarioIntake(workspace).store([file]))

    async with anyio.create_task_group() as tasks:
        for file in files:
            tasks.start_soon(store, file)
    ids = [item.artifact_id for item in outcomes if isinstance(item, ImportedItem)]
    assert len(set(ids)) == 2
    assert ids[0] == ID
    assert listed(workspace) == [ids[1]]


async def test_two_imports_at_once_of_one_content_give_one_scenario(workspace: Workspace, tmp_path: Path) -> None:
    file = read(tmp_path / "one.xml")
    async with anyio.create_task_group() as tasks:
        for _ in range(2):
            tasks.start_soon(ScenarioIntake(workspace).store, [file])
    assert listed(workspace) == [ID]


async def test_a_file_that_vanishes_before_storage_does_not_block_the_others(
    workspace: Workspace, tmp_path: Path
) -> None:
    gone, good = read(tmp_path / "gone.xml", 1), read(tmp_path / "good.xml", 2)
    gone.path.unlink()
    other = ReadFile(good.path, good.content, facts("ZAM_Other-1_1_T-1"))
    refused, taken = await ScenarioIntake(workspace).store([gone, other])
    assert isinstance(refused, PlannerForgeError)
    assert isinstance(taken, ImportedItem)
    assert listed(workspace) == ["ZAM_Other-1_1_T-1"]
