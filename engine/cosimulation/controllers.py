"""Speed controllers: slow driven vehicles down for reasons that SUMO's driver model does not cover.

Each handles one case that SUMO does not: waiting for a gap next to the target lane, a curve that is nearer than the
driver's own deceleration allows, curves of a long lane, or a halt to give way. After every step, each controller
returns a vehicle's maximum speed for the next step, and the lowest of these speeds applies. Controllers brake with the
driver's own deceleration, and harder only if that would be too late (:func:`next_speed_mps`). Speeds in m/s.
"""

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator

import numpy as np

from ..geometry import Values
from ..traffic import LaneHint, Sumo
from ..vehicles import HARDEST_BRAKING_MPS2, STANDING_MPS
from .actors import Actor
from .manoeuvres import LANE_CHANGE_S, Halt


class _SpeedController(ABC):
    """Slows down the driven vehicles of one simulation; created with the simulation."""

    def __init__(self, sumo: Sumo) -> None:
        self._sumo = sumo

    @abstractmethod
    def highest_speed_mps(self, actor: Actor, lane: str) -> float | None:
        """Return the speed to brake to in the next step, or None if the vehicle is not limited.

        Called once per step for every driven vehicle, from its hand-over on; ``lane``: its SUMO lane.
        """


AT_STOP_M = 1.0
"""A vehicle that stands this near its halt has arrived (chosen): another vehicle that stands there keeps it behind."""
STOPPED_WITHIN_M = 0.5
"""Least distance that a stopping vehicle assumes (chosen): with less, rounding would brake without bound."""


def next_speed_mps(
    speed_mps: float,
    usual_mps2: float,
    step_s: float,
    room_m: float | Values,
    left_m: float | Values,
    final_mps: float | Values = 0.0,
    hardest_mps2: float = HARDEST_BRAKING_MPS2,
) -> float | None:
    """Return the speed after the next step of a vehicle that must slow down, or None if it is not limited.

    The vehicle should slow down within ``room_m`` and must do so within ``left_m``. ``usual_mps2``: the driver's own
    deceleration. ``final_mps``: the speed to reach, by default 0. There may be several points (n,), each with its
    distance and its speed. ``hardest_mps2``: the hardest braking.
    """
    room_m = np.maximum(room_m - speed_mps * step_s, 0.0)
    allowed = math.sqrt(float(np.min(final_mps**2 + 2 * usual_mps2 * room_m)))
    if speed_mps + usual_mps2 * step_s <= allowed:
        return None
    needed = 0.0
    if allowed < speed_mps - usual_mps2 * step_s:
        needed = float(np.max((speed_mps**2 - final_mps**2) / (2 * np.maximum(left_m, STOPPED_WITHIN_M))))
    slowest = max(speed_mps - min(max(needed, usual_mps2), hardest_mps2) * step_s, 0.0)
    return max(min(allowed, speed_mps), slowest)


LANE_END_M = 0.5
"""A lane counts as over this far before its end (chosen); on a shorter one, at half of it."""
TO_STEER_OVER_M = 15.0
"""Length of road that a slow vehicle needs to change into the adjacent lane (chosen); it waits that far before the end
of its own.

A vehicle that needs several lane changes waits this distance for each of them.
"""
STEERING_OVER_MPS = 5.0
"""Speed at which a vehicle with a gap next to it rolls on (chosen): SUMO starts no change while it brakes hard."""
STEERING_OVER_M = 0.3
"""A vehicle farther from the centre of its lane is not yet entirely in it (chosen)."""
SLOWER_MPS = 1.0
"""A speed limit lower by no more than this hardly changes a drive (chosen)."""


