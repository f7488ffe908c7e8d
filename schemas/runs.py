"""The record of one planner run on one scenario, which analysis, comparison and pictures read."""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

from pydantic import Field

from .base import Model
from .measures import RunMetrics
from .reviews import Contact, RunLook, RunReview
from .text import measured
from .vocabulary import LEAST_FRICTION, MOST_FRICTION
from .worlds import PERFECT, Perceived, World

Bounded = Annotated[float, Field(ge=-1e12, le=1e12)]
"""A number of a motion, bounded so that no derivative or square overflows.

The bound exceeds every limit of a scenario file (docs/limits.md). The square of its third derivative over steps of 1 ms
is 1e42. Runs of an archive and answers of a planner program may contain any number."""
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

- ``goal_reached``: at the goal, by a motion that CommonRoad's benchmark accepts (``SuccessRule``)
- ``goal_refused``: at the goal, by a motion that the benchmark refuses (``Refusal``)
- ``goal_early``, ``goal_late``: at the goal's position, but only before or after its time
- ``goal_missed``: passed the goal, ended elsewhere, or arrived in time without the goal's speed or heading
- ``timeout``: not at the goal after 1.7 times the steps to the goal's last step
- ``infeasible``: the planner found no trajectory that the vehicle can drive
- ``invalid``: the problem has no solution. This is stated before the run and is never the planner's failure."""
SuccessRule = Literal["driven@1", "accepted@2", "accepted@3"]
"""What makes a reached goal a success.

``driven@1`` requires nothing else, as in the paper. ``accepted@2`` requires that ``valid_solution``, the checker of
CommonRoad's benchmark, accepts the driven motion. Otherwise the outcome is ``goal_refused``. For ``accepted@3``, an
initial state outside the lanelets, which no planner can change, does not count against the motion."""
Refusal = Literal["goal_not_met", "off_lanelets", "not_drivable"]
"""Why CommonRoad's benchmark refuses a motion that reached its goal.

- ``goal_not_met``: no state meets the goal as the benchmark reads it
- ``off_lanelets``: a part of the body is outside the lanelets, for example beyond the end of the map or in a gap
- ``not_drivable``: no acceleration and steering lead from one state to the next
"""
AT_GOAL: tuple[Outcome, ...] = ("goal_reached", "goal_refused")
"""Outcomes that count as reached by the paper's rule."""
NO_TRAJECTORY: tuple[Outcome, ...] = ("invalid", "infeasible")
"""Outcomes without a motion: the problem is invalid, or the planner found no trajectory."""
InvalidReason = Literal[
    "no_goal_state", "initial_collision", "ego_off_road", "ego_against_route", "goal_unreachable", "goal_out_of_time"
]
"""Why a problem is invalid.

- ``ego_against_route``: the ego starts with its heading more than 90° off the route to its goal
- ``goal_unreachable``: the lanelet graph has no route, or the goal is behind the ego and no route leads back
- ``goal_out_of_time``: even the vehicle's largest acceleration does not bring the ego there in time"""
Prediction = Literal["constant_velocity", "growing_covariance", "lane", "ground_truth"]
Traffic = Literal["recorded", "reactive"]
"""``reactive``: SUMO drives the others, so they react to the ego. ``recorded``: they follow their recording."""


VERSION_MARK = "@"
"""Separates a configuration's id from the digest of its planner's version, if results cover several versions."""


def configuration_id(versioned_id: str) -> str:
    """Return the id of a configuration without its planner's version: ``cfg_1`` for ``cfg_1@d4e5f6a``."""
    return versioned_id.partition(VERSION_MARK)[0]


class CollisionRecord(Model):
    """The first collision of a run. An ``obstacle_id`` of None means the road boundary."""

    obstacle_id: int | None
    kind: str
    step: int
    time_s: float


class DrivenObstacle(Model):
    """The real motion of an obstacle in reactive traffic (centre, one entry per time step, rounded to 0.1 mm)."""

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
    """The driven trajectory (centre of the ego, one entry per time step) and the costs of the chosen candidates.

    - ``costs``: weighted cost term → one value per planning step
    - ``plan_steps``: the time steps at which the planner planned
    - ``rejected``: constraint → candidates that it rejected, one value per planning step. If the last attempt gave no
      trajectory, it does not count as a planning step and adds one more value.
    - ``steering_rad``: steering angles of a vehicle that followed its plans; empty if the planner's states were used as
      they are
    - ``others``: obstacles that reactive traffic moved instead of their recordings; the rest followed their recordings
    - ``perceived``: what the planner received about the other road users in an imperfect world; None if it was perfect
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
    perceived: Perceived | None = Field(None, exclude_if=lambda perceived: perceived is None)


MOST_DEBUG_VALUES, MOST_DEBUG_POLYGONS, MOST_DEBUG_POINTS = 32, 8, 100
"""The number of debug values, polygons, and points per polygon that a planning step may report.

