"""What the sensors of an imperfect world report of road users whose truth is known."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from plannerforge.engine.commonroad import Track
from plannerforge.engine.perception import Percept, Sensors
from plannerforge.engine.perception.randomness import Slow, Stretches, stream
from plannerforge.engine.planners.interface import EgoState
from plannerforge.schemas.worlds import World

STEP_S, STEPS = 0.1, 60


@dataclass(frozen=True)
class _Users:
    moving: tuple[Track, ...] = ()
    standing: tuple[Track, ...] = ()


def _track(key: int, start: Sequence[float], speed_mps: float = 0.0, kind: str = "car", steps: int = STEPS) -> Track:
    x = start[0] + np.arange(steps) * STEP_S * speed_mps
    positions = np.stack([x, np.full(steps, float(start[1]))], axis=1)
    return Track(key, kind, 4.5, 1.8, 0, positions, np.zeros(steps), np.full(steps, speed_mps))


def _egos(last: int = STEPS - 1, speed_mps: float = 0.0) -> list[EgoState]:
    return [EgoState(step, np.array([step * STEP_S * speed_mps, 0.0]), 0.0, speed_mps) for step in range(last + 1)]


def _drive(world: World, users: _Users, seed: int = 0, every: int = 3) -> tuple[list[Percept], Sensors]:
    sensors, egos = Sensors(world, seed, STEP_S), _egos()
    return [sensors.perceive(users, egos[: step + 1]) for step in range(0, STEPS, every)], sensors


def _places(percepts: Sequence[Percept], key: int) -> list[list[float]]:
    return [one.positions[0].tolist() for percept in percepts for one in percept.moving if one.obstacle_id == key]


def test_sensors_without_an_imperfection_report_the_truth() -> None:
    users = _Users((_track(5, (20, 0), 3.0),), (_track(6, (30, 5), steps=1),))
    percepts, _ = _drive(World(), users)
    assert _places(percepts, 5) == users.moving[0].positions[::3].tolist()
    assert all(one.standing[0].positions.tolist() == [[30.0, 5.0]] for one in percepts)
    assert all(one.moving[0].first_step == 3 * index for index, one in enumerate(percepts))


@pytest.mark.parametrize(
    ("world", "start", "code"),
    [
        (World(range_m=30), (40, 0), "out_of_range"),
        (World(view_deg=120), (-20, 0), "out_of_view"),
        (World(visible=0.2), (40, 0), "occluded"),
        (World(missed=1), (20, 0), "missed"),
    ],
)
def test_a_road_user_that_is_not_detected_is_not_reported_and_the_reason_is_kept(
    world: World, start: tuple[float, float], code: str
) -> None:
    users = _Users(
        (_track(5, start), _track(12, (30, 40))), (_track(7, (15, 0), steps=1),) if code == "occluded" else ()
    )
    percepts, sensors = _drive(world, users)
    assert not _places(percepts, 5)
    sightings = [one for one in sensors.perceived().sightings if one.obstacle_id == 5]
    assert [(one.step, one.code) for one in sightings] == [(0, code)]
    assert sightings[0].by == (7 if code == "occluded" else None)


def test_a_road_user_that_comes_out_from_behind_another_is_reported_from_then_on() -> None:
    hidden, truck = _track(5, (30, 0)), _track(12, (15, 0), 5.0)
    users = _Users((hidden, truck))
    percepts, sensors = _drive(World(visible=0.2), users)
    changes = [(one.code, one.by) for one in sensors.perceived().sightings if one.obstacle_id == 5]
    assert changes[0] == ("occluded", 12)
    assert changes[1] == ("seen", None)
    assert 0 < len(_places(percepts, 5)) < len(percepts)


def test_latency_reports_an_earlier_state_and_never_one_before_the_run() -> None:
    users = _Users((_track(5, (20, 0), 10.0),))
    percepts, _ = _drive(World(latency_s=0.4), users, every=1)
    expected = [users.moving[0].positions[max(step - 4, 0)].tolist() for step in range(STEPS)]
    assert _places(percepts, 5) == expected


def test_a_lost_frame_leaves_the_frame_before() -> None:
    users = _Users((_track(5, (20, 0), 10.0),))
    percepts, _ = _drive(World(dropped=0.5), users, every=1)
    ages = [step - round((x - 20) / (10 * STEP_S)) for step, (x, _) in enumerate(_places(percepts, 5))]
    assert ages[0] == 0
    assert {0, 1} <= set(ages)
    assert all(later in (0, earlier + 1) for earlier, later in itertools.pairwise(ages))


def test_a_new_road_user_is_reported_only_once_it_is_confirmed_and_kept_for_a_while_when_it_is_hidden() -> None:
    users = _Users((_track(5, (50, 0), -10.0),))
    confirmed, sensors = _drive(World(range_m=40, confirmed_s=0.3), users, every=1)
    found = [(one.step, one.code) for one in sensors.perceived().sightings]
    assert found == [(0, "out_of_range"), (10, "unconfirmed"), (13, "seen")]
    assert len(_places(confirmed, 5)) == STEPS - 13
    leaving = _Users((_track(5, (35, 0), 10.0),))
    kept, sensors = _drive(World(range_m=40, kept_s=0.2), leaving, every=1)
    found = [(one.step, one.code) for one in sensors.perceived().sightings]
    assert found == [(0, "seen"), (6, "kept"), (8, "out_of_range")]
    assert _places(kept, 5) == pytest.approx(leaving.moving[0].positions[:8])


def test_errors_have_the_stated_deviation_and_do_not_depend_on_other_road_users() -> None:
    world = World(position_m=0.5, speed_mps=0.3, heading_deg=10)
    alone, _ = _drive(world, _Users((_track(5, (20, 0)),)), every=1)
    among, _ = _drive(world, _Users((_track(4, (10, 9)), _track(5, (20, 0)), _track(8, (40, -9)))), every=1)
    assert _places(alone, 5) == _places(among, 5)
    errors = [
        np.array(_places(_drive(world, _Users((_track(key, (20, 0)),)), every=1)[0], key)) - (20, 0)
        for key in range(10, 30)
    ]
    assert np.std(np.concatenate(errors)) == pytest.approx(0.5, rel=0.05)


def test_one_part_of_the_sensors_does_not_change_the_numbers_of_another() -> None:
    users = _Users((_track(5, (20, 0)),))
    with_noise, _ = _drive(World(position_m=0.5), users)
    with_both, _ = _drive(World(position_m=0.5, missed=0.5, ghosts=2, localisation_m=0.0, dropped=0.0), users)
    assert set(map(tuple, _places(with_both, 5))) < set(map(tuple, _places(with_noise, 5)))


def test_the_same_seed_gives_the_same_reports_and_another_seed_others() -> None:
    users, world = _Users((_track(5, (20, 0), 3.0),)), World(position_m=0.5, ghosts=1, missed=0.3, localisation_m=0.2)
    first, again, other, by_world = (
        _drive(one, users, seed=seed)[1].perceived()
        for one, seed in ((world, 1), (world, 1), (world, 2), (world.model_copy(update={"seed": 1}), 1))
    )
    assert first == again
    assert other not in (first, by_world)
    assert by_world != first


def test_the_direction_of_a_fast_road_user_is_known_better_than_that_of_a_standing_one() -> None:
    world = World(speed_mps=0.2, heading_deg=10)
    errors = {}
    for speed_mps in (0.0, 20.0):
        headings = [
            float(one.headings_rad[0])
            for key in range(20)
            for percept in _drive(world, _Users((_track(key, (20, 0), speed_mps if key % 2 else -speed_mps),)))[0]
            for one in percept.moving
        ]
        errors[speed_mps] = np.std(headings)
    assert errors[0.0] == pytest.approx(math.radians(10), rel=0.15)
    assert errors[20.0] < math.radians(1)


def test_ghosts_are_as_many_as_stated_on_average_and_in_the_field_of_view() -> None:
    world = World(ghosts=2, ghosts_s=0.5, range_m=40, view_deg=90)
    percepts = [percept for seed in range(30) for percept in _drive(world, _Users(), seed=seed, every=1)[0]]
    assert np.mean([len(percept.moving) for percept in percepts]) == pytest.approx(2, rel=0.15)
    places = np.array([one.positions[0] for percept in percepts for one in percept.moving])
    assert (np.hypot(*places.T) <= 40).all()
    assert (np.abs(np.arctan2(places[:, 1], places[:, 0])) <= math.pi / 4 + 1e-9).all()
    assert all(one.obstacle_id < -1 for percept in percepts for one in percept.moving)


def test_a_confused_class_stays_the_same_over_the_run() -> None:
    users = _Users(tuple(_track(key, (20, key), kind="pedestrian") for key in range(-20, 20)))
    percepts, _ = _drive(World(confused=0.5), users)
    by_key = {
        key: {one.kind for percept in percepts for one in percept.moving if one.obstacle_id == key}
        for key in range(-20, 20)
    }
    assert all(len(kinds) == 1 for kinds in by_key.values())
    assert 10 <= sum(kinds == {"bicycle"} for kinds in by_key.values()) <= 30


def test_a_localisation_error_moves_the_road_users_with_the_ego() -> None:
    users = _Users((_track(5, (20, 4)),))
    percepts, sensors = _drive(World(localisation_m=0.5, localisation_deg=5), users)
    perceived = sensors.perceived()
    for index, percept in enumerate(percepts):
        believed = np.array([perceived.ego_x_m[index], perceived.ego_y_m[index]])
        turn = perceived.ego_heading_rad[index]
        apart = percept.moving[0].positions[0] - believed
        seen = np.array([apart @ (math.cos(turn), math.sin(turn)), apart @ (-math.sin(turn), math.cos(turn))])
        assert seen == pytest.approx([20, 4])
        assert percept.error is not None
        back = percept.error.true(percept.error.believed(np.array([7.0, 8.0]), np.zeros(2)), np.zeros(2))
        assert back == pytest.approx([7, 8])


def test_slow_errors_keep_their_deviation_and_their_correlation_over_blocks() -> None:
    drawn = np.array(
        [
            [Slow(stream((0, 0), "estimate", key), 1, 0.9).at(index)[0] for index in (62, 63, 64, 65)]
            for key in range(3000)
        ]
    )
    assert drawn.std(axis=0) == pytest.approx(np.ones(4), rel=0.05)
    for at in range(3):
        assert np.corrcoef(drawn[:, at], drawn[:, at + 1])[0, 1] == pytest.approx(0.9, abs=0.02)


def test_misses_take_their_share_of_time_in_stretches_of_their_mean_duration() -> None:
    chain = Stretches(stream((0, 0), "missed", 1), 0.2, 5.0)
    values = [chain.at(index) for index in range(40_000)]
    begun = sum(later and not earlier for earlier, later in itertools.pairwise(values))
    assert np.mean(values) == pytest.approx(0.2, abs=0.02)
    assert sum(values) / begun == pytest.approx(5.0, rel=0.1)
