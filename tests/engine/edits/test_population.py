"""Edit P: adding and removing."""

import math
import re
from dataclasses import replace

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, arc, driving, line, town_road
from support.edits import Apply

from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName

SHORT = town_road().cut(31)
CAR = {"op": "add_vehicle", "vehicle_class": "car"}


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ({"at": "3", "position": "middle"}, (150.0, 7.0)),
        ({"at": "3", "position": "beginning"}, (297.75, 7.0)),
        ({"at": "3", "position": "final"}, (2.25, 7.0)),
        ({"at": "3", "position": "0.1"}, (270.0, 7.0)),
        ({"at": "3", "position": "35m"}, (265.0, 7.0)),
        ({"at": "e13", "position": "quarter"}, (220.0, -40.0)),
        ({"at": "ego", "offset_m": 12}, (52.0, 0.0)),
        ({"at": "ego", "offset_m": -12}, (28.0, 0.0)),
        ({"at": "ego", "lane": "left"}, (40.0, 3.5)),
        ({"at": "35", "offset_m": 15}, (180.0, 0.0)),
        ({"at": "lead", "offset_m": 20}, (90.0, 0.0)),
        ({"at": "35", "offset_m": 60}, (225.0, 0.0)),
    ],
)
def test_a_vehicle_enters_at_the_requested_position(
    apply: Apply, place: dict[str, object], expected: tuple[float, float]
) -> None:
    applied = apply(CAR | place, builder=SHORT)
    track = applied.tracks()[101]
    assert track.positions[0] == pytest.approx(expected, abs=0.01)
    assert track.first_step == 0


@pytest.mark.parametrize("name", sorted(vehicle_classes()))
def test_every_class_gets_its_own_size_and_type(apply: Apply, name: str) -> None:
    applied = apply(
        {"op": "add_vehicle", "vehicle_class": name, "at": "3", "position": "middle", "speed": "5m/s"}, builder=SHORT
    )
    track, expected = applied.tracks()[101], vehicle_classes()[name]
    assert (track.kind, track.length_m, track.width_m) == (
        expected.commonroad_type,
        expected.length_m,
        expected.width_m,
    )
    assert track.speeds_mps[0] == pytest.approx(5.0)
    assert track.positions[-1][0] < 150.0


def test_several_vehicles_enter_downstream_of_the_first(apply: Apply) -> None:
    applied = apply(CAR | {"at": "13", "position": "beginning", "count": 3, "spacing_m": 12})
    tracks = applied.tracks()
    assert applied.outcome.edits[0].vehicles == (101, 102, 103)
    assert [tracks[key].positions[0][1] for key in (101, 102, 103)] == pytest.approx([-22.25, -34.25, -46.25])


def test_a_destination_is_driven_to(apply: Apply) -> None:
    applied = apply(CAR | {"at": "1", "position": "185m", "to": ["13"], "speed": "20km/h"})
    (route,) = applied.outcome.edits[0].routes
    assert route.arrives
    assert route.lanelets == (1, 12, 13)


def test_a_later_departure_enters_when_there_is_room(apply: Apply) -> None:
    applied = apply(CAR | {"at": "1", "position": "80m", "time_s": 1.0})
    track = applied.tracks()[101]
    assert track.first_step == 15
    assert not applied.outcome.collisions
    assert "from 1.5 s (requested: 1 s" in applied.outcome.edits[0].what


def test_each_of_several_departures_is_reported_if_they_differ(apply: Apply) -> None:
    alike = apply(CAR | {"at": "13", "position": "40m", "count": 2}, builder=SHORT, dry_run=True)
    assert alike.outcome.edits[0].what.count("from 0 s") == 1
    row = CAR | {"at": "1", "position": "80m", "count": 2, "spacing_m": 12, "time_s": 1.0}
    first, second = apply(row, dry_run=True).outcome.edits[0].what.split("; ")
    assert "from 1.5 s (requested: 1 s" in first
    assert second.startswith("102: 10 m/s (like vehicle 31")


