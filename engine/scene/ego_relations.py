"""The vehicles around the ego: which are ahead and behind along its lane, and descriptions of their positions.

In edits and descriptions, ``lead`` and ``follow`` are the vehicles of :func:`leader_and_follower`. A vehicle counts if
it is on the ego's lanelet, on any successor (on every branch) or on any predecessor. It also counts if it is on another
lanelet but in the ego's lane. :class:`EgoLane` describes where a vehicle is in a driver's words.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..commonroad import Track
from ..geometry import Points, arc_length, point_at, project, without_repeats, wrap_angle
from ..network import Digraph, LaneletGraph
from ..vehicles import STANDING_MPS
from .poses import lanelets_of_pose
from .routing import center_line, goal_center_lanelets, path_ahead, straightest_behind
from .scene import NOT_DRIVEN, Ego, Scene

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

_LOOK_M = 300.0
"""Search distance along lanelets (chosen): vehicles farther ahead do not matter to the ego."""
_SAME_PLACE_M, _SAME_SPEED_MPS, _SAME_HEADING_RAD = 0.5, 1.0, math.radians(10.0)
"""A track that starts within these of the ego's start is the ego's own recording (chosen: rounding in files)."""


def leader_and_follower(scene: Scene, ego: Ego) -> tuple[int | None, int | None]:
    """Return the nearest vehicles ahead and behind along the ego's lane; None if there is no such vehicle.

    Distances are along the centre lines, at the ego's first time step; the search along lanelets ends after 300 m. A
    vehicle that is overtaking next to the lane and the ego's own recording do not count.
    """
    gaps = [*_gaps_along_lanelets(scene, ego), *_gaps_in_lane(scene, ego)]
    ahead = [(gap, key) for key, gap in gaps if gap > 0.0]
    behind = [(-gap, key) for key, gap in gaps if gap <= 0.0]
    return min(ahead)[1] if ahead else None, min(behind)[1] if behind else None


def ego_lane(scene: Scene, ego: Ego) -> "EgoLane | None":
    """Return the lane from the ego's start along its route to its goal, extended straight at both ends.

    The result is None if the ego does not start on a lanelet.
    """
    network = scene.network
    starts = lanelets_of_pose(network, ego.position, ego.heading_rad) or ego.lanelets
    if not starts:
        return None
    goals = goal_center_lanelets(network, scene.loaded.problem(ego.problem_id))
    route = (scene.lanelet_graph.shortest_route(starts, goals) if goals else None) or ()
    start = (route or starts)[0]
    ahead, onward = path_ahead(network, scene.lanelet_graph, start, route, _AHEAD_M)
    behind, before = _backwards(network, scene.lanelet_graph, start)
    line = without_repeats(np.vstack([*behind, ahead])) if behind else ahead
    here_m, lanes_left = project(line, ego.position)[0], _count_lanes_left(network, (*before, *onward))
    straight_on = _roads_straight_on(network, scene.lanelet_graph, start, lanes_left)
    return EgoLane(network, line, here_m, ego.position, ego.heading_rad, lanes_left, ego.size_m[0], straight_on)


def _roads_straight_on(
    network: "LaneletNetwork", graph: LaneletGraph, start: int, lanes_left: Mapping[int, int]
) -> tuple[Points, ...]:
    """Return the centre lines of the ego's lane and the lanes next to it, each straight on at every fork.

    A lane that only turns has a neighbour that goes straight on.
    """
    own = network.find_lanelet_by_id(start)
    neighbours = (own.adj_left, own.adj_right)
    starts = [start, *(int(key) for key in neighbours if key is not None and int(key) in lanes_left)]
    return tuple(path_ahead(network, graph, key, (), _AHEAD_M)[0] for key in starts)


def is_own_recording(track: Track, ego: Ego) -> bool:
    """Return True if a track starts at the ego's position, heading and speed: it is the ego's own recording."""
    index = track.index_at(ego.step)
    if index is None:
        return False
    away = float(np.linalg.norm(track.positions[index] - ego.position))
    turned = abs(wrap_angle(float(track.headings_rad[index]) - ego.heading_rad))
    faster = abs(float(track.speeds_mps[index]) - ego.speed_mps)
    return away < _SAME_PLACE_M and turned < _SAME_HEADING_RAD and faster < _SAME_SPEED_MPS


def _others(scene: Scene, ego: Ego) -> Iterator[tuple[int, Track, int]]:
    """Yield the vehicles that are present at the ego's first step, with their index at that step."""
    for key, track in scene.tracks.items():
        index = track.index_at(ego.step)
        if index is not None and track.kind not in NOT_DRIVEN and not is_own_recording(track, ego):
            yield key, track, index


