"""Predicts whether CommonRoad's benchmark accepts a run that reached its goal: ``valid_solution`` in closed form.

``valid_solution`` of commonroad-drivability-checker takes 0.1 to 0.9 s per trajectory, most of it to check that each
step is feasible. It searches for the acceleration and steering rate that lead nearest to the next state, and checks
that they lead within 2 cm and 0.03 rad of that state. In a step of 0.1 s the motion is so nearly linear in these two
inputs that the search has a closed form, which this module computes for all steps at once. Only steps near a tolerance
or a vehicle limit go to the checker's own search; a drivable motion has very few of them.

The other criteria: a state meets the goal (CommonRoad's ``GoalRegion``), the body touches no road user, and no part of
it is ever outside the lanelets, neither in a gap between them nor beyond the end of the map. The start is the planning
problem's by construction. ``python -m benchmarks.loop --only acceptance_agree`` measures the agreement with
``valid_solution``.
"""

import copy
import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ....schemas.runs import Refusal, RunSteps
from ...geometry import Points, Values, wrap_angles
from ...vehicles import VehicleParameters
from .solution import mean_steering_angles

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
    from shapely.geometry.base import BaseGeometry

_POSITION_M, _HEADING_RAD = 0.02, 0.03
"""Tolerances per step in ``position_orientation_feasibility_criteria``: along x, along y, and for the heading."""
_SPEED_MPS = 0.03
"""Above this speed error and the position tolerance, the checker's search weighs errors twice."""
_CLEARLY = 0.5
"""Errors below this share of the tolerances, or above its reciprocal, are clear; the search decides the rest."""
_OUTSIDE_M2 = 1e-6
"""Smaller areas are rounding errors: the outlines of touching lanelets differ in the last digits. For 35,779 states of
driven motions, the part outside was exactly 0 or more than 1e-3 m², and the checker agreed on all of them.
"""
_NEAR_LIMIT = 0.999
"""Share of the largest acceleration above which the search decides, since it stops at the limit."""


@dataclass(frozen=True)
class DrivenStates:
    """A driven motion of the centre, by state: positions (n, 2), headings, speeds and steering angles (n,)."""

    positions: Points
    headings_rad: Values
    speeds_mps: Values
    steering_rad: Values
    first_step: int

    @classmethod
    def of(cls, steps: RunSteps, vehicle: VehicleParameters, step_s: float) -> "DrivenStates":
        """Return the motion that the solution file of a run contains."""
        positions = np.column_stack([steps.x_m, steps.y_m])
        steering = mean_steering_angles(steps, step_s, vehicle.wheelbase_m, vehicle.maximum_steering_rad)
        return cls(positions, np.array(steps.heading_rad), np.array(steps.speed_mps), steering, steps.first_step)


@dataclass(frozen=True)
class Refused:
    """The reason for a refusal, and the index of the first refused state; None if the refusal concerns all states.

    ``after_start``: if the initial state is outside the lanelets, why the motion would be refused even with a start
    inside. The first states do not count there until the whole body is inside, because no planner chose the start.
    """

    code: Refusal
    index: int | None = None
    after_start: "Refused | None" = None


def refusal(
    driven: DrivenStates, goal: "GoalRegion", network: "LaneletNetwork", vehicle: VehicleParameters, step_s: float
) -> Refused | None:
    """Return why ``valid_solution`` refuses a motion that hit no road user, or None if it accepts it."""
    if not meets_goal(driven, goal):
        return Refused("goal_not_met")
    outside = states_off_lanelets(driven, network, vehicle)
    counting = [state for number, state in enumerate(outside) if state != number]
    later = Refused("off_lanelets", counting[0]) if counting else _undrivable(driven, vehicle, step_s)
    return Refused("off_lanelets", 0, after_start=later) if outside[:1] == [0] else later


