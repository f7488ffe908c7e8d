"""Rewrites an OpenDRIVE document so that netconvert can read it, with the same roads and the same routes over them.

netconvert reads OpenDRIVE 1.4. It does not support namespaces, centre lanes without a type, arcs of curvature 0,
signals without a type, direct junctions, or left-hand traffic. Each of these is valid in some version of the standard
(ASAM OpenDRIVE 1.8: 9.4 arcs, 11.7 lanes, 10.3 traffic direction, 12.3 direct junctions). Each is therefore rewritten
as an equivalent that netconvert can read.
"""

import math
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from lxml import etree

from ....schemas.errors import UnsafeInput
from ....schemas.text import cited, shown_name

LEFT, RIGHT = "LHT", "RHT"
LONGEST_SECTION_M = 2_000.0
"""Longer lane sections are cut: at netconvert's resolution of 1 m, a lane then has 2,000 of 5,000 allowed points."""
_STRAIGHT_PER_M = 1e-8
"""An arc with less curvature is a line: after 1 km, it deviates by 5 mm."""
_SAME_PER_M = 1e-7
"""A spiral with a smaller change of curvature is an arc: after 1 km, it deviates by about 1 cm."""
_SHORTEST_PIECE_M = 1e-6
"""A shorter piece of a reference line has no direction in files with six decimals."""
_JOINT_M = 0.1
"""Length of the roads that replace the connections of a direct junction; netconvert needs a length above 0."""
_STEPS = 200
"""Number of steps of the integration along a piece of a reference line."""


def without_namespaces(root: etree._Element) -> None:
    """Replace the elements' names with their local names, in place."""
    for element in root.iter(etree.Element):
        element.tag = etree.QName(element).localname
    etree.cleanup_namespaces(root)


def traffic_rule(name: str, root: etree._Element) -> str:
    """Return the file's driving side (``LHT`` or ``RHT``); a road without a rule takes the rule of the other roads.

    Raises:
        UnsafeInput: some roads have left-hand and some right-hand traffic, or a rule is unknown.
    """
    rules = {rule for road in root.iterfind("road") if (rule := road.get("rule")) is not None}
    if unknown := rules - {LEFT, RIGHT}:
        raise UnsafeInput(f"{name} has a road with the traffic rule {cited(min(unknown))}", valid=[RIGHT, LEFT])
    if len(rules) > 1:
        raise UnsafeInput(
            f"{name} has roads with traffic on the left (rule LHT) and on the right (RHT); a network has one side",
            next_step="split the file where the side changes, and import the parts",
        )
    return rules.pop() if rules else RIGHT


def repair(name: str, root: etree._Element) -> None:
    """Rewrite what netconvert cannot read, in place; do not change the traffic rule.

    Raises:
        UnsafeInput: a direct junction refers to a road or lane that does not exist.
    """
    for lane in root.iter("lane"):
        if not lane.get("type"):
            lane.set("type", "none")
    for signal in root.iter("signal"):
        if not signal.get("type"):
            signal.set("type", "-1")  # the standard's value for an unknown type
    for geometry in list(root.iter("geometry")):
        _simplify(geometry)
    for view in root.iter("planView"):
        pieces = view.findall("geometry")
        for piece in pieces[1:]:
            if _value(piece, "length") < _SHORTEST_PIECE_M:
                view.remove(piece)
    for junction in root.iterfind("junction"):
        if junction.get("type") == "direct":
            _connect_directly(name, root, junction)
    for road in root.iterfind("road"):
        _cut_long_sections(road)


def _simplify(geometry: etree._Element) -> None:
    """Write a spiral with constant curvature as an arc, and an arc without curvature as a line.

    netconvert divides by the curvature and by its change, so a spiral of almost constant curvature exhausts the memory.
    """
    spiral = geometry.find("spiral")
    if spiral is not None:
        first, last = _value(spiral, "curvStart"), _value(spiral, "curvEnd")
        if abs(last - first) < _SAME_PER_M:
            geometry.replace(spiral, etree.Element("arc", {"curvature": repr((first + last) / 2)}))
    arc = geometry.find("arc")
    if arc is not None and abs(_value(arc, "curvature")) < _STRAIGHT_PER_M:
        geometry.replace(arc, etree.Element("line"))


