"""The loop for every planner: observe, plan, follow the plan for a few steps, judge."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.planning import PlannerConfiguration
from ...schemas.runs import Prediction
from ...schemas.text import shown_name
from ...schemas.worlds import PERFECT, World
from ..commonroad import MadeOnce
from ..execution import ProgressReporter
from ..geometry import Values, arc_length
from ..perception import PoseError, Sensors, walls_of
from ..scene import start_lanelets
from ..vehicles import VehicleParameters, rear_axle, vehicle_of
from .driving.desired_speed import SPEED_BAND_MPS
from .driving.dynamics import SimulatedVehicle
from .goal import Goal, path_to, select_goal_state
from .interface import EgoState, Observation, Plan, PlannedTrajectory, Planner, PlanningTask
from .judge import Judge, Verdict
from .lanes import Road, build_road
from .prediction import Predictor, observe, off_the_lanes, predictor
from .reference_path import BEYOND_GOAL_M, BLENDED_OVER_M, FASTEST_MPS, ReferencePath, blended_start
from .traffic.recorded import RecordedTraffic, Traffic

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.scenario import Scenario

_BEYOND_HORIZON_M = 40.0
"""The path extends this much beyond the reach of the fastest candidate (chosen)."""


@dataclass
class DrivenRun:
    """The states, plans and verdict of a run.

    ``plan_s`` and ``rejections`` include a last attempt without a trajectory; ``plans`` does not. ``verdict``: None if
    the run was stopped before the judge ended it. ``task``: the planner's task, or None if the planner was not called.
    ``blended_over_m``: the length of the curve by which the reference path leads the ego onto its route, if it needs
    one (``eased_over_m`` of the record). ``sensors``: those of an imperfect world, which record what the planner
    received about the other road users. ``vehicle``: the vehicle model that drives the ego, if plans are not driven
    exactly.
    """

    states: list[EgoState]
    traffic: Traffic
    plan_steps: list[int] = field(default_factory=list)
    plans: list[Plan] = field(default_factory=list)
    plan_s: list[float] = field(default_factory=list)
    rejections: list[Mapping[str, int]] = field(default_factory=list)
    verdict: Verdict | None = None
    off_the_lanes: tuple[int, ...] = ()
    blended_over_m: float | None = None
    task: PlanningTask | None = None
    sensors: Sensors | None = None
    vehicle: SimulatedVehicle | None = None

    @property
    def rejected(self) -> Counter[str]:
        """The number of candidates that each constraint rejected over the whole run."""
        total: Counter[str] = Counter()
        for counts in self.rejections:
            total.update(counts)
        return total

    @property
    def steering_rad(self) -> Values | None:
        """The steering angles (n,) of a vehicle that follows its plans; None if planned states count as driven."""
        known = [state.steering_rad for state in self.states[1:]]
        if not known or None in known:
            return None
        if self.vehicle is not None:
            return np.array([self.states[0].steering_rad or 0.0, *known], dtype=np.float64)
        begun = self.plans[0].trajectory
        first = None if begun is None or begun.steering_rad is None else begun.steering_rad[0]
        return None if first is None else np.array([first, *known], dtype=np.float64)

    @property
    def has_not_begun(self) -> bool:
        """True if the run ended because the first step found no feasible motion."""
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
    vehicle: VehicleParameters | None = None,
    world: World = PERFECT,
    seed: int = 0,
    is_over: Callable[[DrivenRun], bool] | None = None,
    made: MadeOnce | None = None,
) -> DrivenRun:
    """Run a planner on a planning problem until the judge ends it.

    A problem that no planner can solve (initial collision, off the road, no route, too little time) ends as ``invalid``
    with a code and without a plan. The traffic is recorded by default; reactive traffic must be at the ego's first
    step. ``vehicle``: the ego's vehicle; None selects the configuration's car. In an imperfect ``world`` the planner
    receives what its sensors report, with random numbers from ``seed``; the judge sees the truth. ``is_over``: called
    after every step that the judge does not end; True stops the run without a verdict. ``made``: stores the tasks of
    the scenario's runs, for planners that do not change them.
    """
    ego = EgoState.of(problem.initial_state)
    run = DrivenRun([ego], traffic or RecordedTraffic(scenario))
    task = _task(scenario, problem, configuration, ego, vehicle or vehicle_of(configuration.settings), made)
    if isinstance(task, Verdict):
        run.verdict = task
        return run
    judge = Judge(task, run.traffic, ego)
    run.verdict = judge.before_the_run(ego)
    if run.verdict is None:
        predict = predictor(prediction, scenario.lanelet_network)
        loop = _Loop(planner, predict, report, _sensing(world, seed, scenario), world, is_over)
        loop.drive(task, run, judge)
        if run.has_not_begun:
            run = loop.drive_blended(task, run)
        run.off_the_lanes = off_the_lanes(predict)
    return run


def _sensing(world: World, seed: int, scenario: "Scenario") -> Callable[[], Sensors] | None:
    """Return the function that creates the sensors of one attempt, or None if the planner gets the truth."""
    if not world.hides_truth:
        return None
    walls, step_s = walls_of(scenario), float(scenario.dt)
    return lambda: Sensors(world, seed, step_s, walls)


def _task(
    scenario: "Scenario",
    problem: "PlanningProblem",
    configuration: PlannerConfiguration,
    ego: EgoState,
    vehicle: VehicleParameters,
    made: MadeOnce | None = None,
) -> PlanningTask | Verdict:
    """Return the task, or the reason why the problem is invalid."""
    if made is None:
        return _new_task(scenario, problem, configuration, ego, vehicle)
    network, goal, horizon_s = scenario.lanelet_network, problem.goal, configuration.settings.horizon_s
    task = made.get(
        ("task", id(network), id(goal), ego.key, horizon_s, vehicle, float(scenario.dt)),
        lambda: _new_task(scenario, problem, configuration, ego, vehicle),
        network,
        goal,
    )
    return task if isinstance(task, Verdict) else replace(task, problem=problem, configuration=configuration)


def _new_task(
    scenario: "Scenario",
    problem: "PlanningProblem",
    configuration: PlannerConfiguration,
    ego: EgoState,
    vehicle: VehicleParameters,
) -> PlanningTask | Verdict:
    network, step_s = scenario.lanelet_network, float(scenario.dt)
    if not problem.goal.state_list:
        return Verdict.invalid("no_goal_state", "the planning problem has no goal state")
    try:
        start_lanelets(network, ego.position, ego.heading_rad)
    except NotPossible as nowhere:
        return Verdict.invalid("ego_off_road", nowhere.message)
    aim = select_goal_state(network, problem.goal, ego, vehicle, step_s)
    goal = Goal(aim)
    beyond_m = max(BEYOND_GOAL_M, configuration.settings.horizon_s * FASTEST_MPS + _BEYOND_HORIZON_M)
    ahead_m = beyond_m
    if not goal.has_position:
        ahead_m += (ego.speed_mps + SPEED_BAND_MPS) * max(goal.last_step - ego.step, 0) * step_s
    try:
        reference = path_to(goal, aim, network, ego, ahead_m=ahead_m, beyond_m=beyond_m)
    except NotPossible as no_way:
        return Verdict.invalid("goal_unreachable", no_way.message)
    road = build_road(network, reference, beyond_m=beyond_m)
    return PlanningTask(network, problem, configuration, reference, road, vehicle, step_s, aim)


@dataclass(frozen=True)
class _Loop:
    """The constant part of all attempts to run one planner."""

    planner: Planner
    predict: Predictor
    report: ProgressReporter
    sensing: Callable[[], Sensors] | None = None
    world: World = PERFECT
    is_over: Callable[[DrivenRun], bool] | None = None

    def drive(self, task: PlanningTask, run: DrivenRun, judge: Judge) -> None:
        """Observe, plan, follow and judge until there is a verdict."""
        self.planner.reset(task)
        run.task = task
        settings, step_s = task.configuration.settings, task.step_s
        first, horizon = run.states[0].step, round(settings.horizon_s / step_s)
        sensors = None if self.sensing is None else self.sensing()
        run.sensors = sensors
        if self.world.moves_by_model:
            run.vehicle = SimulatedVehicle(self.world.ego, self.world.actuator_s, task.vehicle, run.states[0], step_s)
        while run.verdict is None:
            ego = run.states[-1]
            share = (ego.step - first) / max(judge.last_step - first, 1)
            self.report(share, f"step {ego.step} of at most {judge.last_step}")
            percept = None if sensors is None else sensors.perceive(run.traffic, run.states)
            error = None if percept is None else percept.error
            believed = ego if error is None else _believed(ego, error)
            observation = Observation(
                believed, observe(percept or run.traffic, believed, self.predict, horizon, step_s)
            )
            began = perf_counter()
            plan = self.planner.plan(observation)
            run.plan_s.append(perf_counter() - began)
            run.rejections.append(plan.rejected)
            if plan.trajectory is None:
                run.verdict = _infeasible(plan, ego, (ego.step - first) * step_s)
                return
            run.plan_steps.append(ego.step)
            run.plans.append(plan)
            motion = plan.trajectory if error is None else _true_motion(plan.trajectory, ego, error)
            count = min(settings.replan_steps, len(motion.positions) - 1)
            for following in _followed(motion, count, ego, step_s, run.vehicle):
                run.states.append(following)
                run.traffic.advance(following)
                run.verdict = judge.after_step(following)
                if run.verdict is not None or (self.is_over is not None and self.is_over(run)):
                    return

    def drive_blended(self, task: PlanningTask, stuck: DrivenRun) -> DrivenRun:
        """Return the run on the first blended path from which the planner can start, else the original run."""
        ego = stuck.states[0]
        rear = rear_axle(ego.position, ego.heading_rad, task.vehicle)
        for over_m in BLENDED_OVER_M:
            reference = blended_start(task.reference, rear, ego.heading_rad, over_m)
            if not _stays_on(task.road, reference, ego, over_m):
                continue
            run = DrivenRun([ego], stuck.traffic, blended_over_m=over_m)
            blended = task.on_path(reference)
            self.drive(blended, run, Judge(blended, run.traffic, ego))
            if not run.has_not_begun:
                return run
        return stuck


def _believed(ego: EgoState, error: PoseError) -> EgoState:
    """Return the ego's state with the pose that the ego believes it has."""
    position = error.believed(ego.position, ego.position)
    return replace(ego, position=position, heading_rad=ego.heading_rad + error.turn_rad)


