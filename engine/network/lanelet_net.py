"""Converts a lanelet network to a SUMO net for traffic generation, and to the plain values of a generated site.

The lanelets keep their shape and ids: the net is built over them (``sumo_export``), so that vehicles follow their
centre lines. The net adds what traffic generation needs: kinds of roads, lanes that only some vehicles may use, a
location on earth, and lights in the file's state at step 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from .road_network import RoadLanelet, RoadNetwork, TrafficLight
from .sumo_export.layout import NetLayout
from .sumo_export.speeds import lowered_by_curves, posted_speeds, straight_speeds
from .sumo_export.writer import signals_of, sumo_net

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

_ROAD_TYPES = {
    "accessRamp": "motorway_link",
    "exitRamp": "motorway_link",
    "interstate": "motorway",
    "highway": "motorway",
    "mainCarriageWay": "motorway",
    "country": "secondary",
    "urban": "residential",
    "driveWay": "residential",
}
"""OSM's class for a lanelet's type, the first that fits; sites are found by it. Without a type, the speed decides."""
_CLASSES = {
    "bus": "bus coach",
    "taxi": "taxi",
    "bicycle": "bicycle",
    "priorityVehicle": "emergency",
    "truck": "truck trailer delivery",
    "motorcycle": "motorcycle moped",
    "pedestrian": "pedestrian",
}
"""SUMO's classes for the users of a lanelet that is closed to cars; any other lanelet is open to all."""


@dataclass(frozen=True)
class GeoReference:
    """The location of a network's coordinates on earth: a PROJ string, and the offset added to them in m."""

    projection: str
    offset_m: tuple[float, float]


def net_over_lanelets(
    network: "LaneletNetwork", ground: GeoReference, *, step_s: float, largest_id: int
) -> tuple[bytes, RoadNetwork]:
    """Return the ``.net.xml`` over a lanelet network, and the lanelets for vehicles as plain values.

    The cycles of its lights begin as in the file at step 0; :func:`lights_begin_at` shifts them.

    Args:
        network: the lanelets.
        ground: their location on earth.
        step_s: duration of a time step, the unit of the lights' cycles.
        largest_id: the largest id of all elements in the file, including lanelets without vehicles.

    Raises:
        NotPossible: too many lanelets cross or fork for a net over them.
    """
    layout = NetLayout.of(network)
    speeds = lowered_by_curves(layout, straight_speeds(layout, {}, posted_speeds(network)))
    text = sumo_net(layout, speeds, signals_of(network, step_s))
    lanelets = {int(lanelet.lanelet_id): lanelet for lanelet in network.lanelets}
    places = _places(layout)
    driven = {
        key: _plain(lanelets[key], places[key], speeds[key], set(layout.table.lanes)) for key in layout.table.lanes
    }
    lights = _lights(network, driven)
    road_network = RoadNetwork(driven, (), lights, (), (), largest_id=largest_id)
    return _completed(text, layout, lanelets, ground), road_network


def lights_begin_at(net: bytes, elapsed_s: float) -> bytes:
    """Return a net with its lights in their initial states after the given simulated time."""
    root = etree.fromstring(net)
    for logic in root.iterfind("tlLogic"):
        logic.set("offset", f"{elapsed_s:g}")
    return etree.tostring(root, encoding="UTF-8", xml_declaration=True)


def _places(layout: NetLayout) -> dict[int, tuple[str, str]]:
    """Return each lanelet's edge and lane in the net; inside junctions, those of the first path that uses it."""
    inside = {key: layout.internal_edge_of_path[paths[0]] for key, paths in layout.paths_through.items()}
    places = {key: (edge, f"{edge}_0") for key, edge in inside.items()}
    places |= {key: (edge, f"{edge}_{index}") for key, (edge, index) in layout.lane_of.items()}
    nowhere = ("", "")  # inside a junction, but on no path through it
    return {key: places.get(key, nowhere) for key in layout.table.lanes}


def _plain(lanelet: "Lanelet", place: tuple[str, str], speed_mps: float, known: set[int]) -> RoadLanelet:
    edge, lane = place
    return RoadLanelet(
        lanelet_id=int(lanelet.lanelet_id),
        lane_id=lane,
        edge_id=edge,
        left=np.asarray(lanelet.left_vertices, dtype=float)[:, :2],
        right=np.asarray(lanelet.right_vertices, dtype=float)[:, :2],
        successors=tuple(int(key) for key in lanelet.successor if key in known),
        predecessors=tuple(int(key) for key in lanelet.predecessor if key in known),
        left_neighbour=lanelet.adj_left if lanelet.adj_left in known else None,
        left_same_direction=bool(lanelet.adj_left_same_direction),
        right_neighbour=lanelet.adj_right if lanelet.adj_right in known else None,
        right_same_direction=bool(lanelet.adj_right_same_direction),
        internal=edge.startswith(":") or not edge,
        types=tuple(sorted(str(kind.value) for kind in lanelet.lanelet_type or ())),
        users=tuple(sorted(str(user.value) for user in lanelet.user_one_way or ())),
        allowed=frozenset(),
        speed_mps=speed_mps,
        street="",
    )


def _lights(network: "LaneletNetwork", driven: Mapping[int, RoadLanelet]) -> tuple[TrafficLight, ...]:
    """Return the file's lights at lanelets for vehicles, with empty cycles, because scenarios copy the cycles from the
    file.
    """
    standing = {
        int(light): key
        for key, lanelet in sorted((int(one.lanelet_id), one) for one in network.lanelets)
        if key in driven
        for light in lanelet.traffic_lights or ()
    }
    return tuple(
        TrafficLight(light, key, driven[key].right[-1], (), 0, "all") for light, key in sorted(standing.items())
    )


def _completed(text: str, layout: NetLayout, lanelets: "Mapping[int, Lanelet]", ground: GeoReference) -> bytes:
    """Return the net with its location, the kinds of its roads, and lanes that only some vehicles may use."""
    root = etree.fromstring(text.encode())
    location = root.find("location")
    if location is not None:
        location.set("projParameter", ground.projection)
        location.set("netOffset", f"{ground.offset_m[0]:.3f},{ground.offset_m[1]:.3f}")
    for edge in root.iterfind("edge"):
        keys = layout.edges.get(edge.get("id", ""), ())
        if kind := next((kind for key in keys if (kind := _road_type(lanelets[key]))), ""):
            edge.set("type", f"highway.{kind}")
    lanes = {lane.get("id", ""): lane for lane in root.iter("lane")}
    for name, keys in layout.lanelets_of_lane.items():
        users = {_allowed(_users(lanelets[key])) for key in keys}
        if name in lanes and len(users) == 1 and (allowed := users.pop()) != "":
            lanes[name].set("allow", allowed)
    return etree.tostring(root, encoding="UTF-8", xml_declaration=True)


def _road_type(lanelet: "Lanelet") -> str:
    kinds = {str(kind.value) for kind in lanelet.lanelet_type or ()}
    return next((road for kind, road in _ROAD_TYPES.items() if kind in kinds), "")


def _allowed(users: frozenset[str]) -> str:
    """Return SUMO's classes on a lanelet for these users; empty if it is open to all."""
    if not users or not users <= _CLASSES.keys():
        return ""
    return " ".join(classes for user, classes in _CLASSES.items() if user in users)


def _users(lanelet: "Lanelet") -> frozenset[str]:
    return frozenset(str(user.value) for user in lanelet.user_one_way or ())
