"""The operations that a worker carries out for one planner run: drive it, which gives its record, metrics and steps; or
drive a stored one once more, for its plans, candidates and predictions.

A run stores what was driven; the rest is a hundred times as much, and the same seed and versions give it again.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import PlannerFailure
from ...schemas.planning import Replayed, ReplayRequest, RunPlans, RunRequest, RunResponse, ShownPlan
from ...schemas.runs import DrivenObstacle, RunMetrics, RunRecord, RunSteps, RunTiming
from ..commonroad import Track, kept_recording
from ..criticality import drive_criticality
from ..execution import ProgressReporter
from ..geometry import Points, Values, wrap_angles
from ..vehicles import VehicleParameters, vehicle_of
from .driving.drivability import exceeded_limits
from .driving.solution import steering_of
from .external.command import CommandDriver, ScenarioFile
from .interface import EgoState, Observation, Plan, Planner, PlanningTask, ShowsCandidates
from .registry import check_modes, make_planner, open_traffic, planner_version, uses_prediction
from .simulation import DrivenRun, simulate

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

    from ..commonroad import LoadedScenario

_EVERY_S = 0.2
"""Between two points of a line (chosen)."""
_MOST_CANDIDATES, _MOST_PREDICTIONS, _WITHIN_M = 16, 8, 60.0
"""Candidates that are shown of a planning step, evenly chosen by rank, and the nearest others with their predictions;
chosen: more is a tangle."""
_LEAST_M = 0.5
"""A road user that is predicted to move less has no line (chosen)."""


def run_planner(request: RunRequest, report: ProgressReporter) -> RunResponse:
    """Run a planner on one planning problem of a CommonRoad file.

    Raises:
        UnsafeInput: the file cannot be read.
        UnknownName: no such planning problem or planner.
        InvalidRequest: a prediction that does not go with the traffic.
        PlannerFailure: a planner of others broke its contract.
    """
    began = perf_counter()
    start = _Start.of(request)
    loaded, vehicle = start.loaded, start.vehicle
    file = ScenarioFile(Path(request.scenario_path), str(loaded.scenario.scenario_id))
    _check_version(request)
    planner = make_planner(request.configuration.planner, file)
    check_modes(request.traffic, request.prediction)
    driven = start.drive(planner, report)
    record = RunRecord(
        run_id=request.run_id,
        scenario_id=request.scenario_id,
        problem_id=int(start.problem.planning_problem_id),
        config_id=request.configuration.config_id,
        config_name=request.configuration.name,
        planner=request.configuration.planner,
        prediction=request.prediction,
        traffic=request.traffic,
        seed=request.seed,
        step_s=loaded.step_s,
        outcome=driven.final.outcome,
        reason=driven.final.reason,
        invalid_reason=driven.final.invalid_reason,
        collision=driven.final.collision,
        off_the_lanes=driven.off_the_lanes,
        on_recording=driven.traffic.on_recording,
        eased_over_m=driven.blended_over_m,
        rejected_candidates=dict(sorted(driven.rejected.items())),
        metrics=_metrics(driven, vehicle, loaded.step_s),
        beyond_vehicle=tuple(exceeded_limits(_ego_track(driven.states, vehicle), vehicle, loaded.step_s)),
        ego_length_m=vehicle.length_m,
        ego_width_m=vehicle.width_m,
        uses_prediction=uses_prediction(request.configuration.planner),
    )
    report(1.0, driven.final.outcome)
    core_s = [plan.core_s for plan in driven.plans if plan.core_s > 0]
    timing = RunTiming(
        wall_s=perf_counter() - began,
        planning_step_median_ms=1000 * median(driven.plan_s) if driven.plan_s else 0.0,
        core_step_median_ms=1000 * median(core_s) if core_s else None,
        steps=len(driven.plan_s),
        planning_ms=tuple(round(1000 * duration_s, 3) for duration_s in driven.plan_s),
    )
    log = planner.log if isinstance(planner, CommandDriver) else ""
    return RunResponse(record=record, steps=run_steps(driven), timing=timing, planner_log=log)


@dataclass(frozen=True)
class _Start:
    """What a run begins with, as its request names it."""

    request: RunRequest
    loaded: "LoadedScenario"
    problem: "PlanningProblem"
    vehicle: VehicleParameters

    @classmethod
    def of(cls, request: RunRequest) -> "_Start":
        """The scenario in memory, its planning problem, and the ego's vehicle."""
        loaded = kept_recording(Path(request.scenario_path)).loaded
        return cls(request, loaded, loaded.problem(request.problem_id), vehicle_of(request.configuration.settings))

    def drive(self, planner: Planner, report: ProgressReporter) -> DrivenRun:
        """Let a planner drive in the request's traffic."""
        asked, scenario = self.request, self.loaded.scenario
        with open_traffic(asked.traffic, self.loaded, self.problem, self.vehicle, asked.seed) as traffic:
            return simulate(scenario, self.problem, asked.configuration, planner, asked.prediction, report, traffic)


