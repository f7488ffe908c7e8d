"""Resolves the name of a place: asks Nominatim, and decides which of its results the user means.

Nominatim knows settlements, roads and sights, but no intersections. An intersection is found where the lines of its
roads meet.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any

from iso3166 import countries_by_alpha2

from ....schemas.errors import UnknownName
from ....schemas.maps import Box, LocatedPlace, LocateRequest, NamedPlace
from ....schemas.text import cited, one_line, shown_name
from ...execution import ProgressReporter
from ..index import NOT_SHOWN, crossing_parts, listed_parts
from ..naming.places import fold
from ..naming.tags import NAME_KEYS
from ..osm import ground_distance_m
from .services import ServiceClient

SAME_PLACE_M = 20_000.0
"""Findings closer together than this are one place: a town and its boundary, the pieces of a road (chosen)."""
LESS_KNOWN = 0.1
"""A place of the same name that is less important by this difference is not offered as a candidate (chosen)."""
LEAST_IMPORTANCE = 0.3
"""Minimum importance of something that is neither settlement nor road, if no town is given with its name (chosen)."""
CROSSING_M = 80.0
"""Maximum distance between the courses of two crossing roads: carriageways are apart (chosen)."""
MOST_FOUND = 40
"""Maximum number of findings from Nominatim."""
MOST_CANDIDATES = 6
"""Maximum number of places in a question or a refusal (chosen)."""
_ROAD_KINDS = frozenset({"highway", "road"})
_FAR_AROUND = ("state", "region", "province", "country")
_AROUND = (
    "neighbourhood",
    "quarter",
    "suburb",
    "city_district",
    "borough",
    "hamlet",
    "village",
    "town",
    "city",
    "municipality",
    "county",
    "state_district",
    *_FAR_AROUND,
)
"""Keys of Nominatim's addresses for enclosing areas, the nearest first."""
_TERRITORIES = {
    "US": frozenset(["AS", "GU", "MP", "PR", "UM", "VI"]),
    "FR": frozenset(["BL", "GF", "GP", "MF", "MQ", "NC", "PF", "PM", "RE", "WF", "YT"]),
    "NL": frozenset(["AW", "BQ", "CW", "SX"]),
    "CN": frozenset(["HK", "MO"]),
}
"""ISO 3166-1 codes that are also codes of parts (ISO 3166-2) of a country."""


def locate_place(request: LocateRequest, report: ProgressReporter) -> LocatedPlace:
    """Find the place that the text refers to; return several candidates if it is ambiguous.

    Raises:
        UnknownName: Nominatim knows no such place.
        ServiceFailure: Nominatim cannot be reached.
        NotPossible: the settings do not allow the request.
    """
    report(0.0, "looking up the place")
    client = ServiceClient(request.services, report)
    search = _Search(client, request.country)
    crossing = _roads_of_crossing(request.place)
    found = search.crossing(*crossing) if crossing else search.find(request.place)
    if not found:
        first, *rest = listed_parts(request.place) or [""]
        roads, town = crossing or ([first], ", ".join(rest))
        found = search.within(roads, town) if town else []
    if not found:
        where = f" in {request.country}" if request.country else ""
        raise UnknownName(
            f"no available map contains {request.place!r}, and {search.service} knows no such place{where}",
            next_step="use a map's spelling, add the town, or import an .osm extract of the place",
            reason=NOT_SHOWN,
        )
    several = _best_matches(found, request.place)
    if len(several) > 1:
        return LocatedPlace(place=None, candidates=tuple(several), service=search.service, kept=search.kept)
    return LocatedPlace(place=several[0], service=search.service, kept=search.kept)


class _Search:
    """Searches Nominatim; ``service`` is the host that answered, and ``kept`` is True if all answers were cached."""

    def __init__(self, client: ServiceClient, country: str | None) -> None:
        self._client, self._country = client, country
        self.service, self.kept = "", True

    def find(self, words: str) -> list[NamedPlace]:
        """Return all of Nominatim's results in the given country, most important first."""
        parameters: dict[str, int | str] = {
            "q": words,
            "format": "jsonv2",
            "addressdetails": 1,
            "namedetails": 1,
            "polygon_geojson": 1,
            "polygon_threshold": "0.0002",
            "dedupe": 0,
            "limit": MOST_FOUND,
        }
        if self._country is None:
            return self._found(parameters)
        code = _alpha2(self._country)
        found = self._found(parameters | {"countrycodes": code}) if code is not None else []
        # OpenStreetMap treats territories as parts of their country, ISO 3166 does not
        return found or [place for place in self._found(parameters) if place.country == self._country.upper()]

    def _found(self, parameters: Mapping[str, int | str]) -> list[NamedPlace]:
        answered = self._client.search(parameters)
        self.service, self.kept = answered.service, self.kept and answered.kept
        return _pieces_joined([place for entry in answered.answer if (place := _place_of_finding(entry)) is not None])

    def crossing(self, roads: Sequence[str], town: str) -> list[NamedPlace]:
        """Return the intersections of the roads, one for each town."""
        found = [[place for place in self.find(f"{road}, {town}" if town else road) if place.lines] for road in roads]
        if not all(found):
            return []
        crossings = [crossing for pair in product(*found[:2]) if (crossing := _crossing(*pair)) is not None]
        return crossings or (found[0] if town else [])

    def within(self, roads: Sequence[str], town: str) -> list[NamedPlace]:
        """Return the settlements with the name ``town``, with the roads to look for on a map.

        The map may contain the roads even if Nominatim does not know them.
        """
        hints = tuple((road,) for road in roads)
        return [place.model_copy(update={"roads": hints}) for place in self.find(town) if place.is_settlement]


