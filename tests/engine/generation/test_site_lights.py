"""Sites that the map promises are built: lights at a junction with signals on some of its roads only."""

from pathlib import Path
from typing import Any

from plannerforge.engine.execution import silent
from plannerforge.engine.generation.site_network import prepare_site
from plannerforge.engine.maps.osm import OsmMap, OsmNode, OsmWay
from plannerforge.engine.maps.site_search.finder import SiteFinder
from plannerforge.schemas.generation import GenerationRequest

ARM_DEG = 0.0012
"""About 133 m at the equator."""
SIGNAL_DEG = 0.0001


def crossing_with_a_signal_on_one_arm() -> OsmMap:
    ends = {2: (ARM_DEG, 0.0), 3: (0.0, ARM_DEG), 4: (-ARM_DEG, 0.0), 5: (0.0, -ARM_DEG)}
    nodes = {1: OsmNode(1, 0.0, 0.0, {})} | {key: OsmNode(key, *place, {}) for key, place in ends.items()}
    nodes[6] = OsmNode(6, SIGNAL_DEG, 0.0, {"highway": "traffic_signals", "traffic_signals:direction": "backward"})
    tags = {"highway": "secondary", "name": "Long Road"}
    ways = (
        OsmWay(1, (1, 6, 2), tags),
        *(OsmWay(key, (1, key), {"highway": "secondary", "name": f"Road {key}"}) for key in (3, 4, 5)),
    )
    return OsmMap(nodes, ways, (), None)


def test_a_junction_with_a_signal_on_one_arm_gets_lights_and_the_answer_says_so(tmp_path: Path) -> None:
    osm = crossing_with_a_signal_on_one_arm()
    (site,) = SiteFinder(osm).find("signalised_intersection")
    wish: dict[str, Any] = {
        **dict.fromkeys(("map_path", "map_id", "attribution", "folder"), ""),
        **dict.fromkeys(("streets", "vehicles", "road_classes"), ()),
        **dict.fromkeys(("country", "bbox"), None),
    }
    request = GenerationRequest(
        place="Crossing", scenario_type=site.kind, density="medium", duration_s=20.0, seed=1, index=0, **wish
    )
    built = prepare_site(request, osm, site, tmp_path, silent)
    assert "traffic_light" in set(built.net.junction_types.values())
    assert any("lights were made" in note for note in built.notes)
