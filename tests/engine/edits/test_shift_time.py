"""Edit T: shift_time."""

from typing import Any

import numpy as np
import pytest
from support.builders import ScenarioBuilder, driving, town_road
from support.edits import Apply, schema_errors

from plannerforge.schemas.errors import InvalidRequest, NotPossible

ONCOMING = {"op": "shift_time", "vehicles": ["34"]}


@pytest.mark.parametrize("version", ["2018b", "2020a"])
@pytest.mark.parametrize("shift_s", [2.0, -2.0])
def test_the_recording_is_driven_at_another_time(apply: Apply, shift_s: float, version: str) -> None:
    from dataclasses import replace

    applied = apply(ONCOMING | {"time_s": shift_s}, builder=replace(town_road(), version=version))
    old, new = applied.base_tracks()[34], applied.tracks()[34]
    steps = round(shift_s / 0.1)
    for step in range(new.first_step, new.last_step + 1, 10):
        assert new.positions[step - new.first_step] == pytest.approx(old.positions[step - steps])
    assert (new.first_step, new.last_step) == ((20, 150) if steps > 0 else (0, 130))
    assert applied.changed_elements() == {"34"}


def test_the_file_keeps_to_the_schema(apply: Apply) -> None:
    applied = apply(ONCOMING | {"time_s": -3})
    assert schema_errors(applied.xml) <= schema_errors(applied.base)


def test_an_entry_after_time_0_has_no_form_in_the_schema_and_is_written_with_a_note(apply: Apply) -> None:
    added = {"op": "add_vehicle", "vehicle_class": "car", "at": "3", "position": "middle", "time_s": 2.0}
    applied = apply(ONCOMING | {"time_s": 1}, added)
    assert [applied.tracks()[key].first_step for key in (34, 101)] == [10, 20]
    assert len(schema_errors(applied.xml) - schema_errors(applied.base)) > 0
    said = "34 enters at 1.0 s, 101 enters at 2.0 s: CommonRoad's schema requires time 0"
    assert any(text.startswith(said) for text in applied.outcome.warnings)


def test_vehicles_that_enter_at_one_time_are_reported_together(apply: Apply) -> None:
    (told,) = apply({"op": "shift_time", "vehicles": ["31", "34"], "time_s": 1}).outcome.warnings
    assert told.startswith("31, 34 enter at 1.0 s: ")


def test_two_shifts_add_up_and_lose_no_states(apply: Apply) -> None:
    applied = apply(ONCOMING | {"time_s": -3}, ONCOMING | {"time_s": 3})
    assert np.array_equal(applied.tracks()[34].positions, applied.base_tracks()[34].positions)


def test_two_that_overlap_in_the_recording_still_do_if_moved_alike(apply: Apply) -> None:
    overlapping = town_road().with_vehicles(driving(31, (60, 0), 10.0, 101), driving(32, (58, 0), 10.0, 101))
    both = {"op": "shift_time", "vehicles": ["31", "32"], "time_s": 2}
    applied = apply(both, builder=overlapping, on_conflict="refuse")
    assert applied.outcome.collisions == ()
    assert applied.outcome.handed_over == ()


def follower_and_leader(follower_mps: float) -> ScenarioBuilder:
    """33 begins 20 m behind 32, which drives 10 m/s; the ego begins on the lane beside."""
    west = np.pi
    return town_road().with_vehicles(
        driving(33, (260, 7), follower_mps, 101, heading_rad=west), driving(32, (240, 7), 10.0, 101, heading_rad=west)
    )


def shifted(vehicle: str, time_s: float) -> dict[str, Any]:
    return {"op": "shift_time", "vehicles": [vehicle], "time_s": time_s}


