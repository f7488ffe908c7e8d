"""A scenario's facts and record, the defects that rules find in its roads, and ``describe_scenario``.

Lengths are in m, speeds in m/s, times in s, headings in rad, and posted limits in km/h.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field, JsonValue

from .base import Answer, Arguments, Model, Result
from .generation import DensityFacts, ScenarioType, SiteFacts, VehicleAbsence
from .text import cited_all, cited_parts, counted, shown_name, signed
from .vocabulary import GoalForm

Severity = Literal["error", "warning"]
"""The severity of a finding of a rule for road networks."""


class RuleFinding(Model):
    """One defect: the rule, the ids of the elements concerned, the position, and the fault."""

    rule: str
    severity: Severity
    elements: tuple[int, ...]
    where: tuple[float, float] | None = Field(description="x, y in m; None if the defect has no position")
    message: str


class CheckedFile(Model):
    """A file with the findings of the rules; ``unreadable`` says why no rule could run."""

    file: str
    findings: tuple[RuleFinding, ...] = ()
    unreadable: str = ""

    def count(self, severity: Severity) -> int:
        """Return the number of findings of this severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def passed(self) -> bool:
        """Whether the file could be read and no rule found an error."""
        return not self.unreadable and self.count("error") == 0


class LocationFacts(Model):
    """The scenario's location: country and place of the benchmark id, and coordinates if the file has real ones."""

    country: str = Field(description="ISO 3166-1 alpha-3, ZAM for artificial networks")
    place: str
    latitude_deg: float | None = None
    longitude_deg: float | None = None


class RoadFacts(Model):
    """Signs, lights and posted limits, on the lanelets under the ego's start and in the whole file.

    Signs are sorted keys of the vocabulary. Limits are in km/h, ascending.
    """

    lanelets: int
    signs_ego: tuple[str, ...] = ()
    signs_map: tuple[str, ...] = ()
    traffic_light_ego: bool = False
    traffic_lights_map: int = 0
    limits_ego_kmh: tuple[float, ...] = ()
    limits_map_kmh: tuple[float, ...] = ()


class ParticipantFacts(Model):
    """Counts by CommonRoad obstacle type; environment and phantom obstacles are not counted."""

    dynamic: dict[str, int] = Field(default_factory=dict)
    static: dict[str, int] = Field(default_factory=dict)

    @property
    def counts(self) -> dict[str, int]:
        """The number of static and dynamic obstacles together, by type in alphabetical order."""
        kinds = sorted({*self.dynamic, *self.static})
        return {kind: self.dynamic.get(kind, 0) + self.static.get(kind, 0) for kind in kinds}

    @property
    def total(self) -> int:
        """The number of obstacles."""
        return sum(self.dynamic.values()) + sum(self.static.values())


class EgoFacts(Model):
    """One planning problem: the ego's start and its goal.

    - ``lanes``: adjacent lanelets in the ego's direction at its start, 0 if it is on no lanelet
    - ``route``: lanelets to the goal, empty if the goal has no position or cannot be reached
    - ``manoeuvres``: what the recorded traffic does on the ego's route, None in older records
    - ``time_to_conflict_s``: time until an ego that keeps path and initial speed meets the recorded traffic, None if it
      never does; records and answers still call it ``time_to_collision_s``

    Signs, light and limits are those of the lanelets under the ego's start.
    """

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True, serialize_by_alias=True)

    problem_id: int
    speed_mps: float
    x_m: float
    y_m: float
    heading_rad: float
    lanes: int
    lanelets: tuple[int, ...]
    goal_forms: tuple[GoalForm, ...]
    goal_first_step: int | None
    goal_last_step: int | None
    route: tuple[int, ...] = ()
    time_to_conflict_s: float | None = Field(default=None, alias="time_to_collision_s")
    features: tuple[str, ...] = ()
    manoeuvres: tuple[str, ...] | None = Field(
        None, exclude_if=lambda found: found is None, description="manoeuvres by type of road user: 'cut_in:truck'"
    )
    signs: tuple[str, ...] = ()
    traffic_light: bool = False
    limits_kmh: tuple[float, ...] = ()
    vehicle_class: str = Field("car", exclude_if=lambda name: name == "car", description="class of the ego")


