"""The conditions of a call (``time=rush_hour``, ``weather=snow``): read, and what they make of density and classes."""

import csv
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType
from typing import get_args

from ...engine.catalog import manoeuvres_in
from ...engine.cosimulation import presets
from ...engine.traffic import (
    SHARES_OF_DAY_SOURCE,
    SPEED_FACTORS,
    SPEED_FACTORS_SOURCE,
    heavy_factor,
    published_calibrations,
    vehicles_per_lane_km,
    words_of_hour,
)
from ...engine.vehicles import PEDESTRIAN, vehicle_classes
from ...schemas.errors import Faults, InvalidRequest, UnknownName, calling, closest, misspelt
from ...schemas.generation import (
    COMPASS_DEG,
    NATURAL_SHARES,
    SHARES_SOURCE,
    TRIP_KINDS,
    WEATHER_WORDS,
    WEATHERS,
    GenerateScenariosArguments,
    RoadFlow,
    TrafficConditions,
    TripKind,
    Turn,
    VehicleDemand,
    Weather,
)
from ...schemas.text import shown_name
from ...schemas.vocabulary import MANOEUVRES, vehicle_class_of
from ..context import WorkflowContext

_TIMES = {"night": "02:30", "morning_rush": "07:30", "morning": "09:30", "noon": "12:30", "day": "11:30"}
_TIMES |= {"afternoon": "14:30", "rush_hour": "17:30", "evening_rush": "17:30", "evening": "20:30"}
"""Times that words stand for: the middle of an hour."""
_GOODS = ("truck", "trailer")
"""Classes whose share changes with the hour as that of goods vehicles does."""
_KEYS = ("time", "weather", "drivers", "mix", "others", "counts", "od", "trips")
_FIELDS = {"mix": "natural_mix"}
_NAMING = ("counts", "od")
"""Conditions whose values are names of roads: their spelling is kept."""
_LARGEST_TABLE_BYTES, MOST_FLOWS = 1_000_000, 2_000
_COLUMNS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "road": ("road", "from", "street", "way", "osm_way", "edge", "origin"),
        "to": ("to", "destination"),
        "per_h": ("vehicles_per_h", "per_h", "flow", "count", "vehicles", "veh_per_h"),
        "direction": ("direction", "heading"),
    }
)
"""Columns of a table of counts, and the names that each may have."""

MOST_PER_H = 20_000
"""More vehicles in an hour than any road carries."""


@dataclass(frozen=True)
class ReadConditions:
    """Conditions as they act, None where there are none, and what is told of them, a sentence each.

    ``others``: the manoeuvre of another road user that is asked for, such as ``cut_in:truck``; empty without one.
    """

    conditions: TrafficConditions | None = None
    notes: tuple[str, ...] = ()
    others: str = ""


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
    others = str(read.pop("others", ""))
    if not read:
        return ReadConditions(others=others)
    flows = tuple(flow for key in _NAMING for flow in _flows_in(read.pop(key, ())))
    if flows:
        read["flows"] = flows
    conditions = TrafficConditions.model_validate({_FIELDS.get(key, key): value for key, value in read.items()})
    if not flows and conditions.time and "density" not in arguments.model_fields_set:
        per_lane_km = vehicles_per_lane_km(_hour(conditions.time))
        conditions = conditions.model_copy(update={"per_lane_km": per_lane_km})
        notes.append(
            f"{conditions.time}: {per_lane_km:g} vehicles per lane-km (medium at noon, other hours by their share of a "
            f"working day, {SHARES_OF_DAY_SOURCE}); density wins where it is given"
        )
    return ReadConditions(conditions, tuple(notes), others)


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


def circumstances_of(conditions: TrafficConditions | None) -> tuple[str, ...]:
    """What a catalogue calls the time and the weather of conditions."""
    if conditions is None:
        return ()
    weather = () if conditions.weather is None else (conditions.weather,)
    return (*weather, *(words_of_hour(_hour(conditions.time)) if conditions.time else ()))


def _hour(time: str) -> int:
    return int(time.partition(":")[0])


def _parted(text: str) -> tuple[str, str]:
    key, mark, value = (part.strip() for part in text.partition("="))
    key = key.lower()
    if not mark or key not in _KEYS:
        raise UnknownName(
            f"conditions {text!r}: {key or 'nothing'} is no condition",
            valid=[f"{known}=…" for known in closest(key, _KEYS)],
            remedies=misspelt(key, _KEYS),
            next_step="give conditions such as time=rush_hour, weather=snow, drivers=aggressive, mix=natural",
        )
    if key in _NAMING:
        return key, value
    value = value.lower().replace(" ", "_")
    return key, value.replace("-", "_") if key != "time" else value


