"""Whether a made scenario shows what was asked for: type of road, density, place, vehicles.

Read from the made files and from the map file, apart from the site finder and from what the generator checks itself:
nothing of theirs is imported. ``MadeFiles`` is a scenario as the judges see it.
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

    def near(self, within_m: float) -> list[NetEdge]:
        """Roads of the net that come so near to the middle."""
        return [edge for edge in self.net.edges.values() if not edge.internal and self._distance_m(edge) < within_m]

    def is_near(self, point: Points, within_m: float) -> bool:
        """Whether a point (2,) lies so near to the middle."""
        return float(np.linalg.norm(point - self.middle)) < within_m

    def _distance_m(self, edge: NetEdge) -> float:
        lines = [self.net.lanes[lane].shape for lane in edge.lane_ids]
        points = np.vstack([np.linspace(a, b, 8) for line in lines for a, b in itertools.pairwise(line)])
        return float(np.linalg.norm(points - self.middle, axis=1).min())


AT_M, BESIDE_M, JUNCTION_M = 25.0, 40.0, 60.0
"""On the road that the middle lies on, with both carriageways; beside it; at its junction: signs of one place lie so
far apart that is one site."""
TOWN_M = 100.0
"""Around the middle, in which streets with houses or built-up land make a town."""
FAST_KMH, SLOW_KMH = 80.0, 60.0
"""Limits from which on a road is not in a town, and below which it is, whatever else lies there."""
TOLD_BY_TAGS = frozenset({"highway", "ramp", "rural", "urban"})
"""Types of sites that the tags of the map tell; those of junctions are seen on the net alone."""
STREETS = frozenset({"residential", "living_street", "pedestrian"})
FAST_CLASSES = frozenset({"motorway", "trunk"})
LIGHTS = ("traffic_light", "traffic_light_right_on_red", "traffic_light_unregulated")
"""SUMO's types of junctions with traffic lights."""
ARM_M = 25.0
"""From the junction to the point that gives the bearing of an arm."""
SAME_ROAD_RAD, SAME_ARM_RAD = math.radians(45.0), math.radians(15.0)
"""Carriageways of one name, and of any, whose bearings differ by less are one arm."""


def shows_type(made: MadeFiles, kind: str, evidence: MapEvidence) -> bool:
    """Whether the roads at the middle are of the type; what is town and what country, the map file tells."""
    judges: dict[str, Callable[[], bool]] = {
        "roundabout": lambda: _shows_roundabout(made),
        "signalised_intersection": lambda: _crossing(made, lit=True),
        "intersection": lambda: _crossing(made, lit=False),
        "highway": lambda: _highway(made, evidence),
        "ramp": lambda: _ramp(made, evidence),
        "rural": lambda: _rural(made, evidence),
        "urban": lambda: _beside_a_road(made) and _in_town(made, evidence),
    }
    return judges[kind]()


def _classes(edge: NetEdge) -> frozenset[str]:
    return frozenset(part.removeprefix("highway.") for part in edge.road_type.split("|"))


def _is_link(edge: NetEdge) -> bool:
    return all(name.endswith("_link") for name in _classes(edge))


def _any_class(made: MadeFiles, classes: frozenset[str], within_m: float) -> bool:
    return any(_classes(edge) & classes for edge in made.near(within_m))


def _beside_a_road(made: MadeFiles) -> bool:
    """Whether the middle lies beside a road that is neither a motorway nor a link, and no motorway passes."""
    roads = [edge for edge in made.near(BESIDE_M) if not _is_link(edge)]
    return bool(roads) and not any("motorway" in _classes(edge) for edge in roads)


def _in_town(made: MadeFiles, evidence: MapEvidence) -> bool:
    """By the limits where they leave no doubt, otherwise by streets with houses and built-up land."""
    spot = (made.latitude, made.longitude)
    limits = evidence.limits_kmh(*spot, BESIDE_M)
    if max(limits, default=0.0) >= FAST_KMH:
        return False
    slow = min(limits, default=math.inf) < SLOW_KMH
    return slow or _any_class(made, STREETS, TOWN_M) or evidence.is_built_up(*spot, TOWN_M)


def _rural(made: MadeFiles, evidence: MapEvidence) -> bool:
    """Beside a road of the country, off ramps."""
    ramp = any(_is_link(edge) for edge in made.near(BESIDE_M))
    return _beside_a_road(made) and not ramp and not _in_town(made, evidence)


def _highway(made: MadeFiles, evidence: MapEvidence) -> bool:
    """A motorway at the middle; where the whole map has none, a trunk road with a limit above that of a main road."""
    limits = evidence.limits_kmh(made.latitude, made.longitude, AT_M)
    trunk = _is_trunk_for_motorway(evidence) and max(limits, default=0.0) >= FAST_KMH
    return _any_class(made, FAST_CLASSES if trunk else frozenset({"motorway"}), AT_M)


def _is_trunk_for_motorway(evidence: MapEvidence) -> bool:
    return not evidence.holds("highway", "motorway")


