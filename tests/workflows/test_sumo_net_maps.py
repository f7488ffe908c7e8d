"""Scenarios on a user's SUMO network: imported, found by place, cut, filled with traffic."""

from pathlib import Path

import pytest
from support.server import Connect

from plannerforge.engine.maps.index import LIBRARY
from plannerforge.engine.network.net_parser import read_net
from plannerforge.engine.network.netconvert import convert_osm
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]


@pytest.fixture
def net(tmp_path: Path) -> Path:
    path = tmp_path / "maps" / "harbour.net.xml"
    path.parent.mkdir()
    convert_osm(LIBRARY / "musterstadt.osm", path, lefthand=False)
    return path


async def test_a_scenario_is_made_on_an_imported_network(connect: Connect, net: Path, settings: Settings) -> None:
    async with connect() as client:
        imported = await client.call_tool("import_files", {"path": str(net), "name": "Harbour"})
        assert not imported.is_error, imported.content
        wish = {
            "place": "Harbour",
            "scenario_type": "signalised_intersection",
            "vehicles": ["bus"],
            "duration_s": 6,
            "goal": "steps:20",
        }
        answer = await client.call_tool("generate_scenarios", wish)
        assert not answer.is_error, answer.content
        assert answer.structured_content is not None
        made = answer.structured_content["scenarios"][0]
        assert made["checks_failed"] == []
        assert made["classes_realised"]["bus"] >= 1
        assert made["latitude"] == pytest.approx(54.6, abs=0.01)
        again = (await client.call_tool("generate_scenarios", wish)).structured_content
        assert again is not None
        assert again["scenarios"][0]["reused"]
    cut = read_net(settings.workspace / "scenarios" / made["scenario_id"] / "scenario.net.xml")
    whole = read_net(net)
    assert set(cut.drivable_edges("passenger")) <= set(whole.drivable_edges("passenger"))
    assert cut.signals == {name: whole.signals[name] for name in cut.signals}
    assert cut.projection == whole.projection
    assert cut.offset_m == whole.offset_m


async def test_networks_next_to_scenarios_become_maps_only_if_maps_are_requested(connect: Connect, net: Path) -> None:
    (net.parent / "plain.osm").write_bytes((LIBRARY / "fahrhausen.osm").read_bytes())
    async with connect() as client:
        every = (await client.call_tool("import_files", {"path": str(net.parent)})).structured_content
        assert every is not None
        assert [item["file"] for item in every["items"]] == ["plain.osm"]
        maps = (await client.call_tool("import_files", {"path": str(net.parent), "kind": "map"})).structured_content
        assert maps is not None
        assert sorted(item["file"] for item in maps["items"]) == ["harbour.net.xml", "plain.osm"]
        scenarios = await client.call_tool("import_files", {"path": str(net.parent), "kind": "scenario"})
        assert scenarios.is_error
        assert "contains no file to import" in str(scenarios.content)
