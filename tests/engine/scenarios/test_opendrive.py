"""Lanelets as OpenDRIVE: bounds where they were, links that hold, what is lost told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from lxml import etree
from pyproj import Proj
from support.builders import Lane, ScenarioBuilder, line, town_road

from benchmarks.maps.formats import asam_schema, bounds_of
from plannerforge.engine.commonroad import read_scenario, set_friction
from plannerforge.engine.maps.foreign.opendrive import convert_opendrive
from plannerforge.engine.network import run_netconvert, stated_frictions
from plannerforge.engine.scenarios import write_opendrive
from plannerforge.engine.scenarios.exchange.opendrive import BRIDGE_M
from plannerforge.engine.scenarios.exchange.reading_back import geometry_error
from plannerforge.engine.scenarios.exchange.road_plan import RoadPlan
from plannerforge.schemas.artifacts import ForeignExport, ForeignExportRequest
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.text import one_line

SHAPES = {
    "a skew end": ((0.0, 0.0), (30.0, 0.0)),
    "a corner of 90°": (*line((0.0, 0.0), (40.0, 0.0), 9), *line((40.0, 2.0), (40.0, 40.0), 9)),
    "half a metre long": ((0.0, 0.0), (0.5, 0.0)),
    "far from the origin": ((49_000.0, -48_000.0), (49_050.0, -48_020.0)),
}


def quiet(share: float, message: str = "") -> None:
    """Progress that is not looked at."""


def exported(source: Path, target: Path) -> ForeignExport:
    return write_opendrive(ForeignExportRequest(scenario_path=str(source), target_path=str(target)), quiet)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The road of the builders as OpenDRIVE."""
    folder = tmp_path_factory.mktemp("town")
    exported(town_road().write(folder / "town.xml"), folder / "town.xodr")
    return folder / "town.xodr"


def test_lanes_side_by_side_are_one_road_from_left_to_right(town: Path) -> None:
    roads = etree.parse(town).getroot().findall("road")
    lanes = [[note.get("value") for note in road.iter("userData")] for road in roads]
    assert ["2", "1"] in lanes
    assert sorted(key for keys in lanes for key in keys if key) == ["1", "11", "12", "13", "2", "21", "3"]


def test_a_fork_is_a_junction_that_links_lane_to_lane(town: Path) -> None:
    root = etree.parse(town).getroot()
    lane_of = {
        (road.get("id"), lane.get("id")): note.get("value")
        for road in root.iter("road")
        for lane in road.iter("lane")
        for note in lane.iter("userData")
    }
    linked = {
        (
            lane_of[connection.get("incomingRoad"), link.get("from")],
            lane_of[connection.get("connectingRoad"), link.get("to")],
        )
        for connection in root.iter("connection")
        for link in connection.iter("laneLink")
    }
    assert {("1", "11"), ("1", "12"), ("2", "21")} <= linked


def linked(path: Path) -> set[tuple[int, int]]:
    """Which lanelet leads into which in a file, as its links, connections and lane links say."""
    root = etree.parse(path).getroot()
    roads = {road.get("id", ""): road for road in root.iterfind("road")}
    lanelet: dict[tuple[str, str], int] = {}
    behind: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for key, road in roads.items():
        successor = road.find("link/successor")
        for lane in road.iterfind("lanes/laneSection/right/lane"):
            here = key, lane.get("id", "")
            if (note := lane.find("userData")) is not None and float(road.get("length", "0")) > BRIDGE_M:
                lanelet[here] = int(note.get("value", "0"))
            for after in lane.iterfind("link/successor"):
                assert successor is not None
                assert successor.get("elementType") == "road"
                behind.setdefault(here, []).append((successor.get("elementId", ""), after.get("id", "")))
    for junction in root.iterfind("junction"):
        connecting = [connection.get("connectingRoad", "") for connection in junction.iterfind("connection")]
        assert len(set(connecting)) == len(connecting)
        for connection in junction.iterfind("connection"):
            incoming, road = connection.get("incomingRoad", ""), connection.get("connectingRoad", "")
            assert roads[incoming].find("link/successor").get("elementId") == junction.get("id")  # type: ignore[union-attr]
            assert roads[incoming].get("junction") == "-1"
            assert roads[road].get("junction") == junction.get("id")
            assert roads[road].find("link/predecessor").get("elementId") == incoming  # type: ignore[union-attr]
            for link in connection.iterfind("laneLink"):
                behind.setdefault((incoming, link.get("from", "")), []).append((road, link.get("to", "")))
    found = set[tuple[int, int]]()
    for here, key_of_lanelet in lanelet.items():
        waiting = list(behind.get(here, ()))
        while waiting:
            there = waiting.pop()
            if there in lanelet:
                found.add((key_of_lanelet, lanelet[there]))
            else:
                waiting += behind.get(there, ())
    return found


