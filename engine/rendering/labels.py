"""Placing the ids of vehicles so that no two labels, and no label and vehicle, cover each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points

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
class PlacedLabel:
    """Where a label's centre goes, and the point that it belongs to."""

    key: int
    text: str
    center_px: tuple[float, float]
    point_px: tuple[float, float]
    is_far: bool


def place_labels(
    wishes: Sequence[LabelWish], occupied: Sequence[Box], frame: Box, character_px: tuple[float, float]
) -> tuple[tuple[PlacedLabel, ...], tuple[int, ...]]:
    """Place labels greedily in the given order, the important ones first.

    Returns:
        The placed labels, and the keys of those for which no free place was found.
    """
    taken = list(occupied)
    placed: list[PlacedLabel] = []
    left_out: list[int] = []
    for wish in wishes:
        width, height = character_px[0] * len(wish.text), character_px[1]
        for center, is_far in _candidates(wish, width, height):
            box = (center[0] - width / 2, center[1] - height / 2, center[0] + width / 2, center[1] + height / 2)
            if _inside(box, frame) and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                placed.append(PlacedLabel(wish.key, wish.text, center, wish.point_px, is_far))
                break
        else:
            left_out.append(wish.key)
    return tuple(placed), tuple(left_out)


def bounding_box(points_px: Points, margin_px: float = 1.0) -> Box:
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
