"""Frenetix: the sampling planner of TUM, with its C++ core in our own loop.

Candidates end at sampled durations, speeds and lateral offsets (quartic along, quintic across the reference path). They
are checked in order of cost against the limits of the vehicle, the predicted obstacles and the edge of the road; the
ego drives the first that passes. If no candidate passes, an ego below 0.1 m/s stands still; otherwise it drives the
feasible candidate that stops soonest.
"""

import heapq
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby, islice
from operator import itemgetter
from time import perf_counter
from typing import Any, Protocol, TypeVar

import frenetix
import numpy as np
from numpy.typing import NDArray

from ...geometry import Points
from ...vehicles import STANDING_MPS
from ..driving.desired_speed import DesiredSpeed
from ..driving.drivability import Limit, violated_limit
from ..driving.following import FollowedPlan, follow
from ..interface import Observation, Plan, PlanKind, PlannedTrajectory, PlanningTask, evenly_chosen
from ..lanes import LaneCenters, LaneCorridors
from ..safety import SafetyCheck
from .core import (
    CONSTRAINTS,
    FINAL_SPEED,
    DrivenPlan,
    EndState,
    FrameKeeper,
    PlanningStep,
    SamplingSettings,
    add_feasibility,
    add_step_functions,
    collision_probability,
    copied_curvilinear,
    copied_trajectory,
    initial_state,
    sampling_matrix,
)
from .costs import OWN_TERMS, CandidateBatch
from .screening import Screening

_LOW_SPEED_MPS = 2.0
"""Speed below which the core plans with lateral derivatives by arc length (``CurvilinearState``; chosen)."""
COMPLETED_AT_ONCE = 16
"""Candidates that get our own cost terms together, while the core computes its terms one by one (chosen)."""
_MADE_AT_ONCE = 16
"""Candidates that the core generates at a time, cheapest first (chosen)."""


