"""Determines which country's and state's law applies at a position, as codes of ISO 3166."""

from ..naming.places import country_name
from ..naming.regions import regions_at
from ..road_tags.limits import Jurisdiction

_STATES = ("USA", "AUS")
"""Countries with different limits in their states."""


def jurisdiction_of(country: str | None, position: tuple[float, float]) -> Jurisdiction:
    """Return the country (given as ISO 3166-1 alpha-3) and the states that (latitude, longitude) may be in."""
    from iso3166 import countries_by_alpha3

    known = countries_by_alpha3.get(country or "")
    if known is None or country is None:
        return Jurisdiction()
    codes = [region.code for region in regions_at(country, *position)] if country in _STATES else []
    states = tuple(f"{known.alpha2}-{code}" for code in codes)
    name = country_name(country)
    return Jurisdiction(known.alpha2, states, f"{name} ({codes[0]})" if len(codes) == 1 else name)
