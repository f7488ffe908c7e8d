"""Edits of an edited scenario: the answer is about this call's edits, compared with the scenario that it names."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import Problem, driving, town_road
from support.server import Connect

from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
ID = "ZAM_Builder-1_1_T-1"
ROAD = replace(
    town_road().with_vehicles(driving(31, (150, 7), 8.0, 101)), problems=(Problem(start=(40.0, 0.0, 0.0, 10.0)),)
)
SLOW = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 12.0, "speed": "2m/s"}
FAR = {"op": "add_vehicle", "vehicle_class": "car", "at": "vehicle:31", "offset_m": 40.0}


@pytest.fixture
def settings_with_road(settings: Settings, tmp_path: Path) -> Settings:
    (tmp_path / "files").mkdir()
    ROAD.write(tmp_path / "files" / "road.xml")
    return settings.model_copy(update={"starter": False})


async def ask(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    result = await client.call_tool(tool, arguments)
    assert not result.is_error, result.content
    return result.structured_content or {}


async def edited(client: Client, base: str, *edits: dict[str, Any]) -> dict[str, Any]:
    return await ask(client, "modify_scenario", scenario_id=base, edits=list(edits))


async def test_earlier_edits_are_part_of_the_reference(
    connect: Connect, settings_with_road: Settings, tmp_path: Path
) -> None:
    async with connect(settings_with_road) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        first = await edited(client, ID, SLOW)
        again = await edited(client, first["scenario_id"], FAR)
        assert (again["base_id"], again["earlier"], len(again["edits"])) == (first["scenario_id"], 1, 1)
        assert [vehicle["cause"] for vehicle in again["touched"]] == ["added"]
        assert again["untouched"] == 2
        assert again["ego_after"] == again["ego_before"]
        (parents,) = [(await ask(client, "describe_scenario", detail="recipe"))["recipe"]["parents"]]
        assert parents == [ID]


async def test_a_mirrored_scene_is_as_risky_as_before(
    connect: Connect, settings_with_road: Settings, tmp_path: Path
) -> None:
    async with connect(settings_with_road) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        first = await edited(client, ID, SLOW)
        mirrored = await edited(client, first["scenario_id"], {"op": "mirror"})
        assert mirrored["ego_after"] == mirrored["ego_before"]
        assert (mirrored["touched"], mirrored["collisions"], mirrored["untouched"]) == ([], [], 2)


async def test_all_edits_of_a_base_compare_with_the_same_risk(
    connect: Connect, settings_with_road: Settings, tmp_path: Path
) -> None:
    edits = [
        {"op": "set_light", "to": ["1"], "params": ["red=10s"]},
        {"op": "set_weather", "params": ["rain"]},
        {"op": "mirror"},
        SLOW,
    ]
    async with connect(settings_with_road) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        first, *others = [(await edited(client, ID, edit))["ego_before"] for edit in edits]
        assert all(one == first for one in others)


async def test_a_search_by_weather_finds_an_edited_scenario_with_its_latest_weather(
    connect: Connect, settings_with_road: Settings, tmp_path: Path
) -> None:
    async with connect(settings_with_road) as client:
        await ask(client, "import_files", path=str(tmp_path / "files"))
        rainy = await edited(client, ID, {"op": "set_weather", "params": ["heavy_rain", "friction=0.4"]})
        snowy = await edited(client, rainy["scenario_id"], {"op": "set_weather", "params": ["snow"]})
        for word, made in (("heavy_rain", rainy), ("snow", snowy)):
            found = await ask(client, "find_scenarios", features=[word])
            assert [one["scenario_id"] for one in found["matches"]] == [made["scenario_id"]]
        described = await ask(client, "describe_scenario", scenario_id=rainy["scenario_id"])
        assert (described["circumstances"], described["description"]["friction"]) == (["heavy_rain"], 0.4)
