"""Planners and their configurations: arguments and results of list_planners, configure_planner and run_planner."""

from pydantic import Field

from plannerforge.schemas.base import Model
from plannerforge.schemas.runs import Prediction, RunRecord, RunSteps, RunTiming, Traffic


class PlannerConfiguration(Model):
    """A planner with its cost weights; immutable, its id is made from its content.

    ``preset``: the preset it started from; ``base``: the configuration that ``assignments`` changed.
    """

    config_id: str
    planner: str
    name: str
    preset: str = Field(description="the preset whose values all weights had before the assignments")
    base: str | None = None
    assignments: tuple[str, ...] = ()
    weights: dict[str, float]
    external_weights: dict[str, float] = Field(default_factory=dict)


class RunRequest(Model):
    """One planner run, as a worker receives it."""

    run_id: str
    scenario_path: str
    scenario_id: str
    problem_id: int | None = Field(None, description="None: the first planning problem")
    configuration: PlannerConfiguration
    prediction: Prediction = "constant_velocity"
    traffic: Traffic = "recorded"
    seed: int = 0


class RunResponse(Model):
    """What a run gave: the record, the driven steps, and the measured times."""

    record: RunRecord
    steps: RunSteps
    timing: RunTiming


class WeightInfo(Model):
    """A cost weight: value in force, what it means, what raising it does, and whether it acts."""

    name: str
    value: float
    meaning: str
    raising: str
    acts: bool
    computed_by: str
