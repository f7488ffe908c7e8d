"""The vehicles of one moment: oriented rectangles in the colour of their class, with their ids."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Points, oriented_rectangle
from ..vehicles import EGO_SIZE_M
from .canvas import EGO_COLOUR, INK, SMALL_PT, class_colour, series_style
from .content import DrivenPath, SceneContent, Viewport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# ---------- labels
# Placing the ids of vehicles so that no two labels, and no label and vehicle, cover each other.

Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max in pixels."""
_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (0.8, 0.8), (-0.8, 0.8), (0.8, -0.8), (-0.8, -0.8))


@dataclass(frozen=True)
class LabelWish:
    """A text that belongs to a point in pixels; ``reach_px``: half the width and height of the thing around it."""

    key: int
    text: str
    point_px: tuple[float, float]
    reach_px: tuple[float, float]


@dataclass(frozen=True)
class _PlacedLabel:
    """Where a label's centre goes, and the point that it belongs to."""

    key: int
    text: str
    center_px: tuple[float, float]
    point_px: tuple[float, float]
    is_far: bool


def place_labels(
    wishes: Sequence[LabelWish], occupied: Sequence[Box], frame: Box, character_px: tuple[float, float]
) -> tuple[tuple[_PlacedLabel, ...], tuple[int, ...]]:
    """Place labels greedily in the given order, the important ones first.

    Returns:
        The placed labels, and the keys of those for which no free place was found.
    """
    taken = list(occupied)
    placed: list[_PlacedLabel] = []
    left_out: list[int] = []
    for wish in wishes:
        width, height = character_px[0] * len(wish.text), character_px[1]
        for center, is_far in _candidates(wish, width, height):
            box = (center[0] - width / 2, center[1] - height / 2, center[0] + width / 2, center[1] + height / 2)
            if _inside(box, frame) and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                placed.append(_PlacedLabel(wish.key, wish.text, center, wish.point_px, is_far))
                break
        else:
            left_out.append(wish.key)
    return tuple(placed), tuple(left_out)


def _bounding_box(points_px: Points, margin_px: float = 1.0) -> Box:
    """The box around points in pixels."""
    low, high = np.asarray(points_px).min(axis=0) - margin_px, np.asarray(points_px).max(axis=0) + margin_px
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _candidates(wish: LabelWish, width: float, height: float) -> Iterator[tuple[tuple[float, float], bool]]:
    for ring in (0.0, 12.0, 26.0):
        away_x, away_y = (
            reach + 3.0 + ring + size / 2 for reach, size in zip(wish.reach_px, (width, height), strict=True)
        )
        for x, y in _DIRECTIONS:
            yield (wish.point_px[0] + x * away_x, wish.point_px[1] + y * away_y), ring > 0


def _inside(box: Box, frame: Box) -> bool:
    return box[0] >= frame[0] and box[1] >= frame[1] and box[2] <= frame[2] and box[3] <= frame[3]


def _overlap(first: Box, second: Box) -> bool:
    return first[0] < second[2] and second[0] < first[2] and first[1] < second[3] and second[1] < first[3]


# ---------- traffic_layer
# The vehicles of one moment: oriented rectangles in the colour of their class, with their ids.

EGO_KEY = -1
"""Stands for the egos among the labels; obstacle ids are positive."""


@dataclass(frozen=True)
class VehicleShape:
    """A vehicle at one moment: corners (4, 2) counter-clockwise from the front left."""

    vehicle_id: int
    kind: str
    corners: Points
    center: Points


@dataclass(frozen=True)
class NamedOutline:
    """Corners (n, 2) of something that gets a label, such as an ego."""

    name: str
    corners: Points


@dataclass(frozen=True)
class TrafficDrawn:
    """Which vehicles carry a label, which are in view without one, and how many are there but outside the view."""

    labelled: tuple[int, ...]
    unlabelled: tuple[int, ...]
    outside: int

    def counts(self) -> str:
        """How many vehicles are in view, without a label, and outside the picture."""
        seen = len(self.labelled) + len(self.unlabelled)
        parts = [f"{seen} vehicle{'' if seen == 1 else 's'} in view"]
        if self.unlabelled:
            parts.append(f"{len(self.unlabelled)} of them without label")
        if self.outside:
            parts.append(f"{self.outside} outside")
        return ", ".join(parts)


def vehicles_at(content: SceneContent, step: int) -> list[VehicleShape]:
    """All vehicles and standing obstacles that are there at a step, by id."""
    found = []
    for track in content.tracks.values():
        index = track.index_at(step)
        if index is None:
            continue
        center = track.positions[index]
        corners = oriented_rectangle(center, float(track.headings_rad[index]), (track.length_m, track.width_m))
        found.append(VehicleShape(track.obstacle_id, track.kind, corners, center))
    found += [
        VehicleShape(obstacle.obstacle_id, obstacle.kind, obstacle.corners, obstacle.corners.mean(axis=0))
        for obstacle in content.standing
    ]
    return sorted(found, key=lambda vehicle: vehicle.vehicle_id)


