"""What one planner run on one scenario gives: the record that analysis, comparison and pictures read."""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import Model
from .measures import RunMetrics
from .text import measured
from .vocabulary import LEAST_FRICTION, MOST_FRICTION

Bounded = Annotated[float, Field(ge=-1e12, le=1e12)]
"""A number of a motion, from which no derivative or square overflows.

The magnitude exceeds each limit of a scenario file (docs/limits.md); its third derivative over steps of 1 ms, squared,
is 1e42. A run of an archive or an answer of a planner program may state any number.
"""
BoundedCost = Annotated[float, Field(ge=-1e150, le=1e150)]
"""A cost with a finite square."""
Outcome = Literal[
    "goal_reached",
    "goal_refused",
    "goal_early",
    "goal_late",
    "goal_missed",
    "timeout",
    "infeasible",
    "off_road",
    "collision",
    "invalid",
]
"""How a run ended.

``goal_reached``: at the goal, by a motion that CommonRoad's benchmark accepts (``SuccessRule``); ``goal_refused``: at
the goal, by a motion that it refuses (``Refusal``);
``goal_early``, ``goal_late``: the ego was in the goal's place, but only before or after its time; ``goal_missed``: it
passed the goal or ended elsewhere, or was there in time without the goal's speed or heading; ``timeout``: it had not
come to the goal when 1.7 times the steps to the goal's last step were over; ``infeasible``: the planner found no
trajectory that the vehicle can drive; ``invalid``: the problem has no solution, which is stated before the run and is
never a planner's failure.
"""
SuccessRule = Literal["driven@1", "accepted@2"]
"""What makes a goal that was reached a success.

``driven@1``: nothing else, as in the paper. ``accepted@2``: ``valid_solution``, the checker of CommonRoad's benchmark,
accepts the driven motion; where it does not, the outcome is ``goal_refused``.
"""
Refusal = Literal["goal_not_met", "off_lanelets", "not_drivable"]
"""Why CommonRoad's benchmark refuses a motion that reached its goal. ``goal_not_met``: by its reading of the goal no
state meets it; ``off_lanelets``: a part of the body is outside the lanelets, be it at the start behind the end of the
map or in a gap between two lanelets; ``not_drivable``: no acceleration and steering lead from a state to the
next."""
AT_GOAL: tuple[Outcome, ...] = ("goal_reached", "goal_refused")
"""Outcomes that count as reached by the paper's rule."""
NO_TRAJECTORY: tuple[Outcome, ...] = ("invalid", "infeasible")
"""Outcomes without a motion to speak of: the problem is broken, or the planner finds no trajectory for it."""
InvalidReason = Literal[
    "no_goal_state", "initial_collision", "ego_off_road", "ego_against_route", "goal_unreachable", "goal_out_of_time"
]
"""Why a problem is invalid. ``ego_against_route``: the ego begins with its heading more than 90° off the way to its
goal; ``goal_unreachable``: no route on the lanelet graph, or it lies behind the ego and no way leads back;
``goal_out_of_time``: not even the vehicle's largest acceleration brings the ego there in time."""
Prediction = Literal["constant_velocity", "growing_covariance", "lane", "ground_truth"]
Traffic = Literal["recorded", "reactive"]
"""``reactive``: the others react to the ego, driven by SUMO; ``recorded``: they follow their recording."""


VERSION_MARK = "@"
"""Between the id of a configuration and the digest of its planner's version, where results hold several versions."""


def configuration_id(told: str) -> str:
    """Return the id of a configuration without the version of its planner: ``cfg_1`` of ``cfg_1@d4e5f6a``."""
    return told.partition(VERSION_MARK)[0]


class CollisionRecord(Model):
    """The first collision of a run: the obstacle (None: the road boundary), the step and the time."""

    obstacle_id: int | None
    kind: str
    step: int
    time_s: float


class DrivenObstacle(Model):
    """An obstacle of reactive traffic as it really moved (centre, one entry a step); rounded to 0.1 mm."""

    obstacle_id: int
    kind: str
    length_m: Bounded
    width_m: Bounded
    first_step: int
    x_m: tuple[Bounded, ...]
    y_m: tuple[Bounded, ...]
    heading_rad: tuple[Bounded, ...]
    speed_mps: tuple[Bounded, ...]


class RunSteps(Model):
    """The driven trajectory (centre of the ego, one entry a step) and the cost terms of the chosen candidates.

    ``costs``: weighted cost term name → one value per planning step; ``plan_steps``: the steps at which was planned.
    ``rejected``: constraint → candidates it rejected, one value per planning step; one more where the last attempt,
    which is no planning step, gave no trajectory.
    ``steering_rad``: the steering angles of a vehicle that followed its plans; empty where a planner's states were
    taken as they are.
    ``others``: the obstacles that reactive traffic moved, instead of their recordings; the rest followed theirs.
    """

    first_step: int
    x_m: tuple[Bounded, ...]
    y_m: tuple[Bounded, ...]
    heading_rad: tuple[Bounded, ...]
    speed_mps: tuple[Bounded, ...]
    acceleration_mps2: tuple[Bounded, ...]
    steering_rad: tuple[Bounded, ...] = ()
    plan_steps: tuple[int, ...]
    costs: dict[str, tuple[BoundedCost, ...]]
    rejected: dict[str, tuple[int, ...]] = Field(default_factory=dict)
    others: tuple[DrivenObstacle, ...] = ()