def _gaps_in_lane(scene: Scene, ego: Ego) -> Iterator[tuple[int, float]]:
    lane = ego_lane(scene, ego)
    if lane is None:
        return
    for key, track, index in _others(scene, ego):
        match = scene.matches.get(key)
        where = lane.where(track, index, match.at(index) if match else None)
        if where.in_lane and where.ahead_m is not None:
            yield key, where.ahead_m


def _gaps_along_lanelets(scene: Scene, ego: Ego) -> Iterator[tuple[int, float]]:
    """Yield the vehicles on the ego's lanelet and on the lanelets before and after it, with their distances in m.

    Distances ahead are positive.
    """
    if not ego.lanelets:
        return
    own, table = ego.lanelets[0], scene.layout.table
    at, _ = project(table.lanes[own].center, ego.position)
    ahead = _distances(scene, own, table.successors, table.lanes[own].length_m - at)
    behind = _distances(scene, own, table.predecessors, at)
    for key, lanelet, station in _stations(scene, ego, {own, *ahead, *behind}):
        if lanelet == own:
            yield key, station - at
        if lanelet in ahead:
            yield key, ahead[lanelet] + station
        if lanelet in behind:
            yield key, station - behind[lanelet] - table.lanes[lanelet].length_m


def _stations(scene: Scene, ego: Ego, wanted: Collection[int]) -> Iterator[tuple[int, int, float]]:
    """Yield the vehicles on the wanted lanelets: id, lanelet, and arc length in m there, at the ego's first step."""
    for key, track, index in _others(scene, ego):
        match = scene.matches.get(key)
        if match is None or (lanelet := match.at(index)) not in wanted:
            continue
        if not _outside_lane(scene.network, lanelet, track, index):
            yield key, lanelet, project(scene.layout.table.lanes[lanelet].center, track.positions[index])[0]


def _distances(scene: Scene, start: int, onward: Mapping[int, tuple[int, ...]], first_m: float) -> dict[int, float]:
    """Return the distance in m from the ego to the near end of each lanelet in one direction, by lanelet id."""
    lanes = scene.layout.table.lanes
    graph = Digraph[int](lambda key: ((after, lanes[key].length_m) for after in onward[key] if after != start))
    return graph.costs({key: first_m for key in onward[start] if key != start}, _LOOK_M)


_AHEAD_M = 300.0
_BEHIND_M = 150.0
"""How far the ego's lane is followed (chosen)."""
_LANE_HALF_WIDTH_M = 1.75
"""Half a lane of 3.5 m: a vehicle off lanelets is in the ego's lane if it is no farther from its centre line."""
_ONCOMING_REACH_M = 15.0
"""Largest lateral distance of an oncoming vehicle on the same road from the ego's lane (chosen: four lanes)."""
_LINE_END_M = 0.5
"""Next to the last half metre of the ego's line, a place may also be beyond it (chosen)."""
_ROUND_ABOUT = 2.0
"""A place this many times farther along the lane than in a straight line has both distances (chosen)."""
_SAME_RAD = math.radians(45.0)
_OPPOSITE_RAD = math.radians(135.0)
"""Headings turned by less than the first have the same direction, by more than the second the opposite; others cross.
"""
_ALONGSIDE_M = 3.0
"""Headings turned by less than the first have the same direction, by more than the second the opposite."""
_MOST_ADJACENT_LANES = 8
"""Number of lanes to one side that are examined (chosen); it ends cycles of neighbours in broken files."""
_OWN, _ONCOMING = "same lane", "oncoming"


