"""Draws left and right bounds for all lanes of a SUMO net: shared between neighbours, continuous from lane to lane.

A SUMO lane has a centre line and a width; a lanelet has two bounds. If bounds are drawn at half the width from the
centre line, they fold in tight curves, and the bounds of consecutive lanes do not meet. Parallel lanes of an edge are
therefore drawn together. Lanes inside junctions are drawn onto the ends of the lanes before and after them. A lane that
still crosses itself is drawn again, each time more mildly, until it encloses a simple polygon.

All lines have shape (n, 2), in metres; bounds have as many vertices as their centre line.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..geometry import Points, Values, arc_length, hermite, interpolate, resample, unit
from .net_parser import LaneGraph, NetLane, SumoNet
from .road_network import ROAD_DECIMALS

_WIDEST_JOINT_M = 3.0
"""Chosen, about a lane's width: lanes with ends farther apart do not follow each other without a junction."""
_SAME_LINE_M = 0.5
"""Chosen: bounds closer together than this along their whole length are one line."""
_SHORTEST_SEGMENT_M = 0.25
"""Chosen: vertices of parallel lanes closer together than this are merged, so that segments keep a direction."""
_LEAST_AREA_M2 = 0.01
"""Chosen: a lanelet of 10 by 10 cm; bounds on one line enclose no area."""


@dataclass
class LaneBounds:
    """A lane with bounds that are being drawn and may still change.

    ``on_left`` and ``on_right`` are neighbours of the same direction that share a bound; ``oncoming`` is a neighbour of
    the other direction that shares a bound. ``is_folded``: every drawing of it crosses itself or leads backwards.
    """

    lane: NetLane
    center: Points
    left: Points
    right: Points
    on_left: "LaneBounds | None" = None
    on_right: "LaneBounds | None" = None
    oncoming: "LaneBounds | None" = None
    is_folded: bool = False

    def part(self) -> None:
        """Remove the neighbours, which no longer share a bound."""
        if self.on_left is not None:
            self.on_left.on_right = None
        if self.on_right is not None:
            self.on_right.on_left = None
        self.on_left = self.on_right = None

    def move_end(self, index: int, left: Points, right: Points) -> None:
        """Set the first (0) or last (−1) vertices of both bounds, and of the neighbours' bounds that share them."""
        self.left[index], self.right[index] = left, right
        if self.on_left is not None:
            self.on_left.right[index] = left
        if self.on_right is not None:
            self.on_right.left[index] = right


def draw_lane_bounds(net: SumoNet, graph: LaneGraph) -> tuple[dict[str, LaneBounds], tuple[str, ...]]:
    """Return the bounds of the graph's lanes by lane id, and the internal lanes without bounds (hairpins).

    Bounds that lead against their own direction or enclose no area do not count.
    """
    drawn: dict[str, LaneBounds] = {}
    for edge in net.edges.values():
        lanes = sorted((graph.lanes[key] for key in edge.lane_ids if key in graph.lanes), key=lambda lane: lane.index)
        for group in _parallel_groups(lanes):
            drawn.update(_draw_group(group[::-1] if net.lefthand else group))
    inside = [bounds for bounds in drawn.values() if bounds.lane.internal]
    for bounds in inside:
        _stitch(bounds, drawn, graph)
    for bounds in inside:
        following = drawn[graph.successors[bounds.lane.lane_id][0]]
        if following.lane.internal:
            _meet(bounds, following)
    for bounds in inside:
        _share_bounds(bounds)
    for key, bounds in drawn.items():
        _close_joint(key, bounds, drawn, graph)
    for bounds in drawn.values():
        bounds.is_folded = not (_repair(bounds) and _leads_forward(bounds))
    dropped = tuple(key for key, bounds in drawn.items() if bounds.is_folded and bounds.lane.internal)
    for key in dropped:
        drawn.pop(key).part()
    _find_oncoming(net, drawn)
    return drawn, dropped


def _leads_forward(bounds: LaneBounds) -> bool:
    """Return whether the left bound is on the left in driving direction, and the bounds enclose an area."""
    ahead, across = np.diff((bounds.left + bounds.right) / 2, axis=0), bounds.left - bounds.right
    between = (across[:-1] + across[1:]) / 2
    return float((ahead[:, 0] * between[:, 1] - ahead[:, 1] * between[:, 0]).sum()) > _LEAST_AREA_M2


def _parallel_groups(lanes: list[NetLane]) -> list[list[NetLane]]:
    """Return the lanes of an edge in order of index, in groups that are parallel over their whole length."""
    groups: list[list[NetLane]] = []
    for lane in lanes:
        if groups and lane.index == groups[-1][-1].index + 1 and _parallel(groups[-1][-1], lane):
            groups[-1].append(lane)
        else:
            groups.append([lane])
    return groups


