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
ROUND_ABOUT = 2.0
"""A place that is so many times farther along the lane than straight across is told by both distances."""

SAME_RAD = math.radians(45.0)
OPPOSITE_RAD = math.radians(135.0)
ALONGSIDE_M = 3.0
OWN, ONCOMING = "same lane", "oncoming"


@dataclass(frozen=True)
class Where:
    """Words, distance along the ego's lane (ahead positive; None off its road), and the gap in the ego's lane."""

    words: str
    ahead_m: float | None
    gap_m: float | None

    @property
    def in_lane(self) -> bool:
        """Whether it is in the ego's own lane."""
        return self.gap_m is not None


@dataclass(frozen=True)
class EgoLane:
    """The lane that the ego follows: its centre line from behind the ego to far ahead, and the lanes beside it.

    ``beside``: lanelet → lanes to the left of the ego's (right negative) in the same direction; 0 is its own.
    """

    network: "LaneletNetwork"
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
        """The lane through the start lanelet, along the route and then straight on; behind, the straightest ones."""
        ahead, chosen = path_ahead(network, graph, start, route, AHEAD_M)
        behind, before = _backwards(network, graph, start)
        line = without_repeats(np.vstack([behind, ahead])) if len(behind) else ahead
        beside = _lanes_beside(network, (*before, *chosen))
        return cls(network, line, project(line, pose[0])[0], pose[0], pose[1], beside)

    def where(self, track: Track, index: int, lanelet: int | None) -> Where:
        """Where the track is at an index of its arrays."""
        point, heading = track.positions[index], float(track.headings_rad[index])
        station, offset = project(self.line, point)
        ahead = station - self.here_m
        round_about = abs(ahead) > max(ALONGSIDE_M, ROUND_ABOUT * float(np.linalg.norm(point - self.position)))
        lane = self._lane(track, index, lanelet, (station, offset))
        if lane is None or (round_about and lane == ONCOMING):
            return Where(self._elsewhere(point, heading), None, None)
        if round_about:
            return Where(f"{self._elsewhere(point, heading)}, {_along(ahead)} along the lane", round(ahead, 1), None)
        gap = abs(ahead) - (track.length_m + EGO_LENGTH_M) / 2 if lane == OWN else None
        return Where(f"{_along(ahead)}, {lane}", round(ahead, 1), None if gap is None else round(gap, 1))

    def _lane(self, track: Track, index: int, lanelet: int | None, at: tuple[float, float]) -> str | None:
        """The lane that somebody is in, at an arc length and an offset of the line; None on another road."""
        station, offset = at
        if lanelet not in self.beside and not 0.5 < station < arc_length(self.line)[-1] - 0.5:
            return None
        turned = abs(wrap_angle(float(track.headings_rad[index]) - point_at(self.line, station)[1]))
        if turned > OPPOSITE_RAD and abs(offset) < 15.0:
            return ONCOMING
        if turned > SAME_RAD:
            return None
        lanes = self.beside.get(lanelet) if lanelet is not None else None
        if lanelet is None or lanes is None:
            return OWN if abs(offset) <= LANE_HALF_WIDTH_M else None
        if lanes == 0:
            return self._outside(lanelet, offset) if outside_lane(self.network, lanelet, track, index) else OWN
        side = "left" if lanes > 0 else "right"
        return f"{side} lane" if abs(lanes) == 1 else f"{abs(lanes)} lanes to the {side}"

    def _outside(self, lanelet: int, offset: float) -> str:
        """What somebody is on who drives along a lane outside of it."""
        lane = self.network.find_lanelet_by_id(lanelet)
        beside = lane.adj_left if offset > 0 else lane.adj_right
        same = lane.adj_left_same_direction if offset > 0 else lane.adj_right_same_direction
        side = "left" if offset > 0 else "right"
        if beside is None:
            return f"{side} of the lane"
        return f"{side} lane" if same else "in the oncoming lane"

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


def outside_lane(network: "LaneletNetwork", lanelet: int, track: Track, index: int) -> bool:
    """Whether a vehicle is beside a lanelet with its whole width, as one that overtakes on the oncoming lane."""
    lane, line, point = network.find_lanelet_by_id(lanelet), center_line(network, lanelet), track.positions[index]
    nearest = int(np.argmin(np.linalg.norm(lane.center_vertices - point, axis=1)))
    width = float(np.linalg.norm(lane.left_vertices[nearest] - lane.right_vertices[nearest]))
    station, offset = project(line, point)
    return 0.0 < station < float(arc_length(line)[-1]) and abs(offset) > (width + track.width_m) / 2


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
        current = min(before, key=lambda key: (_bend(network, key, current), key))
        chosen.append(current)
        parts.insert(0, center_line(network, current))
        total += graph.length_m[current]
    return (np.vstack(parts) if parts else np.zeros((0, 2))), tuple(chosen)


def _bend(network: "LaneletNetwork", before: int, after: int) -> float:
    """Angle in rad between the course of a lanelet and the beginning of one that follows it."""
    first, second = center_line(network, before), center_line(network, after)
    if len(first) < 2 or len(second) < 2:
        return math.inf
    arriving, leaving = first[-1] - first[0], second[1] - second[0]
    return abs(wrap_angle(math.atan2(*arriving[::-1]) - math.atan2(*leaving[::-1])))


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
