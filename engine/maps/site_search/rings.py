"""Finds closed rings of one-way roads tagged as a roundabout, drawn as one or several ways.

A map may show half a ring (the other half is beyond the border, or a node of it is missing), and anything may be tagged
as a roundabout. In such cases, the network has no roundabout.
"""

import math
from collections.abc import Iterable
from heapq import heappop, heappush
from itertools import islice, pairwise

from ...geometry import wrap_angle
from ..osm import OsmMap, OsmWay, ground_distance_m
from ..road_tags.lanes import oneway_of

LONGEST_RING_M = 1_000.0
"""Maximum length around a ring (chosen): a site's cut does not contain longer ones."""
LEAST_RING_M = 23.5
"""Length of the smallest ring that a car can drive. The outer front wheel of usual cars turns on a circle of 10 m or
more; with a wheelbase of 2.6 m and a track of 1.5 m, the car's centre is then 3.75 m from the middle. Smaller circles,
such as those that calm traffic at crossings of streets, are driven as crossings."""
BACK_RAD = math.radians(150.0)
"""A road with a larger turn at one node leads back (chosen; as for egos that turn back)."""
LEAST_ENTRIES = 2
"""Minimum number of roads that lead into a roundabout (chosen)."""
MOST_NODES = 1_000
"""Maximum number of nodes examined until a ring is closed (chosen)."""
RING_TAGS = ("roundabout", "circular")
"""OSM's values of ``junction`` for roads that lead around in one direction."""


class Rings:
    """The roads of a map from node to node, to find the rings of tagged ways."""

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
        """Return the nodes of the ring that a tagged way is part of, with its beginning repeated at the end.

        The result is empty if the way is open in both directions or does not close over one-way roads, if the ring is
        longer than ``LONGEST_RING_M`` or shorter than ``LEAST_RING_M``, or if fewer than two roads lead into it. A road
        at which the ring turns back is not counted, because the ring is closed there through the exit and entry of an
        arm.
        """
        ring = self._closed(way)
        return () if self._fault(way, ring) else ring

    def fault_of(self, way: OsmWay) -> str:
        """Return why a tagged way is not part of a ring that cars drive around, or an empty string if it is."""
        return self._fault(way, self._closed(way))

    def _closed(self, way: OsmWay) -> tuple[int, ...]:
        """Return the nodes of a way, and of the shortest one-way path from its end back to its beginning, if any."""
        line = way.node_ids[::-1] if direction_of(way) < 0 else way.node_ids
        return line if line[0] == line[-1] or not direction_of(way) else (*line, *self._shortest(line))

    def _fault(self, way: OsmWay, ring: tuple[int, ...]) -> str:
        if not direction_of(way):
            return "is open in both directions"
        inside = frozenset(ring)
        if ring[0] != ring[-1] or len(inside) < 3:
            return "is not closed by one-way roads"
        if not LEAST_RING_M <= (length_m := self._length_m(ring)) <= LONGEST_RING_M:
            return f"is {length_m:.0f} m around, not {LEAST_RING_M:g} to {LONGEST_RING_M:g} m"
        back = self._turns_back(ring)
        around = (key for key in ring[1:] if key not in back)
        entries = (before for key in around for before in self._before.get(key, ()) if before not in inside)
        if len(list(islice(entries, LEAST_ENTRIES))) < LEAST_ENTRIES:
            return (
                "is closed only by turning back" if back else f"has fewer than {LEAST_ENTRIES} roads that lead into it"
            )
        return ""

    def _turns_back(self, ring: tuple[int, ...]) -> frozenset[int]:
        """Return the nodes at which a ring turns by more than ``BACK_RAD``."""
        places = {key: self._osm.nodes[key].position for key in ring}
        wide = math.cos(math.radians(places[ring[0]][0]))

        def heading(start: int, end: int) -> float:
            (south, west), (north, east) = places[start], places[end]
            return math.atan2(north - south, (east - west) * wide)

        corners = zip(ring, ring[1:], (*ring[2:], ring[1]), strict=False)
        return frozenset(
            at for before, at, after in corners if abs(wrap_angle(heading(at, after) - heading(before, at))) > BACK_RAD
        )

    def _shortest(self, line: tuple[int, ...]) -> tuple[int, ...]:
        """Return the nodes of the shortest one-way path from the end of a line back to its beginning, if any."""
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
    """Return 1 for a way driven from its first node, -1 for a way driven to it, 0 for a way in both directions.

    The result matches the cut of the way as it is written for netconvert.
    """
    return oneway_of(way.tags)
