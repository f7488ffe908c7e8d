"""Lanelets as OpenDRIVE 1.7 (ASAM): adjacent lanelets form a road, with all its lanes on the right.

Every road runs one way, along its reference line; ``road_plan`` joins roads. The same lanelets always give the same
bytes. Each lane states its lanelet in ``userData``; lanes of bridges and connectors state the lanelet next to them.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ....schemas.artifacts import ForeignExport, ForeignExportRequest
from ....schemas.errors import NotPossible
from ....schemas.text import counted, one_line
from ...commonroad import read_scenario
from ...execution import ProgressReporter
from ...geometry import Values
from ...network import posted_speeds
from .cross_sections import evaluate
from .reading_back import geometry_error
from .road_plan import RoadPlan

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
    from commonroad.scenario.scenario import Scenario

TYPES = {"sidewalk": "sidewalk", "crosswalk": "sidewalk", "bicycleLane": "biking", "busLane": "bus", "border": "border"}
TYPES |= {"shoulder": "shoulder", "accessRamp": "onRamp", "exitRamp": "offRamp", "parking": "parking"}
"""OpenDRIVE's lane type for the types of a lanelet; the default is driving."""
ROAD_TYPES = {"interstate": "motorway", "highway": "motorway", "country": "rural", "urban": "town"}
_WORD = re.compile(r"\+(\w+)(?:=([^\s+]\S*))?")
_MARKS = {"solid": "solid", "broad_solid": "solid", "dashed": "broken", "broad_dashed": "broken"}


def write_opendrive(request: ForeignExportRequest, report: ProgressReporter) -> ForeignExport:
    """Write the lanelets of a scenario as OpenDRIVE.

    Raises:
        UnsafeInput: the scenario's file is broken.
        NotPossible: it contains no lanelet with an area.
    """
    report(0.1, "reading the scenario")
    loaded = read_scenario(Path(request.scenario_path))
    report(0.3, "drawing the roads")
    root, lost = opendrive_of(loaded.scenario, loaded.benchmark_id)
    if loaded.friction is not None:
        _state_friction(root, loaded.friction)
    etree.indent(root, space=" ")
    text = etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
    Path(request.target_path).write_bytes(text)
    report(0.8, "reading the roads back")
    geometry = geometry_error(text, loaded.scenario.lanelet_network)
    return ForeignExport(path=request.target_path, lost=lost, geometry=geometry)


def opendrive_of(scenario: "Scenario", name: str) -> tuple[etree._Element, tuple[str, ...]]:
    """Return the document for the network of a scenario, and a list of what it lacks.

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
    # Short roads come first: a reader that looks up a lanelet finds the road that is drawn last.
    for key in plan.bridges_behind:
        _write_bridge(root, key, plan, lanelets, is_behind=True)
    for key in plan.bridges_before:
        _write_bridge(root, key, plan, lanelets, is_behind=False)
    for number, (start, goal) in plan.connectors.items():
        _write_connector(root, number, (start, goal), plan, lanelets)
    for key in plan.roads:
        _write_road(root, key, plan, lanelets, limits)
    for junction in plan.junctions:
        _write_junction(root, junction, plan)
    lost = _lost(network, plan, len(getattr(scenario, "footways", ())))
    return root, lost if projection or not _is_located(scenario) else (*lost, "the geo-reference")


def _state_friction(root: etree._Element, friction: float) -> None:
    """Write the friction of the roads into every lane with an area, after its marks as the schema requires."""
    for lane in root.iterfind("road/lanes/laneSection/right/lane"):
        material = etree.Element("material", {"sOffset": "0", "friction": f"{friction:.6g}"})
        (lane.findall("roadMark") or lane.findall("width"))[-1].addnext(material)


def _is_located(scenario: "Scenario") -> bool:
    change = None if scenario.location is None else scenario.location.geo_transformation
    return change is not None and bool(change.geo_reference)


def _projection(scenario: "Scenario") -> str:
    """Return the PROJ string of the file's coordinates; empty if they are not projected, or rotated or scaled."""
    change = None if scenario.location is None else scenario.location.geo_transformation
    stated = "" if change is None or not change.geo_reference else str(change.geo_reference).strip()
    if change is None or not stated.startswith("+proj=") or not stated.isprintable():
        return ""
    shift = float(change.x_translation or 0.0), float(change.y_translation or 0.0), float(change.z_rotation or 0.0)
    if shift[2] or (change.scaling or 1.0) != 1.0:
        return ""
    if not any(shift):
        return stated
    return _shifted(stated, shift[0], shift[1])


