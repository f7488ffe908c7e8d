"""Checks whether a vehicle can enter at a position and a time, and how fast.

While edits are resolved, only the first step of vehicles that edits drive is known: ``OccupiedPlaces`` and
``entry_speed`` use the recording. After the simulation, ``check_entries`` checks every simulated motion again for
entries after the first step, added vehicles that are hit on entry, and time-shifted recordings that start on top of a
road user. Lengths are in m, speeds in m/s.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ...schemas.errors import NotPossible, Remedy, with_values
from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import DrivePlan, Replay, highest_entry_speed
from ..geometry import Points, arc_length, oriented_rectangle, project, rectangles_overlap
from ..scene import Scene
from ..vehicles import HARD_BRAKING_REACTION_S, TIME_GAP_MPS, VehicleClass, hardest_braking_mps2, vehicle_classes
from .changes import Changes, car_at_start, moved_in_time, scene_for_references
from .edited_scene import EGO, EditedScene, SimulatedEdits, new_overlaps, overlap_steps
from .placement import Place

PLACE_TAKEN, HIT_ON_ENTRY = "place_taken", "hit_on_entry"
"""Reasons of refusals: another road user is at the place, or would hit the vehicle that enters there."""
CLEARANCE_M = 0.3
"""Clearance kept before, behind and (half of it) to the sides of an entering vehicle (chosen)."""
_SEARCH_STEP_M = 1.0
"""Step of the search for free places along a lane (chosen)."""
_FREE_PLACES_NAMED = 3
"""Number of free places that a refusal lists (chosen)."""
_MAY_TOUCH_M = 40.0
"""Vehicles with centres farther apart along an axis do not touch: no road user is that long."""
_SHARE_OF_LANE_SPEED = 0.8
"""A vehicle without surrounding traffic enters a little slower than its lane allows (chosen)."""
_AS_FAST_AS_IT_CAN = "its class and the curves ahead allow no more"
_EGO_ID = 0
"""The ego's id among the neighbours; ids of obstacles are positive."""
_LOOK_M = 60.0
"""Vehicles of the lane that are farther away do not set the entry speed (chosen)."""
_SOON_S = 2.0
"""A collision within this time after the entry is caused by place and speed; a later one by driving (chosen)."""
_SLOWER_SHARES = (0.5, 0.0)
"""Shares of its usual speed at which a vehicle enters if it would collide otherwise (chosen)."""


