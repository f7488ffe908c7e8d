"""``ID#problem`` is described and edited around that problem's ego."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, parse

import pytest
from mcp import Client
from support.builders import Problem, town_road
from support.server import Connect

from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
ID = "ZAM_Builder-1_1_T-1"
SECOND = Problem(200, start=(250.0, 7.0, 3.14159, 12.0), goal=(60.0, 7.0, 8.0, 3.0))
GOAL_OF_SECOND = {"op": "set_goal", "to": ["3"], "position": "middle"}


@pytest.fixture
def settings_with_scenario(settings: Settings, tmp_path: Path) -> Settings:
    (tmp_path / "files").mkdir()
    replace(town_road().cut(30), problems=(Problem(), SECOND)).write(tmp_path / "files" / "two.xml")
    return settings.model_copy(update={"starter": False})


async def ask(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    result = await client.call_tool(tool, arguments)
    assert not result.is_error, result.content
    return result.structured_content or {}


async def refusal(client: Client, tool: str, **arguments: Any) -> str:
    result = await client.call_tool(tool, arguments)
    assert result.is_error
    return str(result.content[0].text)  # type: ignore[union-attr]


def problems(settings: Settings, scenario_id: str) -> dict[str, str]:
    """The centre of the goal by planning problem, as the file has it."""
    path = Workspace(settings.workspace).file("scenario", scenario_id, "scenario.xml")
    found: list[Element] = parse(path).getroot().findall("planningProblem")
    return {one.get("id", ""): str(one.findtext(".//goalState//center/x")) for one in found}


async def test_a_problem_is_described_by_its_ego(
    connect: Connect, settings_with_scenario: Settings, tmp_path: Path
) -> None:
    async with connect(settings_with_scenario) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        first = await ask(client, "describe_scenario", scenario_id=ID)
        second = await ask(client, "describe_scenario", scenario_id=f"{ID}#200")
        assert (first["scenario_id"], second["scenario_id"]) == (ID, f"{ID}#200")
        assert [one["description"]["ego"]["problem_id"] for one in (first, second)] == [100, 200]
        assert second["description"]["ego"]["lanelets"] == [3]
        assert "multi_lane" in first["features"]
        assert "single_lane" in second["features"]
        assert "100, 200" in await refusal(client, "describe_scenario", scenario_id=f"{ID}#300")


async def test_edits_of_a_problem_are_about_its_ego_and_go_on_with_it(
    connect: Connect, settings_with_scenario: Settings, tmp_path: Path
) -> None:
    async with connect(settings_with_scenario) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        before = problems(settings_with_scenario, ID)
        edited = await ask(client, "modify_scenario", scenario_id=f"{ID}#200", edits=[GOAL_OF_SECOND])
        after = problems(settings_with_scenario, edited["scenario_id"])
        assert after["100"] == before["100"]
        assert after["200"] != before["200"]
        removal = {"op": "remove_vehicle", "vehicles": ["35"]}
        again = await ask(client, "modify_scenario", scenario_id=edited["scenario_id"], edits=[removal])
        assert problems(settings_with_scenario, again["scenario_id"]) == after
        other = f"{edited['scenario_id']}#100"
        assert f"{ID}#100" in await refusal(client, "modify_scenario", scenario_id=other, edits=[removal])


async def test_naming_the_first_problem_equals_naming_no_problem(
    connect: Connect, settings_with_scenario: Settings, tmp_path: Path
) -> None:
    async with connect(settings_with_scenario) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        removal = {"op": "remove_vehicle", "vehicles": ["35"]}
        made = [
            await ask(client, "modify_scenario", scenario_id=key, edits=[removal], dry_run=False)
            for key in (ID, f"{ID}#100")
        ]
        assert made[0]["scenario_id"] == made[1]["scenario_id"]
