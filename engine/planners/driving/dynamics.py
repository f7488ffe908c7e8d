"""The ego as a simulated vehicle: a tracking controller follows the plan, and a vehicle model computes the motion.

The models are those of CommonRoad (Althoff and Würsching, "CommonRoad: Vehicle Models", 2020; package
``vehiclemodels``): kinematic single-track, dynamic single-track, single-track with drift, and multi-body. Their inputs
are the steering rate and the acceleration.

Steering follows Stanley's law (Hoffmann et al., "Autonomous Automobile Trajectory Tracking for Off-Road Driving",
2007). The front wheels point along the line on which the plan moves the front axle. At a distance e from the line, they
turn towards it by atan(k · e / (k_s + v)). Speed follows the plan with its acceleration and proportional feedback on
speed and distance. Commands act after the actuators' delay. The controller knows the delay: it steers from the state
that the vehicle will reach once all pending commands have acted, as the kinematic model predicts it.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ....schemas.errors import NotPossible
from ....schemas.worlds import Dynamics
from ...geometry import Points, Values, wrap_angle
from ...vehicles import VehicleParameters
from ..interface import EgoState, PlannedTrajectory

if TYPE_CHECKING:
    from vehiclemodels.vehicle_parameters import VehicleParameters as ModelParameters

_CONTROL_S = 0.01
"""Period of the controller (chosen: 100 Hz, as common for steering)."""
_GAIN_PER_S, _SOFTENING_MPS = 2.5, 1.0
"""Stanley's gains: at small distances an error fades with a time constant of 0.4 s; softening at low speed. Hoffmann et
al. publish the law and the gain 2.5 of their vehicle; the softening is chosen.
"""
_SPEED_PER_S, _STATION_PER_S2 = 2.0, 1.0
"""Feedback on speed and distance along the plan (chosen: critically damped, since 2.0² = 4 · 1.0)."""
_HELD_BELOW_MPS = 0.05
"""A vehicle that should stand and is slower stands; the models creep otherwise."""
_SAME_M = 1e-3
"""Wheelbases that differ by less are the same vehicle."""
_MODEL_VEHICLES = (1, 2, 3)
"""CommonRoad's passenger cars, the vehicles with the parameters of all models."""
_SUBSTEPS: dict[Dynamics, int] = {"kinematic": 1, "single_track": 1, "drift": 10, "multi_body": 10}
"""Integration steps per period. The wheels of drift and multi-body models spin up within milliseconds."""

Rates = Callable[[list[float], list[float], Any], list[float]]
"""A model: returns the derivatives of a state under inputs, for parameters."""


def check_dynamics(dynamics: Dynamics, vehicle: VehicleParameters) -> None:
    """Refuse a vehicle for which the models have no parameters.

    Raises:
        NotPossible: The ego is not one of CommonRoad's passenger cars.
    """
    if dynamics != "exact":
        _parameters(vehicle)


def _parameters(vehicle: VehicleParameters) -> "ModelParameters":
    """Return the models' parameters of a vehicle, with its limits and the friction of its road."""
    from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

    for number in _MODEL_VEHICLES:
        found: ModelParameters = setup_vehicle_parameters(number)
        same = abs(found.a + found.b - vehicle.wheelbase_m) < _SAME_M
        if same and abs(found.b - vehicle.rear_axle_behind_center_m) < _SAME_M:
            break
    else:
        raise NotPossible(
            f"the ego is a {vehicle.vehicle_class} with a wheelbase of {vehicle.wheelbase_m:g} m, for which "
            "CommonRoad's vehicle models have no masses and tyres",
            valid=[f"the setting vehicle={number}" for number in _MODEL_VEHICLES],
            next_step="use one of these vehicles, or leave out ego",
        )
    found.longitudinal.a_max = vehicle.maximum_acceleration_mps2
    found.longitudinal.v_switch = vehicle.switching_speed_mps
    found.longitudinal.v_max = vehicle.maximum_speed_mps
    found.steering.min, found.steering.max = -vehicle.maximum_steering_rad, vehicle.maximum_steering_rad
    rate = vehicle.maximum_steering_rate_radps
    found.steering.v_min, found.steering.v_max = -rate, rate
    if vehicle.friction is not None:
        found.tire.p_dy1 = min(found.tire.p_dy1, vehicle.friction)
        found.tire.p_dx1 = min(found.tire.p_dx1, vehicle.friction)
    return found


def _model(dynamics: Dynamics) -> Rates:
    """Return the derivatives of a model's state; all reference points are the centre of mass."""
    if dynamics == "kinematic":
        from vehiclemodels.utils.vehicle_dynamics_ks_cog import vehicle_dynamics_ks_cog as rates
    elif dynamics == "single_track":
        from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st as rates
    elif dynamics == "drift":
        from vehiclemodels.vehicle_dynamics_std import vehicle_dynamics_std as rates
    else:
        from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb as rates
    return rates  # type: ignore[no-any-return]


