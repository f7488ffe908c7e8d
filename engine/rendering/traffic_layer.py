"""The vehicles of one moment: oriented rectangles in the colour of their class, with their ids."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plannerforge.engine.geometry.polyline import Points, oriented_rectangle
from plannerforge.engine.rendering.canvas import SMALL_PT
from plannerforge.engine.rendering.labels import LabelWish, bounding_box, place_labels
from plannerforge.engine.rendering.palette import INK, class_colour
from plannerforge.engine.rendering.scene_content import SceneContent
from plannerforge.engine.rendering.viewport import Viewport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        [nose(vehicle.corners) for vehicle in vehicles], facecolors=INK, edgecolors="none", zorder=zorder + 0.1
    )
    axes.add_collection(bodies)
    axes.add_collection(noses)
    return [bodies, noses]


def nose(corners: Points) -> Points:
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
    occupied = [bounding_box(to_pixels(vehicle.corners)) for vehicle in seen]
    occupied += [bounding_box(to_pixels(ego.corners)) for ego in egos]
    occupied += [bounding_box(to_pixels(points)) for points in keep_free]
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
