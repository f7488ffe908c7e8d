"""What a planner had in mind: a stored run driven once more, with its plans, candidates and predictions kept.

A run stores what was driven; the rest is a hundred times as much, and the same seed and versions give it again.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...schemas.planning import Replayed, ReplayRequest, RunPlans, ShownPlan, ShownPrediction
from ...schemas.runs import RunSteps
from ..commonroad import kept_recording
from ..execution import ProgressReporter
from ..geometry import Points
from ..vehicles import vehicle_of
from .interface import Observation, Plan, Planner, PlanningTask, ShowsCandidates
from .registry import make_planner, open_traffic
from .runs import run_steps
from .simulation import simulate

_EVERY_S = 0.2
"""Between two points of a line (chosen)."""
_MOST_CANDIDATES, _MOST_PREDICTIONS, _WITHIN_M = 16, 8, 60.0
"""Candidates that are shown of a planning step, evenly chosen by rank, and the nearest others with their predictions;
chosen: more is a tangle."""
_LEAST_M = 0.5
"""A road user that is predicted to move less has no line (chosen)."""


def replay_plans(request: ReplayRequest, report: ProgressReporter) -> Replayed:
    """Drive a run again and write its plans as JSON (``RunPlans``) to the request's path.

    Where today's code drives otherwise than what is stored, nothing is shown, and the note says so.

    Raises:
        UnsafeInput: the scenario's file cannot be read.
        UnknownName: no such planning problem or planner.
    """
    run = request.run
    loaded = kept_recording(Path(run.scenario_path)).loaded
    problem = loaded.problem(run.problem_id)
    vehicle = vehicle_of(run.configuration.settings)
    planner = _Watched(make_planner(run.configuration.planner), loaded.step_s)
    with open_traffic(run.traffic, loaded, problem, vehicle, run.seed) as traffic:
        driven = simulate(loaded.scenario, problem, run.configuration, planner, run.prediction, report, traffic)
    stored = RunSteps.model_validate_json(Path(request.steps_path).read_bytes())
    if run_steps(driven) != stored:
        return Replayed(note="this version drives the run otherwise than it is stored, so its plans are not shown")
    plans = tuple(planner.plans[step] for step in driven.plan_steps if step in planner.plans)
    Path(request.path).write_text(RunPlans(plans=plans).model_dump_json(), encoding="utf-8")
    return Replayed(path=request.path)


@dataclass
class _Watched:
    """A planner of which each planning step is kept, by its step."""

    planner: Planner
    step_s: float
    plans: dict[int, ShownPlan] = field(default_factory=dict)

    def reset(self, task: PlanningTask) -> None:
        """Begin anew, as the planner does."""
        self.plans.clear()
        self.planner.reset(task)

    def plan(self, observation: Observation) -> Plan:
        """The planner's answer."""
        plan = self.planner.plan(observation)
        if plan.trajectory is not None:
            self.plans[observation.ego.step] = self._shown(observation, plan.trajectory.positions)
        return plan

    def _shown(self, observation: Observation, positions: Points) -> ShownPlan:
        planner = self.planner
        others = planner.shown_candidates(_MOST_CANDIDATES) if isinstance(planner, ShowsCandidates) else ()
        return ShownPlan(
            step=observation.ego.step,
            plan=self._line(positions),
            candidates=tuple(self._line(one) for one in others),
            predictions=tuple(self._predictions(observation)),
        )

    def _predictions(self, observation: Observation) -> list[ShownPrediction]:
        def distance_m(positions: Points) -> float:
            return float(np.linalg.norm(positions[0] - observation.ego.position))

        near = [(distance_m(one.positions), one.obstacle_id, one) for one in observation.obstacles]
        moving = [
            one
            for distance, _, one in sorted(near, key=lambda each: each[:2])
            if distance <= _WITHIN_M and np.linalg.norm(one.positions[-1] - one.positions[0]) >= _LEAST_M
        ]
        return [
            ShownPrediction(obstacle_id=one.obstacle_id, points_m=self._line(one.positions))
            for one in moving[:_MOST_PREDICTIONS]
        ]

    def _line(self, positions: Points) -> tuple[float, ...]:
        """x, y, x, y, … in m, to the centimetre, with the last point."""
        every = max(round(_EVERY_S / self.step_s), 1)
        kept = positions[::every] if (len(positions) - 1) % every == 0 else [*positions[::every], positions[-1]]
        return tuple(np.round(np.asarray(kept), 2).ravel().tolist())
