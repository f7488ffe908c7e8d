"""Lanelets as OpenDRIVE 1.7 (ASAM): a road for the lanelets side by side, all of its lanes to the right.

Every road runs one way, along its reference line. Where a lane forks or merges, the roads that begin or end there are
connecting roads of a junction. The same lanelets give the same bytes. Each lane names its lanelet in ``userData``.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ....schemas.artifacts import ForeignExport, ForeignExportRequest
from ....schemas.errors import NotPossible
from ....schemas.text import counted, one_line
from ...commonroad import read_scenario
from ...execution import ProgressReporter
from ...geometry import Points, Values
from ...network import posted_speeds
from .cross_sections import Strip, evaluate, strip_of
from .reading_back import geometry_error

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
    from commonroad.scenario.scenario import Scenario

SAME_M = 0.02
"""Neighbours whose common bound differs by more, or that do not begin and end level by it, are roads of their own."""
TYPES = {"sidewalk": "sidewalk", "crosswalk": "sidewalk", "bicycleLane": "biking", "busLane": "bus", "border": "border"}
TYPES |= {"shoulder": "shoulder", "accessRamp": "onRamp", "exitRamp": "offRamp", "parking": "parking"}
"""OpenDRIVE's type of a lane for the types of a lanelet; otherwise driving."""
ROAD_TYPES = {"interstate": "motorway", "highway": "motorway", "country": "rural", "urban": "town"}
_WORD = re.compile(r"\+(\w+)(?:=([^\s+]\S*))?")
_MARKS = {"solid": "solid", "broad_solid": "solid", "dashed": "broken", "broad_dashed": "broken"}


def write_opendrive(request: ForeignExportRequest, report: ProgressReporter) -> ForeignExport:
    """Write the lanelets of a scenario as OpenDRIVE.

    Raises:
        UnsafeInput: the scenario's file is broken.
        NotPossible: it holds no lanelet with an area.
    """
    report(0.1, "reading the scenario")
    loaded = read_scenario(Path(request.scenario_path))
    report(0.3, "drawing the roads")
    root, lost = opendrive_of(loaded.scenario, loaded.benchmark_id)
    etree.indent(root, space=" ")
    text = etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
    Path(request.target_path).write_bytes(text)
    report(0.8, "reading the roads back")
    geometry = geometry_error(text, loaded.scenario.lanelet_network)
    return ForeignExport(path=request.target_path, lost=lost, geometry=geometry)


def opendrive_of(scenario: "Scenario", name: str) -> tuple[etree._Element, tuple[str, ...]]:
    """The document for the network of a scenario, and what it does not hold, in words.

    Raises:
        NotPossible: no lanelet has an area.
    """
    network = scenario.lanelet_network
    plan = RoadPlan.of(network)
    if not plan.roads:
        raise NotPossible("no lanelet of this scenario has an area", next_step="use a scenario with roads")
    root = etree.Element("OpenDRIVE")
    header = _add(
        root, "header", revMajor="1", revMinor="7", name=one_line(name), version="1.00", vendor="PlannerForge"
    )
    projection = _projection(scenario)
    if projection:
        header.append(_reference(projection))
    limits = posted_speeds(network)
    lanelets = {int(lanelet.lanelet_id): lanelet for lanelet in network.lanelets}
    for key in plan.bridges:  # before the roads: whoever looks a lanelet up finds the road that is drawn last
        _write_bridge(root, key, plan, lanelets)
    for key in plan.roads:
        _write_road(root, key, plan, lanelets, limits)
    for junction, members in plan.junctions.items():
        _write_junction(root, junction, members, plan)
    lost = _lost(network, plan, len(getattr(scenario, "footways", ())))
    return root, lost if projection or not _is_located(scenario) else (*lost, "the geo-reference")


def _is_located(scenario: "Scenario") -> bool:
    change = None if scenario.location is None else scenario.location.geo_transformation
    return change is not None and bool(change.geo_reference)


def _projection(scenario: "Scenario") -> str:
    """The PROJ string of the file, where its coordinates are the projected ones."""
    change = None if scenario.location is None else scenario.location.geo_transformation
    said = "" if change is None or not change.geo_reference else str(change.geo_reference).strip()
    if change is None or not said.startswith("+proj=") or not said.isprintable():
        return ""
    shift = float(change.x_translation or 0.0), float(change.y_translation or 0.0), float(change.z_rotation or 0.0)
    if shift[2] or (change.scaling or 1.0) != 1.0:
        return ""
    if not any(shift):
        return said
    return _shifted(said, shift[0], shift[1])


