"""A goal that no car can meet in its time at its speed is refused, with what can be met."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.builders import Lane, Problem, ScenarioBuilder, arc, line, town_road
from support.edits import Apply

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.vehicles import can_be_between, latest_passing_s, least_time_s
from plannerforge.engine.vehicles.models import LARGEST_ACCELERATION_MPS2, LARGEST_SPEED_MPS
from plannerforge.schemas.errors import InvalidRequest, NotPossible

FAST = replace(town_road(), problems=(Problem(start=(40.0, 0.0, 0.0, 22.0), steps=(0, 60)),)).cut(61)
NEAR = {"op": "set_goal", "to": ["1"], "position": "46m"}


@given(
    st.floats(0.0, LARGEST_SPEED_MPS),
    st.lists(st.floats(-LARGEST_ACCELERATION_MPS2, LARGEST_ACCELERATION_MPS2), min_size=1, max_size=40),
)
def test_every_motion_within_the_limits_is_possible(speed: float, accelerations: list[float]) -> None:
    now, driven = speed, 0.0
    for acceleration in accelerations:
        after = min(max(now + acceleration * 0.1, 0.0), LARGEST_SPEED_MPS)
        now, driven = after, driven + (now + after) / 2 * 0.1
    time = 0.1 * len(accelerations)
    assert can_be_between(speed, (driven, driven), np.array([time]), np.array([now])).all()
    assert least_time_s(speed, driven) <= time + 1e-6
    assert latest_passing_s(speed, driven + 1e-3) >= time


def test_the_bounds_are_full_braking_and_full_acceleration() -> None:
    assert latest_passing_s(23.0, 23.0) == math.inf
    assert latest_passing_s(23.0, 17.25) == pytest.approx(1.0)
    assert least_time_s(0.0, 23.0) == pytest.approx(2.0)
    assert not can_be_between(10.0, (0.0, 100.0), np.array([1.0]), np.array([22.0])).any()
    assert not can_be_between(10.0, (16.0, 16.0), np.array([1.0]), np.array([10.0])).any()


def test_the_sentence_names_time_and_speed(apply: Apply) -> None:
    asked = {"op": "set_goal", "to": ["11"], "goal_time": "8..12s", "goal_speed": "5..10m/s"}
    assert "from 8.0 to 12.0 s, at 5.0 to 10.0 m/s" in apply(asked).outcome.edits[0].what
    assert "from 6.0 to 15.0 s, at any speed" in apply({"op": "set_goal", "to": ["11"]}).outcome.edits[0].what


def test_a_time_after_every_car_has_passed_is_refused_with_the_latest_start(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="has passed the goal") as caught:
        apply({**NEAR, "goal_time": "3..4s"}, builder=FAST)
    (latest,) = re.findall(r"begins by (\d\.\d) s", caught.value.valid[0])
    assert apply({**NEAR, "goal_time": f"{latest}..4s"}, builder=FAST).outcome.edits[0].done


def test_a_goal_on_a_circular_road_may_be_passed_first(apply: Apply) -> None:
    ring = (
        Lane(1, arc((0.0, 20.0), 20.0, -math.pi / 2, math.pi / 2), successors=(2,), predecessors=(2,)),
        Lane(2, arc((0.0, 20.0), 20.0, math.pi / 2, 3 * math.pi / 2), successors=(1,), predecessors=(1,)),
    )
    start = Problem(start=(4.0, 0.4, 0.2, 22.0), goal=(20.0, 20.0, 4.0, 3.0), steps=(100, 150))
    goal = {"op": "set_goal", "to": ["1"], "position": "9m", "goal_time": "10..15s"}
    assert apply(goal, builder=ScenarioBuilder(ring, problems=(start,))).outcome.edits[0].done


@pytest.mark.parametrize("speed", [">=49m/s", "0..1m/s"])
def test_an_impossible_speed_at_the_goal_is_refused_with_possible_ones(apply: Apply, speed: str) -> None:
    place = {**NEAR, "position": "85m" if speed.startswith(">") else "49m", "goal_time": "<=5s"}
    with pytest.raises(NotPossible, match="no car that starts at 22") as caught:
        apply({**place, "goal_speed": speed}, builder=FAST)
    (possible,) = re.findall(r"goal_speed='(.*)'", caught.value.valid[0])
    assert apply({**place, "goal_speed": possible}, builder=FAST).outcome.edits[0].done


def test_a_time_after_the_scenario_s_end_is_refused(apply: Apply) -> None:
    with pytest.raises(InvalidRequest, match=r"after the scenario's end at 6\.0 s") as caught:
        apply({"op": "set_goal", "to": ["11"], "goal_time": "1000..2000s"}, builder=FAST)
    assert caught.value.valid == ("'<=6.0s'",)


def test_a_later_start_must_not_make_the_goal_impossible(apply: Apply) -> None:
    goal = {"op": "set_goal", "to": ["1"], "position": "150m", "goal_time": "<=5s"}
    back = {"op": "set_ego", "at": "1", "position": "2m", "speed": "0m/s"}
    with pytest.raises(NotPossible, match=r"from the ego's new start: .*148\.0 m within 5\.0 s") as caught:
        apply(goal, back, builder=FAST)
    assert "set_goal" in str(caught.value.next_step)
    assert apply(back, {**goal, "goal_time": "<=6s"}, builder=FAST).outcome.edits[1].done


def test_nor_may_it_leave_the_file_s_own_goal_behind(apply: Apply) -> None:
    with pytest.raises(NotPossible, match="behind the ego"):
        apply({"op": "set_ego", "at": "1", "position": "180m"}, builder=FAST)


def test_a_car_s_own_end_is_a_goal_that_it_meets(apply: Apply) -> None:
    xml_speed = "<velocity><intervalStart>20</intervalStart><intervalEnd>25</intervalEnd></velocity></goalState>"

    class Slow(ScenarioBuilder):
        def xml(self) -> str:
            return super().xml().replace("</goalState>", xml_speed)

    slow = Slow(FAST.lanes, FAST.vehicles, problems=FAST.problems)
    applied = apply({"op": "set_ego", "vehicles": ["35"]}, builder=slow)
    speeds = read_scenario(applied.xml).problem().goal.state_list[0].velocity
    assert (speeds.start, speeds.end) == pytest.approx((8.0, 25.0))


def test_a_change_to_a_lane_that_begins_elsewhere_adds_no_distance(apply: Apply) -> None:
    lanes = (
        Lane(1, line((0.0, 0.0), (200.0, 0.0)), left=(2, True)),
        Lane(2, line((60.0, 3.5), (200.0, 3.5)), right=(1, True)),
    )
    start = Problem(start=(80.0, 0.0, 0.0, 10.0), goal=(150.0, 0.0, 8.0, 3.0))
    goal = {"op": "set_goal", "to": ["2"], "position": "80m"}
    told = apply(goal, builder=ScenarioBuilder(lanes, problems=(start,))).outcome.edits[0].what
    assert "60.0 m ahead of the ego" in told