MOST_DEBUG_VALUES, MOST_DEBUG_POLYGONS, MOST_DEBUG_POINTS = 32, 8, 100
"""Debug numbers or texts, polygons, and points of a polygon that a planning step may report.

A hundred planning steps with all of them take 1.2 MB (``tests/engine/planners/test_series.py``).
"""
MOST_DEBUG_POINTS_A_RUN = 20_000
"""Points of all polygons that are kept with a run."""


class DebugPolygon(Model):
    """An outline that a planner reported at a planning step."""

    step: int
    name: str
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]


class RunSeries(Model):
    """What is known of a run over time beside its motion; a file of its own beside the steps.

    One value for each driven state: ``lateral_offset_m`` from the reference path (left positive), ``heading_error_rad``
    against its direction, ``steering_rad`` that the motion asks of the front wheels. One value for each planning step
    (``plan_steps`` of the run's steps): ``desired_speed_mps`` of the loop and ``desired_speed_reasons``, and what the
    planner reported by name: ``numbers`` (None if it reported no finite number), ``texts`` (empty if it reported none).
    ``left_out``: how many debug values were beyond the bounds and are not kept.
    """

    lateral_offset_m: tuple[float, ...] = ()
    heading_error_rad: tuple[float, ...] = ()
    steering_rad: tuple[float, ...] = ()
    desired_speed_mps: tuple[float, ...] = ()
    desired_speed_reasons: tuple[str, ...] = ()
    numbers: dict[str, tuple[float | None, ...]] = Field(default_factory=dict)
    texts: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    polygons: tuple[DebugPolygon, ...] = ()
    left_out: int = 0


class RunTiming(Model):
    """Measured times; kept beside the record, never part of the reproducible payload.

    ``steps``: planning steps, the one without a trajectory included; ``planning_ms``: the time of each;
    ``core_step_median_ms``: the part of a step in the planner's core (None: no core).
    """

    wall_s: float
    planning_step_median_ms: float
    core_step_median_ms: float | None = None
    steps: int = 0
    planning_ms: tuple[float, ...] = ()


class LimitExcess(Model):
    """A limit of the ego's vehicle that the driven motion exceeds: where it does so most.

    ``friction``: acceleration along and across together; ``rolling``: the share of the steps in which the wheels would
    have to slide, from ``time_s`` on.
    """

    name: Literal["speed", "acceleration", "friction", "steering angle", "steering rate", "rolling"] = Field(
        description="the limit"
    )
    value: float = Field(description="the largest value, in `unit`")
    limit: float = Field(description="the limit itself, in `unit`")
    unit: str
    time_s: float = Field(description="when it is exceeded most")

    def in_words(self) -> str:
        """``steering rate 0.75 rad/s at 2.3 s (limit 0.4)``."""
        if self.name == "rolling":
            return f"wheels that slide in {100 * self.value:.0f} % of the steps, from {self.time_s:.1f} s on"
        return f"{self.name} {measured(self.value)} {self.unit} at {self.time_s:.1f} s (limit {measured(self.limit)})"


def excesses_in_words(excesses: Sequence[LimitExcess]) -> str:
    """What of a driven motion its vehicle cannot do, and what that means for the run."""
    told = "; ".join(excess.in_words() for excess in excesses)
    return f"the driven motion is beyond the vehicle: {told}; a solution exported of it may be refused"


class TriggerOutcome(Model):
    """Whether a trigger of an edit held in a run with reactive traffic, and what it let a road user begin.

    ``time_s``: since the beginning of the run; None if the trigger never held.
    """

    obstacle_id: int
    code: Literal["trigger_fired", "trigger_not_fired"] = Field(description="stable code")
    begins: Literal["speed_change", "lateral_motion", "speed_and_lateral", "setting_off"] = Field(
        description="what is prescribed from then on"
    )
    trigger: str = Field(description="what the ego has to do, in words")
    time_s: float | None = Field(description="when that began; null if it never did")

    def in_words(self) -> str:
        """Tell when it began and its trigger, with the code."""
        what = f"{self.obstacle_id}'s {_BEGUN[self.begins]}"
        if self.time_s is None:
            return f"{what} never began, as its trigger did not hold ({self.code}): {self.trigger}"
        return f"{what} began at {self.time_s:.1f} s, as its trigger held ({self.code}): {self.trigger}"


_BEGUN = {
    "speed_change": "change of speed",
    "lateral_motion": "motion to the side",
    "speed_and_lateral": "change of speed and motion to the side",
    "setting_off": "drive",
}