def _parallel(lane: NetLane, other: NetLane) -> bool:
    """Return whether two centre lines are half the sum of their widths apart, to within a third of a width."""
    distance = np.linalg.norm(resample(lane.shape, 9) - resample(other.shape, 9), axis=1)
    width = (lane.width_m + other.width_m) / 2
    return bool(np.max(np.abs(distance - width)) < 0.35 * width + 0.1)


def _draw_group(group: list[NetLane]) -> dict[str, LaneBounds]:
    """Draw the bounds of parallel lanes, given from right to left, with vertices at equal shares of their length.

    Return them by lane id.
    """
    shares = _common_shares(group)
    drawn = []
    for lane in group:
        stations = arc_length(lane.shape)
        center = interpolate(lane.shape, stations, shares * stations[-1])
        half = lane.width_m / 2
        drawn.append(LaneBounds(lane, center, offset(center, half), offset(center, -half)))
    for right, left in pairwise(drawn):
        shared = _unfolded(right.center, (right.left + left.right) / 2)
        right.left, left.right = shared, shared.copy()
        right.on_left, left.on_right = left, right
    return {bounds.lane.lane_id: bounds for bounds in drawn}


def _common_shares(group: list[NetLane]) -> Values:
    """Return the shares of their length, from 0 to 1, at which all lanes of a group have vertices."""
    stations = [stations_along(lane.shape) for lane in group]
    longest = max(float(station[-1]) for station in stations)
    kept = [0.0]
    for share in np.unique(np.round(np.concatenate([station / station[-1] for station in stations]), 5))[1:]:
        if (share - kept[-1]) * longest >= _SHORTEST_SEGMENT_M or share == 1.0:
            kept.append(float(share))
    if len(kept) > 2 and (kept[-1] - kept[-2]) * longest < _SHORTEST_SEGMENT_M:
        kept.pop(-2)
    return np.array(kept) if len(kept) >= 3 else np.linspace(0, 1, 3)


def _stitch(bounds: LaneBounds, drawn: dict[str, LaneBounds], graph: LaneGraph) -> None:
    """Move an internal lane's ends onto the ends of the lanes before and after it, fading out along its length."""
    before = drawn[graph.predecessors[bounds.lane.lane_id][0]]
    after = drawn[graph.successors[bounds.lane.lane_id][0]]
    at_start, at_end = not before.lane.internal, not after.lane.internal
    stations = arc_length(bounds.center)
    share = stations / stations[-1]
    if at_start:
        fade = (np.clip(1 - 2 * share, 0, 1) if at_end else 1 - share)[:, None]
        bounds.left = bounds.left + (before.left[-1] - bounds.left[0]) * fade
        bounds.right = bounds.right + (before.right[-1] - bounds.right[0]) * fade
    if at_end:
        fade = (np.clip(2 * share - 1, 0, 1) if at_start else share)[:, None]
        bounds.left = bounds.left + (after.left[0] - bounds.left[-1]) * fade
        bounds.right = bounds.right + (after.right[0] - bounds.right[-1]) * fade
    bounds.left, bounds.right = _unfolded(bounds.center, bounds.left), _unfolded(bounds.center, bounds.right)
    if at_start:
        bounds.left[0], bounds.right[0] = before.left[-1], before.right[-1]
    if at_end:
        bounds.left[-1], bounds.right[-1] = after.left[0], after.right[0]


def _meet(before: LaneBounds, after: LaneBounds) -> None:
    """Move the adjoining ends of two consecutive internal lanes to their common middle."""
    left, right = (before.left[-1] + after.left[0]) / 2, (before.right[-1] + after.right[0]) / 2
    before.left[-1], before.right[-1] = left, right
    after.left[0], after.right[0] = left, right


def _share_bounds(bounds: LaneBounds) -> None:
    """Move the shared bounds of internal neighbours to their middle after stitching, or separate the neighbours."""
    other = bounds.on_left
    if other is None:
        return
    near = len(other.right) == len(bounds.left) and float(np.abs(bounds.left - other.right).max()) < _SAME_LINE_M
    if near:
        shared = (bounds.left + other.right) / 2
        bounds.left, other.right = shared, shared.copy()
    else:
        bounds.on_left = other.on_right = None


