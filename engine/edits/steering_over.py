"""The motion of a vehicle that changes lanes inside a junction from the hand-over on.

SUMO's vehicles keep their lanes inside junctions. Such a vehicle is driven on the lanelet beside from its first step
on, and the motion that is written steers over from its recorded place: as far aside as it rolls, never standing.
"""

import math
from dataclasses import replace

import numpy as np

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, arc_length, point_at, project
from plannerforge.engine.scenarios.tracks import Track

ACROSS_SHARE = 0.6
"""A vehicle that is so far over is on the other lanelet, whichever of the two is wider."""

PROGRESS_ACROSS = 0.5 - math.sin(math.asin(1.0 - 2.0 * ACROSS_SHARE) / 3.0)
"""The share of the way after which it is across: there 3p² - 2p³ comes to ``ACROSS_SHARE``."""

MOVED_M = 1e-3


def placed_over(scene: Scene, plan: DrivePlan) -> Track:
    """The track that SUMO is shown: at the hand-over the vehicle is on the lanelet that it steers over to."""
    start = plan.start
    if plan.steering_over is None:
        return start
    index, center = plan.from_step - start.first_step, scene.layout.table.lanes[plan.steering_over.lanelet_id].center
    positions, headings = start.positions.copy(), start.headings_rad.copy()
    positions[index], headings[index] = point_at(center, project(center, positions[index])[0])
    return replace(start, positions=positions, headings_rad=headings)


def steered_over(front: Points, expected: Points, onward: Points, within_m: float) -> tuple[Points, list[bool]]:
    """The front track (n, 2) of a vehicle that steers over to SUMO's, and whether it is across at each step.

    Args:
        front: the recorded place of the front at the hand-over, shape (2,), in metres.
        expected: where it is a step later if it rolls straight on, shape (2,).
        onward: SUMO's front track from the first step on, shape (n, 2), in metres.
        within_m: the way along the lane in which the vehicle gets over.
    """
    forward = _directions(onward)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    rolled_m = float(np.linalg.norm(expected - front)) + arc_length(onward)
    offset, progress = expected - onward[0], np.clip(rolled_m / within_m, 0.0, 1.0)
    share = progress**2 * (3.0 - 2.0 * progress)
    missing = (offset @ forward[0]) * forward + (offset @ left[0]) * left
    return onward + missing * (1.0 - share)[:, None], (share >= ACROSS_SHARE).tolist()


def _directions(track: Points) -> Points:
    """The unit vectors (n, 2) along a track (n, 2); where it stands, those before, and at first those after."""
    moved = np.diff(track, axis=0, append=track[-1:])
    length_m = np.linalg.norm(moved, axis=1)
    rolls = length_m > MOVED_M
    last = np.maximum.accumulate(np.where(rolls, np.arange(len(track)), int(np.argmax(rolls))))
    return np.asarray(moved[last] / np.maximum(length_m[last], MOVED_M)[:, None])
