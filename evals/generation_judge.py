"""Whether a made scenario shows the type of road, the place and the vehicles asked for; read from the made files.

Apart from the site finder: types are read off the SUMO net around the scenario's GPS position, roads off the map file.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.maps.index import same_street
from plannerforge.engine.network.net_parser import NetEdge, SumoNet, read_net
from plannerforge.engine.traffic.vehicle_classes import class_by_size

NEAR_M = 100.0
LONGEST_RING_M = 1_200.0
LEAST_ROUND = 0.55
"""4π·area / perimeter² of a ring: 1 is a circle, 0.785 a square; oblong roundabouts have less."""


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
        found = (class_by_size(kind, length) for kind, length in self.obstacles)
        return Counter(known.name for known in found if known is not None)

    def near(self, within_m: float = NEAR_M) -> list[NetEdge]:
        """Roads of the net within a distance of the middle."""
        return [edge for edge in self.net.edges.values() if not edge.internal and self._distance_m(edge) < within_m]

    def _distance_m(self, edge: NetEdge) -> float:
        lines = [self.net.lanes[lane].shape for lane in edge.lane_ids]
        points = np.vstack([np.linspace(a, b, 8) for line in lines for a, b in itertools.pairwise(line)])
        return float(np.linalg.norm(points - self.middle, axis=1).min())


def shows_type(made: MadeFiles, kind: str) -> bool:
    """Whether the roads around the middle are of the type."""
    judges: dict[str, Callable[[MadeFiles], bool]] = {
        "roundabout": _roundabout,
        "signalised_intersection": lambda made: _crossing(made, lit=True),
        "intersection": lambda made: _crossing(made, lit=False),
        "highway": lambda made: _any_class(made, ("motorway", "trunk")),
        "ramp": _ramp,
        "rural": lambda made: not _any_class(made, ("residential", "living_street", "motorway"), 40.0),
        "urban": lambda made: bool(made.near()) and not _any_class(made, ("motorway",), 40.0),
        "any": lambda made: bool(made.near()),
    }
    return judges[kind](made)


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
    both_ways = {(edge.to_junction, edge.from_junction) for edge in edges.values()}
    one_way = {k for k, e in edges.items() if (e.from_junction, e.to_junction) not in both_ways or _loop(e)}
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


def _loop(edge: NetEdge) -> bool:
    return edge.from_junction == edge.to_junction


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


def lies_at(made: MadeFiles, map_file: Path, bounds: list[float], street: str | None) -> bool:
    """Whether the middle lies on the map, and near the road named (where the map has a road or point of that name)."""
    south, west, north, east = bounds
    if not (south - 0.01 <= made.latitude <= north + 0.01 and west - 0.01 <= made.longitude <= east + 0.01):
        return False
    if street is None or any(same_street(edge.name, street) for edge in made.net.edges.values() if edge.name):
        return True
    root = etree.parse(map_file).getroot()
    places = {n.get("id"): (float(n.get("lat", "nan")), float(n.get("lon", "nan"))) for n in root.iterfind("node")}
    named = [way for way in root.iterfind("way") if way.find("tag[@k='highway']") is not None and _named(way, street)]
    points = [places[nd.get("ref")] for way in named for nd in way.iterfind("nd") if nd.get("ref") in places]
    north_m, east_m = 111_200.0, 111_200.0 * math.cos(math.radians(made.latitude))
    distances = [math.hypot((a - made.latitude) * north_m, (o - made.longitude) * east_m) for a, o in points]
    return not distances or min(distances) < 250.0


def _named(way: etree._Element, street: str) -> bool:
    values = [tag.get("v", "") for tag in way.iterfind("tag") if tag.get("k") in ("name", "ref")]
    return any(same_street(part.strip(), street) for value in values for part in value.split(";"))


def holds_vehicles(made: MadeFiles, wished: dict[str, tuple[int, int | None]]) -> bool:
    """Whether every class is there in the numbers asked for: (least, most) by class."""
    counts = made.classes()
    return all(
        least <= counts[name] <= (counts[name] if most is None else most) for name, (least, most) in wished.items()
    )