def _close_joint(key: str, bounds: LaneBounds, drawn: dict[str, LaneBounds], graph: LaneGraph) -> None:
    """Make two normal lanes that follow each other directly share their end points."""
    if len(graph.successors[key]) != 1 or bounds.lane.internal:
        return
    after = drawn[graph.successors[key][0]]
    alone = len(graph.predecessors[after.lane.lane_id]) == 1
    if after.lane.internal or not alone or np.linalg.norm(bounds.center[-1] - after.center[0]) >= _WIDEST_JOINT_M:
        return
    left, right = (bounds.left[-1] + after.left[0]) / 2, (bounds.right[-1] + after.right[0]) / 2
    bounds.move_end(-1, left, right)
    after.move_end(0, left, right)


def _repair(bounds: LaneBounds) -> bool:
    """Redraw bounds that cross themselves; return whether the new bounds enclose a simple polygon."""
    lines = repaired(bounds.center, bounds.left, bounds.right)
    if lines is None:
        return False
    if lines[0] is not bounds.left:
        bounds.part()
    bounds.left, bounds.right = lines
    return True


def _find_oncoming(net: SumoNet, drawn: dict[str, LaneBounds]) -> None:
    """Pair the innermost lanes of opposite edges between the same junctions that share their inner bound."""
    innermost: dict[tuple[str, str], list[LaneBounds]] = {}
    for edge in net.edges.values():
        lanes = [drawn[key] for key in edge.lane_ids if key in drawn]
        if not edge.internal and lanes:
            ends = (edge.from_junction, edge.to_junction)
            innermost.setdefault(ends, []).append(max(lanes, key=lambda bounds: bounds.lane.index))
    for (start, end), lanes_there in innermost.items():
        for bounds in lanes_there:
            if bounds.oncoming is not None:
                continue
            for other in innermost.get((end, start), ()):
                if other.oncoming is not None or other is bounds:
                    continue
                own = bounds.right if net.lefthand else bounds.left
                facing = other.right if net.lefthand else other.left
                apart_m = np.linalg.norm(resample(own, 20) - resample(facing[::-1], 20), axis=1)
                if float(apart_m.max()) < _SAME_LINE_M:
                    bounds.oncoming, other.oncoming = other, bounds
                    break


_FOLD_STEP_M = 1e-2
"""Chosen: vertices that would fold back are put this far apart; equal ones would have no direction."""
_NEAREST_VERTICES_M = 0.05
"""Chosen: of two vertices closer together than this, one is left out."""


def stations_along(points: Points, maximum_step_m: float = 4.0) -> Values:
    """Return at least three arc lengths: those of all vertices, and further ones so that no step exceeds the
    maximum.
    """
    vertices = np.unique(np.round(arc_length(points), 4))
    total = float(vertices[-1])
    stations = [0.0]
    for vertex in vertices[1:]:
        start = stations[-1]
        gap = float(vertex) - start
        if gap < _NEAREST_VERTICES_M and vertex != total:
            continue
        pieces = max(int(np.ceil(gap / maximum_step_m)), 1)
        stations.extend(start + gap * (piece + 1) / pieces for piece in range(pieces))
    if len(stations) > 2 and stations[-1] - stations[-2] < _NEAREST_VERTICES_M:
        stations.pop(-2)
    return np.array(stations) if len(stations) >= 3 else np.linspace(0.0, total, 3)


def _normals(points: Points) -> Points:
    """Return left normals at the vertices, up to doubled in curves so that offset lines keep their distance."""
    step = np.diff(points, axis=0)
    step = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
    at_vertices = np.empty_like(points)
    at_vertices[0], at_vertices[-1] = normal[0], normal[-1]
    if len(points) > 2:
        middle = normal[:-1] + normal[1:]
        size = np.linalg.norm(middle, axis=1, keepdims=True)
        middle = np.where(size > 1e-6, middle / np.maximum(size, 1e-9), normal[:-1])
        at_vertices[1:-1] = middle / np.clip(np.sum(middle * normal[:-1], axis=1, keepdims=True), 0.5, 1.0)
    return at_vertices


def offset(points: Points, distance_m: float) -> Points:
    """Return the line shifted to the left by the distance (to the right if negative), without folds."""
    return _unfolded(points, points + _normals(points) * distance_m)


def _unfolded(center: Points, bound: Points, rounds: int = 50) -> Points:
    """Return the bound with each run of vertices that leads backwards along the centre line pulled together."""
    bound = bound.copy()
    along = np.diff(center, axis=0)
    for _ in range(rounds):
        backward = np.flatnonzero(np.sum(np.diff(bound, axis=0) * along, axis=1) < 1e-6)
        if len(backward) == 0:
            break
        for run in np.split(backward, np.flatnonzero(np.diff(backward) > 1) + 1):
            _draw_together(center, bound, int(run[0]), int(run[-1]) + 1)
    return bound


