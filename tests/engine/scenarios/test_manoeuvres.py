"""What recorded traffic does on the ego's way: each manoeuvre is found where it happens, and not where it does not."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, Vehicle, arc, driving, line, town_road

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.schemas.scenarios import ReadFactsRequest, ScenarioFacts
from plannerforge.schemas.vocabulary import MANOEUVRES

STEPS = 60
DONE = set(MANOEUVRES)


def facts_of(builder: ScenarioBuilder, folder: Path) -> ScenarioFacts:
    """The facts of a scenario as its file gives them."""
    return read_facts(ReadFactsRequest(path=builder.write(folder / "scenario.xml")), silent)


def moved(start_x: float, speed: Callable[[float], float], y: Callable[[float], float], kind: str = "car") -> Vehicle:
    """A vehicle on the town road with a speed and an offset from lane 1 over time; it heads along the road."""
    poses, x = [], start_x
    for step in range(STEPS):
        now_mps, time_s = speed(step * 0.1), step * 0.1
        slope = (y(time_s + 0.1) - y(time_s)) / 0.1
        poses.append((x, y(time_s), math.atan2(slope, max(now_mps, 0.1)), now_mps))
        x += now_mps * 0.1
    return Vehicle(77, tuple(poses), kind)


def shift(begin_m: float, end_m: float, from_s: float = 1.0, for_s: float = 3.0) -> Callable[[float], float]:
    """An offset that moves evenly from one value to another."""
    return lambda t: begin_m + (end_m - begin_m) * min(max((t - from_s) / for_s, 0.0), 1.0)


def constant(value: float) -> Callable[[float], float]:
    """The same at all times."""
    return lambda _: value


HELD = {
    "cut_in:truck": (moved(60.0, constant(10.0), shift(3.5, 0.0), "truck"),),
    "cut_out:car": (moved(60.0, constant(10.0), shift(0.0, 3.5)),),
    "lead_brakes_hard:bus": (moved(60.0, lambda t: max(10.0 - 5.0 * t, 0.0), constant(0.0), "bus"),),
    "overtaking:car": (
        moved(60.0, constant(18.0), lambda t: shift(0.0, 3.5)(t) - shift(0.0, 3.5, 4.5, 1.0)(t)),
        driving(78, (95, 0), 8.0, STEPS),
    ),
    "crossing:pedestrian": (replace(driving(79, (110, -6), 1.5, STEPS, heading_rad=math.pi / 2), kind="pedestrian"),),
}
QUIET = {
    "cut_in: far ahead": (moved(160.0, constant(10.0), shift(3.5, 0.0)),),
    "cut_in: behind the ego": (moved(12.0, constant(10.0), shift(3.5, 0.0)),),
    "braking in the next lane": (moved(60.0, lambda t: max(10.0 - 5.0 * t, 0.0), constant(3.5)),),
    "braking softly": (moved(60.0, lambda t: 10.0 - 1.0 * t, constant(0.0)),),
    "passing in the next lane": (moved(20.0, constant(18.0), constant(3.5)), driving(78, (60, 0), 8.0, STEPS)),
    "oncoming": (driving(78, (280, 7), 11.0, STEPS, heading_rad=math.pi),),
    "swaying in its lane": (moved(60.0, constant(10.0), lambda t: 0.4 * math.sin(t)),),
}


@pytest.mark.parametrize("name", HELD)
def test_a_manoeuvre_is_found_with_the_type_that_makes_it(name: str, tmp_path: Path) -> None:
    facts = facts_of(town_road().with_vehicles(*HELD[name]), tmp_path)
    assert facts.ego is not None
    assert name in (facts.ego.manoeuvres or ())
    assert name.partition(":")[0] in facts.features


@pytest.mark.parametrize("name", QUIET)
def test_traffic_without_manoeuvres_has_none(name: str, tmp_path: Path) -> None:
    facts = facts_of(town_road().with_vehicles(*QUIET[name]), tmp_path)
    assert facts.ego is not None
    assert facts.ego.manoeuvres == ()


def test_a_vehicle_that_passes_one_that_leaves_the_lane_for_it_does_not_overtake(tmp_path: Path) -> None:
    faster = moved(60.0, constant(18.0), shift(0.0, 3.5, 0.2, 1.2))
    slower = replace(moved(95.0, constant(8.0), shift(3.5, 0.0, 1.5, 1.5)), vehicle_id=78)
    facts = facts_of(town_road().with_vehicles(faster, slower), tmp_path)
    assert "overtaking" not in facts.features


def crossroads(*vehicles: Vehicle, goal: tuple[float, float] = (108.0, 80.0)) -> ScenarioBuilder:
    """Eastbound 1 forks into 2 (left, then 3 north) and 4 (straight on); westbound 5, 6 and 7 come the other way."""
    lanes = (
        Lane(1, line((0, 0), (90, 0)), successors=(2, 4)),
        Lane(2, arc((90, 18), 18, -math.pi / 2, 0), predecessors=(1,), successors=(3,)),
        Lane(3, line((108, 18), (108, 120)), predecessors=(2, 8)),
        Lane(4, line((90, 0), (200, 0)), predecessors=(1,)),
        Lane(5, line((200, 5), (125, 5)), successors=(6, 8)),
        Lane(6, line((125, 5), (90, 5)), predecessors=(5,), successors=(7,)),
        Lane(7, line((90, 5), (0, 5)), predecessors=(6,)),
        Lane(8, arc((125, 22), 17, 1.5 * math.pi, math.pi), predecessors=(5,), successors=(3,)),
        Lane(9, arc((120, -10), 15, math.pi / 2, math.pi), successors=(10,)),
        Lane(10, line((105, -10), (105, -90)), predecessors=(9,)),
    )
    start = (40.0, 0.0, 0.0, 8.0)
    return ScenarioBuilder(lanes, vehicles, problems=(Problem(start=start, goal=(*goal, 8.0, 3.0)),))


@pytest.mark.parametrize(("ends_at_m", "name"), [(150.0, "merging"), (80.0, "merging"), (300.0, "cut_in")])
def test_a_change_out_of_a_lane_that_ends_is_merging(ends_at_m: float, name: str, tmp_path: Path) -> None:
    """Lane 2 next to the ego's lane 1 ends first, as an acceleration lane does, or where the file ends.

    At 80 m, the vehicle is past the end of its lane before it is in the ego's.
    """
    goes_on = ends_at_m < 300.0
    lanes = [
        Lane(1, line((0, 0), (ends_at_m, 0)), successors=(11,) if goes_on else (), right=(2, True)),
        Lane(2, line((60, -3.5), (ends_at_m, -3.5)), predecessors=(3,), left=(1, True)),
        Lane(3, line((0, -30), (60, -3.5)), successors=(2,)),
    ]
    if goes_on:
        lanes.append(Lane(11, line((ends_at_m, 0), (300, 0)), predecessors=(1,)))
    problems = (Problem(start=(40.0, 0.0, 0.0, 10.0), goal=(250.0, 0.0, 8.0, 3.0)),)
    changing = moved(65.0, constant(10.0), shift(-3.5, 0.0))
    facts = facts_of(ScenarioBuilder(tuple(lanes), (changing,), problems=problems), tmp_path)
    assert DONE & set(facts.features) == {name}


def test_a_left_turn_across_oncoming_lanes_without_a_light_is_unprotected(tmp_path: Path) -> None:
    features = facts_of(crossroads(), tmp_path).features
    assert {"ego_turns_left", "unprotected_left"} <= set(features)


def test_going_straight_at_the_same_junction_is_not_an_unprotected_left(tmp_path: Path) -> None:
    features = facts_of(crossroads(goal=(180.0, 0.0)), tmp_path).features
    assert "ego_goes_straight" in features
    assert "unprotected_left" not in features


def test_an_oncoming_vehicle_that_turns_across_is_not_a_crossing_one(tmp_path: Path) -> None:
    points = [*line((150, 5), (120, 5), 20), *arc((120, -10), 15, math.pi / 2, math.pi, 20)]
    steps = pairwise(points)
    poses = tuple((a[0], a[1], math.atan2(b[1] - a[1], b[0] - a[0]), 12.0) for a, b in steps if a != b)
    turning = facts_of(crossroads(Vehicle(77, poses), goal=(180.0, 0.0)), tmp_path)
    crossing = facts_of(
        crossroads(driving(77, (130, -20), 8.0, STEPS, heading_rad=math.pi / 2), goal=(180.0, 0.0)), tmp_path
    )
    assert {"oncoming_turns"} == DONE & set(turning.features)
    assert {"crossing"} == DONE & set(crossing.features)
