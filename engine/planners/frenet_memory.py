"""From the core's samples to values of our own, and back to the planner's state at the next step.

Array properties of the core's samples are views into its memory: they dangle once candidates are generated anew.
Everything here is copied.
"""

from dataclasses import dataclass

import frenetix
import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, wrap_angle
from plannerforge.engine.planners.frenet_frame import FrenetFrame
from plannerforge.engine.planners.frenet_sampling import CurvilinearState
from plannerforge.engine.planners.interface import EgoState, PlannedTrajectory
from plannerforge.engine.planners.vehicle import VehicleParameters, centers, rear_axle

SAME_PLACE_M = 1e-6


@dataclass(frozen=True)
class DrivenPlan:
    """The trajectory that was chosen at ``first_step``, with its curvilinear states (6, n): s, s', s'', d, d', d''."""

    first_step: int
    trajectory: PlannedTrajectory
    curvilinear: Points
    low_speed: bool

    def state_for(self, ego: EgoState, low_speed: bool) -> CurvilinearState | None:
        """The curvilinear state where the ego is, if it followed this plan."""
        index = ego.step - self.first_step
        if not 0 <= index < len(self.trajectory.positions):
            return None
        if float(np.linalg.norm(self.trajectory.positions[index] - ego.position)) > SAME_PLACE_M:
            return None
        column = self.curvilinear[:, index]
        return CurvilinearState(column[:3].copy(), column[3:].copy(), self.low_speed).as_mode(low_speed)


def copied_trajectory(
    sample: "frenetix.TrajectorySample", frame: FrenetFrame, ego: EgoState, vehicle: VehicleParameters
) -> PlannedTrajectory:
    """A sample as states of the centre in the world; headings continue the ego's."""
    inner = sample.cartesian
    heading = np.array(inner.theta, dtype=float) + frame.angle_rad
    heading += wrap_angle(float(heading[0]) - ego.heading_rad) - (float(heading[0]) - ego.heading_rad)
    rear = frame.outwards(np.stack([np.array(inner.x, dtype=float), np.array(inner.y, dtype=float)], axis=1))
    return PlannedTrajectory(
        positions=centers(rear, heading, vehicle),
        headings_rad=heading,
        speeds_mps=np.array(inner.v, dtype=float),
        accelerations_mps2=np.array(inner.a, dtype=float),
    )


def copied_curvilinear(sample: "frenetix.TrajectorySample") -> Points:
    """The curvilinear states of a sample, shape (6, n)."""
    inner = sample.curvilinear
    rows = (inner.s, inner.s_dot, inner.s_ddot, inner.d, inner.d_dot, inner.d_ddot)
    return np.array([np.array(row, dtype=float) for row in rows])


def core_state(frame: FrenetFrame, ego: EgoState, vehicle: VehicleParameters) -> "frenetix.CartesianPlannerState":
    """The ego as the core's Cartesian state: the rear axle in the frame, the steering angle from the yaw rate."""
    rear = frame.inwards(rear_axle(ego.position, ego.heading_rad, vehicle))
    steering = float(np.arctan2(vehicle.wheelbase_m * ego.yaw_rate_radps, max(ego.speed_mps, 1e-3)))
    steering = float(np.clip(steering, -vehicle.maximum_steering_rad, vehicle.maximum_steering_rad))
    heading = frame.heading_inwards(ego.heading_rad)
    return frenetix.CartesianPlannerState(
        np.ascontiguousarray(rear), heading, ego.speed_mps, ego.acceleration_mps2, steering
    )


def initial_state(
    frame: FrenetFrame, ego: EgoState, vehicle: VehicleParameters, low_speed: bool
) -> CurvilinearState | None:
    """The ego's curvilinear state by the core; None where it cannot be placed (opposite heading, off the path)."""
    try:
        found = frenetix.compute_initial_state(
            frame.system, core_state(frame, ego, vehicle), vehicle.wheelbase_m, low_speed
        )
    except (RuntimeError, ValueError):
        return None
    longitudinal, lateral = np.array(found.x0_lon, dtype=float), np.array(found.x0_lat, dtype=float)
    if not (np.isfinite(longitudinal).all() and np.isfinite(lateral).all()):
        return None
    return CurvilinearState(longitudinal, lateral, low_speed)


def standstill(ego: EgoState, steps: int) -> PlannedTrajectory:
    """Staying where the ego is for so many steps."""
    values: Values = np.zeros(steps + 1)
    return PlannedTrajectory(
        positions=np.repeat(ego.position[None, :], steps + 1, axis=0),
        headings_rad=np.full(steps + 1, ego.heading_rad),
        speeds_mps=values,
        accelerations_mps2=values.copy(),
    )
