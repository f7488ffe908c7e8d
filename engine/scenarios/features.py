"""Features of a scenario computed from its geometry, independent of the tags that its author wrote.

Three features are found in the lanelet network: crossings (lanelets that cross at an angle), roundabouts (short round
cycles of successors with several entries) and motorway ramps (roads of one direction that diverge or merge at a small
angle). Angles in rad.
"""

import math
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...schemas.scenarios import EgoFacts
from ..commonroad import Track
from ..geometry import (
    Points,
    Values,
    arc_length,
    headings,
    meeting_pairs,
    point_at,
    project,
    project_all,
    wrap_angle,
    wrap_angles,
)
from ..network import LaneletGraph
from ..scene import EgoRoute, center_line, has_roundabout, path_ahead, sides_of
from ..vehicles import TIME_GAP_MPS

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

AHEAD_OF_START_M = 100.0
"""Crossings and oncoming traffic count up to this distance from the ego's start (chosen)."""
LEAD_M, LEAD_ASIDE_M = 50.0, 1.5
"""Largest distance of a lead vehicle ahead and to the side of the path (chosen; half a lane is 1.5 to 1.9 m)."""
CROSSING_RAD = math.radians(25.0)
"""Lanelets that meet at a smaller angle merge or diverge (chosen)."""
ONCOMING_RAD, ONCOMING_LATERAL_M = math.radians(135.0), 12.0
"""Oncoming traffic is turned from the path by more than this angle, within this lateral distance (chosen)."""
MOVING_MPS = 1.0
"""Below this speed a vehicle's direction of travel is undefined (chosen)."""
SAMPLED_EVERY = 5
"""Sampling of recorded states for oncoming traffic: every fifth (0.5 s)."""


def features(
    network: "LaneletNetwork",
    graph: LaneletGraph,
    tracks: dict[int, Track],
    ego: EgoFacts,
    route: EgoRoute | None,
    start_step: int,
) -> tuple[str, ...]:
    """Return the features of the vocabulary that hold for this ego, which starts at a step; sorted."""
    start_point = np.array([ego.x_m, ego.y_m])
    crossing, circle = _has_crossing(network, graph, start_point, ego.route), has_roundabout(network, graph)
    holding = {
        "intersection": crossing,
        "roundabout": circle,
        "ramp": not crossing and not circle and _has_ramp(network, graph, start_point, ego.route),
        "multi_lane": ego.lanes >= 2,
        "single_lane": ego.lanes == 1,
        "ego_stands_at_start": ego.speed_mps < TIME_GAP_MPS,
    }
    if route is not None:
        holding["ego_changes_lane"] = route.changes_lane
        holding["ego_goes_straight"] = route.goes_straight
        holding["ego_turns_left"] = "left" in route.turns
        holding["ego_turns_right"] = "right" in route.turns
        holding["ego_turns_back"] = "back" in route.turns
    start = (ego.route or ego.lanelets or (None,))[0]
    if start is not None:
        line, _ = path_ahead(network, graph, start, ego.route, AHEAD_OF_START_M)
        if len(line) > 1:
            here = project(line, start_point)[0]
            holding["oncoming_traffic"] = _has_oncoming(line, here, tracks)
            holding["lead_vehicle"] = _has_lead(line, here, tracks, start_step)
    return tuple(sorted(name for name, holds in holding.items() if holds))


def _has_crossing(network: "LaneletNetwork", graph: LaneletGraph, point: Points, route: tuple[int, ...]) -> bool:
    """Return True if two lanelets cross at over 25° within 100 m of the point, or if any crosses the route.

    Lanelets that share an end (a fork, a merge) do not cross. CommonRoad has no heights, so a bridge counts.
    """
    from shapely.geometry import LineString

    keys = [k for k in graph.length_m if k in route or _is_near(network.find_lanelet_by_id(k).center_vertices, point)]
    lines = {key: center_line(network, key) for key in keys}
    keys = [key for key in keys if len(lines[key]) > 1]
    if not keys:
        return False
    shapes = [LineString(lines[key]) for key in keys]
    for one, two in meeting_pairs(shapes, "crosses").pairs.tolist():
        if not _share_an_end(graph, keys[one], keys[two]):
            crossing = np.asarray(shapes[one].intersection(shapes[two]).centroid.coords[0])
            on_route = keys[one] in route or keys[two] in route
            if (on_route or np.linalg.norm(crossing - point) <= AHEAD_OF_START_M) and _cross_at_angle(
                lines[keys[one]], lines[keys[two]], crossing
            ):
                return True
    return False


def _has_oncoming(line: Points, here_m: float, tracks: dict[int, Track]) -> bool:
    """Return True if a recorded vehicle moves against the line's direction within 12 m of it, ahead of the ego."""
    length = arc_length(line)[-1]
    for track in tracks.values():
        sampled = track.positions[::SAMPLED_EVERY]
        moving = (track.speeds_mps[::SAMPLED_EVERY] >= MOVING_MPS) & is_near_line(line, sampled, ONCOMING_LATERAL_M)
        if not moving.any():
            continue
        positions, facing = sampled[moving], track.headings_rad[::SAMPLED_EVERY][moving]
        stations, offsets, turn = along_line(line, positions, facing)
        against = np.abs(wrap_angles(turn)) > ONCOMING_RAD
        on_path = (here_m < stations) & (stations < length - 0.1) & (np.abs(offsets) <= ONCOMING_LATERAL_M)
        if np.any(against & on_path):
            return True
    return False


