"""From the ego's start to its goal over the lanelet graph."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, point_at, project, wrap_angle
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.schemas.errors import NotPossible

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

FARTHEST_LANELET_M = 3.0
"""An ego that stands on no lanelet counts as on the nearest one up to this distance from its centre line."""


@dataclass(frozen=True)
class Route:
    """Lanelets in driving order; a lane change is a step to a neighbour.

    ``lanelets`` goes on beyond the goal as straight as the network allows; ``goal_index`` is the place of the goal
    lanelet in it, or None where the goal has no position.
    """

    lanelets: tuple[int, ...]
    goal_index: int | None


def find_route(
    network: "LaneletNetwork", goal: "GoalRegion", position: Points, heading_rad: float, *, ahead_m: float
) -> Route:
    """The shortest route from a position to any goal lanelet, continued until ``ahead_m`` metres lie behind the goal.

    Raises:
        NotPossible: the position is on no lanelet, the goal touches none, or no route leads there.
    """
    graph = LaneletGraph.of(network)
    starts = start_lanelets(network, position, heading_rad)
    if not goal.state_list:
        raise NotPossible("the planning problem has no goal state")
    goals = goal_lanelets(network, goal)
    if goals is None:
        return Route(straight_on(network, graph, (starts[0],), ahead_m), None)
    if not goals:
        raise NotPossible("the goal region touches no lanelet")
    aligned = [key for key in starts if _heading_error(network, key, position, heading_rad) < math.pi / 2]
    route = graph.shortest_route(aligned, goals) or graph.shortest_route(starts, goals)
    if route is None:
        raise NotPossible(f"no route leads from lanelet {starts[0]} to the goal on {', '.join(map(str, goals[:6]))}")
    return Route(straight_on(network, graph, route, ahead_m), len(route) - 1)


def start_lanelets(network: "LaneletNetwork", position: Points, heading_rad: float) -> list[int]:
    """Lanelets under a position, the one that fits the heading best first.

    Raises:
        NotPossible: no lanelet is there or within :data:`FARTHEST_LANELET_M`.
    """
    found = [int(key) for key in network.find_lanelet_by_position([position])[0]]
    if not found:
        gaps = {key.lanelet_id: abs(project(key.center_vertices, position)[1]) for key in network.lanelets}
        found = [key for key, gap in gaps.items() if gap < FARTHEST_LANELET_M]
    if not found:
        raise NotPossible(f"the ego at ({position[0]:.1f}, {position[1]:.1f}) m is on no lanelet")
    return sorted(found, key=lambda key: (round(_heading_error(network, key, position, heading_rad), 3), key))


def goal_lanelets(network: "LaneletNetwork", goal: "GoalRegion") -> list[int] | None:
    """Lanelets on which a goal region lies, ascending; None where a goal state leaves the position free."""
    named = goal.lanelets_of_goal_position or {}
    found: set[int] = set()
    for index, state in enumerate(goal.state_list):
        if named.get(index):
            found.update(int(key) for key in named[index] if network.find_lanelet_by_id(key) is not None)
        elif getattr(state, "position", None) is None:
            return None
        else:
            found.update(_lanelets_of(network, state.position))
    return sorted(found)


def _lanelets_of(network: "LaneletNetwork", shape: "object") -> set[int]:
    """Lanelets under the centre of a shape, else those that it touches."""
    found: set[int] = set()
    for part in getattr(shape, "shapes", [shape]):
        under = network.find_lanelet_by_position([np.asarray(part.center, dtype=float)])[0]
        if not under:
            outline = part.shapely_object
            under = [key.lanelet_id for key in network.lanelets if key.polygon.shapely_object.intersects(outline)]
        found.update(int(key) for key in under)
    return found


def _heading_error(network: "LaneletNetwork", lanelet_id: int, position: Points, heading_rad: float) -> float:
    center = network.find_lanelet_by_id(lanelet_id).center_vertices
    _, direction = point_at(center, project(center, position)[0])
    return abs(wrap_angle(direction - heading_rad))


def straight_on(
    network: "LaneletNetwork", graph: LaneletGraph, route: tuple[int, ...], ahead_m: float
) -> tuple[int, ...]:
    """The route with the straightest successors behind it, until they are ``ahead_m`` long or the network ends."""
    longer = list(route)
    length = 0.0
    while length < ahead_m:
        following = [key for key in graph.successors.get(longer[-1], ()) if key not in longer]
        if not following:
            break
        current = network.find_lanelet_by_id(longer[-1])
        nearest = min(following, key=lambda key: (_turn(current, network.find_lanelet_by_id(key)), key))
        longer.append(nearest)
        length += graph.length_m[nearest]
    return tuple(longer)


def _turn(current: "Lanelet", following: "Lanelet") -> float:
    """How far the heading changes from the end of one lanelet to the end of the next, in rad."""
    last = current.center_vertices[-1] - current.center_vertices[-2]
    center = following.center_vertices
    step = point_at(center, float(arc_length(center)[-1]))[1]
    return round(abs(wrap_angle(step - math.atan2(last[1], last[0]))), 3)
