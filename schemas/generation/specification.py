"""A generation request as typed values, parsed once and passed on.

A call in words becomes a :class:`GenerationSpec` (``workflows/generation/specification.py``), and each of its scenarios
a :class:`GenerationRequest`. Goal, ego and manoeuvre keep the words that they were parsed from, and a recipe stores
these words, so the same words give the same recipe.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, PlainSerializer, PlainValidator

from ..base import Model
from ..errors import InvalidRequest, with_values
from ..maps import Box
from ..vocabulary import EGO_CLASSES, ROAD_FRICTIONS, WEATHER_ROADS

SiteType = Literal["highway", "urban", "intersection", "signalised_intersection", "roundabout", "rural", "ramp"]
ScenarioType = Literal["any", SiteType]
MapChoice = Literal["auto", "local", "online"]
"""Which maps to use; ``auto`` means local maps that contain the place, otherwise a downloaded one."""
Density = Literal["low", "medium", "high"]
Criticality = Literal["usual", "raised", "critical"]
"""How critical a scenario has to be for the default planner.

- ``usual``: as the traffic happens to be
- ``raised``: with the added encounter that leaves the planner the least margin
- ``critical``: with an added encounter in which it fails although a careful driver would not"""
Turn = Literal["left", "right", "straight", "lane_change", "merge", "exit", "unprotected_left", "u_turn"]
_AT_JUNCTIONS: tuple[Turn, ...] = ("left", "right", "straight", "lane_change")
_WITHOUT_LIGHTS: tuple[Turn, ...] = (*_AT_JUNCTIONS, "unprotected_left")
_ON_ROADS: tuple[Turn, ...] = ("straight", "lane_change")
TURNS_AT: Mapping[SiteType, tuple[Turn, ...]] = MappingProxyType(
    {
        "roundabout": (*_AT_JUNCTIONS, "u_turn"),
        "signalised_intersection": _AT_JUNCTIONS,
        "intersection": _WITHOUT_LIGHTS,
        "urban": _WITHOUT_LIGHTS,
        "ramp": ("merge", "exit", *_ON_ROADS),
        "highway": _ON_ROADS,
        "rural": _ON_ROADS,
    }
)
"""The turns that an ego can make at each type of site; ``engine/generation/turns.py`` says when it makes them."""


NATURAL_SHARES: Mapping[str, float] = MappingProxyType({"delivery": 0.101, "truck": 0.022, "bus": 0.0025})
"""Shares of all motor vehicles in use, by class: 28.0 million vans, 6.2 million lorries and 0.69 million buses,
compared with 242.7 million cars (:data:`SHARES_SOURCE`). No count is known here for the other classes."""
SHARES_SOURCE = "carmakers' association ACEA, Vehicles in use in Europe, 2019"


class VehicleDemand(Model):
    """The number of vehicles of a class, in addition to the ego.

    ``least`` is also the target, except for cars, which make up the rest of the traffic. ``most`` is None if there is
    no upper bound. ``share`` is a share of all vehicles in [0, 1], and gives at least one vehicle. If there is neither
    a number nor a share, the class gets a fifth of the traffic, as before shares existed. A recipe omits a share of
    None.
    """

    vehicle_class: str
    least: int | None = None
    most: int | None = None
    share: float | None = Field(None, ge=0, le=1, exclude_if=lambda share: share is None)

    @property
    def needed(self) -> int:
        """The minimum number: 1 for a class without a number."""
        return 1 if self.least is None else self.least


Weather = Literal["light_rain", "heavy_rain", "fog", "snow", "hail"]
WEATHERS: tuple[Weather, ...] = get_args(Weather)
"""CommonRoad's words for bad weather. For good weather, its schema and commonroad-io have no word in common."""
WEATHER_WORDS: Mapping[str, Weather] = MappingProxyType({"rain": "light_rain", "mist": "fog", "snowfall": "snow"})
"""Everyday words for weather and their meanings."""


TripKind = Literal["usual", "fringe", "uniform", "length", "lanes", "speed"]
"""The roads on which more trips begin: long, wide and fast ones (usual); those on which traffic enters; all equally;
long ones; long and wide ones; fast ones."""
TRIP_KINDS: tuple[TripKind, ...] = get_args(TripKind)


COMPASS_DEG: Mapping[str, float] = MappingProxyType(
    {
        "north": 90.0,
        "northeast": 45.0,
        "east": 0.0,
        "southeast": -45.0,
        "south": -90.0,
        "southwest": -135.0,
        "west": 180.0,
        "northwest": 135.0,
    }
)
"""Compass directions as headings in degrees, counter-clockwise from east."""


