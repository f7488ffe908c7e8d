"""The ego of a scenario in words: where it starts, what its goal states, and which way leads there."""

from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.scenarios.ego_route import along, ego_route, goal_centers, goal_lanelets, lanelets_at
from plannerforge.engine.scenarios.road_facts import lanes_beside
from plannerforge.schemas.scenarios import DescribedEgo

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem


def describe_ego(scene: Scene) -> DescribedEgo | None:
    """The planning problem that the scene is about; None where the file has none."""
    if scene.ego is None:
        return None
    problem = scene.loaded.problem(scene.ego.problem_id)
    network, state = scene.network, problem.initial_state
    point = np.asarray(state.position, dtype=float)
    under = lanelets_at(network, point)
    route = ego_route(network, scene.lanelet_graph, problem)
    goals = goal_lanelets(network, problem)
    way = "the goal has no place" if not goals else "no way leads to the goal"
    if route is not None:
        way = f"turns {', then '.join(route.turns)}" if route.turns else "straight on"
        way += ", with a lane change" if route.changes_lane else ""
    return DescribedEgo(
        problem_id=scene.ego.problem_id,
        speed_mps=round(float(state.velocity), 3),
        lanelets=along(network, under, point, float(state.orientation)) or under,
        lanes=max((lanes_beside(network, key) for key in under), default=0),
        goal=goal_words(problem, scene.step_s, point, goals),
        goal_lanelets=goals,
        route=route.lanelets if route else (),
        way=way,
    )


def goal_words(problem: "PlanningProblem", step_s: float, start: Any, lanelets: tuple[int, ...]) -> str:
    """What the goal asks for: place, time, speed and heading, as far as it states them."""
    states = problem.goal.state_list
    if not states:
        return "none stated"
    parts = []
    if lanelets and problem.goal.lanelets_of_goal_position:
        parts.append(f"lanelet {', '.join(map(str, lanelets[:6]))}{' …' if len(lanelets) > 6 else ''}")
    elif centers := goal_centers(problem):
        on = f" on lanelet {', '.join(map(str, lanelets[:3]))}" if lanelets else ""
        parts.append(f"region {float(np.linalg.norm(centers[0] - start)):.0f} m away{on}")
    first = states[0]
    if getattr(first, "time_step", None) is not None:
        parts.append(f"at {_span(first.time_step, step_s)} s")
    if getattr(first, "velocity", None) is not None:
        parts.append(f"{_span(first.velocity, 1.0)} m/s")
    if getattr(first, "orientation", None) is not None:
        parts.append(f"heading {_span(first.orientation, 1.0)} rad")
    more = f" (and {len(states) - 1} more goal states)" if len(states) > 1 else ""
    return ", ".join(parts) + more


def _span(value: Any, factor: float) -> str:
    low, high = getattr(value, "start", value), getattr(value, "end", value)
    return f"{low * factor:.3g}" if low == high else f"{low * factor:.3g}..{high * factor:.3g}"
