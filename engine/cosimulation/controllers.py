"""Driven vehicles that stop for others where their orders say so."""

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from ...schemas.errors import NotPossible
from ..geometry import Points, Values, arc_length, curvatures, interpolate, project
from ..scene import Scene
from ..vehicles import COMFORTABLE_MPS2, HARDEST_BRAKING_MPS2, HARDEST_LATERAL_MPS2
from .actors import Actor
from .manoeuvres import LANE_CHANGE_S
from .plans import DrivePlan

# ---------- turn_speed
# Whether a vehicle can still slow down enough for the bends of a new way.

SMOOTHING_M = 4.0
SAME_PLACE_M = 0.1
PIECE_M = 20.0
"""The bend of a lanelet counts from the beginning of the piece on where it is: a long one may bend at its far end."""


def check_curves(scene: Scene, plan: DrivePlan, way: tuple[int, ...], who: str) -> None:
    """Refuse a way with a bend that the vehicle comes to too fast, even if it brakes as hard as it can.

    Lanelets of the recorded way are left out: the vehicle was recorded in their bends.

    Raises:
        NotPossible: naming the lanelet, the speed there at best and the highest that its bend takes.
    """
    index = plan.from_step - plan.start.first_step
    recorded = scene.matches.get(plan.start.obstacle_id)
    known = set(recorded.sequence) if recorded is not None and plan.cause != "added" else set()
    found = first_curve_too_tight(scene, way, plan.start.positions[index], float(plan.start.speeds_mps[index]), known)
    if found is not None:
        raise NotPossible(
            f"{who} {found}",
            next_step="choose a target straight ahead, or remove the vehicle and add one that starts slower",
        )


def first_curve_too_tight(
    scene: Scene, way: tuple[int, ...], position: Points, speed_mps: float, known: Collection[int] = ()
) -> str | None:
    """What is wrong with the first bend of a way that somebody at a position (2,) cannot brake enough for; else None.

    ``known``: lanelets whose bends are not asked about.
    """
    speed_mps, here_m = max(speed_mps, 0.0), project(scene.layout.table.lanes[way[0]].center, position)[0]
    for key, ahead_m, curvature in _bends_ahead(scene, way, here_m):
        at_best = math.sqrt(max(speed_mps**2 - 2 * HARDEST_BRAKING_MPS2 * ahead_m, 0.0))
        highest = math.sqrt(HARDEST_LATERAL_MPS2 / curvature)
        if key not in known and at_best > highest:
            where = f"{ahead_m:.0f} m before" if ahead_m > 0.0 else "in"
            return (
                f"drives {speed_mps:.1f} m/s {where} a bend of lanelet {key} that takes at most {highest:.1f} m/s: "
                "it cannot brake enough"
            )
    return None


def highest_entry_speed(scene: Scene, way: tuple[int, ...], station_m: float) -> float:
    """Speed in m/s from which a driver at an arc length of a way's first lanelet brakes with ease for all bends ahead.

    Where the way ends, it is followed as long as it does not fork. Infinite where nothing bends.
    """
    successors, onwards = scene.layout.table.successors, list(way)
    while len(successors[onwards[-1]]) == 1 and successors[onwards[-1]][0] not in onwards:
        onwards.append(successors[onwards[-1]][0])
    bends = _bends_ahead(scene, onwards, station_m)
    return min(
        (math.sqrt(COMFORTABLE_MPS2 / bend + 2 * COMFORTABLE_MPS2 * ahead_m) for _, ahead_m, bend in bends),
        default=math.inf,
    )


def _bends_ahead(scene: Scene, way: Sequence[int], here_m: float) -> Iterator[tuple[int, float, float]]:
    """Every piece of 20 m of a way that bends: its lanelet, how far ahead it begins, and its largest curvature.

    ``here_m``: the arc length of the first lanelet from which on they count. Lanelets beside each other begin equally
    far ahead; a piece that has begun is 0 m ahead.
    """
    lanes, successors, ahead_m = scene.layout.table.lanes, scene.layout.table.successors, -here_m
    for before, key in zip((None, *way), way, strict=False):
        if before is not None and key in successors[before]:
            ahead_m += lanes[before].length_m
        line = lanes[key].center if before is not None else _from(lanes[key].center, here_m)
        for begin_m, curvature in _bends_of(line):
            away_m = begin_m + (0.0 if before is None else ahead_m)
            if away_m > -PIECE_M:
                yield key, max(away_m, 0.0), curvature


