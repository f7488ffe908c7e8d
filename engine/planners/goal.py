"""CommonRoad's goal regions in all their forms, and whether an ego can reach them.

A goal has one or several states, each with lanelets, shapes or a free position, and intervals of speed and heading. The
ego must meet one of them; ``select_goal_state`` selects the one to drive to. Lengths in m, speeds in m/s, headings in
rad.
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...schemas.errors import NotPossible
from ..geometry import Points, arc_length, project, project_all, project_along
from ..network import LaneletGraph
from ..scene import find_route, start_lanelets
from ..vehicles import VehicleParameters, farthest_m
from .interface import EgoState
from .reference_path import BEYOND_GOAL_M, ReferencePath, build_reference_path

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad.scenario.scenario import Scenario
    from shapely.geometry.base import BaseGeometry

_BEHIND_M = 0.5
"""A goal is behind the ego if its end is farther back than this (chosen)."""
_EDGE_M = 1e-6
"""Anything this near to a goal's area is on its edge (chosen: far above the rounding errors of coordinates)."""
_AHEAD_M = 120.0
"""Length by which compared paths extend beyond the goal (chosen)."""
PASSED_M = 5.0
"""The ego has passed the goal if it is farther than this beyond its end (chosen)."""
_SLOWEST_GOAL_MPS = 0.01
"""Smallest value of either end of the goal's speed interval."""

Timing = Literal["early", "in_time", "late"]


@dataclass(frozen=True)
class _GoalStatus:
    """The relation of an ego state to a goal state: its position, all conditions except the time, and the timing."""

    position: bool
    all_but_time: bool
    timing: Timing

    @property
    def reached(self) -> bool:
        """True if all conditions hold."""
        return self.all_but_time and self.timing == "in_time"


@dataclass(frozen=True)
class _GoalState:
    """One goal state: the first and last steps, area, headings in rad and speeds in m/s; None allows any value."""

    first: int
    last: int
    area: "BaseGeometry | None"
    headings_rad: tuple[float, float] | None
    speeds_mps: tuple[float, float] | None

    @classmethod
    def of(cls, state: Any) -> "_GoalState":
        """Return the conditions of one of CommonRoad's goal states."""
        first, last = _bounds(state.time_step)
        heading, speed = getattr(state, "orientation", None), getattr(state, "velocity", None)
        return cls(
            first=int(first),
            last=int(last),
            area=_area(getattr(state, "position", None)),
            headings_rad=None if heading is None else _bounds(heading),
            speeds_mps=None if speed is None else _bounds(speed),
        )

    def holds(self, point: Points) -> bool:
        """Return True if a point is in the area."""
        import shapely

        return self.area is None or bool(shapely.intersects_xy(self.area, point[0], point[1]))

    def status(self, ego: EgoState) -> _GoalStatus:
        """Return the status of the ego with respect to this state."""
        there = self.holds(ego.position)
        heading = self.headings_rad is None or _angle_within(ego.heading_rad, *self.headings_rad)
        speed = self.speeds_mps is None or self.speeds_mps[0] <= ego.speed_mps <= self.speeds_mps[1]
        timing: Timing = "early" if ego.step < self.first else "late" if ego.step > self.last else "in_time"
        return _GoalStatus(there, there and heading and speed, timing)


