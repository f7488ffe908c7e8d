"""What one planner run on one scenario gives: the record that analysis, comparison and pictures read."""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

from pydantic import Field

from .base import Model
from .measures import RunMetrics
from .reviews import Contact, RunLook, RunReview
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
    ``steering_rad``: the steering angles of a vehicle that followed its plans; empty if a planner's states were
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
        """Return ``steering rate 0.75 rad/s at 2.3 s (limit 0.4)``."""
        if self.name == "rolling":
            return f"wheels that slide in {100 * self.value:.0f} % of the steps, from {self.time_s:.1f} s on"
        return f"{self.name} {measured(self.value)} {self.unit} at {self.time_s:.1f} s (limit {measured(self.limit)})"


def excesses_in_words(excesses: Sequence[LimitExcess]) -> str:
    """Return what of a driven motion its vehicle cannot do, and what that means for the run."""
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


def ending(outcome: Outcome, reason: str, review: RunReview | None = None, *, contact: Contact | None = None) -> str:
    """Return how a run ended in one sentence, its moment included; a collision by who hit whom."""
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
    by the file's tags, such as ``highway``, empty if they say none; ``limit_kmh``: the highest speed limit on the
    ego's lanelets, None if none is posted.
    """

    scenario_id: str
    path: str
    obstacles: dict[str, int] | None = None
    density_per_km: float | None = None
    road: str = ""
    limit_kmh: float | None = None


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
