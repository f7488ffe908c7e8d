"""Traffic signs of a lanelet network: their meaning in any country, posted limits, and lanelets with a traffic light.

A sign's number differs between countries (274, R2-1, r301, C43 …), but its name in commonroad-io does not: in a network
read by commonroad-io, names decide. In 2018b files, the limit is an element of the lanelet, which commonroad-io turns
into a sign. Files as written have numbers only, and new files need one: this module has the numbers of speed limits.

commonroad-io's ``TrafficSignInterpreter`` is not used: it recognises only the country's number for a limit, so it
misses zones, and it fails on values that are not numbers.
"""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement

_SLOWEST_MPS, _FASTEST_MPS = 0.1, 1000.0
"""Chosen: slower than walking, and faster than any vehicle on land (341 m/s)."""
_GERMAN_LIMIT = "274"
SPEED_LIMITS = frozenset({_GERMAN_LIMIT, "274.1", "R2-1", "r301", "3.24", "R15", "C43", "B14", "Ρ-32", "B31"})
"""A speed limit, or the beginning of a speed zone, in the countries with signs that CommonRoad knows."""
_LIMIT_OF_COUNTRY = {"USA": "R2-1", "ESP": "r301"}
_COUNTRIES_WITHOUT_LIMIT = frozenset({"AUS"})
"""CommonRoad knows signs of these countries, but no sign for a speed limit; its reader fails on one."""


def speed_limit_number(country: str) -> str | None:
    """Return the sign number for a speed limit in a country, or None if CommonRoad has none.

    It is the German 274 if the country has no number of its own: CommonRoad's reader accepts it as a limit everywhere.
    """
    return None if country in _COUNTRIES_WITHOUT_LIMIT else _LIMIT_OF_COUNTRY.get(country, _GERMAN_LIMIT)


def is_known_number(number: str, country: str) -> bool:
    """Return whether CommonRoad's reader knows a sign's number in a country; it treats unknown countries as Zamunda."""
    from commonroad.scenario.traffic_sign import TrafficSignIDCountries

    return number == _GERMAN_LIMIT or number in {sign.value for sign in TrafficSignIDCountries[country]}


_KEY_OF_NAME = {
    "WARNING_RIGHT_BEFORE_LEFT": "right_before_left_rule",
    "YIELD": "yield",
    "STOP": "stop",
    "STOP_4_WAY": "stop",
    "RIGHT_OF_WAY": "right_of_way",
    "PRIORITY": "priority_road",
    "MAX_SPEED": "speed_limit",
    "MAX_SPEED_ZONE_START": "speed_limit",
    "MIN_SPEED": "required_speed",
    "NO_OVERTAKING_START": "no_overtaking",
    "GREEN_ARROW": "green_arrow_sign",
    "TOWN_SIGN": "town_sign",
    "BAN_CAR_TRUCK_BUS_MOTORCYCLE": "ban_on_motorcycles_and_multilane_vehicles",
    "U_TURN": "no_u_turn",
}
_KEY_OF_PREFIX = {
    "ADDITION_LEFT_TURNING_PRIORITY": "turning_priority_left",
    "ADDITION_RIGHT_TURNING_PRIORITY": "turning_priority_right",
    "ADDITION_LEFT_TRAFFIC_PRIORITY": "turning_priority_wait",
    "ADDITION_RIGHT_TRAFFIC_PRIORITY": "turning_priority_wait",
}


def sign_keys(signs: Iterable["TrafficSign"]) -> tuple[str, ...]:
    """Return the vocabulary's keys of all signs, sorted, each once; signs outside the vocabulary are left out."""
    return tuple(sorted({key for element in _elements(signs) if (key := _sign_key(element))}))


def limits_mps(element: "TrafficSignElement") -> list[float]:
    """Return the limits in m/s that a sign posts, for a road or a zone, without implausible values.

    The result is empty for all other signs.
    """
    texts = element.additional_values if _sign_key(element) == "speed_limit" else []
    return [speed for text in texts if _SLOWEST_MPS <= (speed := _number(text)) <= _FASTEST_MPS]


def limits_kmh(signs: Iterable["TrafficSign"]) -> tuple[float, ...]:
    """Return posted speed limits in km/h, ascending, rounded to 0.1, as ``limits_mps`` reads them."""
    return tuple(sorted({round(speed * 3.6, 1) for element in _elements(signs) for speed in limits_mps(element)}))


def signs_of(network: "LaneletNetwork", lanelet_ids: Iterable[int]) -> list["TrafficSign"]:
    """Return the signs that these lanelets refer to; dangling references are left out."""
    wanted = sorted({sign for key in lanelet_ids for sign in network.find_lanelet_by_id(key).traffic_signs})
    return [sign for sign in (network.find_traffic_sign_by_id(key) for key in wanted) if sign is not None]


def has_light(network: "LaneletNetwork", lanelet_ids: Iterable[int]) -> bool:
    """Return whether one of these lanelets refers to a traffic light of the file."""
    wanted = {light for key in lanelet_ids for light in network.find_lanelet_by_id(key).traffic_lights}
    return any(network.find_traffic_light_by_id(key) is not None for key in wanted)


def _sign_key(element: "TrafficSignElement") -> str | None:
    """Return the vocabulary's key of a sign by its commonroad-io name; None for signs outside the vocabulary."""
    name = element.traffic_sign_element_id.name
    if name in _KEY_OF_NAME:
        return _KEY_OF_NAME[name]
    return next((key for prefix, key in _KEY_OF_PREFIX.items() if name.startswith(prefix)), None)


def _elements(signs: Iterable["TrafficSign"]) -> list["TrafficSignElement"]:
    return [element for sign in signs for element in sign.traffic_sign_elements]


def _number(text: object) -> float:
    try:
        return float(str(text))
    except ValueError:
        return math.nan
