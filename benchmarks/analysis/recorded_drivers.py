"""Simulates reference drivers in place of an ego that collided in a recorded scenario, independently of the product.

The drivers are those of ``planners.driver_models``, written from ``docs/reference_drivers.md``. Each follows the
ego's path, straight on after its end, at the ego's speeds until it reacts, in steps of 20 ms. Other road users are
projected onto this path near their previous place on it. A track that has ended continues straight at its last speed,
or brakes to a stop if it braked. A driver prevents a collision if it touches neither the other party until both can no
longer meet (at most 30 s after the contact) nor another road user ahead of it once it brakes.

A verdict counts if it stays the same with the others 0.1 m larger and smaller on every side, and with a response 0.2 s
later and 0.05 s earlier. It is left out if another vehicle may hide the other party.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..planners.driver_models import BRAKES, STEP_S, TOUCH_M, Careful, Responding, View, fuzzy_asks, rss_asks
from .recorded import Array, Hit, corners, overlap, pose_of, size_of

DRIVERS = ("full_braking", "r157_careful", "fsm", "rss")
FINE_S, FOLLOWED_S, STANDS_MPS = 0.02, 30.0, 0.1
BRAKED_OVER_S, BRAKED_MPS2 = 0.5, 1.0
"""A road user brakes at the end of its track if it slowed down by more than 1 m/s² over the last half second."""
VARIANTS = ((0.0, 0.0), (0.1, 0.0), (-0.1, 0.0), (0.0, 0.2), (0.0, -0.05))
"""Enlargement of the others on every side in m, and delay of the driver's response in s."""


class _Hidden(Exception):
    """Another vehicle between the two may hide the one that was hit."""


@dataclass(frozen=True)
class DrivenPath:
    """The way that an ego drove, and straight on after its end: points (n, 2), stations and headings (n,)."""

    points: Array
    stations: Array
    headings: Array

    @classmethod
    def driven(cls, poses: Array) -> "DrivenPath":
        """Return the way of driven poses (n, 4)."""
        moved = np.concatenate([[True], np.hypot(*np.diff(poses[:, :2], axis=0).T) > 1e-6])
        points, headings = poses[moved, :2], np.unwrap(poses[moved, 2])
        stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        along = np.array([math.cos(headings[-1]), math.sin(headings[-1])])
        back = np.array([math.cos(headings[0]), math.sin(headings[0])])
        return cls(
            np.vstack([points[0] - 200.0 * back, points, points[-1] + 2000.0 * along]),
            np.concatenate([[-200.0], stations, [stations[-1] + 2000.0]]),
            np.concatenate([headings[:1], headings, headings[-1:]]),
        )

    def pose(self, station: float) -> Array:
        """Return x, y and heading at a station."""
        return np.array([np.interp(station, self.stations, row) for row in (*self.points.T, self.headings)])

    def place(self, point: Array, near: float | None, within_m: float) -> tuple[float, float]:
        """Return the station of a point and how far left of the way it is, within a distance of its last station."""
        begins, ends = self.points[:-1], self.points[1:]
        lengths = np.diff(self.stations)
        along = (ends - begins) / lengths[:, None]
        at = np.clip(((point - begins) * along).sum(axis=1), 0.0, lengths)
        stations = self.stations[:-1] + at
        away = np.hypot(*(point - begins - along * at[:, None]).T)
        if near is not None and bool((kept := np.abs(stations - near) <= within_m).any()):
            away = np.where(kept, away, np.inf)
        best = int(away.argmin())
        left = point - begins[best]
        return float(stations[best]), float(along[best][0] * left[1] - along[best][1] * left[0])


