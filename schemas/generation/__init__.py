"""Generation of scenarios from maps: the tool's arguments and result, and the engine's requests and responses."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

from pydantic import Field

from ..base import DRIVEN_OTHERWISE, Answer, Arguments, Model, Result, first_of
from ..jobs import JobState
from ..maps import Box, MapServices, NamedPlace
from ..text import cited, cited_all, counted, shown_name
from .specification import COMPASS_DEG as COMPASS_DEG
from .specification import EGO_FORMS as EGO_FORMS
from .specification import GOAL_FORMS as GOAL_FORMS
from .specification import LONGEST_DURATION_S as LONGEST_DURATION_S
from .specification import LONGEST_FOR_TURN_S as LONGEST_FOR_TURN_S
from .specification import MIDDLE as MIDDLE
from .specification import NATURAL_SHARES as NATURAL_SHARES
from .specification import SHARES_SOURCE as SHARES_SOURCE
from .specification import THROUGH as THROUGH
from .specification import TRIP_KINDS as TRIP_KINDS
from .specification import TURNS_AT as TURNS_AT
from .specification import USUAL_DENSITY as USUAL_DENSITY
from .specification import USUAL_DURATION_S as USUAL_DURATION_S
from .specification import USUAL_EGO as USUAL_EGO
from .specification import USUAL_GOAL as USUAL_GOAL
from .specification import WEATHER_WORDS as WEATHER_WORDS
from .specification import WEATHERS as WEATHERS
from .specification import Criticality as Criticality
from .specification import Density as Density
from .specification import GenerationRequest as GenerationRequest
from .specification import GenerationSpec as GenerationSpec
from .specification import LaneletGoal as LaneletGoal
from .specification import MapChoice as MapChoice
from .specification import RequestedEgo as RequestedEgo
from .specification import RequestedGoal as RequestedGoal
from .specification import RequestedManoeuvre as RequestedManoeuvre
from .specification import RoadFlow as RoadFlow
from .specification import ScenarioSpec as ScenarioSpec
from .specification import ScenarioType as ScenarioType
from .specification import SiteType as SiteType
from .specification import TrafficConditions as TrafficConditions
from .specification import TripKind as TripKind
from .specification import Turn as Turn
from .specification import VehicleDemand as VehicleDemand
from .specification import Weather as Weather

_SHOWN, _MOST_NOTES = 10, 2
"""How many of several scenarios, and notes on one, an answer shows (chosen)."""
NOTHING_MADE = "generate_scenarios with another scenario_type or place, or without what the reasons above name"
"""The next step after a plan that made no scenario."""
_SHOWN_PLACES, _SHOWN_CANNOT = 5, 3
"""How many places of a plan, and impossible or open combinations, an answer shows (chosen)."""


class PlaceArea(Model):
    """A settlement, or a part of one, inside a map: OSM's kind, all names, centre in degrees, and radius.

    ``radius_m`` comes from the map's outline if there is one, otherwise from the kind and the nearby places.
    """

    name: str
    kind: str
    other_names: tuple[str, ...] = ()
    latitude: float
    longitude: float
    radius_m: float


MAP_FACTS_VERSION = 7
"""The version of map facts. Raise it if more is read from a map, or if sites are counted differently: workspaces then
read their maps again."""


class MapSource(Model):
    """The origin of a downloaded map.

    - ``place``: what was downloaded, in words
    - ``osm_id``: its id in OpenStreetMap, empty for a box
    - ``core``: the area with complete roads
    - ``query``: the query sent to ``service`` (a host)
    - ``data_time``: the time of the data, as the service states it
    - ``beside``: True if the user downloaded it, so that it counts like a local map; otherwise it was downloaded for
      one request, and only that request uses it while the online services are available
    """

    place: str
    osm_id: str
    core: Box
    query: str
    service: str
    data_time: str
    beside: bool = False


INDEX_NAME = "extract.sqlite"
"""The file name of the index of a country extract, in its folder."""


class ExtractSize(Model):
    """The size of a country extract that is stored in tiles; a node at a tile border may count once per tile.

    ``data_time`` is the time that the file states, or empty.
    """

    places: int
    road_names: int
    nodes: int
    ways: int
    tiles: int
    data_time: str


class MapFacts(Model):
    """The content of a map as read from the file, without guesses.

    ``country`` is None if neither the file nor the caller gives it. ``countries_near`` then lists the candidates, and
    is empty if there is no evidence; otherwise it lists the other countries that the map shows. ``sites`` counts sites
    by scenario type. For a road with several names, ``road_names`` has the one in ``streets`` or ``refs`` first.
    ``areas`` are places that cover a part of the map. ``source`` is the origin of a downloaded map. ``extract``
    describes a country extract, which is stored in tiles. Scenarios are generated from parts of it, with its id in
    ``cut_of``. Its ``places`` are the largest ones, and its index contains the streets.
    """

    map_id: str
    file_name: str
    place: str = Field(description="name for the map; the file's own if no place is known")
    places: tuple[str, ...]
    country: str | None
    countries_near: tuple[str, ...] = ()
    south: float
    west: float
    north: float
    east: float
    streets: tuple[str, ...]
    refs: tuple[str, ...]
    sites: dict[SiteType, int]
    road_km: float
    attribution: str
    road_names: tuple[tuple[str, ...], ...] = ()
    areas: tuple[PlaceArea, ...] = ()
    facts_version: int = 1
    source: MapSource | None = None
    extract: ExtractSize | None = None
    cut_of: str = Field("", exclude_if=lambda map_id: not map_id)


class MapList(Model):
    """Maps with their content."""

    maps: tuple[MapFacts, ...]


class ReadMapRequest(Model):
    """A map file to read, with the place and country that the caller gives (None means those of the file)."""

    path: str
    map_id: str | None = None
    place: str | None = None
    country: str | None = None
    attribution: str | None = None


class ConvertMapRequest(Model):
    """A map in another format to convert into a readable one, in a folder."""

    path: str
    folder: str


class ConvertedMap(Model):
    """The map as XML, and what the conversion lost, in words.

    ``too_large`` means that the map is too large to read in one piece, so there is no file.
    """

    path: str
    lost: tuple[str, ...] = ()
    too_large: bool = False


class FetchMapRequest(Model):
    """A request for the roads around a place or in a box, with ``count`` sites of a type."""

    services: MapServices
    folder: str
    place: NamedPlace | None = None
    bbox: Box | None = None
    country: str | None = None
    scenario_type: ScenarioType = "any"
    road_classes: tuple[str, ...] = ()
    count: int = 1


class FetchedMap(Model):
    """A map downloaded into a folder: its file, its content, and the area with complete roads.

    Sites are taken only from ``core``, because roads are cut off beyond it. ``query`` was sent to ``service`` (a host).
    ``data_time`` is the time of the data. ``kept`` means that the answer comes from an earlier request.
    """

    path: str
    facts: MapFacts
    core: Box
    query: str
    service: str
    data_time: str
    kept: bool


class FetchedMaps(Model):
    """The maps downloaded for a request, best first, and what went wrong, one sentence each."""

    maps: tuple[FetchedMap, ...]
    notes: tuple[str, ...] = ()


class IndexExtractRequest(Model):
    """An extract in OpenStreetMap's binary format, to be split into tiles.

    ``folder`` keeps finished parts if the work stops, so that the same request can resume.
    """

    path: str
    folder: str
    map_id: str
    place: str | None = None
    country: str | None = None


class IndexedExtract(Model):
    """The index file of an extract, and the extract's size."""

    index: str
    facts: MapFacts


