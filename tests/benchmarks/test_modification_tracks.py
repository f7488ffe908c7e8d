"""The modification bench judges written motion by its own rules, and draws only what a car can do."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import Lane, ScenarioBuilder, arc, line, town_road
from support.planning import goal_state, problem_for

from benchmarks.modification.arrivals import arrives_on, follows, handover_errors
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.scene.scene import Scene
from plannerforge.evals.ground_truth.reach import distances_m, is_in_reach, nearest_m, places_along, places_on


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return Scene.of(read_scenario(town_road().write(tmp_path_factory.mktemp("bench") / "base.xml")))


def along(scene: Scene, lanelet: int, count: int = 21) -> Track:
    """A car on a lanelet's centre line, from its first to its last tenth."""
    line = scene.network.find_lanelet_by_id(lanelet).center_vertices
    positions = line[0] + np.linspace(0.1, 0.9, count)[:, None] * (line[-1] - line[0])
    heading = float(np.arctan2(*(line[-1] - line[0])[::-1]))
    speed = float(np.linalg.norm(positions[1] - positions[0])) / 0.1
    return Track(7, "car", 4.5, 1.8, 0, positions, np.full(count, heading), np.full(count, speed))


def test_only_the_lanelet_that_is_driven_counts_as_reached(scene: Scene) -> None:
    lanelets = [int(one.lanelet_id) for one in scene.network.lanelets]
    first, other = lanelets[0], lanelets[1]
    track = along(scene, first)
    assert arrives_on(scene.network, track, {first})
    assert not arrives_on(scene.network, track, {other} - set(_after(scene, first)))
    assert follows(scene.network, (first,), track.positions)
    assert not follows(scene.network, (first,), track.positions + np.array([500.0, 0.0]))


def test_a_lanelet_that_a_fast_vehicle_leaps_over_within_a_step_is_reached(scene: Scene) -> None:
    first = int(scene.network.lanelets[0].lanelet_id)
    line = scene.network.find_lanelet_by_id(first).center_vertices
    ahead = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    leap = np.array([line[0] - 9.0 * ahead, line[-1] - 2.25 * ahead + 0.9 * ahead])
    track = along(scene, first, 2)
    assert arrives_on(scene.network, replace(track, positions=leap), {first})


@pytest.mark.parametrize(("over_m", "is_there"), [(-0.1, False), (0.02, False), (0.4, False), (0.7, True)])
def test_a_vehicle_with_its_bumper_over_the_line_has_not_arrived(scene: Scene, over_m: float, is_there: bool) -> None:
    last = scene.network.find_lanelet_by_id(1).center_vertices[-1]
    stops_m = np.minimum(np.arange(40.0), 30.0) - 30.0 + over_m - 4.5 / 2
    halted = replace(along(scene, 1, 40), positions=last + stops_m[:, None] * np.array([1.0, 0.0]))
    assert arrives_on(scene.network, halted, {11}) is is_there


@pytest.mark.parametrize(("leads_there_too", "is_there"), [((), True), ((2,), False)])
def test_grazing_the_target_counts_if_the_route_continues_from_it_alone(
    tmp_path: Path, leads_there_too: tuple[int, ...], is_there: bool
) -> None:
    lanes = [
        replace(lane, predecessors=(1, *leads_there_too)) if lane.lanelet_id in (11, 12) else lane
        for lane in town_road().lanes
    ]
    network = read_scenario(ScenarioBuilder(tuple(lanes)).write(tmp_path / "base.xml")).scenario.lanelet_network
    fronts_x = np.arange(150, 290, 0.5)
    fronts_y = np.clip(1.75 - (fronts_x - 199.7) * 0.2, 0.0, 3.5)
    heading = np.arctan2(np.gradient(fronts_y), np.gradient(fronts_x))
    centres = np.stack([fronts_x - 2.25 * np.cos(heading), fronts_y - 2.25 * np.sin(heading)], axis=1)
    track = Track(7, "car", 4.5, 1.8, 0, centres, heading, np.full(len(heading), 5.0))
    assert arrives_on(network, track, {1}) is is_there


