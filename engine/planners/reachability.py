"""Whether a goal can be reached in its time at all, whatever the planner."""

from plannerforge.engine.planners.goal import Goal, GoalCondition
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.vehicle import VehicleParameters


def out_of_reach(goal: Goal, ego: EgoState, vehicle: VehicleParameters, step_s: float) -> str | None:
    """One sentence on why no goal state can be reached in its time; None where one may be.

    A bound that no vehicle can beat: straight at the goal's area from the ego's centre with the largest acceleration
    up to the largest speed, roads and traffic left aside. With ``v₀``, ``a``, ``v_max`` and the time ``t`` to the
    goal's last step the ego covers at most ``v₀t + at²/2``, from ``t₁ = (v_max − v₀)/a`` on at ``v_max``; its speed is
    then within ``v₀ ± at``. What it lets pass is not proven to be reachable.
    """
    obstacles = [_obstacle(condition, ego, vehicle, step_s) for condition in goal.conditions]
    return None if any(obstacle is None for obstacle in obstacles) else next(iter(obstacles), None)


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