@dataclass(frozen=True)
class OccupiedPlaces:
    """The road users of a scene with a known state at a step, and the ego if it starts at that step.

    Each road user has a name for messages, a track, and the index of its state at the step.
    """

    scene: Scene
    _occupants: tuple[tuple[str, Track, int], ...]

    @classmethod
    def at(cls, scene: Scene, step: int, changes: Changes | None = None) -> "OccupiedPlaces":
        """Return the places at a step; give the resolved ``changes`` before a simulation, but not after it.

        Except for their first step, only the simulation shows where vehicles driven by ``changes`` are.
        """
        there, removed, driven = scene, frozenset[int](), set[int]()
        if changes is not None:
            there, removed = scene_for_references(scene, changes), changes.removed
            driven = {key for key, plan in changes.driven.items() if plan.from_step < step}
        tracks = {key: track for key, track in (there.tracks | there.standing).items() if key not in driven}
        named = [(f"vehicle {key}", track) for key, track in tracks.items()]
        regions = [region for region in scene.regions if region.obstacle_id not in removed]
        named += [(f"obstacle {region.obstacle_id}", region.track) for region in regions]
        named += [] if scene.ego is None else [("the ego", car_at_start(scene.ego, EGO))]
        occupants = ((name, track, index) for name, track in named if (index := track.index_at(step)) is not None)
        return cls(scene, tuple(occupants))

    def occupant(self, place: Place, size_m: tuple[float, float]) -> str | None:
        """Return the name of the road user that occupies a vehicle's place (length, width), or None if it is free."""
        return self.occupant_at(*place.pose(self.scene), size_m)

    def occupant_at(self, center: Points, heading_rad: float, size_m: tuple[float, float]) -> str | None:
        """Return the name of the road user that occupies a centre (2,) and heading, or None if they are free."""
        wanted = oriented_rectangle(center, heading_rad, (size_m[0] + 2 * CLEARANCE_M, size_m[1] + CLEARANCE_M))
        for name, track, index in self._occupants:
            is_near = float(np.abs(track.positions[index] - center).max()) < _MAY_TOUCH_M
            if is_near and rectangles_overlap(wanted, track.corners_at(index)):
                return name
        return None

    def check_free(
        self,
        place: Place,
        size_m: tuple[float, float],
        next_step: str,
        *,
        side: int = 0,
        suits: Callable[[Place], bool] = lambda _: True,
    ) -> None:
        """Refuse an occupied place.

        Args:
            place: the place.
            size_m: the length and width of the vehicle.
            next_step: the advice.
            side: 1 if the vehicle should be ahead of another one, -1 if behind, so that places on that side come first.
            suits: whether the vehicle can enter at a free place.

        Raises:
            NotPossible: the error states the occupant and the nearest free places.
        """
        occupant = self.occupant(place, size_m)
        if occupant is not None:
            free = self._free_beyond(place, size_m, side, suits) or self._free_places(place, size_m, suits)
            here = [
                with_values(**dict.fromkeys(_SEVERAL)),
                *(_alone_at(one) for one in _spaced_places(free, size_m[0])),
            ]
            raise NotPossible(
                f"lanelet {place.lanelet_id} at {place.station_m:.1f} m is occupied by {occupant}",
                reason=PLACE_TAKEN,
                valid=_format_places(free),
                next_step=next_step,
                remedies=[*(_at(one) for one in free[:1]), *here],
            )

    def free_places(self, place: Place, size_m: tuple[float, float]) -> list[str]:
        """Return the nearest free places as ``at`` and ``position``, in the same lane or else in adjacent lanes."""
        return _format_places(self._free_places(place, size_m))

    def _free_places(
        self, place: Place, size_m: tuple[float, float], suits: Callable[[Place], bool] = lambda _: True
    ) -> list[Place]:
        lane, table = self.scene.layout.table.lanes[place.lanelet_id], self.scene.layout.table
        sides = [key for key in (lane.left, lane.right) if key is not None and key in table.lanes]
        next_to_it = [*table.successors[place.lanelet_id], *table.predecessors[place.lanelet_id], *sides]
        here = self._free_on([place.lanelet_id], place, size_m, suits)
        return here or self._free_on(next_to_it, place, size_m, suits)

    def _free_beyond(
        self, place: Place, size_m: tuple[float, float], side: int, suits: Callable[[Place], bool]
    ) -> list[Place]:
        """Return the nearest free places ahead of a place (side 1) or behind it (-1) along the lane."""
        table, here = self.scene.layout.table, place.lanelet_id
        if not side:
            return []
        onward = [here, *(table.successors if side > 0 else table.predecessors)[here]]
        free = self._free_on(onward, place, size_m, suits)
        return [one for one in free if one.lanelet_id != here or (one.station_m - place.station_m) * side > 0]

    def _free_on(
        self, lanelets: list[int], place: Place, size_m: tuple[float, float], suits: Callable[[Place], bool]
    ) -> list[Place]:
        """Return free places on the given lanelets, ordered by straight-line distance from a place.

        They keep a standing vehicle's usual gap to others, unless all free places are tighter.
        """
        wanted, lanes = place.pose(self.scene)[0], self.scene.layout.table.lanes
        tried = []
        for key in lanelets:
            for station in np.arange(
                size_m[0] / 2, lanes[key].length_m - size_m[0] / 2 + 1e-6, _SEARCH_STEP_M
            ).tolist():
                distance_m = float(np.linalg.norm(Place(key, station).pose(self.scene)[0] - wanted))
                tried.append((distance_m, key, station))
        gap_m = vehicle_classes()["car"].minimum_gap_m
        spacious_m = size_m[0] + 2 * (gap_m - CLEARANCE_M), size_m[1]
        for needed_m in (spacious_m, size_m):
            places = (Place(key, station) for _, key, station in sorted(tried))
            free = (one for one in places if self.occupant(one, needed_m) is None and suits(one))
            if found := list(islice(free, _FREE_PLACES_FOUND)):
                return found
        return []