@dataclass(frozen=True)
class Course:
    """A road user along a path, one entry per step from the run's first: poses (n, 4), NaN if it is not there.

    ``rows``: arc length, offset to the left, turn against the path, speed. ``shown``: number of steps in its track.
    """

    poses: Array
    size: Array
    rows: Array
    shown: int

    @classmethod
    def of(cls, obstacle: Any, way: DrivenPath, first_step: int, count: int, step_s: float) -> "Course":
        """Return the course of an obstacle over so many steps."""
        found = [pose_of(obstacle, first_step + i) for i in range(count)]
        there = [i for i, pose in enumerate(found) if pose is not None]
        shown = there[-1] + 1 if there else 0
        poses = np.array([np.full(4, np.nan) if pose is None else pose for pose in found])
        if 0 < shown < count:
            poses[shown:] = _continued(
                poses[:shown], count - shown, step_s, _slowing(obstacle, first_step, shown, step_s)
            )
        rows, near = np.full((count, 4), np.nan), None
        for i in range(there[0] if there else count, count):
            if math.isnan(poses[i, 0]):
                continue
            within = 5.0 + 2.0 * poses[i, 3] * step_s
            near, left = way.place(poses[i, :2], near, within)
            rows[i] = near, left, poses[i, 2] - way.pose(near)[2], poses[i, 3]
        return cls(poses, size_of(obstacle), rows, shown)

    def view(self, at: float, station: float, body: Array, larger: float, step_s: float) -> View | None:
        """Return a driver's view of it from an arc length at a time in steps, or None if it is not there."""
        now, before = self._row(at), self._row(max(at - STEP_S / step_s, 0.0))
        if now is None:
            return None
        size = self.size + 2 * larger
        turn = now[2]
        long = size[0] * abs(math.cos(turn)) + size[1] * abs(math.sin(turn))
        reach, ahead = (long + body[0]) / 2, now[0] - station
        aside = self._aside(now, size, body)
        nearing = 0.0 if before is None else (self._aside(before, size, body) - aside) / STEP_S
        slowing = 0.0 if before is None else (before[3] - now[3]) / STEP_S
        return View(ahead - reach, ahead + reach, aside, nearing, now[3] * math.cos(turn), slowing)

    def _aside(self, row: Array, size: Array, body: Array) -> float:
        across = size[0] * abs(math.sin(row[2])) + size[1] * abs(math.cos(row[2]))
        return float(abs(row[1]) - (across + body[1]) / 2)

    def _row(self, at: float) -> Array | None:
        low = min(int(at), len(self.rows) - 1)
        high = min(low + 1, len(self.rows) - 1)
        share = at - low
        if math.isnan(self.rows[low, 0]) or math.isnan(self.rows[high, 0]):
            return None
        row: Array = self.rows[low] + min(share, 1.0) * (self.rows[high] - self.rows[low])
        return row


def _slowing(obstacle: Any, first_step: int, shown: int, step_s: float) -> float:
    """Return the mean deceleration over the last half second of a track, or 0 if it is no braking."""
    back = round(BRAKED_OVER_S / step_s)
    last, earlier = pose_of(obstacle, first_step + shown - 1), pose_of(obstacle, first_step + shown - 1 - back)
    slowing = 0.0 if last is None or earlier is None else (earlier[3] - last[3]) / (back * step_s)
    return float(slowing) if slowing > BRAKED_MPS2 else 0.0


def _continued(poses: Array, count: int, step_s: float, slowing: float) -> Array:
    """Return the poses after the end of a track."""
    x, y, heading, speed = poses[-1]
    rows = []
    for _ in range(count):
        slower = max(speed - slowing * step_s, 0.0)
        x, y = (
            x + (speed + slower) / 2 * step_s * math.cos(heading),
            y + (speed + slower) / 2 * step_s * math.sin(heading),
        )
        speed = slower
        rows.append((x, y, heading, speed))
    return np.array(rows)


