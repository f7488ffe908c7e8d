"""Whether a made scenario shows the type of road, the place and the vehicles asked for; read from the made files.

Apart from the site finder: types are read off the SUMO net around the scenario's GPS position, roads off the map file.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.net_parser import NetEdge, SumoNet, read_net
from plannerforge.evals.map_evidence import MapEvidence

NEAR_M = 100.0
LONGEST_RING_M = 1_200.0
LEAST_ROUND = 0.55
"""4π·area / perimeter² of a ring: 1 is a circle, 0.785 a square; oblong roundabouts have less."""
STREET_WITHIN_M = 250.0
BESIDE_M, SIDES_APART_M = 40.0, 12.0
OUT_OF_TOWN_KMH = 60.0
SIZES = {
    "car": ("car", 3.0, 6.0),
    "delivery": ("truck", 5.0, 7.0),
    "truck": ("truck", 7.0, 12.1),
    "trailer": ("truck", 12.1, 25.3),
    "bus": ("bus", 8.0, 13.5),
    "coach": ("bus", 13.5, 15.1),
    "taxi": ("taxi", 3.0, 6.0),
    "emergency": ("priorityVehicle", 4.0, 12.1),
    "motorcycle": ("motorcycle", 2.15, 2.6),
    "moped": ("motorcycle", 1.5, 2.15),
    "bicycle": ("bicycle", 1.3, 2.6),
}
"""CommonRoad's type of each class, and the lengths in m (from, below) that tell classes of one type apart."""


@dataclass(frozen=True)
class MadeFiles:
    """A made scenario: its net, its middle there in m and on the globe in degrees, its obstacles as (type, length)."""

    net: SumoNet
    middle: Points
    latitude: float
    longitude: float
    obstacles: tuple[tuple[str, float], ...]

    @classmethod
    def read(cls, folder: Path) -> "MadeFiles":
        """Read ``scenario.xml`` and ``scenario.net.xml``."""
        from pyproj import Proj

        root = etree.parse(folder / "scenario.xml").getroot()
        net = read_net(folder / "scenario.net.xml")
        latitude, longitude = (
            float(root.findtext(f"location/{tag}", "nan")) for tag in ("gpsLatitude", "gpsLongitude")
        )
        middle = np.array(Proj(net.projection)(longitude, latitude)) + np.array(net.offset_m)
        obstacles = tuple(
            (str(found.findtext("type")), float(found.findtext("shape/rectangle/length", "nan")))
            for found in root.iterfind("dynamicObstacle")
        )
        return cls(net, middle, latitude, longitude, obstacles)

    def classes(self) -> Counter[str]:
        """Vehicles by class, the ego not counted."""
        return Counter(
            name
            for kind, length in self.obstacles
            for name, (of_kind, shortest, longest) in SIZES.items()
            if kind == of_kind and shortest <= length < longest
        )

    def near(self, within_m: float = NEAR_M) -> list[NetEdge]:
        """Roads of the net within a distance of the middle."""
        return [edge for edge in self.net.edges.values() if not edge.internal and self._distance_m(edge) < within_m]

    def _distance_m(self, edge: NetEdge) -> float:
        lines = [self.net.lanes[lane].shape for lane in edge.lane_ids]
        points = np.vstack([np.linspace(a, b, 8) for line in lines for a, b in itertools.pairwise(line)])
        return float(np.linalg.norm(points - self.middle, axis=1).min())


def shows_type(made: MadeFiles, kind: str, evidence: MapEvidence) -> bool:
    """Whether the roads around the middle are of the type; what is town and what country, the map file tells."""
    judges: dict[str, Callable[[], bool]] = {
        "roundabout": lambda: _roundabout(made),
        "signalised_intersection": lambda: _crossing(made, lit=True),
        "intersection": lambda: _crossing(made, lit=False),
        "highway": lambda: _any_class(made, ("motorway", "trunk")),
        "ramp": lambda: _ramp(made),
        "rural": lambda: _rural(made, evidence),
        "urban": lambda: _urban(made, evidence),
        "any": lambda: bool(made.near()),
    }
    return judges[kind]()


def _rural(made: MadeFiles, evidence: MapEvidence) -> bool:
    """A road beside the middle, no motorway or street with houses, and a limit above a town's or no built-up area."""
    spot = (made.latitude, made.longitude)
    town = _any_class(made, ("residential", "living_street", "motorway"), BESIDE_M)
    fast = max(evidence.limits_kmh(*spot, BESIDE_M), default=0.0) >= OUT_OF_TOWN_KMH
    return bool(made.near(BESIDE_M)) and not town and (fast or not evidence.is_built_up(*spot, 50.0))


def _urban(made: MadeFiles, evidence: MapEvidence) -> bool:
    """A road beside the middle, no motorway, and streets with houses, a town's limit or a built-up area around."""
    spot = (made.latitude, made.longitude)
    street = _any_class(made, ("residential", "living_street", "pedestrian"))
    slow = min(evidence.limits_kmh(*spot, BESIDE_M), default=math.inf) < OUT_OF_TOWN_KMH
    motorway = _any_class(made, ("motorway",), BESIDE_M)
    return bool(made.near(BESIDE_M)) and not motorway and (street or slow or evidence.is_built_up(*spot, NEAR_M))