class CutExtractRequest(Model):
    """A part of an extract to cut out as a map: given by words, by a box, or as any part with a site of the type.

    ``seed`` chooses among several matches. ``facts`` are those of the extract, with the names that the words may
    contain.
    """

    index: str
    folder: str
    facts: MapFacts
    place: str | None = None
    bbox: Box | None = None
    scenario_type: ScenarioType = "any"
    seed: int = 0


class CutOfExtract(Model):
    """A part of an extract as a map file, and its content; empty and None if no part of the extract matches.

    ``core`` is the area with complete roads, in which to look for sites. ``label`` describes the part. ``words`` are
    those words of the request that refer to something in the map, and empty if all of them refer to the extract.
    """

    path: str = ""
    facts: MapFacts | None = None
    core: Box = (0.0, 0.0, 0.0, 0.0)
    label: str = ""
    words: str = ""


Combination = tuple[tuple[int, int], ...]
"""Levels of several factors of a coverage plan: (index of the factor, index of its level), ascending."""


class PlanFactor(Model):
    """A factor that a coverage plan varies, and its levels in the notation of a call."""

    name: str
    levels: tuple[str, ...]

    def text(self, level: int) -> str:
        """Return a level in the notation of a call, such as ``density=high``."""
        return f"{self.name.partition(' ')[0]}={self.levels[level]}"


