"""The figures of the ego's own motion in a drive, as ``schemas/measures.py`` defines them.

The figures are computed only here. A run stores those that are fields of ``RunMetrics``, and analysis reports all of
them with their times. Lengths are in m, times in s, angles in rad.
"""

from dataclasses import dataclass

import numpy as np

from .commonroad import Track
from .geometry import Values, wrap_angles


@dataclass(frozen=True)
class MotionSeries:
    """A quantity over a drive; its largest value is the measure ``name``.

    ``values``: one for each driven state, starting at ``first_state``, so the time of the largest value is known.
    """

    name: str
    values: Values
    first_state: int = 1


@dataclass(frozen=True)
class MotionFigures:
    """The measures of a motion: figures of the whole drive by name, and series."""

    totals: dict[str, float]
    series: tuple[MotionSeries, ...]


def motion_figures(ego: Track, accelerations_mps2: Values, steering_rad: Values, step_s: float) -> MotionFigures:
    """Measure a motion over its driven states (n,), including the initial state.

    Args:
        ego: the drive.
        accelerations_mps2: along the path, one per state.
        steering_rad: the angles of the front wheels, one per state.
        step_s: the time between two states.
    """
    along = accelerations_mps2
    lateral = ego.speeds_mps[1:] * wrap_angles(np.diff(ego.headings_rad)) / step_s
    felt = np.column_stack([along[1:], lateral])
    jerk = np.diff(along) / step_s
    planar_jerk = np.concatenate([np.abs(jerk[:1]), np.linalg.norm(np.diff(felt, axis=0), axis=1) / step_s])
    duration_s = (len(ego.positions) - 1) * step_s
    distance_m = float(np.linalg.norm(np.diff(ego.positions, axis=0), axis=1).sum())
    return MotionFigures(
        {
            "duration_s": round(duration_s, 9),
            "distance_m": distance_m,
            "mean_speed_mps": distance_m / duration_s if duration_s else float(ego.speeds_mps[0]),
            "mean_squared_jerk": float((jerk**2).mean()) if len(jerk) else 0.0,
        },
        (
            MotionSeries("maximum_acceleration_mps2", np.maximum(along[1:], 0.0)),
            MotionSeries("maximum_braking_mps2", np.maximum(-along[1:], 0.0)),
            MotionSeries("maximum_lateral_acceleration_mps2", np.abs(lateral)),
            MotionSeries("maximum_planar_acceleration_mps2", np.linalg.norm(felt, axis=1)),
            MotionSeries("maximum_jerk_mps3", np.abs(jerk)),
            MotionSeries("maximum_lateral_jerk_mps3", np.abs(np.diff(lateral)) / step_s, first_state=2),
            MotionSeries("maximum_planar_jerk_mps3", planar_jerk),
            MotionSeries("maximum_steering_rate_radps", np.abs(np.diff(steering_rad) / step_s)),
        ),
    )
