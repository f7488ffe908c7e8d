"""``criticality``: the encounter that the search finds near a generated scenario becomes part of it."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
from support.artifacts import store_scenario
from support.builders import ScenarioBuilder, driving, town_road

from benchmarks.harness import call_in_process
from plannerforge.engine.execution import Executor
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.errors import WorkerTimeout
from plannerforge.schemas.generation import Criticality, ScenarioSummary
from plannerforge.workflows import critical_scenarios
from plannerforge.workflows.context import WorkflowContext

pytestmark = pytest.mark.anyio
BASE = "ZAM_Town-1_1_T-1"
QUIET = town_road().with_vehicles(driving(34, (280, 7), 11.0, 81, heading_rad=3.14159))


async def critical(
    folder: Path, criticality: Criticality, builder: ScenarioBuilder = QUIET
) -> tuple[ScenarioSummary, WorkflowContext]:
    workspace = Workspace(folder / "workspace")
    if workspace.find("scenario", BASE) is None:
        store_scenario(workspace, BASE, builder.write(folder / "town.xml"))
    context = call_in_process(workspace)
    generated = ScenarioSummary.model_construct(scenario_id=BASE, notes=[], encounter="")
    return await critical_scenarios.with_encounter(context, generated, criticality, 0), context


async def test_a_raised_scenario_has_an_added_encounter_and_is_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(critical_scenarios.RUNS, "raised", 6)
    made, context = await critical(tmp_path, "raised")
    assert made.scenario_id != BASE
    assert made.encounter
    recipe = context.workspace.get(made.scenario_id, "scenario").recipe
    assert recipe.tool == "modify_scenario"
    assert recipe.parents == (BASE,)
    again, _ = await critical(tmp_path, "raised")
    assert (again.scenario_id, again.encounter) == (made.scenario_id, made.encounter)


async def test_the_search_for_an_encounter_shows_its_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(critical_scenarios.RUNS, "raised", 6)
    shares: list[float] = []

    async def shown(share: float, message: str) -> None:
        assert message
        shares.append(share)

    workspace = Workspace(tmp_path / "workspace")
    store_scenario(workspace, BASE, QUIET.write(tmp_path / "town.xml"))
    whole = WorkflowContext(call_in_process(workspace).services, shown)
    generated = ScenarioSummary.model_construct(scenario_id=BASE, notes=[], encounter="")
    await critical_scenarios.with_encounter(whole.within(0.5, 1.0), generated, "raised", 0)
    assert len(shares) > 1
    assert shares == sorted(shares)
    assert 0.5 <= shares[0] < shares[-1] <= 1.0


async def test_a_search_that_takes_too_long_leaves_the_scenario_with_advice(tmp_path: Path) -> None:
    class Slow:
        """Workers whose operations all exceed their time."""

        async def run(self, *_: object, **__: object) -> None:
            raise WorkerTimeout("the step open_space took longer than 300 s and was stopped")

    workspace = Workspace(tmp_path / "workspace")
    store_scenario(workspace, BASE, QUIET.write(tmp_path / "town.xml"))
    services = replace(call_in_process(workspace).services, workers=cast("Executor", Slow()))
    generated = ScenarioSummary.model_construct(scenario_id=BASE, notes=[], encounter="")
    made = await critical_scenarios.with_encounter(WorkflowContext(services), generated, "critical", 0)
    assert made.scenario_id == BASE
    assert "find_failures" in made.notes[0]


async def test_a_scenario_in_which_the_planner_fails_unavoidably_stays_as_it_is(tmp_path: Path) -> None:
    in_contact_soon = town_road().with_vehicles(driving(31, (46, 0), 0.0, 81))
    made, _ = await critical(tmp_path, "critical", in_contact_soon)
    assert made.scenario_id == BASE
    assert len(made.notes) == 1
    assert not made.encounter