def _shifted(projection: str, x_m: float, y_m: float) -> str:
    """A PROJ string whose coordinates are so much larger, by its false easting and northing; empty if not in metres."""
    words = dict(_WORD.findall(projection))
    if words.get("units", "m") != "m" or "to_meter" in words:
        return ""
    if words["proj"] == "utm":  # its false easting cannot be named: the same as a transverse Mercator
        south = "south" in words
        zone = int(words.pop("zone", "0") or 0)
        words = {key: value for key, value in words.items() if key not in ("proj", "south")}
        words = {"proj": "tmerc", "lat_0": "0", "lon_0": str(6 * zone - 183), "k": "0.9996", **words}
        words |= {"x_0": "500000", "y_0": "10000000" if south else "0"}
    for key, shift_m in (("x_0", x_m), ("y_0", y_m)):
        words[key] = f"{float(words.get(key, '0')) + shift_m:.6f}"
    return " ".join(f"+{key}={value}" if value else f"+{key}" for key, value in words.items())


def _reference(projection: str) -> etree._Element:
    element = etree.Element("geoReference")
    element.text = etree.CDATA(projection)
    return element


@dataclass(frozen=True)
class RoadPlan:
    """Which lanelets are which lanes of which road, and how the roads hang together.

    ``roads``: road → lanelets from left to right, its id is that of the first; ``strips``: their shapes; ``following``:
    lanelet → those that follow it, drawn ones only; ``left_out``: lanelets without an area.
    """

    roads: dict[int, tuple[int, ...]]
    strips: dict[int, Strip]
    following: dict[int, tuple[int, ...]]
    left_out: tuple[int, ...] = field(default=())

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "RoadPlan":
        """Plan the roads of a network; depends on the network alone."""
        lanelets = {int(lanelet.lanelet_id): lanelet for lanelet in network.lanelets}
        roads: dict[int, tuple[int, ...]] = {}
        strips: dict[int, Strip] = {}
        left_out: list[int] = []
        for group in _groups(lanelets):
            for keys in (group, *([(key,) for key in group] if len(group) > 1 else [])):
                if keys != group and group[0] in strips and roads.get(group[0]) == group:
                    break
                try:
                    strips[keys[0]] = strip_of(_bounds([lanelets[key] for key in keys]))
                    roads[keys[0]] = keys
                except ValueError:
                    left_out += keys if len(keys) == 1 else ()
        drawn = {key for keys in roads.values() for key in keys}
        pairs = {(key, int(after)) for key in drawn for after in lanelets[key].successor}
        pairs |= {(int(before), key) for key in drawn for before in lanelets[key].predecessor}
        following: dict[int, list[int]] = {key: [] for key in sorted(drawn)}
        for key, after in sorted(pairs):
            if key in drawn and after in drawn and key != after:
                following[key].append(after)
        return cls(roads, strips, {key: tuple(after) for key, after in following.items()}, tuple(sorted(left_out)))

    @cached_property
    def place(self) -> dict[int, tuple[int, int]]:
        """Lanelet → its road and the id of its lane there (-1 on the left)."""
        return {key: (road, -1 - index) for road, keys in self.roads.items() for index, key in enumerate(keys)}

    @cached_property
    def after(self) -> dict[int, tuple[int, ...]]:
        """Road → the roads that follow any of its lanes."""
        return {
            road: tuple(sorted({self.place[after][0] for key in keys for after in self.following[key]}))
            for road, keys in self.roads.items()
        }

    @cached_property
    def before(self) -> dict[int, tuple[int, ...]]:
        """Road → the roads that lead into any of its lanes."""
        leading: dict[int, list[int]] = {road: [] for road in self.roads}
        for road, following in self.after.items():
            for other in following:
                leading[other].append(road)
        return {road: tuple(others) for road, others in leading.items()}

    @cached_property
    def junctions(self) -> dict[int, tuple[int, ...]]:
        """Junction → its connecting roads: those behind a fork and before a merge that touch one another's ends."""
        joined: dict[int, set[int]] = {}
        bundles = [following for following in self.after.values() if len(following) > 1]
        bundles += [leading for leading in self.before.values() if len(leading) > 1]
        for bundle in bundles:
            members = set(bundle).union(*(joined.get(road, ()) for road in bundle))
            for road in members:
                joined[road] = members
        sets = {frozenset(members) for members in joined.values()}
        entered = [members for members in sets if any(self.before[road] for road in members)]
        first = max((*self.roads, *self.following), default=0) + 1
        return {first + number: tuple(sorted(one)) for number, one in enumerate(sorted(entered, key=min))}

    @cached_property
    def bridges(self) -> dict[int, int]:
        """Connecting road → id of a common road of hardly any length behind it, if other connecting roads follow.

        A connecting road must not lead into a junction (ASAM's rule ``connect_road_no_incoming_road``).
        """
        leading = [
            road for road in sorted(self.junction_of) if any(one in self.junction_of for one in self.after[road])
        ]
        first = max((*self.roads, *self.following, *self.junctions), default=0) + 1
        return {road: first + number for number, road in enumerate(leading)}

    @cached_property
    def junction_of(self) -> dict[int, int]:
        """Connecting road → its junction."""
        return {road: junction for junction, members in self.junctions.items() for road in members}


