"""The feasible candidates of one planning step as arrays, for the cost terms that are computed here."""

from dataclasses import dataclass

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.planners.interface import PredictedObstacle
from plannerforge.engine.planners.lane_center import LaneCenters
from plannerforge.engine.planners.lane_corridors import LaneCorridors


@dataclass(frozen=True)
class CandidateBatch:
    """States of n candidates at m steps: centre ``x_m``, ``y_m``, heading, speed, each of shape (n, m).

    They are some of the candidates of a planning step; ``fastest_mps`` is the largest final speed among all.
    ``target_speed_mps``: mean speed that brings the ego to the goal in the time left; None where the goal has no place.
    """

    x_m: Points
    y_m: Points
    heading_rad: Points
    speed_mps: Points
    step_s: float
    fastest_mps: float
    target_speed_mps: float | None
    obstacles: tuple[PredictedObstacle, ...]
    half_length_m: float
    half_width_m: float
    lanes: LaneCenters
    corridors: LaneCorridors
