"""The batches of a workspace in one list: what came out of each, with the rates that analyses have."""

import pytest
from mcp import Client
from support.runs import DEFAULT, SAFE, record
from support.server import Connect

from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.artifacts import ListArtifactsResult
from plannerforge.schemas.results import AnalyzeResultsResult
from plannerforge.schemas.runs import BatchRecord, LostCell, Outcome, RunRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
ONE, TWO, THREE = "ZAM_Landmoor-32_1_T-1", "ZAM_Fahrhausen-4_1_T-1", "ZAM_Musterstadt-3_1_T-1"
EDITED = "ZAM_Landmoor-32_2_T-1"


async def _with_starter(client: Client, settings: Settings) -> Workspace:
    """The workspace, its starter scenarios taken in."""
    assert not (await client.call_tool("describe_scenario", {"scenario_id": ONE})).is_error
    return Workspace(settings.workspace)


def _record(workspace: Workspace, scenario_id: str, outcome: Outcome) -> RunRecord:
    """A run of the scenario's first planning problem."""
    ego = workspace.get(scenario_id, "scenario").read(ScenarioRecord).facts.egos[0]
    return record(scenario_id, outcome).model_copy(update={"problem_id": ego.problem_id})


def _store(workspace: Workspace, batch_id: str, *runs: RunRecord, lost: tuple[LostCell, ...] = ()) -> None:
    for run in runs:
        workspace.put("run", run.run_id, recipe=Recipe(tool="run_planner"), record=run)
    batch = BatchRecord(
        batch_id=batch_id,
        scenarios=tuple(dict.fromkeys(run.scenario_id for run in runs)),
        configs=tuple(dict.fromkeys(run.config_id for run in runs)),
        prediction="constant_velocity",
        traffic="recorded",
        runs=tuple(run.run_id for run in runs),
        lost=lost,
    )
    workspace.put("batch", batch_id, recipe=Recipe(tool="run_planner"), record=batch)


async def _batches(client: Client, **arguments: object) -> tuple[ListArtifactsResult, list[str]]:
    answer = await client.call_tool("list_artifacts", {"kind": "batch"} | arguments)
    assert not answer.is_error, answer.content
    text = str(answer.content[0].text)  # type: ignore[union-attr]
    return ListArtifactsResult.model_validate(answer.structured_content), text.splitlines()


async def test_each_batch_is_a_line_with_the_rates_of_its_configurations(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _with_starter(client, settings)
        old = [record(ONE), record(TWO, "collision"), record(THREE, "invalid")]
        _store(workspace, "batch_old", *old, lost=(LostCell(scenario_id=EDITED, config_id="cfg_a", error="broken"),))
        _store(workspace, "batch_new", *old[:2], record(ONE, config=SAFE), record(TWO, config=SAFE))
        listed, lines = await _batches(client)
        new, first = (item.batch for item in listed.artifacts)
        assert new is not None
        assert first is not None
        assert [(one.config_name, one.success.count, one.success.of, one.invalid) for one in new.configs] == [
            ("frenetix:Default", 1, 2, 0),
            ("frenetix:Safe", 2, 2, 0),
        ]
        assert (first.scenarios, first.lost, first.configs[0].invalid) == (4, 1, 1)
        assert lines[0].startswith("batch_new, 20")
        assert "constant velocity, recorded traffic, 2 scenarios: " in lines[0]
        assert "frenetix:Default 1/2 = 50% (95% interval 9–91%)" in lines[0]
        assert lines[1].endswith("1/2 = 50% (95% interval 9–91%), 1 invalid, 1 lost")
        assert "compare_results" in lines[2]
        paged, lines = await _batches(client, limit=1, offset=1)
        assert [item.artifact_id for item in paged.artifacts] == ["batch_old"]
        assert not lines[1:]


async def test_batch_that_names_a_run_that_is_not_there_is_listed_with_it_as_lost(
    connect: Connect, settings: Settings
) -> None:
    async with connect() as client:
        workspace = await _with_starter(client, settings)
        _store(workspace, "batch_whole", record(ONE))
        stored = workspace.get("batch_whole", "batch").read(BatchRecord)
        forged = stored.model_copy(update={"batch_id": "batch_forged", "runs": (*stored.runs, "../../../etc/passwd")})
        workspace.put("batch", "batch_forged", recipe=Recipe(tool="run_planner"), record=forged)
        listed, _ = await _batches(client)
        summaries = {item.artifact_id: item.batch for item in listed.artifacts}
        assert {key: batch.lost for key, batch in summaries.items() if batch} == {"batch_whole": 0, "batch_forged": 1}


async def test_edits_of_a_scenario_count_with_it_as_in_an_analysis(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _with_starter(client, settings)
        edit = Recipe(
            tool="modify_scenario",
            arguments={"edits": [{"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "aggressive"}]},
            parents=(ONE,),
        )
        facts = workspace.get(ONE, "scenario")
        file = workspace.file("scenario", ONE, "scenario.xml")
        with workspace.scratch() as folder:
            copied = folder / "scenario.xml"
            copied.write_bytes(file.read_bytes())
            workspace.put(
                "scenario", EDITED, recipe=edit, record=facts.read(ScenarioRecord), files={"scenario.xml": copied}
            )
        ended: dict[str, Outcome] = {ONE: "goal_reached", EDITED: "goal_reached", TWO: "goal_reached", THREE: "timeout"}
        runs = [_record(workspace, name, outcome) for name, outcome in ended.items()]
        _store(workspace, "batch_edited", *runs)
        listed, _ = await _batches(client)
        (item,) = listed.artifacts
        assert item.batch is not None
        (one,) = item.batch.configs
        assert one.success.scenarios == 3
        answer = await client.call_tool("analyze_results", {"results": ["batch_edited"]})
        assert not answer.is_error, answer.content
        assert AnalyzeResultsResult.model_validate(answer.structured_content).success == one.success


async def test_one_name_of_two_configurations_is_shown_with_their_ids(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _with_starter(client, settings)
        twin = SAFE.model_copy(update={"name": DEFAULT.name})
        _store(workspace, "batch_a", record(ONE))
        _store(workspace, "batch_b", record(ONE, config=twin))
        _, lines = await _batches(client)
        assert f"{DEFAULT.name} cfg_b 1/1" in lines[0]
        assert f"{DEFAULT.name} cfg_a 1/1" in lines[1]


async def test_batches_in_a_mixed_list_have_their_rates_and_their_only_scenario(
    connect: Connect, settings: Settings
) -> None:
    async with connect() as client:
        _store(Workspace(settings.workspace), "batch_a", record(ONE))
        answer = await client.call_tool("list_artifacts", {})
        listed = ListArtifactsResult.model_validate(answer.structured_content)
        assert {item.kind for item in listed.artifacts} >= {"batch", "run"}
        assert {item.kind for item in listed.artifacts if item.batch is not None} == {"batch"}
        (batch,) = [item.batch for item in listed.artifacts if item.batch is not None]
        assert (batch.scenarios, batch.scenario_id) == (1, ONE)
