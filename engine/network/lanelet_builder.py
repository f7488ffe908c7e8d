"""Builds a road network of lanelets from a SUMO net, with the same geometry, and with signs, lights and intersections.

Each SUMO lane becomes a lanelet, including those inside junctions. Connections too tight for a lanelet (hairpins) are
left out, and ``remove_hairpins`` also removes them from the net, so that the net and the lanelets agree.
"""

from collections import defaultdict
from collections.abc import Iterable
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from .lane_bounds import LaneBounds, draw_lane_bounds
from .net_parser import Connection, LaneGraph, NetEdge, SignalProgram, SumoNet, connect, lost_connections, read_net
from .netconvert import remove_connections
from .road_network import Incoming, Intersection, RoadLanelet, RoadNetwork, SpeedSign, TrafficLight

_COUNTRY_ROAD_MPS = 70 / 3.6 - 0.1
"""Chosen: roads with a limit of 70 km/h or more are rural; 0.1 m/s for SUMO's rounding."""
_USERS = {
    "passenger": "car",
    "truck": "truck",
    "bus": "bus",
    "emergency": "priorityVehicle",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "taxi": "taxi",
}
"""CommonRoad's road user by SUMO's vehicle class."""
_BUS_LANE_CLASSES = frozenset({"bus", "coach", "taxi", "emergency", "bicycle", "authority", "delivery", "army", "tram"})
"""SUMO's classes on a bus lane: private cars belong to no other class."""
_BICYCLE_LANE_CLASSES = frozenset({"bicycle", "pedestrian", "wheelchair", "scooter", "moped"})


def build_road_network(net: SumoNet, *, step_s: float, elapsed_s: float) -> RoadNetwork:
    """Return all lanes of the net that road vehicles may use, as lanelets.

    Args:
        net: the SUMO net.
        step_s: duration of the scenario's time step, the unit of the lights' cycles.
        elapsed_s: simulated time before step 0 (the warm-up), for the lights' offsets.
    """
    graph = connect(net)
    drawn, dropped = draw_lane_bounds(net, graph)
    graph.drop(dropped)
    ids = {key: number for number, key in enumerate(drawn, start=1)}
    lanelets = {ids[key]: _lanelet(key, bounds, ids, graph, net) for key, bounds in drawn.items()}
    next_id = len(ids) + 1
    by_lane = {lanelet.lane_id: lanelet for lanelet in lanelets.values()}
    signs = _speed_signs(net, by_lane, next_id)
    next_id += len(signs)
    lights = _traffic_lights(net, by_lane, next_id, step_s=step_s, elapsed_s=elapsed_s)
    next_id += len(lights)
    lost = tuple((link.from_lane, link.to_lane) for link in lost_connections(net, graph))
    intersections = _find_intersections(net, ids, graph, next_id)
    folded = tuple(dict.fromkeys(bounds.lane.edge_id for bounds in drawn.values() if bounds.is_folded))
    return RoadNetwork(lanelets, signs, lights, intersections, dropped, lost_connections=lost, folded_edges=folded)


def _lanelet(key: str, bounds: LaneBounds, ids: dict[str, int], graph: LaneGraph, net: SumoNet) -> RoadLanelet:
    lane, edge = bounds.lane, net.edges[bounds.lane.edge_id]
    left, left_same = _neighbour(bounds.on_left, None if net.lefthand else bounds.oncoming, ids)
    right, right_same = _neighbour(bounds.on_right, bounds.oncoming if net.lefthand else None, ids)
    return RoadLanelet(
        lanelet_id=ids[key],
        lane_id=key,
        edge_id=lane.edge_id,
        left=bounds.left,
        right=bounds.right,
        successors=tuple(sorted(ids[other] for other in graph.successors[key])),
        predecessors=tuple(sorted(ids[other] for other in graph.predecessors[key])),
        left_neighbour=left,
        left_same_direction=left_same,
        right_neighbour=right,
        right_same_direction=right_same,
        internal=lane.internal,
        types=_types(edge, lane.allowed, lane.speed_mps),
        users=tuple(word for sumo_class, word in _USERS.items() if sumo_class in lane.allowed) or ("vehicle",),
        allowed=lane.allowed,
        speed_mps=lane.speed_mps,
        street=edge.name,
    )


