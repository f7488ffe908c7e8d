"""A strip of lanes as OpenDRIVE has it: a reference line, and the left offset of each bound along it.

The reference line runs in the middle of the strip, as pieces of cubic curves; at its two ends, the normal is the end of
the strip, so a skew end is kept. Bounds are described by their intersections with the normals, at every station where
any bound has a vertex: at these stations, the file matches the lanelets exactly. Lengths in m.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry import Points, Values, arc_length, interpolate, unit, without_repeats

SPACING_M, FEWEST = 2.0, 4
"""Spacing and least number of the points that the reference line runs through (chosen)."""
DENSE_M = 0.1
"""Spacing of the places on the reference line at which normals are tried (chosen)."""
REACH = 3.0
"""Search distance for a bound on a normal, in widths of the strip (chosen): farther ones belong to another bend."""
STEEPEST_RAD, TURNINGS = np.radians(85.0), (2.5, 0.0, 1.2, 5.0)
"""Chosen: a skew end is kept up to this angle, so that lanes meet. The reference line turns into it over this many
widths times the angle: a cubic is about four times as bent at a skew end as on average, and its normals cross inside a
strip if the radius is less than half the width. The first is tried first, the others if a bound is missed.
"""
GOOD_M, FAR_M = 0.02, 0.1
"""Chosen: a miss up to the first needs no other try; a miss above the second counts first."""
TRIED_M, TRIED_AT_ENDS_M = 0.5, 0.1
"""Spacing of the places at which bounds are cut in addition to vertices (chosen); skew ends turn the normals."""
FLAT_M = 0.002
"""Places at which a bound is nearer to the straight line between its neighbours are not written (chosen)."""
LEVEL_M = 0.004
"""Chosen: a bound that ends this near to the normal at the end of its strip ends on it; ASAM's checker takes 1 cm for a
gap between lanes, and two strips meet there.
"""
_ENDS_M = 1e-3


@dataclass(frozen=True)
class CurvePiece:
    """A cubic from a station: start (2,), heading in rad, length, and its polynomials u(p), v(p) for p in [0, 1]."""

    station_m: float
    start: Points
    heading_rad: float
    length_m: float
    u: Values
    v: Values


@dataclass(frozen=True)
class Strip:
    """Adjacent lanes: the pieces of the reference line, stations (n,), and left offsets (n, bounds) at these."""

    pieces: tuple[CurvePiece, ...]
    stations_m: Values
    offsets_m: Points


def strip_of(bounds: Sequence[Points]) -> Strip:
    """Return the strip between bounds (n, 2) each, from left to right, all in driving direction.

    Raises:
        ValueError: the bounds have no length, so they enclose no strip.
    """
    lines = [without_repeats(line) for line in bounds]
    if any(len(line) < 2 for line in lines):
        raise ValueError("a bound has no length")
    best, least = _strip(lines, TURNINGS[0])
    for turning in TURNINGS[1:]:
        if least[1] <= GOOD_M:
            break
        other, miss = _strip(lines, turning)
        if miss < least:
            best, least = other, miss
    if _missed_at_ends_m(best, lines) > LEVEL_M:  # folded bounds, shorter than the lane is wide: only the ends count
        other, _ = _strip([line[[0, -1]] for line in lines], 0.0)
        if _missed_at_ends_m(other, lines) <= LEVEL_M:
            return other
    return best


def _missed_at_ends_m(strip: Strip, lines: Sequence[Points]) -> float:
    """Return the largest distance between a strip's corners and the ends of the bounds."""
    last = strip.pieces[-1]
    middle, normals = evaluate(strip.pieces, np.array([0.0, last.station_m + last.length_m]))
    drawn = middle[:, None] + normals[:, None] * strip.offsets_m[[0, -1], :, None]
    given = np.array([[line[end] for line in lines] for end in (0, -1)])
    return float(np.linalg.norm(drawn - given, axis=2).max())


