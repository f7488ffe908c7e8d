"""The reference path: the centre lines of a route as one smooth line.

The path starts before the ego and ends far beyond the goal. Lengths in m, arc lengths ("stations") from the start of
the path, headings in rad.

``blended_start`` creates a path that starts in the ego's pose, for starts from which no candidate reaches the route's
centre line: an ego may start oblique to its lane, or so fast before a tight turn that steering takes too long. Every
candidate of a planner that follows the centre line would then break a limit in its first second.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import (
    PathFollower,
    Points,
    Values,
    arc_length,
    gaussian,
    hermite,
    interpolate,
    point_at,
    project,
    project_along,
    resample,
    unit,
    without_repeats,
)
from ..network import LaneletGraph
from ..scene import Route

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

BEYOND_GOAL_M = 120.0
"""Least length beyond the goal; it grows to horizon × speed, since a planner's candidates must not leave the path."""
FASTEST_MPS = 36.0
"""The speed limit of Frenetix's sampling: no candidate gets farther within the horizon."""
BLENDED_OVER_M = (10.0, 15.0, 22.0, 33.0, 50.0)
"""Lengths of a blended start, tried in turn; the shortest feasible one stays closest to the route."""
_TRACKED_M = 5.0
"""Spacing of the points that locate lanelets along the path (chosen: shorter than any curve)."""
_SPACING_M = 1.0
"""Distance between a path's points (chosen)."""
_SMOOTHING_M = 2.0
"""Standard deviation of the smoothing, which rounds the kinks between lanelets (chosen)."""
_BEFORE_M = 30.0
"""A path starts this far before its route, so that no ego is before it (chosen)."""
_CHANGE_S, _SHORTEST_CHANGE_M, _LONGEST_CHANGE_M = 2.5, 20.0, 50.0
"""Duration of a lane change at the ego's speed, and the bounds of its length (chosen)."""
_LARGEST_SHIFT_M = 4.0
"""Largest shift; a goal farther off the centre line is on another lane, and the path stays (chosen)."""
_LENGTH_PER_SHIFT = 6.0
"""Least length in which a path shifts sideways by one metre, since tighter curves cannot be driven."""


@dataclass(frozen=True)
class ReferencePath:
    """Points (n, 2) about one metre apart, and the lanelets of the route.

    ``route_begin_m``: the station at which the first lanelet starts, negative if that is before the path; ``start_m``:
    the station near which the ego starts; ``network_end_m``: the start of the straight extension; ``goal_lanelet`` is
    None if the goal has no position. ``center_m`` (n,): distances of the points along the lanelets' centre lines, since
    smoothing shortens curves, by up to a metre in a small roundabout. It is None for a path that starts off the centre
    lines.
    """

    points: Points
    lanelets: tuple[int, ...]
    goal_lanelet: int | None
    network_end_m: float
    start_m: float = _BEFORE_M
    route_begin_m: float = _BEFORE_M
    center_m: Values | None = None

    def lanelet_ends_m(self, network: "LaneletNetwork") -> Values:
        """Return the station in m at which each lanelet of the route ends, ascending."""
        lines = [np.asarray(network.find_lanelet_by_id(key).center_vertices, dtype=float) for key in self.lanelets]
        track = [_thin(line) for line in lines]
        stations = project_along(self.points, np.concatenate(track), self.route_begin_m)[0]
        ends: Values = np.maximum.accumulate(stations[np.cumsum([len(line) for line in track]) - 1])
        return ends

    def way_m(self, first_m: float, last_m: float) -> float:
        """Return the length in m along the centre lines between two stations; negative if ``last_m`` is smaller."""
        if self.center_m is None:
            return last_m - first_m
        first, last = np.interp([first_m, last_m], self.stations_m, self.center_m)
        return float(last - first)

    def follower(self) -> PathFollower:
        """Return a follower of the ego along the path, which may pass a point twice (a roundabout, a loop)."""
        return self._line.beginning_at(self.start_m)

    @cached_property
    def _line(self) -> PathFollower:
        return PathFollower(self.points)

    @cached_property
    def stations_m(self) -> Values:
        """The arc length of each point in m, shape (n,)."""
        return arc_length(self.points)