@dataclass(frozen=True)
class _Line:
    """The plan over time as the controller reads it: positions of the front axle (n, 2), speeds and distances driven
    (n,).
    """

    fronts: Points
    directions_rad: Values
    ways_m: Values
    speeds_mps: Values
    step_s: float

    @classmethod
    def of(cls, plan: PlannedTrajectory, front_m: float, step_s: float) -> "_Line":
        """Return a plan of the centre, with the front axle ``front_m`` ahead of it."""
        headings = np.unwrap(plan.headings_rad)
        ahead = np.stack([np.cos(headings), np.sin(headings)], axis=1)
        fronts = plan.positions + front_m * ahead
        apart = np.diff(fronts, axis=0)
        moved = np.hypot(apart[:, 0], apart[:, 1])
        directions = np.where(moved > _SAME_M, np.arctan2(apart[:, 1], apart[:, 0]), headings[:-1])
        ways = np.concatenate([[0.0], np.cumsum(moved)])
        return cls(fronts, np.unwrap(directions), ways, np.maximum(plan.speeds_mps, 0.0), step_s)

    def nearest(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Return the distance along the line, the offset to the left and the line's direction at the point nearest to a
        given point.
        """
        begins, along = self.fronts[:-1], np.diff(self.fronts, axis=0)
        squared = np.maximum((along**2).sum(axis=1), _SAME_M**2)
        away = np.array([x_m, y_m]) - begins
        share = (away * along).sum(axis=1) / squared
        last = len(share) - 1
        clipped = np.clip(share, 0.0, 1.0)
        clipped[0], clipped[last] = min(share[0], clipped[0] if last else share[0]), max(clipped[last], share[last])
        distance = ((away - clipped[:, None] * along) ** 2).sum(axis=1)
        at = int(distance.argmin())
        direction = self._direction(at, float(clipped[at]))
        offset = float(-math.sin(direction) * away[at, 0] + math.cos(direction) * away[at, 1])
        if 0.0 < clipped[at] < 1.0:
            segment = float(self.directions_rad[at])
            offset = float(-math.sin(segment) * away[at, 0] + math.cos(segment) * away[at, 1])
        way = float(self.ways_m[at] + clipped[at] * (self.ways_m[at + 1] - self.ways_m[at]))
        return way, offset, direction

    def _direction(self, at: int, share: float) -> float:
        """Return the direction at a fraction of a segment; it changes linearly between the midpoints of segments."""
        place = at + share - 0.5
        return float(np.interp(place, np.arange(len(self.directions_rad)), self.directions_rad))

    def wanted(self, time_s: float) -> tuple[float, float, float]:
        """Return the distance, speed and acceleration at a time since the beginning of the plan."""
        place = min(time_s / self.step_s, len(self.speeds_mps) - 1.0)
        at = min(int(place), len(self.speeds_mps) - 2)
        share, step_s = place - at, self.step_s
        begin, end = float(self.speeds_mps[at]), float(self.speeds_mps[at + 1])
        way = float(self.ways_m[at] + share * (self.ways_m[at + 1] - self.ways_m[at]))
        return way, begin + share * (end - begin), (end - begin) / step_s


class SimulatedVehicle:
    """The ego's vehicle over one run, with the state of its model and the pending commands."""

    def __init__(
        self, dynamics: Dynamics, delay_s: float, vehicle: VehicleParameters, ego: EgoState, step_s: float
    ) -> None:
        """Create the vehicle at a state of the ego.

        Raises:
            NotPossible: The models have no parameters of this vehicle.
        """
        self._parameters, self._rates = _parameters(vehicle), _model(dynamics)
        self._vehicle, self._step_s, self._ego_before = vehicle, step_s, ego
        self._front_m = vehicle.wheelbase_m - vehicle.rear_axle_behind_center_m
        self._periods = max(round(step_s / _CONTROL_S), 1)
        self._period_s = step_s / self._periods
        self._substeps = _SUBSTEPS[dynamics]
        self._late = deque([(ego.steering_rad or 0.0, 0.0)] * round(delay_s / self._period_s))
        self._state = self._begin(dynamics, ego)
        self._is_kinematic, self._is_multi_body = dynamics == "kinematic", dynamics == "multi_body"

    def _begin(self, dynamics: Dynamics, ego: EgoState) -> list[float]:
        """Return the model's state, in which the body moves along its heading without slip."""
        x, y = (float(value) for value in ego.position)
        core = [x, y, ego.steering_rad or 0.0, max(ego.speed_mps, 0.0), ego.heading_rad, ego.yaw_rate_radps, 0.0]
        if dynamics == "kinematic":
            return core[:5]
        if dynamics == "drift":
            from vehiclemodels.init_std import init_std

            return list(init_std(core, self._parameters))
        if dynamics == "multi_body":
            from vehiclemodels.init_mb import init_mb

            return list(init_mb(core, self._parameters))
        return core

    def follow(self, plan: PlannedTrajectory, steps: int, first_step: int) -> list[EgoState]:
        """Return the states of the vehicle while it follows a plan for some steps, numbered from ``first_step``."""
        line = _Line.of(plan, self._front_m, self._step_s)
        driven = []
        for step in range(steps):
            for period in range(self._periods):
                self._drive(line, step * self._step_s + period * self._period_s)
            driven.append(self._ego(first_step + step))
        return driven

    def _drive(self, line: _Line, time_s: float) -> None:
        """Command the vehicle and move it for one period of the controller."""
        steering, standing_mps = self._state[2], self._state[3]
        x, y, heading, speed = self._when_commands_act()
        time_s += len(self._late) * self._period_s
        front_x, front_y = x + self._front_m * math.cos(heading), y + self._front_m * math.sin(heading)
        way, offset, direction = line.nearest(front_x, front_y)
        aim = wrap_angle(direction - heading) - math.atan2(_GAIN_PER_S * offset, _SOFTENING_MPS + max(speed, 0.0))
        wanted_way, wanted_mps, planned_mps2 = line.wanted(time_s)
        push = planned_mps2 + _SPEED_PER_S * (wanted_mps - speed) + _STATION_PER_S2 * (wanted_way - way)
        self._late.append((aim, push))
        aim, push = self._late.popleft()
        limit = self._vehicle.maximum_steering_rad
        rate = (min(max(aim, -limit), limit) - steering) / self._period_s
        if standing_mps < _HELD_BELOW_MPS and push <= 0:
            self._stand(rate)
            return
        self._integrate([rate, max(push, -standing_mps / self._period_s)])

    def _when_commands_act(self) -> tuple[float, float, float, float]:
        """Return the position, heading and speed of the centre once all pending commands have acted."""
        x, y, steering, speed, heading = self._state[:5]
        most, wheelbase = self._vehicle.maximum_steering_rate_radps * self._period_s, self._vehicle.wheelbase_m
        rear = self._vehicle.rear_axle_behind_center_m / wheelbase
        for aim, push in self._late:
            steering += min(max(aim - steering, -most), most)
            speed = max(speed + push * self._period_s, 0.0)
            slip = math.atan(rear * math.tan(steering))
            x += speed * math.cos(heading + slip) * self._period_s
            y += speed * math.sin(heading + slip) * self._period_s
            heading += speed * math.cos(slip) * math.tan(steering) / wheelbase * self._period_s
        return x, y, heading, speed

    def _stand(self, rate: float) -> None:
        """Keep the vehicle where it is; only its wheels turn."""
        most = self._vehicle.maximum_steering_rate_radps
        self._state[2] += min(max(rate, -most), most) * self._period_s
        self._state[3] = 0.0
        if not self._is_kinematic:
            self._state[5] = 0.0
            for index in (7, 8) if len(self._state) == 9 else (10, 23, 24, 25, 26) if self._is_multi_body else ():
                self._state[index] = 0.0

    def _integrate(self, inputs: list[float]) -> None:
        """Move the model by one period with constant inputs, by the classical Runge-Kutta method."""
        span = self._period_s / self._substeps
        for _ in range(self._substeps):
            state = self._state
            first = self._at(state, inputs)
            second = self._at(_moved(state, first, span / 2), inputs)
            third = self._at(_moved(state, second, span / 2), inputs)
            fourth = self._at(_moved(state, third, span), inputs)
            self._state = [
                value + span / 6 * (a + 2 * b + 2 * c + d)
                for value, a, b, c, d in zip(state, first, second, third, fourth, strict=True)
            ]
        if not self._is_multi_body:
            self._state[3] = max(self._state[3], 0.0)

    def _at(self, state: Sequence[float], inputs: list[float]) -> list[float]:
        return self._rates(list(state), inputs, self._parameters)

    def _ego(self, step: int) -> EgoState:
        """Return the present state of the ego, with the mean accelerations of the step before it."""
        x, y, steering, speed, heading = self._state[:5]
        if self._is_multi_body:
            speed = math.hypot(speed, self._state[10])
        before = self._ego_before
        self._ego_before = EgoState(
            step=step,
            position=np.array([x, y]),
            heading_rad=heading,
            speed_mps=speed,
            acceleration_mps2=(speed - before.speed_mps) / self._step_s,
            yaw_rate_radps=(heading - before.heading_rad) / self._step_s,
            steering_rad=steering,
        )
        return self._ego_before


def _moved(state: Sequence[float], rates: Sequence[float], span_s: float) -> list[float]:
    return [value + span_s * rate for value, rate in zip(state, rates, strict=True)]
