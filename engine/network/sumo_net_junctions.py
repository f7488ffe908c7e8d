"""Which lanelets lie inside a junction, and the ways through it.

SUMO knows lanes of edges, which vehicles may change between, and internal lanes of junctions, where the right of way
is decided. Lanelets that cross others, or that an intersection of the file names as a way through it, become internal.
"""

import graphlib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length
from plannerforge.engine.network.sumo_net_lanes import DrivableLane, LaneTable

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

LONGEST_INTERNAL_LANE_M = 90.0
LONGEST_PATH_LANELETS = 12
JOINT_TOLERANCE_M = 0.3
SMALLEST_CROSSING_ANGLE_RAD = math.radians(4.0)


@dataclass(frozen=True)
class JunctionPath:
    """A way from one edge's lane to another's: the lanelet it leaves, those inside the junction, the one it enters."""

    entry: int
    through: tuple[int, ...]
    exit: int


@dataclass(frozen=True)
class JunctionInterior:
    """The lanelets inside junctions, and which lanelets cross which (symmetric)."""

    lanelets: frozenset[int]
    crossings: dict[int, frozenset[int]]


def find_interior(table: LaneTable, network: "LaneletNetwork") -> JunctionInterior:
    """The lanelets that become internal lanes; internal lanelets never form a cycle."""
    crossings = _crossings(table)
    named = _named_by_intersections(network)
    interior = {
        key
        for key, lane in table.lanes.items()
        if (crossings.get(key) or key in named)
        and table.predecessors[key]
        and table.successors[key]
        and lane.length_m < LONGEST_INTERNAL_LANE_M
    }
    while cycle := _cycle(table, interior):
        interior.discard(max(cycle, key=lambda key: (table.lanes[key].length_m, key)))
    return JunctionInterior(frozenset(interior), crossings)


def find_paths(table: LaneTable, interior: frozenset[int]) -> tuple[JunctionPath, ...]:
    """All ways from a lane outside junctions to the next lane outside, in ascending order of the lanelets."""
    found: list[JunctionPath] = []
    for entry in (key for key in table.lanes if key not in interior):
        waiting: list[tuple[int, tuple[int, ...]]] = [(after, ()) for after in table.successors[entry]]
        while waiting:
            current, through = waiting.pop()
            if current not in interior:
                found.append(JunctionPath(entry, through, current))
            elif current not in through and len(through) < LONGEST_PATH_LANELETS:
                waiting += [(after, (*through, current)) for after in table.successors[current]]
    return tuple(sorted(found, key=lambda path: (path.entry, path.exit, path.through)))


def crossing_of(first: Points, second: Points) -> tuple[float, float, float] | None:
    """First proper crossing of two polylines: arc length on each in m and the angle in rad, if there is one."""
    start, step = first[:-1], np.diff(first, axis=0)
    other_start, other_step = second[:-1], np.diff(second, axis=0)
    cross = step[:, None, 0] * other_step[None, :, 1] - step[:, None, 1] * other_step[None, :, 0]
    between = other_start[None] - start[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (between[..., 0] * other_step[None, :, 1] - between[..., 1] * other_step[None, :, 0]) / cross
        across = (between[..., 0] * step[:, None, 1] - between[..., 1] * step[:, None, 0]) / cross
    hits = np.argwhere(
        (np.abs(cross) > 1e-9) & (along >= 0) & (along <= 1) & (across >= 0) & (across <= 1),
    )
    if len(hits) == 0:
        return None
    i, j = hits[0]
    lengths = float(np.linalg.norm(step[i])), float(np.linalg.norm(other_step[j]))
    cosine = float(step[i] @ other_step[j]) / (lengths[0] * lengths[1] + 1e-12)
    return (
        float(arc_length(first)[i] + along[i, j] * lengths[0]),
        float(arc_length(second)[j] + across[i, j] * lengths[1]),
        math.acos(max(-1.0, min(1.0, cosine))),
    )


def _crossings(table: LaneTable) -> dict[int, frozenset[int]]:
    from shapely import LineString, STRtree

    keys = list(table.lanes)
    lines = [LineString(table.lanes[key].center) for key in keys]
    found: dict[int, set[int]] = {}
    for i, j in STRtree(lines).query(lines, predicate="intersects").T.tolist() if keys else []:
        if i < j and _cross(table, table.lanes[keys[i]], table.lanes[keys[j]]):
            found.setdefault(keys[i], set()).add(keys[j])
            found.setdefault(keys[j], set()).add(keys[i])
    return {key: frozenset(others) for key, others in sorted(found.items())}


def _cross(table: LaneTable, first: DrivableLane, second: DrivableLane) -> bool:
    """Whether two lanes cross, leaving out joints, splits and merges at their ends."""
    if (
        second.lanelet_id in table.successors[first.lanelet_id]
        or first.lanelet_id in table.successors[second.lanelet_id]
    ):
        return False
    hit = crossing_of(first.center, second.center)
    if hit is None:
        return False
    first_ends = _near_ends(hit[0], first.length_m)
    second_ends = _near_ends(hit[1], second.length_m)
    at_ends = any(first_ends) and any(second_ends)
    return not at_ends and min(hit[2], math.pi - hit[2]) >= SMALLEST_CROSSING_ANGLE_RAD


def _near_ends(station_m: float, length_m: float) -> tuple[bool, bool]:
    return station_m < JOINT_TOLERANCE_M, station_m > length_m - JOINT_TOLERANCE_M


def _named_by_intersections(network: "LaneletNetwork") -> frozenset[int]:
    named: set[int] = set()
    for intersection in network.intersections:
        for incoming in intersection.incomings:
            for group in (incoming.successors_left, incoming.successors_right, incoming.successors_straight):
                named |= set(group or ())
    return frozenset(named)


def _cycle(table: LaneTable, interior: Iterable[int]) -> list[int] | None:
    kept = frozenset(interior)
    graph = {key: [after for after in table.successors[key] if after in kept] for key in sorted(kept)}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return None
