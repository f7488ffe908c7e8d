"""Convert SUMO's front-bumper tracks to drivable motions of the vehicle's centre; check whether motions are drivable.

SUMO moves vehicles along lane centre lines with kinks, and steps in acceleration: 39% of raw tracks pass the
drivability checker's kinematic single-track model. The path is smoothed over arc length, the progress over time, and
the heading follows as a tractrix: the rear axle is dragged behind the front bumper as a real one is.

Two judges apply the criterion of commonroad-drivability-checker (kinematic single-track model, default tolerances).
``check_drivability`` is the checker itself, which searches inputs by optimisation and takes 0.1 to 0.9 s per
trajectory. ``check_kinematics`` is a closed form that takes 0.2 ms, and its rare errors are false alarms. Screen with
the closed form; accept with the checker.
"""

import copy
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points, Values, arc_length, gaussian, interpolate, without_repeats, wrap_angle, wrap_angles
from .models import BMW_320I
from .motion_thresholds import REST_OF_SMOOTHING_MPS

SMOOTHINGS = ((3.0, 2.0), (5.0, 3.0), (8.0, 4.0))
"""(steps, metres) tried in this order until a motion is drivable (chosen): stronger smoothing moves it more."""
_SHORTEST_TRACK_M = 0.3
"""A shorter track is that of a standing vehicle (chosen)."""
_BEHIND_START_M = 1.0
"""The path starts this far behind the rear of a vehicle at its first point (chosen)."""
_CELL_M = 0.25
"""Spacing of the points at which a path is smoothed, an eighth of the smoothing (chosen)."""
_WHEELBASE_M = 2.5789
"""That of CommonRoad's vehicle 2, to four digits as for the class ``car``. ``BMW_320I`` has the rounded 2.579, which
planner runs use: one value for both would change either their bytes or those of generated and edited traffic.
"""
_POSITION_TOLERANCE_M = 2e-2
_HEADING_TOLERANCE_RAD = 3e-2
"""The checker's default tolerances for a step."""
_FRICTION_EXCESS = 1.1
"""Factor by which accelerations may exceed what a road of stated friction allows: smoothing raises the constant braking
of SUMO's drivers by 7% in ``tests/engine/edits/test_friction.py``.
"""
_STEERING_FROM_MPS = 0.05
"""Below this speed a turn gives no steering angle (chosen)."""


@dataclass(frozen=True)
class Motion:
    """Motion of a centre: positions (n, 2) in m; headings (n,) in rad, speeds in m/s, accelerations in m/s²."""

    positions: Points
    headings_rad: Values
    speeds_mps: Values
    accelerations_mps2: Values


def drivable_motion(
    front: Points,
    first_heading_rad: float,
    length_m: float,
    step_s: float,
    *,
    sigma_steps: float = 3.0,
    sigma_m: float = 2.0,
    rear_axle_m: float = BMW_320I.rear_axle_behind_center_m,
) -> Motion:
    """Return the motion of the centre for a track of the front bumper, shape (n, 2), one point per step.

    A track shorter than 0.3 m counts as a standing vehicle.

    Args:
        front: the track of the front bumper.
        first_heading_rad: heading of the vehicle at its first point.
        length_m: its length.
        step_s: duration of a time step.
        sigma_steps: standard deviation of the smoothing of the progress, in steps.
        sigma_m: standard deviation of the smoothing of the path, in m.
        rear_axle_m: distance from the centre back to the rear axle.
    """
    front = np.asarray(front, dtype=float)
    count = len(front)
    stations = arc_length(front)
    if stations[-1] < _SHORTEST_TRACK_M:
        heading = np.full(count, first_heading_rad)
        direction = np.array([math.cos(first_heading_rad), math.sin(first_heading_rad)])
        still = np.repeat(front[:1], count, axis=0) - length_m / 2 * direction
        return Motion(still, heading, np.zeros(count), np.zeros(count))
    guide = _smooth_guide(front, stations, sigma_steps, sigma_m)
    heading = tractrix(guide, first_heading_rad, length_m / 2 + rear_axle_m)
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    rear = guide - (length_m / 2 + rear_axle_m) * direction
    speed = np.gradient(arc_length(rear), step_s)
    speed[speed < REST_OF_SMOOTHING_MPS] = 0.0
    return Motion(guide - length_m / 2 * direction, heading, speed, np.gradient(speed, step_s))


