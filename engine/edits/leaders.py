"""Behind whom a driven vehicle was, and what road users are called."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.edits.cascade import Resimulated, tracks_after
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scene import NOT_DRIVEN, Scene
from plannerforge.engine.edits.walker_shadows import walker_of
from plannerforge.engine.geometry.polyline import Values
from plannerforge.engine.scenarios.tracks import Track

NEAR_M, NEAR_S, ASIDE_M = 5.0, 2.0, 2.0
"""Somebody so near ahead, by way or by time, and no farther beside, holds a vehicle up."""

LEAST_SHARE = 0.5

Indices = NDArray[np.intp]


def everybody_after(scene: Scene, changes: Changes, result: Resimulated, ego: Track | None) -> dict[int, Track]:
    """All road users as the edits leave them, by id, and the ego as an ordinary driver drives it."""
    found = (*tracks_after(scene, changes, result), *(() if ego is None else (ego,)))
    return {track.obstacle_id: track for track in found}


def leader(track: TouchedTrack, others: Mapping[int, Track], indices: Indices) -> int | None:
    """Behind whom a vehicle was for most of some steps (n,), which count from its first one; None for nobody."""
    found = []
    for key, other in others.items():
        there = indices + (track.first_step - other.first_step)
        both = (there >= 0) & (there < len(other.positions))
        if key == track.vehicle_id or both.sum() <= LEAST_SHARE * len(indices):
            continue
        gap_m = _gaps_m(track, other, indices[both], there[both])
        near = gap_m <= np.maximum(NEAR_M, NEAR_S * track.motion.speeds_mps[indices[both]])
        if near.sum() > LEAST_SHARE * len(indices):
            found.append((-int(near.sum()), float(gap_m[near].mean()), key))
    return min(found)[2] if found else None


def in_words(scene: Scene, key: int) -> str:
    """What somebody is called; the ego has its planning problem's id, below zero where an obstacle has it too."""
    if scene.ego is not None and key not in scene.tracks and abs(key) == scene.ego.problem_id:
        return "the ego"
    if key < 0:
        return f"pedestrian {walker_of(key)}"
    is_walker = key in scene.tracks and scene.tracks[key].kind in NOT_DRIVEN
    return f"{'pedestrian' if is_walker else 'vehicle'} {key}"


def _gaps_m(track: TouchedTrack, other: Track, indices: Indices, there: Indices) -> Values:
    """The room between two vehicles at some steps (n,); infinite where the other is not right ahead."""
    heading = track.motion.headings_rad[indices]
    x, y = (other.positions[there] - track.motion.positions[indices]).T
    ahead, aside = x * np.cos(heading) + y * np.sin(heading), y * np.cos(heading) - x * np.sin(heading)
    room_m = ahead - (track.length_m + other.length_m) / 2
    return np.where((ahead > 0.0) & (np.abs(aside) <= ASIDE_M), room_m, np.inf)