@dataclass(frozen=True)
class _Where:
    """Where a vehicle is: a description, the distance in m along the ego's lane (ahead positive), and the gap."""

    words: str
    ahead_m: float | None
    gap_m: float | None

    @property
    def in_lane(self) -> bool:
        """Whether the vehicle is in the ego's own lane."""
        return self.gap_m is not None


@dataclass(frozen=True)
class EgoLane:
    """The lane that the ego follows: its centre line from behind the ego to far ahead, and the adjacent lanes.

    ``lanes_left``: by lanelet, the number of lanes to the left of the ego's (right negative) in the ego's direction; 0
    is the ego's own lane. ``length_m``: the ego's length. ``straight_on``: the centre lines of the ego's road, straight
    on at every fork, where the ego itself may turn.
    """

    network: "LaneletNetwork"
    line: Points
    here_m: float
    position: Points
    heading_rad: float
    lanes_left: dict[int, int]
    length_m: float
    straight_on: tuple[Points, ...] = ()

    def where(self, track: Track, index: int, lanelet: int | None) -> _Where:
        """Return the position of a track's vehicle relative to the ego's lane, at an index of the track's arrays."""
        point, heading = track.positions[index], float(track.headings_rad[index])
        station, offset = project(self.line, point)
        ahead = station - self.here_m
        round_about = abs(ahead) > max(_ALONGSIDE_M, _ROUND_ABOUT * float(np.linalg.norm(point - self.position)))
        lane = self._lane(track, index, lanelet, (station, offset))
        stands = float(track.speeds_mps[index]) < STANDING_MPS
        across_m = self._across_m(point, heading) if lane is None and not stands else None
        if across_m is not None:
            return _Where(f"{_along(across_m)}, {_ONCOMING}", None, None)
        if lane is None or (round_about and lane == _ONCOMING):
            return _Where(self._elsewhere(point, heading, stands=stands), None, None)
        if lane == _ONCOMING and stands:
            return _Where(f"{_along(ahead)}, standing, facing the other way", round(ahead, 1), None)
        if lane == _ONCOMING and ahead < -_ALONGSIDE_M:
            return _Where(f"{_along(ahead)}, opposite direction, moving away", round(ahead, 1), None)
        if round_about:
            return _Where(
                f"{self._elsewhere(point, heading, stands=stands)}, {_along(ahead)} along the lane",
                round(ahead, 1),
                None,
            )
        gap = abs(ahead) - (track.length_m + self.length_m) / 2 if lane == _OWN else None
        return _Where(f"{_along(ahead)}, {lane}", round(ahead, 1), None if gap is None else round(gap, 1))

    def _across_m(self, point: Points, heading: float) -> float | None:
        """Return how far ahead a vehicle is that comes along the ego's road where the ego turns off; None elsewhere."""
        for line in self.straight_on:
            station, offset = project(line, point)
            ahead = station - project(line, self.position)[0]
            inside = ahead > _ALONGSIDE_M and station < arc_length(line)[-1] - _LINE_END_M
            detour = ahead > _ROUND_ABOUT * float(np.linalg.norm(point - self.position))
            turned = abs(wrap_angle(heading - point_at(line, station)[1]))
            if inside and not detour and turned > _OPPOSITE_RAD and abs(offset) < _ONCOMING_REACH_M:
                return ahead
        return None

    def _lane(self, track: Track, index: int, lanelet: int | None, at: tuple[float, float]) -> str | None:
        """Return a vehicle's lane at an arc length along the line and an offset from it; None on another road."""
        station, offset = at
        if lanelet not in self.lanes_left and not _LINE_END_M < station < arc_length(self.line)[-1] - _LINE_END_M:
            return None
        turned = abs(wrap_angle(float(track.headings_rad[index]) - point_at(self.line, station)[1]))
        if turned > _OPPOSITE_RAD and abs(offset) < _ONCOMING_REACH_M:
            return _ONCOMING
        if turned > _SAME_RAD:
            return None
        lanes = self.lanes_left.get(lanelet) if lanelet is not None else None
        if lanelet is None or lanes is None:
            return _OWN if abs(offset) <= _LANE_HALF_WIDTH_M else None
        if lanes == 0:
            return self._outside(lanelet, offset) if _outside_lane(self.network, lanelet, track, index) else _OWN
        side = "left" if lanes > 0 else "right"
        return f"{side} lane" if abs(lanes) == 1 else f"{abs(lanes)} lanes to the {side}"

    def _outside(self, lanelet: int, offset: float) -> str:
        """Return the description of a vehicle that drives along a lane, but outside it."""
        lane = self.network.find_lanelet_by_id(lanelet)
        adjacent = lane.adj_left if offset > 0 else lane.adj_right
        same = lane.adj_left_same_direction if offset > 0 else lane.adj_right_same_direction
        side = "left" if offset > 0 else "right"
        if adjacent is None:
            return f"{side} of the lane"
        return f"{side} lane" if same else "in the oncoming lane"

    def _elsewhere(self, point: Points, heading: float, *, stands: bool) -> str:
        step = point - self.position
        distance = float(np.linalg.norm(step))
        bearing = wrap_angle(math.atan2(step[1], step[0]) - self.heading_rad)
        turned = wrap_angle(heading - self.heading_rad)
        motion = "standing, facing the other way" if stands else "opposite direction, another road"
        if abs(turned) < _SAME_RAD:
            motion = "same direction, another road"
        elif abs(turned) < _OPPOSITE_RAD:
            motion = f"heading to the {'left' if turned > 0 else 'right'}"
        return f"{distance:.0f} m {_bearing(bearing)}, {motion}"


