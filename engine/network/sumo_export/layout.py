"""Plans a SUMO network over a lanelet network: each lanelet becomes a lane, or part of a path through a junction.

SUMO distinguishes lanes of edges, between which vehicles may change, from internal lanes of junctions, where right of
way applies. A lanelet network does not. The plan has four steps:

1. Lanelets for road vehicles become lanes (``_LaneTable``).
2. Lanelets that cross others, or that an intersection of the file lists after an incoming one, are inside a junction
   (``_find_interior``); the paths through it are chains of them (``_find_paths``).
3. Neighbouring lanelets outside become lanes of one edge, if a vehicle may change between them over their whole length
   (``_group_into_edges``).
4. Ends of edges that a path joins, or with paths that cross, become one junction (``_junctions``).

Lengths are in metres. The plan depends on the network alone, never on the order of sets or of the file.
"""

import graphlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ....schemas.errors import NotPossible
from ...geometry import Points, arc_length, length_m, meeting_pairs, unit, without_repeats

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

_NARROWEST_LANE_M = 0.5
"""Chosen: narrower lanelets are defects of the file; vehicles on them need some width."""
_SHORTEST_LANE_M = 0.05
"""Chosen: a shorter lanelet has no direction."""
_WIDEST_JOINT_M = 6.0
"""Chosen: a successor that begins farther away is an error of the file, and no vehicle can drive on to it."""
_NOT_FOR_VEHICLES = frozenset({"sidewalk", "crosswalk"})


@dataclass(frozen=True)
class _DrivableLane:
    """One lanelet as a lane: centre line (n, 2) in m, and its neighbours of the same direction."""

    lanelet_id: int
    center: Points
    width_m: float
    length_m: float
    left: int | None
    right: int | None


@dataclass(frozen=True)
class _LaneTable:
    """All drivable lanes by lanelet id (ascending), and their successor relation, made symmetric."""

    lanes: dict[int, _DrivableLane]
    successors: dict[int, tuple[int, ...]]

    @cached_property
    def predecessors(self) -> dict[int, tuple[int, ...]]:
        """Lanelets that lead into each lanelet, ascending."""
        leading: dict[int, list[int]] = {key: [] for key in self.lanes}
        for key, following in self.successors.items():
            for after in following:
                leading[after].append(key)
        return {key: tuple(sorted(before)) for key, before in leading.items()}

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "_LaneTable":
        """Return the lanes of a lanelet network; footpaths, rails and degenerate lanelets are left out."""
        drivable = [lanelet for lanelet in network.lanelets if _for_vehicles(lanelet)]
        made = {lanelet.lanelet_id: _lane(lanelet) for lanelet in drivable}
        lanes = {key: lane for key, lane in sorted(made.items()) if lane is not None}
        return cls(lanes, _successors(network, lanes))


@dataclass(frozen=True)
class JunctionPath:
    """A path from a lane of one edge to a lane of another: the lanelets before, inside and after the junction."""

    entry: int
    through: tuple[int, ...]
    exit: int


@dataclass(frozen=True)
class _JunctionInterior:
    """The lanelets inside junctions, and the pairs that cross (symmetric)."""

    lanelets: frozenset[int]
    crossings: dict[int, frozenset[int]]