def center_track(front: Points, first_heading_rad: float, length_m: float) -> Points:
    """Return the centre's track, shape (n, 2): the front bumper's, half a vehicle further back along the same path.

    A centre dragged behind the front bumper would cut corners by metres for a long vehicle, and in a curve that is
    tighter than its bumper can turn, the body would pivot about the rear axle. With the centre on the path, the front
    swings out and the rear in, as when bus drivers turn.

    Args:
        front: the track of the front bumper.
        first_heading_rad: heading of the vehicle at its first point; the body is straight behind it.
        length_m: its length.
    """
    half = length_m / 2
    backwards = -np.array([math.cos(first_heading_rad), math.sin(first_heading_rad)])
    path = without_repeats(np.vstack([front[:1] + (half + _BEHIND_START_M) * backwards, front]))
    stations = arc_length(front) + _BEHIND_START_M
    return interpolate(path, arc_length(path), stations)


def _smooth_guide(front: Points, stations: Values, sigma_steps: float, sigma_m: float) -> Points:
    """Return the front track, smoothed across its path and along its time."""
    moving = np.concatenate([[True], np.diff(stations) > 1e-3])
    cells = max(int(stations[-1] / _CELL_M), 4)
    even = np.linspace(0.0, stations[-1], cells + 1)
    path = gaussian(interpolate(front[moving], stations[moving], even), sigma_m / (stations[-1] / cells))
    progress = np.maximum.accumulate(np.clip(gaussian(stations, sigma_steps), 0.0, stations[-1]))
    along = arc_length(path)
    return interpolate(path, along, np.interp(progress, even, along))


def tractrix(guide: Points, first_heading_rad: float, drag_m: float) -> Values:
    """Return the heading of a rod of length ``drag_m`` with its front end on the guide, shape (n,), unwrapped."""
    heading = np.empty(len(guide))
    heading[0] = angle = first_heading_rad
    points = guide.tolist()  # plain floats: ten times as fast as small arrays
    rear_x, rear_y = points[0][0] - drag_m * math.cos(angle), points[0][1] - drag_m * math.sin(angle)
    for step in range(1, len(points)):
        (x, y), (tip_x, tip_y) = points[step - 1], points[step]
        for quarter in range(1, 5):
            front_x, front_y = x + (tip_x - x) * quarter / 4, y + (tip_y - y) * quarter / 4
            angle = math.atan2(front_y - rear_y, front_x - rear_x)
            rear_x, rear_y = front_x - drag_m * math.cos(angle), front_y - drag_m * math.sin(angle)
        heading[step] = angle
    return np.unwrap(heading)


@dataclass(frozen=True)
class Feasibility:
    """The verdict on a motion: whether every step can be driven, the share of steps that can, the first that cannot."""

    feasible: bool
    share_of_steps: float
    first_infeasible_step: int | None


def steering_angles(motion: Motion, step_s: float, wheelbase_m: float = _WHEELBASE_M) -> Values:
    """Return the steering angle in rad that turns each state into the next, shape (n,); the last angle is repeated."""
    if len(motion.headings_rad) < 2:
        return np.zeros(len(motion.headings_rad))
    turn = wrap_angles(np.diff(motion.headings_rad))
    speed = np.maximum((motion.speeds_mps[:-1] + motion.speeds_mps[1:]) / 2, 1e-3)
    angle = np.arctan(wheelbase_m * turn / (speed * step_s))
    angle[speed < _STEERING_FROM_MPS] = 0.0
    largest_rad = BMW_320I.maximum_steering_rad
    limited: Values = np.clip(np.append(angle, angle[-1]), -largest_rad, largest_rad)
    return limited


def check_kinematics(
    motion: Motion,
    step_s: float,
    *,
    wheelbase_m: float = _WHEELBASE_M,
    rear_axle_m: float = BMW_320I.rear_axle_behind_center_m,
    friction: float | None = None,
) -> Feasibility:
    """Judge a motion of the centre by the closed form, by default with the dimensions of CommonRoad's vehicle 2."""
    return _verdict(drivable_steps(motion, step_s, wheelbase_m=wheelbase_m, rear_axle_m=rear_axle_m, friction=friction))


