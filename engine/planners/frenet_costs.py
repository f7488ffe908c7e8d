"""The cost and feasibility functions of the C++ core, set up anew for every planning step."""

from dataclasses import dataclass

import frenetix
import frenetix.trajectory_functions as functions
import frenetix.trajectory_functions.cost_functions as costs
import frenetix.trajectory_functions.feasability_functions as feasibility
import numpy as np

from plannerforge.engine.planners.frenet_frame import FrenetFrame
from plannerforge.engine.planners.frenet_memory import SECOND_DERIVATIVE_FACTOR
from plannerforge.engine.planners.interface import EgoState, PredictedObstacle
from plannerforge.engine.planners.vehicle import VehicleParameters

CONSTRAINTS = {
    "Yaw rate Constraint": "yaw_rate",
    "Acceleration Constraint": "acceleration",
    "Curvature Constraint": "curvature",
    "Curvature Rate Constraint": "curvature_rate",
}
"""Names of the core's feasibility checks and ours."""

BESIDE_REACH_M = 15.0
"""√50 m of the core and the largest lateral offset, with some to spare; the ego's own length comes on top."""


@dataclass(frozen=True)
class StepInputs:
    """What the functions of one planning step depend on."""

    ego: EgoState
    obstacles: tuple[PredictedObstacle, ...]
    desired_speed_mps: float
    low_speed: bool
    horizon_s: float
    step_s: float
    shortest_s: float
    reach_m: float


def add_feasibility(handler: "frenetix.TrajectoryHandler", vehicle: VehicleParameters) -> None:
    """The four constraints that the core really checks; they stay the same during a run.

    The core's accelerations are half of the true ones (see ``frenet_memory``), so it gets half of the limit.
    """
    steering, wheelbase = vehicle.maximum_steering_rad, vehicle.wheelbase_m
    handler.add_feasability_function(feasibility.CheckYawRateConstraint(steering, wheelbase, False))
    handler.add_feasability_function(
        feasibility.CheckAccelerationConstraint(
            vehicle.switching_speed_mps, vehicle.maximum_acceleration_mps2 / SECOND_DERIVATIVE_FACTOR, False
        )
    )
    handler.add_feasability_function(feasibility.CheckCurvatureConstraint(steering, wheelbase, False))
    handler.add_feasability_function(
        feasibility.CheckCurvatureRateConstraint(wheelbase, vehicle.maximum_steering_rate_radps, False)
    )


def add_step_functions(
    handler: "frenetix.TrajectoryHandler", weights: dict[str, float], frame: FrenetFrame, inputs: StepInputs
) -> None:
    """Coordinates and quick cost terms of this step; those of the step before are removed first.

    The handler keeps functions until one of the same name replaces them, so a term that is left out this time (no
    obstacle in sight) would otherwise go on with old positions.
    """
    handler.clear_cost_functions()
    orientation = frame.heading_inwards(inputs.ego.heading_rad)
    handler.add_function(functions.FillCoordinates(inputs.low_speed, orientation, frame.system, inputs.horizon_s))
    for name, make in _CONSTANT.items():
        if weights[name] > 0:
            handler.add_cost_function(make(name, weights[name]))
    if weights["velocity_offset"] > 0:
        handler.add_cost_function(
            costs.CalculateVelocityOffsetCost(
                "velocity_offset",
                weights["velocity_offset"],
                inputs.desired_speed_mps,
                inputs.step_s,
                inputs.shortest_s,
                False,  # limit_to_t_min is broken in the core
                2,
            )
        )
    # the core raises TypeError for an empty (0, 2) array of obstacles
    if weights["distance_to_obstacles"] > 0 and inputs.obstacles:
        present = frame.inwards(np.array([obstacle.positions[0] for obstacle in inputs.obstacles]))
        handler.add_cost_function(
            costs.CalculateDistanceToObstacleCost(
                "distance_to_obstacles", weights["distance_to_obstacles"], np.ascontiguousarray(present)
            )
        )


_CONSTANT = {
    "acceleration": costs.CalculateAccelerationCost,
    "jerk": costs.CalculateJerkCost,
    "lateral_jerk": costs.CalculateLateralJerkCost,
    "longitudinal_jerk": costs.CalculateLongitudinalJerkCost,
    "orientation_offset": costs.CalculateOrientationOffsetCost,
    "distance_to_reference_path": costs.CalculateDistanceToReferencePathCost,
}


def collision_probability(
    weight: float, frame: FrenetFrame, inputs: StepInputs, vehicle: VehicleParameters
) -> costs.CalculateCollisionProbabilityFast:
    """The core's term ``prediction``. It takes longer than all else in the core, so it is kept out of the handler."""
    counted = [(obstacle, _last_within_reach(obstacle, inputs, vehicle)) for obstacle in inputs.obstacles]
    predictions = {o.obstacle_id: _core_prediction(o, last, frame) for o, last in counted if last > 0}
    return costs.CalculateCollisionProbabilityFast(
        "prediction", weight, predictions, vehicle.length_m, vehicle.width_m, vehicle.rear_axle_behind_center_m
    )


def _last_within_reach(obstacle: PredictedObstacle, inputs: StepInputs, vehicle: VehicleParameters) -> int:
    """The last step ahead at which the core can count an obstacle, 0 where it never can.

    The core counts nothing farther than √50 m from the ego's box, at the same step. By then a candidate is at most the
    share of ``reach_m`` away that its time is of the horizon, and beside that by its lateral offset.
    """
    away = np.linalg.norm(obstacle.positions - inputs.ego.position, axis=1)
    times = np.arange(len(away)) * inputs.step_s
    within = np.flatnonzero(away <= times / inputs.horizon_s * inputs.reach_m + BESIDE_REACH_M + vehicle.length_m)
    return int(within[-1]) if len(within) else 0


def _core_prediction(obstacle: PredictedObstacle, last: int, frame: FrenetFrame) -> "frenetix.PredictedObject":
    """The obstacle until step ``last``.

    The core compares its state i with entry i − 1, so its list begins one step ahead; and it ends one entry early.
    """
    turn = np.array(
        [[np.cos(frame.angle_rad), np.sin(frame.angle_rad)], [-np.sin(frame.angle_rad), np.cos(frame.angle_rad)]]
    )
    positions = frame.inwards(obstacle.positions[1 : last + 2])
    given = np.broadcast_to(obstacle.covariance, (len(obstacle.positions), 2, 2))[1 : last + 2]
    planar = turn @ given @ turn.T
    covariances = np.zeros((len(positions), 6, 6))
    covariances[:, :2, :2] = (planar + planar.transpose(0, 2, 1)) / 2
    half = (obstacle.headings_rad[1 : last + 2] - frame.angle_rad) / 2
    poses = [
        frenetix.PoseWithCovariance(
            np.array([x, y, 0.0]),
            np.array([0.0, 0.0, np.sin(angle), np.cos(angle)]),
            np.asfortranarray(covariance),
        )
        for (x, y), angle, covariance in zip(positions.tolist(), half.tolist(), covariances, strict=True)
    ]
    return frenetix.PredictedObject(obstacle.obstacle_id, poses, obstacle.length_m, obstacle.width_m)
