"""Cutting the surroundings of a site out of a user's SUMO network: its roads stay whole, as the user made them."""

from collections.abc import Iterable
from pathlib import Path

from plannerforge.engine.maps.net_map import NetMap
from plannerforge.engine.maps.osm_reader import OsmWay, ground_distance_m
from plannerforge.engine.network.netconvert import Conversion, run_netconvert
from plannerforge.schemas.errors import NotPossible


def cut_net(
    net: NetMap, center: tuple[float, float], radius_m: float, classes: Iterable[str], target: Path, scratch: Path
) -> Conversion:
    """Write the roads of the given classes that come within a circle around (latitude, longitude) as a network.

    Coordinates, junctions and traffic lights stay those of the whole network.

    Raises:
        NotPossible: no such road, or netconvert refuses the network.
    """
    wanted = frozenset(classes)
    near = [way for way in net.ways if way.road_class in wanted and _distance_m(net, way, center) <= radius_m]
    if not near:
        raise NotPossible("no road here is of the road_classes that were asked for", next_step="leave road_classes out")
    kept = scratch / "kept_edges.txt"
    kept.write_text("".join(f"{edge}\n" for way in near for edge in net.edges[way.way_id]), encoding="utf-8")
    options = ["--sumo-net-file", str(net.path), "--keep-edges.input-file", str(kept)]
    return run_netconvert([*options, "--offset.disable-normalization", "true"], target)


def _distance_m(net: NetMap, way: OsmWay, center: tuple[float, float]) -> float:
    """How near a road comes to a point (equirectangular, good for the size of a site)."""
    from shapely import LineString, Point

    scale = ground_distance_m(center, (center[0] + 1e-3, center[1])) / 1e-3
    scale_east = ground_distance_m(center, (center[0], center[1] + 1e-3)) / 1e-3
    nodes = [net.nodes[key] for key in way.node_ids]
    line = [((node.longitude - center[1]) * scale_east, (node.latitude - center[0]) * scale) for node in nodes]
    return float(LineString(line).distance(Point(0.0, 0.0)))
