"""Hybrid re-simulation in SUMO: recorded vehicles replay exactly, and driven vehicles react to them.

Before every step, replayed vehicles are moved to the pose that was recorded for the end of that step. Their speed is
set after the step, so that other vehicles see it. A driven vehicle is treated in the same way until its hand-over.

A replayed vehicle that is too far from every driven one to matter is left out: otherwise, most of the time of a
re-simulation would be spent on finding such vehicles' lanes.
"""

from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..geometry import Points, Values
from ..traffic import LaneChanges, Sumo, sumo_running
from .actors import Actor
from .controllers import SPEED_CONTROLLERS
from .manoeuvres import LANE_CHANGE_S, ManoeuvreExecutor

TYPES_FILE = "types.add.xml"
"""Name of the file with the vehicle types that SUMO reads."""
ROUTES_FILE = "driven.rou.xml"
"""Name of the file with the routes that the vehicles drove, and their vehicle types."""
LANE_CHANGES_LAST = ("--lanechange.duration", LANE_CHANGE_S)
"""SUMO's usual lane change is instantaneous; the alternative to a duration is to divide the lanes into sublanes."""
SEEN_BEFORE_S = 2.0
"""The surroundings of a recorded vehicle are simulated from this long before its hand-over (chosen)."""
LOOKS_AHEAD_S = 1.5
"""SUMO's drivers plan for the distance of one step and a stop; this is many steps (chosen)."""
SOFT_BRAKING_MPS2 = 4.0
"""Deceleration for the stopping distance that a vehicle looks ahead, unless its own is softer (chosen)."""
AROUND_M = 45.0
"""Added to how far two vehicles look ahead (chosen): a junction between them, and their own lengths.

Without imperfection of the drivers (sigma 0), the driven tracks are bit for bit those with every vehicle present down
to 30 m, 1 s and 4.5 m/s² for all of 140 vehicles of 35 generated scenarios; with 10 m, 0.5 s and 6 m/s² for 136.
"""
STEPS_AT_ONCE = 256
"""Number of steps with places in memory at once (chosen): 6 kB for each replayed road user."""
STAYS_FACTOR = 1.2
"""A vehicle that is present stays until it is farther away than when it appeared, by this factor (chosen)."""


@dataclass(frozen=True)
class SimulationSetup:
    """The network, the number of steps and the time step of a simulation; ``folder`` receives the vehicle types.

    ``keeps_routes``: whether SUMO also writes ``ROUTES_FILE`` to the folder.
    """

    net: Path
    folder: Path
    step_s: float
    last_step: int
    seed: int
    keeps_routes: bool = False


@dataclass(frozen=True)
class DrivenTrack:
    """SUMO's track of a driven vehicle: its front bumper (n, 2) in m at every step, starting at ``first_step``.

    The first point is recorded. ``lanes``: SUMO's lane id at every step. ``leaves``: whether it left the
    network. ``blocked_by``: ids of vehicles that left no room for an ordered lane change that was not carried out,
    longest-blocking first.
    """

    first_step: int
    front: Points
    lanes: tuple[str, ...]
    leaves: bool
    blocked_by: tuple[int, ...] = ()


@dataclass(frozen=True)
class ShownState:
    """A vehicle as SUMO reports it: front bumper (x, y) in m, angle in degrees clockwise from north, speed in m/s."""

    front: tuple[float, float]
    angle_deg: float
    speed_mps: float


def open_simulation(
    setup: SimulationSetup, vehicle_types: Iterable[str], lateral_motion: tuple[str, float] = LANE_CHANGES_LAST
) -> AbstractContextManager[Sumo]:
    """Open a simulation that ends with the block.

    Args:
        setup: the network and the steps.
        vehicle_types: ``vType`` elements.
        lateral_motion: SUMO's option for lateral motion.

    Raises:
        WorkerFailure: SUMO refused the network, a vehicle type or an option, or stopped inside the block.
    """
    options: dict[str, object] = {
        "--default.action-step-length": setup.step_s,
        "--max-depart-delay": -1,
        "--collision.check-junctions": "false",
        lateral_motion[0]: lateral_motion[1],
    }
    if setup.keeps_routes:  # final routes, also of vehicles that are still on the network
        options |= {
            "--vehroute-output": setup.folder / ROUTES_FILE,
            "--vehroute-output.write-unfinished": "true",
            "--vehroute-output.last-route": "true",
        }
    return sumo_running(
        setup.net, setup.folder / TYPES_FILE, vehicle_types, step_s=setup.step_s, seed=setup.seed, options=options
    )


