"""The ego is seen by the driven vehicles, and what an edit does to its danger is a number."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.builders import Problem, driving, town_road
from support.edits import Apply

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.criticality import drive_criticality
from plannerforge.engine.edits.ego_risk import ego_risk_to
from plannerforge.engine.scene.scene import Scene
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.errors import NotPossible

EGO = Problem(start=(40.0, 0.0, 0.0, 10.0))
SLOW = Problem(start=(40.0, 0.0, 0.0, 3.0))
ONE_LANE = replace(town_road(), lanes=tuple(replace(lane, left=None) for lane in town_road().lanes))
CHASED = replace(ONE_LANE.with_vehicles(driving(31, (20, 0), 13.0, 101)), problems=(SLOW,))
RAMMED = replace(ONE_LANE.with_vehicles(driving(31, (15, 0), 20.0, 61)), problems=(SLOW,))
FOLLOWED = replace(town_road().with_vehicles(driving(31, (10, 0), 14.0, 101)), problems=(EGO,))
ALONE = replace(town_road().with_vehicles(driving(31, (150, 7), 8.0, 101)), problems=(EGO,))


def test_a_driven_vehicle_keeps_clear_of_the_ego(apply: Apply) -> None:
    applied = apply({"op": "set_behaviour", "vehicles": ["31"], "preset": "aggressive"}, builder=CHASED)
    after = applied.outcome.ego_after
    assert after is not None
    assert after.minimum_distance_m is not None
    assert after.minimum_distance_m > 0.5


def test_a_slow_vehicle_ahead_raises_the_ego_s_risk(apply: Apply) -> None:
    slow = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 12.0, "speed": "2m/s"}
    outcome = apply(slow, builder=ALONE).outcome
    assert outcome.ego_before is not None
    assert outcome.ego_after is not None
    assert outcome.ego_before.risk_score == 5
    assert outcome.ego_after.risk_score is not None
    assert outcome.ego_after.risk_score < 3


def test_removing_a_vehicle_removes_its_risk(apply: Apply) -> None:
    outcome = apply({"op": "remove_vehicle", "vehicles": ["31"]}, builder=FOLLOWED).outcome
    assert outcome.ego_before is not None
    assert outcome.ego_before.minimum_time_to_collision_s is not None
    assert outcome.ego_after is not None
    assert outcome.ego_after.minimum_distance_m is None


def test_risk_is_the_criticality_of_the_same_drive(tmp_path: Path) -> None:
    tracks = Scene.of(read_scenario(town_road().write(tmp_path / "base.xml"))).tracks
    drive, others = tracks[32], tuple(track for key, track in tracks.items() if key != 32)
    ego = replace(drive, length_m=BMW_320I.length_m, width_m=BMW_320I.width_m)
    whole = drive_criticality(ego, others)
    found = ego_risk_to(ego, others, step_s=0.1).figures
    assert found.minimum_distance_m == pytest.approx(whole.minimum_distance_m, abs=1e-3)
    assert found.minimum_time_to_collision_s == pytest.approx(whole.minimum_time_to_collision_s, abs=1e-3)
    assert found.risk_score == whole.risk_score


def test_a_replayed_vehicle_that_hits_the_ego_from_behind_is_left_out_and_named(apply: Apply) -> None:
    outcome = apply({"op": "set_goal", "to": ["1"], "goal_time": "<=15s"}, builder=RAMMED).outcome
    for danger in (outcome.ego_before, outcome.ego_after):
        assert danger is not None
        assert danger.risk_score != 0
        assert danger.left_out == (31,)
    assert not any("from behind" in one for one in outcome.warnings)
    driven = apply({"op": "set_behaviour", "vehicles": ["31"], "preset": "aggressive"}, builder=RAMMED).outcome
    assert driven.ego_after is not None
    assert driven.ego_after.minimum_distance_m is not None


@pytest.mark.parametrize(
    "edits",
    [
        [{"op": "set_speed", "vehicles": ["31"], "speed": "0m/s", "time_s": 5.0}],
        [{"op": "shift_time", "vehicles": ["31"], "time_s": moved_s} for moved_s in (1.0, -1.0)],
        [{"op": "shift_time", "vehicles": ["31"], "time_s": 0.2}],
    ],
    ids=["driven after it", "moved and moved back", "moved a little"],
)
def test_a_recorded_hit_from_behind_is_not_an_effect_of_an_edit(apply: Apply, edits: list[dict[str, Any]]) -> None:
    outcome = apply(*edits, builder=RAMMED).outcome
    assert outcome.ego_before is not None
    assert outcome.ego_after is not None
    assert outcome.ego_before.risk_score != 0
    assert outcome.ego_after.risk_score == outcome.ego_before.risk_score
    assert outcome.ego_before.left_out == outcome.ego_after.left_out == (31,)


def test_a_hit_from_behind_that_a_shift_brings_about_counts(apply: Apply) -> None:
    late = replace(ONE_LANE.with_vehicles(driving(31, (0, 0), 12.0, 61)), problems=(SLOW,))
    outcome = apply({"op": "shift_time", "vehicles": ["31"], "time_s": -2.0}, builder=late).outcome
    assert outcome.ego_before is not None
    assert outcome.ego_after is not None
    assert outcome.ego_before.risk_score != 0
    assert outcome.ego_after.risk_score == 0


def test_vehicles_left_out_because_of_an_edit_are_reported(apply: Apply) -> None:
    outcome = apply({"op": "remove_vehicle", "vehicles": ["31"]}, builder=RAMMED).outcome
    assert outcome.ego_before is not None
    assert outcome.ego_after is not None
    assert (outcome.ego_before.left_out, outcome.ego_after.left_out) == ((31,), ())


def moving(key: int, x_m: float, speed_mps: float, *, y_m: float = 0.0, heading_rad: float = 0.0) -> Track:
    """A car that drives for 10 s."""
    along = speed_mps * 0.1 * np.arange(101)[:, None] * np.array([np.cos(heading_rad), np.sin(heading_rad)])
    return Track(
        key, "car", 4.5, 1.8, 0, np.array([x_m, y_m]) + along, np.full(101, heading_rad), np.full(101, speed_mps)
    )


@pytest.mark.parametrize(
    ("other", "counts"),
    [
        (moving(2, -40.0, 20.0), False),
        (moving(2, 40.0, 5.0), True),
        (moving(2, 80.0, 5.0, heading_rad=np.pi), True),
        (moving(2, 50.0, 10.0, y_m=-50.0, heading_rad=np.pi / 2), True),
        (moving(2, -40.0, 20.0, y_m=4.0), True),
    ],
    ids=["from behind", "ahead", "oncoming", "across", "passing by"],
)
def test_only_a_hit_from_behind_is_left_out(other: Track, counts: bool) -> None:
    ego = moving(1, 0.0, 10.0)
    found = ego_risk_to(ego, (), (other,), step_s=0.1)
    assert found.left_out == (() if counts else (2,))
    if counts:
        assert found.figures == ego_risk_to(ego, (other,), step_s=0.1).figures


def test_a_vehicle_left_out_counts_until_a_driver_would_have_reacted() -> None:
    ego, follower = moving(1, 0.0, 10.0), moving(2, -64.5, 20.0)
    figures = ego_risk_to(ego, (), (follower,), step_s=0.1).figures
    assert figures.minimum_time_to_collision_s == pytest.approx(4.0, abs=0.15)
    assert ego_risk_to(ego, (follower,), step_s=0.1).figures.risk_score == 0


def test_a_collision_more_than_a_minute_away_does_not_count() -> None:
    creeping = ego_risk_to(moving(1, 0.0, 10.0), (moving(2, 30.0, 9.999),), step_s=0.1).figures
    assert creeping.minimum_time_to_collision_s is None
    assert creeping.minimum_distance_m is not None


def test_the_most_critical_moment_is_the_first_collision_or_the_least_time_to_it() -> None:
    ego, ahead, passing = moving(1, 0.0, 10.0), moving(2, 40.0, 5.0), moving(3, -20.0, 15.0, y_m=3.5)
    figures = ego_risk_to(ego, (passing, ahead), step_s=0.1).figures
    # 40 m less both halves, 2.254 and 2.25 m, closing at 5 m/s: they touch after 7.0992 s, so from the state at 7.1 s
    assert (figures.most_critical_id, figures.most_critical_time_s) == (2, 7.1)
    closing = ego_risk_to(ego, (passing, moving(2, 60.0, 5.0)), step_s=0.1).figures
    assert (closing.most_critical_id, closing.most_critical_time_s) == (2, 10.0)


def test_a_region_counts_under_the_id_of_its_obstacle() -> None:
    region = replace(moving(2, 40.0, 5.0), obstacle_id=-70_003)
    assert ego_risk_to(moving(1, 0.0, 10.0), (region,), step_s=0.1).figures.most_critical_id == 7


def test_both_checks_are_requested_with_detail(apply: Apply) -> None:
    outcome = apply({"op": "set_behaviour", "vehicles": ["31"], "preset": "eco"}, detail="checks").outcome
    assert outcome.checked_by == "drivability_checker"
    assert outcome.checkers_agree == len(outcome.touched) == 1


def test_reactive_traffic_drives_every_vehicle(apply: Apply) -> None:
    edit = {"op": "set_behaviour", "vehicles": ["31"], "params": ["speedFactor=0.5"]}
    outcome = apply(edit, traffic="reactive").outcome
    assert outcome.untouched == 0
    assert outcome.collisions == ()
    assert {vehicle.vehicle_id for vehicle in outcome.touched} >= {31, 32, 34}
    assert 31 not in outcome.handed_over


def test_a_conflict_can_be_refused_in_reactive_traffic_too(apply: Apply) -> None:
    walker = driving(36, (75, 0), 0.1, 101, kind="pedestrian", size_m=(0.6, 0.6))
    rushing = town_road().with_vehicles(driving(31, (62, 3.5), 14.0, 101), walker)
    into = {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "66m", "speed": "14m/s"}
    with pytest.raises(NotPossible, match="101 with 36"):
        apply(into, builder=rushing, on_conflict="refuse", traffic="reactive")
