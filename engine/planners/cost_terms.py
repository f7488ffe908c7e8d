"""The cost terms that the C++ core lacks, computed for all feasible candidates at once.

Each takes a ``CandidateBatch`` and gives raw costs of shape (n,). The meanings of path_length, velocity and
lane_center_offset are those of the Frenetix reference's Python terms; responsibility is our own, in its own module.
"""

from collections.abc import Callable

import numpy as np

from plannerforge.engine.geometry.polyline import Values
from plannerforge.engine.planners.candidate_batch import CandidateBatch
from plannerforge.engine.planners.responsibility import responsibility


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


CostTerm = Callable[[CandidateBatch], Values]


def own_terms() -> dict[str, CostTerm]:
    """The terms that are computed here, by weight."""
    return {
        "path_length": path_length,
        "lane_center_offset": lane_center_offset,
        "velocity": velocity,
        "responsibility": responsibility,
    }
