"""The C++ core of FISS (fiss-planner 1.0.0): what goes in, what comes out, and its traps.

The core plans the centre of the vehicle in the Frenet frame of a reference line. Lateral motions are quintic,
longitudinal ones quartic polynomials of time; a candidate ends after 0.6 to 1 times the horizon (the core's own default
is 3 to 5 s), at one of some speeds between standing still and the desired speed, and at one of some offsets within a
lane. Its coordinates are those of the world. Lengths in m, headings in rad.

Traps (``tests/engine/planners/test_fiss_traps.py`` holds them):

- It heads its vehicle where the centre moves. Real vehicles do not: the rear axle moves where they head, and the
  centre swings out. The headings of a plan are those of a rear axle that is dragged after the centre (a tractrix), the
  speeds those of the rear axle, and the centre begins in the direction in which a vehicle that turns moves.
- It normalises headings to ±π at every state. They are not taken from it.
- It knows no limit of the steering rate, and neither friction nor steering at low speed. What a vehicle can drive is
  checked again (``driving/drivability.py``).
- Its lateral motion is a polynomial only of time: a vehicle that stands would slide sideways to its lane's centre.
  Below ``LOW_SPEED_MPS`` it keeps its offset.
- It finds the nearest point of the whole line if it gets no hint, so a path that crosses itself would put the ego on
  another lap. Every projection of the ego begins at its last station.
- It places the ego as far backwards as forwards: a vehicle that heads against the path gets a negative speed along it.
- A desired speed below 0 is taken, and its grid of speeds then has one speed, 0.
- Its refinement (``fiss_plus``) takes the middle of a band for the lane's centre, whatever the band says. Bands are
  therefore symmetrical about their centres.
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
"""The core's searches by the number that the setting ``search`` has."""
LOW_SPEED_MPS = 2.0
"""Chosen: the same as in Frenetix; below it a vehicle cannot drive lateral motions by time."""
_SHORTEST_SHARE, _DURATIONS = 0.6, 5
"""The core's default: durations from 3 s to 5 s, five of them."""
_HARDEST_MPS2, BRISKEST_MPS2 = 8.0, 4.0
"""Limits that the core's authors plan with: 8 m/s² of braking and across (0.8 g), 4 m/s² of accelerating; but no more
than the vehicle's own."""
_BEHIND_M, _BESIDE_M = 80.0, 60.0
"""The core looks at obstacles from 80 m behind the ego to 60 m beyond what it can reach."""
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
"""The core's reasons to reject a candidate, and the names that plans have for them."""
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
"""Our weights by the core's names."""
_HARD_DISTANCES = ("least_gap_m", "least_headway_s", "least_time_to_collision_s", "crossing_gap_s")
Care = Literal["full", "margins", "bodies"]
"""How far a candidate must keep from others: the hard distances, the core's margins (0.5 m before and behind, 0.3 m at
the sides), or only without contact. ``margins`` drops the hard distances, ``bodies`` the margins too."""


