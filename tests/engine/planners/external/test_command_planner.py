"""A planner that is a program: what it answers is driven, and each way to misbehave is a named error of its run."""

import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
from support.builders import Problem, ScenarioBuilder, town_road
from support.planning import configuration

from plannerforge.engine.execution import silent
from plannerforge.engine.planners import planner_names, planner_version, programs_named, run_planner
from plannerforge.schemas.errors import PlannerFailure
from plannerforge.schemas.planning import CommandPlanner, DeclaredWeight, RunRequest, RunResponse

PROGRAM = Path(__file__).resolve().parents[3] / "support" / "own_planner_program.py"
NEAR = Problem(goal=(65.0, 0.0, 8.0, 3.0), steps=(15, 35))


def declared(behaviour: str, **limits: Any) -> CommandPlanner:
    weights = {"comfort": DeclaredWeight(meaning="how gentle it drives", default=1.0)}
    command = (sys.executable, "-S", str(PROGRAM), behaviour)
    return CommandPlanner(summary="drives straight on", weights=weights, command=command, **limits)


def road() -> ScenarioBuilder:
    return replace(town_road().with_vehicles(), problems=(NEAR,))


def driven(folder: Path, planner: CommandPlanner, *changes: str, version: str = "") -> RunResponse:
    with programs_named({"mine": planner}):
        request = RunRequest(
            run_id="run_0",
            scenario_path=str(road().write(folder / "scenario.xml")),
            scenario_id="ZAM_Builder-1_1_T-1",
            configuration=configuration("mine", *changes),
            planner_version=version,
        )
        return run_planner(request, silent)


def test_its_trajectory_is_driven_and_its_costs_are_kept(tmp_path: Path) -> None:
    response = driven(tmp_path, declared("drives"), "comfort=2.5")
    assert response.record.outcome == "goal_reached"
    assert response.record.planner == "mine"
    assert set(response.steps.costs["comfort"]) == {2.5}
    assert response.steps.speed_mps[0] == response.steps.speed_mps[-1] == 10.0
    assert response.planner_log == ""


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = (driven(tmp_path, declared("drives")) for _ in range(2))
    assert first.record == second.record
    assert first.steps == second.steps


def test_it_gets_the_file_and_no_secret_and_its_log_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SECRET", "of the server")
    log = driven(tmp_path, declared("looks")).planner_log.splitlines()
    assert [log[0], log[2]] == ["has the file", "no secret"]
    assert not Path(log[1].partition(" in ")[2]).exists(), "its folder is gone after the run"


@pytest.mark.parametrize(
    ("behaviour", "limits", "reason", "told"),
    [
        ("floods", {"output_mb": 1}, "flooded_output", "more than 1 MB to standard output"),
        ("writes_five_gb", {"folder_mb": 2}, "wrote_too_much", "more than 2 MB"),
        ("writes_many", {"folder_mb": 4}, "wrote_too_much", "more than 4 MB"),
        ("exits_three", {}, "exit_status", "exit status 3; standard error ends: “no licence for this machine"),
        ("is_killed", {}, "died", "signal 9"),
        ("takes_memory", {"memory_mb": 256}, "exit_status", "it raised “MemoryError”"),
        ("not_a_number", {}, "not_finite", "trajectory.x_m.4"),
        ("other_scenario", {}, "wrong_scenario", "DEU_Other-1_1_T-1"),
        ("other_problem", {}, "wrong_scenario", "#7 instead of ZAM_Builder-1_1_T-1 #100"),
        ("not_json", {}, "not_json", "Loading the planner"),
        ("silent", {}, "not_json", "no answer"),
        ("two_answers", {}, "not_json", "not JSON"),
        ("other_form", {}, "wrong_form", "trajectory"),
        ("forged_name", {}, "wrong_form", "rejected"),
        ("endless_name", {"output_mb": 16}, "wrong_form", "costs"),
        ("endless_names", {"output_mb": 16}, "wrong_form", "costs"),
        ("unknown_field", {}, "wrong_form", "colour"),
        ("different_lengths", {}, "wrong_form", "different lengths"),
        ("too_short", {}, "too_short", "plans only 0.40 s"),
        ("one_state", {}, "too_short", "1 state"),
        ("jumps", {}, "contract_broken", "moves farther in a step"),
        ("elsewhere", {}, "contract_broken", "starts 40.00 m from the ego"),
        ("hangs", {"time_s": 0.7}, "timed_out", "no answer within 0.7 s"),
    ],
)
def test_misbehaviour_is_a_named_error(
    behaviour: str, limits: dict[str, Any], reason: str, told: str, tmp_path: Path
) -> None:
    child = tmp_path / "child"
    planner = declared(behaviour, environment={"CHILD_FILE": str(child)}, **limits)
    with pytest.raises(PlannerFailure) as caught:
        driven(tmp_path, planner)
    assert caught.value.reason == reason
    assert told in caught.value.message
    assert caught.value.message.startswith("planner mine ")
    assert "\n" not in caught.value.message
    assert len(caught.value.message) < 600
    if child.exists():
        assert gone(int(child.read_text()))