class RoadFlow(Model):
    """Vehicles counted per hour on a road, in one compass direction if given, or from one road or direction to another.

    ``road`` and ``to`` are street names or OSM way ids; if ``to`` is given, either can also be a direction.
    """

    road: str
    per_h: float = Field(gt=0)
    direction: str = Field("", exclude_if=lambda word: not word)
    to: str = Field("", exclude_if=lambda word: not word)

    def __str__(self) -> str:
        if self.to:
            return f"{self.road} to {self.to}"
        return f"{self.road} ({self.direction}bound)" if self.direction else self.road


class TrafficConditions(Model):
    """The conditions of the traffic.

    - ``time``: the time of day as ``HH:MM``, or empty
    - ``drivers``: the preset of all drivers, or their published calibrations, joined by ``+``
    - ``natural_mix``: all classes at their natural shares
    - ``per_lane_km``: vehicles per kilometre of lane at the start, instead of the density's; None to use the density
    - ``flows``: counted traffic, which replaces the density and ``per_lane_km``
    - ``trips``: the roads on which more trips begin
    """

    time: str = ""
    weather: Weather | None = None
    drivers: str = ""
    natural_mix: bool = False
    per_lane_km: float | None = None
    flows: tuple[RoadFlow, ...] = Field((), exclude_if=lambda flows: not flows)
    trips: TripKind = Field("usual", exclude_if=lambda kind: kind == "usual")

    @property
    def hour(self) -> int | None:
        """The hour of the day, from 0 to 23, or None if no time is given."""
        return int(self.time.partition(":")[0]) if self.time else None

    @property
    def friction(self) -> float | None:
        """The roads' coefficient of friction in this weather, or None if it is good or no figure is known."""
        road = WEATHER_ROADS.get(self.weather or "")
        return None if road is None else ROAD_FRICTIONS[road]

    @property
    def calibrations(self) -> tuple[str, ...]:
        """The names in ``drivers``: a single preset, or one or more calibrations."""
        return tuple(self.drivers.split("+")) if self.drivers else ()


THROUGH = "through"
"""The goal beyond the site, as far along the ego's route as the scenario's duration allows."""
USUAL_GOAL, USUAL_EGO, USUAL_DURATION_S = THROUGH, "first", 20
"""The defaults of all generation arguments. The recipe records them.

A goal's time window is set in ``engine/generation/planning_problem.py``; planners aim at its middle.
"""
LONGEST_DURATION_S = 120
"""Maximum duration of a recording (chosen)."""
LONGEST_FOR_TURN_S = 60
"""Maximum duration of a recording that is prolonged for the ego's turn (chosen): once around a large ring."""
USUAL_DENSITY: Density = "low"
MIDDLE = "middle"
"""The usual position on a lanelet."""
GOAL_FORMS = (
    "through (any point beyond the site)",
    f"through:TURN ({', '.join(get_args(Turn))})",
    "steps:N (10 to 1000)",
    "distance_m:X (5 to 2000)",
    "lanelet:ID:POSITION, also lanelet:ID:POSITION:LENGTHxWIDTH",
)
EGO_FORMS = ("first", "index:N (cars, from 0)", "type:CLASS")


@dataclass(frozen=True)
class LaneletGoal:
    """A goal on a lanelet: a position as a word, fraction or metres, and the rectangle (length, width) in m."""

    lanelet_id: int
    position: str
    size_m: tuple[float, float] | None


def _nearest_goals(text: str) -> list[str]:
    """Return the goal that an invalid text probably means: a turn without its form, or the nearest number."""
    if (turn := text.strip().lower().replace(" ", "_")) in get_args(Turn):
        return [f"{THROUGH}:{turn}"]
    for form, least, most in (("steps", 10, 1000), ("distance_m", 5, 2000)):
        if (match := re.fullmatch(rf"{form}:(\d{{1,9}})(?:\.\d+)?", text)) is not None:
            return [f"{form}:{min(max(int(match[1]), least), most)}"]
    return []