def mirror(root: etree._Element, middle_m: float) -> None:
    """Mirror all roads at the line y = ``middle_m``, in place, so that left-hand traffic becomes right-hand traffic.

    Lanes swap sides and the sign of their ids, and everything that turns left turns right.
    """
    for road in root.iterfind("road"):
        road.set("rule", RIGHT)
    for piece in root.iter("geometry"):
        piece.set("y", repr(2 * middle_m - _value(piece, "y")))
        piece.set("hdg", repr(-_value(piece, "hdg")))
    for tag, keys in _MIRRORED.items():
        for element in root.iter(tag):
            for key in keys:
                if element.get(key) is not None:
                    element.set(key, repr(-_value(element, key)))
    for section in root.iter("laneSection"):
        for side in section.iterfind("left"):
            side.tag = "other"
        for side in section.iterfind("right"):
            side.tag = "left"
        for side in section.iterfind("other"):
            side.tag = "right"
        section[:] = sorted(section, key=lambda side: _SIDES.get(str(side.tag), 3))
        for lane in section.iter("lane"):
            _negate(lane, "id")
            for link in lane.iterfind("link/*"):
                _negate(link, "id")
        for side in section:
            side[:] = sorted(side, key=lambda lane: -int(lane.get("id", "0")))
    for link in root.iter("laneLink"):
        _negate(link, "from")
        _negate(link, "to")


_SIDES = {"left": 0, "center": 1, "right": 2}
_MIRRORED = {
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": ("a", "b", "c", "d"),
    "paramPoly3": ("aV", "bV", "cV", "dV"),
    "laneOffset": ("a", "b", "c", "d"),
    "superelevation": ("a", "b", "c", "d"),
    "signal": ("t",),
    "object": ("t",),
}
"""Values that are positive to the left of a reference line, or for left turns."""


def _negate(element: etree._Element, key: str) -> None:
    if (text := element.get(key)) is not None:
        element.set(key, str(-int(text)))


def _value(element: etree._Element, key: str) -> float:
    return float(element.get(key) or 0.0)


@dataclass(frozen=True)
class _End:
    """The start or end of a reference line: position in m, and heading in rad along the line."""

    x: float
    y: float
    heading_rad: float


def end_of(road: etree._Element, *, at_start: bool) -> _End:
    """Return the first or last point of a road's reference line, by the formulas of ASAM OpenDRIVE (9: geometry)."""
    pieces = road.findall("planView/geometry")
    piece = pieces[0 if at_start else -1]
    x, y, heading, length = (_value(piece, key) for key in ("x", "y", "hdg", "length"))
    if at_start:
        return _End(x, y, heading)
    u, v, turn = _along(piece, length)
    cosine, sine = math.cos(heading), math.sin(heading)
    return _End(x + u * cosine - v * sine, y + u * sine + v * cosine, heading + turn)


def _along(piece: etree._Element, length_m: float) -> tuple[float, float, float]:
    """Return how far ahead and to the left a piece of a reference line ends, and its turn, in m and rad."""
    if (poly := piece.find("paramPoly3")) is not None:
        p = length_m if poly.get("pRange") == "arcLength" else 1.0
        (u, du), (v, dv) = (_cubic([_value(poly, k + axis) for k in "abcd"], p) for axis in "UV")
        return u, v, math.atan2(dv, du)
    if (poly := piece.find("poly3")) is not None:
        v, dv = _cubic([_value(poly, k) for k in "abcd"], length_m)
        return length_m, v, math.atan(dv)
    arc, spiral = piece.find("arc"), piece.find("spiral")
    first = last = 0.0 if arc is None else _value(arc, "curvature")
    if spiral is not None:
        first, last = _value(spiral, "curvStart"), _value(spiral, "curvEnd")
    s = np.linspace(0.0, length_m, _STEPS + 1)
    headings = first * s + (last - first) * s * s / (2 * max(length_m, _SHORTEST_PIECE_M))
    u, v = (float(np.trapezoid(wave, s)) for wave in (np.cos(headings), np.sin(headings)))
    return u, v, float(headings[-1])


