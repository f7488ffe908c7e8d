"""Whether the ego's vehicle can drive a trajectory: its tyres hold, and its wheels turn far enough.

The curvatures of Frenetix's core contain its halved second derivatives (see ``frenetix/core.py``), and its acceleration
is the one along the path alone. Here both follow from the trajectory itself, by the kinematic single-track model of the
rear axle: yaw rate = speed · tan(steering) / wheelbase. The limits are those of the vehicle, as CommonRoad's
drivability checker asks them of a solution: the largest steering angle, and the friction circle, acceleration along and
across together at most ``maximum_acceleration_mps2`` (Althoff and Würsching, "CommonRoad: Vehicle Models", 2020).
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points
from ..vehicles import VehicleParameters
from .interface import PlannedTrajectory

Limit = Literal["curvature", "friction"]
_SLOW_MPS = 0.5
"""Below it a step of some centimetres tells nothing about the curvature."""


def violated_limit(trajectory: PlannedTrajectory, vehicle: VehicleParameters, step_s: float) -> Limit | None:
    """The limit that a trajectory of the centre breaks, whose speeds are those of the rear axle; None where none."""
    slips, turns = broken_limits(trajectory.headings_rad[None], trajectory.speeds_mps[None], vehicle, step_s)
    return "friction" if slips[0] else "curvature" if turns[0] else None


def broken_limits(
    headings_rad: Points, speeds_mps: Points, vehicle: VehicleParameters, step_s: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of n motions break the friction and which the curvature, for headings and speeds of shape (n, steps)."""
    speed = 0.5 * (speeds_mps[:, 1:] + speeds_mps[:, :-1])
    yaw_rate = np.diff(headings_rad, axis=1) / step_s
    along = np.diff(speeds_mps, axis=1) / step_s
    hardest = (along**2 + (speed * yaw_rate) ** 2).max(axis=1, initial=0.0)
    moving = speed > _SLOW_MPS
    curvature = np.where(moving, np.abs(yaw_rate) / np.where(moving, speed, 1.0), 0.0).max(axis=1, initial=0.0)
    turns = vehicle.wheelbase_m * curvature > np.tan(vehicle.maximum_steering_rad)
    return hardest > vehicle.maximum_acceleration_mps2**2, np.asarray(turns)
