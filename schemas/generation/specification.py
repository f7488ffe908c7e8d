"""What is asked of a generation: its words as typed values, read once and handed on.

A call in words becomes a :class:`GenerationSpec` (``workflows/generation/specification.py``), a scenario of it a
:class:`GenerationRequest`. Goal, ego and manoeuvre know the words that they were read from, and those are what a recipe
holds: the same words give the same recipe.
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
"""Which maps are used: ``auto``: local ones that show the place, otherwise one from the net."""
Density = Literal["low", "medium", "high"]
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
"""What an ego can be asked to do at a site of each type; ``engine/generation/turns.py`` says when it does."""


NATURAL_SHARES: Mapping[str, float] = MappingProxyType({"delivery": 0.101, "truck": 0.022, "bus": 0.0025})
"""Of all motor vehicles in use, by class: 28.0 million vans, 6.2 million lorries and 0.69 million buses, next to 242.7
million cars (:data:`SHARES_SOURCE`). Of the other classes no count is known here."""
SHARES_SOURCE = "ACEA, Vehicles in use in Europe: EU, 2019"


class VehicleDemand(Model):
    """How many vehicles of a class have to be there besides the ego.

    ``least``: with a number no more are aimed for, except cars, which fill up the traffic. ``most`` None: no upper
    bound. ``share``: of all vehicles, in [0, 1], one at least. With neither number nor share the class gets a fifth of
    the traffic, as scenarios did that were made before shares were known; a recipe does not hold a share of None.
    """

    vehicle_class: str
    least: int | None = None
    most: int | None = None
    share: float | None = Field(None, ge=0, le=1, exclude_if=lambda share: share is None)

    @property
    def needed(self) -> int:
        """How many have to be there: one of a class that was only named."""
        return 1 if self.least is None else self.least


Weather = Literal["light_rain", "heavy_rain", "fog", "snow", "hail"]
WEATHERS: tuple[Weather, ...] = get_args(Weather)
"""CommonRoad's words for bad weather; for good weather its schema and commonroad-io have no word in common."""
WEATHER_WORDS: Mapping[str, Weather] = MappingProxyType({"rain": "light_rain", "mist": "fog", "snowfall": "snow"})
"""Everyday words for weather, by what they are taken as."""


