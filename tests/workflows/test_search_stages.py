"""A search and its stages handed to a batch."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import pytest
from support.catalog import facts

from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.artifacts import ListArtifactsArguments
from plannerforge.schemas.catalog import FindScenariosArguments, FindScenariosResult, SearchRecord
from plannerforge.schemas.errors import NotPossible, UnknownName
from plannerforge.schemas.runs import BatchRecord
from plannerforge.schemas.scenarios import ScenarioFacts, ScenarioRecord
from plannerforge.workflows.artifacts import list_artifacts
from plannerforge.workflows.catalog import find_scenarios
from plannerforge.workflows.context import Services, WorkflowContext
from plannerforge.workflows.scenarios import ChosenScenario, choose_scenarios

pytestmark = pytest.mark.anyio
BONN, BILBAO, BERLIN = "DEU_Bonn-1_1_T-1", "ESP_Bilbao-1_1_T-1", "DEU_Berlin-1_1_T-1"


def store(call: WorkflowContext, all_facts: Sequence[ScenarioFacts]) -> None:
    for one in all_facts:
        record = ScenarioRecord(facts=one, origin="imported", content=one.scenario_id)
        call.workspace.put("scenario", one.scenario_id, recipe=Recipe(tool="import_files"), record=record)


@pytest.fixture
def call(tmp_path: Path) -> Iterator[WorkflowContext]:
    """A call on a workspace with three scenarios; nothing here needs a worker."""
    workspace, unused = Workspace(tmp_path), cast("Any", None)
    call = WorkflowContext(Services(workspace, unused, unused, unused, unused, with_starter=False), unused)
    trucks = {"truck": 2}
    two = facts(BONN, tags=["urban"], counts=trucks)
    second_ego = two.egos[0].model_copy(update={"problem_id": 7})
    store(call, [two.model_copy(update={"egos": (*two.egos, second_ego)})])
    store(call, [facts(BILBAO, tags=["urban"], counts=trucks), facts(BERLIN, tags=["highway"])])
    yield call
    workspace.close()


async def search(call: WorkflowContext, **slots: Any) -> FindScenariosResult:
    return await find_scenarios(FindScenariosArguments(**slots), call)


def chosen(call: WorkflowContext, word: str) -> list[ChosenScenario]:
    return list(choose_scenarios([word], call).scenarios)


def test_a_batch_stands_for_its_scenarios(call: WorkflowContext) -> None:
    record = BatchRecord(
        batch_id="batch_1",
        scenarios=(BERLIN, f"{BONN}#7"),
        configs=("cfg_1",),
        prediction="constant_velocity",
        traffic="recorded",
        runs=(),
        lost=(),
    )
    recipe = Recipe(tool="run_planner", arguments={}, parents=(), seed=0, versions={})
    call.workspace.put("batch", "batch_1", recipe=recipe, record=record)
    assert chosen(call, "batch_1") == [ChosenScenario(BERLIN), ChosenScenario(BONN, 7)]


async def test_a_stage_of_a_search_is_handed_to_a_batch(call: WorkflowContext) -> None:
    found = await search(call, country="DEU", tags=["urban"], obstacles=["bus"])
    bonn = [ChosenScenario(BONN), ChosenScenario(BONN, 7)]
    assert chosen(call, f"{found.search_id}:location") == [ChosenScenario(BERLIN), *bonn]
    assert chosen(call, "search:latest:tags") == bonn
    assert f"{found.search_id}:tags" in found.to_text()
    with pytest.raises(NotPossible) as empty:
        chosen(call, f"{found.search_id}:obstacles")
    assert empty.value.valid == (f"{found.search_id}:location", f"{found.search_id}:tags")
    with pytest.raises(UnknownName, match=f"{found.search_id}:tags"):
        chosen(call, f"{found.search_id}:velocity")


async def test_a_stage_of_a_refined_search_stays_within_it(call: WorkflowContext) -> None:
    first = await search(call, tags=["urban"])
    refined = await search(call, within=first.search_id, country="DEU", obstacles=["truck"])
    assert {one.scenario_id for one in chosen(call, f"{refined.search_id}:location")} == {BONN}


async def test_scenarios_added_after_the_search_are_not_in_its_stages(call: WorkflowContext) -> None:
    before = await search(call, country="DEU", obstacles=["bus"])
    store(call, [facts("DEU_Aachen-1_1_T-1")])
    after = await search(call, country="DEU", obstacles=["bus"])
    assert len(chosen(call, f"{before.search_id}:location")) == 3
    assert len(chosen(call, f"{after.search_id}:location")) == 4


async def test_a_hit_that_is_a_further_planning_problem_is_run_as_one(call: WorkflowContext) -> None:
    found = await search(call, tags=["urban"], country="DEU")
    assert chosen(call, found.search_id) == [ChosenScenario(BONN), ChosenScenario(BONN, 7)]


async def test_all_hits_are_run_and_refined_where_only_the_first_are_kept(
    call: WorkflowContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plannerforge.engine.catalog.search.MOST_KEPT", 1)
    found = await search(call, tags=["urban"])
    assert found.total == 3
    kept = call.workspace.get(found.search_id, "search").read(SearchRecord)
    assert (len(kept.scenario_ids), kept.total) == (1, 3)
    store(call, [facts("DEU_Aachen-1_1_T-1", tags=["urban"])])
    assert {one.scenario_id for one in chosen(call, found.search_id)} == {BONN, BILBAO}
    assert len(chosen(call, found.search_id)) == 3
    refined = await search(call, within=found.search_id, country="ESP")
    assert refined.total == 1


async def test_searches_are_listed_by_their_conditions(call: WorkflowContext) -> None:
    await search(call, country="DEU", tags=["urban"], obstacles=["truck>=1"], origin=None)
    await search(call)
    listed = await list_artifacts(ListArtifactsArguments(kind="search"), call)
    assert [one.name for one in listed.artifacts] == [
        "no conditions: 4 matches",
        "country DEU; tags urban; obstacles truck>=1: 2 matches",
    ]
