"""A baseline: follow the reference path and keep the distance of the Intelligent Driver Model.

Longitudinal: Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic
simulations", Physical Review E 62, 2000: acceleration a·[1 − (v/v0)⁴ − (s*/s)²] with the desired gap
s* = s0 + max(0, v·T + v·Δv / (2·√(a·b))). Above the desired speed the free term is that of the improved model (Kesting,
Treiber, Helbing 2010), which never brakes harder than b. Before a bend it brakes by at most b too, to the speed
√(a_lateral / curvature) that its lateral acceleration allows there; harder only where its tyres would slip otherwise.
Lateral: the centre follows the path and drags the rear axle after it; the offset from that way fades out.
It knows no cost terms, neither overtakes nor evades, and does not look at the edge of the road.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, wrap_angle, wrap_angles
from plannerforge.engine.planners.bend_speeds import bend_speeds_mps
from plannerforge.engine.planners.desired_speed import DesiredSpeed
from plannerforge.engine.planners.drivability import Limit, undrivable
from plannerforge.engine.planners.goal import Goal
from plannerforge.engine.planners.interface import (
    EgoState,
    Observation,
    Plan,
    PlanKind,
    PlannedTrajectory,
    PlanningTask,
    PredictedObstacle,
)
from plannerforge.engine.planners.rear_axle_curve import RearAxleCurve, RearAxlePath
from plannerforge.engine.planners.vehicle import centers, rear_axle

EXPONENT = 4.0
EMERGENCY_MPS2 = 8.0
GRIP = 0.98
"""Share of the tyres' friction that is used at most: the curvature along a plan is known between points only."""

BRAKING_GRIP, BEND_GRIP, SLIP_SMOOTHING_M = 0.5, 0.75, 0.5
"""Shares of it with which the ego brakes before a bend in which it would slip, and drives through it: 0.9 together."""

LOOK_AHEAD_S = 1.0
"""Who will be in the ego's corridor within this time is a leader already, so that a cut-in is seen when it begins."""
CORRIDOR_MARGIN_M = 0.3
FADE_S = 4.0
SAME_PLACE_M = 1e-6
SMALLEST_GAP_M = 0.1


@dataclass(frozen=True)
class _OnPath:
    """An obstacle along the path, one entry a step: rear end and speed along the path, and whether it is in the way."""

    rear_m: Values
    speed_mps: Values
    in_corridor: NDArray[np.bool_]

    def leader_at(self, index: int, look_ahead: int) -> tuple[float, float] | None:
        """Rear end and speed when it is in the corridor first between ``index`` and ``look_ahead`` steps later."""
        later = np.flatnonzero(self.in_corridor[index : index + look_ahead + 1])
        if not len(later):
            return None
        first = index + int(later[0])
        return float(self.rear_m[first]), float(self.speed_mps[first])


@dataclass(frozen=True)
class _Driven:
    """What was planned at ``first_step``: stations (n,) of the rear axle on a curve, and the centres (n, 2)."""

    first_step: int
    curve: RearAxleCurve
    stations: Values
    centers: Points

    def going_on(self, ego: EgoState) -> tuple[RearAxleCurve, float] | None:
        """The curve and the station of the ego's rear axle on it, if it followed this plan."""
        index = ego.step - self.first_step
        if not 0 <= index < len(self.centers) or np.linalg.norm(self.centers[index] - ego.position) > SAME_PLACE_M:
            return None
        return self.curve, float(self.stations[index])


