from pathlib import Path

import numpy as np
import pytest

from plannerforge.engine.maps.drawn_library import LIBRARY, Sketch
from plannerforge.engine.network.lane_bounds import is_valid
from plannerforge.engine.network.lanelet_builder import build_road_network
from plannerforge.engine.network.net_parser import SumoNet, read_net
from plannerforge.engine.network.netconvert import cap_speeds, convert_osm
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.schemas.errors import NotPossible


@pytest.fixture(scope="module", params=[False, True], ids=["right-hand", "left-hand"])
def converted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[SumoNet, RoadNetwork]:
    path = tmp_path_factory.mktemp("net") / "a.net.xml"
    convert_osm(LIBRARY / "musterstadt.osm", path, lefthand=request.param)
    net = read_net(path)
    assert net.lefthand is request.param
    return net, build_road_network(net, step_s=0.1, elapsed_s=0.0)


def test_the_bounds_of_no_lane_cross(converted: tuple[SumoNet, RoadNetwork]) -> None:
    _, network = converted
    assert len(network.lanelets) > 60
    assert all(is_valid(lanelet.left, lanelet.right) for lanelet in network.lanelets.values())


def test_references_are_symmetric(converted: tuple[SumoNet, RoadNetwork]) -> None:
    lanelets = converted[1].lanelets
    for key, lanelet in lanelets.items():
        assert all(key in lanelets[other].predecessors for other in lanelet.successors)
        assert all(key in lanelets[other].successors for other in lanelet.predecessors)
        if lanelet.left_neighbour is not None and lanelet.left_same_direction:
            other = lanelets[lanelet.left_neighbour]
            assert other.right_neighbour == key
            assert np.abs(other.right - lanelet.left).max() < 0.05


def test_followers_begin_where_the_lanelet_ends(converted: tuple[SumoNet, RoadNetwork]) -> None:
    lanelets = converted[1].lanelets
    gaps = [
        np.linalg.norm(lanelet.left[-1] - lanelets[other].left[0])
        for lanelet in lanelets.values()
        for other in lanelet.successors
    ]
    assert np.mean(np.array(gaps) < 0.05) > 0.97


def test_the_crossing_has_lights_stop_positions_and_four_arms(converted: tuple[SumoNet, RoadNetwork]) -> None:
    _, network = converted
    assert {colour for light in network.lights for _, colour in light.cycle} == {"green", "yellow", "red"}
    lit = {light.lanelet_id for light in network.lights}
    crossing = next(i for i in network.intersections if any(set(a.lanelet_ids) & lit for a in i.incomings))
    assert len(crossing.incomings) == 4
    assert all(arm.straight and arm.left and arm.right for arm in crossing.incomings)


def test_lanes_of_a_road_have_its_limit_and_type(converted: tuple[SumoNet, RoadNetwork]) -> None:
    _, network = converted
    main = [lanelet for lanelet in network.lanelets.values() if lanelet.street == "Hauptstraße"]
    assert main
    assert all(lanelet.types[0] == "urban" and abs(lanelet.speed_mps - 50 / 3.6) < 0.1 for lanelet in main)


def test_curves_lower_the_speed_and_no_date_stays_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.net.xml"
    convert_osm(LIBRARY / "kreiselheim.osm", path, lefthand=False)
    assert cap_speeds(path) > 0
    text = path.read_text(encoding="utf-8")
    assert "<!--" not in text
    ring = [lane for lane in read_net(path).lanes.values() if not lane.internal and lane.speed_mps < 8.5]
    assert ring, "the ring of 20 m radius allows about 8.4 m/s"


def test_a_map_without_roads_for_cars_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foot.osm"
    path.write_text(
        "<osm version='0.6'><node id='1' lat='54.6' lon='5.2'/><node id='2' lat='54.61' lon='5.2'/>"
        "<way id='1'><nd ref='1'/><nd ref='2'/><tag k='highway' v='footway'/></way></osm>"
    )
    old = tmp_path / "a.net.xml"
    old.write_text("an old file is never taken for a result")
    with pytest.raises(NotPossible, match="cannot build a road network"):
        convert_osm(path, old, lefthand=False)
    assert not old.exists()


def test_of_two_roads_drawn_over_each_other_each_lane_has_one_oncoming_lane(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    for name, aside_m in (("Mill Road", 0.1), ("Mill Road too", -0.1)):
        sketch.road([(0, 0), (60, aside_m), (120, 0)], "residential", name)
    sketch.road([(120, 100), (120, 0), (120, -100)], "residential", "Side Road")
    sketch.road([(0, 100), (0, 0), (0, -100)], "residential", "Other Road")
    sketch.write(tmp_path / "map.osm")
    convert_osm(tmp_path / "map.osm", tmp_path / "a.net.xml", lefthand=False)
    lanelets = build_road_network(read_net(tmp_path / "a.net.xml"), step_s=0.1, elapsed_s=0.0).lanelets
    twice = [lanelet for lanelet in lanelets.values() if lanelet.street.startswith("Mill Road")]
    assert len(twice) == 4
    for lanelet in twice:
        if lanelet.left_neighbour is not None:
            assert lanelets[lanelet.left_neighbour].left_neighbour == lanelet.lanelet_id
    assert all(lanelet.left_neighbour is not None for lanelet in twice)
