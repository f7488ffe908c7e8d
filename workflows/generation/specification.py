"""Parse the words of a call for scenarios into a :class:`GenerationSpec`.

Later code gets typed values and parses no words. Conditions (``time=rush_hour``, ``weather=snow``) set
some of them: a density, classes of vehicles, counted flows.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import get_args

from ...engine.catalog import manoeuvres_in
from ...engine.cosimulation import presets
from ...engine.maps import resolve_road_classes
from ...engine.traffic import (
    SHARES_OF_DAY_SOURCE,
    SPEED_FACTORS,
    SPEED_FACTORS_SOURCE,
    heavy_factor,
    published_calibrations,
    vehicles_per_lane_km,
    words_of_hour,
)
from ...engine.vehicles import PEDESTRIAN, vehicle_class_of, vehicle_classes
from ...schemas.errors import (
    Faults,
    InvalidRequest,
    Remedy,
    UnknownName,
    calling,
    closest,
    instead,
    misspelt,
    with_values,
)
from ...schemas.generation import (
    COMPASS_DEG,
    LONGEST_FOR_TURN_S,
    NATURAL_SHARES,
    SHARES_SOURCE,
    TRIP_KINDS,
    USUAL_GOAL,
    WEATHER_WORDS,
    WEATHERS,
    GenerateScenariosArguments,
    GenerationSpec,
    RequestedEgo,
    RequestedGoal,
    RequestedManoeuvre,
    RoadFlow,
    TrafficConditions,
    TripKind,
    Turn,
    VehicleDemand,
    Weather,
)
from ...schemas.grammar import as_exclusion, parse_condition
from ...schemas.maps import Box
from ...schemas.text import counted
from ...schemas.vocabulary import MANOEUVRES
from ..maps import known_country
from .flow_tables import NAMING

MOST_VEHICLES = 300
"""A site of a few hundred metres has room for fewer. More would only delay the refusal."""
MOST_PEOPLE = 100
"""The maximum number of pedestrians at a site (chosen): pavements near a junction hardly have room for more."""
_TIMES = {"night": "02:30", "morning_rush": "07:30", "morning": "09:30", "noon": "12:30", "day": "11:30"}
_TIMES |= {"afternoon": "14:30", "rush_hour": "17:30", "evening_rush": "17:30", "evening": "20:30"}
"""The times of day for words: the middle of an hour."""
_GOODS = ("truck", "trailer")
"""The share of these classes changes over the day like that of goods vehicles."""
_KEYS = ("time", "weather", "drivers", "mix", "others", "counts", "od", "trips")
_FIELDS = {"mix": "natural_mix"}
MOST_FLOWS = 2_000
MOST_PER_H = 20_000
"""No road carries more vehicles per hour."""


def read_specification(arguments: GenerateScenariosArguments) -> GenerationSpec:
    """Parse a call, and report all of its faults together.

    Args:
        arguments: the call, with the content of its tables instead of their names.

    Raises:
        UnknownName: a class of vehicles or roads, or a condition, is unknown.
        InvalidRequest: the goal, the ego, the box, a condition or a number of vehicles is invalid.
    """
    faults = Faults()
    read = _ReadConditions()
    goal, ego, bbox = RequestedGoal.of(USUAL_GOAL), RequestedEgo(), None
    code: str | None = None
    road_classes: tuple[str, ...] = ()
    vehicles: tuple[VehicleDemand, ...] = ()
    taken: list[str] = []
    with faults.collecting():
        read = read_conditions(arguments)
    with faults.collecting():
        goal = RequestedGoal.of(arguments.goal)
    with faults.collecting():
        ego = _ego(arguments.ego)
    with faults.collecting():
        code = known_country(arguments.country)
    with faults.collecting():
        bbox = _box(arguments.bbox)
    with faults.collecting():
        road_classes = () if arguments.road_classes is None else resolve_road_classes(arguments.road_classes)
    with faults.collecting():
        vehicles, taken = read_vehicles(arguments.vehicles, ego, read.others)
    faults.raise_all()
    return GenerationSpec(
        scenario_type=arguments.scenario_type,
        bbox=bbox,
        road_classes=road_classes,
        density=arguments.density,
        vehicles=with_natural_mix(vehicles, read.conditions),
        duration_s=arguments.duration_s,
        longest_s=_longest_s(arguments, goal),
        ego=ego,
        goal=goal,
        seed=arguments.seed,
        conditions=read.conditions,
        others=read.others,
        place=arguments.place,
        country=arguments.country,
        country_code=code,
        count=arguments.count,
        source=arguments.source,
        trial_run=arguments.trial_run,
        notes=(*read.notes, *taken),
    )


def _longest_s(arguments: GenerateScenariosArguments, goal: RequestedGoal) -> float | None:
    """Return up to when a recording may last for the ego's turn; None if the call states the duration or no turn."""
    is_stated = "duration_s" in arguments.model_fields_set
    return None if is_stated or goal.turn is None else float(LONGEST_FOR_TURN_S)


