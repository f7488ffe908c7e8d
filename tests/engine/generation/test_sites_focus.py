"""The ego has to do with what its site is about, and where it has not, the answer says so."""

from pathlib import Path

import numpy as np
import pytest

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.network.net_parser import read_net
from plannerforge.engine.scene.routing import center_line, ego_route
from plannerforge.schemas.generation import GeneratedScenario, GenerationRequest, RequestedEgo, RequestedGoal, SiteType


def generated(folder: Path, place: str, kind: SiteType, *, seed: int = 0, ego: str = "first") -> GeneratedScenario:
    entry = next(entry for entry in built_in_maps() if entry.facts.place == place)
    wish = GenerationRequest(
        map_path=str(entry.path),
        map_id=entry.facts.map_id,
        place=place,
        country="ZAM",
        attribution=entry.facts.attribution,
        scenario_type=kind,
        density="low",
        duration_s=6.0,
        ego=RequestedEgo.of(ego),
        seed=seed,
        goal=RequestedGoal.of("steps:50"),
        folder=str(folder),
    )
    return generate_scenario(wish, silent)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_ego_of_a_roundabout_drives_on_the_ring(tmp_path: Path, seed: int) -> None:
    generated(tmp_path, "Kreiselheim", "roundabout", seed=seed)
    loaded = read_scenario(tmp_path / "scenario.xml")
    network, net = loaded.scenario.lanelet_network, read_net(tmp_path / "scenario.net.xml")
    route = ego_route(network, LaneletGraph.of(network), loaded.problem())
    assert route is not None
    way = np.concatenate([center_line(network, key) for key in route.lanelets])
    ring = np.concatenate([net.lanes[f"{edge}_0"].shape for edge in net.roundabout_edges[0]])
    assert np.linalg.norm(way[:, None] - ring[None], axis=2).min() < 1.0


def test_an_ego_that_misses_the_site_is_reported(tmp_path: Path) -> None:
    told = [
        any("does not pass the ring" in note for note in found.notes)
        for found in (generated(tmp_path, "Kreiselheim", "roundabout", ego=ego) for ego in ("first", "index:0"))
    ]
    assert told == [False, True]
