"""CommonRoad's goal region in all its forms, whether it can be reached, and how fast to drive there.

A goal has lanelets, shapes or a free position, intervals of speed and heading, and one or several states of which one
has to be met. ``select_goal_state`` says which of several the ego drives to: one is enough, and no ego can drive to
all. Lengths in m, speeds in m/s, headings in rad.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...schemas.errors import NotPossible
from ..geometry import Points, arc_length, project, project_all
from ..network import LaneletGraph
from ..scene import find_route, start_lanelets
from ..vehicles import VehicleParameters
from .interface import EgoState
from .reference_path import ReferencePath, build_reference_path

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.scenario.lanelet import LaneletNetwork
    from shapely.geometry.base import BaseGeometry

BEHIND_M = 0.5
"""Chosen: a goal ends behind the ego when it does so by more than this."""
AHEAD_M = 120.0
"""Chosen: how far the paths that are compared go on beyond the goal."""
SPEED_BAND_MPS = 5.0
MAXIMUM_SPEED_MPS = 50.0
"""As in the Frenetix reference loop: the desired speed is within this band of the present one, and at most this."""
SLOWEST_GOAL_MPS = 0.01
"""An end of the goal's speed interval counts as at least this."""

Timing = Literal["early", "in_time", "late"]


@dataclass(frozen=True)
class _GoalStatus:
    """How one ego state relates to one goal state; a condition that the goal does not state is met."""

    position: bool
    heading: bool
    speed: bool
    timing: Timing

    @property
    def reached(self) -> bool:
        """All conditions hold."""
        return self.position and self.heading and self.speed and self.timing == "in_time"

    @property
    def all_but_time(self) -> bool:
        """Everything holds except possibly the time."""
        return self.position and self.heading and self.speed


@dataclass(frozen=True)
class _Window:
    """First and last time step of a goal state."""

    first: int
    last: int


@dataclass(frozen=True)
class _GoalCondition:
    """Time, area (None: any place) and speed interval in m/s (None: any speed) of one goal state."""

    window: _Window
    area: "BaseGeometry | None"
    speed_mps: tuple[float, float] | None


class Goal:
    """The goal region of a planning problem; one of its states has to be met."""

    def __init__(self, region: "GoalRegion") -> None:
        self._states = list(region.state_list)
        self.windows = tuple(_Window(*_bounds(state.time_step)) for state in self._states)
        self._areas = [_area(getattr(state, "position", None)) for state in self._states]

    @property
    def first_step(self) -> int:
        """The first step at which the goal can be reached."""
        return min(window.first for window in self.windows)

    @property
    def last_step(self) -> int:
        """The last step at which the goal can be reached."""
        return max(window.last for window in self.windows)

    @property
    def conditions(self) -> tuple["_GoalCondition", ...]:
        """What each goal state asks for."""
        return tuple(
            _GoalCondition(window, area, _interval(getattr(state, "velocity", None)))
            for state, area, window in zip(self._states, self._areas, self.windows, strict=True)
        )

    @property
    def has_position(self) -> bool:
        """Whether every goal state asks for a place."""
        return all(area is not None for area in self._areas)

    @property
    def speed_mps(self) -> float | None:
        """The middle of the first speed interval that a goal state names."""
        for state in self._states:
            if getattr(state, "velocity", None) is not None:
                low, high = _bounds_of_number(state.velocity)
                return (max(low, SLOWEST_GOAL_MPS) + max(high, SLOWEST_GOAL_MPS)) / 2
        return None

    def status(self, ego: EgoState) -> list[_GoalStatus]:
        """How the ego stands to each goal state."""
        return [self._status(index, ego) for index in range(len(self._states))]

    def holds(self, point: Points) -> bool:
        """Whether a point lies in the area of any goal state."""
        import shapely

        return any(area is None or shapely.intersects_xy(area, point[0], point[1]) for area in self._areas)

    @property
    def center(self) -> Points | None:
        """A point in the middle of the first goal state's area, shape (2,); None where the position is free."""
        if not self._areas or self._areas[0] is None:
            return None
        inner = self._areas[0].representative_point()
        middle = self._areas[0].centroid
        chosen = middle if self._areas[0].intersects(middle) else inner
        return np.array([chosen.x, chosen.y])

    def stations_on(self, path: Points) -> tuple[float, float] | None:
        """Where a path is inside the goal's area: first and last arc length in m; None where it never is."""
        import shapely

        inside = np.zeros(len(path), dtype=bool)
        for area in self._areas:
            if area is not None:
                inside |= shapely.intersects_xy(area, path[:, 0], path[:, 1])
        within = np.flatnonzero(inside)
        stations = arc_length(path)
        return (float(stations[within[0]]), float(stations[within[-1]])) if len(within) else None

    def _status(self, index: int, ego: EgoState) -> _GoalStatus:
        import shapely

        state, area, window = self._states[index], self._areas[index], self.windows[index]
        timing: Timing = "early" if ego.step < window.first else "late" if ego.step > window.last else "in_time"
        return _GoalStatus(
            position=area is None or bool(shapely.intersects_xy(area, ego.position[0], ego.position[1])),
            heading=_angle_within(ego.heading_rad, getattr(state, "orientation", None)),
            speed=_within(ego.speed_mps, getattr(state, "velocity", None)),
            timing=timing,
        )