@dataclass(frozen=True)
class RequestedGoal:
    """The requested goal: after some steps, after a distance in m on the ego's path, on a lanelet, or beyond the site.

    ``turn`` is the ego's turn at the site if the goal is beyond it, or None for any turn. ``text`` is the original
    text.
    """

    text: str
    steps: int | None = None
    distance_m: float | None = None
    lanelet: LaneletGoal | None = None
    turn: Turn | None = None

    @classmethod
    def of(cls, text: str) -> "RequestedGoal":
        """Parse ``through[:TURN]``, ``steps:N``, ``distance_m:X`` or ``lanelet:ID[:POSITION[:LENGTHxWIDTH]]``.

        Raises:
            InvalidRequest: the text has none of these forms, or a value is outside 10 … 1000 steps, 5 … 2000 m, or a
                rectangle of 0.5 … 500 m.
        """
        if text == THROUGH:
            return cls(text)
        turn = next((turn for turn in get_args(Turn) if text == f"{THROUGH}:{turn}"), None)
        if turn is not None:
            return cls(text, turn=turn)
        if (match := re.fullmatch(r"steps:(\d{1,5})", text)) and 10 <= int(match[1]) <= 1000:
            return cls(text, steps=int(match[1]))
        if (match := re.fullmatch(r"distance_m:(\d{1,5}(?:\.\d+)?)", text)) and 5 <= float(match[1]) <= 2000:
            return cls(text, distance_m=float(match[1]))
        if match := re.fullmatch(r"lanelet:(\d{1,9})(?::([a-z_]+|[\d.]+m?))?(?::([\d.]+)x([\d.]+))?", text):
            try:
                size = (float(match[3]), float(match[4])) if match[3] else None
            except ValueError:
                size = (0.0, 0.0)
            if size is None or all(0.5 <= side <= 500 for side in size):
                return cls(text, lanelet=LaneletGoal(int(match[1]), match[2] or MIDDLE, size))
        raise InvalidRequest(
            f"{text!r} is not a valid goal",
            valid=GOAL_FORMS,
            remedies=[*(with_values(goal=near) for near in _nearest_goals(text)), with_values(goal=None)],
        )

    @property
    def is_through(self) -> bool:
        """Whether the goal is beyond the site."""
        return self.steps is None and self.distance_m is None and self.lanelet is None

    def __str__(self) -> str:
        return self.text

    def in_words(self) -> str:
        """Return the position of the goal, as stated in a refusal."""
        if self.is_through:
            return "beyond the site" if self.turn is None else f"beyond the site after the turn {self.turn!r}"
        if self.lanelet is not None:
            return f"on lanelet {self.lanelet.lanelet_id} ({self.lanelet.position})"
        return f"{self.steps} steps ahead" if self.steps is not None else f"{self.distance_m:g} m ahead"


@dataclass(frozen=True)
class RequestedEgo:
    """The requested ego: the car with an index (None: any), or any vehicle of ``vehicle_class``.

    ``other_class`` is a requested class that an ego cannot have, so a car is used instead. ``text`` is the original
    text.
    """

    text: str = USUAL_EGO
    index: int | None = None
    vehicle_class: str = "car"
    other_class: str | None = None

    @classmethod
    def of(cls, text: str) -> "RequestedEgo":
        """Parse ``first``, ``index:N`` or ``type:CLASS``.

        Raises:
            InvalidRequest: the text has none of these forms.
        """
        match = re.fullmatch(r"first|index:(\d{1,3})|type:([a-z_]{1,30})", text)
        if match is None:
            raise InvalidRequest(f"ego {text!r} cannot be parsed", valid=EGO_FORMS)
        index, name = match.groups()
        if name in EGO_CLASSES:
            return cls(text, vehicle_class=name)
        return cls(text, int(index) if index else None, other_class=name)

    @property
    def requested_class(self) -> str | None:
        """The requested class, whether or not an ego can have it, or None if no class is requested."""
        return self.other_class or (self.vehicle_class if self.text.startswith("type:") else None)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class RequestedManoeuvre:
    """The requested manoeuvre of another road user, and the class that performs it (None: any class)."""

    name: str
    vehicle_class: str | None = None

    @classmethod
    def of(cls, text: str) -> "RequestedManoeuvre | None":
        """Parse ``name`` or ``name:class``; return None if the text is empty."""
        name, _, vehicle_class = text.partition(":")
        return cls(name, vehicle_class or None) if name else None

    @property
    def of_any_class(self) -> "RequestedManoeuvre":
        """The same manoeuvre by any class."""
        return replace(self, vehicle_class=None)

    def __str__(self) -> str:
        return self.name if self.vehicle_class is None else f"{self.name}:{self.vehicle_class}"


def _read_by(read: Callable[[str], Any]) -> PlainValidator:
    """Return a validator that parses text and accepts parsed values."""
    return PlainValidator(lambda value: read(value) if isinstance(value, str) else value, json_schema_input_type=str)


