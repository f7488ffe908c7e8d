"""Gap, time to collision, time headway and risk of a drive that is known by hand."""

import math

import numpy as np
import pytest

from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.criticality import drive_criticality, risk_scores
from plannerforge.engine.geometry.polyline import Points, Values


def driven(positions: Points, headings_rad: Values, speed_mps: float, first_step: int = 0) -> Track:
    return Track(1, "car", 4.0, 2.0, first_step, positions, headings_rad, np.full(len(positions), speed_mps))


def straight(speed_mps: float = 10.0, steps: int = 10, first_step: int = 0) -> Track:
    positions = np.array([(i * 0.1 * speed_mps, 0.0) for i in range(steps + 1)])
    return driven(positions, np.zeros(steps + 1), speed_mps, first_step)


def track(x: float, y: float, speed_mps: float, heading: float = 0.0, steps: int = 10, first_step: int = 0) -> Track:
    direction = np.array([math.cos(heading), math.sin(heading)])
    positions = np.array([x, y]) + np.arange(steps + 1)[:, None] * 0.1 * speed_mps * direction
    count = len(positions)
    return Track(7, "car", 5.0, 2.0, first_step, positions, np.full(count, heading), np.full(count, speed_mps))


def measured(ego: Track, *moving: Track, standing: tuple[Track, ...] = ()) -> tuple[float | None, ...]:
    found = drive_criticality(ego, moving, standing)
    return (found.minimum_distance_m, found.minimum_time_to_collision_s, found.minimum_time_headway_s, found.risk_score)


def test_a_slower_lead_is_nearest_at_the_end() -> None:
    # after 1 s: the centres 30 m apart, the bodies 25.5 m, closing at 5 m/s; front to front 30.5 m at 10 m/s
    assert measured(straight(), track(35.0, 0.0, 5.0)) == pytest.approx((25.5, 5.1, 3.05, 5))


def test_a_lead_that_is_about_to_be_hit_is_extreme_risk() -> None:
    gap, time, headway, risk = measured(straight(), track(20.0, 0.0, 5.0, steps=10), track(15.2, 0.0, 0.0))
    assert (gap, time) == pytest.approx((0.7, 0.07))
    assert headway == pytest.approx(0.57)
    assert risk == 1


@pytest.mark.parametrize(
    "other",
    [track(-20.0, 0.0, 12.0), track(20.0, 3.5, 10.0), track(30.0, 0.5, 10.0, heading=math.pi)],
    ids=["behind", "in the next lane", "oncoming"],
)
def test_only_a_vehicle_ahead_in_the_path_gives_a_headway(other: Track) -> None:
    assert measured(straight(), other)[2] is None


def test_a_leader_beyond_a_curve_is_ahead_on_the_driven_path_not_along_the_heading() -> None:
    angles = np.linspace(0.0, math.pi / 2, 21)
    bend = driven(20.0 * np.column_stack([np.sin(angles), 1 - np.cos(angles)]), angles, 10.0)
    lead = track(20.0, 20.0, 0.0, heading=math.pi / 2, steps=5)
    arc = np.linalg.norm(np.diff(bend.positions[5:], axis=0), axis=1).sum()
    assert measured(bend, lead)[2] == pytest.approx((arc + 0.5) / 10.0, abs=0.01)


def test_without_others_near_every_figure_is_undefined() -> None:
    assert measured(straight()) == (None,) * 4
    assert measured(straight(), track(200.0, 0.0, 0.0)) == (None,) * 4
    assert measured(straight(), track(20.0, 0.0, 0.0, first_step=50)) == (None,) * 4


def test_standing_obstacles_count_at_every_step_and_an_overlap_is_a_collision() -> None:
    states = straight(first_step=40)
    assert measured(states, standing=(track(9.0, 0.0, 0.0, steps=0),))[:2] == (0.0, 0.0)
    assert measured(states, standing=(track(9.0, 0.0, 0.0, steps=0),))[3] == 0


def test_a_standing_ego_has_no_headway() -> None:
    assert measured(straight(0.0), track(10.0, 0.0, 0.0))[2] is None


@pytest.mark.parametrize(
    ("gap", "time", "score"),
    [
        (0.0, 0.0, 0),
        (0.4, 0.5, 1),
        (0.9, 1.0, 2),
        (2.9, 3.0, 3),
        (4.0, 4.9, 4),
        (5.1, 5.1, 5),
        (9.0, math.inf, 5),
        (0.6, math.inf, 3),
        (9.0, 0.3, 3),
    ],
)
def test_risk_is_the_mean_of_a_distance_and_a_time_level(gap: float, time: float, score: int) -> None:
    assert risk_scores(np.array([gap]), np.array([time]))[0] == score


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_a_vehicle_at_the_same_place_is_not_ahead_despite_rounding(turns: int) -> None:
    ego = straight()
    ego = driven(ego.positions, ego.headings_rad + turns * 2 * math.pi, 10.0)
    assert measured(ego, track(1e-9, 0.5, 10.0))[2] is None
