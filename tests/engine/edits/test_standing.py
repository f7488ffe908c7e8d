"""A vehicle that is put in with speed 0 stands until another edit sends it on; a speed that is not reached is told."""

import pytest
from support.builders import driving, town_road
from support.edits import Apply

PARKED = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 60, "speed": "0m/s"}
ALONE = town_road().with_vehicles(driving(31, (150, 3.5), 10.0, 101))


def test_a_standing_vehicle_stands_to_the_end(apply: Apply) -> None:
    applied = apply(PARKED, builder=ALONE)
    (key,) = applied.outcome.edits[0].vehicles
    track = applied.tracks()[key]
    assert track.last_step == 100
    assert track.positions == pytest.approx(track.positions[:1].repeat(101, axis=0))


@pytest.mark.parametrize(
    "order",
    [
        {"op": "set_speed", "vehicles": ["new:0"], "speed": "8m/s", "time_s": 2.0},
        {"op": "change_lane", "vehicles": ["new:0"], "lane": "left"},
    ],
)
def test_a_standing_vehicle_drives_after_another_edit(apply: Apply, order: dict[str, object]) -> None:
    applied = apply(PARKED, order, builder=ALONE)
    (key,) = applied.outcome.edits[0].vehicles
    track = applied.tracks()[key]
    assert float(track.positions[-1][0] - track.positions[0][0]) > 5.0
    if "time_s" in order:
        assert track.positions[18] == pytest.approx(track.positions[0], abs=0.1)


def test_a_speed_that_is_not_reached_is_not_done_and_its_best_value_is_reported(apply: Apply) -> None:
    report = apply({"op": "set_speed", "vehicles": ["31"], "speed": "30m/s", "time_s": 9.0}, builder=ALONE).outcome
    (achieved,) = report.edits[0].achieved
    assert report.edits[0].verdict == "off target"
    assert achieved.asked == 30.0
    assert 10.0 <= achieved.value < 20.0
    assert not achieved.reached