class CoverageRequest(Model):
    """The progress of a coverage plan, and a request for its next ``most`` rows.

    ``strength`` is the number of factors in a combination. ``barred`` are combinations of any size that no map has.
    ``covered`` are finished combinations. ``refused`` counts refusals by combination. ``lap`` is the number of times
    that everything has already been covered; it varies further rows.
    """

    factors: tuple[PlanFactor, ...]
    strength: int
    barred: tuple[Combination, ...] = ()
    covered: tuple[Combination, ...] = ()
    refused: tuple[tuple[Combination, int], ...] = ()
    lap: int = 0
    most: int = 0


class CoverageReport(Model):
    """The progress of a coverage plan, and its next rows, each with the index of one level per factor.

    ``allowed`` counts the possible combinations, and ``covered`` and ``left`` count how many of these are covered and
    left. ``cannot`` lists combinations that were tried often enough, and those that imply one of these.
    """

    rows: tuple[tuple[int, ...], ...]
    allowed: int
    covered: int
    left: tuple[Combination, ...]
    cannot: tuple[Combination, ...]


class SiteCount(Model):
    """The number of different sites that match a request."""

    count: int


class SiteFacts(Model):
    """The site of a scenario: type, centre in degrees, streets, radius; ``osm_id`` is the node or way that marks it."""

    scenario_type: SiteType = Field(description="type of the site")
    latitude: float = Field(description="latitude of its centre, in degrees")
    longitude: float = Field(description="longitude of its centre, in degrees")
    streets: tuple[str, ...] = Field(description="streets that meet there")
    radius_m: float = Field(description="radius of the cut")
    osm_id: str = ""


class GeneratedEgo(Model):
    """The ego's start and goal: step and distance on its recorded path, speed, and the goal's lanelet and time.

    ``cars_to_choose_from`` counts the vehicles of its class, which is a car unless the call requests another class.
    """

    vehicle: str
    vehicle_class: str = Field("car", exclude_if=lambda name: name == "car")
    cars_to_choose_from: int
    speed_mps: float
    goal_step: int
    goal_distance_m: float
    goal_lanelet: int
    goal_time_s: tuple[float, float]
    goal_size_m: tuple[float, float]


class DensityFacts(Model):
    """Vehicles per kilometre of lane in the cut map: requested, at step 0, and at the last step.

    CommonRoad's schema lets obstacles begin only at step 0, so traffic thins out as vehicles leave. ``paper_trips`` is
    the number in the paper's scenarios of that density. ``at_time`` is the time of day that set the density instead of
    ``wish``, or empty.
    """

    wish: Density = Field(description="the density requested")
    paper_trips: int
    lane_km: float = Field(description="length of all lanes in the cut")
    target_per_lane_km: float = Field(description="vehicles per lane-km requested")
    at_start_per_lane_km: float = Field(description="vehicles per lane-km at the first step")
    at_end_per_lane_km: float = Field(description="vehicles per lane-km at the last step")
    at_time: str = ""

    @property
    def requested(self) -> str:
        """The source of the requested density: a word, or a time of day."""
        return self.at_time or f"{self.wish} density"


class Checks(Model):
    """The checks of the written file.

    ``centers_on_lanelets`` and ``feasible_share`` are shares in [0, 1] of all recorded positions and of all tracks.
    ``network_errors`` and ``network_warnings`` are the broken rules for road networks, with the first position of each.
    ``recorded_ego_collision_free`` is None if others were scripted after the ego was recorded. In that case, an
    ordinary driver in the ego's place was checked instead.
    """

    schema_valid: bool
    goal_reachable: bool
    collisions_at_start: int
    overlapping_pairs: int
    recorded_ego_collision_free: bool | None
    centers_on_lanelets: float
    feasible_share: float
    infeasible_vehicles: tuple[int, ...]
    network_errors: tuple[str, ...] = ()
    network_warnings: tuple[str, ...] = ()


