"""The bench sees the heading wrap of the core: with the cure none of its runs is a trap, without it they are."""

import math
from pathlib import Path

import pytest
from support.builders import Lane, Problem, ScenarioBuilder, arc, line
from support.planning import configuration

from benchmarks.planners.__main__ import is_trapped
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.planners import simulation
from plannerforge.engine.planners.frenetix.core import FrameKeeper, FrenetFrame
from plannerforge.engine.planners.runs import run_planner
from plannerforge.schemas.planning import RunRequest, RunResponse

RADIUS_M = 120.0


def driven(scenario: ScenarioBuilder, folder: Path) -> RunResponse:
    path = scenario.write(folder / "scenario.xml")
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=configuration("frenetix:Default"),
        prediction="ground_truth",
    )
    return run_planner(request, silent)


def outcome_and_trap(response: RunResponse) -> tuple[str, bool]:
    return response.record.outcome, is_trapped(response.record, response.steps)


def westward_bend(speed_mps: float) -> ScenarioBuilder:
    """A left bend whose heading crosses π right where the ego begins."""
    quarter, goal = math.pi / 2, math.pi / 2 + 0.35
    lane = Lane(1, arc((0.0, -RADIUS_M), RADIUS_M, quarter - 0.5, quarter + 0.5, 60))
    area = (RADIUS_M * math.cos(goal), RADIUS_M * math.sin(goal) - RADIUS_M, 10.0, 6.0)
    problem = Problem(start=(0.0, 0.0, math.pi, speed_mps), goal=area, steps=(20, 90))
    return ScenarioBuilder((lane,), problems=(problem,))


def headings_as_they_come(self: FrameKeeper, station_m: float, ahead_m: float) -> FrenetFrame:
    """The core's frame in the world's own directions."""
    del station_m, ahead_m
    return FrenetFrame.of(self._path, 0.0)


@pytest.mark.parametrize("speed_mps", [5.0, 10.0, 15.0])
def test_the_bench_counts_a_heading_wrap_only_if_its_remedy_is_off(
    speed_mps: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cured = driven(westward_bend(speed_mps), tmp_path)
    assert outcome_and_trap(cured) == ("goal_reached", False)
    monkeypatch.setattr(FrameKeeper, "frame_for", headings_as_they_come)
    monkeypatch.setattr(simulation, "BLENDED_OVER_M", ())
    uncured = driven(westward_bend(speed_mps), tmp_path)
    assert outcome_and_trap(uncured) == ("infeasible", True)


def test_a_corner_that_cannot_be_taken_at_this_speed_is_not_a_trap(tmp_path: Path) -> None:
    """Infeasible for a reason: from 25 m/s into a bend of 6 m, 10 m ahead."""
    lanes = (
        Lane(1, line((0.0, 0.0), (40.0, 0.0)), successors=(2,)),
        Lane(2, arc((40.0, 6.0), 6.0, -math.pi / 2, 0.0, 21), successors=(3,), predecessors=(1,)),
        Lane(3, line((46.0, 6.0), (46.0, 100.0)), predecessors=(2,)),
    )
    problem = Problem(start=(30.0, 0.0, 0.0, 25.0), goal=(46.0, 60.0, 4.0, 10.0), steps=(20, 90))
    response = driven(ScenarioBuilder(lanes, problems=(problem,)), tmp_path)
    assert outcome_and_trap(response) == ("infeasible", False)


def test_runs_that_are_not_infeasible_are_not_traps(tmp_path: Path) -> None:
    response = driven(westward_bend(10.0), tmp_path)
    steps = response.steps.model_copy(update={"rejected": {"yaw_rate": (0, 9999)}})
    assert not is_trapped(response.record, steps)
    assert is_trapped(response.record.model_copy(update={"outcome": "infeasible"}), steps)


def test_a_wrap_late_in_a_run_is_seen_despite_earlier_rejections(tmp_path: Path) -> None:
    response = driven(westward_bend(10.0), tmp_path)
    stopped = response.record.model_copy(update={"outcome": "infeasible"})
    late = response.steps.model_copy(update={"rejected": {"yaw_rate": (0, 0, 300), "collision": (900, 900, 20)}})
    early = response.steps.model_copy(update={"rejected": {"yaw_rate": (900, 900, 20), "collision": (0, 0, 300)}})
    assert (is_trapped(stopped, late), is_trapped(stopped, early)) == (True, False)
