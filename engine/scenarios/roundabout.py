"""Finding roundabouts in a lanelet network: short round cycles of successors with several ways in."""

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.network.lanelet_graph import LaneletGraph

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

LONGEST_M = 400.0
ROUNDNESS = 0.88
"""4π·area / perimeter² of the cycle: 1 for a circle, 0.785 for a square block of houses."""
FEWEST_ENTRIES = 2


def has_roundabout(network: "LaneletNetwork", graph: LaneletGraph) -> bool:
    """Whether lanelets form a circular junction: a round cycle of at most 400 m that at least two lanelets enter."""
    seen: set[int] = set()
    for start in sorted(graph.successors):
        if start in seen or not graph.predecessors[start]:
            continue
        cycle = _shortest_cycle(graph, start)
        seen.update(cycle)
        if cycle and _is_round(network, cycle) and _entries(graph, cycle) >= FEWEST_ENTRIES:
            return True
    return False


def _shortest_cycle(graph: LaneletGraph, start: int) -> tuple[int, ...]:
    """Fewest successors that lead back to the start, within the longest length; empty where there is no such way."""
    came_from: dict[int, int] = {}
    lengths = {start: graph.length_m[start]}
    queue = deque([start])
    while queue:
        current = queue.popleft()
        for following in graph.successors[current]:
            if following == start:
                cycle = [current]
                while cycle[-1] != start:
                    cycle.append(came_from[cycle[-1]])
                return tuple(reversed(cycle))
            total = lengths[current] + graph.length_m[following]
            if following not in lengths and total <= LONGEST_M:
                lengths[following], came_from[following] = total, current
                queue.append(following)
    return ()


def _is_round(network: "LaneletNetwork", cycle: tuple[int, ...]) -> bool:
    points = np.vstack([network.find_lanelet_by_id(key).center_vertices for key in cycle])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * abs(float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum()))
    return perimeter > 0 and 4 * math.pi * area / perimeter**2 >= ROUNDNESS


def _entries(graph: LaneletGraph, cycle: tuple[int, ...]) -> int:
    inside = set(cycle)
    return sum(1 for key in cycle for before in graph.predecessors[key] if before not in inside)
