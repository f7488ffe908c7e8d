"""Solution files: the drivability checker reads them and judges collisions and the goal as our own loop does.

Its check of the road boundary needs a triangulation package that is not free, so ``valid_solution`` runs here with
that one part left out.
"""

import zipfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from builders import Problem, town_road
from builders_planning import configuration, parked_car
from commonroad.common.solution import CommonRoadSolutionReader, Solution
from commonroad_dc.feasibility import solution_checker

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.planners.run import run
from plannerforge.engine.planners.solution import steering_angles, write_solution
from plannerforge.engine.scenarios.reader import read_scenario
from plannerforge.engine.tuning.configurations import changed_configuration
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.exporting import SolutionRequest
from plannerforge.schemas.planning import RunRequest, RunResponse
from plannerforge.schemas.runs import RunSteps

NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))


def driven(
    path: Path, folder: Path, name: str = "frenetix:Default", settings: Sequence[str] = ()
) -> tuple[RunResponse, Path]:
    """A run of the first problem and its solution file."""
    config, _ = changed_configuration(configuration(name), None, (), settings)
    scenario_id = str(read_scenario(path).scenario.scenario_id)
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=scenario_id,
        configuration=config,
        prediction="ground_truth",
    )
    response = run(request, silent)
    steps = folder / "steps.json"
    steps.write_text(response.steps.model_dump_json())
    target = folder / "run_0.solution.xml"
    asked = SolutionRequest(
        record=response.record,
        configuration=config,
        scenario_path=str(path),
        steps_path=str(steps),
        target_path=str(target),
    )
    write_solution(asked, silent)
    return response, target


def starter(folder: Path, number: int) -> Path:
    """A file of the starter catalogue."""
    with zipfile.ZipFile(str(files("plannerforge.engine.catalog") / "starter.zip")) as archive:
        names = sorted(name for name in archive.namelist() if name.startswith("scenarios/") and name[-8:] != ".net.xml")
        path = folder / "starter.xml"
        path.write_bytes(archive.read(names[number]))
    return path


def judged(path: Path, solution: Solution, monkeypatch: pytest.MonkeyPatch) -> str:
    """How ``valid_solution`` judges: valid, infeasible, or the name of what it raises."""
    loaded = read_scenario(path)
    monkeypatch.setattr(solution_checker, "boundary_collision", lambda *_: False)
    try:
        valid, _ = solution_checker.valid_solution(loaded.scenario, loaded.planning_problems, solution)
    except solution_checker.SolutionCheckerException as refusal:
        return type(refusal).__name__
    return "valid" if valid else "infeasible"


def test_a_run_to_the_goal_on_a_built_road_is_a_valid_solution(tmp_path: Path, monkeypatch: Any) -> None:
    path = replace(town_road(), problems=(NEAR,)).write(tmp_path / "scenario.xml")
    response, target = driven(path, tmp_path)
    assert response.record.outcome == "goal_reached"
    solution = CommonRoadSolutionReader.open(str(target))
    assert solution.benchmark_id == "KS2:SM1:ZAM_Builder-1_1_T-1:2020a"
    assert judged(path, solution, monkeypatch) == "valid"


@pytest.mark.parametrize("number", [0, 5, 10])
def test_the_checker_agrees_on_starter_scenarios(number: int, tmp_path: Path, monkeypatch: Any) -> None:
    path = starter(tmp_path, number)
    response, target = driven(path, tmp_path)
    verdict = judged(path, CommonRoadSolutionReader.open(str(target)), monkeypatch)
    expected = {
        "goal_reached": ("valid", "infeasible"),  # a driven path may steer a little faster than the checker allows
        "collision": ("CollisionException", "GoalNotReachedException"),
    }
    assert verdict in expected.get(response.record.outcome, ("GoalNotReachedException",))


def test_the_checker_sees_a_car_in_the_way_where_the_run_ended(tmp_path: Path) -> None:
    """It places the ego where our loop did: a car at the end of the run is hit, none before."""
    path = replace(town_road(), problems=(NEAR,)).write(tmp_path / "scenario.xml")
    response, target = driven(path, tmp_path)
    loaded = read_scenario(path)
    given = (loaded.scenario, loaded.planning_problems, CommonRoadSolutionReader.open(str(target)))
    assert not solution_checker.obstacle_collision(*given)
    loaded.scenario.add_objects(parked_car(999, (response.steps.x_m[-1], response.steps.y_m[-1])))
    with pytest.raises(solution_checker.CollisionException):
        solution_checker.obstacle_collision(*given)


def test_the_same_run_gives_the_same_bytes_without_a_date(tmp_path: Path) -> None:
    path = replace(town_road(), problems=(NEAR,)).write(tmp_path / "scenario.xml")
    first = driven(path, tmp_path)[1].read_bytes()
    assert driven(path, tmp_path)[1].read_bytes() == first
    assert b"date" not in first
    assert b"processor" not in first


def test_steering_follows_the_curvature_and_rests_at_a_stand() -> None:
    """A circle of 20 m: tan(steering) = wheelbase / radius; then the ego stands with the wheels as they were."""
    count, step_s, radius_m, speed = 30, 0.1, 20.0, 5.0
    headings = [speed / radius_m * step_s * index for index in range(count)]
    steps = RunSteps(
        first_step=0,
        x_m=(0.0,) * (count + 5),
        y_m=(0.0,) * (count + 5),
        heading_rad=(*headings, *[headings[-1]] * 5),
        speed_mps=(speed,) * count + (0.0,) * 5,
        acceleration_mps2=(0.0,) * (count + 5),
        plan_steps=(0,),
        costs={},
    )
    angles = steering_angles(steps, step_s, 2.579, 1.066)
    assert len(angles) == count + 5
    assert angles[: count - 1] == pytest.approx(0.12825, abs=1e-4)
    assert angles[-1] == angles[-2]


def test_the_solution_names_the_vehicle_of_the_configuration(tmp_path: Path) -> None:
    path = tmp_path / "town.xml"
    replace(town_road(), problems=(NEAR,)).write(path)
    for vehicle in (1, 4):
        _, target = driven(path, tmp_path, settings=[f"vehicle={vehicle}"])
        solved = CommonRoadSolutionReader.open(str(target)).planning_problem_solutions[0]
        assert solved.vehicle_type.value == vehicle
    with pytest.raises(NotPossible, match="has its own"):
        driven(path, tmp_path, settings=["length_m=5"])
