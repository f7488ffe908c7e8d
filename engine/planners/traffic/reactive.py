"""Who takes part in reactive traffic: whom SUMO drives, whom it only sees, and how the ego looks to it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ....schemas.errors import NotPossible, WorkerFailure
from ...commonroad import LoadedScenario, Track, recorded_tracks
from ...cosimulation import (
    Actor,
    Hint,
    ShownVehicle,
    SimulationSetup,
    SumoVehicles,
    all_actors,
    not_drivable,
    recorded_plan,
    sumo_running,
)
from ...geometry import Points, oriented_rectangle, point_at, project, rectangles_overlap, wrap_angle
from ...network import NetLayout, write_sumo_net
from ...scene import MapMatcher, Scene, find_route
from ...vehicles import VehicleParameters
from ..goal import aimed_at
from ..interface import EgoState
from .recorded import GrowingTrack, RecordedTraffic, Traffic, rectangle

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem

# ---------- reactive_room
# Whether a vehicle may appear in the middle of a run where it was recorded to appear.

CLEARANCE_M = 1.0
COMFORTABLE_DECELERATION_MPS2 = 4.5


def has_room(track: Track, index: int, traffic: Traffic, ego: EgoState, vehicle: VehicleParameters) -> bool:
    """Whether the pose keeps a metre from everybody, and braking comfortably avoids whoever is slower straight ahead.

    The others are looked at in the step before the ego's, the last one known.
    """
    bodies = [(ego.position, ego.heading_rad, (vehicle.length_m, vehicle.width_m), ego.speed_mps)]
    places = [(other, other.index_at(ego.step - 1)) for other in traffic.moving]
    for other, at in [*places, *((other, 0) for other in traffic.standing)]:
        if at is not None:
            size = (other.length_m, other.width_m)
            bodies.append((other.positions[at], float(other.headings_rad[at]), size, float(other.speeds_mps[at])))
    center, heading, speed = track.positions[index], float(track.headings_rad[index]), float(track.speeds_mps[index])
    forward = np.array([math.cos(heading), math.sin(heading)])
    for position, angle, size, their_speed in bodies:
        along = their_speed * math.cos(angle - heading)
        braking = max(speed**2 - max(along, 0.0) ** 2, 0.0) / (2 * COMFORTABLE_DECELERATION_MPS2)
        own_size = (track.length_m + 2 * CLEARANCE_M + braking, track.width_m + CLEARANCE_M)
        own = oriented_rectangle(center + forward * braking / 2, heading, own_size)
        if rectangles_overlap(own, oriented_rectangle(position, angle, size)):
            return False
    return True


# ---------- reactive_cast
# Who takes part in reactive traffic: whom SUMO drives, whom it only sees, and how the ego looks to it.

EGO = "ego"
REAR_M = 15.0
AHEAD_M = 150.0
EGO_DECELERATION_MPS2 = 8.0
MERGING_COST = 0.5
"""Lanelets under the ego whose matching costs differ by less lie on one another: they merge."""


@dataclass(frozen=True)
class Cast:
    """The road users of a reactive run by how they move; none is in two groups.

    ``driven``: SUMO drives them from their first state, or from the ego's first step if that is later.
    ``shown``: replayed as recorded and seen by the driven ones. ``replayed``: all that SUMO does not drive, shown or
    not (an obstacle off the lanes is not).
    """

    scene: Scene
    driven: tuple[Actor, ...]
    shown: tuple[Actor, ...]
    replayed: RecordedTraffic

    @classmethod
    def of(cls, loaded: LoadedScenario, first_step: int) -> "Cast":
        """Match everybody with the lanes and decide who is driven."""
        everybody = RecordedTraffic(loaded.scenario)
        scene = _scene(loaded, everybody)
        trajectories = recorded_tracks(loaded.scenario)
        keys = [
            key for key, track in trajectories.items() if track.last_step > first_step and not not_drivable(scene, key)
        ]
        begin = {key: max(first_step, scene.tracks[key].first_step) for key in keys}
        plans = {key: recorded_plan(scene, key, "edited", begin[key]) for key in keys}
        cast = all_actors(scene, plans)
        return cls(
            scene,
            driven=tuple(one for one in cast if one.drive_from is not None),
            shown=tuple(one for one in cast if one.drive_from is None),
            replayed=RecordedTraffic(loaded.scenario, without=frozenset(keys)),
        )

    def write_net(self, path: Path) -> None:
        """Write SUMO's network, fast enough for the recorded speeds."""
        write_sumo_net(self.scene.layout, self.scene.lane_speeds_mps, path)

    def keeping_to_route(self, keys: frozenset[str]) -> "Cast":
        """The cast with some driven vehicles put onto their route's lanes when they begin."""
        kept = tuple(replace(one, keep_to_route=True) if one.key in keys else one for one in self.driven)
        return replace(self, driven=kept)

    def ego_edges(self, goal: "GoalRegion", ego: EgoState) -> tuple[str, ...]:
        """The edges of the ego's route with those before and after it.

        SUMO finds by its route which lanes a vehicle's rear still stands on; followers overlook it there otherwise.
        """
        network, graph = self.scene.network, self.scene.edge_graph
        try:
            lanelets = find_route(network, goal, ego.position, ego.heading_rad, ahead_m=AHEAD_M).lanelets
        except NotPossible:
            lanelets = ()
        lanelets = tuple(key for key in lanelets if key in self.scene.layout.table.lanes)
        edges = graph.route(self._with_lanelets_before(lanelets, ego)) if lanelets else None
        if edges is None:
            return (next(iter(self.scene.layout.edges)),)
        return graph.extended(edges, lanelets[-1])

    def _with_lanelets_before(self, lanelets: tuple[int, ...], ego: EgoState) -> tuple[int, ...]:
        table, found, length_m = self.scene.layout.table, list(lanelets), 0.0
        under_ego = dict(self.scene.matcher.near(ego.position, ego.heading_rad, ego.speed_mps))
        best = min(under_ego, key=lambda key: (under_ego[key], key), default=found[0])
        if len(found) > 1 and found[1] in table.successors[best]:
            found[0] = best
        while length_m < REAR_M and (before := [k for k in table.predecessors[found[0]] if k not in found]):
            found.insert(0, self._most_likely_before(before, under_ego, ego))
            length_m += table.lanes[found[0]].length_m
        return tuple(found)

    def _most_likely_before(self, lanelets: list[int], under_ego: dict[int, float], ego: EgoState) -> int:
        """The one that the ego fits best; of several that merge and fit as well, the one with the nearest vehicle.

        A follower on a lane that the ego's rear does not stand on sees the ego as crossing traffic, and far too late.
        """
        costs = {key: under_ego.get(key, math.inf) for key in lanelets}
        fitting = [key for key in lanelets if costs[key] <= min(costs.values()) + MERGING_COST]
        return min(fitting, key=lambda key: (self._nearest_driven_m(key, ego), costs[key], key))

    def _nearest_driven_m(self, lanelet: int, ego: EgoState) -> float:
        gaps = [math.inf]
        for one in self.driven:
            index = one.track.index_at(ego.step)
            if index is not None and self.scene.matches[one.track.obstacle_id].at(index) == lanelet:
                gaps.append(float(np.linalg.norm(one.track.positions[index] - ego.position)))
        return min(gaps)

    def ego_lane(self, position: Points, heading_rad: float, speed_mps: float) -> tuple[Hint, float]:
        """SUMO's edge and lane at a pose of the ego, ("", -1) off the lanes, and the lane's direction in rad."""
        near = self.scene.matcher.near(position, heading_rad, speed_mps)
        if not near:
            return ("", -1), heading_rad
        lanelet = min(near, key=lambda found: (found[1], found[0]))[0]
        center = self.scene.layout.table.lanes[lanelet].center
        direction = point_at(center, project(center, position)[0])[1]
        if lanelet in self.scene.layout.lane_of:
            return self.scene.layout.lane_of[lanelet], direction
        way = self.scene.edge_graph.path_for(lanelet, ())
        return ("", -1) if way is None else (self.scene.layout.internal_edge_of_path[way], 0), direction


