"""The C++ core of FISS (fiss-planner 1.0.0): its inputs, its outputs, and its pitfalls.

The core plans the centre of the vehicle in the Frenet frame of a reference line. Lateral motions are quintic and
longitudinal motions quartic polynomials of time. A candidate ends after 0.6 to 1 times the horizon (the core's own
default is 3 to 5 s), at one of several speeds between 0 and the desired speed, and at one of several offsets within a
lane. Its coordinates are world coordinates. Lengths in m, headings in rad.

Pitfalls (tested by ``tests/engine/planners/test_fiss_traps.py``):

- The core's heading is the direction of the centre's motion. For a real vehicle the rear axle moves in the direction of
  the heading, and the centre swings out. Our headings are therefore those of a rear axle that is dragged behind the
  centre (a tractrix), the speeds are the rear axle's, and the centre starts in the direction in which a turning vehicle
  moves.
- It normalises headings to ±π at every state, so we do not use them.
- It has no limit on the steering rate, and checks neither friction nor steering at low speed. We check again what the
  vehicle can drive (``driving/drivability.py``).
- Its lateral motion is a polynomial of time only, so a standing vehicle would slide sideways to the lane's centre.
  Below ``LOW_SPEED_MPS`` the vehicle keeps its offset.
- Without a hint it finds the nearest point of the whole line, so on a path that crosses itself it could put the ego on
  the wrong lap. Every projection of the ego starts at its last station.
- It accepts an ego that heads against the path, and gives it a negative speed along the path. We refuse to plan for it.
- It accepts a desired speed below 0; its grid of speeds then has one speed, 0.
- Its refinement (``fiss_plus``) takes the middle of a band as the lane's centre, whatever the band's own centre. Bands
  are therefore symmetrical about their centres.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import fiss_planner
import numpy as np

from ....schemas.planning import PlannerSettings
from ...geometry import Points, Values, wrap_angle
from ...vehicles import ARC_LENGTH_MPS, VehicleParameters
from ..driving.following import FOLLOWED_WITHIN_M, is_on_plan
from ..interface import EgoState, PlannedTrajectory, PredictedObstacle
from ..reference_path import ReferencePath

SEARCHES = ("fop", "fop_plus", "fiss", "fiss_plus")
"""The core's searches, indexed by the setting ``search``."""
LOW_SPEED_MPS = 2.0
"""The same as in Frenetix (chosen): below it a vehicle cannot drive lateral motions that depend on time."""
_SHORTEST_SHARE, _DURATIONS = 0.6, 5
"""The core's default: five durations from 3 s to 5 s."""
_HARDEST_MPS2, BRISKEST_MPS2 = 8.0, 4.0
"""Limits in the core authors' plans: 8 m/s² for braking and lateral acceleration (0.8 g), and 4 m/s² for acceleration;
the vehicle's own limits may be lower.
"""
_BEHIND_M, _BEYOND_REACH_M = 80.0, 60.0
"""The core considers obstacles from 80 m behind the ego to 60 m beyond its reach."""
_LINE_SPACING_M = 2.0
"""The core's own spacing, at which it looks for the curve that limits the speed."""
REJECTIONS = {
    "invalid": "invalid",
    "speed": "speed",
    "accel": "acceleration",
    "curvature": "curvature",
    "lat_accel": "lateral_acceleration",
    "off_road": "road_edge",
    "collision": "collision",
    "safety_distance": "safety_distance",
}
"""Maps the core's reasons for rejecting a candidate to the names in plans."""
_COST_FIELDS = {
    "time": "w_time",
    "speed": "w_speed",
    "acceleration": "w_accel",
    "jerk": "w_jerk",
    "lateral": "w_lateral",
    "lane_change": "w_lane_change",
    "history": "w_heuristic",
    "headway": "w_headway",
    "time_to_collision": "w_ttc",
    "clearance": "w_clearance",
    "desired_gap_m": "desired_gap",
    "desired_headway_s": "desired_time_headway",
    "desired_time_to_collision_s": "desired_ttc",
    "desired_clearance_m": "desired_clearance",
    "follow_time_s": "follow_time",
}
_SAFETY_FIELDS = {
    "least_gap_m": "min_gap",
    "least_headway_s": "min_time_headway",
    "least_time_to_collision_s": "min_ttc",
    "reaction_time_s": "reaction_time",
    "crossing_gap_s": "crossing_time_gap",
}
"""Maps our weights to the core's names."""
_HARD_DISTANCES = ("least_gap_m", "least_headway_s", "least_time_to_collision_s", "crossing_gap_s")
Care = Literal["full", "margins", "bodies"]
"""How far a candidate must keep from others: the hard distances, the core's margins (0.5 m in front and behind, 0.3 m
at the sides), or only no contact. ``margins`` drops the hard distances, and ``bodies`` the margins as well.
"""