@pytest.mark.parametrize(("offset_m", "largest_m"), [(-50, "-40.0"), (300, "+260.0"), (1e308, "+260.0")])
def test_beyond_the_road_the_largest_offset_is_named_and_works(apply: Apply, offset_m: float, largest_m: str) -> None:
    with pytest.raises(NotPossible, match="the road does not extend") as caught:
        apply(CAR | {"at": "ego", "offset_m": offset_m}, builder=SHORT)
    assert caught.value.valid[0].startswith(f"up to {largest_m} m")
    assert len(caught.value.text) < 300
    alone = SHORT.with_vehicles(driving(31, (10, 7), 9, 31))
    assert apply(CAR | {"at": "ego", "offset_m": float(largest_m)}, builder=alone).outcome.edits[0].done


def test_an_occupied_place_is_refused_with_the_nearest_free_one(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="occupied by vehicle 31") as caught:
        apply(CAR | {"at": "1", "position": "71m"})
    free = caught.value.valid[0]
    position = free.partition("position='")[2].rstrip("'")
    assert apply(CAR | {"at": "1", "position": position}).outcome.edits[0].done


def test_the_ego_s_own_place_is_taken(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="occupied by the ego"):
        apply(CAR | {"at": "ego"})


def test_a_lane_that_is_not_there_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="no lane in its direction") as caught:
        apply(CAR | {"at": "ego", "lane": "right"})
    assert set(caught.value.valid) == {"same", "left"}


def test_an_unknown_class_is_refused_with_the_valid_ones(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="tank") as caught:
        apply({"op": "add_vehicle", "vehicle_class": "tank", "at": "3"})
    assert set(caught.value.valid) <= {*vehicle_classes(), "pedestrian"}


def test_a_place_is_needed(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="needs a place"):
        apply(CAR)


@pytest.mark.parametrize(("speed", "reason"), [("90m/s", "cannot drive"), ("-3m/s", "relative")])
def test_an_impossible_speed_is_refused(apply: Apply, speed: str, reason: str) -> None:
    with pytest.raises(InvalidRequest, match=reason):
        apply(CAR | {"at": "3", "speed": speed})


def test_only_removed_vehicles_disappear(apply: Apply) -> None:
    applied = apply({"op": "remove_vehicle", "vehicles": ["all", "!33", "!class:motorcycle"]})
    assert set(applied.tracks()) == {33, 34}
    assert applied.outcome.removed == (31, 32, 35)
    assert applied.outcome.untouched == 2


def test_driven_vehicles_do_not_see_removed_ones(apply: Apply) -> None:
    far = replace(town_road(), problems=(Problem(start=(280.0, 7.0, math.pi, 10.0), goal=(50.0, 7.0, 8.0, 3.0)),))
    builder = far.with_vehicles(driving(32, (60, 0), 1.0, 151), driving(33, (30, 0), 5.0, 151))
    behind = {
        "op": "set_behaviour",
        "vehicles": ["33"],
        "params": ["lcSpeedGain=0", "lcStrategic=0", "lcCooperative=0"],
    }
    blocked = apply(behind, builder=builder).tracks()[33].positions[-1][0]
    free = apply({"op": "remove_vehicle", "vehicles": ["32"]}, behind, builder=builder).tracks()[33].positions[-1][0]
    assert free > blocked + 20


def test_a_removed_vehicle_cannot_be_edited_afterwards(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="removed by an earlier edit"):
        apply(
            {"op": "remove_vehicle", "vehicles": ["31"]}, {"op": "set_behaviour", "vehicles": ["31"], "preset": "eco"}
        )


def test_an_added_vehicle_can_be_edited_and_removed(apply: Apply) -> None:
    add, remove = CAR | {"at": "3"}, {"op": "remove_vehicle", "vehicles": ["new:0"]}
    assert 101 in apply(add, {"op": "set_behaviour", "vehicles": ["new:0"], "preset": "eco"}).tracks()
    assert 101 not in apply(add, remove).tracks()


def test_a_vehicle_can_be_added_to_a_scenario_without_vehicles(apply: Apply) -> None:
    applied = apply(
        CAR | {"at": "13", "position": "beginning"}, builder=town_road().with_vehicles(driving(31, (10, 7), 9, 51))
    )
    assert len(applied.tracks()) == 2


