"""Computes the ego's desired speed at every time of a run: before, inside and after the goal's time interval.

Each desired speed has a reason, a :data:`SpeedReason`:

- ``goal_mean``: the mean speed that brings the ego to the middle of the goal by the middle of its time;
- ``goal_end``: the mean speed that still brings it there by the end of the goal's time;
- ``goal_interval``: the middle of the goal's speed interval, inside the goal or if the goal has no position;
- ``speed_limit``: the cruising speed of the lane, if the goal does not (or no longer) set a speed;
- ``curve``: the highest speed for the curve ahead, if that is lower than the cruising speed.

For comparisons, :class:`ReferenceDesiredSpeed` keeps the rule of the Frenetix reference loop.
"""

from copy import copy
from typing import TYPE_CHECKING, Literal, Self

import numpy as np

from ...geometry import Values, arc_length, gaussian, headings
from ...network import USUAL_SPEED_MPS, posted_speeds
from ...vehicles import COMFORTABLE_MPS2
from ..goal import Goal
from ..interface import EgoState, PlanningTask
from ..reference_path import ReferencePath

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

SPEED_BAND_MPS = 5.0
_MAXIMUM_SPEED_MPS = 50.0
"""As in the Frenetix reference loop: the desired speed is within this band of the present speed, and at most this."""
SpeedReason = Literal["goal_mean", "goal_end", "goal_interval", "speed_limit", "curve", "present"]
"""The reason for a desired speed; ``present`` (the ego's own speed) occurs only in the reference's rule."""
_USUAL_OF_TYPE_MPS = {"interstate": 130 / 3.6, "highway": 130 / 3.6, "country": 100 / 3.6}
"""Speeds by CommonRoad's lanelet types if no limit is posted: the advisory speed of German motorways
(Autobahn-Richtgeschwindigkeits-Verordnung, section 1) and the limit outside built-up areas (StVO section 3, paragraph
3, number 2 c). All other lanelets have 50 km/h, the limit inside built-up areas (number 1) and SUMO's default for a
lane.
"""
_SMOOTHING_M = 3.0
"""Length over which curvature is smoothed for comfort (chosen)."""
_STRAIGHT_PER_M = 1e-4
"""Curvature in 1/m below which a path counts as straight (chosen)."""


def curve_speeds_mps(
    stations_m: Values,
    headings_rad: Values,
    lateral_acceleration_mps2: float,
    deceleration_mps2: float,
    smoothing_m: float = _SMOOTHING_M,
) -> Values:
    """Return the highest speeds along a path, shape (n,), that keep v² · curvature within the lateral limit.

    ``stations_m`` and ``headings_rad`` have shape (n,). Before a curve the speed falls by the deceleration, so that
    v² = v_next² + 2 · deceleration · distance. The curvature is smoothed over ``smoothing_m``.
    """
    spacing_m = float(np.mean(np.diff(stations_m)))
    curvature = np.abs(gaussian(np.gradient(headings_rad, stations_m), smoothing_m / spacing_m))
    squared = lateral_acceleration_mps2 / np.maximum(curvature, _STRAIGHT_PER_M)
    # with E = v² + 2·b·s, the condition is that no later E is smaller
    energy = squared + 2.0 * deceleration_mps2 * stations_m
    least = np.minimum.accumulate(energy[::-1])[::-1]
    speeds: Values = np.sqrt(least - 2.0 * deceleration_mps2 * stations_m)
    return speeds


class CruisingSpeed:
    """The speed that suits the lanes and curves along a reference path, regardless of the goal.

    The basis is the lowest limit that is posted on the route's lanelet. Lanelets without a limit have the usual speed
    of their type, or the ego's initial speed if that is higher, since the traffic there is then faster. Curves reduce
    the speed to a comfortable lateral acceleration, and the ego brakes comfortably before them.
    """

    def __init__(
        self,
        network: "LaneletNetwork",
        reference: ReferencePath,
        start_mps: float,
        comfortable_mps2: float = COMFORTABLE_MPS2,
    ) -> None:
        self._stations = arc_length(reference.points)
        posted = posted_speeds(network)
        route = [network.find_lanelet_by_id(key) for key in reference.lanelets]
        limits = np.array(
            [posted.get(int(lanelet.lanelet_id)) or max(_usual_mps(lanelet), start_mps) for lanelet in route]
        )
        lanelet_at = np.searchsorted(reference.lanelet_ends_m(network), self._stations, side="right")
        self._limits = limits[np.minimum(lanelet_at, len(limits) - 1)]
        turned = np.concatenate([along := headings(reference.points), along[-1:]])
        self._curves = curve_speeds_mps(self._stations, turned, comfortable_mps2, comfortable_mps2)

    def at(self, station_m: float) -> tuple[float, SpeedReason]:
        """Return the speed in m/s at a station, and whether the limit or the curve ahead determines it."""
        place = min(max(int(np.searchsorted(self._stations, station_m, side="right")) - 1, 0), len(self._limits) - 1)
        limit, curve = float(self._limits[place]), float(np.interp(station_m, self._stations, self._curves))
        return (limit, "speed_limit") if limit <= curve else (curve, "curve")


def _usual_mps(lanelet: "Lanelet") -> float:
    """Return the highest usual speed of a lanelet's types."""
    kinds = (kind.value for kind in lanelet.lanelet_type or ())
    return max((_USUAL_OF_TYPE_MPS.get(kind, USUAL_SPEED_MPS) for kind in kinds), default=USUAL_SPEED_MPS)


