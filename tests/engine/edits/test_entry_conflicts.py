"""An added vehicle whose speed was left open does not enter into somebody who cannot brake for it."""

import math

import pytest
from support.builders import Lane, ScenarioBuilder, crossing, driving, line
from support.edits import Apply

from plannerforge.schemas.errors import NotPossible

TWO_WAY = (Lane(1, line((0, 0), (300, 0)), left=(2, False)), Lane(2, line((300, 3.5), (0, 3.5)), left=(1, False)))
CUTS_THE_CORNER = driving(31, (90.0, 0.5), 12.0, 101, heading_rad=math.pi - 0.1)
TRUCK = {"op": "add_vehicle", "vehicle_class": "truck", "at": "1", "position": "60m"}

CROSSES = crossing().with_vehicles(driving(31, (-8.0, 0.0), 20.0, 40))
BICYCLE = {"op": "add_vehicle", "vehicle_class": "bicycle", "at": "5"}


@pytest.mark.parametrize(
    ("added", "builder", "usual", "slower"),
    [
        (TRUCK, ScenarioBuilder(TWO_WAY, (CUTS_THE_CORNER,)), "11.1", "0.0"),
        (BICYCLE | {"position": "7m"}, CROSSES, "5.6", "2.8"),
    ],
)
def test_it_enters_more_slowly_if_it_would_collide_at_once(
    apply: Apply, added: dict[str, object], builder: ScenarioBuilder, usual: str, slower: str
) -> None:
    applied = apply(added, builder=builder)
    assert applied.outcome.collisions == ()
    assert float(applied.tracks()[101].speeds_mps[0]) == pytest.approx(float(slower))
    assert f"{float(slower):g} m/s from 0 s" in applied.outcome.edits[0].what
    why = "because it would collide with vehicle 31"
    assert f"vehicle 101 enters with {slower} instead of {usual} m/s, {why}" in applied.outcome.warnings


def test_a_speed_that_was_named_is_kept_and_the_collision_reported(apply: Apply) -> None:
    applied = apply(BICYCLE | {"position": "7m", "speed": "5.5m/s"}, builder=CROSSES)
    assert [set(hit.vehicles) for hit in applied.outcome.collisions] == [{31, 101}]
    assert float(applied.tracks()[101].speeds_mps[0]) == pytest.approx(5.5)
    assert applied.outcome.warnings == ()


def test_a_place_too_close_for_crossing_traffic_is_refused_with_the_time_that_works(apply: Apply) -> None:
    added = BICYCLE | {"position": "9m"}
    with pytest.raises(NotPossible, match=r"hit by vehicle 31, .* 20\.0 m/s") as caught:
        apply(added, builder=CROSSES)
    (time_s,) = (float(one.removeprefix("time_s=")) for one in caught.value.valid if one.startswith("time_s="))
    applied = apply(added | {"time_s": time_s}, builder=CROSSES)
    assert applied.outcome.collisions == ()
    assert f"from {time_s:.1f} s" in applied.outcome.edits[0].what


def test_a_place_that_crossing_traffic_can_brake_for_is_not_refused(apply: Apply) -> None:
    slow = crossing().with_vehicles(driving(31, (-8.0, 0.0), 3.0, 40))
    assert apply(BICYCLE | {"position": "9m"}, builder=slow).outcome.edits[0].done


def test_a_vehicle_behind_that_turns_off_before_the_place_does_not_keep_it(apply: Apply) -> None:
    fork = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 3)),
        Lane(2, line((100, 0), (300, 0)), predecessors=(1,)),
        Lane(3, line((100, 0), (280, 66)), predecessors=(1,)),
    )
    turning, straight_on = (driving(31, (79.0, 0.0), 25.0, 31, heading_rad=angle) for angle in (0.35, 0.0))
    standing = driving(32, (121.0, 0.0), 0.0, 31)
    added = {"op": "add_vehicle", "vehicle_class": "car", "at": "2", "position": "13m"}
    with pytest.raises(NotPossible, match="hit by vehicle 31"):
        apply(added, builder=ScenarioBuilder(fork, (straight_on, standing), problems=()))
    assert apply(added, builder=ScenarioBuilder(fork, (turning, standing), problems=())).outcome.edits[0].done
