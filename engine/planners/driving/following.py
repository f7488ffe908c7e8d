"""The ego as a vehicle: it follows a plan by steering and accelerating within its limits.

A plan is a sequence of states, and possibly no steering leads from one state to the next. Here the rear axle moves as
in the kinematic single-track model of CommonRoad (Althoff and Würsching, "CommonRoad: Vehicle Models", 2020). With
speed v, steering angle δ and wheelbase L, the heading turns by v · tan δ / L. The inputs of a time step are a constant
acceleration and a constant steering rate. The speeds are the plan's. The steering rates keep the rear and the front
axle as near as possible to the whole plan, which is a least-squares problem with bounds. If a corner is too abrupt for
the rate at which the wheels turn, the vehicle starts to steer before it.

The driven motion is the result of this integration, so the wheels always roll and the steering rate never exceeds its
limit. The vehicle follows a drivable plan to within millimetres.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ...geometry import Points, Values
from ...vehicles import VehicleParameters, centers
from ..interface import EgoState, PlannedTrajectory

FOLLOWED_WITHIN_M = 0.3
"""A vehicle this near to its plan is on it, for planners without sampled offsets to derive the distance
from (chosen).
"""
_RATE_WEIGHT_M = 0.01
"""Metres of deviation that 1 rad/s of steering costs in the least-squares problem. Plans have corners of millimetres,
which are not worth steering for: a plan along chords of 1 m deviates from its arc of 8 m radius by 16 mm.
"""
_SHORTEST_STEP_M = 2e-3
"""In a shorter step the plan's turn does not determine the steering angle, which then stays unchanged."""
_LINEARISATIONS, _ON_THE_LINE_M = 2, 0.02
"""The problem is linearised about the plan, and again about the result if that is neither on the plan nor at the
position that the linear problem predicts.
"""
_RATE_SHARE = 0.98
"""Usable share of the largest steering rate. A judge without steering angles computes the rate from headings and
speeds, averaged over steps with changing speed, and must not find more than the limit.
"""
_MOST_ROUNDS, _CENTRING, _TO_THE_BOUND, _SETTLED_M2 = 25, 0.1, 0.99, 1e-4
"""Parameters of the search for the best rates: the centring of a round, the largest share of the distance to a bound,
and the gap at which the search ends, (1 cm)² of deviation squared and summed over all steps. The search takes about a
dozen rounds, and any result is within the bounds.
"""


@dataclass(frozen=True)
class FollowedPlan:
    """The motion with which the vehicle follows a plan.

    ``deviation_m``: the largest lateral distance of the rear axle from the plan; ``within_tyres``: True if tyres and
    engine allow the plan's accelerations; if not, the accelerations of ``trajectory`` are smaller.
    """

    trajectory: PlannedTrajectory
    deviation_m: float
    within_tyres: bool


def is_on_plan(plan: PlannedTrajectory, index: int, ego: EgoState, within_m: float) -> bool:
    """Return True if the vehicle is within ``within_m`` of its planned position in a state of the plan."""
    if not 0 <= index < len(plan.positions):
        return False
    away = plan.positions[index] - ego.position
    return math.hypot(away[0], away[1]) <= within_m


