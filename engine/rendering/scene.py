"""A picture of one scenario, or of two side by side, at one moment."""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points
from .canvas import PICTURE_WIDTH_PX, new_figure, pixels, save_png
from .content import MARGIN_M, SceneContent, Viewport, union, viewport_of
from .furniture import Inventory, SceneView, draw_legend, draw_scale_bar, inventory, scale_bar_area, write_title
from .road import draw_goal, draw_road, draw_signals, draw_stop_lines
from .vehicles import (
    NamedOutline,
    TrafficDrawn,
    draw_ego,
    draw_endings,
    draw_paths,
    draw_vehicles,
    ego_corners,
    focus,
    label_vehicles,
    path_corners,
    vehicles_at,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# ---------- differences
# Where scenarios that are drawn side by side differ, so that a picture of before and after shows what was changed.

MOVED_M = 0.5
LARGEST_COMPARED_M = 400.0
"""A difference that would widen a picture beyond this is left outside: nothing could be recognised in it."""


def widened(viewport: Viewport, views: Sequence[SceneView]) -> Viewport:
    """The viewport with every goal and vehicle that is elsewhere, or only in one of the views, the nearest first."""
    middle = np.array([viewport.x_min + viewport.x_max, viewport.y_min + viewport.y_max]) / 2
    points = [point for view in views[1:] for point in _differing(views[0], view)]
    for point in sorted(points, key=lambda one: (float(np.linalg.norm(one - middle)), *one.tolist())):
        x, y = point.tolist()
        larger = union(viewport, Viewport(x - MARGIN_M, y - MARGIN_M, x + MARGIN_M, y + MARGIN_M))
        if max(larger.width_m, larger.height_m) <= LARGEST_COMPARED_M:
            viewport = larger
    return viewport


def _differing(first: SceneView, second: SceneView) -> list[Points]:
    before, after = _positions(first), _positions(second)
    found = []
    for key in sorted({*before, *after}):
        places = [positions[key] for positions in (before, after) if key in positions]
        if len(places) == 1 or float(np.linalg.norm(places[0] - places[1])) > MOVED_M:
            found += places
    goals = [_goal_centers(view.content) for view in (first, second)]
    same = len(goals[0]) == len(goals[1]) and np.allclose(goals[0], goals[1], atol=MOVED_M)
    return found if same else [*found, *goals[0], *goals[1]]


def _positions(view: SceneView) -> dict[int, Points]:
    tracks = view.content.tracks.items()
    return {key: track.positions[index] for key, track in tracks if (index := track.index_at(view.step)) is not None}


def _goal_centers(content: SceneContent) -> Points:
    centers = [polygon.mean(axis=0) for goal in content.goals for polygon in goal.polygons]
    return np.array(centers).reshape(-1, 2)


# ---------- scene
# A picture of one scenario, or of two side by side, at one moment.

HEADER_PX, SECOND_LINE_PX, LEGEND_ROW_PX = 62, 18, 24
SIDE_PX, GAP_PX, PAIR_WIDTH_PX = 10, 24, 1500


def draw_background(axes: "Axes", view: SceneView, viewport: Viewport) -> None:
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


def _draw_scene(axes: "Axes", view: SceneView, viewport: Viewport) -> TrafficDrawn:
    """Draw one moment: the background, the lights, the vehicles with their ids, the egos."""
    draw_background(axes, view, viewport)
    draw_signals(axes, view.content, view.step, viewport)
    vehicles = vehicles_at(view.content, view.step)
    draw_vehicles(axes, vehicles)
    egos = draw_egos(axes, view)
    draw_endings(axes, view.paths, view.step)
    near = focus(view.content, view.paths, view.step)
    return label_vehicles(axes, vehicles, egos, near, viewport, keep_free=[scale_bar_area(viewport)])


def draw_picture(views: Sequence[SceneView], path: Path) -> tuple[tuple[int, int], str]:
    """Draw one scene, or several side by side, and write it as PNG.

    Where they share a map, they have one scale, and what differs between them is in view.

    Returns:
        The size in pixels, and the alternative text.
    """
    viewports = [viewport_of(view.content, view.paths, view.step) for view in views]
    if _same_place(views):
        viewports = [widened(functools.reduce(union, viewports), views)] * len(views)
    width = PICTURE_WIDTH_PX if len(views) == 1 else PAIR_WIDTH_PX
    plot_width = (width - 2 * SIDE_PX - GAP_PX * (len(views) - 1)) / len(views)
    plot_height = max(plot_width * viewport.height_m / viewport.width_m for viewport in viewports)
    viewports = [fitted(viewport, plot_width / plot_height) for viewport in viewports]
    shown = inventory(views, viewports)
    header = HEADER_PX + (SECOND_LINE_PX if len(views) > 1 and shown.runs else 0)
    height = figure_height(plot_height, shown, header)
    figure = new_figure(width, height)
    told = []
    for number, (view, viewport) in enumerate(zip(views, viewports, strict=True)):
        left, bottom = SIDE_PX + number * (plot_width + GAP_PX), height - header - plot_height
        axes = figure.add_axes((left / width, bottom / height, plot_width / width, plot_height / height))
        traffic = _draw_scene(axes, view, viewport)
        write_title(
            figure, view.content.scenario_id, _subtitle(view, traffic, alone=len(views) == 1), x=left / width + 0.002
        )
        told.append(alt_text(view, traffic))
    draw_legend(figure, shown)
    image = pixels(figure)
    save_png(image, path)
    return image.size, " Beside it: ".join(told)


def figure_height(plot_height_px: float, shown: Inventory, header_px: int = HEADER_PX) -> int:
    """Height of the whole figure in pixels: title, plot and as many legend rows as are needed."""
    return round(header_px + plot_height_px + shown.rows * LEGEND_ROW_PX + 10)


def alt_text(view: SceneView, traffic: TrafficDrawn) -> str:
    """What the picture shows, for those who cannot see it."""
    parts = [f"{view.content.scenario_id} from above at {view.time_s:.1f} s: {traffic.counts()}"]
    if traffic.labelled:
        parts.append(f"labelled {', '.join(map(str, traffic.labelled))}")
    if view.paths:
        parts.append("driven paths of " + "; ".join(path.label for path in view.paths))
    return ", ".join(parts) + "."


def draw_egos(axes: "Axes", view: SceneView, *, start: bool = True) -> list[NamedOutline]:
    """Draw the egos of all runs, and faded the place where they started; without runs the ego's start.

    Returns:
        Outline and label of each ego, for the placing of labels.
    """
    begin = ego_corners(view.content)
    later = view.step > view.content.ego_step
    if begin is not None and (start or not view.paths) and (later or not view.paths):
        draw_ego(axes, begin, faded=later)
    egos = [path_corners(path, view.step) for path in view.paths]
    for number in reversed(range(len(egos))):
        draw_ego(axes, egos[number], colour=view.ego_colour(number))
    alone = "ego's start" if later and not egos else "ego"
    names = [path.name for path in view.paths] if len(view.paths) > 1 else [alone]
    drawn = egos or ([begin] if begin is not None else [])
    return [NamedOutline(name, corners) for name, corners in zip(names, drawn, strict=False)]


def _subtitle(view: SceneView, traffic: TrafficDrawn, *, alone: bool) -> str:
    """Time, speed and counts; beside another scene the outcomes too, which one legend cannot tell for both."""
    speed = ""
    if len(view.paths) == 1:
        path = view.paths[0]
        speed = f"ego {path.speeds_mps[path.index_at(view.step)]:.1f} m/s · "
    elif view.content.ego_position is not None and not view.paths:
        speed = f"ego starts at {view.content.ego_speed_mps:.1f} m/s · "
    outcomes = " · ".join(path.label for path in view.paths)
    second = f"\n{outcomes}" if outcomes and not alone else ""
    return f"t = {view.time_s:.1f} s · {speed}{traffic.counts()}{second}"


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


def _same_place(views: Sequence[SceneView]) -> bool:
    places = [frozenset(lanelet.lanelet_id for lanelet in view.content.lanelets) for view in views]
    return all(place == places[0] for place in places)
