"""Read an OpenDRIVE file back as other tools do, and measure how far its bounds are from those of the lanelets.

No code of the writer is used: the text of the file is parsed and evaluated by the formulas of ASAM OpenDRIVE 1.7 (7:
reference line, 11.4: lane offset, 11.6: widths).
"""

from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ....schemas.artifacts import SAME_BOUND_M, RoadGeometry
from ...geometry import Points, Values

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

EVERY_M = 0.5
"""Spacing of the places examined on a bound in the file, in addition to those where its formula changes (chosen)."""


def geometry_error(text: bytes, network: "LaneletNetwork") -> RoadGeometry:
    """Return the deviations between the lanelets' bounds and those of the file, measured from both sides.

    Points of a bound that is missing from the file count as too far away.
    """
    drawn = _bounds(etree.fromstring(text))
    near, count, farthest_m = 0, 0, 0.0
    for lanelet in network.lanelets:
        for side, given in enumerate((lanelet.left_vertices, lanelet.right_vertices)):
            line = np.asarray(given, dtype=float)[:, :2]
            if (pair := drawn.get(int(lanelet.lanelet_id))) is None:
                count += len(line)
                continue
            away = np.concatenate([_distances(line, pair[side]), _distances(pair[side], line)])
            near, count = near + int((away <= SAME_BOUND_M).sum()), count + len(away)
            farthest_m = max(farthest_m, float(away.max()))
    return RoadGeometry(points=count, within_share=near / max(count, 1), max_m=round(farthest_m, 4))


def _distances(points: Points, line: Points) -> Values:
    import shapely

    away: Values = shapely.distance(shapely.points(points), shapely.LineString(line))
    return away


def _bounds(root: etree._Element) -> dict[int, tuple[Points, Points]]:
    """Return each lanelet's left and right bounds in the file, at stations where a formula changes and between."""
    found: dict[int, tuple[Points, Points]] = {}
    for road in root.iterfind("road"):
        lanes = sorted(road.iterfind("lanes/laneSection/right/lane"), key=lambda lane: -int(lane.get("id", "0")))
        shifts = _table(road, "lanes/laneOffset", "s")
        widths = [_table(lane, "width", "sOffset") for lane in lanes]
        length = float(road.get("length", "0"))
        even = np.linspace(0.0, length, max(round(length / EVERY_M), 2) + 1)
        at = np.unique(np.concatenate([even, shifts[:, 0], *(rows[:, 0] for rows in widths)]))
        at = at[at <= length]
        middle, normals = _reference_line(road, at)
        lateral = _cubic(shifts, at)
        lines = [middle + normals * lateral[:, None]]
        for rows in widths:
            lateral = lateral - _cubic(rows, at)
            lines.append(middle + normals * lateral[:, None])
        for lane, left, right in zip(lanes, lines[:-1], lines[1:], strict=True):
            found[int(lane.findall("userData")[0].get("value", "0"))] = left, right
    return found


def _table(element: etree._Element, path: str, station: str) -> Points:
    """Return the rows of a piecewise cubic, each with its start and its coefficients a, b, c, d."""
    return np.array([[float(row.get(key, "0")) for key in (station, *"abcd")] for row in element.iterfind(path)])


def _rows_at(starts: Values, at: Values) -> "np.ndarray[tuple[int], np.dtype[np.intp]]":
    return np.clip(np.searchsorted(starts, at + 1e-9, side="right") - 1, 0, len(starts) - 1)


def _cubic(rows: Points, at: Values) -> Values:
    row = rows[_rows_at(rows[:, 0], at)]
    along = at - row[:, 0]
    value: Values = row[:, 1] + along * (row[:, 2] + along * (row[:, 3] + along * row[:, 4]))
    return value


def _reference_line(road: etree._Element, at: Values) -> tuple[Points, Points]:
    """Return positions on the reference line, and unit normals to its left."""
    pieces = road.findall("planView/geometry")
    places = np.array([[float(piece.get(key, "0")) for key in ("s", "x", "y", "hdg", "length")] for piece in pieces])
    cubics = np.array(
        [[[float(curve.get(part + axis, "0")) for part in "abcd"] for axis in "UV"] for curve in _curves(pieces)]
    )
    row = _rows_at(places[:, 0], at)
    start, x, y, heading, length = places[row].T
    p = (at - start) / length
    u, v = np.einsum("nac,nc->an", cubics[row], np.stack([p**0, p, p**2, p**3], axis=1))
    du, dv = np.einsum("nac,nc->an", cubics[row], np.stack([0 * p, p**0, 2 * p, 3 * p**2], axis=1))
    cosine, sine = np.cos(heading), np.sin(heading)
    turned = heading + np.arctan2(dv, du)
    positions = np.stack([x + u * cosine - v * sine, y + u * sine + v * cosine], axis=1)
    return positions, np.stack([-np.sin(turned), np.cos(turned)], axis=1)


def _curves(pieces: list[etree._Element]) -> list[etree._Element]:
    return [curve for piece in pieces for curve in piece.iterfind("paramPoly3")]
