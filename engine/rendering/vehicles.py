"""The vehicles at one time and the egos of runs: rectangles with a marked front, driven paths, and their ids.

Labels cover neither each other nor any vehicle.
"""

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...schemas.text import counted
from ..geometry import Points, oriented_rectangle
from .canvas import EGO_COLOUR, INK, SMALL_PT, class_colour, series_style
from .content import DrivenPath, ScenarioView, VehicleShape, Viewport

if TYPE_CHECKING:
    from matplotlib.axes import Axes


UNSEEN_DASHES, UNSEEN_ALPHA = (0, (2, 1.5)), 0.45
"""The outline and the opacity of road users that the planner did not get (chosen)."""


def draw_vehicles(axes: "Axes", vehicles: Sequence[VehicleShape], unseen: Set[int] = frozenset()) -> None:
    """Draw rectangles in the colour of their class with a dark front.

    Those in ``unseen``, by id, are pale with a dashed outline.
    """
    from matplotlib.collections import PolyCollection

    for hidden, line, alpha in ((False, "solid", 1.0), (True, UNSEEN_DASHES, UNSEEN_ALPHA)):
        drawn = [vehicle for vehicle in vehicles if (vehicle.vehicle_id in unseen) == hidden]
        if hidden and not drawn:
            continue
        bodies, colours = [vehicle.corners for vehicle in drawn], [class_colour(vehicle.kind) for vehicle in drawn]
        noses = [_nose(corners) for corners in bodies]
        faces = PolyCollection(
            bodies, facecolors=colours, edgecolors=INK, linewidths=0.8, linestyles=[line], zorder=5.0
        )
        fronts = PolyCollection(noses, facecolors=INK, edgecolors="none", zorder=5.1)
        for part in (faces, fronts):
            if hidden:
                part.set_alpha(alpha)
            axes.add_collection(part)


def _nose(corners: Points) -> Points:
    """Return the triangle that marks the front of a rectangle, shape (3, 2)."""
    front = (corners[0] + corners[3]) / 2
    back = (corners[1] + corners[2]) / 2
    inset = 0.28 * (back - front)
    return np.stack([front, corners[0] + inset, corners[3] + inset])


def draw_egos(axes: "Axes", view: ScenarioView, *, start: bool = True) -> list[tuple[str, Points]]:
    """Draw the egos of all runs with their faded starts, or only the ego's start if there are no runs.

    Returns:
        Label and corners (4, 2) of each ego, for placing the labels.
    """
    content = view.content
    begin = None
    if content.ego_position is not None:
        begin = oriented_rectangle(content.ego_position, content.ego_heading_rad, content.ego_size_m)
    later = view.step > content.ego_step
    if begin is not None and (start or not view.paths) and (later or not view.paths):
        _draw_ego(axes, begin, faded=later)
    egos = [path.corners_at(view.step) for path in view.paths]
    for number in reversed(range(len(egos))):
        _draw_ego(axes, egos[number], colour=view.ego_colour(number))
    alone = f"{view.ego_name}'s start" if later and not egos else view.ego_name
    names = [path.name for path in view.paths] if len(view.paths) > 1 else [alone]
    drawn = egos or ([begin] if begin is not None else [])
    return list(zip(names, drawn, strict=False))


def _draw_ego(axes: "Axes", corners: Points, *, colour: str = EGO_COLOUR, faded: bool = False) -> None:
    from matplotlib.patches import Polygon

    alpha = 0.35 if faded else 1.0
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor=INK, linewidth=1.2, alpha=alpha, zorder=5.5))
    axes.add_patch(Polygon(_nose(corners), facecolor=INK, edgecolor="none", alpha=alpha, zorder=5.6))


def draw_paths(axes: "Axes", paths: Sequence[DrivenPath]) -> None:
    """Draw the driven paths in different colours and dash patterns, later paths thinner so that all are visible."""
    for number, path in enumerate(paths):
        colour, dashes = series_style(path.series)
        width = max(4.2 - 1.1 * number, 1.6)
        axes.plot(*path.positions.T, color=colour, linestyle=dashes, linewidth=width, zorder=4 + number / 50)


def draw_endings(axes: "Axes", paths: Sequence[DrivenPath], step: int) -> None:
    """Mark the ends of runs that collided up to this step."""
    style: Any = {"marker": "X", "markersize": 13, "color": "white", "markeredgecolor": INK, "markeredgewidth": 1.6}
    for path in paths:
        hit = path.record.collision
        if hit is not None and hit.obstacle_id is not None and hit.step <= step:
            axes.plot(*path.positions[-1], zorder=6.8, **style)


@dataclass(frozen=True)
class VehicleCounts:
    """The vehicles with a label, the vehicles in view without a label, and the number of those outside the view."""

    labelled: tuple[int, ...]
    unlabelled: tuple[int, ...]
    outside: int

    def in_words(self) -> str:
        """Describe the numbers of vehicles in view, without a label, and outside the picture."""
        seen = len(self.labelled) + len(self.unlabelled)
        parts = [f"{counted(seen, 'vehicle') if seen else 'no vehicle'} in view"]
        if self.unlabelled:
            parts.append(f"{len(self.unlabelled)} of them without a label")
        if self.outside:
            parts.append(f"{self.outside} outside")
        return ", ".join(parts)


_EGO_KEY = -1
"""The egos' key among the labels; obstacle ids are positive."""