TripKind = Literal["usual", "fringe", "uniform", "length", "lanes", "speed"]
"""On which roads more trips begin: long, wide and fast ones (usual); those on which traffic enters; every one alike;
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
"""Directions of the compass as headings in degrees, counter-clockwise from east."""


class RoadFlow(Model):
    """Vehicles that were counted in an hour: on a road, in one direction of the compass if any, or from it to another.

    ``road``, ``to``: a street's name, an OSM way's id or, for a flow from somewhere to somewhere, a direction.
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
    """Under which conditions traffic drives.

    ``time``: of day, ``HH:MM``, empty if it is not given; ``drivers``: the preset that all drivers have, or the
    published calibrations that hold for them, joined by ``+``;
    ``natural_mix``: all classes at their natural shares. ``per_lane_km``: vehicles per kilometre of lane at the start
    that stand in the place of the density's, None if the density counts. ``flows``: counted traffic that stands in
    the place of both; ``trips``: on which roads more trips begin.
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
        """The hour of the day, from 0 to 23; None if no time is given."""
        return int(self.time.partition(":")[0]) if self.time else None

    @property
    def friction(self) -> float | None:
        """The coefficient of friction of roads in the weather; None if it is good, or no figure is known for it."""
        road = WEATHER_ROADS.get(self.weather or "")
        return None if road is None else ROAD_FRICTIONS[road]

    @property
    def calibrations(self) -> tuple[str, ...]:
        """The names in ``drivers``, none where it is empty; where it is a preset, that is the only one."""
        return tuple(self.drivers.split("+")) if self.drivers else ()


THROUGH = "through"
"""The goal behind the site, as far on the ego's way as the scenario's duration allows."""
USUAL_GOAL, USUAL_EGO, USUAL_DURATION_S = THROUGH, "first", 20
"""What a call asks for that does not say it: every default of a generation stands here, and the recipe records it."""
USUAL_DENSITY: Density = "low"
MIDDLE = "middle"
"""The usual position on a lanelet."""
GOAL_FORMS = (
    "through (behind the site)",
    f"through:TURN ({', '.join(get_args(Turn))})",
    "steps:N (10 to 1000)",
    "distance_m:X (5 to 2000)",
    "lanelet:ID:POSITION, also lanelet:ID:POSITION:LENGTHxWIDTH",
)
EGO_FORMS = ("first", "index:N (cars, from 0)", "type:CLASS")


@dataclass(frozen=True)
class LaneletGoal:
    """A goal on a lanelet: a position word, fraction or metres along it, and the rectangle (length, width) in m."""

    lanelet_id: int
    position: str
    size_m: tuple[float, float] | None


@dataclass(frozen=True)
class AskedGoal:
    """The goal as asked: after a number of steps, after a distance in m on the ego's own path, on a lanelet, or, with
    neither, behind the site.

    ``turn``: what the ego does at the site on its way behind it; None: anything. ``text``: the words for all of it.
    """

    text: str
    steps: int | None = None
    distance_m: float | None = None
    lanelet: LaneletGoal | None = None
    turn: Turn | None = None

    @classmethod
    def of(cls, text: str) -> "AskedGoal":
        """Read ``through[:TURN]``, ``steps:N``, ``distance_m:X`` or ``lanelet:ID[:POSITION[:LENGTHxWIDTH]]``.

        Raises:
            InvalidRequest: none of these, or outside 10 … 1000 steps, 5 … 2000 m, or a rectangle of 0.5 … 500 m.
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
        raise InvalidRequest(f"goal {text!r} cannot be read", valid=GOAL_FORMS, remedies=[with_values(goal=None)])

    @property
    def is_through(self) -> bool:
        """Return whether the goal lies behind the site."""
        return self.steps is None and self.distance_m is None and self.lanelet is None

    def __str__(self) -> str:
        return self.text

    def in_words(self) -> str:
        """Return where the goal lies, as a refusal says it."""
        if self.is_through:
            return "behind the site" if self.turn is None else f"behind the site with the turn {self.turn!r}"
        if self.lanelet is not None:
            return f"on lanelet {self.lanelet.lanelet_id} ({self.lanelet.position})"
        return f"{self.steps} steps ahead" if self.steps is not None else f"{self.distance_m:g} m ahead"


@dataclass(frozen=True)
class AskedEgo:
    """The ego as asked: the car with an index (None: any), or any vehicle of ``vehicle_class``.

    ``other_class``: a class that was asked for and that no ego can be, so that a car replaces it. ``text``: the words
    for all of it.
    """

    text: str = USUAL_EGO
    index: int | None = None
    vehicle_class: str = "car"
    other_class: str | None = None

    @classmethod
    def of(cls, text: str) -> "AskedEgo":
        """Read ``first``, ``index:N`` or ``type:CLASS``.

        Raises:
            InvalidRequest: none of these.
        """
        match = re.fullmatch(r"first|index:(\d{1,3})|type:([a-z_]{1,30})", text)
        if match is None:
            raise InvalidRequest(f"ego {text!r} cannot be read", valid=EGO_FORMS)
        index, name = match.groups()
        if name in EGO_CLASSES:
            return cls(text, vehicle_class=name)
        return cls(text, int(index) if index else None, other_class=name)

    @property
    def asked_class(self) -> str | None:
        """The class that the words name, whether or not an ego can be one; None if they name none."""
        return self.other_class or (self.vehicle_class if self.text.startswith("type:") else None)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class AskedManoeuvre:
    """The manoeuvre of another road user that is asked for, and the class that is to make it (None: any class)."""

    name: str
    vehicle_class: str | None = None

    @classmethod
    def of(cls, text: str) -> "AskedManoeuvre | None":
        """Read ``name`` or ``name:class``; return None if nothing is asked for."""
        name, _, vehicle_class = text.partition(":")
        return cls(name, vehicle_class or None) if name else None

    @property
    def of_any_class(self) -> "AskedManoeuvre":
        """The same manoeuvre, whichever class makes it."""
        return replace(self, vehicle_class=None)

    def __str__(self) -> str:
        return self.name if self.vehicle_class is None else f"{self.name}:{self.vehicle_class}"


