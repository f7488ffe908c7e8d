"""Generation of scenarios from maps: arguments and result of the tool, and what the engine is asked and answers."""

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
from .specification import AskedEgo as AskedEgo
from .specification import AskedGoal as AskedGoal
from .specification import AskedManoeuvre as AskedManoeuvre
from .specification import Density as Density
from .specification import GenerationRequest as GenerationRequest
from .specification import GenerationSpec as GenerationSpec
from .specification import LaneletGoal as LaneletGoal
from .specification import MapChoice as MapChoice
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
"""Scenarios of many, and notes on one, that an answer shows (chosen)."""
_SHOWN_PLACES, _SHOWN_CANNOT = 5, 3
"""Places of a plan, and combinations that cannot be or are left, that an answer shows (chosen)."""


class PlaceArea(Model):
    """A settlement or a part of one inside a map: OSM's kind, all names, centre in degrees and reach around it.

    ``radius_m`` comes from the outline where the map has one, otherwise from the kind and the places around it.
    """

    name: str
    kind: str
    other_names: tuple[str, ...] = ()
    latitude: float
    longitude: float
    radius_m: float


MAP_FACTS_VERSION = 5
"""Raised when more is read of a map than before, or its sites are counted otherwise: what a workspace keeps of a map is
then read anew."""


class MapSource(Model):
    """Where a fetched map comes from.

    ``place``: what was fetched, in words; ``osm_id``: as OpenStreetMap numbers it, empty for a box. ``core``: where its
    roads are whole. ``query``: what was sent to ``service`` (a host), ``data_time``: the time of its data, as it states
    it. ``beside``: a person fetched it to have it beside them, so that it counts like a map of their own; otherwise it
    was fetched for one request, which alone uses it while the net is there.
    """

    place: str
    osm_id: str
    core: Box
    query: str
    service: str
    data_time: str
    beside: bool = False


INDEX_NAME = "extract.sqlite"
"""The index of an extract of a country, in its folder."""


class ExtractSize(Model):
    """How much an extract of a country holds that is kept by tiles; a node at a border of tiles may count for each.

    ``data_time``: as the file states it, empty where it does not.
    """

    places: int
    road_names: int
    nodes: int
    ways: int
    tiles: int
    data_time: str


class MapFacts(Model):
    """What a map shows: read from the file, nothing guessed.

    ``country`` is None where neither the file nor the caller names it; ``countries_near`` are then those that it may
    lie in (none: nothing is known). ``sites`` counts sites by scenario type. ``road_names``: for roads that have
    several names the one of ``streets`` or ``refs``, then the others; ``areas``: places that the map shows in part of
    itself. ``source``: where a fetched map comes from. ``extract``: of an extract of a country, which is
    kept by tiles; scenarios are made from parts of it, whose ``cut_of`` is its id. ``places`` then names the largest,
    and streets are looked up in its index.
    """

    map_id: str
    file_name: str
    place: str = Field(description="name for the map; the file's own where no place is known")
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
    """Maps with what they show."""

    maps: tuple[MapFacts, ...]


class ReadMapRequest(Model):
    """A map file to be read; place and country as the caller knows them (None: what the file says)."""

    path: str
    map_id: str | None = None
    place: str | None = None
    country: str | None = None
    attribution: str | None = None


class ConvertMapRequest(Model):
    """A map in another format that is to be written in one that is read, into a folder."""

    path: str
    folder: str


class ConvertedMap(Model):
    """The map as XML, and what was lost on the way, in words.

    ``too_large``: it holds more than is read at once, and the file is not there.
    """

    path: str
    lost: tuple[str, ...] = ()
    too_large: bool = False


class FetchMapRequest(Model):
    """Roads about a place or in a box, to be fetched, with room for a type of site; ``count``: sites to be had."""

    services: MapServices
    folder: str
    place: NamedPlace | None = None
    bbox: Box | None = None
    country: str | None = None
    scenario_type: ScenarioType = "any"
    road_classes: tuple[str, ...] = ()
    count: int = 1


class FetchedMap(Model):
    """A map that was fetched into a folder: its file, what it shows and where its roads are whole.

    ``core``: sites are taken from inside only, since beyond it roads are cut off. ``query``: what was asked, as it was
    sent; ``service``: the host that answered; ``data_time``: of which time its data is; ``kept``: the answer was kept
    from an earlier request.
    """

    path: str
    facts: MapFacts
    core: Box
    query: str
    service: str
    data_time: str
    kept: bool


class FetchedMaps(Model):
    """The maps that were fetched for a request, the best first, and what did not go as planned, a sentence each."""

    maps: tuple[FetchedMap, ...]
    notes: tuple[str, ...] = ()


