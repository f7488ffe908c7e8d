"""Finds the sites on a map: its roundabouts, signalised intersections, ramps, motorways and so on.

A map of any kind and size is searched in at most n log n time: ``nearness`` finds what is nearby. If hundreds of roads
meet, or hundreds of sites share one position, only the first roads or sites are named.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from heapq import heapify, heappop, heappush
from itertools import islice, pairwise

from ....schemas.generation import SiteType, Turn
from ..osm import HALF_TURN_DEG, OsmMap, OsmNode, OsmWay, ground_distance_m, length_m
from ..road_classes import ALL_ROADS, FAST_ROADS, LINKS, RAMP_LINKS, ROADS, RURAL_CLASSES, THROUGH_ROADS
from .built_up import TOWN_JUNCTIONS_PER_KM, BuiltUp
from .meetings import meetings_of
from .nearness import Gathering, Surroundings
from .rings import RING_TAGS, Rings, direction_of

AHEAD_M = 25.0
"""Maximum distance of a signal from its junction: netconvert's ``tls.guess-signals.dist``."""
SIGNAL_REACH_M = 50.0
"""Maximum distance of a junction from its signals: on wide roads they are mapped at the stop lines.

Measured on 102 extracts: of 271 signals on one-way roads that have no tags for pedestrians or a direction and reach
a junction within 100 m, 241 reach it within 50 m. Those that are farther away spread evenly, as crossings between
junctions do.
"""
LEAST_SIGNALS_FAR = 2
"""Minimum number of signals that lead to a junction if netconvert does not find any of them: one alone may belong to a
crossing for pedestrians (chosen).
"""
LIT_WITHIN_M = 60.0
"""Maximum distance of a signalised site's middle from a junction with lights, as in the check of its network
(chosen).
"""
MERGE_M = 60.0
"""Sites of one type closer together than this are one (chosen)."""
RURAL_CLEAR_M, TOWN_CLEAR_M = 120.0, 400.0
"""Distance from a rural road to the next house; on a town's map, houses beyond its edge may be missing (chosen)."""
MOST_BEHIND = 30
"""Maximum number of roads behind the links of a ramp that are followed for their names (chosen)."""
MOST_NAMED = 50
"""Maximum number of merged sites, and of roads at one node, that name a site (chosen); no real place has as many."""
MOST_ON_SEGMENT = 25
"""Maximum number of sites between two nodes of a way (chosen): no real road runs straight for 10 km."""
NEAR_RAMP_M, AT_MOTORWAY_M = 200.0, 100.0
"""Distance from a ramp to the roads that name it; from a motorway to junctions that are not urban (chosen)."""
SHORTEST_STRETCH_M, SHORTEST_RURAL_M = 40.0, 60.0
"""Shorter ways of a motorway or street, and of a rural road, are pieces between junctions, not stretches (chosen)."""
LEAST_ROAD_M = 100.0
"""Minimum road length of a map with sites (chosen): on less, no car drives the few seconds that a goal takes."""
SPACING_M = 400.0
"""Spacing of sites on one stretch of road (chosen)."""
TOWN_LIMIT_KMH = 60
"""A lower limit indicates a town (chosen; 50 km/h and 30 mph are usual there)."""
EXPRESSWAY_KMH = 80
"""A one-way trunk road with at least this limit counts as a motorway (chosen)."""
ARMS_OF_A_CROSSING = 4
"""Minimum number of arms if one-way roads cross; with three, they only fork or join."""
ARMS_OF_A_JOINT = 2
"""Number of arms of a node at which two roads continue each other."""
MARKED_BY_NODES: frozenset[SiteType] = frozenset({"intersection", "signalised_intersection", "ramp", "urban"})


@dataclass(frozen=True)
class SitePart:
    """One of the spots that were merged into a site: its position, streets, and the node or way that marks it.

    ``turns``: at a ramp, whether a link joins the main road there (``merge``) or leaves it (``exit``), or both.
    """

    position: tuple[float, float]
    streets: tuple[str, ...]
    mark: int
    turns: frozenset[Turn] = frozenset()


