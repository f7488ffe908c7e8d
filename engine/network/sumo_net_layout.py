"""The plan of a SUMO network over a lanelet network: which lanelet is which lane, edge or way through a junction."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from plannerforge.engine.network.sumo_net_edges import group_into_edges
from plannerforge.engine.network.sumo_net_junctions import JunctionInterior, JunctionPath, find_interior, find_paths
from plannerforge.engine.network.sumo_net_lanes import LaneTable

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork


@dataclass(frozen=True)
class NetLayout:
    """The mapping lanelet ↔ SUMO edge and lane, fixed before anything is written.

    ``edges``: edge id → lanelets from right to left. ``ends``: edge id → (from junction, to junction).
    ``links``: junction id → indices into ``paths`` in the order of SUMO's links at that junction.
    """

    table: LaneTable
    interior: JunctionInterior
    edges: dict[str, tuple[int, ...]]
    paths: tuple[JunctionPath, ...]
    ends: dict[str, tuple[str, str]]
    links: dict[str, tuple[int, ...]]

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "NetLayout":
        """Lay out a lanelet network; depends on the network alone, never on the order of sets."""
        table = LaneTable.of(network)
        interior = find_interior(table, network)
        edges = group_into_edges(table, interior.lanelets)
        paths = find_paths(table, interior.lanelets)
        lane_of = _lanes_by_lanelet(edges)
        ends = _junctions(edges, paths, lane_of, interior)
        return cls(table, interior, edges, paths, ends, _links(edges, paths, lane_of, ends))

    @cached_property
    def lane_of(self) -> dict[int, tuple[str, int]]:
        """Lanelet outside junctions → its edge and lane index."""
        return _lanes_by_lanelet(self.edges)

    @cached_property
    def internal_edge_of_path(self) -> dict[int, str]:
        """Index of a path → the id of its internal edge, ``:junction_link``."""
        return {
            path: f":{junction}_{link}" for junction, paths in self.links.items() for link, path in enumerate(paths)
        }

    @cached_property
    def paths_through(self) -> dict[int, tuple[int, ...]]:
        """Lanelet inside a junction → indices of the paths that use it."""
        found: dict[int, list[int]] = {}
        for index, path in enumerate(self.paths):
            for key in path.through:
                found.setdefault(key, []).append(index)
        return {key: tuple(indices) for key, indices in found.items()}

    @cached_property
    def incoming_lanes(self) -> dict[str, tuple[tuple[str, int], ...]]:
        """Junction → the lanes that lead into it, in SUMO's order."""
        found: dict[str, list[tuple[str, int]]] = {junction: [] for junction in self.links}
        for edge, (_, junction) in self.ends.items():
            found[junction] += [(edge, lane) for lane in range(len(self.edges[edge]))]
        return {junction: tuple(lanes) for junction, lanes in found.items()}

    @cached_property
    def lanelets_of_lane(self) -> dict[str, tuple[int, ...]]:
        """SUMO lane id → the lanelets that it covers (several only inside junctions; none for a mere joint)."""
        normal = {f"{edge}_{lane}": (key,) for key, (edge, lane) in self.lane_of.items()}
        internal = {f"{edge}_0": self.paths[path].through for path, edge in self.internal_edge_of_path.items()}
        return normal | internal


def _lanes_by_lanelet(edges: Mapping[str, tuple[int, ...]]) -> dict[int, tuple[str, int]]:
    return {key: (edge, lane) for edge, keys in edges.items() for lane, key in enumerate(keys)}


def _junctions(
    edges: Mapping[str, tuple[int, ...]],
    paths: tuple[JunctionPath, ...],
    lane_of: Mapping[int, tuple[str, int]],
    interior: JunctionInterior,
) -> dict[str, tuple[str, str]]:
    """From and to junction of every edge: ends that a path joins, or whose paths cross, are one junction."""
    groups = _Groups()
    first_use: dict[int, str] = {}
    for path in paths:
        entry = lane_of[path.entry][0]
        groups.join((entry, "end"), (lane_of[path.exit][0], "start"))
        for key in path.through:
            first_use.setdefault(key, entry)
    for key, others in sorted(interior.crossings.items()):
        for other in sorted(others):
            if key in first_use and other in first_use:
                groups.join((first_use[key], "end"), (first_use[other], "end"))
    names: dict[Hashable, str] = {}
    return {
        edge: (
            names.setdefault(groups.root((edge, "start")), f"n{len(names)}"),
            names.setdefault(groups.root((edge, "end")), f"n{len(names)}"),
        )
        for edge in edges
    }


def _links(
    edges: Mapping[str, tuple[int, ...]],
    paths: tuple[JunctionPath, ...],
    lane_of: Mapping[int, tuple[str, int]],
    ends: Mapping[str, tuple[str, str]],
) -> dict[str, tuple[int, ...]]:
    by_lane: dict[tuple[str, int], list[int]] = {}
    for index, path in enumerate(paths):
        by_lane.setdefault(lane_of[path.entry], []).append(index)
    links: dict[str, list[int]] = {}
    for start, end in ends.values():
        links.setdefault(start, [])
        links.setdefault(end, [])
    for edge, (_, junction) in ends.items():
        for lane in range(len(edges[edge])):
            links[junction] += by_lane.get((edge, lane), [])
    return {junction: tuple(found) for junction, found in links.items()}


class _Groups:
    """Disjoint sets with path halving."""

    def __init__(self) -> None:
        self._parent: dict[Hashable, Hashable] = {}

    def root(self, member: Hashable) -> Hashable:
        self._parent.setdefault(member, member)
        while self._parent[member] != member:
            self._parent[member] = self._parent[self._parent[member]]
            member = self._parent[member]
        return member

    def join(self, first: Hashable, second: Hashable) -> None:
        self._parent[self.root(first)] = self.root(second)