class RunRecord(Model):
    """One planner on one planning problem: what happened and why."""

    run_id: str
    scenario_id: str
    problem_id: int
    config_id: str
    config_name: str
    planner: str
    prediction: Prediction
    traffic: Traffic
    seed: int
    step_s: float = Field(ge=0.001, le=10)
    outcome: Outcome
    reason: str = Field(description="one sentence: what ended the run, with figures")
    invalid_reason: InvalidReason | None = Field(None, description="stable code, only where the outcome is invalid")
    collision: CollisionRecord | None
    off_the_lanes: tuple[int, ...] = Field((), description="lane prediction: obstacles predicted straight on")
    on_recording: tuple[int, ...] = Field((), description="reactive traffic: obstacles that SUMO could not drive")
    triggers: tuple[TriggerOutcome, ...] = Field(
        (),
        exclude_if=lambda triggers: not triggers,
        description="reactive traffic: triggers of prescribed motions, and whether they held",
    )
    eased_over_m: float | None = Field(
        None, description="metres of a curve onto the route, where the start allows no way along its centre"
    )
    rejected_candidates: dict[str, int] = Field(description="constraint → candidates it rejected, over the whole run")
    metrics: RunMetrics | None
    success_rule: SuccessRule = Field("driven@1", description="the rule by which it was judged")
    refusal: Refusal | None = Field(None, description="stable code, only where the outcome is goal_refused")
    beyond_vehicle: tuple[LimitExcess, ...] | None = Field(
        None, description="limits of the vehicle that the driven motion exceeds; null: the run is of a version before"
    )
    ego_length_m: float = Field(4.508, ge=0.001, le=1000)
    ego_width_m: float = Field(1.61, ge=0.001, le=1000)
    planner_version: str = Field(
        "", description="version of the planner: as declared or described by git, with a digest; empty: not known"
    )
    planner_source: str = Field("", description="digest of what drove, by which two versions are told apart")
    ego_class: str = Field(
        "car",
        exclude_if=lambda name: name == "car",
        description="what the ego was: as its scenario says, or of the vehicle that the configuration states",
    )
    friction: float | None = Field(
        None,
        exclude_if=lambda friction: friction is None,
        ge=LEAST_FRICTION,
        le=MOST_FRICTION,
        description="coefficient of friction of the road, which limits the ego's accelerations; null: not stated",
    )
    uses_prediction: bool | None = Field(
        None, description="whether the planner plans on predictions of others; null: it did not say"
    )
    imported: bool = Field(
        False, exclude_if=lambda imported: not imported, description="it came in an archive, whose maker vouches for it"
    )


ContactKind = Literal[
    "rear_end_by_other",
    "rear_end_by_ego",
    "cut_in",
    "cut_in_by_ego",
    "oncoming",
    "crossing",
    "side",
    "into_standing",
    "onto_standing_ego",
    "road_boundary",
    "unclear",
]
"""Who hit whom, and from where; the rules that decide are in ``docs/runs.md``."""
BodySide = Literal["front", "rear", "left", "right"]
"""A side of a road user, as its driver sees it."""
RelativeHeading = Literal["same", "oncoming", "crossing"]
"""How another heads, seen from the ego: within 45° of it, within 45° of against it, or between."""
SeenCourse = Literal["same", "oncoming", "crossing", "standing"]
"""The course of another, seen from the ego; ``standing``: it does not move, and heads another way than the ego."""


DriverModelName = Literal["full_braking", "r157_careful", "fsm", "rss", "keep_lane"]
"""Reference drivers that are models of a driver, and planners of the same name."""
ReferenceDriverName = Literal[DriverModelName, "evading"]
"""Drivers in the ego's place: full braking, UN R157's careful and fuzzy ones, RSS, one that keeps lane and speed, and
one that steers aside by a lane's width (``docs/reference_drivers.md``)."""
DriverStart = Literal["before_contact", "start"]
"""What a driver does until it reacts: it follows the ego's own motion up to the contact, or it keeps the lane and the
speed of the start."""


REFERENCE_DRIVERS_DO = (
    "full braking at once, or UN R157's careful and fuzzy drivers or RSS, which keep the ego's speed until they see a "
    "danger"
)
"""The drivers of a verdict and what they do, for each statement that no driver prevents a collision."""


class DriverVerdict(Model):
    """Whether one reference driver prevents a collision from one start; times are those of the run, in s.

    ``until_s``: the latest moment at which it may take over and still prevents it; null: it does not prevent it.
    ``reacts_at_s``: when it first brakes or steers if it takes over at the start; null: it does not react at all.
    """

    driver: ReferenceDriverName = Field(description="the reference driver")
    start: DriverStart = Field(description="where it takes over")
    prevents: bool = Field(description="whether it prevents the collision")
    until_s: float | None = None
    reacts_at_s: float | None = None