@dataclass(frozen=True)
class Site:
    """A place on a map: its type, its centre in degrees, its streets, and the node or way that marks it.

    ``parts``: the spots that were merged into the site, at most ``MOST_NAMED``; the streets are those of all parts.
    ``only_passed``: the requested streets pass the site, but no part is on all of them. ``by_links``: links belong to
    the site, for example because a link is an arm of the roundabout, or one of the streets reaches the junction only
    via a link road.
    """

    kind: SiteType
    latitude: float
    longitude: float
    streets: tuple[str, ...]
    mark: int
    parts: tuple[SitePart, ...] = ()
    only_passed: bool = False
    by_links: bool = False

    @property
    def position(self) -> tuple[float, float]:
        """The site's centre as latitude and longitude in degrees."""
        return self.latitude, self.longitude

    @property
    def turns(self) -> frozenset[Turn]:
        """The turns that links provide at a ramp: to merge onto the main road, to leave it, or both."""
        return frozenset(turn for part in self.parts for turn in part.turns)

    @property
    def osm_id(self) -> str:
        """The mark as OpenStreetMap writes it: ``node/123`` or ``way/123``."""
        return f"{'node' if self.kind in MARKED_BY_NODES else 'way'}/{self.mark}"


@dataclass(frozen=True)
class _Spot:
    """A candidate for a site, without streets; ``roads`` returns the roads that name it once it is confirmed.

    ``by_links``: links belong to it, as the arms of a roundabout.
    """

    kind: SiteType
    node: OsmNode
    mark: int
    roads: Callable[[], Iterable[OsmWay]]
    turns: frozenset[Turn] = frozenset()
    by_links: bool = False

    @property
    def position(self) -> tuple[float, float]:
        return self.node.position

    def streets(self) -> Iterator[str]:
        """Yield the names and numbers of its roads, and its own name."""
        for way in self.roads():
            yield from (name for name in (way.tags.get("name"), way.tags.get("ref")) if name)
        if "name" in self.node.tags:
            yield self.node.tags["name"]


class _Crossings:
    """The junctions of roads: the roads by node, and the nodes with at least three arms."""

    def __init__(self, roads: list[OsmWay]) -> None:
        self._ways_at: dict[int, list[OsmWay]] = {}
        arms: dict[int, int] = {}
        for way in roads:
            for key in dict.fromkeys(way.node_ids):
                self._ways_at.setdefault(key, []).append(way)
            for index, key in enumerate(way.node_ids):
                arms[key] = arms.get(key, 0) + (index > 0) + (index < len(way.node_ids) - 1)
        self._arms = arms
        self.junctions = [key for key, count in arms.items() if count >= 3]

    def __contains__(self, key: int) -> bool:
        return key in self._ways_at

    def is_junction(self, key: int) -> bool:
        """Return whether a node has at least three arms."""
        return self._arms.get(key, 0) >= 3

    def ways_at(self, key: int) -> Sequence[OsmWay]:
        """Return the roads at a node; empty if the node belongs to other roads."""
        return self._ways_at.get(key, ())

    def of_streets(self) -> list[int]:
        """Return junctions of different streets: not of one road that splits in two, and not of expressways."""
        return [key for key in self.junctions if self._crosses(key) and not self._is_of_expressways(key)]

    def joints(self) -> list[int]:
        """Return nodes with two arms that belong to different streets: the end of one is the beginning of the other."""
        return [key for key, count in self._arms.items() if count == ARMS_OF_A_JOINT and self._crosses(key)]

    def _crosses(self, key: int) -> bool:
        names = {way.tags.get("name") or way.tags.get("ref") or str(way.way_id) for way in self.ways_at(key)}
        return len(names) > 1 or len(self.ways_at(key)) > 3

    def _is_of_expressways(self, key: int) -> bool:
        """Return whether only motorways and trunk roads meet at a node, and none of them crosses another one.

        Trunk roads cross if one of them is open in both directions, or if four carriageways meet.
        """
        ways = self.ways_at(key)
        if not all(way.road_class.startswith(("motorway", "trunk")) for way in ways):
            return False
        if any(way.road_class.startswith("motorway") for way in ways):
            return True
        return self._arms[key] < ARMS_OF_A_CROSSING and all(direction_of(way) for way in ways)


