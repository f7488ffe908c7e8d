"""The loop for every planner: observe, plan, follow the plan for some steps, judge."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, degrees, pi
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.planning import PlannerConfiguration
from ...schemas.runs import CollisionRecord, InvalidReason, Outcome, Prediction
from ..execution import ProgressReporter
from ..geometry import Points, arc_length, interpolate, point_at, project, wrap_angle
from ..scene import find_route, start_lanelets
from ..vehicles import VehicleParameters, rear_axle, vehicle_of
from .goal import Goal, Timing, aimed_at, left_behind, out_of_reach
from .interface import EgoState, Observation, Plan, Planner, PlanningTask
from .lanes import Road, build_road
from .prediction import Predictor, observe, off_the_lanes, predictor
from .reference_path import (
    BEFORE_M,
    BEYOND_GOAL_M,
    ReferencePath,
    build_reference_path,
    cubic,
    evenly,
    straight_on_from,
)
from .traffic.recorded import RecordedTraffic, Traffic, rectangle

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.scenario import Scenario

# ---------- eased_start
# A reference path that begins as the ego stands, for starts from which no candidate gets onto the route's centre line.
#
# An ego may begin askew of its lane, or so fast before a tight turn that steering takes too long: then every candidate
# of a planner that follows the centre line breaks a limit in its first second.

EASED_OVER_M = (10.0, 15.0, 22.0, 33.0, 50.0)
"""Lengths to try in turn: the shortest that can be driven stays closest to the route."""


def eased_start(reference: ReferencePath, ego: EgoState, vehicle: VehicleParameters, over_m: float) -> ReferencePath:
    """The path from the ego's rear axle, in its heading, onto the reference path within ``over_m`` metres of it.

    Behind the ego it goes straight back. Where the reference path is shorter than that, it is joined at its end.
    """
    stations = arc_length(reference.points)
    start = rear_axle(ego.position, ego.heading_rad, vehicle)
    joined_m = min(project(reference.points, start)[0] + over_m, float(stations[-1]) - 1.0)
    end, end_heading_rad = point_at(reference.points, joined_m)
    forward = _direction(ego.heading_rad)
    rest = interpolate(reference.points, stations, np.array([joined_m, *stations[stations > joined_m]]))
    behind = straight_on_from(start + forward, start, BEFORE_M)[::-1]
    curve = cubic(start, forward, end, _direction(end_heading_rad))
    points = evenly(np.concatenate([behind, start[None], curve, rest]))
    straight_m = float(stations[-1]) - reference.network_end_m
    return replace(reference, points=points, network_end_m=float(arc_length(points)[-1]) - straight_m)


def _stays_on(road: Road, eased: ReferencePath, ego: EgoState, over_m: float) -> bool:
    """Whether the curve of an eased path does not cut a corner across the edge of the road."""
    begin = project(eased.points, ego.position)[0]
    stations = arc_length(eased.points)
    curve = eased.points[(stations >= begin) & (stations <= begin + over_m)]
    return all(road.holds(point) for point in curve)


def _direction(heading_rad: float) -> Points:
    return np.array([np.cos(heading_rad), np.sin(heading_rad)])


# ---------- verdict
# When a run ends and how: the judge of the loop, apart from the planner.

TIME_LIMIT_FACTOR = 1.7
"""A run may take so many times the steps from its start to the goal's last step, as in the Frenetix reference."""
MOST_STEPS = 2000
"""No run takes more steps than this, whatever the goal's time."""
PASSED_M = 5.0


@dataclass(frozen=True)
class Verdict:
    """How a run ended, with one sentence of figures; ``invalid_reason`` only where the problem is invalid."""

    outcome: Outcome
    reason: str
    collision: CollisionRecord | None = None
    invalid_reason: InvalidReason | None = None


def invalid(code: InvalidReason, reason: str) -> Verdict:
    """The verdict on a problem that nobody can solve."""
    return Verdict("invalid", reason, invalid_reason=code)