def vehicle_limits(vehicle: VehicleParameters) -> "fiss_planner.VehicleParams":
    """Return a vehicle as the core knows it."""
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
        weights: those of the planner, by our names.
        settings: for the search, the horizon and the number of samples.
        step_s: time step of the plans.
        offsets: another number of lateral offsets a lane.
        care: which distances to others a candidate must keep.
        every_candidate: make, check and return every candidate, whatever the search of the settings.
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
    """The reference path as the core's line; ``hardest_mps2``: the lateral acceleration that its curves may need."""

    def __init__(self, reference: ReferencePath, hardest_mps2: float) -> None:
        path = reference.points
        self.line = fiss_planner.ReferenceLine(path[:, 0].tolist(), path[:, 1].tolist())
        samples = self.line.sample(_LINE_SPACING_M)
        self._stations: Values = samples[:, 0]
        self._curve_mps: Values = np.sqrt(hardest_mps2 / np.maximum(np.abs(samples[:, 4]), 1e-4))
        self._reference = reference

    def first_station(self, point: Points) -> float:
        """Return the station in m of the ego at a point (2,) at which it begins."""
        return self._reference.follower().place(point)[0]

    def curve_speed_mps(self, station_m: float, ahead_m: float) -> float:
        """Return the speed at which no curve of the next metres needs more than the lateral acceleration."""
        first, last = np.searchsorted(self._stations, (station_m, station_m + ahead_m))
        return float(self._curve_mps[first : last + 1].min(initial=math.inf))

    def start(self, ego: EgoState, vehicle: VehicleParameters, near_m: float) -> "fiss_planner.FrenetState | None":
        """Return the ego's centre in the line's frame, or None if it heads against it or is past a curve's centre.

        ``near_m``: about where on the path it is.
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
    """Return the obstacles that can matter to an ego that gets at most ``reach_m`` far.

    ``until_s``: how long their predictions count.
    """
    made, farthest_m = [], max(_BEHIND_M, reach_m + _BESIDE_M)
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
    """Return the unwrapped headings of a rod of length ``drag_m`` whose front end follows the points (n, 2).

    While the front end goes a way s straight on, the tangent of half the angle between way and rod falls by
    exp(−s / drag), which is the tractrix of a straight line.
    """
    ways = np.diff(center, axis=0)
    directions, lengths = np.arctan2(ways[:, 1], ways[:, 0]), np.hypot(ways[:, 0], ways[:, 1])
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

    It begins in the ego's heading; the rear axle is dragged after the centre, as in the kinematic single-track model.
    """
    heading = dragged_headings(center, ego.heading_rad, vehicle.rear_axle_behind_center_m)
    speed = np.maximum(center_mps * np.cos(directions_rad - heading), 0.0)
    speed[0] = max(ego.speed_mps, 0.0)
    return PlannedTrajectory(center, heading, speed, np.gradient(speed, step_s))


def copied_trajectory(
    candidate: "fiss_planner.Trajectory", ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> PlannedTrajectory:
    """Return a candidate as states of the centre that a vehicle can be in."""
    center = np.stack([candidate.x, candidate.y], axis=1)
    center[0] = ego.position
    return driven_by_rear_axle(center, candidate.yaw, candidate.v, ego, vehicle, step_s)


def costs_of(candidate: "fiss_planner.Trajectory") -> dict[str, float]:
    """Return the weighted terms of a candidate; ``proximity`` is headway, time to collision and clearance together."""
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
    """The candidate that was chosen at ``first_step``, and the trajectory that was made of it."""

    first_step: int
    candidate: "fiss_planner.Trajectory"
    trajectory: PlannedTrajectory

    def index_of(self, ego: EgoState) -> int | None:
        """Return where on the plan the ego is, if it followed it."""
        index = ego.step - self.first_step
        return index if is_on_plan(self.trajectory, index, ego, FOLLOWED_WITHIN_M) else None

    def rest(self, index: int) -> PlannedTrajectory:
        """Return what is left of the plan."""
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
    """Brake evenly to a stand along the path, at the offset that the ego drifts to while it brakes.

    The drift fades as the speed does: its share of the speed along the path is the same at every moment.
    """
    times = np.arange(round(horizon_s / step_s) + 1) * step_s
    speed = np.maximum(start.s_d - deceleration_mps2 * times, 0.0)
    stopped = np.minimum(times, start.s_d / deceleration_mps2)
    way = start.s_d * stopped - deceleration_mps2 * stopped**2 / 2
    slope = start.d_d / max(start.s_d, ARC_LENGTH_MPS)
    fade_m = max(way[-1], ARC_LENGTH_MPS)
    share = np.minimum(way / fade_m, 1.0)
    offset = start.d + slope * fade_m * (share - share**2 / 2)
    turned = slope * (1.0 - share)
    states = [
        line.to_cartesian(fiss_planner.FrenetState(s=start.s + s, s_d=v, d=d, d_d=v * turn))
        for s, v, d, turn in zip(way.tolist(), speed.tolist(), offset.tolist(), turned.tolist(), strict=True)
    ]
    center = np.array([[state.x, state.y] for state in states])
    center[0] = ego.position
    directions, center_mps = np.array([state.yaw for state in states]), np.array([state.v for state in states])
    return driven_by_rear_axle(center, directions, center_mps, ego, vehicle, step_s)