def network(*lanes: Lane) -> ScenarioBuilder:
    """Lanes alone, with the links of both sides."""
    before = {
        lane.lanelet_id: tuple(one.lanelet_id for one in lanes if lane.lanelet_id in one.successors) for lane in lanes
    }
    whole = tuple(replace(lane, predecessors=before[lane.lanelet_id]) for lane in lanes)
    return replace(town_road(), lanes=whole, vehicles=(), parked=())


WEST, EAST = line((0, 0), (50, 0)), line((50, 0), (100, 0))
JOINTS = {
    "roads in a row": (Lane(1, WEST, (2,)), Lane(2, EAST)),
    "a merge behind a merge": (
        Lane(1, WEST, (3,)),
        Lane(2, ((0, 9), (30, 0.1), (45, 0), (50, 0)), (3,)),
        Lane(3, EAST, (5,)),
        Lane(4, ((50, 9), (80, 0.1), (95, 0), (100, 0)), (5,)),
        Lane(5, line((100, 0), (150, 0))),
        Lane(6, line((-50, 0), (0, 0)), (1,)),
        Lane(7, line((-50, 9), (0, 9)), (2,)),
    ),
    "several roads into several": (
        Lane(1, WEST, (3, 4)),
        Lane(2, ((0, 9), (30, 0.1), (45, 0), (50, 0)), (3, 4)),
        Lane(3, EAST, (5, 6)),
        Lane(4, ((50, 0), (55, 0), (70, -0.1), (100, -9))),
        Lane(5, line((100, 0), (150, 0))),
        Lane(6, ((100, 0), (105, 0), (120, 0.1), (150, 9))),
    ),
    "a fork behind a fork": (
        Lane(1, WEST, (2, 3)),
        Lane(2, EAST, (4, 5)),
        Lane(3, ((50, 0), (55, 0), (70, -0.1), (100, -9))),
        Lane(4, line((100, 0), (150, 0))),
        Lane(5, ((100, 0), (105, 0), (120, 0.1), (150, 9))),
    ),
    "an end of another direction": (Lane(1, WEST, (2,)), Lane(2, line((50, 0), (90, 20)))),
}


@pytest.mark.parametrize("lanes", JOINTS.values(), ids=JOINTS)
def test_each_joint_keeps_its_links_without_a_gap(lanes: tuple[Lane, ...], tmp_path: Path) -> None:
    told = exported(network(*lanes).write(tmp_path / "joint.xml"), tmp_path / "joint.xodr")
    assert told.lost == ()
    pairs = {(lane.lanelet_id, after) for lane in lanes for after in lane.successors}
    assert linked(tmp_path / "joint.xodr") == pairs
    bounds = bounds_of(tmp_path / "joint.xodr")
    gaps = [np.abs(bounds[key][side][-1] - bounds[after][side][0]).max() for key, after in pairs for side in (0, 1)]
    assert max(gaps) < 0.005
    asam_schema("opendrive_17_core.xsd").assertValid(etree.parse(tmp_path / "joint.xodr"))


def test_a_link_between_lanelets_far_apart_is_left_out_and_reported(tmp_path: Path) -> None:
    lanes = Lane(1, WEST, (2,)), Lane(2, line((50, 3.5), (100, 3.5)))
    told = exported(network(*lanes).write(tmp_path / "apart.xml"), tmp_path / "apart.xodr")
    assert told.lost == ("1 link between lanelets that do not meet",)
    assert linked(tmp_path / "apart.xodr") == set()


def test_a_lane_drawn_without_a_width_at_its_start_follows_no_other_lane() -> None:
    wide, short = (
        Lanelet(np.array(left), np.add(left, right) / 2, np.array(right), key, predecessor=before, successor=after)
        for key, left, right, before, after in (
            (1, [(7.39, 1.6), (2.47, 0.0)], [(6.21, 5.1), (0.0, 2.9)], [], [2]),
            (
                2,
                [(2.47, 0.0), (3.89, 1.3), (4.84, 4.1), (4.48, 6.8)],
                [(0.0, 2.9), (0.35, 3.5), (0.32, 4.5), (0.07, 5.1)],
                [1],
                [],
            ),
        )
    )
    plan = RoadPlan.of(LaneletNetwork.create_from_lanelet_list([wide, short]))
    assert plan.following == {1: (), 2: ()}
    assert plan.apart == ((1, 2),)