AbsenceFate = Literal["never_there", "left_out", "replaced"]
AbsenceCode = Literal[
    "no_room", "file_too_large", "not_drivable", "overlap", "no_such_goal", "no_ego_class", "scripted"
]
ABSENCE_REASONS: Mapping[AbsenceCode, str] = MappingProxyType(
    {
        "no_room": "no room at the site at the start, or had left it by then",
        "file_too_large": "a recording with that many vehicles is too large for a file",
        "not_drivable": "SUMO's motion is infeasible for this vehicle class",
        "overlap": "would overlap another road user",
        "no_such_goal": "no such goal on the route, so a later car is the ego",
        "no_ego_class": "an ego cannot have this class, so a car is the ego and this class is in the traffic",
        "scripted": "replaced with the actor of the requested manoeuvre",
    }
)
"""Why a requested road user is missing or different; docs/generation.md lists the codes."""


class VehicleAbsence(Model):
    """Requested road users of one class that are missing or different, and the reason.

    ``fate`` says whether they were missing at the start, were left out of SUMO's recording, or were replaced.
    ``vehicles`` lists the SUMO ids of those that drove in SUMO before they were left out or replaced.
    """

    fate: AbsenceFate = Field(description="what happened to them")
    code: AbsenceCode = Field(description="reason as a code")
    vehicle_class: str = Field(description="the class requested")
    count: int = Field(description="their number")
    vehicles: tuple[str, ...] = ()
    reason: str = Field(description="reason in words")

    def in_words(self) -> str:
        """Return the number and class of the road users, and the reason."""
        return f"{counted(self.count, self.vehicle_class)} ({self.code}: {self.reason})"


class GeneratedScenario(Model):
    """One scenario: its files, and the requested values next to the realised ones.

    ``vehicle_classes`` maps CommonRoad's obstacle id to the requested class, because CommonRoad has fewer types.
    ``unsigned_limits_kmh`` maps a lanelet to its limit if CommonRoad has no sign for it in the country. ``others``
    describes the requested manoeuvre of another road user: which one, when, and how it was created. ``absences``
    explain missing road users.
    """

    benchmark_id: str
    site: SiteFacts
    vehicles_asked: int
    vehicles_realised: int
    classes_asked: dict[str, int]
    classes_realised: dict[str, int]
    density: DensityFacts
    duration_s: float
    recorded_s: float
    lanelets: int
    traffic_lights: int
    ego: GeneratedEgo
    checks: Checks
    notes: tuple[str, ...]
    netconvert_warnings: tuple[str, ...]
    attribution: str
    vehicle_classes: dict[int, str] = Field(default_factory=dict)
    unsigned_limits_kmh: dict[int, float] = Field(default_factory=dict)
    others: str = Field("", exclude_if=lambda words: not words)
    absences: tuple[VehicleAbsence, ...] = Field((), exclude_if=lambda absences: not absences)


class GenerateScenariosArguments(Arguments):
    """Generate scenarios from a map; reports requested and realised."""

    place: str | None = Field(None, description="city, street, 'street A / street B', road number or map id")
    country: str | None = Field(None, description="ISO alpha-3")
    bbox: list[float] | None = Field(None, description="south, west, north, east")
    scenario_type: ScenarioType = "any"
    """The type of site to look for on the map."""
    road_classes: list[str] | None = Field(None, description="roads, link, all or OSM highway values")
    density: Density = USUAL_DENSITY
    """The amount of traffic, in vehicles per kilometre of lane."""
    vehicles: list[str] = Field(
        [],
        description=(
            "besides cars: 'truck=2' at least, 'car=4..4' exactly, 'taxi=30%'. Classes: car truck bus "
            "motorcycle bicycle pedestrian trailer delivery coach taxi emergency moped"
        ),
    )
    duration_s: float = Field(USUAL_DURATION_S, ge=5, le=LONGEST_DURATION_S)
    """The duration of the scenario, in s."""
    ego: str = Field(USUAL_EGO, description="first, index:N (cars, from 0), type:CLASS")
    goal: str = Field(
        USUAL_GOAL,
        description="through[:left, unprotected_left, merge …], steps:N, distance_m:X on its track, "
        "lanelet:ID:POSITION",
    )
    count: int = Field(1, ge=1, le=5000)
    """How many scenarios. Each has another site or other traffic."""
    seed: int = 0
    """The same arguments with the same seed give the same bytes."""
    trial_run: bool = Field(False, description="run a planner too")
    conditions: list[str] = Field(
        [], description="time=rush_hour or 17:30, weather=rain, drivers=PRESET, mix=natural, others=cut_in"
    )
    criticality: Criticality = "usual"
    """With ``critical``, an encounter is added in which the default planner fails although a careful driver would not;
    with ``raised``, one that leaves it little margin."""
    cover: list[str] = Field([], description="'density=low|high', 'turn=left|right'")
    source: MapChoice = "auto"
    """With ``auto``, a place that no local map has is requested online."""


