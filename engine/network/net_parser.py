"""Reads SUMO's .net.xml into plain values: lanes, edges, connections, signal programs, and the succession of lanes.

Pedestrian crossings, walking areas and connectors are left out. Coordinates are the net's, in metres. A net with
invalid or implausible numbers is rejected here.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np
from lxml import etree

from ...schemas.errors import UnsafeInput
from ...schemas.text import cited, one_line, shown_name
from ..commonroad import XmlLimits, scan_xml
from ..geometry import Points, length_m, without_repeats

_MOTOR = """
passenger private taxi bus coach delivery truck trailer motorcycle moped evehicle emergency authority army vip hov
custom1 custom2
"""
_OTHER = """
bicycle pedestrian tram rail_urban rail rail_electric rail_fast ship container cable_car subway aircraft wheelchair
scooter drone
"""
MOTOR_CLASSES = frozenset(_MOTOR.split())
"""SUMO's classes of motor vehicles on roads."""
_ALL_CLASSES = MOTOR_CLASSES | frozenset(_OTHER.split())
ROAD_CLASSES = MOTOR_CLASSES | {"bicycle"}
_DEFAULT_LANE_WIDTH_M, _DEFAULT_SPEED_MPS = 3.2, 13.89
"""SUMO's default if the net has none."""

_FARTHEST_M = 1e8
"""Chosen: coordinates of a projection reach 2e7 m, with an offset twice as much."""
_FASTEST_MPS, _WIDEST_M, _LONGEST_PHASE_S = 500.0, 100.0, 1e6
"""Chosen: no lane is faster or wider, and no phase of a light longer."""
_LONGEST_ID = 2_000
"""Maximum length of an id in characters; chosen: netconvert concatenates the ids of junctions that it joins."""
_LARGEST_NET_BYTES = 200_000_000
"""Chosen: nets have more text than their maps."""


@dataclass(frozen=True)
class NetLane:
    """A lane: centre line of shape (n, 2) in metres, speed limit, width and the SUMO classes that may use it."""

    lane_id: str
    edge_id: str
    index: int
    speed_mps: float
    width_m: float
    allowed: frozenset[str]
    shape: Points
    internal: bool


@dataclass(frozen=True)
class NetEdge:
    """A road in one direction between two junctions, or the inside of a junction (``internal``)."""

    edge_id: str
    from_junction: str
    to_junction: str
    internal: bool
    road_type: str
    name: str
    lane_ids: tuple[str, ...]


@dataclass(frozen=True)
class Connection:
    """A connection from lane to lane across a junction, along the internal lane ``via``.

    ``direction`` is SUMO's letter; ``link`` is the connection's index in the states of the traffic light ``signal``.
    """

    from_edge: str
    to_edge: str
    from_lane: str
    to_lane: str
    via: str | None
    direction: str
    signal: str | None
    link: int


@dataclass(frozen=True)
class SignalProgram:
    """A traffic light's cycle: offset in s and phases as (duration in s, state letter of every link)."""

    signal_id: str
    offset_s: float
    phases: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class SumoNet:
    """A SUMO net; all mappings have the order of the file.

    ``offset_m``: the offset that netconvert added to the projected coordinates (``projection``, a PROJ string).
    """

    lanes: dict[str, NetLane]
    edges: dict[str, NetEdge]
    connections: tuple[Connection, ...]
    junction_types: dict[str, str]
    signals: dict[str, SignalProgram]
    roundabout_edges: tuple[tuple[str, ...], ...]
    projection: str
    offset_m: tuple[float, float]
    lefthand: bool

    def drivable_edges(self, sumo_class: str) -> frozenset[str]:
        """Return the ids of normal edges with at least one lane that the class may use."""
        return frozenset(
            lane.edge_id for lane in self.lanes.values() if not lane.internal and sumo_class in lane.allowed
        )


