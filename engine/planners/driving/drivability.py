"""Checks whether the ego's vehicle can drive a trajectory, within its tyre and steering limits.

The curvatures of Frenetix's core contain its halved second derivatives (see ``frenetix/core.py``), and its acceleration
covers only the direction of the path. This module computes both from the trajectory, by the kinematic single-track
model of the rear axle: yaw rate = speed · tan(steering) / wheelbase. The limits are the vehicle's, as in CommonRoad's
drivability checker: the largest steering angle, and the friction circle, which limits longitudinal and lateral
acceleration together to ``maximum_acceleration_mps2`` (Althoff and Würsching, "CommonRoad: Vehicle Models", 2020).

Candidates are checked only for these two limits. Driven motions are checked for all limits (``exceeded_limits``), since
any of them may cause the refusal of an exported solution.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ....schemas.runs import LimitExcess
from ...commonroad import Track
from ...geometry import Points, Values
from ...vehicles import Motion, VehicleParameters, check_kinematics
from ..interface import PlannedTrajectory
from .solution import steering_of

Limit = Literal["curvature", "friction"]
_SLOW_MPS = 0.5
"""Below it, a step of a few centimetres does not determine the curvature."""
_ROUNDING = 1e-3
"""Share of a limit by which a value may exceed it, since planners plan up to their limits."""


def violated_limit(trajectory: PlannedTrajectory, vehicle: VehicleParameters, step_s: float) -> Limit | None:
    """Return the limit that a trajectory of the centre breaks, or None; its speeds are those of the rear axle."""
    slips, turns = broken_limits(trajectory.headings_rad[None], trajectory.speeds_mps[None], vehicle, step_s)
    return "friction" if slips[0] else "curvature" if turns[0] else None


def broken_limits(
    headings_rad: Points, speeds_mps: Points, vehicle: VehicleParameters, step_s: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return two masks (n,): the motions that break the friction limit, and those that break the curvature limit.

    ``headings_rad`` and ``speeds_mps`` have the shape (n, steps).
    """
    speed = 0.5 * (speeds_mps[:, 1:] + speeds_mps[:, :-1])
    yaw_rate = np.diff(headings_rad, axis=1) / step_s
    along = np.diff(speeds_mps, axis=1) / step_s
    hardest = (along**2 + (speed * yaw_rate) ** 2).max(axis=1, initial=0.0)
    moving = speed > _SLOW_MPS
    curvature = np.where(moving, np.abs(yaw_rate) / np.where(moving, speed, 1.0), 0.0).max(axis=1, initial=0.0)
    turns = vehicle.wheelbase_m * curvature > np.tan(vehicle.maximum_steering_rad)
    return hardest > vehicle.maximum_acceleration_mps2**2, np.asarray(turns)


def exceeded_limits(
    ego: Track, vehicle: VehicleParameters, step_s: float, steering_rad: Values | None = None
) -> Iterator[LimitExcess]:
    """Yield the vehicle limits that a driven motion of its centre exceeds, each at its largest excess.

    ``steering_rad``: the steering angles (n,), if known; otherwise they are computed from headings and speeds.
    ``rolling``: the share of steps in which the wheels would have to slide, because no steering and acceleration lead
    to the position and heading (tolerances of CommonRoad's drivability checker: 2 cm and 0.03 rad per step).
    """
    if len(ego.positions) < 2:
        return
    speed = 0.5 * (ego.speeds_mps[1:] + ego.speeds_mps[:-1])
    along = np.diff(ego.speeds_mps) / step_s
    across = speed * np.diff(np.unwrap(ego.headings_rad)) / step_s
    steering = steering_rad
    if steering is None:
        steering = steering_of(ego.headings_rad, ego.speeds_mps, step_s, vehicle.wheelbase_m)
    powered = vehicle.maximum_acceleration_mps2 * np.minimum(
        1.0, vehicle.switching_speed_mps / np.maximum(speed, vehicle.switching_speed_mps)
    )
    top = np.full(len(ego.speeds_mps), vehicle.maximum_speed_mps)
    tyres = np.full(len(along), vehicle.maximum_acceleration_mps2)
    turned = np.full(len(steering), vehicle.maximum_steering_rad)
    rate = np.full(len(along), vehicle.maximum_steering_rate_radps)
    yield from _excess("speed", ego.speeds_mps, top, "m/s", step_s)
    yield from _excess("acceleration", along, powered, "m/s²", step_s, first=1)
    yield from _excess("friction", np.hypot(along, across), tyres, "m/s²", step_s, first=1)
    yield from _excess("steering angle", np.abs(steering), turned, "rad", step_s)
    yield from _excess("steering rate", np.abs(np.diff(steering)) / step_s, rate, "rad/s", step_s, first=1)
    motion = Motion(ego.positions, ego.headings_rad, ego.speeds_mps, np.append(along, along[-1:]))
    rolls = check_kinematics(
        motion, step_s, wheelbase_m=vehicle.wheelbase_m, rear_axle_m=vehicle.rear_axle_behind_center_m
    )
    if rolls.first_infeasible_step is not None:
        slides = 1.0 - rolls.share_of_steps
        time_s = round((rolls.first_infeasible_step + 1) * step_s, 9)
        yield LimitExcess(name="rolling", value=slides, limit=0.0, unit="of the steps", time_s=time_s)


def excesses_of(trajectory: PlannedTrajectory, vehicle: VehicleParameters, step_s: float) -> tuple[LimitExcess, ...]:
    """Return the vehicle limits that a trajectory of its centre exceeds."""
    track = Track(
        obstacle_id=-1,
        kind="car",
        length_m=vehicle.length_m,
        width_m=vehicle.width_m,
        first_step=0,
        positions=trajectory.positions,
        headings_rad=trajectory.headings_rad,
        speeds_mps=trajectory.speeds_mps,
    )
    return tuple(exceeded_limits(track, vehicle, step_s, trajectory.steering_rad))


_LimitName = Literal["speed", "acceleration", "friction", "steering angle", "steering rate"]


def _excess(
    name: _LimitName, values: Values, limits: Values, unit: str, step_s: float, *, first: int = 0
) -> Iterator[LimitExcess]:
    """Yield the entry farthest above its limit, if any; ``first`` is the number of the first entry's state."""
    index = int((values - limits).argmax())
    value, limit = float(values[index]), float(limits[index])
    if value > limit * (1 + _ROUNDING):
        time_s = round((index + first) * step_s, 9)
        yield LimitExcess(name=name, value=value, limit=limit, unit=unit, time_s=time_s)
