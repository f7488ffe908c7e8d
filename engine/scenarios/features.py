"""What the geometry says about a scenario, apart from the tags that its author wrote into the file."""

import math
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, headings, project, project_all, wrap_angles
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.scenarios.ego_route import EgoRoute, center_line, path_ahead
from plannerforge.engine.scenarios.ramp import has_ramp
from plannerforge.engine.scenarios.roundabout import has_roundabout
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.scenarios import EgoFacts

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

NEAR_M = 100.0
LEAD_M = 50.0
STANDING_MPS = 0.5
CROSSING_RAD = math.radians(25.0)
ONCOMING_RAD = math.radians(135.0)
ONCOMING_BESIDE_M = 12.0
MOVING_MPS = 1.0


def features(
    network: "LaneletNetwork", graph: LaneletGraph, tracks: dict[int, Track], ego: EgoFacts, route: EgoRoute | None
) -> tuple[str, ...]:
    """The features of the vocabulary that hold for this ego, sorted."""
    place = np.array([ego.x_m, ego.y_m])
    crossing, circle = has_crossing(network, graph, place, ego.route), has_roundabout(network, graph)
    found = {
        "intersection": crossing,
        "roundabout": circle,
        "ramp": not crossing and not circle and has_ramp(network, graph, place, ego.route),
        "multi_lane": ego.lanes >= 2,
        "single_lane": ego.lanes == 1,
        "ego_stands_at_start": ego.speed_mps < STANDING_MPS,
    }
    if route is not None:
        found["ego_changes_lane"] = route.changes_lane
        found["ego_goes_straight"] = not route.turns and not route.changes_lane
        found["ego_turns_left"] = "left" in route.turns
        found["ego_turns_right"] = "right" in route.turns
    start = (ego.route or ego.lanelets or (None,))[0]
    if start is not None:
        line, _ = path_ahead(network, graph, start, ego.route, NEAR_M)
        if len(line) > 1:
            here = project(line, place)[0]
            found["oncoming_traffic"] = has_oncoming(line, here, tracks)
            found["lead_vehicle"] = has_lead(line, here, tracks)
    return tuple(sorted(name for name, holds in found.items() if holds))


def has_crossing(network: "LaneletNetwork", graph: LaneletGraph, point: Points, route: tuple[int, ...]) -> bool:
    """Whether two lanelets cross at an angle above 25° within 100 m of the point, or one on the route is crossed.

    Lanelets that share an end (a fork, a merge) do not cross. Heights are not known to CommonRoad: a bridge counts.
    """
    from shapely import STRtree
    from shapely.geometry import LineString

    keys = [k for k in graph.length_m if k in route or _near(network.find_lanelet_by_id(k).center_vertices, point)]
    lines = {key: center_line(network, key) for key in keys}
    keys = [key for key in keys if len(lines[key]) > 1]
    if not keys:
        return False
    shapes = [LineString(lines[key]) for key in keys]
    pairs = STRtree(shapes).query(shapes, predicate="crosses")
    for one, two in zip(*pairs.tolist(), strict=True):
        if one < two and not _share_an_end(graph, keys[one], keys[two]):
            place = np.asarray(shapes[one].intersection(shapes[two]).centroid.coords[0])
            on_route = keys[one] in route or keys[two] in route
            if (on_route or np.linalg.norm(place - point) <= NEAR_M) and _angle(
                lines[keys[one]], lines[keys[two]], place
            ):
                return True
    return False


def has_oncoming(line: Points, here_m: float, tracks: dict[int, Track]) -> bool:
    """Whether a recorded vehicle moves against the line's direction within 12 m beside it, ahead of the ego."""
    ends, turned = arc_length(line), headings(line)
    for track in tracks.values():
        moving = track.speeds_mps[::5] >= MOVING_MPS
        if not moving.any():
            continue
        stations, beside = project_all(line, track.positions[::5][moving])
        segments = np.clip(np.searchsorted(ends, stations, side="right") - 1, 0, len(turned) - 1)
        against = np.abs(wrap_angles(track.headings_rad[::5][moving] - turned[segments])) > ONCOMING_RAD
        on_the_way = (here_m < stations) & (stations < ends[-1] - 0.1) & (np.abs(beside) <= ONCOMING_BESIDE_M)
        if np.any(against & on_the_way):
            return True
    return False


def has_lead(line: Points, here_m: float, tracks: dict[int, Track]) -> bool:
    """Whether a vehicle is on the line within 50 m ahead of the ego at step 0."""
    for track in tracks.values():
        index = track.index_at(0)
        if index is None:
            continue
        station, beside = project(line, track.positions[index])
        if 0.5 < station - here_m < LEAD_M and abs(beside) < 1.5:
            return True
    return False


def _near(vertices: Points, point: Points) -> bool:
    low, high = vertices.min(axis=0) - NEAR_M, vertices.max(axis=0) + NEAR_M
    return bool(np.all(point >= low) and np.all(point <= high))


def _share_an_end(graph: LaneletGraph, one: int, two: int) -> bool:
    if set(graph.predecessors[one]) & set(graph.predecessors[two]) or two in graph.neighbours[one]:
        return True
    if set(graph.successors[one]) & set(graph.successors[two]):
        return True
    return two in graph.successors[one] or one in graph.successors[two]


def _angle(first: Points, second: Points, place: Points) -> bool:
    """Whether the lines meet there at more than the crossing angle, whatever their directions."""
    angles = []
    for line in (first, second):
        station = project(line, place)[0]
        segment = min(int(np.searchsorted(arc_length(line), station, side="right")) - 1, len(line) - 2)
        step = line[segment + 1] - line[segment]
        angles.append(math.atan2(step[1], step[0]))
    difference = abs(wrap_angles(np.array([angles[0] - angles[1]]))[0])
    return bool(min(difference, math.pi - difference) > CROSSING_RAD)
