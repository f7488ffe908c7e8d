"""Finds an available map by a user's description: place, street, intersection, road number, id, box.

The database stores the result for each file in the map folders, so each file is unpacked and read only once.
"""

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cache, lru_cache, partial
from itertools import islice, product, takewhile
from pathlib import Path

from ...schemas.errors import UnknownName, with_values
from ...schemas.generation import MapFacts, MapList, PlaceArea, ScenarioType
from ...schemas.maps import Box, NamedPlace
from ...schemas.text import LONGEST_TEXT, cited, cited_all
from ..workspace import Database, versions_of
from .naming.alike import (
    SHORTEST_BEGUN,
    beginning,
    has_initials,
    is_abbreviated,
    is_begun_with,
    is_half_of,
    is_inflected,
    is_long_enough,
    is_some_words_of,
    is_transliterated,
    is_with_kind,
)
from .naming.gazetteer import Settlement, settlements_called
from .naming.places import countries_spelt_like, country_code, fold, latin, place_keys
from .naming.regions import region_of
from .naming.spellings import (
    HYPHENS,
    MOST_KEPT,
    adds_number,
    distinctive,
    enclitics_of,
    ends_in_section,
    has_same_numbers,
    has_words_of,
    initials_of_network,
    is_class_of_roads,
    is_joined_by_particle,
    is_one_number,
    is_only_a_kind,
    is_section,
    kinds_of_road,
    names_a_street,
    proclitics_of,
    road_keys,
    road_readings,
    route_number,
    whole_road_keys,
    without_kinds,
    words_for_crossings,
    words_of_name,
)
from .naming.tags import CITY_PEOPLE, PLACE_KINDS, ROAD_PLACES, SETTLEMENTS

LIBRARY = Path(__file__).parent / "library"
NOT_SHOWN = "not_shown"
"""The refusal's reason if no map shows the place, the country or the box."""
_NEAREST_SHOWN = 4
"""Maximum number of maps that a refusal of a box lists (chosen)."""
_NEAR_KM = 50.0
"""A settlement farther from a map is another one of the same name (chosen)."""
_EARTH_RADIUS_KM = 6371.0088
"""Mean radius of the Earth (IUGG)."""


_JOINING = ("at", "near", "bei", "by")
_BEFORE_BOTH = (
    r"(?:the\s+)?(?:corner|intersection|junction|crossing)\s+(?:of|between)",
    "ecke",
    "kreuzung(?: von)?",
    "(?:angle|croisement) (?:de|du)",
    "перекр[её]сток",
)
"""Words before or between the roads of a crossing that libpostal lacks; East Asia writes them without blanks."""
_SHORTEST_OF_FILE = 5
"""Minimum length of a word in a file's name that may be a place (chosen)."""
_NO_PLACES = frozenset(
    [
        "planet",
        "extract",
        "export",
        "excerpt",
        "complete",
        "intersection",
        "crossing",
        "junction",
        "roundabout",
        "highway",
        "highways",
        "motorway",
        "street",
        "streets",
        "service",
        "roads",
        "bridge",
        "tunnel",
        "lanes",
        "lights",
        "signals",
        "traffic",
        "track",
        "cycleway",
        "rural",
        "urban",
        "small",
        "large",
        "north",
        "south",
        "middle",
        "center",
        "centre",
        "without",
        "nodes",
        "restriction",
        "boundary",
        "overlapping",
        "oneway",
    ]
)
"""Words in file names that state the kind of map (chosen): there is no standard for file names."""
_PLACE_WORDS = (
    r"city|town|village|quarter|district|suburb|borough|ward|parish|county|township|municipality|neighbou?rhood|stadt(?:teil)?|viertel|"
    r"gemeinde|bezirk|(?:land)?kreis|ville|commune|quartier|arrondissement|ciudad|municipio|barrio|distrito|"
    r"cidade|bairro|freguesia|concelho|citt[aà]|comune|quartiere|miasto|gmina|powiat|kommune?n?|wijk|gemeente|"
    r"ilçe(?:si)?|mahalle(?:si)?|г\.?|город|район|(?:муниципальный )?округ|м[іi]сто"
)
"""Words for a kind of place before or after its name: OSM's values of ``place``, and the wiki's words for
municipalities and their parts in its table of ``admin_level`` in these languages.
"""
_PLACE_FRAME = re.compile(
    rf"^\d{{4,6}}\s+|\s+\d{{5}}(?:-\d{{4}})?$|^(?:the\s+)?(?:{_PLACE_WORDS})(?:\s+(?:of|de|do|da|di|von))?\s+"
    rf"|\s+(?:{_PLACE_WORDS})$|(?<=[\u4e00-\u9fff])[市区區县縣里]$|(?<=[\uac00-\ud7a3])[시구군동]$",
    re.IGNORECASE,
)
_FILE_ENDINGS = re.compile(r"(?:\.(?:osm|pbf|xml|net|xodr|roads|pb|gz|bz2))+$", re.IGNORECASE)
_HOUSE_NUMBER = re.compile(r"\s+\d+\s?[a-z]?$|^\d+[a-z]?\s+", re.IGNORECASE)
_NUMBER_AND_NETWORK = re.compile(r"(?P<network>[^\W\d_]+(?: [^\W\d_]+)*)[\s.-]*(?P<number>\d+[A-Za-z]?)")
_BARE_NUMBER = re.compile(r"(?P<network>)(?P<number>\d+[A-Za-z]?)")
_POSTCODE = re.compile(
    r"^(?:[a-z]{1,2}-)?\d[\d-]{2,8}(?: \d{2,3}| ?[a-z]{2})?\s+(?=\D)"
    r"|\s+(?!\d{1,2}$)(?=\S*\d)[a-z\d]{2,8}(?:[ -][a-z\d]{2,4})?$",
    re.IGNORECASE,
)
"""A postcode before or after a town: one or two groups of Latin letters and digits (``10115``, ``W1F 9QP``)."""
_DISTRICT_NUMBER = re.compile(r"\s+(?:\d{1,2}(?:e|er|[°º.])?|[ivx]+)$", re.IGNORECASE)
_HYPHEN = re.compile(f"[{HYPHENS}]")
_CROSSING_SIGNS = re.compile(r"[/&+×@]")
"""Signs between the roads of a crossing. A text with one names two roads, so no single name can be like all of it."""
_WORDS_BEFORE, _WORDS_AFTER = 3, 2
"""Maximum number of words before the first of two roads (chosen): a preposition, a noun and its preposition; and of
words after the second one.
"""
_PREPOSITIONS = frozenset(("in", "at", "near", "im", "bei", "à", "a", "en", "em", "nel", "в", "i", "w", "of", "auf"))
"""Words between a road and its place: libpostal's stopwords that express a location."""
_EARTH_RADIUS_M = 6_371_008.8
_LEAST_LIKENESS, _LEAST_WORD_LIKENESS, _TELLING_LETTERS = 78, 85, 4
"""Minimum similarity (of 100) of a name, or of its words, for a suggestion; minimum length of these words (chosen)."""
_MOST_NEAR, _COMPARED = 4, 2000
"""Maximum number of suggestions, and of compared names (chosen)."""
_MOST_ERRORS, _LETTERS_AN_ERROR = 2, 4
"""Maximum number of misspelt letters in a name, and minimum number of letters in the name for each (chosen)."""
_FEW_WORDS = 4
"""Maximum number of words in a text for inexact matches of both the place and the road (chosen)."""
_SHOWN_ROADS, _MOST_WORDS, _LONGEST_UNSPACED = 3, 12, 24
"""Maximum numbers of roads that a sentence lists, of words tried in all splits, and of letters (chosen)."""


class Closeness(IntEnum):
    """How closely a text must match the names on a map.

    SAME: the map's own name, in any spelling. TRANSLATED: GeoNames's name for one of its places in another language.
    KNOWN: a settlement that GeoNames has at the map's location. HEARD: the text sounds like the map's name in another
    script, or shortens it. PLACE_PART: a part or the beginning of a place's name. PART: a part or the beginning of a
    road's name.
    """

    SAME = 0
    TRANSLATED = 1
    KNOWN = 2
    HEARD = 3
    PLACE_PART = 4
    PART = 5


@dataclass(frozen=True)
class MapEntry:
    """An available map: its facts and its file."""

    facts: MapFacts
    path: Path


