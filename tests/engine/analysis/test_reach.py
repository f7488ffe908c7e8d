"""Goals that nothing reaches in time: told of every form of a goal's place, and only where it is certain."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle, Shape, ShapeGroup
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.state import CustomState, InitialState
from support.runs import record

from plannerforge.engine.analysis.reach import cannot_be_reached
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.runs import RunSource, ScenarioSource


def place(away_m: float) -> Rectangle:
    return Rectangle(10.0, 4.0, center=np.array([away_m, 0.0]))


@pytest.mark.parametrize(
    ("where", "told"),
    [
        (place(200.0), True),
        (place(40.0), False),
        (ShapeGroup([place(200.0), place(220.0)]), True),
        (ShapeGroup([place(40.0), place(220.0)]), False),
        (None, False),
    ],
    ids=["far", "near", "lanelets far", "one lanelet near", "no place"],
)
def test_a_goal_too_far_for_its_time_is_reported(
    where: Shape | None, told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = InitialState(
        time_step=0,
        position=np.zeros(2),
        orientation=0.0,
        velocity=10.0,
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    asked = CustomState(time_step=Interval(0, 40))
    if where is not None:
        asked = CustomState(time_step=Interval(0, 40), position=where)
    problem = PlanningProblem(100, start, GoalRegion([asked]))
    recording = SimpleNamespace(loaded=SimpleNamespace(problem=lambda _: problem))
    monkeypatch.setattr("plannerforge.engine.analysis.reach.kept_recording", lambda _: recording)
    file = tmp_path / "scenario.xml"
    file.touch()
    late = record(outcome="timeout")
    known = ScenarioSource(scenario_id=late.scenario_id, path=str(file), limit_kmh=50.0)
    assert cannot_be_reached(RunSet((RunSource(record=late),), scenarios=(known,)), late) is told


def test_a_problem_missing_from_the_file_refuses_no_analysis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def problem(number: int) -> PlanningProblem:
        raise UnknownName(f"no planning problem {number}")

    recording = SimpleNamespace(loaded=SimpleNamespace(problem=problem))
    monkeypatch.setattr("plannerforge.engine.analysis.reach.kept_recording", lambda _: recording)
    file = tmp_path / "scenario.xml"
    file.touch()
    late = record(outcome="timeout")
    known = ScenarioSource(scenario_id=late.scenario_id, path=str(file), limit_kmh=50.0)
    assert not cannot_be_reached(RunSet((RunSource(record=late),), scenarios=(known,)), late)
