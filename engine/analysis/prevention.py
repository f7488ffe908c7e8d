"""Judges whether a reference driver in the ego's place could have prevented a collision; all others move as recorded.

The drivers are those of ``engine/planners/reference_drivers``: UN R157's careful driver, the fuzzy safety model, RSS,
full braking, and a driver that keeps its lane and speed. Each driver is judged from two starts:

* ``before_contact``: it follows the path that the ego drove, extended straight ahead, at the ego's speeds, until it
  reacts to the road user that was hit. This start shows what an ego could have done in this encounter.
* ``start``: it keeps its lane and the initial speed until it reacts to any road user. This start shows whether the ego
  caused the encounter.

A drive is followed until the ego stands or has passed the other road user. A driver prevents the collision if it
touches neither the road user that was hit nor any other that it drives into. The other road users do not react to it.
In addition to the drivers that brake, there is one manoeuvre (``evading``): steering aside by a lane's width at the
ego's speed, on the road and clear of all other road users. It does not make a collision preventable.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.reviews import DriverModelName, DriverStart, DriverVerdict, Prevention
from ..commonroad import Track
from ..geometry import Points, Values
from ..planners import (
    CarefulDriver,
    DriverPath,
    DriverScene,
    FullBraking,
    FuzzyDriver,
    KeepLane,
    NominalMotion,
    ReferenceDriver,
    RssDriver,
    brakes_of,
    going_on,
)
from ..vehicles import comfortable_mps2, hardest_braking_mps2

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_RSS = RssDriver()
RSS_RESPONSE_S, RSS_OWN_MPS2, RSS_FRONT_MPS2 = _RSS.response_s, _RSS.own_mps2, _RSS.front_mps2
"""RSS parameters that the RSS measure shares with the RSS driver."""
FOLLOWED_S = 30.0
"""How long a drive is followed after a collision, at most. From 50 m/s, braking by 2 m/s² ends before that."""
STEERING_MPS2, ASIDE_M, STEERING_WITHIN_S, STEERING_EVERY_S = 5.0, 3.5, 4.0, 0.2
"""Chosen: lateral acceleration of an emergency manoeuvre, a lane's width, and the times before a collision at which it
is tried.
"""
STEERING_FOLLOWED_S = 3.0
"""How long after the collision an ego that steered aside must stay on the road and clear of all others (chosen)."""


@dataclass(frozen=True)
class Surroundings:
    """The surroundings of an encounter: all road users except the one that was hit, the road, and the ego's lane.

    ``road``: the area that an ego that steers aside must not leave; if None, steering is not tried. ``lane``: points
    (n, 2) of the path that follows the ego's lane and route; if None, a driver from the start follows the path that the
    ego drove. ``friction``: the road's coefficient of friction, which limits every driver; None if it is not stated.
    """

    others: Sequence[Track]
    road: "BaseGeometry | None"
    lane: Points | None = None
    friction: float | None = None


def prevention_of(
    ego: Track,
    other: Track,
    hit_step: int,
    step_s: float,
    around: Surroundings | None = None,
    *,
    finds_latest: bool = True,
) -> Prevention | None:
    """Return the verdicts of reference drivers, in the ego's place, on its collision with a road user.

    The result is None if the two bodies do not touch on their tracks. Steering is tried if the surroundings contain the
    road. ``finds_latest``: whether to find the latest times at which drivers can take over, which takes most of the
    time. Without it, these times are None, full braking is tried only from the ego's first state, and the only other
    drivers judged are those of UN R157.
    """
    encounters = _Encounters(ego, other, hit_step, step_s, around or Surroundings((), None), finds_latest)
    if not encounters.touch:
        return None
    verdicts = tuple(encounters.verdicts())
    before = {verdict.driver: verdict for verdict in verdicts if verdict.start == "before_contact"}
    evading = before.get("evading")
    return Prevention(
        by_braking_until_s=before["full_braking"].until_s,
        by_careful_driver=before["r157_careful"].prevents,
        by_rss="rss" in before and before["rss"].prevents,
        by_fuzzy_driver=before["fsm"].prevents,
        by_steering_until_s=None if evading is None else evading.until_s,
        steering_tried=evading is not None,
        drivers=verdicts,
    )


def drivers_that_avoid(
    ego: Track, others: Sequence[Track], lane: Points | DriverPath | None, step_s: float, friction: float | None = None
) -> tuple[DriverModelName, ...]:
    """Return the names of UN R157's careful and fuzzy drivers that hit nothing in the ego's place.

    They start as the ego does, keep its lane and initial speed until they react, and drive as long as the ego did. A
    lane that is given as a path keeps the projections of the road users for further calls.
    """
    drivers: dict[DriverModelName, ReferenceDriver] = {"r157_careful": CarefulDriver(), "fsm": FuzzyDriver()}
    if not others:
        return tuple(drivers)
    count = len(ego.positions)
    way = lane if isinstance(lane, DriverPath) else DriverPath.driven(ego) if lane is None else DriverPath.along(lane)
    scene = DriverScene(
        nominal=NominalMotion.along_lane(way, ego, count, step_s, comfortable_mps2(friction)),
        body=ego.size_m,
        brakes=brakes_of(ego.kind).on_road(friction),
        met=going_on(others[0], ego.last_step, step_s),
        met_until=others[0].last_step,
        others=others[1:],
        step_s=step_s,
    )
    return tuple(name for name, driver in drivers.items() if scene.prevents(driver))


@dataclass(frozen=True)
class _Encounters:
    """A collision, and the two encounters in which drivers are judged."""

    ego: Track
    other: Track
    hit_step: int
    step_s: float
    around: Surroundings
    finds_latest: bool = True

    @cached_property
    def _count(self) -> int:
        """The number of states that are examined."""
        return self.hit_step - self.ego.first_step + round(FOLLOWED_S / self.step_s) + 1

    @cached_property
    def _met(self) -> Track:
        """The track of the road user that was hit, continued after its end."""
        return going_on(self.other, self.ego.first_step + self._count - 1, self.step_s)

    def _scene(self, nominal: NominalMotion) -> DriverScene:
        return DriverScene(
            nominal=nominal,
            body=self.ego.size_m,
            brakes=brakes_of(self.ego.kind).on_road(self.around.friction),
            met=self._met,
            met_until=self.other.last_step,
            others=self.around.others,
            step_s=self.step_s,
        )

    @cached_property
    def _as_driven(self) -> DriverScene:
        return self._scene(NominalMotion.driven(self.ego, self._count, self.step_s))

    @cached_property
    def _on_lane(self) -> DriverScene:
        lane = self.around.lane
        way = DriverPath.driven(self.ego) if lane is None else DriverPath.along(lane)
        return self._scene(
            NominalMotion.along_lane(way, self.ego, self._count, self.step_s, comfortable_mps2(self.around.friction))
        )

    @property
    def _hit(self) -> int:
        """The index of the state of the collision."""
        return self.hit_step - self.ego.first_step

    @cached_property
    def touch(self) -> bool:
        """Whether the tracks show the collision."""
        scene = self._as_driven
        if not scene.is_clear_of_met(scene.undisturbed(self._hit + 1)):
            return True
        return not scene.is_clear_of_met(scene.drive(FullBraking(), self._last))

    @property
    def _last(self) -> int:
        """The index of the last state that the ego drove up to the collision."""
        return min(self._hit, len(self.ego.positions) - 1)

    def _time_s(self, index: int | None) -> float | None:
        return None if index is None else round(index * self.step_s, 9)

    def verdicts(self) -> Iterator[DriverVerdict]:
        """Yield one verdict for each reference driver and start."""
        for start, scene in (("before_contact", self._as_driven), ("start", self._on_lane)):
            yield from self._verdicts_from(start, scene)  # type: ignore[arg-type]

    def _verdicts_from(self, start: DriverStart, scene: DriverScene) -> Iterator[DriverVerdict]:
        yield self._full_braking(start, scene)
        drivers: tuple[ReferenceDriver, ...] = (CarefulDriver(), FuzzyDriver())
        for driver in (*drivers, RssDriver()) if self.finds_latest else drivers:
            yield self._of_driver(driver, start, scene)
        if start == "start" and self.finds_latest:
            yield self._of_driver(KeepLane(), start, scene)
        if self.around.road is not None:
            latest = _Steering(scene, self._hit, self.around.road, self.around.friction).latest(self._last)
            yield DriverVerdict(
                driver="evading",
                start=start,
                prevents=latest is not None,
                until_s=self._time_s(latest),
                reacts_at_s=None,
            )

    def _full_braking(self, start: DriverStart, scene: DriverScene) -> DriverVerdict:
        """Return the latest time from which full braking prevents the collision; each state is tried."""
        tried = range(self._last, -1, -1) if self.finds_latest else range(1)
        latest = next((step for step in tried if scene.prevents(FullBraking(), step)), None)
        return DriverVerdict(
            driver="full_braking",
            start=start,
            prevents=latest is not None,
            until_s=self._time_s(latest) if self.finds_latest else None,
            reacts_at_s=0.0,
        )

    def _of_driver(self, driver: ReferenceDriver, start: DriverStart, scene: DriverScene) -> DriverVerdict:
        driven = scene.drive(driver)
        if not self.finds_latest:
            return DriverVerdict(
                driver=driver.name,
                start=start,
                prevents=scene.is_clear(driven),
                reacts_at_s=self._time_s(driven.brakes_from),
            )
        latest = scene.latest_takeover(driver, self._last)
        return DriverVerdict(
            driver=driver.name,
            start=start,
            prevents=latest is not None,
            until_s=self._time_s(latest),
            reacts_at_s=self._time_s(driven.brakes_from),
        )


@dataclass(frozen=True)
class _Steering:
    """Steering aside by a lane's width; ``hit``: the index of the state of the collision."""

    scene: DriverScene
    hit: int
    road: "BaseGeometry"
    friction: float | None

    def latest(self, last: int) -> int | None:
        """Return the latest state from which steering to either side prevents the collision, or None."""
        every = max(round(STEERING_EVERY_S / self.scene.step_s), 1)
        first = max(0, last - round(STEERING_WITHIN_S / self.scene.step_s))
        for index in range(last, first - 1, -every):
            if any(self._evades(index, side) for side in (1.0, -1.0)):
                return index
        return None

    def _evades(self, begins: int, side: float) -> bool:
        """Return True if steering aside from state ``begins`` touches no other road user and stays on the road."""
        import shapely

        count = min(self.hit + round(STEERING_FOLLOWED_S / self.scene.step_s) + 1, self.scene.count)
        driven = self.scene.undisturbed(count)
        aside, turned = _lane_change(count, begins, self.scene.step_s, float(driven.speeds_mps[begins]), self.friction)
        aside, turned = side * aside, side * turned
        if not self.scene.is_clear_of_met(driven, aside, turned):
            return False
        moving = self.scene.bodies(driven, aside, turned)[begins:]
        if not bool(shapely.covers(self.road, moving).all()):
            return False
        area = shapely.box(*shapely.total_bounds(moving))
        return not any(self._touches(track, moving, begins, area) for track in self.scene.others)

    def _touches(self, track: Track, moving: Values, begins: int, area: "BaseGeometry") -> bool:
        import shapely

        steps = range(self.scene.first_step + begins, self.scene.first_step + begins + len(moving))
        there = [(index, at) for index, step in enumerate(steps) if (at := track.index_at(step)) is not None]
        near = shapely.intersects_xy(area.buffer(track.length_m), track.positions[:, 0], track.positions[:, 1])
        if not there or not near.any():
            return False
        corners = shapely.polygons(np.array([track.corners_at(at) for _, at in there]))
        return bool(shapely.intersects(moving[[index for index, _ in there]], corners).any())