class IndexExtractRequest(Model):
    """An extract in OpenStreetMap's binary format that is to be read into tiles.

    ``folder`` keeps what was done when the work breaks off: the same request goes on there.
    """

    path: str
    folder: str
    map_id: str
    place: str | None = None
    country: str | None = None


class IndexedExtract(Model):
    """The index of an extract as a file, and what it holds."""

    index: str
    facts: MapFacts


class CutExtractRequest(Model):
    """A part of an extract that is to become a map: the words for it, or a box, or any with such a site.

    ``seed`` chooses among several that fit; ``facts``: those of the extract, by whose names it may be called.
    """

    index: str
    folder: str
    facts: MapFacts
    place: str | None = None
    bbox: Box | None = None
    scenario_type: ScenarioType = "any"
    seed: int = 0


class CutOfExtract(Model):
    """A part of an extract as a map file, and what it shows; empty and None where the extract shows nothing such.

    ``core``: where its roads are whole and sites are to be looked for; ``label``: what it is about, in words;
    ``words``: of the request, what names something on the map itself (empty: all of it named the extract).
    """

    path: str = ""
    facts: MapFacts | None = None
    core: Box = (0.0, 0.0, 0.0, 0.0)
    label: str = ""
    words: str = ""


Combination = tuple[tuple[int, int], ...]
"""Levels of some factors of a coverage plan together: (index of the factor, index of its level), ascending."""


class PlanFactor(Model):
    """Something that a coverage plan varies, and the levels that it takes, as they are written in a call."""

    name: str
    levels: tuple[str, ...]

    def text(self, level: int) -> str:
        """A level as it is written in a call, such as ``density=high``."""
        return f"{self.name.partition(' ')[0]}={self.levels[level]}"


class CoverageRequest(Model):
    """How far a coverage plan has come; the next ``most`` rows of it are asked for.

    ``strength``: how many factors a combination joins. ``barred``: combinations of any size that no map holds;
    ``covered``: those that were made; ``refused``: how often others were, by combination. ``lap``: how often all was
    covered already, for rows beyond that.
    """

    factors: tuple[PlanFactor, ...]
    strength: int
    barred: tuple[Combination, ...] = ()
    covered: tuple[Combination, ...] = ()
    refused: tuple[tuple[Combination, int], ...] = ()
    lap: int = 0
    most: int = 0


class CoverageReport(Model):
    """How far a coverage plan has come, and its next rows: a level of each factor, by index.

    ``allowed``: combinations that can be; ``covered`` and ``left`` of them; ``cannot``: those that were tried often
    enough, and those that can only be together with such a one.
    """

    rows: tuple[tuple[int, ...], ...]
    allowed: int
    covered: int
    left: tuple[Combination, ...]
    cannot: tuple[Combination, ...]


class SiteCount(Model):
    """How many different sites fit a request."""

    count: int


class SiteFacts(Model):
    """Where a scenario was cut out: type, middle in degrees, streets, radius; ``osm_id``: node or way that marks it."""

    scenario_type: SiteType = Field(description="type of the site")
    latitude: float = Field(description="of its middle, in degrees")
    longitude: float = Field(description="of its middle, in degrees")
    streets: tuple[str, ...] = Field(description="streets that meet there")
    radius_m: float = Field(description="radius of the cut")
    osm_id: str = ""


class GeneratedEgo(Model):
    """The ego's start and goal: step and distance on its own recorded path, speed, the goal's lanelet and window.

    ``cars_to_choose_from``: how many vehicles of its class there are, which is a car unless another was asked for.
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
    """Vehicles per lane-kilometre of the cut: wanted, there at step 0, and there at the last step.

    CommonRoad's schema lets obstacles begin at step 0 only, so that traffic thins out as vehicles leave.
    ``paper_trips``: what the paper's scenarios of that density have. ``at_time``: the time of day that set what is
    wanted in the place of ``wish``; empty where none did.
    """

    wish: Density = Field(description="the density that was asked for")
    paper_trips: int
    lane_km: float = Field(description="length of all lanes in the cut")
    target_per_lane_km: float = Field(description="vehicles per lane-km that were wanted")
    at_start_per_lane_km: float = Field(description="vehicles per lane-km at the first step")
    at_end_per_lane_km: float = Field(description="vehicles per lane-km at the last step")
    at_time: str = ""

    @property
    def asked(self) -> str:
        """What set the wanted density: a word, or a time."""
        return self.at_time or f"{self.wish} density"


class Checks(Model):
    """What was checked on the written file.

    ``centers_on_lanelets`` and ``feasible_share`` are shares in [0, 1] over all recorded positions and all tracks;
    ``network_errors`` and ``network_warnings`` are the broken rules for road networks, with the first place of each.
    ``recorded_ego_collision_free`` is None if others were scripted after the ego was recorded: an ordinary driver in
    its place was checked instead.
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
        "no_room": "there was no room for it at the site by the start, or it had left by then",
        "file_too_large": "a recording of so many vehicles is too large for a file",
        "not_drivable": "the motion that SUMO gave it cannot be driven by a vehicle of its class",
        "overlap": "it would overlap another road user",
        "no_such_goal": "it has no such goal on its way, so a car after it is the ego",
        "no_ego_class": "no ego can be of this class, so a car is the ego; it drives in the traffic",
        "scripted": "an edit put the actor of the manoeuvre that was asked for in its place",
    }
)
"""Why a road user that was asked for is not there as asked; docs/generation.md lists them."""


