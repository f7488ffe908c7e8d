"""Newly drawn planning problems, and the planners' outcomes on them.

Any recorded car of a scenario replaces the ego at any step of its recording. Its goal is its last recorded position, at
any time up to the recording's end.
"""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.scenario.state import CustomState, InitialState

from plannerforge.engine.commonroad import LoadedScenario, Track, read_scenario, recorded_tracks
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import make_planner, simulate
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.runs import Prediction

from ..harness import process_pool
from .failure_causes import is_wrap

_LEAST_STEPS, _SHORTEST_M = 20, 10.0
"""Least time of a recording after the ego's start, and least distance of its goal (chosen)."""
_LOST = "lost"


@dataclass(frozen=True)
class Drive:
    """The result of one planner: ``outcome`` of the run, ``lost`` if it raised; ``trapped``: see ``is_wrap``."""

    name: str
    config: str
    prediction: Prediction
    outcome: str
    reason: str
    trapped: bool = False

    @property
    def is_lost(self) -> bool:
        """True if there is no run."""
        return self.outcome == _LOST


def drawn_problem(
    loaded: LoadedScenario, draws: random.Random, suits: Callable[[PlanningProblem, Sequence[Track]], bool]
) -> LoadedScenario | None:
    """Return the scenario with one of its cars as the ego from a step of its recording, or None if no draw is suitable.

    Args:
        loaded: the scenario; the car is removed from it.
        draws: chooses the car, and one step of each.
        suits: decides whether a problem is suitable among the other road users.
    """
    tracks = recorded_tracks(loaded.scenario)
    cars = [track for track in tracks.values() if track.kind == "car" and len(track.positions) > _LEAST_STEPS]
    draws.shuffle(cars)
    for car in cars:
        problem = _problem_of(car, draws.randrange(len(car.positions) - _LEAST_STEPS))
        if suits(problem, [track for track in tracks.values() if track is not car]):
            loaded.scenario.remove_obstacle(loaded.scenario.obstacle_by_id(car.obstacle_id))
            return replace(loaded, planning_problems=PlanningProblemSet([problem]))
    return None


def _problem_of(car: Track, index: int) -> PlanningProblem:
    """Return the problem from one of the car's states to its last recorded position, at any step up to its last."""
    start = InitialState(
        time_step=car.first_step + index,
        position=np.array(car.positions[index], dtype=float),
        orientation=float(car.headings_rad[index]),
        velocity=float(car.speeds_mps[index]),
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    end = Rectangle(
        car.length_m, car.width_m, center=np.array(car.positions[-1]), orientation=float(car.headings_rad[-1])
    )
    goal = CustomState(time_step=Interval(start.time_step + 1, car.last_step), position=end)
    return PlanningProblem(car.obstacle_id, start, GoalRegion([goal]))


def fresh_drives(
    files: Sequence[Path], draws: Sequence[str], configs: Sequence[str], predictions: Sequence[Prediction], workers: int
) -> list[Drive]:
    """Run all configurations with all predictions on a problem for each draw; the same text draws the same problem."""
    job = partial(_drives, tuple(files), tuple(configs), tuple(predictions))
    with process_pool(workers) as pool:
        return [drive for drives in pool.map(job, draws) for drive in drives]


def _drives(files: Sequence[Path], configs: Sequence[str], predictions: Sequence[Prediction], seed: str) -> list[Drive]:
    loaded = _drawn(files, random.Random(seed))  # noqa: S311 - a sample, no secret
    return [_drive(loaded, config, prediction) for config in configs for prediction in predictions]


def _drawn(files: Sequence[Path], draws: random.Random) -> LoadedScenario:
    """Return a problem of any of these files; draw again if a file has none."""
    found = None
    while found is None:
        found = drawn_problem(read_scenario(draws.choice(files)), draws, _leads_away)
    return found


def _leads_away(problem: PlanningProblem, _others: Sequence[Track]) -> bool:
    goal = problem.goal.state_list[0].position.center
    return bool(np.linalg.norm(goal - problem.initial_state.position) >= _SHORTEST_M)


def _drive(loaded: LoadedScenario, config: str, prediction: Prediction) -> Drive:
    problem, configuration = loaded.problem(), built_in(config)
    name = f"{loaded.benchmark_id}, car {problem.planning_problem_id} at step {problem.initial_state.time_step}"
    planner = make_planner(configuration.planner)
    try:
        run = simulate(loaded.scenario, problem, configuration, planner, prediction, silent)
    except PlannerForgeError as error:
        return Drive(name, config, prediction, _LOST, error.text)
    except Exception as error:  # noqa: BLE001 - a defect of ours is a lost run and not the bench's end
        return Drive(name, config, prediction, _LOST, repr(error))
    last: Mapping[str, int] = run.rejections[-1] if run.rejections else {}
    trapped = run.final.outcome == "infeasible" and is_wrap(last)
    return Drive(name, config, prediction, run.final.outcome, run.final.reason, trapped)
