"""Counts the goals that CommonRoad's own checker accepts, and the motions beyond the vehicle's limits.

``official_goals_gt`` and ``official_goals_cv``: share of the runs of ``frenetix:Default`` on solvable problems that
reach the goal by a motion that ``valid_solution`` accepts, with ground-truth and constant-velocity prediction. A
problem is solvable if it is valid and the checker accepts its first state.

``beyond_limits``: the share of motions of all built-in planners, whatever their outcome, that exceed their vehicle's
limits.

The judge knows a run only by its exported solution file. It is the checker itself. Its road boundary is a triangulation
if the package ``triangle`` is installed (it is not free, so it is not a dependency), otherwise rectangles along the
outline of the lanelets. The limits are recomputed from positions, headings and speeds, without the steering angles in
the file.
"""

import importlib.util
import math
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.solution import CommonRoadSolutionReader, Solution
from commonroad.planning.planning_problem import PlanningProblemSet
from commonroad_dc import pycrcc
from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
from commonroad_dc.feasibility import solution_checker
from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics

from plannerforge.engine.execution import silent
from plannerforge.engine.planners import run_planner, write_solution
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.artifacts import SolutionRequest
from plannerforge.schemas.planning import PlannerConfiguration, RunRequest, RunResponse
from plannerforge.schemas.runs import Prediction

from ..harness import Figures, SeededBench

_JUDGED = "frenetix:Default"
_OTHERS = ("mp_rbfn:Default", "idm:Default", "fiss:Default")
_PREDICTIONS: dict[str, Prediction] = {"official_goals_gt": "ground_truth", "official_goals_cv": "constant_velocity"}
_TOLERANCE = 1e-3
"""Share of a limit allowed for rounding."""
_ROLLING_M = 0.02
"""The checker's tolerance for the position of a step."""
_MOVING_MPS = 0.1
"""In slower steps the turn does not determine the steering angle."""


def measure(bench: SeededBench) -> Figures:
    """Drive, export and judge."""
    driven, beyond, figures = 0, 0, dict[str, float]()
    for key, prediction in _PREDICTIONS.items():
        goals = solvable = 0
        verdicts: Counter[str] = Counter()
        for run in runs(bench, _JUDGED, prediction):
            driven, beyond = driven + 1, beyond + run.is_beyond_vehicle
            if run.refused_at_start:
                verdicts["refused at the start"] += 1
                continue
            solvable += 1
            if run.response.record.outcome in ("goal_reached", "goal_refused"):
                verdict = run.verdict
                verdicts[verdict] += 1
                goals += verdict == "valid"
        figures[key] = goals / max(solvable, 1)
        sys.stderr.write(
            f"{_JUDGED}, {prediction}: {goals} of {solvable} accepted; at the goal: {dict(verdicts)}" + "\n"
        )
    for name in _OTHERS:
        exceeded = [(run.scenario, run.is_beyond_vehicle) for run in runs(bench, name, "constant_velocity")]
        found = [scenario for scenario, is_beyond in exceeded if is_beyond]
        driven, beyond = driven + len(exceeded), beyond + len(found)
        sys.stderr.write(f"{name}: {len(found)} of {len(exceeded)} beyond the vehicle {found[:5]}\n")
    boundary = "its triangulation" if _has_triangles() else "its rectangles: the package triangle is not installed"
    sys.stderr.write(f"boundary of the checker: {boundary}\n")
    return {**figures, "beyond_limits": beyond / max(driven, 1)}


def scenario_files(bench: SeededBench) -> list[Path]:
    """Return the public scenarios, or evenly many of them for a sample."""
    files = sorted((bench.shared / "data" / "commonroad").glob("*.xml"))
    if bench.limit is None or bench.limit >= len(files):
        return files
    return [files[round(place)] for place in np.linspace(0, len(files) - 1, bench.limit)]


def runs(bench: SeededBench, name: str, prediction: Prediction) -> "Iterator[JudgedRun]":
    """Yield a run on each scenario, but for invalid problems."""
    configuration = built_in(name)
    for path in scenario_files(bench):
        request = RunRequest(
            run_id="run_0",
            scenario_path=str(path),
            scenario_id=path.stem,
            configuration=configuration,
            prediction=prediction,
        )
        response = run_planner(request, silent)
        if response.record.outcome != "invalid" and len(response.steps.x_m) > 1:
            yield JudgedRun(path, configuration, response, bench.scratch)