class ScenarioFacts(Model):
    """The paper's four metadata layers (location, roadside, participants, ego) and the computed features.

    Counts, signs and lanes on the ego's lanelets refer to the first planning problem.
    """

    scenario_id: str
    format_version: str
    step_s: float
    horizon_steps: int = Field(description="last time step of any recording or goal")
    location: LocationFacts
    tags: tuple[str, ...] = Field(description="tags in the file, sorted; computed features are separate")
    features: tuple[str, ...] = Field(description="computed from the geometry, sorted")
    roads: RoadFacts
    participants: ParticipantFacts
    egos: tuple[EgoFacts, ...] = Field(description="one per planning problem, by ascending id")
    density_per_km: float = Field(0.0, description="recorded vehicles per kilometre of lanelets, mean over the time")
    source: str = Field("", description="the source of the data according to the file; '' if it was not read")
    circumstances: tuple[str, ...] = Field(
        (), exclude_if=lambda words: not words, description="weather and time of day, in terms of the vocabulary"
    )
    faults: tuple[str, ...] = Field(
        (), exclude_if=lambda faults: not faults, description="faults of an imported file; not examined for other files"
    )

    @property
    def ego(self) -> EgoFacts | None:
        """The ego of the first planning problem."""
        return self.egos[0] if self.egos else None

    @property
    def horizon_s(self) -> float:
        """The time of the last step of any recording or goal, in s."""
        return round(self.horizon_steps * self.step_s, 3)

    def entries(self) -> "tuple[ScenarioFacts, ...]":
        """Return one entry per planning problem with only its ego: the first under the id, others as ``ID#problem``.

        If every entry contained all egos, a catalogue would grow with the square of their number.
        """
        first = self if len(self.egos) < 2 else self.model_copy(update={"egos": self.egos[:1]})
        return (first, *(self._seen_from(ego) for ego in self.egos[1:]))

    def seen_by(self, problem_id: int) -> "ScenarioFacts":
        """Return the entry of this planning problem."""
        wanted = next(ego for ego in self.egos if ego.problem_id == problem_id)
        return self if wanted is self.egos[0] else self._seen_from(wanted)

    def _seen_from(self, ego: EgoFacts) -> "ScenarioFacts":
        roads = self.roads.model_copy(
            update={"signs_ego": ego.signs, "traffic_light_ego": ego.traffic_light, "limits_ego_kmh": ego.limits_kmh}
        )
        return self.model_copy(
            update={
                "scenario_id": f"{self.scenario_id}#{ego.problem_id}",
                "features": ego.features,
                "roads": roads,
                "egos": (ego,),
            }
        )


Origin = Literal["generated", "modified", "imported", "starter"]


class ScenarioRecord(Model):
    """The workspace's record of a scenario, in addition to its files.

    ``content`` is the SHA-256 of the original XML file, which identifies the same file later. ``supersedes`` is the
    earlier version of a file that was changed and imported again. The catalogue no longer lists that version.
    """

    facts: ScenarioFacts
    origin: Origin
    content: str
    supersedes: str | None = None


class OpenLabelTags(Model):
    """The tags of an OpenLABEL file: the file that it tags, CommonRoad's tags, and the types without one."""

    tagged_file: str
    tags: tuple[str, ...]
    unread: tuple[str, ...] = ()


class ReadFactsRequest(Model):
    """The file to read facts from, an accompanying SUMO network if it is imported too, and their maximum size.

    ``keep`` caches the parsed file on disk for later calls. Few files of a large import are used again. ``checks``:
    whether the facts state the file's faults.
    """

    path: Path
    net: Path | None = None
    file_bytes: int = 100_000_000
    keep: bool = True
    checks: bool = False


Detail = Literal["brief", "vehicles", "motion", "lanelets", "checks", "recipe"]


class DescribeScenarioArguments(Arguments):
    """Ego, goal, vehicles (id, class, place, speed, gap), motion, lanelets, validity, recipe: the basis of edits."""

    scenario_id: str = "latest"
    """The scenario."""
    detail: Detail = "brief"
    """The section shown in addition to the brief description."""
    focus: str | None = Field(None, description="ego, vehicle selector or lanelet id: centre of the lists")
    radius_m: float = Field(80, ge=0.1, le=2000)
    """The radius around the focus, in m."""
    time_s: float = Field(0, ge=0)
    """The time."""


