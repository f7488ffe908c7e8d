"""What a server does by itself after its start."""

from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.execution import CallThreads, Operation
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.schemas.base import Model
from plannerforge.schemas.catalog import BuildIndexRequest, BuildIndexResponse
from plannerforge.schemas.errors import PlannerForgeError, ResourceFailure
from plannerforge.server.assembly import calls_within, warm_up
from plannerforge.workflows.operations import BUILD_INDEX

pytestmark = pytest.mark.anyio


class NotedPool:
    """Notes what it was asked for, and fails if told to."""

    def __init__(self, failure: PlannerForgeError | None = None) -> None:
        self.failure = failure
        self.warmed: list[str] = []
        self.asked: list[Model] = []

    async def warm_up(self, lane: str) -> None:
        self.warmed.append(lane)

    async def run(self, operation: Operation[Any, Any], request: Model) -> BuildIndexResponse:
        assert operation == BUILD_INDEX
        self.asked.append(request)
        if self.failure:
            raise self.failure
        return BuildIndexResponse(descriptions=0, built=False)


async def warmed(pool: Any, root: Path) -> None:
    await warm_up(pool, Workspace(root), CallThreads(), "own/model", delay_s=0.0)


async def test_both_lanes_and_the_text_index_are_prepared(tmp_path: Path) -> None:
    pool = NotedPool()
    await warmed(pool, tmp_path)
    assert pool.warmed == ["compute", "retrieval"]
    assert pool.asked == [
        BuildIndexRequest(database=tmp_path / "workspace.sqlite", index=tmp_path / "index", model="own/model")
    ]


async def test_an_index_that_cannot_be_prepared_is_logged_without_harm(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    await warmed(NotedPool(ResourceFailure("no model of that name")), tmp_path)
    assert "no model of that name" in caplog.text


@pytest.mark.parametrize(("memory_mb", "calls"), [(256, 8), (1024, 32), (64, 1), (0, 32)])
def test_calls_at_once_fit_into_the_memory_of_the_server(memory_mb: int, calls: int) -> None:
    assert calls_within(memory_mb) == calls
