"""Solution files: CommonRoad's drivability checker reads them and judges as our own loop did, on real scenarios too.

Its ``valid_solution`` runs whole: start, goal, obstacles, edge of the road, and whether the kinematic single-track
vehicle can drive every step. Only the edge is built of the checker's own rectangles, since its triangles need a package
that is not free.
"""

import math
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("Polygon", reason="CommonRoad's checker needs Polygon3, which is built where there is a compiler")

from commonroad.common.solution import CommonRoadSolutionReader, Solution
from commonroad_dc import pycrcc
from commonroad_dc.boundary.boundary import create_road_boundary_obstacle
from commonroad_dc.feasibility import solution_checker
from support.builders import Problem, town_road
from support.planning import as_planned, configuration, parked_car

from plannerforge.engine.commonroad.reader import LoadedScenario, read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.driving.solution import mean_steering_angles, solution_xml, write_solution
from plannerforge.engine.planners.frenetix import core as frenet_frame
from plannerforge.engine.planners.frenetix import planner as frenetix
from plannerforge.engine.planners.interface import Observation, Plan, PlannedTrajectory, PlanningTask
from plannerforge.engine.planners.runs import run_planner, run_steps
from plannerforge.engine.planners.simulation import simulate
from plannerforge.engine.tuning.configurations import changed_configuration
from plannerforge.schemas.artifacts import SolutionRequest
from plannerforge.schemas.errors import NotPossible
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
    response = run_planner(request, silent)
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


def road_boundary(scenario: Any) -> pycrcc.CollisionChecker:
    """The edge of the road by the checker's own rectangles."""
    checker = pycrcc.CollisionChecker()
    _, rectangles = create_road_boundary_obstacle(scenario, method="obb_rectangles")
    checker.add_collision_object(rectangles)
    return checker


def judged(loaded: LoadedScenario, solution: Solution, monkeypatch: pytest.MonkeyPatch) -> str:
    """How ``valid_solution`` judges: valid, infeasible, or the name of what it raises."""
    monkeypatch.setattr(solution_checker, "_construct_boundary_checker", road_boundary)
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
    assert judged(read_scenario(path), solution, monkeypatch) == "valid"


@pytest.mark.parametrize("number", [5, 10])
def test_the_checker_agrees_on_starter_scenarios(number: int, tmp_path: Path, monkeypatch: Any) -> None:
    path = starter(tmp_path, number)
    response, target = driven(path, tmp_path)
    verdict = judged(read_scenario(path), CommonRoadSolutionReader.open(str(target)), monkeypatch)
    expected = {"goal_reached": "valid"}
    assert verdict == expected.get(response.record.outcome, "GoalNotReachedException")


@pytest.mark.shared_data
@pytest.mark.parametrize(
    "name",
    [
        "BEL_Antwerp-40_6_T-1",  # a turn at a junction
        "DEU_Ibbenbueren-16_5_T-1",  # a turn from the first step on
        "DEU_Lohmar-61_1_T-1",  # from 18 m/s into a corner of 5 m: the tyres are used up
        "ITA_CarpiCentro-3_1_T-1",  # begins below the planner's low speed
        "USA_US101-3_3_T-1",  # a recorded motorway, dense
    ],
)
def test_a_run_to_the_goal_on_a_real_road_is_a_valid_solution(
    name: str, shared_data: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    path = shared_data / "data" / "commonroad" / f"{name}.xml"
    response, target = driven(path, tmp_path)
    assert response.record.outcome == "goal_reached"
    assert judged(read_scenario(path), CommonRoadSolutionReader.open(str(target)), monkeypatch) == "valid"


@pytest.mark.shared_data
@pytest.mark.parametrize(
    "name",
    [
        "CHN_Qingdao-12_4_T-1",  # begins in a tight bend
        "DEU_BadWaldsee-1_1_T-1",  # slow
        "DEU_Lohmar-55_1_T-1",  # turns by 2.6 rad
    ],
)
def test_a_run_of_the_lane_follower_through_a_curve_is_a_valid_solution(
    name: str, shared_data: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    path = shared_data / "data" / "commonroad" / f"{name}.xml"
    response, target = driven(path, tmp_path, "idm")
    assert response.record.outcome == "goal_reached"
    assert judged(read_scenario(path), CommonRoadSolutionReader.open(str(target)), monkeypatch) == "valid"


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("module", "cure", "turned_off"),
    [(frenet_frame, "tangents", lambda segments: segments), (frenetix, "violated_limit", lambda *_: None)],
    ids=["headings half a segment ahead", "tyres without limit"],
)
def test_without_each_cure_the_vehicle_could_not_drive_it(
    module: Any, cure: str, turned_off: Any, shared_data: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    as_planned(monkeypatch)
    monkeypatch.setattr(module, cure, turned_off)
    path = shared_data / "data" / "commonroad" / "DEU_Lohmar-61_1_T-1.xml"
    response, target = driven(path, tmp_path)
    assert (response.record.outcome, response.record.refusal) == ("goal_refused", "not_drivable")
    assert judged(read_scenario(path), CommonRoadSolutionReader.open(str(target)), monkeypatch) == "infeasible"


@pytest.mark.shared_data
def test_a_real_collision_is_not_a_valid_solution(shared_data: Path, tmp_path: Path, monkeypatch: Any) -> None:
    path = shared_data / "data" / "commonroad" / "ESP_Monzon-3_1_T-1.xml"
    response, target = driven(path, tmp_path)
    assert response.record.outcome == "collision"
    loaded, solution = read_scenario(path), CommonRoadSolutionReader.open(str(target))
    assert judged(loaded, solution, monkeypatch) != "valid"
    with pytest.raises(solution_checker.CollisionException):
        solution_checker.obstacle_collision(loaded.scenario, loaded.planning_problems, solution)


class StraightAhead:
    """Keeps its first heading and speed, whatever the road does."""

    def reset(self, task: PlanningTask) -> None:
        self._step_s = task.step_s

    def plan(self, observation: Observation) -> Plan:
        ego, count = observation.ego, 16
        ahead = np.outer(np.arange(count), [math.cos(ego.heading_rad), math.sin(ego.heading_rad)])
        return Plan(
            PlannedTrajectory(
                positions=ego.position + ahead * ego.speed_mps * self._step_s,
                headings_rad=np.full(count, ego.heading_rad),
                speeds_mps=np.full(count, ego.speed_mps),
                accelerations_mps2=np.zeros(count),
            )
        )


@pytest.mark.shared_data
def test_a_run_off_a_real_road_is_not_a_valid_solution(shared_data: Path, monkeypatch: Any) -> None:
    loaded = read_scenario(shared_data / "data" / "commonroad" / "BEL_Antwerp-13_5_T-1.xml")
    problem = loaded.problem()
    run = simulate(loaded.scenario, problem, configuration("frenetix:Default"), StraightAhead(), "ground_truth", silent)
    assert run.final.outcome == "off_road"
    text = solution_xml(
        run_steps(run),
        loaded.step_s,
        scenario_id=loaded.scenario.scenario_id,
        problem_id=problem.planning_problem_id,
        vehicle_id=2,
        cost_function="SM1",
    )
    solution = CommonRoadSolutionReader.fromstring(text)
    assert judged(loaded, solution, monkeypatch) != "valid"
    with pytest.raises(solution_checker.CollisionException):
        solution_checker.boundary_collision(loaded.scenario, loaded.planning_problems, solution)


def test_the_checker_sees_a_car_at_the_end_of_the_run(tmp_path: Path) -> None:
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
    angles = mean_steering_angles(steps, step_s, 2.579, 1.066)
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
