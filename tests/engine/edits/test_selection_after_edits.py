"""A word means in an edit whom it would mean in the file that the edits before it make."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import Lane, ScenarioBuilder, driving, line, town_road
from support.edits import Apply, apply_to

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.description import describe
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName
from plannerforge.schemas.scenarios import DescribeRequest

Edits = tuple[dict[str, Any], ...]

SHORT = town_road().cut(31)
AHEAD = {"op": "add_vehicle", "vehicle_class": "truck", "at": "ego", "offset_m": 14}
LATER = {"op": "add_vehicle", "vehicle_class": "bus", "at": "3", "position": "middle", "time_s": 1.0}
WALKER = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1", "position": "60m", "speed": "0m/s"}
SWAP = {"op": "set_ego", "vehicles": ["31"], "former_ego": "traffic"}
BEFORE: dict[str, Edits] = {
    "added": (AHEAD,),
    "added for later": (LATER,),
    "walker": (WALKER,),
    "removed": ({"op": "remove_vehicle", "vehicles": ["lead", "33"]},),
    "both": ({"op": "remove_vehicle", "vehicles": ["31", "32"]}, AHEAD),
    "other ego": (SWAP,),
    "ego moved": ({"op": "set_ego", "at": "1", "position": "120m"},),
    "shifted": ({"op": "shift_time", "vehicles": ["31"], "time_s": 1},),
}
WORDS = (
    *("lead", "follow", "nearest:1", "nearest:3", "farthest", "fastest", "slowest", "leftmost", "rightmost"),
    *("all", "class:car", "class:truck", "only:truck", "one:motorcycle"),
)


def meant(apply: Apply, *edits: dict[str, Any], words: list[str], builder: ScenarioBuilder = SHORT) -> tuple[int, ...]:
    last = {"op": "remove_vehicle", "vehicles": words}
    return apply(*edits, last, builder=builder, dry_run=True).outcome.edits[-1].vehicles


@pytest.mark.parametrize("before", BEFORE.values(), ids=BEFORE)
def test_words_mean_the_same_after_edits_as_in_the_edited_file(apply: Apply, tmp_path: Path, before: Edits) -> None:
    edited = apply(*before, builder=SHORT).xml
    for word in WORDS:
        try:
            expected = apply_to(edited, tmp_path, {"op": "remove_vehicle", "vehicles": [word]}, dry_run=True)
        except InvalidRequest:
            with pytest.raises(InvalidRequest):
                meant(apply, *before, words=[word])
        else:
            assert meant(apply, *before, words=[word]) == expected.outcome.edits[0].vehicles, word


def test_the_vehicle_described_as_ahead_is_the_lead(apply: Apply, tmp_path: Path) -> None:
    edited = apply(AHEAD, builder=SHORT).xml
    described = describe(DescribeRequest(path=edited, focus=None, detail="vehicles", radius_m=300.0), silent).vehicles
    ahead = min((one for one in described if one.gap_m and (one.ahead_m or 0) > 0), key=lambda one: one.ahead_m or 0.0)
    assert ahead.where == "14 m ahead, same lane"
    assert meant(apply, AHEAD, words=["lead"]) == (ahead.vehicle_id,)


TURNING = driving(36, (220, -30), 5.0, 11, heading_rad=-math.pi / 2)
MERGING = (Lane(4, line((-80, -60), (0, 0)), successors=(1,)), Lane(5, line((-100, 0), (0, 0)), successors=(1,)))
"""Lanelets 4 and 5 lead to the ego's lanelet 1."""


@pytest.mark.parametrize("word", ["lead", "follow"])
def test_a_description_names_leader_and_follower_in_the_lanes_next_to_the_ego(
    apply: Apply, tmp_path: Path, word: str
) -> None:
    """On another branch than the ego's way, or on a lane that joins it."""
    road = town_road()
    first = replace(road.lanes[0], predecessors=(4, 5))
    joining = driving(37, (-40, -30), 5.0, 11, heading_rad=math.atan2(60, 80))
    builder = replace(road, lanes=(first, *road.lanes[1:], *MERGING)).with_vehicles(TURNING, joining)
    path = builder.write(tmp_path / "beside.xml")
    described = describe(DescribeRequest(path=path, focus=None, detail="vehicles", radius_m=400.0), silent).vehicles
    said = [one for one in described if one.where.endswith(f"(selector {word})")]
    assert tuple(one.vehicle_id for one in said) == meant(apply, words=[word], builder=builder)
    assert "same lane" not in said[0].where


