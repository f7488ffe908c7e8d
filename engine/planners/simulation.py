"""The loop for every planner: observe, plan, follow the plan for some steps, judge."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.execution.progress import ProgressReporter
from plannerforge.engine.planners.aim import aimed_at
from plannerforge.engine.planners.eased_start import EASED_OVER_M, eased_start, stays_on
from plannerforge.engine.planners.goal import Goal
from plannerforge.engine.planners.interface import EgoState, Observation, Plan, Planner, PlanningTask
from plannerforge.engine.planners.prediction import Predictor, observe, off_the_lanes, predictor
from plannerforge.engine.planners.reachability import left_behind
from plannerforge.engine.planners.reference_path import BEYOND_GOAL_M, build_reference_path
from plannerforge.engine.planners.road import build_road
from plannerforge.engine.planners.route import find_route, start_lanelets
from plannerforge.engine.planners.traffic import RecordedTraffic, Traffic
from plannerforge.engine.planners.vehicle_models import vehicle_of
from plannerforge.engine.planners.verdict import Judge, Verdict, invalid
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.schemas.runs import Prediction

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.scenario import Scenario

FASTEST_MPS = 36.0


@dataclass
class DrivenRun:
    """What a run has given so far.

    ``plan_s`` and ``rejections`` hold the last attempt too where it gave no trajectory; ``plans`` does not.
    ``eased_over_m``: length of the curve by which the reference path leads the ego onto its route, where it needs one.
    """

    states: list[EgoState]
    traffic: Traffic
    plan_steps: list[int] = field(default_factory=list)
    plans: list[Plan] = field(default_factory=list)
    plan_s: list[float] = field(default_factory=list)
    rejections: list[Mapping[str, int]] = field(default_factory=list)
    verdict: Verdict | None = None
    off_the_lanes: tuple[int, ...] = ()
    eased_over_m: float | None = None

    @property
    def rejected(self) -> Counter[str]:
        """How many candidates each constraint rejected over the whole run."""
        total: Counter[str] = Counter()
        for counts in self.rejections:
            total.update(counts)
        return total

    @property
    def has_not_begun(self) -> bool:
        """Whether it ended because the first step found nothing that can be driven."""
        return self.verdict is not None and self.verdict.outcome == "infeasible" and not self.plans

    @property
    def final(self) -> Verdict:
        """The verdict of an ended run."""
        if self.verdict is None:
            raise RuntimeError("the run has not ended")
        return self.verdict


def simulate(
    scenario: "Scenario",
    problem: "PlanningProblem",
    configuration: PlannerConfiguration,
    planner: Planner,
    prediction: Prediction,
    report: ProgressReporter,
    traffic: Traffic | None = None,
) -> DrivenRun:
    """Run a planner on a planning problem until the judge ends it.

    A problem that nobody can solve (initial collision, off the road, no route, too little time) ends as ``invalid``
    with a code and without a plan.
    The traffic is the recorded one by default; one that reacts must stand at the ego's first step.
    """
    ego = initial_ego(problem.initial_state)
    run = DrivenRun([ego], traffic or RecordedTraffic(scenario))
    task = _task(scenario, problem, configuration, ego)
    if isinstance(task, Verdict):
        run.verdict = task
        return run
    judge = _judge(task, run)
    run.verdict = judge.before_the_run(ego)
    if run.verdict is None:
        predict = predictor(prediction, scenario.lanelet_network)
        _drive(run, planner, judge, predict, task, report)
        if run.has_not_begun:
            run = _eased(run, planner, predict, task, report)
        run.off_the_lanes = off_the_lanes(predict)
    return run


def _eased(
    stuck: DrivenRun, planner: Planner, predict: Predictor, task: PlanningTask, report: ProgressReporter
) -> DrivenRun:
    """The run on the first eased path that the planner can begin on; the run as it was where there is none."""
    ego = stuck.states[0]
    for over_m in EASED_OVER_M:
        reference = eased_start(task.reference, ego, task.vehicle, over_m)
        if not stays_on(task.road, reference, ego, over_m):
            continue
        run = DrivenRun([ego], stuck.traffic, eased_over_m=over_m)
        eased = replace(task, reference=reference)
        _drive(run, planner, _judge(eased, run), predict, eased, report)
        if not run.has_not_begun:
            return run
    return stuck


def _judge(task: PlanningTask, run: DrivenRun) -> Judge:
    goal = Goal(task.problem.goal)
    return Judge(goal, task.reference, task.road, run.traffic, task.vehicle, run.states[0], task.step_s)


def initial_ego(state: Any) -> EgoState:
    """The ego of a planning problem; uncertain values count by their middle, missing ones as 0."""
    position = state.position.center if hasattr(state.position, "center") else state.position
    return EgoState(
        step=int(_middle(state.time_step)),
        position=np.array(position, dtype=float),
        heading_rad=_middle(getattr(state, "orientation", None)),
        speed_mps=_middle(getattr(state, "velocity", None)),
        acceleration_mps2=_middle(getattr(state, "acceleration", None)),
        yaw_rate_radps=_middle(getattr(state, "yaw_rate", None)),
    )


def _task(
    scenario: "Scenario", problem: "PlanningProblem", configuration: PlannerConfiguration, ego: EgoState
) -> PlanningTask | Verdict:
    """The task, or why there is none."""
    network, step_s = scenario.lanelet_network, float(scenario.dt)
    if not problem.goal.state_list:
        return invalid("no_goal_state", "the planning problem has no goal state")
    try:
        start_lanelets(network, ego.position, ego.heading_rad)
    except NotPossible as nowhere:
        return invalid("ego_off_road", nowhere.message)
    vehicle = vehicle_of(configuration.settings)
    aim = aimed_at(network, problem.goal, ego, vehicle, step_s)
    goal = Goal(aim)
    beyond_m = max(BEYOND_GOAL_M, configuration.settings.horizon_s * FASTEST_MPS + 40.0)
    ahead_m = beyond_m
    if not goal.has_position:
        ahead_m += (ego.speed_mps + 5.0) * max(goal.last_step - ego.step, 0) * step_s
    try:
        route = find_route(network, aim, ego.position, ego.heading_rad, ahead_m=ahead_m)
    except NotPossible as no_way:
        return invalid("goal_unreachable", no_way.message)
    reference = build_reference_path(network, route, ego.position, ego.speed_mps, beyond_m=beyond_m)
    if goal.has_position and goal.stations_on(reference.points) is None:
        reference = build_reference_path(
            network, route, ego.position, ego.speed_mps, beyond_m=beyond_m, through=goal.center
        )
    behind = left_behind(goal, ego, reference, network)
    if behind is not None:
        return invalid("goal_unreachable", behind)
    road = build_road(network, reference, beyond_m=beyond_m)
    return PlanningTask(scenario, problem, configuration, reference, road, vehicle, step_s, aim)


def _drive(
    run: DrivenRun, planner: Planner, judge: Judge, predict: Predictor, task: PlanningTask, report: ProgressReporter
) -> None:
    planner.reset(task)
    settings, step_s = task.configuration.settings, task.step_s
    first, horizon = run.states[0].step, round(settings.horizon_s / step_s)
    while run.verdict is None:
        ego = run.states[-1]
        report((ego.step - first) / max(judge.last_step - first, 1), f"step {ego.step} of at most {judge.last_step}")
        observation = Observation(ego, observe(run.traffic, ego, predict, horizon, step_s))
        began = perf_counter()
        plan = planner.plan(observation)
        run.plan_s.append(perf_counter() - began)
        run.rejections.append(plan.rejected)
        if plan.trajectory is None:
            run.verdict = _infeasible(plan, ego, (ego.step - first) * step_s)
            return
        run.plan_steps.append(ego.step)
        run.plans.append(plan)
        for ahead in range(1, min(settings.replan_steps, len(plan.trajectory.positions) - 1) + 1):
            following = plan.trajectory.state_at(ahead, ego.step + ahead, step_s)
            run.states.append(following)
            run.traffic.advance(following)
            run.verdict = judge.after_step(following)
            if run.verdict is not None:
                return


def _infeasible(plan: Plan, ego: EgoState, time_s: float) -> Verdict:
    if "initial_state" in plan.rejected:
        return Verdict("infeasible", f"at {time_s:.1f} s the ego's heading or place does not fit its route")
    most = sorted(plan.rejected.items(), key=lambda item: (-item[1], item[0]))
    why = ", ".join(f"{name} {count}" for name, count in most[:3])
    speed = f"{ego.speed_mps:.1f} m/s"
    return Verdict(
        "infeasible", f"at {time_s:.1f} s and {speed} none of {plan.candidates} candidates can be driven ({why})"
    )


def _middle(value: Any) -> float:
    if value is None:
        return 0.0
    number = 0.5 * (float(value.start) + float(value.end)) if hasattr(value, "start") else float(value)
    return number if math.isfinite(number) else 0.0
