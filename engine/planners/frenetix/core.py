"""Frenetix's C++ core (0.4.0): its inputs, its outputs, and its pitfalls.

In the order of use: the core's frame (``FrameKeeper``), the ego's state in it, the sampled end states, the feasibility
checks and cost functions, and copies of the core's samples as our own values. Lengths in m, headings in rad; "inner"
coordinates are those of the frame, all others are world coordinates.

Pitfalls (tested by ``test_frenetix_traps.py``):

- The core interpolates the reference heading as an angle within ±π. On a route that crosses ±π, the heading jumps by
  2π and every candidate there fails the yaw-rate check. The core therefore gets coordinates turned to the middle of the
  headings ahead; a route that turns through more than a full circle gets a new frame on the way.
- It takes the direction of the segment after a vertex as the heading at the vertex, so its headings run half a segment
  ahead of its positions. In a curve the ego's heading would differ by up to 40 mrad from the motion of its rear axle,
  which no vehicle can drive. We replace the headings by the tangents at the vertices.
- It evaluates its polynomials by Horner's scheme without the factor 2 of the second derivative, so the longitudinal and
  lateral accelerations of its samples are half of the true ones. A plan that continues from them would start with a
  jump in acceleration, so we double them, and take the acceleration of a trajectory from its speeds. We check again
  what the vehicle can drive (``driving/drivability.py``). The core's cost terms ``acceleration`` and ``jerk`` stay a
  quarter of the true integrals, since the presets' weights were tuned with them.
- Array properties of its samples are views of its memory and dangle once new candidates are generated. We copy all of
  them.
- It keeps cost functions until one with the same name replaces them (:func:`add_step_functions`), cannot take an empty
  array of obstacles, and compares its state i with entry i − 1 of a prediction (:func:`_core_prediction`).
- Its term ``distance_to_obstacles`` keeps a view of the given array, not a copy.
- It refuses paths that double back over themselves (:func:`_longest_accepted`).
"""

import math
from collections import Counter
from dataclasses import dataclass, field, replace

import frenetix
import frenetix.trajectory_functions as functions
import frenetix.trajectory_functions.cost_functions as costs
import frenetix.trajectory_functions.feasability_functions as feasibility
import numpy as np

from ....schemas.planning import PlannerSettings
from ...commonroad import MadeOnce
from ...geometry import Points, Values, arc_length, headings, wrap_angle
from ...vehicles import ARC_LENGTH_MPS, VehicleParameters, centers, rear_axle
from ..driving.following import is_on_plan
from ..interface import EgoState, Observation, PlannedTrajectory, PredictedObstacle
from ..reference_path import FASTEST_MPS

SECOND_DERIVATIVE_FACTOR = 2.0
"""Ratio of the true to the reported second derivatives of the core's samples; a test compares it with differences."""
SAFE_RANGE_RAD = 0.75 * math.pi
"""Headings of a frame stay within this of its direction, far from ±π (chosen)."""
_BEHIND_M = 10.0
"""Distance behind the ego from which headings count for a frame (chosen)."""
_DURATION_STEPS_S = (1.0, 0.5, 0.3, 0.2)
"""Steps of the sampled durations at levels 0 to 3, as in the reference for time steps of 0.1 s."""
_SHORTEST_REST_S = 0.2
"""Shortest rest of the driven plan that still counts as an end state (chosen)."""
FINAL_SPEED, FINAL_OFFSET = 5, 10
"""Columns of the sampling matrix."""
CONSTRAINTS = {
    "Yaw rate Constraint": "yaw_rate",
    "Acceleration Constraint": "acceleration",
    "Curvature Constraint": "curvature",
    "Curvature Rate Constraint": "curvature_rate",
}
"""Maps the core's feasibility checks to the names in plans."""
BEYOND_REACH_M = 15.0
"""√50 m of the core plus the largest lateral offset, with a margin; the ego's own length is added to it."""