_RELATIVE = ("offset_m", "gap_s", "lane")
_SEVERAL = ("count", "spacing_m")
"""Arguments of an edit that place a vehicle relative to another one, and that set how many are added."""
_FREE_PLACES_FOUND = 30
"""Number of free places searched for (chosen): at steps of a metre, enough for three vehicles in a row."""
_PLACES_APART = 3
"""Number of free places, a vehicle's length apart, that a refusal proposes for a single vehicle (chosen)."""


def _format_places(free: Sequence[Place]) -> list[str]:
    return [f"at={one.lanelet_id} position='{one.station_m:.1f}m'" for one in free[:_FREE_PLACES_NAMED]]


def _at(place: Place) -> Remedy:
    """Return the edit with a different place."""
    return with_values(at=str(place.lanelet_id), position=f"{place.station_m:.1f}m", **dict.fromkeys(_RELATIVE))


def _alone_at(place: Place) -> Remedy:
    """Return the change of the edit to a single vehicle at a different place."""
    return Remedy((*_at(place).changes, *with_values(**dict.fromkeys(_SEVERAL)).changes))


def _spaced_places(free: Sequence[Place], length_m: float) -> list[Place]:
    """Return the first free places that are at least a length apart on their lanelets."""
    chosen = list[Place]()
    for place in free:
        near = [one for one in chosen if one.lanelet_id == place.lanelet_id]
        if all(abs(one.station_m - place.station_m) >= length_m for one in near):
            chosen.append(place)
        if len(chosen) == _PLACES_APART:
            break
    return chosen


def _would_reach(
    coming: Track, step: int, center: Points, heading_rad: float, size_m: tuple[float, float], friction: float | None
) -> bool:
    """Return True if a recorded vehicle reaches a rectangle (length, width) although it brakes hard after a step.

    The vehicle stays on its recorded path, within its stopping distance.
    """
    index = coming.index_at(step)
    if index is None:
        return False
    stops_after_m = _stopping_distance_m(max(float(coming.speeds_mps[index]), 0.0), friction)
    place = oriented_rectangle(center, heading_rad, size_m)
    count = int((arc_length(coming.positions[index:]) <= stops_after_m).sum())
    return any(rectangles_overlap(coming.corners_at(at), place) for at in range(index, index + count))


def _stopping_distance_m(speed_mps: float, friction: float | None) -> float:
    """Return a driver's stopping distance at a speed; for a closing speed, the distance that the gap shrinks by."""
    return speed_mps * HARD_BRAKING_REACTION_S + speed_mps**2 / (2 * hardest_braking_mps2(friction))


@dataclass(frozen=True)
class _Neighbour:
    """A vehicle in the lane: how far its centre is ahead of the place (behind negative), its speed and length.

    ``is_parked``: it never moves.
    """

    vehicle_id: int
    distance_m: float
    speed_mps: float
    length_m: float
    is_parked: bool = False

    def gap_m(self, vehicle_class: VehicleClass) -> float:
        """Return the gap to a vehicle of this class at the place, bumper to bumper; 0 if they overlap."""
        return max(abs(self.distance_m) - (self.length_m + vehicle_class.length_m) / 2, 0.0)


@dataclass(frozen=True)
class EntrySpeed:
    """The speed at which a vehicle enters, in m/s, and the reason."""

    speed_mps: float
    reason: str


