"""Whether there is a roundabout at a scenario's middle: a closed one-way ring in its net."""

import math

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.net_parser import NetEdge, SumoNet
from plannerforge.evals.made_files import MadeFiles

LONGEST_RING_M = 1_200.0
LEAST_ROUND = 0.55
"""4π·area / perimeter² of a ring: 1 is a circle, 0.785 a square; oblong roundabouts have less."""
LEAST_ENTRIES = 2
ALONG = ("s", "L", "R")
"""SUMO's words for going on along a road; a ring with a turn in it is a way about a block or across a crossing."""
REACH_M, BESIDE_M = 180.0, 30.0
"""How far the roads of a ring may be from its middle, and how far outside it the scenario's middle may lie."""
SIDES_APART_M = 12.0


def shows_roundabout(made: MadeFiles) -> bool:
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


def _is_at_middle(made: MadeFiles, ring: list[str]) -> bool:
    from shapely import Point, Polygon

    area = Polygon(np.vstack([_line(made.net, edge) for edge in ring])).buffer(0.0)
    return float(area.distance(Point(*made.middle))) < BESIDE_M


def _is_round(net: SumoNet, ring: list[str]) -> bool:
    points = np.vstack([_line(net, edge) for edge in ring])
    following = np.roll(points, -1, axis=0)
    perimeter = float(np.linalg.norm(following - points, axis=1).sum())
    area = 0.5 * float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum())
    proper_way = (area > 0) != net.lefthand
    return proper_way and 4 * math.pi * abs(area) / max(perimeter, 1.0) ** 2 > LEAST_ROUND
