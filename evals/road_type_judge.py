"""Whether the roads at a scenario's middle are of the type asked for: read from its net and from the map file.

Apart from the site finder and from what the generator checks itself: nothing of theirs is imported.
"""

import math
from collections.abc import Callable

from plannerforge.engine.geometry.polyline import Points, point_at, wrap_angle
from plannerforge.engine.network.net_parser import NetEdge, SumoNet
from plannerforge.evals.made_files import MadeFiles
from plannerforge.evals.map_evidence import MapEvidence
from plannerforge.evals.ring_judge import shows_roundabout

AT_M, BESIDE_M, JUNCTION_M = 25.0, 40.0, 60.0
"""On the road that the middle lies on, with both carriageways; beside it; at its junction: signs of one place lie so
far apart that is one site."""
TOWN_M = 100.0
FAST_KMH, SLOW_KMH = 80.0, 60.0
"""Limits from which on a road is not in a town, and below which it is, whatever else lies there."""
STREETS = frozenset({"residential", "living_street", "pedestrian"})
FAST_CLASSES = frozenset({"motorway", "trunk"})
LIGHTS = ("traffic_light", "traffic_light_right_on_red", "traffic_light_unregulated")
ARM_M = 25.0
SAME_ROAD_RAD, SAME_ARM_RAD = math.radians(45.0), math.radians(15.0)


def shows_type(made: MadeFiles, kind: str, evidence: MapEvidence) -> bool:
    """Whether the roads at the middle are of the type; what is town and what country, the map file tells."""
    judges: dict[str, Callable[[], bool]] = {
        "roundabout": lambda: shows_roundabout(made),
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
