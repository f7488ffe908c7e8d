"""Determines the pavements of roads from a map, and guesses them if the map has no information.

A map states pavements in tags of the road (``sidewalk``), or draws them as separate ways. If it does neither, streets
in towns get pavements, because hardly any street in a town lacks them. A note reports how much is guessed.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

from ..osm import EARTH_RADIUS_M, HALF_TURN_DEG, OsmMap, OsmNode, OsmWay, ground_distance_m
from ..site_search.rings import RING_TAGS

if TYPE_CHECKING:
    from shapely import STRtree

Sides = Literal["both", "left", "right", "no"]
"""The sides of a road with pavements, in the way's direction: values of OSM's ``sidewalk``."""
_STATED: Mapping[str, Sides] = {
    "both": "both",
    "yes": "both",
    "left": "left",
    "right": "right",
    "no": "no",
    "none": "no",
    "lane": "both",
    "separate": "both",
}
"""Sides by the values of OSM's ``sidewalk``; separately drawn ones are added to the road."""
_WITH_PAVEMENTS = frozenset({"primary", "secondary", "tertiary", "residential", "living_street", "unclassified"})
_GUESSED = _WITH_PAVEMENTS | {"primary_link", "secondary_link", "tertiary_link"}
"""OSM's classes of streets that get pavements if the map has no information."""
_NEVER = frozenset({"motorway", "motorway_link"})
"""OSM's classes of roads without pedestrians, whatever the map states."""
_TOWN_KMH = 60.0
"""Roads with a higher limit get no pavements if the map has no information (chosen)."""
MID_BLOCK_M = 25.0
"""A crossing farther than this from all junctions is mid-block (chosen); a nearer one belongs to the junction."""
_THROUGH = 2
"""Arms at a node where a road continues and no other joins it."""
_DRAWN_WITHIN_M, _DRAWN_EVERY_M, _DRAWN_SHARE = 14.0, 10.0, 0.5
"""A footway belongs to a road if it is within this distance, sampled at this spacing, over this share of its length
(chosen).
"""


@dataclass(frozen=True)
class Pavements:
    """Pavements of roads by way id, and the km of road with pavements according to the map and to a guess.

    ``crossings``: (latitude, longitude) of the crossings marked on the map. ``mid_block``: the nodes of the crossings
    away from junctions, on roads with pavements on both sides.
    """

    sides: Mapping[int, Sides]
    mapped_km: float
    guessed_km: float
    crossings: tuple[tuple[float, float], ...]
    mid_block: frozenset[int] = frozenset()

    def tags_of(self, way: OsmWay) -> dict[str, str]:
        """Return a way's tags with its pavements in netconvert's format; other roads are closed to pedestrians.

        Otherwise, netconvert would let pedestrians use the lanes of vehicles.
        """
        tags = {key: value for key, value in way.tags.items() if key != "foot" and not key.startswith("sidewalk")}
        sides = self.sides.get(way.way_id, "no")
        return tags | ({"sidewalk": "no", "foot": "no"} if sides == "no" else {"sidewalk": sides})

    def tags_of_node(self, node: OsmNode) -> Mapping[str, str]:
        """Return a node's tags without crossings, except mid-block crossings.

        netconvert builds every crossing that a node marks, in addition to its own at junctions.
        """
        if node.tags.get("highway") != "crossing" or node.node_id in self.mid_block:
            return node.tags
        return {key: value for key, value in node.tags.items() if key != "highway"}


def find_pavements(
    osm: OsmMap, roads: Iterable[OsmWay], center: tuple[float, float], radius_m: float, *, lefthand: bool = False
) -> Pavements:
    """Find the pavements of roads within a circle around (latitude, longitude); ``lefthand``: traffic keeps left.

    A ring has no pavement on its inner side: pedestrians do not walk there, and a pavement against the traffic would
    not form a ring.
    """
    footways = _FootWays(osm, center, radius_m)
    sides: dict[int, Sides] = {}
    length_km = {"map": 0.0, "guess": 0.0}
    crossings: dict[int, OsmNode] = {}
    ways = list(roads)
    for way in ways:
        nodes = [osm.nodes[key] for key in way.node_ids]
        near = [
            pair
            for pair in pairwise(nodes)
            if ground_distance_m(pair[0].position, center) <= radius_m
            or ground_distance_m(pair[1].position, center) <= radius_m
        ]
        if not near:
            continue
        crossings |= {node.node_id: node for pair in near for node in pair if _is_crossing(node)}
        there, source = _sides_of(way, near, footways)
        if way.tags.get("junction") in RING_TAGS:
            outer: Sides = "left" if lefthand else "right"
            there = outer if there in ("both", outer) else "no"
        sides[way.way_id] = there
        if there != "no":
            length_km[source] += sum(ground_distance_m(a.position, b.position) for a, b in near) / 1000
    marked = tuple(crossings[key].position for key in sorted(crossings))
    middle = frozenset(_mid_block(osm, ways, sides, crossings, center, radius_m))
    return Pavements(sides, length_km["map"], length_km["guess"], marked, middle)


