"""The built-up parts of a map: houses, residential streets and areas, searched by distance from a point."""

import math
from collections import Counter
from collections.abc import Mapping
from functools import cached_property

from ..naming.gazetteer import discs_of_settlements
from ..naming.shown import areas_shown
from ..osm import HALF_TURN_DEG, OsmMap, OsmNode, OsmWay, ground_distance_m, length_m
from ..road_classes import LINKS
from ..road_tags.limits import signed_kmh
from .nearness import Surroundings

BUILT_UP_ROADS = frozenset({"residential", "living_street"})
BUILT_UP_LANDUSE = frozenset({"residential", "commercial", "retail", "industrial"})
SETTLEMENTS = frozenset({"city", "town", "village", "suburb", "borough", "quarter", "neighbourhood"})
"""OSM's values of ``place`` for built-up settlements and their parts."""
_CORE_SHARE = 0.5
"""Share of a settlement's radius within which a road is in it (measured: ``site_roads/road_reader.py``)."""
_POSTED_WITHIN_M = 300.0
"""Distance from a road within which other roads' posted limits say whether it is in a town (measured, as above)."""
_OFF_STREET = frozenset({"motorway", *LINKS, "service", "track"})
_HOUSE_WITHIN_M, _LINED_SHARE = 100.0, 0.5
"""A residential street has houses if one is within this distance of its middle; share of the streets of a map with
houses (both chosen).
"""
TOWN_JUNCTIONS_PER_KM = 5.0
"""A map with more junctions per kilometre of road is that of a town (chosen)."""