def entry_speed(
    scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int, route: tuple[int, ...]
) -> EntrySpeed:
    """Return the speed: 80% of the lane's speed, or the speed of the nearest moving vehicle in the lane.

    An ego ahead counts like a moving vehicle. An ego behind does not count, because its planner chooses its speed.
    It is never too fast for the leader, parked or not, nor for the curves of the route, which starts on the place's
    lanelet.

    Raises:
        NotPossible: the vehicle behind would hit it, even if it brakes as hard as it can.
    """
    fastest = min(vehicle_class.maximum_speed_mps, highest_entry_speed(scene, route, place.station_m))
    allowed = _SHARE_OF_LANE_SPEED * scene.driven_speeds_mps[place.lanelet_id]
    usual = min(allowed, fastest)
    reason = f"{_SHARE_OF_LANE_SPEED:.0%} of the lane's speed" if allowed <= fastest else _AS_FAST_AS_IT_CAN
    ahead_too = (one for one in _ego_in_lane(scene, changes, place, step) if one.distance_m > 0)
    neighbours = [*_same_lane(scene, changes, place, step), *ahead_too]
    traffic = [one for one in neighbours if not one.is_parked and abs(one.distance_m) < _LOOK_M]
    nearest = min(traffic, key=lambda one: (abs(one.distance_m), one.distance_m), default=None)
    speed = usual if nearest is None else min(nearest.speed_mps, fastest)
    if nearest is not None:
        alike = nearest.speed_mps <= fastest
        reason = f"like {_name(nearest)}, the nearest in the lane" if alike else _AS_FAST_AS_IT_CAN
    leaders = [one for one in neighbours if one.distance_m > 0]
    if leaders:
        leader = min(leaders, key=lambda one: one.distance_m)
        free = max(leader.gap_m(vehicle_class) - vehicle_class.minimum_gap_m, 0.0)
        can_brake = math.sqrt(leader.speed_mps**2 + 2 * vehicle_class.deceleration_mps2 * free)
        reason = f"so that it can brake for {_name(leader)} ahead" if can_brake < speed else reason
        speed = min(speed, can_brake)
    followers = [one for one in neighbours if one.distance_m <= 0 and not one.is_parked]
    follower = max(followers, key=lambda one: one.distance_m, default=None)
    if follower is None:
        return EntrySpeed(speed, reason)
    # A recorded vehicle may turn off or stop first; a driven vehicle may reach the place even so.
    recorded = None if follower.vehicle_id in changes.driven else scene.tracks.get(follower.vehicle_id)
    size_m, gap = (vehicle_class.length_m, vehicle_class.width_m), follower.gap_m(vehicle_class)
    needed = _stopping_distance_m(max(follower.speed_mps - speed, 0.0), scene.friction)
    if needed > gap and (recorded is None or _would_reach(recorded, step, *place.pose(scene), size_m, scene.friction)):
        raise NotPossible(
            f"a {vehicle_class.name} entering lanelet {place.lanelet_id} at {place.station_m:.1f} m with "
            f"{speed:.1f} m/s would be hit by vehicle {follower.vehicle_id}, which follows {gap:.1f} m behind at "
            f"{follower.speed_mps:.1f} m/s and cannot brake enough",
            reason=HIT_ON_ENTRY,
            valid=[
                f"a place at least {math.ceil(needed)} m ahead of vehicle {follower.vehicle_id}'s front",
                "a place behind it",
                _OWN_SPEED,
            ],
            next_step="choose another place, or give a speed",
        )
    return EntrySpeed(speed, reason)


_OWN_SPEED = "a speed in the edit, with which the collision is reported, not refused"
NO_NEIGHBOURS = "no vehicle ahead in its lane", "no vehicle behind"


def gaps_in_words(
    scene: Scene, changes: Changes, vehicle_class: VehicleClass, place: Place, step: int, speed_mps: float
) -> tuple[str, str]:
    """Return the gaps to the next vehicles ahead and behind: in m between bumpers, and as the follower's time gap."""
    neighbours = [*_same_lane(scene, changes, place, step), *_ego_in_lane(scene, changes, place, step)]
    ahead = min((one for one in neighbours if one.distance_m > 0), key=lambda one: one.distance_m, default=None)
    behind = max((one for one in neighbours if one.distance_m <= 0), key=lambda one: one.distance_m, default=None)
    return (
        NO_NEIGHBOURS[0] if ahead is None else f"{_gap_text(ahead, vehicle_class, speed_mps)} ahead",
        NO_NEIGHBOURS[1] if behind is None else f"{_gap_text(behind, vehicle_class, behind.speed_mps)} behind",
    )


def _gap_text(neighbour: _Neighbour, vehicle_class: VehicleClass, follower_mps: float) -> str:
    gap_m = neighbour.gap_m(vehicle_class)
    headway = f" ({gap_m / follower_mps:.1f} s)" if follower_mps > TIME_GAP_MPS else ""
    return f"{gap_m:.1f} m{headway} to {_name(neighbour)}"


def _name(neighbour: _Neighbour) -> str:
    return "the ego" if neighbour.vehicle_id == _EGO_ID else f"vehicle {neighbour.vehicle_id}"


