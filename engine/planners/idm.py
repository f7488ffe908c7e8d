"""A baseline: follow the reference path and keep the distance of the Intelligent Driver Model.

Longitudinal: Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic
simulations", Physical Review E 62, 2000: acceleration a·[1 − (v/v0)⁴ − (s*/s)²] with the desired gap
s* = s0 + max(0, v·T + v·Δv / (2·√(a·b))). Above the desired speed the free term is that of the improved model (Kesting,
Treiber, Helbing 2010), which never brakes harder than b. Before a bend it brakes by at most b too, to the speed
√(a_lateral / curvature) that its lateral acceleration allows there. Lateral: the ego's offset from the path fades out.
It knows no cost terms, neither overtakes nor evades, and does not look at the edge of the road.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, project, wrap_angle, wrap_angles
from plannerforge.engine.planners.bend_speeds import bend_speeds_mps
from plannerforge.engine.planners.desired_speed import DesiredSpeed
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

EXPONENT = 4.0
EMERGENCY_MPS2 = 8.0
LOOK_AHEAD_S = 1.0
"""Who will be in the ego's corridor within this time is a leader already, so that a cut-in is seen when it begins."""
CORRIDOR_MARGIN_M = 0.3
FADE_S, SHORTEST_FADE_M = 4.0, 15.0
LOST_M = 0.2
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
class _Fade:
    """The offset from the path between two stations: a quintic from an offset and slope to none."""

    begin_m: float
    length_m: float
    offset_m: float
    slope: float

    def at(self, stations: Values) -> tuple[Values, Values]:
        """Offsets and their slopes by arc length."""
        share = np.clip((stations - self.begin_m) / self.length_m, 0.0, 1.0)
        offset = self.offset_m * (1 - share**3 * (10 - 15 * share + 6 * share**2))
        offset = offset + self.slope * self.length_m * (share - share**3 * (6 - 8 * share + 3 * share**2))
        slope = -self.offset_m / self.length_m * 30 * share**2 * (1 - share) ** 2
        return offset, slope + self.slope * (1 - share**2 * (18 - 32 * share + 15 * share**2))


class IntelligentDriver:
    """The planner; see :class:`plannerforge.engine.planners.interface.Planner`."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._weights = task.configuration.weights
        self._steps = round(task.configuration.settings.horizon_s / task.step_s)
        self._goal = Goal(task.problem.goal)
        self._desired_speed = DesiredSpeed(self._goal, task.reference, task.step_s)
        self._stations = arc_length(task.reference.points)
        along = np.gradient(task.reference.points, axis=0)
        self._headings = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        self._bend_mps = bend_speeds_mps(
            self._stations,
            self._headings,
            self._weights["lateral_acceleration_mps2"],
            self._weights["deceleration_mps2"],
        )
        self._goal_m = self._goal.stations_on(task.reference.points) if self._goal.has_position else None
        self._fade: _Fade | None = None
        self._desired_mps: float | None = None

    def plan(self, observation: Observation) -> Plan:
        """One trajectory: along the path with the model's acceleration, simulated over the horizon."""
        ego = observation.ego
        station = project(self._task.reference.points, ego.position)[0]
        turned = wrap_angle(ego.heading_rad - float(np.interp(station, self._stations, self._headings)))
        if abs(turned) > math.pi / 2:
            return Plan(None, rejected={"initial_state": 1}, candidates=1)
        travelled, speeds = self._motion(observation, station)
        trajectory = self._trajectory(ego, self._fade_for(ego, station, turned), travelled, speeds)
        kind: PlanKind = "regular" if speeds.any() else "standstill"
        return Plan(trajectory, candidates=1, kind=kind)

    def _motion(self, observation: Observation, station: float) -> tuple[Values, Values]:
        """Stations and speeds, one a step."""
        step_s, vehicle = self._task.step_s, self._task.vehicle
        others = [self._on_path(obstacle) for obstacle in observation.obstacles if len(obstacle.positions)]
        desired, look_ahead = self._desired(observation.ego), round(LOOK_AHEAD_S / step_s)
        stations, speeds = np.full(self._steps + 1, station), np.full(self._steps + 1, observation.ego.speed_mps)
        for i in range(self._steps):
            ahead = (other.leader_at(i, look_ahead) for other in others)
            leaders = [leader for leader in ahead if leader is not None and leader[0] > stations[i]]
            speed, front = float(speeds[i]), float(stations[i]) + vehicle.length_m / 2
            acceleration = self._free(speed, min(desired, self._allowed(float(stations[i])), vehicle.maximum_speed_mps))
            if leaders:
                rear, leader_speed = min(leaders)
                acceleration -= self._interaction(speed, rear - front, speed - leader_speed)
            acceleration = min(acceleration, self._before_bend(speed, float(stations[i]) + speed * step_s))
            strongest = min(EMERGENCY_MPS2, vehicle.maximum_acceleration_mps2)
            acceleration = float(np.clip(acceleration, -strongest, vehicle.maximum_acceleration_mps2))
            speeds[i + 1] = max(speed + acceleration * step_s, 0.0)
            stations[i + 1] = stations[i] + (speed + speeds[i + 1]) / 2 * step_s
        return stations, speeds

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
        """The acceleration to the speed that the bends allow at the following station, braking at most comfortably."""
        allowed = float(np.interp(following, self._stations, self._bend_mps))
        return max((allowed - speed) / self._task.step_s, -self._weights["deceleration_mps2"])

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

    def _fade_for(self, ego: EgoState, station: float, turned: float) -> _Fade:
        """The fade that is being driven; a new one where the ego is not on it."""
        point, heading = self._points(np.array([station]))
        normal = np.array([-math.sin(heading[0]), math.cos(heading[0])])
        offset = float((ego.position - point[0]) @ normal)
        if self._fade is None or abs(float(self._fade.at(np.array([station]))[0][0]) - offset) > LOST_M:
            length = max(FADE_S * ego.speed_mps, SHORTEST_FADE_M, 6.0 * abs(offset))
            self._fade = _Fade(station, length, offset, math.tan(float(np.clip(turned, -1.2, 1.2))))
        return self._fade

    def _trajectory(self, ego: EgoState, fade: _Fade, stations: Values, speeds: Values) -> PlannedTrajectory:
        points, headings = self._points(stations)
        offsets, slopes = fade.at(stations)
        positions = points + offsets[:, None] * np.stack([-np.sin(headings), np.cos(headings)], axis=1)
        directions = headings + np.arctan(slopes)
        directions = directions + (ego.heading_rad - directions[0] - wrap_angle(ego.heading_rad - float(directions[0])))
        positions[0], directions[0] = ego.position, ego.heading_rad
        gained = np.diff(speeds) / self._task.step_s
        return PlannedTrajectory(positions, directions, speeds, np.concatenate([[ego.acceleration_mps2], gained]))

    def _points(self, stations: Values) -> tuple[Points, Values]:
        """Points (n, 2) and headings of the path at stations."""
        path = self._task.reference.points
        points = np.stack([np.interp(stations, self._stations, path[:, i]) for i in range(2)], axis=1)
        return points, np.interp(stations, self._stations, self._headings)
