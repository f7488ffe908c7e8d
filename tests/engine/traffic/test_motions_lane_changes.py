import math

import numpy as np
import pytest

from plannerforge.engine.geometry.polyline import Points, Values, headings
from plannerforge.engine.traffic.motions import STEEPEST, on_wheels

COURSE_RAD = 0.6


def driven(along_m: Values, aside_m: Values) -> Points:
    """A track on a straight lane from what is rolled and slid in each step."""
    ahead, left = np.cumsum(along_m), np.cumsum(aside_m)
    cos, sin = math.cos(COURSE_RAD), math.sin(COURSE_RAD)
    return np.stack([ahead * cos - left * sin, ahead * sin + left * cos], axis=1)


def in_lane(track: Points) -> Points:
    """Metres along and left of the lane, shape (n, 2)."""
    cos, sin = math.cos(COURSE_RAD), math.sin(COURSE_RAD)
    return track @ np.array([[cos, -sin], [sin, cos]])


def test_a_lane_change_at_speed_stays_as_it_is() -> None:
    along, aside = np.full(60, 1.0), np.where(np.arange(60) < 30, 0.107, 0.0)
    track = driven(along, aside)
    assert on_wheels(track, along, aside) == pytest.approx(track, abs=1e-9)


def test_a_standing_vehicle_does_not_slide_into_the_next_lane() -> None:
    along = np.concatenate([np.full(20, 0.5), np.zeros(60)])
    aside = np.concatenate([np.zeros(20), np.full(30, 0.107), np.zeros(30)])
    made = in_lane(on_wheels(driven(along, aside), along, aside))
    assert np.abs(made[:, 1]).max() < 1e-9


def test_it_changes_the_lane_when_it_rolls_again() -> None:
    along = np.concatenate([np.full(20, 0.5), np.zeros(60), np.full(60, 0.5)])
    aside = np.concatenate([np.zeros(20), np.full(30, 0.107), np.zeros(90)])
    track = driven(along, aside)
    made = on_wheels(track, along, aside)
    turned = np.abs(headings(made[(np.arange(140) < 20) | (np.arange(140) >= 80)]) - COURSE_RAD)
    assert turned.max() <= math.atan(STEEPEST) + 1e-9
    assert made[-1] == pytest.approx(track[-1], abs=1e-6)


def test_a_vehicle_that_is_set_back_waits_there_instead_of_reversing() -> None:
    along, aside = np.full(60, 0.2), np.zeros(60)
    track = driven(along, aside)
    track[30:] -= 0.7 * np.array([math.cos(COURSE_RAD), math.sin(COURSE_RAD)])
    made = in_lane(on_wheels(track, along, aside))
    assert np.diff(made[:, 0]).min() >= 0.0
    assert made[-1] == pytest.approx(in_lane(track)[-1], abs=1e-6)


def test_a_vehicle_that_never_moves_stays_in_place() -> None:
    still = np.zeros(10)
    track = np.tile([3.0, 4.0], (10, 1))
    assert on_wheels(track, still, still) == pytest.approx(track)
