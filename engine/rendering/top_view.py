"""A scenario from above at one time, or two side by side.

Two scenarios on one map have the same scale, and the picture covers their differences, so that a comparison of before
and after shows what changed.
"""

import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points
from .canvas import INK, PICTURE_WIDTH_PX, SMALL_PT, Drawing, new_figure
from .content import MARGIN_M, ScenarioContent, ScenarioView, Viewport
from .furniture import Inventory, draw_legend, write_title
from .road import draw_road, draw_signals
from .vehicles import VehicleCounts, draw_egos, draw_endings, draw_paths, draw_vehicles, label_vehicles

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEADER_PX, SIDE_PX = 62, 10
_SECOND_LINE_PX, _LEGEND_ROW_PX, _GAP_PX, _PAIR_WIDTH_PX = 18, 24, 24, 1500
"""Chosen for the sizes of text; a pair is wider, so that both parts stay readable."""
_MOVED_M = 0.5
"""Smallest visible move of a vehicle or goal (chosen)."""
_LARGEST_COMPARED_M = 400.0
"""A difference that would widen a picture beyond this is left out, since nothing would be recognisable."""


def draw_picture(views: Sequence[ScenarioView]) -> Drawing:
    """Draw scenarios side by side; on a shared map they have one scale, and all differences are in view."""
    viewports = [_viewport(view) for view in views]
    if _on_one_map(views) and all(view.focus_id is None for view in views):
        viewports = [_widened(functools.reduce(Viewport.joined, viewports), views)] * len(views)
    width = PICTURE_WIDTH_PX if len(views) == 1 else _PAIR_WIDTH_PX
    plot_width = (width - 2 * SIDE_PX - _GAP_PX * (len(views) - 1)) / len(views)
    plot_height = max(plot_width * viewport.height_m / viewport.width_m for viewport in viewports)
    viewports = [viewport.fitted(plot_width / plot_height) for viewport in viewports]
    shown = Inventory.of(views, viewports)
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
    return Drawing(figure, " Next to it: ".join(texts))


def _viewport(view: ScenarioView) -> Viewport:
    if view.focus_id is not None:
        return Viewport.near(view.focus())
    return Viewport.of(view.content, view.paths, view.step)


def draw_background(axes: "Axes", view: ScenarioView, viewport: Viewport) -> None:
    """Draw the static parts: road, goal, driven paths, scale bar; the viewport has the shape of the axes."""
    axes.set_xlim(viewport.x_min, viewport.x_max)
    axes.set_ylim(viewport.y_min, viewport.y_max)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_edgecolor("#C8C8C8")
    draw_road(axes, view.content, viewport)
    draw_paths(axes, view.paths)
    _draw_scale_bar(axes, viewport)


def _draw_moment(axes: "Axes", view: ScenarioView, viewport: Viewport) -> VehicleCounts:
    """Draw the scenario and the runs at one time; return the numbers of drawn vehicles."""
    draw_background(axes, view, viewport)
    draw_signals(axes, view.content, view.step, viewport)
    vehicles = view.content.vehicles_at(view.step)
    draw_vehicles(axes, vehicles, view.unseen)
    egos = draw_egos(axes, view)
    draw_endings(axes, view.paths, view.step)
    return label_vehicles(axes, vehicles, egos, view.focus(), viewport, keep_free=_scale_bar_area(viewport))


def _draw_scale_bar(axes: "Axes", viewport: Viewport) -> None:
    """Draw a bar of a round length at the lower left of the axes, on a white background."""
    length = round_length(viewport.width_m / 5)
    x, y = _scale_bar_area(viewport)[0] + (0, viewport.height_m * 0.02)
    tick = viewport.height_m * 0.012
    eastings = [x, x, x, x + length, x + length, x + length]
    axes.plot(eastings, [y + tick, y - tick, y, y, y - tick, y + tick], color=INK, linewidth=1.6, zorder=9)
    ground = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
    place, text = (x + length / 2, y + tick * 1.4), f"{length:g} m"
    axes.text(*place, text, ha="center", va="bottom", fontsize=SMALL_PT, zorder=9, bbox=ground)