class ScenarioSummary(Model):
    """One generated scenario in the answer, with requested and realised values side by side."""

    scenario_id: str
    reused: bool = Field(description="whether the same request had created it already")
    map_id: str
    place: str = Field(description="the town or region")
    site: str = Field(description="type of site and streets, in words")
    latitude: float = Field(description="latitude of the site's centre, in degrees")
    longitude: float = Field(description="longitude of the site's centre, in degrees")
    osm_id: str = Field(description="OpenStreetMap's node or way that marks the site")
    vehicles_asked: int = Field(description="vehicles requested")
    vehicles_realised: int = Field(description="vehicles realised")
    classes_asked: dict[str, int] = Field(description="vehicles requested, by class")
    classes_realised: dict[str, int] = Field(description="vehicles realised, by class")
    density: str = Field(description="traffic per lane-km, realised and requested, in words")
    recorded_s: float = Field(description="duration of the recording")
    ego: str = Field(description="start of the ego, in words")
    goal: str = Field(description="the goal, in words")
    ego_speed_mps: float | None = Field(None, description="speed of the ego at its start")
    goal_lanelet: int | None = Field(None, description="id of the lanelet of the goal")
    goal_distance_m: float | None = Field(None, description="distance to the goal along the ego's recorded path")
    goal_time_s: tuple[float, float] | None = Field(None, description="time window of the goal")
    feasible_share: float = Field(description="share of the recorded tracks that a vehicle can drive, from 0 to 1")
    checks_passed: list[str] = Field(description="passed checks")
    checks_failed: list[str] = Field(description="failed checks")
    planners_refuse: str = Field("", description="why the built-in planners refuse this ego; empty if they drive it")
    trial_run: str = Field("", description="outcome of the default planner, if requested")
    others: str = Field(
        "",
        exclude_if=lambda words: not words,
        description="the requested manoeuvre of others: actor, time, and whether it is scripted",
    )
    encounter: str = Field(
        "",
        exclude_if=lambda words: not words,
        description="with `criticality`: the added encounter, and how a planner fares in it",
    )
    absences: tuple[VehicleAbsence, ...] = Field(
        (),
        exclude_if=lambda absences: not absences,
        description="requested road users that differ or are missing, and why",
    )
    notes: list[str]

    @property
    def traffic(self) -> str:
        """The ego and the others by class, and the number requested if it differs."""
        on_foot = self.classes_realised.get("pedestrian", 0)
        vehicles = {name: count for name, count in self.classes_realised.items() if name != "pedestrian"}
        classes = ", ".join(["the ego", *(counted(count, name) for name, count in vehicles.items())])
        on_foot_too = f"; {counted(on_foot, 'pedestrian')}" if on_foot else ""
        differs = self.vehicles_realised != self.vehicles_asked
        here = counted(self.vehicles_realised, "vehicle")
        if differs:
            here = f"{self.vehicles_realised} of the {counted(self.vehicles_asked, 'requested vehicle')}"
        return f"{here}: {classes}{on_foot_too}"

    @property
    def missing(self) -> list[str]:
        """Why requested road users are missing, one line each."""
        return [f"Missing road users: {absence.in_words()}." for absence in self._missing]

    @property
    def _missing(self) -> list[VehicleAbsence]:
        return [absence for absence in self.absences if absence.fate != "replaced"]

    @property
    def where(self) -> str:
        """The site, its map, and its coordinates."""
        osm = f", OSM {self.osm_id}" if self.osm_id else ""
        kind, _, rest = self.site.partition(" ")
        at = f"{self.map_id}, {self.latitude:.5f}, {self.longitude:.5f}{osm}"
        rest = f"on {rest.removeprefix('at ')}" if kind in _ROADS and rest.startswith("at ") else rest
        return f"{_SITE_NOUNS.get(kind, kind)} {rest}, {cited(self.place)} ({at})"

    def answer(self) -> Answer:
        """Return one scenario: its site, traffic and ego; then failures and deviations."""
        tried = [f"Trial run: {self.trial_run}."] if self.trial_run else []
        notes = first_of(self.notes, _MOST_NOTES, "describe_scenario with detail=checks")
        return Answer(
            headline=f"{self.scenario_id}{' (already stored)' if self.reused else ''}: {self.where}.",
            decided=[
                f"{self.recorded_s:g} s, {self.traffic}.",
                f"{self.ego[0].upper()}{self.ego[1:]}.",
                f"Goal: {self.goal}.",
                *([f"Others: {self.others}."] if self.others else []),
                *([f"Encounter: {self.encounter}."] if self.encounter else []),
            ],
            figures=[f"Traffic: {self.density}.", *self.missing, *tried, *(f"Note: {note}" for note in notes)],
            warnings=[
                *([self.planners_refuse] if self.planners_refuse else []),
                *([f"failed checks: {', '.join(self.checks_failed)}"] if self.checks_failed else []),
            ],
            next_step=DRIVEN_OTHERWISE if self.planners_refuse else "run_planner",
        )

    def line(self) -> str:
        """Return the scenario in one line, for a list of several."""
        failed = f"; FAILED: {', '.join(self.checks_failed)}" if self.checks_failed else ""
        tried = f"; trial run: {self.trial_run}" if self.trial_run else ""
        made = f"- {self.scenario_id}{' (already stored)' if self.reused else ''}"
        refused = f"; {self.planners_refuse}" if self.planners_refuse else ""
        others = "".join(f"; {words}" for words in (self.others, self.encounter) if words)
        shown = f"{self.recorded_s:g} s, {self.traffic}; {self.density}"
        absent = [f"{counted(one.count, one.vehicle_class)} ({one.code})" for one in self._missing]
        missing = f"; missing: {', '.join(absent)}" if absent else ""
        return f"{made}: {self.where}; {shown}{others}{missing}{tried}{failed}{refused}"