def _same_lane(scene: Scene, changes: Changes, place: Place, step: int) -> list[_Neighbour]:
    """Return the vehicles on a place's lanelet and on the lanelets directly before and after it."""
    lanes, starts = scene.layout.table.lanes, _lanes_in_a_row(scene, place)
    there, neighbours = scene_for_references(scene, changes), []
    for key, match in sorted(there.matches.items()):
        track: Track | None = there.tracks.get(key) or there.standing.get(key)
        index = track.index_at(step) if track else None
        if track is None or index is None or (lanelet := match.at(index)) not in starts:
            continue
        distance = starts[lanelet] + project(lanes[lanelet].center, track.positions[index])[0] - place.station_m
        speed_mps, is_parked = float(track.speeds_mps[index]), key not in there.tracks
        neighbours.append(_Neighbour(key, distance, speed_mps, track.length_m, is_parked))
    return neighbours


def _lanes_in_a_row(scene: Scene, place: Place) -> dict[int, float]:
    """Return the station in m at which a place's lanelet and those directly before and after it start, by lanelet."""
    lanes = scene.layout.table.lanes
    before = [key for key in scene.lanelet_graph.predecessors.get(place.lanelet_id, ()) if key in lanes]
    starts = {place.lanelet_id: 0.0} | {key: -lanes[key].length_m for key in before}
    return starts | dict.fromkeys(scene.layout.table.successors[place.lanelet_id], lanes[place.lanelet_id].length_m)


def _ego_in_lane(scene: Scene, changes: Changes, place: Place, step: int) -> list[_Neighbour]:
    """Return the ego if it starts in the lane at this step; no recording contains its later positions."""
    ego, starts = changes.ego or scene.ego, _lanes_in_a_row(scene, place)
    key = None if ego is None or ego.step != step else next((each for each in ego.lanelets if each in starts), None)
    if ego is None or key is None:
        return []
    distance = starts[key] + project(scene.layout.table.lanes[key].center, ego.position)[0] - place.station_m
    return [_Neighbour(_EGO_ID, distance, ego.speed_mps, ego.size_m[0])]


def slower_entries(simulated: SimulatedEdits) -> tuple[tuple[Edit, ...], tuple[str, ...]] | None:
    """Return the edits with half or zero speed for those added vehicles that would otherwise hit other road users.

    Returns:
        The edits, and a sentence on each vehicle that enters more slowly; None if there is no such vehicle.
    """
    edits = simulated.edits
    slower, notes, soon = list(edits), [], round(_SOON_S / simulated.scene.step_s) + 1
    for conflict in _conflicts(simulated):
        plan, usual_mps = conflict.plan, float(conflict.plan.start.speeds_mps[0])
        added, other = (simulated.simulated(key) for key in (plan.start.obstacle_id, conflict.other))
        clear = [share for share in _SLOWER_SHARES if _is_clear(_slowed(added, share, soon), other)]
        if clear and usual_mps > 0.0 and slower[conflict.edit].speed is None:
            speed = f"{usual_mps * clear[0]:.1f}"
            slower[conflict.edit] = edits[conflict.edit].model_copy(update={"speed": f"{speed}m/s"})
            why = f"because it would collide with vehicle {conflict.other}"
            notes.append(f"vehicle {added.obstacle_id} enters with {speed} instead of {usual_mps:.1f} m/s, {why}")
    return (tuple(slower), tuple(notes)) if notes else None


def _slowed(track: Track, share: float, states: int) -> Track:
    """Return the first positions and headings of a track that is followed at a share of its speed."""
    indices = np.round(np.arange(min(len(track.positions), states)) * share).astype(int)
    positions, headings_rad, speeds_mps = (
        track.positions[indices],
        track.headings_rad[indices],
        track.speeds_mps[indices],
    )
    return replace(track, positions=positions, headings_rad=headings_rad, speeds_mps=speeds_mps * share)


def _is_clear(track: Track, other: Track) -> bool:
    return next(overlap_steps(track, other), None) is None


def check_entries(simulated: SimulatedEdits) -> None:
    """Refuse entries at places that are occupied or hit, now that the motion of all road users is known.

    Raises:
        NotPossible: the error states the road users in conflict, and free places or times.
    """
    _check_late_entries(simulated)
    _check_not_run_over(simulated)
    _check_shifted(simulated)


