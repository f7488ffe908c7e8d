"""The ego vehicle: CommonRoad's vehicle 2 (BMW 320i)."""

import math
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points


@dataclass(frozen=True)
class VehicleParameters:
    """Size and limits of the ego; lengths in m, accelerations in m/s², angles in rad.

    ``switching_speed_mps``: above it the engine's power limits the acceleration. Source: CommonRoad vehicle models,
    parameters of vehicle 2.
    """

    length_m: float = 4.508
    width_m: float = 1.61
    wheelbase_m: float = 2.579
    rear_axle_behind_center_m: float = 1.4227
    maximum_acceleration_mps2: float = 11.5
    maximum_speed_mps: float = 50.8
    switching_speed_mps: float = 7.319
    maximum_steering_rad: float = 1.066
    maximum_steering_rate_radps: float = 0.4


BMW_320I = VehicleParameters()


def rear_axle(center: Points, heading_rad: float, vehicle: VehicleParameters) -> Points:
    """Position of the rear axle, shape (2,), for a centre and heading."""
    return center - vehicle.rear_axle_behind_center_m * np.array([math.cos(heading_rad), math.sin(heading_rad)])


def centers(rear: Points, headings_rad: Points, vehicle: VehicleParameters) -> Points:
    """Positions of the centre, shape (n, 2), for positions of the rear axle and headings of shape (n,)."""
    direction = np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=1)
    moved: Points = rear + vehicle.rear_axle_behind_center_m * direction
    return moved
