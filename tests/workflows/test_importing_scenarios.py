"""Files are stored in the order of their names, whatever the order in which workers come back or die."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import anyio
import pytest
from support.builders import town_road
from support.catalog import facts

from plannerforge.engine.execution import Limits, Operation
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.schemas.artifacts import ImportedItem
from plannerforge.schemas.errors import PlannerForgeError, WorkerFailure, WorkerTimeout
from plannerforge.schemas.scenarios import ReadFactsRequest, ScenarioFacts
from plannerforge.workflows.context import WorkflowContext
from plannerforge.workflows.operations import READ_FACTS
from plannerforge.workflows.scenario_storage import import_scenarios

pytestmark = pytest.mark.anyio


@dataclass
class Reader:
    """Workers that need longer for earlier files, and die as often as they are told."""

    deaths: dict[str, list[WorkerFailure]] = field(default_factory=dict)
    capacity: int = 2

    async def run(self, operation: Operation[Any, Any], request: ReadFactsRequest) -> ScenarioFacts:
        assert operation == READ_FACTS
        name = request.path.stem
        if self.deaths.get(name):
            raise self.deaths[name].pop(0)
        await anyio.sleep(0.05 if name == "1" else 0.0)
        return facts(f"ZAM_Order-1_{name}_T-1")


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    made = Workspace(tmp_path / "workspace")
    yield made
    made.close()


async def imported(
    workspace: Workspace, folder: Path, reader: Reader, files: int
) -> list[ImportedItem | PlannerForgeError]:
    paths = []
    for index in range(1, files + 1):
        paths.append(folder / f"{index}.xml")
        paths[-1].write_text(town_road().cut(1 + index).xml(), encoding="utf-8")
    limits = Limits(
        roots=(folder,), file_bytes=1_000_000, operation_timeout_s=60.0, worker_memory_bytes=0, worker_count=2
    )
    call: Any = SimpleNamespace(
        workspace=workspace, services=SimpleNamespace(workers=reader), limits=limits, allowed_path=limits.allowed_path
    )
    heard: list[tuple[Path, ImportedItem | PlannerForgeError]] = []
    await import_scenarios(cast("WorkflowContext", call), paths, lambda path, outcome: heard.append((path, outcome)))
    assert [path for path, _ in heard] == paths
    return [outcome for _, outcome in heard]


async def test_the_order_of_the_names_decides(workspace: Workspace, tmp_path: Path) -> None:
    await imported(workspace, tmp_path, Reader(), 5)
    stored = workspace.newest(kind="scenario", limit=9)[::-1]
    assert [one.artifact_id for one in stored] == [f"ZAM_Order-1_{index}_T-1" for index in range(1, 6)]


async def test_a_file_is_read_by_another_worker_after_one_dies(workspace: Workspace, tmp_path: Path) -> None:
    outcomes = await imported(workspace, tmp_path, Reader({"2": [WorkerFailure("killed")]}), 3)
    assert all(isinstance(outcome, ImportedItem) for outcome in outcomes)


@pytest.mark.parametrize("deaths", [[WorkerFailure("killed"), WorkerFailure("killed")], [WorkerTimeout("too long")]])
async def test_a_file_that_crashes_its_workers_is_refused_and_the_rest_is_imported(
    workspace: Workspace, tmp_path: Path, deaths: list[WorkerFailure]
) -> None:
    outcomes = await imported(workspace, tmp_path, Reader({"2": list(deaths)}), 3)
    assert [isinstance(outcome, PlannerForgeError) for outcome in outcomes] == [False, True, False]
