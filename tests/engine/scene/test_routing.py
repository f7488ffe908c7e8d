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
def test_a_route_turns_at_each_junction_and_forks_close_together_are_one(
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


def _way(tmp_path: Path, lanes: tuple[Lane, ...], goal: tuple[float, float]) -> tuple[str, set[str]]:
    """The ego's way in words and the computed features, from (40, 0) eastbound to a goal."""
    path = ScenarioBuilder(lanes, problems=(Problem(goal=(*goal, 8.0, 3.0)),)).write(tmp_path / "scenario.xml")
    ego = describe(DescribeRequest(path=path, detail="brief", focus=None, radius_m=300.0), silent).ego
    assert ego is not None
    return ego.way, set(read_facts(ReadFactsRequest(path=path), silent).features)


def test_a_lane_for_left_turns_alone_turns_left(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2,), right=(6, True)),
        Lane(2, arc((100, 20), 20, -math.pi / 2, 0), predecessors=(1,), successors=(3,)),
        Lane(3, line((120, 20), (120, 120)), predecessors=(2,)),
        Lane(6, line((0, -3.5), (100, -3.5)), successors=(7,), left=(1, True)),
        Lane(7, line((100, -3.5), (200, -3.5)), predecessors=(6,)),
    )
    way, features = _way(tmp_path, lanes, (120.0, 100.0))
    assert way == "turns left"
    assert "ego_turns_left" in features
    assert "ego_goes_straight" not in features


def test_a_side_street_that_ends_on_a_road_is_a_turn(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2,)),
        Lane(2, arc((100, 20), 20, -math.pi / 2, 0), predecessors=(1,), successors=(3,)),
        Lane(3, line((120, 20), (120, 120)), predecessors=(2, 4)),
        Lane(4, line((120, -100), (120, 20)), successors=(3,)),
    )
    assert _way(tmp_path, lanes, (120.0, 100.0))[0] == "turns left"


def test_a_road_that_curves_without_a_junction_is_neither_a_turn_nor_straight_on(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2,)),
        Lane(2, arc((100, 20), 20, -math.pi / 2, 0), predecessors=(1,), successors=(3,)),
        Lane(3, line((120, 20), (120, 120)), predecessors=(2,)),
    )
    way, features = _way(tmp_path, lanes, (120.0, 100.0))
    assert way == "follows its road, which bends left by 90°"
    assert not {"ego_goes_straight", "ego_turns_left"} & features


def test_a_route_that_returns_next_to_its_start_turns_back(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 6)),
        Lane(2, arc((100, 8), 8, -math.pi / 2, math.pi / 2 - 0.01), predecessors=(1,), successors=(3,)),
        Lane(3, line((100, 16), (0, 16)), predecessors=(2,)),
        Lane(6, line((100, 0), (200, 0)), predecessors=(1,)),
    )
    way, features = _way(tmp_path, lanes, (40.0, 16.0))
    assert way == "turns back"
    assert "ego_turns_back" in features


def test_a_left_turn_that_is_divided_inside_the_junction_is_one_turn(tmp_path: Path) -> None:
    """Lane 2 begins the turn at the fork, 3 completes it across the oncoming lane 6, as in SUMO's networks."""
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 5)),
        Lane(2, arc((100, 20), 20, -math.pi / 2, -math.pi / 3), predecessors=(1,), successors=(3,)),
        Lane(3, arc((100, 20), 20, -math.pi / 3, 0), predecessors=(2,), successors=(4,)),
        Lane(4, line((120, 20), (120, 120)), predecessors=(3,)),
        Lane(5, line((100, 0), (200, 0)), predecessors=(1,)),
        Lane(6, line((200, 7), (0, 7))),
    )
    path = ScenarioBuilder(lanes, problems=(Problem(goal=(120.0, 80.0, 8.0, 3.0)),)).write(tmp_path / "scenario.xml")
    loaded = read_scenario(path)
    network = loaded.scenario.lanelet_network
    route = ego_route(network, LaneletGraph.of(network), loaded.problem())
    assert route is not None
    assert route.turns == ("left",)
    assert route.length_m == pytest.approx(60.0 + 10.0 * math.pi + 60.0, abs=0.5)


def test_a_bend_between_two_forks_of_a_junction_belongs_to_its_turn(tmp_path: Path) -> None:
    after, back = arc((100, -10), 10, math.pi / 2, math.pi / 6), arc((100, -10), 10, math.pi / 6, -math.pi / 12)
    last = arc((100, -10), 10, -math.pi / 12, -math.pi / 2)
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 6)),
        Lane(2, after, predecessors=(1,), successors=(3,)),
        Lane(3, back, predecessors=(2,), successors=(4, 7)),
        Lane(4, last, predecessors=(3,), successors=(5,)),
        Lane(5, line((100, -20), (0, -20)), predecessors=(4,)),
        Lane(6, line((100, 0), (200, 0)), predecessors=(1,)),
        Lane(7, line(back[-1], (back[-1][0] - 15, back[-1][1] - 60)), predecessors=(3,)),
    )
    assert _way(tmp_path, lanes, (40.0, -20.0))[0] == "turns back"


def test_the_arms_of_a_roundabout_count_in_full_if_the_ego_starts_and_ends_next_to_it(tmp_path: Path) -> None:
    quarters = [arc((65, 0), 20, math.pi + part * math.pi / 2, math.pi * 1.5 + part * math.pi / 2) for part in range(4)]
    ring = [Lane(part + 1, side, ((part + 1) % 4 + 1,), ((part - 1) % 4 + 1,)) for part, side in enumerate(quarters)]
    ring[0] = Lane(1, quarters[0], (2,), (4, 12))
    ring[3] = Lane(4, quarters[3], (1, 13), (3,))
    ring[1] = Lane(2, quarters[1], (3,), (1, 15))
    lanes = (
        *ring,
        Lane(11, line((-60, -2), (38, -2)), successors=(12,), left=(14, False)),
        Lane(12, ((38, -2), (41, -2.5), (43.5, -4), (45, 0)), successors=(1,), predecessors=(11,)),
        Lane(13, ((45, 0), (43.5, 4), (41, 2.5), (38, 2)), successors=(14,), predecessors=(4,)),
        Lane(14, line((38, 2), (-60, 2)), predecessors=(13,), left=(11, False)),
        Lane(15, line((65, -80), (65, -20)), successors=(2,)),
    )
    problem = Problem(start=(42.0, -3.0, -0.5, 8.0), goal=(36.0, 2.0, 3.0, 3.0))
    path = ScenarioBuilder(lanes, problems=(problem,)).write(tmp_path / "scenario.xml")
    features = set(read_facts(ReadFactsRequest(path=path), silent).features)
    assert "ego_turns_back" in features
    assert not {"ego_turns_left", "ego_turns_right"} & features
