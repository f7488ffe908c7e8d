"""Who does not get to a target in time, and who is not sent there, is judged by lanelets, motion and physics alone."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDGermany
from support.builders import Lane, ScenarioBuilder, Vehicle, arc, driving, line, town_road

from benchmarks.modification.arrivals import Journey, refusal_is_right
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import recorded_tracks
from plannerforge.evals.ground_truth.reach import changes_to, lanelets_at_first, ways_to_m


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("arrivals")


def journey(folder: Path, targets: set[int], *vehicles: Vehicle) -> Journey:
    """The way of the first of some vehicles on the town road."""
    scenario = read_scenario(town_road().with_vehicles(*vehicles).write(folder / "base.xml")).scenario
    tracks = recorded_tracks(scenario)
    return Journey(scenario.lanelet_network, tracks[vehicles[0].vehicle_id], frozenset(targets), tracks, 0.1)


def slowing(one: Journey, final_mps: float) -> Journey:
    """The same way, driven ever slower."""
    speeds = np.linspace(float(one.track.speeds_mps[0]), final_mps, len(one.track.positions))
    places = one.track.positions[0] + np.outer(np.concatenate([[0], np.cumsum(speeds[1:] * 0.1)]), (1, 0))
    return replace(one, track=replace(one.track, positions=places, speeds_mps=speeds))


def test_an_arrival_without_enough_time_is_late_with_reason(folder: Path) -> None:
    assert journey(folder, {13}, driving(51, (20, 0), 10.0, 60)).is_late_with_reason()


def test_an_arrival_with_time_and_a_free_road_is_not(folder: Path) -> None:
    dawdling = slowing(journey(folder, {12}, driving(51, (150, 0), 10.0, 150)), 1.0)
    assert not dawdling.is_late_with_reason()


@pytest.mark.parametrize(("spare_m", "is_late"), [(-0.3, True), (0.3, True), (0.7, False)])
def test_reaching_the_line_and_no_farther_means_there_was_no_time(folder: Path, spare_m: float, is_late: bool) -> None:
    reach_m = 8.0 * (4.0 / 1.5) + 6.0 * (5.9 - 4.0 / 1.5)
    begin_m = 200.0 - 4.5 / 2 - (reach_m - spare_m)
    short = slowing(journey(folder, {12}, driving(51, (begin_m, 0), 10.0, 60)), 3.5)
    assert short.is_late_with_reason() is is_late


def test_driving_past_or_on_another_route_is_not_late_with_reason(folder: Path) -> None:
    assert not journey(folder, {12}, driving(51, (150, 0), 10.0, 100)).is_late_with_reason()
    assert not journey(folder, {12}, driving(51, (150, 3.5), 10.0, 100)).is_late_with_reason()


def test_driving_slightly_off_the_lanelet_is_on_the_route(folder: Path) -> None:
    aside = journey(folder, {11}, driving(51, (20, -2.2), 10.0, 60))
    assert aside.is_late_with_reason()
    assert not replace(aside, targets=frozenset({3})).is_late_with_reason()


def test_one_behind_a_queue_or_at_the_end_of_its_lane_is_late_with_reason(folder: Path) -> None:
    queue = slowing(journey(folder, {12}, driving(51, (166, 0), 10.0, 60), driving(52, (204, 0), 0.0, 60)), 0.2)
    free = replace(queue, others={51: queue.track})
    assert queue.is_late_with_reason()
    assert not free.is_late_with_reason()
    waiting = slowing(journey(folder, {12}, driving(51, (192, 0), 0.6, 80)), 0.0)
    assert waiting.is_late_with_reason()


def test_a_vehicle_that_stops_and_starts_again_is_late_with_reason(folder: Path) -> None:
    through = journey(folder, {12}, driving(51, (165, 0), 10.0, 80))
    speeds = np.concatenate([np.linspace(10.0, 0.0, 50), np.zeros(20), np.linspace(0.0, 1.5, 10)])
    places = through.track.positions[0] + np.outer(np.concatenate([[0], np.cumsum(speeds[1:] * 0.1)]), (1, 0))
    assert 185 < float(places[-1, 0]) < 200 - 4.5 / 2
    assert replace(through, track=replace(through.track, positions=places, speeds_mps=speeds)).is_late_with_reason()
    assert not slowing(journey(folder, {12}, driving(51, (165, 0), 7.0, 80)), 1.0).is_late_with_reason()


@pytest.mark.parametrize("is_bend", [True, False])
def test_braking_for_the_curve_ahead_is_a_reason_and_on_a_straight_road_is_not(folder: Path, is_bend: bool) -> None:
    bend = (*line((0, 0), (40, 0)), *arc((40.0, 6.0), 6.0, -math.pi / 2, 0.0)[1:])
    way = bend if is_bend else line((0, 0), (49, 0))
    onward = line(way[-1], (46, 40) if is_bend else (90, 0))
    lanes = (Lane(1, way, successors=(2,)), Lane(2, onward, predecessors=(1,)))
    builder = ScenarioBuilder(lanes).with_vehicles(driving(51, (8, 0), 13.0, 45))
    scenario = read_scenario(builder.write(folder / "bend.xml")).scenario
    tracks = recorded_tracks(scenario)
    braking = slowing(Journey(scenario.lanelet_network, tracks[51], frozenset({2}), tracks, 0.1), 2.0)
    assert braking.is_late_with_reason() is is_bend


@pytest.mark.parametrize(("past_m", "is_late"), [(0.1, True), (1.0, False)])
def test_a_vehicle_at_the_end_of_its_lane_stands_with_its_bumper_on_the_line(
    folder: Path, past_m: float, is_late: bool
) -> None:
    stop = journey(folder, {13}, driving(51, (197.75 + past_m, 0), 0.0, 80))
    assert stop.is_late_with_reason() is is_late


@pytest.mark.parametrize(("start_m", "limit_mps", "is_late"), [(150, 3.0, True), (150, 30.0, False), (170, 3.0, False)])
def test_slow_driving_is_late_with_reason_if_signs_require_it(
    folder: Path, start_m: float, limit_mps: float, is_late: bool
) -> None:
    slow = slowing(journey(folder, {12}, driving(51, (start_m, 0), 3.0, 150)), 1.5 if start_m > 150 else 3.0)
    sign = TrafficSignElement(TrafficSignIDGermany.MAX_SPEED, [str(limit_mps)])
    slow.network.add_traffic_sign(TrafficSign(900, [sign], set(), np.array([0.0, -3.0])), {1})
    assert slow.is_late_with_reason() is is_late


def test_a_vehicle_next_to_its_target_needs_a_slow_end_or_a_lane_without_a_gap(folder: Path) -> None:
    alone = journey(folder, {2}, driving(51, (20, 0), 10.0, 100))
    assert not alone.is_late_with_reason()
    assert slowing(alone, 2.0).is_late_with_reason()
    row = [driving(52 + place, (-4 + 12.0 * place, 3.5), 10.0, 100) for place in range(6)]
    assert journey(folder, {2}, driving(51, (20, 0), 10.0, 100), *row).is_late_with_reason()


def test_lane_changes_that_take_longer_than_the_scenario_are_a_reason(folder: Path) -> None:
    assert journey(folder, {2}, driving(51, (20, 0), 10.0, 35)).is_late_with_reason()


@pytest.mark.parametrize(
    ("start", "speed_mps", "targets", "is_right"),
    [
        ((20.0, 0.0), 10.0, {12}, False),
        ((20.0, 0.0), 10.0, {3}, True),
        ((20.0, 0.0), 10.0, {21}, False),
        ((20.0, 3.5), 10.0, {12}, False),
        ((190.0, 3.5), 8.0, {12}, False),
        ((190.0, 3.5), 18.0, {12}, True),
        ((185.0, 0.0), 22.0, {12}, True),
        ((193.5, 3.5), 1.0, {12}, False),
        ((194.5, 3.5), 1.0, {12}, True),
        ((191.8, 3.5), 9.0, {12}, False),
        ((192.3, 3.5), 9.0, {12}, True),
    ],
    ids=[
        "free",
        "no way",
        "beside",
        "far",
        "can stop",
        "too fast to stop",
        "too fast for the bend",
        "slow and steers over",
        "slow and too near to steer over",
        "fast and steers over",
        "fast and too near to steer over",
    ],
)
def test_a_refusal_is_right_only_if_physics_requires_it(
    folder: Path, start: tuple[float, float], speed_mps: float, targets: set[int], is_right: bool
) -> None:
    one = journey(folder, targets, driving(51, start, speed_mps, 30))
    assert refusal_is_right(one.network, one.track, one.targets) is is_right


def test_a_recording_begins_on_its_own_lanelet_and_not_on_an_overlapping_one(folder: Path) -> None:
    one = journey(folder, {12}, driving(51, (201, 0), 8.0, 60))
    assert lanelets_at_first(one.network, one.track) == {11}
    assert refusal_is_right(one.network, one.track, frozenset({12}))


def test_lane_changes_are_counted_and_routes_are_traced_back(folder: Path) -> None:
    network = journey(folder, {12}, driving(51, (20, 0), 8.0, 30)).network
    assert changes_to(network, frozenset({12})) == {1: 0, 2: 1, 12: 0}
    assert ways_to_m(network, frozenset({12})) == pytest.approx({1: 200.0, 2: 200.0, 12: 0.0})


def test_a_detour_counts_only_if_there_is_time_to_drive_it(folder: Path) -> None:
    block = (
        Lane(1, line((0, 0), (200, 0)), successors=(3,), predecessors=(4,), left=(2, True)),
        Lane(2, line((0, 3.5), (200, 3.5)), right=(1, True)),
        Lane(3, arc((200, -50), 50, math.pi / 2, -math.pi / 2), successors=(5,), predecessors=(1,)),
        Lane(5, line((200, -100), (0, -100)), successors=(4,), predecessors=(3,)),
        Lane(4, arc((0, -50), 50, 3 * math.pi / 2, math.pi / 2), successors=(1,), predecessors=(5,)),
    )
    path = ScenarioBuilder(block, (driving(51, (190, 0), 15.0, 30),)).write(folder / "block.xml")
    scenario = read_scenario(path).scenario
    track, target = recorded_tracks(scenario)[51], frozenset({2})
    assert refusal_is_right(scenario.lanelet_network, track, target, 500.0)
    assert not refusal_is_right(scenario.lanelet_network, track, target, 550.0)
    assert not refusal_is_right(scenario.lanelet_network, track, target)
