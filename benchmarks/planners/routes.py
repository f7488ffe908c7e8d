"""``make bench-routes``: compares our routes on the lanelet graph with those of commonroad-route-planner.

Both plan route and reference path of every planning problem of a folder, alternately in the same process. The peer is
not a dependency of this project; install it with ``pip install --no-deps commonroad-route-planner`` (Python < 3.12).

Keys: ``problems``, and for ``ours`` and ``peer``: ``<who>_found`` (problems with a route), ``<who>_misses_goal``
(routes that touch no lanelet of the goal), ``<who>_median_ms``, ``<who>_p95_ms`` (processor time, the better of two
calls).
"""

import importlib
import logging
import statistics
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.planners.reference_path import BEYOND_GOAL_M, build_reference_path
from plannerforge.engine.scene import find_route, goal_lanelets

from ..harness import percentile_95, print_figures, scenario_arguments, scenario_files

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import LaneletNetwork

    Router = Callable[[LaneletNetwork, PlanningProblem], tuple[int, ...]]
PEER = "commonroad_route_planner.fast_api.fast_api"
CALLS = 2


@dataclass
class _Tally:
    """One router's results: seconds of each route that it found, and the number that miss the goal."""

    seconds: list[float] = field(default_factory=list)
    misses_goal: int = 0


def _ours(network: "LaneletNetwork", problem: "PlanningProblem") -> tuple[int, ...]:
    """Return the lanelets of our route up to the goal; its reference path is built too."""
    start = problem.initial_state
    position = np.asarray(start.position, dtype=float)
    route = find_route(network, problem.goal, position, float(start.orientation), ahead_m=BEYOND_GOAL_M)
    build_reference_path(network, route, position, float(start.velocity))
    return route.lanelets if route.goal_index is None else route.lanelets[: route.goal_index + 1]


def _problems_of(folder: Path, limit: int | None) -> "Iterator[tuple[LaneletNetwork, PlanningProblem]]":
    """Yield every planning problem of every file of a folder with its network."""
    for path in scenario_files(folder, limit):
        loaded = read_scenario(path)
        for problem in loaded.planning_problems.planning_problem_dict.values():
            yield loaded.scenario.lanelet_network, problem


def _routed(router: "Router", network: "LaneletNetwork", problem: "PlanningProblem", tally: _Tally) -> None:
    """Plan and record the result; no route is an outcome."""
    spent = []
    try:
        for _ in range(CALLS):
            began = time.process_time()
            lanelets = router(network, problem)
            spent.append(time.process_time() - began)
    except Exception:  # noqa: BLE001 - the peer raises anything where it finds no route
        return
    tally.seconds.append(min(spent))
    goals = goal_lanelets(network, problem.goal) if problem.goal.state_list else None
    tally.misses_goal += bool(goals) and not set(goals or ()) & set(lanelets)


def _measure(folder: Path, limit: int | None) -> None:
    try:
        plan = importlib.import_module(PEER).generate_reference_path_from_lanelet_network_and_planning_problem
    except ModuleNotFoundError as error:
        sys.exit(f"{error}: pip install --no-deps commonroad-route-planner into this environment")
    routers: dict[str, Router] = {
        "ours": _ours,
        "peer": lambda network, problem: tuple(plan(network, problem).lanelet_ids),
    }
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    tallies = {who: _Tally() for who in routers}
    figures: dict[str, float | int] = {"problems": 0}
    for network, problem in _problems_of(folder, limit):
        figures["problems"] += 1
        for who, router in routers.items():
            _routed(router, network, problem, tallies[who])
    for who, tally in tallies.items():
        figures |= {
            f"{who}_found": len(tally.seconds),
            f"{who}_misses_goal": tally.misses_goal,
            f"{who}_median_ms": round(1000 * statistics.median(tally.seconds), 2),
            f"{who}_p95_ms": round(1000 * percentile_95(tally.seconds), 2),
        }
    print_figures("Routes", figures)


if __name__ == "__main__":
    _measure(*scenario_arguments(__doc__))