def test_the_reported_bounds_match_another_reader_s(tmp_path: Path) -> None:
    told = exported(town_road().write(tmp_path / "town.xml"), tmp_path / "town.xodr").geometry
    assert told is not None
    assert told.within_share == 1.0
    left, right = bounds_of(tmp_path / "town.xodr")[2]
    assert np.abs(left[:, 1] - 5.25).max() < 0.01
    assert np.abs(right[:, 1] - 1.75).max() < 0.01


def test_a_bound_that_was_moved_in_the_file_is_reported(tmp_path: Path) -> None:
    source = town_road().write(tmp_path / "town.xml")
    exported(source, tmp_path / "town.xodr")
    root = etree.parse(tmp_path / "town.xodr").getroot()
    first = next(root.iter("width"))
    first.set("a", str(float(first.get("a", "0")) + 0.5))
    moved = geometry_error(etree.tostring(root), read_scenario(source).scenario.lanelet_network)
    assert moved.max_m == pytest.approx(0.5, abs=0.02)
    assert moved.within_share < 1.0


def test_a_lanelet_that_the_file_lacks_counts_as_far(tmp_path: Path) -> None:
    source = town_road().write(tmp_path / "town.xml")
    exported(source, tmp_path / "town.xodr")
    root = etree.parse(tmp_path / "town.xodr").getroot()
    network = read_scenario(source).scenario.lanelet_network
    for road in root.findall("road")[1:]:
        root.remove(road)
    assert geometry_error(etree.tostring(root), network).within_share < 0.95


@pytest.mark.parametrize("center", SHAPES.values(), ids=SHAPES)
def test_odd_shapes_keep_their_bounds(center: tuple[tuple[float, float], ...], tmp_path: Path) -> None:
    lanes = (*town_road().lanes, Lane(99, center))
    written = exported(replace(town_road(), lanes=lanes).write(tmp_path / "odd.xml"), tmp_path / "odd.xodr")
    assert written.geometry is not None
    assert written.geometry.within_share > 0.99
    assert 99 in bounds_of(tmp_path / "odd.xodr")


def test_the_same_lanelets_give_the_same_bytes(town: Path, tmp_path: Path) -> None:
    exported(town_road().write(tmp_path / "town.xml"), tmp_path / "again.xodr")
    assert (tmp_path / "again.xodr").read_bytes() == town.read_bytes()


def test_the_file_keeps_to_the_schema_of_the_standard(town: Path) -> None:
    schema = asam_schema("opendrive_17_core.xsd")
    schema.assertValid(etree.parse(town))


def test_a_name_with_markup_in_it_stays_text(tmp_path: Path) -> None:
    name = 'ZAM_"&lt;road/&gt;-1_1_T-1'
    source = tmp_path / "odd.xml"
    source.write_text(town_road().xml().replace('"ZAM_Builder-1_1_T-1"', "'ZAM_\"&lt;road/&gt;-1_1_T-1'"))
    exported(source, tmp_path / "odd.xodr")
    header = etree.parse(tmp_path / "odd.xodr").getroot().find("header")
    assert header is not None
    assert header.get("name") == one_line(name.replace("&lt;", "<").replace("&gt;", ">"))


def test_a_scenario_without_lanelets_is_refused(tmp_path: Path) -> None:
    empty = replace(town_road(), lanes=(), vehicles=(), parked=(), problems=())
    with pytest.raises(PlannerForgeError):
        exported(empty.write(tmp_path / "empty.xml"), tmp_path / "empty.xodr")
    assert not (tmp_path / "empty.xodr").exists()


LOCATED = """<location><geoNameId>-999</geoNameId><gpsLatitude>48</gpsLatitude><gpsLongitude>11</gpsLongitude>
<geoTransformation><geoReference>{projection}</geoReference><additionalTransformation>
<xTranslation>-650000.0</xTranslation><yTranslation>-5300000.5</yTranslation><zRotation>{turned}</zRotation>
<scaling>1.0</scaling></additionalTransformation></geoTransformation></location>"""


def located(folder: Path, projection: str, turned: str = "0.0") -> tuple[str, ForeignExport]:
    """The geo-reference of the town where it lies by a projection with a shift, and what is told."""
    text = town_road().xml()
    start, end = text.index("<location>"), text.index("</location>") + len("</location>")
    (folder / "town.xml").write_text(text[:start] + LOCATED.format(projection=projection, turned=turned) + text[end:])
    told = exported(folder / "town.xml", folder / "town.xodr")
    return etree.parse(folder / "town.xodr").getroot().findtext("header/geoReference") or "", told


