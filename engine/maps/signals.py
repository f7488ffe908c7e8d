"""Traffic signals on the way: the nodes of roads that a driver comes to at a signal or soon after it.

Maps show signals at the junction or where drivers stop for it, and netconvert gives lights to what lies ahead of them
in the direction of travel. A signal that drivers come to after a junction is another junction's.
"""

from collections.abc import Iterable
from heapq import heapify, heappop, heappush
from itertools import pairwise

from .osm import OsmMap, OsmWay, ground_distance_m
from .rings import direction_of

AHEAD_M = 25.0
"""From a signal to the junction that it stands for: netconvert's ``tls.guess-signals.dist``."""


def nodes_at_signals(osm: OsmMap, roads: Iterable[OsmWay]) -> frozenset[int]:
    """The nodes with a traffic signal, and those to which the roads lead from one within ``AHEAD_M``."""
    onwards: dict[int, list[int]] = {}
    for way in roads:
        direction = direction_of(way)
        for one, other in pairwise(way.node_ids):
            onwards.setdefault(one, []).extend([other] if direction >= 0 else [])
            onwards.setdefault(other, []).extend([one] if direction <= 0 else [])
    waiting = [(0.0, key) for key in onwards if osm.nodes[key].tags.get("highway") == "traffic_signals"]
    heapify(waiting)
    reached: set[int] = set()
    while waiting:
        behind_m, key = heappop(waiting)
        if key in reached:
            continue
        reached.add(key)
        for other in onwards[key]:
            further_m = behind_m + ground_distance_m(osm.nodes[key].position, osm.nodes[other].position)
            if other not in reached and further_m <= AHEAD_M:
                heappush(waiting, (further_m, other))
    return frozenset(reached)