def _check_version(request: RunRequest) -> None:
    """Refuse to store a run under another version of a planner of others than the one that would drive."""
    name, wanted = request.configuration.planner, request.planner_version
    here = planner_version(name) if wanted else ""
    if here != wanted:
        raise PlannerFailure(
            f"planner {name} has version {here} where the run is made, not {wanted}",
            next_step="call again where it was edited meanwhile; on a cluster, install the same on every worker",
            reason="other_version",
        )


def _metrics(driven: DrivenRun, vehicle: VehicleParameters, step_s: float) -> RunMetrics | None:
    """The metrics of a run over its driven states (the initial one included); None for an invalid problem."""
    if driven.final.outcome == "invalid":
        return None
    total_costs = [sum(plan.costs.values()) for plan in driven.plans if plan.kind != "standstill" and plan.costs]
    states = driven.states
    ego = _ego_track(states, vehicle)
    accelerations = np.array([state.acceleration_mps2 for state in states])
    turn = wrap_angles(np.diff([state.heading_rad for state in states]))
    jerk: Values = np.diff(accelerations) / step_s
    lateral = ego.speeds_mps[1:] * turn / step_s
    felt = np.column_stack([accelerations[1:], lateral])
    planar = np.linalg.norm(np.diff(felt, axis=0), axis=1) / step_s
    steering = np.diff(steering_of(ego.headings_rad, ego.speeds_mps, step_s, vehicle.wheelbase_m)) / step_s
    duration = (len(states) - 1) * step_s
    distance = float(np.linalg.norm(np.diff(ego.positions, axis=0), axis=1).sum())
    nearness = drive_criticality(ego, driven.traffic.moving, driven.traffic.standing)
    if driven.final.outcome == "off_road":  # the score rates what others are near, not a ditch
        nearness = replace(nearness, risk_score=None)
    return RunMetrics(
        duration_s=round(duration, 9),
        distance_m=distance,
        mean_speed_mps=distance / duration if duration else float(ego.speeds_mps[0]),
        **vars(nearness),
        maximum_jerk_mps3=_largest(np.abs(jerk)),
        mean_squared_jerk=float((jerk**2).mean()) if len(jerk) else 0.0,
        maximum_planar_jerk_mps3=_largest([*np.abs(jerk[:1]), *planar]),
        maximum_braking_mps2=max(_largest(-accelerations[1:]), 0.0),
        maximum_lateral_acceleration_mps2=_largest(np.abs(lateral)),
        maximum_steering_rate_radps=_largest(np.abs(steering)),
        mean_total_cost=float(np.mean(total_costs)) if total_costs else None,
    )


def _largest(values: Sequence[float] | Values) -> float:
    """The largest of some values; 0 without any."""
    return float(max(values, default=0.0))


