"""The worker's operations for a planner run: run it for its record, metrics and steps, or repeat a stored run.

A run stores only the driven motion. Plans, candidates and predictions are a hundred times as large, and the same seed
and versions reproduce them.
"""

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import PlannerFailure
from ...schemas.measures import RunMetrics
from ...schemas.planning import Replayed, ReplayRequest, RunMoment, RunPlans, RunRequest, RunResponse, ShownPlan
from ...schemas.runs import DrivenObstacle, LimitExcess, Outcome, Refusal, RunRecord, RunSteps, RunTiming
from ..commonroad import Track, kept_recording
from ..criticality import drive_criticality
from ..execution import ProgressReporter
from ..geometry import Points, Values, wrap_angles
from ..motion_figures import motion_figures
from ..vehicles import VehicleParameters, vehicle_of
from .driving.acceptance import DrivenStates, Refused, refusal
from .driving.drivability import exceeded_limits
from .driving.solution import steering_of
from .external.command import ScenarioFile
from .external.program import ended_after, log_of
from .interface import EgoState, Observation, Plan, Planner, PlanningTask, ShowsCandidates
from .judge import Verdict
from .registry import (
    check_modes,
    check_world,
    is_built_in,
    make_planner,
    open_traffic,
    planner_version,
    uses_prediction,
    version_that_drives,
)
from .series import run_series
from .simulation import DrivenRun, simulate

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

    from ..commonroad import LoadedScenario

_ROUNDING = 1e-9
"""Values nearer to 0 are rounding errors: an ego at constant speed does not brake."""
_EVERY_S = 0.2
"""Time between two points of a line (chosen)."""
_MOST_CANDIDATES, _MOST_PREDICTIONS, _WITHIN_M = 16, 8, 60.0
"""Shown candidates per planning step, evenly spread over their ranks, and the nearest others with their predictions
(chosen: more would be unreadable).
"""
_SAME_M, _SAME_RAD, _SAME_MPS = 0.01, 0.005, 0.05
"""Tolerances within which a repeated run equals the stored one. Plans are shown to the centimetre; half a hundredth of
a radian moves the corners of a car by a centimetre; and 0.05 m/s is less than the change of speed per step at 1 m/s².
"""
_LEAST_M = 0.5
"""A road user with a shorter predicted motion has no line (chosen)."""


def run_planner(request: RunRequest, report: ProgressReporter) -> RunResponse:
    """Run a planner on one planning problem of a CommonRoad file.

    Raises:
        UnsafeInput: The file cannot be read.
        UnknownName: There is no such planning problem or planner.
        InvalidRequest: The prediction does not fit the traffic, or the vehicle is impossible.
        NotPossible: The ego is a vehicle with a trailer, which the planners here cannot drive.
        PlannerFailure: A user-supplied planner broke its contract.
    """
    began = perf_counter()
    start = _Start.of(request)
    loaded, vehicle = start.loaded, start.vehicle
    file = ScenarioFile(Path(request.scenario_path), str(loaded.scenario.scenario_id))
    _check_version(request)
    check_modes(request.traffic, request.prediction, request.world)
    check_world(request.configuration.planner, request.world)
    version = version_that_drives(request.configuration.planner)
    with ended_after(make_planner(request.configuration.planner, file)) as planner:
        driven = start.drive(planner, report)
    steps = run_steps(driven)
    ending = _apply_benchmark(driven.final, steps, start)
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
        outcome=ending.outcome,
        reason=ending.reason,
        invalid_reason=driven.final.invalid_reason,
        collision=driven.final.collision,
        off_the_lanes=driven.off_the_lanes,
        on_recording=driven.traffic.on_recording,
        triggers=driven.traffic.triggers,
        eased_over_m=driven.blended_over_m,
        rejected_candidates=dict(sorted(driven.rejected.items())),
        metrics=metrics_of(driven, vehicle, loaded.step_s),
        success_rule="accepted@3",
        refusal=ending.refusal,
        beyond_vehicle=_beyond_vehicle(driven, vehicle, loaded.step_s),
        ego_length_m=vehicle.length_m,
        ego_width_m=vehicle.width_m,
        planner_version=version.words,
        planner_source=version.source,
        ego_class=vehicle.vehicle_class,
        friction=vehicle.friction,
        uses_prediction=uses_prediction(request.configuration.planner),
        world=request.world,
    )
    report(1.0, ending.outcome)
    core_s = [plan.core_s for plan in driven.plans if plan.core_s > 0]
    timing = RunTiming(
        wall_s=perf_counter() - began,
        planning_step_median_ms=1000 * median(driven.plan_s) if driven.plan_s else 0.0,
        core_step_median_ms=1000 * median(core_s) if core_s else None,
        steps=len(driven.plan_s),
        planning_ms=tuple(round(1000 * duration_s, 3) for duration_s in driven.plan_s),
    )
    series = run_series(driven, vehicle, loaded.step_s)
    return RunResponse(record=record, steps=steps, timing=timing, series=series, planner_log=log_of(planner))


