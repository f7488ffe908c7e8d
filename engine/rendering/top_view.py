"""A scenario from above at one moment, or two side by side.

Side by side on one map, scenarios are drawn to one scale, and the picture is widened to what differs between them, so
that before and after show what was changed.
"""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points
from .canvas import PICTURE_WIDTH_PX, Drawing, new_figure
from .content import MARGIN_M, ScenarioContent, ScenarioView, Viewport, union, viewport_of
from .furniture import Inventory, draw_legend, draw_scale_bar, inventory, scale_bar_area, write_title
from .road import draw_goal, draw_road, draw_signals, draw_stop_lines
from .vehicles import VehicleCounts, draw_egos, draw_endings, draw_paths, draw_vehicles, label_vehicles, vehicles_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEADER_PX, SIDE_PX = 62, 10
_SECOND_LINE_PX, _LEGEND_ROW_PX, _GAP_PX, _PAIR_WIDTH_PX = 18, 24, 24, 1500
"""Chosen for the sizes of text; a pair is wider, so that each of the two stays readable."""
_MOVED_M = 0.5
"""A vehicle or goal counts as moved from this distance on (chosen): less cannot be seen."""
_LARGEST_COMPARED_M = 400.0
"""A difference that would widen a picture beyond this is left outside: nothing could be recognised in it."""


def draw_picture(views: Sequence[ScenarioView]) -> Drawing:
    """One scenario, or several side by side; where these share a map, with one scale and all differences in view."""
    viewports = [viewport_of(view.content, view.paths, view.step) for view in views]
    if _on_one_map(views):
        viewports = [_widened(functools.reduce(union, viewports), views)] * len(views)
    width = PICTURE_WIDTH_PX if len(views) == 1 else _PAIR_WIDTH_PX
    plot_width = (width - 2 * SIDE_PX - _GAP_PX * (len(views) - 1)) / len(views)
    plot_height = max(plot_width * viewport.height_m / viewport.width_m for viewport in viewports)
    viewports = [fitted(viewport, plot_width / plot_height) for viewport in viewports]
    shown = inventory(views, viewports)
    header = HEADER_PX + (_SECOND_LINE_PX if len(views) > 1 and shown.runs else 0)
    height = figure_height(plot_height, shown, header)
    figure = new_figure(width, height)
    texts = []
    for number, (view, viewport) in enumerate(zip(views, viewports, strict=True)):
        left, bottom = SIDE_PX + number * (plot_width + _GAP_PX), height - header - plot_height
        axes = figure.add_axes((left / width, bottom / height, plot_width / width, plot_height / height))
        counts = _draw_moment(axes, view, viewport)
        write_title(
            figure, view.content.scenario_id, _subtitle(view, counts, alone=len(views) == 1), x=left / width + 0.002
        )
        texts.append(_alt_text(view, counts))
    draw_legend(figure, shown)
    return Drawing(figure, " Beside it: ".join(texts))


def draw_background(axes: "Axes", view: ScenarioView, viewport: Viewport) -> None:
    """Draw all that does not move: road, goal, driven paths, scale bar.

    Args:
        axes: gets the viewport's limits and no ticks.
        view: what to draw.
        viewport: which part of it; must have the shape of the axes.
    """
    _prepare(axes, viewport)
    draw_road(axes, view.content, viewport)
    draw_goal(axes, view.content)
    draw_stop_lines(axes, view.content)
    draw_paths(axes, view.paths)
    draw_scale_bar(axes, viewport)


def _draw_moment(axes: "Axes", view: ScenarioView, viewport: Viewport) -> VehicleCounts:
    """Draw one moment: the background, the lights, the vehicles with their ids, the egos."""
    draw_background(axes, view, viewport)
    draw_signals(axes, view.content, view.step, viewport)
    vehicles = vehicles_at(view.content, view.step)
    draw_vehicles(axes, vehicles)
    egos = draw_egos(axes, view)
    draw_endings(axes, view.paths, view.step)
    return label_vehicles(axes, vehicles, egos, view.focus(), viewport, keep_free=scale_bar_area(viewport))


def figure_height(plot_height_px: float, shown: Inventory, header_px: int = HEADER_PX) -> int:
    """Height of the whole figure in pixels: title, plot and as many legend rows as are needed."""
    return round(header_px + plot_height_px + shown.rows * _LEGEND_ROW_PX + 10)