def test_a_vehicle_about_to_collide_is_driven_from_then_on_with_a_note(apply: Apply) -> None:
    outcome = apply(shifted("33", -1), builder=follower_and_leader(12.0)).outcome
    assert outcome.collisions == ()
    assert outcome.handed_over == (32,)
    touched = {one.vehicle_id: one for one in outcome.touched}[33]
    assert (touched.cause, touched.from_time_s) == ("shifted", 0.0)
    assert touched.handover_jump_m is not None
    assert outcome.edits[0].what == (
        "vehicle 33 drives 1 s earlier than recorded; 33 is driven from 0.0 s: its recording would hit vehicle 32 at "
        "1.8 s"
    )


@pytest.mark.parametrize(
    ("edits", "moved", "other", "begins_s"),
    [
        ([shifted("33", -2)], 33, 32, 0.0),
        ([shifted("32", 2)], 32, 33, 2.0),
        ([shifted("32", 2), {"op": "set_speed", "vehicles": ["32"], "speed": "3m/s"}], 32, 33, 2.0),
    ],
)
def test_a_shift_onto_a_vehicle_is_refused_with_the_nearest_ones_that_fit(
    apply: Apply, edits: list[dict[str, Any]], moved: int, other: int, begins_s: float
) -> None:
    road = follower_and_leader(10.0)
    reason = f"vehicle {moved} would overlap vehicle {other} at {begins_s} s"
    with pytest.raises(NotPossible, match=reason) as caught:
        apply(*edits, builder=road)
    assert len(caught.value.valid) == 2
    for fitting in caught.value.valid:
        time_s = float(fitting.removeprefix("time_s="))
        assert apply(edits[0] | {"time_s": time_s}, builder=road).outcome.collisions == ()


def test_a_shift_beyond_the_scenario_is_refused_with_the_largest_one_that_starts_clear(apply: Apply) -> None:
    road = follower_and_leader(10.0)
    with pytest.raises(InvalidRequest) as caught:
        apply(shifted("32", 60), builder=road)
    (fitting,) = caught.value.valid
    assert apply(shifted("32", float(fitting.removeprefix("time_s="))), builder=road).outcome.collisions == ()


def test_a_shift_onto_the_ego_is_refused(apply: Apply) -> None:
    behind = town_road().with_vehicles(driving(31, (20, 0), 10.0, 101))
    with pytest.raises(NotPossible, match=r"vehicle 31 would overlap the ego at 0\.0 s"):
        apply(shifted("31", -2), builder=behind)


def test_a_shifted_vehicle_is_reported_and_no_longer_untouched(apply: Apply) -> None:
    outcome = apply(ONCOMING | {"time_s": 1}).outcome
    assert [(one.vehicle_id, one.cause, one.from_time_s) for one in outcome.touched] == [(34, "shifted", 1.0)]
    assert outcome.untouched == 4


def test_a_shifted_vehicle_can_be_edited_further(apply: Apply) -> None:
    eco = {"op": "set_behaviour", "vehicles": ["34"], "preset": "eco"}
    applied = apply(ONCOMING | {"time_s": 2}, eco)
    track = applied.tracks()[34]
    assert track.first_step == 20
    assert track.positions[0] == pytest.approx(applied.base_tracks()[34].positions[0])


def test_a_vehicle_that_drives_already_is_not_shifted(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="recording"):
        apply({"op": "set_behaviour", "vehicles": ["34"], "preset": "eco"}, ONCOMING | {"time_s": 2})


def test_an_added_vehicle_is_not_shifted(apply: Apply) -> None:
    add = {"op": "add_vehicle", "vehicle_class": "car", "at": "13"}
    with pytest.raises(NotPossible, match="101 is not recorded"):
        apply(add, {"op": "shift_time", "vehicles": ["new:0"], "time_s": 2})


@pytest.mark.parametrize(("time_s", "reason"), [(40.0, "leave nothing"), (0.0, "needs a time_s"), (None, "needs")])
def test_a_shift_that_leaves_no_states_is_refused(apply: Apply, time_s: float | None, reason: str) -> None:
    with pytest.raises(InvalidRequest, match=reason):
        apply(ONCOMING | {"time_s": time_s})