def _read_by(read: Callable[[str], Any]) -> PlainValidator:
    """Return a validator that reads words and lets through what was read before."""
    return PlainValidator(lambda value: read(value) if isinstance(value, str) else value, json_schema_input_type=str)


_AS_TEXT = PlainSerializer(str, return_type=str)
Goal = Annotated[AskedGoal, _read_by(AskedGoal.of), _AS_TEXT]
Ego = Annotated[AskedEgo, _read_by(AskedEgo.of), _AS_TEXT]
Manoeuvre = Annotated[AskedManoeuvre | None, _read_by(AskedManoeuvre.of), _AS_TEXT]


class ScenarioSpec(Model):
    """What is asked of each scenario of a generation, each part read and checked.

    ``bbox``: south, west, north, east in degrees. ``road_classes``: OSM's ``highway`` values; empty: all roads, with
    links where the site is a ramp or a motorway. ``vehicles``: classes besides the ego; the ego's
    own class is among them if it is not a car. ``others``: a manoeuvre that another road user has to make on the ego's
    way.
    """

    scenario_type: ScenarioType = "any"
    bbox: Box | None = None
    road_classes: tuple[str, ...] = ()
    density: Density = USUAL_DENSITY
    vehicles: tuple[VehicleDemand, ...] = ()
    duration_s: float = float(USUAL_DURATION_S)
    ego: Ego = AskedEgo()
    goal: Goal = AskedGoal.of(USUAL_GOAL)
    seed: int = 0
    conditions: TrafficConditions | None = Field(None, exclude_if=lambda conditions: conditions is None)
    others: Manoeuvre = Field(None, exclude_if=lambda manoeuvre: manoeuvre is None)

    def check_turn(self) -> None:
        """Refuse a turn that no ego makes at a site of the type.

        Raises:
            InvalidRequest: with the turns that are made there.
        """
        kind, turn = self.scenario_type, self.goal.turn
        if turn is not None and kind != "any" and turn not in TURNS_AT[kind]:
            raise InvalidRequest(
                f"at a site of the type {kind} no ego makes the turn {turn!r}",
                valid=[f"{THROUGH}:{known}" for known in TURNS_AT[kind]],
                next_step="choose one of these goals, or another scenario_type",
                given=f"{THROUGH}:{turn}",
            )

    @property
    def people(self) -> VehicleDemand | None:
        """How many people on foot are asked for; None if none are named, or none are to be there."""
        asked = next((demand for demand in self.vehicles if demand.vehicle_class == "pedestrian"), None)
        return None if asked is None or asked.most == 0 else asked

    @property
    def on_wheels(self) -> tuple[VehicleDemand, ...]:
        """The vehicles that are asked for, without people on foot."""
        return tuple(demand for demand in self.vehicles if demand.vehicle_class != "pedestrian")


class GenerationSpec(ScenarioSpec):
    """A call for scenarios, read at the door and handed on; frozen, and never read from words again.

    ``place``: words for a place, a street, a road or a map's id. ``country``: as it was spelled, and ``country_code``:
    ISO 3166-1 alpha-3 where the words are known. ``notes``: what was understood, a sentence each.
    """

    place: str | None = None
    country: str | None = None
    country_code: str | None = None
    count: int = 1
    source: MapChoice = "auto"
    trial_run: bool = False
    notes: tuple[str, ...] = ()


class GenerationRequest(ScenarioSpec):
    """Everything that makes one scenario; the same request gives the same bytes.

    ``index`` counts the scenarios of one call, ``site_index`` those on this map: no site is taken twice. When a site
    fails its checks, the one ``site_step`` further on is tried.

    ``most_sites``: after so many sites without a scenario the request is refused; ``most_rounds``: after so many rounds
    of traffic the best scenario is taken, its faults in the notes. None: as many as the generator tries.

    ``streets``: for every road that the site must carry its names or numbers, as the map has them.
    """

    map_path: str
    map_id: str
    place: str
    country: str | None
    attribution: str
    streets: tuple[tuple[str, ...], ...] = ()
    index: int = 0
    site_index: int = 0
    site_step: int = 1
    most_sites: int | None = Field(None, ge=1, exclude_if=lambda sites: sites is None)
    most_rounds: int | None = Field(None, ge=1, exclude_if=lambda rounds: rounds is None)
    benchmark_number: int = 1
    folder: str
