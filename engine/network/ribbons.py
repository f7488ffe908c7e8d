"""Ribbons: a lane's centre line and width turned into a left and a right bound that do not fold or cross.

All lines have shape (n, 2); bounds have as many vertices as their centre line.
"""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length

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


def normals(points: Points) -> Points:
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
    return unfolded(points, points + normals(points) * distance_m)


def unfolded(center: Points, bound: Points, rounds: int = 50) -> Points:
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
    start, end = center[1] - center[0], center[-1] - center[-2]
    for tension in (1.0, 0.5, 0.1, 0.0):
        yield (
            _hermite(left[0], left[-1], start, end, tension, count),
            _hermite(right[0], right[-1], start, end, tension, count),
        )
    share = np.linspace(0, 1, count)[:, None]
    yield left[0] * (1 - share) + left[-1] * share, right[0] * (1 - share) + right[-1] * share
    half_width = float(np.linalg.norm(left[0] - right[0])) / 2
    across = normals(center)
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


def _hermite(start: Points, end: Points, before: Points, after: Points, tension: float, count: int) -> Points:
    """Cubic Hermite curve of ``count`` points between two points with the given end directions."""
    reach = float(np.linalg.norm(end - start)) * tension
    before = before / max(float(np.linalg.norm(before)), 1e-9) * reach
    after = after / max(float(np.linalg.norm(after)), 1e-9) * reach
    u = np.linspace(0, 1, count)[:, None]
    curve: Points = (
        (2 * u**3 - 3 * u**2 + 1) * start
        + (u**3 - 2 * u**2 + u) * before
        + (3 * u**2 - 2 * u**3) * end
        + (u**3 - u**2) * after
    )
    return curve
