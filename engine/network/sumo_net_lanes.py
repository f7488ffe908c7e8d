"""The lanelets that road vehicles drive on, as lanes: centre line, width, neighbours, and what follows what."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, length_m, without_repeats

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

NARROWEST_LANE_M = 0.5
SHORTEST_LANE_M = 0.05
WIDEST_JOINT_M = 6.0
"""A successor that begins farther away than this is an error of the file, and no vehicle can drive on to it."""

_NOT_FOR_VEHICLES = frozenset({"sidewalk", "crosswalk"})


@dataclass(frozen=True)
class DrivableLane:
    """One lanelet as a lane: centre line (n, 2) in m, and its neighbours of the same direction."""

    lanelet_id: int
    center: Points
    width_m: float
    length_m: float
    left: int | None
    right: int | None


@dataclass(frozen=True)
class LaneTable:
    """All drivable lanes by lanelet id (ascending) and the successor relation among them, made symmetric."""

    lanes: dict[int, DrivableLane]
    successors: dict[int, tuple[int, ...]]

    @cached_property
    def predecessors(self) -> dict[int, tuple[int, ...]]:
        """Lanelets that lead into each lanelet, ascending."""
        found: dict[int, list[int]] = {key: [] for key in self.lanes}
        for key, following in self.successors.items():
            for after in following:
                found[after].append(key)
        return {key: tuple(sorted(before)) for key, before in found.items()}

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "LaneTable":
        """The lanes of a lanelet network; footpaths, rails and degenerate lanelets are left out."""
        drivable = [lanelet for lanelet in network.lanelets if _for_vehicles(lanelet)]
        made = {lanelet.lanelet_id: _lane(lanelet) for lanelet in drivable}
        lanes = {key: lane for key, lane in sorted(made.items()) if lane is not None}
        return cls(lanes, _successors(network, lanes))


def _for_vehicles(lanelet: "Lanelet") -> bool:
    kinds = {str(kind.value) for kind in lanelet.lanelet_type or ()}
    users = {str(user.value) for user in lanelet.user_one_way or ()}
    return not (kinds & _NOT_FOR_VEHICLES) and users not in ({"pedestrian"}, {"train"})


def _lane(lanelet: "Lanelet") -> DrivableLane | None:
    center = without_repeats(np.asarray(lanelet.center_vertices, dtype=float))
    if len(center) < 2 or length_m(center) < SHORTEST_LANE_M:
        return None
    width = float(np.median(np.linalg.norm(lanelet.left_vertices - lanelet.right_vertices, axis=1)))
    return DrivableLane(
        lanelet_id=int(lanelet.lanelet_id),
        center=center,
        width_m=max(width, NARROWEST_LANE_M),
        length_m=length_m(center),
        left=lanelet.adj_left if lanelet.adj_left_same_direction else None,
        right=lanelet.adj_right if lanelet.adj_right_same_direction else None,
    )


def _successors(network: "LaneletNetwork", lanes: dict[int, DrivableLane]) -> dict[int, tuple[int, ...]]:
    pairs = {(lanelet.lanelet_id, after) for lanelet in network.lanelets for after in lanelet.successor}
    pairs |= {(before, lanelet.lanelet_id) for lanelet in network.lanelets for before in lanelet.predecessor}
    found: dict[int, list[int]] = {key: [] for key in lanes}
    for key, after in sorted(pairs):
        if key in lanes and after in lanes and key != after and _joined(lanes[key], lanes[after]):
            found[key].append(after)
    return {key: tuple(following) for key, following in found.items()}


def _joined(lane: DrivableLane, after: DrivableLane) -> bool:
    return float(np.linalg.norm(lane.center[-1] - after.center[0])) < WIDEST_JOINT_M
