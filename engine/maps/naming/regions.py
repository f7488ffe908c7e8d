"""States and provinces that people write after a city (``Seattle, WA``), and the regions at a position.

Their names are those of the CLDR, of ISO 3166-2 and of GeoNames (``scripts/make_regions.py``). The towns of GeoNames
determine their location: a position is in the state of its nearest town.
"""

import gzip
import json
import math
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

from .places import place_keys

_FILE = Path(__file__).parent / "regions.json.gz"
_DOUBT = 2.0
"""A state is possible if its nearest town is at most this many times as far as the nearest town.

Of 2,994 smaller towns of GeoNames that are not in the table, 98.6% are in a possible state, and 81% have a single
one.
"""
Position = tuple[float, float]


@dataclass(frozen=True)
class Region:
    """A state or province: ISO 3166-2 code without the country (empty if unknown), keys of its names, towns."""

    code: str
    names: frozenset[str]
    towns: tuple[Position, ...]

    def away_deg(self, position: Position) -> float:
        """Return the distance of its nearest town from a position, in degrees of latitude."""
        narrowing = math.cos(math.radians(position[0]))
        return min(
            math.hypot(latitude - position[0], narrowing * _turned(longitude - position[1]))
            for latitude, longitude in self.towns
        )


@cache
def _table() -> dict[str, list[dict[str, Any]]]:
    table: dict[str, list[dict[str, Any]]] = json.loads(gzip.decompress(_FILE.read_bytes()))["regions"]
    return table


@cache
def _regions(country: str) -> tuple[Region, ...]:
    """Return all states and provinces of a country (ISO 3166-1 alpha-3)."""
    told = _table().get(country, ())
    return tuple(Region(one["code"], frozenset(one["names"]), _towns(one["towns"])) for one in told)


def _towns(steps: list[int]) -> tuple[Position, ...]:
    latitudes, longitudes = accumulate(steps[::2]), accumulate(steps[1::2])
    return tuple((north / 100, east / 100) for north, east in zip(latitudes, longitudes, strict=True))


def _turned(degrees: float) -> float:
    """Return an angle wrapped to [-180°, 180°)."""
    return (degrees + 180.0) % 360.0 - 180.0


def region_of(text: str, country: str | None, latitude: float, longitude: float) -> bool:
    """Return whether a text refers to a state or province of the country that a position may be in."""
    keys = place_keys(text)
    if country is None or all(keys.isdisjoint(region.names) for region in _regions(country)):
        return False
    return any(not keys.isdisjoint(region.names) for region in regions_at(country, latitude, longitude))


@lru_cache(maxsize=4096)
def regions_at(country: str, latitude: float, longitude: float) -> tuple[Region, ...]:
    """Return the states or provinces of a country that a position may be in, the most likely first."""
    away_deg = [(region.away_deg((latitude, longitude)), number) for number, region in enumerate(_regions(country))]
    least = min(away_deg, default=(0.0, 0))[0]
    return tuple(_regions(country)[number] for deg, number in sorted(away_deg) if deg <= _DOUBT * least)