def vehicle_limits(vehicle: VehicleParameters) -> "fiss_planner.VehicleParams":
    """Return a vehicle's limits in the core's format."""
    limits = fiss_planner.VehicleParams()
    limits.length, limits.width = vehicle.length_m, vehicle.width_m
    limits.wheelbase, limits.rear_axle_to_center = vehicle.wheelbase_m, vehicle.rear_axle_behind_center_m
    limits.max_speed = vehicle.maximum_speed_mps
    limits.max_accel = min(BRISKEST_MPS2, vehicle.maximum_acceleration_mps2)
    limits.max_decel = limits.max_lat_accel = min(_HARDEST_MPS2, vehicle.maximum_acceleration_mps2)
    limits.max_steer, limits.max_steer_rate = vehicle.maximum_steering_rad, vehicle.maximum_steering_rate_radps
    return limits


def core_configuration(
    weights: Mapping[str, float],
    settings: PlannerSettings,
    step_s: float,
    *,
    offsets: int | None = None,
    care: "Care" = "full",
    every_candidate: bool = False,
) -> "fiss_planner.PlannerConfig":
    """Return the core's configuration.

    Args:
        weights: The planner's weights, by the names that this program uses.
        settings: The settings for the search, the horizon and the number of samples.
        step_s: The time step of the plans.
        offsets: The number of lateral offsets per lane, to override the settings.
        care: The distances that a candidate must keep from other road users.
        every_candidate: True to generate, check and return every candidate, regardless of the search.
    """
    configuration = fiss_planner.PlannerConfig()
    search = "fop" if every_candidate else SEARCHES[settings.search]
    configuration.type = fiss_planner.planner_type_from_string(search)
    sampling = configuration.sampling
    sampling.dt, sampling.max_t = step_s, settings.horizon_s
    sampling.min_t, sampling.num_t = _SHORTEST_SHARE * settings.horizon_s, _DURATIONS
    sampling.num_speed = 2 ** (settings.sampling_level + 1) + 1
    sampling.num_width = sampling.num_speed if offsets is None else offsets
    for name, field in _COST_FIELDS.items():
        setattr(configuration.cost, field, weights[name])
    for name, field in _SAFETY_FIELDS.items():
        setattr(configuration.safety, field, weights[name])
    configuration.safety.enabled = care == "full" and any(weights[name] > 0 for name in _HARD_DISTANCES)
    if care == "bodies":
        configuration.collision.margin_lon = configuration.collision.margin_lat = 0.0
    configuration.keep_candidates = every_candidate
    return configuration