def _time(value: str) -> tuple[str, str]:
    if value in _TIMES:
        return _TIMES[value], ""
    found = re.fullmatch(r"(\d{1,2})(?:[:h.](\d{2}))?(?:_?(am|pm))?", value)
    hour = -1 if found is None else int(found[1]) % 12 + 12 * (found[3] == "pm") if found[3] else int(found[1])
    minute = 0 if found is None or found[2] is None else int(found[2])
    if not (0 <= hour < 24 and 0 <= minute < 60):
        raise InvalidRequest(f"time={value} is no time of day", valid=[*_TIMES, "17:30"], given=value)
    return f"{hour:02d}:{minute:02d}", ""


def _weather(value: str) -> tuple[Weather, str]:
    name = WEATHER_WORDS.get(value, value)
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
    if value in known:
        return known[value], f"all drivers are {known[value]} (the paper's preset)"
    published = published_calibrations()
    names = value.split("+")
    for name in names:
        if name not in published:
            near = closest(name, [*presets(), *published])
            raise UnknownName(
                f"there is no driver preset or published calibration {name!r}",
                valid=near,
                remedies=[*misspelt(name, near), calling("describe_catalog", facet="behaviours")],
                next_step="name one preset, or calibrations joined by +, such as drivers=gb_motorway+m25_gaps",
            )
    read = [published[name] for name in names]
    for one, other in combinations(range(len(read)), 2):
        if both := read[one].parameter_names & read[other].parameter_names:
            raise InvalidRequest(
                f"drivers={value}: {names[one]} and {names[other]} both set {' and '.join(sorted(both))}",
                next_step="name one of them",
            )
    return value, "; ".join(
        f"drivers as {name}: {one.sets} ({one.source})" for name, one in zip(names, read, strict=True)
    )


def _mix(value: str) -> tuple[bool, str]:
    if value != "natural":
        raise InvalidRequest(f"mix={value} cannot be meant", valid=["mix=natural"], given=f"mix={value}")
    shares = ", ".join(f"{name} {share:.2%}" for name, share in NATURAL_SHARES.items())
    return True, f"mix: {shares}, one each at least, of goods vehicles as the hour has them ({SHARES_SOURCE})"


def _trips(value: str) -> tuple[TripKind, str]:
    kind = next((kind for kind in TRIP_KINDS if kind == value), None)
    if kind is None:
        raise UnknownName(f"there are no trips {value!r}", valid=TRIP_KINDS)
    return kind, ""


def _others(value: str) -> tuple[str, str]:
    """Read a manoeuvre of another road user, and the class that makes it if one is named on either side of it."""
    word, _, rest = value.partition(":")
    if word not in MANOEUVRES:
        said = manoeuvres_in(re.sub(r"[_:]", " ", value))
        word, _, rest = (said[0] if len(said) == 1 else value).partition(":")
    if word in get_args(Turn):
        raise InvalidRequest(
            f"others={value}: the ego makes this manoeuvre, and no other road user",
            valid=[f"goal=through:{word}"],
            next_step="ask for it by goal",
        )
    if word not in MANOEUVRES:
        raise UnknownName(
            f"there is no manoeuvre {word!r} of another road user",
            valid=closest(word, MANOEUVRES) or MANOEUVRES,
            next_step="name one, such as others=cut_in, or others=cut_in:truck",
        )
    name = vehicle_class_of(rest) if rest else ""
    if name is None:
        raise UnknownName(f"others={value}: there is no vehicle class {rest!r}", valid=closest(rest, vehicle_classes()))
    if name == PEDESTRIAN.name and word != "crossing":
        raise InvalidRequest(f"others={value}: a pedestrian does not do that", valid=["others=crossing:pedestrian"])
    return f"{word}:{name}" if name else word, ""


def _counts(value: str) -> tuple[tuple[RoadFlow, ...], str]:
    flows = _flows(value, "counts", "counts=Main Street:600; 4711:250:north (street or OSM way id: vehicles an hour)")
    return flows, "counts stand in the place of the density; roads without a count carry what turns into them"


def _origins(value: str) -> tuple[tuple[RoadFlow, ...], str]:
    flows = _flows(value, "od", "od=north>Main Street:300; west>east:120 (road or direction > road or direction)")
    return flows, "flows from origin to destination stand in the place of the density"


def _flows(value: str, key: str, example: str) -> tuple[RoadFlow, ...]:
    parts = [part.strip() for part in value.split(";") if part.strip()]
    if not 0 < len(parts) <= MOST_FLOWS:
        raise InvalidRequest(f"{key} holds {len(parts):,} flows", valid=[f"1 to {MOST_FLOWS:,}", example])
    return tuple(_flow(part, key, example) for part in parts)


