"""Whether a collision could have been prevented: reference drivers in the ego's place, all others as they moved.

A reference driver keeps to the path that the ego drove (straight on behind its end) and to its speeds until it brakes;
what it does is decided by when. The others do not react to it, so that this says what an ego could have done about this
encounter, not what would have come after it.

* ``braking``: full braking from a moment on, without any delay: the latest moment that prevents the collision.
* ``careful_driver``: the competent and careful human driver of UN Regulation 157 (Annex 3, performance model 1): it
  perceives another that comes nearer to its way by 0.375 m or stands in it, takes 0.4 s to see the risk, brakes 0.75 s
  after the time to collision (on its way) is below 2 s, by up to 0.774 g with a jerk of 12.65 m/s³.
* ``rss``: Responsibility-Sensitive Safety (Shalev-Shwartz, Shammah, Shashua 2017, definition 1 and 4): it brakes 0.75 s
  after the longitudinal distance to another in its way is below the safe one.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...schemas.runs import Prevention
from ..commonroad import Track
from ..geometry import Points, Values, arc_length, interpolate, oriented_rectangle, point_at, without_repeats

GRAVITY_MPS2 = 9.81
BRAKING_MPS2, JERK_MPS3 = 0.774 * GRAVITY_MPS2, 12.65
"""UN R157, Annex 3: the deceleration of the competent and careful driver, and how it builds up (0.6 s)."""
WANDERING_M, PERCEPTION_S, DELAY_S, CRITICAL_S = 0.375, 0.4, 0.75, 2.0
"""UN R157, Annex 3: lateral wandering, risk perception, delay until braking, time to collision that is critical."""
RSS_RESPONSE_S, RSS_OWN_MPS2, RSS_FRONT_MPS2 = 0.75, 4.0, 8.0
"""RSS leaves its parameters open; chosen: UN R157's delay, braking that the ego counts on, the hardest of others."""
AHEAD_M = 200.0
"""The ego's way goes on straight for so long behind its end."""
AFTER_S = 3.0
"""How long a reference driver has to stay clear after the collision (chosen), unless it stands before."""


def prevention_of(ego: Track, other: Track, hit_step: int, step_s: float) -> Prevention | None:
    """What reference drivers in the ego's place make of its collision with another.

    None where the two do not touch as their tracks and rectangles show them.
    """
    encounter = _Encounter(ego, other, hit_step, step_s)
    if encounter.stays_clear(hit_step):
        return None
    latest = encounter.latest_braking()
    careful, cautious = encounter.careful_braking(), encounter.rss_braking()
    return Prevention(
        by_braking_until_s=None if latest is None else round((latest - ego.first_step) * step_s, 9),
        by_careful_driver=careful is not None and encounter.stays_clear(careful),
        by_rss=cautious is not None and encounter.stays_clear(cautious),
    )