@dataclass(frozen=True)
class NetLayout:
    """The mapping lanelet ↔ SUMO edge and lane, fixed before anything is written.

    ``edges``: by edge id, its lanelets from right to left. ``ends``: by edge id, the junctions that it leads from and
    to. ``links``: by junction id, indices into ``paths`` in the order of SUMO's links at that junction.
    """

    table: _LaneTable
    interior: _JunctionInterior
    edges: dict[str, tuple[int, ...]]
    paths: tuple[JunctionPath, ...]
    ends: dict[str, tuple[str, str]]
    links: dict[str, tuple[int, ...]]

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "NetLayout":
        """Lay out a lanelet network; the result depends on the network alone, never on the order of sets."""
        table = _LaneTable.of(network)
        interior = _find_interior(table, network)
        edges = _group_into_edges(table, interior.lanelets)
        paths = _find_paths(table, interior.lanelets)
        lane_of = _lanes_by_lanelet(edges)
        ends = _junctions(edges, paths, lane_of, interior)
        return cls(table, interior, edges, paths, ends, _links(edges, paths, lane_of, ends))

    @cached_property
    def lane_of(self) -> dict[int, tuple[str, int]]:
        """The edge and the lane index of each lanelet outside junctions, by lanelet id."""
        return _lanes_by_lanelet(self.edges)

    @cached_property
    def internal_edge_of_path(self) -> dict[int, str]:
        """The id of each path's internal edge, ``:junction_link``, by the path's index."""
        return {
            path: f":{junction}_{link}" for junction, paths in self.links.items() for link, path in enumerate(paths)
        }

    @cached_property
    def paths_through(self) -> dict[int, tuple[int, ...]]:
        """The indices of the paths that use each lanelet inside a junction, by lanelet id."""
        through: dict[int, list[int]] = {}
        for index, path in enumerate(self.paths):
            for key in path.through:
                through.setdefault(key, []).append(index)
        return {key: tuple(indices) for key, indices in through.items()}

    @cached_property
    def incoming_lanes(self) -> dict[str, tuple[tuple[str, int], ...]]:
        """The lanes that lead into each junction, in SUMO's order, by junction id."""
        incoming: dict[str, list[tuple[str, int]]] = {junction: [] for junction in self.links}
        for edge, (_, junction) in self.ends.items():
            incoming[junction] += [(edge, lane) for lane in range(len(self.edges[edge]))]
        return {junction: tuple(lanes) for junction, lanes in incoming.items()}

    @cached_property
    def lanelets_of_lane(self) -> dict[str, tuple[int, ...]]:
        """The lanelets of each SUMO lane, by lane id (several only inside junctions; empty for a mere joint)."""
        normal = {f"{edge}_{lane}": (key,) for key, (edge, lane) in self.lane_of.items()}
        internal = {f"{edge}_0": self.paths[path].through for path, edge in self.internal_edge_of_path.items()}
        return normal | internal


def _for_vehicles(lanelet: "Lanelet") -> bool:
    kinds = {str(kind.value) for kind in lanelet.lanelet_type or ()}
    users = {str(user.value) for user in lanelet.user_one_way or ()}
    return not (kinds & _NOT_FOR_VEHICLES) and users not in ({"pedestrian"}, {"train"})


def _lane(lanelet: "Lanelet") -> _DrivableLane | None:
    center = without_repeats(np.asarray(lanelet.center_vertices, dtype=float))
    if len(center) < 2 or length_m(center) < _SHORTEST_LANE_M:
        return None
    width = float(np.median(np.linalg.norm(lanelet.left_vertices - lanelet.right_vertices, axis=1)))
    return _DrivableLane(
        lanelet_id=int(lanelet.lanelet_id),
        center=center,
        width_m=max(width, _NARROWEST_LANE_M),
        length_m=length_m(center),
        left=lanelet.adj_left if lanelet.adj_left_same_direction else None,
        right=lanelet.adj_right if lanelet.adj_right_same_direction else None,
    )


def _successors(network: "LaneletNetwork", lanes: dict[int, _DrivableLane]) -> dict[int, tuple[int, ...]]:
    pairs = {(lanelet.lanelet_id, after) for lanelet in network.lanelets for after in lanelet.successor}
    pairs |= {(before, lanelet.lanelet_id) for lanelet in network.lanelets for before in lanelet.predecessor}
    successors: dict[int, list[int]] = {key: [] for key in lanes}
    for key, after in sorted((key, after) for key, after in pairs if key in lanes and after in lanes and key != after):
        if float(np.linalg.norm(lanes[key].center[-1] - lanes[after].center[0])) < _WIDEST_JOINT_M:
            successors[key].append(after)
    return {key: tuple(following) for key, following in successors.items()}


_LONGEST_INTERNAL_LANE_M = 90.0
"""Chosen: longer than the largest crossing; a longer lanelet that crosses another (a bridge) stays a road."""
_LONGEST_PATH_LANELETS = 12
"""Chosen: ends the search for paths through junctions with lanelets that fork again and again."""
_MOST_FOLLOWED = 200_000
"""Chosen: nested forks multiply, so the search ends here; a network of 370 lanelets takes a few hundred steps."""
_JOINT_TOLERANCE_M = 0.3
"""Chosen: lanelets that meet this close to the ends of both split, merge or follow each other there."""
_SMALLEST_CROSSING_ANGLE_RAD = math.radians(4.0)
"""Chosen: centre lines that cross at a smaller angle are parallel."""


def _find_interior(table: _LaneTable, network: "LaneletNetwork") -> _JunctionInterior:
    """Return the lanelets that become internal lanes; internal lanelets never form a cycle."""
    crossings = _crossings(table)
    named = _after_intersections(network)
    interior = {
        key
        for key, lane in table.lanes.items()
        if (crossings.get(key) or key in named)
        and table.predecessors[key]
        and table.successors[key]
        and lane.length_m < _LONGEST_INTERNAL_LANE_M
    }
    while cycle := _cycle(table, interior):
        interior.discard(max(cycle, key=lambda key: (table.lanes[key].length_m, key)))
    return _JunctionInterior(frozenset(interior), crossings)


