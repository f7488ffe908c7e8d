"""Sites that the map promises are built: lights where some roads have a signal, and beside a road that is broken."""

from functools import cache
from pathlib import Path
from typing import Any

from plannerforge.engine.execution import silent
from plannerforge.engine.generation.site_network import prepare_site, with_later_lights
from plannerforge.engine.generation.writer import STEP_S
from plannerforge.engine.maps.osm import OsmMap, OsmNode, OsmWay
from plannerforge.engine.maps.site_search.finder import Site, SiteFinder
from plannerforge.engine.network import build_road_network, read_net
from plannerforge.engine.traffic import WARM_UP_S
from plannerforge.schemas.generation import GenerationRequest

ARM_DEG = 0.0012
"""About 133 m at the equator."""
SIGNAL_DEG = 0.0001


@cache
def crossing_with_a_signal_on_one_arm() -> OsmMap:
    """One map, so that its site is built once."""
    ends = {2: (ARM_DEG, 0.0), 3: (0.0, ARM_DEG), 4: (-ARM_DEG, 0.0), 5: (0.0, -ARM_DEG)}
    nodes = {1: OsmNode(1, 0.0, 0.0, {})} | {key: OsmNode(key, *place, {}) for key, place in ends.items()}
    nodes[6] = OsmNode(6, SIGNAL_DEG, 0.0, {"highway": "traffic_signals", "traffic_signals:direction": "backward"})
    tags = {"highway": "secondary", "name": "Long Road"}
    ways = (
        OsmWay(1, (1, 6, 2), tags),
        *(OsmWay(key, (1, key), {"highway": "secondary", "name": f"Road {key}"}) for key in (3, 4, 5)),
    )
    return OsmMap(nodes, ways, (), None)


def request_at(site: Site) -> GenerationRequest:
    wish: dict[str, Any] = {
        **dict.fromkeys(("map_path", "map_id", "attribution", "folder"), ""),
        **dict.fromkeys(("streets", "vehicles", "road_classes"), ()),
        **dict.fromkeys(("country", "bbox"), None),
    }
    return GenerationRequest(
        place="Crossing", scenario_type=site.kind, density="medium", duration_s=20.0, seed=1, index=0, **wish
    )


def test_a_junction_with_a_signal_on_one_arm_gets_lights_and_the_answer_reports_it(tmp_path: Path) -> None:
    osm = crossing_with_a_signal_on_one_arm()
    (site,) = SiteFinder(osm).find("signalised_intersection")
    built = prepare_site(request_at(site), osm, site, tmp_path, silent)
    assert "traffic_light" in set(built.net.junction_types.values())
    assert any("lights were created" in note for note in built.notes)


def test_lights_keep_their_phase_offset_in_network_and_lanelets(tmp_path: Path) -> None:
    osm = crossing_with_a_signal_on_one_arm()
    (site,) = SiteFinder(osm).find("signalised_intersection")
    built = prepare_site(request_at(site), osm, site, tmp_path, silent)
    (tmp_path / "later").mkdir()
    later = with_later_lights(built, 30.0, tmp_path / "later")
    anew = build_road_network(read_net(later.net_path), step_s=STEP_S, elapsed_s=WARM_UP_S)
    offsets = [[light.offset_steps for light in network.lights] for network in (built.network, later.network, anew)]
    assert offsets[0] != offsets[1] == offsets[2]
    assert later.network.lanelets == built.network.lanelets
    assert len(later.notes) == len(built.notes) + 1


YARD_M = (
    *(
        (0.0, 0.0),
        (-1.4, -6.8),
        (-1.8, -6.7),
        (-7.6, -5.7),
        (-8.8, -10.6),
        (-12.1, -10.0),
        (-21.8, -8.0),
        (-27.4, -6.9),
    ),
    *((-27.3, -4.3), (-21.1, -4.7), (-20.8, 1.5), (-17.7, 2.6), (-1.7, -0.8)),
)
"""The outline of a yard that is mapped as a road: its corners are too near to each other for lanes of a usual width."""


def test_a_road_that_no_lanelet_can_follow_is_left_out_and_reported(tmp_path: Path) -> None:
    crossing = crossing_with_a_signal_on_one_arm()
    metre_deg = 1 / 111_195
    yard = {
        10 + number: OsmNode(10 + number, (y + 60) * metre_deg, (x + 70) * metre_deg, {})
        for number, (x, y) in enumerate(YARD_M)
    }
    way = OsmWay(99, tuple(yard), {"highway": "unclassified", "oneway": "yes"})
    osm = OsmMap({**crossing.nodes, **yard}, (*crossing.ways, way), (), None)
    site = next(site for site in SiteFinder(osm).find("intersection") if "Long Road" in site.streets)
    built = prepare_site(request_at(site), osm, site, tmp_path, silent)
    assert any("way 99" in note for note in built.notes)
    assert not any(edge.lstrip("-").startswith("99") for edge in built.net.edges)
    assert "Long Road" in {edge.name for edge in built.net.edges.values()}