@dataclass(frozen=True)
class _Encounter:
    """The ego, the one that it collided with, and when."""

    ego: Track
    other: Track
    hit_step: int
    step_s: float

    @cached_property
    def _way(self) -> Points:
        """The ego's driven path (n, 2), straight on behind its end."""
        end = float(self.ego.headings_rad[-1])
        ahead = self.ego.positions[-1] + AHEAD_M * np.array([math.cos(end), math.sin(end)])
        path = without_repeats(self.ego.positions)
        return np.vstack([path, ahead])

    @cached_property
    def _driven_m(self) -> Values:
        """How far the ego had come at each of its states."""
        return arc_length(self.ego.positions)

    @cached_property
    def _steps(self) -> range:
        """The steps that are looked at: from the ego's first to some time after the collision."""
        last = min(self.hit_step + round(AFTER_S / self.step_s), self.other.last_step)
        return range(self.ego.first_step, max(last, self.hit_step) + 1)

    def latest_braking(self) -> int | None:
        """The latest step from which full braking prevents the collision; None: none does."""
        for step in range(min(self.hit_step, self.ego.last_step), self.ego.first_step - 1, -1):
            if self.stays_clear(step):
                return step
        return None

    def stays_clear(self, braking_from: int) -> bool:
        """Whether an ego that brakes fully from a step on does not touch the other."""
        import shapely

        shown, theirs = self._theirs
        if not shown:
            return True
        own = self._boxes(self._stations_when_braking(braking_from)[shown])
        return not bool(shapely.intersects(shapely.polygons(own), theirs).any())

    @cached_property
    def _theirs(self) -> tuple[list[int], NDArray[np.object_]]:
        """The entries of the looked-at steps at which the other is there, and its polygons there."""
        import shapely

        shown = [(index, at) for index, step in enumerate(self._steps) if (at := self.other.index_at(step)) is not None]
        corners = np.array([self.other.corners_at(at) for _, at in shown]).reshape(-1, 4, 2)
        return [index for index, _ in shown], shapely.polygons(corners)

    def _stations_when_braking(self, braking_from: int) -> Values:
        """How far along its way an ego is at each step that brakes fully from one on."""
        before = min(braking_from - self.ego.first_step, len(self._driven_m) - 1)
        station, speed, braking = float(self._driven_m[before]), float(self.ego.speeds_mps[before]), 0.0
        stations = list(self._driven_m[: before + 1])
        while len(stations) < len(self._steps):
            braking = min(braking + JERK_MPS3 * self.step_s, BRAKING_MPS2)
            slower = max(speed - braking * self.step_s, 0.0)
            station += (speed + slower) / 2 * self.step_s
            speed = slower
            stations.append(station)
        return np.array(stations[: len(self._steps)])

    def _boxes(self, stations_m: Values) -> Points:
        """The ego's rectangles (n, 4, 2) at places along its way, with the headings that it had there."""
        driven = self._driven_m
        beyond = np.maximum(stations_m - driven[-1], 0.0)
        headings = np.interp(stations_m, driven, np.unwrap(self.ego.headings_rad))
        ahead = np.column_stack([np.cos(headings), np.sin(headings)]) * beyond[:, None]
        centers = interpolate(self.ego.positions, driven, stations_m) + ahead
        pairs = zip(centers, headings.tolist(), strict=True)
        return np.array([oriented_rectangle(center, heading, self.ego.size_m) for center, heading in pairs])

    def careful_braking(self) -> int | None:
        """The step at which UN R157's driver brakes; None: not before the collision."""
        seen: int | None = None
        for place in self._places:
            if seen is None and (place.in_way or place.came_nearer_m > WANDERING_M):
                seen = place.step
            perceived = seen is not None and (place.step - seen) * self.step_s >= PERCEPTION_S - 1e-9
            if perceived and place.time_to_collision_s < CRITICAL_S:
                return place.step + round(DELAY_S / self.step_s)
        return None

    def rss_braking(self) -> int | None:
        """The step at which an ego of RSS brakes; None: not before the collision."""
        for place in self._places:
            if place.in_way and place.gap_m < _safe_distance_m(place.ego_mps, place.other_mps):
                return place.step + round(RSS_RESPONSE_S / self.step_s)
        return None

    @cached_property
    def _places(self) -> "list[_Place]":
        """Where the other was with regard to the ego's way, at each step until the collision."""
        from shapely import LineString, Point, Polygon, distance

        line = LineString(self._way)
        places: list[_Place] = []
        first_aside: float | None = None
        for step in range(self.ego.first_step, min(self.hit_step, self.ego.last_step) + 1):
            at = self.other.index_at(step)
            if at is None:
                continue
            index = step - self.ego.first_step
            corners = self.other.corners_at(at)
            aside = float(distance(line, Polygon(corners)))
            first_aside = aside if first_aside is None else max(first_aside, aside)
            along = np.array([line.project(Point(corner)) for corner in corners])
            station = float(line.project(Point(self.other.positions[at])))
            gap = float(along.min()) - (float(self._driven_m[index]) + self.ego.length_m / 2)
            places.append(
                _Place(
                    step=step,
                    in_way=aside <= self.ego.width_m / 2 and gap > -self.ego.length_m,
                    came_nearer_m=first_aside - aside,
                    gap_m=max(gap, 0.0) if gap > -self.ego.length_m else math.inf,
                    ego_mps=float(self.ego.speeds_mps[index]),
                    other_mps=self._along_mps(at, station),
                )
            )
        return places

    def _along_mps(self, at: int, station_m: float) -> float:
        """How fast the other moves along the ego's way."""
        _, heading = point_at(self._way, station_m)
        turn = float(self.other.headings_rad[at]) - heading
        return float(self.other.speeds_mps[at]) * math.cos(turn)


@dataclass(frozen=True)
class _Place:
    """Where the other is at a step: whether its body is in the ego's way, how much nearer to it than at the farthest.

    ``gap_m``: how far ahead along it, bumper to bumper, infinite behind the ego; speeds are those along the way.
    """

    step: int
    in_way: bool
    came_nearer_m: float
    gap_m: float
    ego_mps: float
    other_mps: float

    @property
    def time_to_collision_s(self) -> float:
        """On the ego's way, with both keeping their speeds."""
        closing = self.ego_mps - self.other_mps
        return self.gap_m / closing if closing > 0 else math.inf


def _polygon(corners: Points) -> object:
    from shapely import Polygon

    return Polygon(corners)


def _safe_distance_m(rear_mps: float, front_mps: float) -> float:
    """RSS, definition 1, without acceleration during the response (an ego that keeps its speed)."""
    response = rear_mps * RSS_RESPONSE_S
    braking = rear_mps**2 / (2 * RSS_OWN_MPS2) - max(front_mps, 0.0) ** 2 / (2 * RSS_FRONT_MPS2)
    return max(response + braking, 0.0)