def _first_index(one: Actor) -> int:
    """Index of the state from which a driven vehicle is driven on."""
    return (one.drive_from or 0) - one.track.first_step


def _ego_type(vehicle: VehicleParameters) -> str:
    """The ego's ``vType`` element; its apparent braking tells followers how much distance to keep."""
    attributes = {
        "id": f"t{EGO}",
        "length": f"{vehicle.length_m:.3f}",
        "width": f"{vehicle.width_m:.3f}",
        "maxSpeed": "70",
        "decel": f"{EGO_DECELERATION_MPS2:g}",
        "emergencyDecel": f"{EGO_DECELERATION_MPS2:g}",
        "apparentDecel": f"{EGO_DECELERATION_MPS2:g}",
    }
    return f"<vType {' '.join(f'{name}={quoteattr(value)}' for name, value in attributes.items())}/>"


def _scene(loaded: LoadedScenario, everybody: RecordedTraffic) -> Scene:
    """The scenario's lanes and all its obstacles, occupancy sets as tracks of their centres."""
    network = loaded.scenario.lanelet_network
    layout = NetLayout.of(network)
    matcher = MapMatcher.of(layout, network)
    tracks = {track.obstacle_id: track for track in everybody.moving}
    standing = {track.obstacle_id: track for track in everybody.standing}
    usable = {key: track for key, track in (tracks | standing).items() if np.isfinite(track.headings_rad).all()}
    matches = {key: matcher.match(track) for key, track in sorted(usable.items())}
    last = max((track.last_step for track in tracks.values()), default=0)
    found = {key: match for key, match in matches.items() if match is not None}
    return Scene(loaded, layout, matcher, tracks, standing, found, last, None)


