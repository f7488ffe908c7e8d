"""Checks that an analysis marks exactly the goals that require no driving, on public scenarios.

The truth is ``GoalRegion.is_reached`` of commonroad-io on the driven states. A reached goal requires no driving in
three cases, tested in this order: the initial or the first driven state meets it (``at_the_start``); it specifies no
place, speed or heading (``by_time_alone``); or a standing car meets it (``standing``). A standing car drove less than
half a metre, or starts at rest with an initial state that meets the goal at its last time step.

Keys:

- ``trivial_marked``: share of the reached goals marked correctly.
- ``trivial_kind_right``: share of the goals that require no driving marked with the right kind.
- ``trivial_goals``: number of these; ``reached_goals``: number of all reached goals.
"""

import math
import sys
from collections import Counter
from pathlib import Path

import anyio
import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.state import CustomState

from plannerforge.schemas.runs import RunRecord, RunSteps

from ..harness import Figures, SeededBench, ask, share
from .public_runs import public_batch, public_server, raw_runs

STANDING_MPS, STOOD_M = 0.5, 0.5
"""An ego with a lower initial speed stands; one that drove less has stood."""


def truth(problem: PlanningProblem, steps: RunSteps) -> str | None:
    """Return why a reached goal required no driving, or None if it did."""
    start, goal = problem.initial_state, problem.goal
    driven = [_state(steps, index) for index in range(min(2, len(steps.x_m)))]
    if len(steps.x_m) <= 2 or any(goal.is_reached(state) for state in driven):
        return "at_the_start"
    asked = ("position", "velocity", "orientation")
    if not any(getattr(state, name, None) is not None for state in goal.state_list for name in asked):
        return "by_time_alone"
    ways = zip(steps.x_m, steps.x_m[1:], steps.y_m, steps.y_m[1:], strict=False)
    if sum(math.hypot(x2 - x1, y2 - y1) for x1, x2, y1, y2 in ways) < STOOD_M:
        return "standing"
    if abs(float(start.velocity)) < STANDING_MPS and _met_by_waiting(problem):
        return "standing"
    return None


def _state(steps: RunSteps, index: int) -> CustomState:
    return CustomState(
        time_step=steps.first_step + index,
        position=np.array([steps.x_m[index], steps.y_m[index]]),
        orientation=steps.heading_rad[index],
        velocity=steps.speed_mps[index],
    )


def _met_by_waiting(problem: PlanningProblem) -> bool:
    """Return True if the initial state, at rest, meets the goal at one of its last time steps."""
    start = problem.initial_state
    ends = {int(getattr(state.time_step, "end", state.time_step)) for state in problem.goal.state_list}
    waiting = (
        CustomState(time_step=end, position=start.position, orientation=start.orientation, velocity=0.0) for end in ends
    )
    return any(problem.goal.is_reached(state) for state in waiting)


def problem_of(file: Path, record: RunRecord) -> PlanningProblem:
    """Return the planning problem of a run, read anew."""
    _, problems = CommonRoadFileReader(str(file)).open()
    return problems.planning_problem_dict[record.problem_id]


def measure(bench: SeededBench) -> Figures:
    """Return the keys above, over all public scenarios or the bench's limit."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    async with public_server(bench) as client:
        batch_id = await public_batch(bench, client)
        raw = raw_runs(bench, batch_id)
        reached = [record for record in raw.valid if record.outcome == "goal_reached"]
        told = await ask(client, "analyze_results", results=[batch_id])
    marked = told["trivial"] or {"run_ids": (), "kinds": {}}
    true = {one.run_id: truth(problem_of(raw.files[one.scenario_id], one), raw.steps[one.run_id]) for one in reached}
    for run_id, kind in true.items():
        if (run_id in marked["run_ids"]) != (kind is not None):
            sys.stderr.write(f"{run_id}: truth {kind}, {'' if run_id in marked['run_ids'] else 'not '}marked\n")
    kinds = Counter(kind for kind in true.values() if kind is not None)
    agreeing = sum(min(count, marked["kinds"].get(kind, 0)) for kind, count in kinds.items())
    return {
        "trivial_marked": share((kind is not None) == (run_id in marked["run_ids"]) for run_id, kind in true.items()),
        "trivial_kind_right": round(agreeing / max(kinds.total(), sum(marked["kinds"].values()), 1), 4),
        "trivial_goals": kinds.total(),
        "reached_goals": len(true),
    }