class IntelligentDriver:
    """The planner; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._weights = task.configuration.weights
        self._steps = round(task.configuration.settings.horizon_s / task.step_s)
        self._goal = Goal(task.goal_ahead)
        self._desired_speed = DesiredSpeed(self._goal, task.reference, task.step_s)
        self._stations = arc_length(task.reference.points)
        along = np.gradient(task.reference.points, axis=0)
        self._headings = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        self._path = RearAxlePath(task.reference.points, task.vehicle.rear_axle_behind_center_m)
        bends = self._path.stations_m, self._path.headings_rad
        comfortable = self._weights["lateral_acceleration_mps2"], self._weights["deceleration_mps2"]
        grip = task.vehicle.maximum_acceleration_mps2
        self._bend_mps = bend_speeds_mps(*bends, *comfortable)
        self._slip_mps = bend_speeds_mps(*bends, BEND_GRIP * grip, BRAKING_GRIP * grip, SLIP_SMOOTHING_M)
        self._curvature = np.abs(np.gradient(self._path.headings_rad, self._path.stations_m))
        self._goal_m = self._goal.stations_on(task.reference.points) if self._goal.has_position else None
        self._driven: _Driven | None = None
        self._desired_mps: float | None = None

    def plan(self, observation: Observation) -> Plan:
        """One trajectory: along the path with the model's acceleration, simulated over the horizon."""
        ego = observation.ego
        began = self._driven.going_on(ego) if self._driven else None
        curve, station = began or self._curve_from(ego)
        if curve is None:
            return Plan(None, rejected={"initial_state": 1}, candidates=1)
        travelled, speeds = self._motion(observation, station)
        stations = curve.after(station, travelled)
        trajectory = self._trajectory(ego, curve, stations, speeds)
        limit = self._broken_soon(trajectory)
        if limit is not None:
            return Plan(None, rejected={limit: 1}, candidates=1)
        self._driven = _Driven(ego.step, curve, stations, trajectory.positions)
        kind: PlanKind = "regular" if speeds.any() else "standstill"
        return Plan(trajectory, candidates=1, kind=kind)

    def _broken_soon(self, trajectory: PlannedTrajectory) -> Limit | None:
        """The limit of the vehicle that the trajectory breaks before the next plan."""
        driven = trajectory.until(self._task.configuration.settings.replan_steps + 1)
        return undrivable(driven, self._task.vehicle, self._task.step_s)

    def _curve_from(self, ego: EgoState) -> tuple[RearAxleCurve | None, float]:
        """The curve from where the ego's rear axle is, and its station; none where the ego heads back."""
        rear = rear_axle(ego.position, ego.heading_rad, self._task.vehicle)
        station = self._path.foot(rear)
        along_rad = float(self._path.frame(np.array([station]))[1][0])
        if abs(wrap_angle(ego.heading_rad - along_rad)) > math.pi / 2:
            return None, station
        return RearAxleCurve.beginning_at(self._path, rear, ego.heading_rad, FADE_S * ego.speed_mps), station

    def _motion(self, observation: Observation, station: float) -> tuple[Values, Values]:
        """The way in m and the speeds, one a step, of a rear axle that begins at a station."""
        step_s, vehicle = self._task.step_s, self._task.vehicle
        others = [self._on_path(obstacle) for obstacle in observation.obstacles if len(obstacle.positions)]
        desired, look_ahead = self._desired(observation.ego), round(LOOK_AHEAD_S / step_s)
        travelled, speeds = np.zeros(self._steps + 1), np.full(self._steps + 1, observation.ego.speed_mps)
        for i in range(self._steps):
            speed, rear_axle_m = float(speeds[i]), station + float(travelled[i])
            center_m = self._path.center_station(rear_axle_m)
            ahead = (other.leader_at(i, look_ahead) for other in others)
            leaders = [leader for leader in ahead if leader is not None and leader[0] > center_m]
            acceleration = self._free(speed, min(desired, self._allowed(center_m), vehicle.maximum_speed_mps))
            if leaders:
                rear, leader_speed = min(leaders)
                gap_m = rear - center_m - vehicle.length_m / 2
                acceleration -= self._interaction(speed, gap_m, speed - leader_speed)
            acceleration = min(acceleration, self._before_bend(speed, rear_axle_m + speed * step_s))
            grip = self._grip_mps2(speed, rear_axle_m + speed * step_s / 2)
            acceleration = min(max(acceleration, -min(EMERGENCY_MPS2, grip)), grip)
            speeds[i + 1] = max(speed + acceleration * step_s, 0.0)
            travelled[i + 1] = travelled[i] + (speed + speeds[i + 1]) / 2 * step_s
        return travelled, speeds

    def _desired(self, ego: EgoState) -> float:
        """The rule of Frenetix; where it knows nothing but the present speed, the last that it knew.

        Otherwise an ego that a leader slowed down would never drive faster again.
        """
        desired = self._desired_speed.at(ego)
        if self._desired_mps is None or desired != ego.speed_mps:
            self._desired_mps = desired
        return self._desired_mps

    def _free(self, speed: float, desired: float) -> float:
        a, b = self._weights["acceleration_mps2"], self._weights["deceleration_mps2"]
        if speed > desired:
            return float(-b * (1.0 - (max(desired, 0.0) / speed) ** (a * EXPONENT / b)))
        return float(a * (1.0 - (speed / desired) ** EXPONENT)) if desired > 0 else 0.0

    def _interaction(self, speed: float, gap_m: float, closing_mps: float) -> float:
        a, b = self._weights["acceleration_mps2"], self._weights["deceleration_mps2"]
        headway = speed * self._weights["time_headway_s"] + speed * closing_mps / (2.0 * math.sqrt(a * b))
        wanted = self._weights["minimum_gap_m"] + max(0.0, headway)
        return float(a * (wanted / max(gap_m, SMALLEST_GAP_M)) ** 2)

    def _before_bend(self, speed: float, following: float) -> float:
        """The acceleration to the speed that the bends allow at the following station.

        It brakes at most comfortably for a comfortable speed, and as hard as it must where the tyres would slip.
        """
        comfortable, slipping = (
            (float(np.interp(following, self._path.stations_m, allowed)) - speed) / self._task.step_s
            for allowed in (self._bend_mps, self._slip_mps)
        )
        return min(max(comfortable, -self._weights["deceleration_mps2"]), slipping)

    def _grip_mps2(self, speed: float, station: float) -> float:
        """What the bend leaves of the tyres' friction for motion along it."""
        curvature = float(np.interp(station, self._path.stations_m, self._curvature))
        whole = GRIP * self._task.vehicle.maximum_acceleration_mps2
        return math.sqrt(max(whole**2 - (speed**2 * curvature) ** 2, 0.0))

    def _allowed(self, station: float) -> float:
        """The speed from which the comfortable deceleration reaches the goal's speed where the goal begins."""
        if self._goal_m is None or self._goal.speed_mps is None:
            return math.inf
        left = max(self._goal_m[0] - station, 0.0)
        return math.sqrt(self._goal.speed_mps**2 + 2.0 * self._weights["deceleration_mps2"] * left)

    def _on_path(self, obstacle: PredictedObstacle) -> _OnPath:
        """Projected on the nearest point of the path, whose points are about one metre apart."""
        path = self._task.reference.points
        gaps = path[None, :, :] - obstacle.positions[:, None, :]
        nearest = np.argmin((gaps**2).sum(axis=2), axis=1)
        heading, offset = self._headings[nearest], -gaps[np.arange(len(nearest)), nearest]
        along = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading)
        aside = offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading)
        turned = wrap_angles(obstacle.headings_rad - heading)
        cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        half_along = (obstacle.length_m * cos + obstacle.width_m * sin) / 2
        half_across = (obstacle.length_m * sin + obstacle.width_m * cos) / 2
        stations = self._stations[nearest] + along
        room = self._task.vehicle.width_m / 2 + half_across + CORRIDOR_MARGIN_M
        on_path = (nearest > 0) & (nearest < len(path) - 1)
        moving = np.gradient(stations, self._task.step_s) if len(stations) > 1 else np.zeros(1)
        return _OnPath(stations - half_along, moving, (np.abs(aside) < room) & on_path)

    def _trajectory(self, ego: EgoState, curve: RearAxleCurve, stations: Values, speeds: Values) -> PlannedTrajectory:
        rear, headings = curve.poses(stations)
        headings += ego.heading_rad - headings[0] - wrap_angle(ego.heading_rad - float(headings[0]))
        positions = centers(rear, headings, self._task.vehicle)
        positions[0], headings[0] = ego.position, ego.heading_rad
        gained = np.diff(speeds) / self._task.step_s
        return PlannedTrajectory(positions, headings, speeds, np.concatenate([[ego.acceleration_mps2], gained]))
