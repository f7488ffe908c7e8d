"""Edit G."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, arc, line, town_road
from support.edits import Applied, Apply, apply_to

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.scene.routing import goal_center_lanelets
from plannerforge.schemas.errors import InvalidRequest, NotPossible


def goal(applied: Applied) -> object:
    (state,) = read_scenario(applied.xml).problem().goal.state_list
    return state


@pytest.mark.parametrize(
    ("position", "x"), [(None, 300.0), ("beginning", 200.0), ("quarter", 225.0), ("0.66", 266.0), ("12m", 212.0)]
)
def test_the_goal_is_at_the_requested_position(apply: Apply, position: str | None, x: float) -> None:
    applied = apply({"op": "set_goal", "to": ["11"], "position": position}, builder=town_road().cut(11))
    region = goal(applied).position
    assert tuple(region.center) == pytest.approx((x, 0.0), abs=0.01)
    assert (region.length, region.width) == (8.0, 3.0)


@pytest.mark.parametrize("position", [None, "59.99990055m"])
def test_a_goal_at_the_end_of_the_road_stays_on_its_lanelet(tmp_path: Path, position: str | None) -> None:
    start = Problem(start=(20.0, 0.0, 0.0, 10.0), goal=(40.0, 0.0, 8.0, 3.0), steps=(0, 90))
    base = ScenarioBuilder((Lane(1, line((0.0, 0.0), (60.0, 0.0))),), problems=(start,)).write(tmp_path / "base.xml")
    ends_before_its_rounded_end = base.read_text().replace("<x>60.0000</x>", "<x>59.9999006</x>")
    base.write_text(ends_before_its_rounded_end, encoding="utf-8")
    applied = apply_to(base, tmp_path / "out", {"op": "set_goal", "to": ["1"], "position": position})
    written = read_scenario(applied.xml)
    assert goal_center_lanelets(written.scenario.lanelet_network, written.problem()) == (1,)
    assert tuple(goal(applied).position.center) == pytest.approx((60.0, 0.0), abs=0.02)


def test_time_and_rectangle_stay_unless_they_are_named(apply: Apply) -> None:
    kept = goal(apply({"op": "set_goal", "to": ["11"]}))
    assert (kept.time_step.start, kept.time_step.end) == (60, 150)
    named = {"goal_time": "8..12s", "goal_speed": "5..10m/s", "rectangle_m": [6.0, 2.0]}
    new = goal(apply({"op": "set_goal", "to": ["11"], "position": "beginning", **named}))
    assert (new.time_step.start, new.time_step.end) == (80, 120)
    assert (new.velocity.start, new.velocity.end) == (5.0, 10.0)
    assert (new.position.length, new.position.width) == (6.0, 2.0)


@pytest.mark.parametrize(("speed_mps", "too_fast"), [(16.0, True), (6.0, False)])
def test_a_curve_too_tight_for_the_speed_on_the_route_is_reported(
    apply: Apply, speed_mps: float, too_fast: bool
) -> None:
    corner = (
        Lane(1, line((0.0, 0.0), (40.0, 0.0)), successors=(2, 3)),
        Lane(2, line((40.0, 0.0), (140.0, 0.0)), predecessors=(1,)),
        Lane(3, arc((40.0, 8.0), 8.0, -math.pi / 2, 0.0, 21), predecessors=(1,)),
    )
    start = Problem(start=(36.0, 0.0, 0.0, speed_mps), goal=(100.0, 0.0, 8.0, 3.0), steps=(20, 60))
    builder = ScenarioBuilder(corner, problems=(start,))
    told = {to: apply({"op": "set_goal", "to": [to]}, builder=builder).outcome.edits[0].what for to in ("2", "3")}
    assert "curve" not in told["2"]
    assert ("16.0 m/s 4 m before a curve of lanelet 3 that allows at most 8" in told["3"]) == too_fast


def test_a_curve_behind_the_ego_does_not_count(apply: Apply) -> None:
    around = Lane(1, (*arc((0.0, 8.0), 8.0, -math.pi, -math.pi / 2, 21), *line((5.0, 0.0), (120.0, 0.0))))
    start = Problem(start=(20.0, 0.0, 0.0, 20.0), goal=(60.0, 0.0, 8.0, 3.0), steps=(10, 60))
    applied = apply({"op": "set_goal", "to": ["1"]}, builder=ScenarioBuilder((around,), problems=(start,)))
    assert "bend" not in applied.outcome.edits[0].what


def test_a_deadline_in_steps(apply: Apply) -> None:
    new = goal(apply({"op": "set_goal", "to": ["1"], "position": "middle", "goal_time": "<=90steps"}))
    assert (new.time_step.start, new.time_step.end) == (0, 90)


def test_a_goal_without_a_region_gets_one(apply: Apply) -> None:
    bare = replace(town_road(), problems=(Problem(goal=None),))
    region = goal(apply({"op": "set_goal", "to": ["1"]}, builder=bare)).position
    assert (region.length, region.width) == (6.0, 2.0)


def test_the_goal_is_turned_along_its_lanelet(apply: Apply) -> None:
    region = goal(apply({"op": "set_goal", "to": ["13"], "position": "middle"})).position
    assert region.orientation == pytest.approx(-1.5708, abs=1e-3)


def test_the_lanelet_of_a_vehicle_is_a_target(apply: Apply) -> None:
    region = goal(apply({"op": "set_goal", "to": ["lanelet_of:one:truck"], "position": "final"})).position
    assert tuple(region.center) == pytest.approx((200.0, 3.5), abs=0.01)


def test_an_oncoming_lane_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="lanelet 3 cannot be reached by the ego"):
        apply({"op": "set_goal", "to": ["3"]})


def test_a_place_behind_the_ego_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="behind the ego"):
        apply({"op": "set_goal", "to": ["1"], "position": "beginning"})


def test_an_impossible_time_is_refused_with_a_possible_one(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="no car that starts at") as caught:
        apply({"op": "set_goal", "to": ["11"], "goal_time": "<=2s"})
    assert "goal_time of at least" in caught.value.valid[0]


@pytest.mark.parametrize("rectangle", [[6.0, 0.0], [6.0], [-1.0, 2.0], [6.0, 2.0, 1.0]])
def test_a_bad_rectangle_is_refused(apply: Apply, rectangle: list[float]) -> None:
    with pytest.raises(InvalidRequest, match="not a goal region"):
        apply({"op": "set_goal", "to": ["11"], "rectangle_m": rectangle})


@pytest.mark.parametrize("position", ["somewhere", "1.5", "120m", "-0.1"])
def test_a_bad_position_is_refused(apply: Apply, position: str) -> None:
    with pytest.raises(InvalidRequest):
        apply({"op": "set_goal", "to": ["11"], "position": position})


def test_lanelets_within_the_ego_s_reach_are_named_if_none_is_given(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match="a lanelet in 'to'") as caught:
        apply({"op": "set_goal"})
    assert {"11", "13"} <= set(caught.value.valid)


def test_of_the_lanelets_near_the_ego_only_reachable_ones_are_named(apply: Apply) -> None:
    apart = (
        Lane(1, line((0.0, 0.0), (100.0, 0.0)), successors=(2,)),
        Lane(2, line((100.0, 0.0), (200.0, 0.0)), predecessors=(1,)),
        Lane(3, line((0.0, 3.5), (100.0, 3.5)), successors=(4,)),
        Lane(4, line((100.0, 3.5), (200.0, 3.5)), predecessors=(3,)),
    )
    with pytest.raises(InvalidRequest, match="a lanelet in 'to'") as caught:
        apply({"op": "set_goal"}, builder=ScenarioBuilder(apart, problems=(Problem(start=(40.0, 1.0, 0.0, 10.0)),)))
    assert caught.value.valid == ("1", "2")


@pytest.mark.parametrize(
    ("goal_time", "told"),
    [
        ("<=9s", "requires 28.9 m/s on average"),
        ("<=20s", "requires 13.0 m/s on average, by the recording's end at 10.0 s 26.0 m/s"),
        ("10.5..20s", "requires 13.0 m/s on average; the recording ends earlier, at 10.0 s"),
    ],
)
def test_a_time_beyond_the_recording_is_reported(apply: Apply, goal_time: str, told: str) -> None:
    edit = {"op": "set_goal", "to": ["11"], "goal_time": goal_time}
    assert apply(edit, builder=town_road().cut(101)).outcome.edits[0].what.endswith(told)


def test_a_goal_too_far_for_the_time_it_keeps_is_refused_with_the_shortest_time(apply: Apply) -> None:
    hurried = replace(town_road(), problems=(Problem(steps=(10, 20)),))
    with pytest.raises(NotPossible, match="no car that starts at") as caught:
        apply({"op": "set_goal", "to": ["11"]}, builder=hurried)
    assert "goal_time of at least" in str(caught.value.text)
    applied = apply({"op": "set_goal", "to": ["11"], "goal_time": "10..15s"}, builder=hurried)
    assert applied.outcome.edits[0].done


def test_a_problem_without_a_goal_gets_one_for_the_whole_scenario(tmp_path: Path) -> None:
    base = town_road().cut(61).write(tmp_path / "base.xml")
    base.write_text(re.sub(r" *<goalState>.*</goalState>\n", "", base.read_text()), encoding="utf-8")
    applied = apply_to(base, tmp_path / "out", {"op": "set_goal", "to": ["1"], "position": "final"})
    made = goal(applied)
    assert tuple(made.position.center) == pytest.approx((200.0, 0.0), abs=0.01)
    assert (made.time_step.start, made.time_step.end) == (0, 60)


FORK = (
    Lane(1, line((0.0, 0.0), (40.0, 0.0)), successors=(2, 3)),
    Lane(2, line((40.0, 0.0), (140.0, 0.0)), predecessors=(1,)),
    Lane(3, arc((40.0, 20.0), 20.0, -math.pi / 2, 0.0), predecessors=(1,), successors=(4,)),
    Lane(4, line((60.0, 20.0), (60.0, 60.0)), predecessors=(3,)),
)
START = Problem(start=(10.0, 0.0, 0.0, 6.0), goal=(100.0, 0.0, 8.0, 3.0), steps=(0, 200))
AT_FORK = ScenarioBuilder(FORK, problems=(START,))


@pytest.mark.parametrize(("turn", "lanelet"), [("left", 3), ("straight", 2)])
def test_a_goal_is_on_the_lanelet_of_the_requested_turn(apply: Apply, turn: str, lanelet: int) -> None:
    applied = apply({"op": "set_goal", "turn": turn}, builder=AT_FORK)
    written = read_scenario(applied.xml)
    assert goal_center_lanelets(written.scenario.lanelet_network, written.problem()) == (lanelet,)
    assert "at the next fork: goal on lanelet" in applied.outcome.edits[0].what


def test_a_turn_that_is_not_there_names_the_branches_for_a_goal(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="the ego cannot go right at the next fork") as refused:
        apply({"op": "set_goal", "turn": "right"}, builder=AT_FORK)
    assert len(refused.value.valid) == 2


@pytest.mark.parametrize("both", [{}, {"to": ["2"], "turn": "left"}])
def test_a_goal_needs_a_lanelet_or_a_turn(apply: Apply, both: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest, match="a lanelet in 'to'"):
        apply({"op": "set_goal"} | both, builder=AT_FORK)


@pytest.mark.parametrize("given", [{"goal_time": "4..9s"}, {"goal_speed": "6..12m/s"}])
def test_a_time_or_speed_alone_changes_nothing_else_of_the_goal(apply: Apply, given: dict[str, str]) -> None:
    applied = apply({"op": "set_goal", **given})
    (old,), new = read_scenario(applied.base).problem().goal.state_list, goal(applied)
    assert tuple(new.position.center) == pytest.approx(tuple(old.position.center))
    assert (new.position.length, new.position.width) == (old.position.length, old.position.width)
    if "goal_time" in given:
        assert (new.time_step.start, new.time_step.end) == (40, 90)
        assert not hasattr(new, "velocity") or new.velocity is None
    else:
        assert (new.time_step.start, new.time_step.end) == (old.time_step.start, old.time_step.end)
        assert (new.velocity.start, new.velocity.end) == (6.0, 12.0)
    assert applied.outcome.edits[0].verdict == "done"


def test_a_time_given_alone_stays_when_the_goal_moves_and_the_place_stays_when_the_time_changes(apply: Apply) -> None:
    time, place = {"op": "set_goal", "goal_time": "8..14s"}, {"op": "set_goal", "to": ["11"], "position": "beginning"}
    for edits in ((time, place), (place, time)):
        applied = apply(*edits)
        new = goal(applied)
        assert (new.time_step.start, new.time_step.end) == (80, 140)
        assert tuple(new.position.center) == pytest.approx((200.0, 0.0), abs=0.01)
        assert [one.verdict for one in applied.outcome.edits] == ["done", "done"]


def test_a_time_given_alone_that_no_vehicle_can_meet_is_refused(apply: Apply) -> None:
    with pytest.raises(NotPossible):
        apply({"op": "set_goal", "goal_time": "<=0.5s"})


def test_the_valid_places_of_a_goal_contain_the_lanelet_of_the_ego_itself(apply: Apply) -> None:
    with pytest.raises(InvalidRequest) as refused:
        apply({"op": "set_goal"})
    for key in refused.value.valid:
        assert apply({"op": "set_goal", "to": [key], "goal_time": "<=60s"}).outcome.edits[0].done