class DescribeRequest(Model):
    """The input of the describing operation; ``problem_id`` None means the first planning problem.

    ``base``: for a motion in an edited scenario, the file that the edits start from.
    """

    path: Path
    base: Path | None = None
    problem_id: int | None = None
    detail: Detail
    focus: str | None
    radius_m: float
    time_s: float = 0.0


class DescribedEgo(Model):
    """A planning problem: the start, the goal in words, and the lanelets of the route to the goal."""

    problem_id: int
    vehicle_class: str = Field("car", description="class of the ego")
    vehicle: str = Field("", description="its class, size, motion model and limits, in words")
    speed_mps: float = Field(description="speed at the start")
    lanelets: tuple[int, ...] = Field(description="ids of the lanelets under the start")
    lanes: int = Field(description="lanes in the ego's direction at the start")
    goal: str = Field(description="requirements of the goal, in words")
    goal_from_s: float | None = Field(None, description="earliest time for the goal; null if there are several")
    goal_until_s: float | None = Field(None, description="latest time for the goal")
    goal_distance_m: float | None = Field(
        None, description="straight-line distance to the middle of its region; null without one"
    )
    goal_lanelets: tuple[int, ...] = Field(description="ids of the lanelets of the goal")
    route: tuple[int, ...] = Field(description="ids of the lanelets on the route to the goal")
    way: str = Field(description="that route in words")


class DescribedVehicle(Model):
    """A vehicle when it first appears, and its position along the ego's lane in m (ahead positive).

    ``gap_m`` is bumper to bumper, for vehicles in the ego's lane. ``from_s`` is the time at which it appears.
    ``vehicle_class`` is the class it was generated as, if CommonRoad has no such type.
    """

    vehicle_id: int
    kind: str = Field(description="its CommonRoad type")
    where: str = Field(description="position relative to the focus, in words")
    lanelet: int | None = Field(description="id of its lanelet; null off the road")
    speed_mps: float = Field(description="its speed when it first appears")
    distance_m: float = Field(description="its distance from the focus")
    ahead_m: float | None = Field(
        description="distance ahead of the ego along its lane, negative behind; null elsewhere"
    )
    gap_m: float | None
    from_s: float
    until_s: float = Field(description="when it disappears")
    moves: bool = Field(description="whether it moves at all")
    vehicle_class: str = ""


class DescribedLanelet(Model):
    """A lanelet: its edge, successors by direction, neighbours, and the vehicles on it at the start."""

    lanelet_id: int
    edge: str | None = Field(description="SUMO's edge; None inside junctions and where no vehicle drives")
    length_m: float = Field(description="length of its centre line")
    role: str = Field(description="its role for the ego")
    successors: tuple[str, ...] = Field(description="direction and id: 'left 12'")
    left: int | None = Field(description="id of the lanelet to its left in the same direction; null without one")
    right: int | None = Field(description="id of the one to its right; null without one")
    opposite: int | None = Field(description="id of the neighbour in the opposite direction; null without one")
    limit_kmh: float | None = Field(description="its speed limit; null without one")
    vehicles: tuple[int, ...] = Field(description="ids of the vehicles on it at the start")


class Reach(Model):
    """A lanelet outside junctions that a vehicle can reach: the turns on the way, and the distance to its beginning."""

    lanelet_id: int
    turns: tuple[str, ...] = Field(description="lane changes and turns on the way")
    distance_m: float = Field(description="distance to its beginning")


class MotionMoment(Model):
    """A vehicle at one time: its motion, its lanelet, and its leader with the gap between them."""

    time_s: float = Field(description="since the ego's start")
    speed_mps: float = Field(description="along its path")
    acceleration_mps2: float = Field(description="along its path, negative when braking")
    lanelet: int | None = Field(description="id of its lanelet; null off the road")
    leader: int | None = Field(description="id of the nearest vehicle ahead in its lane; null without one in 100 m")
    gap_m: float | None = Field(description="bumper to bumper; null without a leader")


class MotionEvent(Model):
    """An event in a vehicle's motion: it brakes, with its reason ahead, or changes lane."""

    code: Literal["brakes", "changes_lane"] = Field(description="what it does")
    cause: Literal["", "leader", "crossing", "light", "turn", "limit", "edit", "unknown"] = Field(
        description="what was ahead when it began to brake"
    )
    from_s: float = Field(description="when it begins, since the ego's start")
    until_s: float = Field(description="when it ends")
    words: str = Field(description="the same in words, with figures")


