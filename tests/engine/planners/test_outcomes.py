"""Every outcome is told apart, and what nobody can solve is said before the run."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from commonroad.scenario.state import CustomState
from support.planning import (
    configuration,
    drive,
    goal_state,
    lanelet_along,
    network_of,
    parked_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.idm import IntelligentDriver
from plannerforge.engine.planners.interface import Observation, Plan, PlannedTrajectory, PlanningTask
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.planners.simulation import DrivenRun
from plannerforge.schemas.runs import InvalidReason, Outcome

ROAD = straight_road(400.0, lanes=2)
TEN_MPS = 10.0


class Cruise:
    """Straight on along the x axis; it keeps its speed until ``stop_m`` and stands there."""

    def __init__(self, stop_m: float = math.inf) -> None:
        self._stop_m = stop_m

    def reset(self, task: PlanningTask) -> None:
        self._step_s = task.step_s

    def plan(self, observation: Observation) -> Plan:
        ego, count = observation.ego, 16
        x = np.minimum(ego.position[0] + np.arange(count) * self._step_s * TEN_MPS, max(self._stop_m, ego.position[0]))
        return Plan(
            PlannedTrajectory(
                positions=np.stack([x, np.full(count, ego.position[1])], axis=1),
                headings_rad=np.zeros(count),
                speeds_mps=np.where(x < self._stop_m, TEN_MPS, 0.0),
                accelerations_mps2=np.zeros(count),
            )
        )


def cruise(*goals: object, stop_m: float = math.inf) -> DrivenRun:
    return drive(scenario_on(ROAD), problem_for(*goals), planner=Cruise(stop_m))  # type: ignore[arg-type]


AT_40 = rectangle_at(40.0, 0.0)


@pytest.mark.parametrize(
    ("run", "outcome", "said"),
    [
        (lambda: cruise(goal_state((35, 45), AT_40)), "goal_reached", "step 35"),
        (lambda: cruise(goal_state((70, 80), AT_40)), "goal_early", "its time is 7.0 to 8.0 s"),
        (lambda: cruise(goal_state((20, 30), AT_40)), "goal_late", "0.4 s too late"),
        (lambda: cruise(goal_state((35, 45), AT_40, speed=(2.0, 4.0))), "goal_missed", "drove out of the goal"),
        (lambda: cruise(goal_state((20, 30), AT_40, speed=(2.0, 4.0))), "goal_late", "drove out of the goal"),
        (
            lambda: cruise(goal_state((30, 40), rectangle_at(40.0, 3.5, size=(12.0, 2.0)))),
            "goal_missed",
            "without entering it",
        ),
        (lambda: cruise(goal_state((30, 40), speed=(20.0, 25.0))), "goal_missed", "conditions unmet"),
        (lambda: cruise(goal_state((35, 45), AT_40), stop_m=20.0), "timeout", "short of the goal region's end"),
        (lambda: cruise(goal_state((60, 70), AT_40, speed=(2.0, 4.0)), stop_m=40.0), "goal_missed", "was in the goal"),
    ],
)
def test_early_late_missed_and_no_arrival_are_different_outcomes(
    run: Callable[[], DrivenRun], outcome: Outcome, said: str
) -> None:
    final = run().final
    assert final.outcome == outcome
    assert said in final.reason
    assert final.invalid_reason is None


def test_one_of_several_goal_states_in_its_time_is_enough() -> None:
    run = cruise(goal_state((70, 80), AT_40), goal_state((55, 65), rectangle_at(60.0, 0.0)))
    assert run.final.outcome == "goal_reached"


def test_the_time_limit_is_1_7_times_the_goal_s_last_step() -> None:
    run = cruise(goal_state((35, 45), AT_40), stop_m=20.0)
    assert run.states[-1].step == math.ceil(1.7 * 45)
    assert "1.7 times" in run.final.reason


def at_start_of(*goals: object, **changes: object) -> DrivenRun:
    scenario = scenario_on(ROAD, *changes.pop("obstacles", ()))  # type: ignore[misc,call-overload]
    return drive(scenario, problem_for(*goals, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("run", "code", "said"),
    [
        (lambda: at_start_of(), "no_goal_state", "no goal state"),
        (
            lambda: at_start_of(goal_state((35, 45), AT_40), obstacles=(parked_car(9, (2.0, 0.0)),)),
            "initial_collision",
            "obstacle 9",
        ),
        (lambda: at_start_of(goal_state((35, 45), AT_40), position=(0.0, 30.0)), "ego_off_road", "not on a lanelet"),
        (lambda: at_start_of(goal_state((35, 45), AT_40), position=(0.0, -2.5)), "ego_off_road", "off the road"),
        (lambda: at_start_of(goal_state((35, 45), rectangle_at(40.0, 60.0))), "goal_unreachable", "lanelet"),
        (lambda: at_start_of(goal_state((20, 21), rectangle_at(300.0, 0.0))), "goal_out_of_time", "294.0 m away"),
        (
            lambda: at_start_of(goal_state((10, 12), rectangle_at(12.0, 0.0), speed=(25.0, 30.0))),
            "goal_out_of_time",
            "25.0 to 30.0 m/s is unreachable from 10.0 m/s in 1.2 s",
        ),
        (lambda: at_start_of(goal_state((2, 4), speed=(0.0, 1.0))), "goal_out_of_time", "0.0 to 1.0 m/s"),
    ],
)
def test_an_unsolvable_problem_is_reported_before_the_run(
    run: Callable[[], DrivenRun], code: InvalidReason, said: str
) -> None:
    driven = run()
    assert (driven.final.outcome, driven.final.invalid_reason) == ("invalid", code)
    assert said in driven.final.reason
    assert not driven.plans


def test_a_goal_on_lanes_without_a_route_is_unreachable() -> None:
    problem = problem_for(goal_state((35, 45), rectangle_at(0.0, 40.0)))
    lanes = [np.stack([np.linspace(-20.0, 100.0, 25), np.full(25, y)], axis=1) for y in (0.0, 40.0)]
    run = drive(scenario_on(network_of(*(lanelet_along(lane, 1 + i) for i, lane in enumerate(lanes)))), problem)
    assert run.final.invalid_reason == "goal_unreachable"
    assert "no route leads from lanelet 1" in run.final.reason


@pytest.mark.parametrize("lateral_m", [0.0, 3.5])
def test_a_goal_behind_the_ego_without_a_route_back_is_unreachable(lateral_m: float) -> None:
    goal = goal_state((35, 45), rectangle_at(-12.0, lateral_m, size=(8.0, 3.0)))
    run = drive(scenario_on(straight_road(lanes=2)), problem_for(goal))
    assert (run.final.outcome, run.final.invalid_reason) == ("invalid", "goal_unreachable")
    assert "8.0 m behind the ego" in run.final.reason


def test_a_goal_behind_the_ego_on_a_ring_road_is_tried() -> None:
    angle = np.linspace(0.0, math.tau, 81)
    ring = 30.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
    halves = (
        lanelet_along(ring[:41], 1, predecessor=[2], successor=[2]),
        lanelet_along(ring[40:], 2, predecessor=[1], successor=[1]),
    )
    goal = goal_state((150, 300), rectangle_at(*ring[3], size=(4.0, 3.0)))
    problem = problem_for(goal, position=ring[10])
    problem.initial_state.orientation = float(angle[10])
    run = drive(scenario_on(network_of(*halves)), problem, configuration("idm"), planner=IntelligentDriver())
    assert run.final.outcome != "invalid"


def test_a_goal_around_the_ego_is_not_behind_it() -> None:
    goal = goal_state((35, 45), rectangle_at(-5.0, 0.0, size=(12.0, 3.5)))
    assert drive(scenario_on(ROAD), problem_for(goal, speed_mps=0.0)).final.outcome != "invalid"


def test_a_goal_that_one_state_can_still_reach_is_tried() -> None:
    run = cruise(goal_state((20, 21), rectangle_at(300.0, 0.0)), goal_state((35, 45), AT_40))
    assert run.final.outcome == "goal_reached"


NEAR_IN_TIME, FAR_IN_TIME = goal_state((35, 45), AT_40), goal_state((90, 100), rectangle_at(100.0, 0.0))
NEVER = goal_state((20, 21), rectangle_at(300.0, 0.0))
BESIDE_IN_TIME = goal_state((60, 70), rectangle_at(70.0, 3.5))


@pytest.mark.parametrize("planner", ["frenetix:Default", "idm"])
@pytest.mark.parametrize("goals", [(NEAR_IN_TIME, FAR_IN_TIME), (NEVER, NEAR_IN_TIME), (NEVER, BESIDE_IN_TIME)])
def test_the_order_of_goal_states_does_not_count_and_one_within_reach_is_aimed_at(
    planner: str, goals: tuple[CustomState, CustomState]
) -> None:
    runs = [
        drive(
            scenario_on(ROAD), problem_for(*order), configuration(planner), planner=make_planner(planner.split(":")[0])
        )
        for order in (goals, goals[::-1])
    ]
    assert [run.final.outcome for run in runs] == ["goal_reached"] * 2
    assert runs[0].final.reason == runs[1].final.reason
    assert [state.speed_mps for state in runs[0].states] == [state.speed_mps for state in runs[1].states]


def test_of_two_reachable_goal_states_the_one_near_the_present_speed_is_chosen() -> None:
    hasty = goal_state((35, 45), rectangle_at(120.0, 0.0))
    for order in ((hasty, NEAR_IN_TIME), (NEAR_IN_TIME, hasty)):
        assert drive(scenario_on(ROAD), problem_for(*order)).states[-1].position[0] < 60.0
