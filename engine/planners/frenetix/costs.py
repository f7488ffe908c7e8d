"""The cost terms that the C++ core lacks, computed for all feasible candidates at once.

Each term takes a ``CandidateBatch`` and returns raw costs of shape (n,). path_length, velocity and lane_center_offset
have the meaning of the Frenetix reference's Python terms; responsibility is our own.

**Responsibility** measures proximity to others for which the ego would be to blame. The idea is that of Geisslinger,
Poszler and Lienkamp, "An ethical trajectory planning algorithm for autonomous vehicles" (Nature Machine Intelligence,
2023). A risk counts against the ego only if the ego enters the area that the other road user may legally reach. A road
user that leaves its own lane or ignores the right of way is itself to blame. The rules and formulas below are ours.

For every candidate and obstacle, the conflict is the step with the smallest gap between their rectangles; it costs
``exp(−gap / 2 m)`` if the ego is responsible. An obstacle's legal reach is its corridor, the lanelets of its direction
under it and all their successors, from full braking (8 m/s²) to acceleration (3 m/s²). The rules, in this order:

1. A standing obstacle counts unless it is behind the ego.
2. An obstacle ahead in the ego's corridor counts, since the ego must keep its distance; a wrong-way driver does not.
3. An obstacle that follows the ego in the same lane does not count.
4. An obstacle without a lane (a pedestrian, a car off the road) counts if it is in front at the conflict.
5. Otherwise the ego must be within the other's legal reach. A conflict elsewhere (the other cuts in or crosses the
   line) counts only if the ego has left its own corridor too.
6. Within that reach the ego is responsible if it has left its own corridor, or if it drives parallel to the other with
   its body over the edge of the other's lane. If the corridors meet, the one that must give way is responsible: by
   signs (yield or stop, priority, crosswalks), otherwise by right before left, left turns after oncoming traffic, and
   in a merge the vehicle behind gives way.

Simplifications: traffic lights and speed limits are ignored, traffic drives on the right, headings keep their present
values, and a car that has cut in counts as ahead from the next planning step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, Values, wrap_angle, wrap_angles
from ...vehicles import HARDEST_BRAKING_MPS2, STANDING_MPS
from ..interface import PredictedObstacle
from ..lanes import Corridor, LaneCenters, LaneCorridors

_RANGE_M = 8.0
"""A wider gap costs nothing (chosen: it would cost less than 0.02)."""
_SCALE_M = 2.0
"""Gap over which the cost falls to 1/e (chosen)."""
_EVERY_S = 0.2
"""Time between the evaluated gaps (chosen)."""
_ACCELERATION_MPS2 = 3.0
"""Acceleration of another vehicle (chosen: that of a brisk car)."""
_SIDE_BY_SIDE_RAD = math.radians(30.0)
"""Headings within this of each other, or of the opposite direction, are parallel (chosen)."""
_LEFT_TURN_RAD = math.radians(20.0)
"""A candidate that turns left by more than this before the conflict turns left (chosen)."""
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class CandidateBatch:
    """States of n candidates at m steps: centre ``x_m``, ``y_m``, heading, speed, each of shape (n, m).

    The batch has some of a planning step's candidates; ``fastest_mps`` is the largest final speed of all of them.
    ``target_speed_mps``: the mean speed that brings the ego to the goal in the time left; None for a goal without
    position.
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


def _path_length(batch: CandidateBatch) -> Values:
    """Return the length of the candidate in m, the integral of its speed (trapezoids)."""
    return np.asarray(np.trapezoid(batch.speed_mps, dx=batch.step_s, axis=1))


def _velocity(batch: CandidateBatch) -> Values:
    """Return |mean speed − speed that reaches the goal in the time left| in m/s; 0 for a goal without a position."""
    if batch.target_speed_mps is None:
        return np.zeros(len(batch.speed_mps))
    return np.asarray(np.abs(batch.speed_mps.mean(axis=1) - batch.target_speed_mps))


def _lane_center_offset(batch: CandidateBatch) -> Values:
    """Return the mean distance in m to the centre line of the lanelet under each point; 5 m without a lanelet."""
    points = np.stack([batch.x_m.ravel(), batch.y_m.ravel()], axis=1)
    return np.asarray(batch.lanes.offsets(points).reshape(batch.x_m.shape).mean(axis=1))


