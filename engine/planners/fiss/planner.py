"""FISS: iterative search over sampled end states (Sun et al.), with its C++ core in our own loop.

The core samples end states in the lanes along the reference path and searches them for the cheapest valid trajectory.
It generates and checks only the candidates that its search reaches. The setting ``search`` selects one of four
searches. The result is checked once more, for the limits of the vehicle and against the exact bodies and the edge of
the road; if that fails, all candidates are generated, and the ego drives the cheapest one that passes.

If no candidate passes, the planner falls back in its authors' order: the rest of its last plan, a plan that ignores the
hard limits on distances to others, a plan that considers collisions for only 2.5 s, and braking. We add two searches
before it brakes. The first is without the core's margins, since an ego that is already too close to a road user would
never get a plan. The second may exceed the desired speed, since braking in front of a follower does not help.

Sources: Sun, Liu, Yin, Ang: FISS: A Trajectory Planning Framework Using Fast Iterative Search and Sampling Strategy for
Autonomous Driving, RA-L 2022 (10.1109/LRA.2022.3191940). Sun et al.: FISS+: Efficient and Focused Trajectory Generation
and Refinement Using Fast Iterative Search and Sampling Strategy, IROS 2023 (10.1109/IROS55552.2023.10341498).
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import fiss_planner
import numpy as np

from ...geometry import Points
from ...vehicles import STANDING_MPS, rear_axle
from ..driving.desired_speed import DesiredSpeed
from ..driving.drivability import violated_limit
from ..driving.following import FOLLOWED_WITHIN_M, follow
from ..interface import Observation, Plan, PlanKind, PlannedTrajectory, PlanningTask, evenly_chosen
from ..safety import SafetyCheck
from .core import (
    BRISKEST_MPS2,
    LOW_SPEED_MPS,
    REJECTIONS,
    Care,
    DrivenPlan,
    PathLine,
    braking_trajectory,
    copied_trajectory,
    core_configuration,
    core_obstacles,
    costs_of,
    vehicle_limits,
)
from .corridor import lane_bands

_SHORT_HORIZON_S = 2.5
"""The core's default: the time for which collisions count if no candidate is free for longer."""
_BRAKING_SHARES = (1.0, 0.75, 0.5, 0.35, 0.2)
"""Shares of the vehicle's deceleration that are tried in turn, since in a curve the tyres also hold the ego on its
path.
"""
_REST_S = 1.0
"""Shortest duration of a plan by the contract of planners."""
_RECOVERY_MPS2 = 2.0
"""The core's default: the largest deceleration with which a plan starts after the ego has braked at its limit."""


@dataclass
class _Step:
    """One planning step in progress: the ego's state and the results so far."""

    observation: Observation
    start: "fiss_planner.FrenetState"
    target_mps: float
    reach_m: float
    safety: SafetyCheck
    rejected: Counter[str] = field(default_factory=Counter)
    candidates: int = 0
    core_s: float = 0.0
    _obstacles: dict[float, list["fiss_planner.Obstacle"]] = field(default_factory=dict)

    def obstacles(self, step_s: float, until_s: float) -> list["fiss_planner.Obstacle"]:
        """Return the obstacles that can matter until a time."""
        if until_s not in self._obstacles:
            seen = self.observation
            self._obstacles[until_s] = core_obstacles(seen.obstacles, seen.ego, self.reach_m, step_s, until_s)
        return self._obstacles[until_s]


