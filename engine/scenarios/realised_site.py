"""Whether a site has become in the net what the map promised: judged before traffic is made for it."""

from collections.abc import Callable

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.maps.road_classes import LINKS, ROADS
from plannerforge.engine.maps.sites import RURAL_CLASSES, Site
from plannerforge.engine.network.net_parser import NetEdge, SumoNet
from plannerforge.schemas.generation import SiteType

AT_M, NEAR_M = 40.0, 60.0
"""From the middle of a site to its road, and to its junction: sites that lie so close together are one."""
LEAST_ENTRIES = 2
RING_CLEAR_M = 15.0
LEAST_ARMS = 3
ALL_ROADS = frozenset((*ROADS, *LINKS))
FAST_ROADS = frozenset({"motorway", "trunk"})
RAMP_LINKS = frozenset({"motorway_link", "trunk_link"})


def middle_of(site: Site, net: SumoNet) -> Points:
    """The middle of the site in the net's coordinates, shape (2,)."""
    from pyproj import Proj

    if not net.projection:
        return np.zeros(2)
    x, y = Proj(net.projection)(site.longitude, site.latitude)
    return np.array([x + net.offset_m[0], y + net.offset_m[1]])


def why_not_realised(site: Site, net: SumoNet) -> str | None:
    """The reason why the net does not show the site's type near its middle; None where it does."""
    middle = middle_of(site, net)
    judges: dict[SiteType, Callable[[], bool]] = {
        "roundabout": lambda: any(is_ring_at(net, middle, ring) for ring in net.roundabout_edges),
        "signalised_intersection": lambda: any(is_lit(net, key) for key in junctions_near(net, middle)),
        "intersection": lambda: bool(junctions_near(net, middle)),
        "ramp": lambda: _ramp_near(net, middle),
        "highway": lambda: _passes(net, middle, AT_M, _one_of(net, FAST_ROADS)),
        "rural": lambda: _passes(net, middle, AT_M, _none_of(net, ALL_ROADS - RURAL_CLASSES)),
        "urban": lambda: _passes(net, middle, NEAR_M, _none_of(net, FAST_ROADS | frozenset(LINKS))),
    }
    if judges[site.kind]():
        return None
    return f"the {site.kind} at {site.latitude:.5f}, {site.longitude:.5f} is lost when the road network is built"


def road_classes(edge: NetEdge) -> frozenset[str]:
    """OSM's ``highway`` values of an edge; several where netconvert joined roads."""
    return frozenset(part.removeprefix("highway.") for part in edge.road_type.split("|"))


def _one_of(net: SumoNet, classes: frozenset[str]) -> Callable[[str], bool]:
    return lambda edge: bool(road_classes(net.edges[edge]) & classes)


def _none_of(net: SumoNet, classes: frozenset[str]) -> Callable[[str], bool]:
    """Roads of other classes, and those of a user's network that say nothing of theirs."""
    return lambda edge: bool(road_classes(net.edges[edge]) - classes)


def _passes(net: SumoNet, middle: Points, within_m: float, wanted: Callable[[str], bool]) -> bool:
    """Whether a road that is wanted comes so near to the middle."""
    lanes = (lane for lane in net.lanes.values() if not lane.internal and wanted(lane.edge_id))
    return any(float(np.linalg.norm(_dense(lane.shape) - middle, axis=1).min()) < within_m for lane in lanes)


def is_ring_at(net: SumoNet, middle: Points, ring: tuple[str, ...]) -> bool:
    """Whether a ring is closed, has roads that lead into it, and surrounds the middle or passes near it."""
    inside = frozenset(ring) & frozenset(net.edges)
    onward = {turn.from_edge for turn in net.connections if turn.from_edge in inside and turn.to_edge in inside}
    entries = {
        turn.from_edge for turn in net.connections if turn.to_edge in inside and turn.from_edge not in inside
    } & {edge.edge_id for edge in net.edges.values() if not edge.internal}
    if onward != frozenset(ring) or len(entries) < LEAST_ENTRIES:
        return False
    line = np.vstack([net.lanes[net.edges[edge].lane_ids[0]].shape for edge in ring])
    center = (line.min(axis=0) + line.max(axis=0)) / 2
    reach = float(np.linalg.norm(line - center, axis=1).max()) + RING_CLEAR_M
    return float(np.linalg.norm(middle - center)) < reach


def junctions_near(net: SumoNet, middle: Points) -> list[str]:
    """Junctions near the middle at which three roads or more meet, not only motorways; links left out."""
    roads = [edge for edge in net.edges.values() if not edge.internal and road_classes(edge) - frozenset(LINKS)]
    around: dict[str, list[NetEdge]] = {}
    near: dict[str, None] = {}
    for edge in roads:
        line = net.lanes[edge.lane_ids[0]].shape
        for junction, end in ((edge.from_junction, line[0]), (edge.to_junction, line[-1])):
            around.setdefault(junction, []).append(edge)
            if float(np.linalg.norm(end - middle)) < NEAR_M:
                near[junction] = None
    return [key for key in near if _is_crossing(key, around[key])]


def _is_crossing(junction: str, roads: list[NetEdge]) -> bool:
    arms = {
        (edge.from_junction if edge.to_junction == junction else edge.to_junction, edge.edge_id.lstrip("-"))
        for edge in roads
    }
    return len(arms) >= LEAST_ARMS and not all(road_classes(edge) <= FAST_ROADS for edge in roads)


def is_lit(net: SumoNet, junction: str) -> bool:
    """Whether a junction has traffic lights."""
    return net.junction_types.get(junction, "").startswith("traffic_light")


def _ramp_near(net: SumoNet, middle: Points) -> bool:
    """Whether a link leaves or joins a motorway or trunk road near the middle."""
    for turn in net.connections:
        ends = [road_classes(net.edges[key]) for key in (turn.from_edge, turn.to_edge)]
        joins = any(one & FAST_ROADS and other & RAMP_LINKS for one, other in (ends, ends[::-1]))
        if joins and float(np.linalg.norm(net.lanes[turn.from_lane].shape[-1] - middle)) < NEAR_M:
            return True
    return False


def _dense(line: Points) -> Points:
    steps = np.linspace(0.0, 1.0, 9)[:, None, None]
    return ((1 - steps) * line[None, :-1] + steps * line[None, 1:]).reshape(-1, 2) if len(line) > 1 else line