def _strip(lines: Sequence[Points], turning: float) -> tuple[Strip, tuple[int, float]]:
    """Return a strip and its deviations: the number of points above ``FAR_M``, and the largest deviation."""
    pieces = _reference_line(lines[0], lines[-1], turning)
    stations, positions, normals = _sampled(pieces, DENSE_M)
    width = float(max(np.linalg.norm(lines[0][[0, -1]] - lines[-1][[0, -1]], axis=1).max(), 1.0))
    every = _tried(pieces)
    for line in lines:
        every += _feet(line, stations, positions, normals, REACH * width)
    wanted = np.unique(np.round(every, 6))
    wanted = wanted[np.concatenate([[True], np.diff(wanted) > _ENDS_M])]
    wanted[-1] = stations[-1]
    at, across = evaluate(pieces, wanted)
    offsets = np.column_stack([_cut(line, at, across, REACH * width) for line in lines])
    for column in range(1, offsets.shape[1]):  # a bound never crosses the one on its left
        offsets[:, column] = np.minimum(offsets[:, column], offsets[:, column - 1])
    away = np.concatenate([_apart(line, at + across * offsets[:, [k]]) for k, line in enumerate(lines)])
    kept = _needed(wanted, offsets)
    return Strip(tuple(pieces), wanted[kept], offsets[kept]), (int((away > FAR_M).sum()), float(away.max()))


def _apart(one: Points, other: Points) -> Values:
    """Return the distances between two lines: from each line's vertices to the other line."""
    import shapely

    pairs = ((one, other), (other, one))
    away: list[Values] = [shapely.distance(shapely.points(a), shapely.LineString(b)) for a, b in pairs]
    return np.concatenate(away)


def evaluate(pieces: Sequence[CurvePiece], stations_m: Values) -> tuple[Points, Points]:
    """Return positions on the reference line and the unit normals to its left, (n, 2), as OpenDRIVE defines them."""
    starts = np.array([piece.station_m for piece in pieces])
    index = np.clip(np.searchsorted(starts, stations_m, side="right") - 1, 0, len(pieces) - 1)
    positions, normals = np.empty((len(stations_m), 2)), np.empty((len(stations_m), 2))
    for number in np.unique(index):
        piece, here = pieces[number], index == number
        p = (stations_m[here] - piece.station_m) / piece.length_m
        powers = np.column_stack([np.ones_like(p), p, p**2, p**3])
        slopes = np.column_stack([np.zeros_like(p), np.ones_like(p), 2 * p, 3 * p**2])
        turn = _rotation(piece.heading_rad)
        positions[here] = piece.start + np.column_stack([powers @ piece.u, powers @ piece.v]) @ turn.T
        along = np.column_stack([slopes @ piece.u, slopes @ piece.v]) @ turn.T
        along /= np.linalg.norm(along, axis=1)[:, None]
        normals[here] = np.column_stack([-along[:, 1], along[:, 0]])
    return positions, normals


def _rotation(heading_rad: float) -> Points:
    cosine, sine = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return np.array([[cosine, -sine], [sine, cosine]])


def _reference_line(left: Points, right: Points, turning: float) -> list[CurvePiece]:
    """Return cubic pieces through points in the middle of the outer bounds."""
    lengths = [arc_length(line) for line in (left, right)]
    middle_m = float(lengths[0][-1] + lengths[1][-1]) / 2
    count = max(FEWEST, round(middle_m / SPACING_M) + 1)
    shares = np.linspace(0.0, 1.0, count)
    one, other = (interpolate(line, at, shares * at[-1]) for line, at in zip((left, right), lengths, strict=True))
    points = (one + other) / 2
    tangents = np.gradient(points, axis=0)
    shares = shares * middle_m
    kept = np.ones(count, dtype=np.bool_)
    for end in (0, -1):
        across = one[end] - other[end]
        ahead, width = np.array([across[1], -across[0]]), float(np.linalg.norm(across))
        if width <= _ENDS_M or (skew := float(unit(ahead) @ unit(tangents[end]))) <= np.cos(STEEPEST_RAD):
            continue
        tangents[end] = ahead
        turned_m = min(turning * float(np.arccos(min(skew, 1.0))) * width, middle_m / 2)
        kept &= (np.abs(shares - shares[end]) >= turned_m) | (shares == shares[end])
    directions = (tangents / np.maximum(np.linalg.norm(tangents, axis=1), 1e-9)[:, None])[kept]
    points = points[kept]
    pieces: list[CurvePiece] = []
    station = 0.0
    for start, end, out, into in zip(points[:-1], points[1:], directions[:-1], directions[1:], strict=True):
        piece = _piece(station, start, end, out, into)
        pieces.append(piece)
        station += piece.length_m
    return pieces


def _piece(station_m: float, start: Points, end: Points, out: Points, into: Points) -> CurvePiece:
    """Return the cubic between two points with the given directions at them; numbers as written to the file."""
    heading = float(np.round(np.arctan2(out[1], out[0]), 9))
    turn = _rotation(-heading)
    chord = turn @ (end - start)
    reach = max(float(np.linalg.norm(chord)), 1e-3)
    first, last = turn @ out * reach, turn @ into * reach
    polynomials = [
        _rounded([0.0, a, 3 * end - 2 * a - b, a + b - 2 * end]) for a, b, end in zip(first, last, chord, strict=True)
    ]
    p = np.linspace(0.0, 1.0, 65)
    speed = np.hypot(*(sum(k * c * p ** (k - 1) for k, c in enumerate(line) if k) for line in polynomials))
    length = float(np.round(np.trapezoid(speed, p), 9))
    return CurvePiece(round(station_m, 9), np.round(start, 9), heading, length, *polynomials)