class DesiredSpeed:
    """The desired speed on the way to a goal: set by the goal, and after its time interval by the lane and its curves.

    For a goal with a position, it is the mean speed that reaches the goal's middle by the middle of the time interval
    or, once that has passed, by its end. After the middle of the interval it is at most the cruising speed, or the
    present speed if that is higher, so that a late ego does not race. Inside a goal with a speed interval, and for a
    goal with a speed interval but no position, it is the middle of that interval. In all other cases, and after the
    time interval, it is the cruising speed. It always stays within 5 m/s of the present speed.

    An ego inside a goal without a speed interval still aims for the goal's middle, and waits there until the time
    interval ends.

    The goal must be one goal state, see :func:`~..goal.select_goal_state`. An instance serves one run and must be given
    the ego's states in driving order, since the reference path may pass a point twice.
    """

    def __init__(self, goal: Goal, reference: ReferencePath, step_s: float, cruising: CruisingSpeed) -> None:
        self._goal, self._step_s, self._cruising = goal, step_s, cruising
        self._follower, self._start_m = reference.follower(), reference.start_m
        stations = goal.stations_on(reference.points, reference.start_m) if goal.has_position else None
        self._goal_station_m = None if stations is None else (stations[0] + stations[1]) / 2
        self._middle_step = (goal.states[0].first + goal.states[0].last) // 2

    @classmethod
    def of(cls, task: PlanningTask) -> "DesiredSpeed":
        """Return the desired speed for a planning task."""
        start_mps, comfortable = EgoState.of(task.problem.initial_state).speed_mps, task.vehicle.comfortable_mps2
        cruising = task.made.get(
            ("cruising speed", start_mps, comfortable),
            lambda: CruisingSpeed(task.network, task.reference, start_mps, comfortable),
        )
        goal = task.goal_ahead
        return task.made.get(
            ("desired speed", cls, id(goal), id(cruising)),
            lambda: cls(Goal(goal), task.reference, task.step_s, cruising),
            goal,
            cruising,
        ).anew()

    def anew(self) -> Self:
        """Return the desired speed for another run of the same task."""
        other = copy(self)
        other._follower = self._follower.beginning_at(self._start_m)
        return other

    def at(self, ego: EgoState) -> float:
        """Return the desired speed in m/s."""
        return self.explained_at(ego)[0]

    def explained_at(self, ego: EgoState) -> tuple[float, SpeedReason]:
        """Return the desired speed in m/s, and its reason."""
        low, high = max(ego.speed_mps - SPEED_BAND_MPS, 0.0), min(ego.speed_mps + SPEED_BAND_MPS, _MAXIMUM_SPEED_MPS)
        wanted, reason = self._desired_speed(ego, self._follower.place(ego.position)[0])
        return min(max(wanted, min(low, high)), high), reason

    def average_to_goal(self, ego: EgoState) -> float | None:
        """Return the mean speed to the goal's middle in the time left, or None without a position or time."""
        if self._goal_station_m is None:
            return None
        if self._goal.holds(ego.position):
            return self._goal.speed_mps
        here_m = self._follower.place(ego.position)[0]
        mean_mps = self._mean_to(self._goal_station_m - here_m, self._goal.last_step, ego)
        return None if mean_mps is None else max(mean_mps, 0.0)

    def _desired_speed(self, ego: EgoState, here_m: float) -> tuple[float, SpeedReason]:
        goal, cruising = self._goal, self._cruising.at(here_m)
        if ego.step > goal.last_step:
            return cruising
        inside = not goal.has_position or goal.holds(ego.position)
        if inside and goal.speed_mps is not None:
            return goal.speed_mps, "goal_interval"
        if self._goal_station_m is None:
            return cruising
        left_m = self._goal_station_m - here_m
        if left_m <= 0.0 and not inside:
            return cruising
        by_middle = self._mean_to(left_m, self._middle_step, ego)
        if by_middle is not None:
            return max(by_middle, 0.0), "goal_mean"
        by_end = self._mean_to(left_m, goal.last_step, ego)
        if by_end is None:
            return cruising
        return min(max(by_end, 0.0), max(cruising[0], ego.speed_mps)), "goal_end"

    def _mean_to(self, left_m: float, step: int, ego: EgoState) -> float | None:
        """Return the mean speed in m/s that covers a distance before a given step, or None if that step has passed."""
        left_s = (step - ego.step) * self._step_s
        return left_m / left_s if left_s > 0 else None


class ReferenceDesiredSpeed(DesiredSpeed):
    """The rule of the Frenetix reference loop, for comparisons.

    It uses the mean speed to the middle of the goal by the middle of its time, or the goal's speed interval, otherwise
    the present speed. It keeps the present speed inside a goal without a speed interval, so the ego leaves the goal too
    early. It also does so everywhere after the middle of the time, so a standing ego never starts again.
    """

    def _desired_speed(self, ego: EgoState, here_m: float) -> tuple[float, SpeedReason]:
        goal = self._goal
        if not goal.has_position:
            return ego.speed_mps, "present"
        if self._goal_station_m is not None and not goal.holds(ego.position):
            mean_mps = self._mean_to(self._goal_station_m - here_m, self._middle_step, ego)
            if mean_mps is not None:
                return mean_mps, "goal_mean"
        return (ego.speed_mps, "present") if goal.speed_mps is None else (goal.speed_mps, "goal_interval")
