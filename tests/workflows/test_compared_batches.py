"""Which runs stand against which where several batches or versions of a planner are compared."""

from typing import Any

import pytest
from mcp import Client
from support.runs import DEFAULT, SAFE, record
from support.server import Connect

from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.results import ConfigWeights
from plannerforge.schemas.runs import BatchRecord, Outcome, RunRecord
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
SCENARIOS = ("ZAM_Landmoor-32_1_T-1", "ZAM_Fahrhausen-4_1_T-1", "ZAM_Musterstadt-3_1_T-1")


def _runs(batch: str, config: ConfigWeights, ends: str = "ggg", version: str = "") -> list[RunRecord]:
    outcomes: dict[str, Outcome] = {"g": "goal_reached", "c": "collision"}
    changes = {"planner": "mine", "planner_version": version, "planner_source": version} if version else {}
    return [
        record(name, outcomes[end], config).model_copy(
            update={"run_id": f"run_{batch}_{config.config_id}_{place}", **changes}
        )
        for place, (name, end) in enumerate(zip(SCENARIOS, ends, strict=True))
    ]


def _store(workspace: Workspace, name: str, *groups: list[RunRecord]) -> str:
    facts = {key: workspace.get(key, "scenario").read(ScenarioRecord).facts for key in SCENARIOS}
    problems = {key: found.egos[0].problem_id for key, found in facts.items()}
    runs = [run.model_copy(update={"problem_id": problems[run.scenario_id]}) for group in groups for run in group]
    for run in runs:
        workspace.put("run", run.run_id, recipe=Recipe(tool="run_planner"), record=run)
    batch = BatchRecord(
        batch_id=f"batch_{name}",
        scenarios=SCENARIOS,
        configs=tuple(dict.fromkeys(run.config_id for run in runs)),
        prediction="constant_velocity",
        traffic="recorded",
        runs=tuple(run.run_id for run in runs),
        lost=(),
    )
    workspace.put("batch", batch.batch_id, recipe=Recipe(tool="run_planner", arguments={"n": name}), record=batch)
    return batch.batch_id


async def _workspace(client: Client, settings: Settings) -> Workspace:
    assert not (await client.call_tool("describe_scenario", {"scenario_id": SCENARIOS[0]})).is_error
    return Workspace(settings.workspace)


async def _compared(client: Client, **arguments: Any) -> Any:
    answer = await client.call_tool("compare_results", arguments)
    text = "\n".join(part.text for part in answer.content)  # type: ignore[union-attr]
    return text if answer.is_error else answer.structured_content


def _couples(compared: Any) -> list[tuple[str, str]]:
    sides = {side["label"]: side for side in compared["sides"]}
    return [
        tuple(f"{sides[one[end]]['config_id']} {sides[one[end]]['result_id']}" for end in ("before", "after"))  # type: ignore[misc]
        for one in compared["comparisons"]
    ]