@dataclass(frozen=True)
class JudgedRun:
    """A run, its solution file, and the checker's verdict."""

    path: Path
    configuration: PlannerConfiguration
    response: RunResponse
    folder: Path

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return self.path.stem

    @cached_property
    def solution(self) -> Solution:
        """The run as the product exports it."""
        steps, target = self.folder / "steps.json", self.folder / "run.solution.xml"
        steps.write_text(self.response.steps.model_dump_json(), encoding="utf-8")
        request = SolutionRequest(
            record=self.response.record,
            configuration=self.configuration,
            scenario_path=str(self.path),
            steps_path=str(steps),
            target_path=str(target),
        )
        write_solution(request, silent)
        return CommonRoadSolutionReader.open(str(target))

    @cached_property
    def opened(self) -> tuple[Any, PlanningProblemSet]:
        """The scenario and the run's planning problem, read anew."""
        scenario, problems = CommonRoadFileReader(str(self.path)).open()
        problem = problems.planning_problem_dict[self.response.record.problem_id]
        return scenario, PlanningProblemSet([problem])

    @property
    def verdict(self) -> str:
        """The verdict of ``valid_solution``: valid, infeasible, or the name of its exception."""
        return official_verdict(*self.opened, self.solution)

    @property
    def refused_at_start(self) -> bool:
        """True if the checker sees the body off the road at the start."""
        scenario, _ = self.opened
        steps, solved = self.response.steps, self.solution.planning_problem_solutions[0]
        shape = VehicleDynamics.from_model(solved.vehicle_model, solved.vehicle_type).shape
        body = pycrcc.RectOBB(shape.length / 2, shape.width / 2, steps.heading_rad[0], steps.x_m[0], steps.y_m[0])
        return bool(_boundary(scenario).collide(body))

    @property
    def is_beyond_vehicle(self) -> bool:
        """True if the driven motion exceeds a limit of the vehicle."""
        scenario, _ = self.opened
        return is_beyond_vehicle(self.solution, float(scenario.dt))


def official_verdict(scenario: Any, problems: PlanningProblemSet, solution: Solution) -> str:
    """Return the verdict of ``valid_solution`` on a solution: valid, infeasible, or the name of its exception."""
    try:
        with patch.object(solution_checker, "_construct_boundary_checker", _boundary):
            accepted, _ = solution_checker.valid_solution(scenario, problems, solution)
    except solution_checker.SolutionCheckerException as refusal:
        return type(refusal).__name__
    return "valid" if accepted else "infeasible"


def _has_triangles() -> bool:
    return importlib.util.find_spec("triangle") is not None


_TRIANGULATED = solution_checker._construct_boundary_checker


def _boundary(scenario: Any) -> Any:
    """Return the region off the road, as the checker sees it."""
    if _has_triangles():
        return _TRIANGULATED(scenario)
    checker = pycrcc.CollisionChecker()
    _, rectangles = create_road_boundary_obstacle(scenario, method="obb_rectangles")
    checker.add_collision_object(rectangles)
    return checker


def is_beyond_vehicle(solution: Solution, step_s: float) -> bool:
    """Return True if a motion exceeds the limits of its vehicle, judged only by positions, headings and speeds.

    The rear axle must move along its heading at the given speeds. The steering angle of a step is the one that turns
    the vehicle as observed, and between moving steps it must change within the largest rate.
    """
    solved = solution.planning_problem_solutions[0]
    vehicle = VehicleDynamics.from_model(solved.vehicle_model, solved.vehicle_type).parameters
    states = solved.trajectory.state_list
    place = np.array([state.position for state in states])
    heading = np.unwrap([state.orientation for state in states])
    speed = np.array([state.velocity for state in states])
    rear = place - vehicle.b * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    moved, turned = np.diff(rear, axis=0), np.diff(heading)
    middle, mean = (heading[1:] + heading[:-1]) / 2, (speed[1:] + speed[:-1]) / 2
    aside = moved[:, 1] * np.cos(middle) - moved[:, 0] * np.sin(middle)
    along = moved[:, 0] * np.cos(middle) + moved[:, 1] * np.sin(middle)
    slides = (np.abs(aside) > _ROLLING_M).any() or (np.abs(along - mean * step_s) > _ROLLING_M).any()
    gained = np.diff(speed) / step_s
    largest = vehicle.longitudinal.a_max * (1 + _TOLERANCE)
    slips = (np.hypot(gained, mean * turned / step_s) > largest).any()
    powered = vehicle.longitudinal.v_switch / np.maximum(mean, vehicle.longitudinal.v_switch)
    overpowered = (gained > largest * powered).any()
    moving = np.flatnonzero(mean > _MOVING_MPS)
    angles = np.arctan((vehicle.a + vehicle.b) * turned[moving] / (mean[moving] * step_s))
    too_far = (np.abs(angles) > vehicle.steering.max * (1 + _TOLERANCE)).any()
    rates = np.abs(np.diff(angles)) / (np.diff(moving) * step_s)
    too_quick = (rates > vehicle.steering.v_max * (1 + _TOLERANCE)).any()
    too_fast = (speed > vehicle.longitudinal.v_max * (1 + _TOLERANCE)).any() or speed.min() < -math.ulp(1.0)
    return bool(slides or slips or overpowered or too_far or too_quick or too_fast)
