"""Edit T: stop_at."""

import re
from typing import Any

import numpy as np
import pytest
from support.builders import driving, town_road
from support.edits import Applied, Apply

from plannerforge.schemas.errors import InvalidRequest, NotPossible

ALONE = town_road().with_vehicles(driving(34, (280, 7), 10.0, 201, heading_rad=np.pi))
"""A car of 4.5 m in lanelet 3, which leads from x = 300 to x = 0: its front is at station 22.25 m."""


def stop(position: str, **more: object) -> dict[str, object]:
    return {"op": "stop_at", "vehicles": ["34"], "at": "3", "position": position, **more}


def standing_steps(applied: Applied, station_m: float) -> list[int]:
    """Return the steps at which the car stands with its front within 1 m of a station of lanelet 3."""
    track = applied.tracks()[34]
    fronts_m = 300.0 - (track.positions[:, 0] - track.length_m / 2)
    return [
        step for step in range(len(fronts_m)) if track.speeds_mps[step] < 0.1 and abs(fronts_m[step] - station_m) < 1
    ]


def values(applied: Applied, edit: int = 0) -> dict[str, Any]:
    return {one.quantity: one for one in applied.outcome.edits[edit].achieved}


def test_it_stops_there_stands_and_drives_on(apply: Apply) -> None:
    applied = apply(stop("80m", duration_s=4.0), builder=ALONE)
    stood = standing_steps(applied, 80.0)
    assert len(stood) * 0.1 == pytest.approx(4.0, abs=0.5)
    assert applied.tracks()[34].speeds_mps[-1] > 5.0
    assert applied.outcome.touched[0].feasible
    assert values(applied)["stop at"].value == pytest.approx(80.0, abs=1.0)
    assert values(applied)["standing time"].reached
    assert applied.outcome.edits[0].verdict == "done"


def test_without_a_duration_it_stands_until_the_end(apply: Apply) -> None:
    applied = apply(stop("80m"), builder=ALONE)
    assert standing_steps(applied, 80.0)[-1] == 200


def test_it_follows_its_recording_until_the_given_time(apply: Apply) -> None:
    applied = apply(stop("90m", time_s=2.0), builder=ALONE)
    assert applied.tracks()[34].positions[:21] == pytest.approx(applied.base_tracks()[34].positions[:21])
    assert standing_steps(applied, 90.0)


@pytest.mark.parametrize(
    "later",
    [
        {"op": "set_behaviour", "vehicles": ["34"], "preset": "aggressive"},
        {"op": "set_speed", "vehicles": ["34"], "speed": "7m/s", "time_s": 1.0},
    ],
)
def test_the_place_stays_the_same_if_a_later_edit_starts_earlier(apply: Apply, later: dict[str, object]) -> None:
    applied = apply(stop("120m", time_s=4.0, duration_s=2.0), later, builder=ALONE)
    assert standing_steps(applied, 120.0)
    assert values(applied)["stop at"].reached


def test_two_stops_are_two(apply: Apply) -> None:
    applied = apply(stop("120m", duration_s=1.0), stop("70m", duration_s=2.0), builder=ALONE)
    first, second = standing_steps(applied, 70.0), standing_steps(applied, 120.0)
    assert len(first) * 0.1 == pytest.approx(2.0, abs=0.5)
    assert len(second) * 0.1 == pytest.approx(1.0, abs=0.5)
    assert first[-1] < second[0]


def test_a_stop_cut_short_by_the_end_is_reported(apply: Apply) -> None:
    applied = apply(stop("150m", duration_s=30.0), builder=ALONE)
    assert not values(applied)["standing time"].reached
    assert applied.outcome.edits[0].done


def test_a_stop_that_is_not_reached_in_time_is_not_done(apply: Apply) -> None:
    applied = apply(stop("290m", duration_s=1.0), builder=ALONE)
    report = applied.outcome.edits[0]
    assert not report.done
    assert report.achieved[0].failed
    assert report.achieved[0].reason


@pytest.mark.parametrize("duration_s", [1.0, 6.0])
def test_a_stop_that_is_not_reached_in_time_names_a_place_that_is(apply: Apply, duration_s: float) -> None:
    late = apply(stop("290m", duration_s=duration_s), builder=ALONE).outcome.edits[0].achieved[0]
    place = re.search(r"at=(\d+) position=(\d+m)", late.reason)
    assert place is not None
    again = apply({**stop(place[2], duration_s=duration_s), "at": place[1]}, builder=ALONE).outcome.edits[0]
    assert again.done, again.achieved


def test_a_stop_too_short_to_stand_is_not_reported_as_out_of_time(apply: Apply) -> None:
    brief = apply(stop("120m", duration_s=0.1), builder=ALONE).outcome.edits[0]
    late = apply(stop("290m", duration_s=1.0), builder=ALONE).outcome.edits[0]
    assert (brief.done, late.done) == (False, False)
    assert brief.achieved[0].reason != late.achieved[0].reason


@pytest.mark.parametrize("position", ["10m", "25m"])
def test_a_place_behind_or_too_near_is_refused_with_one_that_works(apply: Apply, position: str) -> None:
    with pytest.raises(NotPossible) as refusal:
        apply(stop(position), builder=ALONE)
    assert "at=3" in refusal.value.valid
    better = refusal.value.remedies[0].changes[0].values
    assert apply({**stop(position), **better}, builder=ALONE).outcome.edits[0].done


def test_a_place_off_the_route_is_refused_with_the_lanelets_of_the_route(apply: Apply) -> None:
    with pytest.raises(NotPossible) as refusal:
        apply({**stop("50m"), "at": "1"}, builder=ALONE)
    assert list(refusal.value.valid) == ["at=3"]


def test_a_place_is_required(apply: Apply) -> None:
    with pytest.raises(InvalidRequest):
        apply({"op": "stop_at", "vehicles": ["34"]}, builder=ALONE)


def test_a_vehicle_behind_does_not_hit_the_one_that_stops(apply: Apply) -> None:
    follower = driving(32, (295, 7), 10.0, 201, heading_rad=np.pi)
    applied = apply(stop("80m", duration_s=5.0), builder=ALONE.with_vehicles(*ALONE.vehicles, follower))
    assert not applied.outcome.collisions
    assert applied.outcome.handed_over == (32,)