def _outside_lane(network: "LaneletNetwork", lanelet: int, track: Track, index: int) -> bool:
    """Return True if a vehicle's whole width is next to a lanelet, as when it overtakes in the oncoming lane."""
    lane, line, point = network.find_lanelet_by_id(lanelet), center_line(network, lanelet), track.positions[index]
    nearest = int(np.argmin(np.linalg.norm(lane.center_vertices - point, axis=1)))
    width = float(np.linalg.norm(lane.left_vertices[nearest] - lane.right_vertices[nearest]))
    station, offset = project(line, point)
    return 0.0 < station < float(arc_length(line)[-1]) and abs(offset) > (width + track.width_m) / 2


def _along(ahead_m: float) -> str:
    if abs(ahead_m) < _ALONGSIDE_M:
        return "alongside"
    return f"{abs(ahead_m):.0f} m {'ahead' if ahead_m > 0 else 'behind'}"


def _bearing(angle_rad: float) -> str:
    names = (
        *("ahead", "ahead on the left", "to the left", "behind on the left"),
        *("behind", "behind on the right", "to the right", "ahead on the right"),
    )
    return names[round(angle_rad / (math.pi / 4)) % 8]


def _backwards(network: "LaneletNetwork", graph: LaneletGraph, start: int) -> tuple[list[Points], list[int]]:
    """Return the centre lines behind a lanelet, farthest first, and their lanelets, nearest first."""
    chosen: list[int] = []
    total, current = 0.0, start
    while total < _BEHIND_M:
        before = [key for key in graph.predecessors[current] if key != start and key not in chosen]
        if not before:
            break
        lines = {key: center_line(network, key) for key in before}
        current = straightest_behind(center_line(network, current), lines)
        chosen.append(current)
        total += graph.length_m[current]
    return [center_line(network, key) for key in reversed(chosen)], chosen


def _count_lanes_left(network: "LaneletNetwork", own: tuple[int, ...]) -> dict[int, int]:
    lanes = dict.fromkeys(own, 0)
    for key in own:
        for sign in (1, -1):
            lane, count = network.find_lanelet_by_id(key), 0
            while lane is not None and abs(count) < _MOST_ADJACENT_LANES:
                adjacent = lane.adj_left if sign > 0 else lane.adj_right
                same = lane.adj_left_same_direction if sign > 0 else lane.adj_right_same_direction
                if adjacent is None or not same:
                    break
                count += sign
                lanes.setdefault(int(adjacent), count)
                lane = network.find_lanelet_by_id(adjacent)
    return lanes