def responsibility(batch: CandidateBatch) -> Values:
    """Return the sums (n,) of ``exp(−smallest gap / 2 m)`` over obstacles that the ego is responsible for."""
    total = np.zeros(len(batch.x_m))
    nearness = _Nearness(batch)
    horizon_s = batch.x_m.shape[1] * batch.step_s
    heading = float(batch.heading_rad[0, 0])
    here = np.array([batch.x_m[0, 0], batch.y_m[0, 0]])
    own: Corridor | None = None
    looked = False
    for other in batch.obstacles:
        gap, step = nearness.to(other)
        near = np.flatnonzero(gap < _RANGE_M)
        if not len(near):
            continue
        if not looked:
            own = batch.corridors.from_here(here, heading, _reach_m(batch.fastest_mps, horizon_s))
            looked = True
        conflict = _Conflict(batch, other, own, here, heading, near, step[near])
        total[near] += np.where(conflict.is_the_egos(horizon_s), np.exp(-gap[near] / _SCALE_M), 0.0)
    return total


class _Nearness:
    """Gaps between the candidates' rectangles and an obstacle's rectangle, except at the present step.

    In the obstacle's frame the ego is replaced by its bounding box, which is exact if the two rectangles are parallel
    or at right angles. The gaps are evaluated every 0.2 s, including the last step, except at steps where no candidate
    can be within 8 m.
    """

    def __init__(self, batch: CandidateBatch) -> None:
        self._batch = batch
        every = max(round(_EVERY_S / batch.step_s), 1)
        self._steps = np.arange(batch.x_m.shape[1] - 1, 0, -every)[::-1]
        self._x, self._y = batch.x_m[:, self._steps], batch.y_m[:, self._steps]
        heading = batch.heading_rad[:, self._steps]
        self._cos, self._sin = np.cos(heading), np.sin(heading)
        self._low = np.stack([self._x.min(axis=0), self._y.min(axis=0)], axis=1)
        self._high = np.stack([self._x.max(axis=0), self._y.max(axis=0)], axis=1)

    def to(self, other: PredictedObstacle) -> tuple[Values, NDArray[np.intp]]:
        """Return the smallest gap in m (infinite beyond the range) and its step for every candidate."""
        half_length, half_width = self._batch.half_length_m, self._batch.half_width_m
        steps = self._steps[self._steps < len(other.positions)]
        there, count = other.positions[steps], len(steps)
        reach = _RANGE_M + math.hypot(half_length, half_width) + math.hypot(other.length_m, other.width_m) / 2
        outside = np.maximum(self._low[:count] - there, there - self._high[:count])
        close = np.flatnonzero((outside < reach).all(axis=1))
        if not len(close):
            return np.full(len(self._x), np.inf), np.zeros(len(self._x), dtype=np.intp)
        part = slice(int(close[0]), int(close[-1]) + 1)
        heading = other.headings_rad[steps[part]]
        cos, sin = np.cos(heading), np.sin(heading)
        away_x, away_y = self._x[:, part] - there[part, 0], self._y[:, part] - there[part, 1]
        parallel = np.abs(self._cos[:, part] * cos + self._sin[:, part] * sin)
        turned = np.abs(self._sin[:, part] * cos - self._cos[:, part] * sin)
        ahead = np.abs(away_x * cos + away_y * sin) - (half_length * parallel + half_width * turned)
        aside = np.abs(away_y * cos - away_x * sin) - (half_length * turned + half_width * parallel)
        ahead = np.maximum(ahead - other.length_m / 2, 0.0)
        aside = np.maximum(aside - other.width_m / 2, 0.0)
        squared = ahead * ahead + aside * aside
        nearest = squared.argmin(axis=1)
        return np.sqrt(squared[np.arange(len(squared)), nearest]), steps[part][nearest]