def _draw_together(center: Points, bound: Points, first: int, last: int) -> None:
    """Pull the vertices from the first to the last close together, in the local direction of the centre line."""
    count, direction = last - first + 1, unit(center[last] - center[first])
    if first == 0 and last == len(bound) - 1:
        middle = bound.mean(axis=0)
        bound[:] = middle + (center - center.mean(axis=0)) * 0.05
    elif first == 0:
        bound[: last + 1] = bound[0] + np.linspace(0, 1, count)[:, None] * _FOLD_STEP_M * direction
    elif last == len(bound) - 1:
        bound[first:] = bound[-1] - np.linspace(1, 0, count)[:, None] * _FOLD_STEP_M * direction
    else:
        middle = bound[first : last + 1].mean(axis=0)
        spread = np.linspace(-0.5, 0.5, count)[:, None] * _FOLD_STEP_M * count * direction
        bound[first : last + 1] = middle + spread


def is_valid(left: Points, right: Points) -> bool:
    """Return whether the bounds enclose a simple polygon once rounded as in a file; rounding can close a narrow gap."""
    from shapely.geometry import Polygon

    polygon = Polygon(np.round(np.concatenate([left, right[::-1]]), ROAD_DECIMALS))
    return bool(polygon.is_valid and polygon.area > 1e-4)


def repaired(center: Points, left: Points, right: Points) -> tuple[Points, Points] | None:
    """Return the bounds or, if they enclose no simple polygon, the first milder bounds that do; None if there
    are none.
    """
    if is_valid(left, right):
        return left, right
    for candidate in _redrawings(center, left, right):
        if is_valid(*candidate):
            return candidate
    return None


def _redrawings(center: Points, left: Points, right: Points) -> Iterator[tuple[Points, Points]]:
    """Yield bounds with the same ends, most similar to the given bounds first.

    The order is: narrower bounds at self-crossings, curves between the ends with less and less tension, straight lines,
    and bounds closer to the centre line.
    """
    yield from _narrowings(left, right)
    count = len(center)
    start, end = unit(center[1] - center[0]), unit(center[-1] - center[-2])
    for tension in (1.0, 0.5, 0.1, 0.0):
        yield _curve(left, start, end, tension), _curve(right, start, end, tension)
    share = np.linspace(0, 1, count)[:, None]
    yield left[0] * (1 - share) + left[-1] * share, right[0] * (1 - share) + right[-1] * share
    half_width = float(np.linalg.norm(left[0] - right[0])) / 2
    across = _normals(center)
    for factor in (0.6, 0.35, 0.2, 0.1, 0.05):
        inner_left, inner_right = center + across * half_width * factor, center - across * half_width * factor
        for inner, outer in ((inner_left, left), (inner_right, right)):
            inner[0], inner[-1] = outer[0], outer[-1]
        yield inner_left, inner_right


def _curve(bound: Points, start_direction: Points, end_direction: Points, tension: float) -> Points:
    """Return a curve between the ends of a bound in the given directions; without tension, a straight line."""
    reach_m = float(np.linalg.norm(bound[-1] - bound[0])) * tension
    shares = np.linspace(0, 1, len(bound))
    return hermite(bound[0], start_direction, bound[-1], end_direction, shares, (reach_m, reach_m))


def _narrowings(left: Points, right: Points) -> Iterator[tuple[Points, Points]]:
    """Yield the bounds, step by step closer together where a bound crosses itself."""
    middle = (left + right) / 2
    for _ in range(8):
        width = np.ones(len(left))
        for bound in (left, right):
            for first, second in _self_crossings(bound):
                width[max(first - 1, 0) : min(second + 3, len(left))] = 0.7
        if bool((width == 1).all()):
            return
        width[0] = width[-1] = 1.0
        left, right = middle + (left - middle) * width[:, None], middle + (right - middle) * width[:, None]
        yield left, right


def _self_crossings(line: Points) -> list[tuple[int, int]]:
    """Return the pairs of indices of segments that cross each other."""
    crossings: list[tuple[int, int]] = []
    for first in range(len(line) - 3):
        step = line[first + 1] - line[first]
        starts, steps = line[first + 2 : -1], line[first + 3 :] - line[first + 2 : -1]
        cross = step[0] * steps[:, 1] - step[1] * steps[:, 0]
        between = starts - line[first]
        with np.errstate(divide="ignore", invalid="ignore"):
            here = (between[:, 0] * steps[:, 1] - between[:, 1] * steps[:, 0]) / cross
            there = (between[:, 0] * step[1] - between[:, 1] * step[0]) / cross
        hit = (np.abs(cross) > 1e-12) & (here >= 0) & (here <= 1) & (there >= 0) & (there <= 1)
        crossings.extend((first, first + 2 + int(index)) for index in np.flatnonzero(hit))
    return crossings