class Frenetix:
    """Frenetix as a planner in the planning loop; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def __init__(
        self,
        settings: SamplingSettings | None = None,
        desired_speed: Callable[[PlanningTask], DesiredSpeed] = DesiredSpeed.of,
    ) -> None:
        self._given_settings, self._desired_speed_of = settings, desired_speed

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._settings = self._given_settings or SamplingSettings.of(task.configuration.settings)
        self._weights = task.configuration.weights
        self._own_terms = {name: term for name, term in OWN_TERMS.items() if self._weights[name] > 0}
        network = task.network
        self._lanes = task.made.get("lane centres", lambda: LaneCenters(network)) if self._own_terms else None
        self._corridors = task.made.get("lane corridors", lambda: LaneCorridors(network)) if self._own_terms else None
        self._frames = FrameKeeper(task.reference.points, task.made)
        self._follower = task.reference.follower()
        self._desired_speed = self._desired_speed_of(task)
        self._handler = frenetix.TrajectoryHandler(task.step_s)
        add_feasibility(self._handler, task.vehicle)
        self._driven: DrivenPlan | None = None

    def plan(self, observation: Observation) -> Plan:
        """Sample, compute costs, and return the first candidate that is safe."""
        ego, task = observation.ego, self._task
        horizon_s = self._settings.horizon_s
        reach_m = (ego.speed_mps + task.vehicle.maximum_acceleration_mps2 / 6.0 * horizon_s) * horizon_s
        frame = self._frames.frame_for(self._follower.place(ego.position)[0], reach_m)
        low_speed, desired_mps = ego.speed_mps < _LOW_SPEED_MPS, self._desired_speed.at(ego)
        step = PlanningStep(observation, frame, self._settings, low_speed, desired_mps, task.step_s, reach_m)
        self._step = step
        within_m = self._settings.followed_within_m
        state = self._driven.state_for(ego, low_speed, within_m) if self._driven else None
        going_on = self._driven.rest_for(ego, task.step_s) if self._driven and state else None
        state = state or initial_state(frame, ego, task.vehicle, low_speed)
        if state is None:
            step.rejected["initial_state"] = 1
            return Plan(None, rejected=dict(step.rejected))
        matrix = sampling_matrix(state, ego.speed_mps, self._settings, task.vehicle, going_on)
        feasible = self._feasible(matrix, step)
        safety = SafetyCheck(task, observation)
        followed: FollowedPlan | None = None

        def objection(sample: "frenetix.TrajectorySample") -> str | None:
            nonlocal followed
            trajectory = copied_trajectory(sample, frame, ego, task.vehicle)
            limit = violated_limit(trajectory, task.vehicle, task.step_s)
            if limit is not None:
                return limit
            driven = safety.followed(trajectory, within_m)
            if isinstance(driven, str):
                return driven
            followed = driven
            return None

        chosen = first_feasible(self._ranked(feasible, step), objection, step.rejected)
        if chosen is not None:
            return self._drive(chosen, "regular", step, followed)
        return self._fallback(feasible, float(state.lateral[0]), step)

    def shown_candidates(self, most: int) -> Sequence[Points]:
        """Return feasible candidates of the last planning step, in their order before the expensive cost terms."""
        step, samples = self._step, list(self._candidates)
        chosen = evenly_chosen(len(samples), most)
        return [copied_trajectory(samples[i], step.frame, step.ego, self._task.vehicle).positions for i in chosen]

    def _feasible(self, matrix: Points, step: PlanningStep) -> "_Feasible":
        """Return the feasible candidates with their cheap terms; count the others by the constraint that they break."""
        add_step_functions(self._handler, self._weights, step)
        began = perf_counter()
        screening = Screening.of(matrix, step, self._task.vehicle, self._weights)
        self._candidates = feasible = _Feasible(self._handler, matrix, step, screening)
        step.core_s = perf_counter() - began
        step.candidates, step.fastest_mps = len(matrix), float(matrix[:, FINAL_SPEED].max())
        for broken, count in feasible.others.items():
            for name in broken or ("negative_speed",):
                step.rejected[name] += count
        if missing := step.candidates - feasible.count - feasible.others.total():
            step.rejected["off_reference_path"] += missing
        return feasible

    def _ranked(
        self, feasible: Iterable["frenetix.TrajectorySample"], step: PlanningStep
    ) -> Iterator["frenetix.TrajectorySample"]:
        """Return feasible candidates, cheapest first; the expensive terms are computed on demand."""
        weight, collision = self._weights["prediction"], None
        if weight > 0:
            collision = collision_probability(weight, step, self._task.vehicle)

        def complete(candidates: Sequence["frenetix.TrajectorySample"]) -> None:
            if collision is not None:
                began = perf_counter()
                for sample in candidates:
                    collision.evaluate_trajectory(sample)
                step.core_s += perf_counter() - began
            self._add_own_terms(candidates, step)

        return cheapest_first(feasible, complete, COMPLETED_AT_ONCE if self._own_terms else 1)

    def _add_own_terms(self, candidates: Sequence["frenetix.TrajectorySample"], step: PlanningStep) -> None:
        if not candidates or not self._own_terms or self._lanes is None or self._corridors is None:
            return
        vehicle, frame = self._task.vehicle, step.frame
        inner = [(s.cartesian.x, s.cartesian.y, s.cartesian.theta, s.cartesian.v) for s in candidates]
        x, y, theta, speed = (np.array([row[i] for row in inner], dtype=float) for i in range(4))
        heading = theta + frame.angle_rad
        center = frame.outwards(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(*x.shape, 2)
        batch = CandidateBatch(
            x_m=center[..., 0] + vehicle.rear_axle_behind_center_m * np.cos(heading),
            y_m=center[..., 1] + vehicle.rear_axle_behind_center_m * np.sin(heading),
            heading_rad=heading,
            speed_mps=speed,
            step_s=self._task.step_s,
            fastest_mps=step.fastest_mps,
            target_speed_mps=self._desired_speed.average_to_goal(step.ego),
            obstacles=step.observation.obstacles,
            half_length_m=vehicle.length_m / 2,
            half_width_m=vehicle.width_m / 2,
            lanes=self._lanes,
            corridors=self._corridors,
        )
        for name, term in self._own_terms.items():
            weight = self._weights[name]
            for sample, value in zip(candidates, term(batch).tolist(), strict=True):
                sample.add_cost_value_to_list(name, value, weight * value)

    def _fallback(self, feasible: Iterable["frenetix.TrajectorySample"], offset_m: float, step: PlanningStep) -> Plan:
        if step.ego.speed_mps <= STANDING_MPS:
            self._driven = None
            count = round(self._settings.horizon_s / self._task.step_s) + 1
            positions = np.repeat(step.ego.position[None, :], count, axis=0)
            headings = np.full(count, step.ego.heading_rad)
            still = PlannedTrajectory(positions, headings, np.zeros(count), np.zeros(count))
            stopped = follow(still, step.ego, self._task.vehicle, self._task.step_s).trajectory
            return Plan(stopped, {}, dict(step.rejected), step.candidates, "standstill", step.core_s)

        def how_soon(sample: "frenetix.TrajectorySample") -> tuple[float, float, float, float]:
            end = EndState.of(sample)
            return end.speed_mps, end.duration_s, abs(end.offset_m - offset_m), end.offset_m

        soonest = (sample for sample in sorted(feasible, key=how_soon) if self._limit(sample, step) is None)
        chosen = next(soonest, None)
        if chosen is None:
            return Plan(None, {}, dict(step.rejected), step.candidates, core_s=step.core_s)
        return self._drive(chosen, "stopping", step)

    def _limit(self, sample: "frenetix.TrajectorySample", step: PlanningStep) -> Limit | None:
        """Return the vehicle limit that a candidate breaks, or None."""
        vehicle = self._task.vehicle
        return violated_limit(copied_trajectory(sample, step.frame, step.ego, vehicle), vehicle, self._task.step_s)

    def _drive(
        self,
        sample: "frenetix.TrajectorySample",
        kind: PlanKind,
        step: PlanningStep,
        followed: FollowedPlan | None = None,
    ) -> Plan:
        """Return the plan in which the vehicle follows a candidate; replanning continues from the candidate itself."""
        trajectory = copied_trajectory(sample, step.frame, step.ego, self._task.vehicle)
        followed = followed or follow(trajectory, step.ego, self._task.vehicle, self._task.step_s)
        self._driven = DrivenPlan(
            step.ego.step, trajectory, copied_curvilinear(sample), step.low_speed, EndState.of(sample)
        )
        weighted = {name: float(pair[1]) for name, pair in sorted(sample.costMap.items())}
        return Plan(followed.trajectory, weighted, dict(step.rejected), step.candidates, kind, step.core_s)


class _Feasible:
    """The feasible candidates of a planning step by ascending cost; every iteration yields the same objects.

    The core generates the candidates that screening leaves undecided. Of the other candidates, it generates only the
    cheapest on demand, since generating and copying candidates takes most of a planning step. ``count``: the number of
    feasible candidates; ``others``: the number of infeasible candidates by the constraints that they broke.
    """

    def __init__(
        self, handler: "frenetix.TrajectoryHandler", matrix: Points, step: PlanningStep, screening: Screening
    ) -> None:
        self._handler, self._matrix, self._step = handler, matrix, step
        is_feasible = screening.is_clear & ~screening.broken.any(axis=1)
        names = list(CONSTRAINTS.values())
        rejected = screening.broken[screening.is_clear & ~is_feasible].tolist()
        self.others = Counter(tuple(name for name, is_so in zip(names, row, strict=True) if is_so) for row in rejected)
        self._made: list[tuple[float, int, frenetix.TrajectorySample]] = []
        rows = np.flatnonzero(is_feasible)
        self._waiting = rows[np.argsort(screening.least_cost[rows], kind="stable")]
        self._least_costs = screening.least_cost
        self._make(np.flatnonzero(~screening.is_clear))
        self.count = len(self._made) + len(self._waiting)

    def __iter__(self) -> Iterator["frenetix.TrajectorySample"]:
        given = 0
        while True:
            bound = self._least_costs[self._waiting[0]] if len(self._waiting) else math.inf
            while given < len(self._made) and self._made[given][0] < bound:
                yield self._made[given][-1]
                given += 1
            if not len(self._waiting):
                return
            began = perf_counter()
            several, self._waiting = np.split(self._waiting, [_MADE_AT_ONCE])
            self._make(np.sort(several))
            self._step.core_s += perf_counter() - began

    def _make(self, rows: NDArray[np.intp]) -> None:
        """Let the core generate the candidates of the given rows of the matrix, with the row numbers as their ids."""
        if not len(rows):
            return
        self._handler.generate_trajectories(self._matrix[rows], self._step.low_speed)
        self._handler.evaluate_all_current_functions(False)
        for sample in self._handler.get_sorted_trajectories():
            if sample.feasible:
                sample.uniqueId = int(rows[sample.uniqueId])
                self._made.append((sample.cost, sample.uniqueId, sample))
            else:
                broken = sample.feasabilityMap.items()
                self.others[tuple(CONSTRAINTS[name] for name, count in broken if count > 0)] += 1
        self._made.sort(key=itemgetter(0, 1))


class _Candidate(Protocol):
    """A trajectory with its total cost; the id breaks ties."""

    @property
    def cost(self) -> Any:
        """The weighted sum of the cost terms."""

    @property
    def uniqueId(self) -> Any:  # noqa: N802 - the core's name
        """A unique number."""


_AnyCandidate = TypeVar("_AnyCandidate", bound=_Candidate)


def cheapest_first(
    candidates: Iterable[_AnyCandidate], complete: Callable[[Sequence[_AnyCandidate]], None], at_once: int
) -> Iterator[_AnyCandidate]:
    """Yield candidates by ascending cost, and complete their costs only on demand.

    The given costs ascend and lack expensive, non-negative terms. ``complete`` adds these to ``at_once`` candidates at
    a time. A completed candidate that costs less than the incomplete cost of the next one is cheaper than all that
    follow, so the order is the same as if all had been completed first.
    """
    waiting = (one for _, equal in groupby(candidates, _cost) for one in sorted(equal, key=_order))
    completed: list[tuple[Any, Any, _AnyCandidate]] = []
    while several := list(islice(waiting, at_once)):
        while completed and completed[0][0] < several[0].cost:
            yield heapq.heappop(completed)[-1]
        complete(several)
        for candidate in several:
            heapq.heappush(completed, (*_order(candidate), candidate))
    while completed:
        yield heapq.heappop(completed)[-1]


def _cost(candidate: _Candidate) -> Any:
    return candidate.cost


def _order(candidate: _Candidate) -> tuple[Any, Any]:
    return candidate.cost, candidate.uniqueId


def first_feasible(
    ordered: Iterable[_AnyCandidate], objection: Callable[[_AnyCandidate], str | None], rejected: Counter[str]
) -> _AnyCandidate | None:
    """Return the first candidate without an objection, and count the earlier objections in ``rejected``."""
    for candidate in ordered:
        reason = objection(candidate)
        if reason is None:
            return candidate
        rejected[reason] += 1
    return None