def _groups(lanelets: "Mapping[int, Lanelet]") -> list[tuple[int, ...]]:
    """Lanelets side by side, from left to right, that share their bounds and begin and end level."""
    rights: dict[int, int] = {}
    for key, lanelet in lanelets.items():
        other = lanelet.adj_right if lanelet.adj_right_same_direction else None
        if other is not None and other in lanelets and other != key and _share_a_bound(lanelet, lanelets[other]):
            rights[key] = int(other)
    lefts = {right: left for left, right in rights.items()}
    groups, taken = [], set[int]()
    for key in sorted(lanelets):
        first, seen = key, {key}
        while first in lefts and rights[lefts[first]] == first and lefts[first] not in seen:
            first = lefts[first]
            seen.add(first)
        if first in taken:
            continue
        group = [first]
        while group[-1] in rights and lefts[rights[group[-1]]] == group[-1] and rights[group[-1]] not in group:
            group.append(rights[group[-1]])
        group = [one for one in group if one not in taken]
        taken |= set(group)
        groups.append(tuple(group))
    return groups


def _share_a_bound(left: "Lanelet", right: "Lanelet") -> bool:
    one, other = np.asarray(left.right_vertices)[:, :2], np.asarray(right.left_vertices)[:, :2]
    if len(one) != len(other) or float(np.abs(one - other).max()) > SAME_M:
        return False
    outer_left, outer_right = np.asarray(left.left_vertices)[:, :2], np.asarray(right.right_vertices)[:, :2]
    return all(_in_line(outer_left[end], one[end], outer_right[end]) for end in (0, -1))


def _in_line(first: Points, middle: Points, last: Points) -> bool:
    """Whether the middle lies within SAME_M of the straight from the first to the last."""
    step, to_middle = last - first, middle - first
    length = float(np.linalg.norm(step))
    return length > SAME_M and abs(float(step[0] * to_middle[1] - step[1] * to_middle[0])) / length <= SAME_M


def _bounds(lanelets: "Sequence[Lanelet]") -> list[Points]:
    lines = [lanelets[0].left_vertices, *(lanelet.right_vertices for lanelet in lanelets)]
    return [np.asarray(line, dtype=float)[:, :2] for line in lines]


def _write_road(
    root: etree._Element, key: int, plan: RoadPlan, lanelets: "Mapping[int, Lanelet]", limits: Mapping[int, float]
) -> None:
    strip, keys = plan.strips[key], plan.roads[key]
    last = strip.pieces[-1]
    junction = plan.junction_of.get(key, -1)
    road = _add(
        root, "road", id=str(key), length=_number(last.station_m + last.length_m), junction=str(junction), rule="RHT"
    )
    links = _add(road, "link")
    for tag, others in (("predecessor", plan.before[key]), ("successor", plan.after[key])):
        _write_link(links, tag, key, others, plan)
    if (kind := _road_type(lanelets[key])) != "":
        _add(road, "type", s="0", type=kind)
    view = _add(road, "planView")
    for piece in strip.pieces:
        start = {"x": _number(piece.start[0]), "y": _number(piece.start[1]), "hdg": _number(piece.heading_rad)}
        geometry = _add(view, "geometry", s=_number(piece.station_m), **start, length=_number(piece.length_m))
        polynomials = {
            f"{part}{axis}": f"{value:.12g}"
            for axis in "UV"
            for part, value in zip("abcd", piece.u if axis == "U" else piece.v, strict=True)
        }
        _add(geometry, "paramPoly3", **polynomials, pRange="normalized")
    lanes = _add(road, "lanes")
    for station, offset, slope in _straights(strip.stations_m, strip.offsets_m[:, 0]):
        _add(lanes, "laneOffset", s=_number(station), a=_number(offset), b=_number(slope), c="0", d="0")
    section = _add(lanes, "laneSection", s="0")
    center = _add(_add(section, "center"), "lane", id="0", type="none", level="false")
    _add(center, "roadMark", sOffset="0", color="standard", type=_mark(lanelets[keys[0]], "left"))
    right = _add(section, "right")
    for index, lanelet_id in enumerate(keys):
        widths = strip.offsets_m[:, index] - strip.offsets_m[:, index + 1]
        _write_lane(right, lanelet_id, lanelets[lanelet_id], (strip.stations_m, widths), plan, limits)


