"""Lane changes of vehicles on wheels: they move aside only as far as they roll.

SUMO spreads a lane change over time: a vehicle that has to stop meanwhile slides on sideways, or is set back where the
next lane is bent otherwise, and the heading that follows from its track turns across the lane.
"""

import math

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values

STEEPEST = 0.3
"""Metres aside for a metre along the lane, at most: 17°, a lane's width in 11 m."""

LARGEST_EXCESS, LARGEST_EXCESS_M = 1.05, 0.01
"""A step longer than the vehicle rolls and slides, by more than this factor and length, is a jump."""


def on_wheels(track: Points, along_m: Values, aside_m: Values) -> Points:
    """A track that follows a vehicle's without jumps, sliding and driving backwards, shape (n, 2).

    Args:
        track: where the vehicle is at each step, shape (n, 2), in metres.
        along_m: how far it has rolled along its lane since the step before, shape (n,).
        aside_m: how far it was moved sideways since the step before, shape (n,), left positive.
    """
    made = [(float(track[0, 0]), float(track[0, 1]))]
    for (goal_x, goal_y), course in zip(track[1:].tolist(), _lane_headings(track, along_m, aside_m), strict=True):
        x, y = made[-1]
        cos, sin = math.cos(course), math.sin(course)
        ahead = max((goal_x - x) * cos + (goal_y - y) * sin, 0.0)
        aside = (goal_y - y) * cos - (goal_x - x) * sin
        aside = min(max(aside, -STEEPEST * ahead), STEEPEST * ahead)
        made.append((x + ahead * cos - aside * sin, y + ahead * sin + aside * cos))
    return np.array(made)


def _lane_headings(track: Points, along_m: Values, aside_m: Values) -> list[float]:
    """Heading of the lane at each step but the first; where it does not show, that of the step before."""
    moved = np.diff(track, axis=0)
    length, wanted = np.hypot(moved[:, 0], moved[:, 1]), np.hypot(along_m[1:], aside_m[1:])
    shows = (length > 1e-3) & (length < LARGEST_EXCESS * wanted + LARGEST_EXCESS_M)
    course = np.arctan2(moved[:, 1], moved[:, 0]) - np.arctan2(aside_m[1:], along_m[1:])
    last = np.maximum.accumulate(np.where(shows, np.arange(len(moved)), int(np.argmax(shows))))
    return list(course[last])