def _lane_change(
    count: int, begins: int, step_s: float, speed_mps: float, friction: float | None
) -> tuple[Values, Values]:
    """Return the lateral offset and heading change at each state of an ego that steers a lane's width to the left.

    The lateral acceleration is constant up to half of the offset, and then equally large in the opposite direction.
    """
    steering_mps2 = min(STEERING_MPS2, hardest_braking_mps2(friction))
    half_s = math.sqrt(ASIDE_M / steering_mps2)
    since = np.maximum(np.arange(count) - begins, 0) * step_s
    rising, falling = np.minimum(since, half_s), np.clip(2 * half_s - since, 0.0, half_s)
    aside = np.where(since < half_s, steering_mps2 * rising**2 / 2, ASIDE_M - steering_mps2 * falling**2 / 2)
    sideways = steering_mps2 * np.where(since < half_s, rising, falling)
    return aside, np.arctan2(sideways, max(speed_mps, 1e-9))


def safe_distance_m(rear_mps: Values, front_mps: Values) -> Values:
    """Return the RSS distance, definition 1, without acceleration during the response; shapes (n,)."""
    response = rear_mps * RSS_RESPONSE_S
    braking = rear_mps**2 / (2 * RSS_OWN_MPS2) - np.maximum(front_mps, 0.0) ** 2 / (2 * RSS_FRONT_MPS2)
    distance: Values = np.maximum(response + braking, 0.0)
    return distance
