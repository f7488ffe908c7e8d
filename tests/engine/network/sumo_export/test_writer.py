"""The SUMO network is the lanelet network: same lanes, same geometry, same bytes every time."""

from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from support.builders import ScenarioBuilder, crossing, town_road
from support.elsewhere import net_of

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.network.sumo_export.layout import NetLayout
from plannerforge.engine.network.sumo_export.speeds import lowered_by_curves, straight_speeds
from plannerforge.engine.network.sumo_export.writer import sumo_net


def write(network: Any, net: Path) -> NetLayout:
    layout = NetLayout.of(network)
    net.write_text(sumo_net(layout, lowered_by_curves(layout, straight_speeds(layout, {}))), encoding="utf-8")
    return layout


def written(builder: ScenarioBuilder, folder: Path) -> tuple[NetLayout, Path]:
    net = folder / "road.net.xml"
    scenario = read_scenario(builder.write(folder / "road.xml")).scenario
    return write(scenario.lanelet_network, net), net


def test_lanelets_side_by_side_in_one_direction_are_lanes_of_an_edge_from_the_right(tmp_path: Path) -> None:
    layout, _ = written(town_road(), tmp_path)
    assert layout.edges["e1"] == (1, 2)
    assert layout.edges["e11"] == (11, 21)
    assert layout.edges["e3"] == (3,)


def test_every_lanelet_is_a_lane_or_part_of_a_path_through_a_junction(tmp_path: Path) -> None:
    for builder in (town_road(), crossing()):
        layout, _ = written(builder, tmp_path)
        covered = {key for keys in layout.lanelets_of_lane.values() for key in keys}
        assert covered == {lane.lanelet_id for lane in builder.lanes}


def test_lanes_have_the_centre_lines_of_the_lanelets_as_shapes(tmp_path: Path) -> None:
    _, net = written(town_road(), tmp_path)
    shape = etree.parse(net).find(".//lane[@id='e13_0']").get("shape")
    points = [tuple(float(part) for part in point.split(",")) for point in shape.split()]
    assert points[0] == pytest.approx((220, -20), abs=1e-3)
    assert points[-1] == pytest.approx((220, -100), abs=1e-3)


def test_crossing_lanelets_are_in_a_junction_where_the_left_yields_to_the_right(tmp_path: Path) -> None:
    layout, net = written(crossing(), tmp_path)
    assert layout.interior.lanelets == {2, 5}
    states = {
        element.get("from"): element.get("state")
        for element in etree.parse(net).iter("connection")
        if not element.get("from").startswith(":")
    }
    assert states == {"e1": "m", "e4": "M"}


def test_sumo_loads_the_network_with_exactly_these_lanes(tmp_path: Path) -> None:
    import libsumo

    for builder in (town_road(), crossing()):
        layout, net = written(builder, tmp_path)
        libsumo.start(["sumo", "--net-file", str(net), "--no-step-log", "--no-warnings"])
        try:
            assert set(libsumo.lane.getIDList()) == set(layout.lanelets_of_lane)
        finally:
            libsumo.close()


def test_curves_are_driven_more_slowly_than_straights(tmp_path: Path) -> None:
    _, net = written(town_road(), tmp_path)
    lanes = etree.parse(net)
    straight = float(lanes.find(".//lane[@id='e1_0']").get("speed"))
    bend = float(lanes.find(".//lane[@id='e12_0']").get("speed"))
    assert bend < 10.0 < straight


def test_footpaths_are_left_out(tmp_path: Path) -> None:
    first, _, rest = town_road().xml().partition('<lanelet id="13">')
    file = tmp_path / "foot.xml"
    file.write_text(first + '<lanelet id="13">' + rest.replace("urban</laneletType>", "sidewalk</laneletType>", 1))
    layout = NetLayout.of(read_scenario(file).scenario.lanelet_network)
    assert 13 not in layout.table.lanes
    assert layout.table.successors[12] == ()


@pytest.mark.parametrize("builder", [town_road(), crossing()], ids=["fork", "crossing"])
def test_the_bytes_do_not_depend_on_the_hash_seed(
    builder: ScenarioBuilder, tmp_path: Path, other_process: Executor
) -> None:
    file = builder.write(tmp_path / "road.xml")
    assert other_process.submit(net_of, file).result() == net_of(file)


@pytest.mark.shared_data
def test_networks_of_real_files_load_whole(shared_data: Path, tmp_path: Path) -> None:
    import libsumo

    for path in sorted((shared_data / "data" / "commonroad").glob("*.xml"))[::40]:
        net = tmp_path / "real.net.xml"
        layout = write(read_scenario(path).scenario.lanelet_network, net)
        libsumo.start(["sumo", "--net-file", str(net), "--no-step-log", "--no-warnings"])
        try:
            assert set(libsumo.lane.getIDList()) == set(layout.lanelets_of_lane), path.name
        finally:
            libsumo.close()