# ---------- reactive_traffic
# Traffic that reacts to the ego: SUMO drives the others, one step at a time.
#
# The ego is put at the pose it has driven to before every step of SUMO and its speed is set after it, so that the
# others see it as they see one another, one step late. A driven vehicle begins at its first recorded state (or at the
# one of the ego's first step) and is SUMO's from then on, on its recorded route led on; there are no traffic lights
# for it. One such simulation may run in a process at a time.

MOST_OBLIQUE_RAD = 0.8
BESIDE_EGO_M = 0.3
"""How much room beside the ego the others leave: SUMO knows neither how a vehicle turns while it moves to the side, nor
an overlap with the next lane of less than a sublane."""


class _ReactiveTraffic:
    """The others of one run; ``on_recording`` are those that SUMO could not take over and that followed theirs."""

    def __init__(
        self, vehicles: SumoVehicles, cast: Cast, ego_edges: tuple[str, ...], ego: EgoState, vehicle: VehicleParameters
    ) -> None:
        self._vehicles, self._cast, self._ego_vehicle = vehicles, cast, vehicle
        self._tracks: dict[int, GrowingTrack] = {}
        self._waiting = list(cast.driven)
        self._at_work: list[Actor] = []
        self._shown: dict[str, ShownVehicle] = {}
        self._lost: list[Actor] = []
        self._ego = ShownVehicle(vehicles, EGO, ego_edges)
        self._moving: tuple[Track, ...] = ()
        self._first_step = ego.step
        self.advance(ego)

    @property
    def moving(self) -> tuple[Track, ...]:
        """Dynamic obstacles by ascending id; the driven ones up to the step that was advanced to."""
        return self._moving

    @property
    def standing(self) -> tuple[Track, ...]:
        """Static obstacles."""
        return self._cast.replayed.standing

    @property
    def driven(self) -> tuple[Track, ...]:
        """What the driven vehicles have done so far, by ascending id."""
        return tuple(self._tracks[key].track() for key in sorted(self._tracks))

    @property
    def on_recording(self) -> tuple[int, ...]:
        """Ids of the dynamic obstacles that followed their recording."""
        replayed = [track.obstacle_id for track in self._cast.replayed.moving]
        return tuple(sorted([*replayed, *(one.track.obstacle_id for one in self._lost)]))

    def advance(self, ego: EgoState) -> None:
        """One step of SUMO, to the step of the ego's new state, with the ego there when it ends."""
        starting = [one for one in self._waiting if self._may_start(one, ego)]
        for one in starting:
            self._waiting.remove(one)
            self._vehicles.insert(one.key, one.edges)
            self._vehicles.place_recorded(one, _first_index(one))
        self._place_shown(ego.step)
        self._place_ego(ego)
        there = self._vehicles.step()
        self._ego.settle(ego.speed_mps, there)
        self._settle_shown(ego.step, there)
        self._read(there)
        self._take_over(starting, ego.step, there)
        tracks = [*self._cast.replayed.moving, *self.driven]
        self._moving = tuple(sorted(tracks, key=lambda track: track.obstacle_id))

    def hit_by(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[int, str] | None:
        """Id and type of the first obstacle (by id) that the ego's rectangle overlaps at its step, or None."""
        replayed: RecordedTraffic = self._cast.replayed
        found = replayed.hit_by(ego, vehicle)
        own = rectangle(ego, vehicle)
        for track in self.driven:
            index = track.index_at(ego.step)
            if index is not None and own.collide(_body(track, index)):
                found = min(found or (track.obstacle_id, track.kind), (track.obstacle_id, track.kind))
        return found

    def _may_start(self, one: Actor, ego: EgoState) -> bool:
        """Whether it is time, and the place is free: who would have to hit somebody waits, as at SUMO's departures."""
        if one.drive_from is None or one.drive_from > ego.step:
            return False
        if ego.step == self._first_step:
            return True
        return has_room(one.track, _first_index(one), self, ego, self._ego_vehicle)

    def _place_ego(self, ego: EgoState) -> None:
        """Show SUMO the box around the ego along its lane: to it no vehicle is ever oblique."""
        hint, direction = self._cast.ego_lane(ego.position, ego.heading_rad, ego.speed_mps)
        turned = abs(wrap_angle(ego.heading_rad - direction))
        if turned > MOST_OBLIQUE_RAD:
            direction, turned = ego.heading_rad, 0.0
        width_m = self._ego_vehicle.width_m * math.cos(turned) + self._ego_vehicle.length_m * math.sin(turned)
        length_m, width_m = self._ego_vehicle.length_m, width_m + 2 * BESIDE_EGO_M
        self._ego.place(ego.position, direction, length_m, hint, width_m)

    def _place_shown(self, step: int) -> None:
        for one in self._cast.shown:
            index = self._shown_index(one, step)
            if index is not None:
                if one.key not in self._shown:
                    self._shown[one.key] = ShownVehicle(self._vehicles, one.key, one.edges)
                track = one.track
                heading_rad = float(track.headings_rad[index])
                self._shown[one.key].place(track.positions[index], heading_rad, track.length_m, one.hint_at(index))
            elif one.key in self._shown:
                self._shown.pop(one.key).leave()

    def _settle_shown(self, step: int, there: frozenset[str]) -> None:
        for one in self._cast.shown:
            index = self._shown_index(one, step)
            if index is not None:
                self._shown[one.key].settle(float(one.track.speeds_mps[index]), there)

    def _shown_index(self, one: Actor, step: int) -> int | None:
        if one.track.obstacle_id in self._cast.scene.standing:
            return 0
        return one.track.index_at(step)

    def _read(self, there: frozenset[str]) -> None:
        """The states of those at work; who is not there any more has left the network."""
        self._at_work = [one for one in self._at_work if one.key in there]
        for one in self._at_work:
            self._tracks[one.track.obstacle_id].add(*self._vehicles.state(one))
        for one in self._lost:
            grown = self._tracks[one.track.obstacle_id]
            index = one.track.index_at(grown.last_step + 1 - grown.first_step + (one.drive_from or 0))
            if index is not None:
                grown.add(*_recorded_state(one.track, index))

    def _take_over(self, starting: list[Actor], step: int, there: frozenset[str]) -> None:
        for one in starting:
            grown = self._tracks[one.track.obstacle_id] = GrowingTrack(one.track, step)
            grown.add(*_recorded_state(one.track, _first_index(one)))
            if one.key in there:
                self._vehicles.let_drive(one.key, float(one.track.speeds_mps[_first_index(one)]))
                self._at_work.append(one)
            else:
                self._lost.append(one)


def _recorded_state(track: Track, index: int) -> tuple[float, float, float, float]:
    x, y = track.positions[index]
    return float(x), float(y), float(track.headings_rad[index]), float(track.speeds_mps[index])


def _body(track: Track, index: int) -> Any:
    from commonroad_dc import pycrcc

    x, y, heading, _ = _recorded_state(track, index)
    return pycrcc.RectOBB(track.length_m / 2, track.width_m / 2, math.remainder(heading, math.tau), x, y)


# ---------- reactive_session
# Opening reactive traffic: the network, the vehicle types, and a first trial of where SUMO sees everybody.

SUBLANES = ("--lateral-resolution", 0.4)
"""Both lanes see a vehicle across their line; without sublanes only the lane of its front centre does."""


@contextmanager
def reactive_traffic(
    loaded: LoadedScenario, problem: "PlanningProblem", ego: EgoState, vehicle: VehicleParameters, seed: int
) -> Iterator[_ReactiveTraffic]:
    """The others of a scenario, driven by SUMO from the ego's first step on.

    Raises:
        NotPossible: no lanelet of the scenario can be driven on.
        WorkerFailure: SUMO refused the network or a vehicle.
    """
    import libsumo

    with TemporaryDirectory() as name:
        folder = Path(name)
        cast = Cast.of(loaded, ego.step)
        if not cast.scene.layout.edges:
            raise NotPossible("no lanelet is drivable, so nobody can react", next_step="run with traffic recorded")
        cast.write_net(folder / "scenario.net.xml")
        setup = SimulationSetup(folder / "scenario.net.xml", folder, loaded.step_s, 0, seed)
        everybody = cast.driven + cast.shown
        types = [*(one.vehicle_type() for one in everybody), _ego_type(vehicle)]
        try:
            with sumo_running(setup, types, SUBLANES) as sumo:
                cast = cast.keeping_to_route(_astray(SumoVehicles(sumo), cast))
            with sumo_running(setup, types, SUBLANES) as sumo:
                goal = aimed_at(cast.scene.network, problem.goal, ego, vehicle, loaded.step_s)
                yield _ReactiveTraffic(SumoVehicles(sumo), cast, cast.ego_edges(goal, ego), ego, vehicle)
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise WorkerFailure(f"SUMO stopped: {error}") from error


def _astray(vehicles: SumoVehicles, cast: Cast) -> frozenset[str]:
    """Driven vehicles whose first pose SUMO takes for another road than their own; tried in a step of its own."""
    for one in cast.driven:
        vehicles.insert(one.key, one.edges)
        vehicles.place_recorded(one, _first_index(one))
    there = vehicles.step()
    return frozenset(one.key for one in cast.driven if one.key in there and vehicles.is_astray(one))