def label_vehicles(
    axes: "Axes",
    vehicles: Sequence[VehicleShape],
    egos: Sequence[tuple[str, Points]],
    near: Points,
    viewport: Viewport,
    keep_free: Points,
) -> VehicleCounts:
    """Write the ids next to the vehicles in view, nearest to ``near`` first; return which vehicles have one.

    Args:
        axes: The axes with their final limits and position.
        vehicles: All vehicles at the displayed time.
        egos: Labels and corners of the egos, which are labelled first and which no label may cover.
        near: The point of interest.
        viewport: The visible part of the axes.
        keep_free: Further points (n, 2); no label may cover their bounding box.
    """
    to_pixels = axes.transData.transform
    seen = [vehicle for vehicle in vehicles if viewport.contains(vehicle.corners)]
    seen.sort(key=lambda vehicle: (float(np.linalg.norm(vehicle.center - near)), vehicle.vehicle_id))
    outlines = [*(vehicle.corners for vehicle in seen), *(corners for _, corners in egos), keep_free]
    occupied = [_bounding_box(to_pixels(points)) for points in outlines]
    labels = [_label(_EGO_KEY, name, to_pixels(corners)) for name, corners in egos]
    labels += [_label(vehicle.vehicle_id, str(vehicle.vehicle_id), to_pixels(vehicle.corners)) for vehicle in seen]
    frame = axes.get_window_extent()
    scale = axes.figure.dpi / 72
    character = (0.68 * SMALL_PT * scale, 1.25 * SMALL_PT * scale)
    placed, left_out = place_labels(labels, occupied, (frame.x0, frame.y0, frame.x1, frame.y1), character)
    for place in placed:
        _write(axes, place)
    return VehicleCounts(
        labelled=tuple(sorted(place.label.key for place in placed if place.label.key != _EGO_KEY)),
        unlabelled=tuple(sorted(key for key in left_out if key != _EGO_KEY)),
        outside=len(vehicles) - len(seen),
    )


Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max in pixels."""


@dataclass(frozen=True)
class Label:
    """A text that belongs to a point in pixels; ``reach_px``: half the width and height of the object around it."""

    key: int
    text: str
    point_px: tuple[float, float]
    reach_px: tuple[float, float]


@dataclass(frozen=True)
class _PlacedLabel:
    """A label with the position of its centre; ``is_far``: True if a line must lead to its object."""

    label: Label
    center_px: tuple[float, float]
    is_far: bool


def _label(key: int, text: str, corners_px: Points) -> Label:
    (x, y), half = corners_px.mean(axis=0).tolist(), (corners_px.max(axis=0) - corners_px.min(axis=0)) / 2
    return Label(key, text, (x, y), (float(half[0]), float(half[1])))


def place_labels(
    labels: Sequence[Label], occupied: Sequence[Box], frame: Box, character_px: tuple[float, float]
) -> tuple[tuple[_PlacedLabel, ...], tuple[int, ...]]:
    """Place labels greedily in the given order, in which important labels come first.

    Returns:
        The placed labels, and the keys of those without a free position.
    """
    taken = list(occupied)
    placed: list[_PlacedLabel] = []
    left_out: list[int] = []
    for label in labels:
        width, height = character_px[0] * len(label.text), character_px[1]
        for center, is_far in _candidates(label, width, height):
            box = (center[0] - width / 2, center[1] - height / 2, center[0] + width / 2, center[1] + height / 2)
            if _is_inside(box, frame) and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                placed.append(_PlacedLabel(label, center, is_far))
                break
        else:
            left_out.append(label.key)
    return tuple(placed), tuple(left_out)


_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (0.8, 0.8), (-0.8, 0.8), (0.8, -0.8), (-0.8, -0.8))
"""Directions from a vehicle to its label, in order of preference: above, below, left and right, then diagonally."""
_RINGS_PX = (0.0, 12.0, 26.0)
"""Distances of a label beyond the nearest one; from the second on, a line leads to the vehicle (chosen)."""
_APART_PX = 3.0
"""Distance between a vehicle and its label (chosen)."""


def _candidates(label: Label, width: float, height: float) -> Iterator[tuple[tuple[float, float], bool]]:
    for ring in _RINGS_PX:
        away_x, away_y = (
            reach + _APART_PX + ring + size / 2 for reach, size in zip(label.reach_px, (width, height), strict=True)
        )
        for x, y in _DIRECTIONS:
            yield (label.point_px[0] + x * away_x, label.point_px[1] + y * away_y), ring > 0


def _bounding_box(points_px: Points) -> Box:
    """Return the box around points in pixels, one pixel larger on each side."""
    (x_min, y_min), (x_max, y_max) = points_px.min(axis=0) - 1.0, points_px.max(axis=0) + 1.0
    return float(x_min), float(y_min), float(x_max), float(y_max)


def _is_inside(box: Box, frame: Box) -> bool:
    return box[0] >= frame[0] and box[1] >= frame[1] and box[2] <= frame[2] and box[3] <= frame[3]


def _overlap(first: Box, second: Box) -> bool:
    return first[0] < second[2] and second[0] < first[2] and first[1] < second[3] and second[1] < first[3]


def _write(axes: "Axes", place: _PlacedLabel) -> None:
    from matplotlib.patheffects import withStroke

    back = axes.transData.inverted().transform
    x, y = back(place.center_px)
    if place.is_far:
        x_to, y_to = back(place.label.point_px)
        axes.plot([x, x_to], [y, y_to], color=INK, linewidth=0.6, zorder=6.5)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.text(x, y, place.label.text, ha="center", va="center", fontsize=SMALL_PT, path_effects=halo, zorder=7)
