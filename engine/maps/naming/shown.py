"""Finds the places in an OpenStreetMap extract: settlements, their parts, addresses, administrative areas."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ....schemas.generation import PlaceArea
from ....schemas.maps import Box
from ..osm import OsmMap, ground_distance_m
from .gazetteer import Settlement, settlement_around, settlements_called
from .places import fold
from .tags import CITY_PEOPLE, MOST_NAMES, PLACE_KINDS, SETTLEMENTS, TOWN_PEOPLE, place_names_of

_PART_RANKS = range(PLACE_KINDS.index("suburb"), PLACE_KINDS.index("hamlet"))
"""Kinds of parts of a settlement; the settlement has its middle in one of them."""
MOST_PLACES = 400
"""Maximum number of place names in a map's facts, the most important first (chosen)."""
MOST_AREAS = 500
"""Maximum number of places with an area in a map's facts (chosen)."""
_TOWN_KEYS = ("addr:city", "addr:town", "addr:village", "addr:municipality")
_PART_KEYS = (
    "addr:suburb",
    "addr:district",
    "addr:subdistrict",
    "addr:quarter",
    "addr:neighbourhood",
    "addr:hamlet",
    "addr:place",
)
"""OSM's address tags for a settlement, and for a part of one."""
_LOOKED_UP = 3
"""Maximum number of towns of addresses looked up in the gazetteer, the most frequent ones (chosen)."""
_SAME_M = 50_000.0
"""A settlement of the gazetteer farther away is another one of the same name (chosen)."""
_DISTRICT_LEVELS = range(6, 12)
"""OSM's ``admin_level`` of districts, municipalities and their parts; lower ones are states and countries."""
USUAL_RADIUS_M = {
    "city": 10_000.0,
    "town": 3000.0,
    "village": 1500.0,
    "suburb": 1500.0,
    "borough": 3000.0,
    "quarter": 1000.0,
    "neighbourhood": 700.0,
    "hamlet": 500.0,
    "isolated_dwelling": 200.0,
    "square": 200.0,
    "locality": 500.0,
}
"""Maximum reach of a place without an outline, by its kind (chosen)."""
LEAST_RADIUS_M = 400.0
"""Minimum reach of a place's area: a site needs room (chosen)."""
Position = tuple[float, float]


@dataclass(frozen=True)
class _Outline:
    """A place on the map: its tags, its middle in degrees, and its reach (None if it is only a point)."""

    tags: Mapping[str, str]
    middle: Position
    reach_m: float | None
    names: tuple[str, ...]

    @property
    def rank(self) -> int:
        return PLACE_KINDS.index(self.tags["place"])

    @property
    def own_names(self) -> tuple[str, ...]:
        """All names, starting with the name in the local language."""
        return tuple(dict.fromkeys((*filter(None, (self.tags.get("name", "").strip(),)), *self.names)))

    @property
    def people(self) -> int:
        """The inhabitants on the map, or 0 if unknown."""
        digits = self.tags.get("population", "").replace(",", "").replace(" ", "")
        return int(digits) if digits.isascii() and digits.isdecimal() else 0


def places_shown(osm: OsmMap) -> list[str]:
    """Return the names of the places on a map, most important first, each once.

    Importance is decided by the kind of place, then by its inhabitants, then by its area. A settlement known only from
    addresses, or mapped only as a part of another one, has the importance that GeoNames gives it. If it is too far away
    for the map to be in it, the settlements on the map come first. Parts of settlements in addresses and administrative
    areas follow. A map that contains only parts of a settlement gets the name of the settlement that GeoNames has
    around it.
    """
    outlines = _outlines(osm)
    middle = (osm.bounds[0] + osm.bounds[2]) / 2, (osm.bounds[1] + osm.bounds[3]) / 2
    ranked = [(one.rank + 0.0, -one.people, False, -(one.reach_m or 0.0), one.own_names) for one in outlines]
    is_settled = any(one.tags["place"] in SETTLEMENTS for one in outlines)
    known = {fold(name) for one in outlines for name in one.names}
    of_settlements = {fold(name) for one in outlines if one.tags["place"] in SETTLEMENTS for name in one.names}
    towns, parts = _addressed(osm, _TOWN_KEYS), _addressed(osm, _PART_KEYS)
    for town in [town for town in towns if fold(town) not in of_settlements][:_LOOKED_UP]:
        near = [
            one
            for one in settlements_called(town)
            if ground_distance_m(middle, (one.latitude, one.longitude)) < _SAME_M
        ]
        if not of_settlements.isdisjoint(fold(name) for one in near for name in one.names):
            continue  # the map has it under another name
        if not near and fold(town) in known:
            continue
        people = max((one.population for one in near), default=0)
        ranked.append((_rank_of_addressed(near, middle, osm.bounds), -people, True, 0.0, (town,)))
        of_settlements |= {fold(name) for one in near for name in one.names}
    ranked.sort()
    if not towns and not is_settled and any(one.rank in _PART_RANKS for one in outlines):
        around = settlement_around(middle, beyond_m=USUAL_RADIUS_M["suburb"])
        ranked[:0] = [] if around is None else [(0.0, 0, True, 0.0, (around.name,))]
    names = [names[0] for *_, names in ranked] + [name for *_, names in ranked for name in names[1:3]]
    shown: dict[str, str] = {}
    for name in (*names[:MOST_PLACES], *towns, *parts, *_districts(osm)):
        shown.setdefault(fold(name), name)
    return list(shown.values())


