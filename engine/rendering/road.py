"""The road: lanelets, their edges and directions, stop lines, traffic lights and the goal.

The dashes of lane lines are drawn as pieces of the road, not with a line style. A renderer starts a style's dashes
where it clips the line, so the same road would look different in two pictures side by side.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points, arc_length, interpolate, length_m, point_at, resample, without_repeats
from .canvas import DIRECTION, EGO_COLOUR, INK, PAVEMENT, ROAD, ROAD_EDGE, light_mark
from .content import LaneletShape, ScenarioContent, Viewport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DASH_SHARE, _GAP_SHARE = 1 / 54, 1 / 75
"""Shares of the picture's width (chosen)."""
_ON_SURFACE_M = 0.15
"""An edge that runs this far inside another lanelet is on its surface; neighbours only touch."""
_PIECE_M, _LARGEST_GAP_PIECES = 2.0, 5
"""Length of the judged edge pieces, and the largest number of free pieces between covered ones where lanelets cross."""
_LANE_LINE = "#FFFFFF"


def draw_road(axes: "Axes", content: ScenarioContent, viewport: Viewport) -> None:
    """Draw the static parts: the lanelets in the viewport, direction marks, stop lines and the goal."""
    from matplotlib.collections import LineCollection, PolyCollection

    shown = [lanelet for lanelet in content.lanelets if _may_be_seen(lanelet, viewport)]
    surfaces = [lanelet.outline for lanelet in shown]
    if content.pavements:
        axes.add_collection(PolyCollection(content.pavements, facecolors=PAVEMENT, edgecolors=PAVEMENT, zorder=0.9))
    if content.crossings:
        axes.add_collection(PolyCollection(content.crossings, facecolors=_LANE_LINE, edgecolors="none", zorder=2.3))
    axes.add_collection(PolyCollection(surfaces, facecolors=ROAD, edgecolors=ROAD, linewidths=0.8, zorder=1))
    plain = [lanelet for lanelet in shown if not lanelet.inside_intersection]
    sides = [side for one in plain for side in ((one.left, one.left_neighbour), (one.right, one.right_neighbour))]
    edges = outer_edges([line for line, neighbour in sides if neighbour is None], shown)
    axes.add_collection(LineCollection(dashes(dividers(plain), viewport), colors=_LANE_LINE, linewidths=1.4, zorder=2))
    axes.add_collection(LineCollection(edges, colors=ROAD_EDGE, linewidths=1.0, zorder=2.1))
    marks = [mark for lanelet in shown for mark in _direction_marks(lanelet, viewport)]
    axes.add_collection(PolyCollection(marks, facecolors=DIRECTION, edgecolors="none", zorder=2.2))
    goal: Any = {"facecolors": "none", "edgecolors": EGO_COLOUR, "linewidths": 1.2}
    axes.add_collection(PolyCollection(content.goals, hatch="////", alpha=0.55, zorder=2.5, **goal))
    # A small goal may be under a vehicle; its outline stays visible.
    axes.add_collection(PolyCollection(content.goals, alpha=0.8, zorder=6, **goal))
    axes.add_collection(LineCollection(content.stop_lines, colors=INK, linewidths=2.6, zorder=2.6))


def _may_be_seen(lanelet: LaneletShape, viewport: Viewport) -> bool:
    low, high = lanelet.outline.min(axis=0), lanelet.outline.max(axis=0)
    is_outside_x = high[0] < viewport.x_min or low[0] > viewport.x_max
    return not (is_outside_x or high[1] < viewport.y_min or low[1] > viewport.y_max)


def outer_edges(edges: Sequence[Points], lanelets: Sequence[LaneletShape]) -> list[Points]:
    """Return short pieces (2, 2) of the edges, without those that run over another lanelet.

    Where lanelets cross or merge, the edge of one lanelet is on the surface of another, so it is not an edge of the
    road.
    """
    import shapely

    surfaces = shapely.STRtree([shapely.Polygon(lanelet.outline).buffer(-_ON_SURFACE_M) for lanelet in lanelets])
    kept = []
    for edge in edges:
        fine = resample(edge, max(round(length_m(edge) / _PIECE_M), len(edge), 2))
        covered = np.zeros(len(fine) - 1, dtype=bool)
        covered[surfaces.query(shapely.points((fine[:-1] + fine[1:]) / 2), predicate="intersects")[0]] = True
        kept += [fine[index : index + 2] for index in np.flatnonzero(~_without_gaps(covered))]
    return kept


def _without_gaps(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask in which short gaps between covered pieces are covered, since crossing lanelets almost touch."""
    closed = covered.copy()
    for first, second in itertools.pairwise(np.flatnonzero(covered)):
        if second - first <= _LARGEST_GAP_PIECES:
            closed[first:second] = True
    return closed


def dividers(lanelets: Sequence[LaneletShape]) -> Iterator[Points]:
    """Yield the borders (n, 2) that lanelets share with a neighbour, each once."""
    known = {lanelet.lanelet_id: lanelet for lanelet in lanelets}
    for lanelet in lanelets:
        for side, neighbour in ((lanelet.left, lanelet.left_neighbour), (lanelet.right, lanelet.right_neighbour)):
            other = None if neighbour is None else known.get(neighbour)
            is_mutual = other is not None and lanelet.lanelet_id in (other.left_neighbour, other.right_neighbour)
            if neighbour is not None and not (is_mutual and neighbour < lanelet.lanelet_id):
                yield side


def dashes(lines: Iterable[Points], viewport: Viewport) -> list[Points]:
    """Return the dashes (n, 2) of lines within a viewport; they start at a line's first point."""
    dash_m, gap_m = _DASH_SHARE * viewport.width_m, _GAP_SHARE * viewport.width_m
    return [dash for line in lines for dash in _dashes(without_repeats(line), dash_m, gap_m) if viewport.contains(dash)]


def _dashes(line: Points, dash_m: float, gap_m: float) -> Iterator[Points]:
    stations = arc_length(line)
    for begin_m in np.arange(0.0, stations[-1], dash_m + gap_m).tolist():
        end_m = min(begin_m + dash_m, float(stations[-1]))
        between = stations[(begin_m < stations) & (stations < end_m)]
        yield interpolate(line, stations, np.array([begin_m, *between, end_m]))


def _direction_marks(lanelet: LaneletShape, viewport: Viewport) -> list[Points]:
    """Return small triangles along the centre line, spaced by an eighth of the picture, at least one per lanelet."""
    if lanelet.inside_intersection:
        return []
    size = max(viewport.width_m / 110, 0.8)
    length = length_m(lanelet.center)
    if length < 4 * size:
        return []
    count = max(int(length / (viewport.width_m / 8)), 1)
    marks = []
    for station in (np.arange(count) + 0.5) * length / count:
        point, heading = point_at(lanelet.center, float(station))
        along = np.array([np.cos(heading), np.sin(heading)]) * size
        across = np.array([-along[1], along[0]]) * 0.55
        marks.append(np.stack([point + along, point - along * 0.4 + across, point - along * 0.4 - across]))
    return marks


def draw_signals(axes: "Axes", content: ScenarioContent, step: int, viewport: Viewport) -> None:
    """Draw the traffic lights with their marks at a step."""
    for signal in content.signals:
        if not viewport.contains(signal.position[None, :]):
            continue
        marker, colour = light_mark(signal.state_at(step))
        axes.plot(
            *signal.position, marker=marker, color=colour, markeredgecolor=INK, markersize=7, linestyle="none", zorder=6
        )