async def test_batches_are_compared_configuration_by_configuration(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        one = _store(workspace, "one", _runs("one", DEFAULT), _runs("one", SAFE))
        two = _store(workspace, "two", _runs("two", SAFE), _runs("two", DEFAULT, "gcg"))
        found = await _compared(client, results=[two, one])
        assert _couples(found) == [(f"cfg_a {two}", f"cfg_a {one}"), (f"cfg_b {two}", f"cfg_b {one}")]
        assert [comparison["success"]["only_after"] for comparison in found["comparisons"]] == [1, 0]
        assert (
            f"frenetix:Default of {two} (baseline) with frenetix:Default of {one}" in found["comparisons"][0]["paired"]
        )


async def test_a_side_without_a_like_is_named_and_left_out(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        one = _store(workspace, "one", _runs("one", DEFAULT))
        two = _store(workspace, "two", _runs("two", DEFAULT), _runs("two", SAFE))
        found = await _compared(client, results=[one, two])
        assert _couples(found) == [(f"cfg_a {one}", f"cfg_a {two}")]
        assert [note for note in found["notes"] if "frenetix:Safe" in note]


async def test_batches_without_a_like_are_refused(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        third, fourth = (SAFE.model_copy(update={"config_id": f"cfg_{name}", "name": name}) for name in "cd")
        one = _store(workspace, "one", _runs("one", DEFAULT), _runs("one", SAFE))
        two = _store(workspace, "two", _runs("two", third), _runs("two", fourth))
        told = await _compared(client, results=[one, two])
        assert "no configuration of the baseline batch_one has a match" in told


async def test_no_older_batch_is_the_baseline_unless_it_is_named(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        one = _store(workspace, "one", _runs("one", DEFAULT))
        two = _store(workspace, "two", _runs("two", DEFAULT, "gcg"))
        told = await _compared(client)
        assert isinstance(told, str), "a refusal"
        assert f"results ['{one}', '{two}']" in told
        three = _store(workspace, "three", _runs("three", DEFAULT), _runs("three", SAFE))
        found = await _compared(client)
        assert _couples(found) == [(f"cfg_a {three}", f"cfg_b {three}")]


async def test_two_versions_of_a_planner_are_two_sides(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        mine = DEFAULT.model_copy(update={"name": "mine:Default"})
        old = _store(workspace, "old", _runs("old", mine, "ccg", version="a1b2c3d4"))
        new = _store(workspace, "new", _runs("new", mine, "ggg", version="d4e5f6a7"))
        found = await _compared(client, results=[old, new])
        assert _couples(found) == [(f"cfg_a@a1b2c3d {old}", f"cfg_a@d4e5f6a {new}")]
        (comparison,) = found["comparisons"]
        assert (comparison["before"], comparison["after"]) == ("mine:Default a1b2c3d4", "mine:Default d4e5f6a7")
        assert comparison["conditions"] == ["planner version: a1b2c3d4 → d4e5f6a7"]
        assert comparison["headline_code"] == "flips_too_few"
        listed = await client.call_tool("list_artifacts", {"kind": "batch"})
        lines = listed.content[0].text.splitlines()  # type: ignore[union-attr]
        assert "mine:Default d4e5f6a7 3/3" in lines[0]
        assert "mine:Default a1b2c3d4 1/3" in lines[1]
        asked = {"results": [old, new], "breakdown": "config", "where": ["config=cfg_a"]}
        analysed = await client.call_tool("analyze_results", asked)
        assert not analysed.is_error, analysed.content
        groups = analysed.structured_content["groups"]  # type: ignore[index]
        assert [(group["success"]["count"], group["success"]["of"]) for group in groups] == [(1, 3), (3, 3)]


async def test_runs_without_a_version_take_it_from_their_recipe(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        mine = DEFAULT.model_copy(update={"name": "mine:Default"})
        for name, digest in (("old", "a1b2c3d4e5f6"), ("new", "0a1b2c3d4e5f")):
            recipe = Recipe(tool="run_planner", versions={"planner mine": digest})
            run = _runs(name, mine)[0].model_copy(update={"planner": "mine"})
            workspace.put("run", run.run_id, recipe=recipe, record=run)
        found = await _compared(client, results=["run_old_cfg_a_0", "run_new_cfg_a_0"])
        assert [side["planner_version"] for side in found["sides"]] == ["a1b2c3d", "0a1b2c3"]


async def test_a_batch_without_runs_is_refused_by_name(connect: Connect, settings: Settings) -> None:
    async with connect(settings) as client:
        workspace = await _workspace(client, settings)
        several = _store(workspace, "several", _runs("several", DEFAULT), _runs("several", SAFE))
        empty = _store(workspace, "empty")
        for results in ([empty, several], [several, empty]):
            text = await _compared(client, results=results)
            assert isinstance(text, str)
            assert text.startswith("[invalid_request]")
            assert empty in text


async def test_a_result_is_not_compared_with_itself(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        workspace = await _workspace(client, settings)
        several = _store(workspace, "a", _runs("a", DEFAULT), _runs("a", SAFE))
        alone = _store(workspace, "b", _runs("b", SAFE))
        refused = await client.call_tool("compare_results", {"results": [several, several]})
        without = await client.call_tool("compare_results", {"results": [alone, "latest_batch"]})
        workspace.close()
    assert refused.is_error
    assert (refused.meta or {})["plannerforge/next_call"]["arguments"] == {"results": [several]}
    assert without.is_error
    assert alone in without.content[0].text  # type: ignore[union-attr]
