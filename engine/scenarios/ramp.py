"""Finding motorway ramps in a lanelet network: roads of one direction that part or join at a small angle."""

import math
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, point_at, wrap_angle
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.scenarios.ego_route import center_line

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

NEAR_M = 200.0
ANGLE_RAD = math.radians(20.0)
STRETCH_M = 15.0
"""How far from the joint the angle is measured: at the joint itself it is zero."""
APART_M = 0.3
"""Branches that lie closer over that stretch are the same road twice."""


def has_ramp(network: "LaneletNetwork", graph: LaneletGraph, point: Points, route: tuple[int, ...]) -> bool:
    """Whether roads part or join as at a motorway ramp, within 200 m of the point or on the route.

    Two lanelets that leave (or reach) the same one at less than 20°, on carriageways without oncoming lanes. Crossings
    and roundabouts are for the caller to rule out.
    """
    for key in graph.successors:
        if key not in route and not _is_near(network.find_lanelet_by_id(key).center_vertices, point):
            continue
        for branches, forward in ((graph.successors[key], True), (graph.predecessors[key], False)):
            if any(_is_ramp_pair(network, graph, key, pair, forward) for pair in combinations(branches, 2)):
                return True
    return False


def _is_ramp_pair(
    network: "LaneletNetwork", graph: LaneletGraph, joint: int, pair: tuple[int, int], forward: bool
) -> bool:
    if pair[1] in graph.neighbours[pair[0]] or any(_has_oncoming_lane(network, key) for key in (joint, *pair)):
        return False
    lines = [center_line(network, key) for key in pair]
    if any(len(line) < 2 for line in lines):
        return False
    ends = [_end(line if forward else line[::-1]) for line in lines]
    angle = abs(wrap_angle(ends[0][1] - ends[1][1]))
    return angle < ANGLE_RAD and float(np.linalg.norm(ends[0][0] - ends[1][0])) > APART_M


def _end(line: Points) -> tuple[Points, float]:
    return point_at(line, STRETCH_M)


def _has_oncoming_lane(network: "LaneletNetwork", lanelet_id: int) -> bool:
    """Whether any lane of the carriageway has a neighbour of the other direction."""
    seen: set[int] = set()
    waiting = [lanelet_id]
    while waiting:
        lane = network.find_lanelet_by_id(waiting.pop())
        if lane is None or lane.lanelet_id in seen:
            continue
        seen.add(lane.lanelet_id)
        for beside, same in (
            (lane.adj_left, lane.adj_left_same_direction),
            (lane.adj_right, lane.adj_right_same_direction),
        ):
            if beside is not None and not same:
                return True
            if beside is not None:
                waiting.append(beside)
    return False


def _is_near(vertices: Points, point: Points) -> bool:
    return bool(np.min(np.linalg.norm(vertices - point, axis=1)) <= NEAR_M)
