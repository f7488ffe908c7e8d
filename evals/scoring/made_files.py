"""Checks whether a generated scenario has the requested type of road, density, place and vehicles.

It reads the generated files and the map file, without importing the site finder or the generator's own checks.
``MadeFiles`` is a scenario from the judges' point of view.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from ...engine.geometry import Points, point_at, wrap_angle
from ...engine.network import NetEdge, SumoNet, read_net
from ...schemas.generation import Density
from .map_evidence import MapEvidence

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
"""CommonRoad's type of each class, and the lengths in m (from, below) that distinguish classes of one type."""


@dataclass(frozen=True)
class MadeFiles:
    """A generated scenario: its net, its centre in m in the net and in degrees, its obstacles as (type, length)."""

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
        """Return the number of vehicles by class, excluding the ego."""
        return Counter(
            name
            for kind, length in self.obstacles
            for name, (of_kind, shortest, longest) in SIZES.items()
            if kind == of_kind and shortest <= length < longest
        )

    def near(self, within_m: float) -> list[NetEdge]:
        """Return the roads of the net within a distance of the scenario's centre."""
        return [edge for edge in self.net.edges.values() if not edge.internal and self._distance_m(edge) < within_m]

    def is_near(self, point: Points, within_m: float) -> bool:
        """Return whether a point (2,) is within a distance of the scenario's centre."""
        return float(np.linalg.norm(point - self.middle)) < within_m

    def _distance_m(self, edge: NetEdge) -> float:
        lines = [self.net.lanes[lane].shape for lane in edge.lane_ids]
        points = np.vstack([np.linspace(a, b, 8) for line in lines for a, b in itertools.pairwise(line)])
        return float(np.linalg.norm(points - self.middle, axis=1).min())


AT_M, NEARBY_M, JUNCTION_M = 25.0, 40.0, 60.0
"""Distances from the middle: on its road, with both carriageways; next to it; at its junction. Sites closer than this
are one site.
"""
TOWN_M = 100.0
"""Radius around the middle in which streets with houses or built-up land indicate a town."""
FAST_KMH, SLOW_KMH = 80.0, 60.0
"""Limits above which a road is outside towns, and below which it is in a town, regardless of its surroundings."""
SHOWN_BY_TAGS = frozenset({"highway", "ramp", "rural", "urban"})
"""Types of sites determined from the tags of the map; those of junctions follow from the net alone."""
STREETS = frozenset({"residential", "living_street", "pedestrian"})
FAST_CLASSES = frozenset({"motorway", "trunk"})
LIGHTS = ("traffic_light", "traffic_light_right_on_red", "traffic_light_unregulated")
"""SUMO's types of junctions with traffic lights."""
ARM_M = 25.0
"""Distance from the junction to the point that determines the bearing of an arm."""
SAME_ROAD_RAD, SAME_ARM_RAD = math.radians(45.0), math.radians(15.0)
"""Carriageways of one name, and of any, with a smaller difference of bearings are one arm."""


def shows_type(made: MadeFiles, kind: str, evidence: MapEvidence) -> bool:
    """Return whether the roads at the centre match the site type; the map file distinguishes urban from rural."""
    judges: dict[str, Callable[[], bool]] = {
        "roundabout": lambda: _shows_roundabout(made),
        "signalised_intersection": lambda: _crossing(made, lit=True),
        "intersection": lambda: _crossing(made, lit=False),
        "highway": lambda: _highway(made, evidence),
        "ramp": lambda: _ramp(made, evidence),
        "rural": lambda: _rural(made, evidence),
        "urban": lambda: _near_a_road(made) and _in_town(made, evidence),
    }
    return judges[kind]()


def _classes(edge: NetEdge) -> frozenset[str]:
    return frozenset(part.removeprefix("highway.") for part in edge.road_type.split("|"))


def _is_link(edge: NetEdge) -> bool:
    return all(name.endswith("_link") for name in _classes(edge))


def _any_class(made: MadeFiles, classes: frozenset[str], within_m: float) -> bool:
    return any(_classes(edge) & classes for edge in made.near(within_m))


def _near_a_road(made: MadeFiles) -> bool:
    """Return whether an ordinary road, but no motorway, is near the scenario's centre; links do not count."""
    roads = [edge for edge in made.near(NEARBY_M) if not _is_link(edge)]
    return bool(roads) and not any("motorway" in _classes(edge) for edge in roads)


def _in_town(made: MadeFiles, evidence: MapEvidence) -> bool:
    """Return whether the scenario is in a town: by clear limits, otherwise by streets with houses and built-up land."""
    spot = (made.latitude, made.longitude)
    limits = evidence.limits_kmh(*spot, NEARBY_M)
    if max(limits, default=0.0) >= FAST_KMH:
        return False
    slow = min(limits, default=math.inf) < SLOW_KMH
    return slow or _any_class(made, STREETS, TOWN_M) or evidence.is_built_up(*spot, TOWN_M)


def _rural(made: MadeFiles, evidence: MapEvidence) -> bool:
    """Return whether the scenario is near a country road, and not at a ramp."""
    ramp = any(_is_link(edge) for edge in made.near(NEARBY_M))
    return _near_a_road(made) and not ramp and not _in_town(made, evidence)


