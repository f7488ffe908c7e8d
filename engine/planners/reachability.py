"""Whether a goal can be reached in its time at all, whatever the planner."""

from typing import TYPE_CHECKING

from plannerforge.engine.geometry.polyline import project, project_all
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.planners.goal import Goal, GoalCondition
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reference_path import ReferencePath
from plannerforge.engine.planners.route import start_lanelets
from plannerforge.engine.planners.vehicle import VehicleParameters

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

BEHIND_M = 0.5
"""A goal ends behind the ego when it does so by more than this."""


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

    Nobody drives backwards: every corner of every goal area lies behind the ego along the reference path, and no
    lanelet that an area touches can be reached from where the ego's lanelet and those beside it end.
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


def _obstacle(condition: GoalCondition, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> str | None:
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
