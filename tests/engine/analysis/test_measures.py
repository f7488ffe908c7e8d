"""The measures of a run against closed forms, and what is told where there is none."""

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from plannerforge.engine.analysis.conflicts import nearest_crossing, times_left_to_crossing, worst_times_s
from plannerforge.engine.analysis.measures import MeasuredDrive
from plannerforge.engine.commonroad import Track
from plannerforge.engine.criticality import MovingRectangles
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.schemas.measures import MEASURES, MeasuredValue, Relation, measure_named

STEP_S, LENGTH_M, WIDTH_M = 0.1, 4.0, 2.0


def track(
    x: float, y: float, speed: float, heading: float = 0.0, *, steps: int = 61, key: int = 7, braking: float = 0.0
) -> Track:
    """Straight on from a place, from the first step on braking evenly to a stop."""
    times = np.arange(steps) * STEP_S
    drives = np.minimum(times, speed / braking) if braking else times
    driven = speed * drives - braking * drives**2 / 2
    along = np.array([math.cos(heading), math.sin(heading)])
    return Track(
        obstacle_id=key,
        kind="car",
        length_m=LENGTH_M,
        width_m=WIDTH_M,
        first_step=0,
        positions=np.array([x, y]) + driven[:, None] * along,
        headings_rad=np.full(steps, heading),
        speeds_mps=speed - braking * drives,
    )


def measured(ego: Track, *others: Track, **changes: Any) -> dict[str, MeasuredValue]:
    accelerations = np.gradient(ego.speeds_mps, STEP_S)
    drive = MeasuredDrive(ego, accelerations, others, frozenset(), STEP_S, BMW_320I, **changes)
    return {one.name: one for one in drive.measured()}


def test_following_a_slower_leader_has_the_textbook_figures() -> None:
    ego, leader = track(0.0, 0.0, 20.0, steps=21), track(64.0, 0.5, 12.0, steps=21)
    found = measured(ego, leader)
    gap = 60.0 - 2.0 * 8.0  # of the last state, two seconds later
    expected = {
        "leader_time_to_collision_s": gap / 8.0,
        "minimum_time_to_collision_s": gap / 8.0,
        "time_to_brake_s": (gap - 8.0**2 / 16.0) / 8.0,
        "time_to_react_s": max((gap - 8.0**2 / 16.0) / 8.0, gap / 8.0 - math.sqrt(2 * 1.5 / 8.0)),
        "minimum_time_gap_s": gap / 20.0,
        "minimum_time_headway_s": (gap + LENGTH_M) / 20.0,
        "deceleration_to_avoid_mps2": 8.0**2 / (2 * gap),
        "brake_threat_number": 8.0**2 / (2 * gap) / 8.0,
        "steer_threat_number": 2 * 1.5 / (gap / 8.0) ** 2 / 8.0,
        "rss_margin_m": gap - (20.0 * 0.75 + 20.0**2 / 8.0 - 12.0**2 / 16.0),
        "time_exposed_s": 0.0,
    }
    assert {name: found[name].value for name in expected} == pytest.approx(expected, rel=1e-9)
    partners = {(found[name].partner, found[name].time_s) for name in expected if name != "time_exposed_s"}
    assert partners == {("car 7 ahead", 2.0)}


def test_a_much_faster_ego_may_swerve_later_than_brake() -> None:
    found = measured(track(0.0, 0.0, 30.0, steps=2), track(50.0, 0.5, 5.0, steps=2))
    assert found["time_to_brake_s"].value == pytest.approx((43.5 - 25.0**2 / 16.0) / 25.0)
    assert found["time_to_react_s"].value == pytest.approx(43.5 / 25.0 - math.sqrt(2 * 1.5 / 8.0))


def test_a_leader_that_stops_before_needs_the_ego_to_stop_behind_it() -> None:
    ego, leader = track(0.0, 0.0, 10.0, steps=6), track(24.0, 0.0, 4.0, steps=6, braking=4.0)
    gap, speed = 20.0 + 4.0 * 0.5 - 4.0 * 0.5**2 / 2 - 10.0 * 0.5, 4.0 - 4.0 * 0.5
    needed = 10.0**2 / (2 * (gap + speed**2 / (2 * 4.0)))
    assert measured(ego, leader)["brake_threat_number"].value == pytest.approx(needed / 8.0, rel=1e-9)


def test_exposure_adds_up_the_steps_below_three_seconds() -> None:
    found = measured(track(0.0, 0.0, 20.0, steps=31), track(64.0, 0.0, 10.0, steps=31))
    times = (60.0 - 10.0 * np.arange(31) * STEP_S) / 10.0
    below = times[times <= 3.0 + 1e-9]
    assert found["time_exposed_s"].value == pytest.approx(len(below) * STEP_S)
    assert found["time_integrated_s2"].value == pytest.approx((3.0 - below).sum() * STEP_S)


def test_the_time_between_two_that_cross_is_that_of_the_place_that_both_sweep() -> None:
    ego = track(-20.0, 0.0, 10.0)  # in x −1 … 1 from 17 m on, until its rear is past 23 m
    other = track(0.0, -35.0, 10.0, math.pi / 2)  # in y −1 … 1 from 32 m on
    found = measured(ego, other)
    assert found["post_encroachment_time_s"].value == pytest.approx(3.2 - 2.3, abs=0.011)
    assert found["encroachment_time_s"].value == pytest.approx(0.6, abs=0.021)
    assert found["post_encroachment_time_s"].partner == "car 7 crossing"
    assert found["post_encroachment_time_s"].time_s == pytest.approx(3.2, abs=0.011)


