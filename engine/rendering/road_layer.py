"""The road: lanelets, their edges and directions, stop lines, traffic lights and the goal."""

from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, length_m, point_at
from plannerforge.engine.rendering.palette import (
    DIRECTION,
    EGO_COLOUR,
    INK,
    LIGHT_GREEN,
    LIGHT_RED,
    LIGHT_YELLOW,
    ROAD,
    ROAD_EDGE,
)
from plannerforge.engine.rendering.scene_content import LaneletShape, SceneContent
from plannerforge.engine.rendering.viewport import Viewport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LANE_LINE = "#FFFFFF"
_LIGHT_COLOURS = {"red": LIGHT_RED, "redYellow": LIGHT_RED, "yellow": LIGHT_YELLOW, "green": LIGHT_GREEN}


def draw_road(axes: "Axes", content: SceneContent, viewport: Viewport) -> None:
    """Draw the lanelets that the viewport shows, with direction marks."""
    from matplotlib.collections import LineCollection, PolyCollection

    shown = [lanelet for lanelet in content.lanelets if _may_be_seen(lanelet, viewport)]
    axes.add_collection(
        PolyCollection(
            [lanelet.outline for lanelet in shown], facecolors=ROAD, edgecolors=ROAD, linewidths=0.8, zorder=1
        )
    )
    plain = [lanelet for lanelet in shown if not lanelet.inside_intersection]
    lines = [side for lanelet in plain for side, edge in _sides(lanelet) if not edge]
    edges = [side for lanelet in plain for side, edge in _sides(lanelet) if edge]
    axes.add_collection(LineCollection(lines, colors=LANE_LINE, linewidths=1.4, linestyles=(0, (7, 5)), zorder=2))
    axes.add_collection(LineCollection(edges, colors=ROAD_EDGE, linewidths=1.0, zorder=2.1))
    marks = [mark for lanelet in shown for mark in _direction_marks(lanelet, viewport)]
    axes.add_collection(PolyCollection(marks, facecolors=DIRECTION, edgecolors="none", zorder=2.2))


def draw_stop_lines(axes: "Axes", content: SceneContent) -> None:
    """Draw the stop lines."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(content.stop_lines), colors=INK, linewidths=2.6, zorder=2.6))


def draw_signals(axes: "Axes", content: SceneContent, step: int, viewport: Viewport) -> None:
    """Draw the traffic lights in the colour of the moment.

    The shape says the colour as well: red square, yellow diamond, green circle.
    """
    shapes = {"red": "s", "redYellow": "s", "yellow": "D", "green": "o"}
    seen = [signal for signal in content.signals if viewport.contains(signal.position[None, :])]
    for signal in seen:
        state = signal.state_at(step)
        axes.plot(
            *signal.position,
            marker=shapes.get(state, "o"),
            color=_LIGHT_COLOURS.get(state, "#C8C8C8"),
            markeredgecolor=INK,
            markersize=7,
            linestyle="none",
            zorder=6,
        )


def draw_goal(axes: "Axes", content: SceneContent) -> None:
    """Draw the goal regions, hatched in the ego's colour."""
    from matplotlib.collections import PolyCollection

    polygons = [polygon for goal in content.goals for polygon in goal.polygons]
    hatched = PolyCollection(
        polygons, facecolors="none", edgecolors=EGO_COLOUR, hatch="////", linewidths=1.2, alpha=0.55, zorder=2.5
    )
    axes.add_collection(hatched)


def _may_be_seen(lanelet: LaneletShape, viewport: Viewport) -> bool:
    low, high = lanelet.outline.min(axis=0), lanelet.outline.max(axis=0)
    beside = high[0] < viewport.x_min or low[0] > viewport.x_max
    return not (beside or high[1] < viewport.y_min or low[1] > viewport.y_max)


def _sides(lanelet: LaneletShape) -> tuple[tuple[Points, bool], tuple[Points, bool]]:
    return (lanelet.left, lanelet.left_is_edge), (lanelet.right, lanelet.right_is_edge)


def _direction_marks(lanelet: LaneletShape, viewport: Viewport) -> list[Points]:
    """Small triangles along the centre line, one every eighth of the picture, at least one a lanelet."""
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
