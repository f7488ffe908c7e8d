"""Traffic that reacts to the ego: SUMO drives the others, one step at a time.

The ego is put at the pose it has driven to before every step of SUMO and its speed is set after it, so that the others
see it as they see one another, one step late. A driven vehicle begins at its first recorded state (or at the one of
the ego's first step) and is SUMO's from then on, on its recorded route led on; there are no traffic lights for it.
One such simulation may run in a process at a time.
"""

import math
from typing import Any

from plannerforge.engine.edits.participants import Participant
from plannerforge.engine.geometry.polyline import wrap_angle
from plannerforge.engine.planners.growing_track import GrowingTrack
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reactive_cast import EGO, Cast, first_index
from plannerforge.engine.planners.reactive_room import has_room
from plannerforge.engine.planners.shown_vehicle import ShownVehicle
from plannerforge.engine.planners.sumo_vehicles import SumoVehicles
from plannerforge.engine.planners.traffic import RecordedTraffic, rectangle
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.engine.scenarios.tracks import Track

MOST_OBLIQUE_RAD = 0.8
BESIDE_EGO_M = 0.3
"""How much room beside the ego the others leave: SUMO knows neither how a vehicle turns while it moves to the side, nor
an overlap with the next lane of less than a sublane."""


class ReactiveTraffic:
    """The others of one run; ``on_recording`` are those that SUMO could not take over and that followed theirs."""

    def __init__(
        self, vehicles: SumoVehicles, cast: Cast, ego_edges: tuple[str, ...], ego: EgoState, vehicle: VehicleParameters
    ) -> None:
        self._vehicles, self._cast, self._ego_vehicle = vehicles, cast, vehicle
        self._tracks: dict[int, GrowingTrack] = {}
        self._waiting = list(cast.driven)
        self._at_work: list[Participant] = []
        self._shown: dict[str, ShownVehicle] = {}
        self._lost: list[Participant] = []
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
            self._vehicles.place_recorded(one, first_index(one))
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

    def _may_start(self, one: Participant, ego: EgoState) -> bool:
        """Whether it is time, and the place is free: who would have to hit somebody waits, as at SUMO's departures."""
        if one.drive_from is None or one.drive_from > ego.step:
            return False
        if ego.step == self._first_step:
            return True
        return has_room(one.track, first_index(one), self, ego, self._ego_vehicle)

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

    def _shown_index(self, one: Participant, step: int) -> int | None:
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

    def _take_over(self, starting: list[Participant], step: int, there: frozenset[str]) -> None:
        for one in starting:
            grown = self._tracks[one.track.obstacle_id] = GrowingTrack(one.track, step)
            grown.add(*_recorded_state(one.track, first_index(one)))
            if one.key in there:
                self._vehicles.let_drive(one.key, float(one.track.speeds_mps[first_index(one)]))
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
