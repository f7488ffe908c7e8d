"""The ego and where its runs went: start, driven paths, present position, collisions."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, oriented_rectangle
from plannerforge.engine.rendering.driven_path import DrivenPath
from plannerforge.engine.rendering.palette import EGO_COLOUR, INK, series_style
from plannerforge.engine.rendering.scene_content import EGO_SIZE_M, SceneContent
from plannerforge.engine.rendering.traffic_layer import nose

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def ego_corners(content: SceneContent) -> Points | None:
    """Corners of the ego at its start, (4, 2); None without a planning problem."""
    if content.ego_position is None:
        return None
    return oriented_rectangle(content.ego_position, content.ego_heading_rad, EGO_SIZE_M)


def path_corners(path: DrivenPath, step: int) -> Points:
    """Corners of the ego of a run at a step, (4, 2)."""
    index = path.index_at(step)
    size = (path.record.ego_length_m, path.record.ego_width_m)
    return oriented_rectangle(path.positions[index], float(path.headings_rad[index]), size)


def draw_ego(axes: "Axes", corners: Points, *, colour: str = EGO_COLOUR, faded: bool = False) -> list[object]:
    """Draw the ego as a filled rectangle with a nose; faded for where it began."""
    from matplotlib.patches import Polygon

    alpha = 0.35 if faded else 1.0
    body = Polygon(corners, closed=True, facecolor=colour, edgecolor=INK, linewidth=1.2, alpha=alpha, zorder=5.5)
    front = Polygon(nose(corners), closed=True, facecolor=INK, edgecolor="none", alpha=alpha, zorder=5.6)
    axes.add_patch(body)
    axes.add_patch(front)
    return [body, front]


def draw_paths(axes: "Axes", paths: Sequence[DrivenPath]) -> None:
    """Draw the driven paths, each in a colour and a dash pattern of its own; later ones thinner, so none is hidden."""
    for number, path in enumerate(paths):
        colour, dashes = series_style(path.series)
        width = max(4.2 - 1.1 * number, 1.6)
        axes.plot(
            path.positions[:, 0],
            path.positions[:, 1],
            color=colour,
            linestyle=dashes,
            linewidth=width,
            zorder=4 + number / 50,
        )


def draw_endings(axes: "Axes", paths: Sequence[DrivenPath], step: int) -> None:
    """Mark where runs ended in a collision that had happened by this step."""
    hits = [path for path in paths if path.record.collision is not None and path.record.collision.step <= step]
    for path in hits:
        point = path.positions[-1]
        axes.plot(
            *point, marker="X", markersize=13, color="white", markeredgecolor=INK, markeredgewidth=1.6, zorder=6.8
        )


def focus(content: SceneContent, paths: Sequence[DrivenPath], step: int) -> Points:
    """The point of interest: the first run's ego, else the ego's start, else the middle of the map."""
    if paths:
        point: Points = paths[0].positions[paths[0].index_at(step)]
        return point
    if content.ego_position is not None:
        return content.ego_position
    everything = [lanelet.center.mean(axis=0) for lanelet in content.lanelets]
    return np.mean(everything, axis=0) if everything else np.zeros(2)
