"""Name and head of a generated scenario: benchmark id, place on the globe, tags."""

import unicodedata
from importlib.metadata import version

from ...schemas.generation import GenerationRequest, SiteType
from ..maps import Site
from ..network import RoadNetwork, SumoNet
from .writer import ScenarioHead

NO_COUNTRY = "ZAM"
"""Zamunda: CommonRoad's country for places that are in none."""
TAGS: dict[SiteType, tuple[str, ...]] = {
    "highway": ("highway", "multi_lane"),
    "ramp": ("highway", "slip_road", "merging_lanes"),
    "rural": ("rural",),
    "urban": ("urban",),
    "intersection": ("urban", "intersection"),
    "signalised_intersection": ("urban", "intersection"),
    "roundabout": ("urban", "roundabout"),
}
UMLAUTS: dict[int, str] = {
    ord(a): b for a, b in zip("äöüÄÖÜß", ("ae", "oe", "ue", "Ae", "Oe", "Ue", "ss"), strict=True)
}
SPEED_SIGNS = {"USA": "R2-1", "ESP": "r301"}
"""The sign for a speed limit where it is not the German and Zamundan 274."""
COUNTRIES_WITHOUT_SIGN = frozenset({"AUS"})
"""CommonRoad knows signs of these countries, but none for a speed limit; its reader fails on one."""


def benchmark_id(request: GenerationRequest) -> str:
    """The CommonRoad benchmark id by the 2020a naming: COUNTRY_Place-number_index_T-1."""
    country = request.country or NO_COUNTRY
    return f"{country}_{_plain_name(request.place)}-{request.benchmark_number}_{request.index + 1}_T-1"


def _plain_name(place: str) -> str:
    """A place's name in ASCII letters and digits, every word with a capital; ``Site`` where nothing is left."""
    spelled = place.translate(UMLAUTS)
    letters = unicodedata.normalize("NFKD", spelled).encode("ascii", "ignore").decode()
    words = "".join(letter if letter.isalnum() else " " for letter in letters).split()
    return "".join(word[0].upper() + word[1:] for word in words)[:40] or "Site"


def head_of(request: GenerationRequest, site: Site, net: SumoNet, step_s: float) -> ScenarioHead:
    """Everything that stands in the file before the lanelets."""
    return ScenarioHead(
        benchmark_id=benchmark_id(request),
        affiliation=f"PlannerForge; map data: {request.attribution}",
        source=f"PlannerForge MCP, SUMO {version('libsumo')}",
        latitude=site.latitude,
        longitude=site.longitude,
        projection=net.projection,
        offset_m=net.offset_m,
        tags=("simulated", *TAGS[site.kind]),
        step_s=step_s,
        speed_sign=_speed_sign(request.country or NO_COUNTRY),
    )


def limits_without_sign(country: str | None, network: RoadNetwork) -> dict[int, float]:
    """Posted limits in km/h by lanelet where CommonRoad has no sign for them in that country; otherwise empty."""
    if _speed_sign(country or NO_COUNTRY) is not None:
        return {}
    return {key: round(sign.speed_mps * 3.6, 1) for sign in network.signs for key in sign.lanelet_ids}


def _speed_sign(country: str) -> str | None:
    return None if country in COUNTRIES_WITHOUT_SIGN else SPEED_SIGNS.get(country, "274")
