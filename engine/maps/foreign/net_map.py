"""A user's SUMO network (.net.xml) as a map with nodes, roads and tags as a site finder expects from OpenStreetMap.

Its numeric ids are created here, because a network has names for its roads and no OpenStreetMap ids.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ....schemas.errors import UnsafeInput
from ....schemas.text import cited, counted, one_line, shown_name
from ...geometry import Points
from ...network import MOTOR_CLASSES, NetEdge, SumoNet, build_road_network, read_net
from ..osm import HALF_TURN_DEG, NO_TAGS, OSM_ATTRIBUTION, OsmMap, OsmNode, OsmWay
from ..road_classes import ALL_ROADS

OSM_TYPE = "highway."
"""Prefix of the ``highway`` value in the types that netconvert gives to edges from OSM."""
PROJECTION = re.compile(
    r"(?!.*(pipeline|grids|init=|file=))\+proj=[\w.+-]{1,20}( \+\w{1,20}(=[\w.,:+-]{0,60})?){0,30} ?"
)
"""A PROJ string without files and pipelines: netconvert writes no others."""
FAST_KMH = 60
"""Above it, a road with an unknown type counts as a road outside towns (chosen)."""


@dataclass(frozen=True)
class NetMap(OsmMap):
    """A network as a map; ``edges``: the network's edges by way (both directions of a road).

    ``attribution`` credits OpenStreetMap if the network comes from it, and otherwise the network's file.
    """

    path: Path = Path()
    edges: dict[int, tuple[str, ...]] = field(default_factory=dict)


def read_net_map(path: Path) -> NetMap:
    """Scan and read a network with a georeference.

    Raises:
        UnsafeInput: the file is hostile, broken or not a SUMO network, or has no georeference or no road for vehicles.
    """
    try:
        net = read_net(path)
        edges = [edge for edge in net.edges.values() if not edge.internal and _is_road(edge, net)]
        if not net.projection:
            raise UnsafeInput(
                f"{shown_name(path.name)} has no georeference, so the location of its roads is unknown",
                next_step="make the network with a projection (netconvert --proj.utm), or import the extract behind it",
            )
        if not edges:
            raise UnsafeInput(
                f"{shown_name(path.name)} has no road for vehicles", next_step="use a network with streets in it"
            )
        return _as_map(net, edges, path)
    except (ValueError, KeyError, IndexError, ArithmeticError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as a SUMO network: {cited(error)}") from error


MOST_TRACED = 4_000
"""Maximum number of lanes of a network for which import draws all lanelets to find gaps (chosen: a few seconds)."""


def untraced_links(path: Path) -> list[str]:
    """Describe the drivable connections of a network that no lanelet can represent.

    The result is empty for large networks, which are checked later, cut by cut.

    Raises:
        UnsafeInput: the file is hostile, broken or not a SUMO network.
    """
    try:
        net = read_net(path)
    except (ValueError, KeyError, IndexError, ArithmeticError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as a SUMO network: {cited(error)}") from error
    if len(net.lanes) > MOST_TRACED:
        return []
    try:
        missing = build_road_network(net, step_s=0.1, elapsed_s=0.0).lost_connections
    except (ValueError, KeyError, IndexError, ArithmeticError) as error:
        return [f"not all of its lanelets can be drawn at once: {cited(error)}"]
    if not missing:
        return []
    start, goal = missing[0]
    return [f"{counted(len(missing), 'turn')} too tight for a lanelet, first: {start} to {goal}"]


def _as_map(net: SumoNet, edges: list[NetEdge], path: Path) -> NetMap:
    junctions = _junctions(edges, net)
    number = {name: index for index, name in enumerate(junctions, start=1)}
    lines: dict[int, Points] = {}
    nodes: dict[int, OsmNode] = {}
    ways: list[OsmWay] = []
    edges_of: dict[int, tuple[str, ...]] = {}
    next_id = len(number) + 1
    rings = {edge for ring in net.roundabout_edges for edge in ring}
    for one, back in _roads(edges):
        line = _middle_line(one, net)[1:-1]
        inner = tuple(range(next_id, next_id + len(line)))
        next_id += len(line)
        way_id = len(ways) + 1
        ids = (number[one.from_junction], *inner, number[one.to_junction])
        lines |= dict(zip(inner, line, strict=True))
        tags = _tags(one, net, oneway=back is None, roundabout=one.edge_id in rings)
        ways.append(OsmWay(way_id, ids, tags))
        edges_of[way_id] = (one.edge_id,) if back is None else (one.edge_id, back.edge_id)
    lines |= {number[name]: point for name, point in junctions.items()}
    lit = {number[name] for name in junctions if net.junction_types.get(name, "").startswith("traffic_light")}
    for key, (latitude, longitude) in zip(lines, _degrees(np.array(list(lines.values())), net), strict=True):
        tags_here = {"highway": "traffic_signals"} if key in lit else NO_TAGS
        nodes[key] = OsmNode(key, latitude, longitude, tags_here)
    from_osm = any(edge.road_type.startswith(OSM_TYPE) for edge in edges)
    attribution = OSM_ATTRIBUTION if from_osm else f"SUMO network {one_line(path.name)}"
    return NetMap(nodes, tuple(ways), (), None, attribution, path=path, edges=edges_of)


def _is_road(edge: NetEdge, net: SumoNet) -> bool:
    return any(net.lanes[lane].allowed & MOTOR_CLASSES and len(net.lanes[lane].shape) > 1 for lane in edge.lane_ids)


def _roads(edges: list[NetEdge]) -> list[tuple[NetEdge, NetEdge | None]]:
    """Return each edge with an edge in the opposite direction between the same junctions, or None if there is none."""
    waiting: dict[tuple[str, str], list[NetEdge]] = {}
    for edge in edges:
        waiting.setdefault((edge.from_junction, edge.to_junction), []).append(edge)
    taken: set[str] = set()
    roads: list[tuple[NetEdge, NetEdge | None]] = []
    for edge in edges:
        if edge.edge_id in taken:
            continue
        taken.add(edge.edge_id)
        others = waiting.get((edge.to_junction, edge.from_junction), [])
        back = next((other for other in others if other.edge_id not in taken), None)
        if back is not None:
            taken.add(back.edge_id)
        roads.append((edge, back))
    return roads


def _junctions(edges: list[NetEdge], net: SumoNet) -> dict[str, Points]:
    """Return the junctions in the order of the edges, each at the mean position of the ends of its roads."""
    ends: dict[str, list[Points]] = {}
    for edge in edges:
        line = _middle_line(edge, net)
        ends.setdefault(edge.from_junction, []).append(line[0])
        ends.setdefault(edge.to_junction, []).append(line[-1])
    return {name: np.mean(points, axis=0) for name, points in ends.items()}


def _middle_line(edge: NetEdge, net: SumoNet) -> Points:
    """Return the line of the edge's leftmost lane, which is next to the middle of a two-way road."""
    lines = [net.lanes[lane].shape for lane in edge.lane_ids if len(net.lanes[lane].shape) > 1]
    return lines[-1]