def read_net(path: Path) -> SumoNet:
    """Read a SUMO net; pedestrian crossings and walking areas are left out.

    Raises:
        UnsafeInput: the file is hostile, broken or not a SUMO net.
    """
    if scan_xml(path, XmlLimits(size_bytes=_LARGEST_NET_BYTES)).name != "net":
        raise UnsafeInput(f"{shown_name(path.name)} is not a SUMO net: its root element is not <net>")
    try:
        return _net(etree.parse(path).getroot())
    except (ValueError, ArithmeticError, etree.LxmlError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as a SUMO network: {cited(error)}") from error


def _net(root: etree._Element) -> SumoNet:
    edges, lanes = _edges_and_lanes(root)
    location = root.find("location")
    projection = "" if location is None else location.get("projParameter", "")
    offset = "0,0" if location is None else location.get("netOffset", "0,0")
    offset_x, offset_y = (_number(part, "netOffset", -_FARTHEST_M, _FARTHEST_M) for part in offset.split(","))
    return SumoNet(
        lanes=lanes,
        edges=edges,
        connections=tuple(_connection(c) for c in root.iterfind("connection") if _ends(c) <= edges.keys()),
        junction_types={j.get("id", ""): j.get("type", "") for j in root.iterfind("junction")},
        signals={t.get("id", ""): _signal(t) for t in root.iterfind("tlLogic")},
        roundabout_edges=tuple(tuple(r.get("edges", "").split()) for r in root.iterfind("roundabout")),
        projection="" if projection == "!" else projection,
        offset_m=(offset_x, offset_y),
        lefthand=root.get("lefthand", "") in ("true", "1"),
    )


def _edges_and_lanes(root: etree._Element) -> tuple[dict[str, NetEdge], dict[str, NetLane]]:
    edges: dict[str, NetEdge] = {}
    lanes: dict[str, NetLane] = {}
    for element in root.iterfind("edge"):
        function = element.get("function", "normal")
        if function in ("crossing", "walkingarea", "connector"):
            continue
        edge_id, internal = _id(element), function == "internal"
        own = [_lane(lane, edge_id, internal) for lane in element.iterfind("lane")]
        lanes.update({lane.lane_id: lane for lane in own})
        edges[edge_id] = NetEdge(
            edge_id=edge_id,
            from_junction=element.get("from", ""),
            to_junction=element.get("to", ""),
            internal=internal,
            road_type=element.get("type", ""),
            name=one_line(element.get("name", "")),
            lane_ids=tuple(lane.lane_id for lane in own),
        )
    return edges, lanes


def shape_of(lane: etree._Element) -> Points:
    """Return the centre line of a net's lane without repeated vertices, shape (n, 2), in metres.

    Raises:
        ValueError: a coordinate is not a number, or beyond the range of projections.
    """
    points = [[float(value) for value in point.split(",")[:2]] for point in lane.get("shape", "").split()]
    shape = np.array(points, dtype=float).reshape(-1, 2)
    if not bool(np.all(np.abs(shape) <= _FARTHEST_M)):
        raise ValueError(f"lane {_id(lane)} has a coordinate that is not a number or beyond {_FARTHEST_M:g} m")
    return without_repeats(shape)


def _lane(element: etree._Element, edge_id: str, internal: bool) -> NetLane:
    return NetLane(
        lane_id=_id(element),
        edge_id=edge_id,
        index=int(element.get("index", "0")),
        speed_mps=_number(element.get("speed", str(_DEFAULT_SPEED_MPS)), "speed", 0.0, _FASTEST_MPS),
        width_m=_number(element.get("width", str(_DEFAULT_LANE_WIDTH_M)), "width", 0.0, _WIDEST_M),
        allowed=_permissions(element.get("allow"), element.get("disallow")),
        shape=shape_of(element),
        internal=internal,
    )


def _id(element: etree._Element) -> str:
    text = element.get("id", "")
    if len(text) > _LONGEST_ID or not text.isprintable():
        raise ValueError(f"the id {cited(text)} of a {element.tag} is too long or not on one line")
    return text


def _number(text: str, name: str, least: float, most: float) -> float:
    value = float(text)
    if not least <= value <= most:
        raise ValueError(f"{name} is {cited(text)}; valid: {least:g} to {most:g}")
    return value


def _permissions(allow: str | None, disallow: str | None) -> frozenset[str]:
    if allow is not None:
        return _ALL_CLASSES if allow == "all" else frozenset(allow.split())
    if disallow is not None:
        return frozenset() if disallow == "all" else _ALL_CLASSES - frozenset(disallow.split())
    return _ALL_CLASSES


def _ends(connection: etree._Element) -> set[str]:
    return {connection.get("from", ""), connection.get("to", "")}


def _connection(element: etree._Element) -> Connection:
    source, target = element.get("from", ""), element.get("to", "")
    return Connection(
        from_edge=source,
        to_edge=target,
        from_lane=f"{source}_{element.get('fromLane', '0')}",
        to_lane=f"{target}_{element.get('toLane', '0')}",
        via=element.get("via"),
        direction=element.get("dir", "s"),
        signal=element.get("tl"),
        link=int(element.get("linkIndex", "-1")),
    )


def _signal(element: etree._Element) -> SignalProgram:
    durations = (
        (_number(p.get("duration", "0"), "duration", 0.0, _LONGEST_PHASE_S), p) for p in element.iterfind("phase")
    )
    offset_s = _number(element.get("offset", "0"), "offset", -_LONGEST_PHASE_S, _LONGEST_PHASE_S)
    return SignalProgram(_id(element), offset_s, tuple((duration, p.get("state", "")) for duration, p in durations))


_SHORTEST_LANE_M = 0.05
"""Chosen: a shorter lane has no direction."""
_TINY_JOINT_M = 1.0
"""Chosen: a shorter internal lane between exactly two lanes is left out, and the two are joined directly."""


@dataclass
class LaneGraph:
    """The lanes that vehicles may use, with their successors and predecessors (sorted ids)."""

    lanes: dict[str, NetLane]
    successors: dict[str, list[str]] = field(default_factory=dict)
    predecessors: dict[str, list[str]] = field(default_factory=dict)

    def link(self, before: str, after: str) -> None:
        """Make a lane follow another."""
        for linked, new in ((self.successors[before], after), (self.predecessors[after], before)):
            if new not in linked:
                linked.append(new)
                linked.sort()

    def contract(self, lane_id: str) -> None:
        """Remove a lane, and link the lanes before it to the lanes after it."""
        before, after = list(self.predecessors[lane_id]), list(self.successors[lane_id])
        self.drop([lane_id])
        for entry, following in product(before, after):
            if lane_id not in (entry, following):
                self.link(entry, following)

    def drop(self, lane_ids: Iterable[str]) -> None:
        """Remove lanes and their links."""
        for lane_id in lane_ids:
            for following in self.successors.pop(lane_id):
                self.predecessors[following].remove(lane_id)
            for previous in self.predecessors.pop(lane_id):
                self.successors[previous].remove(lane_id)
            del self.lanes[lane_id]


def connect(net: SumoNet) -> LaneGraph:
    """Return the graph of all lanes for road vehicles; internal lanes without a successor are left out.

    Lanes too short to be drawn are left out too, and their ends are linked directly: if two roads meet end to end, the
    lane inside the junction has no length.
    """
    lanes = {key: lane for key, lane in net.lanes.items() if lane.allowed & ROAD_CLASSES}
    graph = LaneGraph(lanes, {key: [] for key in lanes}, {key: [] for key in lanes})
    for connection in net.connections:
        after = connection.to_lane if connection.via is None else connection.via
        if connection.from_lane in lanes and after in lanes:
            graph.link(connection.from_lane, after)
    for key in [key for key, lane in lanes.items() if not _is_drawable(lane)]:
        graph.contract(key)
    while loose := [
        key
        for key, lane in graph.lanes.items()
        if lane.internal and not (graph.successors[key] and graph.predecessors[key])
    ]:
        graph.drop(loose)
    _join_over_tiny_lanes(graph)
    return graph


def lost_connections(net: SumoNet, graph: LaneGraph) -> tuple[Connection, ...]:
    """Return the connections between road lanes that a vehicle may drive in the net, but not in the graph.

    If a vehicle may use the lanes before, inside and after a junction, the graph must have a route across the junction
    too. If a road lane is too short to be drawn, the route continues to the next lane that is drawn.
    """
    via = {link.from_lane: link.via for link in net.connections if link.from_edge.startswith(":")}
    return tuple(link for link in net.connections if _is_drivable(link, net, via) and not _leads(link, net, graph))


def _is_drivable(link: Connection, net: SumoNet, via: Mapping[str, str | None]) -> bool:
    """Return whether a connection joins two roads via lanes that are long enough and open to some vehicle."""
    ends = [net.lanes.get(key) for key in (link.from_lane, link.to_lane)]
    if link.from_edge.startswith(":") or not all(lane is not None and _is_drawable(lane) for lane in ends):
        return False
    inside, key = [], link.via
    while key is not None and key not in inside:
        inside.append(key)
        key = via.get(key)
    parts = [*ends, *(net.lanes.get(key) for key in inside)]
    return bool(ROAD_CLASSES.intersection(*(lane.allowed for lane in parts if lane is not None)))


def _leads(link: Connection, net: SumoNet, graph: LaneGraph) -> bool:
    """Return whether the graph leads from a connection's first lane to its last only via lanes inside junctions."""
    waiting, seen = [link.from_lane], set[str]()
    while waiting:
        for key in graph.successors.get(waiting.pop(), ()):
            if key == link.to_lane:
                return True
            if key not in seen and net.lanes[key].internal:
                seen.add(key)
                waiting.append(key)
    return False


def _is_drawable(lane: NetLane) -> bool:
    return len(lane.shape) >= 2 and length_m(lane.shape) > _SHORTEST_LANE_M


def _join_over_tiny_lanes(graph: LaneGraph) -> None:
    for key, lane in sorted(graph.lanes.items()):
        if not lane.internal or length_m(lane.shape) >= _TINY_JOINT_M:
            continue
        before, after = graph.predecessors[key], graph.successors[key]
        if len(before) != 1 or len(after) != 1:
            continue
        entry, exit_ = before[0], after[0]
        joint = graph.successors[entry] == [key] and graph.predecessors[exit_] == [key]
        if joint and not graph.lanes[entry].internal and not graph.lanes[exit_].internal:
            graph.drop([key])
            graph.link(entry, exit_)