def resimulate(setup: SimulationSetup, actors: tuple[Actor, ...]) -> dict[int, DrivenTrack]:
    """Simulate as long as any vehicle is driven; return the driven vehicles' tracks by id.

    If a recorded pose is or points off its lane, SUMO may match it to the adjacent road, and the vehicle would drive
    away there, or to no lane, and the vehicle would be gone: such vehicles are kept to their route in a second run.

    Raises:
        WorkerFailure: SUMO refused the network or a vehicle, or stopped.
    """
    if all(actor.drive_from is None for actor in actors):
        return {}
    tracks, astray = _simulate(setup, actors, until_astray=True)
    if astray:
        kept = tuple(replace(actor, keep_to_route=True) if actor.key in astray else actor for actor in actors)
        tracks, _ = _simulate(setup, kept)
    return tracks


def replayed_states(setup: SimulationSetup, actors: tuple[Actor, ...]) -> dict[tuple[str, int], ShownState]:
    """Return all actors' states in SUMO after every step, by SUMO's id and step; absent actors have no entry.

    Raises:
        WorkerFailure: SUMO refused the network or a vehicle, or stopped.
    """
    shown: dict[tuple[str, int], ShownState] = {}
    with open_simulation(setup, [actor.vehicle_type() for actor in actors]) as sumo:
        run = _Run(sumo, actors, _Surroundings(actors, setup, everywhere=True))
        for step in range(setup.last_step + 1):
            run.advance(step)
            shown |= {(key, step): state for key, state in run.left_road.items()}
            shown |= {(key, step): _shown_state(sumo, key) for key in sumo.vehicles()}
    return shown


def _shown_state(sumo: Sumo, key: str) -> ShownState:
    return ShownState(sumo.front(key), sumo.angle_deg(key), sumo.speed_mps(key))


def _simulate(
    setup: SimulationSetup, actors: tuple[Actor, ...], *, until_astray: bool = False
) -> tuple[dict[int, DrivenTrack], frozenset[str]]:
    """Run one simulation; return the tracks, and the vehicles that were off their route at the hand-over.

    ``until_astray``: stop once all such vehicles are known, because the tracks are then not used.
    """
    with open_simulation(setup, [actor.vehicle_type() for actor in actors]) as sumo:
        run = _Run(sumo, actors, _Surroundings(actors, setup))
        for step in range(setup.last_step + 1):
            run.advance(step)
            if run.all_have_left() or (until_astray and run.astray and run.all_are_driven(step)):
                break
        return run.tracks(setup.last_step), frozenset(run.astray)


@dataclass(frozen=True)
class _Place:
    """The front of a vehicle (2,) in m, and the distance ahead of it in m within which others matter."""

    front: Points
    reach_m: float

    @classmethod
    def of(cls, actor: Actor, front: Points, speed_mps: float) -> "_Place":
        """Return the place of an actor with its front at a position."""
        return cls(front, float(_reach_m(actor, np.array(speed_mps))))


