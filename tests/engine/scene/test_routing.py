"""The ego's way to its goal: which turns it takes, junction by junction."""

import math
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, arc, line

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.scenarios.description import describe
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.engine.scene.routing import ego_route
from plannerforge.schemas.scenarios import DescribeRequest, ReadFactsRequest


def left_then_right(apart_m: float) -> ScenarioBuilder:
    """Eastbound 1, left on 2, northbound 3, right on 4 to the goal on 5; 6 and 7 are the other branches."""
    north = 20 + apart_m
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 6)),
        Lane(2, arc((100, 20), 20, -math.pi / 2, 0), predecessors=(1,), successors=(3,)),
        Lane(3, line((120, 20), (120, north)), predecessors=(2,), successors=(4, 7)),
        Lane(4, arc((140, north), 20, math.pi, math.pi / 2), predecessors=(3,), successors=(5,)),
        Lane(5, line((140, north + 20), (240, north + 20)), predecessors=(4,)),
        Lane(6, line((100, 0), (200, 0)), predecessors=(1,)),
        Lane(7, line((120, north), (120, north + 100)), predecessors=(3,)),
    )
    return ScenarioBuilder(lanes, problems=(Problem(goal=(200.0, north + 20, 8.0, 3.0)),))


@pytest.mark.parametrize(("apart_m", "turns"), [(80.0, ("left", "right")), (15.0, ())])
def test_a_way_turns_at_each_junction_and_forks_close_together_are_one(
    tmp_path: Path, apart_m: float, turns: tuple[str, ...]
) -> None:
    loaded = read_scenario(left_then_right(apart_m).write(tmp_path / "scenario.xml"))
    network = loaded.scenario.lanelet_network
    route = ego_route(network, LaneletGraph.of(network), loaded.problem())
    assert route is not None
    assert route.lanelets == (1, 2, 3, 4, 5)
    assert route.turns == turns


def test_turning_left_and_later_right_is_not_going_straight_on(tmp_path: Path) -> None:
    path = left_then_right(80.0).write(tmp_path / "scenario.xml")
    ego = describe(DescribeRequest(path=path, detail="brief", focus=None, radius_m=300.0), silent).ego
    assert ego is not None
    assert ego.way == "turns left, then right"
    features = set(read_facts(ReadFactsRequest(path=path), silent).features)
    assert {"ego_turns_left", "ego_turns_right"} <= features
    assert "ego_goes_straight" not in features
