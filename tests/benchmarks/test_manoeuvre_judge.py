"""The judge of manoeuvres reads files on its own: it sees what happens, and leaves open what is near a threshold."""

import math
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, Vehicle, arc, driving, line, town_road

from benchmarks.selection.manoeuvre_judge import OTHERS, Answer, Judge
from benchmarks.selection.manoeuvres import requests_of

STEPS = 60


def aside(begin_m: float, end_m: float, start_x: float = 60.0, kind: str = "car") -> Vehicle:
    """A vehicle at 10 m/s that moves from one offset to another between 1 s and 4 s."""
    poses = []
    for step in range(STEPS):
        share = min(max((step * 0.1 - 1.0) / 3.0, 0.0), 1.0)
        slope = (end_m - begin_m) / 3.0 if 0.0 < share < 1.0 else 0.0
        poses.append((start_x + step, begin_m + (end_m - begin_m) * share, math.atan2(slope, 10.0), 10.0))
    return Vehicle(77, tuple(poses), kind)


def braking(rate_mps2: float) -> Vehicle:
    """A vehicle ahead in the ego's lane that brakes from 10 m/s on."""
    poses, x = [], 60.0
    for step in range(STEPS):
        speed = max(10.0 - rate_mps2 * step * 0.1, 0.0)
        poses.append((x, 0.0, 0.0, speed))
        x += speed * 0.1
    return Vehicle(77, tuple(poses))


def answers(builder: ScenarioBuilder, folder: Path) -> dict[str, Answer]:
    """What the judge says of a scenario."""
    return dict(Judge(builder.write(folder / "scenario.xml")).answers())


@pytest.mark.parametrize(
    ("vehicle", "name"),
    [
        (aside(3.5, 0.0), "cut_in"),
        (aside(0.0, 3.5), "cut_out"),
        (braking(6.0), "lead_brakes_hard"),
        (driving(77, (110, -6), 3.0, STEPS, heading_rad=math.pi / 2), "crossing"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_manoeuvre_and_no_other_is_seen(vehicle: Vehicle, name: str, tmp_path: Path) -> None:
    found = answers(town_road().with_vehicles(vehicle), tmp_path)
    assert {key for key in OTHERS if found[key] is Answer.YES} == {name}


@pytest.mark.parametrize(
    "vehicle", [aside(3.5, 3.5), aside(3.5, 0.0, start_x=180.0), braking(1.0)], ids=["kept lane", "far ahead", "gentle"]
)
def test_quiet_traffic_makes_no_manoeuvre(vehicle: Vehicle, tmp_path: Path) -> None:
    found = answers(town_road().with_vehicles(vehicle), tmp_path)
    assert {found[key] for key in OTHERS} == {Answer.NO}


def test_braking_near_the_threshold_is_left_open(tmp_path: Path) -> None:
    found = answers(town_road().with_vehicles(braking(3.45)), tmp_path)
    assert found["lead_brakes_hard"] is Answer.OPEN


def test_requests_are_the_same_for_a_seed_and_ask_for_all_manoeuvres() -> None:
    one, again, other = (list(requests_of(48, seed)) for seed in (1, 1, 2))
    assert one == again != other
    assert set(OTHERS) <= {request.feature for request in one}


def route_of(lanes: tuple[Lane, ...], goal: tuple[float, float], start_x: float = 40.0) -> ScenarioBuilder:
    """A scenario without traffic whose ego starts eastbound at y = 0."""
    problem = Problem(start=(start_x, 0.0, 0.0, 10.0), goal=(*goal, 8.0, 3.0))
    return ScenarioBuilder(lanes, problems=(problem,))


def test_a_bend_far_from_a_junction_is_no_turn_and_a_turn_at_a_junction_is(tmp_path: Path) -> None:
    bend = arc((200, -10), 10, math.pi / 2, 0)
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 6)),
        Lane(2, line((100, 0), (200, 0)), predecessors=(1,), successors=(3,)),
        Lane(3, bend, predecessors=(2,), successors=(4,)),
        Lane(4, line((210, -10), (210, -100)), predecessors=(3,)),
        Lane(6, arc((100, 10), 10, -math.pi / 2, 0), predecessors=(1,), successors=(7,)),
        Lane(7, line((110, 10), (110, 100)), predecessors=(6, 8)),
        Lane(8, line((110, -40), (110, 10)), successors=(7,)),
    )
    along, turning = (answers(route_of(lanes, goal), tmp_path) for goal in ((210.0, -80.0), (110.0, 80.0)))
    assert along["ego_turns_right"] is along["ego_turns_left"] is Answer.NO
    assert turning["ego_turns_left"] is Answer.YES