def _roads_of_crossing(text: str) -> tuple[list[str], str] | None:
    """Return the roads of an intersection and the town, or None if the text is not an intersection."""
    parts = listed_parts(text)
    roads = crossing_parts(parts[0]) if parts else []
    return (roads, ", ".join(parts[1:])) if len(roads) == 2 else None


def _place_of_finding(entry: Mapping[str, Any]) -> NamedPlace | None:
    """Return the place in a result of Nominatim, or None if it has no name or no position on earth."""
    try:
        address = entry.get("address", {})
        south, north, west, east = (float(value) for value in entry["boundingbox"])
        names = _names(entry)
        category = str(entry.get("category", ""))
        return NamedPlace(
            label=_label(names[0] if names else str(entry["display_name"]), address),
            name=names[0] if names else one_line(str(entry["display_name"]).partition(",")[0]),
            names=tuple(names),
            around=tuple(dict.fromkeys(one_line(str(address[key])) for key in _AROUND if address.get(key))),
            kind="road" if _is_road(entry) else _kind(entry, category),
            osm_id=f"{entry.get('osm_type', '')}/{entry.get('osm_id', '')}",
            latitude=float(entry["lat"]),
            longitude=float(entry["lon"]),
            box=(south, west, north, east),
            country=_country(address),
            importance=min(max(float(entry.get("importance") or 0.0), 0.0), 1.0),
            lines=_lines(entry.get("geojson", {})) if _is_road(entry) else (),
            roads=(tuple(names),) if _is_road(entry) else (),
        )
    except (KeyError, ValueError, TypeError, AttributeError):
        return None


def _is_road(entry: Mapping[str, Any]) -> bool:
    return entry.get("category") == "highway" and entry.get("osm_type") == "way"


def _kind(entry: Mapping[str, Any], category: str) -> str:
    if category in ("boundary", "place"):
        return one_line(str(entry.get("addresstype") or entry.get("type") or category))
    return one_line(str(entry.get("type") or category))


def _names(entry: Mapping[str, Any]) -> list[str]:
    details = entry.get("namedetails") or {}
    keys = [key for key in details if key.partition(":")[0] in (*NAME_KEYS, "ref")]
    keys.sort(key=lambda key: (key != "name:en", key != "name", key))
    first = [str(entry["name"])] if entry.get("name") else []
    every = [*first, *(part for key in keys for part in str(details[key]).split(";"))]
    return list(dict.fromkeys(one_line(name) for name in every if name.strip()))


def _label(name: str, address: Mapping[str, Any]) -> str:
    """Return a place's name with the town, state and country that distinguish it from other places."""
    town = next((address[key] for key in ("city", "town", "village", "municipality", "county") if address.get(key)), "")
    far = [address[key] for key in ("state", "country") if address.get(key)]
    return ", ".join(dict.fromkeys(one_line(str(part)) for part in (name, town, *far) if part))