def entering_onto_ego(simulated: SimulatedEdits) -> tuple[int, ...]:
    """Return the vehicles that enter later at the ego's position (ordinary driver), by ascending id.

    Such entries are not refused: the ego's planner decides where the ego is later.
    """
    ego = simulated.ego
    if ego is None:
        return ()
    alone = replace(simulated.scene, tracks={ego.obstacle_id: ego}, standing={}, regions=(), ego=None)
    later = {key: start for key, start in simulated.entries.items() if start.first_step > ego.first_step}
    return tuple(key for key, start in later.items() if _occupant_of_start(alone, start, start.first_step) is not None)


def _check_late_entries(edited: EditedScene) -> None:
    """Refuse an entry after the first step at a place where a driven vehicle is at that time."""
    scene = edited.scene
    for key, start in edited.entries.items():
        if start.first_step <= 0:
            continue
        not_yet = {other for other, entry in edited.entries.items() if entry.first_step >= start.first_step}
        tracks = {one: track for one, track in edited.after.tracks.items() if one not in not_yet}
        by_then = replace(edited.after, tracks=tracks)
        occupant = _occupant_of_start(by_then, start, start.first_step)
        if occupant is None:
            continue
        where, free = "the place", list[str]()
        plan = edited.changes.driven.get(key)
        if plan is not None:
            center = scene.layout.table.lanes[plan.lanelets[0]].center
            place = Place(plan.lanelets[0], project(center, start.positions[0])[0])
            where = f"lanelet {place.lanelet_id} at {place.station_m:.1f} m"
            free = OccupiedPlaces.at(by_then, start.first_step).free_places(place, start.size_m)
        later = range(start.first_step + 1, scene.last_step)
        clear = next((step for step in later if _occupant_of_start(by_then, start, step) is None), None)
        raise NotPossible(
            f"{where} is occupied by {occupant} at {start.first_step * scene.step_s:.1f} s after the edits, so "
            f"{start.kind} {key} cannot enter then",
            reason=PLACE_TAKEN,
            valid=free if clear is None else [*free, f"time_s={clear * scene.step_s:g}"],
            next_step="choose a free place or another departure time",
        )


def _occupant_of_start(scene: Scene, start: Track, step: int) -> str | None:
    place = OccupiedPlaces.at(scene, step)
    return place.occupant_at(start.positions[0], float(start.headings_rad[0]), start.size_m)


@dataclass(frozen=True)
class _Conflict:
    """An added vehicle's plan, the index of the edit that left its speed open, and the id of the other vehicle."""

    edit: int
    plan: DrivePlan
    other: int


def _check_not_run_over(simulated: SimulatedEdits) -> None:
    """Refuse an entry if a recorded vehicle, even from another lane, hits it at once and cannot brake enough."""
    scene = simulated.scene
    for conflict in _conflicts(simulated):
        plan, other = conflict.plan, conflict.other
        coming = None if other in simulated.changes.driven else scene.tracks.get(other)
        if coming is None or not _is_run_over(plan.start, coming, plan.from_step, scene.friction):
            continue
        speed_mps = float(coming.speeds_mps[coming.index_at(plan.from_step) or 0])
        raise NotPossible(
            f"the {plan.vehicle_class.name} entering lanelet {plan.lanelets[0]} at "
            f"{plan.from_step * scene.step_s:.1f} s would be hit by vehicle {other}, which arrives there at "
            f"{speed_mps:.1f} m/s and cannot brake enough",
            reason=HIT_ON_ENTRY,
            valid=[*_next_safe_time(simulated, plan), _OWN_SPEED],
            next_step="choose another place or time, or give a speed",
        )


def _conflicts(simulated: SimulatedEdits) -> Iterator[_Conflict]:
    """Yield collisions of added vehicles soon after their entry, if the edit left the speed open."""
    driven = simulated.changes.driven
    left_open = {
        key: index
        for index, step in enumerate(simulated.steps)
        for key in step.added
        if simulated.edits[index].speed is None and key in driven
    }
    for hit in simulated.result.overlaps:
        for key, other in ((hit.first, hit.second), (hit.second, hit.first)):
            if key in left_open and (hit.step - driven[key].from_step) * simulated.scene.step_s <= _SOON_S:
                yield _Conflict(left_open[key], driven[key], other)