def build_reference_path(
    network: "LaneletNetwork",
    route: Route,
    position: Points,
    speed_mps: float,
    *,
    beyond_m: float = BEYOND_GOAL_M,
    through: Points | None = None,
) -> ReferencePath:
    """Return the path of a route for an ego that starts at ``position`` with ``speed_mps``.

    A lane change is a cubic from one centre line to the next. It takes about 2.5 s and never starts behind the ego.

    Args:
        network: The lanelets.
        route: The lanelets to drive along.
        position: The ego's centre, shape (2,).
        speed_mps: The ego's speed, which gives the length of lane changes.
        beyond_m: The length of the straight extension beyond the end of the route.
        through: A point off the centre line that the path shifts to (a goal area at the edge of its lane).
    """
    change_m = float(np.clip(_CHANGE_S * speed_mps, _SHORTEST_CHANGE_M, _LONGEST_CHANGE_M))
    segments = _segments(network, route, position, change_m)
    first = np.asarray(network.find_lanelet_by_id(route.lanelets[0]).center_vertices, dtype=float)
    line = segments[0]
    for following in segments[1:]:
        line = _join(line, following, change_m)
    even = _resample_evenly(line)
    line = gaussian(even, _SMOOTHING_M / _SPACING_M) if len(even) > 3 else even
    if through is not None:
        line = _shift(line, position, through, change_m)
    before, beyond = (
        _straight_on_from(line[1], line[0], _BEFORE_M)[::-1],
        _straight_on_from(line[-2], line[-1], beyond_m),
    )
    extended = np.concatenate([before, line, beyond])
    points = _resample_evenly(extended)
    along = np.concatenate([arc_length(before), _BEFORE_M + arc_length(even), np.zeros(len(beyond))])
    along[len(before) + len(line) :] = along[len(before) + len(line) - 1] + np.arange(1, len(beyond) + 1) * _SPACING_M
    return ReferencePath(
        points=points,
        lanelets=route.lanelets,
        goal_lanelet=None if route.goal_index is None else route.lanelets[route.goal_index],
        network_end_m=_BEFORE_M + float(arc_length(line)[-1]),
        start_m=_BEFORE_M + project(first, position)[0],
        center_m=np.interp(arc_length(points), arc_length(extended), along),
    )


def blended_start(reference: ReferencePath, rear: Points, heading_rad: float, over_m: float) -> ReferencePath:
    """Return a path that starts at an ego's rear axle (2,) with its heading, and joins the reference path within
    ``over_m`` metres.

    Behind the ego the path is straight. If the reference path is too short, the path joins it at its end.
    """
    stations = arc_length(reference.points)
    joined_m = min(reference.follower().place(rear)[0] + over_m, float(stations[-1]) - 1.0)
    end, end_heading_rad = point_at(reference.points, joined_m)
    forward = _direction(heading_rad)
    rest = interpolate(reference.points, stations, np.array([joined_m, *stations[stations > joined_m]]))
    behind = _straight_on_from(rear + forward, rear, _BEFORE_M)[::-1]
    curve = _curve(rear, forward, end, _direction(end_heading_rad))
    points = _resample_evenly(np.concatenate([behind, rear[None], curve, rest]))
    straight_m = float(stations[-1]) - reference.network_end_m
    network_end_m = float(arc_length(points)[-1]) - straight_m
    begin_m = reference.route_begin_m + float(arc_length(points)[-1] - stations[-1])
    return replace(
        reference, points=points, network_end_m=network_end_m, start_m=_BEFORE_M, route_begin_m=begin_m, center_m=None
    )


def _thin(line: Points) -> Points:
    """Return the line with fewer points, about ``_TRACKED_M`` apart, including its last point."""
    count = max(int(arc_length(line)[-1] / _TRACKED_M), 1)
    return resample(line, count + 1)[1:]


