"""Writes a run as a CommonRoad solution file, in the kinematic single-track model (KS).

The states have centre, heading and speed. The steering angle follows from the curvature of the rear axle's path,
tan(steering) = wheelbase · Δheading / Δs (Althoff and Würsching, "CommonRoad: Vehicle Models"). The file contains no
date, computer or computation time, so the same run gives the same bytes.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....schemas.artifacts import CostFunctionId, FileWritten, SolutionRequest
from ....schemas.errors import NotPossible
from ....schemas.runs import RunSteps
from ...commonroad import read_scenario
from ...execution import ProgressReporter
from ...geometry import Points
from ...vehicles import STANDING_MPS, commonroad_vehicle

if TYPE_CHECKING:
    from commonroad.scenario.scenario import ScenarioID


def write_solution(request: SolutionRequest, report: ProgressReporter) -> FileWritten:
    """Write the driven trajectory of a run as a CommonRoad solution file.

    Raises:
        NotPossible: The ego is not a CommonRoad vehicle but has its own parameters.
        UnsafeInput: The scenario cannot be read.
    """
    settings, driven = request.configuration.settings, request.record.ego_class
    # A class refers to its scenario only if the configuration gives no vehicle, since that vehicle has its own class.
    vehicle = commonroad_vehicle(settings, "car" if settings.states_vehicle else driven)
    if vehicle is None and commonroad_vehicle(settings) is not None:
        raise NotPossible(
            f"a solution file needs one of CommonRoad's vehicles, and they include no {driven}; its size and limits "
            "would be checked as another vehicle's",
            valid=["a run with a car as the ego", "a run of a configuration with a vehicle, such as vehicle=2"],
            next_step="export the trajectory as csv, or run again with vehicle=2",
            reason="no_such_vehicle",
        )
    if vehicle is None:
        raise NotPossible(
            f"a solution file needs one of CommonRoad's vehicles; {request.configuration.config_id} has its own "
            "vehicle parameters",
            valid=["a run of a configuration without vehicle parameters"],
        )
    loaded = read_scenario(Path(request.scenario_path))
    steps = RunSteps.model_validate_json(Path(request.steps_path).read_text(encoding="utf-8"))
    text = solution_xml(
        steps,
        loaded.step_s,
        scenario_id=loaded.scenario.scenario_id,
        problem_id=request.record.problem_id,
        vehicle_id=vehicle,
        cost_function=request.cost_function,
    )
    Path(request.target_path).write_text(text, encoding="utf-8")
    report(1.0, "solution written")
    return FileWritten(path=request.target_path)


def solution_xml(
    steps: RunSteps,
    step_s: float,
    *,
    scenario_id: "ScenarioID",
    problem_id: int,
    vehicle_id: int,
    cost_function: CostFunctionId,
) -> str:
    """Return the solution file of one planning problem; ``step_s`` is the scenario's time step in s."""
    from commonroad.common.solution import (
        CommonRoadSolutionWriter,
        CostFunction,
        PlanningProblemSolution,
        Solution,
        VehicleModel,
        VehicleType,
    )
    from commonroad.scenario.state import KSState
    from commonroad.scenario.trajectory import Trajectory
    from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics

    vehicle = VehicleType(vehicle_id)
    parameters = VehicleDynamics.from_model(VehicleModel.KS, vehicle).parameters
    steering = mean_steering_angles(steps, step_s, parameters.a + parameters.b, parameters.steering.max)
    states = [
        KSState(
            time_step=steps.first_step + index,
            position=np.array([steps.x_m[index], steps.y_m[index]]),
            velocity=steps.speed_mps[index],
            orientation=steps.heading_rad[index],
            steering_angle=float(steering[index]),
        )
        for index in range(len(steps.x_m))
    ]
    solved = PlanningProblemSolution(
        problem_id, VehicleModel.KS, vehicle, CostFunction[cost_function], Trajectory(steps.first_step, states)
    )
    text: str = CommonRoadSolutionWriter(Solution(scenario_id, [solved], date=None)).dump()
    return text


def mean_steering_angles(steps: RunSteps, step_s: float, wheelbase_m: float, largest_rad: float) -> Points:
    """Return the steering angle in rad at every state, shape (n,).

    Uses the driven angle if it is known, otherwise the mean of the angles for the turns before and after the state.
    """
    if steps.steering_rad:
        return np.array(steps.steering_rad)
    angles = steering_of(np.array(steps.heading_rad), np.array(steps.speed_mps), step_s, wheelbase_m)
    limited: Points = np.clip(angles, -largest_rad, largest_rad)
    return limited


def steering_of(headings_rad: Points, speed: Points, step_s: float, wheelbase_m: float) -> Points:
    """Return the unlimited steering angle in rad at every state (n,): the mean for the turns around it."""
    turned = np.diff(np.unwrap(headings_rad))
    mean_speed = 0.5 * (speed[1:] + speed[:-1])
    moving = mean_speed > STANDING_MPS
    between = np.zeros(len(turned))
    between[moving] = np.arctan(wheelbase_m * turned[moving] / (mean_speed[moving] * step_s))
    for index in np.flatnonzero(~moving):
        between[index] = between[index - 1] if index else 0.0
    around = np.concatenate([between[:1], between, between[-1:]])
    angles: Points = 0.5 * (around[1:] + around[:-1]) if len(turned) else np.zeros(len(speed))
    return angles