class Prevention(Model):
    """Whether reference drivers in the ego's place prevent a collision (``docs/runs.md``), the others as they moved.

    ``drivers``: the verdict on each driver from each start; empty in what versions before stored. The other fields are
    those from ``before_contact``: ``by_braking_until_s``: the latest moment of the run at which full braking prevents
    it; None: none does. ``by_steering_until_s``: the same of steering aside, which is no reference driver and stands
    beside them; ``steering_tried``: whether it was asked, which it is not of egos that were hit from behind.
    """

    by_braking_until_s: float | None = Field(
        description="latest moment of the run at which full braking prevents it; null: it does not"
    )
    by_careful_driver: bool = Field(description="whether the careful driver of UN R157 prevents it")
    by_rss: bool = Field(description="whether a driver by RSS prevents it")
    by_fuzzy_driver: bool = Field(False, description="whether the fuzzy driver of UN R157 prevents it")
    by_steering_until_s: float | None = None
    steering_tried: bool = False
    drivers: tuple[DriverVerdict, ...] = Field((), description="each driver from each start; empty: an older version")

    @property
    def possible(self) -> bool:
        """Whether any reference driver prevents it, from the moment before the contact or from the start."""
        by_driver = self.by_careful_driver or self.by_rss or self.by_fuzzy_driver
        return self.by_braking_until_s is not None or by_driver or bool(self._from_start(prevents=True))

    @property
    def attributable(self) -> bool:
        """Whether UN R157's careful or its fuzzy driver prevents it from both starts."""
        if not self.drivers:
            return self.by_careful_driver or self.by_fuzzy_driver
        return any(self.prevented_by(name, "both") for name in ("r157_careful", "fsm"))

    def prevented_by(self, driver: ReferenceDriverName, start: Literal["before_contact", "start", "both"]) -> bool:
        """Return whether a driver prevents it from a start, or from both."""
        starts = ("before_contact", "start") if start == "both" else (start,)
        found = {verdict.start for verdict in self.drivers if verdict.driver == driver and verdict.prevents}
        return found.issuperset(starts)

    def in_words(self) -> str:
        """Return which drivers prevent it from which start, and until when."""
        until = self.by_steering_until_s
        aside = "" if until is None else f"; steering aside until {until:.1f} s does"
        if not self.possible:
            starts = " or from the start" if self.drivers else ""
            return f"from the moment before it{starts} no reference driver prevents it ({REFERENCE_DRIVERS_DO}){aside}"
        prevents = [] if self.by_braking_until_s is None else [f"full braking until {self.by_braking_until_s:.1f} s"]
        prevents += [] if until is None else [f"steering aside until {until:.1f} s"]
        prevents += self._drivers(prevents=True)
        if self.by_braking_until_s is None and not self._drivers(prevents=True):
            none = f"from the moment before it no reference driver prevents it ({REFERENCE_DRIVERS_DO}){aside}"
            return f"{none}{self._start_in_words()}"
        others = [*self._drivers(prevents=False), *(["steering"] if self.steering_tried and until is None else [])]
        without = f", not by {_listed(others, 'or')}" if others else ""
        return f"preventable by {_listed(prevents, 'and')}{without}{self._start_in_words()}"

    def _start_in_words(self) -> str:
        """Return which drivers prevent it from the start; empty for versions that did not examine it."""
        if not self.drivers:
            return ""
        yes, no = self._from_start(prevents=True), self._from_start(prevents=False)
        if not yes:
            return "; from the start none does"
        if not no:
            return "; from the start all do"
        return f"; from the start {_listed(yes, 'and')} {'do' if len(yes) > 1 else 'does'}"

    def _from_start(self, *, prevents: bool) -> list[str]:
        """Return the reference drivers that prevent it from the start, or do not; steering aside is not one of them."""
        return [
            _DRIVERS_IN_WORDS[verdict.driver]
            for verdict in self.drivers
            if verdict.start == "start" and verdict.prevents == prevents and verdict.driver != "evading"
        ]

    def _drivers(self, *, prevents: bool) -> list[str]:
        """The reference drivers beside full braking that prevent it, or do not."""
        named = {"careful": self.by_careful_driver, "fuzzy": self.by_fuzzy_driver}
        of_r157 = [name for name, does in named.items() if does == prevents]
        drivers = [f"UN R157's {' and '.join(of_r157)} driver{'s' * (len(of_r157) - 1)}"] if of_r157 else []
        return [*drivers, *(["RSS"] if self.by_rss == prevents else [])]


_DRIVERS_IN_WORDS: dict[ReferenceDriverName, str] = {
    "full_braking": "full braking",
    "r157_careful": "UN R157's careful driver",
    "fsm": "UN R157's fuzzy driver",
    "rss": "RSS",
    "keep_lane": "keeping lane and speed",
    "evading": "steering aside",
}


def _listed(parts: Sequence[str], conjunction: str) -> str:
    """``a, b and c``."""
    return f" {conjunction} ".join([*([", ".join(parts[:-1])] if parts[:-1] else []), parts[-1]])


PaceCode = Literal[
    "stood_at_red",
    "stood_before_red",
    "stood_at_light",
    "stood_at_stop_sign",
    "stood_to_give_way",
    "stood_in_queue",
    "stood_behind_vehicle",
    "stood_in_goal",
    "stood_at_green",
    "stood_without_cause",
    "held_up",
    "braked_for_vehicle",
    "braked_to_give_way",
    "braked_for_light",
    "braked_for_stop_sign",
    "braked_for_curve",
    "braked_for_limit",
    "braked_for_goal",
    "braked_for_road_end",
    "braked_for_course",
    "braked_too_hard",
    "braked_without_cause",
]
"""Why an ego stood, drove slowly or braked; the rules that decide are in ``docs/runs.md``."""
EGOS_OWN: tuple[PaceCode, ...] = ("stood_at_green", "stood_without_cause", "braked_too_hard", "braked_without_cause")
"""What nothing on the road asked of the ego."""


