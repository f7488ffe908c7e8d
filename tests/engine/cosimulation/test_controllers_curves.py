"""A vehicle is slow in the bend of a long lane, and not all along it."""

import math

import numpy as np
import pytest
from support.builders import Lane, ScenarioBuilder, arc, driving, line
from support.edits import Apply

from plannerforge.engine.network.sumo_export.speeds import slow_places

RADIUS_M = 20.0
BEFORE, BEND, AFTER = line((0, 0), (200, 0)), arc((200, 20), RADIUS_M, -math.pi / 2, 0), line((220, 20), (220, 160))
ASIDE = Lane(9, line((0, -50), (300, -50)))


def whole() -> tuple[Lane, ...]:
    """The bend lies in the middle of one lanelet."""
    center = np.concatenate([BEFORE, BEND[1:], AFTER[1:]])
    return Lane(1, center, successors=(2,)), Lane(2, line((220, 160), (220, 260)), predecessors=(1,)), ASIDE


def in_two() -> tuple[Lane, ...]:
    """The bend lies at the beginning of the second lanelet."""
    return (Lane(1, BEFORE, successors=(2,)), Lane(2, np.concatenate([BEND, AFTER[1:]]), predecessors=(1,)), ASIDE)


@pytest.mark.parametrize("lanes", [whole(), in_two()])
def test_a_vehicle_slows_down_for_the_curve_alone(apply: Apply, lanes: tuple[Lane, ...]) -> None:
    builder = ScenarioBuilder(lanes, (driving(31, (100, 0), 13.0, 60), driving(32, (10, -50), 1.0, 201)))
    applied = apply({"op": "reroute", "vehicles": ["31"], "to": ["2"]}, builder=builder)
    track = applied.tracks()[31]
    before = track.speeds_mps[track.positions[:, 0] < 150]
    bend = track.speeds_mps[(track.positions[:, 0] > 203) & (track.positions[:, 1] < 17)]
    after = track.speeds_mps[track.positions[:, 1] > 80]
    assert before.min() > 11.0
    assert len(bend) > 0
    assert 7.0 < bend.max() < 1.15 * math.sqrt(4.0 * RADIUS_M)
    assert after.max() > 11.0
    assert np.diff(track.speeds_mps).min() > -0.6
    assert applied.outcome.touched[0].feasible


def test_an_ordered_speed_is_kept_before_the_curve_and_given_up_in_it(apply: Apply) -> None:
    builder = ScenarioBuilder(whole(), (driving(31, (60, 0), 13.0, 60), driving(32, (10, -50), 1.0, 201)))
    track = apply({"op": "set_speed", "vehicles": ["31"], "speed": "16m/s"}, builder=builder).tracks()[31]
    assert track.speeds_mps[track.positions[:, 0] < 160].max() > 15.0
    assert track.speeds_mps[(track.positions[:, 0] > 205) & (track.positions[:, 1] < 15)].max() < 11.0


@pytest.mark.parametrize(("recorded_mps", "expected_mps"), [(5.0, 8.9), (11.0, 11.0), (20.0, 12.6)])
def test_a_curve_with_a_recording_is_driven_within_the_tyres_limits(recorded_mps: float, expected_mps: float) -> None:
    center = np.array(whole()[0].center)
    places = slow_places(center, 25.0, [(214.0, recorded_mps)])
    in_bend = (places.stations_m > 212) & (places.stations_m < 218)
    assert places.speeds_mps[in_bend] == pytest.approx(expected_mps, abs=0.3)
    assert (places.speeds_mps <= places.hardest_mps).all()


def test_a_kink_that_was_recorded_at_speed_slows_no_vehicle(apply: Apply) -> None:
    kinked = Lane(1, (*line((0, 0), (200, 0)), *line((202, 0.15), (400, 15.0))), successors=())
    fast = ScenarioBuilder((kinked,), (driving(31, (120, 0), 30.0, 31), driving(32, (60, 0), 30.0, 61)))
    track = apply({"op": "set_behaviour", "vehicles": ["32"], "params": ["sigma=0"]}, builder=fast).tracks()[32]
    assert track.speeds_mps.min() > 28.0


def test_a_car_that_is_added_before_the_curve_enters_at_the_speed_of_the_straight(apply: Apply) -> None:
    builder = ScenarioBuilder(whole(), (driving(32, (10, -50), 1.0, 41),))
    applied = apply({"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "50m"}, builder=builder)
    (added,) = applied.outcome.edits[0].vehicles
    assert applied.tracks()[added].speeds_mps[0] == pytest.approx(0.8 * 13.89, abs=0.1)