def _undrivable(driven: DrivenStates, vehicle: VehicleParameters, step_s: float) -> Refused | None:
    step = first_undrivable_step(driven, vehicle, step_s)
    return None if step is None else Refused("not_drivable", step)


def meets_goal(driven: DrivenStates, goal: "GoalRegion") -> bool:
    """Return whether any state meets the goal by ``PlanningProblem.goal_reached``, last state first."""
    from commonroad.scenario.state import KSState

    for index in reversed(range(len(driven.speeds_mps))):
        state = KSState(
            time_step=driven.first_step + index,
            position=driven.positions[index],
            velocity=float(driven.speeds_mps[index]),
            orientation=float(driven.headings_rad[index]),
            steering_angle=float(driven.steering_rad[index]),
        )
        if goal.is_reached(state):
            return True
    return False


def states_off_lanelets(driven: DrivenStates, network: "LaneletNetwork", vehicle: VehicleParameters) -> list[int]:
    """Return the states, in order, at which any part of the body is outside the lanelets.

    Neighbouring lanelets count as one area, from their outermost left to their outermost right bound. The checker fills
    everything outside with triangles, including the area beyond the ends of the network. Only lanelets under the motion
    can matter.
    """
    import shapely

    bodies = _bodies(driven, vehicle)
    area = shapely.union_all(_sections_under(network, shapely.box(*shapely.total_bounds(bodies))))
    shapely.prepare(area)
    doubtful = np.flatnonzero(~shapely.covers(area, bodies))
    outside = doubtful[shapely.area(shapely.difference(bodies[doubtful], area)) > _OUTSIDE_M2]
    return [int(state) for state in outside]


def _bodies(driven: DrivenStates, vehicle: VehicleParameters) -> NDArray[np.object_]:
    """Return the ego's rectangle at every state."""
    import shapely

    cos, sin = np.cos(driven.headings_rad), np.sin(driven.headings_rad)
    along = np.stack([cos, sin], axis=1) * (vehicle.length_m / 2)
    across = np.stack([-sin, cos], axis=1) * (vehicle.width_m / 2)
    corners = [along + across, across - along, -along - across, along - across]
    rings = driven.positions[:, None, :] + np.stack(corners, axis=1)
    return np.asarray(shapely.polygons(rings))


def _sections_under(network: "LaneletNetwork", near: "BaseGeometry") -> list["BaseGeometry"]:
    """Return the lanelets that intersect an area, each merged with its neighbours into one polygon."""
    import shapely

    found, done = [], set[int]()
    for lanelet in network.lanelets:
        if lanelet.lanelet_id in done or not lanelet.polygon.shapely_object.intersects(near):
            continue
        members, left, right = _section(network, lanelet)
        done |= members
        found.append(shapely.make_valid(shapely.Polygon(np.concatenate([left, right[::-1]]))))
        if len(members) > 1:  # lanelets of a section do not always start and end on one line
            found += [shapely.make_valid(network.find_lanelet_by_id(key).polygon.shapely_object) for key in members]
    return found


def _section(network: "LaneletNetwork", lanelet: "Lanelet") -> tuple[set[int], Points, Points]:
    """Return the ids of a lanelet and its neighbours, and the leftmost and rightmost bounds among them."""
    members = {lanelet.lanelet_id}
    bounds = []
    for to_left in (True, False):
        here, forwards = lanelet, True
        while True:
            on_left = to_left == forwards
            neighbour = here.adj_left if on_left else here.adj_right
            if neighbour is None or neighbour in members:
                break
            same = here.adj_left_same_direction if on_left else here.adj_right_same_direction
            following = network.find_lanelet_by_id(neighbour)
            if following is None:
                break
            here, forwards = following, forwards == bool(same)
            members.add(here.lanelet_id)
        vertices = np.asarray(here.left_vertices if to_left == forwards else here.right_vertices)
        bounds.append(vertices if forwards else vertices[::-1])
    return members, bounds[0], bounds[1]


