"""Predicts the motion of the other road users that a planner observes.

A prediction is a function of one track, from its state at an index over a number of steps. Lengths in m, headings in
rad.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import UnknownName
from ...schemas.runs import Prediction
from ...schemas.worlds import LARGEST_RANGE_M
from ..commonroad import Track
from ..geometry import Points, Values, arc_length, headings, project, without_repeats, wrap_angle
from ..network import LaneletGraph
from ..perception import RoadUsers
from ..scene import straight_on
from .interface import EgoState, PredictedObstacle
from .lanes import LaneCorridors

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

Predictor = Callable[[Track, int, int, float], PredictedObstacle]
"""Maps a track, the index of its present state, a number of steps and their duration in s to its predicted motion."""

SENSOR_RADIUS_M = LARGEST_RANGE_M
"""Others with centres farther than this from the ego's are not observed (chosen)."""
_REAR_CONE_RAD, _REAR_CONE_FROM_M = math.radians(20.0), 6.0
"""The cone straight behind the ego, and the distance beyond which others in it are left out; see :func:`observe`."""
_MOVING_VARIANCE_M2, _STANDING_VARIANCE_M2 = 0.1, 0.02
"""Variance of a predicted position in every direction, for moving and for standing obstacles (chosen)."""
_LENGTH_MARGIN_M, _WIDTH_MARGIN_M = 0.5, 0.2
"""The safety margin by which a moving body grows in an estimated future (chosen)."""
_SPREAD_MPS, _SPREAD_ALONG_MPS2 = 0.2, 1.0
"""Growth rate of the deviation in ``growing_covariance``, and the deviation of the unknown acceleration (chosen)."""
_OFFSET_FADES_S = 2.0
"""Time constant with which an offset from the lane's centre fades (chosen)."""
_AHEAD_M = 250.0
"""Length over which a prediction follows lanes; beyond it the prediction is straight (chosen)."""
_SAME_OFFSET_M = 0.5
"""Centre lines with a smaller difference of distances are distinguished by heading (chosen)."""


def predictor(name: Prediction, network: "LaneletNetwork") -> Predictor:
    """Return the function that predicts one track on a network.

    Raises:
        UnknownName: There is no such prediction.
    """
    makers: dict[str, Callable[[], Predictor]] = {
        "constant_velocity": lambda: constant_velocity,
        "growing_covariance": lambda: growing_covariance,
        "lane": lambda: LanePrediction(network),
        "ground_truth": lambda: ground_truth,
    }
    if name not in makers:
        raise UnknownName(f"there is no prediction '{name}'", valid=makers)
    return makers[name]()


def off_the_lanes(predict: Predictor) -> tuple[int, ...]:
    """Return the ids of obstacles that a lane prediction continued straight ahead; empty for other predictions."""
    return tuple(sorted(predict.off_the_lanes)) if isinstance(predict, LanePrediction) else ()


def observe(
    users: RoadUsers, ego: EgoState, predict: Predictor, steps: int, step_s: float
) -> tuple[PredictedObstacle, ...]:
    """Return all obstacles within 80 m of the ego, with their predicted motion over ``steps`` steps.

    As in the reference, an estimated future leaves out followers straight behind (a cone of 20°, farther than 6 m),
    since the ego need not flee from followers that would react. If the recording is the known future, these followers
    are kept, since recorded followers do not react.
    """
    seen = []
    blind = predict is not ground_truth
    for track in users.moving:
        index = track.index_at(ego.step)
        if index is not None and _visible(track.positions[index], ego, blind_behind=blind):
            seen.append(predict(track, index, steps, step_s))
    standing = [track for track in users.standing if _visible(track.positions[0], ego, blind_behind=blind)]
    for track in standing:
        positions = np.repeat(track.positions[:1], steps + 1, axis=0)
        still = _predicted(track, positions, np.repeat(track.headings_rad[:1], steps + 1), 0.0)
        seen.append(replace(still, covariance=np.eye(2) * _STANDING_VARIANCE_M2))
    return tuple(seen)


def _predicted(track: Track, positions: Points, headings_rad: Values, speed_mps: float) -> PredictedObstacle:
    return PredictedObstacle(
        obstacle_id=track.obstacle_id,
        positions=positions,
        headings_rad=headings_rad,
        covariance=np.eye(2) * _MOVING_VARIANCE_M2,
        length_m=track.length_m,
        width_m=track.width_m,
        speed_mps=speed_mps,
        kind=track.kind,
        observed_size_m=(track.length_m, track.width_m),
    )


def constant_velocity(track: Track, index: int, steps: int, step_s: float) -> PredictedObstacle:
    """Predict constant heading and speed; the body grows by a margin of 0.5 m × 0.2 m."""
    heading, speed = float(track.headings_rad[index]), float(track.speeds_mps[index])
    ahead = np.arange(steps + 1)[:, None] * step_s * speed * np.array([math.cos(heading), math.sin(heading)])
    bare = _predicted(track, track.positions[index] + ahead, np.full(steps + 1, heading), speed)
    return replace(bare, length_m=track.length_m + _LENGTH_MARGIN_M, width_m=track.width_m + _WIDTH_MARGIN_M)