def test_half_of_a_shorter_lanelet_is_enough(tmp_path: Path) -> None:
    lanes = (Lane(1, line((0, 0), (40, 0)), successors=(2,)), Lane(2, line((40, 0), (40.6, 0)), predecessors=(1,)))
    network = read_scenario(ScenarioBuilder(lanes).write(tmp_path / "short.xml")).scenario.lanelet_network
    assert arrives_on(network, over(*[(float(x), 0.0) for x in np.linspace(20, 38.1, 20)]), {2})
    assert not arrives_on(network, over(*[(float(x), 0.0) for x in np.linspace(20, 38.0, 20)]), {2})


def test_a_target_that_is_left_again_for_a_road_that_does_not_follow_is_not_reached(scene: Scene) -> None:
    first = int(scene.network.lanelets[0].lanelet_id)
    track = along(scene, first)
    away = track.positions.copy()
    away[10:, 1] += 300.0
    assert not arrives_on(scene.network, replace(track, positions=away), {first})


@pytest.mark.parametrize(("moved_m", "faster_mps", "jump_m", "step_mps"), [(0.0, 0, 0.0, 0.0), (0.2, 1.5, 0.2, 1.5)])
def test_a_jump_or_a_speed_step_at_the_hand_over_is_seen(
    scene: Scene, moved_m: float, faster_mps: float, jump_m: float, step_mps: float
) -> None:
    old = along(scene, int(scene.network.lanelets[0].lanelet_id))
    ahead = np.array([np.cos(old.headings_rad[0]), np.sin(old.headings_rad[0])]) * moved_m
    positions, speeds = old.positions.copy(), old.speeds_mps.copy()
    positions[5:] += ahead
    speeds[5:] += faster_mps
    found = handover_errors(old, replace(old, positions=positions, speeds_mps=speeds), 5, 0.1)
    assert found == pytest.approx((jump_m, step_mps), abs=1e-6)


def test_a_hand_over_at_the_last_state_gives_no_figure(scene: Scene) -> None:
    old = along(scene, int(scene.network.lanelets[0].lanelet_id))
    assert handover_errors(old, old, len(old.positions) - 1, 0.1) is None


def test_a_goal_behind_the_ego_or_out_of_reach_in_time_is_not_drawn(scene: Scene) -> None:
    problem = scene.loaded.problem()
    assert is_in_reach(problem, 0.1, 20.0, 100)
    assert not is_in_reach(problem, 0.1, -5.0, 100)
    assert not is_in_reach(problem, 0.1, 1e5, 100)


@pytest.mark.parametrize(
    ("speeds_mps", "steps", "way_m", "can"),
    [
        (None, (0, 31), 70.0, True),
        ((0.0, 8.6), (0, 31), 70.0, False),
        ((0.0, 8.6), (0, 31), 50.0, True),
        ((0.0, 8.6), (0, 45), 70.0, True),
        ((40.0, 45.0), (0, 20), 80.0, False),
        ((0.0, 2.0), (0, 6), 6.0, False),
    ],
    ids=["any speed", "too slow an end", "nearer", "more time", "too fast an end", "no time to brake"],
)
def test_a_goal_that_no_car_meets_at_its_speed_is_not_drawn(
    speeds_mps: tuple[float, float] | None, steps: tuple[int, int], way_m: float, can: bool
) -> None:
    goal = goal_state(steps, speed=speeds_mps)
    assert is_in_reach(problem_for(goal, speed_mps=9.65), 0.1, way_m, 100) is can


def test_routes_lead_to_successors_and_neighbours(scene: Scene) -> None:
    assert scene.ego is not None
    ways = distances_m(scene.network, scene.ego.position, scene.ego.heading_rad, scene.ego.speed_mps)
    here = scene.ego.lanelets[0]
    assert ways[here] <= 0.0
    assert all(ways[key] > 0.0 for key in _after(scene, here))