class _Surroundings:
    """The replayed actors that may matter to those that SUMO drives, step by step.

    Two vehicles may matter to each other (as leader, as follower in the adjacent lane, at a junction) if the distance
    between them is at most the sum of their look-ahead distances plus a margin.
    """

    def __init__(self, actors: Iterable[Actor], setup: SimulationSetup, *, everywhere: bool = False) -> None:
        actors = tuple(actors)
        self._driven = tuple(actor for actor in actors if actor.drive_from is not None)
        self._replayed = tuple(actor for actor in actors if actor.drive_from is None)
        self._before = round(SEEN_BEFORE_S / setup.step_s)
        self._last_step, self._first_looked_at = setup.last_step, 0
        self._places, self._reach_m = self._seen_from(0)
        self._everywhere = everywhere
        self._there = np.zeros(len(self._replayed), dtype=bool)

    def _seen_from(self, begin: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions (n, steps, 2) and reaches (n, steps) in m at some steps; NaN if an actor is absent.

        Only some steps are computed at a time, because a parked vehicle is present at every step although its track
        needs no memory for them.
        """
        shape = (len(self._replayed), STEPS_AT_ONCE)
        places, reach_m = np.full((*shape, 2), np.nan), np.zeros(shape)
        end = min(begin + STEPS_AT_ONCE, self._last_step + 1)
        for row, actor in enumerate(self._replayed):
            steps = np.arange(max(actor.track.first_step, begin), min(actor.track.last_step + 1, end))
            states = steps - actor.track.first_step
            places[row, steps - begin] = actor.track.positions[states]
            reach_m[row, steps - begin] = _reach_m(actor, actor.track.speeds_mps[states])
        return places, reach_m

    def at(self, step: int, driven: Iterable[_Place]) -> set[str]:
        """Return the SUMO ids of the replayed actors to show after a step; ``driven``: the driven vehicles before it.

        Called for consecutive steps.
        """
        if step >= self._first_looked_at + STEPS_AT_ONCE:
            self._first_looked_at = step
            self._places, self._reach_m = self._seen_from(step)
        now = step - self._first_looked_at
        was_there = self._there
        self._there = ~np.isnan(self._places[:, now, 0]) if self._everywhere else np.zeros_like(was_there)
        reach_m = self._reach_m[:, now] + AROUND_M
        for place in (*driven, *self._about_to_drive(step)):
            away_m = np.linalg.norm(self._places[:, now] - place.front, axis=1)
            self._there |= away_m <= (reach_m + place.reach_m) * np.where(was_there, STAYS_FACTOR, 1.0)
        return {self._replayed[row].key for row in np.flatnonzero(self._there)}

    def _about_to_drive(self, step: int) -> Iterable[_Place]:
        """Yield the recorded places of vehicles that are handed over now or soon."""
        for actor in self._driven:
            index = actor.track.index_at(step)
            if index is not None and not actor.drives_at(step) and step >= (actor.drive_from or 0) - self._before:
                yield _Place.of(actor, actor.track.front_at(index), float(actor.track.speeds_mps[index]))


def _reach_m(actor: Actor, speeds_mps: Values) -> Values:
    """Return how far ahead of a vehicle others may matter, in m: its stopping distance and the gap that it keeps."""
    driver = actor.behaviour.values
    braking_mps2 = min(driver["decel"], SOFT_BRAKING_MPS2)
    stopping_m = max(driver["tau"], LOOKS_AHEAD_S) * speeds_mps + speeds_mps**2 / (2 * braking_mps2)
    return np.asarray(driver["minGap"] + stopping_m)


class _Run:
    """The state of one simulation: the actors that are present, and the observed states of driven vehicles."""

    def __init__(self, sumo: Sumo, actors: tuple[Actor, ...], surroundings: _Surroundings) -> None:
        self.astray: set[str] = set()
        self.left_road: dict[str, ShownState] = {}
        self._sumo, self._surroundings = sumo, surroundings
        self._actors = {actor.key: actor for actor in actors}
        self._order = {key: place for place, key in enumerate(self._actors)}
        self._manoeuvres = ManoeuvreExecutor(sumo)
        self._controllers = tuple(make(sumo) for make in SPEED_CONTROLLERS)
        self._present: set[str] = set()
        self._known: set[str] = set()
        self._held: set[str] = set()
        self._standing: set[str] = set()
        self._on_road: set[str] = set()
        self._driving: list[_Place] = []
        self._kept_to_lane: set[str] = set()
        self._used_lanes: set[tuple[str, str]] = set()
        self._seen: dict[int, list[tuple[int, float, float, str]]] = {}
        handovers = {actor.key: actor.drive_from for actor in actors if actor.drive_from is not None}
        self._last_handover = max(handovers.values(), default=0)
        self._driven = frozenset(handovers)
        self._under_way = set(handovers)

    def advance(self, step: int) -> None:
        """Simulate one step; actors move to where they were recorded or where SUMO drives them."""
        self._place_replayed(step)
        self._sumo.step()
        self._remove_off_road(step)
        shown = self._in_order(self._present.intersection(self._sumo.vehicles()))
        self._driving.clear()
        self._show_speeds(shown, step)
        for actor in shown:
            if actor.drive_from is not None and step >= actor.drive_from:
                self._drive(actor, step)

    def all_are_driven(self, step: int) -> bool:
        """Return True if the last hand-over is past."""
        return step >= self._last_handover

    def all_have_left(self) -> bool:
        """Return True if every driven vehicle reached the end of its route."""
        self._under_way.difference_update(self._sumo.arrived())
        return not self._under_way

    def tracks(self, last_step: int) -> dict[int, DrivenTrack]:
        """Return the driven tracks up to the present step, by vehicle id."""
        tracks = {}
        for key, rows in sorted(self._seen.items()):
            front = np.array([(x, y) for _, x, y, _ in rows])
            leaves = rows[-1][0] < last_step
            blocking = tuple(map(int, self._manoeuvres.blocking(str(key))))
            tracks[key] = DrivenTrack(rows[0][0], front, tuple(lane for *_, lane in rows), leaves, blocking)
        return tracks

    def _place_replayed(self, step: int) -> None:
        """Insert, place and remove vehicles, so that all replayed vehicles that matter are in place after the step."""
        near = self._surroundings.at(step, self._driving)
        for actor in self._in_order(near | self._present | self._driven):
            index = actor.track.index_at(step)
            if actor.drives_at(step):
                continue
            if index is not None and (actor.drive_from is not None or actor.key in near):
                self._place(actor, index)
            elif actor.key in self._present:
                self._remove(actor.key)

    def _remove(self, key: str) -> None:
        for keys in (self._present, self._held, self._standing, self._on_road):
            keys.discard(key)
        self._sumo.remove(key)

    def _remove_off_road(self, step: int) -> None:
        """Remove placed vehicles that left the road in the step, because SUMO crashes on its remaining data on them.

        No driver sees a vehicle off the road, so one that is removed has the same effect as one that stays there. It is
        placed as a new vehicle before the next step. Its last state is kept in ``left_road`` for that step.
        """
        self.left_road = {}
        there = self._present.intersection(self._sumo.vehicles())
        for actor in self._in_order(there - self._standing):
            if actor.drives_at(step):
                continue
            if self._sumo.lane(actor.key):
                self._on_road.add(actor.key)
            elif actor.key in self._on_road:
                self._show_speeds([actor], step)
                self.left_road[actor.key] = _shown_state(self._sumo, actor.key)
                self._remove(actor.key)

    def _in_order(self, keys: Iterable[str]) -> list[Actor]:
        """Return actors in a fixed order, because SUMO's results depend on the order of placement."""
        return [self._actors[key] for key in sorted(keys, key=self._order.__getitem__)]

    def _place(self, actor: Actor, index: int) -> None:
        if actor.key not in self._present:
            if actor.key not in self._known:
                self._known.add(actor.key)
                self._sumo.add_route(actor.route, actor.edges)
            self._sumo.insert(actor.key, actor.route, actor.type_id)
            self._present.add(actor.key)
        elif self._is_left_standing(actor, index):
            return
        self._sumo.move_to(actor.key, actor.pose_at(index), actor.hints[index], keep_to_route=actor.keep_to_route)

    def _is_left_standing(self, actor: Actor, index: int) -> bool:
        """Return True if a placed vehicle keeps its pose by itself, which saves the lane search of placing it again."""
        if not actor.stands_at(index) or actor.key not in self._held:
            if actor.key in self._standing:
                self._standing.discard(actor.key)
                self._sumo.cancel_stop(actor.key)
            return False
        if actor.key not in self._standing:
            if not self._sumo.stays_as_placed(actor.key):
                return False
            self._standing.add(actor.key)
            self._sumo.stop_at_once(actor.key)
        return True

    def _show_speeds(self, shown: list[Actor], step: int) -> None:
        """Set the speeds of all vehicles that were placed before the step, before any driven vehicle sees them."""
        for actor in shown:
            index = actor.track.index_at(step)
            if index is not None and not actor.drives_at(step):
                self._sumo.show_speed(actor.key, float(actor.track.speeds_mps[index]))
                if actor.key not in self._held:
                    self._held.add(actor.key)
                    self._sumo.hold(actor.key)

    def _drive(self, actor: Actor, step: int) -> None:
        """Hand a vehicle over, or give it its orders; record where it is, unless it is off the lanes."""
        key = actor.key
        if step == actor.drive_from:
            if actor.ignores_lights:
                self._sumo.ignore_lights(key)
            self._sumo.release(key)
            if self._sumo.is_astray(key, actor.edges):
                self.astray.add(key)
        lane = self._sumo.lane(key)
        if not lane:
            return
        highest = [] if key in self.astray else [each.highest_speed_mps(actor, lane) for each in self._controllers]
        highest_mps = min((speed for speed in highest if speed is not None), default=None)
        self._used_lanes.add((key, lane))
        self._keep_to_light(actor, lane)
        self._change_to_required_lane(actor, lane)
        self._manoeuvres.act(key, actor.manoeuvres, step, highest_mps)
        front = self._sumo.front(key)
        self._seen.setdefault(actor.track.obstacle_id, []).append((step, *front, lane))
        self._driving.append(_Place.of(actor, np.array(front), self._sumo.speed_mps(key)))

    def _keep_to_light(self, actor: Actor, lane: str) -> None:
        """Keep a vehicle that runs a light in the lanes that lead to the light, and allow lane changes after it."""
        if not actor.ignores_lights:
            return
        leads_there = lane in {"{}_{}".format(*hint) for hint in actor.through}
        if leads_there and actor.key not in self._kept_to_lane:
            self._kept_to_lane.add(actor.key)
            self._sumo.allow_lane_changes(actor.key, LaneChanges.NONE)
        elif not leads_there and actor.key in self._kept_to_lane:
            self._kept_to_lane.remove(actor.key)
            self._sumo.allow_lane_changes(actor.key, LaneChanges.DRIVERS_OWN)

    def _change_to_required_lane(self, actor: Actor, lane: str) -> None:
        """Send a vehicle to the lane that it must still use on its present edge, or to its target's lane there."""
        through = [hint for hint in actor.through if (actor.key, "{}_{}".format(*hint)) not in self._used_lanes]
        here = [hint for hint in (*through, actor.target) if hint and hint[0] == lane.rpartition("_")[0]]
        if here and lane != "{}_{}".format(*here[0]):
            self._sumo.change_lane(actor.key, here[0][1], LANE_CHANGE_S)
