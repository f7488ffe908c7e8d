"""Checks exported solutions of runs reported as drivable with CommonRoad's drivability checker.

Frenetix, MP-RBFN and IDM drive 62 public scenarios (a fixed sample). The product exports each run as a CommonRoad
solution, and commonroad-io reads it back. If a run reached its goal and is reported within the limits of its vehicle,
the checker's ``valid_solution`` must accept it: planning problem solved, goal reached, no collision, on the road, and
each step feasible for the kinematic single-track model. Each step of other runs reported within the limits must be
feasible too. The edge of the road comes from the checker's rectangles, because its triangles need a package that is not
free.

This module also checks how fast the steering angles in the file change against the vehicle's limit, because the checker
does not compare the angles with each other.

Keys:

- ``solutions_valid``: share of successful runs reported as drivable with an accepted solution; ``solutions_judged``:
  their number.
- ``motions_feasible``: share of the other runs reported as drivable in which each step is feasible; ``motions_judged``:
  their number.
- ``steering_told``: share of all solutions for which too fast steering is reported if and only if the file contains it.
- ``solutions_told``: number of runs reported as beyond their vehicle's limits.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import anyio
import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.solution import CommonRoadSolutionReader, Solution
from commonroad.planning.planning_problem import PlanningProblemSet
from commonroad.scenario.scenario import Scenario
from commonroad_dc import pycrcc
from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
from commonroad_dc.feasibility import solution_checker
from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics
from mcp import Client

from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.runs import RunRecord

from ..harness import Figures, SeededBench, ask, finished_batch, import_scenarios, scenario_files, share
from .public_runs import PREDICTION, public_folder, public_server, raw_runs

SCENARIOS = 62
PLANNERS = ("frenetix:Default", "mp-rbfn:Default", "idm:Default")
_SAME = 1e-3
"""Share of the steering rate allowed for rounding, because planners use their limits fully."""


@dataclass(frozen=True)
class Judged:
    """A run with the checker's verdict on its solution, and how fast its wheels turn by it, as a share of the limit."""

    record: RunRecord
    verdict: str
    steering: float

    @property
    def is_reported(self) -> bool:
        """True if the product reports the motion as beyond the vehicle's limits."""
        return bool(self.record.beyond_vehicle)

    @property
    def is_steering_reported(self) -> bool:
        """True if it reports the steering rate as such."""
        return any(excess.name == "steering rate" for excess in self.record.beyond_vehicle or ())


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above; a limit restricts the number of scenarios."""
    judged = anyio.run(_judged, bench)
    drivable = [one for one in judged if not one.is_reported]
    reached = [one for one in drivable if one.record.outcome == "goal_reached"]
    others = [one for one in drivable if one.record.outcome != "goal_reached"]
    for one in judged:
        wrong = one.verdict != "valid" if one in reached else one.verdict not in ("valid", "feasible")
        if (wrong and not one.is_reported) or one.is_steering_reported != (one.steering > 1 + _SAME):
            told = one.record.beyond_vehicle
            sys.stderr.write(f"{one.record.run_id} {one.record.config_name}: {one.verdict}, {one.steering}, {told}\n")
    return {
        "solutions_valid": share(one.verdict == "valid" for one in reached),
        "solutions_judged": len(reached),
        "motions_feasible": share(one.verdict in ("valid", "feasible") for one in others),
        "motions_judged": len(others),
        "steering_told": share(one.is_steering_reported == (one.steering > 1 + _SAME) for one in judged),
        "solutions_told": sum(one.is_reported for one in judged),
    }


async def _judged(bench: SeededBench) -> list[Judged]:
    folder = bench.folder("solutions")
    async with public_server(bench) as client:
        files = scenario_files(bench.shared / "data" / "commonroad", bench.limit or SCENARIOS)
        await import_scenarios(client, files)
        here = [str(CommonRoadFileReader(str(file)).open()[0].scenario_id) for file in files]
        known = _known(bench)
        batch_id = await finished_batch(
            client, scenarios=[name for name in here if name in known], configs=list(PLANNERS), prediction=PREDICTION
        )
        raw = raw_runs(bench, batch_id)
        exported = await _exported(client, [one.run_id for one in raw.valid], folder)
    return [
        judged(one, raw.files[one.scenario_id], exported[one.run_id]) for one in raw.valid if one.run_id in exported
    ]


def _known(bench: SeededBench) -> set[str]:
    """Return the scenarios that were not refused."""
    workspace = Workspace(public_folder(bench))
    names = {artifact.artifact_id for artifact in workspace.newest(kind="scenario", limit=1000)}
    workspace.close()
    return names


async def _exported(client: Client, run_ids: list[str], folder: Path) -> Mapping[str, Path]:
    """Return the solution files of runs, by run id."""
    for begin in range(0, len(run_ids), 50):
        some = run_ids[begin : begin + 50]
        await ask(client, "export_artifacts", ids=some, formats=["solution"], folder=str(folder))
    files = list(folder.iterdir())
    return {run_id: next(file for file in files if run_id in file.name) for run_id in run_ids}


def judged(record: RunRecord, scenario_file: Path, solution_file: Path) -> Judged:
    """Return a run with the results of the checker and the file."""
    scenario, problems = CommonRoadFileReader(str(scenario_file)).open()
    problem = problems.planning_problem_dict[record.problem_id]
    solution = CommonRoadSolutionReader.open(str(solution_file))
    verdict = _verdict(record, scenario, PlanningProblemSet([problem]), solution)
    return Judged(record, verdict, steering_share(solution, scenario.dt))


def _verdict(record: RunRecord, scenario: Scenario, problems: PlanningProblemSet, solution: Solution) -> str:
    if len(solution.planning_problem_solutions[0].trajectory.state_list) < 2:
        return "valid"
    feasible = solution_checker.solution_feasible(solution, scenario.dt, problems)
    if not all(found[0] for found in feasible.values()):
        return "infeasible"
    if record.outcome != "goal_reached":
        return "feasible"
    try:
        with patch.object(solution_checker, "_construct_boundary_checker", _edge):
            accepted, _ = solution_checker.valid_solution(scenario, problems, solution)
    except solution_checker.SolutionCheckerException as refusal:
        return type(refusal).__name__
    return "valid" if accepted else "refused"


def _edge(scenario: Scenario) -> Any:
    """Return the edge of the road by the checker's own rectangles."""
    checker = pycrcc.CollisionChecker()
    _, rectangles = create_road_boundary_obstacle(scenario, method="obb_rectangles")
    checker.add_collision_object(rectangles)
    return checker


def steering_share(solution: Solution, step_s: float) -> float:
    """Return the fastest change of a solution's steering angles as a share of the vehicle's limit."""
    solved = solution.planning_problem_solutions[0]
    limit = VehicleDynamics.from_model(solved.vehicle_model, solved.vehicle_type).parameters.steering.v_max
    angles = np.array([state.steering_angle for state in solved.trajectory.state_list])
    return float(np.abs(np.diff(angles)).max(initial=0.0) / step_s / limit)
