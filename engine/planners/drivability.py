"""Whether the ego's vehicle can drive a trajectory: its tyres hold, and its wheels turn far enough.

The curvatures of Frenetix's core contain its halved second derivatives (see ``frenetix/core.py``), and its acceleration
is the one along the path alone. Here both follow from the trajectory itself, by the kinematic single-track model of the
rear axle: yaw rate = speed · tan(steering) / wheelbase. The limits are those of the vehicle, as CommonRoad's
drivability checker asks them of a solution: the largest steering angle, and the friction circle, acceleration along and
across together at most ``maximum_acceleration_mps2`` (Althoff and Würsching, "CommonRoad: Vehicle Models", 2020).
"""

from typing import Literal

import numpy as np

from ..vehicles import VehicleParameters
from .interface import PlannedTrajectory

Limit = Literal["curvature", "friction"]
_SLOW_MPS = 0.5
"""Below it a step of some centimetres tells nothing about the curvature."""


def violated_limit(trajectory: PlannedTrajectory, vehicle: VehicleParameters, step_s: float) -> Limit | None:
    """The limit that a trajectory of the centre breaks, whose speeds are those of the rear axle; None where none."""
    speed = 0.5 * (trajectory.speeds_mps[1:] + trajectory.speeds_mps[:-1])
    yaw_rate = np.diff(trajectory.headings_rad) / step_s
    along = np.diff(trajectory.speeds_mps) / step_s
    if float((along**2 + (speed * yaw_rate) ** 2).max(initial=0.0)) > vehicle.maximum_acceleration_mps2**2:
        return "friction"
    moving = speed > _SLOW_MPS
    curvature = np.abs(yaw_rate[moving] / speed[moving])
    if vehicle.wheelbase_m * float(curvature.max(initial=0.0)) > np.tan(vehicle.maximum_steering_rad):
        return "curvature"
    return None