def _find_paths(table: _LaneTable, interior: frozenset[int]) -> tuple[JunctionPath, ...]:
    """Return all paths from a lane outside junctions to the next lane outside, in ascending order of the lanelets.

    Raises:
        NotPossible: nested forks lead to too many paths.
    """
    paths: list[JunctionPath] = []
    followed = 0
    for entry in (key for key in table.lanes if key not in interior):
        waiting: list[tuple[int, tuple[int, ...]]] = [(after, ()) for after in table.successors[entry]]
        while waiting:
            current, through = waiting.pop()
            followed += 1
            if followed > _MOST_FOLLOWED:
                raise NotPossible(
                    "the lanelets of a junction fork so often that its paths cannot be listed",
                    next_step="correct the successors of the lanelets, or use another scenario",
                )
            if current not in interior:
                paths.append(JunctionPath(entry, through, current))
            elif current not in through and len(through) < _LONGEST_PATH_LANELETS:
                waiting += [(after, (*through, current)) for after in table.successors[current]]
    return tuple(sorted(paths, key=lambda path: (path.entry, path.exit, path.through)))


def crossing_of(first: Points, second: Points) -> tuple[float, float, float] | None:
    """Return the first proper crossing of two polylines: arc length on each in m and the angle in rad, or None."""
    start, step = first[:-1], np.diff(first, axis=0)
    other_start, other_step = second[:-1], np.diff(second, axis=0)
    cross = step[:, None, 0] * other_step[None, :, 1] - step[:, None, 1] * other_step[None, :, 0]
    between = other_start[None] - start[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (between[..., 0] * other_step[None, :, 1] - between[..., 1] * other_step[None, :, 0]) / cross
        across = (between[..., 0] * step[:, None, 1] - between[..., 1] * step[:, None, 0]) / cross
    hits = np.argwhere((np.abs(cross) > 1e-9) & (along >= 0) & (along <= 1) & (across >= 0) & (across <= 1))
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


def _crossings(table: _LaneTable) -> dict[int, frozenset[int]]:
    """Return the lanelets that each lanelet crosses, by lanelet id; lanelets that cross no other are left out.

    Raises:
        NotPossible: more lanelets meet than in any real road network.
    """
    from shapely import LineString

    keys = list(table.lanes)
    meeting = meeting_pairs([LineString(table.lanes[key].center) for key in keys], "intersects")
    if not meeting.is_whole:
        raise NotPossible(
            f"more than {meeting.most:,} pairs of the {len(keys):,} lanelets for vehicles cross or touch",
            valid=[f"at most {meeting.most:,} pairs"],
            next_step="remove lanelets that cover others from the file, or use another scenario",
        )
    crossing: dict[int, set[int]] = {}
    for i, j in meeting.pairs.tolist():
        if _cross(table, table.lanes[keys[i]], table.lanes[keys[j]]):
            crossing.setdefault(keys[i], set()).add(keys[j])
            crossing.setdefault(keys[j], set()).add(keys[i])
    return {key: frozenset(others) for key, others in sorted(crossing.items())}


def _cross(table: _LaneTable, first: _DrivableLane, second: _DrivableLane) -> bool:
    """Return whether two lanes cross, ignoring joints, splits and merges at their ends."""
    if (
        second.lanelet_id in table.successors[first.lanelet_id]
        or first.lanelet_id in table.successors[second.lanelet_id]
    ):
        return False
    hit = crossing_of(first.center, second.center)
    if hit is None:
        return False
    at_ends = all(
        not _JOINT_TOLERANCE_M <= station_m <= lane.length_m - _JOINT_TOLERANCE_M
        for station_m, lane in zip(hit, (first, second), strict=False)
    )
    return not at_ends and min(hit[2], math.pi - hit[2]) >= _SMALLEST_CROSSING_ANGLE_RAD


def _after_intersections(network: "LaneletNetwork") -> frozenset[int]:
    named: set[int] = set()
    for intersection in network.intersections:
        for incoming in intersection.incomings:
            for group in (incoming.successors_left, incoming.successors_right, incoming.successors_straight):
                named |= set(group or ())
    return frozenset(named)


def _cycle(table: _LaneTable, interior: Iterable[int]) -> list[int] | None:
    kept = frozenset(interior)
    graph = {key: [after for after in table.successors[key] if after in kept] for key in sorted(kept)}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return None


_LENGTH_RATIO = 1.67
"""Chosen: lanes of one edge are about equally long; in a tight curve, the outer one is longer by less than this."""
_LARGEST_STAGGER_M = 5.0
"""Chosen: lanes of one edge begin and end level, to about a car's length."""


def _group_into_edges(table: _LaneTable, interior: frozenset[int]) -> dict[str, tuple[int, ...]]:
    """Return the lanelets of each edge from right to left, in the order of SUMO's lane index.

    The id of an edge is ``e`` plus the id of its rightmost lanelet.
    """
    left_of = _left_neighbours(table, interior)
    right_of = {left: right for right, left in left_of.items()}
    edges: dict[str, tuple[int, ...]] = {}
    placed: set[int] = set()
    for key in table.lanes:
        if key in interior or key in placed:
            continue
        chain = _chain(_chain(key, right_of)[-1], left_of)
        edges[f"e{chain[0]}"] = chain
        placed.update(chain)
    return edges


def _left_neighbours(table: _LaneTable, interior: frozenset[int]) -> dict[int, int]:
    """Return the lanelet to the left of each lanelet in the same edge; each is the left neighbour of at most one."""
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
    left_of: dict[int, int] = {}
    for key, left in sorted(candidates.items()):
        if left not in taken and _side_by_side(table.lanes[key], table.lanes[left]):
            left_of[key] = left
            taken.add(left)
    return left_of


def _chain(start: int, next_of: dict[int, int]) -> tuple[int, ...]:
    """Return a lanelet and its chain of neighbours, up to the last neighbour, or until the chain repeats."""
    chain = dict.fromkeys([start])
    last = start
    while last in next_of and next_of[last] not in chain:
        last = next_of[last]
        chain[last] = None
    return tuple(chain)


def _side_by_side(first: _DrivableLane, second: _DrivableLane) -> bool:
    """Return whether the ends of two lanes are level and close enough for the lanes to share an edge."""
    if not 1 / _LENGTH_RATIO < first.length_m / second.length_m < _LENGTH_RATIO:
        return False
    widest = 1.5 * (first.width_m + second.width_m) + _LARGEST_STAGGER_M
    begin, end = second.center[0] - first.center[0], second.center[-1] - first.center[-1]
    return (
        abs(float(begin @ unit(first.center[1] - first.center[0]))) < _LARGEST_STAGGER_M
        and abs(float(end @ unit(first.center[-1] - first.center[-2]))) < _LARGEST_STAGGER_M
        and float(np.linalg.norm(begin)) < widest
        and float(np.linalg.norm(end)) < widest
    )


def _lanes_by_lanelet(edges: Mapping[str, tuple[int, ...]]) -> dict[int, tuple[str, int]]:
    return {key: (edge, lane) for edge, keys in edges.items() for lane, key in enumerate(keys)}


def _junctions(
    edges: Mapping[str, tuple[int, ...]],
    paths: tuple[JunctionPath, ...],
    lane_of: Mapping[int, tuple[str, int]],
    interior: _JunctionInterior,
) -> dict[str, tuple[str, str]]:
    """Return the from and to junctions of every edge; ends with a common path or crossing paths share a junction."""
    from scipy.cluster.hierarchy import DisjointSet

    groups = DisjointSet((edge, side) for edge in edges for side in ("start", "end"))
    first_use: dict[int, str] = {}
    for path in paths:
        entry = lane_of[path.entry][0]
        groups.merge((entry, "end"), (lane_of[path.exit][0], "start"))
        for key in path.through:
            first_use.setdefault(key, entry)
    for key, others in sorted(interior.crossings.items()):
        for other in sorted(others):
            if key in first_use and other in first_use:
                groups.merge((first_use[key], "end"), (first_use[other], "end"))
    names: dict[tuple[str, str], str] = {}
    return {
        edge: (
            names.setdefault(groups[edge, "start"], f"n{len(names)}"),
            names.setdefault(groups[edge, "end"], f"n{len(names)}"),
        )
        for edge in edges
    }


def _links(
    edges: Mapping[str, tuple[int, ...]],
    paths: tuple[JunctionPath, ...],
    lane_of: Mapping[int, tuple[str, int]],
    ends: Mapping[str, tuple[str, str]],
) -> dict[str, tuple[int, ...]]:
    by_lane: dict[tuple[str, int], list[int]] = {}
    for index, path in enumerate(paths):
        by_lane.setdefault(lane_of[path.entry], []).append(index)
    links: dict[str, list[int]] = {}
    for start, end in ends.values():
        links.setdefault(start, [])
        links.setdefault(end, [])
    for edge, (_, junction) in ends.items():
        for lane in range(len(edges[edge])):
            links[junction] += by_lane.get((edge, lane), [])
    return {junction: tuple(indices) for junction, indices in links.items()}