def _segments(network: "LaneletNetwork", route: Route, position: Points, change_m: float) -> list[Points]:
    """Return the centre lines between lane changes, each with at least two points."""
    graph = LaneletGraph.of(network)
    center = {key: np.asarray(network.find_lanelet_by_id(key).center_vertices, dtype=float) for key in route.lanelets}
    segments: list[Points] = []
    current: list[Points] = []
    begin = 0.0  # share of the current row of neighbours that is already behind
    for index, key in enumerate(route.lanelets):
        following = route.lanelets[index + 1] if index + 1 < len(route.lanelets) else None
        changes = following is not None and following not in graph.successors[key]
        end = 1.0
        if changes:
            length = max(graph.length_m[key], 1e-3)
            here = project(center[key], position)[0] / length if not segments and not current else begin
            end = min(1.0, max(here, begin) + 0.5 * change_m / length)
        part = _cut(center[key], begin, end)
        if len(part):
            current.append(part)
        begin = end if changes else 0.0
        if changes and current:
            segments.append(without_repeats(np.concatenate(current)))
            current = []
    if current:
        segments.append(without_repeats(np.concatenate(current)))
    return [segment for segment in segments if len(segment) > 1]


def _cut(line: Points, first_share: float, last_share: float) -> Points:
    """Return the part of a line between two shares of its length; empty if they are equal."""
    if last_share - first_share < 1e-6:
        return line[:0]
    stations = arc_length(line)
    first, last = first_share * stations[-1], last_share * stations[-1]
    inner = stations[(stations > first + 1e-6) & (stations < last - 1e-6)]
    return interpolate(line, stations, np.concatenate([[first], inner, [last]]))


def _join(line: Points, following: Points, change_m: float) -> Points:
    """Join two neighbouring lines with a cubic Hermite curve that takes half of the lane change from each."""
    before, after = arc_length(line), arc_length(following)
    leave = max(before[-1] - change_m / 2, before[-1] * 0.25)
    arrive = min(change_m / 2, after[-1] * 0.75)
    head = _cut(line, 0.0, leave / before[-1])
    tail = _cut(following, arrive / after[-1], 1.0)
    start, end = head[-1], tail[0]
    curve = _curve(start, unit(head[-1] - head[-2]), end, unit(tail[1] - tail[0]))
    return np.concatenate([head, curve, tail])


def _curve(start: Points, start_direction: Points, end: Points, end_direction: Points) -> Points:
    """Return the inner points (n, 2) of a cubic between two points with given unit directions (2,)."""
    distance = float(np.linalg.norm(end - start))
    shares = np.linspace(0.0, 1.0, max(int(distance / _SPACING_M), 2) + 1)[1:-1]
    return hermite(start, start_direction, end, end_direction, shares)


def _shift(line: Points, position: Points, through: Points, change_m: float) -> Points:
    """Return a line shifted sideways through a point; the shift starts at the ego and ends beyond the point."""
    stations = arc_length(line)
    target, offset = project(line, through)
    begin = max(project(line, position)[0], target - change_m)
    if target - begin < 1.0 or abs(offset) > _LARGEST_SHIFT_M:
        return line
    offset = float(np.clip(offset, -(target - begin) / _LENGTH_PER_SHIFT, (target - begin) / _LENGTH_PER_SHIFT))
    share = np.clip((stations - begin) / (0.8 * (target - begin)), 0.0, 1.0)
    back = np.clip((target + change_m + 10.0 - stations) / change_m, 0.0, 1.0)
    weight = (share**2 * (3 - 2 * share)) * (back**2 * (3 - 2 * back))
    along = np.gradient(line, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    shifted: Points = line + offset * weight[:, None] * normal
    return shifted


def _resample_evenly(line: Points) -> Points:
    """Return the line with points about one spacing apart."""
    line = without_repeats(line, 1e-2)
    return resample(line, max(round(float(arc_length(line)[-1]) / _SPACING_M), 2) + 1)


def _straight_on_from(before: Points, end: Points, length_m: float) -> Points:
    """Return points one spacing apart that continue straight from ``end``, without ``end``."""
    count = int(np.ceil(length_m / _SPACING_M))
    return end + np.arange(1, count + 1)[:, None] * _SPACING_M * unit(end - before)


def _direction(heading_rad: float) -> Points:
    return np.array([np.cos(heading_rad), np.sin(heading_rad)])
