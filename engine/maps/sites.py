"""Finding sites in a map: where in it there is a roundabout, a signalised crossing, a ramp, a motorway …"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

from ...schemas.generation import SiteType
from .osm import OsmMap, OsmNode, OsmWay, ground_distance_m, length_m
from .road_classes import ALL_ROADS, FAST_ROADS, LINKS, RAMP_LINKS, ROADS, RURAL_CLASSES, THROUGH_ROADS

if TYPE_CHECKING:
    from shapely import STRtree

SIGNAL_REACH_M = 45.0
"""From a junction to its traffic signals: on wide roads they are mapped at the stop lines (chosen)."""
MERGE_M = 60.0
"""Sites of one type that lie closer together are one (chosen)."""
RURAL_CLEAR_M, TOWN_CLEAR_M = 120.0, 400.0
"""From a rural road to the next house; on the map of a town, at whose edge houses may just not be drawn (chosen)."""
TOWN_JUNCTIONS_PER_KM = 5.0
"""More junctions on a kilometre of road make the map of a town (chosen)."""
MOST_BEHIND = 30
"""Roads behind the links of a ramp that are followed for their names, at most (chosen)."""
NEAR_RAMP_M, AT_MOTORWAY_M = 200.0, 100.0
"""From a ramp to the roads that it is called after; from a motorway to junctions that are not urban (chosen)."""
SHORTEST_STRETCH_M, SHORTEST_RURAL_M = 40.0, 60.0
"""Shorter ways of a motorway, and of a rural road, are pieces between junctions and no stretches (chosen)."""
SPACING_M = 400.0
"""Between two sites on one stretch of road (chosen)."""
TOWN_LIMIT_KMH = 60
"""A lower limit tells of a town (chosen; 50 km/h and 30 mph are usual there)."""
EXPRESSWAY_KMH = 80
"""A one-way trunk road with this limit or a higher one drives like a motorway (chosen)."""
BUILT_UP_ROADS = frozenset({"residential", "living_street"})
BUILT_UP_LANDUSE = frozenset({"residential", "commercial", "retail", "industrial"})
MARKED_BY_NODES: frozenset[SiteType] = frozenset({"intersection", "signalised_intersection", "ramp", "urban"})


@dataclass(frozen=True)
class Site:
    """A spot of a map: its type, its middle in degrees, the streets there, and the node or way that marks it."""

    kind: SiteType
    latitude: float
    longitude: float
    streets: tuple[str, ...]
    mark: int

    @property
    def position(self) -> tuple[float, float]:
        """Its middle as latitude and longitude in degrees."""
        return self.latitude, self.longitude

    @property
    def osm_id(self) -> str:
        """The mark as OpenStreetMap writes it: ``node/123`` or ``way/123``."""
        return f"{'node' if self.kind in MARKED_BY_NODES else 'way'}/{self.mark}"


class _Crossings:
    """Where roads meet: the roads by node, and the nodes at which at least three arms do."""

    def __init__(self, roads: list[OsmWay]) -> None:
        self.ways_at: dict[int, list[OsmWay]] = {}
        arms: dict[int, int] = {}
        for way in roads:
            for key in dict.fromkeys(way.node_ids):
                self.ways_at.setdefault(key, []).append(way)
            for index, key in enumerate(way.node_ids):
                arms[key] = arms.get(key, 0) + (index > 0) + (index < len(way.node_ids) - 1)
        self.junctions = [key for key, count in arms.items() if count >= 3]

    def of_streets(self) -> list[int]:
        """Junctions of different streets: not one road that parts in two, and not only motorways."""
        return [key for key in self.junctions if self._crosses(key) and not self._only_motorway(key)]

    def _crosses(self, key: int) -> bool:
        names = {way.tags.get("name") or way.tags.get("ref") or str(way.way_id) for way in self.ways_at[key]}
        return len(names) > 1 or len(self.ways_at[key]) > 3

    def _only_motorway(self, key: int) -> bool:
        return all(way.road_class.startswith(("motorway", "trunk")) for way in self.ways_at[key])


class SiteFinder:
    """Finds the sites of one map; every kind is looked for once, sites come in the order of the map.

    ``classes``: the road classes of which sites are made, all without; houses tell of a town in either case.
    """

    def __init__(self, osm: OsmMap, classes: Iterable[str] = ()) -> None:
        self.osm = osm
        self._classes = frozenset(classes) or ALL_ROADS
        self._kinds: dict[SiteType, Callable[[], list[Site]]] = {
            "roundabout": self._roundabouts,
            "signalised_intersection": self._signalised,
            "ramp": self._ramps,
            "highway": self._motorways,
            "intersection": self._crossings,
            "rural": self._rural,
            "urban": self._urban,
        }

    def find(self, kind: SiteType) -> list[Site]:
        """All sites of a kind, near ones merged."""
        return _merged(self._kinds[kind]())

    def kinds(self) -> dict[SiteType, int]:
        """How many sites of each kind the map holds; kinds that it lacks are left out."""
        counts = {kind: len(self.find(kind)) for kind in self._kinds}
        return {kind: count for kind, count in counts.items() if count}

    def longest_road(self) -> Site | None:
        """The middle of the longest road, for a map in which nothing else can be found; None where there is no road."""
        way = max(self.osm.roads(self._classes), key=lambda way: length_m(self.osm, way), default=None)
        if way is None:
            return None
        nodes = [self.osm.nodes[key] for key in way.node_ids]
        middle = nodes[len(nodes) // 2]
        kind: SiteType = "rural" if self._far_from_houses(middle) else "urban"
        return self._site(kind, middle, [way], middle.node_id if kind == "urban" else way.way_id)

    @cached_property
    def _roads(self) -> list[OsmWay]:
        """Roads that lead somewhere; service roads and tracks only where there is nothing else."""
        through = [way for way in self.osm.roads(THROUGH_ROADS & self._classes) if way.tags.get("area") != "yes"]
        return through or self.osm.roads(frozenset(ROADS) & self._classes)

    @cached_property
    def _streets(self) -> _Crossings:
        """Where the roads that lead somewhere meet; a slip road parts from its road there, and crosses nothing."""
        return _Crossings([way for way in self._roads if way.road_class not in LINKS])

    @cached_property
    def _with_links(self) -> _Crossings:
        """Where the roads that lead somewhere and their links meet."""
        return _Crossings(self._roads)

    @cached_property
    def _everywhere(self) -> _Crossings:
        """Where roads meet, driveways and tracks included, links not."""
        return _Crossings(self.osm.roads(frozenset(ROADS) & self._classes))

    @cached_property
    def _fast(self) -> str:
        """The class of the roads that highways and ramps are made of: trunk roads only where no motorway lies."""
        return "motorway" if self.osm.roads(frozenset({"motorway"})) else "trunk"

    def _site(self, kind: SiteType, node: OsmNode, ways: list[OsmWay], mark: int) -> Site:
        streets = {name for way in ways for name in (way.tags.get("name"), way.tags.get("ref")) if name}
        streets |= {node.tags["name"]} if "name" in node.tags else set()
        return Site(kind, node.latitude, node.longitude, tuple(sorted(streets)), mark)

    def _roundabouts(self) -> list[Site]:
        sites = []
        for way in self._roads:
            if way.tags.get("junction") in ("roundabout", "circular"):
                middle = OsmNode(0, *_mean([self.osm.nodes[key] for key in way.node_ids]), {})
                arms = [other for key in way.node_ids for other in self._streets.ways_at[key]]
                sites.append(self._site("roundabout", middle, arms, way.way_id))
        return sites

    def _signalised(self) -> list[Site]:
        """Junctions with a traffic signal at them or within reach; a signal alone may be a pedestrian crossing."""
        return self._lit(self._streets) or self._lit(self._everywhere)

    def _lit(self, crossings: _Crossings) -> list[Site]:
        signals = [
            node
            for key, node in self.osm.nodes.items()
            if node.tags.get("highway") == "traffic_signals" and key in crossings.ways_at
        ]
        sites = []
        for key in crossings.of_streets() if signals else ():
            node = self.osm.nodes[key]
            if any(ground_distance_m(node.position, signal.position) < SIGNAL_REACH_M for signal in signals):
                sites.append(self._site("signalised_intersection", node, crossings.ways_at[key], key))
        return sites

    def _crossings(self) -> list[Site]:
        """Junctions of streets; those with driveways and tracks only where there is no other."""
        crossings = self._streets if self._streets.of_streets() else self._everywhere
        return [
            self._site("intersection", self.osm.nodes[key], crossings.ways_at[key], key)
            for key in crossings.of_streets()
        ]

    def _ramps(self) -> list[Site]:
        """Where a link leaves or joins a motorway, or a trunk road where there is no motorway."""
        sites = []
        for key in self._with_links.junctions:
            ways = self._with_links.ways_at[key]
            classes = {way.road_class for way in ways}
            if self._fast in classes and classes & RAMP_LINKS:
                node = self.osm.nodes[key]
                named = [*ways, *self._roads_behind(ways), *self._passing(node, NEAR_RAMP_M)]
                sites.append(self._site("ramp", node, named, key))
        return sites

    def _roads_behind(self, ways: list[OsmWay]) -> list[OsmWay]:
        """The roads to which the links among the ways lead: a ramp is called after them too."""
        roads: dict[int, OsmWay] = {}
        waiting = [way for way in ways if way.road_class in LINKS]
        while waiting:
            for key in waiting.pop().node_ids:
                for way in self._with_links.ways_at[key]:
                    if way.way_id not in roads and len(roads) < MOST_BEHIND:
                        roads[way.way_id] = way
                        waiting += [way] if way.road_class in LINKS else []
        return list(roads.values())

    def _passing(self, node: OsmNode, within_m: float) -> list[OsmWay]:
        """The roads that pass within a distance: an exit is called after the road that it lies at, too."""
        from shapely import Point

        return [self._roads[index] for index in self._lines.query(Point(*self._metres(node)), "dwithin", within_m)]

    @cached_property
    def _lines(self) -> "STRtree":
        """The roads that lead somewhere, in metres around the middle of the map."""
        from shapely import LineString, STRtree

        return STRtree([LineString([self._metres(self.osm.nodes[key]) for key in way.node_ids]) for way in self._roads])

    def _motorways(self) -> list[Site]:
        fast = [way for way in self._roads if way.road_class == self._fast]
        fast = [way for way in fast if self._fast == "motorway" or _is_expressway(way)]
        ways = [way for way in fast if length_m(self.osm, way) > SHORTEST_STRETCH_M]
        return [
            self._site("highway", point, [way], way.way_id) for way in ways for point in _spaced_points(self.osm, way)
        ]

    def _rural(self) -> list[Site]:
        """Stretches of main roads away from houses; pavements, and limits below 60 km/h, tell of a town."""
        sites = []
        for way in self._roads:
            if way.road_class not in RURAL_CLASSES or way.tags.get("junction"):
                continue
            slow = 0 < (way.maxspeed_kmh or 0) < TOWN_LIMIT_KMH or way.tags.get("sidewalk", "no") not in ("no", "none")
            if length_m(self.osm, way) > SHORTEST_RURAL_M and not slow:
                points = [
                    point for point in _spaced_points(self.osm, way) if self._far_from_houses(point, self._clear_m)
                ]
                sites += [self._site("rural", point, [way], way.way_id) for point in points]
        return sites

    @cached_property
    def _clear_m(self) -> float:
        """How far houses have to be: farther on the map of a town, at whose edge houses may just not be drawn."""
        road_km = sum(length_m(self.osm, way) for way in self._roads) / 1000
        dense = len(self._streets.junctions) > TOWN_JUNCTIONS_PER_KM * road_km
        lit = any(node.tags.get("highway") == "traffic_signals" for node in self.osm.nodes.values())
        return TOWN_CLEAR_M if dense or lit else RURAL_CLEAR_M

    def _urban(self) -> list[Site]:
        """Junctions of streets among houses, off motorways; where there are none, the middles of streets."""
        crossings = [site for site in self._crossings() if not self._far_from_houses(self.osm.nodes[site.mark])]
        sites = [replace(site, kind="urban") for site in crossings]
        off = [site for site in sites if not self._at_motorway(self.osm.nodes[site.mark])]
        return off or self._middles_of_streets() or sites

    def _middles_of_streets(self) -> list[Site]:
        sites = []
        for way in self._roads:
            node = self.osm.nodes[way.node_ids[len(way.node_ids) // 2]]
            is_street = way.road_class not in LINKS and way.road_class not in FAST_ROADS
            if is_street and not self._far_from_houses(node) and not self._at_motorway(node):
                sites.append(self._site("urban", node, [way], node.node_id))
        return sites

    def _at_motorway(self, node: OsmNode) -> bool:
        return any(way.road_class == "motorway" for way in self._passing(node, AT_MOTORWAY_M))

    def _far_from_houses(self, node: OsmNode, clear_m: float = RURAL_CLEAR_M) -> bool:
        from shapely import Point

        return len(self._built_up.query(Point(*self._metres(node)), "dwithin", clear_m)) == 0

    @cached_property
    def _built_up(self) -> "STRtree":
        """Houses, residential streets and areas in metres around the middle of the map."""
        from shapely import LineString, Point, Polygon, STRtree

        houses = [node for node in self.osm.nodes.values() if "addr:housenumber" in node.tags or "shop" in node.tags]
        shapes: list[Point | LineString | Polygon] = [Point(*self._metres(node)) for node in houses]
        for way in self.osm.ways:
            line = [self._metres(self.osm.nodes[key]) for key in way.node_ids]
            if way.tags.get("landuse") in BUILT_UP_LANDUSE and len(line) > 3:
                shapes.append(Polygon(line).buffer(0))
            elif way.road_class in BUILT_UP_ROADS or "building" in way.tags:
                shapes.append(LineString(line))
        return STRtree(shapes)

    def _metres(self, node: OsmNode) -> tuple[float, float]:
        south, west, _, _ = self.osm.bounds
        north = ground_distance_m((south, west), (node.latitude, west))
        east = ground_distance_m((node.latitude, west), (node.latitude, node.longitude))
        return math.copysign(east, node.longitude - west), math.copysign(north, node.latitude - south)


def _is_expressway(way: OsmWay) -> bool:
    """A trunk road that drives like a motorway: one-way carriageway, or signed as one."""
    fast = (way.maxspeed_kmh or 0) >= EXPRESSWAY_KMH and way.tags.get("oneway") == "yes"
    return fast or way.tags.get("motorroad") == "yes"


def _mean(places: Sequence[OsmNode | Site]) -> tuple[float, float]:
    """The mean latitude and longitude in degrees."""
    latitudes, longitudes = zip(*(place.position for place in places), strict=True)
    return math.fsum(latitudes) / len(places), math.fsum(longitudes) / len(places)


def _merged(sites: list[Site]) -> list[Site]:
    """Sites of one kind that lie close together as one, with the streets of all."""
    groups: list[list[Site]] = []
    for site in sites:
        near = (group for group in groups if ground_distance_m(site.position, group[0].position) < MERGE_M)
        if (group := next(near, None)) is not None:
            group.append(site)
        else:
            groups.append([site])
    merged = []
    for group in groups:
        streets = tuple(sorted({street for site in group for street in site.streets}))
        merged.append(Site(group[0].kind, *_mean(group), streets, group[0].mark))
    return merged


def _spaced_points(osm: OsmMap, way: OsmWay) -> list[OsmNode]:
    """Points evenly spaced along a way, one for every ``SPACING_M`` and at least one, the ends left out."""
    nodes = [osm.nodes[key] for key in way.node_ids]
    total = length_m(osm, way)
    count = max(1, round(total / SPACING_M))
    points: list[OsmNode] = []
    gone = 0.0
    for one, other in pairwise(nodes):
        step = ground_distance_m(one.position, other.position)
        while len(points) < count and gone + step >= (wanted := total * (len(points) + 0.5) / count) - 1e-6:
            share = (wanted - gone) / max(step, 1e-9)
            latitude = one.latitude + share * (other.latitude - one.latitude)
            longitude = one.longitude + share * (other.longitude - one.longitude)
            points.append(OsmNode(0, latitude, longitude, {}))
        gone += step
    return points