def _neighbour(
    adjoining: LaneBounds | None, oncoming: LaneBounds | None, ids: dict[str, int]
) -> tuple[int | None, bool]:
    if adjoining is not None and adjoining.lane.lane_id in ids:
        return ids[adjoining.lane.lane_id], True
    if oncoming is not None and oncoming.lane.lane_id in ids:
        return ids[oncoming.lane.lane_id], False
    return None, False


def _types(edge: NetEdge, allowed: frozenset[str], speed_mps: float) -> tuple[str, ...]:
    """Return CommonRoad's lanelet types, from the road's OSM class, its users and its speed."""
    types = []
    if edge.internal:
        types.append("intersection")
    elif "motorway_link" in edge.road_type or "trunk_link" in edge.road_type:
        types.append("highway")
    elif "motorway" in edge.road_type:
        types += ["interstate", "mainCarriageWay"]
    elif "trunk" in edge.road_type:
        types += ["highway", "mainCarriageWay"]
    else:
        types.append("country" if speed_mps >= _COUNTRY_ROAD_MPS else "urban")
    if "bus" in allowed and allowed <= _BUS_LANE_CLASSES:
        types.append("busLane")
    if allowed <= _BICYCLE_LANE_CLASSES:
        types.append("bicycleLane")
    return tuple(types)


_COLOURS = {"r": "red", "R": "red", "y": "yellow", "Y": "yellow", "g": "green", "G": "green", "s": "green"}
_COLOURS |= {"u": "redYellow", "o": "inactive", "O": "inactive"}
"""CommonRoad's colour by SUMO's letter for the state of a link
(https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html).
"""
_SIDES = {"r": "right", "R": "right", "l": "left", "L": "left", "t": "left"}
"""Side to which a connection turns, by SUMO's letter for its direction; all others lead straight on."""
_DIRECTIONS = {side: side for side in ("left", "straight", "right")}
_DIRECTIONS |= {"left straight": "leftStraight", "right straight": "straightRight", "left right": "leftRight"}
"""CommonRoad's direction of a light by the sides that it applies to."""


def _speed_signs(net: SumoNet, by_lane: dict[str, RoadLanelet], first_id: int) -> tuple[SpeedSign, ...]:
    """Return one sign for every normal edge, with its lanes' limit in m/s, on the right at its beginning."""
    signs: list[SpeedSign] = []
    for edge in net.edges.values():
        adjoining = [by_lane[key] for key in edge.lane_ids if key in by_lane]
        if edge.internal or not adjoining:
            continue
        position = adjoining[0].left[0] if net.lefthand else adjoining[0].right[0]
        numbers = tuple(lanelet.lanelet_id for lanelet in adjoining)
        signs.append(SpeedSign(first_id + len(signs), adjoining[0].speed_mps, position, numbers))
    return tuple(signs)


def _traffic_lights(
    net: SumoNet, by_lane: dict[str, RoadLanelet], first_id: int, *, step_s: float, elapsed_s: float
) -> tuple[TrafficLight, ...]:
    """Return a light for each lane and each group of directions that switch together.

    CommonRoad's state at step k is SUMO's at ``elapsed_s + k · step_s`` (up to one step off at a change of phase).
    """
    links: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for connection in net.connections:
        known = connection.signal in net.signals and connection.from_lane in by_lane
        if known and connection.signal is not None and not connection.from_edge.startswith(":"):
            side = _SIDES.get(connection.direction, "straight")
            links.setdefault((connection.from_lane, connection.signal), []).append((connection.link, side))
    lights: list[TrafficLight] = []
    for (lane_id, signal), sides_of_links in links.items():
        program, lanelet = net.signals[signal], by_lane[lane_id]
        cycles: dict[tuple[tuple[int, str], ...], set[str]] = {}
        for link, side in sides_of_links:
            cycles.setdefault(_cycle(program, link, step_s), set()).add(side)
        for cycle, sides in cycles.items():
            direction = "all" if len(cycles) == 1 else _DIRECTIONS.get(" ".join(sorted(sides)), "all")
            offset = round((program.offset_s - elapsed_s) / step_s) % sum(steps for steps, _ in cycle)
            light_id = first_id + len(lights)
            lights.append(TrafficLight(light_id, lanelet.lanelet_id, lanelet.right[-1], cycle, offset, direction))
    return tuple(lights)