def test_a_follower_on_the_same_path_does_not_cross_it() -> None:
    others = [track(-20.0, 0.0, 10.0), track(-20.0, 3.0, 10.0, 0.3), track(30.0, 30.0, 0.0, math.pi / 2)]
    assert nearest_crossing(track(0.0, 0.0, 10.0), others, STEP_S, 10.0) is None


def test_both_at_once_in_the_place_leaves_no_time() -> None:
    crossing = nearest_crossing(track(-20.0, 0.0, 10.0), [track(0.0, -20.0, 10.0, math.pi / 2)], STEP_S, 10.0)
    assert crossing is not None
    assert crossing.post_encroachment_s == 0.0


def bodies(track_: Track) -> MovingRectangles:
    return MovingRectangles(
        track_.positions[:1], track_.headings_rad[:1], np.array([[LENGTH_M, WIDTH_M]]), track_.speeds_mps[:1]
    )


def test_braking_for_a_vehicle_that_stands_across_starts_at_the_stopping_distance() -> None:
    ego, wall = bodies(track(0.0, 0.0, 16.0)), bodies(track(53.0, 0.0, 0.0, math.pi / 2))
    brake, react = times_left_to_crossing(ego, wall, np.array([50.0 / 16.0]), BMW_320I)
    assert brake[0] == pytest.approx((50.0 - 16.0**2 / 16.0) / 16.0, abs=0.01)
    assert react[0] >= brake[0]


def test_accelerating_is_a_way_out_if_braking_is_too_late() -> None:
    ego, other = bodies(track(0.0, 0.0, 16.0)), bodies(track(8.0, -9.5, 12.0, math.pi / 2))
    brake, react = times_left_to_crossing(ego, other, np.array([0.55]), replace(BMW_320I, switching_speed_mps=50.0))
    assert brake[0] == 0.0
    assert react[0] > 0.0


@pytest.mark.parametrize(("stands", "grows"), [(False, 16.0), (True, 8.0)])
def test_the_worst_time_solves_the_equation_of_growing_discs(stands: bool, grows: float) -> None:
    ego, other = bodies(track(0.0, 0.0, 20.0)), bodies(track(40.0, 0.0, 12.0))
    found = float(worst_times_s(ego, other, np.array([stands]))[0])
    gap = 40.0 - 2 * LENGTH_M / 3 - 2 * math.hypot(LENGTH_M / 6, WIDTH_M / 2)
    assert 8.0 * found + grows / 2 * found**2 == pytest.approx(gap, rel=1e-9)


def test_discs_that_overlap_leave_no_time() -> None:
    assert worst_times_s(bodies(track(0.0, 0.0, 5.0)), bodies(track(3.0, 0.0, 5.0)), np.array([False]))[0] == 0.0


def test_a_crash_changes_the_velocity_by_the_share_of_the_masses() -> None:
    ego, other = track(0.0, 0.0, 10.0, steps=11), track(13.5, 0.0, 0.0, math.pi / 2, steps=11)
    assert measured(ego, other, hit=7)["delta_v_mps"].value == pytest.approx(5.0)
    truck = replace(other, kind="truck")
    assert measured(ego, truck, hit=7)["delta_v_mps"].value == pytest.approx(10.0 * 12_000 / 13_500)
    assert "delta_v_mps" not in measured(ego, other)


def test_braking_is_drivable_and_a_turn_on_the_spot_is_not() -> None:
    braking = track(0.0, 0.0, 10.0, steps=11, braking=3.0)
    found = measured(braking)
    assert found["drivable_share"].value == 1.0
    assert found["maximum_braking_mps2"].value == pytest.approx(3.0)
    turned = replace(braking, headings_rad=np.where(np.arange(11) < 5, 0.0, 1.0))
    spun = measured(turned)
    assert 0.0 < (spun["drivable_share"].value or 0.0) < 1.0
    assert spun["drivable_share"].time_s is not None
    assert "limit is 0.4" in spun["maximum_steering_rate_radps"].note


def test_an_empty_road_leaves_the_figures_of_the_ego_alone() -> None:
    found = measured(track(0.0, 0.0, 10.0), track(500.0, 0.0, 10.0))
    assert set(found) < {measure.name for measure in MEASURES}
    assert all(one.obstacle_id is None for one in found.values())
    assert "minimum_distance_m" not in found


@pytest.mark.parametrize(
    ("other", "relation"),
    [
        (track(20.0, 0.0, 10.0), "ahead"),
        (track(-20.0, 0.0, 10.0), "behind"),
        (track(0.0, 4.0, 10.0), "beside"),
        (track(30.0, 4.0, 10.0, math.pi), "oncoming"),
        (track(30.0, 30.0, 1.0, math.pi / 2), "crossing"),
        (track(8.0, 0.0, 0.0, math.pi), "ahead"),
    ],
)
def test_the_nearest_is_reported_with_its_relation(other: Track, relation: Relation) -> None:
    assert relation in get_args(Relation)
    assert measured(track(0.0, 0.0, 10.0, steps=2), other)["minimum_distance_m"].relation == relation


def test_every_measure_that_is_computed_is_defined() -> None:
    found = measured(track(0.0, 0.0, 20.0), track(64.0, 0.0, 10.0), hit=7, progress=0.5)
    assert [name for name in found if measure_named(name) is None] == []