def _cubic(row: list[float], at: float) -> tuple[float, float]:
    a, b, c, d = row
    return a + at * (b + at * (c + at * d)), b + at * (2 * c + 3 * at * d)


def _connect_directly(name: str, root: etree._Element, junction: etree._Element) -> None:
    """Rewrite a direct junction as a common junction: each of its links becomes a very short connecting road."""
    roads = {road.get("id", ""): road for road in root.iterfind("road")}
    key = junction.get("id", "")
    junction.attrib.pop("type")
    for number, connection in enumerate(list(junction.iterfind("connection"))):
        ids = connection.get("incomingRoad", ""), connection.get("linkedRoad", "")
        contact = connection.get("contactPoint", "")
        if not set(ids) <= roads.keys() or contact not in ("start", "end"):
            raise UnsafeInput(
                f"{name}: connection {shown_name(connection.get('id'))} of the direct junction {shown_name(key)} has "
                "a road or an end that does not exist",
                next_step="correct the file's direct junction",
            )
        junction.remove(connection)
        incoming = _Arm(ids[0], roads[ids[0]], at_start=_attached_at_start(roads[ids[0]], key))
        linked = _Arm(ids[1], roads[ids[1]], at_start=contact == "start")
        links = [(int(one.get("from", "0")), int(one.get("to", "0"))) for one in connection.iterfind("laneLink")]
        inward = [link for link in links if incoming.leads_in(link[0])]
        outward = [(there, here) for here, there in links if not incoming.leads_in(here)]
        for way, (before, after, pairs) in enumerate(((incoming, linked, inward), (linked, incoming, outward))):
            if pairs:
                road_id = _free_id(roads)
                roads[road_id] = road = _joint(road_id, key, before, after, pairs)
                root.insert(list(root).index(junction), road)
                junction.append(_connection(f"{number}.{way}", before.key, road_id, pairs))


@dataclass(frozen=True)
class _Arm:
    """A road at a direct junction, and which of its ends is at the junction; for right-hand traffic."""

    key: str
    road: etree._Element
    at_start: bool

    def leads_in(self, lane: int) -> bool:
        """Return whether a lane leads into the junction: right lanes lead to a road's end, left lanes to its start."""
        return (lane > 0) == self.at_start

    def width_m(self, lane: int) -> float:
        """Return the approximate width of a lane at the junction: the first width of its section."""
        section = self.road.findall("lanes/laneSection")[0 if self.at_start else -1]
        found = next((one for one in section.iter("lane") if one.get("id") == str(lane)), None)
        width = None if found is None else found.find("width")
        return 3.5 if width is None else max(_value(width, "a"), 0.5)


def _attached_at_start(road: etree._Element, junction: str) -> bool:
    link = road.find("link/predecessor")
    return link is not None and link.get("elementType") == "junction" and link.get("elementId") == junction


def _free_id(roads: dict[str, etree._Element]) -> str:
    numbers = [int(key) for key in roads if key.isdecimal()]
    return str(max(numbers, default=0) + 1)