class Judge:
    """Looks at every driven state; knows the road, the others, the goal and the time limit."""

    def __init__(
        self,
        goal: Goal,
        reference: ReferencePath,
        road: Road,
        traffic: Traffic,
        vehicle: VehicleParameters,
        initial: EgoState,
        step_s: float,
    ) -> None:
        self._goal, self._reference, self._road = goal, reference, road
        self._traffic, self._vehicle, self._step_s = traffic, vehicle, step_s
        self._first_step = initial.step
        steps = max(goal.last_step - initial.step, 1)
        self.last_step = initial.step + min(ceil(TIME_LIMIT_FACTOR * steps), MOST_STEPS)
        stations = goal.stations_on(reference.points) if goal.has_position else None
        self._goal_end_m = None if stations is None else stations[1]
        self._was_clear_of_edge = not road.touches_edge(rectangle(initial, vehicle))
        self._stays: set[Timing] = set()  # how the ego's steps in the goal's place lay to the goal's time

    def before_the_run(self, initial: EgoState) -> Verdict | None:
        """Why nobody can solve the problem, or None."""
        hit = self._traffic.hit_by(initial, self._vehicle)
        if hit:
            return invalid("initial_collision", f"the ego overlaps obstacle {hit[0]} ({hit[1]}) in its initial state")
        if not self._road.holds(initial.position):
            return invalid("ego_off_road", "the ego starts off the road")
        turned_rad = self._off_route_rad(initial)
        if turned_rad > pi / 2:
            turned = f"the ego heads {degrees(turned_rad):.0f}° off the way to its goal, and nobody drives backwards"
            return invalid("ego_against_route", turned)
        too_far = out_of_reach(self._goal, initial, self._vehicle, self._step_s)
        return invalid("goal_out_of_time", too_far) if too_far else None

    def _off_route_rad(self, ego: EgoState) -> float:
        """The angle between the ego's heading and the reference path beside it."""
        path = self._reference.points
        return abs(wrap_angle(ego.heading_rad - point_at(path, project(path, ego.position)[0])[1]))

    def after_step(self, ego: EgoState) -> Verdict | None:
        """The verdict if this state ends the run."""
        return self._collision(ego) or self._off_road(ego) or self._at_goal(ego) or self._out_of_time(ego)

    def _collision(self, ego: EgoState) -> Verdict | None:
        hit = self._traffic.hit_by(ego, self._vehicle)
        if hit is None:
            return None
        time_s = self._time_s(ego)
        record = CollisionRecord(obstacle_id=hit[0], kind=hit[1], step=ego.step, time_s=time_s)
        reason = f"collided with obstacle {hit[0]} ({hit[1]}) at {time_s:.1f} s, driving {ego.speed_mps:.1f} m/s"
        return Verdict("collision", reason, record)

    def _off_road(self, ego: EgoState) -> Verdict | None:
        touches = self._road.touches_edge(rectangle(ego, self._vehicle))
        leaves = touches if self._was_clear_of_edge else not self._road.holds(ego.position)
        self._was_clear_of_edge = self._was_clear_of_edge or not touches
        if not leaves:
            return None
        time_s = self._time_s(ego)
        record = CollisionRecord(obstacle_id=None, kind="road_boundary", step=ego.step, time_s=time_s)
        reason = f"left the road at {time_s:.1f} s, driving {ego.speed_mps:.1f} m/s"
        return Verdict("off_road", reason, record)

    def _at_goal(self, ego: EgoState) -> Verdict | None:
        states = self._goal.status(ego)
        if any(status.reached for status in states):
            return Verdict("goal_reached", f"reached the goal at {self._time_s(ego):.1f} s (step {ego.step})")
        self._stays |= {status.timing for status in states if status.position}
        for status, window in zip(states, self._goal.windows, strict=True):
            if status.all_but_time and status.timing == "late" and ego.step > self._goal.last_step:
                late = ego.step - window.last
                return Verdict("goal_late", f"met the goal at step {ego.step}, {late} steps after its last")
        return self._beyond_goal(ego) if self._goal.has_position else self._too_late_anywhere(ego)

    def _too_late_anywhere(self, ego: EgoState) -> Verdict | None:
        """A goal without a place: its conditions were not met by its last step."""
        if ego.step <= self._goal.last_step:
            return None
        reason = f"the goal's last step {self._goal.last_step} passed at {ego.speed_mps:.1f} m/s without its conditions"
        return Verdict("goal_missed", reason)

    def _beyond_goal(self, ego: EgoState) -> Verdict | None:
        """A goal with a place: the ego has left it behind, or passes beside it when its time is over."""
        if self._goal_end_m is None:
            return None
        beyond_m = self._beyond_m(ego)
        time_over = ego.step > self._goal.last_step
        if not (beyond_m > PASSED_M or (time_over and self._stays and beyond_m > 0)):
            return None
        if not self._stays:
            reason = f"passed beside the goal region by step {ego.step} and was never in it"
            return Verdict("goal_missed", reason) if time_over else None
        window = f"{self._goal.first_step} to {self._goal.last_step}"
        return Verdict(
            self._outcome_of_stays(),
            f"drove out of the goal region by step {ego.step} at {ego.speed_mps:.1f} m/s; its time is step {window}",
        )

    def _out_of_time(self, ego: EgoState) -> Verdict | None:
        if ego.step < self.last_step:
            return None
        cause = f"{TIME_LIMIT_FACTOR} × the goal's last step"
        if ego.step - self._first_step >= MOST_STEPS:
            cause = f"no run takes more than {MOST_STEPS} steps"
        limit = f"{self._time_s(ego):.1f} s ({cause})"
        if self._stays:
            reason = f"was in the goal region but never met all its conditions within {limit}"
            return Verdict(self._outcome_of_stays(), reason)
        left = ""
        if self._goal_end_m is not None and self._beyond_m(ego) < 0:
            left = f", {-self._beyond_m(ego):.0f} m before the goal's end"
        return Verdict("timeout", f"ran out of time after {limit}{left}")

    def _outcome_of_stays(self) -> Outcome:
        """What it means to have been in the goal's place without reaching the goal.

        In its time the goal's speed or heading was missing; otherwise only the time was wrong, the last stay counting.
        """
        if "in_time" in self._stays:
            return "goal_missed"
        return "goal_late" if "late" in self._stays else "goal_early"

    def _beyond_m(self, ego: EgoState) -> float:
        """How far the ego is beyond the end of the goal along the reference path, in m."""
        return project(self._reference.points, ego.position)[0] - float(self._goal_end_m or 0.0)

    def _time_s(self, ego: EgoState) -> float:
        return round((ego.step - self._first_step) * self._step_s, 9)


# ---------- simulation
# The loop for every planner: observe, plan, follow the plan for some steps, judge.

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
    ego = EgoState.of(problem.initial_state)
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
        if not _stays_on(task.road, reference, ego, over_m):
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