def test_an_ego_that_starts_later_is_not_an_obstacle_before(apply: Apply) -> None:
    late = replace(town_road(), problems=(Problem(start_step=50),))
    assert apply(CAR | {"at": "ego", "time_s": 0.0}, builder=late).outcome.edits[0].done


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ({"at": "ego", "lane": "oncoming", "offset_m": 60}, (100.0, 7.0)),
        ({"at": "vehicle:33", "lane": "oncoming"}, (60.0, 7.0)),
        ({"at": "33", "lane": "right", "offset_m": -25}, (35.0, 0.0)),
    ],
)
def test_places_relative_to_another_lane(apply: Apply, place: dict[str, object], expected: tuple[float, float]) -> None:
    free = SHORT.with_vehicles(SHORT.vehicles[2])
    ego_elsewhere = replace(free, problems=(Problem(start=(40.0, 3.5, 0.0, 10.0), goal=(150.0, 3.5, 8.0, 3.0)),))
    assert apply(CAR | place, builder=ego_elsewhere).tracks()[101].positions[0] == pytest.approx(expected, abs=0.01)


def test_no_oncoming_lane_is_refused(apply: Apply) -> None:
    one_way = Problem(start=(220.0, -60.0, -math.pi / 2, 10.0), goal=(220.0, -90.0, 8.0, 3.0))
    with pytest.raises(NotPossible, match="the ego has no oncoming lane") as caught:
        apply(CAR | {"at": "ego", "lane": "oncoming"}, builder=replace(SHORT, problems=(one_way,)))
    assert caught.value.valid


def test_a_place_next_to_a_newly_added_vehicle(apply: Apply) -> None:
    behind = CAR | {"at": "vehicle:new:0", "offset_m": -20}
    tracks = apply(CAR | {"at": "13", "position": "60m"}, behind, builder=SHORT).tracks()
    assert tracks[102].positions[0] == pytest.approx((220.0, -60.0), abs=0.01)


def test_it_enters_with_the_traffic_around_it_above_the_usual_speed_too(apply: Apply) -> None:
    fast = SHORT.with_vehicles(driving(31, (100, 0), 25.0, 31))
    applied = apply(CAR | {"at": "1", "position": "112m"}, builder=fast)
    assert applied.tracks()[101].speeds_mps[0] == pytest.approx(25.0)
    assert applied.outcome.collisions == ()


def test_a_place_too_close_for_the_one_behind_is_refused_unless_a_speed_is_named(apply: Apply) -> None:
    between = SHORT.with_vehicles(driving(31, (100, 0), 25.0, 31), driving(32, (121, 0), 0.0, 31))
    place = CAR | {"at": "1", "position": "114m"}
    with pytest.raises(NotPossible, match=r"hit by vehicle 31, which follows 9.5 m behind at 25.0 m/s"):
        apply(place, builder=between)
    assert apply(place | {"speed": "2m/s"}, builder=between).outcome.collisions


def test_it_enters_no_faster_than_the_curves_ahead_allow_however_fast_the_traffic_is(apply: Apply) -> None:
    corner = (
        Lane(1, line((0.0, 0.0), (60.0, 0.0)), successors=(2,)),
        Lane(2, arc((60.0, 12.0), 12.0, -math.pi / 2, 0.0, 21), successors=(3,), predecessors=(1,)),
        Lane(3, line((72.0, 12.0), (72.0, 200.0)), predecessors=(2,)),
    )
    fast = ScenarioBuilder(corner, (driving(31, (0.0, 0.0), 20.0, 20),), problems=())
    speeds_mps = []
    for place in ("35m", "55m"):
        applied = apply(CAR | {"at": "1", "position": place}, builder=fast)
        (added,) = applied.outcome.edits[0].vehicles
        speeds_mps.append(float(applied.tracks()[added].speeds_mps[0]))
        assert applied.outcome.touched[0].feasible
    assert speeds_mps[1] == pytest.approx(math.sqrt(4.0 * 12.0 + 2 * 4.0 * 5.0), abs=0.5)
    assert speeds_mps[0] > speeds_mps[1] + 3.0


STANDING = CAR | {"at": "3", "position": "200m", "speed": "0m/s"}
HELD = {"op": "set_speed", "vehicles": ["new:0"], "speed": "0m/s"}