def growing_covariance(track: Track, index: int, steps: int, step_s: float) -> PredictedObstacle:
    """Predict constant velocity with a covariance that grows with time t: 0.1 m² + (0.2 m/s · t)² in every direction.

    Along the heading, (½ · 1 m/s² · t²)² is added for an unknown acceleration of standard deviation 1 m/s²: after 3 s
    the deviations are 0.7 m across and 4.6 m along. Other planners read only the straight motion.
    """
    straight = constant_velocity(track, index, steps, step_s)
    time = np.arange(steps + 1) * step_s
    heading = straight.headings_rad[0]
    direction = np.array([math.cos(heading), math.sin(heading)])
    around = (_MOVING_VARIANCE_M2 + (_SPREAD_MPS * time) ** 2)[:, None, None] * np.eye(2)
    along = ((_SPREAD_ALONG_MPS2 / 2 * time**2) ** 2)[:, None, None] * np.outer(direction, direction)
    return replace(straight, covariance=around + along)


@dataclass(frozen=True)
class _CenterLine:
    points: Points
    stations_m: Values
    headings_rad: Values
    first: Points
    """Points of the lanelet with which the line starts, on which vehicles are placed even if the line returns to it."""


@dataclass(frozen=True)
class _LanePath:
    """A line along lanes, and the obstacle's position on it: station and lateral offset (left positive)."""

    line: _CenterLine
    station_m: float
    offset_m: float

    def at(self, stations_m: Values, offsets_m: Values) -> tuple[Points, Values]:
        """Return points (n, 2) and headings (n,) at stations and offsets; beyond its end the line is straight."""
        line = self.line
        middles = (line.stations_m[:-1] + line.stations_m[1:]) / 2
        heading = np.interp(stations_m, middles, line.headings_rad)
        along = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        on_line = np.stack([np.interp(stations_m, line.stations_m, line.points[:, axis]) for axis in (0, 1)], axis=1)
        beyond = np.maximum(stations_m - line.stations_m[-1], 0.0)
        return on_line + across * offsets_m[:, None] + along * beyond[:, None], heading


class LanePrediction:
    """Predicts along the centre line under the obstacle and its straightest successors, at the obstacle's speed.

    The lateral offset and the heading difference fade with a time constant of 2 s. If no lanelet of its direction is
    under it, the obstacle gets constant velocity, and ``off_the_lanes`` records its id.
    """

    def __init__(self, network: "LaneletNetwork") -> None:
        self._network = network
        self._graph = LaneletGraph.of(network)
        self._corridors = LaneCorridors(network)
        self._lines: dict[int, _CenterLine] = {}  # by first lanelet
        self.off_the_lanes: set[int] = set()

    def __call__(self, track: Track, index: int, steps: int, step_s: float) -> PredictedObstacle:
        """Return the predicted motion of one track."""
        straight = constant_velocity(track, index, steps, step_s)
        heading = float(track.headings_rad[index])
        path = self._path_under(track.positions[index], heading)
        if path is None:
            self.off_the_lanes.add(track.obstacle_id)
            return straight
        time: Values = np.asarray(np.arange(steps + 1) * step_s, dtype=np.float64)
        left: Values = np.exp(-time / _OFFSET_FADES_S)
        positions, directions = path.at(path.station_m + straight.speed_mps * time, path.offset_m * left)
        turned = wrap_angle(heading - float(directions[0]))
        return replace(straight, positions=positions, headings_rad=directions + turned * left)

    def _path_under(self, position: Points, heading_rad: float) -> _LanePath | None:
        """Return the line of the best-fitting lanelet under a position, or None if no lanelet has its direction.

        The best line has the nearest centre line (within half a metre), then the best heading there, then the smallest
        turn.
        """
        paths = [self._path(key, position) for key in self._corridors.under(position, heading_rad)]

        def misfit(path: _LanePath) -> tuple[int, float, float]:
            direction = path.at(np.array([path.station_m]), np.zeros(1))[1][0]
            turn = float(np.ptp(path.line.headings_rad))
            offset = round(abs(path.offset_m) / _SAME_OFFSET_M)
            return offset, round(abs(wrap_angle(heading_rad - direction)), 1), round(turn, 3)

        return min(paths, key=misfit, default=None)

    def _path(self, lanelet_id: int, position: Points) -> _LanePath:
        if lanelet_id not in self._lines:
            route = straight_on(self._network, self._graph, (lanelet_id,), _AHEAD_M)
            lines = [np.asarray(self._network.find_lanelet_by_id(key).center_vertices) for key in route]
            points = without_repeats(np.concatenate(lines))
            first = points[: max(len(without_repeats(lines[0])), 2)]
            self._lines[lanelet_id] = _CenterLine(points, arc_length(points), headings(points), first)
        line = self._lines[lanelet_id]
        return _LanePath(line, *project(line.first, position))


def ground_truth(track: Track, index: int, steps: int, step_s: float) -> PredictedObstacle:
    """Return the recorded future; it ends where the recording ends."""
    del step_s
    future = slice(index, index + steps + 1)
    return _predicted(track, track.positions[future], track.headings_rad[future], float(track.speeds_mps[index]))


def _visible(position: Points, ego: EgoState, *, blind_behind: bool) -> bool:
    distance = float(np.hypot(*(position - ego.position)))
    return distance <= SENSOR_RADIUS_M and not (blind_behind and follows(position, ego))


def follows(position: Points, ego: EgoState) -> bool:
    """Return True if a position is straight behind the ego, where :func:`observe` may leave road users out."""
    offset = position - ego.position
    bearing = wrap_angle(math.atan2(offset[1], offset[0]) - ego.heading_rad)
    return float(np.hypot(*offset)) > _REAR_CONE_FROM_M and math.pi - abs(bearing) < _REAR_CONE_RAD / 2