def _true_motion(plan: PlannedTrajectory, ego: EgoState, error: PoseError) -> PlannedTrajectory:
    """Return the motion of a vehicle that follows a plan from its true pose instead of the believed pose."""
    positions, headings = error.true(plan.positions, ego.position), plan.headings_rad - error.turn_rad
    return replace(plan, positions=positions, headings_rad=headings)


def _followed(
    motion: PlannedTrajectory, count: int, ego: EgoState, step_s: float, vehicle: SimulatedVehicle | None
) -> Iterator[EgoState]:
    """Yield the next states of the ego: those of the plan, or those of a vehicle that follows it."""
    if vehicle is not None:
        yield from vehicle.follow(motion, count, ego.step + 1)
        return
    for ahead in range(1, count + 1):
        yield motion.state_at(ahead, ego.step + ahead, step_s)


def _stays_on(road: Road, blended: ReferencePath, ego: EgoState, over_m: float) -> bool:
    """Return True if the curve of a blended path does not cut a corner across the edge of the road."""
    begin = blended.follower().place(ego.position)[0]
    stations = arc_length(blended.points)
    curve = blended.points[(stations >= begin) & (stations <= begin + over_m)]
    return all(road.holds(point) for point in curve)


def _infeasible(plan: Plan, ego: EgoState, time_s: float) -> Verdict:
    if "initial_state" in plan.rejected:
        return Verdict("infeasible", f"at {time_s:.1f} s the ego's heading or position does not fit its route")
    most = sorted(plan.rejected.items(), key=lambda item: (-item[1], item[0]))
    why = ", ".join(f"{shown_name(name)} {count}" for name, count in most[:3])
    speed = f"{ego.speed_mps:.1f} m/s"
    return Verdict(
        "infeasible", f"at {time_s:.1f} s and {speed} none of the {plan.candidates} candidates can be driven ({why})"
    )