def _area(position: Any) -> Any:
    """The area of a goal position as a shapely geometry; None where the goal has no position."""
    import shapely

    if position is None:
        return None
    parts = [part.shapely_object for part in getattr(position, "shapes", [position])]
    area = shapely.union_all(shapely.make_valid(np.array(parts, dtype=object)))
    shapely.prepare(area)
    return area


def _bounds(step: Any) -> tuple[int, int]:
    low, high = _bounds_of_number(step)
    return int(low), int(high)


def _bounds_of_number(value: Any) -> tuple[float, float]:
    return (float(value.start), float(value.end)) if hasattr(value, "start") else (float(value), float(value))


def _interval(value: Any) -> tuple[float, float] | None:
    return None if value is None else _bounds_of_number(value)


def _within(value: float, interval: Any) -> bool:
    if interval is None:
        return True
    low, high = _bounds_of_number(interval)
    return low <= value <= high


def _angle_within(angle_rad: float, interval: Any) -> bool:
    """Whether an angle lies in an interval on the circle, whatever multiples of 2π either is written with."""
    if interval is None:
        return True
    low, high = _bounds_of_number(interval)
    if high - low >= math.tau:
        return True
    beyond = (angle_rad - low) % math.tau
    return beyond <= high - low + 1e-9 or math.tau - beyond < 1e-9