def test_no_route_leads_against_the_heading_or_through_a_curve_at_full_speed(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0.0, 0.0), (40.0, 0.0)), successors=(2, 3)),
        Lane(2, line((40.0, 0.0), (90.0, 0.0)), predecessors=(1,)),
        Lane(3, arc((40.0, 8.0), 8.0, -math.pi / 2, 0.0, 21), predecessors=(1,)),
    )
    network = read_scenario(ScenarioBuilder(lanes).write(tmp_path / "bend.xml")).scenario.lanelet_network
    here = np.array([36.0, 0.0])
    assert set(distances_m(network, here, 0.0, 4.0)) == {1, 2, 3}
    assert set(distances_m(network, here, 0.0, 15.0)) == {1, 2}
    assert not distances_m(network, here, math.pi, 4.0)


def test_a_place_is_distinguished_from_one_elsewhere(scene: Scene) -> None:
    assert scene.ego is not None
    places = places_along(scene.network, scene.ego.position, 15.0)
    ahead = np.array([np.cos(scene.ego.heading_rad), np.sin(scene.ego.heading_rad)])
    assert nearest_m(scene.ego.position + 15.0 * ahead, places) < 2.0
    assert nearest_m(scene.ego.position + 19.0 * ahead, places) > 2.0
    middle = places_on(scene.network, scene.ego.lanelets[0], 0.5, 4.5)
    assert nearest_m(middle[0] + 3.0, middle) > 2.0
    assert nearest_m(middle[0], []) == float("inf")


def _after(scene: Scene, key: int) -> tuple[int, ...]:
    return tuple(int(one) for one in scene.network.find_lanelet_by_id(key).successor)


def lane_that_ends_beside_one_that_goes_on() -> ScenarioBuilder:
    """Lane 2 ends at 100 m without a successor; lane 1 to its right forks there."""
    return ScenarioBuilder(
        (
            Lane(1, line((0, 0), (100, 0)), successors=(3, 4), left=(2, True)),
            Lane(2, line((0, 3.5), (100, 3.5)), right=(1, True)),
            Lane(3, line((100, 0), (200, 0)), predecessors=(1,)),
            Lane(4, line((100, 0), (200, -80)), predecessors=(1,)),
            Lane(5, line((100, 3.5), (200, 80))),
        )
    )


def over(*points: tuple[float, float]) -> Track:
    """A car whose centre passes these points."""
    positions = np.array(points, dtype=float)
    moved = np.diff(positions, axis=0, append=2 * positions[-1:] - positions[-2:-1])
    return Track(
        7, "car", 4.5, 1.8, 0, positions, np.arctan2(moved[:, 1], moved[:, 0]), np.linalg.norm(moved, axis=1) / 0.1
    )


def test_a_vehicle_that_leaves_an_ending_lane_for_its_neighbour_has_arrived_there(tmp_path: Path) -> None:
    ending = Scene.of(read_scenario(lane_that_ends_beside_one_that_goes_on().write(tmp_path / "base.xml")))
    on_it = [(float(x), 3.5) for x in range(0, 80, 2)]
    goes_on = [(float(x), 0.0) for x in range(90, 200, 2)]
    elsewhere = [(float(x), 3.5 + 0.765 * (x - 100)) for x in range(104, 200, 2)]
    assert arrives_on(ending.network, over(*on_it, *goes_on), {2})
    assert not arrives_on(ending.network, over(*on_it, *elsewhere), {2})
    assert not arrives_on(ending.network, over(*goes_on), {2})


def test_a_branch_of_the_neighbouring_lane_is_not_an_arrival_if_the_own_lane_continues(tmp_path: Path) -> None:
    lanes = lane_that_ends_beside_one_that_goes_on().lanes
    goes_on = (lanes[0], replace(lanes[1], successors=(5,)), *lanes[2:4], replace(lanes[4], predecessors=(2,)))
    both = Scene.of(read_scenario(ScenarioBuilder(goes_on).write(tmp_path / "base.xml")))
    on_it = [(float(x), 3.5) for x in range(0, 80, 2)]
    assert not arrives_on(both.network, over(*on_it, *[(float(x), -0.8 * (x - 100)) for x in range(100, 200, 2)]), {2})
    assert arrives_on(
        both.network, over(*on_it, *[(float(x), 3.5 + 0.765 * (x - 100)) for x in range(100, 200, 2)]), {2}
    )