@dataclass(frozen=True)
class FrenetFrame:
    """A reference path in the core's frame: moved to ``origin`` and turned by ``-angle_rad``."""

    origin: Points
    angle_rad: float
    system: "frenetix.CoordinateSystemWrapper"

    @classmethod
    def of(cls, path: Points, angle_rad: float) -> "FrenetFrame":
        """Return the frame of a path, turned so that the heading ``angle_rad`` becomes 0."""
        origin = np.array(path[0], dtype=np.float64)
        inner = np.ascontiguousarray((path - origin) @ _rotation(angle_rad))
        system = frenetix.CoordinateSystemWrapper(inner)
        system.ref_theta = tangents(np.array(system.ref_theta))
        return cls(origin, angle_rad, system)

    def inwards(self, points: Points) -> Points:
        """Convert world coordinates, shape (…, 2), to the frame."""
        inner: Points = (points - self.origin) @ _rotation(self.angle_rad)
        return inner

    def outwards(self, points: Points) -> Points:
        """Convert frame coordinates, shape (n, 2), to world coordinates."""
        outer: Points = points @ _rotation(self.angle_rad).T + self.origin
        return outer

    def heading_inwards(self, heading_rad: float) -> float:
        """Convert a heading to the frame, in [−π, π)."""
        return (heading_rad - self.angle_rad + math.pi) % math.tau - math.pi


class FrameKeeper:
    """Provides a frame in which no heading ahead is near ±π, and keeps the old frame while it is suitable.

    ``made``: keeps the frames of a path, because runs repeat the same path, and the core takes long to make its system.
    """

    def __init__(self, path: Points, made: MadeOnce | None = None) -> None:
        self._made = made or MadeOnce()
        self._follow(self._made.get("accepted path", lambda: self._accepted(path)))

    def _accepted(self, path: Points) -> Points:
        """Return the path, or its longest initial part that the core accepts."""
        try:
            self._follow(path)
        except RuntimeError:
            return _longest_accepted(path)
        return path

    def _follow(self, path: Points) -> None:
        self._path = path
        self._stations = arc_length(path)[:-1]
        self._headings = headings(path)
        low, high = float(self._headings.min()), float(self._headings.max())
        fits = high - low < 2 * SAFE_RANGE_RAD
        self.frame = self._frame((low + high) / 2 if fits else float(self._headings[0]))

    def _frame(self, angle_rad: float) -> FrenetFrame:
        path = self._path
        return self._made.get(("frame", len(path), angle_rad), lambda: FrenetFrame.of(path, angle_rad))

    def frame_for(self, station_m: float, ahead_m: float) -> FrenetFrame:
        """Return the frame for planning from an arc length over the given distance ahead."""
        near = (self._stations >= station_m - _BEHIND_M) & (self._stations <= station_m + ahead_m)
        window = self._headings[near] if near.any() else self._headings[-1:]
        turned = np.abs(np.remainder(window - self.frame.angle_rad + math.pi, math.tau) - math.pi)
        low, high = float(window.min()), float(window.max())
        if float(turned.max()) > SAFE_RANGE_RAD and high - low < 2 * SAFE_RANGE_RAD:
            self.frame = self._frame((low + high) / 2)
        return self.frame


def _longest_accepted(path: Points) -> Points:
    """Return the path, or the longest initial part that the core accepts.

    If a path doubles back over itself, for example around the loop of a dead end, the core finds no area in which every
    point has a unique position along the path, and refuses the whole path.
    """
    accepted, refused = 2, len(path)
    while refused - accepted > 1:
        middle = (accepted + refused) // 2
        try:
            FrenetFrame.of(path[:middle], 0.0)
            accepted = middle
        except RuntimeError:
            refused = middle
    return path[:accepted]


def tangents(segments_rad: Values) -> Values:
    """Return the heading at every vertex, the mean of the segments before and after it.

    ``segments_rad``: the heading of the segment after each vertex, without jumps; the last one appears twice.
    """
    tangents = segments_rad.copy()
    tangents[1:-1] = 0.5 * (segments_rad[:-2] + segments_rad[1:-1])
    return tangents


