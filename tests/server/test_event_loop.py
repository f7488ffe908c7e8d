"""The thread of the event loop serves clients and nothing else: the work of every call is done in another one."""

from collections.abc import Callable
from typing import Any

import pytest
from support.loop_watch import LoopWatch, watched_loop

from plannerforge.engine.catalog import open_catalogue
from plannerforge.engine.workspace import Workspace
from plannerforge.resources.templates import SCHEME
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]

CALLS: list[tuple[str, dict[str, Any]]] = [
    ("describe_catalog", {}),
    ("find_scenarios", {"obstacles": ["car>=1"]}),
    ("find_scenarios", {"within": "search_000000000000"}),
    ("list_planners", {}),
    ("configure_planner", {"preset": "Comfort", "weights": ["jerk*2"]}),
    ("list_artifacts", {"text": "urban"}),
    ("get_job", {}),
    ("run_planner", {"scenarios": ["preset:500", "NOWHERE-1"]}),
    ("import_files", {"path": ".", "kind": "map"}),
    ("export_artifacts", {"ids": ["latest"], "folder": "exported"}),
    ("render", {"ids": ["x" * 200]}),
    ("analyze_results", {"results": [str(number) for number in range(5000)]}),
]


@pytest.mark.parametrize(("tool", "arguments"), CALLS, ids=[f"{tool}-{i}" for i, (tool, _) in enumerate(CALLS)])
async def test_no_call_works_in_the_thread_of_the_loop(connect: Any, tool: str, arguments: dict[str, Any]) -> None:
    async with connect() as client:
        with watched_loop():
            await client.call_tool(tool, arguments)


async def test_no_resource_is_read_in_the_thread_of_the_loop(connect: Any, settings: Settings) -> None:
    workspace = Workspace(settings.workspace)
    scenario_id = workspace.newest(kind="scenario", limit=1)[0].artifact_id
    workspace.close()
    async with connect() as client:
        with watched_loop():
            await client.read_resource(f"{SCHEME}scenario/{scenario_id}/xml")


@pytest.mark.parametrize(
    "work", [lambda folder: (folder / "a").write_text("a"), lambda folder: open_catalogue(Workspace(folder / "w"))]
)
def test_the_watchdog_sees_work_that_would_block_the_loop(tmp_path: Any, work: Callable[[Any], object]) -> None:
    with pytest.raises(AssertionError, match="the event loop's thread ran"), watched_loop() as watch:
        work(tmp_path)
    assert isinstance(watch, LoopWatch)
