"""FISS: it keeps the contract, drives what a vehicle can, searches as it is asked to, and does what its weights ask."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from support.planning import (
    FAR,
    configuration,
    drive_on_road,
    first_plan,
    goal_state,
    lanelet_along,
    moving_car,
    network_of,
    parked_car,
    problem_for,
    rectangle_at,
    task_on_road,
)

from plannerforge.engine.planners.driving.drivability import violated_limit
from plannerforge.engine.planners.external.conformance import check_planner
from plannerforge.engine.planners.fiss.core import SEARCHES
from plannerforge.engine.planners.fiss.corridor import lane_bands
from plannerforge.engine.planners.fiss.planner import Fiss
from plannerforge.engine.planners.interface import Observation, Plan, PlanningTask
from plannerforge.engine.planners.reference_path import build_reference_path
from plannerforge.engine.planners.registry import make_planner
from plannerforge.engine.scene.routing import find_route
from plannerforge.engine.tuning.configurations import changed_configuration, named_configuration
from plannerforge.engine.tuning.tunings import tuning_of
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas.planning import PlannerConfiguration

ORIGIN = np.zeros(2)


def settings_of(*settings: str, preset: str = "fiss:Default", changes: tuple[str, ...] = ()) -> PlannerConfiguration:
    base = named_configuration(preset)
    assert base is not None
    return changed_configuration(base, None, changes, settings)[0]


def task_for(speed: float, *obstacles: Any, settings: PlannerConfiguration | None = None, **options: Any) -> Any:
    return task_on_road(settings or configuration("fiss"), speed, *obstacles, **options)


def planned(task: PlanningTask, observation: Observation) -> Plan:
    return first_plan(Fiss(), task, observation)


def driven_run(*obstacles: Any, settings: PlannerConfiguration | None = None, **options: Any) -> Any:
    return drive_on_road(Fiss(), settings or configuration("fiss"), *obstacles, **options)


@pytest.mark.parametrize("search", range(len(SEARCHES)))
@pytest.mark.parametrize("speed", [0.0, 0.2, 10.0])
def test_it_keeps_the_contract(speed: float, search: int) -> None:
    chosen = settings_of(f"search={search}")
    for goal in (FAR, goal_state((40, 60), rectangle_at(60.0, 3.5))):
        task, observation = task_for(speed, parked_car(7, (40.0, 0.0)), goal=goal, settings=chosen)
        assert check_planner(lambda: make_planner("fiss"), task, observation) == ()


def test_its_plans_are_drivable() -> None:
    task, observation = task_for(12.0, parked_car(7, (45.0, 0.0)))
    trajectory = planned(task, observation).trajectory
    assert trajectory is not None
    assert violated_limit(trajectory, BMW_320I, 0.1) is None
    assert trajectory.steering_rad is not None
    rates = np.abs(np.diff(trajectory.steering_rad)) / 0.1
    assert rates.max() <= BMW_320I.maximum_steering_rate_radps + 1e-9


def test_it_swerves_around_a_parked_car() -> None:
    run = driven_run(parked_car(7, (60.0, 0.0)), lanes=2, goal=goal_state((70, 130), rectangle_at(110.0, 0.0)))
    assert run.final.outcome == "goal_reached"
    assert max(float(state.position[1]) for state in run.states) > 1.7


def test_it_stays_behind_a_slower_car_on_a_single_lane() -> None:
    run = driven_run(moving_car(7, (30.0, 0.0), (6.0, 0.0)), goal=goal_state((90, 100), rectangle_at(100.0, 0.0)))
    assert run.final.outcome != "collision"
    gaps = [30.0 + 0.6 * state.step - float(state.position[0]) for state in run.states]
    assert min(gaps) > 4.5


def test_it_starts_from_a_standstill_and_reaches_the_goal() -> None:
    run = driven_run(speed_mps=0.0, goal=goal_state((60, 120), rectangle_at(40.0, 0.0)))
    assert run.final.outcome == "goal_reached"


def test_a_blocked_standing_ego_stands_still() -> None:
    task, observation = task_for(0.0, parked_car(7, (5.0, 0.0)), lanes=1)
    plan = planned(task, observation)
    assert plan.trajectory is not None
    moved = np.linalg.norm(plan.trajectory.positions - plan.trajectory.positions[0], axis=1)
    assert moved.max() < 0.3


def test_the_searches_come_to_different_numbers_of_candidates() -> None:
    made = {}
    for number, name in enumerate(SEARCHES):
        task, observation = task_for(10.0, settings=settings_of(f"search={number}"))
        made[name] = planned(task, observation).candidates
    assert made["fop"] == made["fop_plus"] > made["fiss_plus"]
    assert made["fiss"] < made["fop"] / 10


def test_the_sampling_level_sets_the_number_of_candidates() -> None:
    counts = []
    for level in range(4):
        task, observation = task_for(10.0, settings=settings_of("search=0", f"sampling_level={level}"), lanes=1)
        counts.append(planned(task, observation).candidates)
    assert counts == [5 * (2 ** (level + 1) + 1) ** 2 for level in range(4)]


def test_costs_are_reported_by_the_terms_of_the_core() -> None:
    task, observation = task_for(10.0, moving_car(7, (25.0, 0.0), (7.0, 0.0)))
    costs = planned(task, observation).costs
    assert sorted(costs) == ["acceleration", "jerk", "lane_change", "lateral", "proximity", "speed", "time"]
    assert costs["proximity"] > 0


def test_candidates_that_are_shown_can_be_driven_and_differ() -> None:
    task, observation = task_for(10.0)
    planner = Fiss()
    planner.reset(task)
    assert list(planner.shown_candidates(5)) == []
    planner.plan(observation)
    shown = planner.shown_candidates(5)
    assert len(shown) == 5
    assert len({round(float(line[-1][0]), 3) for line in shown}) > 1


def test_rejected_candidates_are_counted_by_reason() -> None:
    task, observation = task_for(12.0, parked_car(7, (30.0, 0.0)), lanes=1)
    rejected = planned(task, observation).rejected
    assert rejected.get("collision", 0) + rejected.get("safety_distance", 0) > 0


def test_more_weight_on_distance_gives_more_distance() -> None:
    ahead = moving_car(7, (40.0, 0.0), (7.0, 0.0))
    plain, careful = (
        driven_run(ahead, settings=settings_of(preset=name), goal=FAR) for name in ("fiss:Plain", "fiss:Default")
    )
    nearest = [
        min(40.0 + 0.7 * state.step - float(state.position[0]) for state in run.states) for run in (plain, careful)
    ]
    assert nearest[0] < nearest[1]


def test_the_lanes_next_to_a_path_have_its_direction() -> None:
    task, _ = task_for(10.0, lanes=2)
    bands = lane_bands(task.network, task.reference)
    index = len(bands.stations_m) // 3
    assert bands.left.right_m[index] == pytest.approx(1.75, abs=0.01)
    assert bands.left.left_m[index] == pytest.approx(5.25, abs=0.01)
    assert bands.right.left_m[index] - bands.right.right_m[index] == 0.0


def test_a_lane_of_the_other_direction_is_not_entered() -> None:
    x = np.linspace(-20.0, 280.0, 61)
    mine, theirs = np.stack([x, np.zeros(61)], axis=1), np.stack([x[::-1], np.full(61, 3.5)], axis=1)
    network = network_of(lanelet_along(mine, 1), lanelet_along(theirs, 2))
    problem = problem_for(FAR)
    route = find_route(network, problem.goal, ORIGIN, 0.0, ahead_m=120.0)
    bands = lane_bands(network, build_reference_path(network, route, ORIGIN, 10.0))
    assert (bands.left.left_m - bands.left.right_m).max() == 0.0


def test_a_lane_change_of_the_route_costs_nothing_and_leaving_the_route_does() -> None:
    task, _ = task_for(10.0, goal=goal_state((80, 100), rectangle_at(160.0, 3.5)))
    bands = lane_bands(task.network, task.reference)
    assert bands.off_route(35.0) == (True, False)
    stays, _ = task_for(10.0)
    assert lane_bands(stays.network, stays.reference).off_route(35.0) == (True, True)


def test_the_search_setting_is_not_part_of_other_configurations() -> None:
    before, after = configuration("frenetix:Default"), settings_of("search=2")
    assert "search" not in before.settings.model_dump()
    assert after.settings == configuration("fiss").settings
    assert settings_of("search=0").config_id != configuration("fiss").config_id
    assert "search" in tuning_of("frenetix").idle_settings


SITUATIONS = (
    (moving_car(7, (12.0, 0.0), (8.0, 0.0)), moving_car(8, (-2.0, 3.5), (11.0, 0.0))),
    (moving_car(7, (30.0, 0.0), (6.0, 0.0)), moving_car(8, (2.0, 4.1), (10.5, 0.0))),
    (moving_car(9, (40.0, -27.5), (0.0, 6.0)),),
    (moving_car(9, (30.0, -22.0), (0.0, 6.0)),),
    (moving_car(7, (7.5, 0.0), (9.0, 0.0)), moving_car(8, (0.0, 3.6), (10.0, 0.0))),
    (moving_car(7, (22.0, 0.0), (8.5, 0.0)),),
)


@cache
def driven_as(situation: int, *changes: str) -> tuple[tuple[float, ...], ...]:
    """Where the ego drives in a situation under the default weights with changes; the default is driven once."""
    goal = goal_state((40, 45), rectangle_at(48.0, 0.0))
    run = driven_run(*SITUATIONS[situation], lanes=2, settings=settings_of(changes=changes), goal=goal)
    return tuple(tuple(state.position) for state in run.states)


@pytest.mark.parametrize("name", tuning_of("fiss").weights)
def test_each_weight_changes_the_driven_motion_in_some_situation(name: str) -> None:
    lowest, highest = tuning_of("fiss").limits.get(name, (0.0, 1e3))

    default = tuning_of("fiss").presets["Default"].weights[name]
    others = [f"{name}={value:g}" for value in (highest, lowest) if value != default]
    assert any(driven_as(number, change) != driven_as(number) for number in range(len(SITUATIONS)) for change in others)