class PaceMoment(Model):
    """A stretch of a run in which the ego stood, was held up by a slower vehicle, or braked by 2 m/s² or more, and why.

    ``obstacle_id``: the other that it is about; ``distance_m``: the gap to it, or from the ego's front to the line, at
    the beginning; ``largest_mps2``: the hardest braking, as a positive number.
    """

    code: PaceCode = Field(description="stable code: what the ego did, and why")
    since_s: float = Field(description="when it began")
    until_s: float = Field(description="when it ended")
    obstacle_id: int | None = None
    obstacle_class: str = ""
    distance_m: float | None = Field(None, description="to the other or the line, when it began")
    largest_mps2: float | None = Field(None, description="the hardest braking in it; null where the ego stood")

    @property
    def is_the_egos(self) -> bool:
        """Whether nothing on the road asked for it."""
        return self.code in EGOS_OWN

    @property
    def duration_s(self) -> float:
        """How long it lasted."""
        return self.until_s - self.since_s

    def in_words(self) -> str:
        """Return ``stood at a green light from 14.5 s to 23.8 s, 2.1 m before its line``."""
        other = "" if self.obstacle_id is None else f"{self.obstacle_class} {self.obstacle_id}".strip()
        far = "" if self.distance_m is None else f"{self.distance_m:.1f} m"
        span = f"from {self.since_s:.1f} s to {self.until_s:.1f} s"
        by = "" if self.largest_mps2 is None else f" by up to {self.largest_mps2:.1f} m/s²"
        before = f", {far} before its line" if far else ""
        words: dict[PaceCode, str] = {
            "stood_at_red": f"stood at a red light {span}{before}",
            "stood_before_red": f"stood {span} on the way to a red light{before}",
            "stood_at_light": f"stood {span} at a light whose colour the file does not hold{before}",
            "stood_at_stop_sign": f"stood at a stop sign {span}{before}",
            "stood_to_give_way": f"stood {span} while {other} crossed its way",
            "stood_in_queue": f"stood in a queue {span}, {far} behind {other}",
            "stood_behind_vehicle": f"stood {span}, {far} behind {other}",
            "stood_in_goal": f"stood in its goal {span}, before the goal's time",
            "stood_at_green": f"stood at a green light {span}{before}, with no other in its way",
            "stood_without_cause": f"stood {span} with no other in its way and no light or sign to wait for",
            "held_up": f"followed slower {other} {span}",
            "braked_for_vehicle": f"braked{by} {span} for {other} ahead",
            "braked_to_give_way": f"braked{by} {span} for {other}, which came across its way",
            "braked_for_light": f"braked{by} {span} for a light",
            "braked_for_stop_sign": f"braked{by} {span} for a stop sign",
            "braked_for_curve": f"braked{by} {span} for a curve",
            "braked_for_limit": f"braked{by} {span} for the speed limit",
            "braked_for_goal": f"braked{by} {span} for the speed or time of its goal",
            "braked_for_road_end": f"braked{by} {span} for the end of the road",
            "braked_for_course": f"braked{by} {span} for {other}, which was on a course to meet it",
            "braked_too_hard": f"braked{by} {span}, much harder than {other or 'anything on its way'} asked for",
            "braked_without_cause": f"braked{by} {span} with nothing on its way that asked for it",
        }
        return words[self.code]


LaidTo = Literal["ego", "recording", "prediction", "planning", "neither"]
"""What a collision is laid to: what the ego did before it without a reason; another that follows a recording and would
have braked; a prediction that had the other elsewhere; a plan that had it there, although the collision is
attributable; nothing, since it is not attributable (neither UN R157's careful nor its fuzzy driver prevents it from
both starts)."""
OwnFault = Literal["slowed", "cut_in", "wrong_side", "red_light", "right_of_way"]
"""How an ego makes a collision that no reference driver on its path prevents: it stood or braked without a reason, cut
in, was on the lane of oncoming traffic, passed a red light, or took the right of way."""


class EgoFault(Model):
    """What the ego did that led to a collision, and when; ``moment``: the stand or braking, if it is one."""

    code: OwnFault = Field(description="stable code of what the ego did")
    time_s: float = Field(description="when it did it")
    moment: PaceMoment | None = None

    def in_words(self) -> str:
        """``the ego, which stood from 4.0 s to 9.0 s with no other in its way and no light or sign to wait for``."""
        if self.moment is not None:
            return f"the ego, which {self.moment.in_words()}"
        words: dict[OwnFault, str] = {
            "slowed": "the ego, which slowed down without a reason",
            "cut_in": "the ego, which cut in",
            "wrong_side": "the ego, which was on a lane of the opposite direction",
            "red_light": "the ego, which passed a red light",
            "right_of_way": "the ego, which did not give way",
        }
        return f"{words[self.code]} at {self.time_s:.1f} s"


