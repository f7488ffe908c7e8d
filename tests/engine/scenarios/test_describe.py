"""A described scenario: where vehicles are in words, what lanelets lead to, and what the focus changes."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, Vehicle, arc, driving, line, town_road

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.cosimulation import recorded_plan
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.description import OWN_RECORDING, describe
from plannerforge.engine.scene import Scene
from plannerforge.schemas.errors import NotPossible, UnknownName
from plannerforge.schemas.scenarios import DescribeRequest, Description, Detail, ego_text


def described(path: Path, detail: Detail = "vehicles", focus: str | None = None, radius_m: float = 400) -> Description:
    return describe(DescribeRequest(path=path, detail=detail, focus=focus, radius_m=radius_m), silent)


@pytest.fixture
def town(tmp_path: Path) -> Path:
    return town_road().write(tmp_path / "scenario.xml")


def test_vehicles_are_placed_in_words(town: Path) -> None:
    words = {vehicle.vehicle_id: vehicle.where for vehicle in described(town).vehicles}
    assert words == {
        31: "30 m ahead, same lane",
        32: "25 m behind, same lane",
        33: "20 m ahead, left lane",
        34: "240 m ahead, oncoming",
        35: "125 m ahead, same lane",
    }


def test_a_vehicle_across_the_junction_at_which_the_ego_turns_is_oncoming(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (60, 0)), left=(2, False), successors=(3, 4)),
        Lane(2, line((60, 3.5), (0, 3.5)), left=(1, False)),
        Lane(3, line((60, 0), (80, 0)), successors=(5,)),
        Lane(4, arc((60, 15), 15.0, -math.pi / 2, 0.0), successors=(6,)),
        Lane(5, line((80, 0), (160, 0))),
        Lane(6, line((75, 15), (75, 100))),
        Lane(7, line((160, 3.5), (80, 3.5)), successors=(8,)),
        Lane(8, line((80, 3.5), (60, 3.5)), successors=(2,)),
        Lane(9, line((160, 40), (80, 40))),
    )
    west = math.pi
    others = (
        driving(41, (110, 3.5), 5.0, 40, heading_rad=west),
        driving(42, (110, 40), 5.0, 40, heading_rad=west),
        driving(43, (10, 3.5), 2.0, 40, heading_rad=west),
    )
    turning = Problem(goal=(75, 60, 8.0, 8.0))
    path = ScenarioBuilder(lanes, others, problems=(turning,)).write(tmp_path / "junction.xml")
    where = {one.vehicle_id: one.where for one in described(path).vehicles}
    assert where[41] == "70 m ahead, oncoming"
    assert "another road" in where[42]
    assert "oncoming" not in where[43]


@pytest.mark.parametrize(("speed", "is_oncoming"), [(0.0, False), (5.0, True)])
def test_a_parked_vehicle_that_faces_the_ego_is_not_oncoming(speed: float, is_oncoming: bool, tmp_path: Path) -> None:
    parked = driving(36, (120, 3.5), speed, 151, heading_rad=math.pi)
    found = described(town_road().with_vehicles(parked).write(tmp_path / "parked.xml")).vehicles
    vehicle = next(one for one in found if one.vehicle_id == 36)
    assert ("oncoming" in vehicle.where) is is_oncoming
    assert ("standing" in vehicle.where) is not is_oncoming


def test_the_gap_is_bumper_to_bumper(town: Path) -> None:
    lead = next(vehicle for vehicle in described(town).vehicles if vehicle.vehicle_id == 31)
    assert lead.ahead_m == pytest.approx(30.0, abs=0.1)
    assert lead.gap_m == pytest.approx(30.0 - (4.5 + 4.508) / 2, abs=0.1)


def test_a_vehicle_overtaking_on_the_oncoming_lane_is_not_in_the_same_lane(tmp_path: Path) -> None:
    lanes = (Lane(1, line((0, 0), (300, 0)), left=(2, False)), Lane(2, line((300, 3.5), (0, 3.5)), left=(1, False)))
    beside = driving(36, (20, 3.6), 12.0, 20)
    path = ScenarioBuilder(lanes, (beside,)).write(tmp_path / "overtaking.xml")
    vehicle = described(path).vehicles[0]
    assert (vehicle.lanelet, vehicle.where, vehicle.gap_m) == (1, "20 m behind, in the oncoming lane", None)


def test_a_wide_vehicle_that_cuts_a_corner_is_still_in_its_lane(tmp_path: Path) -> None:
    bus = driving(36, (65, -2.5), 8.0, 20, kind="bus", size_m=(12.0, 2.5))
    vehicle = described(town_road().with_vehicles(bus).write(tmp_path / "bus.xml")).vehicles[0]
    assert vehicle.where == "25 m ahead, same lane"


def test_on_the_ego_s_lanelet_is_the_same_lane_at_the_edge_of_the_map_too(tmp_path: Path) -> None:
    near_edge = replace(town_road(), problems=(Problem(start=(4.0, 0.0, 0.0, 1.0)),))
    path = near_edge.with_vehicles(driving(36, (0.3, 0), 1.0, 20)).write(tmp_path / "edge.xml")
    assert described(path).vehicles[0].where == "4 m behind, same lane"


def test_a_place_that_the_lane_reaches_by_a_detour_is_described_by_both_distances(tmp_path: Path) -> None:
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2,)),
        Lane(2, arc((100, 10), 10, -math.pi / 2, math.pi), predecessors=(1,), successors=(3,)),
        Lane(3, line((90, 10), (90, -60)), predecessors=(2,)),
    )
    builder = ScenarioBuilder(lanes, problems=(Problem(start=(80.0, 0.0, 0.0, 5.0), goal=None),))
    below = driving(36, (90, -10), 5.0, 20, heading_rad=-math.pi / 2)
    vehicle = described(builder.with_vehicles(below).write(tmp_path / "loop.xml")).vehicles[0]
    assert vehicle.where.startswith("14 m ahead on the right, heading to the right, 87 m ahead along the lane")
    assert vehicle.gap_m is None


@pytest.mark.parametrize(("speed_mps", "where"), [(10.0, OWN_RECORDING), (14.0, "alongside, same lane")])
def test_the_ego_s_own_recording_is_named(tmp_path: Path, speed_mps: float, where: str) -> None:
    path = town_road().with_vehicles(driving(36, (40.2, 0), speed_mps, 20)).write(tmp_path / "own.xml")
    vehicle = described(path).vehicles[0]
    assert vehicle.where == where
    assert (vehicle.gap_m is None) == (where == OWN_RECORDING)


def test_a_vehicle_that_enters_later_states_its_time(tmp_path: Path) -> None:
    later = town_road().with_vehicles(driving(40, (100, 0), 10.0, 50, first_step=20))
    vehicle = described(later.write(tmp_path / "later.xml")).vehicles[0]
    assert vehicle.from_s == pytest.approx(2.0)


def test_lanelets_state_their_successors_and_neighbours(town: Path) -> None:
    lanelets = {lanelet.lanelet_id: lanelet for lanelet in described(town, "lanelets").lanelets}
    assert set(lanelets[1].successors) == {"straight 11", "right 12"}
    assert lanelets[1].left == 2
    assert (lanelets[1].edge, lanelets[2].edge, lanelets[13].edge) == ("e1", "e1", "e13")
    assert lanelets[2].opposite == 3
    assert "ego starts here" in lanelets[1].role
    assert lanelets[1].vehicles == (31, 32, 35)


def test_the_focus_moves_the_centre(town: Path) -> None:
    about = described(town, focus="34")
    assert about.asked is not None
    assert about.asked.vehicle is not None
    assert about.asked.vehicle.vehicle_id == 34
    assert 34 not in [vehicle.vehicle_id for vehicle in about.vehicles]
    assert about.vehicles[0].distance_m < described(town).vehicles[-1].distance_m
    assert described(town, focus="class:truck").focus == "vehicle 33"
    assert described(town, "lanelets", focus="13", radius_m=5).lanelets[0].lanelet_id in (1, 13)


def test_a_focus_states_its_recorded_route_and_its_reachable_lanelets(town: Path) -> None:
    asked = described(town, focus="lead").asked
    assert asked is not None
    assert (asked.name, asked.what) == ("vehicle 31", "lead")
    graph = Scene.of(read_scenario(town)).driven_graph
    reached = {way.lanelet_id: way for way in asked.reach}
    assert reached
    assert set(reached) <= set(graph.reachable(asked.route[:1]))
    assert reached[13].turns == ("right",)
    assert reached[13].distance_m == pytest.approx(130 + 10 * math.pi, abs=0.5)
    distances = [way.distance_m for way in asked.reach]
    assert distances == sorted(distances)


def test_a_word_that_matches_several_vehicles_shows_the_first_and_says_so(town: Path) -> None:
    asked = described(town, focus="nearest:2").asked
    assert asked is not None
    assert asked.what == "nearest:2, the first of 2"


def test_the_radius_bounds_the_list(town: Path) -> None:
    found = described(town, radius_m=22)
    assert [vehicle.vehicle_id for vehicle in found.vehicles] == [33]
    assert found.vehicles_total == 5


def test_an_unknown_focus_is_refused(town: Path) -> None:
    with pytest.raises(UnknownName, match="neither"):
        described(town, focus="9999")


def test_without_an_ego_vehicles_are_still_listed(tmp_path: Path) -> None:
    path = replace(town_road(), problems=()).write(tmp_path / "nobody.xml")
    found = described(path)
    assert found.ego is None
    assert len(found.vehicles) == 5


def test_an_ego_off_the_road_is_on_no_lanelet(tmp_path: Path) -> None:
    path = replace(town_road(), problems=(Problem(start=(40.0, -60.0, 0.0, 0.0)),)).write(tmp_path / "beside.xml")
    ego = described(path).ego
    assert ego is not None
    assert ego_text(ego).startswith("Ego: 0.0 m/s on no lanelet, ")


def test_the_checks_name_problems(tmp_path: Path) -> None:
    path = replace(town_road(), problems=(Problem(start=(70.0, 0.0, 0.0, 10.0)),)).write(tmp_path / "hit.xml")
    checks = described(path, "checks").checks
    assert any(check.startswith("problem: the ego overlaps obstacle 31") for check in checks)
    assert "ok: lanelets lead from the ego's start to its goal" in checks


def test_a_second_description_is_the_same(town: Path) -> None:
    assert described(town) == described(town)


def test_a_vehicle_off_the_lanes_is_marked_and_refused_with_the_nearest(tmp_path: Path) -> None:
    lanes = (Lane(1, line((0, 0), (100, 0))), Lane(2, line((0, 40), (100, 40))))
    jumps = Vehicle(36, tuple((5.0 + 4 * step, 0.0 if step < 12 else 40.0, 0.0, 10.0) for step in range(20)))
    near, far = driving(37, (20, 0), 8.0, 20), driving(38, (60, 40), 8.0, 20)
    path = ScenarioBuilder(lanes, (jumps, far, near)).write(tmp_path / "jump.xml")
    marked = {vehicle.vehicle_id: "edits cannot drive it" in vehicle.where for vehicle in described(path).vehicles}
    assert marked == {36: True, 37: False, 38: False}
    with pytest.raises(NotPossible, match="no lane joins 1 and 2") as caught:
        recorded_plan(Scene.of(read_scenario(path)), 36, "edited", 0)
    assert caught.value.valid == ("37", "38")