def _shifted(projection: str, x_m: float, y_m: float) -> str:
    """Return a PROJ string with shifted coordinates (false easting and northing); empty if it is not in metres."""
    words = dict(_WORD.findall(projection))
    if words.get("units", "m") != "m" or "to_meter" in words:
        return ""
    if words["proj"] == "utm":  # its false easting cannot be set: use the same as a transverse Mercator
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
    _write_links(links, key, plan)
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


def _write_links(links: etree._Element, road: int, plan: RoadPlan) -> None:
    """Link a road to the roads or junctions at its ends."""
    for tag, other, contact, junction in (
        ("predecessor", plan.road_before(road), "end", plan.junction_before(road)),
        ("successor", plan.road_behind(road), "start", plan.junction_behind(road)),
    ):
        if other is not None:
            _add(links, tag, elementType="road", elementId=str(other), contactPoint=contact)
        elif junction is not None:
            _add(links, tag, elementType="junction", elementId=str(junction))


BRIDGE_M = 0.001
"""Length of bridges and connectors (chosen): the resolution of files with three decimals."""


def _write_bridge(
    root: etree._Element, key: int, plan: RoadPlan, lanelets: "Mapping[int, Lanelet]", *, is_behind: bool
) -> None:
    """Write a common road after or before a connecting road, with that road's lanes as they end or start."""
    number = plan.bridges_behind[key] if is_behind else plan.bridges_before[key]
    before = plan.junction_of[key] if is_behind else plan.junction_before(key)
    behind = plan.junction_behind(key) if is_behind else plan.junction_of[key]
    road = _write_short_road(root, number, -1, (key, is_behind), plan)
    links = road[0]
    _add(links, "predecessor", elementType="junction", elementId=str(before))
    _add(links, "successor", elementType="junction", elementId=str(behind))
    for index in range(len(plan.roads[key])):
        _write_short_lane(road, key, index, plan, lanelets, is_behind=is_behind)


def _write_connector(
    root: etree._Element, number: int, pair: tuple[int, int], plan: RoadPlan, lanelets: "Mapping[int, Lanelet]"
) -> None:
    """Write a connecting road between two lanes where several roads end and others start."""
    (start, lane_before), (goal, lane_behind) = (plan.place[key] for key in pair)
    road = _write_short_road(root, number, plan.junction_at[plan.end_joint[start]], (start, True), plan)
    links = road[0]
    exit_, entry = str(plan.exit_of(start)), str(plan.entry_of(goal))
    _add(links, "predecessor", elementType="road", elementId=exit_, contactPoint="end")
    _add(links, "successor", elementType="road", elementId=entry, contactPoint="start")
    index = -1 - lane_before
    lane = _write_short_lane(road, start, index, plan, lanelets, is_behind=True)
    _add(lane[0], "predecessor", id=str(lane_before))
    _add(lane[0], "successor", id=str(lane_behind))
    offset = _number(plan.strips[start].offsets_m[-1, index])
    road.find("lanes/laneOffset").set("a", offset)  # type: ignore[union-attr]  # it was written there


def _write_short_road(
    root: etree._Element, number: int, junction: int, place: tuple[int, bool], plan: RoadPlan
) -> etree._Element:
    """Write a straight road without lanes, as long as a bridge, at the end or the start of a road; return it."""
    key, is_behind = place
    strip = plan.strips[key]
    last = strip.pieces[-1]
    at = last.station_m + last.length_m if is_behind else 0.0
    end, normal = (values[0] for values in evaluate(strip.pieces, np.array([at])))
    length = _number(BRIDGE_M)
    road = _add(root, "road", id=str(number), length=length, junction=str(junction), rule="RHT")
    _add(road, "link")
    view = _add(road, "planView")
    where = {"x": _number(end[0]), "y": _number(end[1]), "hdg": _number(float(np.arctan2(-normal[0], normal[1])))}
    straight = dict.fromkeys(("aU", "cU", "dU", "aV", "bV", "cV", "dV"), "0") | {"bU": length, "pRange": "normalized"}
    _add(_add(view, "geometry", s=_number(0.0), **where, length=length), "paramPoly3", **straight)
    lanes = _add(road, "lanes")
    offset = _number(strip.offsets_m[-1 if is_behind else 0, 0])
    _add(lanes, "laneOffset", s=_number(0.0), a=offset, b="0", c="0", d="0")
    section = _add(lanes, "laneSection", s="0")
    center = _add(_add(section, "center"), "lane", id="0", type="none", level="false")
    _add(center, "roadMark", sOffset="0", color="standard", type="none")
    _add(section, "right")
    return road


