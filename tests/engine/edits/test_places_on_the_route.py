"""Places relative to the ego follow its route, and what edits near the ego do and say."""

import math

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, arc, driving, line, town_road
from support.edits import Apply

from plannerforge.schemas.errors import InvalidRequest, NotPossible

CAR = {"op": "add_vehicle", "vehicle_class": "car"}
SHORT = town_road().cut(31)


def fork(goal: tuple[float, float]) -> ScenarioBuilder:
    """Lane 1 leads to 2, which begins straight on but turns back, and to 3, which goes straight on."""
    back = (*line((100, 0), (110, 0), 6)[:-1], *arc((110, 15), 15, -math.pi / 2, math.pi / 2))
    lanes = (
        Lane(1, line((0, 0), (100, 0)), successors=(2, 3)),
        Lane(2, back, predecessors=(1,), successors=(4,)),
        Lane(3, line((100, 0), (200, 0)), predecessors=(1,)),
        Lane(4, line((110, 30), (0, 30)), predecessors=(2,)),
    )
    return ScenarioBuilder(lanes, (driving(31, (10, 0), 5.0, 31),), problems=(Problem(goal=(*goal, 8.0, 3.0)),))


@pytest.mark.parametrize(("goal", "place"), [((180.0, 0.0), (140.0, 0.0)), ((50.0, 30.0), (77.1, 30.0))])
def test_a_place_ahead_of_the_ego_is_on_its_route(
    apply: Apply, goal: tuple[float, float], place: tuple[float, float]
) -> None:
    far = {(180.0, 0.0): 100, (50.0, 30.0): 150}[goal]
    added = apply(CAR | {"at": "ego", "offset_m": far, "speed": "1m/s"}, builder=fork(goal)).tracks()[101]
    assert added.positions[0] == pytest.approx(place, abs=0.5)


def test_a_place_ahead_of_a_vehicle_is_straight_on_if_branches_start_alike(apply: Apply) -> None:
    added = apply(CAR | {"at": "vehicle:31", "offset_m": 130, "speed": "1m/s"}, builder=fork((180.0, 0.0)))
    assert added.tracks()[101].positions[0] == pytest.approx((140.0, 0.0), abs=0.5)


def test_a_vehicle_added_behind_the_ego_enters_at_the_speed_of_the_ego(apply: Apply) -> None:
    alone = ScenarioBuilder(fork((180.0, 0.0)).lanes, (driving(31, (190, 0), 5.0, 31),))
    added = apply(CAR | {"at": "ego", "offset_m": -15}, builder=alone).tracks()[101]
    assert float(added.speeds_mps[0]) == pytest.approx(10.0, abs=0.1)


def test_the_result_says_where_the_ego_sees_an_added_vehicle(apply: Apply) -> None:
    edit = apply(CAR | {"at": "ego", "offset_m": -15}, builder=SHORT, dry_run=True).outcome.edits[0]
    assert "(15 m behind the ego, same lane)" in edit.what


def test_a_refusal_of_all_vehicles_offers_to_leave_out_those_that_cannot_be_driven(apply: Apply) -> None:
    off_road = SHORT.with_vehicles(*SHORT.vehicles, driving(36, (60, 60), 5.0, 31))
    with pytest.raises(NotPossible) as caught:
        apply({"op": "set_speed", "vehicles": ["all"], "speed": "+10%"}, builder=off_road)
    assert caught.value.remedies[0].changes[0].values == {"vehicles": ["all", "!36"]}


def test_wrong_way_refuses_a_speed_for_an_existing_vehicle(apply: Apply) -> None:
    with pytest.raises(InvalidRequest) as caught:
        apply({"op": "wrong_way", "vehicles": ["31"], "speed": "80km/h"}, builder=SHORT)
    assert caught.value.remedies[0].changes[0].values == {"speed": None}


@pytest.mark.parametrize("given", [{}, {"to": ["11"], "turn": "left"}])
def test_set_goal_says_whether_to_or_turn_is_missing_or_both_are_given(apply: Apply, given: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest) as caught:
        apply({"op": "set_goal", "goal_time": "<=3s", **given}, builder=SHORT)
    assert ("not both" in caught.value.message) is bool(given)


def test_a_crop_that_is_too_small_names_a_rectangle_that_fits(apply: Apply) -> None:
    crop = {"op": "crop", "at": "ego", "rectangle_m": [60, 20]}
    with pytest.raises(NotPossible) as caught:
        apply(crop, builder=SHORT)
    apply(crop | caught.value.remedies[0].changes[0].values, builder=SHORT)


def test_a_relative_speed_that_is_missed_has_a_reason(apply: Apply) -> None:
    queue = SHORT.with_vehicles(driving(31, (70, 0), 2.0, 31), driving(32, (64, 0), 2.0, 31))
    values = apply({"op": "set_speed", "vehicles": ["32"], "speed": "+300%"}, builder=queue).outcome.edits[0].achieved
    assert [bool(one.reason) for one in values] == [not one.reached for one in values]
    assert not all(one.reached for one in values)


def test_braking_at_a_prescribed_rate_is_a_deceleration(apply: Apply) -> None:
    edit = {"op": "set_speed", "vehicles": ["31"], "speed": "0m/s", "time_s": 0.5, "rate_mps2": 5}
    assert {one.quantity for one in apply(edit, builder=SHORT).outcome.edits[0].achieved} == {"speed", "deceleration"}
