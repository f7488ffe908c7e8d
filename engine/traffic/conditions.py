"""What time of day, weather and drivers do to traffic: published figures, and what is made of them.

Hourly shares of a working day's traffic (Tuesday to Thursday, streets of West German cities at the border of the inner
city): G. Schmidt, B. Thomas, Hochrechnungsfaktoren für manuelle und automatische Kurzzeitzählungen im Innerortsbereich,
Forschung Straßenbau und Straßenverkehrstechnik 732, Bonn 1996, p. 95 and 98, as SUMO's documentation of od2trips states
them. Speeds in bad weather: freeways of the Twin Cities, thesis, Iowa State University (lib.dr.iastate.edu/rtd/18916):
4 to 7 % slower in heavy rain, 11 to 15 % in heavy snow, 12 % at visibilities below a quarter of a mile; the middle is
taken.
"""

from collections.abc import Mapping
from types import MappingProxyType

from ...schemas.generation import Weather

CAR_SHARES = (
    *(0.8, 0.5, 0.4, 0.3, 0.4, 1.2, 4.5, 7.4, 6.6, 5.2, 5.0, 5.0),
    *(5.2, 5.3, 5.6, 6.7, 8.4, 8.6, 7.4, 5.0, 3.9, 3.0, 2.1, 1.6),
)
"""Percent of a working day's cars in each hour."""
HEAVY_SHARES = (
    *(0.3, 0.4, 0.4, 0.6, 0.8, 2.0, 4.8, 7.5, 9.0, 8.7, 9.0, 9.0),
    *(7.5, 8.4, 7.8, 6.9, 5.4, 4.0, 2.7, 1.8, 1.2, 0.9, 0.6, 0.3),
)
"""Percent of a working day's goods vehicles in each hour."""
SHARES_OF_DAY_SOURCE = "Schmidt and Thomas 1996"
NOON_PER_LANE_KM, MOST_PER_LANE_KM = 16.0, 28.0
"""Vehicles on a kilometre of lane at noon (medium density), and at most: the other hours in proportion (chosen)."""
SPEED_FACTORS: Mapping[Weather, float] = MappingProxyType({"heavy_rain": 0.945, "snow": 0.87, "fog": 0.88})
"""Free speeds in bad weather over those in good weather; of light rain and hail no figure is known here."""
SPEED_FACTORS_SOURCE = "freeways of the Twin Cities, Iowa State University"
_NOON = 12
NIGHT_HOURS = frozenset({22, 23, 0, 1, 2, 3, 4, 5})
"""Hours that are night (chosen)."""
_RUSH_PERCENT = 7.0
"""From this share of a day's cars on an hour is rush hour (chosen): 7, 16, 17 and 18."""


def words_of_hour(hour: int) -> tuple[str, ...]:
    """What a catalogue calls an hour: night, rush hour or nothing."""
    if hour in NIGHT_HOURS:
        return ("night",)
    return ("rush_hour",) if CAR_SHARES[hour] >= _RUSH_PERCENT else ()


def vehicles_per_lane_km(hour: int) -> float:
    """How dense traffic is in an hour of a working day, in vehicles per kilometre of lane."""
    return round(min(NOON_PER_LANE_KM * CAR_SHARES[hour] / CAR_SHARES[_NOON], MOST_PER_LANE_KM), 1)


def heavy_factor(hour: int) -> float:
    """The share of goods vehicles in an hour's traffic over that in the whole day's."""
    cars, heavy = CAR_SHARES[hour] / sum(CAR_SHARES), HEAVY_SHARES[hour] / sum(HEAVY_SHARES)
    return heavy / cars
