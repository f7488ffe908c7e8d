"""What one planner run on one scenario gives: the record that analysis, comparison and pictures read."""

from typing import Literal

from pydantic import Field

from .base import Model

Outcome = Literal[
    "goal_reached",
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

``goal_early``, ``goal_late``: the ego was in the goal's place, but only before or after its time; ``goal_missed``: it
passed the goal or ended elsewhere, or was there in time without the goal's speed or heading; ``timeout``: it had not
come to the goal when 1.7 times the steps to the goal's last step were over; ``infeasible``: the planner found no
trajectory that the vehicle can drive; ``invalid``: the problem has no solution, which is stated before the run and is
never a planner's failure.
"""
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


class CollisionRecord(Model):
    """The first collision of a run: the obstacle (None: the road boundary), the step and the time."""

    obstacle_id: int | None
    kind: str
    step: int
    time_s: float


class RunMetrics(Model):
    """Figures of one run; None where the figure is not defined (no obstacle met, standing all the time)."""

    duration_s: float
    """From the first to the last driven state."""
    distance_m: float
    """Length of the driven path."""
    mean_speed_mps: float
    """Distance by duration."""
    minimum_distance_m: float | None = Field(description="smallest gap between the ego's and any obstacle's rectangle")
    minimum_time_to_collision_s: float | None
    """Smallest time to collision with any obstacle."""
    minimum_time_headway_s: float | None = Field(None, description="to the vehicle ahead in the ego's path")
    risk_score: int | None = Field(None, description="0 collision … 5 negligible; the most dangerous moment counts")
    maximum_jerk_mps3: float
    """Largest absolute change of the acceleration from step to step; the initial acceleration is left out."""
    mean_squared_jerk: float
    """Mean of its square over the steps, in m²/s⁶."""
    maximum_lateral_acceleration_mps2: float
    """Largest product of speed and yaw rate."""
    mean_total_cost: float | None
    """Mean weighted cost of the chosen candidates; None for planners without costs."""


class DrivenObstacle(Model):
    """An obstacle of reactive traffic as it really moved (centre, one entry a step); rounded to 0.1 mm."""

    obstacle_id: int
    kind: str
    length_m: float
    width_m: float
    first_step: int
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    speed_mps: tuple[float, ...]


class RunSteps(Model):
    """The driven trajectory (centre of the ego, one entry a step) and the cost terms of the chosen candidates.

    ``costs``: weighted cost term name → one value per planning step; ``plan_steps``: the steps at which was planned.
    ``rejected``: constraint → candidates it rejected, one value per planning step; one more where the last attempt,
    which is no planning step, gave no trajectory.
    ``others``: the obstacles that reactive traffic moved, instead of their recordings; the rest followed theirs.
    """

    first_step: int
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    speed_mps: tuple[float, ...]
    acceleration_mps2: tuple[float, ...]
    plan_steps: tuple[int, ...]
    costs: dict[str, tuple[float, ...]]
    rejected: dict[str, tuple[int, ...]] = Field(default_factory=dict)
    others: tuple[DrivenObstacle, ...] = ()


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
    step_s: float
    outcome: Outcome
    reason: str = Field(description="one sentence: what ended the run, with figures")
    invalid_reason: InvalidReason | None = Field(None, description="stable code, only where the outcome is invalid")
    collision: CollisionRecord | None
    off_the_lanes: tuple[int, ...] = Field((), description="lane prediction: obstacles predicted straight on")
    on_recording: tuple[int, ...] = Field((), description="reactive traffic: obstacles that SUMO could not drive")
    eased_over_m: float | None = Field(
        None, description="metres of a curve onto the route, where the start allows no way along its centre"
    )
    rejected_candidates: dict[str, int] = Field(description="constraint → candidates it rejected, over the whole run")
    metrics: RunMetrics | None
    ego_length_m: float = 4.508
    ego_width_m: float = 1.61


class LostCell(Model):
    """A cell of a batch that gave no run: an error of ours or a broken file, never a planner's failure."""

    scenario_id: str
    config_id: str
    error: str


class BatchRecord(Model):
    """A grid of runs: scenarios × configurations under one prediction and traffic mode."""

    batch_id: str
    scenarios: tuple[str, ...]
    configs: tuple[str, ...]
    prediction: Prediction
    traffic: Traffic
    runs: tuple[str, ...]
    lost: tuple[LostCell, ...]
