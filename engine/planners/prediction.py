"""What the planner is told of the others' future."""

import math
from collections.abc import Callable

import numpy as np

from plannerforge.engine.geometry.polyline import Points, wrap_angle
from plannerforge.engine.planners.interface import EgoState, PredictedObstacle
from plannerforge.engine.planners.traffic import Traffic
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.runs import Prediction

SENSOR_RADIUS_M = 80.0
REAR_CONE_RAD = math.radians(20.0)
REAR_CONE_FROM_M = 6.0
MOVING_VARIANCE_M2 = 0.1
STANDING_VARIANCE_M2 = 0.02
LENGTH_MARGIN_M = 0.5
WIDTH_MARGIN_M = 0.2

Predictor = Callable[[Track, int, int, float], PredictedObstacle]


def predictor(name: Prediction) -> Predictor:
    """The function that predicts one track.

    Raises:
        UnknownName: no such prediction.
    """
    predictors: dict[str, Predictor] = {"constant_velocity": constant_velocity, "ground_truth": ground_truth}
    if name not in predictors:
        raise UnknownName(f"there is no prediction '{name}'", valid=predictors)
    return predictors[name]


def observe(
    traffic: Traffic, ego: EgoState, predict: Predictor, steps: int, step_s: float
) -> tuple[PredictedObstacle, ...]:
    """All obstacles within 80 m of the ego with their predicted motion over ``steps`` steps from now on.

    As the reference does, whoever follows straight behind (a cone of 20°, farther than 6 m) is left out of a guessed
    future: the ego need not flee from followers that would react. Where the future is known to be the recording, they
    are seen, because recorded followers do not react.
    """
    seen = []
    blind = predict is not ground_truth
    for track in traffic.moving:
        index = track.index_at(ego.step)
        if index is not None and _visible(track.positions[index], ego, blind_behind=blind):
            seen.append(predict(track, index, steps, step_s))
    standing = [track for track in traffic.standing if _visible(track.positions[0], ego, blind_behind=blind)]
    return tuple(seen + [_standing(track, steps) for track in standing])


def constant_velocity(track: Track, index: int, steps: int, step_s: float) -> PredictedObstacle:
    """Straight on along the present heading with the present speed; the body grows by 0.5 m × 0.2 m of margin."""
    heading, speed = float(track.headings_rad[index]), float(track.speeds_mps[index])
    ahead = np.arange(steps + 1)[:, None] * step_s * speed * np.array([math.cos(heading), math.sin(heading)])
    return PredictedObstacle(
        obstacle_id=track.obstacle_id,
        positions=track.positions[index] + ahead,
        headings_rad=np.full(steps + 1, heading),
        covariance=np.eye(2) * MOVING_VARIANCE_M2,
        length_m=track.length_m + LENGTH_MARGIN_M,
        width_m=track.width_m + WIDTH_MARGIN_M,
        speed_mps=speed,
    )


def ground_truth(track: Track, index: int, steps: int, step_s: float) -> PredictedObstacle:
    """The recorded future itself; it ends where the recording ends."""
    del step_s
    future = slice(index, index + steps + 1)
    return PredictedObstacle(
        obstacle_id=track.obstacle_id,
        positions=track.positions[future],
        headings_rad=track.headings_rad[future],
        covariance=np.eye(2) * MOVING_VARIANCE_M2,
        length_m=track.length_m,
        width_m=track.width_m,
        speed_mps=float(track.speeds_mps[index]),
    )


def _standing(track: Track, steps: int) -> PredictedObstacle:
    return PredictedObstacle(
        obstacle_id=track.obstacle_id,
        positions=np.repeat(track.positions[:1], steps + 1, axis=0),
        headings_rad=np.repeat(track.headings_rad[:1], steps + 1),
        covariance=np.eye(2) * STANDING_VARIANCE_M2,
        length_m=track.length_m,
        width_m=track.width_m,
    )


def _visible(position: Points, ego: EgoState, *, blind_behind: bool) -> bool:
    offset = position - ego.position
    distance = float(np.hypot(*offset))
    bearing = wrap_angle(math.atan2(offset[1], offset[0]) - ego.heading_rad)
    follows = blind_behind and distance > REAR_CONE_FROM_M and math.pi - abs(bearing) < REAR_CONE_RAD / 2
    return distance <= SENSOR_RADIUS_M and not follows
