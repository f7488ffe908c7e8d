"""Consistent artifacts of a workspace: ids follow from recipes, and records match their models."""

from pathlib import Path

from plannerforge.engine.workspace import Artifact, Recipe, Workspace, content_digest
from plannerforge.schemas.catalog import FindScenariosArguments, SearchRecord
from plannerforge.schemas.runs import RunRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from support.catalog import facts
from support.runs import record


def run_id_of(recipe: Recipe) -> str:
    return f"run_{recipe.digest}"


def run_record_of(recipe: Recipe, reason: str = "") -> RunRecord:
    return record("ZAM_A-1_1_T-1").model_copy(update={"run_id": run_id_of(recipe), "reason": reason})


def store_run(workspace: Workspace, recipe: Recipe, steps: Path, reason: str = "") -> Artifact:
    made = run_record_of(recipe, reason)
    return workspace.put("run", made.run_id, recipe=recipe, record=made, files={"steps.json": steps})


def store_search(workspace: Workspace, text: str, recipe: Recipe | None = None) -> Artifact:
    made_by = recipe or Recipe(tool="find_scenarios", arguments={"text": text})
    record = SearchRecord(arguments=FindScenariosArguments(text=text), scenario_ids=(), stages=())
    return workspace.put("search", f"search_{made_by.digest}", recipe=made_by, record=record)


def store_scenario(workspace: Workspace, scenario_id: str, xml: Path) -> Artifact:
    record = ScenarioRecord(facts=facts(scenario_id), origin="imported", content=content_digest(xml))
    recipe = Recipe(tool="generate_scenarios")
    return workspace.put("scenario", scenario_id, recipe=recipe, record=record, name="one", files={"scenario.xml": xml})
