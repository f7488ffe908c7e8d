"""Every refusal of an edit says what is wrong with which value, what is valid, and what to do next."""

import ast
from pathlib import Path
from typing import Any

import pytest
from support.builders import ScenarioBuilder, driving, town_road
from support.edits import Apply

import plannerforge.engine.edits as edits
from plannerforge.schemas.errors import InvalidRequest, NotPossible

REFUSALS = ("InvalidRequest", "NotPossible", "UnknownName")
ROAD = town_road()
NO_EGO = ScenarioBuilder(ROAD.lanes, ROAD.vehicles, problems=())
CAR = {"op": "add_vehicle", "vehicle_class": "car"}
GOAL = {"op": "set_goal", "to": ["11"]}

WRONG: list[tuple[dict[str, Any], str, str]] = [
    ({"op": "reroute", "vehicles": ["31"], "to": ["99"]}, "99 is not a lanelet", "21"),
    ({"op": "set_behaviour", "vehicles": ["31"], "params": ["tau=nan"]}, "not assign a finite", "tau above 0 up to 10"),
    ({"op": "set_behaviour", "vehicles": ["31"], "params": ["tau 2"]}, "not an assignment", "tau above 0 up to 10"),
    ({"op": "set_speed", "vehicles": ["31"], "speed": "nan"}, "'nan' is not a quantity", "0 to 55.6 m/s"),
    (CAR | {"at": "11", "speed": "inf"}, "'inf' is not a quantity", "0 to 55.6 m/s"),
    ({"op": "set_ego", "speed": "slow"}, "'slow' is not a quantity", "0 to 50.8 m/s"),
    ({"op": "reroute", "vehicles": ["31"], "to": ["e99"]}, "'e99' is not a lanelet or edge", "e"),
    ({"op": "reroute", "vehicles": ["31"], "to": ["3"]}, "lanelet 3 cannot be reached", "1"),
    ({"op": "reroute", "vehicles": ["31"]}, "either 'to' or 'turn'", "turn="),
    ({"op": "reroute", "vehicles": ["31"], "turn": "left"}, "cannot go left", "straight"),
    ({"op": "reroute", "vehicles": ["34"], "turn": "left"}, "no fork ahead", ""),
    ({"op": "reroute", "vehicles": ["36"], "to": ["11"]}, "no vehicle 36", "35"),
    ({"op": "reroute", "vehicles": [], "to": ["11"]}, "no vehicle is given", "31 (car)"),
    ({"op": "reroute", "vehicles": ["ego"], "to": ["11"]}, "the planner drives the ego", ""),
    ({"op": "reroute", "vehicles": ["new:0"], "to": ["11"]}, "new:K", ""),
    ({"op": "remove_vehicle", "vehicles": ["nearset:1"]}, "'nearset:1' selects no vehicles", "nearest:3"),
    ({"op": "remove_vehicle", "vehicles": ["nearest:0"]}, "'nearest:0' selects no vehicle", "nearest:1"),
    ({"op": "remove_vehicle", "vehicles": ["nearest:9"]}, "'nearest:9' requests more", "nearest:5"),
    ({"op": "remove_vehicle", "vehicles": ["nearest:many"]}, "'nearest:many' needs a whole number", "nearest:1"),
    ({"op": "remove_vehicle", "vehicles": ["class:tram"]}, "no vehicle class 'tram'", "tr"),
    ({"op": "remove_vehicle", "vehicles": ["class:bus"]}, "has no bus", "31 (car)"),
    ({"op": "remove_vehicle", "vehicles": ["one:car"]}, "there are 3 cars", "31 (car)"),
    ({"op": "remove_vehicle", "vehicles": ["lane:middle"]}, "no lane 'middle'", "leftmost"),
    ({"op": "remove_vehicle", "vehicles": ["!31"]}, "only exclusions", "all"),
    ({"op": "remove_vehicle", "vehicles": ["31", "!31"]}, "31, !31 leaves no vehicle", "31 (car)"),
    ({"op": "remove_vehicle", "vehicles": ["standing"]}, "no vehicle stands", "31 (car)"),
    ({"op": "replace", "vehicles": ["31"], "vehicle_class": "pedestrian"}, "needs a class of vehicle", "truck"),
    ({"op": "wrong_way", "at": "1", "vehicle_class": "pedestrian"}, "needs a class of vehicle", "truck"),
    ({"op": "close_lane"}, "close_lane needs lanelets", "to=[LANELET]"),
    ({"op": "change_lane", "vehicles": ["31"]}, "left or right", "lane=left"),
    ({"op": "change_lane", "vehicles": ["31"], "lane": "right"}, "no lane in its direction on the right", "lane=left"),
    ({"op": "change_lane", "vehicles": ["31"], "lane": "left", "time_s": 99.0}, "31 is not there at 99 s", "time_s"),
    ({"op": "set_speed", "vehicles": ["31"]}, "needs a speed", "30km/h"),
    ({"op": "set_speed", "vehicles": ["31"], "speed": "900km/h"}, "cannot drive at 900km/h", "m/s"),
    ({"op": "set_speed", "vehicles": ["31"], "speed": "fast"}, "'fast' is not a quantity", "a number"),
    ({"op": "set_speed", "vehicles": ["31"], "speed": "8kg"}, "the unit 'kg'", "km/h"),
    ({"op": "shift_time", "vehicles": ["31"]}, "at least one time step", "time_s=2"),
    ({"op": "shift_time", "vehicles": ["31"], "time_s": 99.0}, "99 s would leave nothing", "time_s=1"),
    ({"op": "set_behaviour", "vehicles": ["31"]}, "needs a preset or params", "aggressive"),
    (
        {"op": "set_behaviour", "vehicles": ["31"], "preset": "agressive"},
        "no behaviour preset 'agressive'",
        "aggressive",
    ),
    (
        {"op": "set_behaviour", "vehicles": ["31"], "params": ["tua=1"]},
        "no behaviour parameter 'tua'",
        "tau above 0 up to 10",
    ),
    (
        {"op": "set_behaviour", "vehicles": ["31"], "params": ["tau=-1"]},
        "tau=-1 is out of range",
        "tau above 0 up to 10",
    ),
    ({"op": "set_behaviour", "vehicles": ["31"], "params": ["tau=high"]}, "tau needs a number", "tau above 0 up to 10"),
    ({"op": "set_behaviour", "vehicles": ["31"], "params": ["tau"]}, "tau needs a number", "tau above 0 up to 10"),
    ({"op": "set_behaviour", "vehicles": ["31"], "params": ["tau=1", "tau=2"]}, "tau is set twice", ""),
    (CAR, "needs a place", "at=LANELET"),
    (CAR | {"at": "99"}, "99 is not a lanelet", "21"),
    (CAR | {"at": "e99"}, "'e99' is not a lanelet, edge or vehicle", "e"),
    (CAR | {"at": "1", "lane": "left"}, "'1' is a lanelet", "position"),
    (CAR | {"at": "ego", "position": "middle"}, "'ego' is not a lanelet", "offset_m"),
    (CAR | {"at": "1", "position": "somewhere"}, "'somewhere' is not a position", "middle"),
    (CAR | {"at": "1", "position": "500m"}, "500m is beyond", "200.0m"),
    (CAR | {"at": "1", "position": "7"}, "position 7 is not a fraction", "middle"),
    (CAR | {"at": "ego", "lane": "right", "offset_m": 10.0}, "no lane in its direction on the right", "left"),
    (CAR | {"at": "ego", "offset_m": 900.0}, "the road does not extend", "up to"),
    (CAR | {"at": "31", "offset_m": 0.0}, "is occupied by", "at=1 position="),
    (CAR | {"at": "1", "speed": "900km/h"}, "cannot drive at 900km/h", "m/s"),
    (CAR | {"at": "1", "time_s": 99.0}, "departure at 99.0 s", "0 to 14.9 s"),
    ({"op": "add_vehicle", "at": "1"}, "needs a vehicle_class", "car"),
    ({"op": "add_vehicle", "at": "1", "vehicle_class": "tram"}, "no vehicle class 'tram'", "car"),
    ({"op": "add_vehicle", "at": "1", "vehicle_class": "pedestrian", "speed": "9m/s"}, "9m/s", "4 m/s"),
    ({"op": "add_vehicle", "at": "1", "vehicle_class": "pedestrian", "preset": "eco"}, "preset", "at"),
    ({"op": "set_goal"}, "a lanelet in 'to'", "2"),
    (GOAL | {"goal_time": "90..99s"}, "begins after the scenario's end", "<="),
    (GOAL | {"goal_time": "9..8s"}, "its start is above its end", "8s..9s"),
    (GOAL | {"goal_speed": "900km/h"}, "a car cannot drive at goal_speed", "m/s"),
    (GOAL | {"goal_time": "<=1s"}, "no car that starts at", "goal_time of at least"),
    (GOAL | {"rectangle_m": [8.0]}, "not a goal region", "[length, width]"),
    ({"op": "set_ego"}, "set_ego takes", "at=LANELET"),
    ({"op": "set_ego", "speed": "900km/h"}, "cannot drive at 900km/h", "m/s"),
    ({"op": "set_ego", "vehicles": ["31", "33"]}, "vehicle 31, 33 cannot become the ego", "31"),
    ({"op": "set_ego", "vehicle_class": "bicycle"}, "the ego cannot be a 'bicycle'", "motorcycle"),
    ({"op": "set_ego", "vehicle_class": "bus", "speed": "30m/s"}, "cannot drive at 30m/s", "23.6"),
    (
        {"op": "remove_vehicle", "vehicles": ["31"], "speed": "9m/s"},
        "speed is not an argument of op remove_vehicle",
        "",
    ),
]