class Contact(Model):
    """How the collision of a run came about: speeds at its step, places at the last step before it.

    ``ego_side``, ``other_side``: the sides that met. ``closing_mps``: length of the difference of both velocities.
    ``ego_stood_since_s``: where the ego stood, since when. ``braked_since_s``: from when on the ego braked by more than
    1 m/s² without a break until the contact; None: it did not. ``came_in_s``: for a cut-in, when the one ahead came
    into the way of the one behind. ``also_touched``: others that overlap the ego at the same step. ``prevention``: None
    where the tracks do not hold the one that was hit.
    ``predicted_gap_m``: how far apart the two would have been at the collision, had the other moved as the run's
    predictor said a second before; None where it was not there then, or is not known to have been predicted.
    ``laid_to``: None where that decides, or the prevention is not known. ``fault``: what the ego did, where it is laid
    to the ego.
    """

    kind: ContactKind = Field(description="how the two met")
    time_s: float = Field(description="when they met")
    ego_speed_mps: float = Field(description="speed of the ego then")
    obstacle_id: int | None = None
    obstacle_class: str = ""
    other_speed_mps: float | None = Field(None, description="speed of the other then; null of what has none")
    closing_mps: float | None = None
    ego_side: BodySide | None = Field(None, description="side of the ego that was hit; null where it is not known")
    other_side: BodySide | None = None
    ego_stood_since_s: float | None = None
    braked_since_s: float | None = None
    came_in_s: float | None = None
    also_touched: tuple[int, ...] = ()
    prevention: Prevention | None = None
    predicted_gap_m: float | None = None
    laid_to: LaidTo | None = None
    fault: EgoFault | None = Field(None, description="what the ego did, where the collision is laid to it")

    @property
    def is_unpreventable(self) -> bool:
        """Whether no reference driver prevents it and the ego did not make it."""
        return self.prevention is not None and not self.prevention.possible and self.laid_to != "ego"

    @property
    def unforeseen(self) -> bool:
        """Whether the two would have stayed apart, had the other moved as it was predicted a second before."""
        return self.predicted_gap_m is not None and self.predicted_gap_m > 0

    def in_words(self) -> str:
        """Who hit whom, from where, when, at which speeds, and whether the ego had braked before."""
        if self.other_speed_mps is None:
            where = "left the road" if self.obstacle_id is None else f"collided with {self._other}"
            return f"{where} at {self.time_s:.1f} s, at {self.ego_speed_mps:.1f} m/s{self._braked}"
        speeds = f"ego {self.ego_speed_mps:.1f} m/s{self._braked}; {self._other} {self.other_speed_mps:.1f} m/s"
        also = f"; also touched then: {', '.join(map(str, self.also_touched))}" if self.also_touched else ""
        # What drivers on the ego's path prevent says nothing where the ego made it by how it drove along that path.
        told = self.prevention if self.laid_to != "ego" else None
        judged = "" if told is None else f"; {told.in_words()}"
        if self.unforeseen:
            judged += f"; unforeseen: {self.predicted_gap_m:.1f} m apart as predicted a second before"
        if self.fault is not None:
            judged += f"; laid to {self.fault.in_words()}"
        elif self.laid_to is not None:
            judged += f"; laid to {'the recording' if self.laid_to == 'recording' else self.laid_to}"
        return f"{self._what} at {self.time_s:.1f} s ({speeds}){also}{judged}"

    @property
    def _other(self) -> str:
        return f"{self.obstacle_class} {self.obstacle_id}"

    @property
    def _braked(self) -> str:
        if self.kind == "onto_standing_ego":
            return "" if self.ego_stood_since_s is None else f", standing since {self.ego_stood_since_s:.1f} s"
        return ", not braking" if self.braked_since_s is None else f", braking since {self.braked_since_s:.1f} s"

    @property
    def _beside(self) -> str:
        """Whether both were side by side, or one came in at an angle, as where lanes merge."""
        sides = {self.ego_side, self.other_side}
        return "alongside" if sides <= {"left", "right"} else "of the same direction"

    @property
    def _what(self) -> str:
        other, came = self._other, "" if self.came_in_s is None else f", in the way since {self.came_in_s:.1f} s"
        whence = {"front": "ahead", "rear": "behind", "left": "the left", "right": "the right", None: "nowhere"}
        words: dict[ContactKind, str] = {
            "rear_end_by_other": f"hit from behind by {other}",
            "rear_end_by_ego": f"ran into the back of {other}",
            "cut_in": f"ran into {other} that cut in{came}",
            "cut_in_by_ego": f"cut in ahead of {other}{came}, and was hit by it",
            "oncoming": f"met oncoming {other}, ego's {self.ego_side} to its {self.other_side}",
            "crossing": f"met crossing {other}, ego's {self.ego_side} to its {self.other_side}",
            "side": f"touched {other} {self._beside}, ego's {self.ego_side} to its {self.other_side}",
            "into_standing": f"drove into standing {other}, ego's {self.ego_side} to its {self.other_side}",
            "onto_standing_ego": f"hit while standing by {other} from {whence[self.ego_side]}",
            "road_boundary": "left the road",
            "unclear": f"collided with {other}",
        }
        return words[self.kind]