def _ramp(made: MadeFiles, evidence: MapEvidence) -> bool:
    """A link road that leaves or joins a motorway at the middle; a trunk road where the whole map has no motorway.

    Where a motorway becomes a trunk road at the junction of the link, the link may lead to that.
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
    """A junction of three arms at the middle, not only of motorways, with lights where they are asked for."""
    junctions = {
        junction
        for edge in made.near(JUNCTION_M)
        for junction, end in ((edge.from_junction, 0), (edge.to_junction, -1))
        if made.is_near(_line(made.net, edge)[end], JUNCTION_M)
    }
    kinds = made.net.junction_types
    return any(_arms(made.net, key) >= 3 and (not lit or kinds.get(key, "") in LIGHTS) for key in junctions)


def _arms(net: SumoNet, junction: str) -> int:
    """Directions in which roads lie around a junction, links left out; none where all are motorways or trunk roads.

    The carriageways of a road are one arm: they bear one name and lie in about one direction.
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
"""Longer cycles of one-way roads are no roundabout (chosen)."""
LEAST_ROUND = 0.55
"""4π·area / perimeter² of a ring: 1 is a circle, 0.785 a square; oblong roundabouts have less."""
LEAST_ENTRIES = 2
"""Roads that lead into a roundabout."""
ALONG = ("s", "L", "R")
"""SUMO's words for going on along a road; a ring with a turn in it leads about a block or across a crossing."""
REACH_M, RING_BESIDE_M = 180.0, 30.0
"""How far the roads of a ring may be from its middle, and how far outside it the scenario's middle may lie."""
SIDES_APART_M = 12.0
"""Between the middles of both directions of a road; the other half of a ring is farther off."""


def _shows_roundabout(made: MadeFiles) -> bool:
    """Whether a closed one-way ring surrounds the middle or passes by it, with at least two roads leading in.

    It has to be driven round the proper way: against the clock where traffic keeps right.
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
    """Whether oncoming traffic has a road beside this one; the other half of a ring runs elsewhere."""
    middle = _line(net, edge).mean(axis=0)
    return any(
        float(np.linalg.norm(_line(net, other).mean(axis=0) - middle)) < SIDES_APART_M
        for other in net.edges.values()
        if other is not edge and (other.from_junction, other.to_junction) == (edge.to_junction, edge.from_junction)
    )


def _ring(net: SumoNet, following: dict[str, set[str]], start: str) -> list[str]:
    """The shortest cycle of one-way roads through a road, none where it is longer than a roundabout can be."""
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
    return float(area.distance(Point(*made.middle))) < RING_BESIDE_M


def _is_round(net: SumoNet, ring: list[str]) -> bool:
    points = np.vstack([_line(net, net.edges[edge]) for edge in ring])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum())
    proper_way = (area > 0) != net.lefthand
    return proper_way and 4 * math.pi * abs(area) / max(perimeter, 1.0) ** 2 > LEAST_ROUND


TARGETS: Mapping[Density, float] = {"low": 7.0, "medium": 16.0, "high": 28.0}
"""Vehicles per kilometre of lane, as ``docs/generation.md`` promises them."""
_WITHIN = 0.25
"""Of the target, a density counts as met (chosen)."""
_STATED = "density missed"
"""Stands in the note of a generation that misses its density."""


@dataclass(frozen=True)
class DensityVerdict:
    """Vehicles per kilometre of lane at the start, the ego included, beside the target; whether a miss is stated."""

    target: float
    found: float
    stated: bool

    @property
    def met(self) -> bool:
        """Within a quarter of the target."""
        return abs(self.found - self.target) <= _WITHIN * self.target

    @property
    def honest(self) -> bool:
        """Met, or missed with the reason in a note."""
        return self.met or self.stated


def judge_density(made: MadeFiles, asked: Density, notes: Sequence[str]) -> DensityVerdict:
    """Count the obstacles and the ego on the lanes of the net that cars may use, insides of junctions left out."""
    found = (len(made.obstacles) + 1) / _lane_km(made.net)
    return DensityVerdict(TARGETS[asked], round(found, 2), any(_STATED in note for note in notes))


def _lane_km(net: SumoNet) -> float:
    shapes = [lane.shape for lane in net.lanes.values() if "passenger" in lane.allowed and not lane.internal]
    return sum(float(np.linalg.norm(np.diff(shape, axis=0), axis=1).sum()) for shape in shapes) / 1000


STREET_WITHIN_M, EXIT_WITHIN_M = 100.0, 200.0
"""How far the road may be that a site is called after; an exit is called after the road that it leads to, too."""


def lies_in(made: MadeFiles, box: Sequence[float], slack: float) -> bool:
    """Whether the middle lies in a box (south, west, north, east), up to ``slack`` outside; all in degrees."""
    south, west, north, east = box
    inside = south - slack <= made.latitude <= north + slack
    return inside and west - slack <= made.longitude <= east + slack


def lies_at_street(
    made: MadeFiles, street: str, places: Sequence[str], evidence: MapEvidence, within_m: float = STREET_WITHIN_M
) -> bool:
    """Whether every part of ``street, place`` is a place that the whole map shows, or something named so is near."""
    parts = [part.strip() for part in street.split(",")]
    return all(part in places or evidence.names_near(part, made.latitude, made.longitude, within_m) for part in parts)


def holds_vehicles(made: MadeFiles, required: dict[str, tuple[int, int | None]]) -> bool:
    """Whether every class is there in the numbers asked for: (least, most) by class."""
    counts = made.classes()
    return all(
        least <= counts[name] <= (counts[name] if most is None else most) for name, (least, most) in required.items()
    )
