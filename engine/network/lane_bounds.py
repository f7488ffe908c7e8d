"""Left and right bounds for all lanes of a SUMO net: shared between neighbours, continuous from lane to lane."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..geometry import Points, Values, arc_length, hermite, interpolate, resample, unit
from .net_parser import LaneGraph, NetLane, SumoNet

# ---------- ribbons
# Ribbons: a lane's centre line and width turned into a left and a right bound that do not fold or cross.
#
# All lines have shape (n, 2); bounds have as many vertices as their centre line.

FOLD_STEP_M = 1e-2


def stations_along(points: Points, maximum_step_m: float = 4.0) -> Values:
    """Arc lengths of all vertices, filled up so that no step is longer than the maximum; at least three."""
    vertices = np.unique(np.round(arc_length(points), 4))
    total = float(vertices[-1])
    found = [0.0]
    for station in vertices[1:]:
        start = found[-1]
        gap = float(station) - start
        if gap < 0.05 and station != total:
            continue
        pieces = max(int(np.ceil(gap / maximum_step_m)), 1)
        found.extend(start + gap * (piece + 1) / pieces for piece in range(pieces))
    if len(found) > 2 and found[-1] - found[-2] < 0.05:
        found.pop(-2)
    return np.array(found) if len(found) >= 3 else np.linspace(0.0, total, 3)


def _normals(points: Points) -> Points:
    """Left normals at the vertices, lengthened in bends so that an offset keeps its distance (at most doubled)."""
    step = np.diff(points, axis=0)
    step = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
    found = np.empty_like(points)
    found[0], found[-1] = normal[0], normal[-1]
    if len(points) > 2:
        middle = normal[:-1] + normal[1:]
        size = np.linalg.norm(middle, axis=1, keepdims=True)
        middle = np.where(size > 1e-6, middle / np.maximum(size, 1e-9), normal[:-1])
        found[1:-1] = middle / np.clip(np.sum(middle * normal[:-1], axis=1, keepdims=True), 0.5, 1.0)
    return found


def offset(points: Points, distance_m: float) -> Points:
    """The line moved to the left by the distance (to the right where negative), without folds."""
    return _unfolded(points, points + _normals(points) * distance_m)


def _unfolded(center: Points, bound: Points, rounds: int = 50) -> Points:
    """The bound with every run of vertices that goes backward along the centre line drawn together."""
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
    count = last - first + 1
    direction = center[last] - center[first]
    direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
    if first == 0 and last == len(bound) - 1:
        middle = bound.mean(axis=0)
        bound[:] = middle + (center - center.mean(axis=0)) * 0.05
    elif first == 0:
        bound[: last + 1] = bound[0] + np.linspace(0, 1, count)[:, None] * FOLD_STEP_M * direction
    elif last == len(bound) - 1:
        bound[first:] = bound[-1] - np.linspace(1, 0, count)[:, None] * FOLD_STEP_M * direction
    else:
        middle = bound[first : last + 1].mean(axis=0)
        spread = np.linspace(-0.5, 0.5, count)[:, None] * FOLD_STEP_M * count * direction
        bound[first : last + 1] = middle + spread


def is_valid(left: Points, right: Points) -> bool:
    """Whether the two bounds enclose a simple polygon."""
    from shapely.geometry import Polygon

    polygon = Polygon(np.concatenate([left, right[::-1]]))
    return bool(polygon.is_valid and polygon.area > 1e-4)


def repaired(center: Points, left: Points, right: Points) -> tuple[Points, Points] | None:
    """The mildest redrawing with the same end points that encloses a simple polygon; None where there is none."""
    if is_valid(left, right):
        return left, right
    for candidate in _redrawings(center, left, right):
        if is_valid(*candidate):
            return candidate
    return None


def _redrawings(center: Points, left: Points, right: Points) -> Iterator[tuple[Points, Points]]:
    yield from _narrowings(left, right)
    count = len(center)
    start, end = unit(center[1] - center[0]), unit(center[-1] - center[-2])
    for tension in (1.0, 0.5, 0.1, 0.0):
        reaches_m = [float(np.linalg.norm(bound[-1] - bound[0])) * tension for bound in (left, right)]
        left_curve, right_curve = (
            hermite(bound[0], start, bound[-1], end, np.linspace(0, 1, count), (reach_m, reach_m))
            for bound, reach_m in zip((left, right), reaches_m, strict=True)
        )
        yield left_curve, right_curve
    share = np.linspace(0, 1, count)[:, None]
    yield left[0] * (1 - share) + left[-1] * share, right[0] * (1 - share) + right[-1] * share
    half_width = float(np.linalg.norm(left[0] - right[0])) / 2
    across = _normals(center)
    for factor in (0.6, 0.35, 0.2, 0.1, 0.05):
        inner_left, inner_right = center + across * half_width * factor, center - across * half_width * factor
        for inner, outer in ((inner_left, left), (inner_right, right)):
            inner[0], inner[-1] = outer[0], outer[-1]
        yield inner_left, inner_right


def _narrowings(left: Points, right: Points) -> Iterator[tuple[Points, Points]]:
    """The ribbon, step by step narrower where a bound crosses itself."""
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
    """Pairs of segment indices that cross."""
    found: list[tuple[int, int]] = []
    for first in range(len(line) - 3):
        step = line[first + 1] - line[first]
        starts, steps = line[first + 2 : -1], line[first + 3 :] - line[first + 2 : -1]
        cross = step[0] * steps[:, 1] - step[1] * steps[:, 0]
        between = starts - line[first]
        with np.errstate(divide="ignore", invalid="ignore"):
            here = (between[:, 0] * steps[:, 1] - between[:, 1] * steps[:, 0]) / cross
            there = (between[:, 0] * step[1] - between[:, 1] * step[0]) / cross
        hit = (np.abs(cross) > 1e-12) & (here >= 0) & (here <= 1) & (there >= 0) & (there <= 1)
        found.extend((first, first + 2 + int(index)) for index in np.flatnonzero(hit))
    return found


# ---------- lane_bounds
# Left and right bounds for all lanes of a SUMO net: shared between neighbours, continuous from lane to lane.

LARGEST_GAP_M = 3.0


@dataclass
class Ribbon:
    """A lane while its bounds are being drawn; ``on_left`` and ``on_right`` name neighbours that share a bound."""

    lane: NetLane
    center: Points
    left: Points
    right: Points
    on_left: "Ribbon | None" = None
    on_right: "Ribbon | None" = None
    oncoming: "Ribbon | None" = None

    def part(self) -> None:
        """Forget the neighbours: they no longer share a bound."""
        if self.on_left is not None:
            self.on_left.on_right = None
        if self.on_right is not None:
            self.on_right.on_left = None
        self.on_left = self.on_right = None

    def move_end(self, index: int, left: Points, right: Points) -> None:
        """Set the first (0) or last (−1) vertices of both bounds, for sharing neighbours too."""
        self.left[index], self.right[index] = left, right
        if self.on_left is not None:
            self.on_left.right[index] = left
        if self.on_right is not None:
            self.on_right.left[index] = right


def draw_ribbons(net: SumoNet, graph: LaneGraph) -> tuple[dict[str, Ribbon], tuple[str, ...]]:
    """The ribbons of all lanes of the graph, and the internal lanes for which none can be drawn (hairpins).

    A ribbon that leads against its own bounds counts as one that cannot be drawn.
    """
    ribbons: dict[str, Ribbon] = {}
    for edge in net.edges.values():
        lanes = sorted((graph.lanes[key] for key in edge.lane_ids if key in graph.lanes), key=lambda lane: lane.index)
        for group in _parallel_groups(lanes):
            ribbons.update(_draw_group(group[::-1] if net.lefthand else group))
    inside = [ribbon for ribbon in ribbons.values() if ribbon.lane.internal]
    for ribbon in inside:
        _stitch(ribbon, ribbons, graph)
    for ribbon in inside:
        following = ribbons[graph.successors[ribbon.lane.lane_id][0]]
        if following.lane.internal:
            _meet(ribbon, following)
    for ribbon in inside:
        _share_again(ribbon)
    for key, ribbon in ribbons.items():
        _close_joint(key, ribbon, ribbons, graph)
    dropped = tuple(
        key for key, ribbon in ribbons.items() if not (_repair(ribbon) and _leads_on(ribbon)) and ribbon.lane.internal
    )
    for key in dropped:
        ribbons.pop(key).part()
    _find_oncoming(net, ribbons)
    return ribbons, dropped


def _leads_on(ribbon: Ribbon) -> bool:
    """Whether the left bound lies on the left, seen along the ribbon."""
    ahead, across = np.diff((ribbon.left + ribbon.right) / 2, axis=0), ribbon.left - ribbon.right
    between = (across[:-1] + across[1:]) / 2
    return float((ahead[:, 0] * between[:, 1] - ahead[:, 1] * between[:, 0]).sum()) >= 0.0


def _parallel_groups(lanes: list[NetLane]) -> list[list[NetLane]]:
    groups: list[list[NetLane]] = []
    for lane in lanes:
        if groups and lane.index == groups[-1][-1].index + 1 and _parallel(groups[-1][-1], lane):
            groups[-1].append(lane)
        else:
            groups.append([lane])
    return groups


def _parallel(one: NetLane, other: NetLane) -> bool:
    distance = np.linalg.norm(resample(one.shape, 9) - resample(other.shape, 9), axis=1)
    width = (one.width_m + other.width_m) / 2
    return bool(np.max(np.abs(distance - width)) < 0.35 * width + 0.1)


def _draw_group(group: list[NetLane]) -> dict[str, Ribbon]:
    """Ribbons of parallel lanes, given from right to left, with vertices at the same shares of their length."""
    shares = _common_shares(group)
    ribbons = []
    for lane in group:
        stations = arc_length(lane.shape)
        center = interpolate(lane.shape, stations, shares * stations[-1])
        half = lane.width_m / 2
        ribbons.append(Ribbon(lane, center, offset(center, half), offset(center, -half)))
    for right, left in pairwise(ribbons):
        shared = _unfolded(right.center, (right.left + left.right) / 2)
        right.left, left.right = shared, shared.copy()
        right.on_left, left.on_right = left, right
    return {ribbon.lane.lane_id: ribbon for ribbon in ribbons}


def _common_shares(group: list[NetLane]) -> Values:
    stations = [stations_along(lane.shape) for lane in group]
    longest = max(float(station[-1]) for station in stations)
    kept = [0.0]
    for share in np.unique(np.round(np.concatenate([station / station[-1] for station in stations]), 5))[1:]:
        if (share - kept[-1]) * longest >= 0.25 or share == 1.0:
            kept.append(float(share))
    if len(kept) > 2 and (kept[-1] - kept[-2]) * longest < 0.25:
        kept.pop(-2)
    return np.array(kept) if len(kept) >= 3 else np.linspace(0, 1, 3)


def _stitch(ribbon: Ribbon, ribbons: dict[str, Ribbon], graph: LaneGraph) -> None:
    """Draw an internal lane's ends onto those of the lanes before and after, faded out along its length."""
    before = ribbons[graph.predecessors[ribbon.lane.lane_id][0]]
    after = ribbons[graph.successors[ribbon.lane.lane_id][0]]
    at_start, at_end = not before.lane.internal, not after.lane.internal
    stations = arc_length(ribbon.center)
    share = stations / stations[-1]
    if at_start:
        fade = (np.clip(1 - 2 * share, 0, 1) if at_end else 1 - share)[:, None]
        ribbon.left = ribbon.left + (before.left[-1] - ribbon.left[0]) * fade
        ribbon.right = ribbon.right + (before.right[-1] - ribbon.right[0]) * fade
    if at_end:
        fade = (np.clip(2 * share - 1, 0, 1) if at_start else share)[:, None]
        ribbon.left = ribbon.left + (after.left[0] - ribbon.left[-1]) * fade
        ribbon.right = ribbon.right + (after.right[0] - ribbon.right[-1]) * fade
    ribbon.left, ribbon.right = _unfolded(ribbon.center, ribbon.left), _unfolded(ribbon.center, ribbon.right)
    if at_start:
        ribbon.left[0], ribbon.right[0] = before.left[-1], before.right[-1]
    if at_end:
        ribbon.left[-1], ribbon.right[-1] = after.left[0], after.right[0]


