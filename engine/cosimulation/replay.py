"""Hybrid re-simulation in SUMO: recorded vehicles replay exactly, driven ones react to them.

Replayed vehicles are put at their recorded pose by ``moveToXY`` before every step, with the pose of the step after;
their speed is set after the step, so that others see it. A driven vehicle is put like that until its hand-over.
One libsumo simulation may run in a process at a time.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...schemas.errors import WorkerFailure
from ..commonroad import Track
from ..geometry import Points
from .actors import Actor
from .controllers import EarlyBraking, Halting, LongBends, Waiting
from .manoeuvres import DRIVEN_LANE_CHANGES, DRIVEN_SPEED_MODE, LANE_CHANGE_S, Manoeuvring
from .session import SimulationSetup, sumo_running

REPLAYED_SPEED_MODE = 32
REPLAYED_LANE_CHANGES = 0
KEEP_ROUTE, KEEP_POSE = 1, 2
"""SUMO's keepRoute flags: 1 moves the vehicle to the nearest lane of its route, 2 leaves it exactly where it is put."""
MATCH_REACH_M = 20.0


@dataclass(frozen=True)
class DrivenTrack:
    """What SUMO made of a driven vehicle: its front bumper (n, 2) in m at every step from ``first_step`` on.

    The first point is the recorded one. ``lanes``: SUMO's lane id at every step. ``leaves``: it left the network.
    ``in_the_way``: who left it no room for a change of lane that it was told and did not do, the longest first.
    """

    first_step: int
    front: Points
    lanes: tuple[str, ...]
    leaves: bool
    in_the_way: tuple[int, ...] = ()


@dataclass(frozen=True)
class ShownState:
    """What SUMO shows of a vehicle: its front bumper (x, y) in m, degrees clockwise from north, and speed."""

    front: tuple[float, float]
    angle_deg: float
    speed_mps: float


def front_of(track: Track, index: int) -> Points:
    """The front bumper (2,) in m of a recorded pose."""
    angle = float(track.headings_rad[index])
    forward = np.array([math.cos(angle), math.sin(angle)])
    front: Points = track.positions[index] + track.length_m / 2 * forward
    return front


def resimulate(setup: SimulationSetup, everybody: tuple[Actor, ...]) -> dict[int, DrivenTrack]:
    """Run as long as anybody is driven; the driven vehicles' tracks by id.

    Where a recorded pose lies or points off its lane, SUMO may take it for the road beside, and the vehicle would
    drive away there: such vehicles are kept to their route in a second run.

    Raises:
        WorkerFailure: SUMO refused the network or a vehicle.
    """
    if all(one.drive_from is None for one in everybody):
        return {}
    tracks, astray = _run(setup, everybody, until_astray=True)
    if astray:
        kept = tuple(replace(one, keep_to_route=True) if one.key in astray else one for one in everybody)
        tracks, _ = _run(setup, kept)
    return tracks


def replayed_states(setup: SimulationSetup, everybody: tuple[Actor, ...]) -> dict[tuple[str, int], ShownState]:
    """What SUMO shows of everybody after every step, by SUMO's id and step; who is not there has no entry.

    Raises:
        WorkerFailure: SUMO refused the network or a vehicle.
    """
    shown = {}
    with sumo_running(setup, [one.vehicle_type() for one in everybody]) as sumo:
        run, vehicle = _Run(sumo, everybody), sumo.vehicle
        for step in range(setup.last_step + 1):
            run.before(step)
            sumo.simulationStep()
            run.after(step)
            for key in vehicle.getIDList():
                x, y = vehicle.getPosition(key)
                shown[key, step] = ShownState((x, y), vehicle.getAngle(key), vehicle.getSpeed(key))
    return shown


def _run(
    setup: SimulationSetup, everybody: tuple[Actor, ...], *, until_astray: bool = False
) -> tuple[dict[int, DrivenTrack], frozenset[str]]:
    """One simulation: the tracks, and the vehicles that were on another route when they were handed over.

    ``until_astray``: it ends once all such vehicles are known, because its tracks are not used then.
    """
    with sumo_running(setup, [one.vehicle_type() for one in everybody]) as sumo:
        run = _Run(sumo, everybody)
        try:
            for step in range(setup.last_step + 1):
                run.before(step)
                sumo.simulationStep()
                run.after(step)
                if run.all_have_left() or (until_astray and run.astray and run.all_are_driven(step)):
                    break
        except (sumo.TraCIException, sumo.FatalTraCIError) as error:
            raise WorkerFailure(f"SUMO stopped: {error}") from error
        return run.tracks(setup.last_step), frozenset(run.astray)