def drivable_steps(
    motion: Motion,
    step_s: float,
    *,
    wheelbase_m: float = _WHEELBASE_M,
    rear_axle_m: float = BMW_320I.rear_axle_behind_center_m,
    friction: float | None = None,
) -> NDArray[np.bool_]:
    """Return a mask of the steps between states that can be driven by the closed form, shape (n − 1,).

    ``friction``: the coefficient of friction of the road, which limits the acceleration; None if it is not stated.
    """
    largest_mps2 = BMW_320I.on_road(friction).maximum_acceleration_mps2
    heading = motion.headings_rad
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    moved = np.diff(motion.positions - rear_axle_m * direction, axis=0)
    turn = wrap_angles(np.diff(heading))
    middle = heading[:-1] + turn / 2
    along = moved[:, 0] * np.cos(middle) + moved[:, 1] * np.sin(middle)
    speed = motion.speeds_mps[:-1]
    steering = np.tan(steering_angles(motion, step_s, wheelbase_m)[:-1])
    lateral = np.abs(speed**2 / wheelbase_m * steering)
    within_friction = lateral <= largest_mps2
    limit = np.sqrt(np.maximum(largest_mps2**2 - lateral**2, 0.0))
    acceleration = np.clip(2 * (along - speed * step_s) / step_s**2, -limit, limit)
    reachable = speed * step_s + acceleration * step_s**2 / 2
    reachable_turn = reachable / wheelbase_m * steering
    course = heading[:-1] + reachable_turn / 2
    error_x = np.abs(moved[:, 0] - reachable * np.cos(course))
    error_y = np.abs(moved[:, 1] - reachable * np.sin(course))
    error_heading = np.abs(wrap_angles(turn - reachable_turn))
    good: NDArray[np.bool_] = (
        (error_x < _POSITION_TOLERANCE_M)
        & (error_y < _POSITION_TOLERANCE_M)
        & (error_heading < _HEADING_TOLERANCE_RAD)
        & within_friction
    )
    return good if friction is None else good & _within_friction(motion, step_s, wheelbase_m, friction)


def _within_friction(motion: Motion, step_s: float, wheelbase_m: float, friction: float) -> NDArray[np.bool_]:
    """Return a mask of the steps that need no more friction than the road has, shape (n − 1,).

    The tolerances for positions would hide 4 m/s² in a step of 0.1 s, so speeds and headings are used.
    """
    speed = (motion.speeds_mps[:-1] + motion.speeds_mps[1:]) / 2
    along = np.diff(motion.speeds_mps) / step_s
    across = speed**2 / wheelbase_m * np.tan(steering_angles(motion, step_s, wheelbase_m)[:-1])
    largest_mps2 = BMW_320I.on_road(friction).maximum_acceleration_mps2
    return np.asarray(np.hypot(along, across) <= _FRICTION_EXCESS * largest_mps2)


def check_drivability(
    motion: Motion,
    step_s: float,
    *,
    wheelbase_m: float = _WHEELBASE_M,
    rear_axle_m: float = BMW_320I.rear_axle_behind_center_m,
    friction: float | None = None,
) -> Feasibility:
    """Judge a motion of the centre by the checker, with the axles of the judged vehicle.

    Every step is checked, so that the share and the first bad one are known. All other parameters are those of
    CommonRoad's vehicle 2 (BMW 320i).
    """
    from commonroad.common.solution import VehicleType
    from commonroad.scenario.state import KSState
    from commonroad_dc.feasibility.feasibility_checker import state_transition_feasibility
    from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics

    steering = steering_angles(motion, step_s, wheelbase_m)
    states = [
        KSState(
            time_step=index,
            position=position,
            steering_angle=float(steering[index]),
            velocity=max(float(motion.speeds_mps[index]), 0.0),
            orientation=wrap_angle(float(motion.headings_rad[index])),
        )
        for index, position in enumerate(motion.positions)
    ]
    model = VehicleDynamics.KS(VehicleType.BMW_320i)
    model.parameters = copy.deepcopy(model.parameters)  # the library shares one parameter object among all models
    model.parameters.a, model.parameters.b = wheelbase_m - rear_axle_m, rear_axle_m
    if friction is not None:
        model.parameters.longitudinal.a_max = BMW_320I.on_road(friction).maximum_acceleration_mps2
    transitions = (state_transition_feasibility(*pair, model, step_s)[0] for pair in itertools.pairwise(states))
    good = np.fromiter(transitions, dtype=bool)
    return _verdict(good if friction is None else good & _within_friction(motion, step_s, wheelbase_m, friction))


def _verdict(good: NDArray[np.bool_]) -> Feasibility:
    """Return the verdict on a motion from those on its steps (n,); a motion without steps can be driven."""
    bad = np.flatnonzero(~good)
    return Feasibility(not len(bad), float(good.mean()) if len(good) else 1.0, int(bad[0]) if len(bad) else None)
