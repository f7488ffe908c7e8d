"""What the bench says about a collision: who ran into whom."""

import math

import numpy as np
import pytest

from benchmarks.planners.failure_causes import cause, meeting, rejections
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.schemas.runs import RunRecord, RunSteps


def run(**changes: object) -> RunRecord:
    content = {
        "run_id": "run_1",
        "scenario_id": "ZAM_Builder-1_1_T-1",
        "problem_id": 100,
        "config_id": "cfg_1",
        "config_name": "frenetix:Default",
        "planner": "frenetix",
        "prediction": "ground_truth",
        "traffic": "recorded",
        "seed": 0,
        "step_s": 0.1,
        "outcome": "timeout",
        "reason": "ran out of time",
        "collision": None,
        "rejected_candidates": {"yaw_rate": 3, "collision": 40, "road_edge": 8},
        "metrics": None,
    }
    return RunRecord.model_validate(content | changes)


def ego(speed_mps: float) -> RunSteps:
    """An ego at the origin, heading along x."""
    zero = (0.0, 0.0)
    speeds = (speed_mps, speed_mps)
    return RunSteps(
        first_step=0,
        x_m=zero,
        y_m=zero,
        heading_rad=zero,
        speed_mps=speeds,
        acceleration_mps2=zero,
        plan_steps=(0,),
        costs={},
    )


def other(x_m: float, y_m: float, heading_rad: float, speed_mps: float) -> Track:
    return Track(
        obstacle_id=7,
        kind="car",
        length_m=4.5,
        width_m=1.8,
        first_step=0,
        positions=np.array([[x_m, y_m]] * 2),
        headings_rad=np.array([heading_rad] * 2),
        speeds_mps=np.array([speed_mps] * 2),
    )


@pytest.mark.parametrize(
    ("speed_mps", "place", "told"),
    [
        (0.0, (-4.0, 0.3, 0.0, 8.0), "car 7 (8.0 m/s) ran into the standing ego from behind"),
        (9.0, (4.0, 0.3, 0.0, 2.0), "the ego (9.0 m/s) ran into car 7 (2.0 m/s)"),
        (9.0, (4.0, 0.3, 0.1, 0.0), "the ego (9.0 m/s) ran into the standing car 7"),
        (9.0, (0.4, 1.7, 0.0, 9.0), "the ego (9.0 m/s) and car 7 (9.0 m/s) touched side by side"),
        (9.0, (4.0, 0.5, math.pi, 9.0), "car 7 (9.0 m/s) came towards the ego (9.0 m/s)"),
        (9.0, (2.0, -2.0, math.pi / 2, 9.0), "car 7 (9.0 m/s) crossed the way of the ego (9.0 m/s)"),
        (0.0, (0.0, -3.0, math.pi / 2, 5.0), "car 7 (5.0 m/s) ran into the standing ego"),
    ],
)
def test_a_meeting_tells_which_vehicle_ran_into_which(
    speed_mps: float, place: tuple[float, float, float, float], told: str
) -> None:
    assert meeting(run(), ego(speed_mps), other(*place)) == told


def test_a_run_without_a_collision_is_reported_by_its_reason_and_its_standing_time(tmp_path: object) -> None:
    assert cause(run(), ego(0.0), tmp_path) == "ran out of time; the ego stood for 0.1 s"  # type: ignore[arg-type]
    assert cause(run(), ego(5.0), tmp_path) == "ran out of time"  # type: ignore[arg-type]


def test_the_constraints_that_rejected_most_come_first() -> None:
    assert rejections(run()) == "collision 40, road_edge 8"
    assert rejections(run(rejected_candidates={})) == "none"
