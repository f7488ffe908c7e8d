"""Rings of one-way roads: whether a road that is tagged as a roundabout is closed, drawn as one way or as several.

A map may show half a ring (its other half lies beyond the border, or a node of it is missing), and anything may be
tagged as a roundabout; no network has one there.
"""

from collections.abc import Iterable
from heapq import heappop, heappush
from itertools import islice, pairwise

from ..osm import OsmMap, OsmWay, ground_distance_m
from ..road_tags.lanes import oneway_of

LONGEST_RING_M = 1_000.0
"""Around a ring (chosen): what is cut out around a site holds no longer one."""
LEAST_RING_M = 23.5
"""Around the smallest ring that a car can drive. Of usual cars the outer front wheel turns on a circle of 10 m or more;
with a wheelbase of 2.6 m and a track of 1.5 m, the car's centre is then 3.75 m from the middle. Smaller circles, such as
those that calm traffic at crossings of streets, are driven as crossings."""
LEAST_ENTRIES = 2
"""Roads that lead into a roundabout (chosen)."""
MOST_NODES = 1_000
"""That are looked at until a ring is closed, at most (chosen)."""
RING_TAGS = ("roundabout", "circular")
"""OSM's values of ``junction`` for roads that lead round in one direction."""


class Rings:
    """The roads of a map from node to node, asked for the rings that tagged ways belong to."""

    def __init__(self, osm: OsmMap, roads: Iterable[OsmWay]) -> None:
        self._osm = osm
        self._onwards: dict[int, list[int]] = {}
        self._before: dict[int, set[int]] = {}
        for way in roads:
            direction = direction_of(way)
            for one, other in pairwise(way.node_ids):
                start, end = (other, one) if direction < 0 else (one, other)
                self._before.setdefault(end, set()).add(start)
                if direction:
                    self._onwards.setdefault(start, []).append(end)
                else:
                    self._before.setdefault(start, set()).add(end)

    def around(self, way: OsmWay) -> tuple[int, ...]:
        """The nodes of the ring that a tagged way is part of, its beginning at the end again.

        It is empty if the way is open in both directions or does not close over one-way roads, if the ring is longer
        than ``LONGEST_RING_M`` or shorter than ``LEAST_RING_M``, or if fewer than two roads lead into it.
        """
        if not (direction := direction_of(way)):
            return ()
        line = way.node_ids[::-1] if direction < 0 else way.node_ids
        ring = line if line[0] == line[-1] else (*line, *self._shortest(line))
        inside = frozenset(ring)
        if ring[0] != ring[-1] or len(inside) < 3 or not LEAST_RING_M <= self._length_m(ring) <= LONGEST_RING_M:
            return ()
        entries = (before for key in ring[1:] for before in self._before.get(key, ()) if before not in inside)
        return ring if len(list(islice(entries, LEAST_ENTRIES))) == LEAST_ENTRIES else ()

    def _shortest(self, line: tuple[int, ...]) -> tuple[int, ...]:
        """The nodes over which one-way roads lead from the end of a line back to its beginning; none where none do."""
        paths: list[tuple[float, tuple[int, ...]]] = [(self._length_m(line), (line[-1],))]
        seen = {line[-1]}
        while paths and len(seen) < MOST_NODES:
            length_m, path = heappop(paths)
            for key in self._onwards.get(path[-1], ()):
                further_m = length_m + self._length_m((path[-1], key))
                if key == line[0]:
                    return (*path[1:], key)
                if key not in seen and further_m <= LONGEST_RING_M:
                    seen.add(key)
                    heappush(paths, (further_m, (*path, key)))
        return ()

    def _length_m(self, nodes: tuple[int, ...]) -> float:
        places = [self._osm.nodes[key].position for key in nodes]
        return sum(ground_distance_m(one, other) for one, other in pairwise(places))


def direction_of(way: OsmWay) -> int:
    """1 for a way that is driven from its first node on, -1 for one driven to it, 0 for one in both directions.

    As its cut is written for netconvert.
    """
    return oneway_of(way.tags)
