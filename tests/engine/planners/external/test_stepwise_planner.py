"""A program that is asked at every planning step: what it is told, what it answers, and each way to misbehave."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import Problem, ScenarioBuilder, driving, town_road
from support.planning import configuration

from benchmarks.loop import stepwise_program
from benchmarks.loop.protocol import EXPECTED
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import programs_named, run_planner
from plannerforge.schemas.errors import PlannerFailure
from plannerforge.schemas.planning import CommandPlanner, DeclaredWeight, RunRequest, RunResponse
from plannerforge.schemas.stepwise import StartMessage, StepMessage

EXAMPLES = Path(__file__).resolve().parents[4] / "docs" / "examples" / "own_planner"
LIMITS: dict[str, Any] = {"start_time_s": 20.0, "step_time_s": 10.0, "memory_mb": 256, "folder_mb": 4, "output_mb": 1}
NEAR = Problem(goal=(65.0, 0.0, 8.0, 3.0), steps=(15, 35))
FAR = Problem(goal=(120.0, 0.0, 8.0, 3.0), steps=(40, 110))


def declared(behaviour: str, **limits: Any) -> CommandPlanner:
    command = (sys.executable, "-S", stepwise_program.__file__, behaviour)
    return CommandPlanner(summary="drives on", command=command, protocol="stepwise", **(LIMITS | limits))


def road() -> ScenarioBuilder:
    return replace(town_road().with_vehicles(), problems=(NEAR,))


def driven(folder: Path, planner: CommandPlanner, builder: ScenarioBuilder | None = None, **fields: Any) -> RunResponse:
    with programs_named({"mine": planner}):
        request = RunRequest(
            run_id="run_0",
            scenario_path=str((builder or road()).write(folder / "scenario.xml")),
            scenario_id="ZAM_Builder-1_1_T-1",
            configuration=configuration("mine"),
            **fields,
        )
        return run_planner(request, silent)


def test_it_plans_at_every_planning_step_of_the_run(tmp_path: Path) -> None:
    response = driven(tmp_path, declared("drives"))
    assert response.record.outcome == "goal_reached"
    assert len(response.steps.plan_steps) == len(response.steps.costs["comfort"]) > 5


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = (driven(tmp_path, declared("drives")) for _ in range(2))
    assert (first.record, first.steps, first.series) == (second.record, second.steps, second.series)


LISTENER = """
import json, sys
sys.path.insert(0, {folder!r})
from stepwise_program import say, straight_on
for line in sys.stdin:
    message = json.loads(line)
    sys.stderr.write(line)
    say({{"type": "ready", "protocol": 1}} if message["type"] == "start" else straight_on(message, 0.1))