def _highway(made: MadeFiles, evidence: MapEvidence) -> bool:
    """Return whether there is a motorway at the scenario's centre; on a map without motorways, a fast trunk road
    counts.
    """
    limits = evidence.limits_kmh(made.latitude, made.longitude, AT_M)
    trunk = _is_trunk_for_motorway(evidence) and max(limits, default=0.0) >= FAST_KMH
    return _any_class(made, FAST_CLASSES if trunk else frozenset({"motorway"}), AT_M)


def _is_trunk_for_motorway(evidence: MapEvidence) -> bool:
    return not evidence.holds("highway", "motorway")


def _ramp(made: MadeFiles, evidence: MapEvidence) -> bool:
    """Return whether a link leaves or joins a motorway (or else a trunk road) at the scenario's centre.

    If a motorway becomes a trunk road at the junction of the link, the link may lead to the trunk road.
    """
    net, links = made.net, {"motorway_link", "trunk_link"}
    roads = [edge for edge in net.edges.values() if not edge.internal]
    at_motorway = {
        key for edge in roads if "motorway" in _classes(edge) for key in (edge.from_junction, edge.to_junction)
    }
    for turn in net.connections:
        here, there = net.edges[turn.from_edge], net.edges[turn.to_edge]
        one, other = _classes(here), _classes(there)
        joins = (one & FAST_CLASSES and other & links) or (one & links and other & FAST_CLASSES)
        at_main = here.to_junction in at_motorway or _is_trunk_for_motorway(evidence)
        if joins and at_main and made.is_near(net.lanes[turn.from_lane].shape[-1], JUNCTION_M):
            return True
    return False


def _crossing(made: MadeFiles, *, lit: bool) -> bool:
    """Return whether there is a junction with at least three arms at the scenario's centre, with lights if required."""
    junctions = {
        junction
        for edge in made.near(JUNCTION_M)
        for junction, end in ((edge.from_junction, 0), (edge.to_junction, -1))
        if made.is_near(_line(made.net, edge)[end], JUNCTION_M)
    }
    kinds = made.net.junction_types
    return any(_arms(made.net, key) >= 3 and (not lit or kinds.get(key, "") in LIGHTS) for key in junctions)


def _arms(net: SumoNet, junction: str) -> int:
    """Count the directions of roads around a junction, without links; 0 if all are motorways or trunk roads.

    The carriageways of a road are one arm: they share a name and roughly a direction.
    """
    arms: list[tuple[str, float]] = []
    fast: list[bool] = []
    for edge in net.edges.values():
        if edge.internal or _is_link(edge) or junction not in (edge.from_junction, edge.to_junction):
            continue
        fast.append(_classes(edge) <= FAST_CLASSES)
        line = _line(net, edge)
        bearing = _bearing(line if edge.from_junction == junction else line[::-1])
        if not any(_is_one_arm((edge.name, bearing), arm) for arm in arms):
            arms.append((edge.name, bearing))
    return 0 if all(fast) else len(arms)


def _is_one_arm(one: tuple[str, float], other: tuple[str, float]) -> bool:
    apart = abs(wrap_angle(one[1] - other[1]))
    return apart < SAME_ARM_RAD or (one[0] == other[0] != "" and apart < SAME_ROAD_RAD)


def _bearing(line: Points) -> float:
    ahead = point_at(line, ARM_M)[0] - line[0]
    return math.atan2(float(ahead[1]), float(ahead[0]))


def _line(net: SumoNet, edge: NetEdge) -> Points:
    return net.lanes[edge.lane_ids[0]].shape


LONGEST_RING_M = 1_200.0
"""Longer cycles of one-way roads are not roundabouts (chosen)."""
LEAST_ROUND = 0.55
"""4π·area / perimeter² of a ring: 1 is a circle, 0.785 a square; oblong roundabouts have less."""
LEAST_ENTRIES = 2
"""Minimum number of roads that lead into a roundabout."""
ALONG = ("s", "L", "R")
"""SUMO's letters for continuing along a road; a ring with a turn leads around a block or across an intersection."""
REACH_M, RING_NEARBY_M = 180.0, 30.0
"""Maximum distance of a ring's roads from its middle, and of the scenario's middle from the ring."""
SIDES_APART_M = 12.0
"""Maximum distance between the middles of the two directions of a road; the other half of a ring is farther away."""


def _shows_roundabout(made: MadeFiles) -> bool:
    """Return whether a one-way ring with at least two entries surrounds the scenario's centre or is close to it.

    Traffic on it must circulate in the correct direction: counter-clockwise in right-hand traffic.
    """
    edges = {key: edge for key, edge in made.net.edges.items() if not edge.internal}
    one_way = {key for key, edge in edges.items() if not _has_other_side(made.net, edge)}
    following: dict[str, set[str]] = {key: set() for key in one_way}
    entering: dict[str, set[str]] = {key: set() for key in one_way}
    for connection in made.net.connections:
        if connection.to_edge in one_way and connection.from_edge in edges:
            entering[connection.to_edge].add(connection.from_edge)
            if connection.from_edge in one_way and connection.direction in ALONG:
                following[connection.from_edge].add(connection.to_edge)
    for start in sorted(edge.edge_id for edge in made.near(REACH_M) if edge.edge_id in one_way):
        ring = _ring(made.net, following, start)
        entries = {edge for key in ring for edge in entering[key]} - set(ring)
        if len(entries) >= LEAST_ENTRIES and _is_round(made.net, ring) and _is_at_middle(made, ring):
            return True
    return False


