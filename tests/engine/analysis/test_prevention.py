"""Reference drivers in the ego's place: closed forms of braking, encounters that none of them prevents."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from plannerforge.engine.analysis.prevention import Surroundings
from plannerforge.engine.analysis.prevention import prevention_of as prevention_or_none
from plannerforge.engine.commonroad import Track
from plannerforge.engine.planners import DriverPath, brakes_of
from plannerforge.schemas.reviews import DriverVerdict, Prevention
from plannerforge.schemas.text import REFERENCE_DRIVERS_DO

STEP_S = 0.1
LENGTH_M, WIDTH_M = 4.5, 1.8
CAR = brakes_of("car")


def track(
    key: int, start: tuple[float, float], speed_mps: float, steps: int, heading_rad: float = 0.0, first_step: int = 0
) -> Track:
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    positions = np.array(start) + np.outer(np.arange(steps) * STEP_S * speed_mps, along)
    shape = np.full(steps, heading_rad), np.full(steps, speed_mps)
    return Track(key, "car", LENGTH_M, WIDTH_M, first_step, positions, *shape)


def first_touch(ego: Track, other: Track) -> int:
    """The first step at which the two overlap, along one line."""
    gaps = np.abs(ego.positions - other.positions[: len(ego.positions)])
    touching = (gaps[:, 0] <= LENGTH_M) & (gaps[:, 1] <= WIDTH_M)
    return int(np.flatnonzero(touching)[0])


def prevention_of(ego: Track, other: Track, hit_step: int, step_s: float) -> Prevention:
    found = prevention_or_none(ego, other, hit_step, step_s)
    assert found is not None
    return found


def stopping_m(speed_mps: float) -> float:
    """How far an ego comes that brakes with a jerk to a largest deceleration, by integrating finely."""
    braking, way, step = 0.0, 0.0, 1e-3
    while speed_mps > 0:
        braking = min(braking + CAR.jerk_mps3 * step, CAR.full_mps2)
        way += speed_mps * step
        speed_mps -= braking * step
    return way


@settings(deadline=None, max_examples=25)
@given(speed_mps=st.floats(5, 30), gap_m=st.floats(60, 120))
def test_before_a_standing_car_braking_helps_up_to_the_stopping_distance(speed_mps: float, gap_m: float) -> None:
    ego = track(-1, (0.0, 0.0), speed_mps, 400)
    standing = track(7, (gap_m + LENGTH_M, 0.0), 0.0, 400)
    hit = first_touch(ego, standing)
    found = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
    latest_s = (gap_m - stopping_m(speed_mps)) / speed_mps
    if latest_s < -1.6 * STEP_S:
        assert found.by_braking_until_s is None
    elif latest_s >= 0:
        assert found.by_braking_until_s == pytest.approx(latest_s, abs=1.6 * STEP_S)


def test_a_careful_driver_needs_the_time_that_its_perception_takes() -> None:
    for gap_m, prevents in ((80.0, True), (12.0, False)):
        ego, standing = track(-1, (0.0, 0.0), 10.0, 200), track(7, (gap_m + LENGTH_M, 0.0), 0.0, 200)
        hit = first_touch(ego, standing)
        found = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
        assert found.by_careful_driver is prevents
        assert found.by_rss is prevents
        assert found.by_braking_until_s is not None


def test_the_careful_driver_is_too_late_if_two_seconds_are_too_short() -> None:
    ego, standing = track(-1, (0.0, 0.0), 30.0, 200), track(7, (150.0, 0.0), 0.0, 200)
    hit = first_touch(ego, standing)
    found = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
    assert not found.by_careful_driver, "2 s at 30 m/s are 60 m, and 0.75 s of them go by"
    assert found.by_rss
    assert found.by_braking_until_s is not None


def test_no_ego_prevents_a_recorded_follower_that_drives_into_it() -> None:
    ego, follower = track(-1, (30.0, 0.0), 5.0, 200), track(7, (0.0, 0.0), 15.0, 200)
    hit = first_touch(ego, follower)
    found = prevention_of(ego.part(0, hit + 1), follower, hit, STEP_S)
    assert not found.possible
    assert {one.start for one in found.drivers} == {"before_contact", "start"}
    assert REFERENCE_DRIVERS_DO in found.in_words()
    assert "at the start" in found.in_words()
    older = found.model_copy(update={"drivers": ()})
    assert "the start" not in older.in_words(), "versions before did not examine it"


def test_no_driver_prevents_a_hit_on_a_standing_ego() -> None:
    ego, follower = track(-1, (30.0, 0.0), 0.0, 200), track(7, (0.0, 0.0), 10.0, 200)
    hit = first_touch(ego, follower)
    assert not prevention_of(ego.part(0, hit + 1), follower, hit, STEP_S).possible


@pytest.mark.parametrize(("enters_at_m", "possible"), [(45.0, True), (6.0, False)])
def test_no_driver_prevents_a_cut_in_just_ahead(enters_at_m: float, possible: bool) -> None:
    ego = track(-1, (0.0, 0.0), 20.0, 200)
    slower = track(7, (enters_at_m, 3.5), 8.0, 200)
    steps = np.arange(200)
    slower.positions[:, 1] = np.clip(3.5 - 0.35 * steps, 0.0, None)  # 1 s from lane to lane
    hit = first_touch(ego, slower)
    assert prevention_of(ego.part(0, hit + 1), slower, hit, STEP_S).possible is possible


def test_a_crossing_vehicle_is_seen_before_it_is_in_the_path() -> None:
    ego = track(-1, (0.0, 0.0), 10.0, 200)
    crossing = track(7, (40.0, -40.0), 10.0, 200, heading_rad=math.pi / 2)
    hit = 36
    found = prevention_of(ego.part(0, hit + 1), crossing, hit, STEP_S)
    assert found.by_careful_driver
    assert found.by_braking_until_s is not None


def test_the_text_names_drivers_that_prevent_it_and_drivers_that_do_not() -> None:
    ego, standing = track(-1, (0.0, 0.0), 30.0, 200), track(7, (150.0, 0.0), 0.0, 200)
    hit = first_touch(ego, standing)
    words = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S).in_words()
    rss = "the Responsibility-Sensitive Safety (RSS) driver"
    assert words.startswith("if a reference driver takes over mid-run, full braking (no later than ")
    assert words.endswith(
        f" s), UN regulation R157's fuzzy driver and {rss} prevent it, but the careful driver does not; "
        "if a driver takes over at the start, full braking and the fuzzy and RSS drivers prevent it"
    )


def test_a_contact_that_the_tracks_do_not_show_is_not_judged() -> None:
    assert prevention_or_none(track(-1, (0.0, 0.0), 10.0, 50), track(7, (0.0, 50.0), 0.0, 50), 40, STEP_S) is None


def test_a_standing_turned_ego_keeps_its_heading_in_the_reference_driver_s_place() -> None:
    ego = track(-1, (0.0, 0.0), 0.0, 60, heading_rad=math.pi / 2)
    passing = track(7, (-30.0, 2.5), 10.0, 60)
    assert not prevention_of(ego, passing, 29, STEP_S).possible


@pytest.mark.parametrize(
    ("gap_m", "careful", "fuzzy"),
    [(150.0, False, True), (70.0, False, False)],
    ids=["far enough to begin early", "too near for both"],
)
def test_the_fuzzy_driver_begins_earlier_than_the_careful_one(gap_m: float, careful: bool, fuzzy: bool) -> None:
    # 30 m/s to a stop by 4 m/s² take 22.5 + 112.5 m with the response; by 6 m/s² 22.5 + 75 m
    ego, standing = track(-1, (0.0, 0.0), 30.0, 300), track(7, (gap_m + LENGTH_M, 0.0), 0.0, 300)
    hit = first_touch(ego, standing)
    found = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
    assert (found.by_careful_driver, found.by_fuzzy_driver) == (careful, fuzzy)


def test_the_fuzzy_driver_ignores_a_vehicle_that_keeps_to_the_next_lane() -> None:
    ego, standing = track(-1, (0.0, 0.0), 10.0, 200), track(7, (60.0, 0.0), 0.0, 200)
    hit = first_touch(ego, standing)
    beside = track(7, (60.0, 3.5), 0.0, 200)
    beside.positions[hit:, 1] = 0.0  # jumps into the way as the ego is there
    assert not prevention_of(ego.part(0, hit + 1), beside, hit, STEP_S).by_fuzzy_driver
    assert prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S).by_fuzzy_driver


ROAD = shapely.box(-50, -1.75, 500, 5.25)
"""Two lanes of 3.5 m; the ego's is the right one."""