@dataclass(frozen=True)
class _ReadConditions:
    """Parsed conditions (None if absent), another road user's manoeuvre, and notes for the answer."""

    conditions: TrafficConditions | None = None
    notes: tuple[str, ...] = ()
    others: RequestedManoeuvre | None = None


def read_conditions(arguments: GenerateScenariosArguments) -> _ReadConditions:
    """Return the conditions of a call.

    Raises:
        InvalidRequest: an unknown or repeated condition or value; all are reported together.
    """
    faults, read = Faults(), dict[str, object]()
    notes: list[str] = []
    for text in arguments.conditions:
        with faults.collecting():
            key, value = _split_condition(text)
            if key in read:
                raise InvalidRequest(f"{key} occurs twice in conditions", next_step="give every condition once")
            read[key], note = _READERS[key](value)
            notes += [note] if note else []
    faults.raise_all()
    others = RequestedManoeuvre.of(str(read.pop("others", "")))
    if not read:
        return _ReadConditions(others=others)
    flows = tuple(flow for key in NAMING for flow in _flows_in(read.pop(key, ())))
    if flows:
        read["flows"] = flows
    conditions = TrafficConditions.model_validate({_FIELDS.get(key, key): value for key, value in read.items()})
    is_varied = any(text.partition("=")[0].strip() == "density" for text in arguments.cover)
    is_stated = is_varied or "density" in arguments.model_fields_set
    if not flows and conditions.hour is not None and not is_stated:
        per_lane_km = vehicles_per_lane_km(conditions.hour)
        conditions = conditions.model_copy(update={"per_lane_km": per_lane_km})
        notes.append(
            f"{conditions.time}: {per_lane_km:g} vehicles per lane-km (the medium density at noon, scaled by the "
            f"hour's share of a working day's traffic, {SHARES_OF_DAY_SOURCE}); a given density overrides it"
        )
    elif conditions.hour is not None:
        stated = "cover sets" if is_varied else f"density={arguments.density} sets"
        source = "the flows set" if flows else stated
        notes.append(f"{conditions.time}: the hour does not change the number of vehicles, because {source} it")
    return _ReadConditions(conditions, tuple(notes), others)


def with_natural_mix(
    demands: tuple[VehicleDemand, ...], conditions: TrafficConditions | None
) -> tuple[VehicleDemand, ...]:
    """Return the demands and, if requested, the classes of natural traffic with their shares at that hour."""
    if conditions is None:
        return demands
    given = {demand.vehicle_class for demand in demands}
    if conditions.natural_mix:
        more = [VehicleDemand(vehicle_class=n, share=s) for n, s in NATURAL_SHARES.items() if n not in given]
        demands = (*demands, *more)
    factor = 1.0 if conditions.hour is None else heavy_factor(conditions.hour)
    return tuple(
        demand.model_copy(update={"share": round(demand.share * factor, 5)})
        if demand.share is not None
        and demand.vehicle_class in _GOODS
        and demand.share == NATURAL_SHARES.get(demand.vehicle_class)
        else demand
        for demand in demands
    )


def circumstances_of(conditions: TrafficConditions | None) -> tuple[str, ...]:
    """Return the catalogue's terms for the time and weather of conditions."""
    if conditions is None:
        return ()
    weather = () if conditions.weather is None else (conditions.weather,)
    return (*weather, *(() if conditions.hour is None else words_of_hour(conditions.hour)))


