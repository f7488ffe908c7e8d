"""Oriented rectangles (length, width) in the plane in m, and their overlaps, by separating axes.

Two convex quadrilaterals are disjoint if and only if their projections onto the normal of one of their sides are.
Shapely and commonroad-drivability-checker give the same results, but create an object for each rectangle; this module
compares whole recordings as arrays. For one pair, it tests the corners until it finds a separating axis. For many
pairs, it uses a closed form of centres and headings for all axes at once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .polyline import Points, Values

_Indices = NDArray[np.intp]


def oriented_rectangle(center: Points, heading_rad: float, size_m: tuple[float, float]) -> Points:
    """Return the corners of a rectangle (length, width), shape (4, 2), counter-clockwise from the front left."""
    length, width = size_m
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)]) * length / 2
    across = np.array([-math.sin(heading_rad), math.cos(heading_rad)]) * width / 2
    return np.stack(
        [center + along + across, center - along + across, center - along - across, center + along - across]
    )


def rectangles_overlap(first: Points, second: Points, shrink_m: float = 0.0) -> bool:
    """Return True if two rectangles, given by corners (4, 2), overlap by more than ``shrink_m`` along every axis."""
    for corners in (first, second):
        edges = np.roll(corners, -1, axis=0) - corners
        for edge in edges[:2]:
            norm = math.hypot(edge[0], edge[1])
            if norm < 1e-9:  # a rectangle without length or width: the other side decides
                continue
            axis = np.array([-edge[1], edge[0]]) / norm
            near, far = first @ axis, second @ axis
            if near.max() - shrink_m <= far.min() or far.max() - shrink_m <= near.min():
                return False
    return True


@dataclass(frozen=True)
class BoxTrack:
    """A rectangle at every step from 0: centres (n, 2) in m, headings (n,) in rad, length and width in m."""

    positions: Points
    headings_rad: Values
    size_m: tuple[float, float]


@dataclass(frozen=True)
class FirstOverlap:
    """Two tracks by their indices (``first`` < ``second``), and their first step of overlap."""

    first: int
    second: int
    step: int


def first_overlaps(tracks: Sequence[BoxTrack]) -> list[FirstOverlap]:
    """Return all pairs of tracks that overlap at a common step, each once, in order of their indices."""
    pairs: list[FirstOverlap] = []
    boxes = _Boxes.of(tracks)
    for index in range(len(tracks)):
        others, steps = boxes.near(index)
        if not len(others):
            continue
        hit = boxes.overlap(index, others, steps)
        pairs += [
            FirstOverlap(index, int(other), int(steps[hit & (others == other)].min()))
            for other in np.unique(others[hit])
        ]
    return pairs


@dataclass(frozen=True)
class _Boxes:
    """Tracks as arrays, NaN after a track's end: centres (n, steps, 2), headings (n, steps), half sizes (n, 2).

    ``low``, ``high``: the corners (n, 2) of the box around each track's centres. ``reach_m``: diagonals (n,).
    """

    centers: NDArray[np.float64]
    headings_rad: Points
    half_m: Points
    low: Points
    high: Points
    reach_m: Values

    @classmethod
    def of(cls, tracks: Sequence[BoxTrack]) -> "_Boxes":
        count, steps = len(tracks), max((len(track.positions) for track in tracks), default=0)
        centers, headings = np.full((count, steps, 2), np.nan), np.full((count, steps), np.nan)
        low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
        for index, track in enumerate(tracks):
            length = len(track.positions)
            centers[index, :length], headings[index, :length] = track.positions, track.headings_rad
            if length:
                low[index], high[index] = track.positions.min(axis=0), track.positions.max(axis=0)
        half_m = np.array([track.size_m for track in tracks]).reshape(-1, 2) / 2
        reach_m = np.array([math.hypot(*track.size_m) for track in tracks])
        return cls(centers, headings, half_m, low, high, reach_m)

    def near(self, index: int) -> tuple[_Indices, _Indices]:
        """Return (track, step), both (k,), of all later tracks at steps where the squares around both
        rectangles meet.
        """
        reach_m = (self.reach_m[index] + self.reach_m[index + 1 :, None]) / 2
        is_separate = (self.low[index + 1 :] - self.high[index] > reach_m) | (
            self.low[index] - self.high[index + 1 :] > reach_m
        )
        later = np.flatnonzero(~is_separate.any(axis=1))
        apart = np.abs(self.centers[index + 1 + later] - self.centers[index])
        rows, steps = np.nonzero((apart < reach_m[later, :, None]).all(axis=2))
        return index + 1 + later[rows], steps

    def overlap(self, index: int, others: _Indices, steps: _Indices) -> NDArray[np.bool_]:
        """Return a mask (k,): whether a track overlaps each of the tracks (k,) at steps (k,), by separating axes."""
        apart = self.centers[others, steps] - self.centers[index, steps]
        here_rad, there_rad = self.headings_rad[index, steps], self.headings_rad[others, steps]
        their_half = self.half_m[others]
        own_half = np.broadcast_to(self.half_m[index], their_half.shape)
        turn = there_rad - here_rad
        cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        hit = np.ones(len(others), dtype=bool)
        for mine, theirs, angle in ((own_half, their_half, here_rad), (their_half, own_half, there_rad)):
            along = np.abs(apart[:, 0] * np.cos(angle) + apart[:, 1] * np.sin(angle))
            across = np.abs(apart[:, 1] * np.cos(angle) - apart[:, 0] * np.sin(angle))
            hit &= along < mine[:, 0] + theirs[:, 0] * cos + theirs[:, 1] * sin
            hit &= across < mine[:, 1] + theirs[:, 0] * sin + theirs[:, 1] * cos
        return hit