def _tags(edge: NetEdge, net: SumoNet, *, oneway: bool, roundabout: bool) -> dict[str, str]:
    speed_kmh = round(max(net.lanes[lane].speed_mps for lane in edge.lane_ids) * 3.6)
    named = edge.road_type.split("|")[0].removeprefix(OSM_TYPE)
    guessed = "unclassified" if speed_kmh > FAST_KMH else "residential"
    tags = {"highway": named if named in ALL_ROADS else guessed, "maxspeed": str(speed_kmh)}
    tags |= ({"name": edge.name} if edge.name else {}) | ({"oneway": "yes"} if oneway else {})
    return tags | ({"junction": "roundabout"} if roundabout else {})


def _degrees(points: Points, net: SumoNet) -> list[tuple[float, float]]:
    """Return (latitude, longitude) of points (n, 2) of the network.

    Raises:
        ValueError: the projection is unknown, or the points are outside it.
    """
    from pyproj import Proj
    from pyproj.exceptions import ProjError

    if PROJECTION.fullmatch(net.projection) is None:
        raise ValueError(f"its projection {cited(net.projection)} is not supported")
    x, y = points[:, 0] - net.offset_m[0], points[:, 1] - net.offset_m[1]
    try:
        longitudes, latitudes = Proj(net.projection)(x, y, inverse=True)
    except ProjError as error:
        raise ValueError(f"the projection {cited(net.projection)} is unknown") from error
    if not ((np.abs(latitudes) <= 90.0).all() and (np.abs(longitudes) <= HALF_TURN_DEG).all()):
        raise ValueError(f"its coordinates are outside the projection {cited(net.projection)}")
    return list(zip(np.round(latitudes, 7).tolist(), np.round(longitudes, 7).tolist(), strict=True))