class Encounter(Model):
    """The ego and another at one moment: ``side``: on which side of the ego it is.

    ``time_to_collision_s``: with both keeping course and speed; None: they would not meet.
    """

    time_s: float = Field(description="when that was")
    obstacle_id: int
    obstacle_class: str
    gap_m: float = Field(description="distance between the two")
    side: BodySide
    direction: SeenCourse = Field(description="course of the other, seen from the ego")
    ego_speed_mps: float = Field(description="speed of the ego")
    other_speed_mps: float = Field(description="speed of the other")
    time_to_collision_s: float | None

    @property
    def other(self) -> str:
        """Class and id."""
        return f"{self.obstacle_class} {self.obstacle_id}"

    @property
    def place(self) -> str:
        """``ahead``, ``behind``, ``on the left``, ``oncoming on the right``, ``standing on the right``."""
        where = {"front": "ahead", "rear": "behind", "left": "on the left", "right": "on the right"}[self.side]
        return where if self.direction == "same" else f"{self.direction} {where}"


class LargestMotion(Model):
    """The largest value of one motion of the ego, and when; braking and jerk are given as positive numbers."""

    name: Literal["acceleration", "braking", "lateral acceleration", "jerk"] = Field(description="the motion")
    value: float = Field(description="its largest value, in `unit`")
    unit: str
    time_s: float = Field(description="when that was")


class ComfortExcess(Model):
    """A motion above a comfort limit: its largest mean over ``window_s`` (0: at a step) and where that window ends."""

    name: Literal["acceleration", "braking", "braking jerk", "lateral acceleration", "lateral jerk"] = Field(
        description="the motion"
    )
    value: float = Field(description="its largest mean, in `unit`")
    limit: float = Field(description="the comfort limit, in `unit`")
    unit: str
    window_s: float = Field(description="length of the window that is averaged; 0: a single step")
    time_s: float = Field(description="when that window ends")
    source: str = Field(description="where the limit comes from")

    def in_words(self) -> str:
        """``braking 4.2 m/s² over 2 s, until 3.1 s (limit 3.5, ISO 15622:2018)``."""
        when = f"over {self.window_s:g} s, until {self.time_s:.1f} s" if self.window_s else f"at {self.time_s:.1f} s"
        return f"{self.name} {self.value:.1f} {self.unit} {when} (limit {self.limit:.2g}, {self.source})"


class RunReview(Model):
    """The decisive moments of one run; a moment that there was not is None.

    ``closest``: the smallest gap; ``most_urgent``: the smallest time to collision. ``uncomfortable``: motions above the
    limits of ``docs/runs.md``, whatever the outcome. ``pace``: where the ego stood, was held up or braked, and why.
    """

    run_id: str
    contact: Contact | None = Field(None, description="the collision; null without one")
    closest: Encounter | None = None
    most_urgent: Encounter | None = None
    largest: tuple[LargestMotion, ...] = Field((), description="the largest motions of the ego")
    uncomfortable: tuple[ComfortExcess, ...] = ()
    pace: tuple[PaceMoment, ...] = Field((), description="where the ego stood, was held up or braked, and why")

    def pace_in_words(self) -> str:
        """Return what the ego did by itself; empty if nothing."""
        own = [moment.in_words() for moment in self.pace if moment.is_the_egos]
        return f"The ego's own doing: {'; '.join(own)}." if own else ""

    def nearness_in_words(self) -> str:
        """The closest moment and the shortest time to a collision, in one line; what there was not is said."""
        if self.closest is None:
            return "Closest: none: no other within 60 m."
        near, urgent = self.closest, self.most_urgent
        line = f"Closest: {near.gap_m:.2f} m to {near.other} {near.place} at {near.time_s:.1f} s"
        line += f" (ego {near.ego_speed_mps:.1f}, it {near.other_speed_mps:.1f} m/s)"
        if urgent is None:
            return f"{line}; time to collision: none: never on a collision course."
        least = f"least time to collision {measured(urgent.time_to_collision_s)} s"
        if (urgent.obstacle_id, urgent.time_s) == (near.obstacle_id, near.time_s):
            return f"{line}; {least}, then."
        whom = "it" if urgent.obstacle_id == near.obstacle_id else urgent.other
        return f"{line}; {least} with {whom} {urgent.place} at {urgent.time_s:.1f} s."

    def motion_in_words(self) -> str:
        """The largest motions with their times; empty without steps."""
        parts = [f"{one.name} {measured(one.value)} {one.unit} at {one.time_s:.1f} s" for one in self.largest]
        return f"Largest: {', '.join(parts)}." if parts else ""


