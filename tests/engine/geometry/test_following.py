"""Places along lines that come back to themselves."""

import numpy as np
import pytest

from plannerforge.engine.geometry.following import PathFollower, project_along
from plannerforge.engine.geometry.polyline import Points, arc_length, project, project_all

RADIUS_M = 15.0
AROUND_M = 2 * np.pi * RADIUS_M


def two_laps(offset_m: float = 0.0) -> Points:
    """Two laps of a circle, points about 0.5 m apart; to the left (inside) by an offset."""
    angles = np.linspace(0.0, 4 * np.pi, 380)
    return (RADIUS_M - offset_m) * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def figure_of_eight() -> Points:
    """A line that crosses itself at a right angle."""
    angles = np.linspace(0.0, 2 * np.pi, 400)
    return np.stack([30.0 * np.sin(angles), 15.0 * np.sin(2 * angles)], axis=1)


@pytest.mark.parametrize("offset_m", [-2.0, 0.0, 2.0, 7.0])
def test_a_track_of_two_laps_has_stations_of_both(offset_m: float) -> None:
    stations, offsets = project_along(two_laps(), two_laps(offset_m), begin_m=0.0)
    assert np.all(np.diff(stations) > 0)
    assert stations[-1] == pytest.approx(2 * AROUND_M, abs=0.2)
    assert offsets == pytest.approx(np.full(len(offsets), offset_m), abs=0.01)


def test_the_start_decides_between_two_equal_laps() -> None:
    place = two_laps()[50:60]
    assert project_along(two_laps(), place)[0][0] == pytest.approx(50 * 2 * AROUND_M / 379, abs=0.1)
    second = project_along(two_laps(), place, begin_m=1.4 * AROUND_M)[0]
    assert second[0] == pytest.approx(50 * 2 * AROUND_M / 379 + AROUND_M, abs=0.1)


def test_a_line_that_crosses_itself_is_followed_straight_over_the_crossing() -> None:
    line = figure_of_eight()
    beside = line[2:] + 0.2
    stations = project_along(line, beside)[0]
    assert np.abs(np.diff(stations) - np.diff(arc_length(line[2:]))).max() < 0.5
    assert np.abs(np.diff(project_all(line, beside)[0])).max() > 10.0  # the nearest point leaps to the other branch


def test_on_a_line_that_never_comes_back_it_is_the_nearest_point() -> None:
    line = np.stack([np.arange(0.0, 200.0), 10.0 * np.sin(np.arange(0.0, 200.0) / 40.0)], axis=1)
    track = line[::4] + np.array([0.3, 1.5])
    together = project_along(line, track)
    alone = np.array([project(line, position) for position in track]).T
    assert together[0] == pytest.approx(alone[0], abs=1e-9)
    assert together[1] == pytest.approx(alone[1], abs=1e-9)


def test_a_standing_follower_stays_in_place() -> None:
    follower = PathFollower(two_laps(), begin_m=AROUND_M + 20.0)
    first = follower.place(two_laps(1.0)[230])
    assert all(follower.place(two_laps(1.0)[230]) == first for _ in range(5))
    assert first[0] > AROUND_M


def test_a_track_that_leaves_the_line_and_comes_back_is_found_again() -> None:
    line = np.stack([np.arange(0.0, 300.0), np.zeros(300)], axis=1)
    away = np.array([[0.0, 0.0], [10.0, 40.0], [250.0, 60.0], [290.0, 1.0]])
    assert project_along(line, away)[0] == pytest.approx([0.0, 10.0, 250.0, 290.0])


def test_a_line_of_one_segment_and_a_track_without_positions_are_accepted() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0]])
    assert project_along(line, np.array([[-3.0, 1.0], [13.0, 1.0]]))[0].tolist() == [0.0, 10.0]
    assert project_along(line, np.empty((0, 2)))[0].shape == (0,)


@pytest.mark.parametrize("begin_m", [None, 0.0, 60.0])
@pytest.mark.parametrize("spacing_m", [0.3, 40.0])
def test_places_of_a_whole_track_are_those_of_its_positions_one_by_one(begin_m: float | None, spacing_m: float) -> None:
    drawn = np.random.default_rng(7)
    turned = np.cumsum(drawn.normal(0.0, 0.2, 150))
    line = np.cumsum(np.stack([np.cos(turned), np.sin(turned)], axis=1) * spacing_m, axis=0)
    track = np.repeat(line[10:140] + drawn.normal(0.0, 3.0, (130, 2)), 2, axis=0)
    alone, together = PathFollower(line, begin_m), PathFollower(line, begin_m)
    assert together.places(track) == [alone.place(position) for position in track]
    assert together.place(track[0]) == alone.place(track[0])
