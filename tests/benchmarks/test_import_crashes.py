"""An import that is killed at any moment leaves a workspace that agrees with itself, and goes on where it was."""

import hashlib
import random
from dataclasses import replace
from pathlib import Path

from support.builders import town_road
from support.catalog import facts

from benchmarks.faults.imports import disagreements, kill_imports
from plannerforge.engine.catalog.tables import refresh
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.scenarios import ScenarioRecord

FILES, KILLS = 8, 1


def test_kills_at_random_times_leave_the_workspace_consistent(tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    for index in range(1, FILES + 1):
        replace(town_road().cut(4), benchmark_id=f"ZAM_Struck-1_{index}_T-1").write(folder / f"{index}.xml")
    tally = kill_imports(tmp_path / "workspaces", folder, random.Random(4), KILLS)
    assert tally.faults == []
    assert tally.kills.total() == KILLS


def test_inconsistencies_are_found(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace")
    file = town_road().write(tmp_path / "town.xml")
    content = hashlib.sha256(file.read_bytes()).hexdigest()
    for key in ("ZAM_One-1_1_T-1", "ZAM_Two-1_1_T-1"):
        record = ScenarioRecord(facts=facts(key), origin="imported", content=content)
        recipe = Recipe(tool="test", arguments={"id": key})
        workspace.put("scenario", key, recipe=recipe, record=record, files={"scenario.xml": file})
    refresh(workspace.database)
    assert disagreements(workspace.root) == []
    workspace.file("scenario", "ZAM_One-1_1_T-1", "scenario.xml").write_text("other", encoding="utf-8")
    with workspace.database.writing() as connection:
        connection.execute("DELETE FROM catalog_scenarios WHERE scenario_id = 'ZAM_Two-1_1_T-1'")
    workspace.close()
    found = disagreements(workspace.root)
    assert any("ZAM_One-1_1_T-1" in fault for fault in found)
    assert any("the catalogue lists" in fault for fault in found)