class SiteFinder:
    """Finds the sites of one map; each kind is searched for once, and the sites are in the map's order.

    ``classes``: the road classes for sites, or empty for all; houses indicate a town in either case.
    """

    def __init__(self, osm: OsmMap, classes: Iterable[str] = ()) -> None:
        self.osm = osm
        requested = frozenset(classes)
        self._classes = requested or ALL_ROADS
        self._without_links = requested or frozenset(ROADS)
        self._met: dict[int, tuple[OsmWay, ...]] = {}
        self._found: dict[SiteType, tuple[Site, ...]] = {}

    def find(self, kind: SiteType) -> list[Site]:
        """Return all sites of a kind, with nearby sites merged; empty if the map has hardly any roads."""
        if kind not in self._found:
            sites = _merged(_SPOTS[kind](self)) if self._road_m > LEAST_ROAD_M else []
            self._found[kind] = tuple(
                site for site in sites if site.kind != "signalised_intersection" or self._has_lights(site)
            )
        return list(self._found[kind])

    def find_by_links(self, kind: SiteType) -> list[Site]:
        """Return sites of a kind that ``find`` leaves out because links belong to them.

        At these junctions, a street reaches a second street via a link with its name; if a junction is signalised, the
        network decides whether it gets lights. At these roundabouts, the ring consists of links, or links with a
        street's name enter it.
        """
        if kind == "roundabout" and self._road_m > LEAST_ROAD_M:
            return [replace(site, by_links=True) for site in _merged(self._rings(with_links=True))]
        if kind not in ("intersection", "signalised_intersection", "urban") or self._road_m <= LEAST_ROAD_M:
            return []
        # A signal may be on a link without a name.
        crossings = self._with_links if kind == "signalised_intersection" else self._with_named_links
        keys = crossings.of_streets()
        at_links = {key for key in keys if any(way.road_class in LINKS for way in crossings.ways_at(key))}
        if kind == "signalised_intersection":
            signals = self._signals(crossings)
            keys = [key for key in keys if signals.any_within(self._metres(self.osm.nodes[key]), SIGNAL_REACH_M)]
            keys = [key for key in keys if key in at_links or key in self._lit_over_links]
        else:
            keys = [key for key in keys if key in at_links]
        if kind == "urban":
            keys = [key for key in keys if not self._far_from_houses(self.osm.nodes[key])]
        sites = _merged([self._spot(kind, self.osm.nodes[key], crossings.ways_at(key), key) for key in keys])
        return [replace(site, by_links=True) for site in sites]

    def meetings(self, kind: SiteType, one: Callable[[OsmWay], bool], other: Callable[[OsmWay], bool]) -> list[Site]:
        """Return the junctions at which two streets meet only across a short road between them, as sites of a kind.

        Every part of these sites is on both streets. If a junction is signalised, the network decides whether it gets
        lights.
        """
        if kind not in ("intersection", "signalised_intersection", "urban") or self._road_m <= LEAST_ROAD_M:
            return []
        signals = self._signals(self._with_links)
        spots = []
        for meeting in meetings_of(self.osm, self._roads, one, other, MERGE_M):
            for key in meeting.nodes:
                node = self.osm.nodes[key]
                if not self._with_links.is_junction(key) or (kind == "urban" and self._far_from_houses(node)):
                    continue
                if kind != "signalised_intersection" or signals.any_within(self._metres(node), SIGNAL_REACH_M):
                    spots.append(self._spot(kind, node, meeting.roads, key))
        return [replace(site, by_links=True) for site in _merged(spots)]

    def find_besides_motorways(self, kind: SiteType) -> list[Site]:
        """Return highways and ramps of trunk roads, which ``find`` leaves out on a map with a motorway."""
        if self._fast == "trunk" or self._road_m <= LEAST_ROAD_M:
            return []
        spots = {"highway": self._stretches, "ramp": self._ramps_of_class}
        return _merged(spots[kind]("trunk")) if kind in spots else []

    def middles_of_streets(self) -> list[Site]:
        """Return the middles of the streets among houses, as urban sites of streets without a junction among them."""
        return _merged(self._middles_of_streets()) if self._road_m > LEAST_ROAD_M else []

    def joints_of_streets(self) -> list[Site]:
        """Return where a street ends and another one continues it, as urban sites, or rural ones far from houses."""
        joints = self._joints_of_streets() if self._road_m > LEAST_ROAD_M else []
        return _merged([spot for spot in joints if spot.kind == "urban"]) + _merged(
            [spot for spot in joints if spot.kind == "rural"]
        )

    def narrowed(self, site: Site, is_wanted: Callable[[SitePart], bool]) -> Site:
        """Return a site with its matching parts; if no part matches, the whole site, marked ``only_passed``."""
        parts = tuple(part for part in site.parts if is_wanted(part))
        if len(parts) == len(site.parts):
            return site
        narrow = _site_of(site.kind, parts, [part.position for part in parts]) if parts else None
        is_lit = site.kind != "signalised_intersection" or site.by_links
        if narrow is None or not (is_lit or self._has_lights(narrow)):
            return replace(site, only_passed=True)
        return replace(narrow, by_links=site.by_links)

    def main_streets(self, part: SitePart) -> tuple[str, ...]:
        """Return the names and numbers of the roads at the node of a ramp that are not links."""
        roads = (way for way in self._with_links.ways_at(part.mark) if way.road_class not in LINKS)
        return tuple(name for way in roads for key in ("name", "ref") if (name := way.tags.get(key)))

    def kinds(self) -> dict[SiteType, int]:
        """Return the number of sites of each kind on the map; kinds without sites are left out."""
        counts = {kind: len(self.find(kind)) for kind in _SPOTS}
        return {kind: count for kind, count in counts.items() if count}

    def longest_road(self) -> Site | None:
        """Return the middle of the longest road, for a map without other sites, or None if there is no road."""
        way = max(self.osm.roads(self._classes), key=lambda way: length_m(self.osm, way), default=None)
        if way is None:
            return None
        nodes = [self.osm.nodes[key] for key in way.node_ids]
        middle = nodes[len(nodes) // 2]
        kind: SiteType = "rural" if self._far_from_houses(middle) else "urban"
        spot = self._spot(kind, middle, [way], middle.node_id if kind == "urban" else way.way_id)
        return _merged([spot])[0]

    @cached_property
    def built_up(self) -> BuiltUp:
        """The built-up parts of the map."""
        return BuiltUp(self.osm)

    @cached_property
    def _roads(self) -> list[OsmWay]:
        """Through roads; service roads and tracks only if there are no through roads."""
        through = [way for way in self.osm.roads(THROUGH_ROADS & self._classes) if way.tags.get("area") != "yes"]
        return through or self.osm.roads(frozenset(ROADS) & self._classes)

    @cached_property
    def _road_m(self) -> float:
        return sum(length_m(self.osm, way) for way in self._roads)

    @cached_property
    def _streets(self) -> _Crossings:
        """The junctions of through roads; slip roads, which cross nothing, are left out."""
        return _Crossings([way for way in self._roads if way.road_class not in LINKS])

    @cached_property
    def _with_named_links(self) -> _Crossings:
        """The junctions of through roads, and of links that have the name of a through road."""
        names = {way.tags["name"] for way in self._roads if way.road_class not in LINKS and "name" in way.tags}
        return _Crossings([way for way in self._roads if way.road_class not in LINKS or way.tags.get("name") in names])

    @cached_property
    def _with_links(self) -> _Crossings:
        """The junctions of through roads and links."""
        return _Crossings(self._roads)

    @cached_property
    def _everywhere(self) -> _Crossings:
        """The junctions with driveways but without links and tracks, which netconvert closes to cars."""
        return _Crossings(self.osm.roads((frozenset(ROADS) - {"track"}) & self._classes))

    @cached_property
    def _fast(self) -> str:
        """The class of the roads for highways and ramps: trunk roads only if there is no motorway."""
        return "motorway" if self.osm.roads(frozenset({"motorway"})) else "trunk"

    @staticmethod
    def _spot(kind: SiteType, node: OsmNode, ways: Sequence[OsmWay], mark: int) -> _Spot:
        return _Spot(kind, node, mark, partial(islice, ways, MOST_NAMED))

    def _roundabouts(self) -> list[_Spot]:
        """Return closed rings of the roads (not links) in a site's cut."""
        return self._rings(with_links=False)

    def _rings(self, *, with_links: bool) -> list[_Spot]:
        """Return closed rings of roads, or of roads and links."""
        classes = self._without_links | frozenset(LINKS) if with_links else self._without_links
        tagged = [way for way in self._roads if way.tags.get("junction") in RING_TAGS and way.road_class in classes]
        rings = Rings(self.osm, self.osm.roads(classes) if tagged else ())
        arms = self._with_links if with_links else self._streets
        spots = []
        for way in tagged:
            if ring := rings.around(way):
                middle = OsmNode(0, *_middle([self.osm.nodes[key].position for key in ring]), {})
                has_links = any(road.road_class in LINKS for key in ring for road in self._with_links.ways_at(key))
                roads = partial(_ways_along, arms, ring)
                spots.append(_Spot("roundabout", middle, way.way_id, roads, by_links=has_links))
        return spots

    def ring_faults(self) -> list[tuple[SitePart, str]]:
        """Return the ways that are tagged as a roundabout without being one, each with the reason."""
        tagged = [way for way in self._roads if way.tags.get("junction") in RING_TAGS]
        rings = Rings(self.osm, self.osm.roads(self._without_links | frozenset(LINKS)) if tagged else ())
        faults = []
        for way in tagged:
            if fault := rings.fault_of(way):
                middle = OsmNode(0, *_middle([self.osm.nodes[key].position for key in way.node_ids]), {})
                spot = _Spot("roundabout", middle, way.way_id, partial(_ways_along, self._with_links, way.node_ids))
                faults.append((SitePart(spot.position, tuple(sorted(set(spot.streets()))), way.way_id), fault))
        return faults

    def _signalised(self) -> list[_Spot]:
        """Return junctions with a traffic signal within reach; a signal alone may be a pedestrian crossing."""
        return self._lit(self._streets) or self._lit(self._everywhere)

    def _lit(self, crossings: _Crossings) -> list[_Spot]:
        near = self._signals(crossings)
        spots = []
        for key in () if near.is_empty else crossings.of_streets():
            node = self.osm.nodes[key]
            if near.any_within(self._metres(node), SIGNAL_REACH_M):
                spots.append(self._spot("signalised_intersection", node, crossings.ways_at(key), key))
        return spots

    def _signals(self, crossings: _Crossings) -> Surroundings:
        """Return the traffic signals on the roads that meet at the junctions."""
        return Surroundings(
            [
                [self._metres(node)]
                for key, node in self.osm.nodes.items()
                if node.tags.get("highway") == "traffic_signals" and key in crossings
            ]
        )

    def _has_lights(self, site: Site) -> bool:
        """Return whether drivers reach a junction near the middle of a site at a signal or soon after it.

        On wide roads, they reach it later, but then from several signals.
        """
        middle = self._metres(OsmNode(0, *site.position, {}))
        if self._junctions_with_lights.any_within(middle, LIT_WITHIN_M):
            return True
        near = self._ahead_of_signals.lines_within(middle, LIT_WITHIN_M)
        return len({self._signals_and_junctions[number][0] for number in near}) >= LEAST_SIGNALS_FAR

    @cached_property
    def _lit_over_links(self) -> frozenset[int]:
        """The junctions that drivers reach at a signal or soon after it, if signals on links count."""
        roads = self.osm.roads(self._without_links | frozenset(LINKS))
        return _nodes_at_signals(self.osm, roads) & _where_ways_meet(roads)

    @cached_property
    def _signals_and_junctions(self) -> list[tuple[int, int]]:
        """The signals on the roads in a site's cut, each with the first junctions of streets after it."""
        roads = self.osm.roads(self._without_links)
        return _first_junctions(self.osm, roads, frozenset(self._streets.of_streets()) & _where_ways_meet(roads))

    @cached_property
    def _ahead_of_signals(self) -> Surroundings:
        """The positions of the junctions in ``_signals_and_junctions``, for searches by distance."""
        return Surroundings([[self._metres(self.osm.nodes[key])] for _, key in self._signals_and_junctions])

    @cached_property
    def _junctions_with_lights(self) -> Surroundings:
        """The junctions with lights on the roads in a site's cut.

        A light controls nothing unless two ways meet there and lead on, as where a road only splits or the map ends;
        netconvert leaves it out.
        """
        roads = self.osm.roads(self._without_links)
        lit = _nodes_at_signals(self.osm, roads) & _where_ways_meet(roads)
        return Surroundings([[self._metres(self.osm.nodes[key])] for key in _Crossings(roads).junctions if key in lit])

    def _crossings(self) -> list[_Spot]:
        """Return junctions of streets; those with driveways only if there are no others."""
        crossings = self._streets if self._streets.of_streets() else self._everywhere
        return [
            self._spot("intersection", self.osm.nodes[key], crossings.ways_at(key), key)
            for key in crossings.of_streets()
        ]

    def _ramps(self) -> list[_Spot]:
        """Return the positions where links leave or join a motorway, or a trunk road if there is no motorway."""
        return self._ramps_of_class(self._fast)

    def _ramps_of_class(self, road_class: str) -> list[_Spot]:
        spots = []
        for key in self._with_links.junctions:
            classes = {way.road_class for way in self._with_links.ways_at(key)}
            if road_class in classes and classes & RAMP_LINKS:
                roads = partial(self._roads_of_ramp, key)
                spots.append(_Spot("ramp", self.osm.nodes[key], key, roads, self._turns_at(key)))
        return spots

    def _turns_at(self, key: int) -> frozenset[Turn]:
        """Return the turns that the links at a node of a main road provide, judging from their directions."""
        turns: set[Turn] = set()
        for way in self._with_links.ways_at(key):
            if way.road_class not in RAMP_LINKS:
                continue
            direction = direction_of(way)
            ends_here, begins_here = key in way.node_ids[1:], key in way.node_ids[:-1]
            if (ends_here and direction >= 0) or (begins_here and direction <= 0):
                turns.add("merge")
            if (begins_here and direction >= 0) or (ends_here and direction <= 0):
                turns.add("exit")
        return frozenset(turns)

    def _roads_of_ramp(self, key: int) -> Iterator[OsmWay]:
        """Yield the roads that name a ramp: those at its node, those that its links lead to, and those that pass."""
        ways = list(islice(self._with_links.ways_at(key), MOST_NAMED))
        yield from ways
        yield from self._roads_behind(ways)
        yield from self._passing(self.osm.nodes[key])

    def _roads_behind(self, ways: Sequence[OsmWay]) -> Iterable[OsmWay]:
        """Return the roads to which the links among the ways lead, at most ``MOST_BEHIND``."""
        roads: dict[int, OsmWay] = {}
        waiting = [way for way in ways if way.road_class in LINKS]
        while waiting and len(roads) < MOST_BEHIND:
            for way in self._meeting(waiting.pop()):
                if way.way_id not in roads and len(roads) < MOST_BEHIND:
                    roads[way.way_id] = way
                    waiting += [way] if way.road_class in LINKS else []
        return roads.values()

    def _meeting(self, way: OsmWay) -> tuple[OsmWay, ...]:
        """Return up to ``MOST_BEHIND`` roads that meet a way, possibly including the way itself."""
        if way.way_id not in self._met:
            at_nodes = (other for key in way.node_ids for other in islice(self._with_links.ways_at(key), MOST_BEHIND))
            found: dict[int, OsmWay] = {}
            for other in at_nodes:
                found.setdefault(other.way_id, other)
                if len(found) == MOST_BEHIND:
                    break
            self._met[way.way_id] = tuple(found.values())
        return self._met[way.way_id]

    def _passing(self, node: OsmNode) -> list[OsmWay]:
        """Return the roads that pass near a ramp, since an exit may also be named after one of them."""
        return [self._roads[index] for index in self._lines.lines_within(self._metres(node), NEAR_RAMP_M)]

    @cached_property
    def _lines(self) -> Surroundings:
        """The through roads, for searches by distance."""
        return Surroundings([self._line_of(way) for way in self._roads])

    @cached_property
    def _motorway_lines(self) -> Surroundings:
        return Surroundings([self._line_of(way) for way in self._roads if way.road_class == "motorway"])

    def _line_of(self, way: OsmWay) -> list[tuple[float, float]]:
        return [self._metres(self.osm.nodes[key]) for key in way.node_ids]

    def _motorways(self) -> list[_Spot]:
        return self._stretches(self._fast)

    def _stretches(self, road_class: str) -> list[_Spot]:
        """Return points on the motorways, or on the trunk roads that resemble a motorway."""
        fast = [way for way in self._roads if way.road_class == road_class]
        fast = [way for way in fast if road_class == "motorway" or self._is_expressway(way)]
        ways = [way for way in fast if length_m(self.osm, way) > SHORTEST_STRETCH_M]
        return [
            self._spot("highway", point, [way], way.way_id) for way in ways for point in _spaced_points(self.osm, way)
        ]

    def _is_expressway(self, way: OsmWay) -> bool:
        """Return True for a trunk road that resembles a motorway.

        It is signed as an expressway, or it is a one-way carriageway with a high limit, or one that has no signed limit
        and meets no street.
        """
        if way.tags.get("motorroad") == "yes":
            return True
        if way.tags.get("oneway") != "yes":
            return False
        if way.maxspeed_kmh is None:
            return self._street_nodes.isdisjoint(way.node_ids)
        return way.maxspeed_kmh >= EXPRESSWAY_KMH

    @cached_property
    def _street_nodes(self) -> frozenset[int]:
        """The nodes of all roads other than motorways, trunk roads and links."""
        fast = frozenset((*FAST_ROADS, *LINKS))
        return frozenset(key for way in self._roads if way.road_class not in fast for key in way.node_ids)

    def _rural(self) -> list[_Spot]:
        """Return stretches of main roads away from houses; pavements, and limits below 60 km/h, indicate a town."""
        spots: list[_Spot] = []
        for way in self._roads:
            if way.road_class not in RURAL_CLASSES or way.tags.get("junction"):
                continue
            slow = 0 < (way.maxspeed_kmh or 0) < TOWN_LIMIT_KMH or way.tags.get("sidewalk", "no") not in ("no", "none")
            if length_m(self.osm, way) > SHORTEST_RURAL_M and not slow:
                points = [
                    point for point in _spaced_points(self.osm, way) if self._far_from_houses(point, self._clear_m)
                ]
                spots += [self._spot("rural", point, [way], way.way_id) for point in points]
        return spots

    @cached_property
    def _clear_m(self) -> float:
        """The minimum distance from houses: larger on a town's map, because houses beyond its edge may be missing."""
        dense = len(self._streets.junctions) > TOWN_JUNCTIONS_PER_KM * self._road_m / 1000
        lit = any(node.tags.get("highway") == "traffic_signals" for node in self.osm.nodes.values())
        return TOWN_CLEAR_M if dense or lit else RURAL_CLEAR_M

    def _urban(self) -> list[_Spot]:
        """Return junctions of streets among houses, off motorways; if there are none, the middles of streets."""
        crossings = [spot for spot in self._crossings() if not self._far_from_houses(spot.node)]
        spots = [replace(spot, kind="urban") for spot in crossings]
        off = [spot for spot in spots if not self._at_motorway(spot.node)]
        return off or self._middles_of_streets() or spots

    def _middles_of_streets(self) -> list[_Spot]:
        """Return for each street its node among houses that is nearest to its middle."""
        spots = []
        for way in self._roads:
            if way.road_class in (*LINKS, *FAST_ROADS) or length_m(self.osm, way) < SHORTEST_STRETCH_M:
                continue
            half = len(way.node_ids) // 2
            by_middle = sorted(range(len(way.node_ids)), key=lambda index: abs(index - half))
            nodes = (self.osm.nodes[way.node_ids[index]] for index in by_middle)
            suited = (node for node in nodes if not self._far_from_houses(node) and not self._at_motorway(node))
            if (node := next(suited, None)) is not None:
                spots.append(self._spot("urban", node, [way], node.node_id))
        return spots

    def _joints_of_streets(self) -> list[_Spot]:
        spots = []
        for key in self._streets.joints():
            node, ways = self.osm.nodes[key], self._streets.ways_at(key)
            if any(way.road_class in FAST_ROADS for way in ways):
                continue
            kind: SiteType = "rural" if self._far_from_houses(node) else "urban"
            spots.append(self._spot(kind, node, ways, key if kind == "urban" else ways[0].way_id))
        return spots

    def _at_motorway(self, node: OsmNode) -> bool:
        return self._motorway_lines.any_within(self._metres(node), AT_MOTORWAY_M)

    def _far_from_houses(self, node: OsmNode, clear_m: float = RURAL_CLEAR_M) -> bool:
        return not self.built_up.within(node, clear_m)

    def _metres(self, node: OsmNode) -> tuple[float, float]:
        return self.built_up.metres(node)


_SPOTS: Mapping[SiteType, Callable[[SiteFinder], list[_Spot]]] = {
    "roundabout": SiteFinder._roundabouts,
    "signalised_intersection": SiteFinder._signalised,
    "ramp": SiteFinder._ramps,
    "highway": SiteFinder._motorways,
    "intersection": SiteFinder._crossings,
    "rural": SiteFinder._rural,
    "urban": SiteFinder._urban,
}
"""The search for candidates of each kind; module-level, because in a finder it would form a reference cycle."""


def _ways_along(crossings: _Crossings, nodes: Sequence[int]) -> Iterator[OsmWay]:
    """Yield the first roads at each node of a ring."""
    for key in nodes:
        yield from islice(crossings.ways_at(key), MOST_NAMED)


def _middle(positions: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean latitude and longitude in degrees, even across the antimeridian."""
    latitudes, longitudes = zip(*positions, strict=True)
    if max(longitudes) - min(longitudes) > HALF_TURN_DEG:
        longitudes = tuple(longitude % (2 * HALF_TURN_DEG) for longitude in longitudes)
    latitude, longitude = math.fsum(latitudes) / len(positions), math.fsum(longitudes) / len(positions)
    return latitude, longitude - 2 * HALF_TURN_DEG if longitude > HALF_TURN_DEG else longitude


def _merged(spots: list[_Spot]) -> list[Site]:
    """Return sites merged from candidates of one kind that are close together, with the streets of all of them."""
    groups: list[list[_Spot]] = []
    firsts = Gathering(MERGE_M)
    for spot in spots:
        if (number := firsts.near(spot.position)) is not None:
            groups[number].append(spot)
        else:
            firsts.add(spot.position)
            groups.append([spot])
    sites = []
    for group in groups:
        parts = tuple(
            SitePart(spot.position, tuple(sorted(set(spot.streets()))), spot.mark, spot.turns)
            for spot in group[:MOST_NAMED]
        )
        site = _site_of(group[0].kind, parts, [spot.position for spot in group])
        sites.append(replace(site, by_links=True) if any(spot.by_links for spot in group) else site)
    return sites


def _site_of(kind: SiteType, parts: tuple[SitePart, ...], positions: Sequence[tuple[float, float]]) -> Site:
    """Return a site made of the given parts, at the middle of their positions and marked by the first part."""
    streets = tuple(sorted({street for part in parts for street in part.streets}))
    return Site(kind, *_middle(positions), streets, parts[0].mark, parts)


def _spaced_points(osm: OsmMap, way: OsmWay) -> list[OsmNode]:
    """Return points evenly spaced along a way without its ends: one per ``SPACING_M``, and at least one.

    The number of nodes limits the number of points: a way of few nodes around the world would have a hundred thousand
    points.
    """
    nodes = [osm.nodes[key] for key in way.node_ids]
    total = length_m(osm, way)
    count = max(1, min(round(total / SPACING_M), MOST_ON_SEGMENT * (len(nodes) - 1)))
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


def _where_ways_meet(roads: Iterable[OsmWay]) -> frozenset[int]:
    """Return the nodes that roads reach from at least two nodes, and from which a road leads on."""
    ways_in: dict[int, set[int]] = {}
    leads_on: set[int] = set()
    for way in roads:
        direction = direction_of(way)
        for one, other in pairwise(way.node_ids):
            for before, after, is_open in ((one, other, direction >= 0), (other, one, direction <= 0)):
                if is_open:
                    ways_in.setdefault(after, set()).add(before)
                    leads_on.add(before)
    return frozenset(key for key, before in ways_in.items() if len(before) > 1 and key in leads_on)


def _nodes_at_signals(osm: OsmMap, roads: Iterable[OsmWay]) -> frozenset[int]:
    """Return the nodes with a traffic signal, and those within ``AHEAD_M`` after a signal along roads.

    Maps show signals at the junction or at the stop line, and netconvert gives lights to what is ahead in the direction
    of travel. A signal that drivers reach after a junction belongs to another junction.
    """
    onwards = _onwards(roads)
    waiting = [(0.0, key) for key in onwards if _is_signal(osm.nodes[key])]
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


def _first_junctions(osm: OsmMap, roads: Iterable[OsmWay], junctions: frozenset[int]) -> list[tuple[int, int]]:
    """Return the signals, each with the first of the junctions that drivers reach after it on every way.

    The junctions are at most ``SIGNAL_REACH_M`` ahead.
    """
    onwards = _onwards(roads)
    found = []
    for signal in (key for key in onwards if _is_signal(osm.nodes[key])):
        waiting, reached = [(0.0, signal)], set[int]()
        while waiting:
            behind_m, key = heappop(waiting)
            if key in reached:
                continue
            reached.add(key)
            if key in junctions:
                found.append((signal, key))
                continue
            for other in onwards[key]:
                further_m = behind_m + ground_distance_m(osm.nodes[key].position, osm.nodes[other].position)
                if other not in reached and further_m <= SIGNAL_REACH_M:
                    heappush(waiting, (further_m, other))
    return found


def _is_signal(node: OsmNode) -> bool:
    return node.tags.get("highway") == "traffic_signals"


def _onwards(roads: Iterable[OsmWay]) -> dict[int, list[int]]:
    """Return the nodes that drivers reach next from each node."""
    onwards: dict[int, list[int]] = {}
    for way in roads:
        direction = direction_of(way)
        for one, other in pairwise(way.node_ids):
            onwards.setdefault(one, []).extend([other] if direction >= 0 else [])
            onwards.setdefault(other, []).extend([one] if direction <= 0 else [])
    return onwards