def _scale_bar_area(viewport: Viewport) -> Points:
    """Return the lower left and upper right corners of the scale bar's area, in scenario coordinates, shape (2, 2)."""
    low = np.array([viewport.x_min + viewport.width_m * 0.02, viewport.y_min + viewport.height_m * 0.025])
    size = np.array([round_length(viewport.width_m / 5), viewport.height_m * 0.06])
    return np.stack([low, low + size])


def round_length(about_m: float) -> float:
    """Return the largest of 1, 2, 5 × 10ⁿ metres that does not exceed the given length."""
    power = 10.0 ** math.floor(math.log10(about_m))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= about_m)


def figure_height(plot_height_px: float, shown: Inventory, header_px: int = HEADER_PX) -> int:
    """Return the height of the whole figure in pixels: title, plot and the legend rows."""
    return round(header_px + plot_height_px + shown.rows * _LEGEND_ROW_PX + 10)


def _alt_text(view: ScenarioView, counts: VehicleCounts) -> str:
    """Describe the picture for viewers who cannot see it."""
    parts = [f"{view.content.scenario_id} from above at {view.time_s:.1f} s: {counts.in_words()}"]
    if counts.labelled:
        parts.append(f"labels: {', '.join(map(str, counts.labelled))}")
    if view.paths:
        paths = ", ".join(f"{path.name} ({path.record.outcome.replace('_', ' ')})" for path in view.paths)
        parts.append(f"driven path{'s' * (len(view.paths) > 1)}: {paths}")
    if view.ego_name != "ego":
        length_m, width_m = view.ego_size_m
        parts.append(f"{view.ego_name} of {length_m:g} × {width_m:g} m")
    return ", ".join(parts) + "."


def _subtitle(view: ScenarioView, counts: VehicleCounts, *, alone: bool) -> str:
    """Return the time, speed and counts, and in a comparison the outcomes, which a common legend cannot show."""
    speed = ""
    if len(view.paths) == 1:
        path = view.paths[0]
        speed = f"{view.ego_name} {path.speeds_mps[path.index_at(view.step)]:.1f} m/s · "
    elif view.content.ego_position is not None and not view.paths:
        speed = f"{view.ego_name} starts at {view.content.ego_speed_mps:.1f} m/s · "
    outcomes = " · ".join(path.label for path in view.paths)
    second = f"\n{outcomes}" if outcomes and not alone else ""
    return f"t = {view.time_s:.1f} s · {speed}{counts.in_words()}{second}"


def _on_one_map(views: Sequence[ScenarioView]) -> bool:
    """Return True if the scenarios have the same lanelets at the same places; a mirrored map is another one."""
    maps = [{lanelet.lanelet_id: lanelet.center for lanelet in view.content.lanelets} for view in views]
    return all(
        lanelets.keys() == maps[0].keys()
        and all(
            center.shape == maps[0][key].shape and np.allclose(center, maps[0][key], atol=_MOVED_M)
            for key, center in lanelets.items()
        )
        for lanelets in maps[1:]
    )


def _widened(viewport: Viewport, views: Sequence[ScenarioView]) -> Viewport:
    """Return the viewport, widened to include goals and vehicles that differ between the views, nearest first."""
    middle = viewport.middle
    points = [point for view in views[1:] for point in _differing(views[0], view)]
    for point in sorted(points, key=lambda point: (float(np.linalg.norm(point - middle)), *point.tolist())):
        larger = viewport.joined(Viewport.around(point, 2 * MARGIN_M, 2 * MARGIN_M))
        if max(larger.width_m, larger.height_m) <= _LARGEST_COMPARED_M:
            viewport = larger
    return viewport


def _differing(first: ScenarioView, second: ScenarioView) -> list[Points]:
    """Return the positions of vehicles that moved or are in only one view, and both goals if they differ."""
    before, after = (view.content.positions_at(view.step) for view in (first, second))
    moved = []
    for key in sorted({*before, *after}):
        places = [positions[key] for positions in (before, after) if key in positions]
        if len(places) == 1 or float(np.linalg.norm(places[0] - places[1])) > _MOVED_M:
            moved += places
    goals = [_goal_centers(view.content) for view in (first, second)]
    same = len(goals[0]) == len(goals[1]) and np.allclose(goals[0], goals[1], atol=_MOVED_M)
    return moved if same else [*moved, *goals[0], *goals[1]]


def _goal_centers(content: ScenarioContent) -> Points:
    return np.array([polygon.mean(axis=0) for polygon in content.goals]).reshape(-1, 2)
