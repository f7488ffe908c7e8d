"""The reference path: the centre lines of a route as one smooth line.

It begins before the ego and ends far beyond the goal.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points, arc_length, gaussian, interpolate, project, resample, without_repeats
from ..network import LaneletGraph
from ..scene import Route

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

SPACING_M = 1.0
SMOOTHING_M = 2.0
BEFORE_M = 30.0
LARGEST_BEND_M = 4.0
BEND_LENGTH = 6.0
"""A path is bent sideways by at most one metre on so many metres: tighter bends cannot be driven."""
BEYOND_GOAL_M = 120.0
"""Candidates of the planner's horizon must not leave the path: horizon × speed beyond the goal, at least this."""


@dataclass(frozen=True)
class ReferencePath:
    """Points (n, 2) about one metre apart, and the lanelets of the route.

    ``network_end_m``: where the straight extension begins; ``goal_lanelet`` is None where the goal has no position.
    """

    points: Points
    lanelets: tuple[int, ...]
    goal_lanelet: int | None
    network_end_m: float


def build_reference_path(
    network: "LaneletNetwork",
    route: Route,
    position: Points,
    speed_mps: float,
    *,
    beyond_m: float = BEYOND_GOAL_M,
    through: Points | None = None,
) -> ReferencePath:
    """The path of a route for an ego that starts at ``position`` with ``speed_mps``.

    A lane change is a cubic from one centre line to the next, about 2.5 s long and not begun before the ego.
    ``through``: a point beside the centre line that the path is bent to (a goal area at the edge of its lane).
    """
    change_m = float(np.clip(2.5 * speed_mps, 20.0, 50.0))
    segments = _segments(network, route, position, change_m)
    line = segments[0]
    for following in segments[1:]:
        line = _joined(line, following, change_m)
    line = _smooth(line)
    if through is not None:
        line = _bent(line, position, through, change_m)
    extended = np.concatenate(
        [straight_on_from(line[1], line[0], BEFORE_M)[::-1], line, straight_on_from(line[-2], line[-1], beyond_m)]
    )
    return ReferencePath(
        points=evenly(extended),
        lanelets=route.lanelets,
        goal_lanelet=None if route.goal_index is None else route.lanelets[route.goal_index],
        network_end_m=BEFORE_M + float(arc_length(line)[-1]),
    )


def _segments(network: "LaneletNetwork", route: Route, position: Points, change_m: float) -> list[Points]:
    """Centre lines between lane changes, each of at least two points."""
    graph = LaneletGraph.of(network)
    center = {key: np.asarray(network.find_lanelet_by_id(key).center_vertices, dtype=float) for key in route.lanelets}
    segments: list[Points] = []
    current: list[Points] = []
    begin = 0.0  # share of the present row of neighbours that is behind us
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
    """The part of a line between two shares of its length; empty where they are equal."""
    if last_share - first_share < 1e-6:
        return line[:0]
    stations = arc_length(line)
    first, last = first_share * stations[-1], last_share * stations[-1]
    inner = stations[(stations > first + 1e-6) & (stations < last - 1e-6)]
    return interpolate(line, stations, np.concatenate([[first], inner, [last]]))


def _joined(line: Points, following: Points, change_m: float) -> Points:
    """Two lines beside each other joined by a cubic Hermite curve that takes half of the change from each."""
    before, after = arc_length(line), arc_length(following)
    leave = max(before[-1] - change_m / 2, before[-1] * 0.25)
    arrive = min(change_m / 2, after[-1] * 0.75)
    head = _cut(line, 0.0, leave / before[-1])
    tail = _cut(following, arrive / after[-1], 1.0)
    start, end = head[-1], tail[0]
    curve = cubic(start, unit(head[-1] - head[-2]), end, unit(tail[1] - tail[0]))
    return np.concatenate([head, curve, tail])


def cubic(start: Points, start_direction: Points, end: Points, end_direction: Points) -> Points:
    """Points (n, 2) between two points on a cubic Hermite curve that leaves and arrives in the unit directions (2,)."""
    distance = float(np.linalg.norm(end - start))
    share = np.linspace(0.0, 1.0, max(int(distance / SPACING_M), 2) + 1)[1:-1, None]
    curve: Points = (
        (2 * share**3 - 3 * share**2 + 1) * start
        + (share**3 - 2 * share**2 + share) * start_direction * distance
        + (-2 * share**3 + 3 * share**2) * end
        + (share**3 - share**2) * end_direction * distance
    )
    return curve


def _bent(line: Points, position: Points, through: Points, change_m: float) -> Points:
    """The line shifted sideways to pass through a point; it leaves at the ego and comes back behind the point."""
    stations = arc_length(line)
    target, offset = project(line, through)
    begin = max(project(line, position)[0], target - change_m)
    if target - begin < 1.0 or abs(offset) > LARGEST_BEND_M:
        return line
    offset = float(np.clip(offset, -(target - begin) / BEND_LENGTH, (target - begin) / BEND_LENGTH))
    share = np.clip((stations - begin) / (0.8 * (target - begin)), 0.0, 1.0)
    back = np.clip((target + change_m + 10.0 - stations) / change_m, 0.0, 1.0)
    weight = (share**2 * (3 - 2 * share)) * (back**2 * (3 - 2 * back))
    along = np.gradient(line, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    bent: Points = line + offset * weight[:, None] * normal
    return bent


def _smooth(line: Points) -> Points:
    even = evenly(line)
    return gaussian(even, SMOOTHING_M / SPACING_M) if len(even) > 3 else even


def evenly(line: Points) -> Points:
    """The line with points about one spacing apart."""
    line = without_repeats(line, 1e-2)
    return resample(line, max(round(float(arc_length(line)[-1]) / SPACING_M), 2) + 1)


def straight_on_from(before: Points, end: Points, length_m: float) -> Points:
    """Points one spacing apart that go straight on from ``end``, without ``end``."""
    count = int(np.ceil(length_m / SPACING_M))
    return end + np.arange(1, count + 1)[:, None] * SPACING_M * unit(end - before)


def unit(vector: Points) -> Points:
    """A vector (2,) made one long."""
    one_long: Points = vector / max(float(np.linalg.norm(vector)), 1e-9)
    return one_long