@pytest.mark.parametrize(("edit", "wrong", "valid"), WRONG, ids=[wrong for _, wrong, _ in WRONG])
def test_a_refusal_names_the_value_the_valid_ones_and_the_next_step(
    apply: Apply, edit: dict[str, Any], wrong: str, valid: str
) -> None:
    with pytest.raises(InvalidRequest) as caught:
        apply(edit, builder=ROAD, dry_run=True)
    assert wrong in caught.value.message
    assert not valid or any(valid in value for value in caught.value.valid[: caught.value.shown_values])
    assert " Next: " in caught.value.text


@pytest.mark.parametrize("edit", [GOAL, {"op": "set_ego", "speed": "8m/s"}, CAR | {"at": "ego"}])
def test_without_an_ego_the_next_step_is_another_scenario_or_place(apply: Apply, edit: dict[str, Any]) -> None:
    with pytest.raises(InvalidRequest, match=r"no ego.* Next: (choose|give) a"):
        apply(edit, builder=NO_EGO, dry_run=True)


def test_vehicles_that_have_no_trajectory_are_not_shifted(apply: Apply) -> None:
    parked = ScenarioBuilder(ROAD.lanes, ROAD.vehicles, parked=(driving(36, (120, 0), 0.0, 1),))
    with pytest.raises(InvalidRequest, match=r"no trajectory .*Valid: 35, 34.* Next: ") as caught:
        apply({"op": "shift_time", "vehicles": ["36"], "time_s": 1.0}, builder=parked, dry_run=True)
    assert caught.value.valid[0] == "35"