def _lines(shape: Mapping[str, Any]) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Return the lines of a GeoJSON shape, each as points (latitude, longitude) in degrees."""
    coordinates = shape.get("coordinates", [])
    kind = shape.get("type")
    lines = [coordinates] if kind == "LineString" else coordinates if kind in ("MultiLineString", "Polygon") else []
    return tuple(tuple((float(lat), float(lon)) for lon, lat, *_ in line) for line in lines)


def _pieces_joined(found: Iterable[NamedPlace]) -> list[NamedPlace]:
    """Return the results with the ways of one road merged; OpenStreetMap splits a road wherever something changes."""
    joined: list[NamedPlace] = []
    for place in found:
        same = next((index for index, other in enumerate(joined) if place.lines and _is_piece(place, other)), None)
        if same is None:
            joined.append(place)
        else:
            one = joined[same]
            joined[same] = one.model_copy(
                update={
                    "box": _around_both(one.box, place.box),
                    "lines": (*one.lines, *place.lines),
                    "names": tuple(dict.fromkeys((*one.names, *place.names))),
                    "around": tuple(dict.fromkeys((*one.around, *place.around))),
                    "roads": (tuple(dict.fromkeys((*one.names, *place.names))),),
                }
            )
    return joined


def _is_piece(place: NamedPlace, other: NamedPlace) -> bool:
    shared = {fold(name) for name in place.names} & {fold(name) for name in other.names}
    return bool(other.lines and shared) and _apart_m(place, other) < SAME_PLACE_M


def _around_both(one: Box, other: Box) -> Box:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _apart_m(one: NamedPlace, other: NamedPlace) -> float:
    return ground_distance_m((one.latitude, one.longitude), (other.latitude, other.longitude))


def _best_matches(found: Sequence[NamedPlace], words: str) -> list[NamedPlace]:
    """Return the place that the text means, or several places that are equally well known by this name.

    Raises:
        UnknownName: all places with the name are too unimportant for the name alone to mean one of them.
    """
    settled = [place for place in found if place.is_settlement]
    of_first_kind = settled if found[0].is_settlement else [place for place in found if not place.is_settlement]
    alone = len(listed_parts(words)) == 1
    if alone and not (found[0].is_settlement or found[0].lines):
        of_first_kind = [place for place in of_first_kind if place.importance >= LEAST_IMPORTANCE] or list(settled)
    if not of_first_kind:
        raise UnknownName(
            f"no available map contains {words!r}; Nominatim has only a {shown_name(found[0].kind)} of that name, "
            f"{cited(found[0].label)}",
            next_step="add the town, or give its bbox",
            reason=NOT_SHOWN,
        )
    different = of_first_kind[:1]  # the service's first result counts, whatever its name and importance
    for place in of_first_kind[1:]:
        known = of_first_kind[0].importance - place.importance <= LESS_KNOWN
        same_name = {fold(name) for name in place.names} & {fold(name) for name in of_first_kind[0].names}
        if known and same_name and all(_apart_m(place, other) > SAME_PLACE_M for other in different):
            different.append(place)
    labels = {place.label for place in different}
    if len(labels) < 2:  # Nominatim lists a place as often as the map has it
        return different[:1]
    return [
        next(place for place in different if place.label == label)
        for label in dict.fromkeys(place.label for place in different)
    ][:MOST_CANDIDATES]


def _crossing(one: NamedPlace, other: NamedPlace) -> NamedPlace | None:
    """Return the place where two roads come closest, or None if they never meet."""
    if _apart_m(one, other) > 2 * SAME_PLACE_M:
        return None
    from shapely import LineString, MultiLineString
    from shapely.ops import nearest_points

    narrow = math.cos(math.radians(one.latitude))

    def drawn(place: NamedPlace) -> MultiLineString:
        return MultiLineString(
            [LineString([(lon * narrow, lat) for lat, lon in line]) for line in place.lines if len(line) > 1]
        )

    here, there = (point for point in nearest_points(drawn(one), drawn(other)))
    spot, other_spot = (here.y, here.x / narrow), (there.y, there.x / narrow)
    if ground_distance_m(spot, other_spot) > CROSSING_M:
        return None
    name = f"{one.name} / {other.name}"
    return one.model_copy(
        update={
            "label": f"{name}{one.label[len(one.name) :]}" if one.label.startswith(one.name) else name,
            "name": name,
            "kind": "crossing",
            "osm_id": f"{one.osm_id} {other.osm_id}",
            "latitude": spot[0],
            "longitude": spot[1],
            "box": (*spot, *spot),
            "lines": (*one.lines, *other.lines),
            "roads": (one.names, other.names),
            "around": tuple(dict.fromkeys((*one.around, *other.around))),
        }
    )


def _alpha2(code: str) -> str | None:
    from iso3166 import countries_by_alpha3

    country = countries_by_alpha3.get(code.upper())
    return None if country is None else country.alpha2.lower()


def _country(address: Mapping[str, Any]) -> str | None:
    """Return the ISO 3166-1 alpha-3 code for an address; a territory with a code of its own gets that code."""
    code = str(address.get("country_code", "")).upper()
    parts = {str(value).rpartition("-")[2] for key, value in address.items() if key.startswith("ISO3166-2-lvl")}
    own = sorted(parts & _TERRITORIES.get(code, frozenset()))
    country = countries_by_alpha2.get(own[0] if own else code)
    return None if country is None else country.alpha3
