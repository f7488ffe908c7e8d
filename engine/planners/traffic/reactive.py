"""Traffic that reacts to the ego: SUMO drives the other road users, one step at a time.

Before every step of SUMO the ego is moved to its driven pose, and after the step its speed is set. The other vehicles
thus see the ego as they see one another, one step late. A driven vehicle starts at its first recorded state (or at the
one of the ego's first step). From then on SUMO drives it along its recorded route and beyond. It obeys the traffic
lights of the file. A process can run one such simulation at a time.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from ....schemas.errors import NotPossible
from ....schemas.runs import TriggerOutcome
from ...commonroad import LoadedScenario, Track
from ...cosimulation import Actor, SimulationSetup, next_speed_mps, open_simulation, replayed_actor
from ...geometry import Points, oriented_rectangle, rectangles_overlap, wrap_angle
from ...network import signals_of, sumo_net
from ...traffic import NO_LANE, LaneHint, Sumo, sumo_pose
from ...vehicles import VehicleParameters
from ..goal import select_goal_state
from ..interface import EgoState
from .recorded import GrowingTrack, Traffic, rectangle
from .roles import EGO, TrafficRoles
from .scripted import actors_of

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

_SUBLANES = ("--lateral-resolution", 0.4)
"""With sublanes, both lanes see a vehicle that crosses their line; without them, only the lane of its front centre
does.
"""
_MOST_OBLIQUE_RAD = 0.8
"""An ego that is turned farther across its lane is shown in its own heading, since no box along the lane
fits (chosen).
"""
_EGO_MARGIN_M = 0.3
"""Space that the others leave at the sides of the ego. SUMO models neither a vehicle's turn during lateral motion nor
an overlap with the next lane of less than a sublane.
"""
_NEXT_LANE_M = 1.8
"""A vehicle farther to the side of the ego's body is in the next lane, whatever its heading (chosen). On concentric
lanes 3 m apart, a distant one that heads for the ego's rear is then at least 2 m to the side of its body.
"""
_BEHIND_EGO_M, _LEAST_BEHIND_EGO_M = 1.0, 0.4
"""Gap that followers keep behind a standing ego, and the least gap that hard-braking ones keep (chosen)."""
_CLEARANCE_M = 1.0
"""Space around a vehicle that appears during a run, at each end and in total across (chosen)."""
_COMFORTABLE_DECELERATION_MPS2 = 4.5
"""Deceleration of an appearing vehicle for those ahead: SUMO's default for cars."""


@contextmanager
def reactive_traffic(
    loaded: LoadedScenario, problem: "PlanningProblem", vehicle: VehicleParameters, seed: int
) -> Iterator[Traffic]:
    """Yield the other road users of a scenario, driven by SUMO from the ego's first step.

    Raises:
        NotPossible: No lanelet of the scenario is drivable.
        WorkerFailure: SUMO refused the network or a vehicle, or stopped.
    """
    ego = EgoState.of(problem.initial_state)
    with TemporaryDirectory() as name:
        folder = Path(name)
        roles = TrafficRoles.of(loaded, ego.step)
        if not roles.scene.layout.edges:
            raise NotPossible("no lanelet is drivable, so no vehicle can react", next_step="run with traffic recorded")
        if not roles.driven:  # road users react only by scripts, so there is nothing to simulate
            yield _ScriptedTraffic(roles, ego, vehicle)
            return
        net = folder / "scenario.net.xml"
        signals = signals_of(roles.scene.network, loaded.step_s, ego.step)
        net.write_text(sumo_net(roles.scene.layout, roles.scene.lane_speeds_mps, signals), encoding="utf-8")
        setup = SimulationSetup(net, folder, loaded.step_s, 0, seed)
        types = roles.vehicle_types(vehicle)
        with open_simulation(setup, types, _SUBLANES) as sumo:
            roles = roles.keeping_to_route(_misplaced_vehicles(sumo, roles))
        with open_simulation(setup, types, _SUBLANES) as sumo:
            goal = select_goal_state(roles.scene.network, problem.goal, ego, vehicle, loaded.step_s)
            yield _ReactiveTraffic(sumo, roles, roles.ego_edges(goal, ego), ego, vehicle)


def _misplaced_vehicles(sumo: Sumo, roles: TrafficRoles) -> frozenset[str]:
    """Return driven vehicles that SUMO places on another road or on no lane, found in a separate trial step."""
    for actor in roles.driven:
        _insert(sumo, actor)
    sumo.step()
    there = frozenset(sumo.vehicles())
    return frozenset(a.key for a in roles.driven if a.key in there and sumo.is_astray(a.key, a.edges))