def test_swerving_helps_if_braking_cannot_any_more() -> None:
    ego, standing = track(-1, (0.0, 0.0), 30.0, 200), track(7, (45.0, 0.0), 0.0, 200)
    hit = first_touch(ego, standing)
    found = prevention_or_none(ego.part(0, hit + 1), standing, hit, STEP_S, Surroundings([], ROAD))
    assert found is not None
    assert not found.possible
    # 0.5 m beside half of both widths: 1.8 m aside after sqrt(2 · 1.8 / 5) = 0.85 s
    assert found.by_steering_until_s == pytest.approx((45.0 - LENGTH_M) / 30.0 - 0.87, abs=0.25)
    assert found.in_words().endswith("; swerving no later than 0.4 s prevents it")


@pytest.mark.parametrize(
    ("others", "road"),
    [((track(8, (2.0, 3.5), 30.0, 200),), ROAD), ((), shapely.box(-50, -1.75, 500, 1.75))],
    ids=["another in the lane beside", "no lane beside"],
)
def test_swerving_fails_without_free_road(others: tuple[Track, ...], road: shapely.Polygon) -> None:
    ego, standing = track(-1, (0.0, 0.0), 30.0, 200), track(7, (45.0, 0.0), 0.0, 200)
    hit = first_touch(ego, standing)
    found = prevention_or_none(ego.part(0, hit + 1), standing, hit, STEP_S, Surroundings(others, road))
    assert found is not None
    assert (found.by_steering_until_s, found.steering_tried) == (None, True)