def _write_link(links: etree._Element, tag: str, road: int, others: tuple[int, ...], plan: RoadPlan) -> None:
    """A road's link to the only road there, or to the junction whose connecting roads are there."""
    if not others:
        return
    if tag == "successor" and road in plan.bridges:
        _add(links, tag, elementType="road", elementId=str(plan.bridges[road]), contactPoint="start")
        return
    if tag == "predecessor" and len(others) == 1 and others[0] in plan.bridges:
        _add(links, tag, elementType="road", elementId=str(plan.bridges[others[0]]), contactPoint="end")
        return
    contact = "end" if tag == "predecessor" else "start"
    mine = plan.junction_of.get(road)
    if len(others) == 1 and (plan.junction_of.get(others[0]) in (None, mine) or mine is not None):
        _add(links, tag, elementType="road", elementId=str(others[0]), contactPoint=contact)
        return
    junction = next((plan.junction_of[other] for other in others if other in plan.junction_of), None)
    if junction is not None and junction != mine:
        _add(links, tag, elementType="junction", elementId=str(junction))
    elif mine is not None:
        _add(links, tag, elementType="road", elementId=str(others[0]), contactPoint=contact)


BRIDGE_M = 0.001
"""Length of the road between two connecting roads (chosen): as near as files with three digits tell points apart."""


def _write_bridge(root: etree._Element, key: int, plan: RoadPlan, lanelets: "Mapping[int, Lanelet]") -> None:
    """A common road behind a connecting one, with its lanes as they end."""
    strip, keys = plan.strips[key], plan.roads[key]
    last = strip.pieces[-1]
    end, normal = (values[0] for values in evaluate(strip.pieces, np.array([last.station_m + last.length_m])))
    number, length = plan.bridges[key], _number(BRIDGE_M)
    road = _add(root, "road", id=str(number), length=length, junction="-1", rule="RHT")
    links = _add(road, "link")
    _add(links, "predecessor", elementType="junction", elementId=str(plan.junction_of[key]))
    _add(links, "successor", elementType="junction", elementId=str(plan.junction_of[_connecting(plan, key)]))
    view = _add(road, "planView")
    heading = _number(float(np.arctan2(-normal[0], normal[1])))
    place = {"x": _number(end[0]), "y": _number(end[1]), "hdg": heading}
    straight = dict.fromkeys(("aU", "cU", "dU", "aV", "bV", "cV", "dV"), "0") | {"bU": length, "pRange": "normalized"}
    _add(_add(view, "geometry", s=_number(0.0), **place, length=length), "paramPoly3", **straight)
    lanes = _add(road, "lanes")
    offsets = strip.offsets_m[-1]
    _add(lanes, "laneOffset", s=_number(0.0), a=_number(offsets[0]), b="0", c="0", d="0")
    section = _add(lanes, "laneSection", s="0")
    center = _add(_add(section, "center"), "lane", id="0", type="none", level="false")
    _add(center, "roadMark", sOffset="0", color="standard", type="none")
    right = _add(section, "right")
    for index, lanelet_id in enumerate(keys):
        lane = _add(right, "lane", id=str(-1 - index), type=_lane_type(lanelets[lanelet_id]), level="false")
        _add(lane, "link")
        width = _number(offsets[index] - offsets[index + 1])
        _add(lane, "width", sOffset=_number(0.0), a=width, b="0", c="0", d="0")
        _add(lane, "userData", code="lanelet", value=str(lanelet_id))


