"""Whether a site has become in the net what the map promised: judged before traffic is made for it."""

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.maps.sites import Site
from plannerforge.engine.network.net_parser import NetEdge, SumoNet
from plannerforge.engine.network.road_network import RoadNetwork

NEAR_M = 80.0
LARGEST_RING_M = 160.0


def middle_of(site: Site, net: SumoNet) -> Points:
    """The middle of the site in the net's coordinates, shape (2,)."""
    from pyproj import Proj

    if not net.projection:
        return np.zeros(2)
    x, y = Proj(net.projection)(site.longitude, site.latitude)
    return np.array([x + net.offset_m[0], y + net.offset_m[1]])


def why_not_realised(site: Site, net: SumoNet, network: RoadNetwork) -> str | None:
    """The reason why the net does not show the site's type near its middle; None where it does."""
    middle = middle_of(site, net)
    shown = {
        "roundabout": lambda: _near_edges(
            net, {e for ring in net.roundabout_edges for e in ring}, middle, LARGEST_RING_M
        ),
        "signalised_intersection": lambda: any(
            np.linalg.norm(light.position - middle) < NEAR_M for light in network.lights
        ),
        "ramp": lambda: _near_edges(net, _classes(net, "_link"), middle, NEAR_M),
        "highway": lambda: _near_edges(net, _classes(net, "motorway") | _classes(net, "trunk"), middle, NEAR_M),
    }.get(site.kind)
    if shown is None or shown():
        return None
    return f"the {site.kind} at {site.latitude:.5f}, {site.longitude:.5f} is lost when the road network is built"


def _classes(net: SumoNet, ending: str) -> set[str]:
    return {edge.edge_id for edge in net.edges.values() if any(c.endswith(ending) for c in road_classes(edge))}


def road_classes(edge: NetEdge) -> frozenset[str]:
    """OSM's ``highway`` values of an edge; several where netconvert joined roads."""
    return frozenset(part.removeprefix("highway.") for part in edge.road_type.split("|"))


def _near_edges(net: SumoNet, edges: set[str], middle: Points, within_m: float) -> bool:
    lanes = (
        lane for edge in sorted(edges) if edge in net.edges for lane in map(net.lanes.get, net.edges[edge].lane_ids)
    )
    return any(
        lane is not None and float(np.linalg.norm(_dense(lane.shape) - middle, axis=1).min()) < within_m
        for lane in lanes
    )


def _dense(line: Points) -> Points:
    steps = np.linspace(0.0, 1.0, 9)[:, None, None]
    return ((1 - steps) * line[None, :-1] + steps * line[None, 1:]).reshape(-1, 2) if len(line) > 1 else line
