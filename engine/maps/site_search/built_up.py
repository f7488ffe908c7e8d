"""What of a map is built up: houses, residential streets and areas, asked how near they lie to a point."""

import math
from collections import Counter
from functools import cached_property

from ....schemas.generation import PlaceArea
from ..naming.shown import areas_shown
from ..osm import HALF_TURN_DEG, OsmMap, OsmNode, ground_distance_m, length_m
from .nearness import Surroundings

BUILT_UP_ROADS = frozenset({"residential", "living_street"})
BUILT_UP_LANDUSE = frozenset({"residential", "commercial", "retail", "industrial"})
SETTLEMENTS = frozenset({"city", "town", "village", "suburb", "borough", "quarter", "neighbourhood"})
"""OSM's values of ``place`` for built-up settlements and their parts."""
_CORE_SHARE = 0.5
"""Of the reach of a settlement: nearer to its middle, a road lies in it (measured: ``site_roads/road_reader.py``)."""
TOWN_JUNCTIONS_PER_KM = 5.0
"""More junctions on a kilometre of road make the map of a town (chosen)."""


class BuiltUp:
    """The built-up parts of one map; looked for once, when they are first asked for."""

    def __init__(self, osm: OsmMap) -> None:
        self._osm = osm

    def within(self, node: OsmNode, distance_m: float) -> bool:
        """Whether a house, a residential street or area lies no farther from a node than a distance."""
        return self._shapes.any_within(self.metres(node), distance_m)

    def metres(self, node: OsmNode) -> tuple[float, float]:
        """Eastwards and northwards of a corner of the map; a map round the world is measured from its first road."""
        south, west = self._origin
        north = ground_distance_m((south, west), (node.latitude, west))
        east = ground_distance_m((node.latitude, west), (node.latitude, node.longitude))
        eastwards = math.remainder(node.longitude - west, 2 * HALF_TURN_DEG)
        return math.copysign(east, eastwards), math.copysign(north, node.latitude - south)

    @property
    def is_mapped(self) -> bool:
        """Whether the map shows anything that is built up."""
        return not self._shapes.is_empty

    @cached_property
    def is_dense(self) -> bool:
        """Whether roads meet as often as in towns, or a settlement is marked: for maps that show nothing but roads."""
        roads = self._osm.roads()
        arms = Counter(key for way in roads for key in (*way.node_ids, *way.node_ids[1:-1]))
        junctions = sum(count > 2 for count in arms.values())
        length_km = sum(length_m(self._osm, way) for way in roads) / 1000
        named = any(node.tags.get("place") in SETTLEMENTS for node in self._osm.nodes.values() if node.tags)
        return named or junctions > TOWN_JUNCTIONS_PER_KM * length_km

    def is_in_settlement(self, node: OsmNode) -> bool:
        """Return True if a node lies in the core of a settlement that the map marks, or of a part of one."""
        return any(
            ground_distance_m(node.position, (area.latitude, area.longitude)) <= _CORE_SHARE * area.radius_m
            for area in self._settlements
        )

    @cached_property
    def _settlements(self) -> tuple[PlaceArea, ...]:
        return tuple(area for area in areas_shown(self._osm) if area.kind in SETTLEMENTS)

    @cached_property
    def _shapes(self) -> Surroundings:
        houses = [node for node in self._osm.nodes.values() if "addr:housenumber" in node.tags or "shop" in node.tags]
        lines = [[self.metres(node)] for node in houses]
        areas: list[list[tuple[float, float]]] = []
        for way in self._osm.ways:
            if way.tags.get("landuse") in BUILT_UP_LANDUSE and len(way.node_ids) > 3:
                areas.append([self.metres(self._osm.nodes[key]) for key in way.node_ids])
            elif way.road_class in BUILT_UP_ROADS or "building" in way.tags:
                lines.append([self.metres(self._osm.nodes[key]) for key in way.node_ids])
        return Surroundings(lines, areas)

    @cached_property
    def _origin(self) -> tuple[float, float]:
        south, west, _, east = self._osm.bounds
        roads = self._osm.roads() if east - west > HALF_TURN_DEG else []
        return self._osm.nodes[roads[0].node_ids[0]].position if roads else (south, west)