_AS_TEXT = PlainSerializer(str, return_type=str)
Goal = Annotated[RequestedGoal, _read_by(RequestedGoal.of), _AS_TEXT]
Ego = Annotated[RequestedEgo, _read_by(RequestedEgo.of), _AS_TEXT]
Manoeuvre = Annotated[RequestedManoeuvre | None, _read_by(RequestedManoeuvre.of), _AS_TEXT]


class ScenarioSpec(Model):
    """The request for each scenario of a generation, parsed and checked.

    ``bbox`` is south, west, north, east in degrees. ``road_classes`` are OSM's ``highway`` values; empty means all
    roads, with links if the site is a ramp or a motorway. ``vehicles`` lists classes in addition to the ego, including
    the ego's own class if it is not a car. ``others`` is a manoeuvre that another road user must perform on the ego's
    route. ``longest_s``: the recording may be longer than ``duration_s``, up to this, if the ego's turn takes longer;
    None if the call states the duration.
    """

    scenario_type: ScenarioType = "any"
    bbox: Box | None = None
    road_classes: tuple[str, ...] = ()
    density: Density = USUAL_DENSITY
    vehicles: tuple[VehicleDemand, ...] = ()
    duration_s: float = float(USUAL_DURATION_S)
    longest_s: float | None = Field(None, exclude_if=lambda longest_s: longest_s is None)
    ego: Ego = RequestedEgo()
    goal: Goal = RequestedGoal.of(USUAL_GOAL)
    seed: int = 0
    conditions: TrafficConditions | None = Field(None, exclude_if=lambda conditions: conditions is None)
    others: Manoeuvre = Field(None, exclude_if=lambda manoeuvre: manoeuvre is None)

    def check_turn(self) -> None:
        """Refuse a turn that no ego makes at a site of this type.

        Raises:
            InvalidRequest: no ego makes this turn there; the error lists the possible turns.
        """
        kind, turn = self.scenario_type, self.goal.turn
        if turn is not None and kind != "any" and turn not in TURNS_AT[kind]:
            raise InvalidRequest(
                f"the ego cannot make the turn {turn!r} at {kind} sites",
                valid=[f"{THROUGH}:{known}" for known in TURNS_AT[kind]],
                next_step="choose one of these goals, or another scenario_type",
                given=f"{THROUGH}:{turn}",
            )

    @property
    def people(self) -> VehicleDemand | None:
        """The number of pedestrians requested, or None."""
        requested = next((demand for demand in self.vehicles if demand.vehicle_class == "pedestrian"), None)
        return None if requested is None or requested.most == 0 else requested

    @property
    def on_wheels(self) -> tuple[VehicleDemand, ...]:
        """The requested vehicles, excluding pedestrians."""
        return tuple(demand for demand in self.vehicles if demand.vehicle_class != "pedestrian")


class GenerationSpec(ScenarioSpec):
    """A parsed request for scenarios; frozen, and never parsed again.

    ``place`` is the text for a place, a street, a road or a map's id. ``country`` is the original text and
    ``country_code`` its ISO 3166-1 alpha-3 code if known. ``notes`` state how the request was understood, one sentence
    each.
    """

    place: str | None = None
    country: str | None = None
    country_code: str | None = None
    count: int = 1
    source: MapChoice = "auto"
    trial_run: bool = False
    notes: tuple[str, ...] = ()


class GenerationRequest(ScenarioSpec):
    """Everything that defines one scenario. The same request gives the same bytes.

    ``index`` counts the scenarios of one call, and ``site_index`` those on this map, so no site is used twice. If a
    site fails its checks, the site ``site_step`` further on is tried.

    After ``most_sites`` sites without a scenario, the request is refused. After ``most_rounds`` rounds of traffic, the
    best scenario is used, with its faults in the notes. None means the generator's limits.

    ``streets`` lists, for every road that the site must have, its names or numbers on the map. ``longer_streets`` lists
    for each of them the roads that count instead if the ``streets`` do not meet.
    """

    map_path: str
    map_id: str
    place: str
    country: str | None
    attribution: str
    streets: tuple[tuple[str, ...], ...] = ()
    longer_streets: tuple[tuple[str, ...], ...] = Field((), exclude_if=lambda streets: not streets)
    index: int = 0
    site_index: int = 0
    site_step: int = 1
    most_sites: int | None = Field(None, ge=1, exclude_if=lambda sites: sites is None)
    most_rounds: int | None = Field(None, ge=1, exclude_if=lambda rounds: rounds is None)
    benchmark_number: int = 1
    folder: str
