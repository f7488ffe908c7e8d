"""Grouping of neighbouring lanelets into edges: lanes of one edge are those that a vehicle may change between."""

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.sumo_net_lanes import DrivableLane, LaneTable

LENGTH_RATIO = 1.67
LARGEST_STAGGER_M = 5.0


def group_into_edges(table: LaneTable, interior: frozenset[int]) -> dict[str, tuple[int, ...]]:
    """Edge id → its lanelets from right to left (SUMO's lane index); the id is ``e`` and the rightmost lanelet's id."""
    left_of = _left_neighbours(table, interior)
    right_of = {left: right for right, left in left_of.items()}
    edges: dict[str, tuple[int, ...]] = {}
    placed: set[int] = set()
    for key in table.lanes:
        if key in interior or key in placed:
            continue
        chain = _chain(_rightmost(key, right_of), left_of)
        edges[f"e{chain[0]}"] = chain
        placed.update(chain)
    return edges


def _left_neighbours(table: LaneTable, interior: frozenset[int]) -> dict[int, int]:
    """Lanelet → the lanelet to its left in the same edge; each lanelet is the left neighbour of one at most."""
    outside = [key for key in table.lanes if key not in interior]
    candidates: dict[int, int] = {}
    for key in outside:
        left = table.lanes[key].left
        if left is not None and left in table.lanes and left not in interior:
            candidates[key] = left
    for key in outside:
        right = table.lanes[key].right
        if right is not None and right in table.lanes and right not in interior:
            candidates.setdefault(right, key)
    taken: set[int] = set()
    found: dict[int, int] = {}
    for key, left in sorted(candidates.items()):
        if left not in taken and _side_by_side(table.lanes[key], table.lanes[left]):
            found[key] = left
            taken.add(left)
    return found


def _rightmost(key: int, right_of: dict[int, int]) -> int:
    seen = {key}
    while key in right_of and right_of[key] not in seen:
        key = right_of[key]
        seen.add(key)
    return key


def _chain(start: int, left_of: dict[int, int]) -> tuple[int, ...]:
    chain = [start]
    while chain[-1] in left_of and left_of[chain[-1]] not in chain:
        chain.append(left_of[chain[-1]])
    return tuple(chain)


def _side_by_side(first: DrivableLane, second: DrivableLane) -> bool:
    """Whether two lanes begin and end level and near enough to be lanes of one edge."""
    if not 1 / LENGTH_RATIO < first.length_m / second.length_m < LENGTH_RATIO:
        return False
    widest = 1.5 * (first.width_m + second.width_m) + LARGEST_STAGGER_M
    begin, end = second.center[0] - first.center[0], second.center[-1] - first.center[-1]
    return (
        abs(float(begin @ _direction(first.center[:2]))) < LARGEST_STAGGER_M
        and abs(float(end @ _direction(first.center[-2:]))) < LARGEST_STAGGER_M
        and float(np.linalg.norm(begin)) < widest
        and float(np.linalg.norm(end)) < widest
    )


def _direction(two_points: Points) -> Points:
    step = two_points[1] - two_points[0]
    unit: Points = step / (float(np.linalg.norm(step)) + 1e-9)
    return unit