class Goal:
    """The goal region of a planning problem; the ego must meet one of its ``states``.

    The ego can reach it from ``first_step`` to ``last_step``. ``has_position``: True if every state requires a
    position; ``speed_mps``: the middle of the first speed interval in the states, or None.
    """

    def __init__(self, region: "GoalRegion") -> None:
        self.states = tuple(_GoalState.of(state) for state in region.state_list)
        self.first_step = min(state.first for state in self.states)
        self.last_step = max(state.last for state in self.states)
        self.has_position = all(state.area is not None for state in self.states)
        speeds = next((state.speeds_mps for state in self.states if state.speeds_mps is not None), None)
        self.speed_mps = None if speeds is None else sum(max(end, _SLOWEST_GOAL_MPS) for end in speeds) / 2

    def status(self, ego: EgoState) -> list[_GoalStatus]:
        """Return the status of the ego with respect to each goal state."""
        return [state.status(ego) for state in self.states]

    def holds(self, point: Points) -> bool:
        """Return True if a point is in the area of any goal state."""
        return any(state.holds(point) for state in self.states)

    def distance_m(self, positions: Points) -> float:
        """Return the distance in m from positions (n, 2) to the nearest area of a goal state; 0 inside an area."""
        import shapely

        points = shapely.points(positions)
        return min(
            (float(shapely.distance(state.area, points).min()) for state in self.states if state.area is not None),
            default=0.0,
        )

    @property
    def center(self) -> Points | None:
        """A point in the middle of the first goal state's area, shape (2,); None if the position is free."""
        area = self.states[0].area
        if area is None:
            return None
        middle = area.centroid
        chosen = middle if area.intersects(middle) else area.representative_point()
        return np.array([chosen.x, chosen.y])

    def stations_on(self, path: Points, from_m: float = 0.0) -> tuple[float, float] | None:
        """Return the first and last arc lengths in m of a path's first passage through the goal's area, or None.

        A path that comes back, for example in a roundabout, may pass the area again. For each goal state, only the
        first passage that does not end before ``from_m`` counts. Gaps shorter than ``PASSED_M`` do not end a passage.

        Points of the path on the edge of the area are inside. Goals and paths that begin at the start of a lanelet meet
        there, and rounding, which depends on the location of the map, must not select the next point instead.
        """
        areas = [state.area for state in self.states if state.area is not None]
        found = [passage for area in areas if (passage := _first_passage(area, path, from_m)) is not None]
        return (min(begin for begin, _ in found), max(end for _, end in found)) if found else None


def _first_passage(area: Any, path: Points, from_m: float) -> tuple[float, float] | None:
    """Return a path's first stretch inside an area that ends after a station, otherwise its last stretch there."""
    import shapely

    stations = arc_length(path)
    within = np.flatnonzero(shapely.dwithin(area, shapely.points(path), _EDGE_M))
    if not len(within):
        return None
    ends = np.flatnonzero((np.diff(within) > 1) & (np.diff(stations[within]) > PASSED_M))
    begins, lasts = within[np.concatenate([[0], ends + 1])], within[np.concatenate([ends, [len(within) - 1]])]
    later = np.flatnonzero(stations[lasts] >= from_m)
    chosen = int(later[0]) if len(later) else len(lasts) - 1
    first, last = int(begins[chosen]), int(lasts[chosen])
    return (
        float(stations[first]) - _inside_m(area, path[max(first - 1, 0) : first + 1]),
        float(stations[last]) + _inside_m(area, path[last : last + 2]),
    )


def _inside_m(area: Any, ends: Points) -> float:
    """Return the length of the line between two points (2, 2) that lies inside an area; 0 for fewer points."""
    import shapely

    inside_m = float(shapely.intersection(area, shapely.linestrings(ends)).length) if len(ends) > 1 else 0.0
    return inside_m if inside_m > _EDGE_M else 0.0


def _area(position: Any) -> Any:
    """Return the area of a goal position as a shapely geometry, or None if the goal has no position."""
    import shapely

    if position is None:
        return None
    parts = [part.shapely_object for part in getattr(position, "shapes", [position])]
    area = shapely.union_all(shapely.make_valid(np.array(parts, dtype=object)))
    shapely.prepare(area)
    return area


def _bounds(value: Any) -> tuple[float, float]:
    return (float(value.start), float(value.end)) if hasattr(value, "start") else (float(value), float(value))


def _angle_within(angle_rad: float, low: float, high: float) -> bool:
    """Return True if an angle is in an interval on the circle, regardless of multiples of 2π."""
    if high - low >= math.tau:
        return True
    beyond = (angle_rad - low) % math.tau
    return beyond <= high - low + 1e-9 or math.tau - beyond < 1e-9