A hundred planning steps with all of them take 1.2 MB (``tests/engine/planners/test_series.py``)."""
MOST_DEBUG_POINTS_A_RUN = 20_000
"""The number of polygon points that are stored with a run."""


class DebugPolygon(Model):
    """An outline that a planner reported at a planning step."""

    step: int
    name: str
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]


class RunSeries(Model):
    """Time series of a run in addition to its motion, stored in a separate file.

    There is one value per driven state for ``lateral_offset_m`` from the reference path (left positive),
    ``heading_error_rad`` relative to its direction, and the ``steering_rad`` that the motion requires. There is one
    value per planning step (``plan_steps`` of the run's steps) for ``desired_speed_mps``, ``desired_speed_reasons`` and
    the values that the planner reported by name: ``numbers`` (None if it reported no finite number) and ``texts``
    (empty if it reported no text). ``left_out`` counts the debug values beyond the limits, which are not stored.
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
    """Measured times. They are stored next to the record and are not part of the reproducible payload.

    ``steps`` counts planning steps, including one without a trajectory, and ``planning_ms`` holds the time of each.
    ``core_step_median_ms`` is the part of a step in the planner's core, or None if it has no core.
    """

    wall_s: float
    planning_step_median_ms: float
    core_step_median_ms: float | None = None
    steps: int = 0
    planning_ms: tuple[float, ...] = ()


class LimitExcess(Model):
    """A limit of the ego's vehicle that the driven motion exceeds, with the largest excess.

    ``friction`` combines longitudinal and lateral acceleration. ``rolling`` is the share of time steps, from ``time_s``
    on, in which the wheels would have to slide.
    """

    name: Literal["speed", "acceleration", "friction", "steering angle", "steering rate", "rolling"] = Field(
        description="the limit"
    )
    value: float = Field(description="the largest value, in `unit`")
    limit: float = Field(description="the limit itself, in `unit`")
    unit: str
    time_s: float = Field(description="time of the largest excess")

    def in_words(self) -> str:
        """Return text such as ``steering rate 0.75 rad/s at 2.3 s (limit 0.4)``."""
        if self.name == "rolling":
            return f"wheels would slide in {100 * self.value:.0f}% of the steps, from {self.time_s:.1f} s on"
        return f"{self.name} {measured(self.value)} {self.unit} at {self.time_s:.1f} s (limit {measured(self.limit)})"


def excesses_in_words(excesses: Sequence[LimitExcess]) -> str:
    """Return the limits that a driven motion exceeds, and the consequence for the run."""
    limits = "; ".join(excess.in_words() for excess in excesses)
    return f"the motion exceeds the vehicle's limits: {limits}; an exported solution may be refused"


class TriggerOutcome(Model):
    """The outcome of an edit's trigger in reactive traffic: whether it fired, and which motion it started.

    ``time_s`` counts from the start of the run and is None if the trigger never fired.
    """

    obstacle_id: int
    code: Literal["trigger_fired", "trigger_not_fired"] = Field(description="stable code")
    begins: Literal["speed_change", "lateral_motion", "speed_and_lateral", "setting_off"] = Field(
        description="the motion prescribed from then on"
    )
    trigger: str = Field(description="the condition on the ego, in words")
    time_s: float | None = Field(description="start of the motion; null if it never started")

    def in_words(self) -> str:
        """Return text on when the motion started, with the code and the trigger."""
        motion = f"{self.obstacle_id}'s {_BEGUN[self.begins]}"
        if self.time_s is None:
            return f"{motion} never started because its trigger did not fire ({self.code}): {self.trigger}"
        return f"{motion} started at {self.time_s:.1f} s when its trigger fired ({self.code}): {self.trigger}"


_BEGUN = {
    "speed_change": "change of speed",
    "lateral_motion": "lateral motion",
    "speed_and_lateral": "change of speed and lateral motion",
    "setting_off": "motion",
}


class RunRecord(Model):
    """The record of one planner on one planning problem: the outcome and the reason for it."""

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
    reason: str = Field(description="one sentence on what ended the run, with figures")
    invalid_reason: InvalidReason | None = Field(None, description="stable code, only if the outcome is invalid")
    collision: CollisionRecord | None
    off_the_lanes: tuple[int, ...] = Field(
        (), description="lane prediction: obstacles off the lanes, predicted straight ahead"
    )
    on_recording: tuple[int, ...] = Field((), description="reactive traffic: obstacles that SUMO could not drive")
    triggers: tuple[TriggerOutcome, ...] = Field(
        (),
        exclude_if=lambda triggers: not triggers,
        description="reactive traffic: triggers of prescribed motions, and whether they fired",
    )
    eased_over_m: float | None = Field(
        None, description="length of a curve onto the route, if the ego cannot follow the lane's centre from its start"
    )
    rejected_candidates: dict[str, int] = Field(description="constraint → candidates it rejected, over the whole run")
    metrics: RunMetrics | None
    success_rule: SuccessRule = Field("driven@1", description="the rule by which it was judged")
    refusal: Refusal | None = Field(
        None, description="stable code if the outcome is goal_refused; with goal_reached: of the start, which is given"
    )
    beyond_vehicle: tuple[LimitExcess, ...] | None = Field(
        None, description="limits of the vehicle that the driven motion exceeds; null: an older version made the run"
    )
    ego_length_m: float = Field(4.508, ge=0.001, le=1000)
    ego_width_m: float = Field(1.61, ge=0.001, le=1000)
    planner_version: str = Field(
        "", description="version of the planner: as declared or from git, with a digest; empty: not known"
    )
    planner_source: str = Field("", description="digest of the planner's source, which distinguishes versions")
    ego_class: str = Field(
        "car",
        exclude_if=lambda name: name == "car",
        description="class of the ego, from its scenario or from the vehicle that the configuration sets",
    )
    friction: float | None = Field(
        None,
        exclude_if=lambda friction: friction is None,
        ge=LEAST_FRICTION,
        le=MOST_FRICTION,
        description="coefficient of friction of the road, which limits the ego's accelerations; null: not stated",
    )
    uses_prediction: bool | None = Field(
        None, description="whether the planner plans on predictions of others; null: not stated"
    )
    world: World = Field(
        PERFECT,
        exclude_if=lambda world: world.is_perfect,
        description="what the planner's sensors missed and distorted; absent: nothing",
    )
    imported: bool = Field(
        False,
        exclude_if=lambda imported: not imported,
        description="imported from an archive, so its maker vouches for it",
    )


def ending(outcome: Outcome, reason: str, review: RunReview | None = None, *, contact: Contact | None = None) -> str:
    """Return how a run ended, and when, in one sentence; for a collision, who hit whom."""
    hit = contact if review is None else review.contact
    if hit is not None:
        return f"{outcome.replace('_', ' ')}: {hit.in_words()}"
    return reason if outcome == "goal_reached" else f"{outcome.replace('_', ' ')}: {reason}"


class Lineage(Model):
    """The origin of an edited scenario: its ancestors, nearest first, and its edits in order, one line each."""

    scenario_id: str
    ancestors: tuple[str, ...]
    edits: tuple[str, ...]

    @property
    def root(self) -> str:
        """The original scenario, which was never edited."""
        return self.ancestors[-1] if self.ancestors else self.scenario_id


class ScenarioSource(Model):
    """A scenario, its CommonRoad file, and the known facts that decide how hard it is.

    - ``obstacles``: counts by type
    - ``density_per_km``: recorded vehicles per kilometre of lanelets
    - ``road``: the kind of road from the file's tags, such as ``highway``; empty if no tag names one
    - ``limit_kmh``: the highest speed limit on the ego's lanelets; None if no limit is posted
    """

    scenario_id: str
    path: str
    obstacles: dict[str, int] | None = None
    density_per_km: float | None = None
    road: str = ""
    limit_kmh: float | None = None


class RunSource(Model):
    """A run's record, the file with its steps (None if only the record exists), and its stored look, if any."""

    record: RunRecord
    steps_path: str | None = None
    look: RunLook | None = None


def drawn(records: Iterable[RunRecord]) -> list[RunRecord]:
    """Return the runs in a random order that depends only on their ids, so the first n are a random sample."""
    return sorted(records, key=lambda record: drawn_place(record.run_id))


def drawn_place(name: str) -> bytes:
    """Return the sort key of a name in a random order that depends only on the names."""
    return hashlib.sha256(name.encode()).digest()


CRITICAL_GAP_M = 0.5
"""A smaller gap between the rectangles counts as close (chosen)."""
CRITICAL_TIME_TO_COLLISION_S = 1.5
"""A smaller value is critical (van der Horst and Hogema 1993, "Time-to-collision and collision avoidance")."""


def is_close(record: RunRecord) -> bool:
    """Return whether another road user came critically close in a run, in space or in time."""
    if record.metrics is None:
        return False
    gap, time = record.metrics.minimum_distance_m, record.metrics.minimum_time_to_collision_s
    return (gap is not None and gap < CRITICAL_GAP_M) or (time is not None and time < CRITICAL_TIME_TO_COLLISION_S)


def is_worth_a_look(record: RunRecord) -> bool:
    """Return whether an analysis needs the key moments of a run: it failed after its start, or barely succeeded."""
    return record.outcome != "invalid" and (record.outcome != "goal_reached" or is_close(record))


class ReviewRequest(Model):
    """The runs to review, and the files of their scenarios; ``with_rules``: also judge them by the traffic rules."""

    runs: tuple[RunSource, ...]
    scenarios: tuple[ScenarioSource, ...]
    with_rules: bool = False


class LostCell(Model):
    """A cell of a batch without a run because of an internal error or a broken file, never a planner's failure."""

    scenario_id: str
    config_id: str
    error: str = Field(description="what went wrong")


class BatchRecord(Model):
    """A grid of runs: scenarios × configurations with one prediction, traffic mode and world."""

    batch_id: str
    scenarios: tuple[str, ...]
    configs: tuple[str, ...]
    prediction: Prediction
    traffic: Traffic
    runs: tuple[str, ...]
    lost: tuple[LostCell, ...]
    world: World = Field(PERFECT, exclude_if=lambda world: world.is_perfect)