class GapWaitController(_SpeedController):
    """Makes vehicles that find no gap into their target's lane wait next to it instead of driving past it.

    A vehicle looks for a gap until it must brake with the driver's own deceleration, and stops while there is still
    road to change lanes. A vehicle that is too fast for that brakes as hard as it must.
    """

    def __init__(self, sumo: Sumo) -> None:
        super().__init__(sumo)
        self._stop_given: set[str] = set()
        self._arrived: set[str] = set()
        self._first_lane: dict[str, str] = {}
        self._branched: set[str] = set()

    def highest_speed_mps(self, actor: Actor, lane: str) -> float | None:
        """Return the speed to brake to, as in the base class."""
        self._take_branch(actor, lane)
        if actor.target is None or not actor.lanes_to_target or actor.key in self._arrived:
            return None
        edge, _, lane_index = lane.rpartition("_")
        if edge == actor.target[0] and lane in actor.lanes_to_target:
            self._arrived.add(actor.key)
            return None
        self._give_stop(actor, actor.target, edge)
        if lane in actor.lanes_to_target or not (edge in actor.edges_to_target or edge.startswith(":")):
            return None
        left_m = self._left_m(actor.key, actor.target)
        if left_m < -LANE_END_M:
            return None
        index, wanted = int(lane_index), _nearest_lane(actor, edge, int(lane_index))
        rolls_on = wanted != index and self._steers_over(actor.key, lane, 1 if wanted > index else -1)
        highest_mps = self._braked(actor, left_m, abs(wanted - index), rolls_on=rolls_on)
        if highest_mps is not None and wanted != index:
            self._sumo.change_lane(actor.key, wanted, LANE_CHANGE_S)
        return highest_mps

    def _take_branch(self, actor: Actor, lane: str) -> None:
        """Have SUMO take the junction path that leads to the target, by setting a stop after the junction."""
        if actor.branch is None or actor.target is None or actor.key in self._branched:
            return
        if lane == "{}_{}".format(*actor.target):
            self._branched.add(actor.key)
            self._pass_by_end(actor.key, actor.branch)

    def _pass_by_end(self, key: str, lane: LaneHint) -> None:
        """Have SUMO find a route to the end of a lane, by setting a stop there that the vehicle only passes."""
        station_m = self._sumo.lane_length_m("{}_{}".format(*lane)) - LANE_END_M
        self._sumo.pass_by(key, lane, max(station_m, LANE_END_M))

    def _left_m(self, key: str, target: LaneHint) -> float:
        """Return the distance in m to the end of the target; far below 0 if the vehicle is past it."""
        end_m = self._sumo.lane_length_m("{}_{}".format(*target))
        return self._sumo.driving_distance_m(key, target, end_m) - min(LANE_END_M, end_m / 2)

    def _steers_over(self, key: str, lane: str, direction: int) -> bool:
        """Return True if a vehicle has a gap next to it or is still moving over: it then needs the whole road."""
        comes_over = self._first_lane.setdefault(key, lane) != lane
        offset_m = abs(self._sumo.offset_m(key))
        return (comes_over and offset_m > STEERING_OVER_M) or self._sumo.could_change_lane(key, direction)

    def _braked(self, actor: Actor, left_m: float, changes: int, *, rolls_on: bool) -> float | None:
        """Return a vehicle's next speed, given the road left for lane changes; ``rolls_on``: a lane change starts."""
        speed, step_s, hardest = self._sumo.speed_mps(actor.key), self._sumo.step_s(), actor.hardest_braking_mps2
        usual, wait_m = actor.behaviour.values["decel"], left_m - changes * TO_STEER_OVER_M
        if not rolls_on:
            return next_speed_mps(speed, usual, step_s, wait_m, left_m, hardest_mps2=hardest)
        over_m = wait_m + TO_STEER_OVER_M
        if over_m > LANE_END_M:
            return next_speed_mps(speed, usual, step_s, wait_m, over_m, STEERING_OVER_MPS, hardest)
        return next_speed_mps(speed, usual, step_s, over_m, left_m, hardest_mps2=hardest)

    def _give_stop(self, actor: Actor, target: LaneHint, present_edge: str) -> None:
        """Have SUMO look for gaps into the target's lane early, by setting a stop there that is only passed.

        The speed limit of a stop's lane applies on the whole route to the stop. Therefore a much slower lane gets its
        stop only when the vehicle is next to that lane, and a vehicle that may take several lanes gets no stop.
        """
        if actor.key in self._stop_given:
            return
        edge, target_lane = target[0], "{}_{}".format(*target)
        limits = [self._sumo.limit_mps(f"{key}_0") for key in actor.edges_to_target if key != edge]
        slower = max(limits, default=0.0) > self._sumo.limit_mps(target_lane) + SLOWER_MPS
        is_only = sum(key.rpartition("_")[0] == edge for key in actor.lanes_to_target) == 1
        if not is_only or (slower and present_edge != edge):
            return
        self._stop_given.add(actor.key)
        self._pass_by_end(actor.key, target)


def _nearest_lane(actor: Actor, edge: str, index: int) -> int:
    """Return the nearest lane of an edge that leads to the target, or the given lane if there is none."""
    lanes = [int(key.rpartition("_")[2]) for key in actor.lanes_to_target if key.rpartition("_")[0] == edge]
    return min(lanes, key=lambda other: (abs(other - index), other), default=index)


CURVE_REACHED_M = 0.1
"""A lane that starts nearer than this has been reached (chosen): the deceleration for it stays finite."""