def _bends_of(line: Points) -> Iterator[tuple[float, float]]:
    """Where on a line each piece that bends begins, and its largest curvature."""
    stations, curvature = curvatures(line, SMOOTHING_M)
    if len(stations):
        begins = np.arange(0.0, float(stations[-1]), PIECE_M)
        largest = np.maximum.reduceat(curvature, np.searchsorted(stations, begins))
        yield from ((begin, bend) for begin, bend in zip(begins.tolist(), largest.tolist(), strict=True) if bend > 0.0)


def _from(line: Points, station_m: float) -> Points:
    """The part of a line beyond an arc length; the last 10 cm at least."""
    stations = arc_length(line)
    begin = min(station_m, float(stations[-1]) - SAME_PLACE_M)
    return interpolate(line, stations, np.array([begin, *stations[stations > begin]]))


# ---------- braking
# How a driven vehicle brakes: with its driver's own deceleration, harder only where that comes too late.

STOPPED_WITHIN_M = 0.5


def next_speed_mps(
    speed_mps: float,
    usual_mps2: float,
    step_s: float,
    room_m: float | Values,
    left_m: float | Values,
    final_mps: float | Values = 0.0,
) -> float | None:
    """The speed after the next step of one that shall be slow within some room, and has to within all that is left.

    None while it may drive as it likes. ``usual_mps2``: the driver's own deceleration. ``final_mps``: how slow; it
    stands by default. There may be several places (n,) with the room up to each and the speed there.
    """
    room_m = np.maximum(room_m - speed_mps * step_s, 0.0)
    allowed = math.sqrt(float(np.min(final_mps**2 + 2 * usual_mps2 * room_m)))
    if speed_mps + usual_mps2 * step_s <= allowed:
        return None
    too_fast = allowed < speed_mps - usual_mps2 * step_s
    needed = (
        float(np.max((speed_mps**2 - final_mps**2) / (2 * np.maximum(left_m, STOPPED_WITHIN_M)))) if too_fast else 0.0
    )
    slowest = max(speed_mps - min(max(needed, usual_mps2), HARDEST_BRAKING_MPS2) * step_s, 0.0)
    return max(min(allowed, speed_mps), slowest)


# ---------- early_braking
# Vehicles that were sent round a bend for which their driver's own deceleration comes too late.

CURVE_REACHED_M = 0.1


class EarlyBraking:
    """Tells those of one simulation, step by step, how fast they may be for the lanes ahead.

    SUMO plans with the driver's own deceleration: whoever is handed over nearer to a bend than that takes comes to it
    too fast, and gets slow in it within a step or two.
    """

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._lane = sumo, sumo.vehicle, sumo.lane
        self._done: set[str] = set()

    def highest_speed(self, one: Actor, lane_id: str) -> float | None:
        """The speed in m/s to brake to in the next step; None for a driver whom the own deceleration suffices."""
        if one.key in self._done or not one.is_sent or not lane_id:
            return None
        speed, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        needed = self._needed(one.key, lane_id, speed)
        if needed <= one.behaviour.values["decel"]:
            self._done.add(one.key)
            return None
        return max(speed - min(needed, HARDEST_BRAKING_MPS2) * step_s, 0.0)

    def _needed(self, key: str, lane_id: str, speed_mps: float) -> float:
        """The deceleration in m/s² that brings a vehicle to the limit of every lane ahead where that begins."""
        ahead_m = float(self._lane.getLength(lane_id) - self._vehicle.getLanePosition(key))
        needed = 0.0
        for link in self._vehicle.getNextLinks(key):
            for lane in (link[4], link[0]):
                if lane:
                    over = speed_mps**2 - float(self._lane.getMaxSpeed(lane)) ** 2
                    needed = max(needed, over / (2 * max(ahead_m, CURVE_REACHED_M)))
                    ahead_m += float(self._lane.getLength(lane))
        return needed


# ---------- long_bends
# Vehicles on a long lane, whose limit is that of its straights, slow down where it bends.

BESIDE_M = 1.0
"""A place so little behind the bumper still counts: places are so far apart."""