_ROADS = frozenset({"rural", "urban", "highway"})
"""Types of sites that are on a road, not at a junction."""
_SITE_NOUNS = {"signalised_intersection": "signalised intersection", "rural": "rural road", "urban": "urban road"}
"""Nouns for the types of sites that are not nouns."""


class PlanRecord(Model):
    """A coverage plan: its factors, and the sites of its scenarios.

    ``barred`` maps combinations that the maps do not have to the reason. ``spots`` maps each group of sites, identified
    by its words, to the maps with such sites and their number.
    """

    plan_id: str
    cover: tuple[str, ...]
    factors: tuple[PlanFactor, ...]
    strength: int
    barred: tuple[tuple[Combination, str], ...]
    spots: dict[str, tuple[tuple[str, int], ...]]


class CannotBe(Model):
    """A combination that cannot be generated, and the reason."""

    combination: str = Field(description="values requested together")
    reason: str = Field(description="why it is impossible")


class PlanSummary(Model):
    """The progress of a coverage plan.

    ``asked`` is the requested number of scenarios, or None for as many as the combinations need. ``made`` counts the
    plan's scenarios, including ``reused`` older scenarios. ``allowed`` counts the combinations that the maps allow, and
    ``covered`` counts those with a scenario. ``left`` and ``cannot`` list the first open and the first impossible
    combinations.
    """

    plan_id: str
    strength: int = Field(description="number of factors in a combination")
    asked: int | None
    made: int
    reused: int = Field(description="its scenarios that already existed")
    refused: int = Field(description="rows that no map or traffic allows")
    failed: int = Field(description="rows that failed")
    waiting: int = Field(description="rows still to be generated")
    allowed: int = Field(description="combinations that the maps allow")
    covered: int = Field(description="combinations with a scenario")
    left_total: int = Field(description="combinations still to be covered")
    left: tuple[str, ...] = Field(description="the first of these, in words")
    cannot_total: int = Field(description="impossible combinations")
    cannot: tuple[CannotBe, ...] = Field(description="the first of these, and why")
    places: dict[str, int] = Field(description="scenarios by place")

    def lines(self) -> list[str]:
        """Return what was generated and where, what is impossible, and what is left, one line each."""
        tried = [f"{counted(self.refused, 'attempt')} discarded"] if self.refused else []
        lost = [f"{self.failed} failed"] if self.failed else []
        where = [f"{count} in {shown_name(place)}" for place, count in list(self.places.items())[:_SHOWN_PLACES]]
        more = len(self.places) - len(where)
        there = [f"{', '.join(where)}{f' and {more} more at other places' if more > 0 else ''}"] if where else []
        made = "; ".join([*(f"Made {one}" for one in there), *tried, *lost])
        cannot = [f"{one.combination} ({one.reason})" for one in self.cannot[:_SHOWN_CANNOT]]
        return [
            *([f"{made}."] if made else []),
            *([_cut("Impossible", cannot, self.cannot_total)] if cannot else []),
            *([_cut("Still to be covered", list(self.left[:_SHOWN_CANNOT]), self.left_total)] if self.left else []),
        ]

    @property
    def headline(self) -> str:
        """The number of scenarios, and the share of covered combinations."""
        requested = f" of {self.asked:,}" if self.asked is not None else ""
        before = f" ({self.reused:,} already stored)" if self.reused else ""
        made = f"{self.plan_id}: {self.made:,}{requested} scenarios{before}; "
        if not self.allowed:
            return f"{made}every {self.strength}-way combination is impossible."
        return (
            f"{made}{self.covered / self.allowed:.1%} of the {self.strength}-way "
            f"combinations that the maps allow ({self.covered:,} of {self.allowed:,})."
        )