def _split_condition(text: str) -> tuple[str, str]:
    key, mark, value = (part.strip() for part in text.partition("="))
    key = key.lower()
    if not mark or key not in _KEYS:
        raise UnknownName(
            f"{text!r} in conditions does not name a condition",
            valid=[f"{known}=…" for known in closest(key, _KEYS)],
            remedies=misspelt(key, _KEYS),
            next_step="give conditions such as time=rush_hour, weather=snow, drivers=aggressive, mix=natural",
        )
    if key in NAMING:
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
        meant = f"time={value}" if found is None else ""  # another hour would be a guess
        times = [f"time={known}" for known in (*_TIMES, "17:30")]
        raise InvalidRequest(f"'time={value}' is not a time of day", valid=times, given=meant)
    return f"{hour:02d}:{minute:02d}", ""


def _weather(value: str) -> tuple[Weather, str]:
    name = WEATHER_WORDS.get(value, value)
    known = next((weather for weather in WEATHERS if weather == name), None)
    if known is None:
        raise UnknownName(
            f"there is no weather {value!r}; the default is good weather",
            valid=closest(value, WEATHERS) or WEATHERS,
            next_step="choose one of these, or leave the weather out",
            remedies=misspelt(value, [*WEATHERS, *WEATHER_WORDS]),
            complete=True,
        )
    taken = f"{value!r} is read as {known}" if known != value else ""
    factor, friction = SPEED_FACTORS.get(known), TrafficConditions(weather=known).friction
    slower = "" if factor is None else f"vehicles in free flow drive {1 - factor:.1%} slower ({SPEED_FACTORS_SOURCE})"
    grip = (
        ""
        if friction is None
        else f"the roads have a friction of {friction:g}, and no driver brakes beyond the grip of the tyres"
    )
    effects = " and ".join(filter(None, (slower, grip)))
    effect = f"{known}: {effects}" if effects else f"the file states {known}; its effect on driving is not known here"
    return known, "; ".join(part for part in (taken, effect) if part)


def _drivers(value: str) -> tuple[str, str]:
    known = {name.lower(): name for name in presets()}
    if value in known:
        return known[value], f"all drivers are {known[value]} (a preset of the PlannerForge paper)"
    published = published_calibrations()
    names = value.split("+")
    for name in names:
        if name not in published:
            near = closest(name, [*presets(), *published])
            raise UnknownName(
                f"there is no driver preset or published calibration {name!r}",
                valid=near,
                remedies=[*misspelt(name, near), calling("describe_catalog", facet="behaviours")],
                next_step="use one preset, or calibrations joined by +, such as drivers=gb_motorway+m25_gaps",
            )
    read = [published[name] for name in names]
    for one, other in combinations(range(len(read)), 2):
        if both := read[one].parameter_names & read[other].parameter_names:
            raise InvalidRequest(
                f"drivers={value}: {names[one]} and {names[other]} both set {' and '.join(sorted(both))}",
                next_step="use only one of them",
            )
    return value, "; ".join(
        f"drivers as {name}: {one.sets} ({one.source})" for name, one in zip(names, read, strict=True)
    )


def _mix(value: str) -> tuple[bool, str]:
    if value != "natural":
        raise InvalidRequest(f"mix={value} is not valid", valid=["mix=natural"], given=f"mix={value}")
    shares = ", ".join(f"{name} {share:.2%}" for name, share in NATURAL_SHARES.items())
    return True, f"mix: {shares}, at least one each, goods vehicles by the hour ({SHARES_SOURCE})"


def _trips(value: str) -> tuple[TripKind, str]:
    kind = next((kind for kind in TRIP_KINDS if kind == value), None)
    if kind is None:
        raise UnknownName(f"there are no trips {value!r}", valid=TRIP_KINDS)
    return kind, ""


def _others(value: str) -> tuple[str, str]:
    """Parse another road user's manoeuvre, and its class if one is given before or after it."""
    word, _, rest = value.partition(":")
    if word not in MANOEUVRES:
        manoeuvres = manoeuvres_in(re.sub(r"[_:]", " ", value))
        word, _, rest = (manoeuvres[0] if len(manoeuvres) == 1 else value).partition(":")
    if word in get_args(Turn):
        raise InvalidRequest(
            f"others={value}: only the ego makes this manoeuvre",
            valid=[f"goal=through:{word}"],
            next_step="request it by goal",
        )
    if word not in MANOEUVRES:
        raise UnknownName(
            f"there is no manoeuvre {word!r} of another road user",
            valid=closest(word, MANOEUVRES) or MANOEUVRES,
            next_step="use one of these, such as others=cut_in or others=cut_in:truck",
        )
    name = vehicle_class_of(rest) if rest else ""
    if name is None:
        raise UnknownName(f"others={value}: there is no vehicle class {rest!r}", valid=closest(rest, vehicle_classes()))
    if name == PEDESTRIAN.name and word != "crossing":
        raise InvalidRequest(f"others={value}: a pedestrian cannot do that", valid=["others=crossing:pedestrian"])
    return f"{word}:{name}" if name else word, ""