def _rotation(angle_rad: float) -> Points:
    """Return the matrix R such that ``p @ R`` is p turned by ``-angle_rad``."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


@dataclass(frozen=True)
class CurvilinearState:
    """Arc length and lateral offset, with two derivatives each.

    The lateral derivatives are with respect to arc length at low speed (``low_speed``), otherwise with respect to time.
    """

    longitudinal: Values
    lateral: Values
    low_speed: bool

    def as_mode(self, low_speed: bool) -> "CurvilinearState":
        """Return the same state with lateral derivatives for the given mode, converted by the chain rule."""
        if low_speed == self.low_speed:
            return self
        _, speed, acceleration = self.longitudinal
        offset, first, second = self.lateral
        if not low_speed:
            lateral = [offset, first * speed, second * speed**2 + first * acceleration]
        elif speed > ARC_LENGTH_MPS:
            slope = first / speed
            lateral = [offset, slope, (second - slope * acceleration) / speed**2]
        else:
            lateral = [offset, 0.0, 0.0]
        return CurvilinearState(self.longitudinal, np.array(lateral), low_speed)


def initial_state(
    frame: FrenetFrame, ego: EgoState, vehicle: VehicleParameters, low_speed: bool
) -> CurvilinearState | None:
    """Return the ego's curvilinear state, or None if the core cannot place it (opposite heading, off the path)."""
    rear = frame.inwards(rear_axle(ego.position, ego.heading_rad, vehicle))
    steering = ego.steering_rad
    if steering is None:
        steering = float(np.arctan2(vehicle.wheelbase_m * ego.yaw_rate_radps, max(ego.speed_mps, ARC_LENGTH_MPS)))
        steering = float(np.clip(steering, -vehicle.maximum_steering_rad, vehicle.maximum_steering_rad))
    heading = frame.heading_inwards(ego.heading_rad)
    present = frenetix.CartesianPlannerState(
        np.ascontiguousarray(rear), heading, ego.speed_mps, ego.acceleration_mps2, steering
    )
    try:
        state = frenetix.compute_initial_state(frame.system, present, vehicle.wheelbase_m, low_speed)
    except (RuntimeError, ValueError):
        return None
    longitudinal, lateral = np.array(state.x0_lon, dtype=float), np.array(state.x0_lat, dtype=float)
    if not (np.isfinite(longitudinal).all() and np.isfinite(lateral).all()):
        return None
    return CurvilinearState(longitudinal, lateral, low_speed)


@dataclass(frozen=True)
class SamplingSettings:
    """The reference's sampling, by default at level 2: nine values per axis, durations 1.1 s, 1.4 s and so on."""

    horizon_s: float = 3.0
    shortest_s: float = 1.1
    duration_step_s: float = 0.3
    lateral_m: float = 3.0
    values: int = 9

    @property
    def followed_within_m(self) -> float:
        """The largest distance of the vehicle from a candidate that it follows, half the spacing of sampled offsets.

        Farther away the vehicle is nearer to another candidate, and the costs belong to a motion that it does not
        drive.
        """
        return self.lateral_m / (self.values - 1)

    @classmethod
    def of(cls, settings: PlannerSettings) -> "SamplingSettings":
        """Return the sampling for a configuration's horizon and level; each level halves the distance
        between values.
        """
        level = settings.sampling_level
        return cls(horizon_s=settings.horizon_s, values=2 ** (level + 1) + 1, duration_step_s=_DURATION_STEPS_S[level])


@dataclass(frozen=True)
class EndState:
    """The end of a candidate: after ``duration_s``, at ``speed_mps`` along the path and lateral offset ``offset_m``."""

    duration_s: float
    speed_mps: float
    offset_m: float

    @classmethod
    def of(cls, sample: "frenetix.TrajectorySample") -> "EndState":
        """Return the end state of a sample."""
        row = sample.sampling_parameters
        return cls(duration_s=float(row[1]), speed_mps=float(row[FINAL_SPEED]), offset_m=float(row[FINAL_OFFSET]))