def _connecting(plan: RoadPlan, key: int) -> int:
    """The first connecting road behind a road."""
    return next(one for one in plan.after[key] if one in plan.junction_of)


def _write_lane(
    parent: etree._Element,
    key: int,
    lanelet: "Lanelet",
    profile: tuple[Values, Values],
    plan: RoadPlan,
    limits: Mapping[int, float],
) -> None:
    road, number = plan.place[key]
    lane = _add(parent, "lane", id=str(number), type=_lane_type(lanelet), level="false")
    links = _add(lane, "link")
    leading = [one for one, after in plan.following.items() if key in after]
    for tag, others, roads in (
        ("predecessor", leading, plan.before[road]),
        ("successor", plan.following[key], plan.after[road]),
    ):
        if tag == "successor" and road in plan.bridges:
            _add(links, tag, id=str(number))  # the lanes of the road behind it are the same
        elif len(roads) == 1 and len(others) == 1:
            _add(links, tag, id=str(plan.place[others[0]][1]))
    for station, width, slope in _straights(*profile):
        _add(lane, "width", sOffset=_number(station), a=_number(width), b=_number(slope), c="0", d="0")
    _add(lane, "roadMark", sOffset="0", color="standard", type=_mark(lanelet, "right"))
    if key in limits:
        _add(lane, "speed", sOffset="0", max=f"{limits[key]:.4f}", unit="m/s")
    _add(lane, "userData", code="lanelet", value=str(key))


def _straights(stations: Values, values: Values) -> Iterable[tuple[float, float, float]]:
    """Yield start, value there and slope of the straights between places; one that goes on as before is no other."""
    slopes = np.diff(values) / np.diff(stations)
    written: list[tuple[float, float, float]] = []
    for station, value, slope in zip(stations[:-1].tolist(), values[:-1].tolist(), slopes.tolist(), strict=True):
        if written:
            before, beginning, steepness = written[-1]
            goes_on = abs(beginning + steepness * (station - before) - value) < _SAME_WIDTH_M
            if goes_on and abs(steepness - slope) < _SAME_SLOPE:
                continue
        written.append((station, value, slope))
    return written


_SAME_WIDTH_M, _SAME_SLOPE = 1e-5, 1e-6
"""Straights that differ by less are one: 10 µm, and 1 mm after 1 km."""


def _write_junction(root: etree._Element, junction: int, members: tuple[int, ...], plan: RoadPlan) -> None:
    element = _add(root, "junction", id=str(junction), name=f"junction {junction}")
    number = 0
    for road in members:
        for incoming in plan.before[road]:
            pairs = [
                (plan.place[key][1], plan.place[after][1])
                for key in plan.roads[incoming]
                for after in plan.following[key]
                if plan.place[after][0] == road
            ]
            entry = plan.bridges.get(incoming, incoming)
            ends = {"incomingRoad": str(entry), "connectingRoad": str(road), "contactPoint": "start"}
            connection = _add(element, "connection", id=str(number), **ends)
            number += 1
            for start, end in pairs:
                _add(connection, "laneLink", **{"from": str(start), "to": str(end)})


def _lane_type(lanelet: "Lanelet") -> str:
    kinds = sorted(str(kind.value) for kind in lanelet.lanelet_type or ())
    return next((TYPES[kind] for kind in kinds if kind in TYPES), "driving")


def _road_type(lanelet: "Lanelet") -> str:
    kinds = sorted(str(kind.value) for kind in lanelet.lanelet_type or ())
    return next((ROAD_TYPES[kind] for kind in kinds if kind in ROAD_TYPES), "")


def _mark(lanelet: "Lanelet", side: str) -> str:
    marking = lanelet.line_marking_left_vertices if side == "left" else lanelet.line_marking_right_vertices
    return _MARKS.get(str(marking.value), "none")


def _lost(network: "LaneletNetwork", plan: RoadPlan, footways: int) -> tuple[str, ...]:
    counts = (
        (len(network.traffic_lights), "traffic light", ""),
        (len(network.traffic_signs), "traffic sign", " (speed limits are kept at the lanes)"),
        (len(plan.left_out), "lanelet", " without an area"),
        (footways, "footway", " (pavements and crossings)"),
    )
    return tuple(f"{counted(count, what)}{words}" for count, what, words in counts if count)


def _number(value: float) -> str:
    return f"{float(value):.9f}"


def _add(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
    return etree.SubElement(parent, tag, attributes)
