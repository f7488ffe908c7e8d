"""Which of several goal states the ego heads for: one is enough, and nobody can head for all of them."""

import math
from typing import TYPE_CHECKING

from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.planners.goal import Goal, GoalCondition
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reachability import farthest_m, left_behind, out_of_reach
from plannerforge.engine.planners.reference_path import ReferencePath, build_reference_path
from plannerforge.engine.planners.route import find_route
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.schemas.errors import NotPossible

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.scenario.lanelet import LaneletNetwork

AHEAD_M = 120.0
"""How far the paths that are compared go on beyond the goal."""


def aimed_at(
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
    begin_m, end_m = _way_to(goal, ego, reference)
    first_s, last_s = _seconds_to(condition, ego, step_s)
    if begin_m > farthest_m(ego.speed_mps, last_s, vehicle):
        return None
    slowest = max(begin_m, 0.0) / last_s if last_s > 0 else 0.0
    fastest = max(end_m, 0.0) / first_s if first_s > 0 else math.inf
    return max(_outside(ego.speed_mps, slowest, fastest), to_interval)


def _way_to(goal: Goal, ego: EgoState, reference: ReferencePath) -> tuple[float, float]:
    """How far the area's begin and end lie before the ego along the path, in m."""
    here = project(reference.points, ego.position)[0]
    found = goal.stations_on(reference.points)
    if found is None and goal.center is not None:
        beside = project(reference.points, goal.center)[0]
        found = beside, beside
    begin, end = found or (here, here)
    return begin - here, end - here


def _seconds_to(condition: GoalCondition, ego: EgoState, step_s: float) -> tuple[float, float]:
    window = condition.window
    return (window.first - ego.step) * step_s, (window.last - ego.step) * step_s


def _outside(value: float, low: float, high: float) -> float:
    return max(low - value, value - high, 0.0)
