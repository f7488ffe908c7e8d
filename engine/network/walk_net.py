"""Reads the footways of a SUMO net: pavements along roads, the corners where they meet, and crossings.

netconvert adds a pavement to a road as its outermost lane, joins pavements at a junction with *walking areas*
(corners), and leads *crossings* from corner to corner. The model of vehicles and lanelets leaves them out
(:mod:`net_parser`). This module reads them, draws them as separate lanelets, and gives them right of way.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ..geometry import Points, Values, arc_length, interpolate
from .lane_bounds import offset, repaired, stations_along
from .net_parser import shape_of
from .road_network import Walkway

if TYPE_CHECKING:
    from shapely import Polygon

_SHORTEST_M = 0.5
"""A shorter pavement has no room for a pedestrian (chosen)."""


@dataclass(frozen=True)
class Pavement:
    """A pavement in the direction of its road: centre line (n, 2), width in m, and the corners at its ends, if any.

    ``length_m``: SUMO's length.
    """

    edge_id: str
    line: Points
    length_m: float
    width_m: float
    begins_at: str | None
    ends_at: str | None


@dataclass(frozen=True)
class Crossing:
    """A crossing from one corner to another: centre line (n, 2) and width in m.

    ``over``: edges of the roads that it crosses; ``lit``: whether it has lights.
    """

    edge_id: str
    line: Points
    width_m: float
    corners: tuple[str, str]
    over: frozenset[str]
    lit: bool


@dataclass(frozen=True)
class WalkNet:
    """Footways: pavements, crossings, and the outlines (n, 2) of corners, each by edge.

    ``open_ends``: corners at the end of a road; pedestrians who walk around that end do so on the road.
    """

    pavements: Mapping[str, Pavement]
    crossings: Mapping[str, Crossing]
    corners: Mapping[str, Points]
    open_ends: frozenset[str]

    def pavements_at(self, corner: str) -> list[Pavement]:
        """Return the pavements that end or begin at a corner."""
        return [one for one in self.pavements.values() if corner in (one.begins_at, one.ends_at)]

    @property
    def pavement_km(self) -> float:
        """The total length of all pavements in km."""
        return sum(one.length_m for one in self.pavements.values()) / 1000


def read_walk_net(net_path: Path) -> WalkNet:
    """Read the pavements, corners and crossings of a net that :func:`read_net` reads."""
    root = etree.parse(net_path).getroot()
    by_function: dict[str, list[etree._Element]] = {}
    for edge in root.iterfind("edge"):
        by_function.setdefault(edge.get("function", "normal"), []).append(edge)
    outlines = {str(edge.get("id")): shape_of(edge[0]) for edge in by_function.get("walkingarea", ())}
    corners = {key: outline for key, outline in outlines.items() if len(outline) >= 3}
    crossing_ids = {str(edge.get("id")) for edge in by_function.get("crossing", ())}
    begins, ends, lit = _links(root, corners, crossing_ids)
    pavements = {
        key: Pavement(
            key, shape_of(lane), float(lane.get("length", "0")), _width_m(lane), begins.get(key), ends.get(key)
        )
        for edge in by_function.get("normal", ())
        for key in [str(edge.get("id"))]
        for lane in edge.iterfind("lane")
        if lane.get("allow") == "pedestrian" and float(lane.get("length", "0")) > _SHORTEST_M
    }
    crossings = {
        key: Crossing(
            key,
            shape_of(edge[0]),
            _width_m(edge[0]),
            (ends[key], begins[key]),
            frozenset(edge.get("crossingEdges", "").split()),
            key in lit,
        )
        for edge in by_function.get("crossing", ())
        for key in [str(edge.get("id"))]
        if key in begins and key in ends and len(shape_of(edge[0])) >= 2
    }
    dead = {str(node.get("id")) for node in root.iterfind("junction") if node.get("type") == "dead_end"}
    open_ends = frozenset(key for key in corners if key.removeprefix(":").rpartition("_")[0] in dead)
    return WalkNet(pavements, crossings, corners, open_ends)


def _links(
    root: etree._Element, corners: Mapping[str, Points], crossings: set[str]
) -> tuple[dict[str, str], dict[str, str], set[str]]:
    """Return the start and end corners of pavements and crossings, and the crossings with lights.

    netconvert writes connections from a corner to a crossing and on to the next corner, and for a pavement those from
    and to its two ends. Along the road, a pavement leads from the corner that connects *to* it.
    """
    begins: dict[str, str] = {}
    ends: dict[str, str] = {}
    lit: set[str] = set()
    for link in root.iterfind("connection"):
        start, end = link.get("from", ""), link.get("to", "")
        if start in corners:
            (ends if end in crossings else begins)[end] = start
        if end in corners:
            (begins if start in crossings else ends)[start] = end
        if link.get("tl") is not None and end in crossings:
            lit.add(end)
    return begins, ends, lit


def _width_m(lane: etree._Element) -> float:
    return float(lane.get("width", "2.0"))


def yield_at_crossings(net_path: Path) -> int:
    """Give pedestrians right of way at crossings without lights, in place; return the number of these crossings.

    netconvert gives vehicles priority at the crossings that it guesses. In the net's right-of-way matrix, each row
    states the links that its own link gives way to; columns are counted from the right.
    """
    root = etree.parse(net_path).getroot()
    crossings = {f"{edge.get('id')}_0" for edge in root.iterfind("edge[@function='crossing']")}
    changed: set[str] = set()
    for junction in root.iterfind("junction"):
        rows = sorted(junction.iterfind("request"), key=lambda row: int(row.get("index", "0")))
        lanes = junction.get("intLanes", "").split()
        if junction.get("type") == "traffic_light" or not crossings & set(lanes):
            continue
        for index in _crossing_rows(lanes, rows, crossings):
            rows[index].set("response", "0" * len(rows))
            changed |= {lanes[index]}
            for other, row in enumerate(rows):
                if other != index and _bit(row.get("foes", ""), index):
                    row.set("response", _with_bit(row.get("response", ""), index))
    for link in root.iterfind("connection"):
        if f"{link.get('to')}_0" in changed:
            link.set("state", "M")
    net_path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return len(changed)


def _crossing_rows(lanes: list[str], rows: list[etree._Element], crossings: set[str]) -> list[int]:
    """Return the rows of a junction's matrix that belong to crossings; empty if rows and lanes do not match."""
    return [index for index, lane in enumerate(lanes) if lane in crossings] if len(lanes) == len(rows) else []


