"""From the core's samples to values of our own, and back to the planner's state at the next step.

Array properties of the core's samples are views into its memory: they dangle once candidates are generated anew.
Everything here is copied.

The core (0.4.0) evaluates its polynomials by Horner's scheme and leaves out the factor 2 of the second derivative:
the accelerations of its samples, along and across the path, are half of the true ones. A plan that went on from them
would begin with a jump in acceleration, so they are doubled here, and the acceleration of a trajectory is taken from
its speeds. What the vehicle can drive is judged anew (see ``drivability``). The core's cost terms ``acceleration`` and
``jerk`` stay a quarter of the true integrals, because the weights of the presets were found with them.
"""

from dataclasses import dataclass, replace

import frenetix
import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, wrap_angle
from plannerforge.engine.planners.frenet_frame import FrenetFrame
from plannerforge.engine.planners.frenet_sampling import CurvilinearState, EndState
from plannerforge.engine.planners.interface import EgoState, PlannedTrajectory
from plannerforge.engine.planners.vehicle import VehicleParameters, centers, rear_axle

SAME_PLACE_M = 1e-6
SECOND_DERIVATIVE_FACTOR = 2.0
"""True over reported second derivatives of the core's samples; a test holds it against differences."""


@dataclass(frozen=True)
class DrivenPlan:
    """The trajectory that was chosen at ``first_step``, with its curvilinear states (6, n): s, s', s'', d, d', d''."""

    first_step: int
    trajectory: PlannedTrajectory
    curvilinear: Points
    low_speed: bool
    end: EndState

    def state_for(self, ego: EgoState, low_speed: bool) -> CurvilinearState | None:
        """The curvilinear state where the ego is, if it followed this plan."""
        index = ego.step - self.first_step
        if not 0 <= index < len(self.trajectory.positions):
            return None
        if float(np.linalg.norm(self.trajectory.positions[index] - ego.position)) > SAME_PLACE_M:
            return None
        column = self.curvilinear[:, index]
        return CurvilinearState(column[:3].copy(), column[3:].copy(), self.low_speed).as_mode(low_speed)

    def rest_for(self, ego: EgoState, step_s: float) -> EndState:
        """What is left of this plan at a later step."""
        return replace(self.end, duration_s=round(self.end.duration_s - (ego.step - self.first_step) * step_s, 6))


def copied_trajectory(
    sample: "frenetix.TrajectorySample", frame: FrenetFrame, ego: EgoState, vehicle: VehicleParameters
) -> PlannedTrajectory:
    """A sample as states of the centre in the world; headings continue the ego's."""
    inner = sample.cartesian
    speed = np.array(inner.v, dtype=float)
    heading = np.array(inner.theta, dtype=float) + frame.angle_rad
    heading += wrap_angle(float(heading[0]) - ego.heading_rad) - (float(heading[0]) - ego.heading_rad)
    rear = frame.outwards(np.stack([np.array(inner.x, dtype=float), np.array(inner.y, dtype=float)], axis=1))
    return PlannedTrajectory(
        positions=centers(rear, heading, vehicle),
        headings_rad=heading,
        speeds_mps=speed,
        accelerations_mps2=np.gradient(speed, sample.dt),
    )


def copied_curvilinear(sample: "frenetix.TrajectorySample") -> Points:
    """The curvilinear states of a sample, shape (6, n), with true second derivatives."""
    inner = sample.curvilinear
    rows = (inner.s, inner.s_dot, inner.s_ddot, inner.d, inner.d_dot, inner.d_ddot)
    states = np.array([np.array(row, dtype=float) for row in rows])
    states[[2, 5]] *= SECOND_DERIVATIVE_FACTOR
    return states


def end_state(sample: "frenetix.TrajectorySample") -> EndState:
    """The end that a sample was made for."""
    row = sample.sampling_parameters
    return EndState(duration_s=float(row[1]), speed_mps=float(row[5]), offset_m=float(row[10]))


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