def _counts(value: str) -> tuple[tuple[RoadFlow, ...], str]:
    flows = _flows(value, "counts", "counts=Main Street:600; 4711:250:north (street or OSM way id: vehicles an hour)")
    return flows, "counts replace the density; roads without a count carry the traffic that turns into them"


def _origins(value: str) -> tuple[tuple[RoadFlow, ...], str]:
    flows = _flows(value, "od", "od=north>Main Street:300; west>east:120 (road or direction > road or direction)")
    return flows, "flows from origin to destination replace the density"


def _flows(value: str, key: str, example: str) -> tuple[RoadFlow, ...]:
    parts = [part.strip() for part in value.split(";") if part.strip()]
    if not 0 < len(parts) <= MOST_FLOWS:
        raise InvalidRequest(f"{key} has {len(parts):,} flows", valid=[f"1 to {MOST_FLOWS:,}", example])
    return tuple(_flow(part, key, example) for part in parts)


def _flows_in(read: object) -> tuple[RoadFlow, ...]:
    return tuple(flow for flow in read if isinstance(flow, RoadFlow)) if isinstance(read, tuple) else ()


def _flow(text: str, key: str, example: str) -> RoadFlow:
    found = re.fullmatch(r"(.+?)\s*:\s*(\d+(?:\.\d+)?)(?:\s*:\s*([a-zA-Z-]*))?", text)
    road, mark, to = ("", "", "") if found is None else (part.strip() for part in found[1].partition(">"))
    direction = "" if found is None else (found[3] or "").lower().replace("-", "").removesuffix("bound")
    if found is None or not road or (key == "od") != bool(mark and to) or (direction and direction not in COMPASS_DEG):
        raise InvalidRequest(f"{key}: {text!r} is not a flow", valid=[example, f"directions: {', '.join(COMPASS_DEG)}"])
    per_h = float(found[2])
    if not 0 < per_h <= MOST_PER_H:
        raise InvalidRequest(f"{key}: {text!r} is out of range", valid=[f"above 0 to {MOST_PER_H:,} per hour"])
    return RoadFlow(road=road, to=to, per_h=per_h, direction=direction)


def read_vehicles(
    texts: list[str], ego: RequestedEgo, others: RequestedManoeuvre | None
) -> tuple[tuple[VehicleDemand, ...], list[str]]:
    """Parse the vehicles of a call, including the classes of its ego and actor, with notes on their words.

    Raises:
        UnknownName: a vehicle class does not exist.
        InvalidRequest: the numbers of vehicles are invalid.
    """
    in_our_words = [_normalised_demand(text) for text in texts]
    for words, _ in in_our_words:
        named = _NAMED_DEMAND.fullmatch(words)
        if named is not None and not re.search(r"[\d@]", named[2]):
            _check_class(vehicle_class_of(named[2]) or named[2], texts)
    demands = _vehicle_demands(texts, [words for words, _ in in_our_words])
    demands = _with_ego_class(_with_actor_class(demands, others), ego)
    for demand in demands:
        _check_class(demand.vehicle_class, texts)
    return demands, [taken for _, taken in in_our_words if taken]


def _check_class(name: str, texts: Sequence[str]) -> None:
    known = list(dict.fromkeys([*vehicle_classes(), PEDESTRIAN.name]))
    if name not in known:
        near = closest(name, known)
        raise UnknownName(
            f"there is no vehicle class {name!r}",
            valid=near,
            reason="unknown_class",
            remedies=[*misspelt(name, near), *_without_class(name, texts)],
            complete=True,
        )


def _without_class(name: str, texts: Sequence[str]) -> list[Remedy]:
    """Return the call without the vehicles of a class; no remedy if ``vehicles`` does not contain it."""
    others = [text for text in texts if not re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text)]
    return [] if len(others) == len(texts) else [with_values(vehicles=others or None)]