def out_of_reach(goal: Goal, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> str | None:
    """One sentence on why no goal state can be reached in its time; None where one may be.

    A bound that no vehicle can beat: straight at the goal's area from the ego's centre with the largest acceleration
    up to the largest speed, roads and traffic left aside. With ``v₀``, ``a``, ``v_max`` and the time ``t`` to the
    goal's last step the ego covers at most ``v₀t + at²/2``, from ``t₁ = (v_max − v₀)/a`` on at ``v_max``; its speed is
    then within ``v₀ ± at``. What it lets pass is not proven to be reachable.
    """
    obstacles = [_obstacle(condition, ego, vehicle, step_s) for condition in goal.conditions]
    return None if any(obstacle is None for obstacle in obstacles) else next(iter(obstacles), None)


def left_behind(goal: Goal, ego: EgoState, reference: ReferencePath, network: "LaneletNetwork") -> str | None:
    """One sentence on why a goal behind the ego cannot be reached; None where it may be.

    The ego does not drive backwards. A goal is behind it where every corner of every goal area lies behind it along the
    reference path, and no lanelet that an area touches can be reached from where the ego's lanelet and those beside it
    end.
    """
    import shapely

    areas = [condition.area for condition in goal.conditions if condition.area is not None]
    if len(areas) < len(goal.conditions):
        return None
    here = project(reference.points, ego.position)[0]
    away = here - float(project_all(reference.points, shapely.get_coordinates(areas))[0].max())
    if away <= BEHIND_M:
        return None
    graph = LaneletGraph.of(network)
    beside = graph.beside(start_lanelets(network, ego.position, ego.heading_rad))
    onward = graph.reachable(following for key in beside for following in graph.successors[key])
    outlines = [network.find_lanelet_by_id(key).polygon.shapely_object for key in onward]
    if any(area.intersects(outline) for outline in outlines for area in areas):
        return None
    return f"the goal ends {away:.1f} m behind the ego, and no way leads back to it"


def farthest_m(speed_mps: float, duration_s: float, vehicle: VehicleParameters) -> float:
    """The longest distance in m that a vehicle covers in a time."""
    acceleration = vehicle.maximum_acceleration_mps2
    gain = max(vehicle.maximum_speed_mps - speed_mps, 0.0)
    faster_s = min(duration_s, gain / acceleration)
    top = speed_mps + acceleration * faster_s
    return speed_mps * faster_s + acceleration * faster_s**2 / 2 + top * (duration_s - faster_s)


def _obstacle(condition: _GoalCondition, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> str | None:
    from shapely import Point

    left_s = (condition.window.last - ego.step) * step_s
    if left_s < 0:
        return f"the goal's last step {condition.window.last} is before the ego's first step {ego.step}"
    if condition.area is not None:
        away, reach = float(condition.area.distance(Point(ego.position))), farthest_m(ego.speed_mps, left_s, vehicle)
        if away > reach:
            return (
                f"the goal is {away:.1f} m away as the crow flies and the ego covers at most {reach:.1f} m in the "
                f"{left_s:.1f} s to the goal's last step"
            )
    if condition.speed_mps is None:
        return None
    low, high = condition.speed_mps
    change = vehicle.maximum_acceleration_mps2 * left_s
    if low > ego.speed_mps + change or high < ego.speed_mps - change:
        wanted = f"the goal's speed {low:.1f} to {high:.1f} m/s"
        return f"{wanted} is out of reach from {ego.speed_mps:.1f} m/s in {left_s:.1f} s"
    return None


def select_goal_state(
    network: "LaneletNetwork", region: "GoalRegion", ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> "GoalRegion":
    """The region of one goal state, with place, window and speed of its own; the whole where none can be reached.

    Of the states that a route leads to and that are in reach in their time, the one that asks the least change of
    speed: to a mean that brings the ego into the area within the window, and to the interval of the goal's speed. The
    earlier one where two ask the same. The order in the file does not count.
    """
    if len(region.state_list) < 2:
        return region
    ranked = []
    for part in _states_of(region):
        change_mps = _change_of_speed_mps(network, part, ego, vehicle, step_s)
        if change_mps is not None:
            window = Goal(part).windows[0]
            ranked.append(((round(change_mps, 6), window.last, window.first), part))
    return min(ranked, key=lambda item: item[0])[1] if ranked else region


def _states_of(region: "GoalRegion") -> list["GoalRegion"]:
    from commonroad.planning.goal import GoalRegion

    named = region.lanelets_of_goal_position or {}
    return [
        GoalRegion([state], {0: named[index]} if named.get(index) else None)
        for index, state in enumerate(region.state_list)
    ]


def _change_of_speed_mps(
    network: "LaneletNetwork", part: "GoalRegion", ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> float | None:
    """The larger of the two changes that one goal state asks for; None where it cannot be reached."""
    goal = Goal(part)
    condition = goal.conditions[0]
    if out_of_reach(goal, ego, vehicle, step_s):
        return None
    to_interval = 0.0 if condition.speed_mps is None else _outside(ego.speed_mps, *condition.speed_mps)
    if condition.area is None:
        return to_interval
    try:
        route = find_route(network, part, ego.position, ego.heading_rad, ahead_m=AHEAD_M)
    except NotPossible:
        return None
    reference = build_reference_path(network, route, ego.position, ego.speed_mps, beyond_m=AHEAD_M)
    if left_behind(goal, ego, reference, network):
        return None
    begin_m, end_m = _distances_to(goal, ego, reference)
    window = condition.window
    first_s, last_s = (window.first - ego.step) * step_s, (window.last - ego.step) * step_s
    if begin_m > farthest_m(ego.speed_mps, last_s, vehicle):
        return None
    slowest = max(begin_m, 0.0) / last_s if last_s > 0 else 0.0
    fastest = max(end_m, 0.0) / first_s if first_s > 0 else math.inf
    return max(_outside(ego.speed_mps, slowest, fastest), to_interval)


def _distances_to(goal: Goal, ego: EgoState, reference: ReferencePath) -> tuple[float, float]:
    """How far ahead of the ego the area begins and ends along the path, in m."""
    here = project(reference.points, ego.position)[0]
    stations = goal.stations_on(reference.points)
    if stations is None and goal.center is not None:
        beside = project(reference.points, goal.center)[0]
        stations = beside, beside
    begin, end = stations or (here, here)
    return begin - here, end - here


def _outside(value: float, low: float, high: float) -> float:
    return max(low - value, value - high, 0.0)


class DesiredSpeed:
    """Distance to the goal's middle over the time to the middle of its window, within 5 m/s of the present speed.

    Inside the goal it is the middle of the goal's speed interval; the present speed where nothing else is known (a
    goal without a place or speed). This is the rule of the Frenetix reference loop, with one difference: inside a goal
    without a speed interval the reference keeps the present speed and so drives out of it before its time; here the
    ego goes on aiming at the goal's middle, and waits there. The goal is to be one goal state, see
    :func:`select_goal_state`.
    """

    def __init__(self, goal: Goal, reference: ReferencePath, step_s: float) -> None:
        self._goal, self._reference, self._step_s = goal, reference, step_s
        stations = goal.stations_on(reference.points) if goal.has_position else None
        self._goal_station_m = None if stations is None else (stations[0] + stations[1]) / 2
        self._middle_step = (goal.windows[0].first + goal.windows[0].last) // 2

    def at(self, ego: EgoState) -> float:
        """The desired speed in m/s."""
        wanted = self._wanted(ego)
        low, high = max(ego.speed_mps - SPEED_BAND_MPS, 0.0), min(ego.speed_mps + SPEED_BAND_MPS, MAXIMUM_SPEED_MPS)
        return float(np.clip(wanted, min(low, high), high))

    def average_to_goal(self, ego: EgoState) -> float | None:
        """Mean speed that brings the ego to the goal's middle in the time left; None without a place or time."""
        if self._goal_station_m is None:
            return None
        if self._goal.holds(ego.position):
            return self._goal.speed_mps
        time_left_s = (self._goal.last_step - ego.step) * self._step_s
        if time_left_s <= 0:
            return None
        return max((self._goal_station_m - project(self._reference.points, ego.position)[0]) / time_left_s, 0.0)

    def _wanted(self, ego: EgoState) -> float:
        otherwise = ego.speed_mps if self._goal.speed_mps is None else self._goal.speed_mps
        if self._goal_station_m is None:
            return otherwise if self._goal.has_position else ego.speed_mps
        if self._goal.holds(ego.position) and self._goal.speed_mps is not None:
            return self._goal.speed_mps
        time_left_s = (self._middle_step - ego.step) * self._step_s
        if time_left_s <= 0:
            return otherwise
        return (self._goal_station_m - project(self._reference.points, ego.position)[0]) / time_left_s
