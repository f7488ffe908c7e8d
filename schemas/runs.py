"""What one planner run on one scenario gives: the record that analysis, comparison and pictures read."""

from typing import Literal

from pydantic import Field

from plannerforge.schemas.base import Model

Outcome = Literal["goal_reached", "collision", "timeout", "infeasible", "off_road", "goal_missed", "invalid"]
"""``invalid``: the problem could not be attempted (a collision in its initial state); never a planner's failure."""

Prediction = Literal["constant_velocity", "ground_truth"]
Traffic = Literal["recorded"]


class CollisionRecord(Model):
    """The first collision of a run: with whom (None: the road boundary), at which step and time."""

    obstacle_id: int | None
    kind: str
    step: int
    time_s: float


class RunMetrics(Model):
    """Figures of one run; None where the figure is not defined (no obstacle met, standing all the time)."""

    duration_s: float
    distance_m: float
    mean_speed_mps: float
    minimum_distance_m: float | None = Field(description="smallest gap between the ego's and any obstacle's rectangle")
    minimum_time_to_collision_s: float | None
    maximum_jerk_mps3: float
    mean_squared_jerk: float
    maximum_lateral_acceleration_mps2: float
    mean_total_cost: float | None


class RunSteps(Model):
    """The driven trajectory (centre of the ego, one entry a step) and the cost terms of the chosen candidates.

    ``costs``: weighted cost term name → one value per planning step; ``plan_steps``: the steps at which was planned.
    """

    first_step: int
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    speed_mps: tuple[float, ...]
    acceleration_mps2: tuple[float, ...]
    plan_steps: tuple[int, ...]
    costs: dict[str, tuple[float, ...]]


class RunTiming(Model):
    """Measured times; kept beside the record, never part of the reproducible payload."""

    wall_s: float
    planning_step_median_ms: float


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
    collision: CollisionRecord | None
    rejected_candidates: dict[str, int] = Field(description="constraint → candidates it rejected, over the whole run")
    metrics: RunMetrics | None


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