@pytest.mark.parametrize(
    "projection",
    ["+proj=utm +zone=32 +ellps=WGS84 +units=m +no_defs", "+proj=tmerc +lat_0=48 +lon_0=9 +k=1 +x_0=7 +ellps=WGS84"],
)
def test_the_file_states_the_location_of_its_roads_on_earth(projection: str, tmp_path: Path) -> None:
    written, told = located(tmp_path, projection)
    assert told.lost == ()
    expected = Proj(projection)(650_100.0, 5_300_200.5, inverse=True)
    assert Proj(written)(100.0, 200.0, inverse=True) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("projection", "turned"),
    [("+proj=tmerc +lat_0=48 +lon_0=9 +units=us-ft", "0.0"), ("+proj=utm +zone=32", "0.3"), ("EPSG:25832", "0.0")],
)
def test_a_geo_reference_that_cannot_be_kept_is_reported(projection: str, turned: str, tmp_path: Path) -> None:
    written, told = located(tmp_path, projection, turned)
    assert not written
    assert told.lost == ("the geo-reference",)


def test_netconvert_reads_the_lanes_at_their_positions(town: Path, tmp_path: Path) -> None:
    """SUMO's reader, which shares nothing with the writer: its lanes lie on the middle of the lanelets."""
    net = tmp_path / "town.net.xml"
    run_netconvert(["--opendrive-files", str(town), "--opendrive.curve-resolution", "1"], net)
    root = etree.parse(net).getroot()
    x_m, y_m = (float(part) for part in root.find("location").get("netOffset").split(","))  # type: ignore[union-attr]
    lanes = [lane for edge in root.findall("edge") if edge.get("function") != "internal" for lane in edge.iter("lane")]
    shapes = [
        np.array([point.split(",")[:2] for point in lane.get("shape", "").split()], dtype=float) for lane in lanes
    ]
    middles = {round(float(np.median(shape[:, 1])) - y_m, 1) for shape in shapes}
    assert {0.0, 3.5, 7.0} <= middles
    assert max(float(shape[:, 0].max()) for shape in shapes) - x_m == pytest.approx(300.0, abs=0.1)


def test_pavements_and_crossings_are_left_out_and_reported(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "town.xml")
    bounds = "".join(
        f"<{side}><point><x>0</x><y>{y}</y></point><point><x>50</x><y>{y}</y></point></{side}>"
        for side, y in (("leftBound", -6), ("rightBound", -8))
    )
    users = "<laneletType>sidewalk</laneletType><userBidirectional>pedestrian</userBidirectional>"
    path.write_text(path.read_text().replace("<lanelet ", f'<lanelet id="900">{bounds}{users}</lanelet><lanelet ', 1))
    assert exported(path, tmp_path / "town.xodr").lost == ("1 footway (pavements and crossings)",)


def with_friction(source: Path, friction: float) -> Path:
    document = etree.parse(source)
    set_friction(document.getroot(), friction)
    document.write(source)
    return source


def test_the_friction_of_the_roads_is_written_for_every_lane_and_read_again(tmp_path: Path) -> None:
    exported(with_friction(town_road().write(tmp_path / "town.xml"), 0.2), tmp_path / "town.xodr")
    root = etree.parse(tmp_path / "town.xodr")
    asam_schema("opendrive_17_core.xsd").assertValid(root)
    assert {one.get("friction") for one in root.iter("material")} == {"0.2"}
    lost = convert_opendrive(tmp_path / "town.xodr", tmp_path / "town.net.xml", tmp_path)
    assert stated_frictions(tmp_path / "town.net.xml") == {0.2}
    assert not any(words.startswith("friction") for words in lost)


def test_frictions_that_differ_are_reported_and_left_out(tmp_path: Path) -> None:
    exported(with_friction(town_road().write(tmp_path / "town.xml"), 0.2), tmp_path / "town.xodr")
    root = etree.parse(tmp_path / "town.xodr")
    next(root.iter("material")).set("friction", "0.8")
    root.write(tmp_path / "town.xodr")
    lost = convert_opendrive(tmp_path / "town.xodr", tmp_path / "town.net.xml", tmp_path)
    assert stated_frictions(tmp_path / "town.net.xml") == {None}
    assert any(words.startswith("friction") for words in lost)