def _beyond_vehicle(driven: DrivenRun, vehicle: VehicleParameters, step_s: float) -> tuple[LimitExcess, ...]:
    """Return the limits that the driven motion exceeds; a vehicle model may slip, so its wheels need not roll."""
    found = exceeded_limits(driven_ego(driven.states, vehicle), vehicle, step_s, driven.steering_rad)
    return tuple(excess for excess in found if driven.vehicle is None or excess.name != "rolling")


@dataclass(frozen=True)
class _Start:
    """The inputs of a run, as its request gives them."""

    request: RunRequest
    loaded: "LoadedScenario"
    problem: "PlanningProblem"
    vehicle: VehicleParameters

    @classmethod
    def of(cls, request: RunRequest) -> "_Start":
        """Return the scenario in memory, its planning problem, and the ego's vehicle."""
        loaded = kept_recording(Path(request.scenario_path)).loaded
        problem = loaded.problem(request.problem_id)
        if request.begins_at is not None:
            problem = _start_at(problem, request.begins_at)
        vehicle = vehicle_of(request.configuration.settings, loaded.ego_class(int(problem.planning_problem_id)))
        return cls(request, loaded, problem, vehicle.on_road(loaded.friction))

    def drive(self, planner: Planner, report: ProgressReporter) -> DrivenRun:
        """Run a planner in the request's traffic."""
        request, scenario = self.request, self.loaded.scenario
        with open_traffic(request.traffic, self.loaded, self.problem, self.vehicle, request.seed) as traffic:
            return simulate(
                scenario,
                self.problem,
                request.configuration,
                planner,
                request.prediction,
                report,
                traffic,
                self.vehicle,
                request.world,
                request.seed,
                made=self.loaded.made if is_built_in(request.configuration.planner) else None,
            )


def _start_at(problem: "PlanningProblem", moment: RunMoment) -> "PlanningProblem":
    """Return the planning problem with a new initial state and the same goal time."""
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.state import InitialState

    state = InitialState(
        time_step=moment.step,
        position=np.array([moment.x_m, moment.y_m]),
        orientation=moment.heading_rad,
        velocity=moment.speed_mps,
        acceleration=moment.acceleration_mps2,
        yaw_rate=moment.yaw_rate_radps,
        slip_angle=0.0,
    )
    return PlanningProblem(problem.planning_problem_id, state, problem.goal)


@dataclass(frozen=True)
class _Ending:
    """The end of a run by the rule ``accepted@3``."""

    outcome: Outcome
    reason: str
    refusal: Refusal | None = None


_REFUSALS: dict[Refusal, str] = {
    "goal_not_met": "no state meets the goal by its criteria",
    "off_lanelets": "a part of the body is outside the lanelets",
    "not_drivable": "no acceleration and steering lead to the next state",
}


_START_REFUSED = (
    "CommonRoad's benchmark refuses every motion here, because a part of the body is outside the lanelets in the "
    "planning problem's initial state, which no planner can change"
)