def is_near_line(line: Points, positions: Points, reach_m: float) -> NDArray[np.bool_]:
    """Return which positions (n, 2) are in a line's box, extended by a reach; all other positions are farther away."""
    low, high = line.min(axis=0) - reach_m, line.max(axis=0) + reach_m
    inside: NDArray[np.bool_] = ((positions >= low) & (positions <= high)).all(axis=1)
    return inside


def along_line(line: Points, positions: Points, headings_rad: Values) -> tuple[Points, Points, Values]:
    """Return stations and offsets in m of positions (n, 2) along a line, and the turn of headings from it; (n,)."""
    directions = headings(line)
    stations, offsets = project_all(line, positions)
    segments = np.clip(np.searchsorted(arc_length(line), stations, side="right") - 1, 0, len(directions) - 1)
    return stations, offsets, headings_rad - directions[segments]


def _has_lead(line: Points, here_m: float, tracks: dict[int, Track], start_step: int) -> bool:
    """Return True if a vehicle is on the line within 50 m ahead of the ego when the ego starts."""
    for track in tracks.values():
        index = track.index_at(start_step)
        if index is None:
            continue
        station, offset = project(line, track.positions[index])
        if 0.5 < station - here_m < LEAD_M and abs(offset) < LEAD_ASIDE_M:
            return True
    return False


def _is_near(vertices: Points, point: Points) -> bool:
    low, high = vertices.min(axis=0) - AHEAD_OF_START_M, vertices.max(axis=0) + AHEAD_OF_START_M
    return bool(np.all(point >= low) and np.all(point <= high))


def _share_an_end(graph: LaneletGraph, one: int, two: int) -> bool:
    begin = set(graph.predecessors[one]) & set(graph.predecessors[two]) or two in graph.neighbours[one]
    end = set(graph.successors[one]) & set(graph.successors[two])
    return bool(begin or end) or two in graph.successors[one] or one in graph.successors[two]


def _cross_at_angle(first: Points, second: Points, point: Points) -> bool:
    """Return True if the lines meet at a point at more than the crossing angle, regardless of direction."""
    angles = []
    for line in (first, second):
        station = project(line, point)[0]
        segment = min(int(np.searchsorted(arc_length(line), station, side="right")) - 1, len(line) - 2)
        step = line[segment + 1] - line[segment]
        angles.append(math.atan2(step[1], step[0]))
    difference = abs(wrap_angles(np.array([angles[0] - angles[1]]))[0])
    return bool(min(difference, math.pi - difference) > CROSSING_RAD)


RAMP_NEAR_M = 200.0
"""Ramps count up to this distance from the ego's start: they are longer than junctions (chosen)."""
RAMP_RAD = math.radians(20.0)
"""At a larger angle, roads diverge or merge at a junction (chosen)."""
STRETCH_M = 15.0
"""Distance from the joint at which the angle is measured: at the joint itself it is zero."""
APART_M = 0.3
"""Branches that are closer over that stretch are the same road twice."""


def _has_ramp(network: "LaneletNetwork", graph: LaneletGraph, point: Points, route: tuple[int, ...]) -> bool:
    """Return True if roads diverge or merge as at a motorway ramp, within 200 m of the point or along the route.

    This is the case if two lanelets leave (or reach) the same lanelet at less than 20°, on carriageways without
    oncoming lanes. The caller must exclude crossings and roundabouts.
    """
    for key in graph.successors:
        vertices = network.find_lanelet_by_id(key).center_vertices
        if key not in route and np.min(np.linalg.norm(vertices - point, axis=1)) > RAMP_NEAR_M:
            continue
        for branches, forward in ((graph.successors[key], True), (graph.predecessors[key], False)):
            if any(_is_ramp_pair(network, graph, key, pair, forward) for pair in combinations(branches, 2)):
                return True
    return False


def _is_ramp_pair(
    network: "LaneletNetwork", graph: LaneletGraph, joint: int, pair: tuple[int, int], forward: bool
) -> bool:
    if pair[1] in graph.neighbours[pair[0]] or any(_has_oncoming_lane(network, key) for key in (joint, *pair)):
        return False
    lines = [center_line(network, key) for key in pair]
    if any(len(line) < 2 for line in lines):
        return False
    ends = [point_at(line if forward else line[::-1], STRETCH_M) for line in lines]
    angle = abs(wrap_angle(ends[0][1] - ends[1][1]))
    return angle < RAMP_RAD and float(np.linalg.norm(ends[0][0] - ends[1][0])) > APART_M


def _has_oncoming_lane(network: "LaneletNetwork", lanelet_id: int) -> bool:
    """Return True if any lane of the carriageway has a neighbour in the opposite direction."""
    seen: set[int] = set()
    waiting = [lanelet_id]
    while waiting:
        lane = network.find_lanelet_by_id(waiting.pop())
        if lane is None or lane.lanelet_id in seen:
            continue
        seen.add(lane.lanelet_id)
        for neighbour, same in sides_of(lane):
            if neighbour is not None and not same:
                return True
            if neighbour is not None:
                waiting.append(neighbour)
    return False