def _mid_block(
    osm: OsmMap,
    ways: Sequence[OsmWay],
    sides: Mapping[int, Sides],
    marked: Mapping[int, OsmNode],
    center: tuple[float, float],
    radius_m: float,
) -> Iterator[int]:
    """Yield the marked crossings with pavements on both sides, away from junctions and the edge of the cut."""
    arms = Counter(key for way in ways for key in (*way.node_ids, *way.node_ids[1:-1]))
    without = {key for way in ways if sides.get(way.way_id) != "both" for key in way.node_ids}
    others = [osm.nodes[key].position for key, count in arms.items() if count != _THROUGH]
    for key, node in marked.items():
        inside = ground_distance_m(node.position, center) < radius_m - MID_BLOCK_M
        if not inside or arms[key] != _THROUGH or key in without:
            continue
        if all(ground_distance_m(node.position, other) > MID_BLOCK_M for other in others):
            yield key


def _is_crossing(node: OsmNode) -> bool:
    return node.tags.get("highway") == "crossing" and node.tags.get("crossing") != "no"


def _sides_of(
    way: OsmWay, near: Sequence[tuple[OsmNode, OsmNode]], footways: "_FootWays"
) -> tuple[Sides, Literal["map", "guess"]]:
    """Return the sides of a road that have pavements, and whether the map states this or it is a guess."""
    if way.road_class in _NEVER or way.tags.get("motorroad") == "yes" or way.tags.get("foot") == "no":
        return "no", "map"
    stated = _stated_sides(way.tags)
    if stated is not None:
        return stated, "map"
    drawn = footways.sides_of(near)
    if drawn != "no":
        return drawn, "map"
    fast = (way.maxspeed_kmh or 0.0) > _TOWN_KMH
    return ("both", "guess") if way.road_class in _GUESSED and not fast else ("no", "guess")


def _stated_sides(tags: Mapping[str, str]) -> Sides | None:
    """Return the tagged pavements of a road, or None if the tags do not state any."""
    whole = _STATED.get(tags.get("sidewalk") or tags.get("sidewalk:both") or "")
    if whole is not None:
        return whole
    left, right = (_STATED.get(tags.get(f"sidewalk:{side}", "")) for side in ("left", "right"))
    if left is None and right is None:
        return None
    return _sides(left not in (None, "no"), right not in (None, "no"))


def _sides(left: bool, right: bool) -> Sides:
    if left and right:
        return "both"
    return "left" if left else "right" if right else "no"


class _FootWays:
    """The pavements that a map draws as separate ways, in metres east and north of a point."""

    def __init__(self, osm: OsmMap, center: tuple[float, float], radius_m: float) -> None:
        self._center = center
        self._tree = self._tree_of(osm, radius_m)

    def sides_of(self, segments: Iterable[tuple[OsmNode, OsmNode]]) -> Sides:
        """Return the sides of a road that a separate pavement follows for most of its length."""
        from shapely import LineString

        if self._tree is None:
            return "no"
        looked, found = 0, [0, 0]
        for start, end in segments:
            (x0, y0), (x1, y1) = self._metres(start), self._metres(end)
            length = math.hypot(x1 - x0, y1 - y0)
            if length < 0.1:  # no direction
                continue
            left = (-(y1 - y0) / length * _DRAWN_WITHIN_M, (x1 - x0) / length * _DRAWN_WITHIN_M)
            count = max(round(length / _DRAWN_EVERY_M), 1)
            for share in ((number + 0.5) / count for number in range(count)):
                x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
                looked += 1
                for side, sign in enumerate((1.0, -1.0)):
                    across = LineString([(x, y), (x + sign * left[0], y + sign * left[1])])
                    found[side] += bool(len(self._tree.query(across, predicate="intersects")))
        return _sides(*(looked > 0 and count >= _DRAWN_SHARE * looked for count in found))

    def _tree_of(self, osm: OsmMap, radius_m: float) -> "STRtree | None":
        from shapely import LineString, STRtree

        drawn = [way for way in osm.ways if way.tags.get("footway") == "sidewalk" and len(way.node_ids) > 1]
        lines = [
            LineString([self._metres(osm.nodes[key]) for key in way.node_ids])
            for way in drawn
            if any(ground_distance_m(osm.nodes[key].position, self._center) <= radius_m for key in way.node_ids)
        ]
        return STRtree(lines) if lines else None

    def _metres(self, node: OsmNode) -> tuple[float, float]:
        """Return a node's position in metres east and north (equirectangular: good for the size of a site)."""
        north = math.radians(node.latitude - self._center[0]) * EARTH_RADIUS_M
        east = math.radians(math.remainder(node.longitude - self._center[1], 2 * HALF_TURN_DEG)) * EARTH_RADIUS_M
        return east * math.cos(math.radians(self._center[0])), north
