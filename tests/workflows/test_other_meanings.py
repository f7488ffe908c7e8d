"""A word that refers to something of another kind, or almost to something, is refused with what it may mean."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from support.catalog import facts
from support.runs import record

from plannerforge.engine.execution.jobs import JobStore
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.artifacts import ListArtifactsArguments
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName
from plannerforge.schemas.rendering import RenderArguments
from plannerforge.schemas.runs import BatchRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.workflows.artifacts import list_artifacts
from plannerforge.workflows.configurations import resolve_configuration
from plannerforge.workflows.context import Services, WorkflowContext
from plannerforge.workflows.rendering import named_artifact, render
from plannerforge.workflows.results import choose_results

SCENARIO = "DEU_Bonn-1_1_T-1"


@pytest.fixture
def call(tmp_path: Path) -> Iterator[WorkflowContext]:
    """A workspace with a scenario, a run on it, and the batch of this run."""
    workspace, unused = Workspace(tmp_path), cast("Any", None)
    bonn = ScenarioRecord(facts=facts(SCENARIO), origin="imported", content="bonn")
    workspace.put("scenario", SCENARIO, recipe=Recipe(tool="import_files"), record=bonn)
    run = record(SCENARIO).model_copy(update={"run_id": "run_0123456789ab"})
    workspace.put("run", run.run_id, recipe=Recipe(tool="run_planner"), record=run)
    batch = BatchRecord(
        batch_id="batch_0123456789ab",
        scenarios=(SCENARIO,),
        configs=(run.config_id,),
        prediction="constant_velocity",
        traffic="recorded",
        runs=(run.run_id,),
        lost=(),
    )
    workspace.put("batch", batch.batch_id, recipe=Recipe(tool="run_planner"), record=batch)
    jobs: Any = SimpleNamespace(store=JobStore(workspace.database))
    yield WorkflowContext(Services(workspace, unused, jobs, unused, unused, with_starter=False), unused)
    workspace.close()


def replaced(refusal: InvalidRequest) -> list[str]:
    """The words that the remedies write in place of the wrong ones."""
    return [word for remedy in refusal.remedies for change in remedy.changes for word in change.words.values()]


@pytest.mark.parametrize("word", ["run_0123456789ab", "batch_0123456789ab", "latest_run", "latest_batch"])
def test_a_result_in_place_of_a_scenario_is_refused_with_its_scenario(call: WorkflowContext, word: str) -> None:
    with pytest.raises(UnknownName) as refusal:
        call.artifact(word, "scenario")
    assert refusal.value.valid == (SCENARIO,)
    assert replaced(refusal.value) == [SCENARIO]


@pytest.mark.parametrize(
    ("word", "meant"), [("latest_btach", "latest_batch"), ("previus_run", "previous_run"), ("latst", "latest")]
)
def test_a_misspelt_word_for_a_result_is_proposed_first(call: WorkflowContext, word: str, meant: str) -> None:
    with pytest.raises(UnknownName) as refusal:
        choose_results([word], call)
    assert refusal.value.valid[0] == meant
    assert replaced(refusal.value)[0] == meant


def test_a_misspelt_latest_is_proposed(call: WorkflowContext) -> None:
    with pytest.raises(UnknownName) as refusal:
        call.artifact("latset", "scenario")
    assert replaced(refusal.value) == ["latest"]
    assert refusal.value.valid[0] == "latest"
    assert call.artifact("latest_scenario", "scenario").artifact_id == SCENARIO


@pytest.mark.parametrize("kind", ["scenario", "search", "study"])
def test_a_misspelt_word_for_the_newest_of_a_kind_is_proposed(call: WorkflowContext, kind: Any) -> None:
    with pytest.raises(UnknownName) as refusal:
        call.artifact(f"latest_{kind[:-2]}{kind[-1]}{kind[-2]}", kind)
    assert replaced(refusal.value)[0] == f"latest_{kind}"


def test_a_misspelt_word_for_a_result_is_refused_as_a_scenario_with_its_scenario(call: WorkflowContext) -> None:
    with pytest.raises(UnknownName) as refusal:
        call.artifact("latest_btach", "scenario")
    assert refusal.value.valid == (SCENARIO,)
    assert replaced(refusal.value) == [SCENARIO]


@pytest.mark.anyio
async def test_artifacts_of_a_word_for_a_result_are_listed_and_its_misspelling_corrected(call: WorkflowContext) -> None:
    with pytest.raises(UnknownName) as refusal:
        await list_artifacts(ListArtifactsArguments(parent="latest_btach"), call)
    assert replaced(refusal.value)[0] == "latest_batch"
    assert not (await list_artifacts(ListArtifactsArguments(parent="latest_batch"), call)).artifacts


def test_a_misspelt_word_for_the_current_configuration_is_proposed(call: WorkflowContext) -> None:
    with pytest.raises(UnknownName) as refusal:
        resolve_configuration("curent", call)
    assert replaced(refusal.value)[0] == "current"


@pytest.mark.parametrize("results", [("run_0123456789ab", "batch_0123456789ab"), ()])
def test_a_job_in_place_of_an_artifact_is_refused_with_its_results(
    call: WorkflowContext, results: tuple[str, ...]
) -> None:
    job, _ = call.jobs.store.start("batch", Recipe(tool="run_planner"))
    call.jobs.store.end(job.job_id, "done", results=results)
    ways: list[Callable[[], object]] = [
        lambda: named_artifact(job.job_id, call),
        lambda: choose_results([job.job_id], call),
        lambda: call.artifact(job.job_id, "study"),
    ]
    for way in ways:
        with pytest.raises(UnknownName) as refusal:
            way()
        assert set(refusal.value.valid) == set(results)
        assert replaced(refusal.value) == ["batch_0123456789ab"] * bool(results)


@pytest.mark.anyio
@pytest.mark.parametrize("kind", ["search", "boundary"])
async def test_a_kind_of_picture_without_its_artifact_is_drawn_without_the_kind(
    call: WorkflowContext, kind: Any
) -> None:
    with pytest.raises(NotPossible) as refusal:
        await render(RenderArguments(ids=[SCENARIO], kind=kind), call)
    assert refusal.value.remedies[-1].changes[0].values == {"kind": None}
