"""Online maps: the services with their rules, and the places that texts refer to.

The settings consist of these models, so this module imports nothing else.
"""

from typing import Literal

from pydantic import Field

from .base import Model

Box = tuple[float, float, float, float]
"""(south, west, north, east) in degrees."""
OnlineMode = Literal["offline", "cache", "online"]
"""``offline``: no requests and no cached answers. ``cache``: cached answers only. ``online``: the services."""
NOMINATIM_URL = "https://nominatim.openstreetmap.org"
OVERPASS_URLS = (
    "https://overpass-api.de/api",
    "https://overpass.kumi.systems/api",
    "https://overpass.private.coffee/api",
    "https://maps.mail.ru/osm/tools/overpass/api",
)
"""The paper's four services, in the order of use."""


class MapServices(Model):
    """The services for places and roads, the rules for requests, and the cache.

    ``user_agent`` identifies the program, as the services' policies require. ``delay_s`` is the minimum time between
    two requests to one host, across all processes of the workspace. ``timeout_s`` limits one request. ``cache`` is the
    folder of cached answers, and those older than ``cache_days`` are requested again. ``most_km2`` limits the area of
    one download.
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
        """The only hosts (with their ports) that a request may go to."""
        urls = (self.nominatim_url, *self.overpass_urls)
        return tuple(dict.fromkeys(url.partition("://")[2].partition("/")[0] for url in urls))


class NamedPlace(Model):
    """A real place as Nominatim knows it.

    ``names`` are all of its names, and ``around`` those of the areas that contain it, nearest first. ``kind`` is
    its type (city, road, bus_stop …). ``lines`` are a road's polylines as (latitude, longitude). ``country`` is ISO
    3166-1 alpha-3. ``importance`` is Nominatim's, in [0, 1].
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
    roads: tuple[tuple[str, ...], ...] = Field((), description="the requested roads, each with all of its known names")

    @property
    def is_settlement(self) -> bool:
        """Whether the place is a settlement, a part of a settlement, or a region."""
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
    """A place in the user's words to look up; ``country`` is ISO alpha-3 if the user gives it."""

    services: MapServices
    place: str
    country: str | None = None


class LocatedPlace(Model):
    """The place that a text refers to. If ``place`` is None there are several, and ``candidates`` are the best known.

    ``service`` is the host that answered. ``kept`` means that the answer was cached.
    """

    place: NamedPlace | None
    candidates: tuple[NamedPlace, ...] = ()
    service: str = ""
    kept: bool = False