class _Run:
    """The state of one simulation: who is there, and what was seen of the driven ones."""

    def __init__(self, sumo: Any, everybody: tuple[Actor, ...]) -> None:
        self.sumo, self.everybody = sumo, everybody
        self.manoeuvring = Manoeuvring(sumo)
        self.judges = (Waiting(sumo), EarlyBraking(sumo), LongBends(sumo), Halting(sumo))
        self.present: set[str] = set()
        self.astray: set[str] = set()
        self.used: set[tuple[str, str]] = set()
        self.seen: dict[int, list[tuple[int, float, float, str]]] = {}
        self.last_handover = max((one.drive_from for one in everybody if one.drive_from is not None), default=0)
        self.on_their_way = {one.key for one in everybody if one.drive_from is not None}

    def before(self, step: int) -> None:
        """Insert, place and remove, so that all replayed vehicles stand right after the step."""
        for one in self.everybody:
            index = step - one.track.first_step
            if index == 0:
                self._insert(one)
            if one.key not in self.present or _drives(one, step):
                continue
            if one.track.index_at(step) is not None:
                self._place(one, index)
            elif one.drive_from is None:
                self._remove(one)

    def after(self, step: int) -> None:
        """Set the speeds of all replayed ones; then hand over, and tell and record the driven ones, who see them."""
        there = self.present.intersection(self.sumo.vehicle.getIDList())
        shown = [one for one in self.everybody if one.key in there]
        for one in shown:
            index = one.track.index_at(step)
            if index is not None and not _drives(one, step):
                self.sumo.vehicle.setPreviousSpeed(one.key, max(float(one.track.speeds_mps[index]), 0.0))
                if step == one.track.first_step:
                    self._hold(one)
        for one in shown:
            if one.drive_from is not None and step >= one.drive_from:
                self._drive(one, step)

    def all_are_driven(self, step: int) -> bool:
        """Whether the last hand-over is past."""
        return step >= self.last_handover

    def all_have_left(self) -> bool:
        """Whether every driven vehicle reached the end of its route, so that nothing more is seen of any."""
        self.on_their_way.difference_update(self.sumo.simulation.getArrivedIDList())
        return not self.on_their_way

    def tracks(self, last_step: int) -> dict[int, DrivenTrack]:
        """The driven tracks so far."""
        found = {}
        for key, rows in sorted(self.seen.items()):
            front = np.array([(x, y) for _, x, y, _ in rows])
            leaves = rows[-1][0] < last_step
            blocking = tuple(map(int, self.manoeuvring.in_the_way(str(key))))
            found[key] = DrivenTrack(rows[0][0], front, tuple(lane for *_, lane in rows), leaves, blocking)
        return found

    def _insert(self, one: Actor) -> None:
        self.sumo.route.add(f"r{one.key}", one.edges)
        self.sumo.vehicle.add(one.key, f"r{one.key}", f"t{one.key}", depart="now", departLane="0", departPos="0")
        self.present.add(one.key)

    def _place(self, one: Actor, index: int) -> None:
        edge, lane = one.hint_at(index)
        x, y, angle = one.poses[index]
        keep = KEEP_ROUTE if one.keep_to_route else KEEP_POSE
        self.sumo.vehicle.moveToXY(one.key, edge, lane, x, y, angle, keep, MATCH_REACH_M)

    def _remove(self, one: Actor) -> None:
        self.present.discard(one.key)
        if one.key in self.sumo.vehicle.getIDList():
            self.sumo.vehicle.remove(one.key)

    def _hold(self, one: Actor) -> None:
        self.sumo.vehicle.setSpeedMode(one.key, REPLAYED_SPEED_MODE)
        self.sumo.vehicle.setLaneChangeMode(one.key, REPLAYED_LANE_CHANGES)

    def _drive(self, one: Actor, step: int) -> None:
        vehicle = self.sumo.vehicle
        if step == one.drive_from:
            vehicle.setSpeed(one.key, -1)
            vehicle.setSpeedMode(one.key, DRIVEN_SPEED_MODE)
            vehicle.setLaneChangeMode(one.key, DRIVEN_LANE_CHANGES)
            if vehicle.getRoute(one.key)[-1] != one.edges[-1]:
                self.astray.add(one.key)
        lane_id = vehicle.getLaneID(one.key)
        highest = [] if one.key in self.astray else [judge.highest_speed(one, lane_id) for judge in self.judges]
        highest_mps = min((speed for speed in highest if speed is not None), default=None)
        self.used.add((one.key, lane_id))
        through = [hint for hint in one.through if (one.key, f"{hint[0]}_{hint[1]}") not in self.used]
        here = [hint for hint in (*through, one.target) if hint and hint[0] == lane_id.rpartition("_")[0]]
        if here and lane_id != f"{here[0][0]}_{here[0][1]}":
            vehicle.changeLane(one.key, here[0][1], LANE_CHANGE_S)
        self.manoeuvring.act(one.key, one.manoeuvres, step, highest_mps)
        x, y = vehicle.getPosition(one.key)
        self.seen.setdefault(one.track.obstacle_id, []).append((step, x, y, lane_id))


def _drives(one: Actor, step: int) -> bool:
    return one.drive_from is not None and step > one.drive_from