def _has_other_side(net: SumoNet, edge: NetEdge) -> bool:
    """Return whether oncoming traffic has a parallel road; the other half of a ring runs elsewhere."""
    middle = _line(net, edge).mean(axis=0)
    return any(
        float(np.linalg.norm(_line(net, other).mean(axis=0) - middle)) < SIDES_APART_M
        for other in net.edges.values()
        if other is not edge and (other.from_junction, other.to_junction) == (edge.to_junction, edge.from_junction)
    )


def _ring(net: SumoNet, following: dict[str, set[str]], start: str) -> list[str]:
    """Return the shortest cycle of one-way roads through a road; empty if it is too long for a roundabout."""
    queue, seen = [(0.0, [start])], {start}
    while queue:
        length_m, route = queue.pop(0)
        length_m += float(np.linalg.norm(np.diff(_line(net, net.edges[route[-1]]), axis=0), axis=1).sum())
        for edge in sorted(following[route[-1]]):
            if edge == start:
                return route
            if edge not in seen and length_m < LONGEST_RING_M:
                seen.add(edge)
                queue.append((length_m, [*route, edge]))
        queue.sort(key=lambda entry: entry[0])
    return []


def _is_at_middle(made: MadeFiles, ring: list[str]) -> bool:
    from shapely import Point, Polygon

    area = Polygon(np.vstack([_line(made.net, made.net.edges[edge]) for edge in ring])).buffer(0.0)
    return float(area.distance(Point(*made.middle))) < RING_NEARBY_M


def _is_round(net: SumoNet, ring: list[str]) -> bool:
    points = np.vstack([_line(net, net.edges[edge]) for edge in ring])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum())
    proper_way = (area > 0) != net.lefthand
    return proper_way and 4 * math.pi * abs(area) / max(perimeter, 1.0) ** 2 > LEAST_ROUND


TARGETS: Mapping[Density, float] = {"low": 7.0, "medium": 16.0, "high": 28.0}
"""Vehicles per kilometre of lane, as promised in ``docs/generation.md``."""
_WITHIN = 0.25
"""Share of the target within which a density counts as met (chosen)."""
_STATED = "than the requested"
"""Occurs in the note of a generation that misses its density."""


@dataclass(frozen=True)
class DensityVerdict:
    """Vehicles per kilometre of lane at the start, including the ego; ``stated``: whether the answer admits a miss."""

    target: float
    found: float
    stated: bool

    @property
    def met(self) -> bool:
        """Whether the density found is within a quarter of the target."""
        return abs(self.found - self.target) <= _WITHIN * self.target

    @property
    def honest(self) -> bool:
        """Whether the target is met, or is missed with the reason in a note."""
        return self.met or self.stated


def judge_density(made: MadeFiles, requested: Density, notes: Sequence[str]) -> DensityVerdict:
    """Return the verdict on the density: obstacles plus ego per km of car lanes outside junctions."""
    found = (len(made.obstacles) + 1) / _lane_km(made.net)
    return DensityVerdict(TARGETS[requested], round(found, 2), any(_STATED in note for note in notes))


def _lane_km(net: SumoNet) -> float:
    shapes = [lane.shape for lane in net.lanes.values() if "passenger" in lane.allowed and not lane.internal]
    return sum(float(np.linalg.norm(np.diff(shape, axis=0), axis=1).sum()) for shape in shapes) / 1000


STREET_WITHIN_M, EXIT_WITHIN_M = 100.0, 200.0
"""Maximum distance of the road that names a site; an exit is also named after the road that it leads to."""


def is_in_box(made: MadeFiles, box: Sequence[float], slack: float) -> bool:
    """Return whether the site's centre is at most ``slack`` outside a box (south, west, north, east); in degrees."""
    south, west, north, east = box
    inside = south - slack <= made.latitude <= north + slack
    return inside and west - slack <= made.longitude <= east + slack


def is_at_street(
    made: MadeFiles, street: str, places: Sequence[str], evidence: MapEvidence, within_m: float = STREET_WITHIN_M
) -> bool:
    """Return whether every part of ``street, place`` is a place of the map, or has a match of that name nearby."""
    parts = [part.strip() for part in street.split(",")]
    return all(part in places or evidence.names_near(part, made.latitude, made.longitude, within_m) for part in parts)


def has_vehicles(made: MadeFiles, required: dict[str, tuple[int, int | None]]) -> bool:
    """Return whether every class is present in the required numbers: (minimum, maximum) by class."""
    counts = made.classes()
    return all(
        least <= counts[name] <= (counts[name] if most is None else most) for name, (least, most) in required.items()
    )