"""


def heard(folder: Path, builder: ScenarioBuilder, **fields: Any) -> tuple[StartMessage, list[StepMessage]]:
    """What a program is told; its first lines, since the log keeps the beginning."""
    listener = folder / "listener.py"
    listener.write_text(LISTENER.format(folder=str(Path(stepwise_program.__file__).parent)), encoding="utf-8")
    planner = CommandPlanner(
        summary="listens", command=(sys.executable, "-S", str(listener)), protocol="stepwise", **LIMITS
    )
    start, *steps = driven(folder, planner, builder, **fields).planner_log.split("[...]")[0].strip().splitlines()
    whole = [line for line in steps if line.endswith("}")]
    return StartMessage.model_validate_json(start), [StepMessage.model_validate_json(line) for line in whole]


def test_a_program_gets_the_task_once(tmp_path: Path) -> None:
    start, _ = heard(tmp_path, road())
    assert (start.scenario_id, start.problem_id, start.step_s) == ("ZAM_Builder-1_1_T-1", 100, 0.1)
    assert start.vehicle["maximum_steering_rate_radps"] == 0.4
    assert start.route[0] == 1
    lane = next(one for one in start.lanelets if one.id == 1)
    assert (lane.left_neighbour, lane.left_same_direction, lane.right_neighbour) == (2, True, None)
    assert lane.successors == (11, 12)
    assert {goal.last_step for goal in start.goals} == {35}
    assert start.goals[0].areas is not None
    assert min(start.goals[0].areas[0].x_m) == pytest.approx(61.0)
    assert start.reference.x_m[0] < 40.0 < start.reference.x_m[-1]


def test_a_program_gets_others_as_observed_and_predicted_but_never_their_recording(tmp_path: Path) -> None:
    lead = driving(7, (70.0, 0.0), 8.0, 60, kind="truck", size_m=(9.0, 2.5))
    braking = replace(lead, poses=tuple((x - 0.1 * index**2 / 2, *rest) for index, (x, *rest) in enumerate(lead.poses)))
    _, steps = heard(tmp_path, road().with_vehicles(braking))  # type: ignore[arg-type]
    (other,) = steps[0].others
    assert (other.id, other.kind, other.length_m, other.width_m) == (7, "truck", 9.0, 2.5)
    assert (other.x_m, other.speed_mps) == (70.0, 8.0)
    assert other.predicted.length_m > other.length_m, "the prediction's margin"
    assert other.predicted.x_m[10] == pytest.approx(78.0, abs=1e-3), "constant velocity, although it brakes"
    assert len(other.predicted.x_m) == 31


def test_a_program_learns_where_it_is_on_its_route(tmp_path: Path) -> None:
    start_aside = replace(road(), problems=(replace(NEAR, start=(40.0, 0.4, 0.05, 10.0)),))
    _, steps = heard(tmp_path, start_aside)
    first = steps[0]
    assert (first.step, first.time_s) == (0, 0.0)
    assert first.route.offset_m == pytest.approx(0.4, abs=1e-3)
    assert first.route.heading_error_rad == pytest.approx(0.05, abs=1e-3)
    assert first.route.to_goal_m == pytest.approx(21.0, abs=1.1)


def test_it_sees_the_lights_of_its_route_as_they_are(tmp_path: Path) -> None:
    text = road().xml()
    light = (
        '<trafficLight id="900"><cycle><cycleElement><duration>10</duration><color>red</color></cycleElement>'
        "<cycleElement><duration>50</duration><color>green</color></cycleElement><timeOffset>0</timeOffset></cycle>"
        "</trafficLight>"
    )
    lit = text.replace("</lanelet>", '<trafficLightRef ref="900"/></lanelet>', 1).replace(
        "<planningProblem", f"{light}<planningProblem", 1
    )
    assert lit.count("900") == 2

    class Lit(ScenarioBuilder):
        def xml(self) -> str:
            return lit

    _, steps = heard(tmp_path, Lit(road().lanes))
    states = {one.step: one.signals[0].state for one in steps if one.signals}
    assert (states[0], states[12]) == ("red", "green")
    assert steps[0].signals[0].ahead_m == pytest.approx(160.0, abs=0.5)


SHORT = {"start_time_s": 1.0, "step_time_s": 0.9, "time_s": 1.5}
"""Limits for programs that break a limit of time, whatever else the machine does meanwhile."""
PATIENT = {"start_time_s": 10.0, "step_time_s": 4.0, "time_s": 10.0}
"""Limits for programs that are waited for until they are ended, but have to come to what they do wrong before."""
TIMES = {
    **dict.fromkeys(("hangs", "hangs_with_child", "stops_itself", "never_ready", "slow"), SHORT),
    **dict.fromkeys(("closes_input", "closes_output"), PATIENT),
}


@pytest.mark.parametrize(("behaviour", "reason"), EXPECTED.items())
def test_misbehaviour_is_a_named_error(behaviour: str, reason: str, tmp_path: Path) -> None:
    limits = TIMES.get(behaviour, {})
    with pytest.raises(PlannerFailure) as caught:
        driven(tmp_path, declared(behaviour, **limits))
    assert caught.value.reason == reason
    assert caught.value.message.startswith("planner mine ")
    assert f"({reason})" in caught.value.text


def test_no_trajectory_ends_the_run_as_infeasible_with_the_rejected_candidates(tmp_path: Path) -> None:
    listener = tmp_path / "none.py"
    listener.write_text(
        "import json, sys\n"
        "for line in sys.stdin:\n"
        "    m = json.loads(line)\n"
        "    a = {'type': 'ready', 'protocol': 1} if m['type'] == 'start' else\\\n"
        "        {'type': 'plan', 'step': m['step'], 'trajectory': None, 'rejected': {'comfort': 12}}\n"
        "    print(json.dumps(a), flush=True)\n"
    )
    planner = CommandPlanner(summary="finds none", command=(sys.executable, str(listener)), protocol="stepwise")
    record = driven(tmp_path, planner).record
    assert record.outcome == "infeasible"
    assert record.rejected_candidates == {"comfort": 12}


def test_a_program_that_stays_serves_many_runs_and_is_started_again_after_a_fault(tmp_path: Path) -> None:
    planner = declared("garbage@9", stays=True)
    far = replace(road(), problems=(FAR,))
    assert driven(tmp_path, planner).record.outcome == "goal_reached"
    with pytest.raises(PlannerFailure):
        driven(tmp_path, planner, far)
    assert driven(tmp_path, planner).record.outcome == "goal_reached"


def drives_as_the_example(folder: Path, command: tuple[str, ...]) -> RunResponse:
    gap = DeclaredWeight(meaning="gap, s", kind="parameter", default=1.5, lowest=0.5, highest=5.0)
    planner = CommandPlanner(
        summary="example", command=command, protocol="stepwise", step_time_s=20.0, weights={"time_gap_s": gap}
    )
    behind = road().with_vehicles(driving(7, (62.0, 0.0), 6.0, 120, kind="car"))
    return driven(folder, planner, replace(behind, problems=(FAR,)))


def test_the_example_in_python_follows_a_slower_car_and_gives_the_reason(tmp_path: Path) -> None:
    response = drives_as_the_example(tmp_path, (sys.executable, "-S", str(EXAMPLES / "stepwise_planner.py")))
    assert response.record.outcome in {"goal_reached", "goal_late", "timeout"}
    assert response.record.beyond_vehicle == ()
    assert response.series is not None
    assert "behind 7" in response.series.texts["why"]
    assert min(gap for gap in response.series.numbers["gap_m"] if gap is not None) > 2.0


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
def test_the_example_in_cpp_compiles_and_plans_as_the_one_in_python(tmp_path: Path) -> None:
    source, program = EXAMPLES / "stepwise_planner.cpp", tmp_path / "stepwise_planner"
    assert len(source.read_text(encoding="utf-8").splitlines()) <= 120
    build = ["g++", "-O1", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-o", str(program), str(source)]
    subprocess.run(build, check=True, capture_output=True)
    in_cpp = drives_as_the_example(tmp_path, (str(program),))
    in_python = drives_as_the_example(tmp_path, (sys.executable, "-S", str(EXAMPLES / "stepwise_planner.py")))
    assert in_cpp.record.outcome == in_python.record.outcome
    assert in_cpp.steps.x_m == pytest.approx(in_python.steps.x_m, abs=0.01)


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
def test_the_example_in_cpp_refuses_invalid_json(tmp_path: Path) -> None:
    program = tmp_path / "stepwise_planner"
    build = ["g++", "-O0", "-std=c++17", "-o", str(program), str(EXAMPLES / "stepwise_planner.cpp")]
    subprocess.run(build, check=True, capture_output=True)
    for text in ("{", "[", '"', '{"type"', "", '{"type":}', "[1,", '"\\', "}", "tru"):
        done = subprocess.run(
            [str(program)], input=f"{text}\n", capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode != 0, text
        assert "what()" in done.stderr


def test_the_settings_of_the_example_are_valid() -> None:
    import tomllib

    section = tomllib.loads((EXAMPLES / "stepwise.toml").read_text(encoding="utf-8"))["planners"]["stepper"]
    assert CommandPlanner(**section).protocol == "stepwise"
    assert json.loads((EXAMPLES / "plan.schema.json").read_text())["title"] == "PlanMessage"
