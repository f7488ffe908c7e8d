"""Decides whether an ego that respects the speed limit could reach a goal in time on a straight line.

No path to the goal is shorter, so an ego that fails on this line cannot reach the goal in time on any path.
"""

import math
from typing import Any

from ...schemas.errors import UnknownName
from ...schemas.runs import RunRecord
from ..commonroad import kept_recording
from ..vehicles import farthest_m
from .run_set import RunSet


def cannot_be_reached(runs: RunSet, record: RunRecord) -> bool:
    """Return True if the ego cannot reach any goal in time, even straight ahead and up to the speed limit.

    It accelerates as hard as its vehicle can (:func:`~..vehicles.farthest_m`) to the highest limit posted on its lane,
    or to its vehicle's largest speed if no limit is posted; an ego that starts faster keeps its speed. The result is
    False if the file or the goal's position or time is unknown, so True is certain.
    """
    kept = runs.look(record)
    if kept is not None:
        return kept.out_of_reach
    path, known = runs.scenario_path(record), runs.scenario(record)
    if path is None or known is None or not path.is_file():
        return False
    try:
        problem = kept_recording(path).loaded.problem(record.problem_id)
    except UnknownName:  # the file was replaced since the run
        return False
    states = problem.goal.state_list
    start = problem.initial_state
    limit_mps = math.inf if known.limit_kmh is None else known.limit_kmh / 3.6
    vehicle = runs.vehicle(record)
    for state in states:
        place: Any = getattr(state, "position", None)
        shapes = getattr(place, "shapes", (place,))  # lanelets are a group of shapes
        if not all(hasattr(shape, "shapely_object") for shape in shapes):
            return False
        from shapely import Point

        away_m = min(float(shape.shapely_object.distance(Point(start.position))) for shape in shapes)
        time_s = (float(getattr(state.time_step, "end", state.time_step)) - start.time_step) * record.step_s
        if away_m - record.ego_length_m <= farthest_m(float(start.velocity), time_s, vehicle, limit_mps):
            return False
    return bool(states)