def verdict(found: Prevention, driver: str, start: str) -> DriverVerdict:
    return next(one for one in found.drivers if (one.driver, one.start) == (driver, start))


def braking_leader(gap_m: float, speed_mps: float, by_mps2: float, steps: int) -> Track:
    """A car ahead that brakes from 1 s on to a stop."""
    leader = track(7, (gap_m + LENGTH_M, 0.0), speed_mps, steps)
    speeds = np.maximum(speed_mps - by_mps2 * np.maximum(np.arange(steps) * STEP_S - 1.0, 0.0), 0.0)
    leader.speeds_mps[:] = speeds
    leader.positions[1:, 0] = leader.positions[0, 0] + np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)
    return leader


@pytest.mark.parametrize(("by_mps2", "gap_m"), [(6.0, 40.0), (3.0, 40.0)], ids=["hard", "gently"])
def test_the_careful_driver_prevents_running_into_a_leader_that_brakes(by_mps2: float, gap_m: float) -> None:
    ego, leader = track(-1, (0.0, 0.0), 25.0, 300), braking_leader(gap_m, 25.0, by_mps2, 300)
    hit = first_touch(ego, leader)
    found = prevention_of(ego.part(0, hit + 1), leader, hit, STEP_S)
    assert found.by_careful_driver
    assert found.attributable


def test_a_driver_that_still_rolls_after_three_seconds_has_not_prevented_anything() -> None:
    """At 35 m/s the fuzzy driver reaches a leader that brakes by 4.5 m/s² five seconds after the ego did."""
    ego, leader = track(-1, (0.0, 0.0), 35.0, 400), braking_leader(10.0, 35.0, 4.5, 400)
    hit = first_touch(ego, leader)
    whole = prevention_of(ego.part(0, hit + 1), leader, hit, STEP_S)
    assert not verdict(whole, "fsm", "before_contact").prevents
    # a track that ends while the leader still brakes goes on braking
    ending = prevention_of(ego.part(0, hit + 1), leader.part(0, hit + 5), hit, STEP_S)
    assert [one.prevents for one in ending.drivers] == [one.prevents for one in whole.drivers]


def test_an_ego_that_sped_up_caused_the_encounter() -> None:
    speeds = np.minimum(8.0 + 3.0 * np.arange(200) * STEP_S, 20.0)
    ego = track(-1, (0.0, 0.0), 8.0, 200)
    ego.speeds_mps[:] = speeds
    ego.positions[1:, 0] = np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)
    other = track(7, (14.0, 0.0), 9.0, 400)
    hit = first_touch(ego, other)
    found = prevention_of(ego.part(0, hit + 1), other, hit, STEP_S)
    assert verdict(found, "keep_lane", "start").prevents
    assert found.possible
    assert found.in_words().endswith("takes over at the start, all prevent it")


def test_from_the_start_a_driver_that_hits_another_vehicle_does_not_prevent_it() -> None:
    ego, crossing = track(-1, (0.0, 0.0), 10.0, 200), track(7, (80.0, -40.0), 5.0, 400, heading_rad=math.pi / 2)
    ego.positions[20:, 0] = ego.positions[19, 0] + np.arange(1, 181) * 0.95  # it slowed for the one in its lane
    hit = next(i for i in range(200) if abs(ego.positions[i, 0] - 80.0) < 3 and abs(crossing.positions[i, 1]) < 3)
    parked = track(9, (40.0, 0.0), 0.0, 400)
    alone = prevention_of(ego.part(0, hit + 1), crossing, hit, STEP_S)
    among = prevention_or_none(ego.part(0, hit + 1), crossing, hit, STEP_S, Surroundings([parked], None))
    assert among is not None
    assert not verdict(among, "keep_lane", "start").prevents
    assert len(alone.drivers) == len(among.drivers)


