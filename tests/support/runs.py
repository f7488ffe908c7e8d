"""Handmade runs: records and step files, for tests of analysis and pictures."""

import math
from pathlib import Path

from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.results import ConfigWeights
from plannerforge.schemas.runs import CollisionRecord, DrivenObstacle, Outcome, RunRecord, RunSource, RunSteps

DEFAULT = ConfigWeights(
    config_id="cfg_a",
    name="frenetix:Default",
    planner="frenetix",
    weights={"prediction": 0.2, "velocity_offset": 1.0, "distance_to_obstacles": 0.0, "lateral_jerk": 0.2},
)
SAFE = ConfigWeights(
    config_id="cfg_b",
    name="frenetix:Safe",
    planner="frenetix",
    weights={"prediction": 0.5, "velocity_offset": 1.0, "distance_to_obstacles": 1.0, "lateral_jerk": 0.2},
)


def metrics(**changes: float | None) -> RunMetrics:
    """Return unremarkable metrics with some values changed."""
    values: dict[str, float | None] = {
        "duration_s": 5.0,
        "distance_m": 50.0,
        "mean_speed_mps": 10.0,
        "minimum_distance_m": 2.0,
        "minimum_time_to_collision_s": 4.0,
        "minimum_time_headway_s": 2.0,
        "minimum_time_gap_s": 1.6,
        "risk_score": 3,
        "maximum_jerk_mps3": 2.0,
        "mean_squared_jerk": 1.0,
        "maximum_planar_jerk_mps3": 2.5,
        "maximum_braking_mps2": 1.5,
        "maximum_steering_rate_radps": 0.1,
        "maximum_lateral_acceleration_mps2": 1.0,
        "mean_total_cost": 3.0,
    }
    return RunMetrics.model_validate(values | changes)


def record(
    scenario_id: str = "ZAM_Town-1_1_T-1",
    outcome: Outcome = "goal_reached",
    config: ConfigWeights = DEFAULT,
    *,
    obstacle_id: int | None = None,
    rejected: dict[str, int] | None = None,
    figures: RunMetrics | None = None,
    prediction: str = "constant_velocity",
    seed: int = 0,
) -> RunRecord:
    """Return a run with these facts; a collision is at step 40."""
    collision = None
    if outcome == "collision":
        collision = CollisionRecord(obstacle_id=obstacle_id or 1, kind="car", step=40, time_s=4.0)
    return RunRecord(
        run_id=f"run_{config.config_id}_{scenario_id}_{prediction}_{seed}",
        scenario_id=scenario_id,
        problem_id=100,
        config_id=config.config_id,
        config_name=config.name,
        planner=config.planner,
        prediction=prediction,  # type: ignore[arg-type]
        traffic="recorded",
        seed=seed,
        step_s=0.1,
        outcome=outcome,
        reason=f"ended as {outcome}",
        success_rule="accepted@3",
        collision=collision,
        rejected_candidates=rejected or {},
        metrics=None if outcome == "invalid" else figures or metrics(),
    )


def driven(x_m: float, y_m: float, speed_mps: float, heading_rad: float = 0.0) -> DrivenObstacle:
    """Return a car that drives at constant speed for 41 steps from a place on."""
    steps = range(41)
    return DrivenObstacle(
        obstacle_id=7,
        kind="car",
        length_m=4.5,
        width_m=1.8,
        first_step=0,
        x_m=tuple(x_m + math.cos(heading_rad) * speed_mps * 0.1 * step for step in steps),
        y_m=tuple(y_m + math.sin(heading_rad) * speed_mps * 0.1 * step for step in steps),
        heading_rad=(heading_rad,) * 41,
        speed_mps=(speed_mps,) * 41,
    )


def source(
    run: RunRecord, folder: Path | None = None, others: tuple[DrivenObstacle, ...] = (), **costs: float
) -> RunSource:
    """Return the run with a file of 41 steps straight ahead at 10 m/s, planned every third step at these constant
    costs.
    """
    if folder is None:
        return RunSource(record=run)
    planned = tuple(range(0, 41, 3))
    steps = RunSteps(
        first_step=0,
        x_m=tuple(40.0 + step for step in range(41)),
        y_m=(0.0,) * 41,
        heading_rad=(0.0,) * 41,
        speed_mps=(10.0,) * 41,
        acceleration_mps2=(0.0,) * 41,
        plan_steps=planned,
        costs={term: (value,) * len(planned) for term, value in costs.items()},
        others=others,
    )
    path = folder / f"{run.run_id}.json"
    path.write_text(steps.model_dump_json(), encoding="utf-8")
    return RunSource(record=run, steps_path=str(path))