def _write_short_lane(
    road: etree._Element, key: int, index: int, plan: RoadPlan, lanelets: "Mapping[int, Lanelet]", *, is_behind: bool
) -> etree._Element:
    """Write the next lane of a short road, as wide as a lane of another road at its end or start; return it."""
    right: etree._Element = road.find("lanes/laneSection/right")  # type: ignore[assignment]  # it was written there
    kind = _lane_type(lanelets[plan.roads[key][index]])
    lane = _add(right, "lane", id=str(-1 - len(right)), type=kind, level="false")
    _add(lane, "link")
    offsets = plan.strips[key].offsets_m[-1 if is_behind else 0]
    width = _number(offsets[index] - offsets[index + 1])
    _add(lane, "width", sOffset=_number(0.0), a=width, b="0", c="0", d="0")
    _add(lane, "userData", code="lanelet", value=str(plan.roads[key][index]))
    return lane


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
    for tag, others, bridges, other_road in (
        ("predecessor", plan.leading[key], plan.bridges_before, plan.road_before(road)),
        ("successor", plan.following[key], plan.bridges_behind, plan.road_behind(road)),
    ):
        if road in bridges:
            _add(links, tag, id=str(number))  # the lanes of the bridge are the same
        elif other_road is not None:
            for other in others:
                _add(links, tag, id=str(plan.place[other][1]))
    for station, width, slope in _straights(*profile):
        _add(lane, "width", sOffset=_number(station), a=_number(width), b=_number(slope), c="0", d="0")
    _add(lane, "roadMark", sOffset="0", color="standard", type=_mark(lanelet, "right"))
    if key in limits:
        _add(lane, "speed", sOffset="0", max=f"{limits[key]:.4f}", unit="m/s")
    _add(lane, "userData", code="lanelet", value=str(key))


def _straights(stations: Values, values: Values) -> Iterable[tuple[float, float, float]]:
    """Return start, value and slope of the line segments between stations; collinear segments are merged."""
    slopes = np.diff(values) / np.diff(stations)
    written: list[tuple[float, float, float]] = []
    for station, value, slope in zip(stations[:-1].tolist(), values[:-1].tolist(), slopes.tolist(), strict=True):
        if written:
            before, beginning, steepness = written[-1]
            goes_on = abs(beginning + steepness * (station - before) - value) < _SAME_WIDTH_M + _SAME_SLOPE * station
            if goes_on and abs(steepness - slope) < _SAME_SLOPE:
                continue
        written.append((station, value, slope))
    return written


_SAME_WIDTH_M, _SAME_SLOPE = 1e-5, 1e-6
"""Straights that differ by less are merged: 10 µm, and 1 mm after 1 km."""


def _write_junction(root: etree._Element, junction: int, plan: RoadPlan) -> None:
    element = _add(root, "junction", id=str(junction), name=f"junction {junction}")
    for road in sorted(plan.connecting):
        if plan.junction_of[road] != junction:
            continue
        pairs = [(key, key) for key in plan.roads[road]]
        if road not in plan.bridges_before:
            pairs = [(before, key) for key, _ in pairs for before in plan.leading[key]]
        lanes = [(plan.place[before][1], plan.place[key][1]) for before, key in pairs]
        _write_connection(element, str(plan.road_before(road)), road, lanes)
    for number, (start, _) in plan.connectors.items():
        end, lane = plan.place[start]
        if plan.junction_at[plan.end_joint[end]] == junction:
            _write_connection(element, str(plan.exit_of(end)), number, [(lane, -1)])


def _write_connection(element: etree._Element, incoming: str, road: int, pairs: Sequence[tuple[int, int]]) -> None:
    ends = {"incomingRoad": incoming, "connectingRoad": str(road), "contactPoint": "start"}
    connection = _add(element, "connection", id=str(len(element)), **ends)
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
        (len(network.traffic_signs), "traffic sign", " (speed limits are kept on the lanes)"),
        (len(plan.left_out), "lanelet", " without an area"),
        (len(plan.apart), "link", " between lanelets that do not meet"),
        (footways, "footway", " (pavements and crossings)"),
    )
    return tuple(f"{counted(count, what)}{words}" for count, what, words in counts if count)


def _number(value: float) -> str:
    return f"{float(value):.9f}"


def _add(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
    return etree.SubElement(parent, tag, attributes)
