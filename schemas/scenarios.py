"""What is known about a scenario: its metadata layers, its record, what rules find in its roads,
and what ``describe_scenario`` takes and answers.

Lengths in m, speeds in m/s, times in s, headings in rad; posted limits in km/h. The answer's text stands at the end.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field, JsonValue

from .base import Answer, Arguments, Model, Result
from .generation import DensityFacts, ScenarioType, SiteFacts, VehicleAbsence
from .text import cited_all, cited_parts, counted, shown_name
from .vocabulary import GoalForm

Severity = Literal["error", "warning"]
"""Of what a rule for road networks finds."""


class RuleFinding(Model):
    """One defect: the rule that found it, the ids of the elements concerned, where it is, and what is wrong."""

    rule: str
    severity: Severity
    elements: tuple[int, ...]
    where: tuple[float, float] | None = Field(description="x, y in m; None if the defect has no place")
    message: str


class CheckedFile(Model):
    """A file with what the rules found; ``unreadable`` says why none could be run."""

    file: str
    findings: tuple[RuleFinding, ...] = ()
    unreadable: str = ""

    def count(self, severity: Severity) -> int:
        """Return how many findings are of this severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def passed(self) -> bool:
        """Return whether the file could be read and no rule found an error."""
        return not self.unreadable and self.count("error") == 0


class LocationFacts(Model):
    """Where the scenario is: country and place of the benchmark id; coordinates where the file states real ones."""

    country: str = Field(description="ISO 3166-1 alpha-3, ZAM for artificial networks")
    place: str
    latitude_deg: float | None = None
    longitude_deg: float | None = None


class RoadFacts(Model):
    """Signs, lights and posted limits: on the lanelets under the ego's start, and anywhere in the file.

    Signs are keys of the vocabulary, sorted; limits in km/h, ascending.
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
        """Static and dynamic together, by type in alphabetical order."""
        kinds = sorted({*self.dynamic, *self.static})
        return {kind: self.dynamic.get(kind, 0) + self.static.get(kind, 0) for kind in kinds}

    @property
    def total(self) -> int:
        """All obstacles."""
        return sum(self.dynamic.values()) + sum(self.static.values())


class EgoFacts(Model):
    """One planning problem: where the ego starts and what its goal states.

    ``lanes``: lanelets side by side in the ego's direction at its start, 0 if it stands on none;
    ``route``: lanelets to the goal, empty if the goal has no place or cannot be reached;
    ``manoeuvres``: what the recorded traffic does on the ego's way, None in records from before it was looked at;
    ``time_to_conflict_s``: until an ego that keeps path and initial speed meets the recorded traffic, None if it
    never does; records and answers name it ``time_to_collision_s``, as they did before. Signs, light and limits are
    those of the lanelets under its start.
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
        None, exclude_if=lambda found: found is None, description="what road users of which type do: 'cut_in:truck'"
    )
    signs: tuple[str, ...] = ()
    traffic_light: bool = False
    limits_kmh: tuple[float, ...] = ()
    vehicle_class: str = Field("car", exclude_if=lambda name: name == "car", description="what the ego is")


