"""The operation of a worker: a file and a configuration in, a record, the driven steps and times out."""

import math
import statistics
import subprocess
import sys
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, arc, line
from support.builders import town_road as whole_town_road
from support.elsewhere import digest_of_run
from support.planning import configuration

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners.runs import run_planner
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.planning import RunRequest, RunResponse

BARE = """
import sys
sys.modules |= dict.fromkeys(("Polygon", "torch", "sentence_transformers"))
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import run_planner
from plannerforge.schemas.planning import RunRequest
for line in sys.stdin:
    print(run_planner(RunRequest.model_validate_json(line), silent).record.outcome)
"""

NEAR = Problem(goal=(75.0, 0.0, 8.0, 3.0), steps=(30, 45))


def town_road() -> ScenarioBuilder:
    """The road with a goal that is reached in about three seconds."""
    return replace(whole_town_road(), problems=(NEAR,))


def request(builder: ScenarioBuilder, folder: Path, problem_id: int | None = None, name: str = "") -> RunRequest:
    path = builder.write(folder / "scenario.xml")
    return RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=builder.benchmark_id,
        problem_id=problem_id,
        configuration=configuration(name or "frenetix:Default"),
    )


def carried_out(builder: ScenarioBuilder, folder: Path, problem_id: int | None = None) -> RunResponse:
    return run_planner(request(builder, folder, problem_id), silent)


def test_runs_need_neither_polygon3_nor_pytorch(tmp_path: Path) -> None:
    names = ["frenetix:Default", "mp_rbfn:Default", "idm", "fiss"]
    asked = "\n".join(request(town_road(), tmp_path, name=name).model_dump_json() for name in names)
    done = subprocess.run([sys.executable, "-c", BARE], input=asked, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["goal_reached"] * len(names)


@pytest.mark.parametrize("version", ["2018b", "2020a"])
def test_both_formats_run_to_the_goal(version: str, tmp_path: Path) -> None:
    response = carried_out(replace(town_road(), version=version), tmp_path)
    record, steps = response.record, response.steps
    assert record.outcome == "goal_reached"
    assert record.metrics is not None
    assert record.metrics.minimum_distance_m is not None
    assert record.metrics.minimum_distance_m > 0
    assert len(steps.x_m) == len(steps.speed_mps) == round(record.metrics.duration_s / 0.1) + 1
    assert steps.plan_steps == tuple(range(0, len(steps.x_m) - 1, 3))
    assert all(len(values) == len(steps.plan_steps) for values in steps.costs.values())


def test_every_planning_step_has_its_time_and_its_rejections(tmp_path: Path) -> None:
    response = carried_out(town_road(), tmp_path)
    planned = len(response.steps.plan_steps)
    assert len(response.timing.planning_ms) == response.timing.steps == planned
    assert statistics.median(response.timing.planning_ms) == pytest.approx(
        response.timing.planning_step_median_ms, abs=1e-3
    )
    rejected = response.steps.rejected
    assert {name: sum(counts) for name, counts in rejected.items()} == response.record.rejected_candidates
    assert {len(counts) for counts in rejected.values()} == {planned}


def test_the_attempt_without_a_trajectory_has_its_time_and_its_rejections_too(tmp_path: Path) -> None:
    narrow = replace(
        town_road().with_vehicles(),
        lanes=(
            Lane(1, line((0.0, 0.0), (40.0, 0.0)), successors=(2,)),
            Lane(2, arc((40.0, 6.0), 6.0, -math.pi / 2, 0.0, 21), successors=(3,), predecessors=(1,)),
            Lane(3, line((46.0, 6.0), (46.0, 100.0)), predecessors=(2,)),
        ),
        problems=(Problem(start=(30.0, 0.0, 0.0, 25.0), goal=(46.0, 60.0, 4.0, 10.0), steps=(20, 90)),),
    )
    response = carried_out(narrow, tmp_path)
    attempts = len(response.steps.plan_steps) + 1
    assert response.record.outcome == "infeasible"
    assert len(response.timing.planning_ms) == response.timing.steps == attempts
    assert {len(counts) for counts in response.steps.rejected.values()} == {attempts}


def test_a_file_without_obstacles_has_no_distance_to_any(tmp_path: Path) -> None:
    record = carried_out(town_road().with_vehicles(), tmp_path).record
    assert record.outcome == "goal_reached"
    assert record.metrics is not None
    assert record.metrics.minimum_distance_m is None
    assert record.metrics.minimum_time_to_collision_s is None


def test_one_of_several_problems_is_chosen(tmp_path: Path) -> None:
    problems = (NEAR, Problem(200, start=(40.0, 3.5, 0.0, 8.0), goal=(70.0, 3.5, 8.0, 3.0), steps=(30, 45)))
    builder = replace(town_road().with_vehicles(), problems=problems)
    assert carried_out(builder, tmp_path).record.problem_id == 100
    second = carried_out(builder, tmp_path, 200)
    assert second.record.problem_id == 200
    assert second.steps.y_m[0] == 3.5
    with pytest.raises(UnknownName, match="no planning problem 300"):
        carried_out(builder, tmp_path, 300)


def test_a_problem_that_begins_later_keeps_its_clock(tmp_path: Path) -> None:
    later = Problem(start_step=20, start=(40.0, 0.0, 0.0, 8.0), goal=(70.0, 0.0, 8.0, 3.0), steps=(50, 70))
    builder = replace(town_road().with_vehicles(), problems=(later,))
    response = carried_out(builder, tmp_path)
    assert response.steps.first_step == 20
    assert response.steps.plan_steps[0] == 20
    assert response.record.outcome == "goal_reached"


def test_an_invalid_problem_has_no_metrics(tmp_path: Path) -> None:
    builder = replace(town_road(), problems=(Problem(start=(70.0, 0.0, 0.0, 8.0)),))
    record = carried_out(builder, tmp_path).record
    assert record.outcome == "invalid"
    assert record.metrics is None
    assert "obstacle 31" in record.reason


def test_progress_never_falls_and_ends_at_one(tmp_path: Path) -> None:
    shares: list[float] = []
    run_planner(request(town_road().with_vehicles(), tmp_path), lambda share, message="": shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_other_processes_and_hash_seeds_give_the_same_bytes(tmp_path: Path, other_process: Executor) -> None:
    asked = request(town_road(), tmp_path, name="frenetix:Balanced")
    assert other_process.submit(digest_of_run, asked).result() == digest_of_run(asked)
