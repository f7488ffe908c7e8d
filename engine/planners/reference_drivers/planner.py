"""Reference drivers as planners: they follow the reference path and brake by their models.

The models do not define the driving while they do not react. With ``follows`` the planner drives like the Intelligent
Driver Model (``idm.py``): to the goal, at its time headway behind others, braking at most comfortably. Without
``follows``, the planner keeps its lane and its initial speed until it reacts. After a reaction, it keeps the speed that
it then has, like the reference drivers of verdicts. Its model perceives the others as observed when the plan is made;
within a plan they move as predicted. The lateral motion and the speeds in curves are those of the Intelligent Driver
Model.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from inspect import signature
from typing import Any

import numpy as np

from ....schemas.reviews import DriverModelName
from ...geometry import Values, arc_length, project_all, wrap_angles
from ...vehicles import vehicle_classes
from ..idm import IntelligentDriver
from ..interface import Observation, PlanningTask, PredictedObstacle
from .drives import WANDERING_M
from .models import (
    HEAVY_BRAKES,
    CarefulDriver,
    FullBraking,
    FuzzyDriver,
    KeepLane,
    Moment,
    ReferenceDriver,
    RssDriver,
    Seen,
    brakes_of,
)
from .paths import with_hidden

NOMINAL: Mapping[str, float] = {
    "follows": 0.0,
    "time_headway_s": 2.0,
    "minimum_gap_m": 2.0,
    "acceleration_mps2": 1.0,
    "deceleration_mps2": 1.67,
    "lateral_acceleration_mps2": 3.0,
}
"""Defaults for driving while the model does not react: UN R157's time headway, the acceleration of the vehicles in the
Joint Research Centre's comparison, and otherwise the values of ``idm``.
"""
_TRACTOR = 4
"""CommonRoad's number of the vehicle that is the tractor of a truck."""
_HIDES_FROM_M = 1.2
"""Pedestrians, bicycles and motorcycles are narrower than this and hide no other road user."""
_BEHIND_M, _AHEAD_M = 50.0, 300.0
"""The part of the path on which others matter, enough for a vehicle at 50 m/s."""


class ReferencePlanner(IntelligentDriver):
    """The planner of one reference driver; see :class:`plannerforge.engine.planners.interface.Planner`.

    ``make``: creates the driver for the weights of a configuration, given by name.
    """

    def __init__(self, make: Callable[[Mapping[str, float]], ReferenceDriver]) -> None:
        self._make = make

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        configuration = task.configuration
        weights = {**NOMINAL, **configuration.weights}
        super().reset(replace(task, configuration=configuration.model_copy(update={"weights": weights})))
        self._driver = self._make(weights)
        self._memory: Any = self._driver.begin()
        self._speeds_before: dict[int, float] = {}
        self._first_step: int | None = None
        self._last_step = 0
        self._at: dict[int, _Pedals] = {}
        kind = vehicle_classes()[task.vehicle.vehicle_class].commonroad_type
        brakes = HEAVY_BRAKES if configuration.settings.vehicle == _TRACTOR else brakes_of(kind)
        self._brakes = brakes.on_road(task.vehicle.friction)

    def _motion(self, observation: Observation, station: float) -> tuple[Values, Values]:
        """Return the distance in m and the speed, per step, of a rear axle that starts at a station."""
        ego, step_s = observation.ego, self._task.step_s
        if self._first_step is None:
            self._first_step = ego.step
        ahead = self._ahead(observation, self._path.center_station(station))
        pedals = self._at.get(ego.step, _Pedals(0.0, ego.speed_mps))
        memory, now_s = self._memory, (ego.step - self._first_step) * step_s
        travelled, speeds = np.zeros(self._steps + 1), np.full(self._steps + 1, ego.speed_mps)
        self._at = {ego.step: pedals}
        felt, desired = ego.acceleration_mps2, self._desired_speed.at(ego)
        for i in range(self._steps):
            speed, rear_m = float(speeds[i]), station + float(travelled[i])
            center_m = self._path.center_station(rear_m)
            seen = ahead.seen(i, center_m)
            memory, wanted = self._driver.react(memory, Moment(now_s + i * step_s, speed, felt, seen))
            if i == 0:  # later steps of the plan are predicted, not perceived
                self._memory = memory
            if wanted is None:
                pedals = replace(pedals, braking_mps2=0.0)
            else:
                pedals = replace(pedals, braking_mps2=self._brakes.after(pedals.braking_mps2, wanted, step_s))
            nominal = self._undisturbed_mps2(desired, speed, pedals.kept_mps, center_m, rear_m, seen)
            acceleration = nominal if wanted is None else min(nominal, -pedals.braking_mps2)
            grip = self._grip_mps2(speed, rear_m + speed * step_s / 2)
            most = min(grip, self._task.vehicle.most_acceleration_mps2(speed))
            acceleration = min(max(acceleration, -grip), most)
            speeds[i + 1] = max(speed + acceleration * step_s, 0.0)
            travelled[i + 1] = travelled[i] + (speed + speeds[i + 1]) / 2 * step_s
            felt = (float(speeds[i + 1]) - speed) / step_s
            if wanted is not None:
                pedals = replace(pedals, kept_mps=min(pedals.kept_mps, float(speeds[i + 1])))
            self._at[ego.step + i + 1] = pedals
        return travelled, speeds

    def _undisturbed_mps2(
        self, desired_mps: float, speed: float, kept_mps: float, center_m: float, rear_m: float, seen: tuple[Seen, ...]
    ) -> float:
        """Return the acceleration of a driver while its model does not react."""
        step_s, top = self._task.step_s, self._task.vehicle.maximum_speed_mps
        in_bend = self._before_curve(speed, rear_m + speed * step_s)
        if not self._weights["follows"]:
            return min((kept_mps - speed) / step_s, self._weights["acceleration_mps2"], in_bend)
        acceleration = self._free(speed, min(desired_mps, self._allowed(center_m), top))
        leaders = [
            one
            for one in seen
            if one.hider_gap_m is None and one.is_in_way and one.gap_m > -self._task.vehicle.length_m
        ]
        if leaders:
            leader = min(leaders, key=lambda one: one.gap_m)
            acceleration -= self._interaction(speed, leader.gap_m, speed - leader.along_mps)
        return min(max(acceleration, -self._weights["deceleration_mps2"]), in_bend)

    def _ahead(self, observation: Observation, center_m: float) -> "_Ahead":
        """Return the other road users along the path near the ego."""
        points = self._task.reference.points
        near = (self._way.stations_m >= center_m - _BEHIND_M) & (self._way.stations_m <= center_m + _AHEAD_M)
        first = int(np.argmax(near))
        line = points[near] if near.sum() > 1 else points
        begin_m = float(self._way.stations_m[first]) if near.sum() > 1 else 0.0
        elapsed_s = (observation.ego.step - self._last_step) * self._task.step_s
        rows = []
        for obstacle in observation.obstacles:
            if not len(obstacle.positions):
                continue
            before = self._speeds_before.get(obstacle.obstacle_id)
            slower = 0.0 if before is None or elapsed_s <= 0 else (before - obstacle.speed_mps) / elapsed_s
            rows.append(_row(obstacle, line, begin_m, slower, self._task.step_s))
        self._speeds_before = {obstacle.obstacle_id: obstacle.speed_mps for obstacle in observation.obstacles}
        self._last_step = observation.ego.step
        return _Ahead(tuple(rows), (self._task.vehicle.length_m, self._task.vehicle.width_m))


