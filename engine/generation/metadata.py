"""What a generated scenario's file states before the lanelets: benchmark id, authorship, position on Earth, tags."""

import unicodedata
from dataclasses import dataclass

from ...schemas.generation import GenerationRequest, SiteType
from ..commonroad import speed_limit_number
from ..maps import Site
from ..network import RoadNetwork, SumoNet
from ..traffic import sumo_version

STEP_S = 0.1
"""Time step of all generated scenarios: that of nearly all scenarios of CommonRoad's collection."""
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


@dataclass(frozen=True)
class ScenarioMetadata:
    """The attributes of a file's root, its location and its tags.

    ``latitude`` and ``longitude`` in degrees, ``offset_m`` of the projected coordinates. ``speed_sign``: the country's
    sign for a speed limit, None where CommonRoad has none.
    """

    benchmark_id: str
    affiliation: str
    source: str
    latitude: float
    longitude: float
    projection: str
    offset_m: tuple[float, float]
    tags: tuple[str, ...]
    step_s: float
    speed_sign: str | None


def metadata_of(request: GenerationRequest, site: Site, net: SumoNet) -> ScenarioMetadata:
    """The metadata of a scenario at a site; the benchmark id is COUNTRY_Place-number_index_T-1, as in format 2020a."""
    country = request.country or NO_COUNTRY
    return ScenarioMetadata(
        benchmark_id=f"{country}_{_plain_name(request.place)}-{request.benchmark_number}_{request.index + 1}_T-1",
        affiliation=f"PlannerForge; map data: {request.attribution}",
        source=f"PlannerForge MCP, SUMO {sumo_version()}",
        latitude=site.latitude,
        longitude=site.longitude,
        projection=net.projection,
        offset_m=net.offset_m,
        tags=("simulated", *TAGS[site.kind]),
        step_s=STEP_S,
        speed_sign=speed_limit_number(country),
    )


def _plain_name(place: str) -> str:
    """A place's name in ASCII letters and digits, every word with a capital; ``Site`` where nothing is left."""
    spelled = place.translate(UMLAUTS)
    letters = unicodedata.normalize("NFKD", spelled).encode("ascii", "ignore").decode()
    words = "".join(letter if letter.isalnum() else " " for letter in letters).split()
    return "".join(word[0].upper() + word[1:] for word in words)[:40] or "Site"


def limits_without_sign(metadata: ScenarioMetadata, network: RoadNetwork) -> dict[int, float]:
    """Posted limits in km/h by lanelet where the file cannot state them, for want of a sign; otherwise empty."""
    if metadata.speed_sign is not None:
        return {}
    return {key: round(sign.speed_mps * 3.6, 1) for sign in network.signs for key in sign.lanelet_ids}