class PathLine:
    """The reference path as the core's line; ``hardest_mps2`` is the largest lateral acceleration in its curves."""

    def __init__(self, reference: ReferencePath, hardest_mps2: float) -> None:
        path = reference.points
        self.line = fiss_planner.ReferenceLine(path[:, 0].tolist(), path[:, 1].tolist())
        samples = self.line.sample(_LINE_SPACING_M)
        self._stations: Values = samples[:, 0]
        self._curve_mps: Values = np.sqrt(hardest_mps2 / np.maximum(np.abs(samples[:, 4]), 1e-4))
        self._reference = reference

    def first_station(self, point: Points) -> float:
        """Return the ego's station in m at its initial point (2,)."""
        return self._reference.follower().place(point)[0]

    def curve_speed_mps(self, station_m: float, ahead_m: float) -> float:
        """Return the highest speed at which no curve within a distance ahead needs more lateral acceleration."""
        first, last = np.searchsorted(self._stations, (station_m, station_m + ahead_m))
        return float(self._curve_mps[first : last + 1].min(initial=math.inf))

    def start(self, ego: EgoState, vehicle: VehicleParameters, near_m: float) -> "fiss_planner.FrenetState | None":
        """Return the ego's centre in the line's frame, or None if it has no valid position.

        This is the case if the ego heads against the line or is beyond the centre of a curve.

        ``near_m``: the approximate station of the ego.
        """
        speed = max(ego.speed_mps, 0.0)
        sideways = vehicle.rear_axle_behind_center_m * ego.yaw_rate_radps
        turned = math.atan2(sideways, max(speed, ARC_LENGTH_MPS)) if speed > ARC_LENGTH_MPS else 0.0
        center_mps = math.hypot(speed, sideways) if speed > ARC_LENGTH_MPS else speed
        steepest = math.tan(vehicle.maximum_steering_rad) / vehicle.wheelbase_m
        curvature = min(max(ego.yaw_rate_radps / max(center_mps, ARC_LENGTH_MPS), -steepest), steepest)
        x, y = ego.position.tolist()
        state = fiss_planner.EgoState(
            x, y, ego.heading_rad + turned, center_mps, ego.acceleration_mps2, curvature if speed > 0 else 0.0
        )
        start = self.line.to_frenet(state, near_m)
        along = self.line.at(start.s)
        values = (start.s, start.s_d, start.s_dd, start.d, start.d_d, start.d_dd)
        if abs(wrap_angle(ego.heading_rad - along.yaw)) > math.pi / 2 or along.kappa * start.d >= 1.0:
            return None
        return start if all(math.isfinite(value) for value in values) else None


def core_obstacles(
    obstacles: Sequence[PredictedObstacle], ego: EgoState, reach_m: float, step_s: float, until_s: float = math.inf
) -> list["fiss_planner.Obstacle"]:
    """Return the obstacles that can matter to an ego that covers at most ``reach_m``.

    ``until_s``: the duration for which their predictions count.
    """
    made, farthest_m = [], max(_BEHIND_M, reach_m + _BEYOND_REACH_M)
    for obstacle in obstacles:
        count = min(len(obstacle.positions), 1 + math.floor(until_s / step_s + 1e-9)) if until_s < math.inf else None
        positions = obstacle.positions[:count]
        if not len(positions) or np.abs(positions - ego.position).max(axis=1).min() > farthest_m:
            continue
        times = [index * step_s for index in range(len(positions))]
        x, y = positions.T.tolist()
        headings = obstacle.headings_rad[:count].tolist()
        stands = len(positions) > 1 and bool((positions == positions[0]).all())
        made.append(
            fiss_planner.Obstacle.from_arrays(
                obstacle.obstacle_id, obstacle.length_m, obstacle.width_m, times, x, y, headings, stands
            )
        )
    return made


def dragged_headings(center: Points, first_rad: float, drag_m: float) -> Values:
    """Return the unwrapped headings of a rod of length ``drag_m`` with its front end on the points (n, 2).

    While the front end moves straight by s, the tangent of half the angle between its direction and the rod falls by
    exp(−s / drag), which is the tractrix of a straight line.
    """
    steps = np.diff(center, axis=0)
    directions, lengths = np.arctan2(steps[:, 1], steps[:, 0]), np.hypot(steps[:, 0], steps[:, 1])
    kept, heading = np.exp(-lengths / drag_m).tolist(), first_rad
    headings = [heading]
    for direction, share in zip(directions.tolist(), kept, strict=True):
        off = math.remainder(direction - heading, math.tau)
        heading += off - 2.0 * math.atan(math.tan(off / 2.0) * share)
        headings.append(heading)
    return np.array(headings)


