"""Suggestions are tried on what failed and on what passed, and told with what they bought and cost."""

import pytest
from support.server import Connect

from plannerforge.schemas.results import TriedChange
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
LATE = ["ZAM_Landmoor-32_1_T-1", "ZAM_Fahrhausen-4_1_T-1"]
"""Starter scenarios that an ego which does not mind being slow ends late."""
IN_TIME = ["ZAM_Musterstadt-3_1_T-1"]


async def test_a_trial_runs_the_change_and_reports_its_gain_and_cost(connect: Connect, settings: Settings) -> None:
    async with connect() as client:

        async def ask(tool: str, **arguments: object) -> dict[str, object]:
            result = await client.call_tool(tool, arguments)
            assert not result.is_error, result.content
            return result.structured_content or {}

        careless = await ask("configure_planner", weights=["velocity_offset=0"])
        batch = await ask("run_planner", scenarios=[*LATE, *IN_TIME], configs=[careless["config_id"]])
        assert batch["state"] == "done"
        untried = await client.call_tool("analyze_results", {})
        assert "trial=true tries it" in str(untried.content[0].text)  # type: ignore[union-attr]
        tried = await ask("analyze_results", trial=True)
        while tried["job_id"]:
            tried = await ask("analyze_results", trial=True)
        suggestions = [one["suggestion"] for one in tried["findings"] if one["suggestion"]]  # type: ignore[attr-defined]
        (raised,) = (one for one in suggestions if one["weight"] == "velocity_offset")
        change = TriedChange.model_validate(raised["tried"])
        assert (change.failing, change.passing, change.gained) == (2, 1, 2)
        assert not change.helps  # two flips may be chance
        runs = (await ask("list_artifacts", kind="run", limit=50))["artifacts"]
        jobs = (await ask("list_artifacts", kind="job", limit=1))["artifacts"]
        made = (await ask("get_job", job_id=jobs[0]["artifact_id"]))["results"]  # type: ignore[index]
        assert made
        assert set(made) <= {run["artifact_id"] for run in runs}  # type: ignore[attr-defined, call-overload]
        again = await ask("analyze_results", trial=True)
        assert again["findings"] == tried["findings"]
        assert (await ask("list_artifacts", kind="run", limit=50))["artifacts"] == runs
        current = await ask("list_planners")
        assert current["config_id"] == careless["config_id"]


async def test_a_server_that_creates_no_artifacts_runs_no_trial(connect: Connect, settings: Settings) -> None:
    async with connect(settings.model_copy(update={"read_only": True})) as client:
        (tool,) = (one for one in (await client.list_tools()).tools if one.name == "analyze_results")
        assert "trial" not in tool.input_schema["properties"]
        assert tool.annotations is not None
        assert tool.annotations.read_only_hint
        refused = await client.call_tool("analyze_results", {"trial": True})
        assert refused.is_error
        assert "read-only, but trial creates data" in str(refused.content[0].text)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("gained", "lost", "p", "said"),
    [(6, 0, 0.03, "helps: 6 of 9"), (2, 0, 0.5, "shows no clear gain"), (1, 4, 1.0, "harms"), (5, 4, 0.5, "no clear")],
)
def test_only_clear_gains_are_reported_as_help(gained: int, lost: int, p: float, said: str, era: str) -> None:
    change = TriedChange(config_id="cfg_a", change="prediction=1", failing=9, gained=gained, passing=9, lost=lost, p=p)
    assert said in change.in_words()