class VehicleAbsence(Model):
    """Road users of a class that were asked for and are not there as asked, and why.

    ``fate``: they were never there at the start, were left out of what SUMO recorded, or were replaced. ``vehicles``:
    SUMO's ids of those that were there, otherwise empty.
    """

    fate: AbsenceFate = Field(description="what became of them")
    code: AbsenceCode = Field(description="why, as a code")
    vehicle_class: str = Field(description="the class that was asked for")
    count: int = Field(description="how many of them")
    vehicles: tuple[str, ...] = ()
    reason: str = Field(description="why, in words")

    def in_words(self) -> str:
        """Return the number and class, what became of them, and why."""
        return f"{counted(self.count, self.vehicle_class)} {self.fate.replace('_', ' ')} ({self.code}): {self.reason}"


class GeneratedScenario(Model):
    """One scenario: files, and what was asked beside what came out.

    ``vehicle_classes``: the class of the request by CommonRoad's obstacle id, because CommonRoad has fewer types.
    ``unsigned_limits_kmh``: posted limits by lanelet, where CommonRoad has no sign for them in the country.
    ``others``: the manoeuvre that was asked for of another road user: who makes it, when, and how it came about.
    ``absences``: why those that were asked for are not there as asked.
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
    """Make scenarios from a map; tells asked and realised. Unknown places are refused."""

    place: str | None = Field(None, description="city, street, 'street A / street B', road number or map id")
    country: str | None = Field(None, description="ISO alpha-3")
    bbox: list[float] | None = Field(None, description="south, west, north, east")
    scenario_type: ScenarioType = "any"
    """The type of site that is looked for on the map."""
    road_classes: list[str] | None = Field(None, description="roads, link, all or OSM highway values")
    density: Density = USUAL_DENSITY
    """How much traffic, in vehicles per kilometre of lane."""
    vehicles: list[str] = Field(
        [],
        description=(
            "beside cars: 'truck=2' at least, 'car=4..4' exactly, 'taxi=30%'. Classes: car truck bus "
            "motorcycle bicycle pedestrian trailer delivery coach taxi emergency moped"
        ),
    )
    duration_s: float = Field(USUAL_DURATION_S, ge=5, le=120)
    """How long the scenario lasts, in s."""
    ego: str = Field(USUAL_EGO, description="first, index:N (cars, from 0), type:CLASS")
    goal: str = Field(
        USUAL_GOAL,
        description="through[:left, unprotected_left, merge …], steps:N, distance_m:X on its track, "
        "lanelet:ID:POSITION",
    )
    count: int = Field(1, ge=1, le=5000)
    """How many scenarios; each is made at another site or with other traffic."""
    seed: int = 0
    """The same arguments with the same seed give the same bytes."""
    trial_run: bool = Field(False, description="run a planner too")
    conditions: list[str] = Field(
        [], description="time=rush_hour or 17:30, weather=rain, drivers=PRESET, mix=natural, others=cut_in"
    )
    cover: list[str] = Field([], description="combine: 'density=low|high', 'turn=left|right'")
    source: MapChoice = Field("auto", description="auto: online where no local map shows it")


class ScenarioSummary(Model):
    """One generated scenario in the answer; asked beside realised."""

    scenario_id: str
    reused: bool = Field(description="whether the same request had made it before")
    map_id: str
    place: str = Field(description="the town or region")
    site: str = Field(description="type of site and streets, in words")
    latitude: float = Field(description="of the site's middle, in degrees")
    longitude: float = Field(description="of the site's middle, in degrees")
    osm_id: str = Field(description="OpenStreetMap's node or way that marks the site")
    vehicles_asked: int = Field(description="vehicles that were asked for")
    vehicles_realised: int = Field(description="vehicles that are there")
    classes_asked: dict[str, int] = Field(description="vehicles that were asked for, by class")
    classes_realised: dict[str, int] = Field(description="vehicles that are there, by class")
    density: str = Field(description="traffic per lane-km beside what was wanted, in words")
    recorded_s: float = Field(description="length of the recording")
    ego: str = Field(description="start of the ego, in words")
    goal: str = Field(description="the goal, in words")
    ego_speed_mps: float | None = Field(None, description="speed of the ego at its start")
    goal_lanelet: int | None = Field(None, description="id of the lanelet of the goal")
    goal_distance_m: float | None = Field(None, description="how far the goal is ahead, along the ego's recorded way")
    goal_time_s: tuple[float, float] | None = Field(None, description="when the goal has to be reached")
    feasible_share: float = Field(description="share of the recorded tracks that a vehicle can drive, from 0 to 1")
    checks_passed: list[str] = Field(description="checks that it passes")
    checks_failed: list[str] = Field(description="checks that it does not pass")
    planners_refuse: str = Field("", description="why the built-in planners refuse this ego; empty if they drive it")
    trial_run: str = Field("", description="outcome of the default planner, where asked")
    others: str = Field(
        "",
        exclude_if=lambda words: not words,
        description="who makes the manoeuvre asked of others, when, and whether scripted",
    )
    absences: tuple[VehicleAbsence, ...] = Field(
        (), exclude_if=lambda absences: not absences, description="asked for and not there as asked, and why"
    )
    notes: list[str]

    @property
    def traffic(self) -> str:
        """The ego and the others by class; beside how many the request comes to where those are not as many."""
        on_foot = self.classes_realised.get("pedestrian", 0)
        vehicles = {name: count for name, count in self.classes_realised.items() if name != "pedestrian"}
        classes = ", ".join(["the ego", *(counted(count, name) for name, count in vehicles.items())])
        beside = f"; {counted(on_foot, 'pedestrian')}" if on_foot else ""
        differs = self.vehicles_realised != self.vehicles_asked
        wanted = f" of {self.vehicles_asked} that the request comes to" if differs else ""
        return f"{counted(self.vehicles_realised, 'vehicle')}{wanted}: {classes}{beside}"

    @property
    def missing(self) -> list[str]:
        """Why some that were asked for are not there, a line each; those that another one replaced are not missing."""
        return [f"Missing: {absence.in_words()}." for absence in self.absences if absence.fate != "replaced"]

    @property
    def where(self) -> str:
        """The site, its map, and its place on earth."""
        osm = f", OSM {self.osm_id}" if self.osm_id else ""
        return f"{self.site}, {cited(self.place)} ({self.map_id}, {self.latitude:.5f}, {self.longitude:.5f}{osm})"

    def answer(self) -> Answer:
        """One scenario: where it is, its traffic, the ego's task; what failed or came out otherwise."""
        remarks = [f"trial run: {self.trial_run}"] if self.trial_run else []
        notes = first_of(self.notes, _MOST_NOTES, f"describe_scenario of {self.scenario_id}, detail=checks")
        return Answer(
            headline=f"{self.scenario_id}{' (made before)' if self.reused else ''}: {self.where}.",
            decided=[
                f"{self.recorded_s:g} s, {self.traffic}.",
                f"{self.ego[0].upper()}{self.ego[1:]}; goal {self.goal}.",
                *([f"Others: {self.others}."] if self.others else []),
            ],
            figures=[f"Traffic: {self.density}.", *self.missing, *(f"Note: {note}" for note in (*remarks, *notes))],
            warnings=[
                *([self.planners_refuse] if self.planners_refuse else []),
                *([f"failed checks: {', '.join(self.checks_failed)}"] if self.checks_failed else []),
            ],
            next_step=DRIVEN_OTHERWISE if self.planners_refuse else "run_planner",
        )

    def line(self) -> str:
        """The same in a line, for one of many."""
        failed = f"; FAILED: {', '.join(self.checks_failed)}" if self.checks_failed else ""
        tried = f"; trial run: {self.trial_run}" if self.trial_run else ""
        made = f"- {self.scenario_id}{' (made before)' if self.reused else ''}"
        refused = f"; {self.planners_refuse}" if self.planners_refuse else ""
        others = f"; {self.others}" if self.others else ""
        shown = f"{self.recorded_s:g} s, {self.traffic}; {self.density}"
        return f"{made}: {self.where}; {shown}{others}{tried}{failed}{refused}"