def _vehicle_demands(texts: list[str], in_our_words: Iterable[str]) -> tuple[VehicleDemand, ...]:
    """Return the demands in the normalised texts ``in_our_words``.

    Errors and remedies that concern all demands together cite ``texts``, the words of the call.
    """
    demands = tuple(_vehicle_demand(text) for text in in_our_words)
    requested = sum(demand.needed for demand in demands)
    on_foot = sum(demand.needed for demand in demands if demand.vehicle_class == PEDESTRIAN.name)
    if on_foot > MOST_PEOPLE:
        raise InvalidRequest(f"vehicles requests {on_foot:,} pedestrians at one site", valid=[f"at most {MOST_PEOPLE}"])
    if requested > MOST_VEHICLES:
        raise InvalidRequest(
            f"vehicles requests {requested:,} vehicles at one site",
            valid=[f"at most {MOST_VEHICLES} of all classes in total"],
            remedies=_with_fewer(texts, demands),
        )
    shared = sum(demand.share or 0.0 for demand in demands)
    if shared > 1:
        raise InvalidRequest(
            f"the shares in vehicles {texts} add up to {shared:.0%}",
            valid=["shares of at most 100% together; cars make up the rest"],
            next_step="lower the shares, or give numbers, such as taxi=3",
            remedies=[with_values(vehicles=_with_lower_shares(texts, demands, shared))],
        )
    often = sorted(name for name, times in Counter(d.vehicle_class for d in demands).items() if times > 1)
    if often:
        raise InvalidRequest(
            f"vehicles {texts} contains {' and '.join(often)} more than once",
            valid=["each class once"],
            next_step="give every class once, with its total number",
            remedies=[with_values(vehicles=_with_each_class_once(texts, demands))],
        )
    return demands


def _with_lower_shares(texts: Sequence[str], demands: Sequence[VehicleDemand], shared: float) -> list[str]:
    """Return the demands with shares in the same proportion that add up to at most 100%."""
    return [
        text if demand.share is None else f"{demand.vehicle_class}={math.floor(100 * demand.share / shared)}%"
        for text, demand in zip(texts, demands, strict=True)
    ]


def _with_each_class_once(texts: Sequence[str], demands: Sequence[VehicleDemand]) -> list[str]:
    """Return the demands with one total for each class that occurs more than once."""
    named = Counter(demand.vehicle_class for demand in demands)
    numbers: Counter[str] = Counter()
    for demand in demands:
        numbers[demand.vehicle_class] += demand.needed
    once = {
        demand.vehicle_class: text if named[demand.vehicle_class] == 1 else f"{demand.vehicle_class}={number}"
        for text, demand in zip(texts, demands, strict=True)
        if (number := numbers[demand.vehicle_class]) or named[demand.vehicle_class] == 1
    }
    return list(once.values())


def _with_fewer(texts: Sequence[str], demands: Sequence[VehicleDemand]) -> list[Remedy]:
    """Return the call with fewer vehicles of the most frequent class, if the others leave room for any."""
    most = max(range(len(demands)), key=lambda index: demands[index].needed)
    room = MOST_VEHICLES - sum(demand.needed for index, demand in enumerate(demands) if index != most)
    return [instead(texts[most], f"{demands[most].vehicle_class}={room}")] if room > 0 else []


def _vehicle_demand(text: str) -> VehicleDemand:
    """Parse one demand for vehicles.

    ``truck`` means its share of traffic, ``truck=2`` a minimum, ``car=4..4`` both bounds, ``bicycle=0`` no bicycles,
    and ``taxi=30%`` a share of all vehicles.
    """
    if (shared := re.fullmatch(r"\s*([a-z_]+)\s*=\s*(\d{1,3}(?:\.\d+)?)\s*%\s*", text)) is not None:
        return _shared_demand(text, shared[1], float(shared[2]) / 100)
    try:
        demand = parse_condition(text, whole=True)
    except InvalidRequest as refusal:
        raise refusal.preceded_by("in vehicles, ") from refusal
    low, high = demand.interval.low, demand.interval.high
    if demand.negated:
        return VehicleDemand(vehicle_class=demand.name, least=0, most=0)
    if text.strip() == demand.name:
        return _bare_demand(demand.name)
    least = 0 if low is None else round(low)
    at_least = demand.interval.exact and least > 0
    most = None if high is None or at_least else round(high)
    if demand.value is not None or demand.scope is not None or least < 0 or (most is not None and most < least):
        raise InvalidRequest(
            f"{text!r} is not valid in vehicles",
            valid=["truck", "truck=2", "car=4..4", "bicycle=0"],
            remedies=[instead(text, demand.name if demand.value or not low else f"{demand.name}={abs(round(low))}")],
        )
    return VehicleDemand(vehicle_class=demand.name, least=least, most=most)