def _ego_track(states: list[EgoState], vehicle: VehicleParameters) -> Track:
    """The driven states as a track with the ego's size; its id is of no obstacle."""
    return Track(
        obstacle_id=-1,
        kind="car",
        length_m=vehicle.length_m,
        width_m=vehicle.width_m,
        first_step=states[0].step,
        positions=np.array([state.position for state in states]),
        headings_rad=np.array([state.heading_rad for state in states]),
        speeds_mps=np.array([state.speed_mps for state in states]),
    )


def run_steps(driven: DrivenRun) -> RunSteps:
    """The driven states; a term or constraint that a planning step did not have counts 0 there."""
    states = driven.states
    terms = sorted({name for plan in driven.plans for name in plan.costs})
    constraints = sorted({name for counts in driven.rejections for name in counts})
    return RunSteps(
        first_step=states[0].step,
        x_m=tuple(float(state.position[0]) for state in states),
        y_m=tuple(float(state.position[1]) for state in states),
        heading_rad=tuple(state.heading_rad for state in states),
        speed_mps=tuple(state.speed_mps for state in states),
        acceleration_mps2=tuple(state.acceleration_mps2 for state in states),
        plan_steps=tuple(driven.plan_steps),
        others=tuple(_driven_obstacle(track) for track in driven.traffic.driven),
        costs={name: tuple(_normal(plan.costs.get(name, 0.0)) for plan in driven.plans) for name in terms},
        rejected={name: tuple(counts.get(name, 0) for counts in driven.rejections) for name in constraints},
    )


def _normal(value: float) -> float:
    """A number, 0 for one that is smaller than normal ones: that is what underflow leaves."""
    return 0.0 if abs(value) < sys.float_info.min else float(value)


def _driven_obstacle(track: Track) -> DrivenObstacle:
    def rounded(values: Values) -> tuple[float, ...]:
        return tuple(round(value, 4) for value in values.tolist())

    return DrivenObstacle(
        obstacle_id=track.obstacle_id,
        kind=track.kind,
        length_m=track.length_m,
        width_m=track.width_m,
        first_step=track.first_step,
        x_m=rounded(track.positions[:, 0]),
        y_m=rounded(track.positions[:, 1]),
        heading_rad=rounded(track.headings_rad),
        speed_mps=rounded(track.speeds_mps),
    )


def replay_plans(request: ReplayRequest, report: ProgressReporter) -> Replayed:
    """Drive a run again and write its plans as JSON (``RunPlans``) to the request's path.

    Where today's code drives otherwise than what is stored, nothing is shown, and the note says so.

    Raises:
        UnsafeInput: the scenario's file cannot be read.
        UnknownName: no such planning problem or planner.
    """
    start = _Start.of(request.run)
    planner = _Watched(make_planner(request.run.configuration.planner), start.loaded.step_s)
    driven = start.drive(planner, report)
    stored = RunSteps.model_validate_json(Path(request.steps_path).read_bytes())
    if run_steps(driven) != stored:
        return Replayed(note="this version drives the run otherwise than it is stored, so its plans are not shown")
    plans = tuple(planner.plans[step] for step in driven.plan_steps)
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

    def _predictions(self, observation: Observation) -> list[tuple[float, ...]]:
        def distance_m(positions: Points) -> float:
            return float(np.linalg.norm(positions[0] - observation.ego.position))

        near = [(distance_m(one.positions), one.obstacle_id, one) for one in observation.obstacles]
        moving = [
            one
            for distance, _, one in sorted(near, key=lambda each: each[:2])
            if distance <= _WITHIN_M and np.linalg.norm(one.positions[-1] - one.positions[0]) >= _LEAST_M
        ]
        return [self._line(one.positions) for one in moving[:_MOST_PREDICTIONS]]

    def _line(self, positions: Points) -> tuple[float, ...]:
        """x, y, x, y, … in m, to the centimetre, with the last point."""
        every = max(round(_EVERY_S / self.step_s), 1)
        kept = positions[::every] if (len(positions) - 1) % every == 0 else [*positions[::every], positions[-1]]
        return tuple(np.round(np.asarray(kept), 2).ravel().tolist())
