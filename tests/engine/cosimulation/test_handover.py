"""A vehicle is taken over at its recorded state, without a jump in place or speed."""

from dataclasses import replace

import numpy as np
import pytest
from support.builders import driving, town_road
from support.edits import Apply

from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.cosimulation.handover import handover_track
from plannerforge.engine.cosimulation.replay import DrivenTrack
from plannerforge.engine.vehicles import check_kinematics, nearest_class

EDITS = (
    {"op": "reroute", "vehicles": ["35"], "turn": "right"},
    {"op": "reroute", "vehicles": ["31"], "to": ["21"]},
    {"op": "set_behaviour", "vehicles": ["32"], "preset": "aggressive"},
    {"op": "set_behaviour", "vehicles": ["34"], "preset": "cautious"},
)


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: f"{edit['op']}-{edit['vehicles'][0]}")
def test_the_motion_begins_at_the_recorded_state(apply: Apply, edit: dict[str, object]) -> None:
    applied = apply(edit)
    for vehicle in applied.outcome.touched:
        old, new = applied.base_tracks()[vehicle.vehicle_id], applied.tracks()[vehicle.vehicle_id]
        assert new.positions[0] == pytest.approx(old.positions[0])
        assert new.headings_rad[0] == pytest.approx(old.headings_rad[0])
        assert new.speeds_mps[0] == pytest.approx(old.speeds_mps[0])
        assert vehicle.handover_jump_m is not None
        assert vehicle.handover_jump_m <= 0.05
        assert vehicle.handover_speed_step_mps is not None
        assert vehicle.handover_speed_step_mps <= 1.0


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: f"{edit['op']}-{edit['vehicles'][0]}")
def test_positions_and_speeds_agree_all_along(apply: Apply, edit: dict[str, object]) -> None:
    applied = apply(edit)
    for vehicle in applied.outcome.touched:
        track = applied.tracks()[vehicle.vehicle_id]
        moved = np.linalg.norm(np.diff(track.positions, axis=0), axis=1)
        fastest = np.maximum(track.speeds_mps[1:], track.speeds_mps[:-1])
        assert (moved - fastest * 0.1).max() <= 0.05
        assert vehicle.feasible


def test_no_vehicle_is_driven_beyond_the_scenario(apply: Apply) -> None:
    applied = apply({"op": "set_behaviour", "vehicles": ["all"], "preset": "balanced"})
    assert max(track.last_step for track in applied.tracks().values()) <= 150


def test_a_vehicle_recorded_for_a_while_only_is_driven_to_the_end(apply: Apply) -> None:
    short = driving(36, (20, 3.5), 8.0, 30)
    builder = town_road().with_vehicles(*town_road().vehicles, short)
    applied = apply({"op": "set_behaviour", "vehicles": ["36"], "preset": "balanced"}, builder=builder)
    assert applied.base_tracks()[36].last_step == 29
    assert applied.tracks()[36].last_step == 150


def test_a_vehicle_recorded_off_its_lane_is_not_matched_to_the_adjacent_road(apply: Apply) -> None:
    overtaking = driving(36, (20, 6.8), 10.0, 151)
    applied = apply(
        {"op": "set_behaviour", "vehicles": ["36"], "preset": "balanced"}, builder=town_road().with_vehicles(overtaking)
    )
    track = applied.tracks()[36]
    assert track.positions[0] == pytest.approx((20, 6.8))
    assert track.positions[60][0] > 60
    assert track.positions[60][1] < 5


def test_a_vehicle_recorded_at_an_angle_off_its_lane_is_led_in_smoothly(apply: Apply) -> None:
    straight = driving(36, (20, 6.2), 17.0, 151)
    askew = replace(straight, poses=((20.0, 6.2, 0.24, 17.0), *straight.poses[1:]))
    applied = apply(
        {"op": "set_behaviour", "vehicles": ["36"], "preset": "balanced"}, builder=town_road().with_vehicles(askew)
    )
    (vehicle,) = applied.outcome.touched
    assert vehicle.handover_speed_step_mps is not None
    assert vehicle.handover_speed_step_mps <= 1.0
    assert vehicle.feasible


@pytest.mark.parametrize("braking_mps2", [4.0, 7.0, 8.0])
def test_a_vehicle_that_brakes_at_once_into_a_tight_curve_changes_speed_step_by_step(braking_mps2: float) -> None:
    start = Track(
        obstacle_id=36,
        kind="car",
        length_m=5.0,
        width_m=2.0,
        first_step=0,
        positions=np.zeros((1, 2)),
        headings_rad=np.zeros(1),
        speeds_mps=np.array([10.8]),
    )
    times_s = np.minimum(np.arange(60) * 0.1, 9.8 / braking_mps2)
    turned_rad = np.clip((9.8 * times_s - braking_mps2 * times_s**2 / 2) / 6.0, 0.0, np.pi / 2)
    front = np.stack([2.5 + 6.0 * np.sin(turned_rad), 6.0 * (np.cos(turned_rad) - 1)], axis=1)
    touched = handover_track(start, DrivenTrack(0, front, ("e1_0",) * 60, leaves=False), 0.1, 60)
    assert touched is not None
    speeds = touched.motion.speeds_mps
    assert speeds[0] == 10.8
    assert abs(speeds[1] - speeds[0]) <= 1.0


def test_a_bus_in_a_too_tight_turn_swings_out() -> None:
    start = Track(
        obstacle_id=36,
        kind="bus",
        length_m=12.0,
        width_m=2.5,
        first_step=0,
        positions=np.stack([np.arange(11) * 0.6, np.zeros(11)], axis=1),
        headings_rad=np.zeros(11),
        speeds_mps=np.full(11, 6.0),
    )
    way_m = 6.0 + np.arange(130) * 0.6  # straight for 25 m, then round a half circle of 6 m, then straight on
    turned_rad = np.clip((way_m - 25.0) / 6.0, 0.0, np.pi)
    straight_m = np.minimum(way_m, 25.0) - np.maximum(way_m - 25.0 - 6.0 * np.pi, 0.0)
    front = np.stack([6.0 + straight_m + 6.0 * np.sin(turned_rad), 6.0 * (1 - np.cos(turned_rad))], axis=1)
    touched = handover_track(start, DrivenTrack(10, front, ("e1_0",) * 130, leaves=False), 0.1, 140)
    assert touched is not None
    bus = nearest_class("bus", 12.0)
    assert check_kinematics(touched.motion, 0.1, wheelbase_m=bus.wheelbase_m, rear_axle_m=bus.rear_axle_m).feasible
    assert touched.motion.positions[0] == pytest.approx(start.positions[10])


@pytest.mark.parametrize("speed_mps", [1.0, 3.4, 10.0])
def test_a_stopped_vehicle_does_not_roll_back(apply: Apply, speed_mps: float) -> None:
    stop = {"op": "set_speed", "vehicles": ["36"], "speed": "0m/s"}
    applied = apply(stop, builder=town_road().with_vehicles(driving(36, (60, 0), speed_mps, 101)))
    assert np.diff(applied.tracks()[36].positions[:, 0]).min() >= 0.0