class BuiltUp:
    """The built-up parts of one map, computed on first use."""

    def __init__(self, osm: OsmMap) -> None:
        self._osm = osm

    def within(self, node: OsmNode, distance_m: float) -> bool:
        """Return whether a house or a residential street or area is within a distance of a node."""
        return self._shapes.any_within(self.metres(node), distance_m)

    def metres(self, node: OsmNode) -> tuple[float, float]:
        """Return a node's metres east and north of a corner of the map, or of its first road if it spans the world."""
        south, west = self._origin
        north = ground_distance_m((south, west), (node.latitude, west))
        east = ground_distance_m((node.latitude, west), (node.latitude, node.longitude))
        eastwards = math.remainder(node.longitude - west, 2 * HALF_TURN_DEG)
        return math.copysign(east, eastwards), math.copysign(north, node.latitude - south)

    @property
    def is_mapped(self) -> bool:
        """Whether the map has any built-up part."""
        return not self._shapes.is_empty

    @cached_property
    def is_dense(self) -> bool:
        """Whether junctions are as dense as in towns, or a settlement is marked, for maps with only roads."""
        roads = self._osm.roads()
        arms = Counter(key for way in roads for key in (*way.node_ids, *way.node_ids[1:-1]))
        junctions = sum(count > 2 for count in arms.values())
        length_km = sum(length_m(self._osm, way) for way in roads) / 1000
        named = any(node.tags.get("place") in SETTLEMENTS for node in self._osm.nodes.values() if node.tags)
        return named or junctions > TOWN_JUNCTIONS_PER_KM * length_km

    def is_in_settlement(self, node: OsmNode) -> bool:
        """Return whether a node is in the core of a settlement, or of a part of a settlement.

        Settlements are those of the map. Those of GeoNames count too if the map lacks the houses of its streets: then a
        road without houses may still be in a town.
        """
        return any(
            ground_distance_m(node.position, (latitude, longitude)) <= _CORE_SHARE * radius_m
            for discs in (self._settlements, self._known_settlements)
            for latitude, longitude, radius_m in discs
        )

    def posted_kmh_around(self, way: OsmWay, middle: OsmNode) -> float | None:
        """Return the median limit posted on the roads that meet a road, or on the roads near its middle.

        The roads near its middle count only if two or more of them have a posted limit. Motorways, links and drives do
        not count.
        """
        meeting = sorted(
            kmh for key in way.node_ids for other, kmh in self._posted_at.get(key, ()) if other != way.way_id
        )
        if meeting:
            return meeting[len(meeting) // 2]
        places, limits = self._posted
        near = sorted(limits[index] for index in places.lines_within(self.metres(middle), _POSTED_WITHIN_M))
        return near[len(near) // 2] if len(near) > 1 else None

    @cached_property
    def _posted_ways(self) -> tuple[tuple[OsmWay, float], ...]:
        """The roads with a posted limit, in km/h."""
        roads = (way for way in self._osm.roads() if way.road_class not in _OFF_STREET)
        return tuple((way, kmh) for way in roads if (kmh := signed_kmh(way.tags)) is not None)

    @cached_property
    def _posted_at(self) -> Mapping[int, list[tuple[int, float]]]:
        """The roads at each node, with their posted limits."""
        at: dict[int, list[tuple[int, float]]] = {}
        for way, kmh in self._posted_ways:
            for key in dict.fromkeys(way.node_ids):
                at.setdefault(key, []).append((way.way_id, kmh))
        return at

    @cached_property
    def _posted(self) -> tuple[Surroundings, list[float]]:
        """The middles of the roads with a posted limit, and the limits."""
        middles = [self.metres(self._osm.nodes[way.node_ids[len(way.node_ids) // 2]]) for way, _ in self._posted_ways]
        return Surroundings([[middle] for middle in middles]), [kmh for _, kmh in self._posted_ways]

    @cached_property
    def _settlements(self) -> tuple[tuple[float, float, float], ...]:
        """The latitude, longitude (degrees) and radius in m of the settlements that the map shows."""
        areas = (area for area in areas_shown(self._osm) if area.kind in SETTLEMENTS)
        return tuple((area.latitude, area.longitude, area.radius_m) for area in areas)

    @cached_property
    def _known_settlements(self) -> tuple[tuple[float, float, float], ...]:
        """The same for the settlements of GeoNames, if the map lacks the houses of its streets."""
        return () if self._shows_houses else discs_of_settlements(self._osm.bounds)

    @cached_property
    def _shows_houses(self) -> bool:
        """Whether half of the residential streets have houses or built-up areas, or a map without these has some."""
        houses = Surroundings(self._houses, self._areas)
        streets = [way for way in self._osm.roads(BUILT_UP_ROADS) if len(way.node_ids) > 1]
        middles = (self.metres(self._osm.nodes[way.node_ids[len(way.node_ids) // 2]]) for way in streets)
        lined = sum(houses.any_within(middle, _HOUSE_WITHIN_M) for middle in middles)
        return not houses.is_empty and lined >= _LINED_SHARE * len(streets)

    @cached_property
    def _shapes(self) -> Surroundings:
        streets = [self._line(way) for way in self._osm.ways if way.road_class in BUILT_UP_ROADS]
        return Surroundings([*self._houses, *streets], self._areas)

    @cached_property
    def _houses(self) -> list[list[tuple[float, float]]]:
        """The houses as points or outlines, in metres."""
        nodes = [node for node in self._osm.nodes.values() if "addr:housenumber" in node.tags or "shop" in node.tags]
        outlines = [self._line(way) for way in self._osm.ways if "building" in way.tags and not _is_area(way)]
        return [*([self.metres(node)] for node in nodes), *outlines]

    @cached_property
    def _areas(self) -> list[list[tuple[float, float]]]:
        """The outlines of built-up areas, in metres."""
        return [self._line(way) for way in self._osm.ways if _is_area(way)]

    def _line(self, way: OsmWay) -> list[tuple[float, float]]:
        return [self.metres(self._osm.nodes[key]) for key in way.node_ids]

    @cached_property
    def _origin(self) -> tuple[float, float]:
        south, west, _, east = self._osm.bounds
        roads = self._osm.roads() if east - west > HALF_TURN_DEG else []
        return self._osm.nodes[roads[0].node_ids[0]].position if roads else (south, west)


def _is_area(way: OsmWay) -> bool:
    """Return whether a way outlines a built-up area."""
    return way.tags.get("landuse") in BUILT_UP_LANDUSE and len(way.node_ids) > 3