@dataclass(frozen=True)
class Scene:
    """A collision along the way that the ego drove."""

    hit: Hit

    @cached_property
    def driven(self) -> Array:
        """The driven poses up to the contact (n, 4)."""
        return np.array([self.hit.own(i) for i in range(self.hit.at + 1)])

    @cached_property
    def way(self) -> DrivenPath:
        """The way of the ego."""
        return DrivenPath.driven(self.driven)

    @cached_property
    def stations(self) -> Array:
        """The ego's station at each driven step."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.driven[:, :2], axis=0).T))])

    @property
    def count(self) -> int:
        """The number of simulated steps."""
        return self.hit.at + round(FOLLOWED_S / self.hit.record.step_s) + 1

    @cached_property
    def met(self) -> Course:
        """The course of the one that was hit."""
        return self._course(self.hit.obstacle)

    @cached_property
    def others(self) -> list[Course]:
        """The courses of all others that come near the way."""
        found = [self._course(other) for other in self.hit.others]
        return [one for one in found if one.shown and bool((np.abs(one.rows[:, 1]) < 10.0).any())]

    def _course(self, obstacle: Any) -> Course:
        return Course.of(obstacle, self.way, self.hit.steps.first_step, self.count, self.hit.record.step_s)

    def nominal(self, at: float) -> tuple[float, float]:
        """Return station and speed of the driven motion at a time in steps."""
        last = len(self.stations) - 1
        if at >= last:
            speed = float(self.driven[-1, 3])
            return float(self.stations[-1]) + speed * (at - last) * self.hit.record.step_s, speed
        steps = np.arange(last + 1)
        return float(np.interp(at, steps, self.stations)), float(np.interp(at, steps, self.driven[:, 3]))

    def prevents(self, driver: str, larger: float, later: float, begins: int = 0) -> bool:
        """Return True if a driver prevents the collision; ``begins``: the step from which full braking brakes.

        Raises:
            _Hidden: it may not see the other party.
        """
        step_s, fine = self.hit.record.step_s, round(self.hit.record.step_s / FINE_S)
        full, ramp = BRAKES.get(self.hit.record.ego_class, BRAKES["car"])
        body, careful, responding = self.hit.own_size, Careful(later), Responding(later)
        (station, v), force, felt, free = self.nominal(begins), 0.0, 0.0, True
        for step in range(begins, self.count):
            if self._touches(self.met, step, station, 0.0 if free else TOUCH_M, larger):
                return False
            if not free and any(self._runs_into(other, step, station, larger) for other in self.others):
                return False
            seen = self.met.view(step, station, body, larger, step_s)
            if not free and v < STANDS_MPS:
                later_steps = range(step, self.met.shown)
                return not any(self._touches(self.met, i, station, TOUCH_M, larger) for i in later_steps)
            if step >= self.met.shown and seen is not None and seen.past <= 0 and seen.speed <= v and seen.slowing <= 0:
                return True
            for part in range(fine):
                at = step + part / fine
                asked = self._asks(driver, at, begins, (careful, responding), station, v, felt, larger)
                free = free and asked <= 0
                if free:
                    place, new = self.nominal(at + 1 / fine)
                else:
                    force = min(force + full / ramp * FINE_S, full, asked) if asked > 0 else 0.0
                    new = max(v - force * FINE_S, 0.0)
                    place = station + (v + new) / 2 * FINE_S
                felt, station, v = (new - v) / FINE_S, place, new
        return True

    def _asks(
        self,
        driver: str,
        at: float,
        begins: int,
        reacting: tuple[Careful, Responding],
        station: float,
        v: float,
        felt: float,
        larger: float,
    ) -> float:
        """Return the deceleration that a driver asks for at a time in steps."""
        if driver == "full_braking":
            return math.inf if at >= begins else 0.0
        step_s = self.hit.record.step_s
        seen = self.met.view(at, station, self.hit.own_size, larger, step_s)
        careful, responding = reacting
        if seen is None:
            return 0.0 if driver == "r157_careful" else responding.allowed(at * step_s, 0.0)
        if seen.aside <= 0:
            for other in self.others:
                front = other.view(at, station, self.hit.own_size, larger, step_s)
                if front is not None and front.aside <= 0.2 and 0 <= front.gap < seen.gap and at < other.shown:
                    raise _Hidden
        if driver == "r157_careful":
            return careful.wants(at * step_s, v, felt, seen)
        return responding.allowed(at * step_s, fuzzy_asks(v, felt, seen) if driver == "fsm" else rss_asks(v, seen))

    def _touches(self, other: Course, step: int, station: float, less: float, larger: float) -> bool:
        pose = other.poses[step]
        own = self.way.pose(station)
        reach = (other.size.sum() + self.hit.own_size.sum()) / 2 + 1.0
        if math.isnan(pose[0]) or math.hypot(*(pose[:2] - own[:2])) > reach:
            return False
        ours = corners(own, self.hit.own_size - np.array([2 * less, 0.0]))
        return overlap(ours, corners(pose, other.size, larger), (own[2], pose[2]))

    def _runs_into(self, other: Course, step: int, station: float, larger: float) -> bool:
        """Return True if the ego touches another road user ahead of its centre within that one's track."""
        if step >= other.shown or math.isnan(other.rows[step, 0]) or other.rows[step, 0] <= station:
            return False
        return self._touches(other, step, station, TOUCH_M, larger)


def prevented_by(hit: Hit, driver: str) -> bool | None:
    """Return whether a driver prevents a collision from just before it, or None if that is unclear."""
    scene = Scene(hit)
    verdicts = set[bool]()
    for larger, later in VARIANTS:
        if later != 0 and driver == "full_braking":  # it has no response time
            continue
        try:
            verdicts.add(any(_tried(scene, driver, larger, later)))
        except _Hidden:
            return None
        if len(verdicts) > 1:
            return None
    return verdicts.pop()


def _tried(scene: Scene, driver: str, larger: float, later: float) -> Iterator[bool]:
    """Yield whether a driver prevents it: full braking from each step before the contact, others from the first."""
    if driver != "full_braking":
        yield scene.prevents(driver, larger, later)
    else:
        for begins in range(scene.hit.at, -1, -1):
            yield scene.prevents(driver, larger, later, begins)