class DescribedMotion(Model):
    """The whole recorded motion of a vehicle: evenly spaced times, and events."""

    moments: tuple[MotionMoment, ...] = Field(description="the vehicle at evenly spaced times")
    events: tuple[MotionEvent, ...] = Field(description="events in order")
    driven_m: float = Field(description="distance driven")
    walks: bool = Field(False, description="whether it is a pedestrian", exclude_if=lambda walks: not walks)

    def lines(self) -> list[str]:
        """Return lines of text: the distance and the events, then one line per moment."""
        did = [f"- {_span_s(event)} s: {event.words}" for event in self.events]
        moments = [
            f"- {one.time_s:g} s: {one.speed_mps:.1f} m/s, {signed(one.acceleration_mps2)} m/s², "
            + (f"lanelet {one.lanelet}" if one.lanelet is not None else "off the lanelets")
            + (f", follows {one.leader}, gap {one.gap_m:.1f} m" if one.gap_m is not None else "")
            for one in self.moments
        ]
        if self.walks:
            return [f"It walks {self.driven_m:g} m.", "Motion over time:", *moments]
        return [
            f"It drives {self.driven_m:g} m. Events:"
            if did
            else f"It drives {self.driven_m:g} m and keeps its lane; its speed never falls by 1 m/s or more at over "
            "1 m/s².",
            *did,
            "Motion over time:",
            *moments,
        ]


def _span_s(event: MotionEvent) -> str:
    return f"{event.from_s:g}" if event.from_s == event.until_s else f"{event.from_s:g} to {event.until_s:g}"


class DescribedFocus(Model):
    """The vehicle or lanelet in focus: the selector that chose it, its recorded route, and where it can drive.

    ``vehicle`` is its position and speed, or None for a lanelet. ``route`` lists the lanelets of the recording.
    ``reach`` starts with the nearest lanelets.
    """

    name: str = Field(description="the vehicle or lanelet")
    what: str = Field(description="the selector that chose it")
    vehicle: DescribedVehicle | None = None
    route: tuple[int, ...] = ()
    reach: tuple[Reach, ...] = ()
    motion: DescribedMotion | None = Field(
        None, exclude_if=lambda motion: motion is None, description="its whole recorded motion, with detail=motion"
    )


class Description(Model):
    """The content of the scenario's file around the focus; ``asked`` describes a focus other than the ego.

    ``time_s`` is the time of the described vehicles, from the ego's start.
    """

    ego: DescribedEgo | None = Field(description="the planning problem; null if the file has none")
    focus: str = Field(description="centre of the lists of vehicles and lanelets")
    asked: DescribedFocus | None = Field(None, description="the focus, if it is not the ego")
    vehicles: tuple[DescribedVehicle, ...] = Field(description="the vehicles near the focus, the nearest first")
    vehicles_total: int = Field(description="vehicles in the scenario, without the one in focus")
    lanelets: tuple[DescribedLanelet, ...] = Field(description="the lanelets near the focus")
    lanelets_total: int = Field(description="lanelets within the radius")
    checks: tuple[str, ...] = Field((), description="findings of the file's checks")
    time_s: float = Field(0.0, exclude_if=lambda time_s: time_s == 0, description="time of the described vehicles")
    friction: float | None = Field(
        None, exclude_if=lambda friction: friction is None, description="friction of the roads; null if not stated"
    )