def driven_by_rear_axle(
    center: Points, directions_rad: Values, center_mps: Values, ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> PlannedTrajectory:
    """Return the motion of a vehicle with its centre on points (n, 2), moving in directions (n,) at speeds (n,).

    It starts with the ego's heading; the rear axle is dragged behind the centre, as in the kinematic single-track
    model.
    """
    heading = dragged_headings(center, ego.heading_rad, vehicle.rear_axle_behind_center_m)
    speed = np.maximum(center_mps * np.cos(directions_rad - heading), 0.0)
    speed[0] = max(ego.speed_mps, 0.0)
    return PlannedTrajectory(center, heading, speed, np.gradient(speed, step_s))


def copied_trajectory(
    candidate: "fiss_planner.Trajectory", ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> PlannedTrajectory:
    """Return a candidate as feasible states of the vehicle's centre."""
    center = np.stack([candidate.x, candidate.y], axis=1)
    center[0] = ego.position
    return driven_by_rear_axle(center, candidate.yaw, candidate.v, ego, vehicle, step_s)


def costs_of(candidate: "fiss_planner.Trajectory") -> dict[str, float]:
    """Return the weighted costs of a candidate by term; ``proximity`` is headway, time to collision and clearance."""
    terms = candidate.cost
    return {
        "acceleration": terms.accel,
        "jerk": terms.jerk,
        "lane_change": terms.lane_change,
        "lateral": terms.lateral,
        "proximity": terms.proximity,
        "speed": terms.speed,
        "time": terms.time,
    }


@dataclass(frozen=True)
class DrivenPlan:
    """The candidate that was chosen at ``first_step``, and its trajectory."""

    first_step: int
    candidate: "fiss_planner.Trajectory"
    trajectory: PlannedTrajectory

    def index_of(self, ego: EgoState) -> int | None:
        """Return the ego's index on the plan, or None if the ego does not follow the plan."""
        index = ego.step - self.first_step
        return index if is_on_plan(self.trajectory, index, ego, FOLLOWED_WITHIN_M) else None

    def rest(self, index: int) -> PlannedTrajectory:
        """Return the part of the planned trajectory from the given state on."""
        return self.trajectory.since(index)


def braking_trajectory(
    line: "fiss_planner.ReferenceLine",
    start: "fiss_planner.FrenetState",
    deceleration_mps2: float,
    ego: EgoState,
    vehicle: VehicleParameters,
    step_s: float,
    horizon_s: float,
) -> PlannedTrajectory:
    """Return even braking to a standstill along the path, at the offset that the ego drifts to while braking.

    The drift fades with the speed: its share of the speed along the path is constant.
    """
    times = np.arange(round(horizon_s / step_s) + 1) * step_s
    speed = np.maximum(start.s_d - deceleration_mps2 * times, 0.0)
    stopped = np.minimum(times, start.s_d / deceleration_mps2)
    distance = start.s_d * stopped - deceleration_mps2 * stopped**2 / 2
    slope = start.d_d / max(start.s_d, ARC_LENGTH_MPS)
    fade_m = max(distance[-1], ARC_LENGTH_MPS)
    share = np.minimum(distance / fade_m, 1.0)
    offset = start.d + slope * fade_m * (share - share**2 / 2)
    turned = slope * (1.0 - share)
    states = [
        line.to_cartesian(fiss_planner.FrenetState(s=start.s + s, s_d=v, d=d, d_d=v * turn))
        for s, v, d, turn in zip(distance.tolist(), speed.tolist(), offset.tolist(), turned.tolist(), strict=True)
    ]
    center = np.array([[state.x, state.y] for state in states])
    center[0] = ego.position
    directions, center_mps = np.array([state.yaw for state in states]), np.array([state.v for state in states])
    return driven_by_rear_axle(center, directions, center_mps, ego, vehicle, step_s)