def sampling_matrix(
    state: CurvilinearState,
    speed_mps: float,
    settings: SamplingSettings,
    vehicle: VehicleParameters,
    going_on: EndState | None = None,
) -> Points:
    """Return all combinations as the core's matrix, shape (n, 13).

    Columns: t0, t1, s0, s0', s0'', s1', s1'', d0, d0', d0'', d1, d1', d1''. The matrix has about 800 rows. The end
    states include the present speed and offset, the whole horizon, and ``going_on``, the rest of the driven plan.
    Without ``going_on``, replanning loses a plan that stops just in time, since every new candidate takes at least
    ``shortest_s``.
    """
    durations = np.arange(settings.shortest_s, settings.horizon_s + 1e-9, settings.duration_step_s)
    durations = np.unique(np.round(np.append(durations, settings.horizon_s), 6))
    low = max(0.001, speed_mps - vehicle.maximum_acceleration_mps2 * settings.horizon_s)
    reach = speed_mps + vehicle.maximum_acceleration_mps2 / 6.0 * settings.horizon_s
    high = max(min(reach, FASTEST_MPS, vehicle.maximum_speed_mps), low)
    speeds = np.unique(np.append(np.linspace(low, high, settings.values), state.longitudinal[1]))
    offsets = np.linspace(-settings.lateral_m, settings.lateral_m, settings.values)
    offsets = np.unique(np.append(offsets, state.lateral[0]))
    t1, v1, d1 = (axis.ravel() for axis in np.meshgrid(durations, speeds, offsets, indexing="ij"))
    if going_on is not None and going_on.duration_s >= _SHORTEST_REST_S:
        rest = going_on.duration_s, going_on.speed_mps, going_on.offset_m
        t1, v1, d1 = (np.append(axis, value) for axis, value in zip((t1, v1, d1), rest, strict=True))
    matrix = np.zeros((len(t1), 13))
    matrix[:, 1], matrix[:, FINAL_SPEED], matrix[:, FINAL_OFFSET] = t1, v1, d1
    matrix[:, 2:5], matrix[:, 7:10] = state.longitudinal, state.lateral
    return matrix


@dataclass
class PlanningStep:
    """One planning step in progress: the inputs of the core's functions, and the counters.

    ``reach_m``: the distance that the fastest candidate covers within the horizon; ``core_s``: the core's computation
    time.
    ``obstacle_places``: the array that the core's cost term reads; it must exist while candidates are generated.
    """

    observation: Observation
    frame: FrenetFrame
    settings: SamplingSettings
    low_speed: bool
    desired_speed_mps: float
    step_s: float
    reach_m: float
    rejected: Counter[str] = field(default_factory=Counter)
    candidates: int = 0
    fastest_mps: float = 0.0
    core_s: float = 0.0
    obstacle_places: Points | None = None

    @property
    def ego(self) -> EgoState:
        """The observed ego."""
        return self.observation.ego


def add_feasibility(handler: "frenetix.TrajectoryHandler", vehicle: VehicleParameters) -> None:
    """Add the four constraints that the core actually checks; they stay the same during a run.

    The core's accelerations are half of the true accelerations (see the module), so it gets half of the limit.
    """
    steering, wheelbase = vehicle.maximum_steering_rad, vehicle.wheelbase_m
    handler.add_feasability_function(feasibility.CheckYawRateConstraint(steering, wheelbase, False))
    handler.add_feasability_function(
        feasibility.CheckAccelerationConstraint(
            vehicle.switching_speed_mps, vehicle.maximum_acceleration_mps2 / SECOND_DERIVATIVE_FACTOR, False
        )
    )
    handler.add_feasability_function(feasibility.CheckCurvatureConstraint(steering, wheelbase, False))
    handler.add_feasability_function(
        feasibility.CheckCurvatureRateConstraint(wheelbase, vehicle.maximum_steering_rate_radps, False)
    )


