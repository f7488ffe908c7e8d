"""People on foot in generated scenarios: where they walk, who gives way, and what other requests keep."""

from pathlib import Path

import pytest
from lxml import etree
from shapely import Point, Polygon, make_valid, union_all
from support.generation import MAPS, make, request_for

from benchmarks.maps.people import judge_file
from plannerforge.engine.commonroad.reader import read_recorded
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation import generate_scenario
from plannerforge.engine.generation.people import PEOPLE, open_footways, target_pedestrians
from plannerforge.engine.generation.site_network import prepare_site
from plannerforge.engine.generation.sites import fitting_sites
from plannerforge.engine.maps.map_file import read_map_file
from plannerforge.engine.network import convert_osm, read_net, read_walk_net
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GeneratedScenario, VehicleDemand

ON_FOOT = VehicleDemand(vehicle_class="pedestrian", least=6)
FOOTWAYS = {"sidewalk", "crosswalk"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, GeneratedScenario]:
    """A junction with lights and six people, in its folder."""
    folder = tmp_path_factory.mktemp("people")
    bicycles = VehicleDemand(vehicle_class="bicycle", least=2)
    wish = [ON_FOOT, bicycles]
    return folder, make("Musterstadt", folder, scenario_type="intersection", vehicles=wish, duration_s=12.0)


def test_pedestrians_walk_on_their_own_paths_and_meet_no_vehicle(made: tuple[Path, GeneratedScenario]) -> None:
    folder, scenario = made
    assert scenario.classes_realised["pedestrian"] == 6
    counts = judge_file(folder / "scenario.xml")
    assert counts["pedestrians"] == 6
    assert counts["overlaps"] == 0
    assert counts["on_ways"] >= 0.99 * counts["positions"]
    assert counts["on_crossings"] >= 1
    assert counts["yielded"] == counts["encounters"]


def test_pedestrians_count_as_no_vehicles(made: tuple[Path, GeneratedScenario]) -> None:
    _, scenario = made
    vehicles = sum(count for name, count in scenario.classes_realised.items() if name != "pedestrian")
    assert scenario.vehicles_realised == vehicles + 1
    assert scenario.checks.schema_valid
    assert scenario.checks.network_errors == ()


def test_the_answer_tells_guessed_pavements_and_crossings(made: tuple[Path, GeneratedScenario]) -> None:
    _, scenario = made
    assert any("pavements: guessed for" in note and "crossings at junctions" in note for note in scenario.notes)
    assert any("of 6 pedestrians use a crossing" in note for note in scenario.notes)


def test_footways_are_not_lanes_of_the_network(made: tuple[Path, GeneratedScenario]) -> None:
    folder, scenario = made
    loaded = read_recorded(folder / "scenario.xml").loaded
    kinds = [{kind.value for kind in lanelet.lanelet_type} for lanelet in loaded.footways]
    assert all(kind & FOOTWAYS for kind in kinds)
    assert {"crosswalk"} in kinds
    driven = list(loaded.scenario.lanelet_network.lanelets)
    assert not any({kind.value for kind in lanelet.lanelet_type} & FOOTWAYS for lanelet in driven)
    assert len(driven) + len(kinds) == scenario.lanelets


def test_people_walk_as_fast_as_people_and_without_jumps(made: tuple[Path, GeneratedScenario]) -> None:
    folder, _ = made
    tracks = read_recorded(folder / "scenario.xml").tracks.values()
    walked = [track for track in tracks if track.kind == "pedestrian"]
    assert len(walked) == 6
    assert all(track.first_step == 0 for track in walked)
    speeds = [float(speed) for track in walked for speed in track.speeds_mps]
    assert max(speeds) < 5.0
    assert 0.3 < sum(speeds) / len(speeds) < 2.0


def test_the_same_request_with_people_gives_same_bytes(made: tuple[Path, GeneratedScenario], tmp_path: Path) -> None:
    folder, _ = made
    wish = [ON_FOOT, VehicleDemand(vehicle_class="bicycle", least=2)]
    make("Musterstadt", tmp_path, scenario_type="intersection", vehicles=wish, duration_s=12.0)
    assert (tmp_path / "scenario.xml").read_bytes() == (folder / "scenario.xml").read_bytes()


def test_without_people_a_site_has_no_pavements(tmp_path: Path) -> None:
    make("Musterstadt", tmp_path, scenario_type="intersection", vehicles=[ON_FOOT.model_copy(update={"most": 0})])
    types = {element.text for element in etree.parse(tmp_path / "scenario.xml").iter("laneletType")}
    assert not types & FOOTWAYS


def test_a_motorway_is_refused_to_people(tmp_path: Path) -> None:
    with pytest.raises(NotPossible, match="pedestrians cannot walk") as refused:
        make("Neuland", tmp_path, scenario_type="highway", road_classes=("motorway",), vehicles=[ON_FOOT])
    assert "leave pedestrian out" in str(refused.value.next_step)


def test_vehicles_yield_at_every_crossing_without_lights(tmp_path: Path) -> None:
    request = request_for("Kreiselheim", tmp_path, scenario_type="urban", vehicles=[ON_FOOT])
    osm = read_map_file(Path(request.map_path))
    site = prepare_site(request, osm, fitting_sites(osm, request)[0], tmp_path, silent)
    walk = read_walk_net(site.net_path)
    unlit = {f"{key}_0" for key, crossing in walk.crossings.items() if not crossing.lit}
    assert unlit
    junctions = etree.parse(site.net_path).getroot().iterfind("junction")
    for junction in (one for one in junctions if one.get("type") != "internal"):
        lanes = junction.get("intLanes", "").split()
        rows = {int(row.get("index", "")): row for row in junction.iterfind("request")}
        for index in (index for index, lane in enumerate(lanes) if lane in unlit):
            assert set(rows[index].get("response", "")) == {"0"}
            foes = [key for key, row in rows.items() if row.get("foes", "")[-1 - index] == "1"]
            assert all(rows[key].get("response", "")[-1 - index] == "1" for key in foes)