class LongBends:
    """Tells the driven vehicles of one simulation, step by step, how fast they may be for the bends of long lanes.

    SUMO has one limit for all of a lane. That of its sharpest bend would slow the vehicles all along it.
    """

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._lane = sumo, sumo.vehicle, sumo.lane

    def highest_speed(self, one: Actor, lane_id: str) -> float | None:
        """The speed in m/s to brake to in the next step; None while a vehicle may drive as it likes.

        It brakes with the driver's own deceleration, and harder only where that comes too late.
        """
        if not one.slow_places or not lane_id:
            return None
        speed, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        usual = one.behaviour.values["decel"]
        ahead = list(self._places_ahead(one, lane_id, speed * step_s + speed**2 / (2 * usual)))
        if not ahead:
            return None
        away_m, allowed_mps = (np.concatenate(column) for column in zip(*ahead, strict=True))
        return next_speed_mps(speed, usual, step_s, away_m, away_m, allowed_mps)

    def _places_ahead(self, one: Actor, lane_id: str, reach_m: float) -> Iterator[tuple[Values, Values]]:
        """Distances in m to the bends within reach on the route, and the speeds for them, lane by lane.

        A driver who is faster than others is so in bends too, as far as tyres hold.
        """
        factor = one.behaviour.values["speedFactor"]
        begin_m = -float(self._vehicle.getLanePosition(one.key))
        for lane in self._lanes_ahead(one, lane_id):
            if begin_m > reach_m:
                return
            if lane in one.slow_places:
                places = one.slow_places[lane]
                away_m = places.stations_m + begin_m
                near = away_m >= -BESIDE_M
                if near.any():
                    yield away_m[near], np.minimum(places.speeds_mps * factor, places.hardest_mps)[near]
            begin_m += float(self._lane.getLength(lane))

    def _lanes_ahead(self, one: Actor, lane_id: str) -> Iterator[str]:
        """The lane of a vehicle and those that follow it as SUMO sees them, ways through junctions included."""
        yield lane_id
        for link in self._vehicle.getNextLinks(one.key):
            yield from (lane for lane in (link[4], link[0]) if lane)


# ---------- waiting
# Vehicles that find no gap into the lane of their target wait beside it for one, instead of driving past it.

LANE_END_M = 0.5
"""So far before its end a lane counts as over; on a shorter one, half of it."""
TO_STEER_OVER_M = 15.0
"""A slow vehicle needs so much road to get into the lane beside; it waits so far before the end of its own.

One that needs several changes of lane waits so far for each of them.
"""
STEERING_OVER_MPS = 5.0
"""A vehicle with a gap beside it rolls on so fast on that road: SUMO begins no change of lane while it brakes hard."""
STEERING_OVER_M = 0.3
"""A vehicle so far beside the middle of its lane is not yet wholly in it."""
PASSING_MPS = "100"
"""The speed of a stop that is passed and not stopped at: above all that vehicles drive."""
SLOWER_MPS = 1.0
"""A speed limit lower by so little changes nobody's drive much."""