def _is_run_over(start: Track, coming: Track, step: int, friction: float | None) -> bool:
    """Return True if a recorded vehicle reaches the place of an entry, however hard it brakes after a step."""
    size = start.length_m + 2 * CLEARANCE_M, start.width_m + CLEARANCE_M
    return _would_reach(coming, step, start.positions[0], float(start.headings_rad[0]), size, friction)


def _next_safe_time(edited: EditedScene, plan: DrivePlan) -> list[str]:
    """Return the first time at which no recorded vehicle reaches the place, as ``time_s``; empty if there is none."""
    scene = edited.scene
    there = [track for key, track in scene.tracks.items() if key not in edited.changes.removed]
    for step in range(plan.from_step + 1, scene.last_step):
        if not any(_is_run_over(plan.start, track, step, scene.friction) for track in there):
            return [f"time_s={step * scene.step_s:g}"]
    return []


def _check_shifted(simulated: SimulatedEdits) -> None:
    """Refuse a time-shifted recording that starts on top of a road user, unless they overlap as recorded."""
    for key, other in _on_top(simulated):
        index = max(
            index
            for index, (edit, step) in enumerate(zip(simulated.edits, simulated.steps, strict=True))
            if edit.op == "shift_time" and {key, other} & set(step.vehicles)
        )
        replays, step_s = simulated.changes.replays, simulated.scene.step_s
        moved = {vehicle: replays[vehicle] for vehicle in simulated.steps[index].vehicles if vehicle in replays}
        steps = round((simulated.edits[index].time_s or 0.0) / step_s)
        raise NotPossible(
            f"vehicle {key} would overlap {'the ego' if other == EGO else f'vehicle {other}'} at "
            f"{replays[key].track.first_step * step_s:.1f} s, when its shifted recording starts",
            valid=_fitting_times(moved, steps, simulated),
            next_step="choose another time_s, or leave the vehicle out",
        )


def _on_top(edited: EditedScene) -> Iterator[tuple[int, int]]:
    """Yield pairs of a time-shifted recording and a road user that it starts on top of.

    The other road users are checked as simulated and also without any hand-over, that is, as they would drive if the
    recording were absent.
    """
    shifted = edited.shifted
    for hit in edited.result.overlaps:
        for key, other in ((hit.first, hit.second), (hit.second, hit.first)):
            if key in shifted and shifted[key].first_step == hit.step:
                yield key, other
    for key, track in shifted.items():
        others = _without(key, edited.requested)
        yield from (
            (key, hit.second) for hit in new_overlaps([track.part(0, 1)], others, shifted, edited.changes.shifts)
        )


def _without(key: int, tracks: Mapping[int, Track]) -> Iterator[Track]:
    return (track for other, track in tracks.items() if other != key)


def _fitting_times(replays: Mapping[int, Replay], requested: int, edited: EditedScene) -> list[str]:
    """Return the ``time_s`` nearest to the requested steps at which the vehicles start clear of all others for 2 s."""
    scene, nearest = edited.scene, []
    for sign in (-1, 1):
        tried = (requested + sign * more for more in range(1, 2 * scene.last_step))
        fitting = next((steps for steps in tried if steps and _fits(replays, steps - requested, edited)), None)
        nearest += [] if fitting is None else [fitting]
    return [f"time_s={steps * scene.step_s:g}" for steps in sorted(nearest, key=lambda steps: abs(steps - requested))]


def _fits(replays: Mapping[int, Replay], more_steps: int, edited: EditedScene) -> bool:
    scene, shifts, moved = edited.scene, edited.changes.shifts, dict[int, Track]()
    for key, replay in replays.items():
        shifts[key] += more_steps
        track = None if replay.recording is None else moved_in_time(replay.recording, shifts[key], scene)
        if track is None:
            return False
        moved[key] = replace(track, length_m=track.length_m + 2 * CLEARANCE_M, width_m=track.width_m + CLEARANCE_M)
    there, states = {**edited.requested, **moved}, round(_SOON_S / scene.step_s) + 1
    return not any(
        new_overlaps([track.part(0, states)], _without(key, there), moved, shifts) for key, track in moved.items()
    )
