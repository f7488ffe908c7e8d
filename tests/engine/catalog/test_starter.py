"""A workspace's catalogue: the starter scenarios once, and whatever is stored, seen by every server."""

import errno
import os
from pathlib import Path

import pytest
from support.catalog import facts

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.engine.catalog.tables import refresh
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import ResourceFailure
from plannerforge.schemas.scenarios import ScenarioRecord


def count(workspace: Workspace) -> int:
    return int(workspace.database.connection().execute("SELECT count(*) FROM catalog_scenarios").fetchone()[0])


def store(workspace: Workspace, scenario_id: str) -> None:
    record = ScenarioRecord(facts=facts(scenario_id), origin="imported", content="0" * 64)
    workspace.put("scenario", scenario_id, recipe=Recipe(tool="import_files"), record=record)


def test_a_new_workspace_has_the_starter_scenarios_with_their_files(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    open_catalogue(workspace)
    assert count(workspace) >= 12
    for artifact in workspace.newest(kind="scenario", limit=100):
        assert artifact.read(ScenarioRecord).origin == "starter"
        assert workspace.file("scenario", artifact.artifact_id, "scenario.xml").stat().st_size > 1000
    workspace.close()


def test_the_starter_is_put_in_once(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    open_catalogue(workspace)
    before = count(workspace)
    open_catalogue(workspace)
    assert count(workspace) == before
    workspace.close()


def test_a_full_disk_leaves_no_starter_scenarios(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "no space left on device")

    workspace = Workspace(tmp_path)
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(ResourceFailure, match="no space left"):
        open_catalogue(workspace)
    assert workspace.newest(kind="scenario") == []
    monkeypatch.undo()
    open_catalogue(workspace)
    assert count(workspace) >= 12
    workspace.close()


def test_scenarios_of_another_server_are_entered_by_the_next_search(tmp_path: Path) -> None:
    one, other = Workspace(tmp_path), Workspace(tmp_path)
    open_catalogue(one, with_starter=False)
    store(other, "DEU_Bonn-1_1_T-1")
    assert count(one) == 0
    assert refresh(one.database) == 1
    assert count(other) == 1
    assert refresh(other.database) == 0
    one.close()
    other.close()


def test_tables_of_another_version_are_filled_again(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    open_catalogue(workspace, with_starter=False)
    store(workspace, "DEU_Bonn-1_1_T-1")
    refresh(workspace.database)
    with workspace.database.writing() as connection:
        connection.execute("UPDATE catalog_version SET version = -1")
    assert refresh(workspace.database) == 1
    assert count(workspace) == 1
    workspace.close()