def test_a_vehicle_that_follows_its_lane_into_the_ego_s_merges_and_does_not_cut_in(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2,), left=(3, True)),
        Lane(2, line((100, 0), (125, 0)), predecessors=(1,), successors=(5,)),
        Lane(3, line((0, 3.5), (100, 3.5)), successors=(4,), right=(1, True)),
        Lane(4, line((100, 3.5), (125, 0)), predecessors=(3,), successors=(5,)),
        Lane(5, line((125, 0), (300, 0)), predecessors=(2, 4)),
    )
    slope = math.atan2(-3.5, 25.0)
    poses = []
    for step in range(STEPS):
        x = 80.0 + step
        poses.append((x, 3.5 - 3.5 * min(max((x - 100) / 25, 0), 1), slope if 100 < x < 125 else 0.0, 10.0))
    found = answers(route_of(lanes, (250.0, 0.0), start_x=60.0).with_vehicles(Vehicle(77, tuple(poses))), tmp_path)
    assert (found["merging"], found["cut_in"]) == (Answer.YES, Answer.NO)


def test_a_vehicle_that_turns_into_the_ego_s_lane_from_a_cross_street_does_not_surely_merge(tmp_path: Path) -> None:
    turn = arc((110, -10), 10, math.pi, math.pi / 2)
    lanes = (
        Lane(1, line((0, 0), (110, 0)), successors=(2,)),
        Lane(2, line((110, 0), (300, 0)), predecessors=(1, 4)),
        Lane(3, line((100, -80), (100, -10)), successors=(4,)),
        Lane(4, turn, predecessors=(3,), successors=(2,)),
    )
    poses: list[tuple[float, float, float, float]] = [(100.0, -30.0 + step, math.pi / 2, 10.0) for step in range(20)]
    for step in range(16):
        angle = math.pi - step * 0.1
        poses.append((110 + 10 * math.cos(angle), -10 + 10 * math.sin(angle), angle - math.pi / 2, 10.0))
    poses += [(110.0 + step, 0.0, 0.0, 10.0) for step in range(24)]
    found = answers(route_of(lanes, (250.0, 0.0), start_x=70.0).with_vehicles(Vehicle(77, tuple(poses))), tmp_path)
    assert Answer.YES not in (found["merging"], found["cut_in"])


@pytest.mark.parametrize(("faster", "slower", "answer"), [(3.5, 0.0, Answer.YES), (0.0, -3.5, Answer.NO)])
def test_the_vehicle_that_overtakes_changes_the_lane_itself(
    faster: float, slower: float, answer: Answer, tmp_path: Path
) -> None:
    """Both are in one lane first; then either the faster or the slower one leaves it."""

    def shifting(key: int, x: float, speed_mps: float, aside_m: float) -> Vehicle:
        poses = [
            (x + speed_mps * step * 0.1, aside_m * min(max((step - 5) / 20, 0.0), 1.0), 0.0, speed_mps)
            for step in range(STEPS)
        ]
        return Vehicle(key, tuple(poses))

    both = shifting(77, 60.0, 18.0, faster), shifting(78, 95.0, 8.0, slower)
    assert answers(town_road().with_vehicles(*both), tmp_path)["overtaking"] is answer