def test_a_later_departure_at_an_edited_vehicle_s_position_is_refused(apply: Apply) -> None:
    alone = SHORT.with_vehicles(driving(31, (10, 0), 5.0, 61))
    onto = CAR | {"at": "3", "position": "201m", "time_s": 2}
    with pytest.raises(NotPossible, match=r"lanelet 3 at 201.0 m .* by vehicle 101 at 2.0 s") as caught:
        apply(STANDING, HELD, onto, builder=alone)
    position = caught.value.valid[0].partition("position='")[2].rstrip("'")
    applied = apply(STANDING, HELD, onto | {"position": position}, builder=alone)
    assert applied.outcome.collisions == ()


def test_a_later_departure_at_a_recorded_vehicle_s_position_is_refused(apply: Apply) -> None:
    oncoming = Problem(start=(250.0, 7.0, math.pi, 10.0), goal=(50.0, 7.0, 8.0, 3.0))
    alone = replace(SHORT, problems=(oncoming,)).with_vehicles(driving(31, (100, 0), 8.0, 101))
    hold = {"op": "set_speed", "vehicles": ["31"], "speed": "2m/s"}
    onto = CAR | {"at": "1", "position": "113m", "time_s": 4}
    assert apply(onto, builder=alone).outcome.edits[0].done
    with pytest.raises(NotPossible, match=r"by vehicle 31 at 4.0 s after the edits") as caught:
        apply(hold, onto, builder=alone)
    later = float(caught.value.valid[-1].removeprefix("time_s="))
    assert apply(hold, onto | {"time_s": later, "speed": "2m/s"}, builder=alone).outcome.collisions == ()


def test_a_place_that_an_edited_vehicle_has_left_by_then_is_free(apply: Apply) -> None:
    alone = SHORT.with_vehicles(driving(31, (100, 0), 0.0, 61))
    onto = CAR | {"at": "1", "position": "100m", "time_s": 4}
    with pytest.raises(NotPossible, match="occupied by vehicle 31"):
        apply(onto, builder=alone)
    applied = apply({"op": "set_speed", "vehicles": ["31"], "speed": "8m/s"}, onto, builder=alone)
    assert applied.tracks()[101].first_step == 40
    assert applied.outcome.collisions == ()


def test_a_later_pedestrian_at_an_edited_vehicle_s_position_is_refused(apply: Apply) -> None:
    alone = SHORT.with_vehicles(driving(31, (10, 0), 5.0, 61))
    walker = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "3", "position": "200m", "speed": "0m/s"}
    with pytest.raises(NotPossible, match="so pedestrian 102 cannot enter then"):
        apply(STANDING, HELD, walker | {"time_s": 2}, builder=alone)


def test_entering_at_the_ego_s_possible_position_is_reported(apply: Apply) -> None:
    alone = SHORT.with_vehicles(driving(31, (10, 7), 5.0, 61))
    ahead = CAR | {"at": "ego", "offset_m": 50, "time_s": 4, "speed": "8m/s"}
    told = apply(ahead, builder=alone).outcome
    assert any("101 enters at the position of an ego" in note for note in told.warnings)
    assert told.ego_after is not None
    assert told.ego_after.minimum_distance_m == 0.0
    assert not any(
        "at the position of an ego" in note for note in apply(ahead | {"time_s": 1}, builder=alone).outcome.warnings
    )


def test_a_vehicle_without_departure_enters_when_the_ego_starts(apply: Apply) -> None:
    later = replace(SHORT, problems=(Problem(start_step=12, steps=(60, 150)),))
    applied = apply(CAR | {"at": "ego", "offset_m": 25}, builder=later)
    assert applied.tracks()[101].first_step == 12


def test_an_added_vehicle_tells_its_speed_place_and_gaps(apply: Apply) -> None:
    what = apply(CAR | {"at": "ego", "offset_m": 12}, builder=SHORT, dry_run=True).outcome.edits[0].what
    assert "(12 m ahead of the ego, same lane)" in what
    gaps = r"gaps: [\d.]+ m \([\d.]+ s\) to vehicle \d+ ahead, [\d.]+ m \([\d.]+ s\) to the ego behind"
    assert re.search(rf"m/s \(like vehicle \d+, the nearest in the lane\) from 0 s, {gaps}", what)
    alone = apply(CAR | {"at": "3", "speed": "5m/s"}, builder=SHORT, dry_run=True).outcome.edits[0].what
    assert "(its middle, " in alone
    assert "5 m/s from 0 s, gaps: no vehicle ahead in its lane, 126.7 m (11.5 s) to vehicle 34 behind" in alone
