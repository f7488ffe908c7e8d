"""Who is meant by a selector."""

import math

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, Vehicle, driving, line, town_road
from support.edits import Apply

from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName


def meant(apply: Apply, *selectors: str, builder: object = None) -> tuple[int, ...]:
    edit = {"op": "remove_vehicle", "vehicles": list(selectors)}
    return apply(edit, builder=builder or town_road().cut(11), dry_run=True).outcome.edits[0].vehicles


@pytest.mark.parametrize(
    ("selectors", "expected"),
    [
        (["31"], (31,)),
        (["35", "31"], (31, 35)),
        (["all"], (31, 32, 33, 34, 35)),
        (["all", "!31", "!one:truck"], (32, 34, 35)),
        (["class:car"], (31, 32, 35)),
        (["one:motorcycle"], (34,)),
        (["only:truck"], (33,)),
        (["only:LKW"], (33,)),
        (["class:lorry"], (33,)),
        (["one:motorbike"], (34,)),
        (["nearest:1"], (33,)),
        (["nearest:3"], (31, 32, 33)),
        (["farthest"], (34,)),
        (["lead"], (31,)),
        (["follow"], (32,)),
        (["fastest"], (33,)),
        (["slowest"], (35,)),
        (["leftmost"], (33,)),
        (["nearest:1", "!33"], (32,)),
        (["nearest:2", "!33", "!32"], (31, 35)),
        (["fastest", "!one:truck"], (34,)),
        (["one:car", "!31", "!32"], (35,)),
        (["lead", "!31"], (35,)),
    ],
)
def test_selectors(apply: Apply, selectors: list[str], expected: tuple[int, ...]) -> None:
    assert meant(apply, *selectors) == expected


def test_a_vehicle_that_enters_later_is_in_no_outer_lane_at_the_start(apply: Apply) -> None:
    late = driving(36, (20, 3.5), 8.0, 20, first_step=5)
    assert meant(apply, "leftmost", builder=town_road().cut(11).with_vehicles(*town_road().vehicles, late)) == (33,)


def test_the_lead_may_be_on_another_branch_than_the_ego_s_way(apply: Apply) -> None:
    turning = driving(36, (220, -30), 5.0, 11, heading_rad=-math.pi / 2)
    builder = town_road().with_vehicles(turning, driving(37, (290, 0), 5.0, 11))
    assert meant(apply, "lead", builder=builder) == (36,)


def test_a_vehicle_follows_while_its_lanelet_is_still_in_the_ego_s_lane(apply: Apply) -> None:
    lanes = (Lane(1, line((0, 0), (200, 0))), Lane(3, ((0.0, -0.3), (40.0, -0.3), (80.0, -40.0))))
    way = tuple((30.0 + s, -0.3 - max(s - 10.0, 0.0), 0.0 if s < 10 else -math.pi / 4, 10.0) for s in range(40))
    builder = ScenarioBuilder(lanes, (Vehicle(36, way),), problems=(Problem(start=(60.0, 0.0, 0.0, 10.0)),))
    assert meant(apply, "follow", builder=builder) == (36,)


def test_a_vehicle_overtaking_in_the_next_lane_is_not_a_follower(apply: Apply) -> None:
    lanes = (Lane(1, line((0, 0), (300, 0)), left=(2, False)), Lane(2, line((300, 3.5), (0, 3.5)), left=(1, False)))
    others = (driving(36, (25, 3.6), 12.0, 11), driving(37, (10, 0), 10.0, 11))
    assert meant(apply, "follow", builder=ScenarioBuilder(lanes, others)) == (37,)


def test_the_ego_s_own_recording_neither_leads_nor_follows_and_is_noted(apply: Apply) -> None:
    builder = town_road().cut(11)
    builder = builder.with_vehicles(*builder.vehicles, driving(36, (39.9, 0), 10.0, 11))
    assert meant(apply, "follow", builder=builder) == (32,)
    noted = "36 is the ego's own recording: the minimum distance is 0 m until you remove it (remove_vehicle)"
    assert noted in apply({"op": "remove_vehicle", "vehicles": ["35"]}, builder=builder).outcome.warnings
    assert noted not in apply({"op": "remove_vehicle", "vehicles": ["36"]}, builder=builder).outcome.warnings


def test_standing_vehicles(apply: Apply) -> None:
    builder = town_road().with_vehicles(driving(31, (90, 0), 0.0, 101), driving(32, (60, 3.5), 5.0, 101))
    assert meant(apply, "standing", builder=builder) == (31,)
    with pytest.raises(NotPossible, match="no vehicle stands"):
        meant(apply, "standing")


def test_pedestrians_are_not_vehicles_but_can_be_named(apply: Apply) -> None:
    walker = driving(36, (100, 1), 1.0, 151, kind="pedestrian", size_m=(0.5, 0.5))
    builder = town_road().with_vehicles(*town_road().vehicles, walker)
    assert 36 not in meant(apply, "all", builder=builder)
    assert meant(apply, "36", builder=builder) == (36,)
    assert meant(apply, "class:pedestrian", builder=builder) == (36,)
    with pytest.raises(NotPossible, match="pedestrian 36 cannot be driven"):
        apply({"op": "set_behaviour", "vehicles": ["36"], "preset": "eco"}, builder=builder)


def test_an_ambiguous_one_is_refused_with_the_candidates(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="there are 3 cars") as caught:
        meant(apply, "one:car")
    assert caught.value.valid == ("31 (car)", "32 (car)", "35 (car)")


def test_a_missing_class_is_refused_with_the_present_ones(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="has no bus") as caught:
        meant(apply, "class:bus")
    assert "33 (truck)" in caught.value.valid


def test_an_unknown_id_is_refused_with_the_nearest(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="no vehicle 37") as caught:
        meant(apply, "37")
    assert caught.value.valid[0] == "35"


@pytest.mark.parametrize("word", ["ego", "the ego", "100", "!ego"])
def test_the_ego_is_refused_with_the_right_operation(apply: Apply, word: str) -> None:
    with pytest.raises(NotPossible, match="ego") as caught:
        meant(apply, word)
    assert "set_goal" in caught.value.next_step
    assert "configure_planner" in caught.value.next_step


def test_an_unknown_word_is_refused(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="selects no vehicles"):
        meant(apply, "leader")


def test_naming_no_vehicle_and_only_exclusions_are_refused(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="no vehicle is given"):
        meant(apply)
    with pytest.raises(InvalidRequest, match="only exclusions"):
        meant(apply, "!31")


def test_new_refers_to_an_earlier_edit_that_adds(apply: Apply) -> None:
    with pytest.raises(UnknownName, match="new:K"):
        meant(apply, "new:0")


@pytest.mark.parametrize("word", ["fastest", "slowest"])
def test_two_that_fit_alike_are_refused_with_both(apply: Apply, word: str) -> None:
    builder = town_road().with_vehicles(driving(31, (90, 0), 5.0, 11), driving(32, (60, 3.5), 5.0, 11))
    with pytest.raises(NotPossible, match=f"'{word}' is ambiguous: 2 vehicles") as caught:
        meant(apply, word, builder=builder)
    assert caught.value.valid == ("31 (car)", "32 (car)")


def test_the_answer_states_the_meaning_of_a_class_word(apply: Apply) -> None:
    edit = {"op": "remove_vehicle", "vehicles": ["one:lorry"]}
    told = apply(edit, builder=town_road().cut(11), dry_run=True).outcome.edits[0].meant
    assert told.startswith("one:lorry ('lorry' read as truck): truck 33")