@dataclass(frozen=True)
class _Conflict:
    """The conflicts of the candidates ``near`` (indices) with one obstacle, each at its own ``step``."""

    batch: CandidateBatch
    other: PredictedObstacle
    own: Corridor | None
    here: Points
    heading_rad: float
    near: NDArray[np.intp]
    step: NDArray[np.intp]

    def is_the_egos(self, horizon_s: float) -> _Flags:
        """Return, for each conflict, whether the ego would be responsible, by the rules of the module."""
        other, there = self.other, self.other.positions[0]
        turn = wrap_angle(float(other.headings_rad[0]) - self.heading_rad)
        reach = _reach_m(other.speed_mps, horizon_s)
        legal = self.batch.corridors.from_here(there, float(other.headings_rad[0]), reach)
        in_own_lane, before_ego = _inside(self.own, there)
        if other.speed_mps < STANDING_MPS:
            return np.full(len(self.near), (there - self.here) @ _direction(self.heading_rad) > 0.0) | self._in_front()
        if in_own_lane and before_ego > 0.0:
            return np.full(len(self.near), abs(turn) < math.pi / 2)
        ego_is_inside, before_other = _inside(legal, self.here)
        if ego_is_inside and before_other > 0.0 and abs(turn) < math.pi / 2:
            return np.zeros(len(self.near), dtype=np.bool_)
        if legal is None:
            return self._in_front()
        return self._between_lanes(legal, turn)

    def _between_lanes(self, legal: Corridor, turn: float) -> _Flags:
        """Return, for each conflict, the result of rules 5 and 6, in which neither vehicle follows the other."""
        points = self._points()
        left_own = np.ones(len(points), dtype=np.bool_) if self.own is None else self.own.locate(points)[1] > 0.0
        both_left = left_own & (legal.locate(self.other.positions)[1] > 0.0)[self.step]
        station, beyond_edge = legal.locate(points)
        parallel = abs(turn) < _SIDE_BY_SIDE_RAD or abs(turn) > math.pi - _SIDE_BY_SIDE_RAD
        half_m = self.batch.half_width_m if parallel else self.batch.half_length_m
        within = self._reachable(station) & (beyond_edge < half_m)
        over_the_edge = (beyond_edge > 0.0) if parallel else np.zeros(len(points), dtype=np.bool_)
        return np.asarray(both_left | (within & (left_own | over_the_edge | self._gives_way(legal, turn))))

    def _gives_way(self, legal: Corridor, turn: float) -> _Flags:
        mine = self.own.priority if self.own else 0
        if mine != legal.priority:
            return np.full(len(self.near), mine < legal.priority)
        if abs(turn) < _SIDE_BY_SIDE_RAD:
            return self._in_front()
        if abs(turn) > math.pi - _SIDE_BY_SIDE_RAD:
            turned = wrap_angles(self.batch.heading_rad[self.near, self.step] - self.heading_rad)
            return np.asarray(turned > _LEFT_TURN_RAD)
        return np.full(len(self.near), turn > 0.0)  # a vehicle that moves to the ego's left comes from its right

    def _reachable(self, station: Values) -> _Flags:
        time = self.step * self.batch.step_s
        speed, margin = self.other.speed_mps, self.other.length_m / 2 + self.batch.half_length_m + _RANGE_M
        braking = np.minimum(time, speed / HARDEST_BRAKING_MPS2)
        least = speed * braking - HARDEST_BRAKING_MPS2 / 2 * braking**2
        most = speed * time + _ACCELERATION_MPS2 / 2 * time**2
        return np.asarray((station >= least - margin) & (station <= most + margin))

    def _in_front(self) -> _Flags:
        """Return, for each conflict, whether the obstacle is in front of the ego's centre."""
        heading = self.batch.heading_rad[self.near, self.step]
        away = self.other.positions[self.step] - self._points()
        return np.asarray(np.cos(heading) * away[:, 0] + np.sin(heading) * away[:, 1] > 0.0)

    def _points(self) -> Points:
        return np.stack([self.batch.x_m[self.near, self.step], self.batch.y_m[self.near, self.step]], axis=1)


def _inside(corridor: Corridor | None, point: Points) -> tuple[bool, float]:
    if corridor is None:
        return False, 0.0
    station, beyond_edge = corridor.locate(point[None, :])
    return bool(beyond_edge[0] <= 0.0), float(station[0])


def _direction(heading_rad: float) -> Points:
    return np.array([math.cos(heading_rad), math.sin(heading_rad)])


def _reach_m(speed_mps: float, horizon_s: float) -> float:
    return speed_mps * horizon_s + _ACCELERATION_MPS2 / 2 * horizon_s**2


OWN_TERMS: dict[str, Callable[[CandidateBatch], Values]] = {
    "path_length": _path_length,
    "lane_center_offset": _lane_center_offset,
    "velocity": _velocity,
    "responsibility": responsibility,
}
"""Maps weights to the terms computed here."""
