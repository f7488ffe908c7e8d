"""A reference driver in the ego's place, among road users that move as recorded and do not react to it.

Until the driver reacts, the ego follows a :class:`NominalMotion`: as driven, or along its lane at its initial speed.
After that it brakes as the driver wants, keeps its speed in between, and follows the same path. A drive ends when the
ego has stopped, or when the ego and the other road user can no longer meet. An ego that is still rolling has not
prevented the collision. If the other road user's track ends earlier, it continues straight at its last speed, or keeps
braking to a standstill if it was braking.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...commonroad import Track
from ...geometry import Values, arc_length, headings, resample, without_repeats
from ...vehicles import COMFORTABLE_MPS2, STANDING_MPS
from ..driving.desired_speed import curve_speeds_mps
from .models import Brakes, Moment, ReferenceDriver, Seen
from .paths import DriverPath, OnPath, rectangles, with_hidden

WANDERING_M = 0.375
"""Deviation of a vehicle's centre from the middle of the path at which it is perceived to leave it (UN R157)."""
_MEAN_OVER_S, _BRAKES_MPS2 = 0.5, 1.0
"""A road user brakes at the end of its track if its mean deceleration over the last half second exceeds 1 m/s²."""
_LEAST_WAY_M = 5.0
"""Curvature is undefined on a path shorter than a car."""


@dataclass(frozen=True)
class NominalMotion:
    """The ego's motion until its driver reacts: stations (n,) in m along a path and speeds (n,), one per step.

    ``was_driven``: True if it is the ego's own motion, which touches no other road user before it is changed.
    """

    path: DriverPath
    first_step: int
    stations_m: Values
    speeds_mps: Values
    was_driven: bool

    @classmethod
    def driven(cls, ego: Track, count: int, step_s: float) -> "NominalMotion":
        """Return the motion of a track over ``count`` states; after its end, straight ahead at its last speed."""
        path, last = DriverPath.driven(ego), float(ego.speeds_mps[-1])
        after = np.arange(1, max(count - len(ego.positions), 0) + 1)
        stations = np.concatenate([path.stations_m, path.length_m + after * last * step_s])
        speeds = np.concatenate([ego.speeds_mps, np.full(len(after), last)])
        return cls(path, ego.first_step, stations[:count], speeds[:count], was_driven=True)

    @classmethod
    def along_lane(
        cls, path: DriverPath, ego: Track, count: int, step_s: float, comfortable_mps2: float = COMFORTABLE_MPS2
    ) -> "NominalMotion":
        """Return the motion of an ego that keeps to a path at the initial speed of a track.

        It is slower only in curves that would need more than a comfortable lateral acceleration.
        """
        known_m, limits = _bend_limits(path, comfortable_mps2)
        begin = float(path.follow(ego.positions[:1])[0][0])
        wanted = float(ego.speeds_mps[0])
        stations, speeds = [begin], [wanted]
        while len(stations) < count:
            limit = float(np.interp(stations[-1] + speeds[-1] * step_s, known_m, limits))
            speed = min(speeds[-1] + comfortable_mps2 * step_s, wanted, max(limit, 0.0))
            stations.append(stations[-1] + (speeds[-1] + speed) / 2 * step_s)
            speeds.append(speed)
        return cls(path, ego.first_step, np.array(stations), np.array(speeds), was_driven=False)


def _bend_limits(path: DriverPath, comfortable_mps2: float) -> tuple[Values, Values]:
    """Return stations and the speeds at which a path's curves need a comfortable acceleration, both (n,)."""
    if path.length_m < _LEAST_WAY_M:
        return np.zeros(1), np.full(1, np.inf)
    points = without_repeats(path.points)
    line = resample(points, max(round(path.length_m), 3))
    return arc_length(line)[:-1], curve_speeds_mps(
        arc_length(line)[:-1], headings(line), comfortable_mps2, comfortable_mps2
    )