@pytest.mark.parametrize(
    ("before", "words", "expected"),
    [
        ((AHEAD,), ["lead"], (101,)),
        ((AHEAD,), ["nearest:2"], (33, 101)),
        ((AHEAD,), ["all"], (31, 32, 33, 34, 35, 101)),
        ((AHEAD,), ["class:truck", "!new:0"], (33,)),
        ((AHEAD, LATER), ["only:bus"], (102,)),
        (({"op": "remove_vehicle", "vehicles": ["lead"]},), ["lead"], (35,)),
        (({"op": "remove_vehicle", "vehicles": ["nearest:1"]},), ["nearest:2"], (31, 32)),
        (({"op": "remove_vehicle", "vehicles": ["31"]},), ["class:car", "!31"], (32, 35)),
        ((SWAP,), ["nearest:1"], (33,)),
        ((AHEAD, {"op": "remove_vehicle", "vehicles": ["new:0"]}), ["lead"], (31,)),
    ],
)
def test_words_refer_to_added_vehicles_but_not_to_removed_ones(
    apply: Apply, before: Edits, words: list[str], expected: tuple[int, ...]
) -> None:
    assert meant(apply, *before, words=words) == expected


def test_a_vehicle_that_enters_later_is_not_near_at_the_start(apply: Apply) -> None:
    near = {"op": "add_vehicle", "vehicle_class": "car", "at": "2", "position": "40m", "time_s": 2.0}
    assert meant(apply, near, words=["nearest:1"]) == (33,)
    assert 101 in meant(apply, near, words=["class:car"])


def test_pedestrians_are_not_leaders(apply: Apply) -> None:
    assert meant(apply, WALKER, words=["lead"]) == (31,)


def test_an_added_vehicle_that_was_removed_again_is_named_as_removed(apply: Apply) -> None:
    remove = {"op": "remove_vehicle", "vehicles": ["101"]}
    for again in ("101", "new:0"):
        with pytest.raises(NotPossible, match="vehicle 101 was removed by an earlier edit"):
            meant(apply, AHEAD, remove, words=[again])


def test_removed_vehicles_are_not_candidates(apply: Apply) -> None:
    remove = {"op": "remove_vehicle", "vehicles": ["35"]}
    with pytest.raises(UnknownName, match="no vehicle 36") as unknown:
        meant(apply, remove, words=["36"])
    with pytest.raises(NotPossible, match="there are 2 cars") as ambiguous:
        meant(apply, remove, words=["one:car"])
    assert unknown.value.valid[0] == "34"
    assert ambiguous.value.valid == ("31 (car)", "32 (car)")


def test_places_and_lanelets_are_named_by_added_vehicles(apply: Apply) -> None:
    goal = apply(AHEAD | {"lane": "left", "offset_m": 60}, {"op": "set_goal", "to": ["lanelet_of:new:0"]}, dry_run=True)
    assert goal.outcome.edits[1].what.startswith("goal on lanelet 2 ")
    behind = {"op": "add_vehicle", "vehicle_class": "car", "at": "101", "offset_m": -20}
    tracks = apply(AHEAD | {"at": "13", "position": "60m", "offset_m": None}, behind, builder=SHORT).tracks()
    assert tracks[102].positions[0] == pytest.approx((220.0, -60.0), abs=0.01)


def test_a_vehicle_enters_slowly_enough_to_brake_for_an_added_one(apply: Apply) -> None:
    builder = SHORT.with_vehicles(driving(31, (10, 7), 9.0, 31))
    standing = {"op": "add_vehicle", "vehicle_class": "car", "at": "11", "position": "80m", "speed": "0m/s"}
    behind = {"op": "add_vehicle", "vehicle_class": "car", "at": "11", "position": "72m"}
    applied = apply(standing, behind, builder=builder)
    assert applied.tracks()[102].speeds_mps[0] < 6.0
    assert applied.outcome.collisions == ()


@pytest.mark.parametrize(
    ("word", "reason", "valid"),
    [("nearest:0", "selects no vehicle", "nearest:1"), ("nearest:6", "requests more vehicles than are", "nearest:5")],
)
def test_an_invalid_number_of_vehicles_is_refused(apply: Apply, word: str, reason: str, valid: str) -> None:
    with pytest.raises(InvalidRequest, match=reason) as caught:
        meant(apply, words=[word])
    assert caught.value.valid[0] == valid