class DescribedGeneration(Model):
    """Site, traffic and checks of a generated scenario when it was generated, with requested and realised values.

    ``notes`` (including repairs), ``network_warnings`` and ``netconvert_warnings`` are listed only if ``detail``
    requests them, but are always counted. ``feasible_share`` of the recorded tracks is in [0, 1].
    """

    site: SiteFacts = Field(description="the site")
    scenario_type_asked: ScenarioType = Field(description="type of site requested")
    vehicles_asked: int = Field(description="vehicles requested")
    vehicles_realised: int = Field(description="vehicles realised")
    classes_asked: dict[str, int] = Field(description="vehicles requested, by class")
    classes_realised: dict[str, int] = Field(description="vehicles realised, by class")
    density: DensityFacts = Field(description="vehicles per lane-km, requested and realised")
    duration_asked_s: float = Field(description="duration requested")
    recorded_s: float = Field(description="duration of the recording")
    feasible_share: float
    checks_failed: tuple[str, ...] = Field(description="failed checks")
    notes_total: int = Field(description="number of notes")
    warnings_total: int = Field(description="number of network and netconvert warnings")
    notes: tuple[str, ...] = ()
    network_warnings: tuple[str, ...] = Field((), description="warnings of the network checks")
    netconvert_warnings: tuple[str, ...] = Field((), description="warnings of SUMO's netconvert")
    conditions: tuple[str, ...] = Field((), description="requested conditions of the traffic")
    absences: tuple[VehicleAbsence, ...] = Field(
        (),
        exclude_if=lambda absences: not absences,
        description="requested road users that differ or are missing, and why",
    )

    def lines(self) -> list[str]:
        """Return a line on site, traffic and checks, then notes and warnings, one per line."""
        site, density = self.site, self.density
        streets = cited_all(site.streets) or "unnamed roads"
        mark = f", OSM {site.osm_id}" if site.osm_id else ""
        classes = ", ".join(["the ego", *(counted(count, name) for name, count in self.classes_realised.items())])
        by_class = " and ".join(counted(count, name) for name, count in self.classes_asked.items())
        requested = f", including {by_class}" if by_class else ""
        vehicles = counted(self.vehicles_realised, "vehicle")
        requested_density = density.at_time or density.wish
        under = f"conditions {', '.join(self.conditions)}; " if self.conditions else ""
        listed = [f"Not as requested: {absence.in_words()}" for absence in self.absences]
        listed += [f"Generation note: {note}" for note in self.notes]
        listed += [f"Road network: {warning}" for warning in self.network_warnings]
        listed += [f"netconvert: {warning}" for warning in self.netconvert_warnings]
        is_complete = listed or self.notes_total + self.warnings_total == 0
        unlisted = "" if is_complete else f" {self.notes_total} notes, {self.warnings_total} warnings: detail checks."
        first = (
            f"Generated: {site.scenario_type} (requested: {self.scenario_type_asked}) at {site.latitude:.5f}, "
            f"{site.longitude:.5f} within {site.radius_m:g} m ({streets}{mark}); {vehicles} "
            f"(requested: {self.vehicles_asked}{requested}): {classes}; {density.at_start_per_lane_km:g} per "
            f"lane-km at the start, {density.at_end_per_lane_km:g} at the end (requested: {requested_density}, "
            f"{density.target_per_lane_km:g}); {self.recorded_s:g} s recorded (requested: {self.duration_asked_s:g}); "
            f"{under}{self.feasible_share:.0%} of tracks drivable; "
            f"checks failed: {', '.join(self.checks_failed) or 'none'}."
        )
        return [first + unlisted, *listed]


