"""Routes of SUMO edges for sequences of lanelets.

A recording gives lanelets, with gaps and lanelets inside junctions; SUMO needs connected edges. A *path* leads through
a junction, from the lanelet before it to the lanelet after it (``NetLayout.paths``).
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from ..network import Digraph, NetLayout
from .map_matching import straightness

_EXTENSION_M = 2000.0
"""How far a route is continued (chosen): 40 s at 50 m/s, longer than scenarios last."""
_TURNS_BACK = math.cos(math.radians(150.0))
"""A U-turn is driven only if no other lane leads on (chosen), because most cars hardly manage it."""
_LONGEST_REPAIR_EDGES = 6
"""A gap in a recording is closed by at most this many edges, including its ends (chosen): a longer one is a detour."""


@dataclass(frozen=True)
class EdgeGraph:
    """The successors of edges, and routes for lanelets."""

    layout: NetLayout

    @cached_property
    def successors(self) -> dict[str, tuple[str, ...]]:
        """The edges that a path leads to from each edge, sorted, by edge id."""
        following: dict[str, set[str]] = {edge: set() for edge in self.layout.edges}
        for path in self.layout.paths:
            following[self.layout.lane_of[path.entry][0]].add(self.layout.lane_of[path.exit][0])
        return {edge: tuple(sorted(after)) for edge, after in following.items()}

    @cached_property
    def _graph(self) -> Digraph[str]:
        return Digraph(lambda edge: ((after, 1.0) for after in self.successors[edge]))

    @cached_property
    def paths_from(self) -> dict[int, tuple[int, ...]]:
        """The indices of the paths that leave each lanelet, by lanelet id."""
        leaving: dict[int, list[int]] = {}
        for index, path in enumerate(self.layout.paths):
            leaving.setdefault(path.entry, []).append(index)
        return {key: tuple(indices) for key, indices in leaving.items()}

    def route(self, lanelets: Sequence[int]) -> tuple[str, ...] | None:
        """Return the edges for a drive over lanelets, from the edge into the first to the edge after the last.

        Gaps are closed with as few edges as possible; the result is None if that takes too many.
        """
        edges: list[str] = []
        for edge in self._edges_of(lanelets):
            if not edges or edge == edges[-1]:
                edges = edges or [edge]
                continue
            between = self._graph.fewest_steps_route(edges[-1], edge)
            if between is None or len(between) > _LONGEST_REPAIR_EDGES:
                return None
            edges += between[1:]
        return tuple(edges) or None

    def first_gap(self, lanelets: Sequence[int]) -> tuple[int, int] | None:
        """Return the first two consecutive lanelets of a drive that are not connected, or None."""
        if self.route(lanelets) is not None:
            return None
        broken = (pair for pair in pairwise(lanelets) if self.route(pair) is None)
        return next(broken, (lanelets[0], lanelets[-1]))

    def extended(self, edges: Sequence[str], last_lanelet: int | None = None) -> tuple[str, ...]:
        """Return the route continued straight ahead, so that a vehicle does not stop where its recording ends.

        ``last_lanelet``: the lane in which the vehicle arrives; the route continues from this lane if it leads onwards
        and not back.
        """
        route, total, lanelet = list(edges), 0.0, last_lanelet
        while total < _EXTENSION_M:
            lanes = self.layout.edges[route[-1]]
            own = self._straightest([lanelet], route) if lanelet in lanes else None
            if own is None or self._straightness(own) < _TURNS_BACK:
                own = self._straightest(lanes, route)
            if own is None:
                break
            lanelet = self.layout.paths[own].exit
            route.append(self.layout.lane_of[lanelet][0])
            total += self.layout.table.lanes[lanelet].length_m
        return tuple(route)

    def straight_on(self, lanelet_id: int) -> tuple[int, ...]:
        """Return a route's continuation after a lanelet, through a junction and beyond it; empty at the end."""
        successors = self.layout.table.successors[lanelet_id]
        index = self._straightest([lanelet_id], ())
        if index is None:
            return successors if len(successors) == 1 else ()
        path = self.layout.paths[index]
        return (*path.through, path.exit)

    def _straightest(self, lanelets: Iterable[int], route: Collection[str]) -> int | None:
        """Return the index of the straightest path from the given lanelets to an edge off a route, or None."""
        leaving = [index for key in lanelets for index in self.paths_from.get(key, ())]
        onward = [index for index in leaving if self.layout.lane_of[self.layout.paths[index].exit][0] not in route]
        return max(onward, key=lambda index: (self._straightness(index), -index), default=None)

    def path_for(self, lanelet_id: int, edges: Sequence[str]) -> int | None:
        """Return the index of the path that uses an internal lanelet and fits a route best; None if no path uses it."""
        paths = self.layout.paths_through.get(lanelet_id, ())
        return max(paths, key=lambda index: (self._fit(index, edges), -index)) if paths else None

    def _fit(self, index: int, edges: Sequence[str]) -> int:
        path = self.layout.paths[index]
        return (self.layout.lane_of[path.entry][0] in edges) + (self.layout.lane_of[path.exit][0] in edges)

    def _straightness(self, index: int) -> float:
        path, lanes = self.layout.paths[index], self.layout.table.lanes
        return straightness(lanes[path.entry].center, lanes[path.exit].center)

    def _edges_of(self, lanelets: Sequence[int]) -> list[str]:
        lane_of = self.layout.lane_of
        outside = [lane_of[key][0] for key in lanelets if key in lane_of]
        first, last = lanelets[0], lanelets[-1]
        before = self._end_edge(first, [*outside, *self._inside_exits(lanelets)], entry=True)
        after = self._end_edge(last, [*before, *outside], entry=False)
        return [*before, *outside, *after]

    def _inside_exits(self, lanelets: Sequence[int]) -> list[str]:
        """Return the exits of paths through all leading internal lanelets, which separate paths with equal starts."""
        inside: list[int] = []
        for key in lanelets:
            if key in self.layout.lane_of:
                break
            inside.append(key)
        exits = [
            self.layout.lane_of[path.exit][0]
            for path in self.layout.paths
            if inside and set(inside) <= set(path.through)
        ]
        return sorted(set(exits))

    def _end_edge(self, lanelet_id: int, edges: Sequence[str], *, entry: bool) -> list[str]:
        """Return the edge before (entry) or after a lanelet inside a junction; empty for a lanelet outside."""
        if lanelet_id in self.layout.lane_of:
            return []
        index = self.path_for(lanelet_id, edges)
        if index is None:
            return []
        path = self.layout.paths[index]
        return [self.layout.lane_of[path.entry if entry else path.exit][0]]
