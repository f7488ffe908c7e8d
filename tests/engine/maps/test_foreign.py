"""OpenDRIVE, Lanelet2 and CommonRoad files as maps: what is read, what is told as lost, what is refused."""

import re
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from commonroad.common.file_reader import CommonRoadFileReader
from lxml import etree
from support.builders import town_road
from support.foreign_maps import lanelet2_of, straight_road

from plannerforge.engine.commonroad import schema_errors
from plannerforge.engine.maps import LaneletMap, SiteFinder, cut_lanelets, foreign_format, read_map_file
from plannerforge.engine.maps.facts import read_map
from plannerforge.engine.maps.foreign.conversion import convert_roads
from plannerforge.engine.maps.foreign.lanelet2 import users_of
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import ConvertedMap, ConvertMapRequest, ReadMapRequest


def converted(path: Path) -> ConvertedMap:
    folder = path.parent / "converted"
    folder.mkdir(exist_ok=True)
    return convert_roads(ConvertMapRequest(path=str(path), folder=str(folder)), lambda *_: None)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "town.xml"
    town_road().write(path)
    return path


def test_opendrive_becomes_a_net_and_losses_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "low_road.xodr"
    reference = "<geoReference><![CDATA[+proj=utm +zone=32 +ellps=WGS84 +units=m +vunits=m +no_defs]]></geoReference>"
    path.write_text(straight_road(header=reference, x="500000"), encoding="utf-8")
    made = converted(path)
    found = read_map_file(Path(made.path))
    assert found.bounds[1] == pytest.approx(9.0, abs=0.02)
    told = " ".join(made.lost)
    assert all(word in told for word in ("1 signal", "1 object", "heights", "sidewalk 1"))
    assert "artificial" not in told