def _joint(key: str, junction: str, before: _Arm, after: _Arm, pairs: list[tuple[int, int]]) -> etree._Element:
    """Return a connecting road from one arm to another; ``pairs`` lists the lanes that it connects."""
    end = end_of(before.road, at_start=before.at_start)
    heading = end.heading_rad + (math.pi if before.at_start else 0.0)
    road = etree.Element("road", {"name": "", "length": repr(_JOINT_M), "id": key, "junction": junction})
    links = etree.SubElement(road, "link")
    for tag, arm in (("predecessor", before), ("successor", after)):
        contact = "start" if arm.at_start else "end"
        etree.SubElement(links, tag, {"elementType": "road", "elementId": arm.key, "contactPoint": contact})
    view = etree.SubElement(road, "planView")
    place = {"s": "0", "x": repr(end.x), "y": repr(end.y), "hdg": repr(heading), "length": repr(_JOINT_M)}
    etree.SubElement(etree.SubElement(view, "geometry", place), "line")
    section = etree.SubElement(etree.SubElement(road, "lanes"), "laneSection", {"s": "0"})
    center = etree.SubElement(section, "center")
    etree.SubElement(center, "lane", {"id": "0", "type": "none", "level": "false"})
    right = etree.SubElement(section, "right")
    for number, (start, goal) in enumerate(pairs, start=1):
        lane = etree.SubElement(right, "lane", {"id": str(-number), "type": "driving", "level": "false"})
        link = etree.SubElement(lane, "link")
        etree.SubElement(link, "predecessor", {"id": str(start)})
        etree.SubElement(link, "successor", {"id": str(goal)})
        width = {"sOffset": "0", "a": repr(before.width_m(start)), "b": "0", "c": "0", "d": "0"}
        etree.SubElement(lane, "width", width)
    return road


def _connection(key: str, incoming: str, road: str, pairs: list[tuple[int, int]]) -> etree._Element:
    names = {"id": key, "incomingRoad": incoming, "connectingRoad": road, "contactPoint": "start"}
    connection = etree.Element("connection", names)
    for number, (start, _) in enumerate(pairs, start=1):
        etree.SubElement(connection, "laneLink", {"from": str(start), "to": str(-number)})
    return connection


def _cut_long_sections(road: etree._Element) -> None:
    """Cut lane sections that are too long for one lanelet into equal parts; each lane continues in the next part."""
    lanes, length_m = road.find("lanes"), _value(road, "length")
    if lanes is None or length_m <= LONGEST_SECTION_M:
        return
    sections = lanes.findall("laneSection")
    starts = [_value(section, "s") for section in sections]
    for section, start, end in zip(sections, starts, [*starts[1:], length_m], strict=True):
        count = math.ceil((end - start) / LONGEST_SECTION_M)
        if count < 2:
            continue
        step = (end - start) / count
        place = list(lanes).index(section)
        lanes.remove(section)
        for number in range(count):
            part = deepcopy(section)
            part.set("s", repr(start + number * step))
            for lane in part.iter("lane"):
                _shift(lane, number * step)
                _follow_itself(lane, before=number > 0, behind=number + 1 < count)
            lanes.insert(place + number, part)


def _shift(lane: etree._Element, by_m: float) -> None:
    """Shift a lane's tables, which begin with the section, to a later start."""
    for tag in ("width", "border", "speed", "access", "roadMark", "material", "rule", "height"):
        rows = lane.findall(tag)
        current = [row for row in rows if _value(row, "sOffset") <= by_m]
        for row in current[:-1]:
            lane.remove(row)
        for row in rows[max(len(current) - 1, 0) :]:
            ahead = by_m - _value(row, "sOffset")
            row.set("sOffset", repr(max(-ahead, 0.0)))
            if tag in ("width", "border") and ahead > 0:
                a, b, c, d = (_value(row, key) for key in "abcd")
                value, slope = _cubic([a, b, c, d], ahead)
                for key, number in zip("abcd", (value, slope, c + 3 * d * ahead, d), strict=True):
                    row.set(key, repr(number))


def _follow_itself(lane: etree._Element, *, before: bool, behind: bool) -> None:
    link = lane.find("link")
    if link is None:
        link = etree.Element("link")
        lane.insert(0, link)
    for tag, cut in (("predecessor", before), ("successor", behind)):
        if cut and lane.get("id") != "0":
            for old in link.findall(tag):
                link.remove(old)
            etree.SubElement(link, tag, {"id": lane.get("id", "0")})
    link[:] = sorted(link, key=lambda one: str(one.tag))


def y_range(root: etree._Element) -> Iterator[float]:
    """Return the y of every piece of a reference line, in m."""
    return (_value(piece, "y") for piece in root.iter("geometry"))