def _meet(before: Ribbon, after: Ribbon) -> None:
    """Two internal lanes in a row share the middle of their end points."""
    left, right = (before.left[-1] + after.left[0]) / 2, (before.right[-1] + after.right[0]) / 2
    before.left[-1], before.right[-1] = left, right
    after.left[0], after.right[0] = left, right


def _share_again(ribbon: Ribbon) -> None:
    """After stitching: internal neighbours share the middle of their bounds, or are neighbours no more."""
    other = ribbon.on_left
    if other is None:
        return
    near = len(other.right) == len(ribbon.left) and float(np.abs(ribbon.left - other.right).max()) < 0.5
    if near:
        shared = (ribbon.left + other.right) / 2
        ribbon.left, other.right = shared, shared.copy()
    else:
        ribbon.on_left = other.on_right = None


def _close_joint(key: str, ribbon: Ribbon, ribbons: dict[str, Ribbon], graph: LaneGraph) -> None:
    """Two normal lanes that follow each other directly share their end points."""
    if len(graph.successors[key]) != 1 or ribbon.lane.internal:
        return
    after = ribbons[graph.successors[key][0]]
    alone = len(graph.predecessors[after.lane.lane_id]) == 1
    if after.lane.internal or not alone or np.linalg.norm(ribbon.center[-1] - after.center[0]) >= LARGEST_GAP_M:
        return
    left, right = (ribbon.left[-1] + after.left[0]) / 2, (ribbon.right[-1] + after.right[0]) / 2
    ribbon.move_end(-1, left, right)
    after.move_end(0, left, right)


def _repair(ribbon: Ribbon) -> bool:
    bounds = repaired(ribbon.center, ribbon.left, ribbon.right)
    if bounds is None:
        return False
    if bounds[0] is not ribbon.left:
        ribbon.part()
    ribbon.left, ribbon.right = bounds
    return True


def _find_oncoming(net: SumoNet, ribbons: dict[str, Ribbon]) -> None:
    """Innermost lanes of two edges between the same junctions that share their inner bound."""
    innermost: dict[tuple[str, str], list[Ribbon]] = {}
    for edge in net.edges.values():
        lanes = [ribbons[key] for key in edge.lane_ids if key in ribbons]
        if not edge.internal and lanes:
            ends = (edge.from_junction, edge.to_junction)
            innermost.setdefault(ends, []).append(max(lanes, key=lambda ribbon: ribbon.lane.index))
    for (start, end), found in innermost.items():
        for ribbon in found:
            for other in innermost.get((end, start), ()):
                one = ribbon.right if net.lefthand else ribbon.left
                two = other.right if net.lefthand else other.left
                if float(np.linalg.norm(resample(one, 20) - resample(two[::-1], 20), axis=1).max()) < 0.5:
                    ribbon.oncoming = other
                    break
