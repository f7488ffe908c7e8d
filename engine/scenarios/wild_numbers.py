"""Refusing numbers that no scenario has, before they fill the memory or bend the geometry of whoever uses them."""

import math
from collections.abc import Iterable
from itertools import chain
from typing import Any

import numpy as np

from plannerforge.engine.scenarios.recorded_scenario import RecordedScenario
from plannerforge.engine.scenarios.tracks import last_recorded_step, middle_of
from plannerforge.schemas.errors import UnsafeInput

LONGEST_COORDINATE_M = 1e8
LARGEST_OBSTACLE_M = 1000.0
LONGEST_STEP_S = 10.0
LAST_STEP = 1_000_000
"""More than a day at 0.1 s; longer scenarios would fill the memory of whatever goes through their steps."""


def refuse_wild_numbers(read: RecordedScenario) -> None:
    """Look at step, coordinates, sizes, states and times of a scenario.

    Raises:
        UnsafeInput: one is not finite or far beyond what occurs, naming where it stands.
    """
    scenario, problems = read.loaded.scenario, read.loaded.planning_problems.planning_problem_dict
    if not 0.0 < read.loaded.step_s <= LONGEST_STEP_S:
        raise UnsafeInput(
            f"timeStepSize is {read.loaded.step_s:g} s", valid=[f"more than 0 and at most {LONGEST_STEP_S:g} s"]
        )
    for lanelet in scenario.lanelet_network.lanelets:
        if not _tame(lanelet.left_vertices) or not _tame(lanelet.right_vertices):
            raise UnsafeInput(f"lanelet {lanelet.lanelet_id} has coordinates that are not finite or beyond 1e8 m")
    for obstacle in scenario.obstacles:
        if not _sized(getattr(obstacle, "obstacle_shape", None)):  # phantom obstacles have none
            raise UnsafeInput(
                f"obstacle {obstacle.obstacle_id} has a size that is not above 0 and at most {LARGEST_OBSTACLE_M:g} m"
            )
    for obstacle in scenario.dynamic_obstacles:
        _refuse_unfinite(obstacle)
    for track in read.tracks.values():
        if not (_tame(track.positions) and _tame(track.headings_rad) and _tame(track.speeds_mps)):
            raise UnsafeInput(f"obstacle {track.obstacle_id} has states that are not finite or beyond 1e8")
        _refuse_late(f"obstacle {track.obstacle_id}", [track.first_step, track.last_step])
    _refuse_late("the recording", [last_recorded_step(scenario)])
    for key, problem in sorted(problems.items()):
        state = problem.initial_state
        values = np.array([*np.asarray(state.position, dtype=float), float(state.velocity), float(state.orientation)])
        if not _tame(values):
            raise UnsafeInput(f"planning problem {key} has an initial state that is not finite or beyond 1e8")
        _refuse_late(f"planning problem {key}", chain([int(state.time_step)], _goal_steps(problem)))


def _refuse_unfinite(obstacle: Any) -> None:
    """A value that is no number is not one that was left out: whatever is made of the file would keep it.

    Of plain trajectories, which are read apart, there are the first and the last state; the rest is finite.
    """
    trajectory = getattr(obstacle.prediction, "trajectory", None)
    for state in (obstacle.initial_state, *(trajectory.state_list if trajectory else ())):
        for name in state.used_attributes:
            value = getattr(state, name)
            if name != "position" and value is not None and not math.isfinite(middle_of(value)):
                raise UnsafeInput(
                    f"obstacle {obstacle.obstacle_id} has a {name} that is not finite at step {state.time_step}",
                    next_step=f"correct the {name} in the file, or leave it out of all states of the obstacle",
                )


def _goal_steps(problem: Any) -> Iterable[int]:
    steps = [goal.time_step for goal in problem.goal.state_list if getattr(goal, "time_step", None) is not None]
    return [int(end) for step in steps for end in (getattr(step, "start", step), getattr(step, "end", step))]


def _refuse_late(what: str, steps: Iterable[int]) -> None:
    for step in steps:
        if not 0 <= step <= LAST_STEP:
            raise UnsafeInput(f"{what} has the time step {step:,}", valid=[f"0 to {LAST_STEP:,}"])


def _sized(shape: Any) -> bool:
    """Whether length, width and radius, those that the shape has, can be those of a body."""
    sizes = [getattr(shape, name, None) for name in ("length", "width", "radius")]
    return all(0.0 < float(size) <= LARGEST_OBSTACLE_M for size in sizes if size is not None)


def _tame(values: Any) -> bool:
    array = np.asarray(values, dtype=float)
    return bool(np.all(np.isfinite(array)) and np.all(np.abs(array) < LONGEST_COORDINATE_M))
