"""Edit P: pedestrians, and where slow road users are allowed."""

from dataclasses import replace

import pytest
from support.builders import driving, town_road
from support.edits import Apply, schema_errors

from plannerforge.schemas.errors import InvalidRequest, NotPossible

QUIET = town_road().with_vehicles(driving(34, (280, 7), 11.0, 101, heading_rad=3.14159))
WALKER = {"op": "add_vehicle", "vehicle_class": "pedestrian"}


def test_a_pedestrian_crosses_the_whole_road_from_its_right(apply: Apply) -> None:
    applied = apply(WALKER | {"at": "1", "position": "100m"}, builder=QUIET)
    track = applied.tracks()[101]
    assert track.kind == "pedestrian"
    assert track.positions[0] == pytest.approx((100.0, -2.35), abs=0.01)
    assert track.positions[-1] == pytest.approx((100.0, 9.35), abs=0.15)
    assert schema_errors(applied.xml) <= schema_errors(applied.base)


def test_a_departure_and_a_speed_hold(apply: Apply) -> None:
    track = apply(WALKER | {"at": "1", "position": "100m", "speed": "2m/s", "time_s": 3.0}, builder=QUIET).tracks()[101]
    assert track.first_step == 30
    assert track.speeds_mps[0] == pytest.approx(2.0)


def test_a_pedestrian_without_speed_stands_on_the_lane(apply: Apply) -> None:
    applied = apply(WALKER | {"at": "ego", "offset_m": 40, "speed": "0m/s"}, builder=QUIET)
    track = applied.tracks()[101]
    assert "stands on lanelet 1 at 80.0 m" in applied.outcome.edits[0].what
    assert track.positions[0] == pytest.approx((80.0, 0.0))
    assert track.positions[-1] == pytest.approx((80.0, 0.0))


def test_driven_vehicles_brake_for_a_pedestrian_on_their_lane(apply: Apply) -> None:
    drive = {"op": "set_behaviour", "vehicles": ["34"], "preset": "balanced"}
    step_out = WALKER | {"at": "3", "position": "80m", "time_s": 3.0}
    slowest = apply(drive, builder=QUIET).tracks()[34].speeds_mps.min()
    braking = apply(step_out, drive, builder=QUIET)
    assert braking.tracks()[34].speeds_mps.min() < slowest - 1.0
    assert not braking.outcome.collisions


def test_a_replayed_vehicle_that_would_hit_a_pedestrian_is_handed_over(apply: Apply) -> None:
    outcome = apply(WALKER | {"at": "3", "position": "80m", "time_s": 3.5}, builder=QUIET).outcome
    assert 34 in outcome.handed_over


@pytest.mark.parametrize("name", ["pedestrian", "bicycle"])
def test_motorways_are_not_open_to_the_slow(apply: Apply, name: str) -> None:
    motorway = replace(QUIET, tags=("highway",))
    with pytest.raises(NotPossible, match=f"a {name} is not allowed on lanelet 1: it belongs to a motorway"):
        apply({"op": "add_vehicle", "vehicle_class": name, "at": "1"}, builder=motorway)


@pytest.mark.parametrize("extra", [{"to": ["3"]}, {"count": 2}, {"preset": "eco"}])
def test_arguments_only_for_vehicles_are_refused(apply: Apply, extra: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest, match="vehicles"):
        apply(WALKER | {"at": "1"} | extra, builder=QUIET)


def test_an_impossible_pace_is_refused(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="30km/h"):
        apply(WALKER | {"at": "1", "speed": "30km/h"}, builder=QUIET)


def test_a_pedestrian_is_never_driven(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="cannot be driven as a vehicle"):
        apply(WALKER | {"at": "1"}, {"op": "set_behaviour", "vehicles": ["new:0"], "preset": "eco"}, builder=QUIET)


def test_an_added_pedestrian_can_be_removed_again(apply: Apply) -> None:
    applied = apply(WALKER | {"at": "1"}, {"op": "remove_vehicle", "vehicles": ["new:0"]}, builder=QUIET)
    assert not applied.changed_elements()


def test_a_pedestrian_stands_at_the_kerb_for_a_duration_before_it_crosses(apply: Apply) -> None:
    waits = apply(WALKER | {"at": "1", "position": "100m", "speed": "2m/s", "duration_s": 3.0}, builder=QUIET)
    track = waits.tracks()[101]
    assert track.first_step == 0
    assert track.positions[30] == pytest.approx(track.positions[0])
    assert track.speeds_mps[29] == 0.0
    assert track.positions[40][1] - track.positions[0][1] == pytest.approx(2.0)


def test_a_cyclist_with_a_side_and_a_speed_crosses_and_gains_speed_as_its_class_does(apply: Apply) -> None:
    cyclist = {"op": "add_vehicle", "vehicle_class": "bicycle", "side": "left", "at": "1", "position": "100m"}
    applied = apply(cyclist | {"speed": "3m/s", "duration_s": 1.0}, builder=QUIET)
    track = applied.tracks()[101]
    assert track.kind == "bicycle"
    assert track.positions[0] == pytest.approx((100.0, 9.35), abs=0.01)
    assert track.positions[-1][1] == pytest.approx(-2.35, abs=0.35)
    assert track.speeds_mps[20] == pytest.approx(1.0)
    assert track.speeds_mps[-1] == pytest.approx(3.0)
    assert all(vehicle.feasible for vehicle in applied.outcome.touched)


def test_a_bicycle_with_a_side_alone_is_parked_there(apply: Apply) -> None:
    parked = {"op": "add_vehicle", "vehicle_class": "bicycle", "side": "right", "at": "1", "position": "100m"}
    assert "parked at the right kerb" in apply(parked, builder=QUIET).outcome.edits[0].what


@pytest.mark.parametrize("more", [{"when": "gap<=2s"}, {"vehicle_class": "car"}])
def test_a_duration_belongs_to_one_that_crosses_and_to_no_trigger(apply: Apply, more: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest):
        apply(WALKER | {"at": "1", "position": "100m", "duration_s": 3.0} | more, builder=QUIET)
