"""Runs whose ego is no car: judge, record, reactive traffic, picture and solution file know the class."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Problem, ScenarioBuilder, Vehicle, town_road
from support.planning import configuration

from plannerforge.engine.commonroad.document import ScenarioDocument
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.driving.solution import write_solution
from plannerforge.engine.planners.runs import run_planner
from plannerforge.engine.rendering.views.scenes import read_content, scene_view
from plannerforge.engine.tuning.configurations import changed_configuration
from plannerforge.engine.vehicles.models import ego_class
from plannerforge.schemas.artifacts import SolutionRequest
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.planning import RunRequest, RunResponse
from plannerforge.schemas.runs import ScenarioSource

NEAR = Problem(start=(40.0, 0.0, 0.0, 8.0), goal=(60.0, 0.0, 8.0, 3.0), steps=(15, 40))


def written(folder: Path, name: str, *parked: Vehicle) -> Path:
    """The town's road without traffic, its ego of a class, and what stands there."""
    builder: ScenarioBuilder = replace(town_road().with_vehicles(), problems=(NEAR,), parked=parked)
    path = builder.write(folder / f"{name}.xml")
    document = ScenarioDocument.read(path)
    document.set_ego_class(100, name)
    document.write(path, builder.benchmark_id)
    return path


def ran(path: Path, *settings: str, planner: str = "idm", traffic: str = "recorded") -> RunResponse:
    config, _ = changed_configuration(configuration(planner), None, (), settings)
    asked = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=config,
        traffic=traffic,  # type: ignore[arg-type]
    )
    return run_planner(asked, silent)


@pytest.mark.parametrize("planner", ["frenetix", "mp_rbfn", "idm", "fiss"])
@pytest.mark.parametrize("name", ["taxi", "truck", "bus", "motorcycle"])
def test_every_planner_drives_the_vehicle_of_the_class(name: str, planner: str, tmp_path: Path) -> None:
    record = ran(written(tmp_path, name), planner=planner).record
    assert record.ego_class == name
    assert (record.ego_length_m, record.ego_width_m) == ego_class(name).vehicle.size_m
    assert record.outcome != "invalid"
    assert record.beyond_vehicle == ()


def test_no_planner_drives_a_semi_trailer_but_its_tractor_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "trailer")
    with pytest.raises(NotPossible, match="trailer"):
        ran(path)
    record = ran(path, "vehicle=4").record
    assert (record.ego_class, record.ego_length_m) == ("truck", 5.1)


@pytest.mark.parametrize(("ahead_m", "is_hit"), [(6.9, True), (7.1, False)])
def test_the_judge_sees_the_length_of_the_class(ahead_m: float, is_hit: bool, tmp_path: Path) -> None:
    box = Vehicle(50, ((40.0 + ahead_m, 0.0, 0.0, 0.0),), "parkedVehicle", 2.0, 2.0)
    record = ran(written(tmp_path, "bus", box)).record
    assert (record.invalid_reason == "initial_collision") is is_hit


def test_reactive_traffic_meets_the_class(tmp_path: Path) -> None:
    record = ran(written(tmp_path, "bus"), traffic="reactive").record
    assert (record.ego_class, record.ego_length_m) == ("bus", 12.0)


def test_a_solution_file_is_refused_by_class_and_written_for_a_stated_vehicle(tmp_path: Path) -> None:
    path = written(tmp_path, "truck")
    for settings, is_refused in (((), True), (("vehicle=2",), False)):
        response = ran(path, *settings)
        steps = tmp_path / "steps.json"
        steps.write_text(response.steps.model_dump_json(), encoding="utf-8")
        asked = SolutionRequest(
            record=response.record,
            configuration=changed_configuration(configuration("idm"), None, (), settings)[0],
            scenario_path=str(path),
            steps_path=str(steps),
            target_path=str(tmp_path / "solution.xml"),
        )
        if is_refused:
            with pytest.raises(NotPossible, match="include no truck") as caught:
                write_solution(asked, silent)
            assert caught.value.reason == "no_such_vehicle"
        else:
            assert Path(write_solution(asked, silent).path).is_file()


def test_the_player_gets_class_and_size(tmp_path: Path) -> None:
    path = written(tmp_path, "motorcycle")
    scene, _ = scene_view(read_content(ScenarioSource(scenario_id="ZAM_Builder-1_1_T-1", path=str(path))))
    assert scene.start is not None
    assert (scene.start.kind, scene.start.length_cm, scene.start.width_cm) == ("motorcycle", 220, 90)
