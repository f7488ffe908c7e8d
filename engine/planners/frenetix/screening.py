"""Predicts which candidates the core would reject, and lower bounds of the costs, before the core generates them.

The core takes ten times as long to generate, check and copy a candidate as the closed forms below, and of 800
candidates a planning step uses only a few dozen. This module therefore computes the constraints and the cheap cost
terms of all candidates at once, with the core's formulas, from the coefficients of their polynomials. The last digits
differ from the core's. A candidate is *clear* only if every value is farther from its limit than rounding can move it;
the core decides on all other candidates. The driven motion, its costs and the number of rejected candidates are exactly
the core's.

Arrays have the shape (n, m) for n candidates at m steps. "along" is s, "across" is d; second derivatives are halved, as
in the core (see ``core.py``).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, Values
from ...vehicles import VehicleParameters
from .core import CONSTRAINTS, FINAL_OFFSET, FINAL_SPEED, SECOND_DERIVATIVE_FACTOR, PlanningStep

_Flags = NDArray[np.bool_]
_SLOW_MPS = 1.1e-3
"""Below 1e-3 m/s the core keeps the last heading; near this speed rounding decides."""
_LARGEST_CURVATURE_RATE = 0.4
"""In 1/(m·s): a constant of the core's check."""
_ROUNDING = 1e-6
"""Relative and absolute difference that rounding cannot reach, since only the last three of 16 digits differ."""
_ROUNDING_OF_CURVATURE = 1e-9
"""In m/s²: divided by the squared speed, the difference that rounding cannot reach in a curvature."""
_ROUNDED_YAW_RATE = 6e-6
"""In rad/s: the core rounds yaw rates to five decimals before it compares them."""
_LEAST_SCALE = 0.01
"""Nearer to the centre of the path's curve, rounding errors grow a hundredfold."""
_FARTHEST_RAD = np.pi - 1e-6
"""Beyond this heading of the path in its frame, rounding decides on which side of ±π it is."""


@dataclass(frozen=True)
class Screening:
    """The screening result for n candidates.

    ``is_clear`` (n,): whether the core is certain to agree. ``broken`` (n, 4): the constraints that a clear candidate
    breaks, in the order of ``CONSTRAINTS``. ``least_cost`` (n,): a lower bound of its weighted cost.
    """

    is_clear: _Flags
    broken: _Flags
    least_cost: Values

    @classmethod
    def of(
        cls, matrix: Points, step: PlanningStep, vehicle: VehicleParameters, weights: dict[str, float]
    ) -> "Screening":
        """Return the screening of the rows of a sampling matrix; at low speed no candidate is clear."""
        count = len(matrix)
        if step.low_speed:
            return cls(np.zeros(count, bool), np.zeros((count, len(CONSTRAINTS)), bool), np.zeros(count))
        motions = _Motions.of(matrix, step)
        exceeded = motions.exceeded(vehicle, step.step_s)
        is_clear = motions.is_regular & np.all([sure == maybe for sure, maybe in exceeded], axis=0)
        broken = np.stack([sure for sure, _ in exceeded], axis=1)
        return cls(is_clear, broken, motions.least_cost(step, weights))


@dataclass(frozen=True)
class _Steps:
    """The time steps of candidates, up to and after their end states.

    ``ends`` (n,): the number of steps up to the end state; ``times_s`` (n, m): the time of each step, held constant
    after the last of these; ``beyond_s`` (n, m): the time elapsed since then.
    """

    ends: NDArray[np.intp]
    is_checked: _Flags
    times_s: Points
    beyond_s: Points

    @classmethod
    def of(cls, durations_s: Values, step_s: float, count: int) -> "_Steps":
        """Return the steps of candidates that reach their end states after the given durations (n,)."""
        ends, index = (1.0 + durations_s / step_s).astype(np.intp), np.arange(count)
        reached = np.minimum(index, ends[:, None] - 1)
        times_s = np.asarray(step_s * reached, dtype=np.float64)
        beyond_s = np.asarray(step_s * (index - reached), dtype=np.float64)
        return cls(ends, index < ends[:, None], times_s, beyond_s)


def _pairs(first: Values, second: Values) -> tuple[Values, Values, NDArray[np.intp]]:
    """Return the distinct pairs of two columns, and for each row the index of its pair."""
    pairs, index = np.unique(first + 1j * second, return_inverse=True)  # complex numbers: ten times as fast as rows
    return pairs.real, pairs.imag, index