def add_step_functions(handler: "frenetix.TrajectoryHandler", weights: dict[str, float], step: PlanningStep) -> None:
    """Replace the coordinates and cheap cost terms of the previous step by those of this step.

    The handler keeps functions until one with the same name replaces them. A term that is left out this time (no
    obstacle in sight) would otherwise keep old positions.
    """
    handler.clear_cost_functions()
    orientation = step.frame.heading_inwards(step.ego.heading_rad)
    handler.add_function(
        functions.FillCoordinates(step.low_speed, orientation, step.frame.system, step.settings.horizon_s)
    )
    for name, make in _CONSTANT.items():
        if weights[name] > 0:
            handler.add_cost_function(make(name, weights[name]))
    if weights["velocity_offset"] > 0:
        handler.add_cost_function(
            costs.CalculateVelocityOffsetCost(
                "velocity_offset",
                weights["velocity_offset"],
                step.desired_speed_mps,
                step.step_s,
                step.settings.shortest_s,
                False,  # limit_to_t_min is broken in the core
                2,
            )
        )
    # the core raises TypeError for an empty (0, 2) array of obstacles
    if weights["distance_to_obstacles"] > 0 and step.observation.obstacles:
        present = step.frame.inwards(np.array([obstacle.positions[0] for obstacle in step.observation.obstacles]))
        step.obstacle_places = np.ascontiguousarray(present)
        handler.add_cost_function(
            costs.CalculateDistanceToObstacleCost(
                "distance_to_obstacles", weights["distance_to_obstacles"], step.obstacle_places
            )
        )


_CONSTANT = {
    "acceleration": costs.CalculateAccelerationCost,
    "jerk": costs.CalculateJerkCost,
    "lateral_jerk": costs.CalculateLateralJerkCost,
    "longitudinal_jerk": costs.CalculateLongitudinalJerkCost,
    "orientation_offset": costs.CalculateOrientationOffsetCost,
    "distance_to_reference_path": costs.CalculateDistanceToReferencePathCost,
}


def collision_probability(
    weight: float, step: PlanningStep, vehicle: VehicleParameters
) -> costs.CalculateCollisionProbabilityFast:
    """Return the core's cost term ``prediction``.

    It is not in the cost handler, because it takes longer than all other terms.
    """
    counted = [(obstacle, _last_within_reach(obstacle, step, vehicle)) for obstacle in step.observation.obstacles]
    predictions = {o.obstacle_id: _core_prediction(o, last, step.frame) for o, last in counted if last > 0}
    return costs.CalculateCollisionProbabilityFast(
        "prediction", weight, predictions, vehicle.length_m, vehicle.width_m, vehicle.rear_axle_behind_center_m
    )


def _last_within_reach(obstacle: PredictedObstacle, step: PlanningStep, vehicle: VehicleParameters) -> int:
    """Return the last step ahead at which the core can count an obstacle, or 0 if there is no such step.

    The core counts no obstacle farther than √50 m from the ego's box at the same step. After a share of the horizon, a
    candidate is at most that share of ``reach_m`` away, plus its lateral offset.
    """
    away = np.linalg.norm(obstacle.positions - step.ego.position, axis=1)
    times = np.arange(len(away)) * step.step_s
    within = np.flatnonzero(away <= times / step.settings.horizon_s * step.reach_m + BEYOND_REACH_M + vehicle.length_m)
    return int(within[-1]) if len(within) else 0


