"""From a SUMO net to a road network of lanelets with one geometry for both."""

from plannerforge.engine.network.intersections import find_intersections
from plannerforge.engine.network.lane_geometry import Ribbon, draw_ribbons
from plannerforge.engine.network.lane_graph import LaneGraph, connect
from plannerforge.engine.network.net_parser import NetEdge, SumoNet
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.engine.network.signs_and_lights import speed_signs, traffic_lights

COUNTRY_ROAD_MPS = 70 / 3.6 - 0.1
USERS = {
    "passenger": "car",
    "truck": "truck",
    "bus": "bus",
    "emergency": "priorityVehicle",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "taxi": "taxi",
}
BUS_LANE_CLASSES = frozenset({"bus", "coach", "taxi", "emergency", "bicycle", "authority", "delivery", "army", "tram"})
BICYCLE_LANE_CLASSES = frozenset({"bicycle", "pedestrian", "wheelchair", "scooter", "moped"})


def build_road_network(net: SumoNet, *, step_s: float, elapsed_s: float) -> RoadNetwork:
    """All lanes of the net that road vehicles may use, as lanelets.

    Args:
        net: the SUMO net.
        step_s: duration of a time step of the scenario, in which the lights' cycles are counted.
        elapsed_s: simulated time that has gone by at step 0 (the warm-up), for the lights' offsets.
    """
    graph = connect(net)
    ribbons, dropped = draw_ribbons(net, graph)
    graph.drop(dropped)
    ids = {key: number for number, key in enumerate(ribbons, start=1)}
    lanelets = {ids[key]: _lanelet(key, ribbon, ids, graph, net) for key, ribbon in ribbons.items()}
    next_id = len(ids) + 1
    signs = speed_signs(net, lanelets, next_id)
    next_id += len(signs)
    lights = traffic_lights(net, lanelets, next_id, step_s=step_s, elapsed_s=elapsed_s)
    next_id += len(lights)
    return RoadNetwork(lanelets, signs, lights, find_intersections(net, ids, next_id), dropped)


def _lanelet(key: str, ribbon: Ribbon, ids: dict[str, int], graph: LaneGraph, net: SumoNet) -> RoadLanelet:
    lane, edge = ribbon.lane, net.edges[ribbon.lane.edge_id]
    left, left_same = _neighbour(ribbon.on_left, None if net.lefthand else ribbon.oncoming, ids)
    right, right_same = _neighbour(ribbon.on_right, ribbon.oncoming if net.lefthand else None, ids)
    return RoadLanelet(
        lanelet_id=ids[key],
        lane_id=key,
        edge_id=lane.edge_id,
        left=ribbon.left,
        right=ribbon.right,
        successors=tuple(sorted(ids[other] for other in graph.successors[key])),
        predecessors=tuple(sorted(ids[other] for other in graph.predecessors[key])),
        left_neighbour=left,
        left_same_direction=left_same,
        right_neighbour=right,
        right_same_direction=right_same,
        internal=lane.internal,
        types=_types(edge, lane.allowed, lane.speed_mps),
        users=tuple(word for sumo_class, word in USERS.items() if sumo_class in lane.allowed) or ("vehicle",),
        allowed=lane.allowed,
        speed_mps=lane.speed_mps,
        street=edge.name,
    )


def _neighbour(beside: Ribbon | None, oncoming: Ribbon | None, ids: dict[str, int]) -> tuple[int | None, bool]:
    if beside is not None and beside.lane.lane_id in ids:
        return ids[beside.lane.lane_id], True
    if oncoming is not None and oncoming.lane.lane_id in ids:
        return ids[oncoming.lane.lane_id], False
    return None, False


def _types(edge: NetEdge, allowed: frozenset[str], speed_mps: float) -> tuple[str, ...]:
    """CommonRoad's lanelet types, from the road's OSM class, its users and its speed."""
    found = []
    if edge.internal:
        found.append("intersection")
    elif "motorway_link" in edge.road_type or "trunk_link" in edge.road_type:
        found.append("highway")
    elif "motorway" in edge.road_type:
        found += ["interstate", "mainCarriageWay"]
    elif "trunk" in edge.road_type:
        found += ["highway", "mainCarriageWay"]
    else:
        found.append("country" if speed_mps >= COUNTRY_ROAD_MPS else "urban")
    if "bus" in allowed and allowed <= BUS_LANE_CLASSES:
        found.append("busLane")
    if allowed <= BICYCLE_LANE_CLASSES:
        found.append("bicycleLane")
    return tuple(found)