def draw_vehicles(axes: "Axes", vehicles: Sequence[VehicleShape], *, zorder: float = 5.0) -> list["object"]:
    """Draw rectangles with a dark nose at the front; returns the artists."""
    from matplotlib.collections import PolyCollection

    bodies = PolyCollection(
        [vehicle.corners for vehicle in vehicles],
        facecolors=[class_colour(vehicle.kind) for vehicle in vehicles],
        edgecolors=INK,
        linewidths=0.8,
        zorder=zorder,
    )
    noses = PolyCollection(
        [_nose(vehicle.corners) for vehicle in vehicles], facecolors=INK, edgecolors="none", zorder=zorder + 0.1
    )
    axes.add_collection(bodies)
    axes.add_collection(noses)
    return [bodies, noses]


def _nose(corners: Points) -> Points:
    """The triangle that marks the front of a rectangle, shape (3, 2)."""
    front = (corners[0] + corners[3]) / 2
    back = (corners[1] + corners[2]) / 2
    inset = 0.28 * (back - front)
    return np.stack([front, corners[0] + inset, corners[3] + inset])


def label_vehicles(
    axes: "Axes",
    vehicles: Sequence[VehicleShape],
    egos: Sequence[NamedOutline],
    near: Points,
    viewport: Viewport,
    keep_free: Sequence[Points] = (),
) -> TrafficDrawn:
    """Write the ids beside the vehicles in view, those nearest to ``near`` first.

    Args:
        axes: drawn with their final limits and position.
        vehicles: all vehicles of the moment.
        egos: the egos, which no label may cover and which are labelled first.
        near: the point of interest.
        viewport: what the axes show.
        keep_free: further points (n, 2) whose boxes no label may cover.
    """
    to_pixels = axes.transData.transform
    seen = [vehicle for vehicle in vehicles if viewport.contains(vehicle.corners)]
    seen.sort(key=lambda vehicle: (float(np.linalg.norm(vehicle.center - near)), vehicle.vehicle_id))
    occupied = [_bounding_box(to_pixels(vehicle.corners)) for vehicle in seen]
    occupied += [_bounding_box(to_pixels(ego.corners)) for ego in egos]
    occupied += [_bounding_box(to_pixels(points)) for points in keep_free]
    wishes = [_wish(vehicle.vehicle_id, str(vehicle.vehicle_id), to_pixels(vehicle.corners)) for vehicle in seen]
    wishes = [_wish(EGO_KEY, ego.name, to_pixels(ego.corners)) for ego in egos] + wishes
    frame = axes.get_window_extent()
    scale = axes.figure.dpi / 72
    character = (0.68 * SMALL_PT * scale, 1.25 * SMALL_PT * scale)
    placed, left_out = place_labels(wishes, occupied, (frame.x0, frame.y0, frame.x1, frame.y1), character)
    for label in placed:
        _write(axes, label.text, label.center_px, label.point_px if label.is_far else None)
    return TrafficDrawn(
        labelled=tuple(sorted(label.key for label in placed if label.key != EGO_KEY)),
        unlabelled=tuple(sorted(key for key in left_out if key != EGO_KEY)),
        outside=len(vehicles) - len(seen),
    )


def _wish(key: int, text: str, corners_px: Points) -> LabelWish:
    center = corners_px.mean(axis=0)
    half = (corners_px.max(axis=0) - corners_px.min(axis=0)) / 2
    point, reach = (float(center[0]), float(center[1])), (float(half[0]), float(half[1]))
    return LabelWish(key, text, point, reach)


def _write(axes: "Axes", text: str, center_px: tuple[float, float], pointed_at_px: tuple[float, float] | None) -> None:
    from matplotlib.patheffects import withStroke

    back = axes.transData.inverted().transform
    x, y = back(center_px)
    if pointed_at_px is not None:
        x_to, y_to = back(pointed_at_px)
        axes.plot([x, x_to], [y, y_to], color=INK, linewidth=0.6, zorder=6.5)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.text(x, y, text, ha="center", va="center", fontsize=SMALL_PT, path_effects=halo, zorder=7)


# ---------- ego_layer
# The ego and where its runs went: start, driven paths, present position, collisions.


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
    front = Polygon(_nose(corners), closed=True, facecolor=INK, edgecolor="none", alpha=alpha, zorder=5.6)
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