def follow(plan: PlannedTrajectory, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> FollowedPlan:
    """Return the motion from the vehicle's present state that is as close to a plan as its limits allow.

    ``plan`` contains states of the centre, the present one first. The ego starts with its own steering angle. If that
    is unknown (a planning problem does not give it), it starts with the angle that suits the plan.
    """
    count = len(plan.positions)
    if count < 2:
        return FollowedPlan(replace(plan, steering_rad=np.full(count, ego.steering_rad or 0.0)), 0.0, True)
    track = _Track.of(plan, vehicle)
    speeds = np.maximum(plan.speeds_mps, 0.0)
    speeds[0] = ego.speed_mps
    start = _Pose.of(ego, vehicle)
    steering, driven = _find_steering(track, speeds, start, ego.steering_rad, vehicle, step_s)
    limited = _within_tyres(speeds, steering, vehicle, step_s)
    within = limited is speeds
    if not within:
        speeds = limited
        driven = _roll(start, speeds, steering, vehicle.wheelbase_m, step_s)
    deviation_m = float(np.abs(track.across(driven)).max())
    accelerations = plan.accelerations_mps2 if within else np.gradient(speeds, step_s)
    headings = driven.headings_rad
    positions = centers(np.stack([driven.x_m, driven.y_m], axis=1), headings, vehicle)
    positions[0], headings[0] = ego.position, ego.heading_rad
    return FollowedPlan(PlannedTrajectory(positions, headings, speeds, accelerations, steering), deviation_m, within)


@dataclass(frozen=True)
class _Pose:
    """The position of the rear axle in m and its heading in rad."""

    x_m: float
    y_m: float
    heading_rad: float

    @classmethod
    def of(cls, ego: EgoState, vehicle: VehicleParameters) -> "_Pose":
        back, heading = vehicle.rear_axle_behind_center_m, ego.heading_rad
        return cls(
            float(ego.position[0]) - back * math.cos(heading),
            float(ego.position[1]) - back * math.sin(heading),
            heading,
        )


@dataclass(frozen=True)
class _Rolled:
    """The result of an integration: rear axle and heading per state, and heading at half time per step."""

    x_m: Values
    y_m: Values
    headings_rad: Values
    halfway_rad: Values


@dataclass(frozen=True)
class _Track:
    """A plan in terms of the rear axle."""

    x_m: Values
    y_m: Values
    headings_rad: Values
    sin: Values
    cos: Values

    @classmethod
    def of(cls, plan: PlannedTrajectory, vehicle: VehicleParameters) -> "_Track":
        back, headings = vehicle.rear_axle_behind_center_m, plan.headings_rad
        sin, cos = np.sin(headings), np.cos(headings)
        return cls(plan.positions[:, 0] - back * cos, plan.positions[:, 1] - back * sin, headings, sin, cos)

    def across(self, driven: _Rolled) -> Values:
        """Return a motion's offset to the left of the plan in m, at every state but the first."""
        away_x, away_y = driven.x_m - self.x_m, driven.y_m - self.y_m
        return np.asarray((away_y * self.cos - away_x * self.sin)[1:])

    def turned(self, driven: _Rolled) -> Values:
        """Return a motion's heading relative to the plan's in rad (left positive), at every state but the first."""
        turn = driven.headings_rad - self.headings_rad
        return np.asarray((turn - math.tau * round(float(turn[0]) / math.tau))[1:])


def _roll(start: _Pose, speeds: Values, steering: Values, wheelbase_m: float, step_s: float) -> _Rolled:
    """Return the rear axle's motion for speeds and steering angles (n,) that change linearly within a step.

    Uses Simpson's rule, over half steps for the heading and over whole steps for the position; its error is below a
    micrometre per step.
    """
    shares = _QUARTERS
    v = speeds[:-1, None] + np.diff(speeds)[:, None] * shares
    rate = v * np.tan(steering[:-1, None] + np.diff(steering)[:, None] * shares) / wheelbase_m
    half = (rate[:, 0] + 4.0 * rate[:, 1] + rate[:, 2]) * (step_s / 12.0)
    whole = half + (rate[:, 2] + 4.0 * rate[:, 3] + rate[:, 4]) * (step_s / 12.0)
    heading = np.empty(len(speeds))
    heading[0] = start.heading_rad
    heading[1:] = start.heading_rad + np.cumsum(whole)
    halfway = heading[:-1] + half
    ends = v[:, ::2] * (step_s / 6.0)
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = np.empty(len(speeds)), np.empty(len(speeds))
    x[0], y[0] = start.x_m, start.y_m
    x[1:] = start.x_m + np.cumsum(ends[:, 0] * cos[:-1] + 4.0 * ends[:, 1] * np.cos(halfway) + ends[:, 2] * cos[1:])
    y[1:] = start.y_m + np.cumsum(ends[:, 0] * sin[:-1] + 4.0 * ends[:, 1] * np.sin(halfway) + ends[:, 2] * sin[1:])
    return _Rolled(x, y, heading, halfway)


_QUARTERS: Values = np.array([0.0, 0.25, 0.5, 0.75, 1.0])


def _find_steering(
    track: _Track, speeds: Values, start: _Pose, present_rad: float | None, vehicle: VehicleParameters, step_s: float
) -> tuple[Values, _Rolled]:
    """Return the steering angle at every state (n,), within the vehicle's steering rate, and the resulting motion."""
    distances = 0.5 * (speeds[1:] + speeds[:-1]) * step_s
    steering = _steering_of_plan(track, distances, vehicle)
    if present_rad is not None:
        steering[0] = present_rad
    driven = _roll(start, speeds, steering, vehicle.wheelbase_m, step_s)
    for _ in range(_LINEARISATIONS):
        problem = _linearise(track, driven, distances, steering, vehicle, step_s, begins_free=present_rad is None)
        best = problem.without_bounds()
        clipped = np.clip(best, -problem.bounds, problem.bounds)
        steering = problem.steering_for(clipped)
        driven = _roll(start, speeds, steering, vehicle.wheelbase_m, step_s)
        if float(np.abs(track.across(driven)).max()) < _ON_THE_LINE_M:
            break
        if (clipped != best).any():
            best = _solve_bounded(problem.matrix, problem.right, problem.bounds, best)
            steering = problem.steering_for(best)
            driven = _roll(start, speeds, steering, vehicle.wheelbase_m, step_s)
        across = track.across(driven)
        if float(np.abs(across - problem.across(best)).max()) < _ON_THE_LINE_M:
            break
    return steering, driven


def _steering_of_plan(track: _Track, distances: Values, vehicle: VehicleParameters) -> Values:
    """Return the steering angle in rad at every state, the mean of the angles for the turns before and after it."""
    turn = np.diff(track.headings_rad)
    moving = distances > _SHORTEST_STEP_M
    between = np.arctan(vehicle.wheelbase_m * turn / np.where(moving, distances, 1.0))
    if not moving.all():
        last = np.maximum.accumulate(np.where(moving, np.arange(len(distances)), -1))
        between = np.where(last >= 0, between[last], between[int(moving.argmax())] if moving.any() else 0.0)
    angles = np.empty(len(distances) + 1)
    angles[0], angles[-1] = between[0], between[-1]
    angles[1:-1] = 0.5 * (between[1:] + between[:-1])
    limited: Values = np.clip(angles, -vehicle.maximum_steering_rad, vehicle.maximum_steering_rad)
    return limited


@dataclass(frozen=True)
class _Problem:
    """The least-squares problem, linearised about some steering angles and their motion.

    The unknowns are the rates of the steps and, if ``first_rad`` is None, the first angle; ``bounds`` limits their
    absolute values. The best x solves ``matrix``·x = ``right`` if no bound is active. At x the motion is ``gain``·x +
    ``offset`` m to the left of the plan.
    """

    matrix: Points
    right: Values
    bounds: Values
    gain: Points
    offset: Values
    first_rad: float | None
    largest_rad: float
    step_s: float

    def without_bounds(self) -> Values:
        """Return the best unknowns without bounds."""
        return _solve(self.matrix, self.right)

    def across(self, unknown: Values) -> Values:
        """Return the motion's offset to the left of the plan in m, as the linear problem predicts it."""
        return np.asarray(self.gain @ unknown + self.offset)

    def steering_for(self, unknown: Values) -> Values:
        """Return the steering angle at every state."""
        first, rates = (float(unknown[-1]), unknown[:-1]) if self.first_rad is None else (self.first_rad, unknown)
        angles = np.empty(len(rates) + 1)
        angles[0] = first
        angles[1:] = first + self.step_s * np.cumsum(rates)
        limited: Values = np.clip(angles, -self.largest_rad, self.largest_rad)
        return limited


def _linearise(
    track: _Track,
    driven: _Rolled,
    distances: Values,
    steering: Values,
    vehicle: VehicleParameters,
    step_s: float,
    *,
    begins_free: bool,
) -> _Problem:
    """Return the problem about steering angles (n,) and the motion that they lead to."""
    wheelbase, bound = vehicle.wheelbase_m, _RATE_SHARE * vehicle.maximum_steering_rate_radps
    middle = 0.5 * (steering[1:] + steering[:-1])
    gain = distances / wheelbase * (1.0 + np.tan(middle) ** 2)
    by_step = gain[:, None] * _mean_angles(len(distances), step_s)
    turned = np.cumsum(by_step, axis=0)
    halfway = distances[:, None] * (turned - 0.5 * by_step)
    along = np.cumsum(np.cos(driven.halfway_rad)[:, None] * halfway, axis=0)
    aside = np.cumsum(np.sin(driven.halfway_rad)[:, None] * halfway, axis=0)
    rear = track.cos[1:, None] * along + track.sin[1:, None] * aside
    front = rear + wheelbase * turned
    about = np.empty(len(distances) + 1)
    about[:-1], about[-1] = np.diff(steering) / step_s, steering[0]
    rear_m = track.across(driven) - rear @ about
    front_m = track.across(driven) + wheelbase * track.turned(driven) - front @ about
    matrix = rear.T @ rear + front.T @ front
    matrix.flat[:: len(about) + 1] += _RATE_WEIGHT_M**2
    right = -(rear.T @ rear_m + front.T @ front_m)
    right[-1] += _RATE_WEIGHT_M**2 * steering[0]  # a standing vehicle keeps its angle
    bounds = np.full(len(about), bound)
    if begins_free:
        bounds[-1] = vehicle.maximum_steering_rad
        return _Problem(matrix, right, bounds, rear, rear_m, None, vehicle.maximum_steering_rad, step_s)
    first = float(steering[0])
    return _Problem(
        matrix[:-1, :-1],
        right[:-1] - first * matrix[:-1, -1],
        bounds[:-1],
        rear[:, :-1],
        rear_m + first * rear[:, -1],
        first,
        vehicle.maximum_steering_rad,
        step_s,
    )


@lru_cache(maxsize=64)
def _mean_angles(steps: int, step_s: float) -> Points:
    """Return the matrix of mean angles per step (rows) by the steps' rates and the first angle (columns)."""
    matrix = np.tril(np.full((steps, steps + 1), step_s), -1)
    matrix[np.arange(steps), np.arange(steps)] = 0.5 * step_s
    matrix[:, -1] = 1.0
    return matrix


def _solve_bounded(matrix: Points, right: Values, bounds: Values, best: Values) -> Values:
    """Return the x with |x| ≤ bounds that minimises x·M·x/2 − b·x; ``best`` is the minimum without bounds.

    M is positive definite.

    Uses a primal-dual interior-point method (Nocedal and Wright, "Numerical Optimization", 2006, chapter 16.6). The
    number of rounds hardly depends on the number of active bounds.
    """
    x = np.clip(best, -0.5 * bounds, 0.5 * bounds)
    slope = matrix @ x - right
    slack = np.stack([bounds - x, bounds + x])
    multipliers = max(float(np.abs(slope).max()), _SETTLED_M2) * bounds / slack
    for _ in range(_MOST_ROUNDS):
        gap = float((multipliers * slack).sum())
        if gap <= _SETTLED_M2:
            break
        aims, ratios = _CENTRING * gap / slack.size / slack, multipliers / slack
        system = matrix.copy()
        system.flat[:: len(x) + 1] += ratios.sum(axis=0)
        step = _solve(system, aims[1] - aims[0] - slope)
        signed = np.stack([step, -step])
        change = aims + ratios * signed - multipliers
        nearest = max(float((signed / slack).max()), float((-change / multipliers).max()))
        share = min(1.0, _TO_THE_BOUND / nearest) if nearest > 0 else 1.0
        x = x + share * step
        slack, multipliers = slack - share * signed, multipliers + share * change
        slope = matrix @ x - right
    return np.asarray(x)


def _solve(matrix: Points, right: Values) -> Values:
    """Return the x with M·x = b for a symmetric positive definite M, in half the time of a general solver."""
    from scipy.linalg.lapack import dposv

    found: Values = dposv(matrix, right)[1]
    return found


def _within_tyres(speeds: Values, steering: Values, vehicle: VehicleParameters, step_s: float) -> Values:
    """Return the speeds if tyres and engine allow them, otherwise the nearest feasible speeds, step by step.

    A vehicle above its top speed does not accelerate further.
    """
    largest, top = vehicle.maximum_acceleration_mps2, max(vehicle.maximum_speed_mps, float(speeds[0]))
    curvature = np.tan(steering[:-1]) / vehicle.wheelbase_m
    along, across = np.diff(speeds) / step_s, speeds[:-1] ** 2 * curvature
    power = largest * vehicle.switching_speed_mps
    powered = power / np.maximum(0.5 * (speeds[1:] + speeds[:-1]), vehicle.switching_speed_mps)
    if (along**2 + across**2 <= largest**2).all() and (along <= powered).all() and (speeds <= top).all():
        return speeds
    allowed = speeds.tolist()
    for index, turn in enumerate(curvature.tolist()):
        speed = allowed[index]
        room = math.sqrt(max(largest**2 - (speed * speed * turn) ** 2, 0.0))
        at_end = (math.sqrt(speed * speed + 4.0 * power * step_s) - speed) / (2.0 * step_s)  # a · (v + a · t) = power
        fastest = min(room, max(at_end, min((vehicle.switching_speed_mps - speed) / step_s, largest)))
        wanted = (allowed[index + 1] - speed) / step_s
        allowed[index + 1] = min(max(speed + min(max(wanted, -room), fastest) * step_s, 0.0), top)
    return np.array(allowed)