BLOCK = """<osm version="0.6">
<node id="1" lat="48.1" lon="11.600"/><node id="2" lat="48.1" lon="11.602"><tag k="highway" v="crossing"/></node>
<node id="3" lat="48.1" lon="11.604"/>
<way id="9"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="residential"/><tag k="sidewalk" v="both"/></way>
</osm>"""


def test_a_marked_crossing_between_junctions_is_built_once_and_cars_wait(tmp_path: Path) -> None:
    extract, net = tmp_path / "block.osm", tmp_path / "block.net.xml"
    extract.write_text(BLOCK)
    convert_osm(extract, net, lefthand=False, pavements=True)
    open_footways(net)
    walk = read_walk_net(net)
    (crossing,) = walk.crossings.values()
    assert crossing.edge_id == ":2_c0"
    assert all(len(walk.pavements_at(corner)) == 2 for corner in crossing.corners), "a pavement on either side of it"
    (junction,) = etree.parse(net).getroot().iterfind("junction[@id='2']")
    lanes = junction.get("intLanes", "").split()
    waits = {lanes[int(row.get("index", "0"))]: row.get("response", "") for row in junction.iterfind("request")}
    assert "1" not in waits[":2_c0_0"]
    at = lanes.index(":2_c0_0")
    assert all(waits[lane][-1 - at] == "1" for lane in lanes if lane != ":2_c0_0")


def test_without_pedestrians_a_marked_crossing_is_not_a_junction(tmp_path: Path) -> None:
    extract, net = tmp_path / "block.osm", tmp_path / "block.net.xml"
    extract.write_text(BLOCK)
    convert_osm(extract, net, lefthand=False)
    assert len(read_net(net).drivable_edges("passenger")) == 2, "one in each direction"


def test_people_of_a_real_extract_cross_between_junctions(shared_data: Path, tmp_path: Path) -> None:
    request = request_for(
        "Kreiselheim",
        tmp_path,
        map_path=str(shared_data / "data" / "osm" / "o2s_montlake_roundabout.osm"),
        country="USA",
        vehicles=[VehicleDemand(vehicle_class="pedestrian", least=8)],
        duration_s=12.0,
        seed=2,
    )
    scenario = generate_scenario(request, silent)
    assert any("between junctions, as the map marks them" in note for note in scenario.notes)
    assert scenario.checks.network_errors == ()
    counts = judge_file(tmp_path / "scenario.xml")
    assert counts["on_crossings"] >= 4, "SUMO leads no walk round the end of a road that the map cuts off"
    assert counts["overlaps"] == 0
    assert counts["on_ways"] >= 0.99 * counts["positions"]


def test_drawn_footways_cover_pavements_and_crossings_of_the_net(tmp_path: Path) -> None:
    request = request_for("Kreiselheim", tmp_path, scenario_type="roundabout", vehicles=[ON_FOOT])
    osm = read_map_file(Path(request.map_path))
    site = prepare_site(request, osm, fitting_sites(osm, request)[0], tmp_path, silent)
    outlines = [Polygon([*way.right, *way.left[::-1]]) for way in site.network.walkways]
    area = union_all([make_valid(outline).buffer(0.05) for outline in outlines])
    walk = read_walk_net(site.net_path)
    middles = [line.mean(axis=0) for line in (one.line for one in walk.crossings.values())]
    assert middles
    assert all(area.covers(Point(middle)) for middle in middles)
    assert read_net(site.net_path).edges.keys().isdisjoint(walk.corners)


def test_how_many_people_are_wanted() -> None:
    request = request_for("Musterstadt", Path(), vehicles=[ON_FOOT, VehicleDemand(vehicle_class="truck", least=1)])
    assert request.people == ON_FOOT
    assert [demand.vehicle_class for demand in request.on_wheels] == ["truck"]
    bare = VehicleDemand(vehicle_class="pedestrian", share=0.0)
    assert target_pedestrians(bare, "high", 40) == PEOPLE["high"]
    assert target_pedestrians(bare.model_copy(update={"share": 0.25}), "low", 40) == 10
    assert target_pedestrians(ON_FOOT, "low", 40) == 6
    assert request_for("Musterstadt", Path()).people is None
    assert set(MAPS) >= {"Musterstadt"}


def test_a_network_of_sumo_gets_the_pavements_that_it_lacks(tmp_path: Path) -> None:
    net_path = tmp_path / "town.net.xml"
    convert_osm(Path(MAPS["Musterstadt"].path), net_path, lefthand=False)
    made = make("Musterstadt", tmp_path, map_path=str(net_path), scenario_type="intersection", vehicles=[ON_FOOT])
    assert made.classes_realised["pedestrian"] == 6
    assert any("guessed along roads up to 50" in note for note in made.notes)
    assert judge_file(tmp_path / "scenario.xml")["overlaps"] == 0


def test_a_lanelet_network_is_refused_to_people(tmp_path: Path) -> None:
    make("Landmoor", tmp_path, scenario_type="rural")
    roads = (tmp_path / "scenario.xml").rename(tmp_path / "roads.xml")
    with pytest.raises(NotPossible, match="without added pavements"):
        make("Landmoor", tmp_path, map_path=str(roads), scenario_type="any", vehicles=[ON_FOOT])
