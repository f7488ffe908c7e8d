"""Whether a vehicle may appear in the middle of a run where it was recorded to appear."""

import math

import numpy as np

from plannerforge.engine.geometry.polyline import oriented_rectangle, rectangles_overlap
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.traffic import Traffic
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.engine.scenarios.tracks import Track

CLEARANCE_M = 1.0
COMFORTABLE_DECELERATION_MPS2 = 4.5


def has_room(track: Track, index: int, traffic: Traffic, ego: EgoState, vehicle: VehicleParameters) -> bool:
    """Whether the pose keeps a metre from everybody, and braking comfortably avoids whoever is slower straight ahead.

    The others are looked at in the step before the ego's, the last one known.
    """
    bodies = [(ego.position, ego.heading_rad, (vehicle.length_m, vehicle.width_m), ego.speed_mps)]
    places = [(other, other.index_at(ego.step - 1)) for other in traffic.moving]
    for other, at in [*places, *((other, 0) for other in traffic.standing)]:
        if at is not None:
            size = (other.length_m, other.width_m)
            bodies.append((other.positions[at], float(other.headings_rad[at]), size, float(other.speeds_mps[at])))
    center, heading, speed = track.positions[index], float(track.headings_rad[index]), float(track.speeds_mps[index])
    forward = np.array([math.cos(heading), math.sin(heading)])
    for position, angle, size, their_speed in bodies:
        along = their_speed * math.cos(angle - heading)
        braking = max(speed**2 - max(along, 0.0) ** 2, 0.0) / (2 * COMFORTABLE_DECELERATION_MPS2)
        own_size = (track.length_m + 2 * CLEARANCE_M + braking, track.width_m + CLEARANCE_M)
        own = oriented_rectangle(center + forward * braking / 2, heading, own_size)
        if rectangles_overlap(own, oriented_rectangle(position, angle, size)):
            return False
    return True