def _bare_demand(name: str) -> VehicleDemand:
    """Return a class without a number: its natural share of traffic. Cars make up the rest of the traffic anyway."""
    return VehicleDemand(vehicle_class=name, share=None if name == "car" else NATURAL_SHARES.get(name, 0.0))


def _shared_demand(text: str, name: str, share: float) -> VehicleDemand:
    if name == "car":
        raise InvalidRequest(
            f"vehicles {text!r}: cars have no share of their own, because they make up the rest",
            valid=["shares of other classes, such as taxi=30%, of at most 100% together"],
            next_step="leave the share of cars out",
            remedies=[instead(text, name)],
        )
    if share > 1:
        raise InvalidRequest(
            f"vehicles {text!r} is more than 100%",
            valid=[f"{name}=100% or less"],
            next_step="lower the share",
            remedies=[instead(text, f"{name}=100%")],
        )
    return VehicleDemand(vehicle_class=name, share=share)


def _ego(text: str) -> RequestedEgo:
    """Return the requested ego with our word for its class: ``type:lorry`` and ``lorry`` become ``type:truck``."""
    known = vehicle_class_of(text.strip().removeprefix("type:"))
    return RequestedEgo.of(text if known is None else f"type:{known}")


def _with_ego_class(demands: tuple[VehicleDemand, ...], ego: RequestedEgo) -> tuple[VehicleDemand, ...]:
    """Return the demands with the ego's class, if it is not a car, because other vehicles have it too."""
    name = ego.requested_class
    if name in (None, "car") or any(demand.vehicle_class == name for demand in demands):
        return demands
    return *demands, _bare_demand(name)


def _with_actor_class(
    demands: tuple[VehicleDemand, ...], others: RequestedManoeuvre | None
) -> tuple[VehicleDemand, ...]:
    """Return the demands with the class of a manoeuvre's actor, if the class is given and missing from the demands.

    Raises:
        InvalidRequest: vehicles excludes the class.
    """
    name = None if others is None else others.vehicle_class
    demand_of_class = next((demand for demand in demands if demand.vehicle_class == name), None)
    if demand_of_class is not None and demand_of_class.most == 0:
        raise InvalidRequest(
            f"others={others} needs a {name}, but vehicles excludes it", next_step=f"leave {name}=0 out of vehicles"
        )
    return demands if name in (None, "car") or demand_of_class is not None else (*demands, _bare_demand(name))


_NAMED_DEMAND = re.compile(r"(\s*!?\s*)([^\W\d][^<>=!]*?)(\s*(?:[<>=].*)?)", re.DOTALL)
"""A demand with a class in any script: what precedes the class, the class, and its number."""


def _normalised_demand(text: str) -> tuple[str, str]:
    """Return a demand with our word for its class, and a note if the word was replaced."""
    text = as_exclusion(text)
    found = _NAMED_DEMAND.fullmatch(text)
    name = None if found is None else vehicle_class_of(found[2])
    if found is None or name is None or name == found[2]:
        return text, ""
    return f"{found[1]}{name}{found[3]}", f"{found[2].strip()!r} is read as {name}"


def _box(bbox: list[float] | None) -> Box | None:
    """Return the checked box of the arguments.

    Raises:
        InvalidRequest: the numbers are not a box.
    """
    if bbox is None:
        return None
    if len(bbox) != 4:
        raise InvalidRequest(
            f"bbox has {counted(len(bbox), 'number')}", valid=["[south, west, north, east] in degrees"]
        )
    south, west, north, east = bbox
    if not (-90 <= south < north <= 90 and -180 <= west < east <= 180):
        ordered = [min(south, north), min(west, east), max(south, north), max(west, east)]
        wrong = [
            *([f"south ({south:g}) is not below north ({north:g})"] if south >= north else []),
            *([f"west ({west:g}) is not below east ({east:g})"] if west >= east else []),
        ]
        raise InvalidRequest(
            f"bbox {bbox} is not a box: {' and '.join(wrong) or 'a number is out of range'}",
            valid=["[south, west, north, east] in degrees, south from -90 to 90, west from -180 to 180"],
            next_step="put the numbers in this order",
            remedies=[with_values(bbox=ordered)],
        )
    return south, west, north, east


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
