"""The conditions of a call (``time=rush_hour``, ``weather=snow``): read, and what they make of density and classes."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from ...engine.cosimulation import presets
from ...engine.traffic import (
    SHARES_OF_DAY_SOURCE,
    SPEED_FACTORS,
    SPEED_FACTORS_SOURCE,
    heavy_factor,
    vehicles_per_lane_km,
)
from ...schemas.errors import Faults, InvalidRequest, UnknownName, closest
from ...schemas.generation import (
    NATURAL_SHARES,
    SHARES_SOURCE,
    WEATHERS,
    GenerateScenariosArguments,
    TrafficConditions,
    VehicleDemand,
    Weather,
)

_TIMES = {"night": "02:30", "morning_rush": "07:30", "morning": "09:30", "noon": "12:30", "day": "11:30"}
_TIMES |= {"afternoon": "14:30", "rush_hour": "17:30", "evening_rush": "17:30", "evening": "20:30"}
"""Times that words stand for: the middle of an hour."""
_WEATHER_WORDS: dict[str, Weather] = {"rain": "light_rain", "mist": "fog", "snowfall": "snow"}
_GOODS = ("truck", "trailer")
"""Classes whose share changes with the hour as that of goods vehicles does."""
_KEYS = ("time", "weather", "drivers", "mix")
_FIELDS = {"mix": "natural_mix"}


@dataclass(frozen=True)
class ReadConditions:
    """Conditions as they act, None where there are none, and what is told of them, a sentence each."""

    conditions: TrafficConditions | None = None
    notes: tuple[str, ...] = ()


def read_conditions(arguments: GenerateScenariosArguments) -> ReadConditions:
    """The conditions of a call.

    Raises:
        InvalidRequest: an unknown condition or value, or one twice; all faults at once.
    """
    faults, read = Faults(), dict[str, object]()
    notes: list[str] = []
    for text in arguments.conditions:
        with faults.collecting():
            key, value = _parted(text)
            if key in read:
                raise InvalidRequest(f"{key} stands twice in conditions", next_step="name every condition once")
            read[key], note = _READERS[key](value)
            notes += [note] if note else []
    faults.raise_all()
    if not read:
        return ReadConditions()
    conditions = TrafficConditions.model_validate({_FIELDS.get(key, key): value for key, value in read.items()})
    if conditions.time and "density" not in arguments.model_fields_set:
        per_lane_km = vehicles_per_lane_km(_hour(conditions.time))
        conditions = conditions.model_copy(update={"per_lane_km": per_lane_km})
        notes.append(
            f"{conditions.time}: {per_lane_km:g} vehicles per lane-km (medium at noon, other hours by their share of a "
            f"working day, {SHARES_OF_DAY_SOURCE}); density wins where it is given"
        )
    return ReadConditions(conditions, tuple(notes))


def with_natural_mix(
    demands: tuple[VehicleDemand, ...], conditions: TrafficConditions | None
) -> tuple[VehicleDemand, ...]:
    """The demands with the classes of natural traffic, where that was asked for, at their share of the hour."""
    if conditions is None:
        return demands
    named = {demand.vehicle_class for demand in demands}
    if conditions.natural_mix:
        more = [VehicleDemand(vehicle_class=n, share=s) for n, s in NATURAL_SHARES.items() if n not in named]
        demands = (*demands, *more)
    factor = heavy_factor(_hour(conditions.time)) if conditions.time else 1.0
    return tuple(
        demand.model_copy(update={"share": round(demand.share * factor, 5)})
        if demand.share is not None
        and demand.vehicle_class in _GOODS
        and demand.share == NATURAL_SHARES.get(demand.vehicle_class)
        else demand
        for demand in demands
    )


def _hour(time: str) -> int:
    return int(time.partition(":")[0])


def _parted(text: str) -> tuple[str, str]:
    key, mark, value = (part.strip().lower() for part in text.partition("="))
    if not mark or key not in _KEYS:
        raise UnknownName(
            f"conditions {text!r}: {key or 'nothing'} is no condition",
            valid=[f"{known}=…" for known in _KEYS],
            next_step="give conditions such as time=rush_hour, weather=snow, drivers=aggressive, mix=natural",
        )
    return key, value.replace(" ", "_").replace("-", "_") if key != "time" else value.replace(" ", "_")


def _time(value: str) -> tuple[str, str]:
    if value in _TIMES:
        return _TIMES[value], ""
    found = re.fullmatch(r"(\d{1,2})(?:[:h.](\d{2}))?(?:_?(am|pm))?", value)
    hour = -1 if found is None else int(found[1]) % 12 + 12 * (found[3] == "pm") if found[3] else int(found[1])
    minute = 0 if found is None or found[2] is None else int(found[2])
    if not (0 <= hour < 24 and 0 <= minute < 60):
        raise InvalidRequest(f"time={value} is no time of day", valid=[*_TIMES, "17:30"])
    return f"{hour:02d}:{minute:02d}", ""


def _weather(value: str) -> tuple[Weather, str]:
    name = _WEATHER_WORDS.get(value, value)
    known = next((weather for weather in WEATHERS if weather == name), None)
    if known is None:
        raise UnknownName(
            f"there is no weather {value!r}; without a condition it is good", valid=closest(value, WEATHERS) or WEATHERS
        )
    taken = f"{value!r} is taken as {known}" if known != value else ""
    factor = SPEED_FACTORS.get(known)
    effect = (
        f"{known}: vehicles drive {1 - factor:.1%} slower where they are free ({SPEED_FACTORS_SOURCE})"
        if factor is not None
        else f"{known} stands in the file; how it changes driving is not known here"
    )
    return known, "; ".join(part for part in (taken, effect) if part)


def _drivers(value: str) -> tuple[str, str]:
    known = {name.lower(): name for name in presets()}
    if value not in known:
        raise UnknownName(f"there is no driver preset {value!r}", valid=list(presets()))
    return known[value], f"all drivers are {known[value]} (the paper's preset)"


def _mix(value: str) -> tuple[bool, str]:
    if value != "natural":
        raise InvalidRequest(f"mix={value} cannot be meant", valid=["mix=natural"])
    shares = ", ".join(f"{name} {share:.2%}" for name, share in NATURAL_SHARES.items())
    return True, f"mix: {shares}, one each at least, of goods vehicles as the hour has them ({SHARES_SOURCE})"


_READERS: dict[str, Callable[[str], tuple[object, str]]] = {
    "time": _time,
    "weather": _weather,
    "drivers": _drivers,
    "mix": _mix,
}
