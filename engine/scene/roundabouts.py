"""Finds roundabouts in a lanelet network: short, round, one-way cycles of successors with several entries."""

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from ..network import LaneletGraph

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

LONGEST_RING_M = 400.0
"""Longest cycle of a roundabout, about 127 m in diameter (chosen)."""
ROUNDNESS = 0.88
"""4π·area / perimeter² of the cycle: 1 for a circle, 0.785 for a square block of houses."""
FEWEST_ENTRIES = 2
"""Fewest lanelets that enter a roundabout; a turning circle has one."""


def has_roundabout(network: "LaneletNetwork", graph: LaneletGraph) -> bool:
    """Return True if lanelets form a circular junction.

    A circular junction is a round one-way cycle of at most 400 m that at least two lanelets enter, driven anticlockwise
    if traffic keeps right and clockwise if it keeps left. The round trip around a block of houses is neither one-way
    nor driven that way.
    """
    seen: set[int] = set()
    keeps_right = _keeps_right(network)
    for start in sorted(graph.successors):
        if start in seen or not graph.predecessors[start]:
            continue
        cycle = _shortest_cycle(graph, start)
        seen.update(cycle)
        if _is_roundabout(network, graph, cycle, keeps_right):
            return True
    return False


def roundabout_of(network: "LaneletNetwork", graph: LaneletGraph, lanelet_id: int) -> frozenset[int]:
    """Return the lanelets of the circular junction that a lanelet belongs to; empty if there is none."""
    cycle = _shortest_cycle(graph, lanelet_id)
    is_ring = bool(cycle) and _is_roundabout(network, graph, cycle, _keeps_right(network))
    return frozenset(cycle) if is_ring else frozenset()


def _is_roundabout(
    network: "LaneletNetwork", graph: LaneletGraph, cycle: tuple[int, ...], keeps_right: bool | None
) -> bool:
    if not cycle or not _is_one_way(network, cycle) or _entries(graph, cycle) < FEWEST_ENTRIES:
        return False
    roundness, against_the_clock = _shape(network, cycle)
    return roundness >= ROUNDNESS and keeps_right in (None, against_the_clock)


def _keeps_right(network: "LaneletNetwork") -> bool | None:
    """Return whether traffic keeps right, judged by opposite lanes; None if no road has both directions."""
    left = sum(1 for lane in network.lanelets if lane.adj_left is not None and not lane.adj_left_same_direction)
    right = sum(1 for lane in network.lanelets if lane.adj_right is not None and not lane.adj_right_same_direction)
    return None if left == right else left > right


def _is_one_way(network: "LaneletNetwork", cycle: tuple[int, ...]) -> bool:
    sides = [side for key in cycle for side in sides_of(network.find_lanelet_by_id(key))]
    return all(neighbour is None or same for neighbour, same in sides)


def sides_of(lane: "Lanelet") -> tuple[tuple[int | None, bool | None], ...]:
    """Return the adjacent lanelets on the left and on the right, and whether each leads in the same direction."""
    return (lane.adj_left, lane.adj_left_same_direction), (lane.adj_right, lane.adj_right_same_direction)


def _shortest_cycle(graph: LaneletGraph, start: int) -> tuple[int, ...]:
    """Return the shortest chain of successors back to the start, within the maximum length; empty if there is none."""
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
            if following not in lengths and total <= LONGEST_RING_M:
                lengths[following], came_from[following] = total, current
                queue.append(following)
    return ()


def _shape(network: "LaneletNetwork", cycle: tuple[int, ...]) -> tuple[float, bool]:
    """Return the roundness of the cycle, and whether it is driven anticlockwise."""
    points = np.vstack([network.find_lanelet_by_id(key).center_vertices for key in cycle])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum())
    return 4 * math.pi * abs(area) / max(perimeter, 1e-6) ** 2, area > 0


def _entries(graph: LaneletGraph, cycle: tuple[int, ...]) -> int:
    inside = set(cycle)
    return sum(1 for key in cycle for before in graph.predecessors[key] if before not in inside)