class DescribeScenarioResult(Result):
    """A scenario in words and ids, with everything that an edit needs."""

    scenario_id: str
    origin: Origin = Field(description="its origin")
    place: str = Field(description="the town or region; empty if not known")
    detail: Detail = Field("brief", description="the section shown in addition to the summary")
    tags: tuple[str, ...] = Field(description="its tags")
    features: tuple[str, ...] = Field(description="features computed from its geometry")
    step_s: float = Field(description="length of a time step")
    duration_s: float = Field(description="duration of the recording")
    counts: dict[str, int] = Field(description="road users by type")
    signs: tuple[str, ...] = Field(description="traffic signs, with their values")
    circumstances: tuple[str, ...] = Field(
        (), exclude_if=lambda words: not words, description="weather and time of day; empty if not stated"
    )
    description: Description = Field(description="content of its file around the focus")
    other_problems: tuple[int, ...] = Field((), description="other planning problems of the file: use ID#problem")
    generation: DescribedGeneration | None = Field(None, description="how it was generated; null otherwise")
    recipe: dict[str, JsonValue] | None = Field(
        None, description="the call that generates it again; null unless requested"
    )

    def answer(self) -> Answer:
        """Return the scenario, its ego and the focus, then the lists of ``detail``."""
        shown, total = self.description, sum(self.counts.values())
        kinds = ", ".join(counted(count, kind) for kind, count in self.counts.items())
        several = f"{counted(total, 'other road user')} ({kinds})" if len(self.counts) > 1 else kinds
        traffic = several if total else "no traffic"
        decided = [f"Tags: {', '.join(self.tags) or 'none'}. Features: {', '.join(self.features) or 'none'}."]
        decided += [f"On the ego's lane: {', '.join(self.signs).replace('_', ' ')}."] if self.signs else []
        decided += self._conditions()
        decided.append(ego_text(shown.ego) if shown.ego else "No planning problem, so no ego.")
        if self.other_problems:
            problems = ", ".join(f"{self.scenario_id}#{key}" for key in self.other_problems[:_PROBLEMS_SHOWN])
            count = counted(len(self.other_problems), "more planning problem")
            decided.append(f"The file has {count}, each with its own ego: {problems}.")
        decided += _focus(shown.asked) if shown.asked else []
        motion = shown.asked.motion.lines() if shown.asked is not None and shown.asked.motion is not None else []
        listed = [*motion, *self._vehicles(), *self._lanelets(), *(f"Check {check}" for check in shown.checks)]
        if self.generation is not None and self.detail in ("checks", "recipe"):
            listed += self.generation.lines()
        if self.recipe is not None:
            listed.append(f"Recipe: {json.dumps(cited_parts(self.recipe), ensure_ascii=False, sort_keys=True)}")
        failed = () if self.generation is None else self.generation.checks_failed
        return Answer(
            headline=f"{self.scenario_id} ({self.origin}, {self.place}): {self.duration_s:g} s, {traffic}.",
            decided=decided,
            listed=listed,
            warnings=[f"failed when it was generated: {', '.join(failed)}"] if failed else (),
        )

    def _conditions(self) -> list[str]:
        """Return a line on weather, time of day and the friction of the roads, if there are any."""
        words = [word.replace("_", " ") for word in self.circumstances]
        friction = self.description.friction
        words += [] if friction is None else [f"road friction {friction:g}"]
        return [f"Conditions: {', '.join(words)}."] if words else []

    def _vehicles(self) -> list[str]:
        """Return the vehicles that ``detail`` lists."""
        shown, most = self.description, VEHICLES_SHOWN[self.detail]
        if not most or not shown.vehicles_total:
            return []
        if not shown.vehicles:
            return [f"No vehicle within radius_m of {shown.focus}, {shown.vehicles_total} elsewhere; raise radius_m."]
        more = shown.vehicles_total - len(shown.vehicles)
        rest = "raise radius_m" if self.detail == "vehicles" else "detail=vehicles"
        start = ", from its position at 0 s" if shown.time_s else ""
        measured = [f"distances along its lane{start}"] if shown.focus == "the ego" else []
        when = f" at {shown.time_s:g} s" if shown.time_s else ""
        notes = "; ".join([*measured, *([f"{more} more: {rest}"] if more else [])])
        head = f"Vehicles{when}, nearest to {shown.focus} first{f' ({notes})' if notes else ''}:"
        return [head, *(_vehicle(vehicle, shown.asked) for vehicle in shown.vehicles)]

    def _lanelets(self) -> list[str]:
        shown = self.description
        if not shown.lanelets:
            return []
        more = shown.lanelets_total - len(shown.lanelets)
        head = f"Lanelets near {shown.focus}{f' ({more} more: raise radius_m or set focus)' if more else ''}:"
        return [head, *(_lanelet(lanelet) for lanelet in shown.lanelets)]


VEHICLES_SHOWN: Mapping[Detail, int] = {
    "brief": 5,
    "vehicles": 40,
    "motion": 0,
    "lanelets": 0,
    "checks": 0,
    "recipe": 0,
}
LANELETS_SHOWN: Mapping[Detail, int] = {
    "brief": 0,
    "vehicles": 0,
    "motion": 0,
    "lanelets": 30,
    "checks": 0,
    "recipe": 0,
}
"""The maximum number of vehicles and lanelets for each detail (chosen, because a model reads the description)."""