def _cut(label: str, texts: list[str], total: int) -> str:
    """Return a line with the listed combinations and, if ``total`` is larger, the number of the others."""
    more = f"; {total - len(texts):,} more" if total > len(texts) else ""
    return f"{label}: {counted(total, 'combination')}: {'; '.join(texts)}{more}."


class GenerateScenariosResult(Result):
    """The generated scenarios; for a coverage plan, its progress and the job that executes it."""

    scenarios: list[ScenarioSummary] = Field(description="the generated scenarios")
    notes: list[str]
    attribution: list[str] = Field(description="the required credit for the map's data")
    plan: PlanSummary | None = Field(None, description="progress of a coverage plan; otherwise null")
    job_id: str = ""
    state: JobState = "done"

    def answer(self) -> Answer:
        """Return one scenario in full, several in one line each, or the figures of a plan."""
        if self.plan is not None:
            following = f"run_planner with scenarios ['{self.plan.plan_id}']"
            if self.state == "running":
                following = f"get_job with job_id '{self.job_id}'"
            elif self.state != "done":
                following = "repeat this call: finished scenarios are reused"
            elif not self.plan.made:
                following = NOTHING_MADE
            return Answer(
                headline=self.plan.headline,
                decided=[f"{self.job_id}: {self.state}."] if self.job_id and self.state != "done" else (),
                figures=self.plan.lines(),
                listed=[*(f"Note: {note}" for note in self.notes), f"Map data: {cited_all(self.attribution, '; ')}"],
                next_step=following,
            )
        source = f"Map data: {cited_all(self.attribution, '; ')}"
        notes = [f"Note: {note}" for note in self.notes]
        if len(self.scenarios) == 1:
            one = self.scenarios[0].answer()
            return replace(one, figures=[*one.figures, *notes, source])
        shown = [made.line() for made in self.scenarios[:_SHOWN]]
        rest = [f"… {len(self.scenarios) - _SHOWN} more: list_artifacts"] if len(self.scenarios) > _SHOWN else []
        return Answer(
            headline=f"{counted(len(self.scenarios), 'scenario')} generated:",
            listed=[*shown, *rest, *notes, source],
            next_step=self._following(),
        )

    def _following(self) -> str:
        """Return the next call: a run of the scenarios that the built-in planners can drive."""
        driven = [made.scenario_id for made in self.scenarios if not made.planners_refuse]
        more = f" and {len(driven) - 2} more" if len(driven) > 2 else ""
        return f"run_planner with scenarios {driven[:2]}{more}" if driven else DRIVEN_OTHERWISE