@dataclass(frozen=True)
class MapMatch:
    """A map that contains the requested place.

    ``streets``: the streets, by their names on the map, that the site must be on. ``unnamed``: words of the request
    that the map does not contain, although it has the street next to them. ``area``: the requested part of the map;
    None means all of it. ``understood``: a sentence for each interpretation of words that differ from the names on the
    map. ``longer``: for each of several streets, other streets with longer names that contain its words.
    """

    entry: MapEntry
    streets: tuple[tuple[str, ...], ...] = ()
    unnamed: tuple[str, ...] = ()
    area: PlaceArea | None = None
    understood: tuple[str, ...] = ()
    longer: tuple[tuple[str, ...], ...] = ()

    @property
    def widened(self) -> "MapMatch | None":
        """A match of the whole map, if streets outside their place's circle are acceptable; otherwise None.

        The circle of a town is mostly a guess, and an intersection of streets is unique. A quarter, however, states
        which part of a single street is requested.
        """
        if self.area is None or not self.streets:
            return None
        if self.area.kind not in SETTLEMENTS and len(self.streets) < 2:
            return None
        note = f"the streets are outside {_area_text(self.area)}; the whole map was searched"
        kept = tuple(text for text in self.understood if not text.endswith(_area_text(self.area)))
        return replace(self, area=None, understood=(*kept, note))

    @property
    def box(self) -> Box | None:
        """The box to search: around ``area``, and within the part of a fetched map with complete roads.

        The box is None if neither limits it. If they don't overlap, it is the part with complete roads.
        """
        area = None if self.area is None else _box_around(self.area)
        core = None if self.entry.facts.source is None else self.entry.facts.source.core
        if area is None or core is None:
            return area or core
        south, west = max(area[0], core[0]), max(area[1], core[1])
        north, east = min(area[2], core[2]), min(area[3], core[3])
        return (south, west, north, east) if south < north and west < east else core


@cache
def built_in_maps() -> tuple[MapEntry, ...]:
    """Return the maps that come with the package, by id; they never change, so they are read once."""
    listed = MapList.model_validate_json((LIBRARY / "catalogue.json").read_bytes())
    return tuple(MapEntry(facts, LIBRARY / facts.file_name) for facts in listed.maps)


def find_maps(
    maps: Sequence[MapEntry],
    *,
    place: str | None = None,
    country: str | None = None,
    bbox: Box | None = None,
    scenario_type: ScenarioType = "any",
    closeness: Closeness = Closeness.PART,
) -> list[MapMatch]:
    """Return all maps that fit, in the given order, but those with the requested type of site first.

    If no map has the exact name, similar names count, down to the given closeness.

    Raises:
        UnknownName: no map covers the place, country or box; the error lists what is available, closest first.
    """
    if not maps:
        raise UnknownName("there is no map", next_step="import an .osm file with import_files")
    everywhere = matches = [MapMatch(entry, ()) for entry in maps]
    code = None if country is None else country_code(country) or country.upper()
    if country is not None and code is not None:
        matches = _in_country(matches, country, code)
    if bbox is not None:
        matches = _in_box(matches, bbox)
    if place is not None:
        shown = _showing(matches, place, code, closeness)
        if not shown:
            raise _not_shown_error(place, country, bbox, matches, _showing(everywhere, place, code, closeness))
        matches = shown
    return sorted(
        matches,
        key=lambda match: (
            len(match.unnamed) * 2 + (scenario_type != "any" and scenario_type not in match.entry.facts.sites)
        ),
    )


def match_fetched(entry: MapEntry, place: NamedPlace | None, asked: str | None) -> MapMatch:
    """Return the match of a fetched map with the requested place, even if the map has other names for the place."""
    if asked is None:
        return MapMatch(entry)
    try:
        return find_maps([entry], place=asked, closeness=Closeness.SAME)[0]
    except UnknownName:
        label = "" if place is None else place.label
        taken = (f"{asked!r} is read as {cited(label)}",) if label and fold(label) != fold(asked) else ()
        return MapMatch(entry, _streets_of(entry.facts, place), understood=taken)


def _streets_of(facts: MapFacts, place: NamedPlace | None) -> tuple[tuple[str, ...], ...]:
    """Return the requested roads by their names on the map, without those that the map does not have."""
    if place is None:
        return ()
    known = {fold(name): name for name in (*facts.streets, *facts.refs)}
    named = (tuple(known[fold(name)] for name in names if fold(name) in known) for names in place.roads)
    return tuple(names for names in named if names)


def same_street(one: str, other: str) -> bool:
    """Return whether two spellings refer to one street; case, accents, script and abbreviations may differ."""
    return bool(road_keys(one) & road_keys(other))


def _in_country(matches: list[MapMatch], country: str, code: str) -> list[MapMatch]:
    """Return the maps in a country, and maps of unknown country to which no other country is nearer."""
    fitting = [match for match in matches if code in _countries(match.entry.facts) or not _countries(match.entry.facts)]
    if not fitting:
        known = sorted({code for match in matches for code in _countries(match.entry.facts)})
        raise UnknownName(
            f"no map covers the country {country!r}",
            valid=known,
            next_step="import a map of this country",
            reason=NOT_SHOWN,
            remedies=[
                *(with_values(country=one) for one in countries_spelt_like(country) if one in known),
                with_values(country=None),
            ],
        )
    return fitting


def _countries(facts: MapFacts) -> tuple[str, ...]:
    """Return the countries that a map is or may be in, and others that it shows; empty if they are unknown."""
    return facts.countries_near if facts.country is None else (facts.country, *facts.countries_near)


def _in_box(matches: list[MapMatch], bbox: Box) -> list[MapMatch]:
    south, west, north, east = bbox
    fitting = [
        match
        for match in matches
        if south <= match.entry.facts.north
        and north >= match.entry.facts.south
        and west <= match.entry.facts.east
        and east >= match.entry.facts.west
    ]
    if not fitting:
        nearest = sorted((match.entry.facts for match in matches), key=lambda facts: _km_between(_box_of(facts), bbox))
        raise UnknownName(
            f"no map covers any part of the box {list(bbox)}",
            valid=[f"{_box_text(f)}, {_km_between(_box_of(f), bbox):,.0f} km away" for f in nearest[:_NEAREST_SHOWN]],
            next_step="choose a box inside one of these maps, which are the nearest",
            reason=NOT_SHOWN,
            remedies=[with_values(bbox=list(_box_of(facts))) for facts in nearest[:1]],
        )
    return fitting


def _box_of(f: MapFacts) -> Box:
    return f.south, f.west, f.north, f.east


def _km_between(one: Box, other: Box) -> float:
    """Return the distance between the middles of two boxes on a sphere (haversine formula)."""
    (south, west), (north, east) = (
        (math.radians((box[0] + box[2]) / 2), math.radians((box[1] + box[3]) / 2)) for box in (one, other)
    )
    half = math.sin((north - south) / 2) ** 2 + math.cos(south) * math.cos(north) * math.sin((east - west) / 2) ** 2
    return 2.0 * _EARTH_RADIUS_KM * math.asin(math.sqrt(min(half, 1.0)))


def _box_text(f: MapFacts) -> str:
    return f"{cited(f.place)} [{f.south:.4f}, {f.west:.4f}, {f.north:.4f}, {f.east:.4f}]"


def _showing(found: list[MapMatch], place: str, country: str | None, closeness: Closeness) -> list[MapMatch]:
    """Return maps on which each part of the text (``street, city`` or ``street A / street B``) is a place or road.

    Only the closest matches count. If the text has the town of an available map after a comma, only maps that contain
    this town count, so that ``Oxford Street, Sydney`` does not match an intersection in another town.
    """
    if (town := _find_town(place[:LONGEST_TEXT], found)) is not None:
        found = [map_ for map_ in found if map_ in town.maps or _read_place(town.words, map_.entry.facts) is not None]
    for level in range(closeness + 1):
        matches = (_match(map_.entry, place[:LONGEST_TEXT], country, Closeness(level)) for map_ in found)
        if shown := [match for match in matches if match is not None]:
            shown = [match for match in shown if not match.streets] or shown  # a town rather than a road of its name
            is_half = closeness is Closeness.PART
            return _add_incomplete_roads(shown, found, place[:LONGEST_TEXT], Closeness(level)) if is_half else shown
    return []


@dataclass(frozen=True)
class _Town:
    """A town that follows a street in a text: its name, the other parts of the text, and the maps of the town."""

    words: str
    others: tuple[str, ...]
    maps: tuple[MapMatch, ...]

    @property
    def roads(self) -> list[str]:
        """The roads in the other parts, one by one."""
        return [part for listed in self.others for part in crossing_parts(listed)]


def _is_on_map(facts: MapFacts, part: str) -> bool:
    return _read_part(part, facts, Closeness.HEARD) is not None


def _find_town(place: str, found: Sequence[MapMatch]) -> _Town | None:
    """Return the last comma-separated part that is the town of an available map; None if the text has only one part."""
    listed = listed_parts(place)
    for index in reversed(range(len(listed) if len(listed) > 1 else 0)):
        if maps := tuple(map_ for map_ in found if _is_town_of(listed[index], map_.entry.facts)):
            return _Town(listed[index], (*listed[:index], *listed[index + 1 :]), maps)
    return None


def _is_town_of(part: str, facts: MapFacts) -> bool:
    """Return whether the text is the map's place, or a settlement that the map or GeoNames has in its area."""
    towns = (area for area in facts.areas if area.kind in SETTLEMENTS)
    names = (facts.place, *(name for area in towns for name in (area.name, *area.other_names)))
    keys = frozenset[str]().union(*map(_framed_keys, names))
    return any(
        not keys.isdisjoint(_framed_keys(text))
        or _read_name_elsewhere(text, facts) is not None
        or _read_settlement(text, facts, wide=True) is not None
        for text in _with_and_without_region(part, facts)
    )


def _with_and_without_region(part: str, facts: MapFacts) -> list[str]:
    """Return the text, and what is left without a postcode, and the map's state or country (``Mountain View CA``)."""
    texts = tuple(dict.fromkeys((part, _POSTCODE.sub("", part))))
    return [*texts, *(head for text in texts for head, tail in _splits(text) if _is_around(tail, facts))]


