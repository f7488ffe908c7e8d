"""Who drives ahead of and behind the ego along its lane."""

import heapq
from collections.abc import Mapping

from plannerforge.engine.edits.scene import NOT_DRIVEN, Ego, Scene
from plannerforge.engine.geometry.polyline import project

LOOK_M = 300.0


def leader_and_follower(scene: Scene, ego: Ego) -> tuple[int | None, int | None]:
    """The nearest vehicles ahead and behind along the ego's lanelet and what follows or leads to it.

    Distances are along the centre lines, at the ego's first time step; vehicles beyond 300 m do not count.
    """
    if not ego.lanelets:
        return None, None
    own = ego.lanelets[0]
    stations = _stations(scene, ego.step)
    table = scene.layout.table
    at, _ = project(table.lanes[own].center, ego.position)
    length = table.lanes[own].length_m
    ahead = _distances(scene, own, table.successors, length - at)
    behind = _distances(scene, own, table.predecessors, at)
    gaps_ahead: list[tuple[float, int]] = []
    gaps_behind: list[tuple[float, int]] = []
    for key, (lanelet, station) in stations.items():
        if lanelet == own:
            (gaps_ahead if station > at else gaps_behind).append((abs(station - at), key))
            continue
        if lanelet in ahead:
            gaps_ahead.append((ahead[lanelet] + station, key))
        if lanelet in behind:
            gaps_behind.append((behind[lanelet] + table.lanes[lanelet].length_m - station, key))
    return _nearest(gaps_ahead), _nearest(gaps_behind)


def _nearest(gaps: list[tuple[float, int]]) -> int | None:
    return min(gaps)[1] if gaps else None


def _stations(scene: Scene, step: int) -> dict[int, tuple[int, float]]:
    """Vehicle → its lanelet and arc length on it at a time step."""
    found = {}
    for key, match in scene.matches.items():
        track = scene.tracks.get(key)
        index = track.index_at(step) if track and track.kind not in NOT_DRIVEN else None
        if track is not None and index is not None:
            lanelet = match.at(index)
            station, _ = project(scene.layout.table.lanes[lanelet].center, track.positions[index])
            found[key] = (lanelet, station)
    return found


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