def _bit(bits: str, index: int) -> bool:
    return index < len(bits) and bits[-1 - index] == "1"


def _with_bit(bits: str, index: int) -> str:
    place = len(bits) - 1 - index
    return bits if place < 0 else f"{bits[:place]}1{bits[place + 1 :]}"


def draw_walkways(net: WalkNet, first_id: int) -> tuple[Walkway, ...]:
    """Return pavements and crossings as lanelets along their lines, corners as lanelets along their longer axis."""
    drawn: list[Walkway] = []

    def add(edge_id: str, *, crosses: bool, bounds: tuple[Points, Points] | None) -> None:
        if bounds is not None:
            drawn.append(Walkway(first_id + len(drawn), edge_id, crosses, *bounds))

    for pavement in net.pavements.values():
        add(pavement.edge_id, crosses=False, bounds=_strip(pavement.line, pavement.width_m))
    for crossing in net.crossings.values():
        add(crossing.edge_id, crosses=True, bounds=_strip(crossing.line, crossing.width_m))
    for key, outline in net.corners.items():
        add(key, crosses=False, bounds=_area_bounds(outline))
    return tuple(drawn)


def _strip(line: Points, width_m: float) -> tuple[Points, Points] | None:
    stations = stations_along(line)
    center = interpolate(line, arc_length(line), stations)
    return repaired(center, offset(center, width_m / 2), offset(center, -width_m / 2))


_NEAREST_M = 0.02
"""Of two points of a bound closer together than this, one is left out (chosen)."""
_LEAST_AREA_M2 = 0.05
"""A smaller corner is dropped (chosen)."""


def _area_bounds(outline: Points) -> tuple[Points, Points] | None:
    """Split the outline of an area into a left and a right bound with the same number of points.

    The bounds begin and end at the two sides of the outline that are farthest apart and do not meet.
    """
    from shapely import Polygon, make_valid
    from shapely.geometry.polygon import orient

    parts = [part for part in _polygons(make_valid(Polygon(outline))) if part.area > _LEAST_AREA_M2]
    if not parts:
        return None
    ring = np.array(orient(max(parts, key=lambda part: part.area)).exterior.coords)[:-1]
    if len(ring) < 4:
        ring = np.concatenate([np.stack([point, (point + after) / 2]) for point, after in _pairs(ring)])
    count = len(ring)
    middles = np.array([(point + after) / 2 for point, after in _pairs(ring)])
    first, last = max(
        (
            (one, other)
            for one in range(count)
            for other in range(one + 2, count)
            if (other + 1) % count != one  # sides that meet at a corner would make a bound of one point
        ),
        key=lambda pair: (round(float(np.linalg.norm(middles[pair[0]] - middles[pair[1]])), 3), -pair[0], -pair[1]),
    )
    right = ring[first + 1 : last + 1]
    left = np.concatenate([ring[last + 1 :], ring[: first + 1]])[::-1]
    shares = np.unique(np.concatenate([_shares(left), _shares(right)]).round(6))
    near = _NEAREST_M / min(arc_length(left)[-1], arc_length(right)[-1])
    kept = np.concatenate([[True], np.diff(shares[:-1]) > near, [True]])
    shares = shares[kept]
    return _at(left, shares), _at(right, shares)


def _polygons(shape: object) -> Iterable["Polygon"]:
    from shapely import Polygon, get_parts

    return [part for part in get_parts(shape) if isinstance(part, Polygon)]


def _pairs(ring: Points) -> Iterable[tuple[Points, Points]]:
    return zip(ring, np.roll(ring, -1, axis=0), strict=True)


def _shares(line: Points) -> Values:
    stations = arc_length(line)
    return np.asarray(stations / stations[-1])


def _at(line: Points, shares: Values) -> Points:
    stations = arc_length(line)
    return interpolate(line, stations, shares * stations[-1])
