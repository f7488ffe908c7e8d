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
    """Whether lanelets form a circular junction.

    A round one-way cycle of at most 400 m that at least two lanelets enter, driven against the clock where traffic
    keeps right and with it where traffic keeps left. The round trip about a block of houses is neither one-way nor
    driven that way.
    """
    seen: set[int] = set()
    keeps_right = _keeps_right(network)
    for start in sorted(graph.successors):
        if start in seen or not graph.predecessors[start]:
            continue
        cycle = _shortest_cycle(graph, start)
        seen.update(cycle)
        if not cycle or not _is_one_way(network, cycle) or _entries(graph, cycle) < FEWEST_ENTRIES:
            continue
        roundness, against_the_clock = _shape(network, cycle)
        if roundness >= ROUNDNESS and keeps_right in (None, against_the_clock):
            return True
    return False


def _keeps_right(network: "LaneletNetwork") -> bool | None:
    """Side of the traffic by where the opposite lanes lie; None where no road has both directions."""
    left = sum(1 for lane in network.lanelets if lane.adj_left is not None and not lane.adj_left_same_direction)
    right = sum(1 for lane in network.lanelets if lane.adj_right is not None and not lane.adj_right_same_direction)
    return None if left == right else left > right


def _is_one_way(network: "LaneletNetwork", cycle: tuple[int, ...]) -> bool:
    lanes = [network.find_lanelet_by_id(key) for key in cycle]
    sides = [(lane.adj_left, lane.adj_left_same_direction) for lane in lanes]
    sides += [(lane.adj_right, lane.adj_right_same_direction) for lane in lanes]
    return all(neighbour is None or same for neighbour, same in sides)


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


def _shape(network: "LaneletNetwork", cycle: tuple[int, ...]) -> tuple[float, bool]:
    """Roundness of the cycle, and whether it is driven against the clock."""
    points = np.vstack([network.find_lanelet_by_id(key).center_vertices for key in cycle])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum())
    return 4 * math.pi * abs(area) / max(perimeter, 1e-6) ** 2, area > 0


def _entries(graph: LaneletGraph, cycle: tuple[int, ...]) -> int:
    inside = set(cycle)
    return sum(1 for key in cycle for before in graph.predecessors[key] if before not in inside)
