"""Ways over junctions drawn anew where netconvert leaves a corner at one of their ends, or a hook within.

Where a junction is small or was joined of several, netconvert gives up its own curve and draws a straight line, or one
that ends across the road that it leads to. Vehicles and lanelets follow these lines, so they are mended in the net.
"""

import math
from collections.abc import Iterator
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import (
    Points,
    Values,
    arc_length,
    headings,
    interpolate,
    length_m,
    resample,
    without_repeats,
    wrap_angles,
)

FOLD_RAD = math.radians(100.0)
LARGEST_CORNER_RAD = math.radians(20.0)
TIGHT_M, LEAST_GAIN = 3.0, 1.2
"""A bend of a smaller radius is a hook where another curve makes the radius so many times larger."""
REACHES = (0.2, 0.35, 0.5, 0.75, 1.0, 1.4)
"""How far a curve keeps the direction of its ends, as shares of the distance between them."""
SAMPLES = 33
SPACING_M, FEWEST_POINTS = 1.0, 10
DECIMALS = 3


def mend_corners(net_path: Path) -> int:
    """Replace, in place, every way over a junction that meets its roads at a corner by the mildest curve between them.

    Folds in the lanes of roads are left out before.

    Returns:
        The number of lanes of roads and ways that were drawn anew.
    """
    root = etree.parse(net_path).getroot()
    lanes = {lane.get("id", ""): lane for lane in root.iter("lane")}
    changed = sum(_unfold(lane) for key, lane in lanes.items() if not key.startswith(":"))
    for before, inside, after in _ways(root):
        if not all(lane in lanes for lane in (before, *inside, after)):
            continue
        ends = _shape(lanes[before]), _shape(lanes[after])
        parts = [_shape(lanes[lane]) for lane in inside]
        if any(len(line) < 2 for line in (*ends, *parts)):
            continue
        way = without_repeats(np.concatenate(parts))
        curve = mildest_curve(ends[0][-1] - ends[0][-2], way, ends[1][1] - ends[1][0])
        if curve is not None:
            for lane, part in zip(inside, _split(curve, [length_m(part) for part in parts]), strict=True):
                _set_shape(lanes[lane], part)
            changed += 1
    if changed:
        net_path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return changed


def _unfold(lane: etree._Element) -> bool:
    old = _shape(lane)
    new = without_folds(old)
    if len(new) < len(old):
        _set_shape(lane, new)
    return len(new) < len(old)


def without_folds(line: Points) -> Points:
    """The line without the inner vertices at which it turns back (by more than 100°)."""
    while len(line) > 2:
        turns = np.abs(np.diff(headings(line)))
        sharpest = int(np.argmax(turns))
        if turns[sharpest] <= FOLD_RAD:
            break
        line = np.delete(line, sharpest + 1, axis=0)
    return line


def mildest_curve(ahead: Points, way: Points, onward: Points) -> Points | None:
    """A curve between the ends of a way that leaves and arrives in the given directions, bent as little as can be.

    None where the way itself has neither a corner at its ends nor a hook, or no curve is milder.
    """
    if len(way) < 2:
        return None
    corner = _sharpest_corner(ahead, way, onward)
    bend = _sharpest_bend(way)
    if corner <= LARGEST_CORNER_RAD and bend <= 1 / TIGHT_M:
        return None
    curve = _least_bent(ahead / np.linalg.norm(ahead), way[0], way[-1], onward / np.linalg.norm(onward))
    if _sharpest_corner(ahead, curve, onward) < corner - LARGEST_CORNER_RAD / 2:
        return curve
    hooked = corner <= LARGEST_CORNER_RAD and bend > LEAST_GAIN * _sharpest_bend(curve)
    return curve if hooked else None


def _least_bent(ahead: Points, start: Points, end: Points, onward: Points) -> Points:
    span = float(np.linalg.norm(end - start))
    curves = [
        _cubic(start, start + ahead * span * first, end - onward * span * last, end)
        for first, last in product(REACHES, REACHES)
    ]
    best = min(curves, key=_sharpest_bend)
    return resample(best, max(FEWEST_POINTS, math.ceil(length_m(best) / SPACING_M) + 1))


def _sharpest_corner(ahead: Points, way: Points, onward: Points) -> float:
    directions = np.vstack([ahead, np.diff(way, axis=0)[[0, -1]], onward])
    angles = np.arctan2(directions[:, 1], directions[:, 0])
    return float(np.abs(wrap_angles(angles[[1, 3]] - angles[[0, 2]])).max())


def _sharpest_bend(curve: Points) -> float:
    """Largest curvature in 1/m."""
    if len(curve) < 3:
        return 0.0
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    turns = np.abs(np.diff(headings(curve)))
    return float(np.max(turns / np.maximum((steps[1:] + steps[:-1]) / 2, 1e-6)))


def _cubic(start: Points, first: Points, last: Points, end: Points) -> Points:
    u = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    curve: Points = (1 - u) ** 3 * start + 3 * u * (1 - u) ** 2 * first + 3 * u**2 * (1 - u) * last + u**3 * end
    return curve


def _ways(root: etree._Element) -> Iterator[tuple[str, list[str], str]]:
    """Every connection of two roads: the lane before, those inside the junction in order, the lane behind."""
    following = {
        f"{found.get('from')}_{found.get('fromLane')}": found.get("via")
        for found in root.iterfind("connection")
        if found.get("from", "").startswith(":")
    }
    for found in root.iterfind("connection"):
        lane = found.get("via")
        if lane is None or found.get("from", "").startswith(":"):
            continue
        inside = []
        while lane is not None and lane not in inside:
            inside.append(lane)
            lane = following.get(lane)
        yield f"{found.get('from')}_{found.get('fromLane')}", inside, f"{found.get('to')}_{found.get('toLane')}"


def _shape(lane: etree._Element) -> Points:
    points = [[float(value) for value in point.split(",")[:2]] for point in lane.get("shape", "").split()]
    return without_repeats(np.array(points, dtype=float).reshape(-1, 2))


def _split(curve: Points, lengths_m: list[float]) -> list[Points]:
    """The curve in pieces that have the given shares of its length."""
    stations = arc_length(curve)
    ends = np.concatenate([[0.0], np.cumsum(lengths_m)]) / sum(lengths_m) * stations[-1]
    return [_piece(curve, stations, float(begin), float(end)) for begin, end in pairwise(ends)]


def _piece(curve: Points, stations: Values, begin: float, end: float) -> Points:
    between = stations[(stations > begin + 0.05) & (stations < end - 0.05)]
    return interpolate(curve, stations, np.concatenate([[begin], between, [end]]))


def _set_shape(lane: etree._Element, shape: Points) -> None:
    lane.set("shape", " ".join(f"{x:.{DECIMALS}f},{y:.{DECIMALS}f}" for x, y in shape))
    lane.set("length", f"{max(length_m(shape), 0.1):.{DECIMALS}f}")
