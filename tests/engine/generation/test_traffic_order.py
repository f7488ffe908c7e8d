"""The first car is one to which the site matters."""

from pathlib import Path

import numpy as np
from shapely import LineString, Point

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.generation.sites import road_classes
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.maps.index import built_in_maps
from plannerforge.engine.network.net_parser import SumoNet, read_net
from plannerforge.schemas.generation import GenerationRequest, RequestedGoal


def classes_at(net: SumoNet, position: Points) -> frozenset[str]:
    """OSM classes of the road whose lane lies nearest to a position."""
    lanes = [lane for lane in net.lanes.values() if not lane.internal]
    nearest = min(lanes, key=lambda lane: LineString(lane.shape).distance(Point(position)))
    return road_classes(net.edges[nearest.edge_id])


def test_the_ego_of_a_ramp_leaves_or_joins_the_motorway(tmp_path: Path) -> None:
    entry = next(entry for entry in built_in_maps() if entry.facts.place == "Neuland")
    wish = GenerationRequest(
        map_path=str(entry.path),
        map_id=entry.facts.map_id,
        place="Neuland",
        country="ZAM",
        attribution=entry.facts.attribution,
        scenario_type="ramp",
        density="medium",
        duration_s=8.0,
        goal=RequestedGoal.of("steps:75"),
        seed=3,
        folder=str(tmp_path),
    )
    generate_scenario(wish, silent)
    problem = read_scenario(tmp_path / "scenario.xml").problem()
    net = read_net(tmp_path / "scenario.net.xml")
    start = classes_at(net, np.asarray(problem.initial_state.position))
    end = classes_at(net, np.asarray(problem.goal.state_list[0].position.center))
    assert sorted(start | end) == ["motorway", "motorway_link"]
