"""Edits of who is where, and of the scene itself."""

import numpy as np
import pytest
from support.builders import crossing, driving, town_road
from support.edits import Apply, schema_errors

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.schemas.errors import NotPossible

ROAD = town_road()
FREE = town_road().with_vehicles(driving(31, (70, 0), 10.0, 101))


def test_a_moved_vehicle_keeps_its_id_and_its_speeds_and_changes_no_other(apply: Apply) -> None:
    applied = apply({"op": "move", "vehicles": ["35"], "at": "2", "position": "20m"})
    old, new = applied.base_tracks()[35], applied.tracks()[35]
    assert new.positions[0] == pytest.approx([20.0, 3.5])
    assert new.speeds_mps == pytest.approx(old.speeds_mps, abs=0.1)
    assert applied.changed_elements() == {"35"}


def test_a_replaced_vehicle_has_the_size_of_its_new_class_and_drives_as_before(apply: Apply) -> None:
    applied = apply({"op": "replace", "vehicles": ["31"], "vehicle_class": "truck"}, builder=FREE)
    old, new = applied.base_tracks()[31], applied.tracks()[31]
    assert (new.kind, old.kind) == ("truck", "car")
    assert new.length_m > old.length_m
    assert new.positions == pytest.approx(old.positions)


def test_a_time_gap_decides_where_a_vehicle_enters(apply: Apply) -> None:
    added = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "gap_s": 2.0}
    applied = apply(added, builder=town_road().with_vehicles(driving(31, (150, 3.5), 10.0, 101)))
    (key,) = applied.outcome.edits[0].vehicles
    track, ego = applied.tracks()[key], read_scenario(applied.base).problem().initial_state
    room_m = track.positions[0][0] - track.length_m / 2 - (ego.position[0] + 4.508 / 2)
    assert room_m == pytest.approx(20.0, abs=0.1)