def first_undrivable_step(driven: DrivenStates, vehicle: VehicleParameters, step_s: float) -> int | None:
    """Return the first step that the kinematic single-track model cannot drive within the tolerances, or None."""
    steps = _Steps.of(driven, vehicle)
    clear, good = steps.judged(vehicle, step_s)
    for index in np.flatnonzero(~(clear & good)):
        if clear[index] or not _can_be_searched(driven, int(index), vehicle, step_s):
            return int(index)
    return None


@dataclass(frozen=True)
class _Steps:
    """All steps of a motion: state and next state of the rear axle, (n − 1,) each."""

    x_m: Values
    y_m: Values
    heading_rad: Values
    speed_mps: Values
    steering_rad: Values
    next_x_m: Values
    next_y_m: Values
    next_heading_rad: Values
    next_speed_mps: Values

    @classmethod
    def of(cls, driven: DrivenStates, vehicle: VehicleParameters) -> "_Steps":
        """Return the steps of a motion of the centre."""
        heading, back = driven.headings_rad, vehicle.rear_axle_behind_center_m
        x = driven.positions[:, 0] - back * np.cos(heading)
        y = driven.positions[:, 1] - back * np.sin(heading)
        speed = driven.speeds_mps
        return cls(
            x[:-1], y[:-1], heading[:-1], speed[:-1], driven.steering_rad[:-1], x[1:], y[1:], heading[1:], speed[1:]
        )

    def judged(self, vehicle: VehicleParameters, step_s: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return two masks of the steps: those with a clear verdict, and those that are drivable.

        The errors in x, y, speed and heading are nearly linear in acceleration and steering rate. Gauss-Newton
        iterations from the mean acceleration, within the limits, therefore replace the search.
        """
        largest, rate_limit = vehicle.maximum_acceleration_mps2, vehicle.maximum_steering_rate_radps
        lateral = self.speed_mps**2 * np.tan(self.steering_rad) / vehicle.wheelbase_m
        slides = np.abs(lateral) > largest
        room = np.sqrt(np.maximum(largest**2 - lateral**2, 0.0))
        powered = largest * vehicle.switching_speed_mps / np.maximum(self.speed_mps, vehicle.switching_speed_mps)
        lowest, highest = -room, np.minimum(room, powered)
        acceleration = np.clip((self.next_speed_mps - self.speed_mps) / step_s, lowest, highest)
        rate = np.zeros_like(acceleration)
        for _ in range(3):
            errors = self._errors(acceleration, rate, vehicle, step_s)
            gain_a, gain_r = self._gains(rate, vehicle, step_s)
            aa, ar, rr = (gain_a * gain_a).sum(axis=0), (gain_a * gain_r).sum(axis=0), (gain_r * gain_r).sum(axis=0)
            wanted_a = (gain_a * errors).sum(axis=0) + aa * acceleration + ar * rate
            wanted_r = (gain_r * errors).sum(axis=0) + ar * acceleration + rr * rate
            rr = np.maximum(rr, 1e-12)
            determinant = np.maximum(aa * rr - ar**2, 1e-18)
            rate = np.clip((aa * wanted_r - ar * wanted_a) / determinant, -rate_limit, rate_limit)
            acceleration = np.clip((wanted_a - ar * rate) / aa, lowest, highest)
            rate = np.clip((wanted_r - ar * acceleration) / rr, -rate_limit, rate_limit)
        off_x, off_y, off_speed, off_heading = np.abs(self._errors(acceleration, rate, vehicle, step_s))
        tolerances = np.array([_POSITION_M, _POSITION_M, _SPEED_MPS, _HEADING_RAD])[:, None]
        shares = np.stack([off_x, off_y, off_speed, off_heading]) / tolerances
        good = (shares < _CLEARLY).all(axis=0) & ~slides
        hardest = np.hypot(acceleration, lateral) > _NEAR_LIMIT * largest
        bad = slides | (shares[[0, 1, 3]].max(axis=0) > 1.0 / _CLEARLY)
        return (good & ~hardest) | bad, good

    def _errors(self, acceleration: Values, rate: Values, vehicle: VehicleParameters, step_s: float) -> Points:
        """Return the next state minus the state that the inputs lead to, (4, n): x, y, speed, heading."""
        wheelbase = vehicle.wheelbase_m
        v, steering = self.speed_mps, self.steering_rad
        shares = np.array([0.0, 0.25, 0.5, 0.75, 1.0])[:, None] * step_s
        speeds = v + acceleration * shares
        limit = vehicle.maximum_steering_rad
        turning = speeds * np.tan(np.clip(steering + rate * shares, -limit, limit)) / wheelbase
        half = (turning[0] + 4 * turning[1] + turning[2]) * (step_s / 12)
        whole = half + (turning[2] + 4 * turning[3] + turning[4]) * (step_s / 12)
        headings = self.heading_rad + np.stack([np.zeros_like(half), half, whole])
        parts = speeds[::2] * np.array([1.0, 4.0, 1.0])[:, None] * (step_s / 6)
        return np.stack(
            [
                self.next_x_m - self.x_m - (parts * np.cos(headings)).sum(axis=0),
                self.next_y_m - self.y_m - (parts * np.sin(headings)).sum(axis=0),
                self.next_speed_mps - speeds[-1],
                wrap_angles(self.next_heading_rad - headings[-1]),
            ]
        )

    def _gains(self, rate: Values, vehicle: VehicleParameters, step_s: float) -> tuple[Points, Points]:
        """Return the derivatives of x, y, speed and heading by acceleration and by steering rate, (4, n) each."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        tangent = np.tan(self.steering_rad + rate * step_s / 2)
        half, curvature = step_s**2 / 2, tangent / vehicle.wheelbase_m
        turn = self.speed_mps * (1 + tangent**2) / vehicle.wheelbase_m * half
        aside = self.speed_mps * turn * step_s / 3
        by_acceleration = np.stack([half * cos, half * sin, np.full_like(cos, step_s), curvature * half])
        return by_acceleration, np.stack([-aside * sin, aside * cos, np.zeros_like(cos), turn])


def _can_be_searched(driven: DrivenStates, index: int, vehicle: VehicleParameters, step_s: float) -> bool:
    """Return True if the checker's own search finds inputs for one step."""
    from commonroad.common.solution import VehicleType
    from commonroad.scenario.state import KSState
    from commonroad_dc.feasibility.feasibility_checker import state_transition_feasibility
    from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics
    from scipy.integrate import ODEintWarning

    model = VehicleDynamics.KS(VehicleType.BMW_320i)
    model.parameters = copy.deepcopy(model.parameters)  # all models of the library share one instance
    model.parameters.a = vehicle.wheelbase_m - vehicle.rear_axle_behind_center_m
    model.parameters.b = vehicle.rear_axle_behind_center_m
    longitudinal, steering = model.parameters.longitudinal, model.parameters.steering
    longitudinal.a_max, longitudinal.v_max = vehicle.maximum_acceleration_mps2, vehicle.maximum_speed_mps
    longitudinal.v_switch = vehicle.switching_speed_mps
    steering.max, steering.min = vehicle.maximum_steering_rad, -vehicle.maximum_steering_rad
    steering.v_max, steering.v_min = vehicle.maximum_steering_rate_radps, -vehicle.maximum_steering_rate_radps
    before, after = (
        KSState(
            time_step=place,
            position=driven.positions[place],
            steering_angle=float(driven.steering_rad[place]),
            velocity=float(driven.speeds_mps[place]),
            orientation=math.remainder(float(driven.headings_rad[place]), math.tau),
        )
        for place in (index, index + 1)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ODEintWarning)  # a failed integration is an answer: the step is refused
        return bool(state_transition_feasibility(before, after, model, step_s)[0])
