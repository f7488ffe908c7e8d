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
* ``fuzzy_driver``: the fuzzy safety model of the same regulation, as amended in 2022 (performance model 2; Mattas and
  others, "Fuzzy surrogate safety metrics for real-time assessment of rear-end collision risk", Accident Analysis and
  Prevention 2020, and "Driver models for the definition of safety requirements of automated vehicles in international
  regulations", there 2022): it brakes early and gently where a situation is somewhat unsafe, by up to 4 m/s², and by up
  to 6 m/s² where it is critical.

Beside them stands one manoeuvre of another kind, steering aside by a lane's width at the speed that the ego had
(``by_steering_until_s``): on the road and clear of all others. It makes no collision preventable: the drivers brake.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...schemas.runs import Prevention
from ..commonroad import Track
from ..criticality import MovingRectangles, corners_of
from ..geometry import Points, Values, arc_length, interpolate, point_at, without_repeats

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

GRAVITY_MPS2 = 9.81
BRAKING_MPS2, JERK_MPS3 = 0.774 * GRAVITY_MPS2, 12.65
"""UN R157, Annex 3: the deceleration of the competent and careful driver, and how it builds up (0.6 s)."""
WANDERING_M, PERCEPTION_S, DELAY_S, CRITICAL_S = 0.375, 0.4, 0.75, 2.0
"""UN R157, Annex 3: lateral wandering, risk perception, delay until braking, time to collision that is critical."""
RSS_RESPONSE_S, RSS_OWN_MPS2, RSS_FRONT_MPS2 = 0.75, 4.0, 8.0
"""RSS leaves its parameters open; chosen: UN R157's delay, braking that the ego counts on, the hardest of others."""
FUZZY_RESPONSE_S, FUZZY_GENTLE_MPS2, FUZZY_HARD_MPS2, FUZZY_FRONT_MPS2 = 0.75, 4.0, 6.0, 7.0
FUZZY_STANDSTILL_M, FUZZY_MARGIN_M, FUZZY_EARLIER_S = 2.0, 2.0, 0.1
"""The fuzzy safety model's response time, braking of both, distance when standing, margin of the safe distance, and how
much later than the ego is past it another may come into its way."""
STEERING_MPS2, ASIDE_M, STEERING_WITHIN_S, STEERING_EVERY_S = 5.0, 3.5, 4.0, 0.2
"""Chosen: lateral acceleration of an emergency manoeuvre, a lane's width, and when before a collision it is tried."""
AHEAD_M = 200.0
"""The ego's way goes on straight for so long behind its end."""
AFTER_S = 3.0
"""How long a reference driver has to stay clear after the collision (chosen), unless it stands before."""


@dataclass(frozen=True)
class Surroundings:
    """What steering aside has to keep clear of beside the one that was hit: all others, and what is not road."""

    others: Sequence[Track]
    road: "BaseGeometry"


def prevention_of(
    ego: Track, other: Track, hit_step: int, step_s: float, around: Surroundings | None = None
) -> Prevention | None:
    """What reference drivers in the ego's place make of its collision with another.

    None where the two do not touch as their tracks and rectangles show them. Steering is tried where the surroundings
    are given.
    """
    encounter = _Encounter(ego, other, hit_step, step_s)
    if encounter.stays_clear(hit_step):
        return None

    def since_start_s(step: int | None) -> float | None:
        return None if step is None else round((step - ego.first_step) * step_s, 9)

    careful, cautious = encounter.careful_braking(), encounter.rss_braking()
    return Prevention(
        by_braking_until_s=since_start_s(encounter.latest_braking()),
        by_careful_driver=careful is not None and encounter.stays_clear(careful),
        by_rss=cautious is not None and encounter.stays_clear(cautious),
        by_fuzzy_driver=encounter.is_clear(encounter.fuzzy_stations()),
        by_steering_until_s=None if around is None else since_start_s(encounter.latest_steering(around)),
        steering_tried=around is not None,
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
        return self.is_clear(self._stations_when_braking(braking_from))

    def is_clear(self, stations_m: Values) -> bool:
        """Whether an ego that is at these stations of its way does not touch the other."""
        import shapely

        shown, theirs = self._theirs
        if not shown:
            return True
        own = self._boxes(stations_m[shown])
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

    @cached_property
    def _stations_at_speed(self) -> Values:
        """How far along its way an ego is at each step that keeps to its speeds, and to the last one behind its end."""
        beyond = np.arange(len(self._steps) - len(self._driven_m)) + 1
        later = self._driven_m[-1] + beyond * float(self.ego.speeds_mps[-1]) * self.step_s
        stations: Values = np.concatenate([self._driven_m, later])[: len(self._steps)]
        return stations

    def _boxes(self, stations_m: Values, aside_m: Values | None = None, turned_rad: Values | None = None) -> Points:
        """The ego's rectangles (n, 4, 2) at places along its way, with the headings that it had there.

        ``aside_m``: how far to the left of the way; ``turned_rad``: from its headings.
        """
        driven = self._driven_m
        beyond = np.maximum(stations_m - driven[-1], 0.0)
        headings = np.interp(stations_m, driven, np.unwrap(self.ego.headings_rad))
        along = np.column_stack([np.cos(headings), np.sin(headings)])
        centers = interpolate(self.ego.positions, driven, stations_m) + along * beyond[:, None]
        if aside_m is not None and turned_rad is not None:
            centers = centers + np.column_stack([-along[:, 1], along[:, 0]]) * aside_m[:, None]
            headings = headings + turned_rad
        sizes = np.tile(self.ego.size_m, (len(centers), 1))
        return corners_of(MovingRectangles(centers, headings, sizes, np.zeros(len(centers))))

    def latest_steering(self, around: Surroundings) -> int | None:
        """The latest step from which steering aside, to either side, prevents the collision; None: none does."""
        every = max(round(STEERING_EVERY_S / self.step_s), 1)
        last = min(self.hit_step, self.ego.last_step)
        first = max(self.ego.first_step, last - round(STEERING_WITHIN_S / self.step_s))
        for step in range(last, first - 1, -every):
            if any(self._evades(step, side, around) for side in (1.0, -1.0)):
                return step
        return None

    def _evades(self, step: int, side: float, around: Surroundings) -> bool:
        """Whether steering aside from a step on touches neither the other, nor anyone else, nor leaves the road."""
        import shapely

        stations = self._stations_at_speed
        begins = step - self.ego.first_step
        aside, turned = _lane_change(len(stations), begins, self.step_s, float(self.ego.speeds_mps[begins]))
        own = shapely.polygons(self._boxes(stations, side * aside, side * turned))
        shown, theirs = self._theirs
        if bool(shapely.intersects(own[shown], theirs).any()):
            return False
        moving = own[begins:]
        if not bool(shapely.covers(around.road, moving).all()):
            return False
        area = shapely.box(*shapely.total_bounds(moving))
        return not any(self._touches(track, own, begins, area) for track in around.others)

    def _touches(self, track: Track, own: NDArray[np.object_], begins: int, area: "BaseGeometry") -> bool:
        import shapely

        steps = range(self.ego.first_step + begins, self.ego.first_step + len(own))
        there = [(step, at) for step in steps if (at := track.index_at(step)) is not None]
        near = shapely.intersects_xy(area.buffer(track.length_m), track.positions[:, 0], track.positions[:, 1])
        if not there or not near.any():
            return False
        corners = shapely.polygons(np.array([track.corners_at(at) for _, at in there]))
        mine = own[[step - self.ego.first_step for step, _ in there]]
        return bool(shapely.intersects(mine, corners).any())

    def careful_braking(self) -> int | None:
        """The step at which UN R157's driver brakes; None: not before the collision."""
        seen: int | None = None
        for place in self._places_before:
            if seen is None and (self._is_in_way(place) or place.came_nearer_m > WANDERING_M):
                seen = place.step
            perceived = seen is not None and (place.step - seen) * self.step_s >= PERCEPTION_S - 1e-9
            if perceived and self._time_to_collision_s(place) < CRITICAL_S:
                return place.step + round(DELAY_S / self.step_s)
        return None

    def rss_braking(self) -> int | None:
        """The step at which an ego of RSS brakes; None: not before the collision."""
        for place in self._places_before:
            own = self._own_mps(place)
            safe = safe_distance_m(np.array([own]), np.array([place.along_mps]))
            if self._is_in_way(place) and self._gap_m(place) < safe[0]:
                return place.step + round(RSS_RESPONSE_S / self.step_s)
        return None

    def fuzzy_stations(self) -> Values:
        """How far along the way the driver of the fuzzy safety model is at each step.

        It drives as the ego did until something is unsafe, waits for its response time, then brakes by how unsafe it
        is; once nothing is, it keeps its speed.
        """
        places = {place.step: place for place in self._places}
        stations, speed, braking = [0.0], float(self.ego.speeds_mps[0]), 0.0
        waits, is_alert, felt = FUZZY_RESPONSE_S, False, 0.0
        for step in self._steps[:-1]:
            wanted = self._fuzzy_braking_mps2(places.get(step), stations[-1], speed, felt)
            is_alert = is_alert or wanted > 0
            faster = speed
            if not is_alert:
                faster = float(self.ego.speeds_mps[min(step + 1 - self.ego.first_step, len(self.ego.speeds_mps) - 1)])
            elif wanted > 0 and waits > 1e-9:
                waits -= self.step_s
            elif wanted > 0:
                braking = min(braking + JERK_MPS3 * self.step_s, BRAKING_MPS2, wanted)
                faster = max(speed - braking * self.step_s, 0.0)
            felt = (faster - speed) / self.step_s
            stations.append(stations[-1] + (speed + faster) / 2 * self.step_s)
            speed = faster
        return np.array(stations)

    def _fuzzy_braking_mps2(self, place: "_Place | None", station: float, own_mps: float, felt_mps2: float) -> float:
        """How hard the fuzzy safety model wants to brake; 0 where it is safe, or the other is not ahead."""
        if place is None or place.middle_m < station:
            return 0.0
        beside = place.aside_m - self.ego.width_m / 2
        if beside > 0:
            closing = own_mps - place.along_mps
            if closing <= 0 or place.nearing_mps <= 0:
                return 0.0
            past_s = (place.middle_m - station + (self.ego.length_m + self.other.length_m) / 2) / closing
            if beside / place.nearing_mps > past_s + FUZZY_EARLIER_S:
                return 0.0
        gap = max(place.rear_m - station - self.ego.length_m / 2, 0.0)
        critical = _critical_share(gap, own_mps, place.along_mps, felt_mps2)
        if critical > 0:
            return FUZZY_GENTLE_MPS2 + critical * (FUZZY_HARD_MPS2 - FUZZY_GENTLE_MPS2)
        return _unsafe_share(gap, own_mps, place.along_mps) * FUZZY_GENTLE_MPS2

    @property
    def _places_before(self) -> "list[_Place]":
        """Those until the collision."""
        last = min(self.hit_step, self.ego.last_step)
        return [place for place in self._places if place.step <= last]

    @cached_property
    def _places(self) -> "list[_Place]":
        """Where the other is with regard to the ego's way, at each step that is looked at."""
        from shapely import LineString, Point, Polygon, distance

        line = LineString(self._way)
        places: list[_Place] = []
        first_aside = before = None
        for step in self._steps:
            at = self.other.index_at(step)
            if at is None:
                continue
            corners = self.other.corners_at(at)
            aside = float(distance(line, Polygon(corners)))
            first_aside = aside if first_aside is None else max(first_aside, aside)
            station = float(line.project(Point(self.other.positions[at])))
            places.append(
                _Place(
                    step=step,
                    aside_m=aside,
                    came_nearer_m=first_aside - aside,
                    nearing_mps=0.0 if before is None else (before - aside) / self.step_s,
                    rear_m=min(float(line.project(Point(corner))) for corner in corners),
                    middle_m=station,
                    along_mps=self._along_mps(at, station),
                )
            )
            before = aside
        return places

    def _along_mps(self, at: int, station_m: float) -> float:
        """How fast the other moves along the ego's way."""
        _, heading = point_at(self._way, station_m)
        turn = float(self.other.headings_rad[at]) - heading
        return float(self.other.speeds_mps[at]) * math.cos(turn)

    def _own_mps(self, place: "_Place") -> float:
        return float(self.ego.speeds_mps[place.step - self.ego.first_step])

    def _ahead_m(self, place: "_Place") -> float:
        """How far the other's rear is ahead of the driven ego's front, negative behind it."""
        return place.rear_m - (float(self._driven_m[place.step - self.ego.first_step]) + self.ego.length_m / 2)

    def _gap_m(self, place: "_Place") -> float:
        """How far ahead the other is, bumper to bumper; infinite behind the ego."""
        ahead = self._ahead_m(place)
        return max(ahead, 0.0) if ahead > -self.ego.length_m else math.inf

    def _is_in_way(self, place: "_Place") -> bool:
        return place.aside_m <= self.ego.width_m / 2 and self._ahead_m(place) > -self.ego.length_m

    def _time_to_collision_s(self, place: "_Place") -> float:
        """On the ego's way, with both keeping their speeds."""
        closing = self._own_mps(place) - place.along_mps
        return self._gap_m(place) / closing if closing > 0 else math.inf


@dataclass(frozen=True)
class _Place:
    """Where the other is at a step: how far from the ego's way its body is, and how far along it.

    ``came_nearer_m``: than at the farthest; ``nearing_mps``: how fast it comes nearer; ``rear_m``, ``middle_m``: along
    the way, of its nearest corner and its centre; ``along_mps``: its speed along the way.
    """

    step: int
    aside_m: float
    came_nearer_m: float
    nearing_mps: float
    rear_m: float
    middle_m: float
    along_mps: float


def _lane_change(count: int, begins: int, step_s: float, speed_mps: float) -> tuple[Values, Values]:
    """How far aside and turned an ego is at each state that steers a lane's width to the left from one of them on.

    Its lateral acceleration is constant until half of the way, then as large the other way.
    """
    half_s = math.sqrt(ASIDE_M / STEERING_MPS2)
    since = np.maximum(np.arange(count) - begins, 0) * step_s
    rising, falling = np.minimum(since, half_s), np.clip(2 * half_s - since, 0.0, half_s)
    aside = np.where(since < half_s, STEERING_MPS2 * rising**2 / 2, ASIDE_M - STEERING_MPS2 * falling**2 / 2)
    sideways = STEERING_MPS2 * np.where(since < half_s, rising, falling)
    return aside, np.arctan2(sideways, max(speed_mps, 1e-9))


def _unsafe_share(gap_m: float, own_mps: float, front_mps: float) -> float:
    """The proactive fuzzy safety metric: 0 where the one ahead may brake hard, 1 where hard braking is too little."""
    front_m = max(front_mps, 0.0) ** 2 / (2 * FUZZY_FRONT_MPS2)
    response_m = own_mps * FUZZY_RESPONSE_S
    safe = response_m + own_mps**2 / (2 * FUZZY_GENTLE_MPS2) - front_m + FUZZY_MARGIN_M
    unsafe = response_m + own_mps**2 / (2 * FUZZY_HARD_MPS2) - front_m
    return _share_between(gap_m - FUZZY_STANDSTILL_M, safe, unsafe)


def _critical_share(gap_m: float, own_mps: float, front_mps: float, felt_mps2: float) -> float:
    """The critical fuzzy safety metric: 0 where gentle braking is enough for an even one ahead, 1 where hard is not."""
    if own_mps <= front_mps:
        return 0.0
    going_on = max(felt_mps2, -FUZZY_GENTLE_MPS2)
    closing = own_mps + going_on * FUZZY_RESPONSE_S - front_mps
    if closing < 0:
        return float(gap_m < (own_mps - front_mps) ** 2 / (2 * abs(felt_mps2)))
    response_m = (own_mps + going_on * FUZZY_RESPONSE_S / 2 - front_mps) * FUZZY_RESPONSE_S
    safe = response_m + closing**2 / (2 * FUZZY_GENTLE_MPS2)
    return _share_between(gap_m, safe, response_m + closing**2 / (2 * FUZZY_HARD_MPS2))


def _share_between(value: float, none: float, all_: float) -> float:
    """0 from one value on, 1 up to a smaller other one, even between."""
    return float(value < all_) if none <= all_ else float(np.clip((none - value) / (none - all_), 0.0, 1.0))


def safe_distance_m(rear_mps: Values, front_mps: Values) -> Values:
    """RSS, definition 1, without acceleration during the response (an ego that keeps its speed); shapes (n,)."""
    response = rear_mps * RSS_RESPONSE_S
    braking = rear_mps**2 / (2 * RSS_OWN_MPS2) - np.maximum(front_mps, 0.0) ** 2 / (2 * RSS_FRONT_MPS2)
    distance: Values = np.maximum(response + braking, 0.0)
    return distance
