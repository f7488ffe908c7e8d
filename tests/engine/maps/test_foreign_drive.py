"""OpenDRIVE as files have it: joints without length, traffic on the left, versions after 1.4, straight curves."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.foreign_maps import drive_file, two_roads

from plannerforge.engine.maps.foreign.opendrive import convert_opendrive
from plannerforge.engine.network.lanelet_builder import build_road_network
from plannerforge.engine.network.net_parser import SumoNet, read_net
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.schemas.errors import UnsafeInput


def converted(text: str, folder: Path) -> tuple[SumoNet, RoadNetwork]:
    source = folder / "a.xodr"
    source.write_text(text, encoding="utf-8")
    convert_opendrive(source, folder / "a.net.xml", folder)
    net = read_net(folder / "a.net.xml")
    return net, build_road_network(net, step_s=0.1, elapsed_s=0.0)


def ends(lanelet: RoadLanelet) -> tuple[float, float]:
    return float(lanelet.center[0][0]), float(lanelet.center[-1][0])


def test_roads_that_meet_end_to_end_stay_connected(tmp_path: Path) -> None:
    _, network = converted(two_roads(), tmp_path)
    assert len(network.lanelets) == 4
    assert network.lost_connections == ()
    for lanelet in network.lanelets.values():
        assert len(lanelet.successors) + len(lanelet.predecessors) == 1
        for key in lanelet.successors:
            assert network.lanelets[key].left[0] == pytest.approx(lanelet.left[-1])
            assert ends(network.lanelets[key])[0] == pytest.approx(ends(lanelet)[1])


@pytest.mark.parametrize("rule", ["RHT", "LHT"])
def test_traffic_drives_on_the_side_that_the_file_states(rule: str, tmp_path: Path) -> None:
    net, network = converted(two_roads(rule=rule), tmp_path)
    assert net.lefthand == (rule == "LHT")
    assert network.lost_connections == ()
    for lanelet in network.lanelets.values():
        eastwards = ends(lanelet)[1] > ends(lanelet)[0]
        middle = np.mean([one.center[:, 1].mean() for one in network.lanelets.values()])
        north = lanelet.center[:, 1].mean() > middle
        assert north == (eastwards == (rule == "LHT"))


def test_a_left_turn_of_left_hand_traffic_turns_left(tmp_path: Path) -> None:
    curve = '<geometry s="0" x="0" y="0" hdg="0" length="100"><arc curvature="0.01"/></geometry>'
    _, network = converted(drive_file(curve, length=100, rule="LHT"), tmp_path)
    for lanelet in network.lanelets.values():
        ahead = np.diff(lanelet.center, axis=0)
        turn = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        outwards = ends(lanelet)[1] > ends(lanelet)[0]
        assert (turn[-1] > turn[0]) == outwards


def test_roads_of_both_sides_are_refused_by_name(tmp_path: Path) -> None:
    text = two_roads(rule="LHT").replace('rule="LHT"', 'rule="RHT"', 1)
    with pytest.raises(UnsafeInput, match="LHT"):
        converted(text, tmp_path)


def test_a_namespace_and_a_centre_lane_without_type_are_read(tmp_path: Path) -> None:
    text = two_roads().replace("<OpenDRIVE>", '<OpenDRIVE xmlns="http://www.opendrive.org">')
    text = text.replace('<lane id="0" type="none" level="false"/>', '<lane id="0" level="false"/>')
    assert len(converted(text, tmp_path)[1].lanelets) == 4


@pytest.mark.parametrize(
    "piece",
    [
        '<arc curvature="0.0"/>',
        '<spiral curvStart="1e-09" curvEnd="-4.999999862227235e-10"/>',
        '<spiral curvStart="0.069" curvEnd="0.06900000000000002"/>',
    ],
)
def test_pieces_that_are_hardly_curved_are_read(piece: str, tmp_path: Path) -> None:
    view = f'<geometry s="0" x="0" y="0" hdg="0" length="60">{piece}</geometry>'
    _, network = converted(drive_file(view, length=60), tmp_path)
    assert len(network.lanelets) == 2


def test_a_direct_junction_leads_to_both_of_its_roads(tmp_path: Path) -> None:
    straight = '<geometry s="0" x="{}" y="{}" hdg="{}" length="100"><line/></geometry>'
    roads = [
        drive_file(
            straight.format(0, 0, 0), length=100, key=1, link='<successor elementType="junction" elementId="9"/>'
        ),
        *(
            drive_file(
                straight.format(100, 0, heading),
                length=100,
                key=key,
                link='<predecessor elementType="junction" elementId="9"/>',
            )
            for key, heading in ((2, 0.0), (3, -0.1))
        ),
    ]
    junction = "".join(
        f'<connection id="{key}" incomingRoad="1" linkedRoad="{key}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for key in (2, 3)
    )
    inner = "".join(re.sub(r"</?OpenDRIVE>|<header.*?</header>", "", text) for text in roads)
    head, direct = "<header revMajor='1' revMinor='8'/>", "<junction id='9' name='' type='direct'>"
    text = f"<OpenDRIVE>{head}{inner}{direct}{junction}</junction></OpenDRIVE>"
    net, network = converted(text, tmp_path)
    ways = {(link.from_edge, link.to_edge) for link in net.connections if not link.from_edge.startswith(":")}
    assert len([way for way in ways if way[0] == "-1"]) == 2
    assert not [lost for lost in network.lost_connections if lost[0] == "-1_0"]


def test_a_long_road_is_cut_and_stays_whole(tmp_path: Path) -> None:
    view = '<geometry s="0" x="0" y="0" hdg="0" length="9000"><arc curvature="0.0002"/></geometry>'
    _, network = converted(drive_file(view, length=9000), tmp_path)
    assert max(len(lanelet.left) for lanelet in network.lanelets.values()) <= 5000
    assert len(network.lanelets) > 2
    assert len([one for one in network.lanelets.values() if not one.successors]) == 2
    assert network.lost_connections == ()