def test_a_parked_vehicle_is_off_the_lane(apply: Apply) -> None:
    applied = apply({"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "0.8", "side": "right"})
    (key,) = applied.outcome.edits[0].vehicles
    (parked,) = [one for one in read_scenario(applied.xml).scenario.static_obstacles if one.obstacle_id == key]
    assert parked.obstacle_type.value == "parkedVehicle"
    inner_m = parked.initial_state.position[1] + parked.obstacle_shape.width / 2
    assert inner_m == pytest.approx(-1.75 - 0.1, abs=0.01)
    assert schema_errors(applied.xml) <= schema_errors(applied.base)


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
def test_a_pedestrian_starts_on_either_side(apply: Apply, side: str, sign: float) -> None:
    walker = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1", "position": "0.9", "side": side}
    applied = apply(walker, builder=FREE)
    (key,) = applied.outcome.edits[0].vehicles
    walk = applied.tracks()[key].positions
    assert float(np.sign(walk[-1][1] - walk[0][1])) == sign


def test_a_vehicle_that_would_hit_a_closed_lane_reacts(apply: Apply) -> None:
    applied = apply({"op": "close_lane", "to": ["11"], "position": "0.9"}, builder=FREE)
    assert applied.outcome.handed_over == ()
    closed = apply({"op": "close_lane", "to": ["1"], "position": "0.7"}, builder=FREE)
    assert closed.outcome.handed_over == (31,)
    assert not closed.outcome.collisions


def test_a_light_gets_other_phases_and_a_vehicle_at_red_stops(apply: Apply) -> None:
    coming = town_road().with_vehicles(driving(35, (150, 0), 8.0, 101))
    applied = apply({"op": "set_light", "to": ["1", "2"], "params": ["red=60", "green=20"]}, builder=coming)
    assert applied.tracks()[35].front_at(100)[0] < 200.5
    assert applied.outcome.handed_over == (35,)


@pytest.mark.parametrize(
    ("phases", "second", "third"),
    [
        (["red=2s"], "red", "green"),
        (["red=1", "red=1"], "red", "green"),
        (["green=2"], "green", "red"),
        (["yellow=2"], "yellow", "red"),
        (["off=2"], "inactive", "inactive"),
    ],
)
def test_a_single_colour_lasts_as_long_as_stated_and_then_changes_once(
    apply: Apply, phases: list[str], second: str, third: str
) -> None:
    applied = apply({"op": "set_light", "to": ["1"], "params": phases}, builder=town_road())
    (light,) = read_scenario(applied.xml).scenario.lanelet_network.traffic_lights
    states = [light.get_state_at_time_step(step).value for step in range(1_000)]
    assert states == [second] * 20 + [third] * 980


def test_vehicles_stop_at_the_entry_of_a_junction_for_a_light_inside_it(apply: Apply) -> None:
    coming = crossing().with_vehicles(driving(35, (-55, 0), 8.0, 101))
    applied = apply({"op": "set_light", "to": ["2"], "params": ["red=60", "green=20"]}, builder=coming)
    assert applied.tracks()[35].front_at(100)[0] < -9.0
    assert "lanelet 2 is inside a junction" in applied.outcome.edits[0].what


def test_a_vehicle_that_is_to_run_a_red_light_crosses_at_red(apply: Apply) -> None:
    coming = town_road().with_vehicles(driving(35, (150, 0), 8.0, 101))
    light = {"op": "set_light", "to": ["1", "2"], "params": ["red=60", "green=20"]}
    applied = apply(light, {"op": "run_red_light", "vehicles": ["35"]}, builder=coming)
    assert applied.tracks()[35].front_at(100)[0] > 205.0
    assert [report.verdict for report in applied.outcome.edits] == ["done", "done"]


def test_a_scene_that_is_mirrored_twice_is_itself_again(apply: Apply) -> None:
    once = apply({"op": "mirror"}, builder=ROAD)
    assert once.tracks()[33].positions[0] == pytest.approx([60.0, -3.5])
    lanelet = read_scenario(once.xml).scenario.lanelet_network.find_lanelet_by_id(1)
    assert (lanelet.adj_left, lanelet.adj_right) == (None, 2)
    twice = apply({"op": "mirror"}, {"op": "mirror"}, builder=ROAD)
    assert twice.tracks()[34].positions == pytest.approx(twice.base_tracks()[34].positions)


def test_edits_after_a_mirror_see_the_mirrored_scene(apply: Apply) -> None:
    right = {"op": "change_lane", "vehicles": ["31"], "lane": "right", "lateral_s": 3.0, "time_s": 1.0}
    track = apply({"op": "mirror"}, right, builder=FREE).tracks()[31]
    assert track.positions[-1][1] == pytest.approx(-3.5, abs=0.2)


def test_a_scenario_is_cut_to_a_time(apply: Apply) -> None:
    applied = apply({"op": "crop", "time_s": 2.0, "duration_s": 6.0}, builder=FREE)
    old, new = applied.base_tracks()[31], applied.tracks()[31]
    assert new.positions == pytest.approx(old.positions[20:81])
    goal = read_scenario(applied.xml).problem().goal.state_list[0].time_step
    assert (goal.start, goal.end) == (40, 130)


def test_a_scenario_is_cut_to_a_place(apply: Apply) -> None:
    near = town_road().with_vehicles(
        driving(31, (70, 0), 10.0, 101), driving(34, (280, 7), 5.0, 101, heading_rad=np.pi)
    )
    small = {"op": "crop", "at": "ego", "rectangle_m": [250.0, 6.0]}
    applied = apply(small, builder=near)
    network = read_scenario(applied.xml).scenario.lanelet_network
    assert {int(one.lanelet_id) for one in network.lanelets} == {1, 2}
    assert set(applied.tracks()) == {31}


def test_a_place_without_the_goal_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible):
        apply({"op": "crop", "at": "ego", "rectangle_m": [50.0, 20.0]}, builder=FREE)


def test_new_vehicles_keep_their_number_across_an_edit_of_the_scene(apply: Apply) -> None:
    added = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 30, "lane": "left"}
    applied = apply(added, {"op": "mirror"}, {"op": "cut_in", "vehicles": ["new:0"], "gap_s": 1.5}, builder=FREE)
    (key,) = applied.outcome.edits[0].vehicles
    assert applied.outcome.edits[2].vehicles == (key,)


def test_a_vehicle_that_enters_too_fast_after_a_change_of_the_scene_enters_more_slowly(apply: Apply) -> None:
    wet = {"op": "set_weather", "params": ["friction=0.3"]}
    car = {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "80m"}
    behind = town_road().with_vehicles(driving(31, (60, 0), 12.0, 101))
    assert apply(wet, car, builder=behind).outcome.edits[1].done
