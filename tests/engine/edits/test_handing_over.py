"""A replayed vehicle that would run into an edited one is handed over too; what is left is reported."""

import numpy as np
import pytest
from support.builders import Lane, Problem, ScenarioBuilder, driving, line, town_road
from support.edits import Apply

from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.edits.edited_scene import Overlap, new_overlaps
from plannerforge.schemas.errors import NotPossible

BRAKES = {"op": "set_behaviour", "vehicles": ["31"], "params": ["speedFactor=0.2"]}
PAIR = town_road().with_vehicles(driving(31, (60, 0), 10.0, 101), driving(32, (35, 0), 10.0, 101))


def test_a_follower_that_would_hit_is_handed_over_and_reported(apply: Apply) -> None:
    applied = apply(BRAKES, builder=PAIR)
    assert applied.outcome.handed_over == (32,)
    assert applied.outcome.collisions == ()
    assert applied.changed_elements() == {"31", "32"}


def test_a_follower_far_behind_stays_as_recorded(apply: Apply) -> None:
    far = town_road().with_vehicles(driving(31, (150, 0), 10.0, 101), driving(32, (5, 0), 1.0, 101))
    applied = apply(BRAKES, builder=far)
    assert applied.outcome.handed_over == ()
    assert applied.changed_elements() == {"31"}


def test_a_remaining_collision_is_reported_or_refused(apply: Apply) -> None:
    walker = driving(36, (75, 0), 0.1, 101, kind="pedestrian", size_m=(0.6, 0.6))
    rushing = town_road().with_vehicles(driving(31, (62, 3.5), 14.0, 101), walker)
    into = {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "66m", "speed": "14m/s"}
    applied = apply(into, builder=rushing)
    assert [hit.vehicles for hit in applied.outcome.collisions] == [(101, 36)]
    with pytest.raises(NotPossible, match="101 with 36") as caught:
        apply(into, builder=rushing, on_conflict="refuse")
    assert "on_conflict=report" in caught.value.next_step


def test_overlaps_of_the_recording_are_blamed_on_no_edit(apply: Apply) -> None:
    overlapping = town_road().with_vehicles(driving(31, (60, 0), 10.0, 101), driving(32, (58, 0), 10.0, 101))
    applied = apply({"op": "set_behaviour", "vehicles": ["31"], "preset": "balanced"}, builder=overlapping)
    assert applied.outcome.collisions == ()


def test_two_that_overlap_once_in_the_recording_can_collide_later() -> None:
    def moving(key: int, places_m: list[float]) -> Track:
        still = np.zeros(len(places_m))
        return Track(key, "car", 4.0, 2.0, 0, np.array([[x, 0.0] for x in places_m]), still, still)

    one, apart = moving(1, [0.0] * 60), [50.0] * 5
    recorded = {1: one, 2: moving(2, apart + [3.0] * 5 + [50.0] * 50)}
    prolonged = moving(2, apart + [3.0] * 20 + [50.0] * 35)
    again = moving(2, apart + [3.0] * 5 + [50.0] * 30 + [3.0] * 20)
    assert new_overlaps([one], [prolonged], recorded) == ()
    assert new_overlaps([one], [again], recorded) == (Overlap(1, 2, 40),)


def test_a_queue_that_builds_up_behind_is_handed_over_to_its_end(apply: Apply) -> None:
    queue = [driving(key, (130 - 12 * place, 0), 10.0, 60) for place, key in enumerate(range(31, 39))]
    applied = apply(BRAKES, builder=town_road().with_vehicles(*queue))
    assert applied.outcome.handed_over == (32, 33, 34, 35, 36, 37, 38)
    assert applied.outcome.collisions == ()


def test_a_vehicle_that_keeps_its_recording_although_all_should_react_is_named(apply: Apply) -> None:
    walker = driving(36, (75, 5), 0.5, 101, kind="pedestrian", size_m=(0.6, 0.6))
    last = driving(37, (20, 3.5), 8.0, 2, first_step=99)
    applied = apply(
        {"op": "set_behaviour", "vehicles": ["31"], "preset": "balanced"},
        builder=town_road().with_vehicles(driving(31, (60, 0), 10.0, 101), walker, last),
        traffic="reactive",
    )
    assert "vehicle 36 keeps its recording, because SUMO cannot drive it" in applied.outcome.warnings
    assert any(text.startswith("vehicle 37 keeps its recording") for text in applied.outcome.warnings)


def test_no_vehicle_runs_into_a_queue_that_the_ego_would_pass_through(apply: Apply) -> None:
    """The ego of the recording drives on where a slow bicycle is now, through it and the queue behind it."""
    road = (Lane(1, line((0, 0), (600, 0))),)
    ahead_and_behind = (driving(31, (60, 0), 12.0, 151), driving(32, (20, 0), 12.0, 151))
    builder = ScenarioBuilder(road, ahead_and_behind, problems=(Problem(goal=(500.0, 0.0, 8.0, 3.0)),))
    slow = {"op": "add_vehicle", "vehicle_class": "bicycle", "at": "1", "position": "100m", "speed": "1m/s"}
    applied = apply(slow, builder=builder)
    assert applied.outcome.handed_over == (31, 32)
    assert applied.outcome.collisions == ()