def _flows_in(read: object) -> tuple[RoadFlow, ...]:
    return tuple(flow for flow in read if isinstance(flow, RoadFlow)) if isinstance(read, tuple) else ()


def _flow(text: str, key: str, example: str) -> RoadFlow:
    found = re.fullmatch(r"(.+?)\s*:\s*(\d+(?:\.\d+)?)(?:\s*:\s*([a-zA-Z-]*))?", text)
    road, mark, to = ("", "", "") if found is None else (part.strip() for part in found[1].partition(">"))
    direction = "" if found is None else (found[3] or "").lower().replace("-", "").removesuffix("bound")
    if found is None or not road or (key == "od") != bool(mark and to) or (direction and direction not in COMPASS_DEG):
        raise InvalidRequest(f"{key}: {text!r} is no flow", valid=[example, f"directions: {', '.join(COMPASS_DEG)}"])
    per_h = float(found[2])
    if not 0 < per_h <= MOST_PER_H:
        raise InvalidRequest(f"{key}: {text!r} has no flow that can be", valid=[f"above 0 to {MOST_PER_H:,} an hour"])
    return RoadFlow(road=road, to=to, per_h=per_h, direction=direction)


def with_tables_read(arguments: GenerateScenariosArguments, context: WorkflowContext) -> GenerateScenariosArguments:
    """The same with the content of tables (``counts=FILE.csv``, ``od=FILE.csv``) in the place of their names.

    Raises:
        InvalidRequest: a table is missing, too large, no text, or lacks a column; naming its line.
        OutsideRoots: it lies elsewhere than tools may read.
    """
    read = [_with_table_read(text, context) for text in arguments.conditions]
    return arguments if read == arguments.conditions else arguments.model_copy(update={"conditions": read})


def _with_table_read(text: str, context: WorkflowContext) -> str:
    key, _, value = (part.strip() for part in text.partition("="))
    if key.lower() not in _NAMING or not value.lower().endswith((".csv", ".tsv", ".txt")):
        return text
    path = context.allowed_path(value)
    if not path.is_file():
        raise InvalidRequest(f"{key}: there is no file {value}", next_step="name a CSV file, or write flows out")
    if path.stat().st_size > _LARGEST_TABLE_BYTES:
        raise InvalidRequest(
            f"{key}: {shown_name(path.name)} is larger than 1 MB", next_step="keep the rows of one town"
        )
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InvalidRequest(f"{key}: {shown_name(path.name)} is no text in UTF-8") from error
    return f"{key}={'; '.join(_rows(lines, key.lower(), path.name))}"


def _rows(lines: list[str], key: str, name: str) -> Iterator[str]:
    """The flows of a table as they are written out in a call."""
    separator = max(",;\t", key=(lines[0] if lines else "").count)
    reader = csv.reader(lines, delimiter=separator)
    header = [word.strip().lower().replace(" ", "_") for word in next(reader, [])]
    columns = {
        column: next((header.index(word) for word in words if word in header), None)
        for column, words in _COLUMNS.items()
    }
    needed = ("road", "to", "per_h") if key == "od" else ("road", "per_h")
    if missing := [" or ".join(_COLUMNS[column][:2]) for column in needed if columns[column] is None]:
        raise InvalidRequest(
            f"{key}: the first line of {name} names no column {' and no column '.join(missing)}",
            valid=["from,to,vehicles_per_h" if key == "od" else "road,vehicles_per_h,direction"],
        )
    for number, row in enumerate(reader, 2):
        if not any(cell.strip() for cell in row):
            continue
        cells = {
            column: row[at].strip().replace(";", ",") if at is not None and at < len(row) else ""
            for column, at in columns.items()
        }
        if not cells["road"] or not re.fullmatch(r"\d+(\.\d+)?", cells["per_h"]):
            raise InvalidRequest(f"{key}: line {number} of {name} holds no road and number: {', '.join(row)[:80]!r}")
        if float(cells["per_h"]) == 0:
            continue
        road = f"{cells['road']}>{cells['to']}" if key == "od" else cells["road"]
        yield ":".join(part for part in (road, cells["per_h"], cells["direction"]) if part)


_READERS: dict[str, Callable[[str], tuple[object, str]]] = {
    "time": _time,
    "weather": _weather,
    "drivers": _drivers,
    "mix": _mix,
    "counts": _counts,
    "od": _origins,
    "trips": _trips,
    "others": _others,
}