def _focus(focus: DescribedFocus) -> list[str]:
    """Return one line: the focus, its recorded route, and where it can drive."""
    name = f"{focus.name[0].upper()}{focus.name[1:]}{f' ({focus.what})' if focus.what else ''}"
    seen = f": {_vehicle_in_words(focus.vehicle, place=', ')}." if focus.vehicle is not None else "."
    recorded = f" Recorded route: {_chain(focus.route)}." if focus.route else ""
    routes = [(" then ".join(route.turns) or "straight", route) for route in focus.reach]
    reached = [f"{route.lanelet_id} ({turns}, {route.distance_m:.0f} m)" for turns, route in routes]
    if focus.vehicle is not None and focus.vehicle.kind == "pedestrian":
        return [f"{name}{seen}{recorded}"]
    return [f"{name}{seen}{recorded} Can reach lanelets: {', '.join(reached) or 'none'}."]


_PROBLEMS_SHOWN = 6
"""The number of other planning problems that an answer lists (chosen)."""


def ego_text(ego: DescribedEgo) -> str:
    """Return a line on the ego's start, its goal and its route there."""
    lanes = f"{ego.lanes} lane{'' if ego.lanes == 1 else 's'} in its direction"
    lanelets = (
        f"lanelet{'s' * (len(ego.lanelets) > 1)} {', '.join(map(str, ego.lanelets))}" if ego.lanelets else "no lanelet"
    )
    route = f" Route: {ego.way}{f', {_chain(ego.route)}' if ego.route else ''}."
    what = "" if ego.vehicle_class == "car" else f"{ego.vehicle}. Starts at "
    return f"Ego: {what}{ego.speed_mps:.1f} m/s on {lanelets}, {lanes}. Goal: {ego.goal}.{route}"


def _chain(route: tuple[int, ...]) -> str:
    shown = [str(key) for key in (route if len(route) <= 8 else (*route[:4], *route[-3:]))]
    noun = "lanelet" if len(route) == 1 else "lanelets"
    return f"{noun} " + " → ".join(shown if len(route) <= 8 else [*shown[:4], "…", *shown[4:]])


def _vehicle(vehicle: DescribedVehicle, focus: DescribedFocus | None) -> str:
    """Return a vehicle in one line, with its distance from the focus if there is one."""
    away = f"{vehicle.distance_m:.0f} m from {focus.name}; relative to the ego: " if focus is not None else ""
    return f"- {vehicle.vehicle_id} {_vehicle_in_words(vehicle, away)}"


def _vehicle_in_words(vehicle: DescribedVehicle, away: str = "", place: str = ": ") -> str:
    """Return the type, position relative to the ego, speed, gap and lanelet of a vehicle."""
    gap = f", gap {vehicle.gap_m:.1f} m" if vehicle.gap_m is not None else ""
    lanelet = f", lanelet {vehicle.lanelet}" if vehicle.lanelet is not None else ", off the lanelets"
    when = f", from {vehicle.from_s:g} s" if vehicle.from_s > 0 else ""
    shown_speed = f"{vehicle.speed_mps:.1f}"
    speed = f", {'0' if shown_speed == '0.0' else shown_speed} m/s" if vehicle.moves else ", standing"
    speed = "" if "standing" in vehicle.where else speed
    kind = f"{vehicle.kind} ({vehicle.vehicle_class})" if vehicle.vehicle_class else vehicle.kind
    return f"{kind}{place}{away}{vehicle.where}{speed}{gap}{lanelet}{when}"


def _lanelet(lanelet: DescribedLanelet) -> str:
    neighbours = [f"left {lanelet.left}"] if lanelet.left is not None else []
    neighbours += [f"right {lanelet.right}"] if lanelet.right is not None else []
    neighbours += [f"opposite {lanelet.opposite}"] if lanelet.opposite is not None else []
    parts = [f"{lanelet.length_m:.0f} m", *([f"edge {shown_name(lanelet.edge)}"] if lanelet.edge else [])]
    parts += [lanelet.role] if lanelet.role else []
    leads = [" to ".join(successor.split(" ", 1)) for successor in lanelet.successors]
    parts += [f"leads {', '.join(leads)}" if leads else "no successor"]
    parts += [f"neighbours: {', '.join(neighbours)}"] if neighbours else []
    parts += [f"limit {lanelet.limit_kmh:g} km/h"] if lanelet.limit_kmh else []
    parts += [f"vehicles: {', '.join(map(str, lanelet.vehicles))}"] if lanelet.vehicles else []
    return f"- {lanelet.lanelet_id}: {'; '.join(parts)}"
