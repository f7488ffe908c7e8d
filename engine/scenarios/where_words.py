"""Where a vehicle is, relative to the ego, in words that a driver would use."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, point_at, project, without_repeats, wrap_angle
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.scenarios.ego_route import center_line, path_ahead
from plannerforge.engine.scenarios.tracks import Track

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

AHEAD_M = 300.0
BEHIND_M = 150.0
EGO_LENGTH_M = 4.508
LANE_HALF_WIDTH_M = 1.75
SAME_RAD = math.radians(45.0)
OPPOSITE_RAD = math.radians(135.0)
ALONGSIDE_M = 3.0


@dataclass(frozen=True)
class Where:
    """Words, distance along the ego's lane (ahead positive; None off its road), and the gap in the ego's lane."""

    words: str
    ahead_m: float | None
    gap_m: float | None


@dataclass(frozen=True)
class EgoLane:
    """The lane that the ego follows: its centre line from behind the ego to far ahead, and the lanes beside it.

    ``beside``: lanelet → lanes to the left of the ego's (right negative) in the same direction; 0 is its own.
    """

    line: Points
    here_m: float
    position: Points
    heading_rad: float
    beside: dict[int, int]

    @classmethod
    def of(
        cls,
        network: "LaneletNetwork",
        graph: LaneletGraph,
        start: int,
        route: tuple[int, ...],
        pose: tuple[Points, float],
    ) -> "EgoLane":
        """The lane through the start lanelet, along the route and then straight on; behind, first predecessors."""
        ahead, chosen = path_ahead(network, graph, start, route, AHEAD_M)
        behind, before = _backwards(network, graph, start)
        line = without_repeats(np.vstack([behind, ahead])) if len(behind) else ahead
        beside = _lanes_beside(network, (*before, *chosen))
        return cls(line, project(line, pose[0])[0], pose[0], pose[1], beside)

    def where(self, track: Track, index: int, lanelet: int | None) -> Where:
        """Where the track is at an index of its arrays."""
        point, heading = track.positions[index], float(track.headings_rad[index])
        station, offset = project(self.line, point)
        turned = abs(wrap_angle(heading - point_at(self.line, station)[1]))
        lane = self._lane(lanelet, offset, turned)
        on_line = 0.5 < station < arc_length(self.line)[-1] - 0.5
        if lane is None or not on_line:
            return Where(self._elsewhere(point, heading), None, None)
        ahead = station - self.here_m
        along = _along(ahead)
        gap = abs(ahead) - (track.length_m + EGO_LENGTH_M) / 2 if lane == "same lane" else None
        return Where(f"{along}, {lane}", round(ahead, 1), None if gap is None else round(gap, 1))

    def _lane(self, lanelet: int | None, offset: float, turned: float) -> str | None:
        if turned > OPPOSITE_RAD and abs(offset) < 15.0:
            return "oncoming"
        if turned > SAME_RAD:
            return None
        lanes = self.beside.get(lanelet) if lanelet is not None else None
        if lanes is None:
            if abs(offset) > LANE_HALF_WIDTH_M:
                return None
            lanes = 0
        if lanes == 0:
            return "same lane"
        side = "left" if lanes > 0 else "right"
        return f"{side} lane" if abs(lanes) == 1 else f"{abs(lanes)} lanes to the {side}"

    def _elsewhere(self, point: Points, heading: float) -> str:
        step = point - self.position
        distance = float(np.linalg.norm(step))
        bearing = wrap_angle(math.atan2(step[1], step[0]) - self.heading_rad)
        turned = wrap_angle(heading - self.heading_rad)
        motion = "coming the other way"
        if abs(turned) < SAME_RAD:
            motion = "same direction, another road"
        elif abs(turned) < OPPOSITE_RAD:
            motion = f"heading to the {'left' if turned > 0 else 'right'}"
        return f"{distance:.0f} m {_bearing(bearing)}, {motion}"


def _along(ahead_m: float) -> str:
    if abs(ahead_m) < ALONGSIDE_M:
        return "alongside"
    return f"{abs(ahead_m):.0f} m {'ahead' if ahead_m > 0 else 'behind'}"


def _bearing(angle_rad: float) -> str:
    names = ("ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right")
    return names[round(angle_rad / (math.pi / 4)) % 8]


def _backwards(network: "LaneletNetwork", graph: LaneletGraph, start: int) -> tuple[Points, tuple[int, ...]]:
    chosen: list[int] = []
    parts: list[Points] = []
    total, current = 0.0, start
    while total < BEHIND_M:
        before = [key for key in graph.predecessors[current] if key != start and key not in chosen]
        if not before:
            break
        current = before[0]
        chosen.append(current)
        parts.insert(0, center_line(network, current))
        total += graph.length_m[current]
    return (np.vstack(parts) if parts else np.zeros((0, 2))), tuple(chosen)


def _lanes_beside(network: "LaneletNetwork", own: tuple[int, ...]) -> dict[int, int]:
    found = dict.fromkeys(own, 0)
    for key in own:
        for sign in (1, -1):
            lane, count = network.find_lanelet_by_id(key), 0
            while lane is not None and abs(count) < 8:
                beside = lane.adj_left if sign > 0 else lane.adj_right
                same = lane.adj_left_same_direction if sign > 0 else lane.adj_right_same_direction
                if beside is None or not same:
                    break
                count += sign
                found.setdefault(int(beside), count)
                lane = network.find_lanelet_by_id(beside)
    return found
