"""The line along the ego's lane and route, from the start of a planning problem."""

from typing import TYPE_CHECKING

from ....schemas.errors import NotPossible
from ...commonroad import MadeOnce
from ...geometry import Points
from ...vehicles import VehicleParameters
from ..goal import Goal, path_to, select_goal_state
from ..interface import EgoState
from ..reference_path import BEYOND_GOAL_M

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.scenario import Scenario

_ON_M = 300.0
"""Length of a route if its goal has no position: 10 s at 30 m/s."""


def lane_line(
    scenario: "Scenario", problem: "PlanningProblem", vehicle: VehicleParameters, made: MadeOnce | None = None
) -> Points | None:
    """Return the reference path of a planning problem, shape (n, 2), or None if no route leads to its goal.

    ``made``: stores the paths of the scenario's planning problems.
    """
    if made is None:
        return _lane_line(scenario, problem, vehicle)
    network, goal, ego = scenario.lanelet_network, problem.goal, EgoState.of(problem.initial_state)
    key = ("lane line", id(network), id(goal), ego.key, vehicle, float(scenario.dt))
    return made.get(key, lambda: _lane_line(scenario, problem, vehicle), network, goal)


def _lane_line(scenario: "Scenario", problem: "PlanningProblem", vehicle: VehicleParameters) -> Points | None:
    if not problem.goal.state_list:
        return None
    ego, network = EgoState.of(problem.initial_state), scenario.lanelet_network
    aim = select_goal_state(network, problem.goal, ego, vehicle, float(scenario.dt))
    try:
        return path_to(Goal(aim), aim, network, ego, ahead_m=_ON_M, beyond_m=BEYOND_GOAL_M).points
    except NotPossible:
        return None