def _add_incomplete_roads(shown: list[MapMatch], found: list[MapMatch], text: str, level: Closeness) -> list[MapMatch]:
    """Add the roads that begin with the text to the matches, since its last word may be incomplete.

    ``Rue de B`` is a spelling of ``B Street``, and the beginning of ``Rue de Bretagne``. This adds no roads to a place,
    to a road with exactly this name, or to one that the text abbreviates (``Main St``: ``Main Street``).
    """
    names = {name for match in shown for group in match.streets for name in group}
    is_telling = any(map(distinctive, road_readings(text)))  # more than a kind of road
    if (is_telling and any(fold(name) == fold(text) for name in names)) or not all(match.streets for match in shown):
        return shown
    begun = {map_.entry.facts.map_id: roads for map_ in found if (roads := _roads_begun(text, map_.entry.facts))}
    is_short_for_one = level is Closeness.SAME and not names.isdisjoint(name for one in begun.values() for name in one)
    if is_telling and is_short_for_one:
        return shown
    kept = {match.entry.facts.map_id for match in shown}
    joined = [_joined(match, begun.get(match.entry.facts.map_id, ()), text) for match in shown]
    others = [map_ for map_ in found if map_.entry.facts.map_id not in kept]
    return joined + [
        _as_match(map_.entry, begun[map_.entry.facts.map_id], text)
        for map_ in others
        if map_.entry.facts.map_id in begun
    ]


def _joined(match: MapMatch, begun: tuple[str, ...], text: str) -> MapMatch:
    """Add the roads to a match as alternatives, or replace its roads if the text was read as several names."""
    if not begun:
        return match
    is_one = len(match.streets) == 1 and match.area is None and not match.unnamed
    return _as_match(match.entry, tuple(dict.fromkeys((*match.streets[0], *begun) if is_one else begun)), text)


def _as_match(entry: MapEntry, roads: tuple[str, ...], text: str) -> MapMatch:
    reading = _as_roads(text, roads)
    return MapMatch(entry, reading.streets, understood=reading.understood)


def place_parts(place: str) -> list[str]:
    """Split the text of a place at commas and at the words for an intersection."""
    return [part for listed in listed_parts(place) for part in crossing_parts(listed)]


def listed_parts(place: str) -> list[str]:
    """Split the text of a place at commas; the number of a section stays with its road (``Taiwan Blvd., Sec. 4``)."""
    parts = [part.strip() for part in re.split(r"[,;，；]", place) if part.strip()]
    return _with_sections(parts) if any(map(is_section, parts)) else parts


def _with_sections(parts: Sequence[str]) -> list[str]:
    """Return the parts with each section joined to the road before it, or to the next part if there is none."""
    joined: list[str] = []
    waiting = ""
    for part in parts:
        if not is_section(part):
            joined.append(f"{part} {waiting}" if waiting.isascii() and waiting else part + waiting)
            waiting = ""
        elif joined and names_a_street(joined[-1]):
            joined[-1] += f" {part}" if part.isascii() else part
        else:
            waiting = part
    return [*joined, waiting] if waiting else joined


def crossing_parts(text: str) -> list[str]:
    """Return the roads of an intersection (``A & B``, ``A at B``, ``corner of A and B``, ``A/B``), or the text."""
    inner = _crossing_patterns()[1].sub("", text).strip()
    ends = [0, *(end for joint in _joints(inner) for end in joint.span()), len(inner)]
    parts = (inner[start:end].strip() for start, end in zip(ends[::2], ends[1::2], strict=True))
    return [part for part in parts if part]


def _joints(text: str) -> list[re.Match[str]]:
    """Return the words and signs between roads, without those inside a number (``Rua Vinte e Cinco``)."""
    return [
        joint
        for joint in _crossing_patterns()[0].finditer(text)
        if _CROSSING_SIGNS.search(joint[0]) or not is_one_number(text[: joint.start()], joint[0], text[joint.end() :])
    ]


def _two_parts(text: str) -> Iterator[list[str]]:
    """Yield the ways to read a text with several words or signs for an intersection as only two roads.

    A word may belong to a name, such as the Portuguese *e* in ``A / Rua Vinte e Cinco de Julho``, so signs come first.
    """
    inner = _crossing_patterns()[1].sub("", text).strip()
    joints = [joint for joint in _joints(inner) if joint.start() > 0 and joint.end() < len(inner)]
    if len(joints) > 1:
        for joint in sorted(joints, key=lambda joint: _CROSSING_SIGNS.search(joint[0]) is None):
            yield [inner[: joint.start()].strip(), inner[joint.end() :].strip()]


@cache
def _crossing_patterns() -> tuple[re.Pattern[str], re.Pattern[str]]:
    """Return patterns for the words between the roads of an intersection, and for those before or after them."""
    joining, corners = words_for_crossings()
    phrases = sorted({*map(re.escape, corners), *_BEFORE_BOTH}, key=lambda phrase: (-len(phrase), phrase))
    words = "|".join([*map(re.escape, (*joining, *_JOINING)), *phrases])
    between = rf"\s*[/&+×@、]\s*|\s+(?:(?:{words})\.?\s+)+|\s+(?:と|和|与)\s+|(?<=[路街道])[与和](?=[\u4e00-\u9fff])"
    around = rf"^(?:{'|'.join(phrases)})\s+|\s*(?:路口|交叉口|交差点)$"
    return re.compile(between, re.IGNORECASE), re.compile(around, re.IGNORECASE)


def _not_shown_error(
    place: str, country: str | None, bbox: Box | None, matches: list[MapMatch], elsewhere: list[MapMatch]
) -> UnknownName:
    """Return the error that no remaining map covers the place; if others do, it blames the box or country."""
    if elsewhere:
        limits = [f"the box {list(bbox)}"] if bbox is not None else []
        limits += [f"{country!r}"] if country is not None else []
        return UnknownName(
            f"no map contains {place!r} in {' and '.join(limits)}: it is elsewhere",
            valid=[_box_text(match.entry.facts) for match in elsewhere],
            next_step=f"leave {' and '.join(['bbox'] * (bbox is not None) + ['country'] * (country is not None))} out, "
            "or choose another place",
            reason=NOT_SHOWN,
            remedies=[with_values(bbox=None, country=None)],
        )
    nameless = [
        match.entry.facts
        for match in matches
        if not match.entry.facts.places and any(roads_called(part, match.entry.facts) for part in place_parts(place))
    ]
    if nameless:
        return UnknownName(
            f"no map contains {place!r}; {nameless[0].map_id} has a road of this name, but does not state its place",
            valid=[facts.map_id for facts in nameless],
            next_step="give the road alone, give its country, or add the map with its place",
            reason=NOT_SHOWN,
        )
    shown = sorted({match.entry.facts.place for match in matches})
    town = _find_town(place[:LONGEST_TEXT], matches)
    why = ""
    if town is not None:
        near = _near_in_town(town)
        own = town.maps[0].entry.facts
        missing = [part for part in town.roads if not any(_is_on_map(map_.entry.facts, part) for map_ in town.maps)]
        why = f": {cited(own.place)} ({own.map_id}) is available, but has no {cited_all(missing or town.roads, ' or ')}"
    else:
        towns = [part for part in listed_parts(place[:LONGEST_TEXT])[1:] if country_code(part) is None]
        names = {
            name for part in towns for map_ in matches for name in _with_and_without_region(part, map_.entry.facts)
        }
        is_elsewhere = any(settlements_called(without_frame(name)) for name in names)
        near = [] if is_elsewhere else _near(place[:LONGEST_TEXT], [match.entry.facts for match in matches])
    corrected = _corrected(place[:LONGEST_TEXT], matches if town is None else town.maps)
    near = list(dict.fromkeys((*corrected, *near)))[:_MOST_NEAR]
    if near:
        return UnknownName(
            f"no map contains {place!r}{why}",
            valid=map(cited, near),
            next_step="import an .osm extract of the place with import_files",
            reason=NOT_SHOWN,
            remedies=[with_values(place=one) for one in near],
        )
    return UnknownName(
        f"no map contains {place!r} or a similar name",
        valid=map(cited, shown),
        next_step="import an .osm extract of the place with import_files",
        reason=NOT_SHOWN,
    )


def _corrected(place: str, found: Sequence[MapMatch]) -> list[str]:
    """Return the text with misspelt names corrected as on a map that has everything else in it, fewest errors first."""
    parts = place_parts(place)
    errors: dict[str, int] = {}
    for map_ in found:
        facts = map_.entry.facts
        wrong = [part for part in parts if not _is_on_map(facts, part)]
        if not wrong or (len(parts) > 1 and len(wrong) == len(parts)):
            continue
        corrections = [_closest(part, facts) for part in wrong]
        for names in islice(product(*corrections), _MOST_NEAR):
            text = place
            for part, (_, name) in zip(wrong, names, strict=True):
                text = text.replace(part, name, 1)
            if _showing([map_], text, None, Closeness.KNOWN):
                errors[text] = min(sum(count for count, _ in names), errors.get(text, _MOST_ERRORS * len(parts)))
    return sorted(errors, key=lambda text: (errors[text], text))