class AnticipatoryBraking(_SpeedController):
    """Makes rerouted vehicles brake harder than their driver would if a slower lane ahead (a curve) requires it.

    SUMO plans with the driver's deceleration: a vehicle that is handed over too near to a curve would enter it too
    fast, and slow down only in the curve, within a step or two.
    """

    def __init__(self, sumo: Sumo) -> None:
        super().__init__(sumo)
        self._done: set[str] = set()

    def highest_speed_mps(self, actor: Actor, lane: str) -> float | None:
        """Return the speed to brake to, as in the base class."""
        if actor.key in self._done or not actor.is_sent or not lane:
            return None
        speed, step_s = self._sumo.speed_mps(actor.key), self._sumo.step_s()
        needed = self._needed_mps2(actor.key, lane, speed)
        if needed <= actor.behaviour.values["decel"]:
            self._done.add(actor.key)
            return None
        return max(speed - min(needed, actor.hardest_braking_mps2) * step_s, 0.0)

    def _needed_mps2(self, key: str, lane: str, speed_mps: float) -> float:
        """Return the deceleration with which a vehicle meets every speed limit ahead at the start of its lane."""
        ahead_m = self._sumo.lane_length_m(lane) - self._sumo.station_m(key)
        needed = 0.0
        for next_lane in self._sumo.lanes_ahead(key):
            over = speed_mps**2 - self._sumo.limit_mps(next_lane) ** 2
            needed = max(needed, over / (2 * max(ahead_m, CURVE_REACHED_M)))
            ahead_m += self._sumo.lane_length_m(next_lane)
        return needed


BEHIND_M = 1.0
"""A place no farther behind the bumper still counts: the spacing of the places."""


class CurveSpeedController(_SpeedController):
    """Slows vehicles in the curves of a long lane, which has the speed limit of its straights.

    SUMO has one limit per lane. The limit of the sharpest curve would slow vehicles along the whole lane.
    """

    def highest_speed_mps(self, actor: Actor, lane: str) -> float | None:
        """Return the speed to brake to, as in the base class."""
        if not actor.slow_places or not lane:
            return None
        speed, step_s = self._sumo.speed_mps(actor.key), self._sumo.step_s()
        usual = actor.behaviour.values["decel"]
        ahead = list(self._places_ahead(actor, lane, speed * step_s + speed**2 / (2 * usual)))
        if not ahead:
            return None
        away_m, allowed_mps = (np.concatenate(column) for column in zip(*ahead, strict=True))
        return next_speed_mps(speed, usual, step_s, away_m, away_m, allowed_mps, actor.hardest_braking_mps2)

    def _places_ahead(self, actor: Actor, lane: str, reach_m: float) -> Iterator[tuple[Values, Values]]:
        """Yield distances in m to the curves within reach on the route, and their speeds, lane by lane.

        A driver that is faster than others is also faster in curves, within what tyres allow.
        """
        factor = actor.behaviour.values["speedFactor"]
        begin_m = -self._sumo.station_m(actor.key)
        for key in (lane, *self._sumo.lanes_ahead(actor.key)):
            if begin_m > reach_m:
                return
            if key in actor.slow_places:
                places = actor.slow_places[key]
                away_m = places.stations_m + begin_m
                near = away_m >= -BEHIND_M
                if near.any():
                    yield away_m[near], np.minimum(places.speeds_mps * factor, places.hardest_mps)[near]
            begin_m += self._sumo.lane_length_m(key)


class StopController(_SpeedController):
    """Makes vehicles stop where their halts require: to give way, or because an edit orders a stop."""

    def __init__(self, sumo: Sumo) -> None:
        super().__init__(sumo)
        self._steps: dict[str, int] = {}
        self._rolled_m: dict[str, float] = {}
        self._stood_steps: Counter[tuple[str, Halt]] = Counter()

    def highest_speed_mps(self, actor: Actor, lane: str) -> float | None:  # noqa: ARG002 - halts are on any lane
        """Return the speed to brake to, as in the base class."""
        if not actor.halts or actor.drive_from is None:
            return None
        speed_mps, step_s = self._sumo.speed_mps(actor.key), self._sumo.step_s()
        step = self._steps[actor.key] = self._steps.get(actor.key, actor.drive_from - 1) + 1
        if step > actor.drive_from:
            self._rolled_m[actor.key] = self._rolled_m.get(actor.key, 0.0) + speed_mps * step_s
        holding = [one for one in actor.halts if one.from_step <= step < one.until_step]
        left = (one for one in holding if not self._is_over(actor.key, one))
        halt = min(left, key=lambda one: one.rolled_m, default=None)
        if halt is None:
            return None
        left_m = halt.rolled_m - self._rolled_m.get(actor.key, 0.0)
        if left_m <= AT_STOP_M and speed_mps <= STANDING_MPS:
            self._stood_steps[actor.key, halt] += 1
        usual, hardest = actor.behaviour.values["decel"], actor.hardest_braking_mps2
        return next_speed_mps(speed_mps, usual, step_s, left_m, left_m, hardest_mps2=hardest)

    def _is_over(self, key: str, halt: Halt) -> bool:
        """Return True if a vehicle has stood at a halt for as long as ordered."""
        return halt.stands_steps is not None and self._stood_steps[key, halt] >= halt.stands_steps


SPEED_CONTROLLERS: tuple[type[_SpeedController], ...] = (
    GapWaitController,
    AnticipatoryBraking,
    CurveSpeedController,
    StopController,
)
"""All controllers, in the order in which they are called; the first one also orders lane changes."""