def gone(pid: int) -> bool:
    """Whether a process ends; it was killed, and on a busy machine it takes a moment until it is dead."""
    for _ in range(600):
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.05)
    return False


def test_no_trajectory_is_an_outcome_with_the_rejected_candidates(tmp_path: Path) -> None:
    record = driven(tmp_path, declared("finds_none")).record
    assert record.outcome == "infeasible"
    assert record.rejected_candidates == {"comfort_limit": 12}


def test_a_trajectory_that_ends_before_the_goal_is_infeasible_there(tmp_path: Path) -> None:
    response = driven(tmp_path, declared("ends_early"))
    assert response.record.outcome == "infeasible"
    assert response.record.rejected_candidates == {"trajectory_ended": 1}
    assert len(response.steps.x_m) == 15


def test_a_program_that_stays_serves_many_runs_with_a_log_each(tmp_path: Path) -> None:
    planner = declared("looks", stays=True)
    logs = [driven(tmp_path, planner).planner_log.splitlines() for _ in range(2)]
    assert len(logs[0]) == len(logs[1]) == 3
    assert logs[0] == logs[1], "the same process in the same folder"


@pytest.mark.parametrize(
    ("behaviour", "reason"),
    [("exits_three@2", "exit_status"), ("not_json@2", "not_json"), ("floods@2", "flooded_output")],
)
def test_a_program_that_stays_and_misbehaves_is_started_again(behaviour: str, reason: str, tmp_path: Path) -> None:
    planner = declared(behaviour, stays=True, output_mb=1)
    assert driven(tmp_path, planner).record.outcome == "goal_reached"
    with pytest.raises(PlannerFailure) as caught:
        driven(tmp_path, planner)
    assert caught.value.reason == reason
    assert driven(tmp_path, planner).record.outcome == "goal_reached"


def test_a_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    planner = CommandPlanner(summary="is not there", command=(str(tmp_path / "absent"),))
    with pytest.raises(PlannerFailure, match="there is no program") as caught:
        driven(tmp_path, planner)
    assert caught.value.reason == "cannot_start"


def test_an_edited_program_is_another_version(tmp_path: Path) -> None:
    script = tmp_path / "planner.py"
    planner = CommandPlanner(summary="a script", command=("python3", str(script)))
    versions = []
    for text in ("print(1)", "print(12)"):
        script.write_text(text)
        with programs_named({"mine": planner}):
            versions.append(planner_version("mine"))
    assert len(set(versions)) == 2


def test_a_run_uses_the_requested_version(tmp_path: Path) -> None:
    with programs_named({"mine": declared("drives")}):
        version = planner_version("mine")
    assert driven(tmp_path, declared("drives"), version=version).record.outcome == "goal_reached"
    with pytest.raises(PlannerFailure) as caught:
        driven(tmp_path, declared("looks"), version=version)
    assert caught.value.reason == "other_version"


def test_programs_are_known_while_they_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with programs_named({"mine": declared("drives")}):
        assert planner_names()[-1] == "mine"
        assert json.loads(os.environ["PLANNERFORGE_PLANNERS"])["mine"]["summary"] == "drives straight on"
    assert "mine" not in planner_names()
    monkeypatch.setenv("PLANNERFORGE_PLANNERS", "{")
    with pytest.raises(PlannerFailure, match="PLANNERFORGE_PLANNERS cannot be read"):
        planner_names()


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"command": ("./planner",)}, "absolute path"),
        ({"command": ()}, "at least 1 item"),
        ({"command": ("python3",), "time_s": 0}, "greater than 0"),
        ({"command": ("python3",), "presets": {"Fast": {"weights": {"absent": 1.0}}}}, "absent, which is not a weight"),
    ],
)
def test_a_wrong_declaration_is_refused_by_name(fields: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        CommandPlanner(summary="wrong", **fields)
