"""Where the ego's centre and rear axle are; its parameters are in ``vehicle_models``."""

import math

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.planners.vehicle_models import BMW_320I, VehicleParameters

__all__ = ["BMW_320I", "VehicleParameters", "centers", "rear_axle"]


def rear_axle(center: Points, heading_rad: float, vehicle: VehicleParameters) -> Points:
    """Position of the rear axle, shape (2,), for a centre and heading."""
    return center - vehicle.rear_axle_behind_center_m * np.array([math.cos(heading_rad), math.sin(heading_rad)])


def centers(rear: Points, headings_rad: Points, vehicle: VehicleParameters) -> Points:
    """Positions of the centre, shape (n, 2), for positions of the rear axle and headings of shape (n,)."""
    direction = np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=1)
    moved: Points = rear + vehicle.rear_axle_behind_center_m * direction
    return moved