def _apply_benchmark(verdict: Verdict, steps: RunSteps, start: _Start) -> _Ending:
    """Return the loop's verdict; a reached goal counts only if CommonRoad's benchmark accepts the motion.

    An initial state that the benchmark refuses does not count, because no planner can change it.
    """
    if verdict.outcome != "goal_reached":
        return _Ending(verdict.outcome, verdict.reason)
    loaded, vehicle = start.loaded, start.vehicle
    driven = DrivenStates.of(steps, vehicle, loaded.step_s)

    def counting(refused: Refused | None) -> Refused | None:
        """Return a refusal that counts: the benchmark's own model cannot slip."""
        slips = refused is not None and refused.code == "not_drivable" and start.request.world.moves_by_model
        return None if slips else refused

    refused = counting(refusal(driven, start.problem.goal, loaded.scenario.lanelet_network, vehicle, loaded.step_s))
    if refused is None:
        return _Ending(verdict.outcome, verdict.reason)
    if refused.code == "off_lanelets" and refused.index == 0:
        later = counting(refused.after_start)
        if later is None:
            return _Ending(verdict.outcome, f"{verdict.reason}; {_START_REFUSED}", refused.code)
        refused = later
    moment = "" if refused.index is None else f" at {refused.index * loaded.step_s:.1f} s"
    why = f"{verdict.reason}, but CommonRoad's benchmark refuses the motion: {_REFUSALS[refused.code]}{moment}"
    return _Ending("goal_refused", why, refused.code)


def _check_version(request: RunRequest) -> None:
    """Refuse to store a run under a version of a user-supplied planner that differs from the current version."""
    name, wanted = request.configuration.planner, request.planner_version
    here = planner_version(name) if wanted else ""
    if here != wanted:
        raise PlannerFailure(
            f"planner {name} has version {here} on the machine that runs it, not {wanted}",
            next_step="call again if it was edited meanwhile; on a cluster, install the same version on every worker",
            reason="other_version",
        )


def metrics_of(driven: DrivenRun, vehicle: VehicleParameters, step_s: float) -> RunMetrics | None:
    """Return the metrics of a run over its driven states, including the initial state; None for an invalid problem."""
    if driven.final.outcome == "invalid":
        return None
    total_costs = [sum(plan.costs.values()) for plan in driven.plans if plan.kind != "standstill" and plan.costs]
    ego = driven_ego(driven.states, vehicle)
    angles = driven.steering_rad
    if angles is None:
        angles = steering_of(ego.headings_rad, ego.speeds_mps, step_s, vehicle.wheelbase_m)
    accelerations = np.array([state.acceleration_mps2 for state in driven.states])
    motion = motion_figures(ego, accelerations, angles, step_s)
    nearness = drive_criticality(ego, driven.traffic.moving, driven.traffic.standing)
    if driven.final.outcome == "off_road":  # the score rates proximity to others, not to a ditch
        nearness = replace(nearness, risk_score=None)
    figures = {
        **motion.totals,
        **{one.name: _largest(one.values) for one in motion.series},
        **vars(nearness),
        "mean_total_cost": float(np.mean(total_costs)) if total_costs else None,
    }
    return RunMetrics.model_validate({name: figures[name] for name in RunMetrics.model_fields})


def _largest(values: Values) -> float:
    """Return the largest value; 0 if there are no values or the largest is only a rounding error."""
    largest = float(max(values, default=0.0))
    return largest if abs(largest) >= _ROUNDING else 0.0


def driven_ego(states: list[EgoState], vehicle: VehicleParameters) -> Track:
    """Return the driven states as a track with the ego's size; no obstacle has its id."""
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
    """Return the driven states; a term or constraint that is missing from a planning step counts as 0."""
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
        steering_rad=() if driven.steering_rad is None else tuple(driven.steering_rad.tolist()),
        plan_steps=tuple(driven.plan_steps),
        others=tuple(_driven_obstacle(track) for track in driven.traffic.driven),
        perceived=None if driven.sensors is None else driven.sensors.perceived(),
        costs={name: tuple(_normal(plan.costs.get(name, 0.0)) for plan in driven.plans) for name in terms},
        rejected={name: tuple(counts.get(name, 0) for counts in driven.rejections) for name in constraints},
    )