def _classes(edge: NetEdge) -> set[str]:
    return {part.removeprefix("highway.") for part in edge.road_type.split("|")}


def _any_class(made: MadeFiles, classes: tuple[str, ...], within_m: float = NEAR_M) -> bool:
    return any(_classes(edge) & set(classes) for edge in made.near(within_m))


def _crossing(made: MadeFiles, *, lit: bool) -> bool:
    """A junction of three roads near the middle, with lights where they are asked for; both directions are one road."""
    roads = {(end, edge.edge_id.lstrip("-")) for edge in made.near() for end in (edge.from_junction, edge.to_junction)}
    arms = Counter(junction for junction, _ in roads)
    lights = ("traffic_light", "traffic_light_right_on_red", "traffic_light_unregulated")
    kinds = made.net.junction_types
    return any(count >= 3 and (not lit or kinds.get(key, "") in lights) for key, count in arms.items())


def _ramp(made: MadeFiles) -> bool:
    """A link road that leaves or joins a motorway or trunk road near the middle."""
    near = {edge.edge_id: _classes(edge) for edge in made.near()}
    mains, links = {"motorway", "trunk"}, {"motorway_link", "trunk_link"}
    pairs = ((near.get(c.from_edge, set()), near.get(c.to_edge, set())) for c in made.net.connections)
    return any((one & mains and other & links) or (one & links and other & mains) for one, other in pairs)


def _roundabout(made: MadeFiles) -> bool:
    """A closed one-way ring within reach, driven round the proper way, with at least two roads leading in."""
    edges = {key: edge for key, edge in made.net.edges.items() if not edge.internal}
    one_way = {key for key, edge in edges.items() if not _has_other_side(made.net, edge)}
    following: dict[str, set[str]] = {key: set() for key in one_way}
    entering: dict[str, set[str]] = {key: set() for key in one_way}
    for connection in made.net.connections:
        if connection.to_edge in one_way and connection.from_edge in edges:
            entering[connection.to_edge].add(connection.from_edge)
            if connection.from_edge in one_way:
                following[connection.from_edge].add(connection.to_edge)
    for start in sorted(edge.edge_id for edge in made.near(180.0) if edge.edge_id in one_way):
        ring = _ring(made.net, following, start)
        if ring and _is_round(made.net, ring) and len({e for key in ring for e in entering[key]} - set(ring)) >= 2:
            return True
    return False


def _has_other_side(net: SumoNet, edge: NetEdge) -> bool:
    """Whether traffic comes the other way beside a road; the other half of a ring runs elsewhere."""
    middle = _line(net, edge.edge_id).mean(axis=0)
    return any(
        float(np.linalg.norm(_line(net, other.edge_id).mean(axis=0) - middle)) < SIDES_APART_M
        for other in net.edges.values()
        if other is not edge and (other.from_junction, other.to_junction) == (edge.to_junction, edge.from_junction)
    )


def _line(net: SumoNet, edge: str) -> Points:
    return net.lanes[net.edges[edge].lane_ids[0]].shape


def _ring(net: SumoNet, following: dict[str, set[str]], start: str) -> list[str]:
    """The shortest cycle of one-way roads through a road, none where it is longer than a roundabout can be."""
    queue, seen = [(0.0, [start])], {start}
    while queue:
        gone, way = queue.pop(0)
        gone += float(np.linalg.norm(np.diff(_line(net, way[-1]), axis=0), axis=1).sum())
        for edge in sorted(following[way[-1]]):
            if edge == start:
                return way
            if edge not in seen and gone < LONGEST_RING_M:
                seen.add(edge)
                queue.append((gone, [*way, edge]))
        queue.sort(key=lambda entry: entry[0])
    return []


def _is_round(net: SumoNet, ring: list[str]) -> bool:
    points = np.vstack([_line(net, edge) for edge in ring])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum())
    proper_way = (area > 0) != net.lefthand
    return proper_way and 4 * math.pi * abs(area) / max(perimeter, 1.0) ** 2 > LEAST_ROUND


def lies_in(made: MadeFiles, box: Sequence[float], slack: float) -> bool:
    """Whether the middle lies in a box (south, west, north, east), up to ``slack`` outside; all in degrees."""
    south, west, north, east = box
    inside = south - slack <= made.latitude <= north + slack
    return inside and west - slack <= made.longitude <= east + slack


def lies_at_street(made: MadeFiles, street: str, places: Sequence[str], evidence: MapEvidence) -> bool:
    """Whether every part of ``street, place`` is a place that the whole map shows, or something named so is near."""
    parts = [part.strip() for part in street.split(",")]
    return all(
        part in places or evidence.names_near(part, made.latitude, made.longitude, STREET_WITHIN_M) for part in parts
    )


def holds_vehicles(made: MadeFiles, wished: dict[str, tuple[int, int | None]]) -> bool:
    """Whether every class is there in the numbers asked for: (least, most) by class."""
    counts = made.classes()
    return all(
        least <= counts[name] <= (counts[name] if most is None else most) for name, (least, most) in wished.items()
    )
