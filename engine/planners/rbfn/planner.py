"""MP-RBFN: candidates are motion primitives that a network of radial basis functions generates in one call.

The planner samples end states next to the reference path, the network leads to them, and the motion continues along the
path (``candidates.py``). Infeasible candidates are left out. The others are checked in order of cost (``costs.py``)
against the predicted obstacles and the edge of the road, and the ego drives the first that passes. If no candidate
passes, an ego below 0.1 m/s stands still; otherwise it drives the feasible candidate that stops soonest.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, Values, wrap_angles
from ...vehicles import STANDING_MPS, centers, rear_axle
from ..driving.desired_speed import DesiredSpeed
from ..driving.drivability import broken_limits
from ..driving.following import FollowedPlan, follow
from ..interface import EgoState, Observation, Plan, PlanKind, PlannedTrajectory, PlanningTask, evenly_chosen
from ..safety import SafetyCheck
from .candidates import Candidates, Driven, PathTable, Samples, Start, candidates, followed_within_m
from .costs import CHANNELS, ChannelBatch, RoadEdge
from .network import PrimitiveNetwork

_SLOWEST_TURNING_MPS = 0.1
"""Below this speed a yaw rate does not determine the steering angle (chosen)."""
_COSTED_S = 0.3
"""Time between the states for which costs are computed (chosen)."""
_EQUAL = 0.002
"""Costs that differ by less than this share of the sum of all weights are equal, and the gentler candidate wins
(chosen). The network's error, a thousandth of the distance, must not decide between a gentle and a harsh candidate.
"""


@dataclass(frozen=True)
class _Step:
    """One planning step: the feasible candidates and their unweighted costs by channel (n,)."""

    ego: EgoState
    found: Candidates
    drivable: NDArray[np.intp]
    rejected: Counter[str]
    costs: dict[str, Values]


class RadialBasisPrimitives:
    """MP-RBFN as a planner of the loop; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def __init__(self, network: PrimitiveNetwork | None = None) -> None:
        self._network = network or PrimitiveNetwork.shipped()

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._weights = task.configuration.weights
        self._path = PathTable(task.reference.points, task.reference.start_m)
        self._edge = RoadEdge(task.road)
        self._desired_speed = DesiredSpeed.of(task)
        count = round(task.configuration.settings.horizon_s / task.step_s) + 1
        self._times: Values = np.arange(count, dtype=np.float64) * task.step_s
        self._within_m = followed_within_m(task.configuration.settings.sampling_level)
        self._driven: Driven | None = None

    def plan(self, observation: Observation) -> Plan:
        """Sample, compute costs, and return the first candidate that is safe."""
        ego, task = observation.ego, self._task
        start, rest = self._start(ego)
        if abs(start.turned_rad) > np.pi / 2:
            return Plan(None, rejected={"initial_state": 1}, candidates=1)
        desired_mps = self._desired_speed.at(ego)
        settings = task.configuration.settings
        samples = Samples.of(start, desired_mps, settings.horizon_s, task.step_s, settings.sampling_level, task.vehicle)
        found = candidates(self._network, self._path, start, samples, self._times).with_rest(rest)
        rejected: Counter[str] = Counter()
        drivable = self._drivable(found, rejected)
        step = _Step(ego, found, drivable, rejected, self._costs(found, drivable, start, desired_mps, observation))
        self._step = step
        safety = SafetyCheck(task, observation)
        for index in self._cheapest_first(step):
            followed = safety.followed(self._trajectory(step, index), self._within_m)
            if not isinstance(followed, str):
                return self._drive(step, index, "regular", followed)
            rejected[followed] += 1
        return self._fallback(step)

    def shown_candidates(self, most: int) -> Sequence[Points]:
        """Return at most ``most`` feasible candidates of the last planning step."""
        order = list(self._cheapest_first(self._step))
        return [self._trajectory(self._step, order[i]).positions for i in evenly_chosen(len(order), most)]

    def _start(self, ego: EgoState) -> tuple[Start, Candidates | None]:
        """Return the rear axle's start, and the rest of the current plan if the ego has followed it."""
        rear = rear_axle(ego.position, ego.heading_rad, self._task.vehicle)
        rest = None
        if self._driven is not None and self._driven.holds(ego, self._within_m):
            rest = self._driven.rest(self._path, ego.step, self._task.step_s)
        if ego.steering_rad is not None:
            curvature = float(np.tan(ego.steering_rad)) / self._task.vehicle.wheelbase_m
        else:
            steepest = np.tan(self._task.vehicle.maximum_steering_rad) / self._task.vehicle.wheelbase_m
            turning = ego.yaw_rate_radps / max(ego.speed_mps, _SLOWEST_TURNING_MPS)
            curvature = float(np.clip(turning, -steepest, steepest))
        return Start.of(self._path, rear, ego.heading_rad, ego.speed_mps, curvature), rest

    def _drivable(self, found: Candidates, rejected: Counter[str]) -> NDArray[np.intp]:
        """Return the candidates that the network knows and the vehicle can drive; count each other candidate once."""
        vehicle, motions = self._task.vehicle, found.motions
        slips, turns = broken_limits(motions.heading_rad, motions.speed_mps, vehicle, self._task.step_s)
        steering = np.arctan(vehicle.wheelbase_m * motions.curvature_per_m)
        rates = np.abs(np.diff(steering, axis=1)) / self._task.step_s
        within = np.arange(rates.shape[1]) < found.primitive_steps[:, None]
        too_quick = np.where(within, rates, 0.0).max(axis=1) > vehicle.maximum_steering_rate_radps
        too_far = np.abs(steering).max(axis=1) > vehicle.maximum_steering_rad
        left = np.ones(found.count, dtype=np.bool_)
        broken = {"unknown": ~found.known, "friction": slips, "curvature": turns | too_far, "steering_rate": too_quick}
        for name, which in broken.items():
            count = int((left & which).sum())
            if count:
                rejected[name] += count
            left &= ~which
        return np.flatnonzero(left)

    def _costs(
        self, found: Candidates, drivable: NDArray[np.intp], start: Start, desired_mps: float, observation: Observation
    ) -> dict[str, Values]:
        """Return the unweighted costs of the feasible candidates by channel, for the channels that have a weight."""
        if not len(drivable):
            return {}
        every = max(round(_COSTED_S / self._task.step_s), 1)
        steps = np.arange(len(self._times) - 1, 0, -every, dtype=np.intp)[::-1]
        x, y, heading = (
            values[np.ix_(drivable, steps)]
            for values in (found.motions.x_m, found.motions.y_m, found.motions.heading_rad)
        )
        distances_m = np.cumsum(found.motions.speed_mps[drivable], axis=1) * self._task.step_s
        _, offset, along = self._path.coordinates(x, y, start.station_m + distances_m[:, steps])
        back = self._task.vehicle.rear_axle_behind_center_m
        batch = ChannelBatch(
            steps=steps,
            x_m=x + back * np.cos(heading),
            y_m=y + back * np.sin(heading),
            offset_m=offset,
            turned_rad=wrap_angles(heading - along),
            final_mps=found.motions.speed_mps[drivable, -1],
            desired_mps=desired_mps,
            obstacles=observation.obstacles,
            vehicle=self._task.vehicle,
            edge=self._edge,
        )
        return {name: channel(batch) for name, channel in CHANNELS.items() if self._weights[name] > 0}

    def _cheapest_first(self, step: _Step) -> Iterable[int]:
        """Return indices into ``drivable`` by ascending cost; among equal costs, the gentler candidate comes first."""
        total = np.zeros(len(step.drivable))
        for name, values in step.costs.items():
            total += self._weights[name] * values
        equal = _EQUAL * sum(self._weights.values()) or 1.0
        gentleness = np.round(step.found.gentleness[step.drivable], 6)
        order: NDArray[np.intp] = np.lexsort((total, gentleness, np.floor(total / equal)))
        return map(int, order)

    def _trajectory(self, step: _Step, index: int) -> PlannedTrajectory:
        """Return a candidate as states of the centre."""
        motions, row = step.found.motions, step.drivable[index]
        heading, speed = motions.heading_rad[row], motions.speed_mps[row]
        rear = np.stack([motions.x_m[row], motions.y_m[row]], axis=1)
        positions: Points = centers(rear, heading, self._task.vehicle)
        return PlannedTrajectory(positions, heading, speed, np.gradient(speed, self._task.step_s))

    def _drive(self, step: _Step, index: int, kind: PlanKind, followed: FollowedPlan | None = None) -> Plan:
        """Return the motion with which the vehicle follows a candidate."""
        trajectory = self._trajectory(step, index)
        followed = followed or follow(trajectory, step.ego, self._task.vehicle, self._task.step_s)
        row = slice(step.drivable[index], step.drivable[index] + 1)
        chosen = step.found.part(row)
        self._driven = Driven(step.ego.step, chosen, trajectory)
        weighted = {name: self._weights[name] * float(values[index]) for name, values in sorted(step.costs.items())}
        return Plan(followed.trajectory, weighted, dict(step.rejected), step.found.count, kind)

    def _fallback(self, step: _Step) -> Plan:
        if step.ego.speed_mps <= STANDING_MPS:
            self._driven = None
            count = len(self._times)
            positions = np.repeat(step.ego.position[None, :], count, axis=0)
            headings = np.full(count, step.ego.heading_rad)
            still = PlannedTrajectory(positions, headings, np.zeros(count), np.zeros(count))
            stopped = follow(still, step.ego, self._task.vehicle, self._task.step_s).trajectory
            return Plan(stopped, {}, dict(step.rejected), step.found.count, "standstill")
        stops = step.found.stops_s[step.drivable]
        slowest = step.found.motions.speed_mps[step.drivable, -1]
        if not len(stops):
            return Plan(None, {}, dict(step.rejected), step.found.count)
        soonest = np.lexsort((np.abs(step.found.last_offset_m[step.drivable]), slowest, stops))
        return self._drive(step, int(soonest[0]), "stopping")
