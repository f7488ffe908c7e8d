"""What an answer warns of: nothing where nothing is wrong, and each thing by name where it is."""

from dataclasses import replace
from typing import Any

import pytest
from support.builders import driving, town_road
from support.edits import Apply

SHORT = town_road().cut(61)
OFF_ROAD = driving(36, (60.0, 60.0), 5.0, 61)
EVERY_KIND = [
    {"op": "set_speed", "vehicles": ["31"], "speed": "8m/s"},
    {"op": "set_behaviour", "vehicles": ["31"], "preset": "aggressive"},
    {"op": "change_lane", "vehicles": ["31"], "lane": "left"},
    {"op": "reroute", "vehicles": ["35"], "to": ["12"]},
    {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "120m"},
    {"op": "remove_vehicle", "vehicles": ["31"]},
    {"op": "shift_time", "vehicles": ["35"], "time_s": -0.5},
    {"op": "set_goal", "to": ["11"], "goal_time": "<=20s"},
    {"op": "set_ego", "at": "2", "position": "90m"},
]


@pytest.mark.parametrize("edit", EVERY_KIND, ids=lambda edit: edit["op"])
def test_an_edit_of_ordinary_traffic_gives_no_warnings(apply: Apply, edit: dict[str, Any]) -> None:
    outcome = apply(edit, builder=SHORT).outcome
    assert outcome.warnings == ()
    assert outcome.edits[0].done
    assert all(touched.feasible for touched in outcome.touched)


def test_unseen_vehicles_are_named_only_if_one_drives(apply: Apply) -> None:
    beside = SHORT.with_vehicles(*SHORT.vehicles, OFF_ROAD)
    driven = apply(EVERY_KIND[0], builder=beside).outcome.warnings
    assert driven == ("driven vehicles do not see 36, because it is recorded off the lanelets",)
    assert apply(EVERY_KIND[7], builder=beside).outcome.warnings == ()
    gone = {"op": "remove_vehicle", "vehicles": ["36"]}
    assert apply(gone, EVERY_KIND[0], builder=beside).outcome.warnings == ()


def test_reactive_traffic_names_vehicles_that_keep_their_recording(apply: Apply) -> None:
    beside = SHORT.with_vehicles(*SHORT.vehicles, OFF_ROAD)
    warnings = apply(EVERY_KIND[0], builder=beside, traffic="reactive").outcome.warnings
    assert "vehicle 36 keeps its recording, because SUMO cannot drive it" in warnings
    assert not any("cannot be driven" in one for one in apply(EVERY_KIND[0], builder=beside).outcome.warnings)


@pytest.mark.parametrize(
    ("times", "named"),
    [
        ((0.0, 0.0), None),
        ((0.0, 1.5), "102 enters at 1.5 s"),
        ((2.0, 1.5), "102 enters at 1.5 s, 101 enters at 2.0 s"),
        ((1.5, 1.5), "101, 102 enter at 1.5 s"),
    ],
)
def test_vehicles_that_enter_late_are_named_in_order(
    apply: Apply, times: tuple[float, float], named: str | None
) -> None:
    adds = [
        {"op": "add_vehicle", "vehicle_class": "car", "at": lane, "position": "120m", "time_s": time_s}
        for lane, time_s in zip(("2", "3"), times, strict=True)
    ]
    empty = replace(SHORT, vehicles=SHORT.vehicles[:1])
    warnings = apply(*adds, builder=empty).outcome.warnings
    rest = "CommonRoad's schema requires time 0, but its reader accepts this"
    assert warnings == (() if named is None else (f"{named}: {rest}",))