def test_full_braking_helps_only_while_it_keeps_clear_of_others_ahead_too() -> None:
    """Another crosses just before the standing car when the ego would have passed: braking has to end earlier."""
    ego, standing = track(-1, (0.0, 0.0), 10.0, 400), track(7, (60.0, 0.0), 0.0, 400)
    hit = first_touch(ego, standing)
    crossing = track(8, (56.0, -60.0), 10.0, 400, heading_rad=math.pi / 2)
    alone = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
    among = prevention_or_none(ego.part(0, hit + 1), standing, hit, STEP_S, Surroundings([crossing], None))
    assert among is not None
    assert alone.by_braking_until_s is not None
    assert among.by_braking_until_s is not None
    nearer_m = (60.0 - LENGTH_M / 2) - (56.0 - WIDTH_M / 2)
    assert alone.by_braking_until_s - among.by_braking_until_s == pytest.approx(nearer_m / 10.0, abs=1.1 * STEP_S)


def test_a_standing_car_that_a_cut_out_reveals_is_not_seen_before() -> None:
    ego, standing = track(-1, (0.0, 0.0), 20.0, 300), track(7, (100.0, 0.0), 0.0, 300)
    lead = track(8, (34.5, 0.0), 20.0, 300)  # 1.5 s ahead
    lead.positions[:, 1] = np.clip((np.arange(300) * STEP_S - 1.8) * 2.0, 0.0, 3.5)
    hit = first_touch(ego, standing)
    seen = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
    hidden = prevention_or_none(ego.part(0, hit + 1), standing, hit, STEP_S, Surroundings([lead], None))
    assert hidden is not None
    reacts = [verdict(found, "fsm", "before_contact").reacts_at_s or 0.0 for found in (seen, hidden)]
    assert reacts[1] > reacts[0]
    assert reacts[1] >= 1.8 + 0.375 / 2.0


def test_trucks_prevent_less_than_cars() -> None:
    standing = track(7, (75.0, 0.0), 0.0, 300)
    latest = {}
    for kind in ("car", "truck", "bus"):
        ego = replace(track(-1, (0.0, 0.0), 20.0, 200), kind=kind)
        hit = first_touch(ego, standing)
        latest[kind] = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S).by_braking_until_s or 0.0
    assert latest["truck"] == latest["bus"] < latest["car"]
    assert latest["car"] - latest["truck"] == pytest.approx((200 / 5.0 - 200 / CAR.full_mps2) / 20.0, abs=0.25)


def test_a_road_user_next_to_a_curve_does_not_jump_along_the_path() -> None:
    """The ego drives a right-angle bend of 10 m; the other moves straight past the middle of the bend, 8 m aside."""
    angle = np.linspace(0.0, math.pi / 2, 60)
    bend = np.column_stack([10.0 * np.sin(angle), 10.0 - 10.0 * np.cos(angle)])
    line = np.vstack([[[-20.0, 0.0]], bend, [[10.0, 40.0]]])
    way = DriverPath.along(line)
    passing = np.column_stack([np.linspace(-10.0, 4.0, 140), np.full(140, 8.0)])
    stations, _, _ = way.follow(passing)
    assert np.abs(np.diff(stations)).max() < 2.5


def test_takeover_times_are_within_the_run_and_report_if_it_is_too_late() -> None:
    ego, standing = track(-1, (0.0, 0.0), 12.0, 300), track(7, (120.0, 0.0), 0.0, 300)
    hit = first_touch(ego, standing)
    found = prevention_of(ego.part(0, hit + 1), standing, hit, STEP_S)
    careful, full = (verdict(found, name, "before_contact") for name in ("r157_careful", "full_braking"))
    assert careful.until_s is not None
    assert full.until_s is not None
    assert full.until_s - careful.until_s == pytest.approx(0.75 + 0.4, abs=0.25)
    assert found.by_braking_until_s == full.until_s


def test_verdicts_of_earlier_versions_are_read_as_they_were() -> None:
    old = Prevention(by_braking_until_s=None, by_careful_driver=False, by_rss=False, by_fuzzy_driver=True)
    assert old.possible
    assert old.attributable
    assert "at the start" not in old.in_words()


def test_a_follower_that_falls_back_first_still_catches_up_with_every_driver() -> None:
    speeds = np.concatenate([np.full(30, 8.0), np.full(270, 14.0)])
    ego, follower = track(-1, (30.0, 0.0), 10.0, 300), track(7, (0.0, 0.0), 8.0, 300)
    follower.speeds_mps[:] = speeds
    follower.positions[1:, 0] = np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)
    hit = first_touch(ego, follower)
    assert not prevention_of(ego.part(0, hit + 1), follower, hit, STEP_S).possible