def _rank_of_addressed(near: Sequence[Settlement], middle: Position, bounds: Box) -> float:
    """Return the rank in ``PLACE_KINDS`` of a town in addresses, from GeoNames entries of its name near the map.

    A town with only its outskirts on the map comes after the map's own towns, and a town farther away comes after its
    villages: addresses also name post towns, municipalities and provinces.
    """
    people = max((one.population for one in near), default=0)
    rank = PLACE_KINDS.index("city" if people >= CITY_PEOPLE else "town" if people >= TOWN_PEOPLE else "village")
    if not near or any(_is_on(bounds, one) or _is_within(middle, one, wide=False) for one in near):
        return rank
    is_outskirt = any(_is_within(middle, one, wide=True) for one in near)
    return max(rank, PLACE_KINDS.index("town" if is_outskirt else "village") + 0.5)


def _is_within(position: Position, settlement: Settlement, *, wide: bool) -> bool:
    away_m = ground_distance_m(position, (settlement.latitude, settlement.longitude))
    return away_m <= settlement.reach_m(wide=wide)


def _is_on(bounds: Box, settlement: Settlement) -> bool:
    south, west, north, east = bounds
    return south <= settlement.latitude <= north and west <= settlement.longitude <= east


def _addressed(osm: OsmMap, keys: tuple[str, ...]) -> list[str]:
    """Return the values of the given address tags, tag by tag, most frequent first."""
    counted: dict[str, Counter[str]] = {key: Counter() for key in keys}
    for tags in _all_tags(osm):
        for key in keys:
            if (name := tags.get(key, "").strip()) and not name.isdecimal():
                counted[key][name] += 1
    return [name for key in keys for name, _ in sorted(counted[key].items(), key=lambda pair: (-pair[1], pair[0]))]


def _all_tags(osm: OsmMap) -> Iterator[Mapping[str, str]]:
    yield from (node.tags for node in osm.nodes.values() if node.tags)
    yield from (way.tags for way in osm.ways)
    yield from (relation.tags for relation in osm.relations)


def _districts(osm: OsmMap) -> list[str]:
    """Return the names of administrative areas with borders on the map, smallest first."""
    found: list[tuple[int, tuple[str, ...]]] = []
    for relation in osm.relations:
        level = relation.tags.get("admin_level", "")
        is_district = level.isdecimal() and int(level) in _DISTRICT_LEVELS
        if relation.tags.get("boundary") == "administrative" and is_district:
            found.append((-int(level), tuple(place_names_of(relation.tags))))
    return [name for _, names in sorted(found) for name in names[:MOST_NAMES]]


def _outlines(osm: OsmMap) -> list[_Outline]:
    """Return the places of a map: points and outlines in the order of the file.

    An outline that crosses the edge of the extract is open, because the nodes beyond the edge are missing. It is
    included, too.
    """
    found: list[tuple[Mapping[str, str], Position, float | None]] = []
    found += [(node.tags, node.position, None) for node in osm.nodes.values() if node.tags.get("place") in PLACE_KINDS]
    ways = {way.way_id: way for way in osm.ways}
    found += [
        (way.tags, *_middle_and_reach([osm.nodes[key].position for key in way.node_ids]))
        for way in osm.ways
        if way.tags.get("place") in PLACE_KINDS
    ]
    for relation in osm.relations:
        if relation.tags.get("place") in PLACE_KINDS:
            lines = [ways[number] for kind, number, _ in relation.members if kind == "way" and number in ways]
            if points := [osm.nodes[key].position for line in lines for key in line.node_ids]:
                found.append((relation.tags, *_middle_and_reach(points)))
    return [
        _Outline(tags, middle, reach, tuple(names)) for tags, middle, reach in found if (names := place_names_of(tags))
    ]


def _middle_and_reach(points: list[Position]) -> tuple[Position, float]:
    south, north = min(p[0] for p in points), max(p[0] for p in points)
    west, east = min(p[1] for p in points), max(p[1] for p in points)
    middle = ((south + north) / 2, (west + east) / 2)
    return middle, max(ground_distance_m(middle, point) for point in points)


def areas_shown(osm: OsmMap) -> tuple[PlaceArea, ...]:
    """Return settlements and their parts with their locations, most important first.

    A place with a point and an outline is one place, located at its point. A place without an outline reaches at most
    half way to the next place of its size.
    """
    places = sorted(enumerate(_outlines(osm)), key=lambda pair: (pair[1].rank, -pair[1].people, pair[0]))[:MOST_AREAS]
    merged: dict[str, PlaceArea] = {}
    for _, place in places:
        key = fold(place.names[0])
        if key in merged:
            kept = merged[key]
            others = dict.fromkeys((*kept.other_names, *(name for name in place.names if name != kept.name)))
            merged[key] = kept.model_copy(update={"other_names": tuple(others)[:MOST_NAMES]})
            continue
        reach_m = place.reach_m
        if reach_m is None:
            near = (
                ground_distance_m(place.middle, other.middle) / 2
                for _, other in places
                if other.rank <= place.rank
                and fold(other.names[0]) != key
                and (other.rank in _PART_RANKS) == (place.rank in _PART_RANKS)
            )
            reach_m = min([USUAL_RADIUS_M[place.tags["place"]], *near])
        merged[key] = PlaceArea(
            name=place.names[0],
            kind=place.tags["place"],
            other_names=place.names[1:],
            latitude=place.middle[0],
            longitude=place.middle[1],
            radius_m=round(max(reach_m, LEAST_RADIUS_M)),
        )
    return tuple(merged.values())
