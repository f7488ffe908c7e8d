"""Limits of the numbers in a scenario: values beyond them fill the memory or break the geometry of later steps.

Called once for a file that is taken in, after it was read: commonroad-io accepts any number.
"""

import math
from collections.abc import Iterable
from itertools import chain
from typing import Any

import numpy as np

from ...schemas.errors import UnsafeInput
from .reader import RecordedScenario
from .tracks import last_recorded_step, middle_of

_LONGEST_COORDINATE_M = 1e8
"""Physics: more than twice around the earth. Headings and speeds are held to it too, as numbers without a unit."""
_LARGEST_OBSTACLE_M = 1000.0
"""Chosen: longer than any train or ship."""
_LONGEST_STEP_S = 10.0
"""Chosen: recordings of traffic have 0.04 s to 1 s; between longer steps no motion can be told."""
_LAST_STEP = 1_000_000
"""More than a day at 0.1 s; longer scenarios would fill the memory of whatever goes through their steps."""


def refuse_values_beyond_limits(recorded: RecordedScenario) -> None:
    """Check the time step, coordinates, sizes, states and times of a scenario.

    Raises:
        UnsafeInput: one is not finite or far beyond what occurs, naming where it stands.
    """
    scenario, step_s = recorded.loaded.scenario, recorded.loaded.step_s
    if not 0.0 < step_s <= _LONGEST_STEP_S:
        raise UnsafeInput(f"timeStepSize is {step_s:g} s", valid=[f"more than 0 and at most {_LONGEST_STEP_S:g} s"])
    for lanelet in scenario.lanelet_network.lanelets:
        if not _within(lanelet.left_vertices) or not _within(lanelet.right_vertices):
            raise UnsafeInput(f"lanelet {lanelet.lanelet_id} has coordinates that are not finite or beyond 1e8 m")
    for obstacle in scenario.obstacles:
        if not _has_possible_size(getattr(obstacle, "obstacle_shape", None)):  # phantom obstacles have none
            raise UnsafeInput(
                f"obstacle {obstacle.obstacle_id} has a size that is not above 0 and at most {_LARGEST_OBSTACLE_M:g} m"
            )
    for obstacle in scenario.dynamic_obstacles:
        _refuse_not_finite(obstacle)
    for track in recorded.tracks.values():
        if not (_within(track.positions) and _within(track.headings_rad) and _within(track.speeds_mps)):
            raise UnsafeInput(f"obstacle {track.obstacle_id} has states that are not finite or beyond 1e8")
        _refuse_late(f"obstacle {track.obstacle_id}", [track.first_step, track.last_step])
    _refuse_late("the recording", [last_recorded_step(scenario)])
    for key, problem in sorted(recorded.loaded.planning_problems.planning_problem_dict.items()):
        state = problem.initial_state
        values = np.array([*np.asarray(state.position, dtype=float), float(state.velocity), float(state.orientation)])
        if not _within(values):
            raise UnsafeInput(f"planning problem {key} has an initial state that is not finite or beyond 1e8")
        _refuse_late(f"planning problem {key}", chain([int(state.time_step)], _goal_steps(problem)))


def _refuse_not_finite(obstacle: Any) -> None:
    """A value that is no number is not one that was left out: every file made from this one would keep it.

    Of plain trajectories, which are read apart, the first and the last state are here; the others were found finite.
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
        if not 0 <= step <= _LAST_STEP:
            raise UnsafeInput(f"{what} has the time step {step:,}", valid=[f"0 to {_LAST_STEP:,}"])


def _has_possible_size(shape: Any) -> bool:
    """Whether length, width and radius, those that the shape has, are above 0 and not beyond the limit."""
    sizes = [getattr(shape, name, None) for name in ("length", "width", "radius")]
    return all(0.0 < float(size) <= _LARGEST_OBSTACLE_M for size in sizes if size is not None)


def _within(values: Any) -> bool:
    array = np.asarray(values, dtype=float)
    return bool(np.all(np.isfinite(array)) and np.all(np.abs(array) < _LONGEST_COORDINATE_M))