class Waiting:
    """Tells the driven vehicles of one simulation, step by step, how fast they may be so that they can still wait."""

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._lane = sumo, sumo.vehicle, sumo.lane
        self._told: set[str] = set()
        self._there: set[str] = set()
        self._first_lane: dict[str, str] = {}

    def highest_speed(self, one: Actor, lane_id: str) -> float | None:
        """The speed in m/s to brake to in the next step; None while a vehicle may drive as it likes.

        It looks for a gap until it has to brake with the driver's own deceleration, and stands where there is still
        road to steer over. One that comes too fast for that brakes as hard as it has to.
        """
        if one.target is None or not one.lanes_to_target or one.key in self._there:
            return None
        edge, _, index = lane_id.rpartition("_")
        if edge == one.target[0] and lane_id in one.lanes_to_target:
            self._there.add(one.key)
            return None
        self._tell(one, one.target, lane_id)
        if lane_id in one.lanes_to_target or not (edge in one.edges_to_target or edge.startswith(":")):
            return None
        left_m = self._left_m(one.key, *one.target)
        if left_m < -LANE_END_M:
            return None
        lane, wanted = int(index), _nearest_lane(one, edge, int(index))
        goes_on = wanted != lane and self._steers_over(one.key, lane_id, 1 if wanted > lane else -1)
        highest_mps = self._braked(one, left_m, abs(wanted - lane), goes_on=goes_on)
        if highest_mps is not None and wanted != lane:
            self._vehicle.changeLane(one.key, wanted, LANE_CHANGE_S)
        return highest_mps

    def _left_m(self, key: str, edge: str, index: int) -> float:
        """The way in m to the end of the target; far below 0 for a vehicle that is past it."""
        end_m = float(self._lane.getLength(f"{edge}_{index}"))
        return float(self._vehicle.getDrivingDistance(key, edge, end_m, index)) - min(LANE_END_M, end_m / 2)

    def _steers_over(self, key: str, lane_id: str, direction: int) -> bool:
        """Whether a vehicle has a gap beside it, or is not yet wholly over: it needs the rest of the road then."""
        comes_over = self._first_lane.setdefault(key, lane_id) != lane_id
        beside_m = abs(float(self._vehicle.getLateralLanePosition(key)))
        return (comes_over and beside_m > STEERING_OVER_M) or bool(self._vehicle.couldChangeLane(key, direction))

    def _braked(self, one: Actor, left_m: float, changes: int, *, goes_on: bool) -> float | None:
        """The next speed of a vehicle that has some way left for its changes of lane; if it goes on, one begins now."""
        speed, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        usual, wait_m = one.behaviour.values["decel"], left_m - changes * TO_STEER_OVER_M
        if not goes_on:
            return next_speed_mps(speed, usual, step_s, wait_m, left_m)
        over_m = wait_m + TO_STEER_OVER_M
        if over_m > LANE_END_M:
            return next_speed_mps(speed, usual, step_s, wait_m, over_m, STEERING_OVER_MPS)
        return next_speed_mps(speed, usual, step_s, over_m, left_m)

    def _tell(self, one: Actor, target: tuple[str, int], lane_id: str) -> None:
        """Have SUMO look for gaps into the target's lane from far on, by a stop there that is passed.

        The speed limit of a stop's lane holds on the whole way there, so that a much slower one has its stop only when
        the vehicle is beside it, and one that may take several lanes has none. SUMO takes none for which the vehicle
        could not brake with ease.
        """
        if one.key in self._told:
            return
        edge, index = target
        limits = [self._lane.getMaxSpeed(f"{key}_0") for key in one.edges_to_target if key != edge]
        slower = max(limits, default=0.0) > self._lane.getMaxSpeed(f"{edge}_{index}") + SLOWER_MPS
        is_only = sum(key.rpartition("_")[0] == edge for key in one.lanes_to_target) == 1
        if not is_only or (slower and lane_id.rpartition("_")[0] != edge):
            return
        self._told.add(one.key)
        end_m = max(self._lane.getLength(f"{edge}_{index}") - LANE_END_M, LANE_END_M)
        try:
            self._vehicle.setStop(one.key, edge, end_m, index, 0.0)
        except self._sumo.TraCIException:
            return
        self._vehicle.setStopParameter(one.key, 0, "speed", PASSING_MPS)


def _nearest_lane(one: Actor, edge: str, index: int) -> int:
    """The nearest lane of an edge that leads to the target; the one named where none does."""
    found = [int(key.rpartition("_")[2]) for key in one.lanes_to_target if key.rpartition("_")[0] == edge]
    return min(found, key=lambda other: (abs(other - index), other), default=index)


# ---------- halting
# Driven vehicles that stop for others where their orders say so.


class Halting:
    """Tells the driven vehicles of one simulation, step by step, how fast they may be so that they stop in time."""

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle = sumo, sumo.vehicle
        self._steps: dict[str, int] = {}
        self._rolled_m: dict[str, float] = {}

    def highest_speed(self, one: Actor, lane_id: str) -> float | None:  # noqa: ARG002 - halts are on any lane
        """The speed in m/s to brake to in the next step; None while a vehicle may drive as it likes."""
        if not one.halts or one.drive_from is None:
            return None
        speed_mps, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        step = self._steps[one.key] = self._steps.get(one.key, one.drive_from - 1) + 1
        if step > one.drive_from:
            self._rolled_m[one.key] = self._rolled_m.get(one.key, 0.0) + speed_mps * step_s
        holding = [halt.rolled_m for halt in one.halts if halt.from_step <= step < halt.until_step]
        left_m = min(holding, default=None)
        if left_m is None:
            return None
        left_m -= self._rolled_m.get(one.key, 0.0)
        return next_speed_mps(speed_mps, one.behaviour.values["decel"], step_s, left_m, left_m)