@dataclass(frozen=True)
class _Pedals:
    """A driver's deceleration, and the speed that it keeps while it does not react."""

    braking_mps2: float
    kept_mps: float


@dataclass(frozen=True)
class _Row:
    """One obstacle along the path, one entry per step: station and offset of its centre, extents, speed along it."""

    key: int
    hides: bool
    slowing_mps2: float
    middle_m: Values
    offset_m: Values
    half_along_m: Values
    half_across_m: Values
    along_mps: Values
    nearing_mps: Values


def _row(obstacle: PredictedObstacle, line: Any, begin_m: float, slower: float, step_s: float) -> _Row:
    stations, offsets = project_all(line, obstacle.positions)
    begins = arc_length(line)
    at = np.clip(np.searchsorted(begins, stations, side="right") - 1, 0, len(begins) - 2)
    along = np.diff(line, axis=0)[at]
    turned = wrap_angles(obstacle.headings_rad - np.arctan2(along[:, 1], along[:, 0]))
    cosine, sine = np.cos(turned), np.sin(turned)
    length, width = obstacle.length_m, obstacle.width_m
    across = (length * np.abs(sine) + width * np.abs(cosine)) / 2
    moved = np.hypot(*np.diff(obstacle.positions, axis=0).T) / step_s
    moving = np.concatenate([[obstacle.speed_mps], moved])[: len(stations)]
    aside = np.abs(offsets) - across
    closer = -np.diff(aside, append=aside[-1:]) / step_s
    if len(closer) > 1:
        closer[-1] = closer[-2]
    return _Row(
        key=obstacle.obstacle_id,
        hides=width >= _HIDES_FROM_M,
        slowing_mps2=slower,
        middle_m=begin_m + stations,
        offset_m=offsets,
        half_along_m=(length * np.abs(cosine) + width * np.abs(sine)) / 2,
        half_across_m=across,
        along_mps=moving * cosine,
        nearing_mps=closer,
    )


@dataclass(frozen=True)
class _Ahead:
    """All obstacles along the path, and the ego's length and width."""

    rows: tuple[_Row, ...]
    body: tuple[float, float]

    def seen(self, index: int, station_m: float) -> tuple[Seen, ...]:
        """Return the obstacles as a driver with its centre at a station perceives them ``index`` steps ahead."""
        found = []
        for row in self.rows:
            if index >= len(row.middle_m):
                continue
            ahead = float(row.middle_m[index]) - station_m
            reach = float(row.half_along_m[index]) + self.body[0] / 2
            aside = abs(float(row.offset_m[index])) - float(row.half_across_m[index]) - self.body[1] / 2
            seen = Seen(
                key=row.key,
                gap_m=ahead - reach,
                past_m=ahead + reach,
                aside_m=aside,
                nearing_mps=float(row.nearing_mps[index]),
                along_mps=float(row.along_mps[index]),
                slowing_mps2=row.slowing_mps2 if index == 0 else 0.0,
            )
            found.append((seen, float(row.offset_m[index]), row.hides))
        return with_hidden(found, WANDERING_M)


DRIVERS: Mapping[DriverModelName, Callable[..., ReferenceDriver]] = {
    "r157_careful": CarefulDriver,
    "fsm": FuzzyDriver,
    "rss": RssDriver,
    "full_braking": FullBraking,
    "keep_lane": KeepLane,
}
"""Maps each driver's name to its model."""


def reference_planner(name: DriverModelName) -> ReferencePlanner:
    """Return the planner of a reference driver, with parameters from a run's weights."""
    model = DRIVERS[name]
    parameters = signature(model).parameters

    def make(weights: Mapping[str, float]) -> ReferenceDriver:
        return model(**{parameter: weights[parameter] for parameter in parameters if parameter in weights})

    return ReferencePlanner(make)