def _cycle(program: SignalProgram, link: int, step_s: float) -> tuple[tuple[int, str], ...]:
    """Return the sequence of colours of a link, each with its number of time steps."""
    phases = [
        (max(round(duration_s / step_s), 1), _COLOURS.get(state[link], "inactive"))
        for duration_s, state in program.phases
    ]
    return tuple((sum(steps for steps, _ in run), colour) for colour, run in groupby(phases, itemgetter(1)))


def _find_intersections(net: SumoNet, ids: dict[str, int], graph: LaneGraph, first_id: int) -> tuple[Intersection, ...]:
    """Return junctions with at least two arms in and two out, three on one side; ``ids``: lanelet id by SUMO lane.

    If the lane across a junction is too short to be drawn, the lane after it replaces it.
    """
    arms: dict[str, dict[str, defaultdict[str, set[int]]]] = {}
    exits: dict[str, set[str]] = {}
    for connection in net.connections:
        if connection.from_edge.startswith(":"):
            continue
        junction = net.edges[connection.from_edge].to_junction
        exits.setdefault(junction, set()).add(connection.to_edge)
        following = graph.successors.get(connection.from_lane, ())
        over = next((lane for lane in (connection.via, connection.to_lane) if lane in following), None)
        if over is not None:
            arm = arms.setdefault(junction, {}).setdefault(connection.from_edge, defaultdict(set))
            arm["in"].add(ids[connection.from_lane])
            arm[_SIDES.get(connection.direction, "straight")].add(ids[over])
    intersections: list[Intersection] = []
    for junction, by_edge in arms.items():
        ways_in, ways_out = len(by_edge), len(exits[junction])
        if min(ways_in, ways_out) < 2 or max(ways_in, ways_out) < 3:
            continue
        incomings = tuple(
            Incoming(number, *(tuple(sorted(arm[role])) for role in ("in", "right", "straight", "left")))
            for number, arm in enumerate(by_edge.values(), start=first_id + 1)
        )
        intersections.append(Intersection(first_id, incomings))
        first_id += 1 + len(incomings)
    return tuple(intersections)


_MAXIMUM_ROUNDS = 3
"""Chosen: netconvert redraws a junction without the connection, which may make another one too tight."""


def remove_hairpins(net_path: Path, scratch: Path) -> tuple[int, tuple[str, ...]]:
    """Delete the connections of all lanes without valid bounds from a net, in place.

    Returns:
        The number of connections, and netconvert's warnings.
    """
    removed = 0
    warnings: list[str] = []
    for _ in range(_MAXIMUM_ROUNDS):
        net = read_net(net_path)
        connections = _owners(net, draw_lane_bounds(net, connect(net))[1])
        if not connections:
            break
        removed += len(connections)
        warnings += remove_connections(net_path, connections, scratch)
    return removed, tuple(warnings)


def _owners(net: SumoNet, dropped_lanes: Iterable[str]) -> list[tuple[str, str, int, int]]:
    """Return the connections between normal edges that use dropped internal lanes, in order."""
    following = {c.from_lane: c.via for c in net.connections if c.from_edge.startswith(":") and c.via is not None}
    owner: dict[str, Connection] = {}
    for connection in net.connections:
        inside = None if connection.from_edge.startswith(":") else connection.via
        while inside is not None:
            owner[inside] = connection
            inside = following.get(inside)
    dropped = {owner[lane] for lane in dropped_lanes if lane in owner}
    return sorted((c.from_edge, c.to_edge, _index(c.from_lane), _index(c.to_lane)) for c in dropped)


def _index(lane_id: str) -> int:
    return int(lane_id.rsplit("_", 1)[1])