def _rounded(values: Sequence[float]) -> Values:
    """Return the values rounded to 1e-9, without a minus sign before 0."""
    return np.round(np.array(values), 9) + 0.0


def _sampled(pieces: Sequence[CurvePiece], spacing_m: float) -> tuple[Values, Points, Points]:
    total = pieces[-1].station_m + pieces[-1].length_m
    stations = np.linspace(0.0, total, max(round(total / spacing_m), 8) + 1)
    return (stations, *evaluate(pieces, stations))


def _tried(pieces: Sequence[CurvePiece]) -> list[float]:
    """Return points on the reference line; they are closer together in its first and last pieces."""
    total = pieces[-1].station_m + pieces[-1].length_m
    ends = pieces[0].length_m, pieces[-1].station_m
    parts = ((0.0, ends[0], TRIED_AT_ENDS_M), (*ends, TRIED_M), (ends[1], total, TRIED_AT_ENDS_M))
    return [
        float(at)
        for first, last, step in parts
        for at in np.linspace(first, last, max(round((last - first) / step), 1) + 1)
    ]


def _feet(line: Points, stations: Values, positions: Points, normals: Points, reach_m: float) -> list[float]:
    """Return, for each vertex of a line, the nearest station with a normal through the vertex."""
    feet = []
    along = np.column_stack([normals[:, 1], -normals[:, 0]])
    for vertex in line:
        ahead = np.einsum("ij,ij->i", vertex - positions, along)
        lateral = np.abs(np.einsum("ij,ij->i", vertex - positions, normals))
        crossed = np.flatnonzero((ahead[:-1] >= 0) & (ahead[1:] < 0) & (lateral[:-1] <= reach_m))
        if len(crossed):
            at = crossed[np.argmin(lateral[crossed])]
            share = ahead[at] / (ahead[at] - ahead[at + 1])
            feet.append(float(stations[at] + share * (stations[at + 1] - stations[at])))
    return feet


def _cut(line: Points, at: Points, across: Points, reach_m: float) -> Values:
    """Return how far to the left each normal crosses a line, at the nearest crossing; interpolate if it misses the
    line.
    """
    start, step = line[:-1], np.diff(line, axis=0)
    found = np.full(len(at), np.nan)
    for number, (origin, normal) in enumerate(zip(at, across, strict=True)):
        cross = normal[0] * step[:, 1] - normal[1] * step[:, 0]
        between = start - origin
        with np.errstate(divide="ignore", invalid="ignore"):
            lateral = (between[:, 0] * step[:, 1] - between[:, 1] * step[:, 0]) / cross
            share = (between[:, 0] * normal[1] - between[:, 1] * normal[0]) / cross
        hits = (np.abs(cross) > 1e-12) & (share >= -1e-9) & (share <= 1 + 1e-9) & (np.abs(lateral) <= reach_m)
        if hits.any():
            candidates = lateral[hits]
            found[number] = candidates[np.argmin(np.abs(candidates))]
    for end, vertex in ((0, line[0]), (-1, line[-1])):  # a strip's end is the normal at its station, or nearly so
        ahead = abs(float((vertex - at[end]) @ [across[end][1], -across[end][0]]))
        if np.isnan(found[end]) or ahead <= LEVEL_M:  # a bound may cross the normal of its own end once more
            found[end] = float((vertex - at[end]) @ across[end])
    known = np.flatnonzero(~np.isnan(found))
    whole: Values = np.interp(np.arange(len(found)), known, found[known])
    return whole


def _needed(stations: Values, offsets: Points) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Return a mask of the stations that linear interpolation needs to yield every offset (Douglas and Peucker)."""
    kept = np.zeros(len(stations), dtype=np.bool_)
    kept[[0, -1]] = True
    waiting = [(0, len(stations) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = ((stations[inner] - stations[first]) / (stations[last] - stations[first]))[:, None]
        straight = offsets[first] + share * (offsets[last] - offsets[first])
        off = np.abs(offsets[inner] - straight).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] > FLAT_M:
            middle = first + 1 + worst
            kept[middle] = True
            waiting += [(first, middle), (middle, last)]
    return kept