@dataclass(frozen=True)
class _Motions:
    """The candidates' longitudinal and lateral motions, and the path next to them.

    ``is_checked``: the steps until a candidate's end state, which the core checks; after it the candidate continues
    straight. ``divisor``: the speed, or 1 where it is slow. ``is_regular`` (n,): True if the candidate stays on the
    path and rounding selects no formula.
    """

    speed: Points
    across: Points
    slope: Points
    acceleration: Points
    curvature: Points
    velocity: Points
    heading: Points
    is_checked: _Flags
    is_slow: _Flags
    divisor: Points
    is_regular: _Flags
    jerk_along: Values
    jerk_across: Values

    @classmethod
    def of(cls, matrix: Points, step: PlanningStep) -> "_Motions":
        """Return the motions of the rows of a sampling matrix."""
        step_s = step.step_s
        count = int(1.0 + step.settings.horizon_s / step_s)
        # the longitudinal motion depends on only two end values, the lateral motion on two others
        durations, final_speeds, of_pair = _pairs(matrix[:, 1], matrix[:, FINAL_SPEED])
        quartic = _quartic(matrix[0, 2:5], durations, final_speeds)
        path, is_driven = _along(quartic, _Steps.of(durations, step_s, count), step)
        durations, offsets, of_side = _pairs(matrix[:, 1], matrix[:, FINAL_OFFSET])
        quintic = _quintic(matrix[0, 7:10], durations, offsets)
        side = _across(quintic, _Steps.of(durations, step_s, count))
        steps = _Steps.of(matrix[:, 1], step_s, count)
        speed, half_acceleration, curvatures, curvature_change, direction = (row[of_pair] for row in path)
        across, drift, half_drift_change = (row[of_side] for row in side)
        is_slow = speed <= _SLOW_MPS
        divisor = np.where(is_slow, 1.0, speed) if is_slow.any() else speed
        slope = _where_moving(is_slow, drift / divisor)
        slope_change = _where_moving(is_slow, (half_drift_change - slope * half_acceleration) / divisor**2)
        scale = 1.0 - curvatures * across
        secant = np.sqrt(1.0 + slope**2)  # 1 / cos of the heading relative to the path; slope is its tangent
        stretch = scale * secant
        away = curvatures * slope + curvature_change * across
        curvature = (slope_change + away * slope) / (secant * stretch**2) + curvatures / stretch
        acceleration = half_acceleration * stretch + speed**2 * secant * (
            scale * slope * (curvature * stretch - curvatures) - away
        )
        return cls(
            speed=speed,
            across=across,
            slope=slope,
            acceleration=acceleration,
            curvature=curvature,
            velocity=np.abs(speed * stretch),
            heading=np.arctan(slope) + direction,
            is_checked=steps.is_checked,
            is_slow=is_slow,
            divisor=divisor,
            is_regular=is_driven[of_pair] & (steps.ends <= count) & (scale > _LEAST_SCALE).all(axis=1),
            jerk_along=_jerk(quartic, step_s)[of_pair],
            jerk_across=_jerk(quintic, step_s)[of_side],
        )

    def exceeded(self, vehicle: VehicleParameters, step_s: float) -> list[tuple[_Flags, _Flags]]:
        """Return for every constraint two masks (n,): the candidates that certainly break it, and those that may."""
        curvature = np.tan(vehicle.maximum_steering_rad) / vehicle.wheelbase_m
        error = _ROUNDING * (1.0 + np.abs(self.curvature))
        error += _ROUNDING_OF_CURVATURE / self.divisor**2
        is_checked, unknown = self.is_checked, self.is_checked & self.is_slow
        yaw_rate = np.abs(np.diff(self.heading, axis=1)) / step_s - curvature * self.velocity[:, 1:]
        largest = vehicle.maximum_acceleration_mps2 / SECOND_DERIVATIVE_FACTOR
        powered = largest * vehicle.switching_speed_mps / np.maximum(self.velocity, vehicle.switching_speed_mps)
        pushed = np.maximum(self.acceleration - powered, -largest - self.acceleration)
        bent = np.abs(self.curvature) - curvature
        changed = np.abs(np.diff(self.curvature, axis=1)) / step_s - _LARGEST_CURVATURE_RATE
        after = is_checked[:, 1:]
        unknown_after = after & (self.is_slow[:, 1:] | self.is_slow[:, :-1])
        inner = is_checked.copy()  # the core skips two steps at either end
        inner[:, :2] = False
        inner[:, :-2] &= is_checked[:, 2:]
        inner[:, -2:] = False
        push_error = _ROUNDING * (10.0 + np.abs(self.acceleration))
        found = {
            "yaw_rate": _excess(yaw_rate, _ROUNDED_YAW_RATE + _ROUNDING * self.velocity[:, 1:], after, unknown_after),
            "acceleration": _excess(pushed, push_error, is_checked, unknown),
            "curvature": _excess(bent, error, inner, inner & self.is_slow),
            "curvature_rate": _excess(changed, (error[:, 1:] + error[:, :-1]) / step_s, after, unknown_after),
        }
        return [found[name] for name in CONSTRAINTS.values()]

    def least_cost(self, step: PlanningStep, weights: dict[str, float]) -> Values:
        """Return the sum of the terms computed here, rounded down; no term of the core is negative."""
        off_speed = _where_moving(self.is_slow, self.velocity - step.desired_speed_mps)
        lateral = self.across[:, self.across.shape[1] - self.across.shape[1] // 2 :]
        cost: Values = (
            weights["lateral_jerk"] * self.jerk_across
            + weights["longitudinal_jerk"] * self.jerk_along
            + weights["velocity_offset"] * np.sqrt((off_speed**2).sum(axis=1))
            + weights["distance_to_reference_path"] * np.sqrt((lateral**2).sum(axis=1))
        )
        return np.where(self.is_regular, cost * (1.0 - _ROUNDING) - _ROUNDING, 0.0)


def _where_moving(is_slow: _Flags, values: Points) -> Points:
    """Return the values with 0 where a candidate is slow."""
    return np.where(is_slow, 0.0, values) if is_slow.any() else values


def _excess(above: Points, error: Points | float, counted: _Flags, unknown: _Flags) -> tuple[_Flags, _Flags]:
    """Return two masks of rows: those where a value is certainly above zero, and those where it may be.

    ``unknown`` marks entries that may have any value.
    """
    sure, maybe = (above > error) & counted, (above > -error) & counted
    if unknown.any():
        sure, maybe = sure & ~unknown, maybe | unknown
    return np.asarray(sure.any(axis=1)), np.asarray(maybe.any(axis=1))


def _quartic(start: Values, duration_s: Values, speed_mps: Values) -> Points:
    """Return the coefficients (5, n) from a state to a speed without acceleration."""
    place, speed, acceleration = start.tolist()
    missing = speed_mps - speed - acceleration * duration_s
    fourth = (-0.5 * duration_s * acceleration - missing) / (2.0 * duration_s**3)
    third = (-acceleration - 12.0 * fourth * duration_s**2) / (6.0 * duration_s)
    same = np.ones(len(duration_s))
    return np.stack([place * same, speed * same, 0.5 * acceleration * same, third, fourth])


def _quintic(start: Values, duration_s: Values, offset_m: Values) -> Points:
    """Return the coefficients (6, n) from a state to an offset without derivatives."""
    place, speed, acceleration = start.tolist()
    t = duration_s
    missing = offset_m - (place + speed * t + 0.5 * acceleration * t**2)
    slower, softer = -(speed + acceleration * t), -acceleration
    third = 10.0 * missing / t**3 - 4.0 * slower / t**2 + 0.5 * softer / t
    fourth = -15.0 * missing / t**4 + 7.0 * slower / t**3 - softer / t**2
    fifth = 6.0 * missing / t**5 - 3.0 * slower / t**4 + 0.5 * softer / t**3
    same = np.ones(len(t))
    return np.stack([place * same, speed * same, 0.5 * acceleration * same, third, fourth, fifth])


def _values(coefficients: Points, times_s: Points) -> tuple[Points, Points, Points]:
    """Return value, derivative and half of the second derivative of n polynomials at times (n, m)."""
    value = first = half_second = np.broadcast_to(coefficients[-1][:, None], times_s.shape)
    for power in range(len(coefficients) - 2, -1, -1):
        value = value * times_s + coefficients[power][:, None]
        if power >= 1:
            first = first * times_s + value
        if power >= 2:
            half_second = half_second * times_s + first
    return value, first, half_second


def _jerk(coefficients: Points, time_s: float) -> Values:
    """Return the root of the integral of the squared jerk until a time, with the core's factors."""
    third, fourth = coefficients[3], coefficients[4]
    squared = 36.0 * third**2 * time_s + 144.0 * third * fourth * time_s**2 + 192.0 * fourth**2 * time_s**3
    if len(coefficients) == 6:
        fifth = coefficients[5]
        squared += (240.0 * third * time_s**3 + 720.0 * fourth * time_s**4 + 720.0 * fifth * time_s**5) * fifth
    root: Values = np.sqrt(np.maximum(squared, 0.0))
    return root


def _along(quartic: Points, steps: _Steps, step: PlanningStep) -> tuple[tuple[Points, ...], _Flags]:
    """Return the longitudinal motion, the path next to it, and whether the path is long enough (n,).

    The motion is speed and half acceleration; the path is curvature, its derivative and heading.

    After the end state the speed stays constant.
    """
    system = step.frame.system
    station, speed, half_acceleration = _values(quartic, steps.times_s)
    station += steps.beyond_s * speed
    half_acceleration[~steps.is_checked] = 0.0
    stations, curvatures, changes = (np.array(one) for one in (system.ref_pos, system.ref_curv, system.ref_curv_d))
    direction = np.interp(station, stations, np.unwrap(np.array(system.ref_theta)))
    direction -= 2.0 * np.pi * np.round(direction / (2.0 * np.pi))
    room_m = _ROUNDING * max(float(stations[-1]), 1.0)
    is_on_path = (station > stations[0] + room_m) & (station < stations[-1] - room_m)
    is_on_path &= np.abs(direction) < _FARTHEST_RAD
    curvature, change = np.interp(station, stations, curvatures), np.interp(station, stations, changes)
    return (speed, half_acceleration, curvature, change, direction), np.asarray(is_on_path.all(axis=1))


def _across(quintic: Points, steps: _Steps) -> tuple[Points, Points, Points]:
    """Return the offset, its derivative and half its second derivative; the offset is constant after the end."""
    offset, drift, half_change = _values(quintic, steps.times_s)
    drift[~steps.is_checked] = half_change[~steps.is_checked] = 0.0
    return offset, drift, half_change