class PlanRecord(Model):
    """A coverage plan: what it varies, and where its scenarios may lie.

    ``barred``: combinations that the maps do not hold, with the reason; ``spots``: for each group of sites, by its
    words, the maps that hold such sites and how many.
    """

    plan_id: str
    cover: tuple[str, ...]
    factors: tuple[PlanFactor, ...]
    strength: int
    barred: tuple[tuple[Combination, str], ...]
    spots: dict[str, tuple[tuple[str, int], ...]]


class CannotBe(Model):
    """A combination that cannot be made, and why."""

    combination: str = Field(description="values that were asked for together")
    reason: str = Field(description="why they cannot be")


class PlanSummary(Model):
    """How far a coverage plan has come.

    ``asked``: scenarios; None: as many as the combinations need. ``made``: by this plan, ``reused`` of them before it.
    Combinations: ``allowed`` by the maps, ``covered`` of them; the first of those ``left`` and of those that cannot be.
    """

    plan_id: str
    strength: int = Field(description="how many factors a combination joins")
    asked: int | None
    made: int
    reused: int = Field(description="scenarios of it that were there before")
    refused: int = Field(description="rows that no map or traffic allows")
    failed: int = Field(description="rows that failed")
    waiting: int = Field(description="rows that are still to be made")
    allowed: int = Field(description="combinations that the maps allow")
    covered: int = Field(description="combinations that scenarios have")
    left_total: int = Field(description="combinations that are still to be covered")
    left: tuple[str, ...] = Field(description="the first of these, in words")
    cannot_total: int = Field(description="combinations that cannot be made")
    cannot: tuple[CannotBe, ...] = Field(description="the first of these, and why")
    places: dict[str, int] = Field(description="scenarios by place")

    def lines(self) -> list[str]:
        """What was made where, what cannot be, and what is left, a line each."""
        tried = [f"{counted(self.refused, 'try')} refused"] if self.refused else []
        lost = [f"{self.failed} failed"] if self.failed else []
        where = [f"{shown_name(place)} {count}" for place, count in list(self.places.items())[:_SHOWN_PLACES]]
        more = len(self.places) - len(where)
        there = [f"at {', '.join(where)}{f' and {more} more places' if more > 0 else ''}"] if where else []
        made = "; ".join([*there, *tried, *lost])
        cannot = [f"{one.combination} ({one.reason})" for one in self.cannot[:_SHOWN_CANNOT]]
        return [
            *([f"Made {made}."] if made else []),
            *([_cut("Cannot be", cannot, self.cannot_total)] if cannot else []),
            *([_cut("Left", list(self.left[:_SHOWN_CANNOT]), self.left_total)] if self.left else []),
        ]

    @property
    def headline(self) -> str:
        """How many scenarios, and how much of the combinations."""
        asked = f" of {self.asked:,}" if self.asked is not None else ""
        before = f" ({self.reused:,} made before)" if self.reused else ""
        share = self.covered / self.allowed if self.allowed else 1.0
        return (
            f"{self.plan_id}: {self.made:,}{asked} scenarios{before}; {share:.1%} of the {self.strength}-way "
            f"combinations that the maps allow ({self.covered:,} of {self.allowed:,})."
        )


