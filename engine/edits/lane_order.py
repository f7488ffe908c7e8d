"""Who drives ahead of and behind the ego along its lane: whom ``lead`` and ``follow`` mean, in edits and descriptions.

A vehicle counts that is on the ego's lanelet, on any that follows it (whichever branch the ego takes) or on any that
leads to it, and so does one whose lanelet is another but which is in the ego's lane where it is.
"""

import heapq
import math
from collections.abc import Iterator, Mapping

import numpy as np

from plannerforge.engine.edits.scene import NOT_DRIVEN, Ego, Scene
from plannerforge.engine.geometry.polyline import project, wrap_angle
from plannerforge.engine.scenarios.ego_route import along, goal_lanelets, lanelets_at
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.scenarios.where_words import EgoLane, outside_lane

LOOK_M = 300.0
SAME_PLACE_M, SAME_SPEED_MPS, SAME_HEADING_RAD = 0.5, 1.0, math.radians(10.0)


def leader_and_follower(scene: Scene, ego: Ego) -> tuple[int | None, int | None]:
    """The nearest vehicles ahead and behind along the ego's lane; None where there is none.

    Distances are along the centre lines, at the ego's first time step; the search along lanelets ends after 300 m.
    Who overtakes beside the lane is neither, nor is the ego's own recording.
    """
    gaps = [*_gaps_along_lanelets(scene, ego), *_gaps_in_lane(scene, ego)]
    ahead = [(gap, key) for key, gap in gaps if gap > 0.0]
    behind = [(-gap, key) for key, gap in gaps if gap <= 0.0]
    return min(ahead)[1] if ahead else None, min(behind)[1] if behind else None


def ego_lane(scene: Scene, ego: Ego) -> EgoLane | None:
    """The lane from the ego's start along its way to its goal; None where it starts on no lanelet."""
    network = scene.network
    under = lanelets_at(network, ego.position)
    starts = along(network, under, ego.position, ego.heading_rad) or under or ego.lanelets
    if not starts:
        return None
    goals = goal_lanelets(network, scene.loaded.problem(ego.problem_id))
    route = (scene.lanelet_graph.shortest_route(starts, goals) if goals else None) or ()
    pose = (ego.position, ego.heading_rad)
    return EgoLane.of(network, scene.lanelet_graph, (route or starts)[0], route, pose)


def is_own_recording(track: Track, ego: Ego) -> bool:
    """Whether a track begins as the ego does, in place, heading and speed: what the ego did when it was recorded."""
    index = track.index_at(ego.step)
    if index is None:
        return False
    away = float(np.linalg.norm(track.positions[index] - ego.position))
    turned = abs(wrap_angle(float(track.headings_rad[index]) - ego.heading_rad))
    faster = abs(float(track.speeds_mps[index]) - ego.speed_mps)
    return away < SAME_PLACE_M and turned < SAME_HEADING_RAD and faster < SAME_SPEED_MPS


def _others(scene: Scene, ego: Ego) -> Iterator[tuple[int, Track, int]]:
    """Vehicles that are there at the ego's first step, with their index at it."""
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
    """Distances to the vehicles on the ego's lanelet and on those before and after it, ahead positive."""
    if not ego.lanelets:
        return
    own, table = ego.lanelets[0], scene.layout.table
    at, _ = project(table.lanes[own].center, ego.position)
    ahead = _distances(scene, own, table.successors, table.lanes[own].length_m - at)
    behind = _distances(scene, own, table.predecessors, at)
    for key, lanelet, station in _stations(scene, ego):
        if lanelet == own:
            yield key, station - at
        if lanelet in ahead:
            yield key, ahead[lanelet] + station
        if lanelet in behind:
            yield key, station - behind[lanelet] - table.lanes[lanelet].length_m


def _stations(scene: Scene, ego: Ego) -> Iterator[tuple[int, int, float]]:
    """Vehicles on lanelets, and their arc length on them, at the ego's first time step."""
    for key, track, index in _others(scene, ego):
        match = scene.matches.get(key)
        if match is not None and not outside_lane(scene.network, match.at(index), track, index):
            lanelet = match.at(index)
            yield key, lanelet, project(scene.layout.table.lanes[lanelet].center, track.positions[index])[0]


def _distances(scene: Scene, start: int, onward: Mapping[int, tuple[int, ...]], first_m: float) -> dict[int, float]:
    """Lanelets in one direction → distance from the ego to their near end."""
    found: dict[int, float] = {}
    queue = [(first_m, key) for key in onward[start]]
    heapq.heapify(queue)
    while queue:
        distance, key = heapq.heappop(queue)
        if key in found or key == start or distance > LOOK_M:
            continue
        found[key] = distance
        for after in onward[key]:
            heapq.heappush(queue, (distance + scene.layout.table.lanes[key].length_m, after))
    return found