@dataclass(frozen=True)
class Driven:
    """A driver's motion: stations (n,) and speeds (n,) until the encounter is over, and the start of its braking.

    ``brakes_from``: the index of the state at which the driver first wanted to brake, or None. ``stands``: True if the
    ego stands at its last state.
    """

    stations_m: Values
    speeds_mps: Values
    brakes_from: int | None
    stands: bool


@dataclass(frozen=True)
class DriverScene:
    """The ego's body and brakes, its motion until its driver reacts, and the other road users along its path.

    ``body``: length and width in m. ``met``: the road user that it collided with, extended beyond its track by
    :func:`going_on`; ``met_until``: the last step of its track. ``others``: all other road users. On the driven path, a
    driver reacts only to ``met``, since the ego has already reacted to the others. On its lane, it reacts to all of
    them.
    """

    nominal: NominalMotion
    body: tuple[float, float]
    brakes: Brakes
    met: Track
    met_until: int
    others: Sequence[Track]
    step_s: float

    @property
    def first_step(self) -> int:
        """The step at which the ego starts."""
        return self.nominal.first_step

    @property
    def count(self) -> int:
        """The number of evaluated steps."""
        return len(self.nominal.stations_m)

    @cached_property
    def _met(self) -> OnPath:
        return self._on_path(self.met)

    @cached_property
    def _watched(self) -> list[OnPath]:
        """The road users to which the driver reacts, or that may hide ``met`` from it."""
        rows = [self._on_path(track) for track in self._near_the_path]
        if not self.nominal.was_driven:
            return rows
        return [row for row in rows if row.hides and bool((row.aside_m < self.body[1] / 2).any())]

    @cached_property
    def _near_the_path(self) -> list[Track]:
        centers, _ = self.nominal.path.poses(self.nominal.stations_m)
        low, high = centers.min(axis=0) - self.body[0], centers.max(axis=0) + self.body[0]
        last = self.first_step + self.count - 1
        near = []
        for track in self.others:
            begin, end = self.first_step - track.first_step, last - track.first_step + 1
            states = max(begin, 0), min(max(end, 0), len(track.positions))
            part = self.nominal.path.kept.get((id(track), *states), partial(track.part, *states), track)
            room = max(track.size_m)
            inside = (part.positions > low - room) & (part.positions < high + room)
            if len(part.positions) and bool(inside.all(axis=1).any()):
                near.append(part)
        return near

    def _on_path(self, track: Track) -> OnPath:
        index = min(max(track.first_step - self.first_step, 0), self.count - 1)
        path, near_m = self.nominal.path, float(self.nominal.stations_m[index])
        return path.kept.get(
            ("row", id(track), self.step_s, near_m), lambda: OnPath.of(path, track, self.step_s, near_m), track
        )

    def drive(self, driver: ReferenceDriver, takes_over: int = 0) -> Driven:
        """Return the motion of a driver that takes over at a given state."""
        stations: list[float] = self.nominal.stations_m[: takes_over + 1].tolist()
        speeds: list[float] = self.nominal.speeds_mps[: takes_over + 1].tolist()
        memory, braking, brakes_from = driver.begin(), 0.0, None
        felt = 0.0 if takes_over == 0 else (speeds[-1] - speeds[-2]) / self.step_s
        for index in range(takes_over, self.count - 1):
            met = self._met.seen(self.first_step + index, stations[-1], self.body, self.step_s)
            seen = self._seen(index, stations[-1], met)
            memory, wanted = driver.react(memory, Moment(index * self.step_s, speeds[-1], felt, seen))
            if self._is_over(index, met, speeds[-1], wanted):
                break
            if wanted is not None and brakes_from is None:
                brakes_from = index
            if brakes_from is None:
                station, speed = float(self.nominal.stations_m[index + 1]), float(self.nominal.speeds_mps[index + 1])
            else:
                braking = 0.0 if wanted is None else self.brakes.after(braking, wanted, self.step_s)
                speed = max(speeds[-1] - braking * self.step_s, 0.0)
                station = stations[-1] + (speeds[-1] + speed) / 2 * self.step_s
            felt = (speed - speeds[-1]) / self.step_s
            stations.append(station)
            speeds.append(speed)
            if brakes_from is not None and speed < STANDING_MPS:
                return Driven(np.array(stations), np.array(speeds), brakes_from, stands=True)
        return Driven(np.array(stations), np.array(speeds), brakes_from, stands=False)

    def _is_over(self, index: int, met: Seen | None, speed: float, wanted: float | None) -> bool:
        """Return True if the ego and ``met``, which no longer brakes, can no longer reach each other."""
        if met is None or self.first_step + index <= self.met_until or met.slowing_mps2 > 0:
            return False
        if met.is_passed:
            return met.along_mps <= speed
        return wanted is None and met.gap_m > 0 and speed <= met.along_mps

    def undisturbed(self, count: int) -> Driven:
        """Return the nominal motion over ``count`` states."""
        return Driven(self.nominal.stations_m[:count], self.nominal.speeds_mps[:count], None, stands=False)

    def _has_passed(self, index: int, station: float, speed: float) -> bool:
        """Return True if the ego has passed ``met``, and ``met`` does not catch up."""
        met = self._met.seen(self.first_step + index, station, self.body, self.step_s)
        return met is not None and met.is_passed and met.along_mps <= speed

    def _seen(self, index: int, station: float, met: Seen | None) -> tuple[Seen, ...]:
        """Return what the driver sees: ``met`` unless it is hidden, and on its lane all other road users."""
        if not self._watched:
            return () if met is None else (met,)
        if self.nominal.was_driven and (met is None or not met.is_in_way):
            return () if met is None else (met,)
        step = self.first_step + index
        rows = [] if met is None else [(met, self._met.offset_at(step), self._met.hides)]
        for row in self._watched:
            seen = row.seen(step, station, self.body, self.step_s)
            if seen is not None:
                rows.append((seen, row.offset_at(step), row.hides))
        shown = with_hidden(rows, WANDERING_M)
        return tuple(one for one in shown if one.key == self._met.key) if self.nominal.was_driven else shown

    def is_clear(self, driven: Driven, aside_m: Values | None = None, turned_rad: Values | None = None) -> bool:
        """Return True if a drive touches neither ``met`` nor any other road user that it drives into.

        ``aside_m`` (n,): the ego's offset to the left of the path at each state; ``turned_rad`` (n,): its additional
        turn.
        """
        return self.is_clear_of_met(driven, aside_m, turned_rad) and not self._drives_into_others(driven)

    def bodies(self, driven: Driven, aside_m: Values | None = None, turned_rad: Values | None = None) -> NDArray[Any]:
        """Return the ego's polygons (n,) at the states of a drive; see :meth:`is_clear`.

        For a driver that reacts, they are shorter by the resolution of the steps: its position is known to half of full
        braking times the squared step, and the fuzzy model and RSS stop exactly at a standing obstacle.
        """
        known_m = 0.0 if driven.brakes_from is None else self.brakes.full_mps2 * self.step_s**2 / 2
        body = (self.body[0] - 2 * known_m, self.body[1])
        centers, bearings = self.nominal.path.poses(driven.stations_m)
        if aside_m is not None and turned_rad is not None:
            centers = centers + np.column_stack([-np.sin(bearings), np.cos(bearings)]) * aside_m[:, None]
            bearings = bearings + turned_rad
        return rectangles(centers, bearings, body)

    def is_clear_of_met(self, driven: Driven, aside_m: Values | None = None, turned_rad: Values | None = None) -> bool:
        """Return True if a drive does not touch ``met``; see :meth:`is_clear`."""
        import shapely

        own = self.bodies(driven, aside_m, turned_rad)
        begin, theirs = self._met_bodies
        first, last = max(begin, 0), min(begin + len(theirs), len(own))
        if last > first and bool(shapely.intersects(own[first:last], theirs[first - begin : last - begin]).any()):
            return False
        shown = self.met_until - self.first_step + 1
        later = theirs[max(len(own) - begin, 0) : max(shown - begin, 0)]
        return not (driven.stands and len(later) and bool(shapely.intersects(own[-1], later).any()))

    @cached_property
    def _met_bodies(self) -> tuple[int, NDArray[Any]]:
        """The index of the first state at which ``met`` is present (negative if it is earlier), and its polygons."""
        track = self.met
        return track.first_step - self.first_step, rectangles(track.positions, track.headings_rad, track.size_m)

    def _drives_into_others(self, driven: Driven) -> bool:
        """Return True if the ego, once its driver controls it, touches another road user that is not behind it."""
        import shapely

        begins = driven.brakes_from if self.nominal.was_driven else 0
        if begins is None or not self.others:
            return False
        centers, bearings = self.nominal.path.poses(driven.stations_m)
        own = self.bodies(driven)
        for track in self._near_the_path:
            shift = track.first_step - self.first_step
            first, last = max(begins, shift), min(shift + len(track.positions), len(own))
            if last <= first:
                continue
            theirs = slice(first - shift, last - shift)
            towards = track.positions[theirs] - centers[first:last]
            reach = np.hypot(*towards.T) < (sum(self.body) + sum(track.size_m)) / 2
            along = np.cos(bearings[first:last]) * towards[:, 0] + np.sin(bearings[first:last]) * towards[:, 1]
            at = np.flatnonzero(reach & (along > 0))
            if not len(at):
                continue
            bodies = rectangles(track.positions[theirs][at], track.headings_rad[theirs][at], track.size_m)
            if bool(shapely.intersects(own[first:last][at], bodies).any()):
                return True
        return False

    def prevents(self, driver: ReferenceDriver, takes_over: int = 0) -> bool:
        """Return True if a driver that takes over at a state touches neither ``met`` nor any road user ahead."""
        return self.is_clear(self.drive(driver, takes_over))

    def latest_takeover(self, driver: ReferenceDriver, last: int) -> int | None:
        """Return the latest state for a takeover, at most ``last``; None if even the first state is too late.

        Uses bisection: the driver prevents the collision from that state, but not from the next state.
        """
        if not self.prevents(driver):
            return None
        early, late = 0, last + 1
        while late - early > 1:
            middle = (early + late) // 2
            early, late = (middle, late) if self.prevents(driver, middle) else (early, middle)
        return early


def going_on(track: Track, last_step: int, step_s: float) -> Track:
    """Return a track extended to a step, straight at its last speed, or braking to a standstill if it braked."""
    count = last_step - track.last_step
    if count <= 0:
        return track
    speed, back = float(track.speeds_mps[-1]), min(round(_MEAN_OVER_S / step_s), len(track.speeds_mps) - 1)
    slowing = 0.0 if back < 1 else (float(track.speeds_mps[-1 - back]) - speed) / (back * step_s)
    slowing = slowing if slowing > _BRAKES_MPS2 else 0.0
    speeds = np.maximum(speed - slowing * np.arange(1, count + 1) * step_s, 0.0)
    distances_m = np.cumsum((np.concatenate([[speed], speeds[:-1]]) + speeds) / 2 * step_s)
    heading = float(track.headings_rad[-1])
    positions = track.positions[-1] + np.outer(distances_m, [np.cos(heading), np.sin(heading)])
    return replace(
        track,
        positions=np.concatenate([track.positions, positions]),
        headings_rad=np.concatenate([track.headings_rad, np.full(count, heading)]),
        speeds_mps=np.concatenate([track.speeds_mps, speeds]),
    )
