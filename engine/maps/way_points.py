"""The length of a way, and points evenly spaced along it."""

from itertools import pairwise

from plannerforge.engine.maps.osm_reader import OsmMap, OsmNode, OsmWay, distance_m

SPACING_M = 400.0


def length_m(osm: OsmMap, way: OsmWay) -> float:
    """Length on the ground."""
    nodes = [osm.nodes[key] for key in way.node_ids]
    return sum(distance_m(one, other) for one, other in pairwise(nodes))


def spaced_points(osm: OsmMap, way: OsmWay) -> list[OsmNode]:
    """Points evenly spaced along a way, one for every ``SPACING_M`` and at least one, the ends left out."""
    nodes = [osm.nodes[key] for key in way.node_ids]
    total = length_m(osm, way)
    count = max(1, round(total / SPACING_M))
    found: list[OsmNode] = []
    gone = 0.0
    for one, other in pairwise(nodes):
        step = distance_m(one, other)
        while len(found) < count and gone + step >= (wanted := total * (len(found) + 0.5) / count) - 1e-6:
            share = (wanted - gone) / max(step, 1e-9)
            latitude = one.latitude + share * (other.latitude - one.latitude)
            longitude = one.longitude + share * (other.longitude - one.longitude)
            found.append(OsmNode(0, latitude, longitude, {}))
        gone += step
    return found
