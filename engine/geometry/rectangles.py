"""Oriented rectangles (length, width) in the plane in m, and where they overlap, by separating axes.

Two convex quadrilaterals are apart if and only if they are so along the normal of one of their sides. Shapely and
commonroad-drivability-checker decide the same, but make an object of each rectangle: here whole recordings are
compared with each other as arrays. One pair is decided from its corners, up to the first axis that keeps it apart;
many pairs from centres and headings in closed form, all axes at once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .polyline import Points, Values

_Indices = NDArray[np.intp]


def oriented_rectangle(center: Points, heading_rad: float, size_m: tuple[float, float]) -> Points:
    """Corners of a rectangle (length, width), shape (4, 2), counter-clockwise from the front left."""
    length, width = size_m
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)]) * length / 2
    across = np.array([-math.sin(heading_rad), math.cos(heading_rad)]) * width / 2
    return np.stack(
        [center + along + across, center - along + across, center - along - across, center + along - across]
    )


def rectangles_overlap(first: Points, second: Points, shrink_m: float = 0.0) -> bool:
    """Whether two rectangles, given by their corners (4, 2), overlap by more than ``shrink_m`` along every axis."""
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
    """A rectangle at every step from 0 on: centres (n, 2) in m, headings (n,) in rad, length and width in m."""

    positions: Points
    headings_rad: Values
    size_m: tuple[float, float]


@dataclass(frozen=True)
class FirstOverlap:
    """Two tracks by their indices (``first`` < ``second``), and the first step at which they overlap."""

    first: int
    second: int
    step: int


def first_overlaps(tracks: Sequence[BoxTrack]) -> list[FirstOverlap]:
    """All pairs that overlap at a step at which both exist, each once, in order of their indices."""
    pairs: list[FirstOverlap] = []
    for index, track in enumerate(tracks):
        others, steps = _near(index, tracks)
        if not len(others):
            continue
        hit = _overlap_at(track, tracks, others, steps)
        pairs += [
            FirstOverlap(index, int(other), int(steps[hit & (others == other)].min()))
            for other in np.unique(others[hit])
        ]
    return pairs


def _near(index: int, tracks: Sequence[BoxTrack]) -> tuple[_Indices, _Indices]:
    """(track, step), both (k,), of all later tracks where the squares around both rectangles meet."""
    track = tracks[index]
    others: list[_Indices] = [np.empty(0, dtype=np.intp)]
    steps: list[_Indices] = [np.empty(0, dtype=np.intp)]
    for later in range(index + 1, len(tracks)):
        other = tracks[later]
        count = min(len(track.positions), len(other.positions))
        reach = (math.hypot(*track.size_m) + math.hypot(*other.size_m)) / 2
        apart = np.abs(track.positions[:count] - other.positions[:count])
        near = np.flatnonzero((apart[:, 0] < reach) & (apart[:, 1] < reach))
        others.append(np.full(len(near), later))
        steps.append(near)
    return np.concatenate(others), np.concatenate(steps)


def _overlap_at(track: BoxTrack, tracks: Sequence[BoxTrack], others: _Indices, steps: _Indices) -> NDArray[np.bool_]:
    """Whether a track overlaps the others (k,) at the steps (k,): no axis of either rectangle keeps them apart."""
    pairs = list(zip(others, steps, strict=True))
    apart = np.array([tracks[other].positions[step] for other, step in pairs]) - track.positions[steps]
    there_rad = np.array([tracks[other].headings_rad[step] for other, step in pairs])
    here_rad = track.headings_rad[steps]
    their_half = np.array([tracks[other].size_m for other in others]) / 2
    own_half = np.broadcast_to(np.array(track.size_m) / 2, their_half.shape)
    turn = there_rad - here_rad
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    hit = np.ones(len(others), dtype=bool)
    for mine, theirs, angle in ((own_half, their_half, here_rad), (their_half, own_half, there_rad)):
        along = np.abs(apart[:, 0] * np.cos(angle) + apart[:, 1] * np.sin(angle))
        across = np.abs(apart[:, 1] * np.cos(angle) - apart[:, 0] * np.sin(angle))
        hit &= along < mine[:, 0] + theirs[:, 0] * cos + theirs[:, 1] * sin
        hit &= across < mine[:, 1] + theirs[:, 0] * sin + theirs[:, 1] * cos
    return hit
