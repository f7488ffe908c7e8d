"""What the list of artifacts says about jobs, about candidates of a search, and if it is empty."""

from pathlib import Path
from typing import Any, cast

import pytest
from support.server import Connect

from plannerforge.engine.execution import JobStore
from plannerforge.engine.tuning import changed_configuration, named_configuration
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.server.settings import Settings
from plannerforge.workflows import configurations
from plannerforge.workflows.context import Limits, Services, WorkflowContext

pytestmark = pytest.mark.anyio


async def _lines(connect: Connect, **arguments: object) -> tuple[list[str], bool]:
    async with connect() as client:
        answer = await client.call_tool("list_artifacts", arguments)
    return str(answer.content[0].text).splitlines(), bool(answer.is_error)  # type: ignore[union-attr]


async def test_a_job_s_line_ends_with_its_start_and_counts_the_parents_that_it_leaves_out(
    connect: Connect, settings: Settings
) -> None:
    store = JobStore(Workspace(settings.workspace).database)
    job, _ = store.start("batch", Recipe(tool="run_planner", parents=tuple(f"ZAM_A-{one}_1_T-1" for one in range(6))))
    store.start("study", Recipe(tool="optimize_planner"))
    (line,), _ = await _lines(connect, kind="job", text="run_planner")
    assert line.startswith(job.job_id)
    assert " and 2 more, 20" in line
    assert line.endswith("Z")
    assert len((await _lines(connect, kind="job"))[0]) == 2


@pytest.mark.parametrize(
    ("kind", "tool"), [("run", "run_planner"), ("map", "describe_catalog"), ("study", "optimize_planner")]
)
async def test_an_empty_list_names_the_call_that_creates_this_kind(connect: Connect, kind: str, tool: str) -> None:
    lines, _ = await _lines(connect, kind=kind)
    assert tool in lines[-1]
    filtered, _ = await _lines(connect, kind=kind, text="nothing like it")
    assert tool not in filtered[-1]


async def test_an_unknown_parent_is_refused(connect: Connect) -> None:
    (line,), is_error = await _lines(connect, parent="nothing")
    assert is_error
    assert line.startswith("[unknown_name]")


def test_a_candidate_of_a_search_is_neither_a_preset_nor_the_current_configuration(tmp_path: Path) -> None:
    workspace, unused = Workspace(tmp_path / "workspace"), cast("Any", None)
    call = WorkflowContext(Services(workspace, unused, unused, unused, Limits(roots=(tmp_path,))))
    base = named_configuration("idm:Default")
    assert isinstance(base, PlannerConfiguration)
    candidate, _ = changed_configuration(base, None, ["time_headway_s=0.5"])
    searched = Recipe(tool=configurations.BY_SEARCH, parents=(base.config_id,))
    stored = configurations.store_configuration(call, candidate, searched)
    assert stored.recipe.tool == "optimize_planner"
    assert configurations.made_configurations(call, 9) == []
