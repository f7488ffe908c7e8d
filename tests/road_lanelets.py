"""Lanelets of a generated road network, for tests that need no net."""

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork

HALF_WIDTH_M = np.array([0.0, 1.75])


def street(key: int, center: Points, successors: tuple[int, ...] = ()) -> RoadLanelet:
    """A lanelet of a town that leads east about a centre line (n, 2), with nothing beside it."""
    return RoadLanelet(
        lanelet_id=key,
        lane_id=f"e{key}_0",
        edge_id=f"e{key}",
        left=center + HALF_WIDTH_M,
        right=center - HALF_WIDTH_M,
        successors=successors,
        predecessors=(),
        left_neighbour=None,
        left_same_direction=False,
        right_neighbour=None,
        right_same_direction=False,
        internal=False,
        types=("urban",),
        users=("car",),
        allowed=frozenset({"passenger"}),
        speed_mps=13.9,
        street="",
    )


def network_of_streets(*lanelets: RoadLanelet) -> RoadNetwork:
    """A network of these alone: no signs, no lights, no intersections."""
    return RoadNetwork({one.lanelet_id: one for one in lanelets}, (), (), (), ())
