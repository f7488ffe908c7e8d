"""Maps from the net: which services may be asked and how, and what place some words mean.

The settings are made of these models: nothing else is imported for them.
"""

from typing import Literal

from pydantic import Field

from .base import Model

Box = tuple[float, float, float, float]
"""(south, west, north, east) in degrees."""
OnlineMode = Literal["offline", "cache", "online"]
"""``offline``: nothing is asked, and no kept answer is used; ``cache``: kept answers only; ``online``: the services."""
NOMINATIM_URL = "https://nominatim.openstreetmap.org"
OVERPASS_URLS = (
    "https://overpass-api.de/api",
    "https://overpass.kumi.systems/api",
    "https://overpass.private.coffee/api",
    "https://maps.mail.ru/osm/tools/overpass/api",
)
"""The paper's four services, in the order in which they are asked."""


class MapServices(Model):
    """Where places and roads may be asked for, how politely, and where answers are kept.

    ``user_agent``: names the program to the services, as their policies ask. ``delay_s``: least time between two
    requests to one host, of all processes on the workspace. ``timeout_s``: of one request. ``cache``: folder of the
    kept answers; ``cache_days``: older ones are asked for again. ``most_km2``: largest area of one download.
    """

    mode: OnlineMode = "offline"
    nominatim_url: str = NOMINATIM_URL
    overpass_urls: tuple[str, ...] = OVERPASS_URLS
    user_agent: str = ""
    delay_s: float = 1.0
    timeout_s: float = 30.0
    cache: str = ""
    cache_mb: int = 500
    cache_days: float = 90.0
    most_km2: float = 10.0

    @property
    def hosts(self) -> tuple[str, ...]:
        """The hosts (with their ports) that a request may go to; no other."""
        urls = (self.nominatim_url, *self.overpass_urls)
        return tuple(dict.fromkeys(url.partition("://")[2].partition("/")[0] for url in urls))


class NamedPlace(Model):
    """A place on earth as Nominatim knows it.

    ``names``: all of its names, ``around``: those of what it lies in, the nearest first. ``kind``: what it is (city,
    road, bus_stop …). ``lines``: a road's course, (latitude, longitude) each. ``country``: ISO 3166-1 alpha-3.
    ``importance``: Nominatim's, in [0, 1].
    """

    label: str
    name: str
    names: tuple[str, ...] = ()
    around: tuple[str, ...] = ()
    kind: str
    osm_id: str
    latitude: float
    longitude: float
    box: Box
    country: str | None = None
    importance: float = 0.0
    lines: tuple[tuple[tuple[float, float], ...], ...] = ()
    roads: tuple[tuple[str, ...], ...] = Field(
        (), description="the roads that were asked for, by all names that are known of each"
    )

    @property
    def is_settlement(self) -> bool:
        """Return whether it is a settlement, a part of one or a region."""
        return self.kind in SETTLEMENTS


SETTLEMENTS = frozenset(
    [
        "city",
        "town",
        "village",
        "hamlet",
        "municipality",
        "borough",
        "suburb",
        "quarter",
        "neighbourhood",
        "city_district",
        "district",
        "county",
        "state_district",
        "state",
        "province",
        "region",
        "island",
        "country",
        "administrative",
        "locality",
        "isolated_dwelling",
    ]
)
"""Nominatim's kinds of settlements, their parts and regions."""


class LocateRequest(Model):
    """A place in the user's words, to be looked up; ``country``: ISO alpha-3, where the user names it."""

    services: MapServices
    place: str
    country: str | None = None


class LocatedPlace(Model):
    """What the words mean. ``place`` None: several places, of which ``candidates`` are the best known.

    ``service``: the host that said so; ``kept``: it said so before, and was not asked again.
    """

    place: NamedPlace | None
    candidates: tuple[NamedPlace, ...] = ()
    service: str = ""
    kept: bool = False