def _cut(what: str, texts: list[str], total: int) -> str:
    """Some texts of so many, in a line."""
    more = f"; {total - len(texts):,} more" if total > len(texts) else ""
    return f"{what}: {counted(total, 'combination')}: {'; '.join(texts)}{more}."


class GenerateScenariosResult(Result):
    """The scenarios that were made; of a coverage plan, how far it has come, and the job that carries it out."""

    scenarios: list[ScenarioSummary] = Field(description="the scenarios that were made")
    notes: list[str]
    attribution: list[str] = Field(description="whom the map's data must be credited to")
    plan: PlanSummary | None = Field(None, description="of a coverage plan, how far it has come; else null")
    job_id: str = ""
    state: JobState = "done"

    def answer(self) -> Answer:
        """One scenario with all that decides, of several a line each; a plan in figures."""
        if self.plan is not None:
            following = f"run_planner with scenarios ['{self.plan.plan_id}']"
            if self.state == "running":
                following = f"get_job with job_id '{self.job_id}'"
            elif self.state != "done":
                following = "the same call again: what is made is reused"
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
            headline=f"{counted(len(self.scenarios), 'scenario')} made:",
            listed=[*shown, *rest, *notes, source],
            next_step=self._following(),
        )

    def _following(self) -> str:
        """Return the next call: a run of those that the built-in planners drive."""
        driven = [made.scenario_id for made in self.scenarios if not made.planners_refuse]
        return f"run_planner with scenarios {driven[:2]} and so on" if driven else DRIVEN_OTHERWISE
