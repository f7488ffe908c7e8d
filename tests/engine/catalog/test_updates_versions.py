"""Of the versions of a scenario the catalogue lists the one that was imported last, also once it is rebuilt."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.catalog import facts

from plannerforge.engine.catalog.tables import family, list_again, listed_version, refresh
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.scenarios import ScenarioRecord


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    made = Workspace(tmp_path / "workspace")
    yield made
    made.close()


def put(workspace: Workspace, scenario_id: str, supersedes: str | None = None) -> None:
    record = ScenarioRecord(facts=facts(scenario_id), origin="imported", content=scenario_id, supersedes=supersedes)
    workspace.put("scenario", scenario_id, recipe=Recipe(tool="test", arguments={"id": scenario_id}), record=record)


def listed(workspace: Workspace) -> list[str]:
    refresh(workspace.database)
    rows = workspace.database.connection().execute("SELECT scenario_id FROM catalog_scenarios ORDER BY scenario_id")
    return [row[0] for row in rows]


def forget_tables(workspace: Workspace) -> None:
    with workspace.database.writing() as connection:
        connection.execute("DROP TABLE catalog_version")


def test_the_newest_version_is_listed(workspace: Workspace) -> None:
    put(workspace, "ZAM_A-1_1_T-1")
    put(workspace, "ZAM_B-1_1_T-1")
    assert listed(workspace) == ["ZAM_A-1_1_T-1", "ZAM_B-1_1_T-1"]
    put(workspace, "ZAM_A-1_2_T-1", "ZAM_A-1_1_T-1")
    put(workspace, "ZAM_A-1_3_T-1", "ZAM_A-1_2_T-1")
    assert listed(workspace) == ["ZAM_A-1_3_T-1", "ZAM_B-1_1_T-1"]
    assert family(workspace.database.connection(), "ZAM_A-1_2_T-1") == (
        "ZAM_A-1_1_T-1",
        "ZAM_A-1_2_T-1",
        "ZAM_A-1_3_T-1",
    )


def test_two_servers_that_change_the_same_version_leave_one_listed(workspace: Workspace) -> None:
    put(workspace, "ZAM_A-1_1_T-1")
    put(workspace, "ZAM_A-1_2_T-1", "ZAM_A-1_1_T-1")
    put(workspace, "ZAM_A-1_3_T-1", "ZAM_A-1_1_T-1")
    assert listed(workspace) == ["ZAM_A-1_3_T-1"]


def test_an_earlier_version_can_be_listed_again_until_a_newer_one_comes(workspace: Workspace) -> None:
    put(workspace, "ZAM_A-1_1_T-1")
    put(workspace, "ZAM_A-1_2_T-1", "ZAM_A-1_1_T-1")
    assert listed(workspace) == ["ZAM_A-1_2_T-1"]
    list_again(workspace.database, "ZAM_A-1_1_T-1")
    assert listed(workspace) == ["ZAM_A-1_1_T-1"]
    assert listed_version(workspace.database.connection(), "ZAM_A-1_2_T-1") == "ZAM_A-1_1_T-1"
    put(workspace, "ZAM_C-1_1_T-1")
    assert listed(workspace) == ["ZAM_A-1_1_T-1", "ZAM_C-1_1_T-1"]
    put(workspace, "ZAM_A-1_3_T-1", "ZAM_A-1_2_T-1")
    assert listed(workspace) == ["ZAM_A-1_3_T-1", "ZAM_C-1_1_T-1"]


def test_a_relisted_scenario_stays_listed_when_the_tables_are_rebuilt(workspace: Workspace) -> None:
    put(workspace, "ZAM_A-1_1_T-1")
    put(workspace, "ZAM_A-1_2_T-1", "ZAM_A-1_1_T-1")
    list_again(workspace.database, "ZAM_A-1_1_T-1")
    forget_tables(workspace)
    assert listed(workspace) == ["ZAM_A-1_1_T-1"]
    list_again(workspace.database, "ZAM_A-1_2_T-1")
    forget_tables(workspace)
    assert listed(workspace) == ["ZAM_A-1_2_T-1"]