def out_of_reach(goal: Goal, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> str | None:
    """Return one sentence on why no goal state can be reached in its time, or None if one may be reachable.

    This is a bound that no vehicle can beat: the straight distance from the ego's centre to the goal's area must be at
    most :func:`farthest_m` until the goal's last step, and the speed must be within ``v₀ ± at``. A goal that meets this
    bound may still be unreachable.
    """
    obstacles = [_obstacle(state, ego, vehicle, step_s) for state in goal.states]
    return None if None in obstacles else obstacles[0]


def path_to(
    goal: Goal, region: "GoalRegion", network: "LaneletNetwork", ego: EgoState, *, ahead_m: float, beyond_m: float
) -> ReferencePath:
    """Return the reference path of the route to a goal, shifted if the goal is off its centre line.

    Args:
        goal: The goal to drive to.
        region: The same goal as CommonRoad's goal region.
        network: The lanelets.
        ego: The state in which the path begins.
        ahead_m: The minimum length of the route if the goal has no position.
        beyond_m: The length of the straight extension beyond the end of the route.

    Raises:
        NotPossible: No route leads to the goal, or it is behind the ego.
    """
    route = find_route(network, region, ego.position, ego.heading_rad, ahead_m=ahead_m)
    path = partial(build_reference_path, network, route, ego.position, ego.speed_mps, beyond_m=beyond_m)
    reference = path()
    behind = _left_behind(goal, ego, reference, network)
    if behind is not None:
        raise NotPossible(behind)
    is_off_path = goal.has_position and goal.stations_on(reference.points) is None
    return path(through=goal.center) if is_off_path else reference


def _left_behind(goal: Goal, ego: EgoState, reference: ReferencePath, network: "LaneletNetwork") -> str | None:
    """Return one sentence on why a goal behind the ego cannot be reached, or None if it may be reachable.

    The ego does not drive backwards. A goal is behind it if every corner of every goal area is behind it along the
    reference path, and no lanelet that touches an area is reachable from the ends of the ego's lanelet and its
    neighbours.
    """
    import shapely

    if not goal.has_position:
        return None
    areas = [state.area for state in goal.states if state.area is not None]
    here = reference.follower().place(ego.position)[0]
    away = here - float(project_all(reference.points, shapely.get_coordinates(areas))[0].max())
    if away <= _BEHIND_M:
        return None
    graph = LaneletGraph.of(network)
    starts = graph.parallel_lanes(start_lanelets(network, ego.position, ego.heading_rad))
    onward = graph.reachable(following for key in starts for following in graph.successors[key])
    outlines = [network.find_lanelet_by_id(key).polygon.shapely_object for key in onward]
    if any(area.intersects(outline) for outline in outlines for area in areas):
        return None
    return f"the goal ends {away:.1f} m behind the ego, and no route leads back to it"


def _obstacle(state: _GoalState, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> str | None:
    from shapely import Point

    left_s = (state.last - ego.step) * step_s
    if left_s < 0:
        return f"the goal's last step {state.last} is before the ego's first step {ego.step}"
    if state.area is not None:
        away, reach = float(state.area.distance(Point(ego.position))), farthest_m(ego.speed_mps, left_s, vehicle)
        if away > reach:
            return (
                f"the goal is {away:.1f} m away in a straight line, but the ego covers at most {reach:.1f} m in the "
                f"{left_s:.1f} s to the goal's last step"
            )
    if state.speeds_mps is None:
        return None
    low, high = state.speeds_mps
    change = vehicle.maximum_acceleration_mps2 * left_s
    if low > ego.speed_mps + change or high < ego.speed_mps - change:
        wanted = f"the goal's speed {low:.1f} to {high:.1f} m/s"
        return f"{wanted} is unreachable from {ego.speed_mps:.1f} m/s in {left_s:.1f} s"
    return None


def select_goal_state(
    network: "LaneletNetwork", region: "GoalRegion", ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> "GoalRegion":
    """Return the region of one goal state, with its own conditions; the whole region if all states are unreachable.

    Among the states that a route leads to in their time, it selects the one that needs the smallest change of speed.
    The change leads to a mean speed that brings the ego into the area within the window, and to the goal's speed
    interval. The earlier state wins a tie. The order in the file does not matter.
    """
    from commonroad.planning.goal import GoalRegion

    if len(region.state_list) < 2:
        return region
    named, ranked = region.lanelets_of_goal_position or {}, []
    for index, state in enumerate(region.state_list):
        part = GoalRegion([state], {0: named[index]} if named.get(index) else None)
        goal = Goal(part)
        change_mps = _change_of_speed_mps(network, part, goal, ego, vehicle, step_s)
        if change_mps is not None:
            ranked.append(((round(change_mps, 6), goal.last_step, goal.first_step), part))
    return min(ranked, key=lambda item: item[0])[1] if ranked else region


def _change_of_speed_mps(
    network: "LaneletNetwork", part: "GoalRegion", goal: Goal, ego: EgoState, vehicle: VehicleParameters, step_s: float
) -> float | None:
    """Return the larger of the two speed changes that one goal state needs, or None if it is unreachable."""
    if out_of_reach(goal, ego, vehicle, step_s):
        return None
    speeds_mps = goal.states[0].speeds_mps
    to_interval = 0.0 if speeds_mps is None else _outside(ego.speed_mps, *speeds_mps)
    if not goal.has_position:
        return to_interval
    try:
        reference = path_to(goal, part, network, ego, ahead_m=_AHEAD_M, beyond_m=_AHEAD_M)
    except NotPossible:
        return None
    begin_m, end_m = _distances_to(goal, ego, reference)
    first_s, last_s = (goal.first_step - ego.step) * step_s, (goal.last_step - ego.step) * step_s
    if begin_m > farthest_m(ego.speed_mps, last_s, vehicle):
        return None
    slowest = max(begin_m, 0.0) / last_s if last_s > 0 else 0.0
    fastest = max(end_m, 0.0) / first_s if first_s > 0 else math.inf
    return max(_outside(ego.speed_mps, slowest, fastest), to_interval)


def _distances_to(goal: Goal, ego: EgoState, reference: ReferencePath) -> tuple[float, float]:
    """Return the distances along the path from the ego to the start and the end of the area, in m."""
    here = reference.follower().place(ego.position)[0]
    stations = goal.stations_on(reference.points, here)
    if stations is None and goal.center is not None:
        nearest = project(reference.points, goal.center)[0]
        stations = nearest, nearest
    begin, end = stations or (here, here)
    return begin - here, end - here


def _outside(value: float, low: float, high: float) -> float:
    return max(low - value, value - high, 0.0)


def progress_to_goal(
    scenario: "Scenario", problem: "PlanningProblem", vehicle: VehicleParameters, positions: Points
) -> float | None:
    """Return the share of the reference path to the goal that positions (n, 2) of the centre cover, from 0 to 1.

    It is 1 only if a position is in the goal's area, as the judge requires. If the ego passes next to the area, the
    distance from its nearest position to the area counts as not covered. None if the goal has no position, or no path
    leads to it.
    """
    ego, network = EgoState.of(problem.initial_state), scenario.lanelet_network
    if not problem.goal.state_list:
        return None
    aim = select_goal_state(network, problem.goal, ego, vehicle, float(scenario.dt))
    goal = Goal(aim)
    if not goal.has_position:
        return None
    try:
        reference = path_to(goal, aim, network, ego, ahead_m=BEYOND_GOAL_M, beyond_m=BEYOND_GOAL_M)
    except NotPossible:
        return None
    start = reference.follower().place(ego.position)[0]
    stations = goal.stations_on(reference.points, start)
    if stations is None:
        return None
    nearest_m = goal.distance_m(positions)
    if nearest_m <= 0:
        return 1.0
    whole = reference.way_m(start, stations[0])
    reached = reference.way_m(start, float(project_along(reference.points, positions, start)[0].max()))
    left = whole - reached if reached < whole else nearest_m
    return max(1.0 - left / whole, 0.0) if whole > 0 else 0.0


def goal_with_path(
    scenario: "Scenario", problem: "PlanningProblem", vehicle: VehicleParameters
) -> tuple[Goal, ReferencePath] | None:
    """Return the goal state that an ego drives to and its route's reference path, or None if there is no route."""
    if not problem.goal.state_list:
        return None
    ego, network = EgoState.of(problem.initial_state), scenario.lanelet_network
    aim = select_goal_state(network, problem.goal, ego, vehicle, float(scenario.dt))
    goal = Goal(aim)
    try:
        return goal, path_to(goal, aim, network, ego, ahead_m=BEYOND_GOAL_M, beyond_m=BEYOND_GOAL_M)
    except NotPossible:
        return None