class ScenarioFacts(Model):
    """The four metadata layers of the paper (location, roadside, participants, ego) and the computed features.

    Counts, signs and lanes on the ego's lanelets belong to the first planning problem.
    """

    scenario_id: str
    format_version: str
    step_s: float
    horizon_steps: int = Field(description="last time step of any recording or goal")
    location: LocationFacts
    tags: tuple[str, ...] = Field(description="tags in the file, sorted; computed features stay apart")
    features: tuple[str, ...] = Field(description="computed from the geometry, sorted")
    roads: RoadFacts
    participants: ParticipantFacts
    egos: tuple[EgoFacts, ...] = Field(description="one per planning problem, by ascending id")
    density_per_km: float = Field(0.0, description="recorded vehicles per kilometre of lanelets, mean over the time")
    source: str = Field("", description="where the file says that its data come from; '' where it was not read")
    circumstances: tuple[str, ...] = Field(
        (), exclude_if=lambda words: not words, description="weather and time of day, in words of the vocabulary"
    )

    @property
    def ego(self) -> EgoFacts | None:
        """The first planning problem's."""
        return self.egos[0] if self.egos else None

    @property
    def horizon_s(self) -> float:
        """Seconds to the last time step of any recording or goal."""
        return round(self.horizon_steps * self.step_s, 3)

    def entries(self) -> "tuple[ScenarioFacts, ...]":
        """Return one per planning problem, with its ego alone: the first under the id, the others as ``ID#problem``.

        Each would hold the egos of all others otherwise, and a catalogue of them grow with the square of their number.
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
    """What the workspace keeps about a scenario beside its files.

    ``content``: SHA-256 of the XML file as it came, by which the same file is known again; ``supersedes``: the earlier
    version of a file that was changed and imported again, which the catalogue lists no longer.
    """

    facts: ScenarioFacts
    origin: Origin
    content: str
    supersedes: str | None = None


class ReadFactsRequest(Model):
    """Which file to read the facts from, the SUMO network beside it where it comes in too, and their largest size.

    ``keep``: whether what was read is kept on disk for the calls that follow; of many files few are asked for again.
    """

    path: Path
    net: Path | None = None
    file_bytes: int = 100_000_000
    keep: bool = True


Detail = Literal["brief", "vehicles", "motion", "lanelets", "checks", "recipe"]


class DescribeScenarioArguments(Arguments):
    """Ego, goal, vehicles (id, class, place, speed, gap), their motion, lanelets and what follows
    them, validity, recipe: what an edit is written from."""

    scenario_id: str = "latest"
    """The scenario."""
    detail: Detail = "brief"
    """What is told in addition to the brief description."""
    focus: str | None = Field(None, description="ego, vehicle selector or lanelet id: the centre of what is listed")
    radius_m: float = Field(80, ge=0.1, le=2000)
    """How far around the focus is listed, in m."""
    time_s: float = Field(0, ge=0)
    """The moment."""


class DescribeRequest(Model):
    """What the describing operation needs; ``problem_id`` None is the first planning problem."""

    path: Path
    problem_id: int | None = None
    detail: Detail
    focus: str | None
    radius_m: float
    time_s: float = 0.0


class DescribedEgo(Model):
    """A planning problem: start, goal in words, and the lanelets of the way to the goal."""

    problem_id: int
    vehicle_class: str = Field("car", description="what the ego is")
    vehicle: str = Field("", description="its class, size, motion model and limits, in words")
    speed_mps: float = Field(description="speed at the start")
    lanelets: tuple[int, ...] = Field(description="ids of the lanelets under the start")
    lanes: int = Field(description="lanes in the ego's direction at the start")
    goal: str = Field(description="what the goal asks for, in words")
    goal_from_s: float | None = Field(None, description="when the goal may be reached first; null if there are several")
    goal_until_s: float | None = Field(None, description="when it may be reached last")
    goal_distance_m: float | None = Field(None, description="straight to the middle of its region; null without one")
    goal_lanelets: tuple[int, ...] = Field(description="ids of the lanelets of the goal")
    route: tuple[int, ...] = Field(description="ids of the lanelets on the way to the goal")
    way: str = Field(description="that way in words")


class DescribedVehicle(Model):
    """A vehicle when it is first there: where in words, and along the ego's lane in metres (ahead positive).

    ``gap_m``: bumper to bumper, for vehicles in the ego's lane; ``from_s``: when it appears; ``vehicle_class``: what it
    was generated as, where CommonRoad has no type of that name.
    """

    vehicle_id: int
    kind: str = Field(description="its CommonRoad type")
    where: str = Field(description="where it is, seen from the focus, in words")
    lanelet: int | None = Field(description="id of its lanelet; null off the road")
    speed_mps: float = Field(description="its speed when it is first there")
    distance_m: float = Field(description="its distance from the focus")
    ahead_m: float | None = Field(
        description="how far ahead of the ego along its lane, behind negative; null elsewhere"
    )
    gap_m: float | None
    from_s: float
    until_s: float = Field(description="when it is last there")
    moves: bool = Field(description="whether it drives at all")
    vehicle_class: str = ""


class DescribedLanelet(Model):
    """A lanelet: its edge, what follows by direction, its neighbours, and the vehicles on it at first."""

    lanelet_id: int
    edge: str | None = Field(description="SUMO's edge; None inside junctions and where nobody drives")
    length_m: float = Field(description="length of its centre line")
    role: str = Field(description="what it is to the ego")
    successors: tuple[str, ...] = Field(description="direction and id: 'left 12'")
    left: int | None = Field(description="id of the lanelet to its left in the same direction; null without one")
    right: int | None = Field(description="id of the one to its right; null without one")
    opposite: int | None = Field(description="id of the neighbour in the opposite direction; null without one")
    limit_kmh: float | None = Field(description="its speed limit; null without one")
    vehicles: tuple[int, ...] = Field(description="ids of the vehicles on it at first")


class Reach(Model):
    """A lanelet outside junctions that a vehicle can get to: the turns on the way, and how far its beginning is."""

    lanelet_id: int
    turns: tuple[str, ...] = Field(description="lane changes and turns on the way")
    distance_m: float = Field(description="how far its beginning is")


class MotionMoment(Model):
    """A vehicle at a moment: how it moves, its lanelet, and the vehicle that it follows with the gap between them."""

    time_s: float = Field(description="since the ego's start")
    speed_mps: float = Field(description="along its way")
    acceleration_mps2: float = Field(description="along its way, braking negative")
    lanelet: int | None = Field(description="id of its lanelet; null off the road")
    leader: int | None = Field(description="id of the nearest vehicle ahead in its lane; null without one in 100 m")
    gap_m: float | None = Field(description="bumper to bumper; null without a leader")


class MotionEvent(Model):
    """Something that a vehicle does: it brakes, with what lay ahead when it began, or changes lane."""

    code: Literal["brakes", "changes_lane"] = Field(description="what it does")
    cause: Literal["", "leader", "crossing", "light", "turn", "limit", "unknown"] = Field(
        description="what lay ahead when it began to brake"
    )
    from_s: float = Field(description="when it begins, since the ego's start")
    until_s: float = Field(description="when it ends")
    words: str = Field(description="the same in words, with figures")


class DescribedMotion(Model):
    """The whole recorded motion of a vehicle: some moments evenly spaced, and what it did."""

    moments: tuple[MotionMoment, ...] = Field(description="the vehicle at some moments, evenly spaced")
    events: tuple[MotionEvent, ...] = Field(description="what it did, in order")
    driven_m: float = Field(description="how far it drove")

    def lines(self) -> list[str]:
        """Return what it did, then a line a moment."""
        did = [f"- {_span_s(event)} s: {event.words}" for event in self.events]
        moments = [
            f"- {one.time_s:g} s: {one.speed_mps:.1f} m/s, {one.acceleration_mps2:+.1f} m/s², "
            + (f"lanelet {one.lanelet}" if one.lanelet is not None else "on no lanelet")
            + (f", follows {one.leader}, gap {one.gap_m:.1f} m" if one.gap_m is not None else "")
            for one in self.moments
        ]
        return [
            f"It drives {self.driven_m:g} m; it brakes or changes lane:"
            if did
            else f"It drives {self.driven_m:g} m, brakes nowhere and keeps its lane.",
            *did,
            "Moment by moment:",
            *moments,
        ]


def _span_s(event: MotionEvent) -> str:
    return f"{event.from_s:g}" if event.from_s == event.until_s else f"{event.from_s:g} to {event.until_s:g}"


class DescribedFocus(Model):
    """A vehicle or lanelet that a call asked about: by which word, its recorded way, and where it can drive.

    ``vehicle``: where it is, and how fast, None for a lanelet; ``route``: lanelets of the recording; ``reach``: the
    nearest lanelets first.
    """

    name: str = Field(description="the vehicle or lanelet")
    what: str = Field(description="by which word it was meant")
    vehicle: DescribedVehicle | None = None
    route: tuple[int, ...] = ()
    reach: tuple[Reach, ...] = ()
    motion: DescribedMotion | None = Field(
        None,
        exclude_if=lambda motion: motion is None,
        description="its whole recorded motion, where detail asks for it",
    )


class Description(Model):
    """What the scenario's file shows, centred on the focus; ``asked`` says what a focus other than the ego is.

    ``time_s``: when the vehicles are there, from the ego's start.
    """

    ego: DescribedEgo | None = Field(description="the planning problem; null if the file has none")
    focus: str = Field(description="what the list of vehicles and lanelets is centred on")
    asked: DescribedFocus | None = Field(None, description="the focus, where it is not the ego")
    vehicles: tuple[DescribedVehicle, ...] = Field(description="the vehicles near the focus, the nearest first")
    vehicles_total: int = Field(description="vehicles in the scenario, without the one in focus")
    lanelets: tuple[DescribedLanelet, ...] = Field(description="the lanelets near the focus")
    lanelets_total: int = Field(description="lanelets within the radius")
    checks: tuple[str, ...] = Field((), description="what the checks of the file found")
    time_s: float = Field(0.0, exclude_if=lambda time_s: time_s == 0, description="when the vehicles are described")


class DescribedGeneration(Model):
    """Site, traffic and checks of a generated scenario, as they were when it was made: asked beside realised.

    ``notes`` (repairs among them), ``network_warnings`` and ``netconvert_warnings`` are listed only where the detail
    asks for them; their numbers always stand there. ``feasible_share``: of the recorded tracks, in [0, 1].
    """

    site: SiteFacts = Field(description="where it was cut out")
    scenario_type_asked: ScenarioType = Field(description="type of site that was asked for")
    vehicles_asked: int = Field(description="vehicles that were asked for")
    vehicles_realised: int = Field(description="vehicles that are there")
    classes_asked: dict[str, int] = Field(description="vehicles that were asked for, by class")
    classes_realised: dict[str, int] = Field(description="vehicles that are there, by class")
    density: DensityFacts = Field(description="vehicles per lane-km, wanted and there")
    duration_asked_s: float = Field(description="length that was asked for")
    recorded_s: float = Field(description="length of the recording")
    feasible_share: float
    checks_failed: tuple[str, ...] = Field(description="checks that it did not pass")
    notes_total: int = Field(description="how many notes there are")
    warnings_total: int = Field(description="how many warnings of network and netconvert there are")
    notes: tuple[str, ...] = ()
    network_warnings: tuple[str, ...] = Field((), description="warnings of our checks of the network")
    netconvert_warnings: tuple[str, ...] = Field((), description="warnings of SUMO's netconvert")
    conditions: tuple[str, ...] = Field((), description="conditions of the traffic, as they were asked for")
    absences: tuple[VehicleAbsence, ...] = Field(
        (), exclude_if=lambda absences: not absences, description="asked for and not there as asked, and why"
    )

    def lines(self) -> list[str]:
        """Site, traffic and checks in a line, then notes and warnings, one each."""
        site, density = self.site, self.density
        streets = cited_all(site.streets) or "unnamed roads"
        mark = f", OSM {site.osm_id}" if site.osm_id else ""
        classes = ", ".join(counted(count, name) for name, count in self.classes_realised.items()) or "the ego alone"
        asked = "".join(f", with {counted(count, name)}" for name, count in self.classes_asked.items())
        asked_density = density.at_time or density.wish
        under = f"conditions {', '.join(self.conditions)}; " if self.conditions else ""
        listed = [f"Not as asked: {absence.in_words()}" for absence in self.absences]
        listed += [f"Generation note: {note}" for note in self.notes]
        listed += [f"Road network: {warning}" for warning in self.network_warnings]
        listed += [f"netconvert: {warning}" for warning in self.netconvert_warnings]
        is_complete = listed or self.notes_total + self.warnings_total == 0
        unlisted = "" if is_complete else f" {self.notes_total} notes, {self.warnings_total} warnings: detail checks."
        first = (
            f"Generated: {site.scenario_type} (asked: {self.scenario_type_asked}) at {site.latitude:.5f}, "
            f"{site.longitude:.5f} within {site.radius_m:g} m ({streets}{mark}); vehicles {self.vehicles_realised} "
            f"(asked: {self.vehicles_asked}{asked}), beside the ego {classes}; {density.at_start_per_lane_km:g} per "
            f"lane-km at the start, {density.at_end_per_lane_km:g} at the end (asked: {asked_density}, "
            f"{density.target_per_lane_km:g}); {self.recorded_s:g} s recorded (asked: {self.duration_asked_s:g} s); "
            f"{under}{self.feasible_share:.0%} of tracks drivable; "
            f"checks failed: {', '.join(self.checks_failed) or 'none'}."
        )
        return [first + unlisted, *listed]


class DescribeScenarioResult(Result):
    """A scenario in words and ids: all that an edit needs."""

    scenario_id: str
    origin: Origin = Field(description="where it comes from")
    place: str = Field(description="the town or region; empty if it is not known")
    detail: Detail = Field("brief", description="what is told in addition to the summary")
    tags: tuple[str, ...] = Field(description="tags that it has")
    features: tuple[str, ...] = Field(description="features that its geometry shows")
    step_s: float = Field(description="length of a time step")
    duration_s: float = Field(description="length of the recording")
    counts: dict[str, int] = Field(description="road users by type")
    signs: tuple[str, ...] = Field(description="traffic signs, with their values")
    description: Description = Field(description="what its file shows around the focus")
    other_problems: tuple[int, ...] = Field((), description="other planning problems of the file: ID#problem names one")
    generation: DescribedGeneration | None = Field(None, description="how it was generated; null if it was not")
    recipe: dict[str, JsonValue] | None = Field(None, description="what makes it again; null if it was not asked for")

    def answer(self) -> Answer:
        """Return what it is, the ego, what was asked about; then the lists that the detail asks for."""
        shown, total = self.description, sum(self.counts.values())
        kinds = ", ".join(counted(count, kind) for kind, count in self.counts.items())
        traffic = f"{counted(total, 'road user')} beside the ego ({kinds})" if total else "no traffic"
        decided = [f"Tags: {', '.join(self.tags) or 'none'}. Computed: {', '.join(self.features) or 'nothing'}."]
        decided += [f"On the ego's lane: {', '.join(self.signs)}."] if self.signs else []
        decided.append(ego_text(shown.ego) if shown.ego else "No planning problem, so no ego.")
        if self.other_problems:
            words = ", ".join(f"{self.scenario_id}#{key}" for key in self.other_problems[:_PROBLEMS_SHOWN])
            count = counted(len(self.other_problems), "more planning problem")
            decided.append(f"The file has {count}, each with an ego of its own: {words}.")
        decided += _focus(shown.asked) if shown.asked else []
        motion = shown.asked.motion.lines() if shown.asked is not None and shown.asked.motion is not None else []
        listed = [*motion, *self._vehicles(), *self._lanelets(), *(f"Check: {check}" for check in shown.checks)]
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

    def _vehicles(self) -> list[str]:
        """Return the vehicles that the detail lists; one that lists none says nothing about them."""
        shown, most = self.description, VEHICLES_SHOWN[self.detail]
        if not most or not shown.vehicles_total:
            return []
        if not shown.vehicles:
            return [f"No vehicle within radius_m of {shown.focus}; {shown.vehicles_total} elsewhere: raise radius_m."]
        more = shown.vehicles_total - len(shown.vehicles)
        rest = "raise radius_m" if self.detail == "vehicles" else "detail=vehicles"
        measured = ", metres along its lane" if shown.focus == "the ego" else ""
        measured += f", at {shown.time_s:g} s, placed as seen from the ego's start" if shown.time_s else ""
        others = f" ({more} more: {rest})" if more else ""
        head = f"Vehicles, in a straight line nearest to {shown.focus} first{measured}{others}:"
        return [head, *(_vehicle(vehicle, shown.asked) for vehicle in shown.vehicles)]

    def _lanelets(self) -> list[str]:
        shown = self.description
        if not shown.lanelets:
            return []
        more = shown.lanelets_total - len(shown.lanelets)
        head = f"Lanelets near {shown.focus}{f' ({more} more: raise radius_m, or focus)' if more else ''}:"
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
"""How many vehicles and lanelets each detail lists, at most: a description is read by a model (chosen)."""


def _focus(focus: DescribedFocus) -> list[str]:
    """Whom the call asked about, where it was recorded to drive, and where it can drive."""
    name = f"{focus.name[0].upper()}{focus.name[1:]}{f' ({focus.what})' if focus.what else ''}"
    seen = f": {_seen(focus.vehicle)}." if focus.vehicle is not None else "."
    recorded = f" Recorded way: lanelets {_chain(focus.route)}." if focus.route else ""
    ways = [(" then ".join(way.turns) or "straight", way) for way in focus.reach]
    reached = [f"{turns} {way.lanelet_id} ({way.distance_m:.0f} m)" for turns, way in ways]
    return [f"{name}{seen}{recorded} Can reach: {', '.join(reached) or 'no other lanelet'}."]


_PROBLEMS_SHOWN = 6
"""Other planning problems that an answer names (chosen)."""


def ego_text(ego: DescribedEgo) -> str:
    """Where the ego starts, what its goal asks for and its way there, in a line."""
    lanes = f"{ego.lanes} lane{'' if ego.lanes == 1 else 's'} in its direction"
    lanelets = f"lanelet {', '.join(map(str, ego.lanelets))}" if ego.lanelets else "no lanelet"
    route = f" Way: {ego.way}{f', lanelets {_chain(ego.route)}' if ego.route else ''}."
    what = "" if ego.vehicle_class == "car" else f"{ego.vehicle}. Starts at "
    return f"Ego: {what}{ego.speed_mps:.1f} m/s on {lanelets}, {lanes}. Goal: {ego.goal}.{route}"


def _chain(route: tuple[int, ...]) -> str:
    shown = [str(key) for key in (route if len(route) <= 8 else (*route[:4], *route[-3:]))]
    return " → ".join(shown if len(route) <= 8 else [*shown[:4], "…", *shown[4:]])


def _vehicle(vehicle: DescribedVehicle, focus: DescribedFocus | None) -> str:
    """Return a vehicle in a line; where something was asked about, by its distance from there too."""
    away = f"{vehicle.distance_m:.0f} m from {focus.name}; seen from the ego " if focus is not None else ""
    return f"- {vehicle.vehicle_id} {_seen(vehicle, away)}"


def _seen(vehicle: DescribedVehicle, away: str = "") -> str:
    """Kind, place as seen from the ego, speed, gap and lanelet of a vehicle."""
    gap = f", gap {vehicle.gap_m:.1f} m" if vehicle.gap_m is not None else ""
    lanelet = f", lanelet {vehicle.lanelet}" if vehicle.lanelet is not None else ", on no lanelet"
    when = f", from {vehicle.from_s:g} s" if vehicle.from_s > 0 else ""
    speed = f"{vehicle.speed_mps:.1f} m/s" if vehicle.moves else "stands"
    kind = f"{vehicle.kind} ({vehicle.vehicle_class})" if vehicle.vehicle_class else vehicle.kind
    return f"{kind}: {away}{vehicle.where}, {speed}{gap}{lanelet}{when}"


def _lanelet(lanelet: DescribedLanelet) -> str:
    beside = [f"left {lanelet.left}"] if lanelet.left is not None else []
    beside += [f"right {lanelet.right}"] if lanelet.right is not None else []
    beside += [f"opposite {lanelet.opposite}"] if lanelet.opposite is not None else []
    parts = [f"{lanelet.length_m:.0f} m", *([f"edge {shown_name(lanelet.edge)}"] if lanelet.edge else [])]
    parts += [lanelet.role] if lanelet.role else []
    parts += [f"leads {', '.join(lanelet.successors)}" if lanelet.successors else "leads nowhere"]
    parts += [f"beside {', '.join(beside)}"] if beside else []
    parts += [f"limit {lanelet.limit_kmh:g} km/h"] if lanelet.limit_kmh else []
    parts += [f"vehicles {', '.join(map(str, lanelet.vehicles))}"] if lanelet.vehicles else []
    return f"- {lanelet.lanelet_id}: {'; '.join(parts)}"