def _insert(sumo: Sumo, actor: Actor) -> bool:
    """Insert a vehicle into SUMO at the state from which SUMO drives it; return True if SUMO can place it."""

    def placing() -> None:
        index = actor.handover_index
        sumo.add_route(actor.route, actor.edges)
        sumo.insert(actor.key, actor.route, actor.type_id)
        sumo.move_to(actor.key, actor.pose_at(index), actor.hints[index], keep_to_route=actor.keep_to_route)

    return sumo.takes(placing, actor.key)


class _ReactiveTraffic:
    """The other road users of a run.

    Those in ``on_recording`` followed their recordings, since SUMO could not take them over.
    """

    def __init__(
        self, sumo: Sumo, roles: TrafficRoles, ego_edges: tuple[str, ...], ego: EgoState, vehicle: VehicleParameters
    ) -> None:
        self._sumo, self._roles, self._ego_vehicle = sumo, roles, vehicle
        self._tracks: dict[int, GrowingTrack] = {}
        self._waiting = list(roles.driven)
        self._under_way: list[Actor] = []
        self._shown: dict[str, ShownVehicle] = {}
        self._lost: list[Actor] = []
        self._ego = ShownVehicle(sumo, EGO, ego_edges)
        self.moving: tuple[Track, ...] = ()
        self.standing = roles.replayed.standing
        self._scripted = actors_of(roles.scripts, roles.scene, vehicle)
        self._hints: dict[int, tuple[Track, tuple[LaneHint, ...]]] = {}
        self._braking: set[str] = set()
        self._first_step = ego.step
        self.advance(ego)

    @property
    def driven(self) -> tuple[Track, ...]:
        """The tracks up to the present step of those that the ego may influence, by ascending id."""
        scripted = {key: track for key, actor in self._scripted.items() if (track := actor.driven) is not None}
        tracks = {key: grown.track() for key, grown in self._tracks.items()} | scripted
        return tuple(tracks[key] for key in sorted(tracks))

    @property
    def on_recording(self) -> tuple[int, ...]:
        """Ids of the dynamic obstacles that followed their recordings."""
        replayed = [track.obstacle_id for track in self._roles.replayed.moving]
        return tuple(sorted([*replayed, *(actor.track.obstacle_id for actor in self._lost)]))

    @property
    def triggers(self) -> tuple[TriggerOutcome, ...]:
        """The triggers of scripted motions by road user, and whether they have fired up to the present step."""
        return tuple(outcome for actor in self._scripted.values() for outcome in actor.triggers(self._first_step))

    def advance(self, ego: EgoState) -> None:
        """Advance SUMO by one step to the step of the ego's new state, with the ego there at its end."""
        starting = [actor for actor in self._waiting if self._may_start(actor, ego)]
        for actor in starting:
            self._waiting.remove(actor)
            _insert(self._sumo, actor)
        for scripted in self._scripted.values():
            scripted.advance(ego)
        self._place_shown(ego.step)
        self._place_ego(ego)
        self._sumo.step()
        there = frozenset(self._sumo.vehicles())
        self._ego.settle(ego.speed_mps, there)
        self._settle_shown(ego.step, there)
        self._read(there)
        self._take_over(starting, ego.step, there)
        driven = self.driven
        self._brake_for_ego(ego, {track.obstacle_id: track for track in driven})
        tracks = [*self._roles.replayed.moving, *driven]
        self.moving = tuple(sorted(tracks, key=lambda track: track.obstacle_id))

    def hits(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[tuple[int, str], ...]:
        """Return id and type of all obstacles that overlap the ego's rectangle at the ego's step, by ascending id."""
        return _all_hits(self._roles.replayed.hits(ego, vehicle), self.driven, ego, vehicle)

    def _may_start(self, actor: Actor, ego: EgoState) -> bool:
        """Return True if it is time and the position is free; a vehicle waits if it would have to hit another one.

        SUMO's departures wait in the same way.
        """
        if actor.drive_from is None or actor.drive_from > ego.step:
            return False
        if ego.step == self._first_step:
            return True
        return is_insertion_safe(actor.track, actor.handover_index, self, ego, self._ego_vehicle)

    def _place_ego(self, ego: EgoState) -> None:
        """Show SUMO the box around the ego along its lane, since SUMO never sees a vehicle as oblique."""
        hint, direction = self._roles.ego_lane(ego.position, ego.heading_rad, ego.speed_mps)
        turned = abs(wrap_angle(ego.heading_rad - direction))
        if turned > _MOST_OBLIQUE_RAD:
            direction, turned = ego.heading_rad, 0.0
        width_m = self._ego_vehicle.width_m * math.cos(turned) + self._ego_vehicle.length_m * math.sin(turned)
        pose = sumo_pose(float(ego.position[0]), float(ego.position[1]), direction, self._ego_vehicle.length_m)
        self._ego.place(pose, hint, width_m + 2 * _EGO_MARGIN_M)

    def _place_shown(self, step: int) -> None:
        for actor in (*self._roles.shown, *self._lost):
            place = self._shown_place(actor, step)
            if place is not None:
                if actor.key not in self._shown:
                    self._shown[actor.key] = ShownVehicle(self._sumo, actor.key, actor.edges)
                self._shown[actor.key].place(*place)
            elif actor.key in self._shown:
                self._shown.pop(actor.key).leave()

    def _settle_shown(self, step: int, there: frozenset[str]) -> None:
        for actor in (*self._roles.shown, *self._lost):
            speed_mps = self._shown_speed_mps(actor, step)
            if speed_mps is not None:
                self._shown[actor.key].settle(speed_mps, there)

    def _shown_place(self, actor: Actor, step: int) -> tuple[tuple[float, float, float], LaneHint] | None:
        """Return the pose and the lane at which SUMO must show a road user, or None if it is absent."""
        scripted = self._scripted.get(actor.track.obstacle_id)
        if scripted is None:
            index = self._shown_index(actor, step)
            return None if index is None else (actor.pose_at(index), actor.hints[index])
        state = scripted.state_at(step)
        if state is None:
            return None
        (x, y), heading, _ = state
        hints = self._hints_of(scripted.motion)
        return sumo_pose(float(x), float(y), heading, actor.track.length_m), hints[scripted.index]

    def _shown_speed_mps(self, actor: Actor, step: int) -> float | None:
        scripted = self._scripted.get(actor.track.obstacle_id)
        if scripted is None:
            index = self._shown_index(actor, step)
            return None if index is None else float(actor.track.speeds_mps[index])
        state = scripted.state_at(step)
        return None if state is None else state[2]

    def _hints_of(self, motion: Track) -> tuple[LaneHint, ...]:
        """Return the lanes of a scripted motion at all its states, updated if the motion has changed."""
        key = motion.obstacle_id
        if key not in self._hints or self._hints[key][0] is not motion:
            match = self._roles.scene.matcher.match(motion)
            hints = (NO_LANE,) * len(motion.positions)
            if match is not None:
                hints = replayed_actor(self._roles.scene, motion, match).hints
            self._hints[key] = motion, hints
        return self._hints[key][1]

    def _shown_index(self, actor: Actor, step: int) -> int | None:
        if actor.track.obstacle_id in self._roles.scene.standing:
            return 0
        grown = self._tracks.get(actor.track.obstacle_id)
        late = 0 if grown is None or actor.drive_from is None else grown.first_step - actor.drive_from
        return actor.track.index_at(step - late)

    def _read(self, there: frozenset[str]) -> None:
        """Record the states of the driven vehicles; those that are missing have left the network."""
        self._under_way = [actor for actor in self._under_way if actor.key in there]
        for actor in self._under_way:
            self._tracks[actor.track.obstacle_id].add(*self._sumo.state(actor.key, actor.track.length_m))
        for actor in self._lost:
            grown = self._tracks[actor.track.obstacle_id]
            index = self._shown_index(actor, grown.last_step + 1)
            if index is not None:
                grown.add(*_recorded_state(actor.track, index))

    def _brake_for_ego(self, ego: EgoState, driven: Mapping[int, Track]) -> None:
        """Make vehicles brake that would otherwise hit the ego's rear, as hard as they can if necessary.

        SUMO's drivers see the ego only on the lanes that it occupies. A follower on a merging lane, or behind an ego
        that is at an angle in a junction, would not see it.
        """
        hardest_mps2 = self._ego_vehicle.hardest_braking_mps2
        for actor in self._under_way:
            track = driven[actor.track.obstacle_id]
            room_m = _room_behind_m(track, ego, self._ego_vehicle)
            usual_mps2, speed_mps = self._sumo.decel_mps2(actor.key), float(track.speeds_mps[-1])
            highest_mps = None
            if room_m is not None:
                own_way_m = ego.speed_mps**2 / (2 * hardest_mps2)
                room_m += own_way_m
                highest_mps = next_speed_mps(
                    speed_mps,
                    usual_mps2,
                    self._sumo.step_s(),
                    room_m - _BEHIND_EGO_M,
                    room_m - _LEAST_BEHIND_EGO_M,
                    hardest_mps2=hardest_mps2,
                )
            if highest_mps is not None:
                self._sumo.slow_down(actor.key, highest_mps)
                self._braking.add(actor.key)
            elif actor.key in self._braking:
                self._sumo.release_speed(actor.key)
                self._braking.discard(actor.key)

    def _take_over(self, starting: list[Actor], step: int, there: frozenset[str]) -> None:
        for actor in starting:
            state = _recorded_state(actor.track, actor.handover_index)
            grown = self._tracks[actor.track.obstacle_id] = GrowingTrack(actor.track, step)
            grown.add(*state)
            if actor.key in there and self._sumo.lane(actor.key):
                self._sumo.show_speed(actor.key, state[3])
                self._sumo.release(actor.key)
                self._under_way.append(actor)
            else:
                self._sumo.remove(actor.key)
                self._lost.append(actor)


class _ScriptedTraffic:
    """Other road users that follow recordings, or scripts that depend on the ego: SUMO drives none of them."""

    def __init__(self, roles: TrafficRoles, ego: EgoState, vehicle: VehicleParameters) -> None:
        self._replayed, self._first_step = roles.replayed, ego.step
        self._scripted = actors_of(roles.scripts, roles.scene, vehicle)
        self.moving: tuple[Track, ...] = ()
        self.standing = roles.replayed.standing
        self.on_recording = tuple(sorted(track.obstacle_id for track in roles.replayed.moving))
        self.advance(ego)

    @property
    def driven(self) -> tuple[Track, ...]:
        """The tracks up to the present step of those that the ego may influence, by ascending id."""
        tracks = {key: track for key, actor in self._scripted.items() if (track := actor.driven) is not None}
        return tuple(tracks[key] for key in sorted(tracks))

    @property
    def triggers(self) -> tuple[TriggerOutcome, ...]:
        """Triggers of scripted motions by the road user's id, and whether they have fired up to the present step."""
        return tuple(outcome for actor in self._scripted.values() for outcome in actor.triggers(self._first_step))

    def advance(self, ego: EgoState) -> None:
        """Advance to the step of the ego's new state."""
        for actor in self._scripted.values():
            actor.advance(ego)
        self.moving = tuple(sorted([*self._replayed.moving, *self.driven], key=lambda track: track.obstacle_id))

    def hits(self, ego: EgoState, vehicle: VehicleParameters) -> tuple[tuple[int, str], ...]:
        """Return id and type of all obstacles that overlap the ego's rectangle at the ego's step, by ascending id."""
        return _all_hits(self._replayed.hits(ego, vehicle), self.driven, ego, vehicle)


def _all_hits(
    replayed: tuple[tuple[int, str], ...], driven: tuple[Track, ...], ego: EgoState, vehicle: VehicleParameters
) -> tuple[tuple[int, str], ...]:
    """Return id and type of the known hits and of the driven obstacles that overlap the ego, by ascending id."""
    own, hits = rectangle(ego, vehicle), set(replayed)
    for track in driven:
        index = track.index_at(ego.step)
        if index is not None and own.collide(_body(track, index)):
            hits.add((track.obstacle_id, track.kind))
    return tuple(sorted(hits))


def _room_behind_m(track: Track, ego: EgoState, vehicle: VehicleParameters) -> float | None:
    """Return the gap from a follower's front to the ego's rear, along the follower's heading, at its track's last
    state.

    None for a vehicle that does not drive towards the ego's rear: it would pass the ego, is farther to the side than
    the next lane, or has a very different heading.
    """
    apart, heading = ego.position - track.positions[-1], float(track.headings_rad[-1])
    ahead_m, left_m = _turned(apart, -heading)
    behind_m, aside_m = _turned(-apart, -ego.heading_rad)
    half_widths_m = (track.width_m + vehicle.width_m) / 2
    if ahead_m <= 0.0 or behind_m >= 0.0 or abs(wrap_angle(ego.heading_rad - heading)) > _MOST_OBLIQUE_RAD:
        return None
    if abs(left_m) > half_widths_m + _EGO_MARGIN_M or abs(aside_m) > half_widths_m + _NEXT_LANE_M:
        return None
    return max(ahead_m - (track.length_m + vehicle.length_m) / 2, 0.0)


def _turned(vector: Points, angle_rad: float) -> tuple[float, float]:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return float(vector[0] * cos - vector[1] * sin), float(vector[0] * sin + vector[1] * cos)


def is_insertion_safe(track: Track, index: int, traffic: Traffic, ego: EgoState, vehicle: VehicleParameters) -> bool:
    """Return True if a vehicle at this pose is clear of all road users and can brake comfortably for those ahead.

    The other road users are at their positions one step before the ego's, the last ones known.
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
        braking = max(speed**2 - max(along, 0.0) ** 2, 0.0) / (2 * _COMFORTABLE_DECELERATION_MPS2)
        own_size = (track.length_m + 2 * _CLEARANCE_M + braking, track.width_m + _CLEARANCE_M)
        own = oriented_rectangle(center + forward * braking / 2, heading, own_size)
        if rectangles_overlap(own, oriented_rectangle(position, angle, size)):
            return False
    return True


def _recorded_state(track: Track, index: int) -> tuple[float, float, float, float]:
    x, y = track.positions[index]
    return float(x), float(y), float(track.headings_rad[index]), float(track.speeds_mps[index])


def _body(track: Track, index: int) -> Any:
    from commonroad_dc import pycrcc

    x, y, heading, _ = _recorded_state(track, index)
    return pycrcc.RectOBB(track.length_m / 2, track.width_m / 2, math.remainder(heading, math.tau), x, y)


class ShownVehicle:
    """A vehicle that SUMO does not drive but shows to those that it drives: the ego, or a replayed road user.

    It is placed before every step at the position where the step ends. SUMO determines the lanes that a vehicle
    overlaps only when it enters a lane, and not when it is moved along the same lane, so vehicles on the next lane
    would never see it cross the line. A vehicle that has crossed a line, or come back, therefore enters again: a new
    entry is placed at its current position, and the old one, which the others have seen so far, leaves after the step.
    It does not leave earlier, since a vehicle that enters a junction again counts as the last there, and its follower
    would take precedence.

    Args:
        sumo: The simulation.
        key: Names its route ``s<key>``, its type ``t<key>`` and its entries ``<key>:<number>``.
        edges: Its route.
    """

    def __init__(self, sumo: Sumo, key: str, edges: tuple[str, ...]) -> None:
        self._sumo, self._key = sumo, key
        self._entry, self._entry_before, self._entries = "", "", 0
        self._is_seen_elsewhere = False
        self._over: tuple[str, frozenset[str]] = "", frozenset()
        sumo.add_route(f"s{key}", edges)

    def place(self, pose: tuple[float, float, float], hint: LaneHint, width_m: float | None = None) -> None:
        """Place it at a pose of ``sumo_pose`` where the next step ends; ``width_m`` overrides its type's width."""
        if not self._entry or self._is_seen_elsewhere:
            self._enter_anew()
        if width_m is not None:
            self._sumo.set_width(self._entry, width_m)
        self._sumo.move_to(self._entry, pose, hint)

    def settle(self, speed_mps: float, there: frozenset[str]) -> None:
        """Show its speed after the step and remove the old entry; ``there``: the vehicles on the network."""
        self._sumo.remove(self._entry_before)
        self._entry_before = ""
        left_road = bool(self._over[0]) and self._entry in there and not self._sumo.lane(self._entry)
        if left_road:
            self._sumo.remove(self._entry)  # SUMO crashes on data of a vehicle that left the road
        if self._entry in there and not left_road:
            self._sumo.show_speed(self._entry, speed_mps)
            self._sumo.hold(self._entry)
            self._compare_lines()
        else:
            self._entry = ""

    def leave(self) -> None:
        """Remove it from the simulation."""
        self._sumo.remove(self._entry)

    def _compare_lines(self) -> None:
        """Compare the lines that it crosses with those that it crossed when it entered its lane."""
        lane = self._sumo.lane(self._entry)
        aside_m, half_m = self._sumo.offset_m(self._entry), self._sumo.width_m(self._entry) / 2
        edge_m = self._sumo.lane_width_m(lane) / 2 if lane else math.inf
        over = {"left": aside_m + half_m > edge_m, "right": aside_m - half_m < -edge_m}
        lines = frozenset(side for side, is_over in over.items() if is_over)
        if lane != self._over[0]:
            self._over = lane, lines
        self._is_seen_elsewhere = lines != self._over[1]

    def _enter_anew(self) -> None:
        self._entry_before, self._entry = self._entry, f"{self._key}:{self._entries}"
        self._entries += 1
        self._over, self._is_seen_elsewhere = ("", frozenset()), False
        self._sumo.insert(self._entry, f"s{self._key}", f"t{self._key}")
