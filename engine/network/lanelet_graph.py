"""The graph of a lanelet network: what can be reached from where, and by which lanelets.

An edge leads to every successor, and to the neighbour of the same direction on either side (a lane change).
"""

import heapq
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..geometry import length_m

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

LANE_CHANGE_COST_M = 20.0
"""A lane change counts as so many metres, so that routes change lanes only where they must."""


@dataclass(frozen=True)
class LaneletGraph:
    """Lanelet ids with their lengths, successors, predecessors and neighbours of the same direction."""

    length_m: dict[int, float]
    successors: dict[int, tuple[int, ...]]
    predecessors: dict[int, tuple[int, ...]]
    neighbours: dict[int, tuple[int, ...]]

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "LaneletGraph":
        """The graph of a network; references to lanelets that do not exist are left out."""
        lanelets = {lanelet.lanelet_id: lanelet for lanelet in network.lanelets}
        return cls(
            length_m={key: length_m(lanelet.center_vertices) for key, lanelet in sorted(lanelets.items())},
            successors={k: _known(lanelet.successor, lanelets) for k, lanelet in sorted(lanelets.items())},
            predecessors={k: _known(lanelet.predecessor, lanelets) for k, lanelet in sorted(lanelets.items())},
            neighbours={k: _known(_beside(lanelet), lanelets) for k, lanelet in sorted(lanelets.items())},
        )

    def shortest_route(self, starts: Iterable[int], goals: Iterable[int]) -> tuple[int, ...] | None:
        """The cheapest way from any start to any goal lanelet, both included; None where there is none."""
        wanted = frozenset(goals)
        best: dict[int, float] = dict.fromkeys(starts, 0.0)
        came_from: dict[int, int] = {}
        queue = [(0.0, start) for start in sorted(best)]
        heapq.heapify(queue)
        while queue:
            cost, current = heapq.heappop(queue)
            if cost > best[current]:
                continue
            if current in wanted:
                return self._walk_back(current, came_from)
            for following, step_cost in self._steps(current):
                if cost + step_cost < best.get(following, float("inf")):
                    best[following] = cost + step_cost
                    came_from[following] = current
                    heapq.heappush(queue, (cost + step_cost, following))
        return None

    def reachable(self, starts: Iterable[int]) -> frozenset[int]:
        """All lanelets that can be reached from the starts, themselves included."""
        found = set(starts)
        waiting = list(found)
        while waiting:
            for following, _ in self._steps(waiting.pop()):
                if following not in found:
                    found.add(following)
                    waiting.append(following)
        return frozenset(found)

    def beside(self, starts: Iterable[int]) -> frozenset[int]:
        """The lanelets that lane changes alone lead to, the starts included."""
        found = set(starts)
        waiting = list(found)
        while waiting:
            new = set(self.neighbours.get(waiting.pop(), ())) - found
            found |= new
            waiting.extend(new)
        return frozenset(found)

    def _steps(self, lanelet_id: int) -> list[tuple[int, float]]:
        onward = [(key, self.length_m[lanelet_id]) for key in self.successors.get(lanelet_id, ())]
        return onward + [(key, LANE_CHANGE_COST_M) for key in self.neighbours.get(lanelet_id, ())]

    @staticmethod
    def _walk_back(goal: int, came_from: dict[int, int]) -> tuple[int, ...]:
        route = [goal]
        while route[-1] in came_from:
            route.append(came_from[route[-1]])
        return tuple(reversed(route))


def _known(ids: Iterable[int | None], lanelets: dict[int, "Lanelet"]) -> tuple[int, ...]:
    return tuple(sorted({key for key in ids if key is not None and key in lanelets}))


def _beside(lanelet: "Lanelet") -> list[int | None]:
    left = lanelet.adj_left if lanelet.adj_left_same_direction else None
    right = lanelet.adj_right if lanelet.adj_right_same_direction else None
    return [left, right]