def _normal(value: float) -> float:
    """Return a number, or 0 if it is subnormal, since underflow leaves such values."""
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
    """Repeat a run and write its plans as JSON (``RunPlans``) to the request's path.

    If the run differs from the stored one by more than rounding on another machine explains (:func:`_difference`),
    nothing is shown, and the note gives the difference.

    Raises:
        UnsafeInput: The scenario's file cannot be read.
        UnknownName: There is no such planning problem or planner.
        PlannerFailure: A user's planner was edited since, or broke its contract.
    """
    start = _Start.of(request.run)
    file = ScenarioFile(Path(request.run.scenario_path), str(start.loaded.scenario.scenario_id))
    _check_version(request.run)
    with ended_after(make_planner(request.run.configuration.planner, file)) as own:
        planner = _RecordingPlanner(own, start.loaded.step_s)
        driven = start.drive(planner, report)
    stored = RunSteps.model_validate_json(Path(request.steps_path).read_bytes())
    difference = _difference(run_steps(driven), stored)
    if difference is not None:
        return Replayed(note=f"repeated here, the run {difference}, so its plans are not shown")
    plans = tuple(planner.plans[step] for step in driven.plan_steps)
    Path(request.path).write_text(RunPlans(plans=plans).model_dump_json(), encoding="utf-8")
    return Replayed(path=request.path)


def _difference(here: RunSteps, stored: RunSteps) -> str | None:
    """Return the difference between a repeated run and the stored one as text, or None if they are equal.

    They are equal if they have the same number of states, were planned at the same steps, and every state of the ego
    and of reactive traffic is within :data:`_SAME_M`, :data:`_SAME_RAD` and :data:`_SAME_MPS` of the stored one. Other
    processors and libraries round the last digits differently, which does not change the plans in the picture.
    """
    if (here.first_step, len(here.x_m), here.plan_steps) != (stored.first_step, len(stored.x_m), stored.plan_steps):
        counts = [f"{len(one.x_m)} states planned in {len(one.plan_steps)} steps" for one in (here, stored)]
        return f"has {counts[0]}, but the stored one has {counts[1]}"
    drivers: list[tuple[str, RunSteps | DrivenObstacle, RunSteps | DrivenObstacle]] = [("the ego", here, stored)]
    theirs = {one.obstacle_id: one for one in stored.others}
    if sorted(theirs) != sorted(one.obstacle_id for one in here.others):
        return "moves other road users than the stored one"
    for one in here.others:
        other = theirs[one.obstacle_id]
        if (one.first_step, len(one.x_m)) != (other.first_step, len(other.x_m)):
            return f"moves road user {one.obstacle_id} at other times than the stored one"
        drivers.append((f"road user {one.obstacle_id}", one, other))
    for name, mine, its in drivers:
        away_m = np.hypot(np.subtract(mine.x_m, its.x_m), np.subtract(mine.y_m, its.y_m))
        turned = np.abs(wrap_angles(np.subtract(mine.heading_rad, its.heading_rad)))
        faster = np.abs(np.subtract(mine.speed_mps, its.speed_mps))
        beyond = np.flatnonzero((away_m > _SAME_M) | (turned > _SAME_RAD) | (faster > _SAME_MPS))
        if len(beyond):
            first = int(beyond[0])
            return (
                f"differs from the stored one at step {its.first_step + first}: {name} by {away_m[first]:.3f} m, "
                f"{turned[first]:.3f} rad and {faster[first]:.3f} m/s (allowed: {_SAME_M} m, {_SAME_RAD} rad, "
                f"{_SAME_MPS} m/s)"
            )
    return None


@dataclass
class _RecordingPlanner:
    """Wraps a planner and records its planning steps, by step."""

    planner: Planner
    step_s: float
    plans: dict[int, ShownPlan] = field(default_factory=dict)

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run, as the planner does."""
        self.plans.clear()
        self.planner.reset(task)

    def plan(self, observation: Observation) -> Plan:
        """Return the planner's plan, and record the planning step."""
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
        """Return x, y, x, y, … in m, to the centimetre, including the last point."""
        every = max(round(_EVERY_S / self.step_s), 1)
        kept = positions[::every] if (len(positions) - 1) % every == 0 else [*positions[::every], positions[-1]]
        return tuple(np.round(np.asarray(kept), 2).ravel().tolist())
