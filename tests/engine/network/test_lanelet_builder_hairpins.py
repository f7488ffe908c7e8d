"""A turn that no lanelet can follow leaves the net and the lanelets together."""

import math
from collections.abc import Sequence
from pathlib import Path

import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.foreign.conversion import convert_roads
from plannerforge.engine.network import lanelet_builder as hairpins
from plannerforge.engine.network.lanelet_builder import build_road_network, remove_hairpins
from plannerforge.engine.network.net_parser import read_net
from plannerforge.engine.network.netconvert import convert_osm, remove_connections
from plannerforge.schemas.generation import ConvertMapRequest


@pytest.fixture
def net_path(tmp_path: Path) -> Path:
    """A road that forks into two at an angle of 5°: from one of them into the other nobody can turn."""
    fork_rad = math.radians(5.0)
    places = {1: (0.0, -200.0), 2: (0.0, 0.0), 3: (0.0, 200.0), 4: (200 * math.sin(fork_rad), 200 * math.cos(fork_rad))}
    nodes = [f'<node id="{k}" lat="{48 + y / 111195:.7f}" lon="{11 + x / 74400:.7f}"/>' for k, (x, y) in places.items()]
    roads = [
        f'<way id="{10 + end}"><nd ref="{start}"/><nd ref="{end}"/><tag k="highway" v="residential"/></way>'
        for start, end in ((1, 2), (2, 3), (2, 4))
    ]
    (tmp_path / "fork.osm").write_text(f'<osm version="0.6">{"".join([*nodes, *roads])}</osm>')
    convert_osm(tmp_path / "fork.osm", tmp_path / "site.net.xml", lefthand=False)
    return tmp_path / "site.net.xml"


def dropped(net_path: Path) -> int:
    return len(build_road_network(read_net(net_path), step_s=0.1, elapsed_s=0.0).dropped_lanes)


def test_a_hairpin_is_removed_from_the_net_and_netconvert_s_warnings_are_kept(
    net_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def warned(net: Path, connections: Sequence[tuple[str, str, int, int]], scratch: Path) -> tuple[str, ...]:
        remove_connections(net, connections, scratch)
        return ("a lane is lost",)

    monkeypatch.setattr(hairpins, "remove_connections", warned)
    before = len(read_net(net_path).connections)
    assert dropped(net_path) == 1
    assert remove_hairpins(net_path, tmp_path) == (1, ("a lane is lost",))
    assert dropped(net_path) == 0
    assert len(read_net(net_path).connections) < before


def test_an_import_of_the_net_tells_the_turn_that_its_lanelets_lack(net_path: Path, tmp_path: Path) -> None:
    before = net_path.read_bytes()
    told = convert_roads(ConvertMapRequest(path=str(net_path), folder=str(tmp_path)), silent)
    (lost,) = build_road_network(read_net(net_path), step_s=0.1, elapsed_s=0.0).lost_connections
    assert (told.path, net_path.read_bytes()) == (str(net_path), before)
    assert [lost[0] in words and lost[1] in words for words in told.lost] == [True]


def test_a_net_without_hairpins_stays_as_it_is(tmp_path: Path) -> None:
    net_path = tmp_path / "site.net.xml"
    convert_osm(LIBRARY / "musterstadt.osm", net_path, lefthand=False)
    before = net_path.read_bytes()
    assert remove_hairpins(net_path, tmp_path) == (0, ())
    assert net_path.read_bytes() == before
