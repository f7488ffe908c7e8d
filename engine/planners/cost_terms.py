"""The cost terms that the C++ core lacks, computed for all feasible candidates at once.

Each takes a :class:`CandidateBatch` and gives raw costs of shape (n,). The meanings of path_length, velocity and
lane_center_offset are those of the Frenetix reference's Python terms; responsibility is our own, see there.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values
from plannerforge.engine.planners.interface import PredictedObstacle
from plannerforge.engine.planners.lane_center import LaneCenters

RESPONSIBILITY_RANGE_M = 10.0
RESPONSIBILITY_SCALE_M = 2.0


@dataclass(frozen=True)
class CandidateBatch:
    """States of n candidates at m steps: centre ``x_m``, ``y_m``, heading, speed, each of shape (n, m).

    ``target_speed_mps``: mean speed that brings the ego to the goal in the time left; None where the goal has no place.
    """

    x_m: Points
    y_m: Points
    heading_rad: Points
    speed_mps: Points
    step_s: float
    target_speed_mps: float | None
    obstacles: tuple[PredictedObstacle, ...]
    half_length_m: float
    lanes: LaneCenters


def path_length(batch: CandidateBatch) -> Values:
    """Length of the candidate in m: the integral of its speed (trapezoids)."""
    return np.asarray(np.trapezoid(batch.speed_mps, dx=batch.step_s, axis=1))


def velocity(batch: CandidateBatch) -> Values:
    """|mean speed − speed that reaches the goal in the time left| in m/s; 0 where the goal has no place."""
    if batch.target_speed_mps is None:
        return np.zeros(len(batch.speed_mps))
    return np.asarray(np.abs(batch.speed_mps.mean(axis=1) - batch.target_speed_mps))


def lane_center_offset(batch: CandidateBatch) -> Values:
    """Mean distance in m to the centre line of the lanelet under each point; 5 m where there is none."""
    points = np.stack([batch.x_m.ravel(), batch.y_m.ravel()], axis=1)
    return np.asarray(batch.lanes.offsets(points).reshape(batch.x_m.shape).mean(axis=1))


def responsibility(batch: CandidateBatch) -> Values:
    """How much the ego itself brings about nearness to others.

    For every obstacle the largest value over time of ``share × exp(−gap / 2 m)``: ``gap`` is the distance between the
    centres less half of both lengths (at least 0), ``share`` the part of the closing speed that the ego contributes,
    in [0, 1]. Driving up to a standing car has share 1; being run into from behind has share 0, because the ego does
    not close in. It needs no reachable sets; the idea (who causes the danger pays) is that of the ethical planner by
    Geisslinger et al. 2023, the formula is ours.
    """
    total = np.zeros(len(batch.x_m))
    ego_x, ego_y = batch.speed_mps * np.cos(batch.heading_rad), batch.speed_mps * np.sin(batch.heading_rad)
    for other in batch.obstacles:
        count = min(len(other.positions), batch.x_m.shape[1])
        away_x = other.positions[:count, 0] - batch.x_m[:, :count]
        away_y = other.positions[:count, 1] - batch.y_m[:, :count]
        distance = np.maximum(np.hypot(away_x, away_y), 1e-6)
        gap = np.maximum(distance - batch.half_length_m - other.length_m / 2, 0.0)
        near = gap < RESPONSIBILITY_RANGE_M
        if not near.any():
            continue
        heading = other.headings_rad[:count]
        own = np.maximum((ego_x[:, :count] * away_x + ego_y[:, :count] * away_y) / distance, 0.0)
        theirs = -other.speed_mps * (np.cos(heading) * away_x + np.sin(heading) * away_y) / distance
        share = own / np.maximum(own + np.maximum(theirs, 0.0), 1e-6)
        closing = own + theirs > 1e-6
        danger = np.where(near & closing, share * np.exp(-gap / RESPONSIBILITY_SCALE_M), 0.0)
        total += danger.max(axis=1)
    return total


CostTerm = Callable[[CandidateBatch], Values]


def own_terms() -> dict[str, CostTerm]:
    """The terms that are computed here, by weight."""
    return {
        "path_length": path_length,
        "lane_center_offset": lane_center_offset,
        "velocity": velocity,
        "responsibility": responsibility,
    }