class RuleVerdict(Model):
    """What a run makes of a traffic rule (``docs/traffic_rules.md``).

    ``robustness``: how far the rule is from being broken at the worst step, in its unit, negative where it is broken;
    None: the run had nothing that it is about. ``time_s``: of the worst step; ``first_s``: from when on it is broken.
    """

    TOLERANCE: ClassVar[float] = 0.01
    """Files hold centimetres: a rule is broken by more than this."""

    rule: str = Field(description="stable name of the rule")
    name: str = Field(description="the rule in words")
    unit: str = Field(description="unit of `robustness`")
    robustness: float | None
    time_s: float | None = None
    first_s: float | None = None
    obstacle_id: int | None = None

    @property
    def violated(self) -> bool:
        """Whether the run broke the rule."""
        return self.first_s is not None

    @property
    def degree(self) -> float:
        """By how much the rule is broken at worst; 0 where it is kept."""
        return -self.robustness if self.violated and self.robustness is not None else 0.0

    def in_words(self) -> str:
        """``R_G1 safe distance by 12.3 m at 2.0 s (from 1.2 s on, obstacle 42)``."""
        more = [f"from {self.first_s:.1f} s on"] if self.first_s != self.time_s else []
        more += [f"obstacle {self.obstacle_id}"] if self.obstacle_id is not None else []
        told = f" ({', '.join(more)})" if more else ""
        return f"{self.rule} {self.name} by {measured(self.degree)} {self.unit} at {self.time_s:.1f} s{told}"


def ending(outcome: Outcome, reason: str, review: RunReview | None = None, *, contact: Contact | None = None) -> str:
    """How a run ended in one sentence, its moment included; a collision by who hit whom."""
    hit = contact if review is None else review.contact
    if hit is not None:
        return f"{outcome.replace('_', ' ')}: {hit.in_words()}"
    return reason if outcome == "goal_reached" else f"{outcome.replace('_', ' ')}: {reason}"


class Lineage(Model):
    """Where an edited scenario comes from: its ancestors, the nearest first, and its edits in order, a line each."""

    scenario_id: str
    ancestors: tuple[str, ...]
    edits: tuple[str, ...]

    @property
    def root(self) -> str:
        """The scenario that was never edited."""
        return self.ancestors[-1] if self.ancestors else self.scenario_id


class ScenarioSource(Model):
    """A scenario, the CommonRoad file that holds it, and of what is known of it what decides how hard it is.

    ``obstacles``: by type; ``density_per_km``: recorded vehicles per kilometre of lanelets; ``road``: the kind of road
    by the file's tags, such as ``highway``, empty where they say none; ``limit_kmh``: the highest speed limit on the
    ego's lanelets, None where none is posted.
    """

    scenario_id: str
    path: str
    obstacles: dict[str, int] | None = None
    density_per_km: float | None = None
    road: str = ""
    limit_kmh: float | None = None


class RunLook(Model):
    """What one look at a run's steps and scenario gives, as it is kept beside the run: its moments, and about its goal.

    ``out_of_reach``: whether no ego could be there in time; ``trivial``: why the goal asked for no driving, empty if it
    did.
    """

    VERSION: ClassVar[int] = 3
    """Of the rules that decide; what is kept of another version is not read."""

    review: RunReview
    out_of_reach: bool = False
    trivial: str = ""


class LooksResponse(Model):
    """A look at each run, in the order of the request."""

    looks: tuple[RunLook, ...]


class RunSource(Model):
    """A run's record, the file with its steps (None: only the record is at hand), and the look at it, if it is kept."""

    record: RunRecord
    steps_path: str | None = None
    look: RunLook | None = None


def drawn(records: Iterable[RunRecord]) -> list[RunRecord]:
    """Return the runs in a random order that depends only on their ids; the first n are a random sample."""
    return sorted(records, key=lambda record: drawn_place(record.run_id))


def drawn_place(name: str) -> bytes:
    """Return where a name stands in a random order that depends on nothing but the names."""
    return hashlib.sha256(name.encode()).digest()


CRITICAL_GAP_M = 0.5
"""Gap between rectangles below which a run was close (chosen)."""
CRITICAL_TIME_TO_COLLISION_S = 1.5
"""Encounters below it are critical (van der Horst and Hogema 1993, "Time-to-collision and collision avoidance")."""


def is_close(record: RunRecord) -> bool:
    """Return whether another came critically close in a run, in space or in time."""
    if record.metrics is None:
        return False
    gap, time = record.metrics.minimum_distance_m, record.metrics.minimum_time_to_collision_s
    return (gap is not None and gap < CRITICAL_GAP_M) or (time is not None and time < CRITICAL_TIME_TO_COLLISION_S)


def is_worth_a_look(record: RunRecord) -> bool:
    """Return whether an analysis needs the moments of a run: it failed on its way, or was a close success."""
    return record.outcome != "invalid" and (record.outcome != "goal_reached" or is_close(record))


class ReviewRequest(Model):
    """Which runs to look at, and the files of their scenarios."""

    runs: tuple[RunSource, ...]
    scenarios: tuple[ScenarioSource, ...]


class ReviewResponse(Model):
    """The decisive moments of each run, in the order of the request."""

    reviews: tuple[RunReview, ...]


class LostCell(Model):
    """A cell of a batch that gave no run: an error of ours or a broken file, never a planner's failure."""

    scenario_id: str
    config_id: str
    error: str = Field(description="what went wrong")


class BatchRecord(Model):
    """A grid of runs: scenarios × configurations under one prediction and traffic mode."""

    batch_id: str
    scenarios: tuple[str, ...]
    configs: tuple[str, ...]
    prediction: Prediction
    traffic: Traffic
    runs: tuple[str, ...]
    lost: tuple[LostCell, ...]