def test_no_refusal_in_the_code_of_edits_is_without_a_next_step() -> None:
    lacking = [
        f"{path.name}:{node.lineno}"
        for path in sorted(Path(edits.__path__[0]).glob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in REFUSALS
        if "next_step" not in {word.arg for word in node.keywords}
    ]
    assert not lacking


@pytest.mark.parametrize(
    ("edit", "left_out"),
    [
        ({"op": "change_lane", "vehicles": ["all"], "lane": "left"}, ["all", "!33", "!34"]),
        ({"op": "change_lane", "vehicles": ["31", "34"], "lane": "left"}, ["31"]),
        ({"op": "stop_at", "vehicles": ["31", "32", "35"], "at": "1", "position": "120m"}, ["31", "32"]),
    ],
)
def test_vehicles_that_an_edit_does_not_suit_are_refused_together_with_the_edit_of_the_others(
    apply: Apply, edit: dict[str, Any], left_out: list[str]
) -> None:
    with pytest.raises(NotPossible) as caught:
        apply(edit, builder=ROAD, dry_run=True)
    changed = caught.value.remedies[0].changes[0].values
    assert changed == {"vehicles": left_out}
    assert apply({**edit, **changed}, builder=ROAD, dry_run=True).outcome.edits


def test_an_edit_that_suits_no_vehicle_gives_the_reason_of_each(apply: Apply) -> None:
    with pytest.raises(InvalidRequest) as caught:
        apply({"op": "change_lane", "vehicles": ["31", "35"], "lane": "right"}, builder=ROAD, dry_run=True)
    assert all(f"vehicle {key} " in caught.value.message for key in (31, 35))


def test_a_value_that_no_vehicle_can_take_is_refused_once(apply: Apply) -> None:
    with pytest.raises(InvalidRequest) as several:
        apply({"op": "set_speed", "vehicles": ["31", "35"], "speed": "fast"}, builder=ROAD, dry_run=True)
    with pytest.raises(InvalidRequest) as one:
        apply({"op": "set_speed", "vehicles": ["31"], "speed": "fast"}, builder=ROAD, dry_run=True)
    assert several.value.message == one.value.message


@pytest.mark.parametrize(
    ("position", "nearest"), [("-5m", "beginning"), ("-0.5", "beginning"), ("500m", "final"), ("1e9", "1e9m")]
)
def test_a_position_off_the_lanelet_leads_to_its_nearest_end(apply: Apply, position: str, nearest: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        apply(CAR | {"at": "1", "position": position}, builder=ROAD, dry_run=True)
    assert next(iter(caught.value.remedies[0].changes[0].words.values())) == nearest