class Fiss:
    """FISS as a planner of the loop; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        limits = vehicle_limits(task.vehicle)
        self._path = task.made.get("line of the core", lambda: PathLine(task.reference, limits.max_lat_accel))
        self._bands = task.made.get("lane bands", lambda: lane_bands(task.network, task.reference))
        self._corridors: dict[tuple[float, float], fiss_planner.Corridor] = {}
        self._desired_speed = DesiredSpeed.of(task)
        self._cores: dict[tuple[bool, Care, bool], fiss_planner.Planner] = {}
        self._station_m: float | None = None
        self._driven: DrivenPlan | None = None
        self._has_braked = False
        self._step: _Step | None = None

    def plan(self, observation: Observation) -> Plan:
        """Search, and return the cheapest candidate that is safe and that the vehicle can drive."""
        ego, task = observation.ego, self._task
        index = self._driven.index_of(ego) if self._driven else None
        start = self._start(observation, index)
        if start is None:
            self._step = None
            return Plan(None, rejected={"initial_state": 1}, candidates=1)
        self._station_m = start.s
        horizon_s = task.configuration.settings.horizon_s
        desired_mps = min(self._desired_speed.at(ego), task.vehicle.maximum_speed_mps)
        reach_m = max(ego.speed_mps, desired_mps, 5.0) * horizon_s
        target_mps = max(min(desired_mps, self._path.curve_speed_mps(start.s, reach_m)), 0.0)
        step = self._step = _Step(observation, start, target_mps, reach_m, SafetyCheck(task, observation))
        return (
            self._search_plan(step)
            or self._rest(step, index)
            or self._search_plan(step, "margins")
            or self._search_plan(step, "margins", until_s=_SHORT_HORIZON_S)
            or self._search_plan(step, "bodies", until_s=_SHORT_HORIZON_S)
            or self._search_plan(step, "bodies", until_s=_SHORT_HORIZON_S, target_mps=self._hurrying_mps(step))
            or self._brake(step)
        )

    def shown_candidates(self, most: int) -> Sequence[Points]:
        """Return valid candidates of the last planning step, ordered by cost."""
        step = self._step
        found = [] if step is None else self._valid(step, "full", math.inf, step.target_mps)
        return [self._trajectory(found[i], step).positions for i in evenly_chosen(len(found), most) if step]

    def _start(self, observation: Observation, index: int | None) -> "fiss_planner.FrenetState | None":
        """Return the ego's centre in the frame of the path, from the plan that it follows or as observed."""
        ego = observation.ego
        if index is not None and self._driven is not None and index < len(self._driven.candidate.t):
            return self._driven.candidate.frenet_state_at(index)
        if self._has_braked:
            ego = replace(ego, acceleration_mps2=max(ego.acceleration_mps2, -_RECOVERY_MPS2))
        near_m = self._station_m
        if near_m is None:
            near_m = self._path.first_station(rear_axle(ego.position, ego.heading_rad, self._task.vehicle))
        return self._path.start(ego, self._task.vehicle, near_m)

    def _core(self, care: Care, *, slow: bool, every_candidate: bool = False) -> "fiss_planner.Planner":
        """Return the core for an ego at low or normal speed; each core remembers its last plan."""
        key = slow, care, every_candidate
        if key not in self._cores:
            configuration = core_configuration(
                self._task.configuration.weights,
                self._task.configuration.settings,
                self._task.step_s,
                offsets=1 if slow else None,
                care=care,
                every_candidate=every_candidate,
            )
            self._cores[key] = fiss_planner.make_planner(configuration, vehicle_limits(self._task.vehicle))
        return self._cores[key]

    def _search_plan(
        self, step: _Step, care: Care = "full", *, until_s: float = math.inf, target_mps: float | None = None
    ) -> Plan | None:
        """Return the plan of one search, or None if no candidate that it reached is drivable and safe.

        ``until_s``: the time for which collisions count; ``target_mps``: an end speed other than the desired speed.
        """
        target = step.target_mps if target_mps is None else target_mps
        result = self._result(step, care, until_s, target)
        step.candidates += result.stats.num_generated
        for name, count in result.stats.rejections.items():
            if count:
                step.rejected[REJECTIONS[name]] += count
        if not result.success:
            return None
        plan = self._driven_if_safe(result.trajectory, step, until_s)
        if plan is not None:
            return plan
        others = self._valid(step, care, until_s, target)
        step.candidates += len(others)
        return next(filter(None, (self._driven_if_safe(other, step, until_s) for other in others)), None)

    def _valid(self, step: _Step, care: Care, until_s: float, target_mps: float) -> list["fiss_planner.Trajectory"]:
        """Return all valid candidates by cost, including those that the core's search does not reach."""
        every = self._result(step, care, until_s, target_mps, every_candidate=True).candidates
        return sorted((one for one in every if one.rejection == fiss_planner.Rejection.OK), key=_total_cost)

    def _result(
        self, step: _Step, care: Care, until_s: float, target_mps: float, *, every_candidate: bool = False
    ) -> "fiss_planner.PlanResult":
        ego = step.observation.ego
        slow = ego.speed_mps < LOW_SPEED_MPS
        corridor = self._kept_offset(step) if slow else self._lanes(step)
        obstacles = step.obstacles(self._task.step_s, until_s)
        core = self._core(care, slow=slow, every_candidate=every_candidate)
        began = perf_counter()
        result = core.plan(step.start, self._path.line, corridor, obstacles, target_speed=target_mps)
        step.core_s += perf_counter() - began
        return result

    def _hurrying_mps(self, step: _Step) -> float:
        """Return the speed that the ego can reach within half of the horizon, if curves allow it.

        The core samples no speeds above its target, so without this an ego that is slower than its followers could only
        brake.
        """
        gained_mps = BRISKEST_MPS2 * self._task.configuration.settings.horizon_s / 2
        fastest_mps = min(step.observation.ego.speed_mps + gained_mps, self._task.vehicle.maximum_speed_mps)
        within_curves = min(fastest_mps, self._path.curve_speed_mps(step.start.s, step.reach_m))
        return max(step.target_mps, within_curves)

    def _lanes(self, step: _Step) -> "fiss_planner.Corridor":
        """Return the lanes along the path; an adjacent lane costs more if the route does not change to it."""
        weight = self._task.configuration.weights["route"]
        right, left = self._bands.off_route(step.start.s)
        costs = weight * right, weight * left
        if costs not in self._corridors:
            self._corridors = {costs: self._bands.corridor(*costs)}
        return self._corridors[costs]

    def _kept_offset(self, step: _Step) -> "fiss_planner.Corridor":
        """Return a corridor around the offset that a slow ego has or drifts to."""
        horizon_s = self._task.configuration.settings.horizon_s
        offset = step.start.d + step.start.d_d * horizon_s / 4
        half = self._bands.half_width_at(step.start.s)
        begin, end = step.start.s - 10.0, step.start.s + step.reach_m + 10.0
        return fiss_planner.Corridor.uniform(begin, end, offset - half, offset + half, 10.0)

    def _driven_if_safe(self, candidate: "fiss_planner.Trajectory", step: _Step, until_s: float) -> Plan | None:
        trajectory = self._trajectory(candidate, step)
        reason: str | None = violated_limit(trajectory, self._task.vehicle, self._task.step_s)
        if reason is None:
            counted = None if until_s == math.inf else 1 + round(until_s / self._task.step_s)
            followed = step.safety.followed(trajectory, FOLLOWED_WITHIN_M, counted, is_safe=True)
            if not isinstance(followed, str):
                self._has_braked = False
                self._driven = DrivenPlan(step.observation.ego.step, candidate, trajectory)
                return self._plan_of(followed.trajectory, step, costs_of(candidate))
            reason = followed
        step.rejected[reason] += 1
        return None

    def _followed(self, trajectory: PlannedTrajectory, step: _Step) -> PlannedTrajectory:
        """Return the motion with which the vehicle follows a trajectory, however far it deviates."""
        return follow(trajectory, step.observation.ego, self._task.vehicle, self._task.step_s).trajectory

    def _trajectory(self, candidate: "fiss_planner.Trajectory", step: _Step) -> PlannedTrajectory:
        return copied_trajectory(candidate, step.observation.ego, self._task.vehicle, self._task.step_s)

    def _plan_of(
        self,
        trajectory: PlannedTrajectory,
        step: _Step,
        costs: dict[str, float] | None = None,
        kind: PlanKind = "regular",
    ) -> Plan:
        return Plan(trajectory, costs or {}, dict(step.rejected), step.candidates, kind, step.core_s)

    def _rest(self, step: _Step, index: int | None) -> Plan | None:
        """Return the rest of the plan that the ego follows, if it is still long enough and safe."""
        if index is None or self._driven is None:
            return None
        rest = self._driven.rest(index)
        if (len(rest.positions) - 1) * self._task.step_s < _REST_S - 1e-9:
            return None
        followed = step.safety.followed(rest, FOLLOWED_WITHIN_M)
        if isinstance(followed, str):
            return None
        return self._plan_of(followed.trajectory, step, costs_of(self._driven.candidate))

    def _brake(self, step: _Step) -> Plan:
        """Stand still, or brake as hard as the tyres allow on the path; return no plan if braking is impossible."""
        ego, task = step.observation.ego, self._task
        self._driven, self._has_braked = None, True
        horizon_s = task.configuration.settings.horizon_s
        if ego.speed_mps <= STANDING_MPS:
            count = round(horizon_s / task.step_s) + 1
            positions, headings = np.repeat(ego.position[None, :], count, axis=0), np.full(count, ego.heading_rad)
            still = PlannedTrajectory(positions, headings, np.zeros(count), np.zeros(count))
            return self._plan_of(self._followed(still, step), step, kind="standstill")
        hardest = task.vehicle.maximum_acceleration_mps2
        for trajectory in self._braking_trajectories(step, (share * hardest for share in _BRAKING_SHARES)):
            limit = violated_limit(trajectory, task.vehicle, task.step_s)
            if limit is None:
                return self._plan_of(self._followed(trajectory, step), step, kind="stopping")
            step.rejected[limit] += 1
        return Plan(None, {}, dict(step.rejected), max(step.candidates, 1), core_s=step.core_s)

    def _braking_trajectories(self, step: _Step, decelerations: Iterable[float]) -> Iterable[PlannedTrajectory]:
        task, ego = self._task, step.observation.ego
        horizon_s = task.configuration.settings.horizon_s
        line, start = self._path.line, step.start
        for hard in decelerations:
            yield braking_trajectory(line, start, hard, ego, task.vehicle, task.step_s, horizon_s)


def _total_cost(candidate: "fiss_planner.Trajectory") -> float:
    return float(candidate.total_cost())