def _core_prediction(obstacle: PredictedObstacle, last: int, frame: FrenetFrame) -> "frenetix.PredictedObject":
    """Return the obstacle until step ``last``.

    The core compares its state i with entry i − 1, so its list starts one step ahead and ends one entry early.
    """
    turn = np.array(
        [[np.cos(frame.angle_rad), np.sin(frame.angle_rad)], [-np.sin(frame.angle_rad), np.cos(frame.angle_rad)]]
    )
    positions = frame.inwards(obstacle.positions[1 : last + 2])
    given = np.broadcast_to(obstacle.covariance, (len(obstacle.positions), 2, 2))[1 : last + 2]
    planar = turn @ given @ turn.T
    covariances = np.zeros((len(positions), 6, 6))
    covariances[:, :2, :2] = (planar + planar.transpose(0, 2, 1)) / 2
    half = (obstacle.headings_rad[1 : last + 2] - frame.angle_rad) / 2
    places, turns = np.zeros((len(positions), 3)), np.zeros((len(positions), 4))
    places[:, :2], turns[:, 2], turns[:, 3] = positions, np.sin(half), np.cos(half)
    columns = covariances.transpose(0, 2, 1)  # symmetric; the core expects column-major matrices
    poses = [frenetix.PoseWithCovariance(*pose) for pose in zip(places, turns, columns, strict=True)]
    return frenetix.PredictedObject(obstacle.obstacle_id, poses, obstacle.length_m, obstacle.width_m)


@dataclass(frozen=True)
class DrivenPlan:
    """The trajectory chosen at ``first_step``, with its curvilinear states (6, n): s, s', s'', d, d', d''."""

    first_step: int
    trajectory: PlannedTrajectory
    curvilinear: Points
    low_speed: bool
    end: EndState

    def state_for(self, ego: EgoState, low_speed: bool, within_m: float) -> CurvilinearState | None:
        """Return the curvilinear state of this plan, or None if the ego is farther than ``within_m`` from it."""
        index = ego.step - self.first_step
        if not is_on_plan(self.trajectory, index, ego, within_m):
            return None
        column = self.curvilinear[:, index]
        return CurvilinearState(column[:3].copy(), column[3:].copy(), self.low_speed).as_mode(low_speed)

    def rest_for(self, ego: EgoState, step_s: float) -> EndState:
        """Return the rest of this plan at a later step."""
        return replace(self.end, duration_s=round(self.end.duration_s - (ego.step - self.first_step) * step_s, 6))


def copied_trajectory(
    sample: "frenetix.TrajectorySample", frame: FrenetFrame, ego: EgoState, vehicle: VehicleParameters
) -> PlannedTrajectory:
    """Return a sample as states of the centre in world coordinates; headings continue the ego's."""
    inner = sample.cartesian
    speed = np.array(inner.v, dtype=float)
    heading = np.array(inner.theta, dtype=float) + frame.angle_rad
    heading += wrap_angle(float(heading[0]) - ego.heading_rad) - (float(heading[0]) - ego.heading_rad)
    rear = frame.outwards(np.stack([np.array(inner.x, dtype=float), np.array(inner.y, dtype=float)], axis=1))
    return PlannedTrajectory(
        positions=centers(rear, heading, vehicle),
        headings_rad=heading,
        speeds_mps=speed,
        accelerations_mps2=_changes(speed, sample.dt),
    )


def _changes(values: Values, step_s: float) -> Values:
    """Return the result of ``np.gradient`` in a fifth of its time: central differences, one-sided at both ends."""
    changes = np.empty_like(values)
    changes[1:-1] = (values[2:] - values[:-2]) / (2.0 * step_s)
    changes[0], changes[-1] = (values[1] - values[0]) / step_s, (values[-1] - values[-2]) / step_s
    return changes


def copied_curvilinear(sample: "frenetix.TrajectorySample") -> Points:
    """Return the curvilinear states of a sample, shape (6, n), with true second derivatives."""
    inner = sample.curvilinear
    rows = (inner.s, inner.s_dot, inner.s_ddot, inner.d, inner.d_dot, inner.d_ddot)
    states = np.array([np.array(row, dtype=float) for row in rows])
    states[[2, 5]] *= SECOND_DERIVATIVE_FACTOR
    return states
