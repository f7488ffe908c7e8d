"""Edit T: set_speed."""

import numpy as np
import pytest
from support.builders import Vehicle, driving, town_road
from support.edits import Apply

from plannerforge.schemas.errors import InvalidRequest, UnknownName

ALONE = town_road().with_vehicles(driving(34, (280, 7), 10.0, 101, heading_rad=np.pi))


def held(speed: str, **more: object) -> dict[str, object]:
    return {"op": "set_speed", "vehicles": ["34"], "speed": speed, **more}


def braking(vehicle_id: int, x_m: float, speed_mps: float, deceleration_mps2: float) -> Vehicle:
    """Somebody who brakes to a stand from the first step on, in the lane to the left of the drawing."""
    times_s = np.minimum(np.arange(101) * 0.1, speed_mps / deceleration_mps2)
    speeds = speed_mps - deceleration_mps2 * times_s
    places = x_m - (speed_mps + speeds) / 2 * times_s
    return Vehicle(vehicle_id, tuple((float(x), 7.0, np.pi, float(v)) for x, v in zip(places, speeds, strict=True)))


@pytest.mark.parametrize(("speed", "expected"), [("0m/s", 0.0), ("18km/h", 5.0), ("20m/s", 20.0)])
def test_a_speed_is_reached_and_kept_above_the_limit_too(apply: Apply, speed: str, expected: float) -> None:
    applied = apply(held(speed), builder=ALONE)
    track = applied.tracks()[34]
    assert track.speeds_mps[80] == pytest.approx(expected, abs=0.1)
    assert applied.outcome.touched[0].feasible
    assert "34 reaches that speed at" in applied.outcome.edits[0].what


def test_it_drives_as_recorded_before_the_edit(apply: Apply) -> None:
    applied = apply(held("3m/s", time_s=4.0), builder=ALONE)
    old, new = applied.base_tracks()[34], applied.tracks()[34]
    assert new.positions[:41] == pytest.approx(old.positions[:41])
    assert new.speeds_mps[80] == pytest.approx(3.0, abs=0.1)


def test_of_two_speeds_the_later_one_applies_from_its_time_on(apply: Apply) -> None:
    track = apply(held("3m/s", time_s=5.0), held("12m/s"), builder=ALONE).tracks()[34]
    assert track.speeds_mps[45] == pytest.approx(12.0, abs=0.2)
    assert track.speeds_mps[90] == pytest.approx(3.0, abs=0.2)


def test_traffic_ahead_is_not_hit_and_the_report_states_the_smallest_gap(apply: Apply) -> None:
    slow = driving(32, (250, 7), 4.0, 101, heading_rad=np.pi)
    applied = apply(held("20m/s"), builder=ALONE.with_vehicles(*ALONE.vehicles, slow))
    assert not applied.outcome.collisions
    assert "34 does not reach the speed" in applied.outcome.edits[0].what
    assert "traffic ahead, a junction or a curve limits it" in applied.outcome.edits[0].what


def test_a_vehicle_with_an_ordered_speed_brakes_as_hard_as_its_leader(apply: Apply) -> None:
    follower = driving(34, (280, 7), 17.0, 101, heading_rad=np.pi)
    builder = town_road().with_vehicles(follower, braking(32, 262.0, 17.0, 8.0))
    applied = apply(held("10m/s"), builder=builder)
    gap_m = applied.tracks()[34].positions[:, 0] - applied.tracks()[32].positions[:, 0] - 4.5
    assert applied.outcome.handed_over == ()
    assert gap_m.min() >= 1.0
    assert np.diff(applied.tracks()[34].speeds_mps).min() >= -0.8


def test_a_speed_without_enough_time_is_reported(apply: Apply) -> None:
    what = apply(held("30m/s", time_s=8.5), builder=ALONE).outcome.edits[0].what
    assert "the scenario ends at 10.0 s" in what


@pytest.mark.parametrize("speed", ["0m/s", "30m/s"])
def test_a_speed_ordered_just_before_the_end_is_not_blamed_on_the_traffic(apply: Apply, speed: str) -> None:
    what = apply(held(speed, time_s=9.8), builder=ALONE).outcome.edits[0].what
    assert "the scenario ends at 10.0 s" in what


@pytest.mark.parametrize("speed", ["-90m/s", "90m/s", "900%"])
def test_an_impossible_speed_is_refused(apply: Apply, speed: str) -> None:
    with pytest.raises(InvalidRequest, match="cannot drive"):
        apply(held(speed), builder=ALONE)


def test_a_speed_and_a_vehicle_are_needed(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="set_speed needs a speed"):
        apply({"op": "set_speed", "vehicles": ["34"]}, builder=ALONE)
    with pytest.raises(UnknownName, match="no vehicle 99"):
        apply(held("3m/s") | {"vehicles": ["99"]}, builder=ALONE)


def test_equal_results_of_several_vehicles_are_reported_once(apply: Apply) -> None:
    apart = town_road().with_vehicles(*(driving(30 + n, (40.0 + 40 * n, 3.5), 10.0, 81) for n in range(4)))
    applied = apply({"op": "set_speed", "vehicles": ["30", "31", "32", "33"], "speed": "9m/s"}, builder=apart)
    assert applied.outcome.edits[0].what.count("reach") == 1
    assert len(applied.outcome.edits[0].achieved) == 4