def test_opendrive_without_a_georeference_is_at_a_stated_artificial_place(tmp_path: Path) -> None:
    path = tmp_path / "low_road.xodr"
    path.write_text(straight_road(), encoding="utf-8")
    made = converted(path)
    assert "artificial place" in made.lost[0]
    assert np.abs(read_map_file(Path(made.path)).bounds).max() < 0.01


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<OpenDRIVE><header/></OpenDRIVE>", "has no road"),
        ("<roads/>", "is not OpenDRIVE"),
        (straight_road()[:300], "not well-formed"),
        (straight_road(x="nan"), "x of a geometry is “nan”"),
        (straight_road(length="1e300"), "length of a geometry"),
        (straight_road(lanes=70), "lanes side by side"),
        ('<!DOCTYPE a [<!ENTITY b "bb">]><OpenDRIVE>&b;</OpenDRIVE>', "document type"),
    ],
)
def test_a_broken_or_hostile_opendrive_file_is_refused_by_name(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.xodr"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UnsafeInput, match=reason):
        converted(path)


def test_lanelets_of_lanelet2_keep_ids_neighbours_and_successors(tmp_path: Path, scenario: Path) -> None:
    path = lanelet2_of(scenario, tmp_path / "town.osm")
    assert foreign_format(path) == "Lanelet2"
    made = converted(path)
    assert [fault for fault in schema_errors(Path(made.path)) if "planningProblem" not in fault] == []
    read = {one.lanelet_id: one for one in CommonRoadFileReader(made.path).open()[0].lanelet_network.lanelets}
    given = {one.lanelet_id: one for one in CommonRoadFileReader(str(scenario)).open()[0].lanelet_network.lanelets}
    assert set(read) == set(given)
    for key, lanelet in given.items():
        assert set(read[key].successor) == set(lanelet.successor)
        assert read[key].adj_right == lanelet.adj_right
        assert read[key].left_vertices[-1] - read[key].left_vertices[0] == pytest.approx(
            lanelet.left_vertices[-1] - lanelet.left_vertices[0], rel=0.02, abs=0.5
        )


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('<osm><relation id="1"><tag k="type" v="lanelet"/></relation></osm>', "no lanelet with two bounds"),
        (
            '<osm><node id="1" lat="x" lon="1"/><relation id="1"><tag k="type" v="lanelet"/></relation></osm>',
            "position",
        ),
        ('<osm><relation id="q"><tag k="type" v="lanelet"/></relation></osm>', "not readable as Lanelet2"),
    ],
)
def test_a_broken_lanelet2_map_is_refused_with_its_reason(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.osm"
    path.write_text(text, encoding="utf-8")
    assert foreign_format(path) == "Lanelet2"
    with pytest.raises(UnsafeInput, match=reason):
        converted(path)


def test_streets_of_openstreetmap_do_not_count_as_lanelets(tmp_path: Path) -> None:
    path = tmp_path / "streets.osm"
    path.write_text('<osm><way id="1"><tag k="name" v="lanelet street"/></way></osm>', encoding="utf-8")
    assert foreign_format(path) is None


def test_a_scenario_as_a_map_keeps_its_lanelets_and_leaves_its_traffic_out(scenario: Path) -> None:
    made = converted(scenario)
    assert "recorded road users" in made.lost[0]
    found = read_map_file(Path(made.path))
    assert isinstance(found, LaneletMap)
    assert found.network is not None
    given = CommonRoadFileReader(str(scenario)).open()[0].lanelet_network
    assert set(found.network.lanelets) == {lanelet.lanelet_id for lanelet in given.lanelets}
    assert (found.name, found.country) == ("Builder", "ZAM")
    assert SiteFinder(found).longest_road() is not None


def test_a_large_network_is_cut_and_references_to_the_rest_are_removed(scenario: Path, tmp_path: Path) -> None:
    found = read_map_file(Path(converted(scenario).path))
    assert isinstance(found, LaneletMap)
    assert found.network is not None
    first = min(found.network.lanelets)
    start = found.network.lanelets[first].center[0]
    assert not cut_lanelets(found, (start[0], start[1]), 1e6, tmp_path / "whole.xml")
    assert cut_lanelets(found, (start[0], start[1]), 20.0, tmp_path / "cut.xml")
    left = CommonRoadFileReader(str(tmp_path / "cut.xml")).open()[0].lanelet_network
    keys = {lanelet.lanelet_id for lanelet in left.lanelets}
    assert first in keys
    assert keys < set(found.network.lanelets)
    assert all(set(lanelet.successor) | set(lanelet.predecessor) <= keys for lanelet in left.lanelets)


@pytest.mark.parametrize(
    ("tags", "users"),
    [
        ({"subtype": "road"}, ("vehicle",)),
        ({"subtype": "road", "participant:vehicle": "no"}, ()),
        ({"subtype": "road", "participant:vehicle": "yes"}, ("vehicle",)),
        ({"subtype": "road", "participant:vehicle:bus": "yes"}, ("bus",)),
        ({"subtype": "road", "participant:vehicle": "yes", "participant:vehicle:truck": "no"}, ("car", "bus")),
        ({"subtype": "road", "participant:vehicle": "no", "participant:bicycle": "yes"}, ("bicycle",)),
        ({"subtype": "walkway", "participant:pedestrian": "yes"}, ("pedestrian",)),
    ],
)
def test_participants_of_lanelet2_decide_on_the_users_of_a_lanelet(
    tags: dict[str, str], users: tuple[str, ...]
) -> None:
    found = users_of(tags)
    assert found[: len(users)] == users if "car" in users else found == users
    assert "truck" not in found


def test_lanelets_follow_although_each_line_has_its_own_nodes(tmp_path: Path, scenario: Path) -> None:
    path = lanelet2_of(scenario, tmp_path / "lanes.osm")
    root = etree.parse(path).getroot()
    nodes = {node.get("id"): node for node in root.iterfind("node")}
    for number, reference in enumerate(root.iterfind("way/nd"), start=900_000):
        node = deepcopy(nodes[reference.get("ref")])
        node.set("id", str(number))
        node.set(
            "lat", f"{float(node.get('lat')) + 3e-8 * (number % 2):.10f}"
        )  # 3 mm: less than the coordinates' digits
        reference.set("ref", str(number))
        root.insert(0, node)
    path.write_bytes(etree.tostring(root))
    made, known = (CommonRoadFileReader(str(file)).open_lanelet_network() for file in (converted(path).path, scenario))
    for lanelet in known.lanelets:
        assert sorted(made.find_lanelet_by_id(lanelet.lanelet_id).successor) == sorted(lanelet.successor)


def test_a_lanelet_that_is_closed_to_all_is_not_part_of_a_route(tmp_path: Path, scenario: Path) -> None:
    path = lanelet2_of(scenario, tmp_path / "lanes.osm")
    text = path.read_text(encoding="utf-8")
    tag = '<tag k="subtype" v="road"/>'
    path.write_text(text.replace(tag, f'{tag}<tag k="participant:vehicle" v="no"/>', 1), encoding="utf-8")
    told = converted(path)
    assert any("1 lanelet that no participant may use" in words for words in told.lost)
    known = CommonRoadFileReader(str(scenario)).open_lanelet_network()
    assert len(CommonRoadFileReader(told.path).open_lanelet_network().lanelets) == len(known.lanelets) - 1


def test_a_lanelet2_map_is_in_the_country_of_its_position(tmp_path: Path, scenario: Path) -> None:
    request = ReadMapRequest(path=converted(lanelet2_of(scenario, tmp_path / "lanes.osm")).path, map_id="map_1")
    assert read_map(request, lambda *_: None).country == "DEU"


def test_lanelets_for_bicycles_alone_are_closed_to_cars(tmp_path: Path, scenario: Path) -> None:
    text = scenario.read_text(encoding="utf-8")
    first = text.index("</laneletType>") + len("</laneletType>")
    users = "<userOneWay>bicycle</userOneWay><userOneWay>pedestrian</userOneWay>"
    end = text.index("</lanelet>", first)
    inside = re.sub(r"<userOneWay>.*?</userOneWay>", "", text[first:end])
    scenario.write_text(text[:first] + users + inside + text[end:], encoding="utf-8")
    lanelets = read_map_file(Path(converted(scenario).path))
    assert isinstance(lanelets, LaneletMap)
    assert b'allow="bicycle pedestrian"' in lanelets.net
