"""How time of day, weather and drivers affect traffic: published figures, and values derived from them.

Hourly shares of a working day's traffic (Tuesday to Thursday, streets of West German cities at the border of the inner
city): G. Schmidt, B. Thomas, Hochrechnungsfaktoren für manuelle und automatische Kurzzeitzählungen im Innerortsbereich,
Forschung Straßenbau und Straßenverkehrstechnik 732, Bonn 1996, p. 95 and 98, as quoted in SUMO's documentation of
od2trips. Speeds in bad weather: freeways of the Twin Cities, thesis, Iowa State University
(lib.dr.iastate.edu/rtd/18916): 4 to 7% slower in heavy rain, 11 to 15% in heavy snow, 12% at visibilities below a
quarter of a mile; the midpoints are used.

Calibrations of drivers are published measurements or fits, by name; a value that a source does not state stays at its
default. The reaction time of drivers is not set: SUMO's two parameters for it, ``actionStepLength`` and EIDM's
``treaction``, make a platoon behind a steady leader break down at published values (0.9 and 1.5 s, tried in SUMO 1.28).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist
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
"""Vehicles per kilometre of lane at noon (medium density), and at most: the other hours in proportion (chosen)."""
SPEED_FACTORS: Mapping[Weather, float] = MappingProxyType({"heavy_rain": 0.945, "snow": 0.87, "fog": 0.88})
"""Free speeds in bad weather relative to those in good weather; no figure is known for light rain and hail."""
SPEED_FACTORS_SOURCE = "freeways of the Twin Cities, Iowa State University"
_NOON = 12
NIGHT_HOURS = frozenset({22, 23, 0, 1, 2, 3, 4, 5})
"""Hours that are night (chosen)."""
_RUSH_PERCENT = 7.0
"""An hour with at least this share of a day's cars is rush hour (chosen): 7, 16, 17 and 18."""


def words_of_hour(hour: int) -> tuple[str, ...]:
    """Return the catalogue's words for an hour: night, rush hour or nothing."""
    if hour in NIGHT_HOURS:
        return ("night",)
    return ("rush_hour",) if CAR_SHARES[hour] >= _RUSH_PERCENT else ()


def vehicles_per_lane_km(hour: int) -> float:
    """Return the density of traffic in an hour of a working day, in vehicles per kilometre of lane."""
    return round(min(NOON_PER_LANE_KM * CAR_SHARES[hour] / CAR_SHARES[_NOON], MOST_PER_LANE_KM), 1)


def heavy_factor(hour: int) -> float:
    """Return the share of goods vehicles in an hour's traffic, relative to their share in the whole day's."""
    cars, heavy = CAR_SHARES[hour] / sum(CAR_SHARES), HEAVY_SHARES[hour] / sum(HEAVY_SHARES)
    return heavy / cars


CARS_AND_VANS = frozenset({"car", "taxi", "delivery"})
CARS_AND_TRUCKS = CARS_AND_VANS | {"truck", "trailer"}
MOTOR_VEHICLES = CARS_AND_TRUCKS | {"bus", "coach", "emergency", "motorcycle", "moped"}
SPEED_CUT = 2.0
"""Speed factors farther from their mean than this many standard deviations are not used (chosen)."""
KINDS_OF_DRIVERS = 20
"""Gaps are drawn from the middles of this many equally likely parts of their distribution (chosen)."""
_OVER_MPH = 10.0
"""British statistics count cars above the limit, and cars more than this above it."""


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation of a quantity that differs between drivers."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class Calibration:
    """A published calibration.

    ``sets``: a description of what it sets, with figures; ``classes``: vehicle classes that it applies to.
    ``speed_factor``: free speed relative to the limit, normally distributed; ``time_gap_s``: from bumper to bumper
    behind a vehicle at the same speed, in addition to the standstill gap, log-normally distributed; ``parameters`` of
    SUMO's vehicle types, equal for all.
    """

    sets: str
    source: str
    classes: frozenset[str]
    speed_factor: Spread | None = None
    time_gap_s: Spread | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def parameter_names(self) -> frozenset[str]:
        """The parameters of SUMO's vehicle types that it sets."""
        spread = {"speedFactor": self.speed_factor, "tau": self.time_gap_s}
        return frozenset(self.parameters) | {name for name, value in spread.items() if value is not None}


def published_calibrations() -> dict[str, Calibration]:
    """Return all published calibrations by name."""
    return {
        "gb_30mph": _british("30 mph roads", 30.0, over=0.50, far_over=0.05),
        "gb_rural": _british("single carriageways with a limit of 60 mph", 60.0, over=0.11, far_over=0.01),
        "gb_motorway": _british("motorways", 70.0, over=0.45, far_over=0.08),
        "m25_gaps": Calibration(
            "time gaps of 1.1 ± 0.42 s",
            "J. T. S. Al-Obaedi, Close Following Behavior, International Journal of Engineering 32(5), 2019, abstract: "
            "a quarter million pairs on the M25 and M42",
            MOTOR_VEHICLES,
            time_gap_s=Spread(1.1, 0.42),
        ),
        "highd": Calibration(
            "one middle driver: time gap 1.13 s, 3.65 m when standing, acceleration 1.1 m/s², braking 1.98 m/s²",
            "C. Zhang and L. Sun, Bayesian Calibration of the Intelligent Driver Model, arXiv 2210.03571, 2024: MA-IDM "
            "on cars and trucks of German motorways (highD), population means in their MA_IDM_hierarchical.ipynb",
            CARS_AND_TRUCKS,
            # The source gives multiples (0.706, 1.825, 0.731, 1.185) of 1.6 s, 2 m, 1.5 m/s² and 1.67 m/s².
            parameters={"tau": 1.13, "minGap": 3.65, "accel": 1.0965, "decel": 1.979},
        ),
    }


def _british(roads: str, limit_mph: float, *, over: float, far_over: float) -> Calibration:
    """Return a calibration of cars' free speeds: the normal distribution with two given shares.

    The shares are those over the limit and over the limit by 10 mph.
    """
    at_limit, above = (NormalDist().inv_cdf(1 - share) for share in (over, far_over))
    deviation_mph = _OVER_MPH / (above - at_limit)
    factor = Spread(1 - at_limit * deviation_mph / limit_mph, deviation_mph / limit_mph)
    return Calibration(
        f"free speeds of {factor.mean:.2f} ± {factor.deviation:.2f} of the limit, normal with {over:.0%} of cars above "
        f"it and {far_over:.0%} more than 10 mph above it",
        f"Department for Transport, Vehicle speed compliance statistics for Great Britain: 2022, published 24 August "
        f"2023: cars on {roads}",
        CARS_AND_VANS,
        speed_factor=factor,
    )


def time_gaps_s(spread: Spread) -> tuple[float, ...]:
    """Return equally likely values of a log-normal distribution with a given mean and deviation, ascending."""
    variance = math.log1p((spread.deviation / spread.mean) ** 2)
    logarithm = NormalDist(math.log(spread.mean) - variance / 2, math.sqrt(variance))
    shares = ((number + 0.5) / KINDS_OF_DRIVERS for number in range(KINDS_OF_DRIVERS))
    return tuple(round(math.exp(logarithm.inv_cdf(share)), 3) for share in shares)