def _closest(part: str, facts: MapFacts) -> list[tuple[int, str]]:
    """Return the names on a map that differ from a text in a few letters, with the number of these errors.

    A letter is missing, superfluous or wrong, or two neighbours are swapped. A word for the kind of road may be absent.
    """
    from rapidfuzz import process
    from rapidfuzz.distance import OSA

    found: dict[str, int] = {}
    for typed, names in zip(_letters(part), _letters_of_names(facts), strict=True):
        most = min(_MOST_ERRORS, len(typed) // _LETTERS_AN_ERROR)
        if most:
            for _, count, name in process.extract(typed, names, scorer=OSA.distance, score_cutoff=most, limit=None):
                if kinds_of_road(part) <= kinds_of_road(name) or typed == fold(part):
                    found[name] = min(count, found.get(name, count))
    return sorted((count, name) for name, count in found.items())[:_MOST_NEAR]


def _letters_of_names(facts: MapFacts) -> tuple[dict[str, str], dict[str, str]]:
    """Return the letters of each name on a map: of the whole name, and of its words other than the kind of road."""
    areas = (area.name for area in facts.areas)
    names = dict.fromkeys(
        (*facts.streets, *facts.places, *areas, *(one for names in facts.road_names for one in names))
    )
    pairs = {name[:LONGEST_TEXT]: _letters(name[:LONGEST_TEXT]) for name in names if _is_single(name)}
    return {name: pair[0] for name, pair in pairs.items()}, {name: pair[1] for name, pair in pairs.items()}


@lru_cache(maxsize=MOST_KEPT)
def _is_single(name: str) -> bool:
    return len(place_parts(name)) == 1


@lru_cache(maxsize=MOST_KEPT)
def _letters(name: str) -> tuple[str, str]:
    return fold(name), "".join(word for word in words_of_name(name) if not kinds_of_road(word))


def _near_in_town(town: _Town) -> list[str]:
    """Return the streets of an available town that resemble the other parts of a text, followed by the town."""
    scores: dict[str, float] = {}
    for match in town.maps:
        facts = match.entry.facts
        for name in (*facts.streets, *facts.refs):
            if len(place_parts(name)) != 1:
                continue
            spelling = name[:LONGEST_TEXT]
            likeness = max((_likeness(_telling(part), _telling(spelling)) for part in town.roads), default=0.0)
            if likeness >= _LEAST_LIKENESS:
                scores[name] = max(scores.get(name, 0.0), likeness)
    streets = sorted(scores, key=lambda name: (-scores[name], name))[: _MOST_NEAR - 1]
    towns = [town.words, *(match.entry.facts.place for match in town.maps)]
    whole = next((one for one in towns if _showing(list(town.maps), one, None, Closeness.KNOWN)), None)
    names = (f"{name}, {town.words}" for name in streets)
    near = [name for name in names if _showing(list(town.maps), name, None, Closeness.KNOWN)]
    return [*near, *([] if whole is None else [whole])]


def _near(place: str, shown: Sequence[MapFacts]) -> list[str]:
    """Return names that resemble the text or a part of it in spelling or sound, most similar first."""
    parts = [
        part for part in dict.fromkeys((place, *place_parts(place))) if len(part) >= _TELLING_LETTERS or part == place
    ]
    words = _words(place)
    named: dict[str, str] = {}
    for facts in shown:
        for name in (facts.place, *facts.places, *(area.name for area in facts.areas)):
            named.setdefault(name, name)
        for name in (*facts.streets, *facts.refs):
            named.setdefault(name, f"{name}, {facts.place}" if len(parts) > 1 else name)
    names = sorted(named, key=lambda name: (words.isdisjoint(_words(name)), name))[:_COMPARED]
    choices = [(name, _telling(name[:LONGEST_TEXT])) for name in names]
    scores: dict[str, float] = {}
    for part in parts:
        asked = _telling(part)
        for name, telling in choices:
            if (likeness := _likeness(asked, telling)) >= _LEAST_LIKENESS:
                scores[named[name]] = max(scores.get(named[name], 0.0), likeness)
    return sorted(scores, key=lambda name: (-scores[name], name))[:_MOST_NEAR]


def _likeness(asked: tuple[str, ...], telling: tuple[str, ...]) -> float:
    """Return the similarity of two names in spelling or sound (0 to 100); a part of a name scores nearly as high."""
    from rapidfuzz import fuzz

    together = fuzz.ratio("".join(asked), "".join(telling), score_cutoff=_LEAST_LIKENESS)
    heard = fuzz.ratio(_sound("".join(asked)), _sound("".join(telling)), score_cutoff=_LEAST_LIKENESS)
    long = [word for word in asked if len(word) >= _TELLING_LETTERS]
    each = [max((fuzz.ratio(word, other) for other in telling), default=0.0) for word in long]
    return max(together, heard, min(each) - 1 if each and min(each) >= _LEAST_WORD_LIKENESS else 0.0)


@lru_cache(maxsize=MOST_KEPT)
def _telling(name: str) -> tuple[str, ...]:
    """Return the distinctive words of a name, in Latin letters; if it has none, return all of its words."""
    readings = road_readings(name)
    telling = distinctive(frozenset.intersection(*readings)) if readings else frozenset()
    return tuple(sorted(telling)) or tuple(latin(word) for word in name.split())


@lru_cache(maxsize=MOST_KEPT)
def _sound(text: str) -> str:
    """Return a rough phonetic form, in which doubled letters and letters that sound alike become one letter."""
    for letters, sound in (("sch", "s"), ("sh", "s"), ("ph", "f"), ("ck", "k"), ("th", "t"), ("ee", "i"), ("oo", "u")):
        text = text.replace(letters, sound)
    text = text.replace("h", "").translate(str.maketrans("czwyq", "ksvik"))
    return re.sub(r"(.)\1+", r"\1", text)


def _match(entry: MapEntry, place: str, country: str | None, closeness: Closeness) -> MapMatch | None:
    """Return the map with the requested streets if it covers every part of the place, or None.

    A part that is not on the map is accepted under two conditions. Another part is a street on the map, and the map is
    identified: by a part of the text that refers to it or, if the map has no place names, by the caller's country.
    """
    facts = entry.facts
    reading = _read_whole(place, facts)
    if reading is None:
        listed = listed_parts(place)
        if not listed:
            return None
        reading = _Reading()
        namesakes = False
        settled = any(country_code(part) in _countries(facts) for part in listed)
        for part in listed:
            found = (
                _read_whole(part, facts)
                or _read_roads_of_crossing(part, facts)
                or _read_together(part, facts, Closeness.SAME)
                or _read_part(
                    part, facts, Closeness.SAME if _CROSSING_SIGNS.search(part) else closeness, settled=settled
                )
                or _read_crossing(part, facts, closeness)
                or _read_together(part, facts, closeness)
                or _read_roads_in_a_phrase(part, facts, closeness)
                or _read_after_proclitic(part, facts, closeness)
                or (_read_with_postcode(part, facts, closeness) if part != listed[0] else None)
                or (_read_own_town_and_more(part, facts) if part != listed[0] else None)
            )
            if found is None and country_code(part) not in (None, *_countries(facts)) and len(part) > 3:
                return None
            if found is None and _is_a_crossing(part):
                return None  # a crossing needs both of its roads
            namesakes = namesakes or (len(listed) > 1 and found is not None and _is_town_elsewhere(part, found, facts))
            reading += found or _Reading(unnamed=(part,))
        if facts.places and not reading.placed and (namesakes or (reading.unnamed and reading.named)):
            return None  # the state or the country alone does not tell in which of its towns the street is
    if any(_is_outside(part, facts) for part in reading.unnamed):
        return None
    reading = _match_file_name(reading, facts)
    if reading.named:
        reading = _match_road_names(reading, facts)
    if reading.streets and reading.area is not None and _is_called(reading.area, facts.place):
        reading = _without_area(reading, reading.area)
    known = reading.named or (not facts.places and country in _countries(facts))
    if reading.unnamed and not (reading.streets and known):
        return None
    longer = _longer_names(reading, facts)
    return MapMatch(entry, reading.streets, reading.unnamed, reading.area, reading.understood, longer)


def _longer_names(reading: "_Reading", facts: MapFacts) -> tuple[tuple[str, ...], ...]:
    """Return the roads with longer names for each of several roads in a reading; empty if there are none.

    People shorten the names of the roads of a crossing, and a short form may be the whole name of another road
    (``Olmedo`` for ``José Olmedo``). Which of them is meant is known only where the roads meet.
    """
    if len(reading.streets) < 2:
        return ()
    found = frozenset(name for roads in reading.streets for name in roads)
    longer = tuple(_roads_with(part, found, facts) for part in reading.typed)
    return longer if any(longer) else ()


def _roads_with(part: str, found: frozenset[str], facts: MapFacts) -> tuple[str, ...]:
    """Return the roads, except those found, that have all words of a name; a number allows only a kind or direction."""
    asked = [words for words in road_readings(part) if distinctive(words)]
    numbers = {distinctive(words) for words in asked if all(map(str.isdecimal, distinctive(words)))}
    index = _road_index((*facts.streets, *facts.refs), facts.road_names)
    return tuple(
        name
        for name, spellings in index.spellings.items()
        if name not in found
        and any(
            has_words_of(held, words) and (not numbers or distinctive(held) in numbers)
            for words in asked
            for held in _all_readings(spellings)
        )
    )


def _is_a_crossing(part: str) -> bool:
    """Return whether the text has several names, and one of them has a word for a kind of road."""
    names = crossing_parts(part)
    return len(names) > 1 and any(kinds_of_road(name) and not is_only_a_kind(name) for name in names)


def _is_town_elsewhere(part: str, found: "_Reading", facts: MapFacts) -> bool:
    """Return whether a text that was read as a road is rather a settlement that the map does not show.

    ``Napoli`` in ``Via Roma, Napoli`` is the city, even on a map of another city with a ``Via Napoli``. A text with a
    word for a kind of road, or with exactly the road's name, is the road.
    """
    if not found.streets or found.placed:
        return False
    exact = {fold(road) for roads in found.streets for road in roads}
    return any(
        fold(name) not in exact
        and not kinds_of_road(name)
        and any(
            settlement.population >= CITY_PEOPLE or settlement.country in _countries(facts)
            for settlement in settlements_called(without_frame(name))
        )
        for name in _with_and_without_region(part, facts)
    )


def _without_area(reading: "_Reading", area: PlaceArea) -> "_Reading":
    """Drop the circle of the map's own town from a reading, where it is only the context of the requested road."""
    told = (text.replace(_area_text(area), cited(area.name)) for text in reading.understood)
    return replace(reading, area=None, understood=tuple(text for text in told if text != cited(area.name)))


def _match_file_name(reading: "_Reading", facts: MapFacts) -> "_Reading":
    """Return the reading with words of the map's file name accepted, since people name files after places."""
    named = _words_of_file_name(file_stem(facts.file_name))
    rest = replace(reading, unnamed=())
    for part in reading.unnamed:
        by_file = _Reading(placed=True, understood=(f"{part!r} is read as the map {cited(facts.file_name)}",))
        rest += by_file if fold(part) in named else _Reading(unnamed=(part,))
    return rest


def _match_road_names(reading: "_Reading", facts: MapFacts) -> "_Reading":
    """Return the reading with words accepted that a road of the map is named after, if the text gives the map's place.

    For example, ``Northgate`` is accepted because of ``NE Northgate Way``, although no place on the map has this name.
    """
    rest = replace(reading, unnamed=())
    for part in reading.unnamed:
        rest += _read_road(part, facts, core=True) or _Reading(unnamed=(part,))
    return rest


@dataclass(frozen=True)
class _Reading:
    """The meaning of a text on a map.

    ``placed``: the text refers to the map's place or a part of it. ``around``: it refers to the map's state or country.
    ``typed``: the words that were read as each of the streets.
    """

    streets: tuple[tuple[str, ...], ...] = ()
    unnamed: tuple[str, ...] = ()
    area: PlaceArea | None = None
    understood: tuple[str, ...] = ()
    placed: bool = False
    around: bool = False
    typed: tuple[str, ...] = ()

    @property
    def named(self) -> bool:
        """Whether the text refers to the map, a part of it, or a region around it."""
        return self.placed or self.around

    def __add__(self, other: "_Reading") -> "_Reading":
        areas = [area for area in (self.area, other.area) if area is not None]  # the district rather than its city
        return _Reading(
            self.streets + other.streets,
            self.unnamed + other.unnamed,
            min(areas, key=lambda area: (-PLACE_KINDS.index(area.kind), area.radius_m), default=None),
            self.understood + other.understood,
            self.placed or other.placed,
            self.around or other.around,
            self.typed + other.typed,
        )


def _read_part(part: str, facts: MapFacts, closeness: Closeness, *, settled: bool = False) -> _Reading | None:
    """Read the text as one place or one road; return None if it is neither of these."""
    return _read_whole(part, facts) or _read_road(part, facts) or _read_alike(part, facts, closeness, settled=settled)


def _read_whole(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as the whole name of a place or a road.

    A square is read as its roads, if it has any. The position of a place is unknown if only addresses or borders name
    it; then the name is read as the road with exactly this name.
    """
    place = _read_place(part, facts)
    is_square = place is not None and place.area is not None and place.area.kind in ROAD_PLACES
    if place is not None and not is_square and not _is_a_road_s_name(part, facts):
        return place
    return _read_road(part, facts, whole=True) or place


def _is_a_road_s_name(part: str, facts: MapFacts) -> bool:
    """Return whether a road has exactly this name, and neither the map nor a located place on it does."""
    word = fold(part)
    places = (facts.map_id, facts.place, *(name for area in facts.areas for name in (area.name, *area.other_names)))
    return word in map(fold, facts.streets) and word not in map(fold, places)


def _read_alike(
    part: str, facts: MapFacts, closeness: Closeness, *, wide: bool = False, settled: bool = False
) -> _Reading | None:
    """Read the text as a place or a road with a similar name.

    ``wide``: the map may be in the outskirts of a settlement, because a road is given with it. ``settled``: other words
    refer to a place of the map, so this text does not refer to a place elsewhere.
    """
    if closeness is Closeness.SAME or not any(map(str.isalpha, part)):
        return None
    found = _read_name_elsewhere(part, facts)
    if found is None and closeness >= Closeness.KNOWN:
        found = _read_settlement(part, facts, wide=wide or settled) or _read_postal_district(part, facts)
    if found is None and closeness >= Closeness.HEARD:
        alike = (is_transliterated, is_abbreviated, is_with_kind)
        readings = (read(part, facts, is_like) for is_like in alike for read in (_read_place_like, _read_road_like))
        found = next((reading for reading in readings if reading is not None), None)
        found = found or _read_initials(part, facts)
    if found is None and closeness >= Closeness.PLACE_PART and (settled or not _is_elsewhere(part, facts)):
        words = without_frame(part)
        is_half = is_some_words_of if _is_outside(part, facts) else is_half_of  # ``Lyon``: no ``Place du Lyonnais``
        found = _read_place_like(words, facts, is_half)
        if found is None and closeness is Closeness.PART:
            found = _read_road_like(words, facts, is_half)
    return found


def _read_name_elsewhere(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as GeoNames's name for a place of the map in another language."""
    for settlement in settlements_called(without_frame(part)):
        if settlement.country not in _countries(facts) and not _is_near(settlement, facts):
            continue
        for name in (facts.place, *facts.places, *(area.name for area in facts.areas)):
            if not settlement.keys.isdisjoint(place_keys(name)) and (found := _read_place(name, facts)) is not None:
                return replace(found, understood=(f"{part!r} is read as {cited(name)}",))
    return None


def _read_settlement(part: str, facts: MapFacts, *, wide: bool) -> _Reading | None:
    """Read the text as a settlement that GeoNames has at the map's location but the map does not have."""
    for settlement in settlements_called(without_frame(part)):
        away_m = 1000.0 * _km_between(_as_box(settlement), _nearest_spot(settlement, facts))
        if away_m <= settlement.reach_m(wide=wide):
            where = f"{away_m / 1000:.1f} km from the map" if away_m else "inside the map"
            taken = f"{part!r} is {settlement.name} in GeoNames; its centre is {where}"
            return _Reading(placed=True, understood=(taken,))
    return None


def _read_own_town_and_more(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text behind a road as the map's town with a word for a part that no gazetteer has (``Nairobi CBD``)."""
    head, _, tail = part.rpartition(" ")
    is_town = bool(head) and not place_keys(head).isdisjoint(place_keys(facts.place))
    if not is_town or not tail.isalpha() or settlements_called(part) or _is_around(part, facts):
        return None
    return _Reading(placed=True, understood=(f"{part!r} is read as {head}: the map has no part called {tail!r}",))


def _read_postal_district(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as a place of the map with a district number (``Dublin 4``, ``Praha 5``)."""
    unnumbered = _DISTRICT_NUMBER.sub("", part)
    if unnumbered == part:
        return None
    found = _read_place_by_keys(unnumbered, facts, place_keys) or _read_name_elsewhere(unnumbered, facts)
    found = found or _read_settlement(unnumbered, facts, wide=False)
    if found is None:
        return None
    return replace(found, understood=(f"{part!r} is read as {unnumbered}: the map has no district with that number",))


def _read_with_postcode(part: str, facts: MapFacts, closeness: Closeness) -> _Reading | None:
    """Read the text as a place of the map with a postcode (``London W1``), which narrows down nothing.

    Only a text behind a road can be read so: the road of ``A40 London`` is no postcode.
    """
    town = _POSTCODE.sub("", part)
    if town != part and _is_around(town, facts):  # the part after a town: ``PA 19104``
        return _Reading(around=True, understood=(f"the postcode in {part!r} is not used",))
    head, _, state = town.rpartition(" ")
    named = head if _is_state_code(state, facts) else town
    if town == part or names_a_street(named):
        return None
    found = _read_place(town, facts) or _read_together(town, facts, Closeness.SAME)
    found = found or _read_alike(town, facts, min(closeness, Closeness.KNOWN), wide=True)
    if found is None or found.streets or not found.placed:
        return None
    return replace(found, understood=(*found.understood, f"the postcode in {part!r} is not used"))


def _is_near(settlement: Settlement, facts: MapFacts) -> bool:
    return _km_between(_as_box(settlement), _nearest_spot(settlement, facts)) <= _NEAR_KM


def _is_elsewhere(part: str, facts: MapFacts) -> bool:
    """Return whether the text names a city elsewhere, and no settlement in or near the map's country."""
    known = settlements_called(without_frame(part))
    return any(settlement.population >= CITY_PEOPLE for settlement in known) and not any(
        settlement.country in _countries(facts) or _is_near(settlement, facts) for settlement in known
    )


def _middle_of(area: PlaceArea) -> Box:
    return area.latitude, area.longitude, area.latitude, area.longitude


def _as_box(settlement: Settlement) -> Box:
    return settlement.latitude, settlement.longitude, settlement.latitude, settlement.longitude


def _nearest_spot(settlement: Settlement, facts: MapFacts) -> Box:
    """Return the point of a map nearest to a settlement's centre, as a box."""
    latitude = min(max(settlement.latitude, facts.south), facts.north)
    longitude = min(max(settlement.longitude, facts.west), facts.east)
    return latitude, longitude, latitude, longitude


def _read_place_like(part: str, facts: MapFacts, is_like: Callable[[str, str], bool]) -> _Reading | None:
    """Read the text as a place of the map with a name that is similar in the given way.

    A text that is a street's name is not part of a town with a similar name (``玄武大道``: ``玄武区``).
    """
    is_street = names_a_street(part)
    for area in facts.areas:
        if is_street and area.kind not in ROAD_PLACES and not kinds_of_road(area.name):
            continue
        if any(is_like(part, name) for name in (area.name, *area.other_names)):
            found = _read_whole(area.name, facts)
            taken = cited(area.name) if found is not None and found.streets else _area_text(area)
            return None if found is None else replace(found, understood=(f"{part!r} is read as {taken}",))
    for name in facts.places:
        if is_like(part, name) and not (is_street and not kinds_of_road(name)):
            return _Reading(placed=True, understood=(f"{part!r} is read as {cited(name)}",))
    return None


def _read_road_like(part: str, facts: MapFacts, is_like: Callable[[str, str], bool]) -> _Reading | None:
    """Read the text as the roads of the map with names that are similar in the given way."""
    index = _road_index((*facts.streets, *facts.refs), facts.road_names)
    roads = tuple(name for name, spellings in index.spellings.items() if any(is_like(part, one) for one in spellings))
    return _as_roads(part, roads) if roads else None


def _read_initials(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as the only road of the map with these initials; a country's code has another meaning."""
    if country_code(part) is not None:
        return None
    found = _read_road_like(part, facts, has_initials)
    return found if found is not None and len(found.streets[0]) == 1 else None


def _read_place(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as the map itself (its id, file, place, region or country) or as a place inside it."""
    own = {facts.map_id, facts.map_id.removeprefix("map_"), file_stem(facts.file_name)}
    if {fold(part), fold(file_stem(part))} & {fold(name) for name in own}:
        return _Reading(placed=True)
    for keys_of in (place_keys, _framed_keys):
        if (found := _read_place_by_keys(part, facts, keys_of)) is not None:
            return found
    return _read_town_and_district(part, facts) or (_Reading(around=True) if _is_around(part, facts) else None)


def _read_town_and_district(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as a town and its district with a hyphen between them (``Düsseldorf-Derendorf``)."""
    for hyphen in _HYPHEN.finditer(part):
        town, district = part[: hyphen.start()], part[hyphen.end() :]
        if place_keys(facts.place).isdisjoint(place_keys(town)):
            continue
        if (found := _read_place_by_keys(district, facts, place_keys)) is not None:
            return replace(found, understood=found.understood or (f"{part!r} is read as {cited(district)}",))
    return None


def _is_around(part: str, facts: MapFacts) -> bool:
    """Return whether the text is a country or state that the map is in."""
    code = country_code(part)
    return (code is not None and code in _countries(facts)) or _is_in_state(part, facts)


def _is_in_state(part: str, facts: MapFacts) -> bool:
    """Return whether the text is a state or province that the map is in."""
    middle = (facts.south + facts.north) / 2, (facts.west + facts.east) / 2
    return any(region_of(part, country, *middle) for country in _countries(facts))


def _is_state_code(word: str, facts: MapFacts) -> bool:
    """Return whether a word is the code of the map's state, and no kind of road (``New Haven CT`` is no court)."""
    return word.isupper() and _is_in_state(word, facts)


def _is_outside(part: str, facts: MapFacts) -> bool:
    """Return whether the text is a city, or a part as large as one, that does not reach the map.

    Smaller ones do not count: many towns have a part called ``Altstadt``, and GeoNames knows only some of them.
    """
    known = settlements_called(without_frame(part))
    is_city = any(settlement.population >= CITY_PEOPLE for settlement in known)
    return is_city and _read_settlement(part, facts, wide=True) is None


def _read_place_by_keys(part: str, facts: MapFacts, keys_of: Callable[[str], frozenset[str]]) -> _Reading | None:
    """Read the text as a place inside the map, or as the map's own place, by the given keys of names.

    The map's own name means its town, never a quarter with the same name (``竹北``: ``竹北市``, not ``竹北里``).
    """
    keys = keys_of(part)
    is_own = not keys.isdisjoint(keys_of(facts.place))
    for area in facts.areas:
        if is_own and area.kind not in SETTLEMENTS and not _is_called(area, facts.place):
            continue
        if any(not keys.isdisjoint(keys_of(name)) for name in (area.name, *area.other_names)):
            widest = max(_same_place(area, facts), key=lambda one: one.radius_m)
            taken = "" if fold(part) in (fold(area.name), fold(widest.name)) else f"{part!r} is read as "
            if _is_whole(widest, facts):
                return _Reading(placed=True, understood=(f"{taken}{cited(widest.name)}",) if taken else ())
            return _Reading(placed=True, area=widest, understood=(f"{taken or 'the place is '}{_area_text(widest)}",))
    for name in (facts.place, *facts.places):
        if not keys.isdisjoint(keys_of(name)):
            alike = fold(part) == fold(name)
            return _Reading(placed=True, understood=() if alike else (f"{part!r} is read as {cited(name)}",))
    return None


def _is_called(area: PlaceArea, name: str) -> bool:
    return fold(name) in map(fold, (area.name, *area.other_names))


def _same_place(area: PlaceArea, facts: MapFacts) -> list[PlaceArea]:
    """Return the place and its duplicates of the same kind: a map may contain a place twice, in two languages.

    Duplicates share a name, and the centre of one is within the outline of the other.
    """
    names = {fold(name) for name in (area.name, *area.other_names)}
    return [
        other
        for other in facts.areas
        if other == area
        or (
            other.kind == area.kind
            and not names.isdisjoint(fold(name) for name in (other.name, *other.other_names))
            and 1000.0 * _km_between(_middle_of(area), _middle_of(other)) <= max(area.radius_m, other.radius_m)
        )
    ]


def file_stem(name: str) -> str:
    """Return a file's name without the extensions of maps; a converted map has another extension than its source."""
    return _FILE_ENDINGS.sub("", name)


def without_frame(part: str) -> str:
    """Return a place's name without a postcode and the words for its kind (``city of``, ``Stadtteil``)."""
    return _PLACE_FRAME.sub("", part)


def _words_of_file_name(stem: str) -> frozenset[str]:
    """Return the words of a file's name that may be a place, since people name extracts after their places."""
    words = {fold(word) for word in re.split(r"[\W_\d]+", stem)}
    return frozenset(word for word in words if len(word) >= _SHORTEST_OF_FILE and word not in _NO_PLACES)


def _area_text(area: PlaceArea) -> str:
    return (
        f"the {area.kind} {cited(area.name)}, {area.radius_m / 1000:.1f} km around its centre "
        f"({area.latitude:.4f}, {area.longitude:.4f})"
    )


def _is_whole(area: PlaceArea, facts: MapFacts) -> bool:
    """Return whether a place is the whole map rather than a part: the map's largest place, or one that covers it."""
    largest = _same_place(facts.areas[0], facts)
    alone = sum(other.kind == facts.areas[0].kind for other in facts.areas) == len(largest)
    if alone and area in largest and area.kind in SETTLEMENTS:
        return True
    south, west, north, east = _box_around(area)
    return south <= facts.south and west <= facts.west and facts.north <= north and facts.east <= east


def _box_around(area: PlaceArea) -> Box:
    up = math.degrees(area.radius_m / _EARTH_RADIUS_M)
    aside = up / max(math.cos(math.radians(area.latitude)), 0.05)
    return area.latitude - up, area.longitude - aside, area.latitude + up, area.longitude + aside


@lru_cache(maxsize=MOST_KEPT)
def _framed_keys(name: str) -> frozenset[str]:
    """Return the keys of a place's name, with and without the words for its kind."""
    return place_keys(name) | place_keys(without_frame(name))


def _read_road(
    part: str, facts: MapFacts, *, short: bool = False, whole: bool = False, core: bool = False
) -> _Reading | None:
    """Read the text as a road.

    ``short``: a single distinctive word suffices, as people write the roads of an intersection. ``whole``: the text
    must be the whole name. ``core``: the text is everything that distinguishes the road from other roads.
    """
    roads = roads_called(part, facts, short=short, whole=whole) if not core else _roads_after(part, facts)
    if not roads and not whole and (unnumbered := _HOUSE_NUMBER.sub("", part)) != part:
        roads = () if ends_in_section(unnumbered) else _without_other_numbers(unnumbered, facts, short=short)
    if not roads:
        return None
    return _as_roads(part, roads)


def _without_other_numbers(part: str, facts: MapFacts, *, short: bool) -> tuple[str, ...]:
    """Return the roads with a name that has no more numbers than the text, from which a house number was removed.

    ``State Highway 4`` is not ``State Highway 12``, although each of them may be ``State Highway``.
    """
    spellings = _road_index((*facts.streets, *facts.refs), facts.road_names).spellings
    roads = roads_called(part, facts, short=short)
    return tuple(name for name in roads if not all(adds_number(part, one) for one in spellings[name]))


def _as_roads(part: str, roads: tuple[str, ...]) -> _Reading:
    """Return a reading of the text as the given roads."""
    exact = {fold(name) for name in roads} == {fold(part)}
    more = f" and {len(roads) - _SHOWN_ROADS} more" * (len(roads) > _SHOWN_ROADS)
    taken = f"{part!r} is read as {cited_all(roads[:_SHOWN_ROADS], ' or ')}{more}"
    return _Reading(streets=(roads,), understood=() if exact else (taken,), typed=(part,))


def _read_crossing(text: str, facts: MapFacts, closeness: Closeness) -> _Reading | None:
    """Read the text as several roads or a road near a place; return None if one of them is unknown.

    If one road has exactly the name in the text, a second road may be of a different kind (``Colina Drive`` for
    ``Colina Street``). The roads must then meet, and the answer states the interpretation.
    """
    parts = crossing_parts(text)
    if len(parts) < 2:
        return None if parts in ([], [text]) else _read_part(parts[0], facts, closeness)
    reading = _Reading()
    of_other_kind: list[str] = []
    for part in parts:
        found = (
            _read_road(part, facts)
            or _read_place(part, facts)
            or _read_together(part, facts, closeness)
            or _read_road(part, facts, short=True)
            or _read_alike(part, facts, closeness)
        )
        if found is None and closeness >= Closeness.HEARD and (found := _read_other_kind(part, facts)) is not None:
            of_other_kind.append(part)
        if found is None:
            return None
        reading += found
    return None if of_other_kind and len(of_other_kind) == len(reading.streets) else reading


def _read_roads_of_crossing(text: str, facts: MapFacts) -> _Reading | None:
    """Read the text as roads that meet, if every part is a road, even if a quarter has the same name.

    The town of the map still counts as a place: ``Main Street at Springfield`` has a road and a town.
    """
    readings = (_read_all_roads(parts, facts) for parts in (*_two_parts(text), crossing_parts(text)))
    return next((reading for reading in readings if reading is not None), None)


def _read_all_roads(parts: Sequence[str], facts: MapFacts) -> _Reading | None:
    """Read each part as a road; return None if there is only one part, or a part is no road or is the map's town."""
    if len(parts) < 2 or any(not place_keys(part).isdisjoint(place_keys(facts.place)) for part in parts):
        return None
    reading = _Reading()
    for part in parts:
        found = _read_road(part, facts)
        if found is None and not kinds_of_road(part):
            found = _read_road(part, facts, core=True)
        if found is None:
            return None
        reading += found
    return reading


def _read_other_kind(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as a road with the same name but of a different kind.

    A number is not a name: ``5th Street`` is not ``5th Avenue``.
    """
    told_by = [distinctive(words) for words in road_readings(part)]
    is_number = any(all(map(str.isdecimal, words)) for words in told_by)
    if is_number or not kinds_of_road(part):
        return None
    roads = _roads_after(part, facts)
    return _as_roads(part, roads) if roads else None


def _read_together(text: str, facts: MapFacts, closeness: Closeness) -> _Reading | None:
    """Read the text as a road and a place side by side (``I-5 Seattle``, ``上海中山北路``), in either order."""
    for head, tail in _splits(text):
        if is_only_a_kind(head) or (is_only_a_kind(tail) and not _is_state_code(tail, facts)):
            continue  # ``Massachusetts Avenue`` is not an avenue in Massachusetts
        if (one := _read_road(head, facts, whole=True)) and (other := _read_road(tail, facts, whole=True)):
            return one + other
        whole = is_joined_by_particle(head, tail)  # ``Praia da Barra`` is one name, not half a road in Barra
        for first, second in ((head, tail), (tail, head)):
            if len(second) < 3 and second.isascii() and not second.isupper():
                continue
            place = _read_place(second, facts)
            if place is not None and place.around:  # ``Mountain View CA``: a town, and not the avenue of its name
                rest = _read_whole(first, facts)
            else:
                rest = _read_road(first, facts, whole=whole) or _read_place(first, facts)
            if rest is None and place is not None:
                rest = _read_together(first, facts, closeness)
            if rest is None and place is None and closeness is Closeness.PART and len(text.split()) <= _FEW_WORDS:
                place = _read_alike(second, facts, Closeness.KNOWN)
            if place is None and rest is not None and rest.streets:
                place = _read_alike(second, facts, closeness, wide=True)
            elif place is not None and rest is None:
                level = min(closeness, Closeness.HEARD) if whole else closeness
                rest = _read_crossing(first, facts, level) or _read_alike(first, facts, level, settled=True)
            if place is not None and rest is not None:
                return place + rest if first == tail else rest + place
            if whole and first == head and closeness is Closeness.PART and _is_named_by(place, first, facts):
                return place
    return None


def _is_named_by(place: _Reading | None, words: str, facts: MapFacts) -> bool:
    """Return whether a place on the map can have words before its name (``Praia da``), which then name no street."""
    return place is not None and place.area is not None and not (_is_whole(place.area, facts) or names_a_street(words))


def _read_roads_in_a_phrase(text: str, facts: MapFacts, closeness: Closeness) -> _Reading | None:
    """Read the text as two roads of the map in a phrase of any language (``cruce de A con B``, ``A ja B kulma``).

    The text must have the whole name of each road, with up to three words before the names and up to two between and
    after them. These words may not look like names: only the first may have a capital letter. A word between the names
    may be written together with the second one (``פינת הרצל ואלנבי``). If no names fit, the roads' names in other
    grammatical forms do (``угол Северной и Новороссийской``), or else parts of the names, as people shorten the roads
    of a crossing (``Straszewskiego róg Piłsudskiego``).
    """
    words = _CROSSING_SIGNS.sub(lambda sign: f" {sign[0]} ", text).split()
    if len(words) > _MOST_WORDS:
        return None
    phrases = [words, *([*words[:index], *pair, *words[index + 1 :]] for index, pair in _clitics_in(words))]
    readers = (partial(_read_road, whole=True), _read_inflected, partial(_read_road, short=True))
    for read in readers[: 3 if closeness >= Closeness.PART else 2 if closeness >= Closeness.HEARD else 1]:
        for first, second in (pair for phrase in phrases for pair in _two_roads(phrase)):
            if (one := read(first, facts)) is not None and (other := read(second, facts)) is not None:
                return one + other
    return None


def _clitics_in(words: Sequence[str]) -> Iterator[tuple[int, tuple[str, str]]]:
    """Yield the ways to split a word into a longer one and short words before or after it, with its position."""
    return ((index, pair) for index, word in enumerate(words) for pair in (*proclitics_of(word), *enclitics_of(word)))


def _read_after_proclitic(part: str, facts: MapFacts, closeness: Closeness) -> _Reading | None:
    """Read the text as a place or road with a preposition that is written together with it (``ברחוב הרצל``)."""
    words = part.split()
    for _, rest in proclitics_of(words[0]) if words else ():
        name = " ".join((rest, *words[1:]))
        if (found := _read_part(name, facts, min(closeness, Closeness.HEARD))) is not None:
            return replace(found, understood=found.understood or (f"{part!r} is read as {cited(name)}",))
    return None


def _two_roads(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the texts that may be the roads in a phrase of these words, the longest first."""
    for begin, after in product(range(_WORDS_BEFORE + 1), range(_WORDS_AFTER + 1)):
        end = len(words) - after
        if end - begin < 3 or not all(map(_is_no_name, (*words[1:begin], *words[end:]))):
            continue
        for between, rest in ((one, one + more) for more in (1, 2) for one in range(begin + 1, end - more)):
            joining = words[between:rest]
            first, second = " ".join(words[begin:between]), " ".join(words[rest:end])
            is_sign = any(map(_CROSSING_SIGNS.fullmatch, joining))
            if all(_CROSSING_SIGNS.fullmatch(word) or _is_no_name(word) for word in joining) and (
                is_sign or not is_one_number(first, " ".join(joining), second)
            ):
                yield first, second


def _read_inflected(part: str, facts: MapFacts) -> _Reading | None:
    """Read the text as roads with this name in another grammatical form, or as a road with exactly this name."""
    if (found := _read_road(part, facts, whole=True)) is not None:
        return found
    index = _road_index((*facts.streets, *facts.refs), facts.road_names)
    near = (index.by_beginning.get(beginning(word), {}) for word in words_of_name(part) if len(word) > SHORTEST_BEGUN)
    fewest = min(filter(None, near), key=len, default={})
    roads = tuple(name for name in fewest if any(is_inflected(part, one) for one in index.spellings[name]))
    return _as_roads(part, roads) if roads else None


def _is_no_name(word: str) -> bool:
    return not any(map(str.isupper, word)) and any(map(str.isalpha, word))


def _splits(text: str) -> Iterator[tuple[str, str]]:
    """Yield all ways to split a text in two: between words, or between letters in scripts without spaces.

    The words of one number stay together.
    """
    words = text.split()
    if len(words) == 1 and len(text) <= _LONGEST_UNSPACED and re.search(r"[\u3040-\u30ff\u4e00-\u9fff]", text):
        yield from ((text[:index], text[index:]) for index in range(2, len(text) - 1))
    if len(words) <= _MOST_WORDS:
        for index in range(1, len(words)):
            tail = words[index:]
            if is_one_number(" ".join(words[:index]), "", " ".join(tail)):
                continue
            if tail[0].casefold() in _PREPOSITIONS and len(tail) > 1:
                tail = tail[1:]
            yield " ".join(words[:index]), " ".join(tail)


@dataclass(frozen=True)
class _RoadIndex:
    """Indices of a map's roads: map order, key, key of the whole road for a section, and first letters of a word."""

    order: dict[str, int] = field(default_factory=dict)
    by_key: dict[str, list[str]] = field(default_factory=dict)
    by_whole: dict[str, list[str]] = field(default_factory=dict)
    by_beginning: dict[str, dict[str, None]] = field(default_factory=dict)
    spellings: dict[str, tuple[str, ...]] = field(default_factory=dict)


@lru_cache(maxsize=256)
def _road_index(known: tuple[str, ...], several: tuple[tuple[str, ...], ...]) -> _RoadIndex:
    others = {names[0]: names[1:] for names in several}
    index = _RoadIndex()
    for position, name in enumerate(known):
        index.order.setdefault(name, position)
        index.spellings[name] = (name, *others.get(name, ()))
        for key in {key for spelling in index.spellings[name] for key in road_keys(spelling)}:
            index.by_key.setdefault(key, []).append(name)
        for key in {key for spelling in index.spellings[name] for key in whole_road_keys(spelling)}:
            index.by_whole.setdefault(key, []).append(name)
        for word in {word for spelling in index.spellings[name] for word in words_of_name(spelling)}:
            index.by_beginning.setdefault(beginning(word), {})[name] = None
    return index


@lru_cache(maxsize=256)
def _beginnings(known: tuple[str, ...], several: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, str], ...]:
    """Return pairs of a road name's joined words and the road's main name, sorted for a search by prefix."""
    spellings = _road_index(known, several).spellings
    return tuple(sorted((" ".join(words_of_name(one)), name) for name, every in spellings.items() for one in every))


def _roads_begun(text: str, facts: MapFacts) -> tuple[str, ...]:
    """Return roads with names that begin with the words in the given order; the last word may be incomplete."""
    known, several = (*facts.streets, *facts.refs), facts.road_names
    begun = " ".join(words_of_name(text))
    if not begun or not is_long_enough(text):
        return ()
    names = _beginnings(known, several)
    first = bisect_left(names, (begun, ""))
    same = takewhile(lambda pair: pair[0].startswith(begun), names[first:])
    found = {name for words, name in same if is_begun_with(begun, words)}
    return tuple(sorted(found, key=_road_index(known, several).order.__getitem__))


def roads_called(part: str, facts: MapFacts, *, short: bool = False, whole: bool = False) -> tuple[str, ...]:
    """Return the roads with a name, including their sections; those with another main name come last.

    If there are none, return roads with all words of the name (``Loop 101`` in ``AZ 101 Loop``) or its number (``Route
    99``).
    """
    index = _road_index((*facts.streets, *facts.refs), facts.road_names)
    keys = road_keys(part) if not _CROSSING_SIGNS.search(part) else {fold(part)}  # two roads are not one of them
    called = {name for key in keys for name in index.by_key.get(key, ())}
    if any(fold(name) == fold(part) for name in called):
        # ``6. Sokak`` shares a reading with ``6. Cadde``, and is another road if the map has both.
        called = {name for name in called if any(_is_spelling(part, one) for one in index.spellings[name])}
    same = called.union(name for key in keys for name in index.by_whole.get(key, ()))
    if not same and (number := route_number(part)) is not None:
        same = {name for name in facts.refs if name.split()[-1:] == [number] or re.fullmatch(rf"[A-Z]+{number}", name)}
        initials = initials_of_network(part)  # ``RN7`` is N 7 rather than A 7
        same = {name for name in same if fold(name).removesuffix(number) in initials} or same
    if not same:
        same = _roads_of_state(part, facts)
    if not same and not whole:
        asked = [words for words in road_readings(part) if distinctive(words)]
        enough = short or len(part.replace("-", " ").split()) > 1
        same = {
            name
            for name, spellings in index.spellings.items()
            if enough and any(words <= held for words in asked for held in _all_readings(spellings))
        }
    if not same and not whole and not asked:
        # ``Северная`` is short for ``Северная улица``: a direction is the whole name of many streets.
        named = {without_kinds(words) for words in road_readings(part)} - {frozenset()}
        same = {
            name
            for name, spellings in index.spellings.items()
            if not named.isdisjoint(map(without_kinds, _all_readings(spellings)))
        }
    return tuple(sorted(same, key=lambda name: (keys.isdisjoint(road_keys(name)), index.order[name])))


def _roads_of_state(part: str, facts: MapFacts) -> set[str]:
    """Return the roads with a number that the text gives with the map's state or province (``QC-134``, ``CA-85``).

    Maps write this number alone, after the state (``CA 85``), or after a kind of road (``SR 85``).
    """
    asked = _NUMBER_AND_NETWORK.fullmatch(part.strip())
    if asked is None or not _is_in_state(asked["network"], facts):
        return set()
    held = ((name, _NUMBER_AND_NETWORK.fullmatch(name) or _BARE_NUMBER.fullmatch(name)) for name in facts.refs)
    return {
        name
        for name, ref in held
        if ref is not None
        and fold(ref["number"]) == fold(asked["number"])
        and (not ref["network"] or _is_of_state(ref["network"], facts))
    }


def _is_of_state(network: str, facts: MapFacts) -> bool:
    """Return whether the words before a road's number refer to the map's state or to no class of roads above it."""
    return _is_in_state(network, facts) or (route_number(f"{network} 1") is not None and not is_class_of_roads(network))


def _is_spelling(typed: str, name: str) -> bool:
    """Return True if a name is the typed name, abbreviated or with its numbers written differently."""
    return (
        fold(name) == fold(typed)
        or is_abbreviated(typed, name)
        or is_abbreviated(name, typed)
        or has_same_numbers(typed, name)
    )


def _roads_after(part: str, facts: MapFacts) -> tuple[str, ...]:
    """Return roads named after a word: their names otherwise contain only the kind of road and a direction."""
    index = _road_index((*facts.streets, *facts.refs), facts.road_names)
    asked = {telling for words in road_readings(part) if (telling := distinctive(words))}
    return tuple(
        name
        for name, spellings in index.spellings.items()
        if any(distinctive(words) in asked for words in _all_readings(spellings))
    )


@lru_cache(maxsize=MOST_KEPT)
def _all_readings(spellings: tuple[str, ...]) -> tuple[frozenset[str], ...]:
    return tuple(words for spelling in spellings for words in road_readings(spelling))


@lru_cache(maxsize=MOST_KEPT)
def _words(name: str) -> frozenset[str]:
    return frozenset(fold(word) for word in name.replace("-", " ").split()) - {""}


@dataclass(frozen=True)
class SeenFile:
    """A file of a map folder: the resulting map, or the reason for its refusal (the other is empty)."""

    map_id: str
    refusal: str


class SeenFiles:
    """The files that were read, by path; a file counts as new if it has changed or another program version read it."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def find(self, path: Path) -> SeenFile | None:
        """Return the result for a file, or None if it is new or missing."""
        query = "SELECT map_id, refusal FROM map_files WHERE path = ? AND stamp = ?"
        row = self._database.connection().execute(query, (str(path), _stamp(path))).fetchone()
        return None if row is None else SeenFile(row["map_id"], row["refusal"])

    def keep(self, path: Path, seen: SeenFile) -> None:
        """Store the result for a file in its current state.

        Raises:
            ResourceFailure: the database cannot be written.
        """
        row = (str(path), _stamp(path), seen.map_id, seen.refusal)
        with self._database.writing() as connection:
            connection.execute("INSERT OR REPLACE INTO map_files VALUES (?, ?, ?, ?)", row)


def _stamp(path: Path) -> str:
    """Return a file's size, modification time and this program's version; empty for a missing file."""
    try:
        stat = path.stat()
    except OSError:
        return ""
    return f"{stat.st_size} {stat.st_mtime_ns} {versions_of()}"
