"""Scenarios on roads of other formats, through a client: OpenDRIVE, Lanelet2, a CommonRoad file, a scenario."""

from pathlib import Path

import pytest
from commonroad.common.file_reader import CommonRoadFileReader
from support.builders import town_road
from support.foreign_maps import lanelet2_of, opendrive_of_net
from support.server import Connect

from plannerforge.engine.maps.index import LIBRARY
from plannerforge.engine.network.netconvert import convert_osm
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]


async def test_a_scenario_s_network_is_filled_with_other_traffic(
    connect: Connect, tmp_path: Path, settings: Settings
) -> None:
    path = tmp_path / "maps" / "town.xml"
    path.parent.mkdir()
    town_road().write(path)
    async with connect() as client:
        await client.call_tool("import_files", {"path": str(path)})
        wish = {"place": "ZAM_Builder-1_1_T-1", "vehicles": ["truck=1"], "duration_s": 8, "goal": "steps:40", "seed": 3}
        answer = await client.call_tool("generate_scenarios", wish)
        assert not answer.is_error, answer.content
        assert answer.structured_content is not None
        made = answer.structured_content["scenarios"][0]
        again = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert again is not None
        assert again["scenarios"][0]["reused"]
    assert made["checks_failed"] == []
    assert made["classes_realised"]["truck"] >= 1
    assert any("location on earth" in note for note in made["notes"])
    written = settings.workspace / "scenarios" / made["scenario_id"] / "scenario.xml"
    new, old = (CommonRoadFileReader(str(file)).open()[0].lanelet_network for file in (written, path))
    assert {one.lanelet_id for one in new.lanelets} == {one.lanelet_id for one in old.lanelets}
    for lanelet in old.lanelets:
        assert new.find_lanelet_by_id(lanelet.lanelet_id).left_vertices == pytest.approx(lanelet.left_vertices)


async def test_maps_of_other_formats_are_imported_and_used(connect: Connect, tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    convert_osm(LIBRARY / "musterstadt.osm", tmp_path / "town.net.xml", lefthand=False)
    opendrive_of_net(tmp_path / "town.net.xml", folder / "harbour.xodr")
    town_road().write(tmp_path / "town.xml")
    lanelet2_of(tmp_path / "town.xml", folder / "lanes.osm")
    async with connect() as client:
        told = (await client.call_tool("import_files", {"path": str(folder)})).structured_content
        assert told is not None
        assert [item["kind"] for item in told["items"]] == ["map", "map"], told
        assert "lost in the conversion: " in next(
            item["summary"] for item in told["items"] if item["file"] == "harbour.xodr"
        )
        for item in told["items"]:
            wish = {"place": item["artifact_id"], "duration_s": 6, "goal": "steps:30"}
            answer = await client.call_tool("generate_scenarios", wish)
            assert not answer.is_error, answer.content
