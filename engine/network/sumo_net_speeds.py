"""How fast each lane may be driven, where the file's lanelets say nothing that SUMO could use.

Inside towns 50 km/h, more where a vehicle was recorded faster; bends lower it, because SUMO slows down for turns
inside junctions only (a quarter of its cars break the friction circle in the bends of edges otherwise).
"""

import math
from collections.abc import Mapping

from plannerforge.engine.geometry.polyline import Points, maximum_curvature
from plannerforge.engine.network.sumo_net_layout import NetLayout

USUAL_SPEED_MPS = 13.89
COMFORTABLE_LATERAL_ACCELERATION_MPS2 = 4.0
SLOWEST_BEND_MPS = 3.0


def lane_speeds(layout: NetLayout, recorded_mps: Mapping[int, float]) -> dict[int, float]:
    """Speed of every lanelet in m/s: equal within an edge, then lowered where the lanelet bends.

    Args:
        layout: the network.
        recorded_mps: fastest speed recorded on each lanelet; missing ones count as slow.
    """
    wanted = {
        key: recorded * 1.05 if (recorded := recorded_mps.get(key, 0.0)) > USUAL_SPEED_MPS else USUAL_SPEED_MPS
        for key in layout.table.lanes
    }
    for keys in layout.edges.values():
        wanted.update(dict.fromkeys(keys, max(wanted[key] for key in keys)))
    return {key: min(speed, bend_speed(layout.table.lanes[key].center)) for key, speed in wanted.items()}


def bend_speed(shape: Points, sigma_m: float = 4.0) -> float:
    """Speed in m/s at which the sharpest bend of a polyline takes the comfortable lateral acceleration; may be inf."""
    curvature = maximum_curvature(shape, sigma_m)
    if curvature <= 0.0:
        return math.inf
    return max(SLOWEST_BEND_MPS, math.sqrt(COMFORTABLE_LATERAL_ACCELERATION_MPS2 / curvature))
