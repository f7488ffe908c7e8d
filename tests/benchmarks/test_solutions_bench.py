"""The benches of solutions and recorded collisions: their judges tell what can be driven, and who hit whom."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("Polygon", reason="CommonRoad's checker needs Polygon3, which is built where there is a compiler")

from commonroad.common.solution import CommonRoadSolutionReader
from support.builders import Problem, town_road
from support.planning import configuration
from support.runs import record

from benchmarks.analysis.recorded import Hit, corners, kind_of, overlap
from benchmarks.analysis.recorded_drivers import prevented_by
from benchmarks.analysis.solutions import judged, steering_share
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.driving.solution import solution_xml
from plannerforge.engine.planners.runs import run_planner
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import RunSteps

STEPS = 41


def driven(speed_mps: float, heading_rad: tuple[float, ...] | None = None) -> RunSteps:
    """Straight on along x, whatever the headings say."""
    return RunSteps(
        first_step=0,
        x_m=tuple(0.1 * speed_mps * step for step in range(STEPS)),
        y_m=(0.0,) * STEPS,
        heading_rad=heading_rad or (0.0,) * STEPS,
        speed_mps=(speed_mps,) * STEPS,
        acceleration_mps2=(0.0,) * STEPS,
        plan_steps=(),
        costs={},
    )


def test_the_judge_accepts_a_drive_and_refuses_one_that_wheels_cannot_make(tmp_path: Path) -> None:
    near = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))
    path = replace(town_road(), problems=(near,)).with_vehicles().write(tmp_path / "scenario.xml")
    scenario = read_scenario(path).scenario
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=str(scenario.scenario_id),
        configuration=configuration("idm:Default"),
        prediction="constant_velocity",
    )
    response = run_planner(request, silent)
    assert response.record.beyond_vehicle == ()

    def verdict(steps: RunSteps) -> str:
        text = solution_xml(
            steps, 0.1, scenario_id=scenario.scenario_id, problem_id=100, vehicle_id=2, cost_function="SM1"
        )
        (tmp_path / "solution.xml").write_text(text, encoding="utf-8")
        return judged(response.record, path, tmp_path / "solution.xml").verdict

    assert verdict(response.steps) == "valid"
    jumping = [y + (0.3 if index > 20 else 0.0) for index, y in enumerate(response.steps.y_m)]
    assert verdict(response.steps.model_copy(update={"y_m": tuple(jumping)})) == "infeasible"


def test_the_steering_of_a_file_is_a_share_of_the_vehicles_limit(tmp_path: Path) -> None:
    scenario = read_scenario(town_road().write(tmp_path / "scenario.xml")).scenario
    turns = np.cumsum(np.where(np.arange(STEPS) > 20, 0.02, 0.0))
    text = solution_xml(
        driven(5.0, tuple(turns.tolist())),
        0.1,
        scenario_id=scenario.scenario_id,
        problem_id=100,
        vehicle_id=2,
        cost_function="SM1",
    )
    path = tmp_path / "solution.xml"
    path.write_text(text, encoding="utf-8")
    angle = math.atan(2.5789 * 0.02 / 0.5)
    assert steering_share(CommonRoadSolutionReader.open(str(path)), 0.1) == pytest.approx(
        angle / 2 / 0.1 / 0.4, rel=0.01
    )


def hit_by(start: tuple[float, float], speed_mps: float, ego_mps: float, heading_rad: float = 0.0) -> Hit:
    """The ego straight on, and one that goes evenly from a place; the contact is their first overlap."""
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])

    def state_at_time(step: int) -> SimpleNamespace:
        return SimpleNamespace(
            position=np.array(start) + along * 0.1 * speed_mps * step, orientation=heading_rad, velocity=speed_mps
        )

    other = SimpleNamespace(obstacle_shape=SimpleNamespace(length=4.5, width=1.8), state_at_time=state_at_time)
    hit = Hit(record(outcome="collision"), driven(ego_mps), other, STEPS - 1)
    for index in range(STEPS):
        pose = hit.other(index)
        assert pose is not None
        boxes = corners(hit.own(index), hit.own_size), corners(pose, hit.size)
        if overlap(*boxes, (0.0, heading_rad)):
            return replace(hit, step=index)
    raise AssertionError("they do not touch")


@pytest.mark.parametrize(
    ("hit", "kind", "preventable"),
    [
        (hit_by((-20.0, 0.0), 12.0, 5.0), "rear_end_by_other", False),
        (hit_by((30.0, 0.0), 2.0, 12.0), "rear_end_by_ego", True),
        (hit_by((30.0, 0.5), 0.0, 12.0), "into_standing", True),
        (hit_by((-20.0, 0.0), 8.0, 0.0), "onto_standing_ego", False),
        (hit_by((40.0, 0.3), 5.0, 10.0, math.pi), "oncoming", False),
        (hit_by((20.0, -20.0), 10.0, 10.0, math.pi / 2), "crossing", True),
    ],
    ids=["follower", "leader", "standing", "onto the ego", "oncoming", "crossing"],
)
def test_recorded_collisions_are_classed_and_tried(hit: Hit, kind: str, preventable: bool) -> None:
    assert kind_of(hit) == kind
    assert prevented_by(hit, "full_braking") is preventable
