"""Searches directed graphs, and provides the graph of a lanelet network.

The searches are our own. Among equally cheap routes, they take the one with the lower node ids, regardless of the order
in the file; networkx takes the first route that it finds, and scipy's csgraph does not specify which one it takes. On
straight roads, an early lane change costs as much as a late one, so routes would vary, and so would everything computed
along them.
"""

import heapq
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from ..geometry import length_m

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

LANE_CHANGE_COST_M = 20.0
"""Chosen: a lane change costs as much as 20 m of road, so that routes change lanes only if they must."""

_Node = TypeVar("_Node", int, str)


@dataclass(frozen=True)
class Digraph(Generic[_Node]):
    """A directed graph: a function returns the successors of a node, each with its non-negative cost."""

    steps_from: Callable[[_Node], Iterable[tuple[_Node, float]]]

    def cheapest_route(self, starts: Iterable[_Node], goals: Iterable[_Node]) -> tuple[_Node, ...] | None:
        """Return the cheapest route from any start to any goal, both included, or None if there is none."""
        wanted = frozenset(goals)
        came_from: dict[_Node, _Node] = {}
        for node, _ in self._by_cost(dict.fromkeys(starts, 0.0), came_from):
            if node in wanted:
                return _route_to(node, came_from)
        return None

    def costs(self, starts: Mapping[_Node, float], at_most: float = math.inf) -> dict[_Node, float]:
        """Return the lowest cost of every node up to a limit; ``starts`` maps the first nodes to their costs."""
        costs: dict[_Node, float] = {}
        for node, cost in self._by_cost(starts, {}):
            if cost > at_most:
                break
            costs[node] = cost
        return costs

    def fewest_steps_route(self, start: _Node, goal: _Node) -> tuple[_Node, ...] | None:
        """Return the route with the fewest nodes, both ends included, or None if there is none.

        In a tie, it takes the route with nodes that come earlier in the order of the steps.
        """
        came_from: dict[_Node, _Node] = {}
        for node, _ in self._by_steps([start], came_from):
            if node == goal:
                return _route_to(goal, came_from)
        return None

    def reachable(self, starts: Iterable[_Node]) -> dict[_Node, int]:
        """Return the fewest steps to each reachable node, nearest node first, including the starts."""
        return dict(self._by_steps(starts, {}))

    def _by_cost(self, starts: Mapping[_Node, float], came_from: dict[_Node, _Node]) -> Iterator[tuple[_Node, float]]:
        """Yield nodes with their costs, cheapest first; at equal cost, the lower id comes first (Dijkstra)."""
        best = dict(starts)
        queue = [(cost, node) for node, cost in best.items()]
        heapq.heapify(queue)
        while queue:
            cost, node = heapq.heappop(queue)
            if cost > best[node]:
                continue
            yield node, cost
            for following, step_cost in self.steps_from(node):
                if cost + step_cost < best.get(following, math.inf):
                    best[following] = cost + step_cost
                    came_from[following] = node
                    heapq.heappush(queue, (cost + step_cost, following))

    def _by_steps(self, starts: Iterable[_Node], came_from: dict[_Node, _Node]) -> Iterator[tuple[_Node, int]]:
        """Yield each reachable node with the fewest steps to it, nearest first."""
        steps = dict.fromkeys(starts, 0)
        queue = deque(steps)
        while queue:
            node = queue.popleft()
            yield node, steps[node]
            for following, _ in self.steps_from(node):
                if following not in steps:
                    steps[following] = steps[node] + 1
                    came_from[following] = node
                    queue.append(following)


def _route_to(goal: _Node, came_from: Mapping[_Node, _Node]) -> tuple[_Node, ...]:
    route = [goal]
    while route[-1] in came_from:
        route.append(came_from[route[-1]])
    return tuple(reversed(route))


@dataclass(frozen=True)
class LaneletGraph:
    """Lanelet ids with their lengths in m, successors, predecessors and neighbours of the same direction, ascending.

    A step leads to every successor and, by a lane change, to the neighbour on either side.
    """

    length_m: dict[int, float]
    successors: dict[int, tuple[int, ...]]
    predecessors: dict[int, tuple[int, ...]]
    neighbours: dict[int, tuple[int, ...]]

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "LaneletGraph":
        """Return the graph of a network; references to missing lanelets are left out."""
        lanelets = {
            lanelet.lanelet_id: lanelet for lanelet in sorted(network.lanelets, key=lambda lane: lane.lanelet_id)
        }
        return cls(
            length_m={key: length_m(lanelet.center_vertices) for key, lanelet in lanelets.items()},
            successors={key: _known(lanelet.successor, lanelets) for key, lanelet in lanelets.items()},
            predecessors={key: _known(lanelet.predecessor, lanelets) for key, lanelet in lanelets.items()},
            neighbours={key: _known(_neighbour_ids(lanelet), lanelets) for key, lanelet in lanelets.items()},
        )

    def shortest_route(self, starts: Iterable[int], goals: Iterable[int]) -> tuple[int, ...] | None:
        """Return the cheapest route by length and lane changes, including its start and goal, or None."""
        return Digraph(self._steps_from).cheapest_route(starts, goals)

    def reachable(self, starts: Iterable[int]) -> dict[int, int]:
        """Return the fewest steps to each reachable lanelet, nearest lanelet first, including the starts."""
        return Digraph(lambda key: sorted(self._steps_from(key))).reachable(starts)

    def parallel_lanes(self, starts: Iterable[int]) -> frozenset[int]:
        """Return the lanelets that can be reached by lane changes alone, including the starts."""
        changes = Digraph(lambda key: ((other, LANE_CHANGE_COST_M) for other in self.neighbours.get(key, ())))
        return frozenset(changes.reachable(starts))

    def _steps_from(self, lanelet_id: int) -> list[tuple[int, float]]:
        onward = [(key, self.length_m[lanelet_id]) for key in self.successors.get(lanelet_id, ())]
        return onward + [(key, LANE_CHANGE_COST_M) for key in self.neighbours.get(lanelet_id, ())]


def _known(ids: Iterable[int | None], lanelets: dict[int, "Lanelet"]) -> tuple[int, ...]:
    return tuple(sorted({key for key in ids if key is not None and key in lanelets}))


def _neighbour_ids(lanelet: "Lanelet") -> list[int | None]:
    left = lanelet.adj_left if lanelet.adj_left_same_direction else None
    right = lanelet.adj_right if lanelet.adj_right_same_direction else None
    return [left, right]
