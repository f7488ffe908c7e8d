"""Whether a motion can be driven: a closed form of the drivability checker's kinematic single-track criterion.

The checker (commonroad-drivability-checker, default tolerances 2 cm, 2 cm, 0.03 rad a step) searches inputs by
optimisation and takes 0.1–0.9 s a trajectory; this takes 0.2 ms, and its rare errors are false alarms. Screen with it;
accept with the checker.
"""

from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Values, wrap_angles
from plannerforge.engine.traffic.smoothing import REAR_AXLE_BEHIND_CENTER_M, Motion

WHEELBASE_M = 2.5789
MAXIMUM_ACCELERATION_MPS2 = 11.5
MAXIMUM_STEERING_RAD = 1.066
POSITION_TOLERANCE_M = 2e-2
HEADING_TOLERANCE_RAD = 3e-2


@dataclass(frozen=True)
class Feasibility:
    """Verdict on a motion: whether every step can be driven, the share of steps that can, the first that cannot."""

    feasible: bool
    share_of_steps: float
    first_infeasible_step: int | None


def steering_angles(motion: Motion, step_s: float, wheelbase_m: float = WHEELBASE_M) -> Values:
    """Steering angle in rad that turns each state into the next, shape (n,); the last one is repeated."""
    if len(motion.headings_rad) < 2:
        return np.zeros(len(motion.headings_rad))
    turn = wrap_angles(np.diff(motion.headings_rad))
    speed = np.maximum((motion.speeds_mps[:-1] + motion.speeds_mps[1:]) / 2, 1e-3)
    angle = np.arctan(wheelbase_m * turn / (speed * step_s))
    angle[speed < 0.05] = 0.0
    limited: Values = np.clip(np.append(angle, angle[-1]), -MAXIMUM_STEERING_RAD, MAXIMUM_STEERING_RAD)
    return limited


def check_kinematics(
    motion: Motion,
    step_s: float,
    *,
    wheelbase_m: float = WHEELBASE_M,
    rear_axle_m: float = REAR_AXLE_BEHIND_CENTER_M,
) -> Feasibility:
    """Judge a motion of the centre, by default with the dimensions of CommonRoad's vehicle 2 (BMW 320i)."""
    if len(motion.speeds_mps) < 2:
        return Feasibility(True, 1.0, None)
    heading = motion.headings_rad
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    moved = np.diff(motion.positions - rear_axle_m * direction, axis=0)
    turn = wrap_angles(np.diff(heading))
    middle = heading[:-1] + turn / 2
    along = moved[:, 0] * np.cos(middle) + moved[:, 1] * np.sin(middle)
    speed = motion.speeds_mps[:-1]
    steering = np.tan(steering_angles(motion, step_s, wheelbase_m)[:-1])
    lateral = np.abs(speed**2 / wheelbase_m * steering)
    within_friction = lateral <= MAXIMUM_ACCELERATION_MPS2
    limit = np.sqrt(np.maximum(MAXIMUM_ACCELERATION_MPS2**2 - lateral**2, 0.0))
    acceleration = np.clip(2 * (along - speed * step_s) / step_s**2, -limit, limit)
    reachable = speed * step_s + acceleration * step_s**2 / 2
    reachable_turn = reachable / wheelbase_m * steering
    course = heading[:-1] + reachable_turn / 2
    error_x = np.abs(moved[:, 0] - reachable * np.cos(course))
    error_y = np.abs(moved[:, 1] - reachable * np.sin(course))
    error_heading = np.abs(wrap_angles(turn - reachable_turn))
    good = (
        (error_x < POSITION_TOLERANCE_M)
        & (error_y < POSITION_TOLERANCE_M)
        & (error_heading < HEADING_TOLERANCE_RAD)
        & within_friction
    )
    bad = np.flatnonzero(~good)
    return Feasibility(bool(good.all()), float(good.mean()), int(bad[0]) if len(bad) else None)
