"""Whether a goal can be reached in time at all, by what is certain: a straight way, and a speed that no ego exceeds."""

import math
from typing import Any

import numpy as np

from ...schemas.errors import UnknownName
from ...schemas.runs import RunRecord
from ..commonroad import kept_recording
from .run_set import RunSet

ACCELERATION_MPS2 = 4.0
"""Stronger than passenger cars in traffic accelerate (chosen; ISO 15622 allows cruise control 2 m/s² at speed)."""
UNLIMITED_MPS = 130 / 3.6
"""Where no limit is posted: the advisory speed of German motorways (chosen)."""
OVER_LIMIT = 1.1
"""Planners and recordings drive a little above a limit (chosen)."""


def cannot_be_reached(runs: RunSet, record: RunRecord) -> bool:
    """Whether even straight on, accelerating at 4 m/s² to the speed limit, an ego is at no goal's place in time.

    False where the file, the goal's place or its time is not known: what is told is certain.
    """
    kept = runs.look(record)
    if kept is not None:
        return kept.out_of_reach
    path, known = runs.scenario_path(record), runs.scenario(record)
    if path is None or known is None or not path.is_file():
        return False
    try:
        problem = kept_recording(path).loaded.problem(record.problem_id)
    except UnknownName:  # the file was put in the place of the one that was run
        return False
    states = problem.goal.state_list
    start = problem.initial_state
    limit_mps = UNLIMITED_MPS if known.limit_kmh is None else OVER_LIMIT * known.limit_kmh / 3.6
    for state in states:
        place: Any = getattr(state, "position", None)
        shapes = getattr(place, "shapes", (place,))  # lanelets are a group of shapes
        if not all(hasattr(shape, "shapely_object") for shape in shapes):
            return False
        from shapely import Point

        away_m = min(float(shape.shapely_object.distance(Point(start.position))) for shape in shapes)
        time_s = (float(getattr(state.time_step, "end", state.time_step)) - start.time_step) * record.step_s
        if away_m - record.ego_length_m <= farthest_m(float(start.velocity), limit_mps, time_s):
            return False
    return bool(states)


def farthest_m(speed_mps: float, limit_mps: float, time_s: float) -> float:
    """How far an ego comes that accelerates to a limit and keeps it; one that is faster keeps its speed."""
    limit = max(limit_mps, speed_mps)
    until_s = min((limit - speed_mps) / ACCELERATION_MPS2, time_s)
    return float(
        speed_mps * until_s + ACCELERATION_MPS2 * until_s**2 / 2 + limit * max(time_s - until_s, 0.0)
        if math.isfinite(time_s)
        else np.inf
    )