def _alt_text(view: ScenarioView, counts: VehicleCounts) -> str:
    """What the picture shows, for those who cannot see it."""
    parts = [f"{view.content.scenario_id} from above at {view.time_s:.1f} s: {counts.in_words()}"]
    if counts.labelled:
        parts.append(f"labelled {', '.join(map(str, counts.labelled))}")
    if view.paths:
        parts.append("driven paths of " + "; ".join(path.label for path in view.paths))
    return ", ".join(parts) + "."


def _subtitle(view: ScenarioView, counts: VehicleCounts, *, alone: bool) -> str:
    """Time, speed and counts; beside another scenario the outcomes too, which one legend cannot tell for both."""
    speed = ""
    if len(view.paths) == 1:
        path = view.paths[0]
        speed = f"ego {path.speeds_mps[path.index_at(view.step)]:.1f} m/s · "
    elif view.content.ego_position is not None and not view.paths:
        speed = f"ego starts at {view.content.ego_speed_mps:.1f} m/s · "
    outcomes = " · ".join(path.label for path in view.paths)
    second = f"\n{outcomes}" if outcomes and not alone else ""
    return f"t = {view.time_s:.1f} s · {speed}{counts.in_words()}{second}"


def _prepare(axes: "Axes", viewport: Viewport) -> None:
    axes.set_xlim(viewport.x_min, viewport.x_max)
    axes.set_ylim(viewport.y_min, viewport.y_max)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_edgecolor("#C8C8C8")


def fitted(viewport: Viewport, ratio: float) -> Viewport:
    """The viewport widened to the shape of the axes, so that both scales are the same."""
    width, height = viewport.width_m, viewport.height_m
    wider, higher = max(width, height * ratio), max(height, width / ratio)
    x, y = (viewport.x_min + viewport.x_max) / 2, (viewport.y_min + viewport.y_max) / 2
    return Viewport(x - wider / 2, y - higher / 2, x + wider / 2, y + higher / 2)


def _on_one_map(views: Sequence[ScenarioView]) -> bool:
    """Whether the scenarios have the same lanelets, by their ids."""
    maps = [frozenset(lanelet.lanelet_id for lanelet in view.content.lanelets) for view in views]
    return all(lanelets == maps[0] for lanelets in maps)


def _widened(viewport: Viewport, views: Sequence[ScenarioView]) -> Viewport:
    """The viewport with every goal and vehicle that is elsewhere, or only in one of the views, the nearest first."""
    middle = np.array([viewport.x_min + viewport.x_max, viewport.y_min + viewport.y_max]) / 2
    points = [point for view in views[1:] for point in _differing(views[0], view)]
    for point in sorted(points, key=lambda point: (float(np.linalg.norm(point - middle)), *point.tolist())):
        x, y = point.tolist()
        larger = union(viewport, Viewport(x - MARGIN_M, y - MARGIN_M, x + MARGIN_M, y + MARGIN_M))
        if max(larger.width_m, larger.height_m) <= _LARGEST_COMPARED_M:
            viewport = larger
    return viewport


def _differing(first: ScenarioView, second: ScenarioView) -> list[Points]:
    """Where vehicles are that moved or are in one view only, and both goals where they differ."""
    before, after = _positions(first), _positions(second)
    moved = []
    for key in sorted({*before, *after}):
        places = [positions[key] for positions in (before, after) if key in positions]
        if len(places) == 1 or float(np.linalg.norm(places[0] - places[1])) > _MOVED_M:
            moved += places
    goals = [_goal_centers(view.content) for view in (first, second)]
    same = len(goals[0]) == len(goals[1]) and np.allclose(goals[0], goals[1], atol=_MOVED_M)
    return moved if same else [*moved, *goals[0], *goals[1]]


def _positions(view: ScenarioView) -> dict[int, Points]:
    tracks = view.content.tracks.items()
    return {key: track.positions[index] for key, track in tracks if (index := track.index_at(view.step)) is not None}


def _goal_centers(content: ScenarioContent) -> Points:
    centers = [polygon.mean(axis=0) for goal in content.goals for polygon in goal.polygons]
    return np.array(centers).reshape(-1, 2)
