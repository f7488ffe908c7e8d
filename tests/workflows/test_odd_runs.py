"""What the catalogue's coverage of an operational design domain counts as a failed run."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from support.artifacts import store_scenario
from support.builders import town_road
from support.runs import record

from benchmarks.harness import call_in_process
from plannerforge.engine.execution import Limits
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.catalog import DescribeCatalogArguments
from plannerforge.schemas.runs import Outcome
from plannerforge.workflows.catalog import describe_catalog
from plannerforge.workflows.context import WorkflowContext

TOWN = """
TAXONOMY:
  dynamic:
    traffic_density: [low, medium, high]
MODULES:
  town:
    INCLUDE_AND:
      traffic_density: [low, medium, high]
"""


@pytest.mark.anyio
async def test_every_run_that_does_not_reach_its_goal_counts_as_failed(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace")
    store_scenario(workspace, "ZAM_Town-1_1_T-1", town_road().write(tmp_path / "town.xml"))
    for seed, outcome in enumerate(get_args(Outcome)):
        run = record("ZAM_Town-1_1_T-1", outcome, seed=seed)
        workspace.put("run", run.run_id, recipe=Recipe(tool="run_planner", seed=seed), record=run)
    (tmp_path / "town.yaml").write_text(TOWN, encoding="utf-8")
    services = replace(call_in_process(workspace).services, limits=Limits(roots=(tmp_path,)))
    answer = await describe_catalog(
        DescribeCatalogArguments(odd=str(tmp_path / "town.yaml")), WorkflowContext(services)
    )
    assert answer.odd is not None
    assert (answer.odd.inside.scenarios, answer.odd.inside.runs) == (1, len(get_args(Outcome)) - 1)
    assert answer.odd.inside.failed == answer.odd.inside.runs - 1
    workspace.close()
